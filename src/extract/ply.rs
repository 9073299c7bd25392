//! PLY, binary, little-endian. Positions are doubles, since floats lose millimetres of surveys.

use super::fields::{Colors, Field, Fields, has_words};
use super::input::{Batch, Input};
use super::table::ByteFile;
use super::{Packed, Sink, Taker};
use crate::cloud::{las, scalar};
use crate::error::Result;
use crate::progress::Progress;
use std::io::{Seek, SeekFrom, Write};
use std::path::Path;

pub struct Plan<'p> {
    input: &'p Input,
    fields: Fields,
    /// True if intensities are integers of 16 bits.
    whole: bool,
}

/// Digits of the number of points at most. It is known at the end; a comment fills the rest.
const DIGITS: usize = 20;
const BEFORE_COUNT: &str = "ply\nformat binary_little_endian 1.0\nelement vertex ";

impl<'p> Plan<'p> {
    pub fn new(input: &'p Input, scalars: &[scalar::Scalar], notes: &mut Vec<String>) -> Plan<'p> {
        if (0..input.parts().len())
            .any(|part| has_words(input, part) && input.parts()[part].available.rgb)
        {
            notes.push("colours are rounded to 8 bits a channel, as PLY has them; .las, .laz and .csv keep 16".into());
        }
        let fields = Fields::new(input, Colors::Bytes, scalars, notes);
        let whole = input.parts().iter().all(|part| part.intensity_range == las::INTENSITY_RANGE);
        Plan { input, fields, whole }
    }

    fn kind(&self, field: Field) -> Scalar {
        match field {
            Field::Intensity if !self.whole => Scalar::Float,
            Field::Intensity | Field::Source => Scalar::Ushort,
            Field::Scalar(scalar::Scalar::Extra(_)) | Field::GpsTime => Scalar::Double,
            Field::Normal(_) | Field::Scalar(_) => Scalar::Float,
            _ => Scalar::Uchar,
        }
    }

    pub fn create(&self, path: &Path) -> Result<PlyFile> {
        let mut head = format!("{BEFORE_COUNT}{}\n", counted(0));
        ["x", "y", "z"].iter().for_each(|axis| head += &format!("property double {axis}\n"));
        for (field, name) in &self.fields.fields {
            head += &format!("property {} {name}\n", self.kind(*field).name());
        }
        head += "end_header\n";
        ByteFile::create(path, head.as_bytes()).map(PlyFile)
    }
}

#[derive(Clone, Copy)]
enum Scalar {
    Uchar,
    Ushort,
    Float,
    Double,
}

impl Scalar {
    fn name(self) -> &'static str {
        match self {
            Scalar::Uchar => "uchar",
            Scalar::Ushort => "ushort",
            Scalar::Float => "float",
            Scalar::Double => "double",
        }
    }

    fn put(self, value: f64, out: &mut Vec<u8>) {
        match self {
            Scalar::Uchar => out.push(value as u8),
            Scalar::Ushort => out.extend((value as u16).to_le_bytes()),
            Scalar::Float => out.extend((value as f32).to_le_bytes()),
            Scalar::Double => out.extend(value.to_le_bytes()),
        }
    }
}

impl Sink for Plan<'_> {
    fn pack(&self, batch: &Batch) -> Result<Packed> {
        let mut packed = Packed::default();
        let own = self.input.parts()[batch.part].own;
        for &i in &batch.left {
            let place = own.world(batch.steps(i as usize)).to_array();
            place.iter().for_each(|v| packed.bytes.extend(v.to_le_bytes()));
            for (field, value) in self.fields.values(self.input, batch, i as usize) {
                self.kind(field).put(value, &mut packed.bytes);
            }
            packed.ends.push(packed.bytes.len());
        }
        Ok(packed)
    }
}

/// Returns a number of points and a comment, together of the same length for any number.
fn counted(points: u64) -> String {
    let digits = points.to_string();
    let blanks = DIGITS - digits.len();
    format!("{digits}\ncomment pointillist{:blanks$}", "")
}

pub struct PlyFile(ByteFile);

impl Taker for PlyFile {
    fn take(&mut self, points: u64, bytes: Vec<u8>) -> Result<()> {
        self.0.take(points, bytes)
    }

    fn finish(self: Box<Self>, _progress: &dyn Progress) -> Result<()> {
        let count = counted(self.0.points);
        self.0.finish_with(|file| {
            file.seek(SeekFrom::Start(BEFORE_COUNT.len() as u64))?;
            file.write_all(count.as_bytes())
        })
    }
}
