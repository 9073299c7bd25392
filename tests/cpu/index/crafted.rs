//! Crafted changes to the bytes of an index.

use super::*;

pub const HEADER_BYTES: usize = 56;
pub const HEADER_PAGE: usize = 4096;

/// Offsets of a node record's fields.
pub mod field {
    pub const ORIGIN: usize = 0;
    pub const POINTS: usize = 24;
    pub const AT: usize = 32;
    pub const SPACING: usize = 40;
    pub const EXTENT: usize = 48;
    pub const COUNT: usize = 60;
    pub const FIRST_CHILD: usize = 124;
    pub const CHILDREN: usize = 128;
    pub const PARENT: usize = 132;
    pub const PLANES: usize = 136;
    pub const LATTICE: usize = 138;
    pub const BITS: usize = 140;
    pub const COARSER: usize = 141;
    pub const BYTES: usize = 144;
}

pub fn number(bytes: &[u8], at: usize) -> u64 {
    u64::from_le_bytes(bytes[at..at + 8].try_into().unwrap())
}

/// Updates the checksums of a changed header and directory.
pub fn signed(mut bytes: Vec<u8>) -> Vec<u8> {
    if let Some(directory) = bytes.get(number(&bytes, 24) as usize..) {
        let crc = crc32c::crc32c(directory);
        bytes[44..48].copy_from_slice(&crc.to_le_bytes());
    }
    bytes[48..52].fill(0);
    let crc = crc32c::crc32c(&bytes[..HEADER_BYTES]);
    bytes[48..52].copy_from_slice(&crc.to_le_bytes());
    bytes
}

/// Replaces the contents of an index, which start at this byte.
pub fn with_contents(bytes: &[u8], at: usize, contents: &[u8]) -> Vec<u8> {
    let mut crafted = [&bytes[..at], contents].concat();
    let length = crafted.len() as u64;
    crafted[16..24].copy_from_slice(&length.to_le_bytes());
    crafted[32..40].copy_from_slice(&(contents.len() as u64).to_le_bytes());
    crafted
}

/// Converts an index to version 1: shorter records, without room for derived planes.
pub fn first_version(bytes: &[u8]) -> Vec<u8> {
    let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
    let long = |at: usize| u64::from_le_bytes(bytes[at..at + 8].try_into().unwrap()) as usize;
    let (nodes, directory_at, contents) = (word(12) as usize, long(24), long(32));
    let record = size_of::<NodeRecord>();
    let records = bytes[directory_at..][..nodes * record]
        .chunks(record)
        .flat_map(|record| [&record[..108], &record[record.len() - 20..]].concat());
    let records: Vec<u8> = records.collect();
    let mut known: serde_json::Value =
        serde_json::from_slice(&bytes[directory_at + nodes * record..][..contents]).unwrap();
    ["oriented", "balance", "intensity_balance", "counts"]
        .into_iter()
        .for_each(|unknown| drop(known.as_object_mut().unwrap().remove(unknown)));
    let directory = [records, serde_json::to_vec(&known).unwrap()].concat();
    let mut first = [&bytes[..directory_at], &directory].concat();
    let length = first.len() as u64;
    first[8..12].copy_from_slice(&1u32.to_le_bytes());
    first[16..24].copy_from_slice(&length.to_le_bytes());
    first[32..40].copy_from_slice(&(directory.len() as u64 - 128 * nodes as u64).to_le_bytes());
    first[44..48].copy_from_slice(&crc32c::crc32c(&directory).to_le_bytes());
    first[48..52].fill(0);
    let crc = crc32c::crc32c(&first[..56]);
    first[48..52].copy_from_slice(&crc.to_le_bytes());
    first
}
