//! PTX: one part per scan.
//!
//! Each scan begins with ten lines: columns, rows, the scanner's position and three axes, and four
//! rows of a matrix. Then a line per direction follows, column by column: x y z in the scanner's
//! frame, intensity, optionally red green blue; 0 0 0 for no hit. The matrix places each scan;
//! directions without a hit are skipped.

use super::floats::{ColorUnit, Floats, Point, Role, there};
use super::from_floats::ReadPart;
use super::input::{Input, Meter};
use super::table::line;
use super::{Header, ReadOptions, text};
use crate::error::Result;
use crate::progress::{Progress, Silent};
use glam::{DMat4, DVec3};
use std::ops::Range;

/// Numbers in each line of a scan's head.
const HEAD: [usize; 10] = [1, 1, 3, 3, 3, 3, 4, 4, 4, 4];
/// Longest head `[bytes]`.
const HEAD_BYTES: u64 = 8 << 10;

/// The head of a scan.
struct Head {
    columns: u64,
    rows: u64,
    /// Transform from the scanner's frame to the world.
    pose: DMat4,
    bytes: u64,
    lines: u64,
}

pub fn is_one(start: &[u8]) -> bool {
    head(start).is_some()
}

/// Parses the head at the beginning of a text.
fn head(start: &[u8]) -> Option<Head> {
    let mut numbers = Vec::new();
    let mut lines = 0;
    let mut end = 0;
    let mut held = HEAD.iter();
    let mut next = held.next();
    for line in text::all_lines(start) {
        let Some(&count) = next else { break };
        lines += 1;
        end = line.as_ptr().addr() - start.as_ptr().addr() + line.len();
        end += if start[end..].starts_with(b"\r\n") { 2 } else { start.len().min(end + 1) - end };
        if line.trim_ascii().is_empty() {
            continue;
        }
        let own: Vec<f64> =
            text::blanks(line.trim_ascii()).map(text::number).collect::<Option<_>>()?;
        if own.len() != count || own.iter().any(|v| !v.is_finite()) {
            return None;
        }
        numbers.extend(own);
        next = held.next();
    }
    if next.is_some() {
        return None;
    }
    let size = |v: f64| (v.fract() == 0.0 && (0.0..=1e9).contains(&v)).then_some(v as u64);
    let matrix: [f64; 16] = numbers[14..].try_into().ok()?;
    // Rows of the file are columns here: its points stand left of the matrix.
    let pose = DMat4::from_cols_array(&matrix);
    let is_affine = [3, 7, 11].iter().all(|&place| matrix[place] == 0.0) && matrix[15] == 1.0;
    is_affine.then_some(Head {
        columns: size(numbers[0])?,
        rows: size(numbers[1])?,
        pose,
        bytes: end as u64,
        lines,
    })
}

pub fn read(
    input: &Input,
    begin: u64,
    options: &ReadOptions,
    progress: &dyn Progress,
    notes: &mut Vec<String>,
) -> Result<Vec<ReadPart>> {
    notes.extend(options.text.idle(input));
    let parts = scans(input, begin, options, progress, notes)?;
    notes.push(format!("{}: read as PTX, scans in their places: {}", input.name(), parts.len()));
    Ok(parts)
}

fn scans(
    input: &Input,
    begin: u64,
    options: &ReadOptions,
    progress: &dyn Progress,
    notes: &mut Vec<String>,
) -> Result<Vec<ReadPart>> {
    let meter = Meter::new(progress, input, input.length);
    let mut parts = Vec::new();
    let (mut at, mut line) = (begin, 0);
    loop {
        let start = input.take(at, HEAD_BYTES)?;
        if start.trim_ascii().is_empty() && start.len() as u64 == input.length - at {
            return Ok(parts);
        }
        let Some(head) = head(&start) else {
            let shown = text::lines(&start).next().map(text::shown).unwrap_or_default();
            let what = format!(
                "line {} should begin scan {}, but reads {shown}; the rest was skipped",
                line + 1,
                parts.len() + 1
            );
            if options.strict || parts.is_empty() {
                return Err(input.wrong(what));
            }
            notes.push(format!("{}: {what}", input.name()));
            return Ok(parts);
        };
        let name = format!("{} scan {}", input.name(), parts.len() + 1);
        line += head.lines;
        let scan = scan(input, at + head.bytes, line, &head, options, &meter)?;
        scan.tell(input, &name, &head, options, notes)?;
        at = scan.end;
        line += scan.lines;
        let facts = vec![
            ("columns".into(), head.columns.to_string()),
            ("rows".into(), head.rows.to_string()),
            (
                "scanner".into(),
                head.pose.w_axis.truncate().to_array().map(|v| v.to_string()).join(" "),
            ),
        ];
        let header = Header { format: "PTX".into(), facts, ..Header::default() };
        let (unit, limits) = (ColorUnit::Guess, Some([0.0, 1.0]));
        let own = scan.floats.into_parts(input, header, unit, limits, progress, notes)?;
        parts.extend(own.into_iter().map(|part| part.named(&name)));
    }
}

struct Scan {
    floats: Floats,
    /// Non-blank lines, and the end of this scan.
    records: u64,
    lines: u64,
    end: u64,
    misses: u64,
    bad: u64,
    /// Number and contents of the first bad line.
    first_bad: Option<(u64, String)>,
}

/// Reads the points from `at`, after this many lines.
fn scan(
    input: &Input,
    at: u64,
    before: u64,
    head: &Head,
    options: &ReadOptions,
    meter: &Meter,
) -> Result<Scan> {
    let (end, records) = end(input, at, head.columns.saturating_mul(head.rows))?;
    let start = input.take(at, HEAD_BYTES.min(end - at))?;
    let width = text::lines(&start).next().map_or(0, |line| text::blanks(line).count());
    let roles: Vec<Role> = match width {
        4 => [position(), vec![Role::Intensity]].concat(),
        6 => [position(), (0..3).map(Role::Color).collect()].concat(),
        7 => [position(), vec![Role::Intensity], (0..3).map(Role::Color).collect()].concat(),
        _ => position(),
    };
    let empty = || Scan {
        floats: Floats::new(there(&roles), options.wanted, false, false),
        records,
        lines: 0,
        end,
        misses: 0,
        bad: 0,
        first_bad: None,
    };
    let mut scan = Scan { lines: before, ..empty() };
    scan.floats = scan.floats.spilling(input);
    scan.floats.reserve(records as usize);
    let parse = |block: &[u8]| {
        let mut scan = empty();
        for line in text::all_lines(block) {
            scan.lines += 1;
            scan.add(line, &roles, &head.pose);
        }
        scan
    };
    text::parse(input, at..end, meter, parse, |block, _| scan.append(block))?;
    scan.lines -= before;
    Ok(scan)
}

/// Returns where a scan of `stated` lines ends, and its number of lines. If neither the file ends
/// nor another scan begins there, it ends where the next one begins.
fn end(input: &Input, at: u64, stated: u64) -> Result<(u64, u64)> {
    let (end, records) = text::skip_lines(input, at, stated)?;
    let next = input.take(end, HEAD_BYTES)?;
    if next.trim_ascii().is_empty() || is_one(&next) {
        return Ok((end, records));
    }
    match next_head(input, at)? {
        Some(begin) => Ok((begin, lines_within(input, at..begin)?)),
        None => Ok((end, records)),
    }
}

fn lines_within(input: &Input, range: Range<u64>) -> Result<u64> {
    let mut count = 0;
    let silent = Meter::new(&Silent, input, range.end - range.start);
    text::parse(
        input,
        range,
        &silent,
        |block| text::lines(block).count() as u64,
        |lines, _| count += lines,
    )?;
    Ok(count)
}

/// Returns where the next head begins: at a line of one number.
fn next_head(input: &Input, mut at: u64) -> Result<Option<u64>> {
    const BLOCK_BYTES: u64 = 1 << 20;
    loop {
        let block = input.take(at, BLOCK_BYTES)?;
        let is_last = at + block.len() as u64 >= input.length;
        let end = if is_last { block.len() } else { text::last_end(&block).unwrap_or(block.len()) };
        for line in text::all_lines(&block[..end]).filter(|line| line::count(line).is_some()) {
            let begin = at + (line.as_ptr().addr() - block.as_ptr().addr()) as u64;
            if is_one(&input.take(begin, HEAD_BYTES)?) {
                return Ok(Some(begin));
            }
        }
        if is_last {
            return Ok(None);
        }
        at += end as u64;
    }
}

fn position() -> Vec<Role> {
    (0..3).map(Role::Position).collect()
}

impl Scan {
    fn add(&mut self, line: &[u8], roles: &[Role], pose: &DMat4) {
        if line.trim_ascii().is_empty() {
            return;
        }
        let mut point = Point::default();
        let mut fields = text::blanks(line);
        for &role in roles {
            match fields.next().and_then(text::number) {
                Some(value) => point.set(role, value),
                None => return self.spoil(line),
            }
        }
        if fields.next().is_some() {
            return self.spoil(line);
        }
        if point.position == [0.0; 3] {
            self.misses += 1;
            return;
        }
        point.position = pose.transform_point3(DVec3::from_array(point.position)).to_array();
        self.floats.push(&point);
    }

    fn spoil(&mut self, line: &[u8]) {
        self.bad += 1;
        self.first_bad.get_or_insert_with(|| (self.lines, text::shown(line)));
    }

    fn append(&mut self, block: Scan) {
        self.first_bad = self
            .first_bad
            .take()
            .or(block.first_bad.map(|(line, shown)| (line + self.lines, shown)));
        self.lines += block.lines;
        self.floats.append(block.floats);
        self.misses += block.misses;
        self.bad += block.bad;
    }

    fn tell(
        &self,
        input: &Input,
        name: &str,
        head: &Head,
        options: &ReadOptions,
        notes: &mut Vec<String>,
    ) -> Result<()> {
        let stated = head.columns.saturating_mul(head.rows);
        let mut lost = Vec::new();
        if self.records != stated {
            lost.push(format!("says {stated} lines, and has {}", self.records));
        }
        if let Some((line, shown)) = &self.first_bad {
            lost.push(format!(
                "{} not points and were skipped; line {line}: {shown}",
                text::lines_in_words(self.bad)
            ));
        }
        for what in lost {
            if options.strict {
                return Err(input.wrong(format!("{name}: {what}")));
            }
            notes.push(format!("{name}: {what}"));
        }
        if self.misses > 0 {
            notes.push(format!(
                "{name}: {} of {} directions hit nothing and were skipped",
                self.misses, self.records
            ));
        }
        Ok(())
    }
}
