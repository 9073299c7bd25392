//! Checksums of mutated inputs, so that what lies behind them is reached.

/// Least bytes of header pages of indexes and shadows.
const PAGE: usize = 4096;

fn number<const N: usize>(bytes: &[u8], at: usize) -> Option<u64> {
    let own: [u8; N] = bytes.get(at..at + N)?.try_into().ok()?;
    let mut wide = [0; 8];
    wide[..N].copy_from_slice(&own);
    Some(u64::from_le_bytes(wide))
}

fn put(bytes: &mut [u8], at: usize, value: &[u8]) {
    bytes[at..at + value.len()].copy_from_slice(value);
}

/// Returns an E57 file whose pages have their checksums.
pub fn e57(bytes: &[u8]) -> Vec<u8> {
    let mut file = bytes.to_vec();
    let size = number::<8>(&file, 40).unwrap_or(0) as usize;
    if (8..=1 << 16).contains(&size) {
        for page in file.chunks_exact_mut(size) {
            let crc = crc32c::crc32c(&page[..size - 4]).to_be_bytes();
            put(page, size - 4, &crc);
        }
    }
    file
}

/// Where an index file has its fields.
mod index {
    pub const NODES: usize = 12;
    pub const LENGTH: usize = 16;
    pub const DIRECTORY: usize = 24;
    pub const CONTENTS: usize = 32;
    pub const DIRECTORY_CRC: usize = 44;
    pub const HEADER_CRC: usize = 48;
    pub const HEADER: usize = 56;
}

/// Returns an index whose length and checksums are those of its bytes. If `planes`, the checksums
/// of its planes, too.
pub fn pnti(bytes: &[u8], planes: bool) -> Vec<u8> {
    use pointillist::index::format::{NodeRecord, PLANES};
    let mut file = bytes.to_vec();
    let length = file.len();
    let fits = |at: usize, bytes: usize| at.checked_add(bytes).is_some_and(|end| end <= length);
    let (Some(at), Some(nodes)) =
        (number::<8>(&file, index::DIRECTORY), number::<4>(&file, index::NODES))
    else {
        return file;
    };
    if length < PAGE || at as usize > length {
        return file;
    }
    let (at, width) = (at as usize, size_of::<NodeRecord>());
    if planes && fits(at, nodes as usize * width) {
        for k in 0..nodes as usize {
            let place = at + k * width;
            let mut record: NodeRecord = bytemuck::pod_read_unaligned(&file[place..place + width]);
            // Crafted counts overflow here, too.
            if record.at > 1 << 40 {
                continue;
            }
            for (plane, _) in &PLANES {
                if !record.has(*plane) {
                    continue;
                }
                let (from, bytes) = record.range(*plane);
                if fits(from as usize, bytes as usize) {
                    let own = &file[from as usize..(from + bytes) as usize];
                    record.crc[*plane as usize] = crc32c::crc32c(own);
                }
            }
            put(&mut file, place, bytemuck::bytes_of(&record));
        }
    }
    put(&mut file, index::LENGTH, &(length as u64).to_le_bytes());
    let contents = length.saturating_sub(at).saturating_sub(nodes as usize * width);
    put(&mut file, index::CONTENTS, &(contents as u64).to_le_bytes());
    let crc = crc32c::crc32c(&file[at..]);
    put(&mut file, index::DIRECTORY_CRC, &crc.to_le_bytes());
    seal(&mut file, index::HEADER_CRC, index::HEADER);
    file
}

/// Where a file of shadows has its fields.
mod shadow {
    pub const NODES: usize = 12;
    pub const INDEX: usize = 16;
    pub const LENGTH: usize = 24;
    pub const DIRECTORY: usize = 32;
    pub const CONTENTS: usize = 40;
    pub const DIRECTORY_CRC: usize = 48;
    pub const HEADER_CRC: usize = 52;
    pub const HEADER: usize = 56;
}

/// Returns shadows of an index, with its identity, and the length and checksums of their bytes.
pub fn shadows(bytes: &[u8], identity: u64) -> Vec<u8> {
    let mut file = bytes.to_vec();
    let length = file.len();
    if length < PAGE {
        return file;
    }
    let at = (number::<8>(&file, shadow::DIRECTORY).unwrap_or(0) as usize).min(length);
    let nodes = number::<4>(&file, shadow::NODES).unwrap_or(0) as usize;
    let contents = length.saturating_sub(at).saturating_sub(4 * nodes);
    put(&mut file, shadow::INDEX, &identity.to_le_bytes());
    put(&mut file, shadow::LENGTH, &(length as u64).to_le_bytes());
    put(&mut file, shadow::CONTENTS, &(contents as u64).to_le_bytes());
    let crc = crc32c::crc32c(&file[at..]);
    put(&mut file, shadow::DIRECTORY_CRC, &crc.to_le_bytes());
    seal(&mut file, shadow::HEADER_CRC, shadow::HEADER);
    file
}

/// Writes the checksum of a header, which counts as 0 in it.
fn seal(file: &mut [u8], at: usize, length: usize) {
    put(file, at, &[0; 4]);
    let crc = crc32c::crc32c(&file[..length]);
    put(file, at, &crc.to_le_bytes());
}

/// Returns an input that is several files: of each its length, 32 bits, then its bytes.
pub fn files(bytes: &[u8]) -> Vec<&[u8]> {
    let (mut rest, mut files) = (bytes, Vec::new());
    while let Some((head, tail)) = rest.split_at_checked(4) {
        let length = u32::from_le_bytes(head.try_into().expect("four bytes")) as usize;
        let (own, others) = tail.split_at(length.min(tail.len()));
        files.push(own);
        rest = others;
    }
    files
}

/// Returns several files as one input.
pub fn together(files: &[Vec<u8>]) -> Vec<u8> {
    let one = |file: &Vec<u8>| [&(file.len() as u32).to_le_bytes()[..], file].concat();
    files.iter().flat_map(one).collect()
}
