//! Well-known text of either version to a system.
//!
//! Input such as `PROJCS["...",GEOGCS[...],UNIT["foot",0.3048]]` gives name, EPSG code, kind and
//! units. Unknown keywords are ignored: writers differ in everything but the brackets. `proj4wkt`
//! parses the projection.

use super::super::catch_panic::catch_panic;
use super::{Crs, Kind, Unit};

/// A keyword and the contents of its brackets.
#[derive(Debug, Default)]
struct Node {
    keyword: String,
    texts: Vec<String>,
    nodes: Vec<Node>,
}

/// Deepest nesting; honest text nests about ten deep.
const DEEPEST: usize = 64;

/// Parses the system of a text; `None` if it is not WKT.
pub fn parse(text: &str) -> Option<Crs> {
    let text = text.trim_matches(|c: char| c == '\0' || c.is_whitespace());
    let root = node(&mut text.chars().peekable(), 0)?;
    let (horizontal, vertical) = root.halves()?;
    let kind = horizontal.kind()?;
    let mut unit = horizontal.length();
    let degrees = (kind == Kind::Geographic).then(|| horizontal.angle());
    let mut height = vertical.and_then(Node::length);
    if kind == Kind::Geographic {
        // The length unit of a geographic system is that of its heights.
        height = height.or(unit.take());
        unit = Some(Unit::default());
    }
    let height_unit = height.filter(|height| unit.as_ref() != Some(height));
    let system = Crs {
        name: horizontal.texts.first().cloned(),
        epsg: horizontal.epsg(),
        kind,
        unit,
        height_unit,
        height_epsg: vertical.and_then(Node::epsg),
        degrees,
        ..Crs::default()
    };
    if system.name.is_none() && system.unit.is_none() && system.epsg.is_none() {
        return None;
    }
    let proj = catch_panic(|| proj4wkt::wkt_to_projstring(text).ok()).ok().flatten();
    Some(system.completed(proj))
}

type Characters<'t> = std::iter::Peekable<std::str::Chars<'t>>;

/// Parses one keyword and its brackets, up to the end of the text.
fn node(text: &mut Characters, depth: usize) -> Option<Node> {
    let keyword = word(text);
    if keyword.is_empty() || depth > DEEPEST || !matches!(text.peek(), Some('[' | '(')) {
        return None;
    }
    text.next();
    let mut own = Node { keyword: keyword.to_uppercase(), ..Node::default() };
    while let Some(&next) = text.peek() {
        match next {
            ']' | ')' => {
                text.next();
                break;
            }
            '"' => own.texts.push(quoted(text)),
            c if c == ',' || c.is_whitespace() => drop(text.next()),
            c if is_part(c) => {
                let mut ahead = text.clone();
                word(&mut ahead);
                if matches!(ahead.peek(), Some('[' | '(')) {
                    own.nodes.push(node(text, depth + 1)?)
                } else {
                    own.texts.push(word(text))
                }
            }
            _ => drop(text.next()),
        }
    }
    Some(own)
}

fn is_part(c: char) -> bool {
    c.is_alphanumeric() || matches!(c, '_' | '.' | '+' | '-')
}

fn word(text: &mut Characters) -> String {
    while text.next_if(|c| c.is_whitespace()).is_some() {}
    let word = std::iter::from_fn(|| text.next_if(|&c| is_part(c))).collect();
    while text.next_if(|c| c.is_whitespace()).is_some() {}
    word
}

/// Parses a quoted string, in which doubled quotes stand for one.
fn quoted(text: &mut Characters) -> String {
    text.next();
    let mut quoted = String::new();
    while let Some(c) = text.next() {
        if c == '"' && text.next_if_eq(&'"').is_none() {
            break;
        }
        quoted.push(c);
    }
    quoted
}

impl Node {
    fn is(&self, keywords: &[&str]) -> bool {
        keywords.contains(&self.keyword.as_str())
    }

    fn find(&self, keywords: &[&str]) -> Option<&Node> {
        self.nodes.iter().find(|node| node.is(keywords))
    }

    /// Returns the horizontal system and the vertical one.
    fn halves(&self) -> Option<(&Node, Option<&Node>)> {
        if self.is(&["BOUNDCRS"]) {
            return self.find(&["SOURCECRS"])?.nodes.first()?.halves();
        }
        if self.is(&["COMPD_CS", "COMPOUNDCRS"]) {
            let (horizontal, within) = self.nodes.first()?.halves()?;
            let vertical = self
                .nodes
                .iter()
                .map(Node::bare)
                .find(|node| node.is(&["VERT_CS", "VERTCRS", "VERTICALCRS", "VERTCS"]));
            return Some((horizontal, vertical.or(within)));
        }
        Some((self, self.find(&["VERTCS"])))
    }

    fn bare(&self) -> &Node {
        let source = if self.is(&["BOUNDCRS"]) { self.find(&["SOURCECRS"]) } else { None };
        source.and_then(|source| source.nodes.first()).unwrap_or(self)
    }

    fn kind(&self) -> Option<Kind> {
        let cartesian = || {
            self.find(&["CS"]).is_some_and(|cs| {
                cs.texts.first().is_some_and(|kind| kind.eq_ignore_ascii_case("cartesian"))
            })
        };
        Some(match self.keyword.as_str() {
            "PROJCS" | "PROJCRS" | "PROJECTEDCRS" => Kind::Projected,
            "GEOCCS" => Kind::Geocentric,
            "GEODCRS" | "GEODETICCRS" | "GEOGCRS" | "GEOGRAPHICCRS" if cartesian() => {
                Kind::Geocentric
            }
            "GEOGCS" | "GEOGCRS" | "GEOGRAPHICCRS" | "GEODCRS" | "GEODETICCRS" => Kind::Geographic,
            "LOCAL_CS" | "ENGCRS" | "ENGINEERINGCRS" => Kind::Local,
            _ => return None,
        })
    }

    fn epsg(&self) -> Option<u32> {
        let code = |node: &&Node| {
            node.is(&["AUTHORITY", "ID"])
                && node.texts.first().is_some_and(|by| by.eq_ignore_ascii_case("epsg"))
        };
        self.nodes.iter().find(code)?.texts.get(1)?.parse().ok()
    }

    /// Returns units of these kinds, its own or those of its axes.
    fn units<'n>(&'n self, keywords: &'n [&'n str]) -> impl Iterator<Item = &'n Node> {
        let axes = self.nodes.iter().filter(|node| node.is(&["AXIS"])).flat_map(|axis| &axis.nodes);
        self.nodes.iter().chain(axes).filter(move |node| node.is(keywords))
    }

    /// Returns the unit of lengths; `UNIT` of a geographic system is one of angles.
    fn length(&self) -> Option<Unit> {
        let keywords: &[&str] = if self.kind() == Some(Kind::Geographic) {
            &["LENGTHUNIT"]
        } else {
            &["UNIT", "LENGTHUNIT"]
        };
        self.units(keywords).find_map(|unit| {
            let name = unit.texts.first()?;
            let factor = unit
                .texts
                .get(1)
                .and_then(|factor| factor.parse::<f64>().ok())
                .filter(|factor| factor.is_finite() && *factor > 0.0);
            factor
                .map(|metres| Unit::of(metres, name))
                .or_else(|| Unit::numbered(unit.epsg()?))
                .or_else(|| named(name))
        })
    }

    /// Returns the degrees per unit of angles.
    fn angle(&self) -> f64 {
        let factor = |unit: &Node| {
            unit.texts
                .get(1)?
                .parse::<f64>()
                .ok()
                .filter(|radians| radians.is_finite() && *radians > 0.0)
        };
        let degrees =
            self.units(&["UNIT", "ANGLEUNIT"]).find_map(factor).map_or(1.0, f64::to_degrees);
        // Files round the number.
        if (degrees - 1.0).abs() < 1e-6 { 1.0 } else { degrees }
    }
}

fn named(name: &str) -> Option<Unit> {
    let name = name.to_lowercase().replace(['_', '-'], " ");
    let has = |word: &str| name.contains(word);
    match () {
        _ if has("metre") || has("meter") => Some(Unit::default()),
        _ if (has("foot") || has("feet") || has("ft")) && (has("us") || has("survey")) => {
            Unit::numbered(9003)
        }
        _ if has("foot") || has("feet") || name == "ft" => Unit::numbered(9002),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_that_is_none_or_ends_early_is_no_panic() {
        let whole = r#"COMPD_CS["a ""b"" c",PROJCS["NAD83 / X",GEOGCS["NAD83",UNIT["degree",0.0174532925199433]],UNIT["US survey foot",0.3048006096012192,AUTHORITY["EPSG","9003"]],AUTHORITY["EPSG","2263"]],VERT_CS["NAVD88",UNIT["metre",1]]]"#;
        for end in 0..=whole.len() {
            let _ = parse(&whole[..end]);
        }
        let found = parse(whole).unwrap();
        assert_eq!(
            (found.epsg, found.kind, found.unit.unwrap().symbol()),
            (Some(2263), Kind::Projected, "ftUS")
        );
        assert_eq!(found.height_unit, Some(Unit::default()));
        assert_eq!((parse(""), parse("WGS 84"), parse(&"A[".repeat(100_000))), (None, None, None));
    }
}
