//! Detection of a table's format from the beginning of a text, once.
//!
//! Every way to split lines is tried (`RANKED`). A candidate must find rows of equal width with
//! three coordinates in (nearly) all lines. If names are found, it must fit them. Two candidates
//! that read different coordinates from one line are ambiguous, and the file is refused.

use super::heading::{Heading, Names, has_all};
use super::line::{self, Splitter, count, is_comment, is_whole};
use super::values::{Kind, Values};
use super::{Column, Delimiter, Reading, Role, Source, Table, TextOptions, names};
use crate::cloud::text;
use std::collections::BTreeSet;

/// Most bytes of the sample.
pub const SAMPLE_BYTES: u64 = 64 << 10;
const SAMPLE_LINES: usize = 1000;

/// Ways to read lines; the first of those with equal results is used.
const RANKED: &[Reading] = &[
    reading(Delimiter::Tab, false),
    reading(Delimiter::Tab, true),
    reading(Delimiter::Semicolon, false),
    reading(Delimiter::Semicolon, true),
    reading(Delimiter::Comma, false),
    reading(Delimiter::Comma, true),
    reading(Delimiter::Space, false),
    reading(Delimiter::Space, true),
    Reading { delimiter: Delimiter::Comma, decimal_comma: true, paired: true },
];

const fn reading(delimiter: Delimiter, decimal_comma: bool) -> Reading {
    Reading { delimiter, decimal_comma, paired: false }
}

/// A non-blank line of the sample.
pub struct Sampled<'a> {
    /// Line number, from 1.
    pub number: u64,
    pub at: usize,
    pub bytes: &'a [u8],
}

/// A way to read lines, and its result on the sample.
struct Candidate<'a> {
    reading: Reading,
    columns: Vec<Column>,
    words_at_end: bool,
    source: Source,
    /// Potential rows, from the first row on.
    rows: Vec<Row<'a>>,
    /// Number of actual rows among them.
    matched: usize,
    /// Names of columns that do not fit the rows.
    misfit: Option<String>,
    /// A comment that seems to name other columns.
    unfit: Option<String>,
}

impl Candidate<'_> {
    fn is_named(&self) -> bool {
        matches!(self.source, Source::Names(_))
    }
}

pub struct Row<'a> {
    line: &'a Sampled<'a>,
    pub fields: Vec<Vec<u8>>,
    /// The position, if it is a row.
    position: Option<[f64; 3]>,
}

pub fn sniff(start: &[u8], is_whole: bool, asked: &TextOptions) -> Result<Table, String> {
    let lines = sampled(start, is_whole);
    let first = lines.first().ok_or("has no line of text")?;
    if first.bytes.trim_ascii_start().to_ascii_lowercase().starts_with(b"ncols") {
        return Err("is a grid of heights (it begins with ncols), not a table of points".into());
    }
    let is_asked =
        |reading: &&Reading| asked.delimiter.is_none_or(|delimiter| reading.delimiter == delimiter);
    let mut candidates: Vec<Candidate> = RANKED
        .iter()
        .filter(is_asked)
        .filter_map(|&reading| candidate(&lines, reading, asked))
        .collect();
    // Names prove that it is a table, however many lines are not rows.
    candidates.retain(|candidate| {
        candidate.is_named() && candidate.matched > 0
            || candidate.matched * 2 >= candidate.rows.len()
    });
    let misfit = candidates.iter().find_map(|candidate| candidate.misfit.clone());
    candidates.retain(|candidate| candidate.misfit.is_none());
    if candidates.iter().any(Candidate::is_named) {
        candidates.retain(Candidate::is_named);
    } else if let Some(misfit) = misfit {
        return Err(misfit);
    }
    let most = candidates.iter().map(|candidate| candidate.matched).max().unwrap_or(0);
    candidates.retain(|candidate| candidate.matched * 10 >= most * 9);
    if asked.delimiter.is_none() {
        weigh_pairs(&mut candidates);
    } else if candidates.iter().any(|candidate| !candidate.reading.paired) {
        candidates.retain(|candidate| !candidate.reading.paired);
    }
    if let Some(two) = two_meanings(&candidates) {
        return Err(two);
    }
    let most = candidates.iter().map(|candidate| candidate.matched).max().unwrap_or(0);
    let chosen = candidates
        .into_iter()
        .find(|candidate| candidate.matched == most)
        .ok_or_else(|| no_table(&lines, asked))?;
    let mut table = table(&lines, chosen);
    if let Some(name) = asked.scalar {
        read_as_intensity(&mut table, name)?;
    }
    Ok(table)
}

/// Gives the column of this name the role of intensity, and no other.
fn read_as_intensity(table: &mut Table, name: &str) -> Result<(), String> {
    let titles: Vec<String> =
        (0..table.columns.len()).map(|place| table.extra(place).name).collect();
    let is_it =
        |title: &&String| **title == name || names::normalized(title) == names::normalized(name);
    let place = titles
        .iter()
        .position(|title| title == name)
        .or_else(|| titles.iter().position(|title| is_it(&title)));
    let Some(place) = place else {
        return Err(format!(
            "has no column \"{name}\" to read as --scalar; it has {}",
            titles.join(", ")
        ));
    };
    if table.columns[place].is_text || matches!(table.columns[place].role, Role::Position(_)) {
        return Err(format!(
            "cannot read \"{name}\" as --scalar: it is {}",
            if table.columns[place].is_text { "text" } else { "a coordinate" }
        ));
    }
    table
        .columns
        .iter_mut()
        .filter(|column| column.role == Role::Intensity)
        .for_each(|column| column.role = Role::Other);
    table.columns[place].role = Role::Intensity;
    Ok(())
}

fn no_table(lines: &[Sampled], asked: &TextOptions) -> String {
    let what = match asked.columns {
        Some(columns) => {
            format!(
                "no rows of the {} columns that were asked for (one for every field, - to skip one)",
                columns.roles().len()
            )
        }
        None => "no rows of at least three numbers with equal field counts".into(),
    };
    let shown = lines
        .iter()
        .max_by_key(|line| numbers_within(line.bytes))
        .map(|line| (line.number, text::shown(line.bytes)));
    let (number, shown) = shown.unwrap_or_default();
    format!(
        "has {what} within its first {} lines (line {number}: {shown}); it is not a text point cloud, or needs --delimiter and --columns",
        lines.len()
    )
}

/// Counts numbers in a line, to choose one for a message.
fn numbers_within(line: &[u8]) -> usize {
    text::fields(line).filter(|field| text::number(field).is_some()).count().min(3)
}

fn sampled(start: &[u8], is_whole: bool) -> Vec<Sampled<'_>> {
    let end = if is_whole { start.len() } else { text::last_end(start).unwrap_or(0) };
    let lines = text::all_lines(&start[..end]).zip(1..).map(|(bytes, number)| Sampled {
        number,
        at: bytes.as_ptr().addr() - start.as_ptr().addr(),
        bytes,
    });
    lines.filter(|line| !line.bytes.trim_ascii().is_empty()).take(SAMPLE_LINES).collect()
}

/// Evaluates a way to read the sample; `None` if it finds no rows.
fn candidate<'a>(
    lines: &'a [Sampled<'a>],
    reading: Reading,
    asked: &TextOptions,
) -> Option<Candidate<'a>> {
    let is_number = |field: &Vec<u8>| text::number_with(field, reading.decimal_comma).is_some();
    let is_row = |fields: &[Vec<u8>]| fields.iter().filter(|field| is_number(field)).count() >= 3;
    let could_be = lines.iter().enumerate().filter(|(_, line)| {
        !is_comment(line.bytes, reading.delimiter) && count(line.bytes).is_none()
    });
    let mut splitter = Splitter::new(reading);
    let mut rows: Vec<(usize, Row)> = could_be
        .map(|(place, line)| {
            (place, Row { line, fields: splitter.split(line.bytes), position: None })
        })
        .collect();
    let numeric: Vec<&[Vec<u8>]> =
        rows.iter().map(|(_, row)| row.fields.as_slice()).filter(|fields| is_row(fields)).collect();
    let width = match asked.columns {
        Some(columns) => columns.roles().len(),
        None => width(&numeric, reading, is_number)?,
    };
    let words_at_end = ends_in_words(&numeric, width, rows.len(), reading, is_number);
    let fits = |fields: &[Vec<u8>]| fits(fields, width) || words_at_end && fields.len() > width;
    let begin = rows.iter().position(|(_, row)| is_row(&row.fields) && fits(&row.fields))?;
    rows.drain(..begin);
    let first = rows[0].0;
    let mut rows: Vec<Row> = rows.into_iter().map(|(_, row)| row).collect();

    let kinds: Vec<Kind> =
        (0..width).map(|place| Kind::of(&rows, place, width, &is_number)).collect();
    let Heading { names, misfit, unfit } =
        Heading::find(&lines[..first], reading, width, kinds.last() == Some(&Kind::Empty));
    let misfit = misfit.filter(|_| asked.columns.is_none());
    if misfit.is_some() {
        let matched = rows.len();
        return Some(Candidate {
            reading,
            columns: Vec::new(),
            words_at_end,
            source: Source::Values,
            rows,
            matched,
            misfit,
            unfit,
        });
    }
    let (columns, source) = columns(&rows, &kinds, names, reading, asked)?;
    let contradicted = rows
        .iter()
        .filter(|row| contradicts(&row.fields, &columns, source, reading, asked))
        .count();
    // A line or two may be damaged.
    if contradicted * 10 >= rows.len() {
        return None;
    }
    let axes =
        (0..3).map(|axis| columns.iter().position(|column| column.role == Role::Position(axis)));
    let axes: Vec<usize> = axes.collect::<Option<_>>()?;
    for row in rows.iter_mut().filter(|row| fits(&row.fields)) {
        let value = |axis: usize| text::number_with(&row.fields[axes[axis]], reading.decimal_comma);
        row.position = value(0).zip(value(1)).zip(value(2)).map(|((x, y), z)| [x, y, z]);
    }
    let matched = rows.iter().filter(|row| row.position.is_some()).count();
    Some(Candidate { reading, columns, words_at_end, source, rows, matched, misfit: None, unfit })
}

/// Returns the roles of columns and their origin: as requested, by name, or by value.
fn columns(
    rows: &[Row],
    kinds: &[Kind],
    names: Option<Names>,
    reading: Reading,
    asked: &TextOptions,
) -> Option<(Vec<Column>, Source)> {
    let by_name =
        names.as_ref().map_or(vec![Role::Other; kinds.len()], |names| names.roles.clone());
    let (roles, source) = match (asked.columns, &names) {
        (Some(columns), _) => (columns.roles().to_vec(), Source::Asked),
        (None, Some(names)) if has_all(&by_name) => (by_name, Source::Names(names.line)),
        (None, names) => {
            let values = Values { rows, kinds, decimal_comma: reading.decimal_comma };
            (
                values.roles(by_name)?,
                names.as_ref().map_or(Source::Values, |names| Source::Partly(names.line)),
            )
        }
    };
    let column = |(place, &role): (usize, &Role)| Column {
        name: names
            .as_ref()
            .and_then(|names| names.names.get(place).cloned())
            .filter(|name| !name.is_empty()),
        role: match role {
            _ if source == Source::Asked => role,
            _ if kinds[place] == Kind::Text => Role::Other,
            // Useless alone.
            Role::Returns if !roles.contains(&Role::Return) => Role::Other,
            _ => role,
        },
        is_text: kinds[place] == Kind::Text,
    };
    Some((roles.iter().enumerate().map(column).collect(), source))
}

/// Tests whether the fields of a row show that it is read wrongly: numbers with the other decimal
/// mark, and lists of numbers.
fn contradicts(
    fields: &[Vec<u8>],
    columns: &[Column],
    source: Source,
    reading: Reading,
    asked: &TextOptions,
) -> bool {
    let is_known = matches!(source, Source::Names(_) | Source::Asked);
    fields.iter().enumerate().any(|(place, field)| {
        // Values have not yet decided whether a named column is text.
        let is_used = columns.get(place).is_some_and(|column| {
            column.role != Role::Other
                || column.name.as_deref().is_some_and(|name| names::role(name).is_some())
        });
        (!is_known || is_used) && is_other_number(field, reading.decimal_comma)
            || !is_known && asked.delimiter.is_none() && is_list_of_numbers(field)
    })
}

/// Tests whether rows end in text of several words, separated by blanks.
fn ends_in_words(
    numeric: &[&[Vec<u8>]],
    width: usize,
    rows: usize,
    reading: Reading,
    is_number: impl Fn(&Vec<u8>) -> bool,
) -> bool {
    let longer = numeric.iter().filter(|fields| fields.len() > width).count();
    let mut ends = numeric.iter().filter_map(|fields| fields.get(width - 1));
    reading.delimiter == Delimiter::Space
        && longer > 1
        && longer * 10 >= rows
        && ends.all(|field| !is_number(field))
}

/// Tests for `width` fields, or one more that is empty behind a delimiter at the end.
fn fits(fields: &[Vec<u8>], width: usize) -> bool {
    fields.len() == width || fields.len() == width + 1 && fields.last().is_some_and(Vec::is_empty)
}

/// Returns the most frequent number of fields per row; the least if rows end in words separated by
/// blanks.
fn width(
    rows: &[&[Vec<u8>]],
    reading: Reading,
    is_number: impl Fn(&Vec<u8>) -> bool,
) -> Option<usize> {
    let least = rows.iter().map(|fields| fields.len()).min()?;
    if reading.delimiter == Delimiter::Space
        && least > 3
        && rows.iter().all(|fields| !is_number(&fields[least - 1]))
    {
        return Some(least);
    }
    let mut counts: Vec<(usize, usize)> = Vec::new();
    for fields in rows {
        match counts.iter_mut().find(|(width, _)| *width == fields.len()) {
            Some((_, count)) => *count += 1,
            None => counts.push((fields.len(), 1)),
        }
    }
    // The first of equally frequent ones.
    counts.into_iter().rev().max_by_key(|&(_, count)| count).map(|(width, _)| width)
}

/// Tests for a number with the other decimal mark.
fn is_other_number(field: &[u8], decimal_comma: bool) -> bool {
    text::number_with(field, decimal_comma).is_none()
        && text::number_with(field, !decimal_comma).is_some()
}

/// Tests for a field that other delimiters split into numbers, so that it was split wrongly.
fn is_list_of_numbers(field: &[u8]) -> bool {
    let mut parts = text::fields(field).peekable();
    parts.next().is_some_and(|part| text::number(part).is_some())
        && parts.peek().is_some()
        && parts.all(|part| text::number(part).is_some())
        // A number with a decimal comma is one number.
        && text::number_with(field, true).is_none()
}

/// Removes the contradicted one of two candidates: integers separated by commas, or decimal-comma
/// numbers separated by commas.
fn weigh_pairs(candidates: &mut Vec<Candidate>) {
    /// Number of distinct fractions that prove decimals: 1 in 38,000 that this many integers
    /// without leading zeros are all different.
    const MANY: usize = 100;
    let Some(paired) = candidates.iter().find(|candidate| candidate.reading.paired) else { return };
    // One line may be damaged if there are many.
    let few = paired.rows.len() < 20;
    if paired.matched + usize::from(!few) < paired.rows.len() {
        return candidates.retain(|candidate| !candidate.reading.paired);
    }
    let fractions = || {
        paired
            .rows
            .iter()
            .flat_map(|row| &row.fields)
            .filter_map(|field| field.split(|&byte| byte == b',').nth(1))
    };
    let padded = fractions().filter(|fraction| fraction.len() > 1 && fraction[0] == b'0').count();
    let distinct = fractions().filter(|fraction| fraction.len() > 1).collect::<BTreeSet<_>>().len();
    let drop_paired = padded == 0 && distinct >= MANY;
    // No program writes 007 for 7.
    let drop_whole = padded > 0 && padded * 100 >= fractions().count();
    candidates.retain(|candidate| {
        if candidate.reading.paired {
            !drop_paired
        } else {
            !drop_whole || !is_whole_numbers(candidate)
        }
    });
}

fn is_whole_numbers(candidate: &Candidate) -> bool {
    let rows = candidate.rows.iter().filter(|row| row.position.is_some());
    candidate.reading.delimiter == Delimiter::Comma
        && rows.flat_map(|row| &row.fields).all(|field| is_whole(field))
}

/// Describes the first line that two candidates read as different points.
fn two_meanings(candidates: &[Candidate]) -> Option<String> {
    let (first, others) = candidates.split_first()?;
    others.iter().find_map(|other| {
        first.rows.iter().find_map(|row| {
            let own = row.position?;
            let same = other.rows.iter().find(|other| other.line.number == row.line.number);
            let others = same?.position.filter(|position| position.map(f64::to_bits) != own.map(f64::to_bits))?;
            let place = |[x, y, z]: [f64; 3]| format!("{x} {y} {z}");
            Some(format!(
                "line {} has two meanings: {} is the point {} ({}) or {} ({}); choose with --delimiter or --columns",
                row.line.number,
                text::shown(row.line.bytes),
                place(own),
                first.reading,
                place(others),
                other.reading
            ))
        })
    })
}

fn table(lines: &[Sampled], chosen: Candidate) -> Table {
    let Candidate { reading, columns, words_at_end, source, rows, unfit, .. } = chosen;
    let has = |role: Role| columns.iter().any(|column| column.role == role);
    let first = &rows[0].line;
    let before = lines.iter().take_while(|line| line.number < first.number);
    let rows_before = before.clone().filter(|line| !is_comment(line.bytes, reading.delimiter));
    let count = rows_before.clone().filter_map(|line| line::count(line.bytes)).last();
    let named =
        if let Source::Names(line) | Source::Partly(line) = source { Some(line) } else { None };
    let mut splitter = Splitter::new(reading);
    let mut has_number = |line: &Sampled| {
        splitter
            .split(line.bytes)
            .iter()
            .any(|field| text::number_with(field, reading.decimal_comma).is_some())
    };
    let others: Vec<&Sampled> = rows_before
        .filter(|line| line::count(line.bytes).is_none() && Some(line.number) != named)
        .collect();
    let (odd, passed): (Vec<&Sampled>, Vec<&Sampled>) =
        others.into_iter().partition(|line| has_number(line));
    Table {
        reading,
        words_at_end,
        unfit: unfit.filter(|_| matches!(source, Source::Values | Source::Partly(_))),
        lacks_returns: has(Role::Return) && !has(Role::Returns),
        columns,
        source,
        count,
        body_at: first.at,
        lines_before: first.number - 1,
        odd: odd.into_iter().map(|line| (line.number, text::shown(line.bytes))).collect(),
        passed: passed.len() as u64,
    }
}
