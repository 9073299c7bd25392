//! LAS and LAZ files of simulated scans: LAS 1.2, point format 3 (time and colour), streamed and
//! atomic (`cloud::las::write`). Records are packed here, 34 bytes each.

use super::chunk::{Chunk, Lattice};
use crate::cloud;
use crate::cloud::las::write::{Head, LasWriter};
use crate::error::{Error, Result};
use glam::DVec3;
use std::path::Path;

const RECORD_BYTES: usize = 34;

pub struct LasFile(LasWriter);

impl LasFile {
    /// Creates a file for `points` points. Errors early if LAS 1.2 cannot count them.
    pub fn create(path: &Path, lattice: Lattice, points: u64) -> Result<LasFile> {
        if points > u32::MAX as u64 {
            return Err(Error::Request(format!(
                "{points} points are more than LAS 1.2 can count ({}); write several files",
                u32::MAX
            )));
        }
        let compressed = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("laz"));
        // No date and no guid: the same seed gives the same bytes on any day.
        let head = Head {
            minor: 2,
            format: 3,
            extra_bytes: 0,
            compressed,
            lattice: cloud::Lattice { step: DVec3::splat(lattice.step), offset: lattice.offset },
            file_source: 0,
            global_encoding: 0,
            system: "SIMULATION".into(),
            records: Vec::new(),
        };
        LasWriter::create(path, head).map(LasFile)
    }

    pub fn write(&mut self, chunk: &Chunk) -> Result<()> {
        let mut bytes = Vec::with_capacity(chunk.len() * RECORD_BYTES);
        for i in 0..chunk.len() {
            let mut record = [0u8; RECORD_BYTES];
            record[0..4].copy_from_slice(&chunk.x[i].to_le_bytes());
            record[4..8].copy_from_slice(&chunk.y[i].to_le_bytes());
            record[8..12].copy_from_slice(&chunk.z[i].to_le_bytes());
            record[12..14].copy_from_slice(&chunk.intensity[i].to_le_bytes());
            let (number, of) = chunk.returns[i];
            record[14] = number & 7 | (of & 7) << 3;
            record[15] = chunk.class[i] & 31;
            record[16] = chunk.scan_angle[i] as u8;
            record[18..20].copy_from_slice(&chunk.source[i].to_le_bytes());
            record[20..28].copy_from_slice(&chunk.gps_time[i].to_le_bytes());
            for (k, value) in chunk.rgb[i].into_iter().enumerate() {
                record[28 + 2 * k..30 + 2 * k].copy_from_slice(&value.to_le_bytes());
            }
            bytes.extend_from_slice(&record);
        }
        self.0.write(&bytes)
    }

    /// Completes the header and renames the file to its final name.
    pub fn finish(self) -> Result<()> {
        self.0.finish()
    }
}
