//! A single LAS record with all its fields, in the file's own numbers, parsed with the `las` crate.

use super::super::point_lookup::Extras;
use super::Las;
use crate::cloud::ColumnSet;
use crate::cloud::input::Input;
use crate::error::Result;
use las::Transform;
use las::point::Format;
use std::path::Path;

/// Returns the colour and the extra fields of a record by its number; `None` if there is none, or
/// the crate cannot parse it.
pub fn record(path: &Path, number: u64) -> Result<Option<(Option<[u16; 3]>, Extras)>> {
    let input = Input::open(path)?;
    let las = Las::located(&input, ColumnSet::ALL, true, &mut Vec::new())?;
    let record = las.record(&input, number)?;
    Ok(record.and_then(|record| parsed(&las, &record)))
}

fn parsed(las: &Las, record: &[u8]) -> Option<(Option<[u16; 3]>, Extras)> {
    let extra_bytes = las.layout.extra_width() as u16;
    let format = Format { extra_bytes, ..Format::new(las.layout.format).ok()? };
    let point = las::raw::Point::read_from(record, &format).ok()?;
    let point = las::Point::new(point, &las::Vector::<Transform>::default());
    let flags = [
        (point.is_synthetic, "synthetic"),
        (point.is_key_point, "key point"),
        (point.is_withheld, "withheld"),
        (point.is_overlap, "overlap"),
        (point.is_edge_of_flight_line, "edge of flight line"),
    ];
    let extras = Extras {
        near_infrared: point.nir,
        scan_angle_deg: Some(point.scan_angle),
        user_data: Some(point.user_data),
        flags: flags.into_iter().filter(|(is_so, _)| *is_so).map(|(_, name)| name).collect(),
        extra_bytes: point.extra_bytes,
    };
    Some((point.color.map(|color| [color.red, color.green, color.blue]), extras))
}
