//! Wavefront OBJ: one part, from the `v` lines.
//!
//! Vertices have the colours that scanners append (`v x y z r g b`, 0 to 1). Of faces only whether
//! there are any is read.

use super::floats::{ColorUnit, Floats, Point};
use super::from_floats::ReadPart;
use super::input::{Input, Meter};
use super::{ColumnSet, Header, ReadOptions, text};
use crate::error::Result;
use crate::progress::Progress;

pub fn read(
    input: &Input,
    options: &ReadOptions,
    progress: &dyn Progress,
    notes: &mut Vec<String>,
) -> Result<Vec<ReadPart>> {
    let there = ColumnSet { rgb: true, ..ColumnSet::default() };
    let meter = Meter::new(progress, input, input.length);
    let mut floats = Floats::new(there, options.wanted, false, false).spilling(input);
    let (mut bad, mut faces) = (0, false);
    let parse = |block: &[u8]| {
        let mut floats = Floats::new(there, options.wanted, false, false);
        let (mut bad, mut faces) = (0u64, false);
        for line in text::lines(block) {
            match line {
                [b'v', rest @ ..] if is_keyword(rest) => match vertex(rest) {
                    Some(point) => floats.push(&point),
                    None => bad += 1,
                },
                [b'f', rest @ ..] => faces |= is_keyword(rest),
                _ => {}
            }
        }
        (floats, bad, faces)
    };
    text::parse(input, 0..input.length, &meter, parse, |(block, its_bad, its_faces), _| {
        floats.append(block);
        bad += its_bad;
        faces |= its_faces;
    })?;
    if bad > 0 {
        let what = format!("{bad} vertex lines are not three numbers and were skipped");
        if options.strict {
            return Err(input.wrong(what));
        }
        notes.push(format!("{}: {what}", input.name()));
    }
    let header = Header { format: "OBJ".into(), faces, ..Header::default() };
    floats.into_parts(input, header, ColorUnit::Guess, None, progress, notes)
}

/// Tests whether the letter before this was a keyword.
fn is_keyword(rest: &[u8]) -> bool {
    rest.first().is_some_and(u8::is_ascii_whitespace)
}

fn vertex(line: &[u8]) -> Option<Point> {
    let mut point = Point::default();
    // A comma is part of a number here, not a delimiter.
    let mut fields = text::blanks(line);
    for value in &mut point.position {
        *value = text::number(fields.next()?)?;
    }
    let rest: [Option<f64>; 3] = std::array::from_fn(|_| fields.next().and_then(text::number));
    if let [Some(r), Some(g), Some(b)] = rest {
        point.color = [r as f32, g as f32, b as f32];
    }
    Some(point)
}
