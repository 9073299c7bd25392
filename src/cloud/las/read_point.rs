//! A single LAS record with all its fields, in the file's own numbers, read with the `las` crate.

use super::super::point_lookup::Extras;
use glam::DVec3;
use std::path::Path;

/// Returns the colour and the extra fields of a record; `None` if the crate cannot read the file.
/// `place` is its position, within half a step.
pub fn record(
    path: &Path,
    number: u64,
    place: DVec3,
    step: DVec3,
) -> Option<(Option<[u16; 3]>, Extras)> {
    let point = sought(path, number)
        .filter(|point| is_at(point, place, step))
        .or_else(|| counted(path, number))?;
    let point = is_at(&point, place, step).then_some(point)?;
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

fn is_at(point: &las::Point, place: DVec3, step: DVec3) -> bool {
    (DVec3::new(point.x, point.y, point.z) - place).abs().cmple(0.5 * step.abs()).all()
}

/// Reads a record by seeking. With chunks of varying size, as in COPC, the crate returns another
/// one.
fn sought(path: &Path, number: u64) -> Option<las::Point> {
    let mut reader = las::Reader::from_path(path).ok()?;
    reader.seek(number).ok()?;
    reader.read_points(1).ok()?.points().next()?.ok()
}

/// Reads a record after all before it.
fn counted(path: &Path, number: u64) -> Option<las::Point> {
    const AT_ONCE: u64 = 1 << 16;
    let mut reader = las::Reader::from_path(path).ok()?;
    for _ in 0..number / AT_ONCE {
        reader.read_points(AT_ONCE).ok()?;
    }
    reader.read_points(number % AT_ONCE + 1).ok()?.points().last()?.ok()
}
