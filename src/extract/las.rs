//! LAS, LAZ and COPC. Points of LAS files of one kind keep their records, bit for bit; others
//! become records of LAS 1.4, which hold the attributes of all formats, and scalars as extra bytes.

use super::fields::{Colors, has_words, intensity, record};
use super::input::{Batch, Input, Part};
use super::{Format, Packed, Sink, Taker};
use crate::cloud::crs::Kind;
use crate::cloud::digits::number;
use crate::cloud::las::copc::{CopcWriter, IN_MEMORY};
use crate::cloud::las::header::{DECLARATION_BYTES, ExtraBytes, Layout, Vlr};
use crate::cloud::las::number::ANGLE_STEP;
use crate::cloud::las::raw::{has_waveform, without_waveform};
use crate::cloud::las::write::{Head, LasWriter};
use crate::cloud::las::{INTENSITY_RANGE, Las};
use crate::cloud::scalar::Scalar;
use crate::cloud::{Header, Lattice};
use crate::error::{Error, Result};
use crate::progress::Progress;
use glam::DVec3;
use std::path::Path;

/// Bits of the global encoding.
const STANDARD_TIME: u16 = 1;
const SYNTHETIC_RETURNS: u16 = 8;
const WKT: u16 = 16;

pub struct Plan<'p> {
    input: &'p Input,
    lattice: Lattice,
    /// Steps from each part's lattice to the file's; `None` if positions are rounded.
    shifts: Vec<Option<[i64; 3]>>,
    /// True if points keep their records: all of these, or what one of another format can hold.
    raw: bool,
    /// The kind of file, and the point format.
    kind: Format,
    format: u8,
    /// Extra bytes of the files' own records.
    extra_bytes: u16,
    /// Scalars that become extra bytes.
    added: Vec<Scalar>,
    /// True if intensities are rounded or stretched, by part.
    intensities: Vec<Intensity>,
}

#[derive(Clone, Copy, PartialEq)]
enum Intensity {
    /// Rounded to a whole number.
    Rounded,
    /// As stored: the range of the file is that of 16 bits.
    Stored,
}

impl<'p> Plan<'p> {
    pub fn new(
        input: &'p Input,
        kind: Format,
        scalars: &[Scalar],
        notes: &mut Vec<String>,
    ) -> Result<Plan<'p>> {
        let parts = input.parts();
        let las: Option<Vec<&Las>> = (0..parts.len()).map(|part| input.las(part)).collect();
        let alike = las.as_ref().and_then(|las| alike(las));
        let (lattice, shifts) = lattice(parts, notes)?;
        let intensities = parts.iter().map(|part| of_intensity(part, notes)).collect();
        let raw = alike.is_some();
        let (format, extra_bytes) = match alike {
            Some(first) => {
                if has_waveform(first.format) || first.kept.has_more {
                    notes.push("waveforms and records behind the points are left out".into());
                }
                let format = without_waveform(first.format);
                let format = if kind == Format::Copc { raised(format) } else { format };
                (format, first.extra_width() as u16)
            }
            None => (modern(input, scalars, notes), 0),
        };
        // Records have these already.
        let has = |scalar: &Scalar| match scalar {
            Scalar::HeightAboveGround => false,
            Scalar::NearInfrared => raw || format == 8,
            Scalar::ScanAngle => true,
            Scalar::Extra(_) => raw,
        };
        let added = scalars.iter().copied().filter(|scalar| !has(scalar)).collect();
        Ok(Plan { input, lattice, shifts, raw, kind, format, extra_bytes, added, intensities })
    }

    pub fn create(&self, path: &Path) -> Result<Box<dyn Taker>> {
        let layout = self.first().map(|las| &las.layout);
        let minor = match layout {
            Some(layout) if self.raw && self.format < 6 => layout.minor.clamp(2, 4),
            _ => 4,
        };
        let many = self.input.points() > u32::MAX as u64;
        let records = self.records(layout);
        let wkt = if records.iter().any(is_wkt) { WKT } else { 0 };
        let kept = layout.map_or(0, |layout| layout.kept.global_encoding);
        let one = layout.filter(|_| self.input.parts().len() == 1);
        let head = Head {
            minor: if many { 4 } else { minor },
            format: self.format,
            extra_bytes: self.extra_bytes + 8 * self.added.len() as u16,
            compressed: self.kind != Format::Las,
            lattice: self.lattice,
            file_source: one.map_or(0, |layout| layout.kept.file_source),
            global_encoding: kept & (STANDARD_TIME | SYNTHETIC_RETURNS) | wkt,
            system: "EXTRACTION".into(),
            records,
        };
        Ok(match self.kind {
            Format::Copc => Box::new(CopcWriter::create(path, head, IN_MEMORY)?),
            _ => Box::new(LasWriter::create(path, head)?),
        })
    }

    fn first(&self) -> Option<&Las> {
        (!self.input.parts().is_empty()).then(|| self.input.las(0)).flatten()
    }

    /// Returns the records of the header: all of files that are alike, else those of the first
    /// one's coordinate system.
    fn records(&self, layout: Option<&Layout>) -> Vec<Vlr> {
        let all = layout.map_or(&[][..], |layout| &layout.kept.records);
        let own = all.iter().filter(|vlr| self.raw || vlr.user == PROJECTION).cloned();
        let mut records: Vec<Vlr> = own.collect();
        // Formats from 6 on name their system by WKT. Files of these formats are as they are.
        let is_older = !self.raw || layout.is_some_and(|layout| layout.format < 6);
        let is_asked = self.kind == Format::Copc || is_older && self.format >= 6;
        if let Some(part) = self.input.parts().first()
            && is_asked
            && !records.iter().any(is_wkt)
        {
            let keys = || keys_of(&part.header).filter(|_| layout.is_none());
            records.extend(wkt_of(&part.header).or_else(keys));
        }
        if !self.added.is_empty() {
            let (user, record) = EXTRA_BYTES;
            let is_it = |vlr: &Vlr| (vlr.user.as_str(), vlr.record) == EXTRA_BYTES;
            let at = records.iter().position(is_it).unwrap_or_else(|| {
                let description = "extra bytes".into();
                records.push(Vlr { user: user.into(), record, description, data: Vec::new() });
                records.len() - 1
            });
            let own = layout.filter(|_| self.raw).map_or(&[][..], |layout| &layout.extra_bytes);
            let declared: usize = own.iter().map(|extra| extra.bytes).sum();
            let data = &mut records[at].data;
            data.truncate(DECLARATION_BYTES * own.len());
            // Bytes of another meaning, so that ours are declared where they are.
            let mut spare = self.extra_bytes as usize - declared;
            while spare > 0 {
                let bytes = spare.min(255);
                data.extend(ExtraBytes::plain("undocumented", 0, bytes).declared());
                spare -= bytes;
            }
            self.added.iter().for_each(|scalar| {
                let name = match scalar {
                    Scalar::Extra(name) if LAS_NAMES.contains(name) => format!("extra_{name}"),
                    Scalar::Extra(name) => name.to_string(),
                    named => named.to_string().replace('-', "_"),
                };
                data.extend(ExtraBytes::plain(&name, F64, 8).declared());
            });
        }
        records
    }

    fn steps(&self, batch: &Batch, i: usize) -> Result<[i32; 3]> {
        let own = batch.steps(i);
        let steps = match self.shifts[batch.part] {
            Some(shift) => [0, 1, 2].map(|axis| own[axis] + shift[axis]),
            None => {
                let place = self.input.parts()[batch.part].own.world(own);
                let steps = ((place - self.lattice.offset) / self.lattice.step).round();
                steps.as_i64vec3().to_array()
            }
        };
        let narrow = steps.map(|v| i32::try_from(v).ok());
        match narrow {
            [Some(x), Some(y), Some(z)] => Ok([x, y, z]),
            _ => Err(too_far()),
        }
    }

    /// Packs a point of any format as one of format 6, 7 or 8.
    fn modern(&self, batch: &Batch, i: usize, steps: [i32; 3], out: &mut Vec<u8>) {
        let (columns, record) = (batch.columns, record(self.input, batch, i));
        let (user_data, flags) =
            record.map_or((0, 0), |record| (record.user_data(), record.flags()));
        let number = |scalar| columns.scalar(scalar).map_or(0.0, |own| own[i]);
        let angle = (number(Scalar::ScanAngle) / ANGLE_STEP).round() as i16;
        let range = self.input.parts()[batch.part].intensity_range;
        let stored = columns.intensity.as_ref().map_or(0, |column| column[i]);
        let intensity = match self.intensities[batch.part] {
            Intensity::Rounded => intensity(stored, range).round() as u16,
            Intensity::Stored => stored,
        };
        let byte = |column: &Option<Vec<u8>>| column.as_ref().map_or(0, |column| column[i]);
        steps.iter().for_each(|v| out.extend(v.to_le_bytes()));
        out.extend(intensity.to_le_bytes());
        // A point that is of no pulse is its own only return.
        let returns = columns.returns.as_ref().map_or(0x11, |column| column[i]);
        out.extend([returns, flags, byte(&columns.class), user_data]);
        out.extend(angle.to_le_bytes());
        out.extend(batch.source(i).to_le_bytes());
        let time = columns.gps_time.as_ref().map_or(0.0, |column| column[i]);
        out.extend(time.to_le_bytes());
        if self.format >= 7 {
            let words = self.raw || has_words(self.input, batch.part);
            let color = Colors::Words.color(batch, record, words, i);
            color.iter().for_each(|v| out.extend(v.to_le_bytes()));
        }
        if self.format == 8 {
            let infrared = number(Scalar::NearInfrared) as u16;
            out.extend(infrared.to_le_bytes());
        }
    }
}

impl Sink for Plan<'_> {
    fn pack(&self, batch: &Batch) -> Result<Packed> {
        let mut packed = Packed::default();
        for &i in &batch.left {
            let steps = self.steps(batch, i as usize)?;
            let own = record(self.input, batch, i as usize).filter(|_| self.raw);
            match own {
                Some(own) if without_waveform(own.format) == self.format => {
                    own.write(steps, &mut packed.bytes);
                }
                _ => {
                    self.modern(batch, i as usize, steps, &mut packed.bytes);
                    let extra = own.as_ref().map_or(&[][..], |own| own.extra_bytes());
                    packed.bytes.extend_from_slice(extra);
                }
            }
            for &scalar in &self.added {
                let own = batch.columns.scalar(scalar);
                let number = own.map_or(f64::NAN, |own| own[i as usize]);
                packed.bytes.extend(number.to_le_bytes());
            }
            packed.ends.push(packed.bytes.len());
        }
        Ok(packed)
    }
}

impl Taker for LasWriter {
    fn take(&mut self, _points: u64, bytes: Vec<u8>) -> Result<()> {
        self.write(&bytes)
    }

    fn finish(self: Box<Self>, _progress: &dyn Progress) -> Result<()> {
        LasWriter::finish(*self)
    }
}

impl Taker for CopcWriter {
    fn take(&mut self, _points: u64, bytes: Vec<u8>) -> Result<()> {
        self.write(&bytes)
    }

    fn finish(self: Box<Self>, progress: &dyn Progress) -> Result<()> {
        CopcWriter::finish(*self, progress)
    }
}

/// User of records about the coordinate system.
const PROJECTION: &str = "LASF_Projection";

/// User and number of the record that declares extra bytes.
const EXTRA_BYTES: (&str, u16) = ("LASF_Spec", 4);

/// Type of extra bytes that are f64.
const F64: u8 = 10;

/// Names that other programs have for fields of records.
const LAS_NAMES: [&str; 8] = [
    "classification",
    "gps_time",
    "intensity",
    "nir",
    "point_source_id",
    "return_number",
    "scan_angle",
    "user_data",
];

/// Returns the first of files whose records have the same fields and meaning.
fn alike<'l>(las: &[&'l Las]) -> Option<&'l Layout> {
    let extra = |layout: &'l Layout| {
        let is_it = |vlr: &&'l Vlr| (vlr.user.as_str(), vlr.record) == EXTRA_BYTES;
        layout.kept.records.iter().find(is_it).map(|vlr| &vlr.data)
    };
    let key = |las: &&'l Las| {
        let layout = &las.layout;
        let time = layout.kept.global_encoding & STANDARD_TIME;
        (layout.format, layout.record_bytes, time, extra(layout))
    };
    let first = las.first()?;
    las.iter().all(|other| key(other) == key(first)).then_some(&first.layout)
}

/// Returns the point format of LAS 1.4 that holds all fields of an older one.
fn raised(format: u8) -> u8 {
    match format {
        0 | 1 => 6,
        2 | 3 => 7,
        modern => modern,
    }
}

/// Returns the point format of LAS 1.4 that holds all attributes. Notes what it does not.
fn modern(input: &Input, scalars: &[Scalar], notes: &mut Vec<String>) -> u8 {
    let parts = input.parts();
    let las: Vec<&Las> = (0..parts.len()).filter_map(|part| input.las(part)).collect();
    if input.is_index() {
        notes.push("an index has no scan angles, near infrared and extra bytes beside the one that it keeps, and no user data, flags and 16-bit colours; exporting its files keeps them".into());
    } else if las.len() > 1 {
        notes.push("the files have different point formats; LAS 1.4 records hold them all".into());
    }
    if las.iter().any(|las| las.layout.has_unnamed_bytes()) {
        notes.push("extra bytes that are no named numbers are left out, since the files declare different ones".into());
    }
    if parts.iter().any(|part| part.available.normal) {
        notes.push("normals are left out; .ply and .csv keep them".into());
    }
    match () {
        () if scalars.contains(&Scalar::NearInfrared) => 8,
        () if parts.iter().any(|part| part.available.rgb) => 7,
        () => 6,
    }
}

fn of_intensity(part: &Part, notes: &mut Vec<String>) -> Intensity {
    let [low, high] = part.intensity_range;
    if !part.available.intensity || [low, high] == INTENSITY_RANGE {
        return Intensity::Stored;
    }
    // A narrower range would leave few steps.
    const FEWEST: f64 = 16.0;
    if low >= 0.0 && high <= 65535.0 && high - low >= FEWEST {
        notes.push(format!("{}: intensities are rounded to whole numbers", part.title));
        Intensity::Rounded
    } else {
        notes.push(format!(
            "{}: intensities from {} to {} become 0 to 65535",
            part.title,
            number(low),
            number(high)
        ));
        Intensity::Stored
    }
}

/// A step that is fine enough for points of any instrument `[m]`.
const FINE: f64 = 1e-4;

/// Returns the lattice of the file, and each part's shift to it: the files' own lattice where they
/// agree, else the finest steps of all.
fn lattice(parts: &[Part], notes: &mut Vec<String>) -> Result<(Lattice, Vec<Option<[i64; 3]>>)> {
    let Some(first) = parts.first().map(|part| part.own) else {
        let unit = Lattice { step: DVec3::splat(0.001), offset: DVec3::ZERO };
        return Ok((unit, Vec::new()));
    };
    let shift = |part: &Part| {
        let steps = (part.own.offset - first.offset) / first.step;
        let whole = steps.round();
        let agrees = part.own.step == first.step
            && (steps - whole).abs().max_element() < 1e-3
            && whole.abs().max_element() < 2f64.powi(31);
        agrees.then(|| whole.as_i64vec3().to_array())
    };
    let shifts: Vec<_> = parts.iter().map(shift).collect();
    if shifts.iter().all(|shift| *shift == Some([0; 3])) {
        return Ok((first, shifts));
    }
    let step = parts.iter().fold(first.step, |step, part| step.min(part.own.step));
    let bounds = parts.iter().filter_map(|part| part.bounds);
    let Some((low, high)) = bounds.reduce(|(a, b), (low, high)| (a.min(low), b.max(high))) else {
        return Ok((first, shifts));
    };
    let agree = shifts.iter().all(Option::is_some);
    let fits = |lattice: &Lattice| {
        let steps = |place: DVec3| ((place - lattice.offset) / lattice.step).abs().max_element();
        steps(low).max(steps(high)) < 2f64.powi(31) - 1.0
    };
    // Finer steps than all of these are given up where the files lie far apart.
    let coarsest = parts.iter().fold(DVec3::splat(FINE), |step, part| step.max(part.own.step));
    let steps = std::iter::successors(Some(step), |step| Some(*step * 2.0));
    let at = |step: DVec3| {
        let to_middle = (((low + high) / 2.0 - first.offset) / step).round() * step;
        let middle = first.offset + to_middle;
        [first.offset, middle].map(|offset| Lattice { step, offset }).into_iter().find(fits)
    };
    let lattice = steps.take_while(|step| step.cmple(coarsest).any()).find_map(at);
    let Some(lattice) = lattice else { return Err(too_far()) };
    if agree && lattice == first {
        return Ok((first, shifts));
    }
    let steps = lattice.step.to_array().map(number).join(" ");
    notes.push(format!(
        "the files have different lattices; positions are rounded to steps of {steps}"
    ));
    Ok((lattice, vec![None; parts.len()]))
}

fn too_far() -> Error {
    Error::Request(
        "the points lie more than 2^32 steps apart, or not where the headers say; export the files one by one, or to .ply or .csv".into(),
    )
}

fn is_wkt(vlr: &Vlr) -> bool {
    vlr.user == PROJECTION && vlr.record == 2112
}

/// Returns a coordinate system as WKT: that of a header, or that of the EPSG code it states.
fn wkt_of(header: &Header) -> Option<Vlr> {
    let system = header.system.as_ref().filter(|system| system.plane.is_none())?;
    let is_wkt = |text: &str| {
        ["PROJCS", "GEOGCS", "GEOCCS", "COMPD_CS", "PROJCRS", "GEOGCRS", "GEODCRS", "COMPOUNDCRS"]
            .iter()
            .any(|word| text.starts_with(word))
    };
    let stated = header.facts.iter().map(|(_, text)| text.as_str()).find(|text| is_wkt(text));
    let known = || Some(crs_definitions::from_code(system.epsg?.try_into().ok()?)?.wkt);
    let data = [stated.or_else(known)?.as_bytes(), &[0]].concat();
    Some(Vlr { user: PROJECTION.into(), record: 2112, description: DESCRIPTION.into(), data })
}

/// Returns a coordinate system as a directory of GeoTIFF keys.
fn keys_of(header: &Header) -> Option<Vlr> {
    let system = header.system.as_ref().filter(|system| system.plane.is_none())?;
    let (model, key) = match system.kind {
        Kind::Projected => (1, 3072),
        Kind::Geographic => (2, 2048),
        Kind::Geocentric | Kind::Local => return None,
    };
    let code = u16::try_from(system.epsg?).ok()?;
    // Two keys: the model, and the code of the system.
    let keys: [u16; 12] = [1, 1, 0, 2, 1024, 0, 1, model, key, 0, 1, code];
    let data = keys.iter().flat_map(|v| v.to_le_bytes()).collect();
    Some(Vlr { user: PROJECTION.into(), record: 34735, description: DESCRIPTION.into(), data })
}

/// Description of records of coordinate systems.
const DESCRIPTION: &str = "coordinate system";
