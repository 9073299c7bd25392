//! NAME.N.part: the nodes that one job of a plan has built.
//!
//! ```text
//! header, 4096 bytes   magic, version, lengths, CRC-32C
//! planes               as in an index
//! directory            node records, children of every node, and as JSON the plan's hash, the job,
//!                      and of every cell: its nodes, those without a parent, and the CRC-32C of
//!                      its planes
//! ```
//!
//! All integers are little-endian. The header is written last (guide: reliability).

use super::build_chunk::{BuiltNode, OpenNode};
use crate::cloud::input::Input;
use crate::config::POINTS_PER_PAGE;
use crate::error::{Error, Result};
use crate::index::format::{NodeRecord, Writer};
use bytemuck::{Pod, Zeroable};
use serde::{Deserialize, Serialize};
use std::path::Path;

const MAGIC: [u8; 8] = *b"pntp\r\n\x1a\n";
const VERSION: u32 = 1;

/// Bytes that are copied at a time.
const BLOCK: u64 = 4 << 20;

#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct FileHeader {
    magic: [u8; 8],
    version: u32,
    nodes: u32,
    length: u64,
    directory_at: u64,
    contents_bytes: u64,
    directory_crc: u32,
    header_crc: u32,
}

impl FileHeader {
    fn own_crc(&self) -> u32 {
        crc32c::crc32c(bytemuck::bytes_of(&FileHeader { header_crc: 0, ..*self }))
    }
}

#[derive(Serialize, Deserialize)]
struct PartContents {
    /// Hash of the plan.
    plan: String,
    job: usize,
    cells: Vec<StoredCell>,
}

#[derive(Serialize, Deserialize)]
struct StoredCell {
    nodes: usize,
    open: Vec<u32>,
    planes_crc: u32,
}

/// A cell whose nodes are written: their end, the end of their planes, and those without a parent.
pub struct WrittenCell {
    pub nodes_end: usize,
    pub end: u64,
    pub open: Vec<OpenNode>,
}

/// Completes a part whose planes are written. Returns its length.
pub fn write(
    writer: Writer,
    (plan, job): (String, usize),
    nodes: &[BuiltNode],
    cells: &[WrittenCell],
) -> Result<u64> {
    let (mut first, mut end, mut stored) = (0, Writer::START, Vec::new());
    for cell in cells {
        let mut planes_crc = 0;
        for at in (end..cell.end).step_by(BLOCK as usize) {
            let mut block = vec![0; BLOCK.min(cell.end - at) as usize];
            writer.get(at, &mut block)?;
            planes_crc = crc32c::crc32c_append(planes_crc, &block);
        }
        let open = cell.open.iter().map(|open| open.node).collect();
        stored.push(StoredCell { nodes: cell.nodes_end - first, open, planes_crc });
        (first, end) = (cell.nodes_end, cell.end);
    }
    let contents = serde_json::to_vec(&PartContents { plan, job, cells: stored })
        .map_err(|error| Error::Request(error.to_string()))?;
    let records: Vec<NodeRecord> = nodes
        .iter()
        .map(|node| NodeRecord { children: node.children.len() as u32, ..node.record })
        .collect();
    let children: Vec<u32> = nodes.iter().flat_map(|node| node.children.iter().copied()).collect();
    let parts: [&[u8]; 3] =
        [bytemuck::cast_slice(&records), bytemuck::cast_slice(&children), &contents];
    let (mut length, mut directory_crc) = (end, 0);
    for part in parts {
        writer.put(length, part)?;
        length += part.len() as u64;
        directory_crc = crc32c::crc32c_append(directory_crc, part);
    }
    let mut header = FileHeader {
        magic: MAGIC,
        version: VERSION,
        nodes: nodes.len() as u32,
        length,
        directory_at: end,
        contents_bytes: contents.len() as u64,
        directory_crc,
        header_crc: 0,
    };
    header.header_crc = header.own_crc();
    let mut page = vec![0; Writer::START as usize];
    page[..size_of::<FileHeader>()].copy_from_slice(bytemuck::bytes_of(&header));
    writer.close(&page)?;
    Ok(length)
}

/// A part, open for reading.
pub struct PartFile {
    input: Input,
    header: FileHeader,
}

impl PartFile {
    /// Opens a part. Errors if it is no complete part.
    pub fn open(path: &Path) -> Result<PartFile> {
        let input = Input::open(path)?;
        let mut header = FileHeader::zeroed();
        if input.length >= Writer::START {
            input.read_exactly(0, bytemuck::bytes_of_mut(&mut header))?;
        }
        if header.magic != MAGIC || header.version != VERSION {
            return Err(input.wrong("is not a part of an index of this version"));
        }
        let FileHeader { length, directory_at, .. } = header;
        if header.own_crc() != header.header_crc
            || length != input.length
            || !(Writer::START..=length).contains(&directory_at)
        {
            return Err(damaged(
                &input,
                "its header is damaged, or its length another than it says",
            ));
        }
        Ok(PartFile { input, header })
    }

    /// Returns its cells. Errors if it is damaged, or no part of this job of this plan.
    pub fn cells(&self, plan: &str, job: usize) -> Result<Vec<PartCell>> {
        let PartFile { input, header } = self;
        let bytes = input.take(header.directory_at, header.length - header.directory_at)?;
        let wrong = || damaged(input, "its directory is damaged");
        if crc32c::crc32c(&bytes) != header.directory_crc {
            return Err(wrong());
        }
        let records_bytes = header.nodes as usize * size_of::<NodeRecord>();
        let (records, rest) = bytes.split_at_checked(records_bytes).ok_or_else(wrong)?;
        let children_bytes = rest.len().checked_sub(header.contents_bytes as usize);
        let (children, contents) = rest.split_at(children_bytes.ok_or_else(wrong)?);
        let contents: PartContents = serde_json::from_slice(contents).map_err(|_| wrong())?;
        if contents.plan != plan || contents.job != job {
            return Err(input.wrong(format!(
                "is not the part of job {job} of this plan, but of job {}{}; run job {job} again",
                contents.job,
                if contents.plan == plan { "" } else { " of another plan" }
            )));
        }
        let mut children = children.as_chunks().0.iter().map(|&child| u32::from_le_bytes(child));
        let mut records = records.chunks_exact(size_of::<NodeRecord>());
        let (mut first, mut at) = (0, 0);
        let mut cells = Vec::new();
        for stored in contents.cells {
            // Numbered from the first of the cell.
            let mut nodes: Vec<BuiltNode> = Vec::new();
            let mut bytes = 0;
            for record in records.by_ref().take(stored.nodes) {
                let mut record: NodeRecord = bytemuck::pod_read_unaligned(record);
                let below = children.by_ref().take(record.children as usize);
                let below: Vec<u32> = below.map(|child| child.wrapping_sub(first)).collect();
                let is_sound = below.len() == record.children as usize
                    && below.iter().all(|&child| (child as usize) < nodes.len())
                    && record.count <= POINTS_PER_PAGE
                    && record.at == Writer::START + at + bytes;
                if !is_sound {
                    return Err(wrong());
                }
                (record.at, record.children) = (bytes, 0);
                bytes += record.bytes();
                nodes.push(BuiltNode { record, children: below });
            }
            let open = |node: u32| {
                let node = node.wrapping_sub(first);
                let count = nodes.get(node as usize)?.record.count;
                Some(OpenNode { node, count, samples: None })
            };
            let open: Option<Vec<OpenNode>> = stored.open.into_iter().map(open).collect();
            let open = open.filter(|open| nodes.len() == stored.nodes && !open.is_empty());
            let open = open.ok_or_else(wrong)?;
            first += nodes.len() as u32;
            cells.push(PartCell { nodes, open, at, bytes, planes_crc: stored.planes_crc });
            at += bytes;
        }
        if first != header.nodes || Writer::START + at != header.directory_at {
            return Err(wrong());
        }
        Ok(cells)
    }

    /// Passes the planes of a cell to `put`, block by block, with their offsets in it. Errors if
    /// they are damaged.
    pub fn copy(
        &self,
        cell: &PartCell,
        mut put: impl FnMut(u64, &[u8]) -> Result<()>,
    ) -> Result<()> {
        let mut found = 0;
        for offset in (0..cell.bytes).step_by(BLOCK as usize) {
            let bytes = BLOCK.min(cell.bytes - offset);
            let block = self.input.take(Writer::START + cell.at + offset, bytes)?;
            found = crc32c::crc32c_append(found, &block);
            put(offset, &block)?;
        }
        let is_sound = found == cell.planes_crc;
        if is_sound { Ok(()) } else { Err(damaged(&self.input, "its planes are damaged")) }
    }
}

/// The nodes of a cell, with planes from byte 0, and those without a parent.
pub struct PartCell {
    pub nodes: Vec<BuiltNode>,
    pub open: Vec<OpenNode>,
    /// Offset of its planes from the first of the part.
    at: u64,
    pub bytes: u64,
    planes_crc: u32,
}

fn damaged(input: &Input, what: &str) -> Error {
    input.wrong(format!("{what}; run its job again"))
}
