//! Column names from the lines before the first row, if they fit the rows.

use super::line::{Splitter, is_comment};
use super::sniff::Sampled;
use super::{Delimiter, Reading, Role, names, word};
use crate::cloud::text;

/// The names in a line.
pub struct Names {
    pub line: u64,
    pub names: Vec<String>,
    pub roles: Vec<Role>,
}

/// Statements of the lines before the first row about columns.
#[derive(Default)]
pub struct Heading {
    /// Names of the last line that has some.
    pub names: Option<Names>,
    /// A reason why names do not fit the rows.
    pub misfit: Option<String>,
    /// The same for a comment, which need not be a heading.
    pub unfit: Option<String>,
}

impl Heading {
    /// Finds names for `width` columns. `ends_empty`: the last column is empty, behind a delimiter
    /// at the end.
    pub fn find(before: &[Sampled], reading: Reading, width: usize, ends_empty: bool) -> Heading {
        let mut heading = Heading::default();
        let mut splitter = Splitter::new(Reading { paired: false, ..reading });
        for line in before {
            let remark = is_comment(line.bytes, reading.delimiter);
            let bare = if remark { without_marks(line.bytes) } else { line.bytes };
            let own = words(splitter.split(bare), reading.delimiter);
            // Names may be separated differently from rows.
            let other = words(text::fields(bare).map(<[u8]>::to_vec).collect(), Delimiter::Space);
            let other = if remark || own.len() == 1 { other } else { Vec::new() };
            if own.iter().any(|name| text::number(name.as_bytes()).is_some()) {
                continue;
            }
            let ways = [(&own, reading.delimiter), (&other, Delimiter::Space)];
            // A sentence may have any number of words.
            let is_heading = |names: &[String], fitted: &[String]| {
                let known = roles(fitted).iter().filter(|role| **role != Role::Other).count();
                !remark || names.len() <= width || known * 2 > fitted.len()
            };
            let fitting = ways.into_iter().find_map(|(names, delimiter)| {
                fitted(names, delimiter, width, ends_empty)
                    .filter(|fitted| is_heading(names, fitted))
            });
            match fitting {
                Some(names) => heading.take(line.number, names, remark),
                None if [&own, &other].into_iter().any(|names| has_all(&roles(names))) => {
                    let what = format!(
                        "line {} names {} columns, but rows have {width} fields",
                        line.number,
                        own.len().max(other.len())
                    );
                    match remark {
                        true => heading.unfit = Some(what),
                        false => heading.misfit = Some(format!("{what}; name them with --columns")),
                    }
                }
                None => {}
            }
        }
        // Good names override misfits of other lines.
        if heading.names.as_ref().is_some_and(|names| has_all(&names.roles)) {
            heading.misfit = None;
        }
        heading
    }

    fn take(&mut self, line: u64, names: Vec<String>, remark: bool) {
        let roles = roles(&names);
        let positions: Vec<&str> = roles
            .iter()
            .filter(|role| matches!(role, Role::Position(_)))
            .map(|role| word(*role))
            .collect();
        if (1..3).contains(&positions.len()) && !remark {
            let named = positions.join(" and ");
            self.misfit = Some(format!(
                "line {line} names {named}, but not all of x, y and z; name the columns with --columns"
            ));
        }
        if has_all(&roles)
            || !remark && self.names.as_ref().is_none_or(|names| !has_all(&names.roles))
        {
            self.names = Some(Names { line, names, roles });
        }
    }
}

fn roles(names: &[String]) -> Vec<Role> {
    names::roles(names.iter().map(String::as_str))
}

pub fn has_all(roles: &[Role]) -> bool {
    (0..3).map(Role::Position).all(|role| roles.contains(&role))
}

/// Strips the marks of a comment.
fn without_marks(line: &[u8]) -> &[u8] {
    let line = line.trim_ascii_start();
    &line[line.iter().take_while(|byte| matches!(byte, b'#' | b'/' | b'%' | b';')).count()..]
}

/// Converts fields to names; between blanks a unit belongs to the name before it.
fn words(fields: Vec<Vec<u8>>, delimiter: Delimiter) -> Vec<String> {
    let mut names: Vec<String> = Vec::new();
    for field in fields {
        // Invalid UTF-8 is read as Latin-1.
        let name = String::from_utf8(field)
            .unwrap_or_else(|error| error.as_bytes().iter().map(|&byte| byte as char).collect());
        match names.last_mut() {
            Some(last) if delimiter == Delimiter::Space && name.starts_with(['[', '(']) => {
                *last += &format!(" {name}")
            }
            _ => names.push(name),
        }
    }
    names
}

/// Fits names to the number of columns. A trailing delimiter of names or rows is ignored, and
/// between blanks a name may have several words.
fn fitted(
    names: &[String],
    delimiter: Delimiter,
    width: usize,
    ends_empty: bool,
) -> Option<Vec<String>> {
    let mut names = names.to_vec();
    if names.len() == width + 1 && names.last().is_some_and(String::is_empty) {
        names.pop();
    }
    if names.len() + 1 == width && ends_empty {
        names.push(String::new());
    }
    if names.len() > width && delimiter == Delimiter::Space {
        names = joined(names, width);
    }
    (names.len() == width).then_some(names)
}

/// Joins words to known names, such as `Gps Time`, and then the remaining unknown words.
fn joined(mut names: Vec<String>, width: usize) -> Vec<String> {
    const MOST_WORDS: usize = 4;
    let mut at = 0;
    while at < names.len() && names.len() > width {
        let surplus = names.len() - width;
        // A unit ends a name.
        let is_name = |words: &[String]| {
            words.iter().rev().skip(1).all(|word| !word.contains(['[', '(']))
                && names::role(&words.join(" ")).is_some()
        };
        let length = (2..=MOST_WORDS.min(surplus + 1))
            .rev()
            .find(|length| names.get(at..at + length).is_some_and(is_name));
        join(&mut names, at, length.unwrap_or(1));
        at += 1;
    }
    let mut runs: Vec<(usize, usize)> = Vec::new();
    let unknown = names
        .iter()
        .enumerate()
        .filter(|(_, name)| names::role(name).is_none())
        .map(|(place, _)| place);
    for place in unknown {
        match runs.last_mut() {
            Some((start, length)) if *start + *length == place => *length += 1,
            _ => runs.push((place, 1)),
        }
    }
    let surplus = names.len().saturating_sub(width);
    match runs.as_slice() {
        // If only one run of words can be joined, the others stay in place.
        [(start, length)] if *length > surplus => join(&mut names, *start, surplus + 1),
        runs if runs.iter().map(|(_, length)| length - 1).sum::<usize>() == surplus => {
            runs.iter().rev().for_each(|&(start, length)| join(&mut names, start, length));
        }
        _ => {}
    }
    names
}

/// Joins `length` names from `at` on into one.
fn join(names: &mut Vec<String>, at: usize, length: usize) {
    let name = names[at..at + length].join(" ");
    names.splice(at..at + length, [name]);
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(line: &str, width: usize) -> Option<Vec<String>> {
        let words =
            words(text::blanks(line.as_bytes()).map(<[u8]>::to_vec).collect(), Delimiter::Space);
        fitted(&words, Delimiter::Space, width, false)
    }

    #[test]
    fn names_of_several_words_are_joined_where_only_one_way_fits() {
        assert_eq!(names("Point ID X Y Z", 4).unwrap(), ["Point ID", "X", "Y", "Z"]);
        assert_eq!(
            names("x y z Gps Time Number of Returns", 5).unwrap(),
            ["x", "y", "z", "Gps Time", "Number of Returns"]
        );
        assert_eq!(
            names("X Y Z Illuminance (PCV) Volume density (r=0.01) Nx Ny Nz", 8).unwrap(),
            ["X", "Y", "Z", "Illuminance (PCV) Volume", "density (r=0.01)", "Nx", "Ny", "Nz"]
        );
        assert_eq!(names("X [m] Y [m] Z [m]", 3).unwrap(), ["X [m]", "Y [m]", "Z [m]"]);
        assert_eq!(names("e n z", 3).unwrap(), ["e", "n", "z"]);
        assert!(names("p q x y z u v", 6).is_none());
    }
}
