//! Byte order marks; decoding of UTF-16 to UTF-8, a chunk at a time.

use super::input::{Decoded, Input, Meter};
use crate::error::Result;
use crate::progress::Progress;

const UTF8: &[u8] = b"\xEF\xBB\xBF";
const LITTLE: &[u8] = b"\xFF\xFE";
const BIG: &[u8] = b"\xFE\xFF";

/// Bytes of UTF-16 that are decoded together, about.
const CHUNK: u64 = 1 << 20;

/// Returns the length of a UTF-8 mark at the beginning.
pub fn mark_bytes(input: &Input) -> Result<u64> {
    Ok(if input.take(0, 3)? == UTF8 { 3 } else { 0 })
}

/// UTF-16 that is read as UTF-8.
pub struct Utf16 {
    source: Box<Input>,
    pair: fn([u8; 2]) -> u16,
    /// Where chunks begin, in the source and in UTF-8, and where the last one ends `[bytes]`.
    chunks: Vec<[u64; 2]>,
}

impl Utf16 {
    /// Reads all of a source once, to know where its chunks are in UTF-8.
    fn of(source: Input, pair: fn([u8; 2]) -> u16, progress: &dyn Progress) -> Result<Utf16> {
        let meter = Meter::new(progress, &source, source.length);
        // After the mark.
        let mut chunks = vec![[2, 0]];
        loop {
            let [at, decoded] = chunks[chunks.len() - 1];
            let mut bytes = source.take(at, CHUNK)?;
            let there = bytes.len() as u64;
            let is_last = there < CHUNK || at + there >= source.length;
            // Both halves of a pair of surrogates are in one chunk.
            let end = bytes.len().saturating_sub(2);
            if !is_last && pair([bytes[end], bytes[end + 1]]) >> 10 == 0xD800 >> 10 {
                bytes.truncate(end);
            }
            let length = text(&bytes, pair).len() as u64;
            chunks.push([at + bytes.len() as u64, decoded + length]);
            meter.advance(bytes.len() as u64)?;
            if is_last {
                return Ok(Utf16 { source: Box::new(source), pair, chunks });
            }
        }
    }

    /// Returns the length of the text as UTF-8 `[bytes]`.
    fn length(&self) -> u64 {
        self.chunks.last().map_or(0, |[_, end]| *end)
    }
}

impl Decoded for Utf16 {
    /// Reads bytes of one chunk, as UTF-8.
    fn read_some_at(&self, bytes: &mut [u8], offset: u64) -> Result<usize> {
        let next = self.chunks.partition_point(|[_, decoded]| *decoded <= offset);
        let Some([end, _]) = self.chunks.get(next) else { return Ok(0) };
        let [at, decoded] = self.chunks[next - 1];
        let mut own = vec![0; (end - at) as usize];
        self.source.read_exactly(at, &mut own)?;
        let text = text(&own, self.pair);
        let rest = text.as_bytes().get((offset - decoded) as usize..).unwrap_or_default();
        let count = rest.len().min(bytes.len());
        bytes[..count].copy_from_slice(&rest[..count]);
        Ok(count)
    }
}

/// Decodes UTF-16. Half a unit at the end is left out.
fn text(bytes: &[u8], pair: fn([u8; 2]) -> u16) -> String {
    let mut text = String::with_capacity(bytes.len() / 2);
    let pairs = bytes.chunks_exact(2).map(|bytes| pair([bytes[0], bytes[1]]));
    text.extend(
        char::decode_utf16(pairs).map(|decoded| decoded.unwrap_or(char::REPLACEMENT_CHARACTER)),
    );
    text
}

/// Returns the text as UTF-8 if it is UTF-16. Errors if UTF-16 has no mark.
pub fn decoded(
    input: &Input,
    progress: &dyn Progress,
    notes: &mut Vec<String>,
) -> Result<Option<Input>> {
    let start = input.take(0, 4096)?;
    let (pair, name): (fn([u8; 2]) -> u16, _) = if start.starts_with(LITTLE) {
        (u16::from_le_bytes, "UTF-16, little-endian")
    } else if start.starts_with(BIG) {
        (u16::from_be_bytes, "UTF-16, big-endian")
    } else {
        let zeros = start.iter().filter(|&&byte| byte == 0).count();
        if zeros * 4 > start.len() {
            return Err(input
                .wrong("is not text, or is UTF-16 without a byte order mark; save it as UTF-8"));
        }
        return Ok(None);
    };
    let decoded = Utf16::of(input.again()?, pair, progress)?;
    notes.push(format!("{}: read as {name}", input.name()));
    Ok(Some(input.decoded(decoded.length(), decoded)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::progress::Silent;
    use std::path::PathBuf;

    #[test]
    fn chunks_are_the_text_wherever_they_are_cut() {
        // Characters of one to four bytes, and halves of surrogates at the ends of chunks.
        let text: String = "a\u{e9}\u{4e2d}\u{1f600}\n".chars().cycle().take(1_500_000).collect();
        for lone in [None, Some(0xD800u16)] {
            let units = std::iter::once(0xFEFFu16).chain(text.encode_utf16()).chain(lone);
            let bytes: Vec<u8> = units.flat_map(u16::to_be_bytes).chain([7]).collect();
            let input = Input::made(PathBuf::from("a.txt"), bytes);
            let mut notes = Vec::new();
            let decoded = decoded(&input, &Silent, &mut notes).unwrap().unwrap();
            assert_eq!(notes, ["a.txt: read as UTF-16, big-endian"]);
            let replaced = lone.map_or("", |_| "\u{fffd}");
            let expected = format!("{text}{replaced}").into_bytes();
            assert_eq!(decoded.length, expected.len() as u64);
            assert!(decoded.take(0, u64::MAX).unwrap() == expected);
            for at in [0, 1, (1 << 20) - 1, 2_000_001, expected.len() - 1] {
                let part = decoded.take(at as u64, 1 << 21).unwrap();
                assert!(part == expected[at..expected.len().min(at + (1 << 21))], "from {at}");
            }
        }
    }
}
