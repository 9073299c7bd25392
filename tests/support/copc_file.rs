//! COPC files with known points.

use glam::DVec3;
use pointillist::cloud::Lattice;
use pointillist::cloud::las::copc::CopcWriter;
use pointillist::cloud::las::write::Head;
use pointillist::progress::Silent;
use std::path::Path;

/// Writes points of format 7 on a lattice of millimetres, each with its number as its time.
pub fn write_copc(path: &Path, at: &[[i32; 3]], rgb: &[[u8; 3]]) {
    let head = Head {
        minor: 4,
        format: 7,
        extra_bytes: 0,
        compressed: true,
        lattice: Lattice { step: DVec3::splat(0.001), offset: DVec3::ZERO },
        file_source: 0,
        global_encoding: 0,
        system: String::new(),
        records: Vec::new(),
    };
    let mut file = CopcWriter::create(path, head, 64 << 20).unwrap();
    for (i, (at, rgb)) in at.iter().zip(rgb).enumerate() {
        let mut record = Vec::with_capacity(36);
        at.iter().for_each(|v| record.extend(v.to_le_bytes()));
        record.extend((i as u16).to_le_bytes());
        record.extend([0x21 - (i % 2) as u8 * 0x10, 0, i as u8 % 7, 0]);
        record.resize(22, 0);
        record.extend((i as f64).to_le_bytes());
        rgb.iter().for_each(|&v| record.extend((v as u16 * 257).to_le_bytes()));
        file.write(&record).unwrap();
    }
    file.finish(&Silent).unwrap();
}
