//! Text files, in blocks of whole lines, on all cores.
//!
//! In: a range of a file and a parser for a block of lines. Out: what the parser made of each block, in the file's order.
//! A few MiB are read at a time and cut at line ends, one piece a thread: a text of any length passes through bounded memory.

use super::input::{Input, Meter};
use crate::error::Result;
use rayon::prelude::*;
use std::ops::Range;

/// Read at a time. A line longer than this is no line of numbers; its pieces are bad lines.
const BLOCK_BYTES: usize = 8 << 20;

/// The largest piece for one parse: small enough for the cache, large enough to be worth a task.
const PIECE_BYTES: usize = 256 << 10;

/// Parses the lines in `range`, block by block, and hands each block's result to `take`.
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
            let end = block.iter().rposition(|&byte| byte == b'\n').map_or(block.len(), |newline| newline + 1);
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

/// Cuts after the first line end beyond every [`PIECE_BYTES`].
fn pieces(block: &[u8]) -> Vec<&[u8]> {
    let mut rest = block;
    let mut pieces = Vec::new();
    while rest.len() > PIECE_BYTES {
        let Some(newline) = rest[PIECE_BYTES..].iter().position(|&byte| byte == b'\n') else { break };
        let (piece, after) = rest.split_at(PIECE_BYTES + newline + 1);
        pieces.push(piece);
        rest = after;
    }
    pieces.push(rest);
    pieces
}

/// Lines that hold something, without their ends.
pub fn lines(block: &[u8]) -> impl Iterator<Item = &[u8]> {
    block.split(|&byte| byte == b'\n').map(<[u8]>::trim_ascii).filter(|line| !line.is_empty())
}

/// Fields between any of space, tab, comma, semicolon.
pub fn fields(line: &[u8]) -> impl Iterator<Item = &[u8]> {
    line.split(|byte| matches!(byte, b' ' | b'\t' | b',' | b';' | b'\r')).filter(|field| !field.is_empty())
}

pub fn number(field: &[u8]) -> Option<f64> {
    std::str::from_utf8(field).ok()?.parse().ok()
}

/// Skips `count` lines that hold something, from `at` on; returns where the next line begins and how many there were.
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
            if byte == b'\n' {
                seen += inked as u64;
                inked = false;
                if seen == count {
                    return Ok((block_at + i as u64 + 1, seen));
                }
            } else {
                inked |= !byte.is_ascii_whitespace();
            }
        }
        block_at += block.len() as u64;
    }
}
