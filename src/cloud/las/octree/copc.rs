//! The octree of COPC: which LAZ chunk is which node.
//!
//! The list of nodes is in pages, which point at each other. Nothing in it is believed: every node
//! is one chunk of the LAZ table, every chunk is one node, and no page is read twice. So a crafted
//! list can neither run in a circle nor claim more than the file has.

use super::super::header::{array_at, u32_at};
use super::super::{Las, MAGIC, Places, Stretch};
use super::{Key, Octree, OctreeNode, is_inside, named};
use crate::cloud::input::Input;
use crate::error::Result;
use glam::DVec3;
use std::collections::{HashMap, HashSet};

/// Place and length of the information record, which every COPC file has first `[bytes]`.
const INFO_AT: u64 = 375 + 54;
const INFO_BYTES: u64 = 160;

/// Length of a node in a page `[bytes]`.
const ENTRY_BYTES: u64 = 32;

/// Most entries of all pages for each chunk: nodes without points and other pages are entries too.
const ENTRIES_PER_CHUNK: u64 = 8;

/// Tests whether a file says that it is COPC.
pub fn is_copc(input: &Input) -> Result<bool> {
    let head = input.take(0, INFO_AT)?;
    Ok(head.starts_with(MAGIC) && head.get(377..382) == Some(b"copc\0"))
}

/// Reads all pages. Errors say what is wrong with which bytes.
pub fn read(input: &Input, las: &Las) -> Result<Octree> {
    let wrong = |what: String| input.wrong(format!("has an octree {what}"));
    let info = input.take(INFO_AT, INFO_BYTES)?;
    let Places::Known(chunks) = &las.places else {
        return Err(wrong("whose LAZ chunks cannot be located".into()));
    };
    if info.len() < INFO_BYTES as usize || !is_copc(input)? {
        return Err(wrong(format!("without an information record at byte {INFO_AT}")));
    }
    let number = |k: usize| f64::from_le_bytes(array_at(&info, 8 * k));
    let offset = |k: usize| u64::from_le_bytes(array_at(&info, 8 * k));
    let (center, half, spacing) =
        (DVec3::new(number(0), number(1), number(2)), number(3), number(4));
    let is_cube = center.is_finite() && half.is_finite() && half > 0.0;
    if !(is_cube && spacing > 0.0 && spacing <= 2.0 * half) {
        return Err(wrong(format!(
            "of an impossible cube: center {center}, half side {half}, spacing {spacing} (bytes {INFO_AT} to {})",
            INFO_AT + 40
        )));
    }
    let (mut nodes, mut taken) = (HashMap::new(), HashSet::new());
    let mut first = 0;
    let chunks: HashMap<u64, (Stretch, u64)> = chunks
        .iter()
        .filter(|chunk| chunk.points > 0)
        .map(|chunk| {
            first += chunk.points;
            (chunk.at, (*chunk, first - chunk.points))
        })
        .collect();
    let most = ENTRIES_PER_CHUNK * (chunks.len() as u64 + 1);
    let mut pages = vec![(offset(5), offset(6))];
    let (mut seen, mut entries) = (HashSet::from([offset(5)]), 0);
    while let Some((at, bytes)) = pages.pop() {
        if !bytes.is_multiple_of(ENTRY_BYTES)
            || at.checked_add(bytes).is_none_or(|end| end > input.length)
        {
            return Err(wrong(format!(
                "with a page of {bytes} bytes at byte {at}, which the file of {} does not have",
                input.length
            )));
        }
        entries += bytes / ENTRY_BYTES;
        if entries > most {
            return Err(wrong(format!(
                "with more than {most} entries (page at byte {at}), but the file has {} chunks",
                chunks.len()
            )));
        }
        let page = input.take(at, bytes)?;
        for (k, entry) in page.chunks_exact(ENTRY_BYTES as usize).enumerate() {
            let key: Key = [0, 1, 2, 3].map(|i| u32_at(entry, 4 * i) as i32);
            let (start, length) =
                (u64::from_le_bytes(array_at(entry, 16)), u32_at(entry, 24) as i32);
            let points = u32_at(entry, 28) as i32;
            let wrong = |what: String| {
                let place = at + ENTRY_BYTES * k as u64;
                wrong(format!("whose node {} {what} (entry at byte {place})", named(key)))
            };
            if !is_inside(key) {
                return Err(wrong("is outside of the root".into()));
            }
            match points {
                -1 if !seen.insert(start) => {
                    return Err(wrong(format!("points at a page that is known, at byte {start}")));
                }
                -1 => pages.push((start, length as u32 as u64)),
                0 => {}
                _ => {
                    let (chunk, first) = *chunks.get(&start).ok_or_else(|| {
                        wrong(format!("begins at byte {start}, where no chunk does"))
                    })?;
                    let own = [chunk.bytes, chunk.points];
                    if own != [length, points].map(|v| v as i64 as u64) {
                        return Err(wrong(format!(
                            "claims {points} points in {length} bytes, but its chunk has {} in {}",
                            chunk.points, chunk.bytes
                        )));
                    }
                    if !taken.insert(start) {
                        return Err(wrong(format!("has the chunk of another at byte {start}")));
                    }
                    if nodes.insert(key, OctreeNode { key, chunk, first }).is_some() {
                        return Err(wrong("comes twice".into()));
                    }
                }
            }
        }
    }
    if let Some((at, _)) = chunks.iter().find(|(at, _)| !taken.contains(at)) {
        return Err(wrong(format!(
            "with {} nodes for {} chunks: none has that at byte {at}",
            nodes.len(),
            chunks.len()
        )));
    }
    let mut nodes: Vec<OctreeNode> = nodes.into_values().collect();
    nodes.sort_unstable_by_key(|node| node.key);
    let (corner, sides) = (center - half, DVec3::splat(2.0 * half));
    Ok(Octree { corner, sides, spacing, nodes, bytes: input.length })
}
