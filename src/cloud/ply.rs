//! PLY, ASCII and both binary forms: one part.
//!
//! The vertex element's positions, colours, normals, intensity, class, returns, source and time are
//! read. Other elements only matter if they come before the vertices. Binary records without lists
//! are read by threads at any offset; ASCII in blocks of lines; binary records with lists in
//! sequence, since only the lengths inside them tell where the next begins. Counts are not believed
//! beyond the file's length.

mod header;

use super::floats::{ColorUnit, Floats, Point, Role};
use super::from_floats::ReadPart;
use super::input::{Input, Meter};
use super::{Header, ReadOptions, scalar, text};
use crate::error::Result;
use crate::progress::Progress;
use header::{Coding, Element, Layout, Scalar};
use rayon::prelude::*;
use std::io::{BufReader, Read};

/// Bytes per task: they fit the cache together with the resulting block.
const TASK_BYTES: u64 = 512 << 10;

/// Bytes that decide how the numbers of an ASCII body are written.
const SAMPLE_BYTES: u64 = 16 << 10;
const SAMPLE_LINES: usize = 64;

/// Tasks between two appends, which bounds memory besides the columns.
const TASKS: u64 = 32;

pub fn read(
    input: &Input,
    options: &ReadOptions,
    progress: &dyn Progress,
    notes: &mut Vec<String>,
) -> Result<Vec<ReadPart>> {
    let mut layout = header::read(input)?;
    let Some(index) = layout.elements.iter().position(|element| element.name == "vertex") else {
        return Err(
            input.wrong(format!("has no vertex element, only {} others", layout.elements.len()))
        );
    };
    let (mut scalars, mut read) = (Vec::new(), 0);
    for property in &mut layout.elements[index].properties {
        if property.role == Role::Other && property.length.is_none() {
            scalars.push(scalar::Scalar::named(&property.name).to_string());
            if let Some(asked) = options.wanted.scalars.named(&property.name) {
                property.role = Role::Scalar(asked, read);
                read += 1;
            }
        }
    }
    let vertex = &layout.elements[index];
    let roles: Vec<Role> = vertex.properties.iter().map(|property| property.role).collect();
    for (axis, name) in ["x", "y", "z"].iter().enumerate() {
        if vertex.count > 0 && !roles.contains(&Role::Position(axis)) {
            return Err(input.wrong(format!("has vertices without {name}")));
        }
    }
    let color = vertex
        .properties
        .iter()
        .find(|property| property.role == Role::Color(0))
        .map(|property| property.scalar);
    let (bytes, unit) = match color {
        _ if vertex.is_splats() => (false, ColorUnit::Harmonics),
        Some(Scalar::F32 | Scalar::F64) => (false, ColorUnit::Unit),
        Some(Scalar::U8 | Scalar::I8) | None => (true, ColorUnit::Unit),
        Some(_) => (false, ColorUnit::Fields),
    };
    let positions =
        vertex.properties.iter().filter(|property| matches!(property.role, Role::Position(_)));
    // ASCII decimals are not `f32`, whatever the header declares; they are kept as written.
    let narrow = layout.coding != Coding::Ascii
        && positions.map(|property| property.scalar).all(Scalar::fits_f32);
    let empty = Floats::with_roles(&roles, options.wanted, narrow, bytes);

    let found = match (skip(input, &layout, &layout.elements[..index])?, vertex.record_bytes()) {
        _ if vertex.count == 0 => Found { floats: empty, records: 0 },
        (None, _) => Found { floats: empty, records: 0 },
        (Some(at), _) if layout.coding == Coding::Ascii => {
            let decimal_comma = has_decimal_commas(&input.take(at, SAMPLE_BYTES)?, vertex);
            if decimal_comma {
                notes.push(format!("{}: numbers use decimal commas", input.name()));
            }
            ascii(input, vertex, at, decimal_comma, empty, progress)?
        }
        (Some(at), Some(stride)) => {
            fixed(input, vertex, at, stride, layout.coding == Coding::Big, empty, progress)?
        }
        (Some(at), None) => {
            listed(input, vertex, at, layout.coding == Coding::Big, empty, progress)?
        }
    };
    if found.records < vertex.count {
        let what = format!(
            "header declares {} points, {} could be read; the file ends or is damaged after them",
            vertex.count, found.records
        );
        if options.strict || found.records == 0 {
            return Err(input.wrong(what));
        }
        notes.push(format!("{}: {what}", input.name()));
    }
    if vertex.is_splats() && options.wanted.rgb {
        notes.push(format!(
            "{}: colours are the base colours of Gaussian splats, 0.5 + {HARMONIC} f_dc",
            input.name()
        ));
    }
    let header = Header {
        format: format!("PLY {}", layout.coding.name()),
        points: Some(vertex.count),
        bounds: None,
        faces: layout.elements.iter().any(Element::joins),
        scalars,
        facts: layout.comments.iter().map(|comment| ("comment".into(), comment.clone())).collect(),
        ..Header::default()
    };
    found.floats.into_parts(input, header, unit, None, progress, notes)
}

/// The constant spherical harmonic, 1 / (2 sqrt(pi)).
const HARMONIC: f64 = 0.282_094_79;

/// Sets a field of a point. Colours of splats are computed from coefficients and clamped to 0..=1.
fn set(point: &mut Point, role: Role, value: f64, splats: bool) {
    let is_color = splats && matches!(role, Role::Color(_));
    point.set(role, if is_color { (0.5 + HARMONIC * value).clamp(0.0, 1.0) } else { value });
}

struct Found {
    floats: Floats,
    /// Records read, including skipped ones.
    records: u64,
}

/// Returns where the element after these begins; `None` if the file ends before.
fn skip(input: &Input, layout: &Layout, elements: &[Element]) -> Result<Option<u64>> {
    let mut at = layout.body_at;
    for element in elements {
        if layout.coding == Coding::Ascii {
            let (next, lines) = text::skip_lines(
                input,
                at,
                if element.properties.is_empty() { 0 } else { element.count },
            )?;
            if lines < element.count && !element.properties.is_empty() {
                return Ok(None);
            }
            at = next;
        } else if let Some(stride) = element.record_bytes() {
            match element.count.checked_mul(stride).and_then(|bytes| at.checked_add(bytes)) {
                Some(next) if next <= input.length => at = next,
                _ => return Ok(None),
            }
        } else {
            let mut source = Records {
                source: BufReader::new(input.stream(at)),
                big: layout.coding == Coding::Big,
                bytes: 0,
            };
            for _ in 0..element.count {
                if source.record(element, |_, _| {}).is_none() {
                    return Ok(None);
                }
            }
            at += source.bytes;
        }
    }
    Ok(Some(at))
}

/// Tests whether the first lines are records if commas are decimal marks, and some have one.
fn has_decimal_commas(start: &[u8], vertex: &Element) -> bool {
    let lines = || text::lines(start).take(SAMPLE_LINES.min(vertex.count as usize));
    let is_record = |line: &[u8]| {
        let fields = text::blanks(line).filter(|field| text::number_with(field, true).is_some());
        fields.count() == text::blanks(line).count()
            && header::parse_line(line, &vertex.properties, true, |_, _| {}).is_some()
    };
    // The last line of the sample may be truncated, and one may be damaged.
    let (all, records) = (lines().count(), lines().filter(|line| is_record(line)).count());
    lines().any(|line| line.contains(&b',')) && records * 10 >= all * 9
}

fn ascii(
    input: &Input,
    vertex: &Element,
    at: u64,
    decimal_comma: bool,
    empty: Floats,
    progress: &dyn Progress,
) -> Result<Found> {
    let (end, lines) = text::skip_lines(input, at, vertex.count)?;
    let meter = Meter::new(progress, input, end - at);
    let splats = vertex.is_splats();
    let mut floats = empty.clone().spilling(input);
    // A vertex takes at least two bytes per property; shorter lines are bad ones.
    floats.reserve(lines.min((end - at) / (2 * vertex.properties.len() as u64)) as usize);
    let mut records = 0;
    let parse = |block: &[u8]| {
        let mut floats = empty.clone();
        let mut records = 0u64;
        for line in text::lines(block) {
            let mut point = floats.point();
            if header::parse_line(line, &vertex.properties, decimal_comma, |role, value| {
                set(&mut point, role, value, splats)
            })
            .is_some()
            {
                floats.push(&point);
                records += 1;
            }
        }
        (floats, records)
    };
    text::parse(input, at..end, &meter, parse, |(block, its_records), _| {
        floats.append(block);
        records += its_records;
    })?;
    Ok(Found { floats, records })
}

fn fixed(
    input: &Input,
    vertex: &Element,
    at: u64,
    stride: u64,
    big: bool,
    empty: Floats,
    progress: &dyn Progress,
) -> Result<Found> {
    let records = vertex.count.min((input.length - at) / stride);
    let meter = Meter::new(progress, input, records);
    let splats = vertex.is_splats();
    let mut fields = Vec::new();
    let mut offset = 0;
    for property in &vertex.properties {
        if property.role != Role::Other {
            fields.push((offset, property.scalar, property.role));
        }
        offset += property.scalar.bytes();
    }
    let mut floats = empty.clone().spilling(input);
    floats.reserve(records as usize);
    let task = (TASK_BYTES / stride).max(1);
    for batch in (0..records).step_by((task * TASKS) as usize) {
        let starts: Vec<u64> =
            (batch..records.min(batch + task * TASKS)).step_by(task as usize).collect();
        let blocks = starts
            .into_par_iter()
            .map(|start| {
                let count = (records - start).min(task);
                let mut bytes = vec![0; (count * stride) as usize];
                input.read_exactly(at + start * stride, &mut bytes)?;
                let mut floats = empty.clone();
                floats.reserve(count as usize);
                for record in bytes.chunks_exact(stride as usize) {
                    let mut point = floats.point();
                    for &(offset, scalar, role) in &fields {
                        set(&mut point, role, scalar.value(&record[offset..], big), splats);
                    }
                    floats.push(&point);
                }
                meter.advance(count)?;
                Ok(floats)
            })
            .collect::<Result<Vec<_>>>()?;
        blocks.into_iter().for_each(|block| floats.append(block));
    }
    Ok(Found { floats, records })
}

fn listed(
    input: &Input,
    vertex: &Element,
    at: u64,
    big: bool,
    empty: Floats,
    progress: &dyn Progress,
) -> Result<Found> {
    let meter = Meter::new(progress, input, vertex.count);
    let mut source = Records { source: BufReader::new(input.stream(at)), big, bytes: 0 };
    let splats = vertex.is_splats();
    let mut floats = empty.spilling(input);
    let mut records = 0;
    while records < vertex.count {
        let mut point = floats.point();
        if source.record(vertex, |role, value| set(&mut point, role, value, splats)).is_none() {
            break;
        }
        floats.push(&point);
        records += 1;
        meter.advance(1)?;
    }
    Ok(Found { floats, records })
}

/// A sequential reader of binary records.
struct Records<R: Read> {
    source: R,
    big: bool,
    /// Bytes consumed.
    bytes: u64,
}

impl<R: Read> Records<R> {
    /// Reads the next record; `None` if the file ends inside it. A list takes at least the bytes of
    /// its length, so a large count alone cannot loop for long.
    fn record(&mut self, element: &Element, mut set: impl FnMut(Role, f64)) -> Option<()> {
        for property in &element.properties {
            match property.length {
                None => set(property.role, self.scalar(property.scalar)?),
                Some(length) => {
                    let count = self.scalar(length)?;
                    if count < 0.0 || count.fract() != 0.0 {
                        return None;
                    }
                    self.pass((count as u64).saturating_mul(property.scalar.bytes() as u64))?;
                }
            }
        }
        Some(())
    }

    fn scalar(&mut self, scalar: Scalar) -> Option<f64> {
        let mut bytes = [0; 8];
        self.source.read_exact(&mut bytes[..scalar.bytes()]).ok()?;
        self.bytes += scalar.bytes() as u64;
        Some(scalar.value(&bytes, self.big))
    }

    fn pass(&mut self, count: u64) -> Option<()> {
        let passed =
            std::io::copy(&mut (&mut self.source).take(count), &mut std::io::sink()).ok()?;
        self.bytes += passed;
        (passed == count).then_some(())
    }
}
