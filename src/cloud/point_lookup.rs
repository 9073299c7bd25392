//! Lookup of all attributes of a point by its position. Files are read again, since only displayed
//! attributes are kept in memory.

use super::digits::number;
use super::las::read_point;
use super::stream::{self, Batch, Source};
use super::{ColumnSet, Lattice, ReadOptions, intensity_of};
use crate::error::Result;
use crate::progress::Progress;
use glam::DVec3;
use serde::Serialize;
use std::path::PathBuf;
use std::sync::Mutex;

/// A point to look up.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LookupQuery {
    /// Position as returned by [`Lattice::world`], exact to the last bit.
    pub position: DVec3,
    /// Class and return number, to distinguish coincident points.
    pub kind: Option<[u8; 2]>,
    /// Part number and LAS point source id.
    pub station: Option<(usize, Option<u16>)>,
}

/// All attributes of a point in the file's own numbers: colours of 16 bits a channel in LAS, of 8
/// in other files; `None` if missing.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Record {
    /// Name of the scan or the file.
    pub file: String,
    /// Index in the file, from 0.
    pub point: u64,
    pub rgb: Option<[u16; 3]>,
    pub intensity: Option<f64>,
    pub class: Option<u8>,
    pub return_number: Option<u8>,
    pub returns: Option<u8>,
    /// LAS point source id.
    pub source: Option<u16>,
    /// Unit normal.
    pub normal: Option<[f64; 3]>,
    /// GPS time as in the file `[s]`.
    pub gps_time: Option<f64>,
    /// Fields only LAS has.
    pub extras: Extras,
    /// Number of other points at the same position.
    pub others: u64,
}

/// Fields of a LAS record that are not displayed.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Extras {
    pub near_infrared: Option<u16>,
    pub scan_angle_deg: Option<f32>,
    pub user_data: Option<u8>,
    /// Flags such as synthetic or withheld.
    pub flags: Vec<&'static str>,
    /// Extra bytes as stored.
    pub extra_bytes: Vec<u8>,
}

/// A candidate with its dissimilarity; the first of the most similar ones wins.
struct Candidate {
    unlike: (bool, bool, u64),
    record: Record,
    part: usize,
}

/// Returns the record of a point; `None` if no point has its position. Files are read as before,
/// with all columns.
pub fn find(
    paths: &[PathBuf],
    read: ReadOptions,
    sought: &LookupQuery,
    progress: &dyn Progress,
) -> Result<Option<Record>> {
    let options = ReadOptions { wanted: ColumnSet::ALL, strict: false, ..read };
    let mut best: Option<Candidate> = None;
    let mut found = 0;
    let sources = stream::open(paths, &options, progress, &mut Vec::new())?;
    for (part, source) in sources.iter().enumerate() {
        let Some(steps) = steps_at(&source.lattice(), sought.position) else { continue };
        let here = |batch: &Batch| -> Vec<Candidate> {
            let columns = batch.columns;
            let is_there = |&i: &usize| [columns.x[i], columns.y[i], columns.z[i]] == steps;
            let found = (0..columns.len()).filter(is_there);
            found.map(|i| candidate(sought, part, source, batch, i)).collect()
        };
        // A point of an octree is in one of few nodes, unless the list of these is wrong.
        let mut near = Vec::new();
        let around = source.nodes_around(steps, &mut |batch| near.extend(here(batch)))?;
        let (candidates, available) = match around.filter(|_| !near.is_empty()) {
            Some(available) => (near, available),
            None => {
                let all = Mutex::new(Vec::new());
                let lock = || all.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
                let streamed = source.stream(progress, &|batch| {
                    let here = here(batch);
                    lock().extend(here);
                    Ok(())
                })?;
                (std::mem::take(&mut *lock()), streamed.available)
            }
        };
        found += candidates.len() as u64;
        for mut candidate in candidates {
            candidate.record.rgb.take_if(|_| !available.rgb);
            if best.as_ref().is_none_or(|best| candidate.unlike < best.unlike) {
                best = Some(candidate);
            }
        }
    }
    let Some(Candidate { mut record, part, .. }) = best else { return Ok(None) };
    // Batches do not know the colour range of the whole file yet.
    if sources[part].is_las() {
        let own = read_point::record(sources[part].path(), record.point)?;
        let (rgb, extras) = own.unwrap_or_default();
        (record.rgb, record.extras) = (rgb.filter(|_| record.rgb.is_some()), extras);
    }
    Ok(Some(Record { others: found - 1, ..record }))
}

/// Returns the steps of exactly this position, if any.
fn steps_at(lattice: &Lattice, place: DVec3) -> Option<[i32; 3]> {
    let steps = ((place - lattice.offset) / lattice.step).round();
    let fits = steps.cmpge(DVec3::splat(i32::MIN as f64)).all()
        && steps.cmple(DVec3::splat(i32::MAX as f64)).all();
    let steps = steps.as_i64vec3().to_array();
    (fits && lattice.world(steps) == place).then(|| steps.map(|step| step as i32))
}

fn candidate(
    sought: &LookupQuery,
    part: usize,
    source: &Source,
    batch: &Batch,
    i: usize,
) -> Candidate {
    let columns = batch.columns;
    let returns = columns.returns.as_ref().map(|column| column[i]);
    let record = Record {
        file: source.title(),
        point: batch.first + i as u64,
        rgb: columns.rgb.as_ref().map(|column| column[i].map(u16::from)),
        intensity: columns
            .intensity
            .as_ref()
            .map(|column| intensity_of(column[i], source.intensity_range())),
        class: columns.class.as_ref().map(|column| column[i]),
        return_number: returns.map(|returns| returns & 15),
        returns: returns.map(|returns| returns >> 4),
        source: columns.source.as_ref().map(|column| column[i]),
        normal: columns
            .normal
            .as_ref()
            .map(|column| column[i].map(|component| component as f64 / 127.0)),
        gps_time: columns.gps_time.as_ref().map(|column| column[i]),
        extras: Extras::default(),
        others: 0,
    };
    let kind = [record.class.unwrap_or(0), record.return_number.unwrap_or(0)];
    let is_elsewhere = sought
        .station
        .is_some_and(|(other, id)| other != part || (id.is_some() && id != record.source));
    let unlike = (is_elsewhere, sought.kind.is_some_and(|other| other != kind), record.point);
    Candidate { unlike, record, part }
}

/// Describes everything but the position.
impl std::fmt::Display for Record {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "point {} of {}", self.point, self.file)?;
        if let Some([r, g, b]) = self.rgb {
            write!(f, ", color {r} {g} {b}")?;
        }
        if let Some(intensity) = self.intensity {
            write!(f, ", intensity {intensity}")?;
        }
        if let Some(class) = self.class {
            write!(f, ", class {class}")?;
        }
        if let (Some(number), Some(all)) = (self.return_number, self.returns) {
            write!(f, ", return {number} of {all}")?;
        }
        if let Some(source) = self.source {
            write!(f, ", source {source}")?;
        }
        if let Some([x, y, z]) = self.normal.filter(|normal| *normal != [0.0; 3]) {
            write!(f, ", normal {x:.3} {y:.3} {z:.3}")?;
        }
        if let Some(time) = self.gps_time {
            write!(f, ", time {}", number(time))?;
        }
        write!(f, "{}", self.extras)?;
        if self.others > 0 {
            write!(f, "; {} more in the same place", self.others)?;
        }
        Ok(())
    }
}

impl std::fmt::Display for Extras {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        if let Some(near_infrared) = self.near_infrared {
            write!(f, ", near infrared {near_infrared}")?;
        }
        if let Some(angle) = self.scan_angle_deg {
            write!(f, ", scan angle {angle}°")?;
        }
        if let Some(data) = self.user_data {
            write!(f, ", user data {data}")?;
        }
        self.flags.iter().try_for_each(|flag| write!(f, ", {flag}"))?;
        if !self.extra_bytes.is_empty() {
            write!(f, ", extra bytes {}", hex(&self.extra_bytes))?;
        }
        Ok(())
    }
}

pub fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}
