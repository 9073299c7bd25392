//! Attributes of points, by the names that programs give them, as fields of LAS records.
//!
//! So all that is known of LAS holds for other formats: ranges of colours, scalars by name, export.
//! Attributes without a field become extra bytes.

use super::super::header::{ExtraBytes, Kept, Layout, Vlr, record_bytes};
use super::super::number::{ANGLE_STEP, stored};
use crate::cloud::crs::{self, Crs};
use crate::cloud::input::Input;
use crate::cloud::{ColumnSet, Header, Lattice};
use crate::error::Result;

/// Types of numbers, as in declarations of extra bytes.
pub const U8: u8 = 1;
pub const I8: u8 = 2;
pub const I16: u8 = 4;
pub const I32: u8 = 6;
pub const F32: u8 = 9;

/// Widths of the types from 1 on `[bytes]`.
pub const WIDTHS: [usize; 10] = [1, 1, 2, 2, 4, 4, 8, 8, 4, 8];

/// Most bytes of an attribute that is no number.
const MOST_BYTES: usize = 255;

/// An attribute as a file declares it.
#[derive(Clone, Debug)]
pub struct Attribute {
    pub name: String,
    pub kind: u8,
    /// Numbers a point.
    pub elements: usize,
    /// Factor on values, and offset that is added.
    pub scale: f64,
    pub offset: f64,
    /// The greatest value, if it is stated.
    pub most: Option<f64>,
}

impl Attribute {
    /// Returns the bytes of a point.
    pub fn bytes(&self) -> usize {
        WIDTHS[self.kind as usize - 1] * self.elements
    }
}

/// A field of a record. Numbers are those of an attribute's first element.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Field {
    Position(usize),
    Intensity,
    Return,
    Returns,
    Class,
    /// Bits of the byte of flags, as in formats from 6 on: their shift and number.
    Flags(u32, u32),
    UserData,
    /// Scan angle in [`ANGLE_STEP`], or in degrees.
    Steps,
    Degrees,
    Source,
    Time,
    Color(usize),
    Infrared,
    /// Extra bytes from this place on.
    Extra(usize),
}

impl Field {
    /// Returns the field of a name, if it has one of its own.
    fn named(attribute: &Attribute) -> Option<Field> {
        let letters = attribute.name.chars().filter(|c| c.is_alphanumeric());
        let name: String = letters.flat_map(char::to_lowercase).collect();
        let field = match (name.as_str(), attribute.elements) {
            ("position", 3) => Field::Position(0),
            ("rgb" | "rgba", 3) => Field::Color(0),
            (_, 2..) => return None,
            ("x", _) => Field::Position(0),
            ("y", _) => Field::Position(1),
            ("z", _) => Field::Position(2),
            ("red", _) => Field::Color(0),
            ("green", _) => Field::Color(1),
            ("blue", _) => Field::Color(2),
            ("intensity", _) => Field::Intensity,
            ("returnnumber", _) => Field::Return,
            ("numberofreturns", _) => Field::Returns,
            ("classification", _) => Field::Class,
            ("classificationflags" | "classflags", _) => Field::Flags(0, 4),
            ("synthetic", _) => Field::Flags(0, 1),
            ("keypoint", _) => Field::Flags(1, 1),
            ("withheld", _) => Field::Flags(2, 1),
            ("overlap", _) => Field::Flags(3, 1),
            ("scanchannel" | "scannerchannel", _) => Field::Flags(4, 2),
            ("scandirectionflag", _) => Field::Flags(6, 1),
            ("edgeofflightline", _) => Field::Flags(7, 1),
            ("userdata", _) => Field::UserData,
            ("scanangle", _) if attribute.kind == I16 => Field::Steps,
            ("scanangle" | "scananglerank", _) => Field::Degrees,
            ("pointsourceid", _) => Field::Source,
            ("gpstime", _) => Field::Time,
            ("infrared" | "nearinfrared" | "nir", _) => Field::Infrared,
            _ => return None,
        };
        Some(field)
    }
}

/// The attributes of a file with their fields, and the records that have them.
pub struct Plan {
    pub attributes: Vec<Attribute>,
    fields: Vec<Field>,
    format: u8,
    extra: Vec<ExtraBytes>,
    /// Columns that the attributes fill.
    holds: ColumnSet,
}

/// Where the values of an attribute are: the first byte, and the bytes to the next point.
#[derive(Clone, Copy)]
pub struct Place {
    pub at: usize,
    pub stride: usize,
}

/// What a file says besides its attributes.
pub struct Said {
    pub format: String,
    pub points: u64,
    pub lattice: Lattice,
    pub bounds: Option<[[f64; 3]; 2]>,
    /// Coordinate system: WKT, an EPSG code or a PROJ definition.
    pub system: String,
    pub compressed: bool,
    pub lies: Vec<String>,
}

impl Plan {
    /// Finds the fields of attributes. Errors if there are no positions, or records too wide.
    pub fn new(input: &Input, attributes: Vec<Attribute>) -> Result<Plan> {
        let mut fields: Vec<Option<Field>> = Vec::new();
        for attribute in &attributes {
            // Of two of a name, the second is one more number.
            let field = Field::named(attribute).filter(|field| !fields.contains(&Some(*field)));
            if matches!(field, Some(Field::Position(_))) && attribute.kind != I32 {
                return Err(input.wrong(format!(
                    "stores {} not as 32-bit integers, which are read",
                    attribute.name
                )));
            }
            fields.push(field);
        }
        let has = |field: Field| fields.contains(&Some(field));
        let is_whole = |axis: fn(usize) -> Field| {
            let wide = |k: usize| attributes[k].elements == 3;
            fields.iter().position(|own| *own == Some(axis(0))).is_some_and(wide)
                || (0..3).all(|k| has(axis(k)))
        };
        if !is_whole(Field::Position) {
            return Err(input.wrong("has no positions among its attributes"));
        }
        let most = |field: Field| {
            let found = fields.iter().position(|own| *own == Some(field));
            found.and_then(|k| attributes[k].most).unwrap_or(f64::INFINITY)
        };
        let holds = ColumnSet {
            rgb: is_whole(Field::Color),
            intensity: has(Field::Intensity),
            class: has(Field::Class),
            returns: has(Field::Return),
            source: has(Field::Source),
            gps_time: has(Field::Time),
            ..ColumnSet::ALL
        };
        // Whole degrees of a scan angle are those of older formats.
        let is_rank = |(attribute, field): (&Attribute, &Option<Field>)| {
            *field == Some(Field::Degrees) && matches!(attribute.kind, U8 | I8)
        };
        let is_old = attributes.iter().zip(&fields).any(is_rank)
            && !has(Field::Infrared)
            && most(Field::Class) <= 31.0
            && most(Field::Return).max(most(Field::Returns)) <= 7.0;
        let format = match (is_old, holds.rgb) {
            (true, rgb) => holds.gps_time as u8 + 2 * rgb as u8,
            (false, _) if has(Field::Infrared) => 8,
            (false, rgb) => 6 + rgb as u8,
        };
        let (mut extra, mut at) = (Vec::new(), record_bytes(format) as usize);
        let mut settled = Vec::new();
        for (attribute, field) in attributes.iter().zip(fields) {
            let bytes = attribute.bytes();
            let is_kept = !matches!(field, Some(Field::Color(_))) || holds.rgb;
            let field = field.filter(|_| is_kept).unwrap_or_else(|| {
                let kind = if attribute.elements == 1 { attribute.kind } else { 0 };
                let Attribute { name, scale, offset, .. } = attribute;
                let own = ExtraBytes::plain(name, kind, bytes);
                extra.push(ExtraBytes { scale: *scale, offset: *offset, ..own });
                at += bytes;
                Field::Extra(at - bytes)
            });
            if bytes > MOST_BYTES || at > u16::MAX as usize {
                return Err(input.wrong(format!(
                    "has an attribute {} of {bytes} bytes, in points of {at}: more than records of LAS hold",
                    attribute.name
                )));
            }
            settled.push(field);
        }
        Ok(Plan { attributes, fields: settled, format, extra, holds })
    }

    /// Returns the bytes of a point.
    pub fn row_bytes(&self) -> usize {
        self.attributes.iter().map(Attribute::bytes).sum()
    }

    fn record_bytes(&self) -> usize {
        let extra = self.extra.iter().map(|extra| extra.bytes).sum::<usize>();
        record_bytes(self.format) as usize + extra
    }

    /// Tests whether an attribute is positions, or colours, of three numbers.
    pub fn is_position(&self, attribute: usize) -> bool {
        self.fields[attribute] == Field::Position(0) && self.attributes[attribute].elements == 3
    }

    pub fn is_color(&self, attribute: usize) -> bool {
        self.fields[attribute] == Field::Color(0) && self.attributes[attribute].elements == 3
    }

    /// Returns the layout of the records.
    pub fn layout(&self, said: Said) -> Layout {
        let Said { format, points, lattice, bounds, system, compressed, lies } = said;
        let mut kept = Kept::default();
        let mut keep = |user: &str, record, description: &str, data| {
            let (user, description) = (user.into(), description.into());
            kept.records.push(Vlr { user, record, description, data });
        };
        if !self.extra.is_empty() {
            let data = self.extra.iter().flat_map(ExtraBytes::declared).collect();
            keep("LASF_Spec", 4, "extra bytes", data);
        }
        let known = crs::well_known(&system).map(|text| [text.as_bytes(), &[0]].concat());
        if let Some(data) = known.filter(|data| data.len() <= u16::MAX as usize) {
            keep("LASF_Projection", 2112, "coordinate system", data);
        }
        let mut facts = Vec::new();
        if !system.is_empty() {
            facts.push(("coordinate system".into(), system.clone()));
        }
        let named = self.extra.iter().map(|extra| ("extra attribute".into(), extra.name.clone()));
        facts.extend(named);
        Layout {
            minor: 4,
            format: self.format,
            compressed,
            record_bytes: self.record_bytes(),
            points_at: 0,
            points,
            lattice,
            flips: [0; 3],
            lies,
            tail_at: None,
            laszip: None,
            extra_bytes: self.extra.clone(),
            copc: false,
            header: Header {
                format,
                points: Some(points),
                bounds,
                facts,
                system: Crs::named(&system),
                ..Header::default()
            },
            kept,
            holds: self.holds,
        }
    }

    /// Appends points as records. Errors name an attribute whose value does not fit its field.
    pub fn write(
        &self,
        data: &[u8],
        places: &[Place],
        points: std::ops::Range<usize>,
        out: &mut Vec<u8>,
    ) -> std::result::Result<(), String> {
        let (width, before) = (self.record_bytes(), out.len());
        out.resize(before + points.len() * width, 0);
        for ((attribute, field), place) in self.attributes.iter().zip(&self.fields).zip(places) {
            let own = WIDTHS[attribute.kind as usize - 1];
            let rows = data[place.at..].chunks(place.stride).skip(points.start);
            for ((record, row), i) in out[before..].chunks_exact_mut(width).zip(rows).zip(0..) {
                if let Field::Extra(at) = *field {
                    let bytes = attribute.bytes();
                    record[at..at + bytes].copy_from_slice(&row[..bytes]);
                    continue;
                }
                for element in 0..attribute.elements {
                    let row = &row[element * own..];
                    let value = match attribute.kind {
                        // Writers store signed degrees as bytes.
                        U8 if *field == Field::Degrees => (row[0] as i8).into(),
                        kind => stored(kind, row),
                    };
                    let value = match field {
                        Field::Position(_) => value,
                        _ => value * attribute.scale + attribute.offset,
                    };
                    if self.put(*field, element, value, record).is_none() {
                        return Err(format!(
                            "{} {value} of point {}, which does not fit a point of format {}",
                            attribute.name,
                            points.start + i,
                            self.format
                        ));
                    }
                }
            }
        }
        Ok(())
    }

    /// Writes a value to a field; `None` if it does not fit.
    fn put(&self, field: Field, element: usize, value: f64, record: &mut [u8]) -> Option<()> {
        let is_old = self.format < 6;
        let within = |least: f64, most: f64| {
            let whole = value.round();
            (least..=most).contains(&whole).then_some(whole)
        };
        let mut set = |at: usize, bytes: &[u8]| record[at..at + bytes.len()].copy_from_slice(bytes);
        let word = || within(0.0, 65_535.0).map(|v| (v as u16).to_le_bytes());
        match field {
            Field::Position(axis) => {
                let steps = within(i32::MIN.into(), i32::MAX.into())? as i32;
                set(4 * (axis + element), &steps.to_le_bytes());
            }
            Field::Intensity => set(12, &word()?),
            Field::Return => record[14] |= within(0.0, if is_old { 7.0 } else { 15.0 })? as u8,
            Field::Returns if is_old => record[14] |= (within(0.0, 7.0)? as u8) << 3,
            Field::Returns => record[14] |= (within(0.0, 15.0)? as u8) << 4,
            Field::Class if is_old => record[15] |= within(0.0, 31.0)? as u8,
            Field::Class => set(16, &[within(0.0, 255.0)? as u8]),
            Field::Flags(shift, bits) => {
                let flags = (within(0.0, ((1 << bits) - 1) as f64)? as u8) << shift;
                if is_old {
                    // Overlap and channels came later.
                    record[14] |= flags & 0xC0;
                    record[15] |= (flags & 7) << 5;
                } else {
                    record[15] |= flags;
                }
            }
            Field::UserData => set(17, &[within(0.0, 255.0)? as u8]),
            Field::Degrees if is_old => set(16, &(within(-128.0, 127.0)? as i8).to_le_bytes()),
            Field::Steps | Field::Degrees => {
                let step = if field == Field::Steps { 1.0 } else { ANGLE_STEP };
                let steps = (value / step).round();
                let fits = (i16::MIN.into()..=i16::MAX.into()).contains(&steps);
                set(18, &fits.then_some(steps as i16)?.to_le_bytes());
            }
            Field::Source => set(if is_old { 18 } else { 20 }, &word()?),
            Field::Time => set(if is_old { 20 } else { 22 }, &value.to_le_bytes()),
            Field::Color(channel) => {
                let first = match self.format {
                    2 => 20,
                    3 => 28,
                    _ => 30,
                };
                set(first + 2 * (channel + element), &word()?);
            }
            Field::Infrared => set(36, &word()?),
            Field::Extra(_) => {}
        }
        Some(())
    }
}
