//! LAS 1.0 to 1.4, LAZ and COPC -> one part.
//!
//! In: a file. Out: its raw i32 coordinates on its own scale and offset, never through f64, and the wanted columns.
//! Records are fixed-width, so threads read and cut their own stretches of the file; LAZ goes chunk by chunk through the `laz` crate's
//! record decoder into the same windows. Nothing but the columns and one block a thread is ever in memory.
//! The file is judged by its own length: what a header promises beyond it is not there, and is said.

pub mod header;
mod laz;
mod records;

use super::input::{Input, Meter};
use super::{Columns, Part, ReadOptions, Wanted, color};
use crate::error::{Error, Result};
use crate::progress::Progress;
use header::Layout;
use rayon::prelude::*;
use records::{Fields, Filled, WINDOW, Window};

pub fn read(input: &Input, options: &ReadOptions, progress: &dyn Progress, notes: &mut Vec<String>) -> Result<Vec<Part>> {
    let layout = header::read(input, notes)?;
    let fields = Fields::new(&layout);
    let mut found = if layout.compressed {
        laz::read(input, &layout, &fields, options.wanted, progress)?
    } else {
        plain(input, &layout, &fields, options.wanted, progress)?
    };
    let depth = records::finish(&mut found.columns, &found.windows);
    let count = found.columns.len() as u64;
    if count != layout.points {
        let because = if found.why.is_empty() { String::new() } else { format!(": {}", found.why) };
        let what = format!("header says {} points, {count} could be read{because}", layout.points);
        if options.strict || count == 0 {
            return Err(input.wrong(what));
        }
        notes.push(format!("{}: {what}", input.name()));
    } else if !found.why.is_empty() {
        notes.push(format!("{}: {}", input.name(), found.why));
    }
    if found.columns.rgb.is_some() && !depth.is_wide() {
        notes.push(format!("{}: {}", input.name(), color::NOTE_8_IN_16));
    }
    Ok(vec![Part {
        path: input.path.clone(),
        name: None,
        header: layout.header,
        lattice: layout.lattice,
        columns: found.columns,
        intensity_range: [0.0, 65535.0],
        rgb_bits: depth.bits(),
    }])
}

/// The columns as the tasks left them, and why there are fewer points than promised, or what else is odd about their number.
struct Found {
    columns: Columns,
    windows: Vec<Filled>,
    why: String,
}

/// Uncompressed records.
fn plain(input: &Input, layout: &Layout, fields: &Fields, wanted: Wanted, progress: &dyn Progress) -> Result<Found> {
    let room = (input.length - layout.points_at) / layout.record_bytes as u64;
    let count = layout.points.min(room) as usize;
    let mut columns = records::columns(count, fields.available(wanted)).ok_or_else(|| no_room(input, count as u64))?;
    let sizes = (0..count).step_by(WINDOW).map(|start| WINDOW.min(count - start));
    let meter = Meter::new(progress, input, count as u64);
    let windows = Window::over(&mut columns)
        .split_into(sizes)
        .into_par_iter()
        .map_init(Vec::new, |block, mut window| {
            block.resize(window.len() * layout.record_bytes, 0);
            input.read_exactly(layout.points_at + (window.start * layout.record_bytes) as u64, block)?;
            window.fill(0, block, fields);
            meter.advance(window.len() as u64)?;
            Ok(window.filled(window.len()))
        })
        .collect::<Result<Vec<_>>>()?;
    let why = if layout.points > room {
        format!("the file ends after byte {}", input.length)
    } else {
        let end = layout.tail_at.unwrap_or(input.length);
        let more = (end.saturating_sub(layout.points_at) / layout.record_bytes as u64).saturating_sub(layout.points);
        if more > 0 { format!("the file has room for {more} more points than its header says; they were not read") } else { String::new() }
    };
    Ok(Found { columns, windows, why })
}

fn no_room(input: &Input, points: u64) -> Error {
    input.wrong(format!("has {points} points, more than fit the memory; index it instead, or ask for fewer attributes"))
}
