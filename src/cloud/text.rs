//! Text files in blocks of whole lines, on all cores.
//!
//! A few MiB are read at a time and cut at line ends, one piece per thread, so texts of any length
//! take bounded memory. Results are in the file's order. Lines end in LF, CRLF or CR. Numbers have
//! a decimal point, or a decimal comma if the caller says so; `1.5D+03` is a number, too.

use super::input::{Input, Meter};
use crate::error::Result;
use rayon::prelude::*;
use std::ops::Range;

/// Bytes per read. A longer line is not a line of numbers; its pieces are bad lines.
const BLOCK_BYTES: usize = 8 << 20;

/// Largest piece per task: small enough for the cache, large enough to be worth a task.
const PIECE_BYTES: usize = 256 << 10;

/// Parses the lines in `range`, block by block, and passes each block's result to `take`.
pub fn parse<T: Send>(
    input: &Input,
    range: Range<u64>,
    meter: &Meter,
    parse: impl Fn(&[u8]) -> T + Sync,
    mut take: impl FnMut(T, usize),
) -> Result<()> {
    let mut at = range.start;
    let mut carried = Vec::new();
    loop {
        let mut block = std::mem::take(&mut carried);
        let read = input.take(at, (range.end - at).min(BLOCK_BYTES as u64))?;
        at += read.len() as u64;
        block.extend_from_slice(&read);
        let last = read.is_empty() || at >= range.end;
        if !last {
            let end = last_end(&block).unwrap_or(block.len());
            carried = block.split_off(end);
        }
        let pieces = pieces(&block);
        let results: Vec<T> = pieces.par_iter().map(|piece| parse(piece)).collect();
        for (result, piece) in results.into_iter().zip(&pieces) {
            take(result, piece.len());
        }
        meter.advance(read.len() as u64)?;
        if last {
            return Ok(());
        }
    }
}

/// Splits after the first line end beyond every [`PIECE_BYTES`].
fn pieces(block: &[u8]) -> Vec<&[u8]> {
    let mut rest = block;
    let mut pieces = Vec::new();
    while rest.len() > PIECE_BYTES {
        let Some(end) = first_end(&rest[PIECE_BYTES..]) else { break };
        let (piece, after) = rest.split_at(PIECE_BYTES + end);
        pieces.push(piece);
        rest = after;
    }
    pieces.push(rest);
    pieces
}

/// Returns the beginning of the second line. A CR as the last byte may have its LF in the next
/// block, so it ends no line.
fn first_end(block: &[u8]) -> Option<usize> {
    let end = memchr::memchr2(b'\n', b'\r', block)?;
    match &block[end..] {
        [b'\r', b'\n', ..] => Some(end + 2),
        [b'\r'] => None,
        _ => Some(end + 1),
    }
}

/// Returns the end of the last complete line.
pub fn last_end(block: &[u8]) -> Option<usize> {
    let block = block.strip_suffix(b"\r").unwrap_or(block);
    memchr::memrchr2(b'\n', b'\r', block).map(|end| end + 1)
}

/// Returns all lines without their ends, including blank ones, so that they can be counted.
pub fn all_lines(block: &[u8]) -> impl Iterator<Item = &[u8]> {
    let mut rest = Some(block).filter(|block| !block.is_empty());
    std::iter::from_fn(move || {
        let block = rest?;
        let end = memchr::memchr2(b'\n', b'\r', block).unwrap_or(block.len());
        let next = match &block[end..] {
            [b'\r', b'\n', ..] => end + 2,
            _ => end + 1,
        };
        rest = block.get(next..).filter(|rest| !rest.is_empty());
        Some(&block[..end])
    })
}

/// Returns non-blank lines without their ends.
pub fn lines(block: &[u8]) -> impl Iterator<Item = &[u8]> {
    all_lines(block).map(<[u8]>::trim_ascii).filter(|line| !line.is_empty())
}

/// Splits at spaces, tabs, commas and semicolons.
pub fn fields(line: &[u8]) -> impl Iterator<Item = &[u8]> {
    line.split(|byte| matches!(byte, b' ' | b'\t' | b',' | b';' | b'\r'))
        .filter(|field| !field.is_empty())
}

/// Splits at spaces and tabs.
pub fn blanks(line: &[u8]) -> impl Iterator<Item = &[u8]> {
    line.split(|byte| matches!(byte, b' ' | b'\t')).filter(|field| !field.is_empty())
}

pub fn number(field: &[u8]) -> Option<f64> {
    plain(field).or_else(|| fortran(field))
}

/// Parses a number with a decimal comma or a decimal point.
pub fn number_with(field: &[u8], decimal_comma: bool) -> Option<f64> {
    if !decimal_comma {
        return number(field);
    }
    let Some(comma) = field.iter().position(|&byte| byte == b',') else {
        return Some(field).filter(|field| !field.contains(&b'.')).and_then(number);
    };
    // A digit must follow, since a comma may separate words.
    field.get(comma + 1).filter(|byte| byte.is_ascii_digit())?;
    let points = |byte| match byte {
        b',' => b'.',
        b'.' => b',',
        other => other,
    };
    replaced(field, points, number)
}

/// Parses `1.5D+03`.
fn fortran(field: &[u8]) -> Option<f64> {
    let is_exponent = |byte: &u8| matches!(byte, b'd' | b'D');
    let is_number = field.iter().all(|byte| {
        byte.is_ascii_digit() || is_exponent(byte) || matches!(byte, b'+' | b'-' | b'.')
    });
    (is_number && field.iter().any(is_exponent)).then_some(())?;
    replaced(field, |byte| if is_exponent(&byte) { b'e' } else { byte }, plain)
}

fn plain(field: &[u8]) -> Option<f64> {
    fast_float2::parse(field).ok()
}

/// Parses a field with replaced bytes; `None` if it is too long for a number.
fn replaced(
    field: &[u8],
    other: impl Fn(u8) -> u8,
    parse: fn(&[u8]) -> Option<f64>,
) -> Option<f64> {
    let mut bytes = [0; 64];
    let bytes = bytes.get_mut(..field.len())?;
    bytes.iter_mut().zip(field).for_each(|(slot, &byte)| *slot = other(byte));
    parse(bytes)
}

/// Quotes a line for a message, truncated.
pub fn shown(line: &[u8]) -> String {
    const MOST: usize = 80;
    let text = String::from_utf8_lossy(&line[..line.len().min(MOST)]);
    format!("\"{}{}\"", text.escape_debug(), if line.len() > MOST { "..." } else { "" })
}

pub fn lines_in_words(count: u64) -> String {
    if count == 1 { "1 line".into() } else { format!("{count} lines") }
}

/// Skips `count` non-blank lines from `at`. Returns where the next line begins and the number of
/// skipped ones.
pub fn skip_lines(input: &Input, at: u64, count: u64) -> Result<(u64, u64)> {
    let mut block_at = at;
    let mut seen = 0;
    let mut inked = false;
    if count == 0 {
        return Ok((at, 0));
    }
    loop {
        let block = input.take(block_at, BLOCK_BYTES as u64)?;
        if block.is_empty() {
            return Ok((block_at, seen + inked as u64));
        }
        for (i, &byte) in block.iter().enumerate() {
            if matches!(byte, b'\n' | b'\r') {
                seen += inked as u64;
                inked = false;
                if seen == count {
                    let ends = if block[i..].starts_with(b"\r\n") { 2 } else { 1 };
                    return Ok((block_at + i as u64 + ends, seen));
                }
            } else {
                inked |= !byte.is_ascii_whitespace();
            }
        }
        block_at += block.len() as u64;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_end_in_lf_crlf_and_cr() {
        let lines: Vec<&[u8]> = all_lines(b"a\r\nb\n\nc\rd\r\n").collect();
        assert_eq!(lines, [b"a".as_slice(), b"b", b"", b"c", b"d"]);
        assert_eq!(all_lines(b"").count(), 0);
        assert_eq!(
            (first_end(b"ab\r\nc"), first_end(b"ab\r"), last_end(b"a\rb\r"), last_end(b"ab")),
            (Some(4), None, Some(2), None)
        );
    }

    #[test]
    fn numbers_are_those_of_the_standard_library() {
        for text in [
            "1",
            "-1.5",
            "+2.25",
            ".5",
            "5.",
            "1e-320",
            "1.7976931348623157e308",
            "-0",
            "1E+05",
            "123456789.123456789",
            "0.1",
        ] {
            assert_eq!(number(text.as_bytes()), text.parse().ok(), "{text}");
        }
        assert!(
            number(b"NaN").unwrap().is_nan()
                && number(b"-inf") == Some(f64::NEG_INFINITY)
                && number(b"1e999") == Some(f64::INFINITY)
        );
        for text in [
            "", "-", ".", "0x1F", "1 2", "1,5", "tree", "dead", "d", "1e", "--1", "1.2.3",
            "infinit", "1d", "e5",
        ] {
            assert_eq!(number(text.as_bytes()), None, "{text}");
        }
        assert_eq!(number(b"1.5D+03"), Some(1500.0));
        assert_eq!(number(b"-2d-1"), Some(-0.2));
    }

    #[test]
    fn decimal_commas_are_no_points() {
        assert_eq!(number_with(b"500000,25", true), Some(500000.25));
        assert_eq!(number_with(b"-7", true), Some(-7.0));
        assert_eq!(number_with(b"1,5E+03", true), Some(1500.0));
        assert_eq!(number_with(b"1,5D+03", true), Some(1500.0));
        for text in ["1.5", "1,5,5", "1.000,5", "1,", ","] {
            assert_eq!(number_with(text.as_bytes(), true), None, "{text}");
        }
    }
}
