//! Attributes as numbers with a name, for tables and PLY.

use super::input::{Batch, Input};
use crate::cloud::intensity_of;
use crate::cloud::las::raw::Record;
use crate::cloud::scalar::Scalar;

/// An attribute that a point may have.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Field {
    Color(usize),
    Intensity,
    Class,
    Return,
    Returns,
    Source,
    GpsTime,
    Normal(usize),
    UserData,
    Scalar(Scalar),
}

/// Names that our own readers and common programs know.
const FIELDS: [(Field, &str); 15] = [
    (Field::Color(0), "red"),
    (Field::Color(1), "green"),
    (Field::Color(2), "blue"),
    (Field::Intensity, "intensity"),
    (Field::Class, "classification"),
    (Field::Return, "return_number"),
    (Field::Returns, "number_of_returns"),
    (Field::Source, "point_source_id"),
    (Field::GpsTime, "gps_time"),
    (Field::Normal(0), "nx"),
    (Field::Normal(1), "ny"),
    (Field::Normal(2), "nz"),
    (Field::Scalar(Scalar::ScanAngle), "scan_angle"),
    (Field::UserData, "user_data"),
    (Field::Scalar(Scalar::NearInfrared), "near_infrared"),
];

/// The fields of an input, and how its colours are counted.
pub struct Fields {
    pub fields: Vec<(Field, String)>,
    pub colors: Colors,
}

/// The range of colours that are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Colors {
    Bytes,
    Words,
}

impl Colors {
    /// Returns 16 bits a channel if some LAS file has them.
    pub fn of(input: &Input) -> Colors {
        let has_words = |part: usize| {
            input.las(part).is_some_and(|las| las.available.rgb && las.scale().full > 255.0)
        };
        match (0..input.parts().len()).any(has_words) {
            true => Colors::Words,
            false => Colors::Bytes,
        }
    }

    /// Returns the colour of a point in this range.
    pub fn color(self, batch: &Batch, record: Option<Record>, words: bool, i: usize) -> [u16; 3] {
        let stored = batch.columns.rgb.as_ref().map_or([0; 3], |rgb| rgb[i]);
        match self {
            Colors::Bytes => stored.map(u16::from),
            // The file's own 16 bits, or eight bits in both halves.
            Colors::Words => match record.filter(|_| words).and_then(|record| record.color()) {
                Some(color) => color,
                None => stored.map(|v| v as u16 * 257),
            },
        }
    }
}

/// Returns the record of a point of a LAS file.
pub fn record<'b>(input: &Input, batch: &'b Batch, i: usize) -> Option<Record<'b>> {
    let layout = &input.las(batch.part)?.layout;
    let width = layout.record_bytes;
    let bytes = batch.records.get(i * width..(i + 1) * width)?;
    Some(Record { bytes, format: layout.format })
}

/// Tests whether a part has 16 bits a colour channel.
pub fn has_words(input: &Input, part: usize) -> bool {
    input.las(part).is_some_and(|las| las.scale().full > 255.0)
}

impl Fields {
    /// Returns the fields that some part has, with these scalars. Notes what LAS records have
    /// besides.
    pub fn new(
        input: &Input,
        colors: Colors,
        scalars: &[Scalar],
        notes: &mut Vec<String>,
    ) -> Fields {
        let parts = input.parts();
        let has = |field: Field| {
            let own = |part: usize| {
                let available = parts[part].available;
                let las = input.las(part).map(|las| &las.layout);
                match field {
                    Field::Color(_) => available.rgb,
                    Field::Intensity => available.intensity,
                    Field::Class => available.class,
                    Field::Return | Field::Returns => available.returns,
                    Field::Source => available.source,
                    Field::GpsTime => available.gps_time,
                    Field::Normal(_) => available.normal,
                    Field::UserData => las.is_some(),
                    Field::Scalar(scalar) => scalars.contains(&scalar),
                }
            };
            (0..parts.len()).any(own)
        };
        let las: Vec<_> = (0..parts.len()).filter_map(|part| input.las(part)).collect();
        if las.iter().any(|las| las.layout.has_unnamed_bytes()) {
            notes.push("extra bytes of LAS points that are no named numbers are left out; .las and .laz keep them".into());
        }
        if !las.is_empty() {
            notes.push("flags of LAS points are left out; .las and .laz keep them".into());
        }
        let known = FIELDS.into_iter().filter(|(field, _)| has(*field));
        let mut fields: Vec<(Field, String)> =
            known.map(|(field, name)| (field, name.into())).collect();
        for &scalar in scalars {
            if FIELDS.iter().all(|(field, _)| *field != Field::Scalar(scalar)) {
                let name = own_name(scalar, &fields);
                fields.push((Field::Scalar(scalar), name));
            }
        }
        Fields { fields, colors }
    }

    /// Returns the values of a point, in the order of the fields; where its part lacks one, NaN
    /// of a scalar, and 0 of others.
    pub fn values<'f>(
        &'f self,
        input: &'f Input,
        batch: &'f Batch,
        i: usize,
    ) -> impl Iterator<Item = (Field, f64)> + 'f {
        let columns = batch.columns;
        let (record, part) = (record(input, batch, i), &input.parts()[batch.part]);
        let color = self.colors.color(batch, record, has_words(input, batch.part), i);
        let byte = move |column: &Option<Vec<u8>>| column.as_ref().map_or(0, |column| column[i]);
        let value = move |field: Field| match field {
            Field::Color(channel) => color[channel].into(),
            Field::Intensity => columns
                .intensity
                .as_ref()
                .map_or(0.0, |column| intensity(column[i], part.intensity_range)),
            Field::Class => byte(&columns.class).into(),
            Field::Return => (byte(&columns.returns) & 15).into(),
            Field::Returns => (byte(&columns.returns) >> 4).into(),
            Field::Source => batch.source(i).into(),
            Field::GpsTime => columns.gps_time.as_ref().map_or(0.0, |column| column[i]),
            Field::Normal(axis) => {
                columns.normal.as_ref().map_or(0.0, |column| column[i][axis] as f64 / 127.0)
            }
            Field::UserData => record.map_or(0.0, |record| record.user_data().into()),
            Field::Scalar(scalar) => columns.scalar(scalar).map_or(f64::NAN, |own| own[i]),
        };
        self.fields.iter().map(move |(field, _)| (*field, value(*field)))
    }
}

/// Returns the name of a scalar among those of fields, in one word that means nothing else.
fn own_name(scalar: Scalar, fields: &[(Field, String)]) -> String {
    let name = match scalar {
        Scalar::Extra(name) => {
            name.replace(|c: char| c.is_whitespace() || c == ',' || c == '"', "_")
        }
        named => named.to_string().replace('-', "_"),
    };
    let is_taken = |taken: &str| taken.eq_ignore_ascii_case(&name);
    let read = FIELDS.iter().filter(|(field, _)| *field != Field::UserData).map(|(_, name)| *name);
    let own = fields.iter().map(|(_, name)| name.as_str());
    match read.chain(own).chain(["x", "y", "z"]).any(is_taken) {
        true => format!("extra_{name}"),
        false => name,
    }
}

/// Returns an intensity in the file's own numbers.
pub fn intensity(stored: u16, range: [f64; 2]) -> f64 {
    if range == crate::cloud::las::INTENSITY_RANGE {
        stored.into()
    } else {
        intensity_of(stored, range)
    }
}
