//! Wavefront OBJ: one part, from the `v` lines.
//!
//! Vertices have the colours that scanners append (`v x y z r g b`, 0 to 1). Faces are ignored.

use super::from_floats::{ColorUnit, Floats, Point, ReadPart};
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
    let mut bad = 0;
    let parse = |block: &[u8]| {
        let mut floats = Floats::new(there, options.wanted, false, false);
        let mut bad = 0u64;
        for line in text::lines(block)
            .filter_map(|line| line.strip_prefix(b"v"))
            .filter(|line| line.first().is_some_and(u8::is_ascii_whitespace))
        {
            match vertex(line) {
                Some(point) => floats.push(&point),
                None => bad += 1,
            }
        }
        (floats, bad)
    };
    text::parse(input, 0..input.length, &meter, parse, |(block, its_bad), _| {
        floats.append(block);
        bad += its_bad;
    })?;
    if bad > 0 {
        let what = format!("{bad} vertex lines are not three numbers and were skipped");
        if options.strict {
            return Err(input.wrong(what));
        }
        notes.push(format!("{}: {what}", input.name()));
    }
    let header = Header { format: "OBJ".into(), ..Header::default() };
    floats.into_parts(input, header, ColorUnit::Guess, None, notes)
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
