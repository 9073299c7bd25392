//! Byte order marks; decoding of UTF-16 to UTF-8, in memory.

use super::input::Input;
use crate::error::Result;

const UTF8: &[u8] = b"\xEF\xBB\xBF";
const LITTLE: &[u8] = b"\xFF\xFE";
const BIG: &[u8] = b"\xFE\xFF";

/// Returns the length of a UTF-8 mark at the beginning.
pub fn mark_bytes(input: &Input) -> Result<u64> {
    Ok(if input.take(0, 3)? == UTF8 { 3 } else { 0 })
}

/// Returns the text as UTF-8 if it is UTF-16. Errors if UTF-16 has no mark.
pub fn decoded(input: &Input, notes: &mut Vec<String>) -> Result<Option<Input>> {
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
    let bytes = input.take(2, u64::MAX)?;
    let mut text = String::with_capacity(bytes.len() / 2);
    let pairs = bytes.chunks_exact(2).map(|bytes| pair([bytes[0], bytes[1]]));
    text.extend(
        char::decode_utf16(pairs).map(|decoded| decoded.unwrap_or(char::REPLACEMENT_CHARACTER)),
    );
    notes.push(format!("{}: read as {name}", input.name()));
    Ok(Some(input.with(text.into_bytes())))
}
