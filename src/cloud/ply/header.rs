//! The PLY header: elements, their properties, and the beginning of the body. Counts are checked
//! where the body is read.

use crate::cloud::floats::Role;
use crate::cloud::input::Input;
use crate::cloud::text;
use crate::error::Result;

pub struct Layout {
    pub coding: Coding,
    pub elements: Vec<Element>,
    pub body_at: u64,
    /// Comments and object information, in the file's own words.
    pub comments: Vec<String>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Coding {
    Ascii,
    Little,
    Big,
}

impl Coding {
    pub fn name(self) -> &'static str {
        match self {
            Coding::Ascii => "ascii",
            Coding::Little => "binary_little_endian",
            Coding::Big => "binary_big_endian",
        }
    }
}

pub struct Element {
    pub name: String,
    pub count: u64,
    pub properties: Vec<Property>,
}

impl Element {
    /// Keeps coefficients of splats as colours only if there are no others.
    fn choose_colors(&mut self) {
        if self
            .properties
            .iter()
            .any(|property| matches!(property.role, Role::Color(_)) && !property.harmonic)
        {
            self.properties
                .iter_mut()
                .filter(|property| property.harmonic)
                .for_each(|property| property.role = Role::Other);
        }
    }

    /// Tests whether it joins vertices to surfaces.
    pub fn joins(&self) -> bool {
        ["face", "tristrips"].contains(&self.name.as_str()) && self.count > 0
    }

    /// Tests whether colours are coefficients of Gaussian splats.
    pub fn is_splats(&self) -> bool {
        self.properties.iter().any(|property| property.harmonic && property.role != Role::Other)
    }

    /// Returns the bytes of a binary record; `None` if it has lists, whose lengths are in the body.
    pub fn record_bytes(&self) -> Option<u64> {
        self.properties
            .iter()
            .map(|property| property.length.is_none().then_some(property.scalar.bytes() as u64))
            .sum()
    }
}

pub struct Property {
    pub name: String,
    pub role: Role,
    /// True if it is a coefficient of a Gaussian splat, from which the colour is computed.
    pub harmonic: bool,
    pub scalar: Scalar,
    /// The type of a list's length; `None` for a single value.
    pub length: Option<Scalar>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Scalar {
    fn named(name: &[u8]) -> Option<Self> {
        Some(match name {
            b"char" | b"int8" => Scalar::I8,
            b"uchar" | b"uint8" => Scalar::U8,
            b"short" | b"int16" => Scalar::I16,
            b"ushort" | b"uint16" => Scalar::U16,
            b"int" | b"int32" => Scalar::I32,
            b"uint" | b"uint32" => Scalar::U32,
            b"float" | b"float32" => Scalar::F32,
            b"double" | b"float64" => Scalar::F64,
            _ => return None,
        })
    }

    pub fn bytes(self) -> usize {
        match self {
            Scalar::I8 | Scalar::U8 => 1,
            Scalar::I16 | Scalar::U16 => 2,
            Scalar::I32 | Scalar::U32 | Scalar::F32 => 4,
            Scalar::F64 => 8,
        }
    }

    /// Tests whether every value of this type is an `f32`.
    pub fn fits_f32(self) -> bool {
        !matches!(self, Scalar::I32 | Scalar::U32 | Scalar::F64)
    }

    /// Decodes the value at the beginning of `bytes`, which hold at least [`Scalar::bytes`].
    #[inline]
    pub fn value(self, bytes: &[u8], big: bool) -> f64 {
        macro_rules! read {
            ($type:ty) => {{
                let mut own = [0; size_of::<$type>()];
                own.copy_from_slice(&bytes[..size_of::<$type>()]);
                (if big { <$type>::from_be_bytes(own) } else { <$type>::from_le_bytes(own) }) as f64
            }};
        }
        match self {
            Scalar::I8 => read!(i8),
            Scalar::U8 => read!(u8),
            Scalar::I16 => read!(i16),
            Scalar::U16 => read!(u16),
            Scalar::I32 => read!(i32),
            Scalar::U32 => read!(u32),
            Scalar::F32 => read!(f32),
            Scalar::F64 => read!(f64),
        }
    }
}

/// Longest header `[bytes]`.
const HEADER_BYTES: u64 = 1 << 20;

pub fn read(input: &Input) -> Result<Layout> {
    let start = input.take(0, HEADER_BYTES)?;
    let end = if ends_in_returns(&start) { b'\r' } else { b'\n' };
    let mut layout =
        Layout { coding: Coding::Ascii, elements: Vec::new(), body_at: 0, comments: Vec::new() };
    let mut has_format = false;
    let mut at = 0;
    for (number, line) in start.split_inclusive(|&byte| byte == end).enumerate() {
        at += line.len();
        let wrong = |what: String| input.wrong(format!("header line {}: {what}", number + 1));
        let words: Vec<&[u8]> =
            line.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty()).collect();
        match words.as_slice() {
            [] | [b"ply"] => {}
            [b"format", coding, ..] => {
                layout.coding = match *coding {
                    b"ascii" => Coding::Ascii,
                    b"binary_little_endian" => Coding::Little,
                    b"binary_big_endian" => Coding::Big,
                    other => {
                        return Err(wrong(format!("unknown format {}", shown(other))));
                    }
                };
                has_format = true;
            }
            [b"comment" | b"obj_info", rest @ ..] => layout
                .comments
                .push(rest.iter().map(|word| shown(word)).collect::<Vec<_>>().join(" ")),
            [b"element", name, count] => {
                let count = std::str::from_utf8(count).ok().and_then(|text| text.parse().ok());
                let count = count.ok_or_else(|| {
                    wrong(format!("the count of {} is not a number", shown(name)))
                })?;
                layout.elements.push(Element { name: shown(name), count, properties: Vec::new() });
            }
            [b"property", kind @ .., name] => {
                let scalar = |word: &[u8]| {
                    Scalar::named(word)
                        .ok_or_else(|| wrong(format!("unknown type {}", shown(word))))
                };
                let (length, scalar) = match kind {
                    [b"list", length, value] => (Some(scalar(length)?), scalar(value)?),
                    [value] => (None, scalar(value)?),
                    _ => return Err(wrong("this is not a property".into())),
                };
                let role = if length.is_some() { Role::Other } else { role(&shown(name)) };
                let harmonic =
                    length.is_none() && matches!(*name, b"f_dc_0" | b"f_dc_1" | b"f_dc_2");
                let element = layout
                    .elements
                    .last_mut()
                    .ok_or_else(|| wrong("a property before any element".into()))?;
                let name = shown(name);
                element.properties.push(Property { name, role, harmonic, scalar, length });
            }
            [b"end_header"] => {
                if !has_format {
                    return Err(wrong("no format line came before the end of the header".into()));
                }
                layout.body_at = at as u64;
                layout.elements.iter_mut().for_each(Element::choose_colors);
                return Ok(layout);
            }
            [word, ..] => {
                return Err(wrong(format!(
                    "{} is not a header line; the file is truncated or not PLY",
                    shown(word)
                )));
            }
        }
    }
    Err(input.wrong(format!(
        "has no end_header within its first {} bytes; it is truncated or not PLY",
        start.len()
    )))
}

/// Tests by the first line whether lines end in CR alone.
fn ends_in_returns(start: &[u8]) -> bool {
    let end = start.iter().position(|byte| matches!(byte, b'\r' | b'\n'));
    end.is_some_and(|at| start[at] == b'\r' && start.get(at + 1) != Some(&b'\n'))
}

fn role(name: &str) -> Role {
    match name.to_lowercase().as_str() {
        "x" => Role::Position(0),
        "y" => Role::Position(1),
        "z" => Role::Position(2),
        "red" | "r" | "diffuse_red" | "f_dc_0" => Role::Color(0),
        "green" | "g" | "diffuse_green" | "f_dc_1" => Role::Color(1),
        "blue" | "b" | "diffuse_blue" | "f_dc_2" => Role::Color(2),
        "nx" => Role::Normal(0),
        "ny" => Role::Normal(1),
        "nz" => Role::Normal(2),
        "intensity" | "scalar_intensity" => Role::Intensity,
        "class" | "classification" | "scalar_classification" => Role::Class,
        "return_number" | "scalar_returnnumber" => Role::Return,
        "number_of_returns" | "scalar_numberofreturns" => Role::Returns,
        "point_source_id" | "scalar_pointsourceid" => Role::Source,
        "gps_time" | "scalar_gpstime" => Role::Time,
        _ => Role::Other,
    }
}

/// Quotes a few bytes of a file for a message.
fn shown(word: &[u8]) -> String {
    String::from_utf8_lossy(&word[..word.len().min(64)]).escape_debug().to_string()
}

/// Sets the fields of a line of an ASCII body; `None` if it is not such a record. With decimal
/// commas, only blanks separate numbers.
pub fn parse_line(
    line: &[u8],
    properties: &[Property],
    decimal_comma: bool,
    set: impl FnMut(Role, f64),
) -> Option<()> {
    if decimal_comma {
        parse_fields(text::blanks(line), properties, |field| text::number_with(field, true), set)
    } else {
        parse_fields(text::fields(line), properties, text::number, set)
    }
}

fn parse_fields<'a>(
    mut fields: impl Iterator<Item = &'a [u8]>,
    properties: &[Property],
    number: impl Fn(&[u8]) -> Option<f64>,
    mut set: impl FnMut(Role, f64),
) -> Option<()> {
    for property in properties {
        match property.length {
            None if property.role == Role::Other => drop(fields.next()?),
            None => set(property.role, number(fields.next()?)?),
            Some(_) => {
                let length: u32 = std::str::from_utf8(fields.next()?).ok()?.parse().ok()?;
                for _ in 0..length {
                    fields.next()?;
                }
            }
        }
    }
    Some(())
}
