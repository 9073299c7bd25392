//! Text tables (XYZ, CSV, TXT, ASC, PTS): one part.
//!
//! Text is UTF-8, or in any encoding with a byte order mark. Notes report how the table was read,
//! which lines are not rows, and which columns lack values. PTX, which is not a table, is detected
//! by content.

use super::floats::{Floats, Role};
use super::from_floats::ReadPart;
use super::input::{Input, Meter};
use super::scalar::Scalar;
use super::table::line::{Line, Missing, Splitter};
use super::table::{Source, Table, sniff};
use super::{Extra, Header, ReadOptions, crs, encoding, ptx, text};
use crate::error::Result;
use crate::progress::Progress;

pub fn read(
    input: &Input,
    options: &ReadOptions,
    progress: &dyn Progress,
    notes: &mut Vec<String>,
) -> Result<Vec<ReadPart>> {
    let decoded = encoding::decoded(input, progress, notes)?;
    let input = decoded.as_ref().unwrap_or(input);
    let begin = encoding::mark_bytes(input)?;
    let start = input.take(begin, sniff::SAMPLE_BYTES)?;
    if ptx::is_one(&start) {
        return ptx::read(input, begin, options, progress, notes);
    }
    let is_whole = begin + start.len() as u64 >= input.length;
    let mut table =
        sniff::sniff(&start, is_whole, &options.text).map_err(|what| input.wrong(what))?;
    let (mut scalars, mut read) = (Vec::new(), 0);
    for place in (0..table.columns.len())
        .filter(|&place| table.columns[place].is_extra())
        .collect::<Vec<_>>()
    {
        let name = table.extra(place).name;
        scalars.push(Scalar::named(&name).to_string());
        if let Some(asked) = options.wanted.scalars.named(&name) {
            table.columns[place].role = Role::Scalar(asked, read);
            read += 1;
        }
    }
    notes.push(format!("{}: {table}", input.name()));
    if let Some(what) = table.guess_or_loss().filter(|_| options.strict) {
        return Err(input.wrong(format!("{what}; name all columns with --columns, - to skip one")));
    }
    let mut rows = rows(input, begin + table.body_at as u64, &table, options, progress)?;
    tell(input, &table, &rows, options, notes)?;
    let points = table.count.map(|first| first.saturating_add(rows.counted));
    let format =
        if table.count.is_some() && table.source == Source::Values { "PTS" } else { "XYZ" };
    let names = table
        .columns
        .iter()
        .map(|column| column.name.clone().unwrap_or_default())
        .collect::<Vec<_>>()
        .join(", ");
    let named = Some(("names".to_string(), names))
        .filter(|_| table.columns.iter().any(|column| column.name.is_some()));
    let angles = Some(crs::DEGREES)
        .filter(|_| names_angles(&table))
        .map(|(what, text)| (what.into(), text.into()));
    let facts =
        [("columns".into(), table.words())].into_iter().chain(named).chain(angles).collect();
    let extras = std::mem::take(&mut rows.extras)
        .into_iter()
        .zip(&table.columns)
        .filter(|(_, column)| column.is_extra());
    let extras = extras.map(|(extra, _)| extra).collect();
    let header =
        Header { format: format.into(), points, facts, extras, scalars, ..Header::default() };
    rows.floats.into_parts(input, header, table.color_unit(), None, progress, notes)
}

/// Tests whether x and y are named after longitude and latitude.
fn names_angles(table: &Table) -> bool {
    let named = |axis: usize, short: &str| {
        let own = table
            .columns
            .iter()
            .find(|column| column.role == Role::Position(axis))
            .and_then(|column| column.name.as_ref());
        own.is_some_and(|name| name.trim().to_lowercase().starts_with(short))
    };
    named(0, "lon") && named(1, "lat")
}

/// Rows, bad lines and counts of a block.
struct Rows {
    floats: Floats,
    lines: u64,
    /// Sum of the counts of blocks after the first.
    counted: u64,
    bad: Bad,
    no_data: Missing,
    /// Missing values per column.
    missing: Vec<Missing>,
    /// Columns without a value in the last line.
    gaps: Vec<usize>,
    /// Extra attributes per column, if requested.
    extras: Vec<Extra>,
}

/// Lines that are not rows.
#[derive(Default)]
struct Bad {
    lines: u64,
    /// The first one: line number, reason, contents.
    first: Option<(u64, String)>,
}

impl Bad {
    fn add(&mut self, line: u64, what: impl FnOnce() -> String) {
        self.lines += 1;
        self.first.get_or_insert_with(|| (line, what()));
    }
}

fn rows(
    input: &Input,
    at: u64,
    table: &Table,
    options: &ReadOptions,
    progress: &dyn Progress,
) -> Result<Rows> {
    let roles = table.roles();
    let empty = || Rows {
        floats: Floats::with_roles(&roles, options.wanted, false, false),
        lines: 0,
        counted: 0,
        bad: Bad::default(),
        no_data: Missing::default(),
        missing: vec![Missing::default(); table.columns.len()],
        gaps: Vec::new(),
        extras: if options.extras {
            table.columns.iter().enumerate().map(|(place, _)| table.extra(place)).collect()
        } else {
            Vec::new()
        },
    };
    let parse = |block: &[u8]| {
        let mut rows = empty();
        let mut splitter = Splitter::new(table.reading);
        for line in text::all_lines(block) {
            rows.lines += 1;
            rows.add(line, table, &mut splitter);
        }
        rows
    };
    let mut rows = Rows { lines: table.lines_before, ..empty() };
    rows.floats = rows.floats.spilling(input);
    for (number, line) in &table.odd {
        rows.bad.add(*number, || line.clone());
    }
    let length = input.length - at;
    let meter = Meter::new(progress, input, length);
    text::parse(input, at..input.length, &meter, parse, |block, bytes| {
        if rows.floats.len() == 0 {
            rows.floats
                .reserve((block.floats.len() as u64 * length / bytes.max(1) as u64) as usize);
        }
        rows.append(block);
    })?;
    Ok(rows)
}

impl Rows {
    fn add(&mut self, line: &[u8], table: &Table, splitter: &mut Splitter) {
        if line.trim_ascii().is_empty() {
            return;
        }
        let mut point = self.floats.point();
        self.gaps.clear();
        match table.line(line, splitter, &mut point, &mut self.gaps, &mut self.extras) {
            Line::Point => {
                self.floats.push(&point);
                self.gaps.iter().for_each(|&place| self.missing[place].add(self.lines));
            }
            Line::Comment => {}
            Line::Count(count) => self.counted = self.counted.saturating_add(count),
            Line::NoData => self.no_data.join(Missing { lines: 1, first: self.lines }),
            Line::Bad(why) => self.bad.add(self.lines, || format!("{}: {why}", text::shown(line))),
        }
    }

    /// Adds the lines of the following block.
    fn append(&mut self, block: Rows) {
        let before = self.lines;
        let later = |missing: Missing| Missing { first: missing.first + before, ..missing };
        self.floats.append(block.floats);
        self.lines += block.lines;
        self.counted = self.counted.saturating_add(block.counted);
        self.bad.lines += block.bad.lines;
        self.bad.first =
            self.bad.first.take().or(block.bad.first.map(|(line, what)| (line + before, what)));
        self.no_data.join(later(block.no_data));
        self.extras.iter_mut().zip(block.extras).for_each(|(sum, extra)| sum.join(extra));
        self.missing
            .iter_mut()
            .zip(block.missing)
            .for_each(|(sum, missing)| sum.join(later(missing)));
    }
}

/// Reports bad lines and missing values; an error if `strict` and lines are lost.
fn tell(
    input: &Input,
    table: &Table,
    rows: &Rows,
    options: &ReadOptions,
    notes: &mut Vec<String>,
) -> Result<()> {
    let lines = |count: u64| text::lines_in_words(count);
    if let Some((line, what)) = &rows.bad.first {
        if options.strict {
            return Err(input.wrong(format!("line {line} is not a row of the table: {what}")));
        }
        let are = if rows.bad.lines == 1 {
            "is not a point and was skipped"
        } else {
            "are not points and were skipped"
        };
        notes.push(format!(
            "{}: {} {are}; line {line}: {what}",
            input.name(),
            lines(rows.bad.lines)
        ));
    }
    if rows.no_data.lines > 0 {
        let Missing { lines: count, first } = rows.no_data;
        notes.push(format!(
            "{}: {} without data (coordinates such as -1.70141E+38) were skipped, the first is line {first}",
            input.name(),
            lines(count)
        ));
    }
    for (place, missing) in rows.missing.iter().enumerate().filter(|(_, missing)| missing.lines > 0)
    {
        notes.push(format!(
            "{}: {} without a value for {}, the first is line {}",
            input.name(),
            lines(missing.lines),
            table.title(place),
            missing.first
        ));
    }
    let read = rows.floats.len() as u64 + rows.floats.not_finite + rows.no_data.lines;
    if let Some(count) =
        table.count.map(|first| first.saturating_add(rows.counted)).filter(|&count| count != read)
    {
        let what = format!("the count lines declare {count} points, {read} could be read");
        if options.strict {
            return Err(input.wrong(what));
        }
        notes.push(format!("{}: {what}", input.name()));
    }
    Ok(())
}
