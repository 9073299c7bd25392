//! One line of a table to a point.
//!
//! A field without a number that fits its column is missing; later fields keep their columns.

use super::{Delimiter, Reading, Role, Table};
use crate::cloud::floats::Point;
use crate::cloud::{Extra, text};

/// The contents of a line.
#[derive(Clone, Debug, PartialEq)]
pub enum Line {
    Point,
    Comment,
    /// The number of points of the following block, as in PTS.
    Count(u64),
    /// A position that marks missing data, such as -1.70141E+38.
    NoData,
    /// Not a row of this table, with the reason.
    Bad(String),
}

/// Missing values of a column.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Missing {
    pub lines: u64,
    /// Line of the first, from 1.
    pub first: u64,
}

impl Missing {
    pub fn add(&mut self, line: u64) {
        self.join(Missing { lines: 1, first: line });
    }

    /// Adds those of later lines.
    pub fn join(&mut self, later: Missing) {
        if self.lines == 0 {
            self.first = later.first;
        }
        self.lines += later.lines;
    }
}

impl Table {
    /// Reads a line into `point`, which has default values. Appends columns without a value to
    /// `gaps`. Adds values of columns outside of points to `extras`, which has one entry per
    /// column, or none if not requested.
    pub fn line(
        &self,
        line: &[u8],
        splitter: &mut Splitter,
        point: &mut Point,
        gaps: &mut Vec<usize>,
        extras: &mut [Extra],
    ) -> Line {
        if is_comment(line, self.reading.delimiter) {
            return Line::Comment;
        }
        if self.count.is_some()
            && let Some(count) = count(line)
        {
            return Line::Count(count);
        }
        if self.reading.paired {
            let fields = splitter.split(line);
            return self.row(fields.iter().map(Vec::as_slice), point, gaps, extras);
        }
        if memchr::memchr(b'"', line).is_some() {
            return self.row(splitter.quoted(line), point, gaps, extras);
        }
        match self.reading.delimiter.byte() {
            Some(byte) => {
                self.row(line.split(|&b| b == byte).map(<[u8]>::trim_ascii), point, gaps, extras)
            }
            None => self.row(text::blanks(line), point, gaps, extras),
        }
    }

    fn row<'a>(
        &self,
        mut fields: impl Iterator<Item = &'a [u8]>,
        point: &mut Point,
        gaps: &mut Vec<usize>,
        extras: &mut [Extra],
    ) -> Line {
        for (place, column) in self.columns.iter().enumerate() {
            let Some(field) = fields.next() else {
                return Line::Bad(format!("{place} fields, not {}", self.columns.len()));
            };
            if column.role == Role::Other {
                if let Some(extra) = extras.get_mut(place) {
                    extra.add(text::number_with(field, self.reading.decimal_comma));
                }
                continue;
            }
            match text::number_with(field, self.reading.decimal_comma)
                .filter(|&value| column.role.holds(value))
            {
                Some(value) => point.set(column.role, value),
                None if matches!(column.role, Role::Position(_)) => {
                    return Line::Bad(format!("no number for {}", self.title(place)));
                }
                None => {
                    point.set(column.role, f64::NAN);
                    gaps.push(place);
                }
            }
        }
        if self.lacks_returns {
            point.returns |= point.returns << 4;
        }
        let surplus =
            fields.by_ref().enumerate().find(|(place, field)| *place > 0 || !field.is_empty());
        if surplus.is_some() && !self.words_at_end {
            return Line::Bad(format!("more than {} fields", self.columns.len()));
        }
        if point.position.iter().any(|&v| stands_for_none(v)) { Line::NoData } else { Line::Point }
    }
}

/// Tests for the largest numbers that programs write for missing values: for 32 bits 1E38, 2^127
/// and the maximum, and the maximum of 64 bits.
fn stands_for_none(v: f64) -> bool {
    (1e37..=3.5e38).contains(&v.abs()) || v.abs() == f64::MAX
}

/// Tests for comments: `#`, `//`, `%`; and `;` if it is not the delimiter.
pub fn is_comment(line: &[u8], delimiter: Delimiter) -> bool {
    match line.trim_ascii_start() {
        [b'#' | b'%', ..] | [b'/', b'/', ..] => true,
        [b';', ..] => delimiter != Delimiter::Semicolon,
        _ => false,
    }
}

/// Parses a line with a single count.
pub fn count(line: &[u8]) -> Option<u64> {
    let digits = line.trim_ascii();
    if digits.is_empty() || !digits.iter().all(u8::is_ascii_digit) {
        return None;
    }
    std::str::from_utf8(digits).ok()?.parse().ok()
}

/// A splitter of lines into fields, with quotes.
pub struct Splitter {
    reading: Reading,
    /// Reads quoted lines, once there is one: making it takes longer than a short file.
    quotes: Option<csv_core::Reader>,
    /// The fields of a line, concatenated, and the end of each.
    bare: Vec<u8>,
    bytes: Vec<u8>,
    ends: Vec<usize>,
}

impl Splitter {
    pub fn new(reading: Reading) -> Self {
        Splitter { reading, quotes: None, bare: Vec::new(), bytes: Vec::new(), ends: Vec::new() }
    }

    /// Returns the fields of a line without quotes.
    pub fn split(&mut self, line: &[u8]) -> Vec<Vec<u8>> {
        let fields: Vec<Vec<u8>> = match self.reading.delimiter.byte() {
            _ if line.contains(&b'"') => self.quoted(line).map(<[u8]>::to_vec).collect(),
            Some(byte) => {
                line.split(|&b| b == byte).map(|field| field.trim_ascii().to_vec()).collect()
            }
            None => text::blanks(line).map(<[u8]>::to_vec).collect(),
        };
        if self.reading.paired { pairs(&fields) } else { fields }
    }

    /// Splits by the rules of CSV, within one line. Blanks before a quote are not part of its
    /// field.
    fn quoted(&mut self, line: &[u8]) -> impl Iterator<Item = &[u8]> {
        let byte = self.reading.delimiter.byte();
        let delimiter = byte.unwrap_or(b' ');
        self.bare.clear();
        for &byte in line {
            let byte = if self.reading.delimiter == Delimiter::Space && byte == b'\t' {
                b' '
            } else {
                byte
            };
            if byte == b'"' {
                let kept =
                    self.bare.iter().rposition(|&byte| byte != b' ').map_or(0, |last| last + 1);
                if delimiter != b' ' && (kept == 0 || self.bare[kept - 1] == delimiter) {
                    self.bare.truncate(kept);
                }
            }
            self.bare.push(byte);
        }
        let bare = if byte.is_none() { self.bare.trim_ascii() } else { &self.bare };
        // At most one field more than delimiters, and one byte more than the line, so that the
        // output never overflows.
        self.bytes.resize(bare.len() + 1, 0);
        self.ends.resize(bare.len() + 2, 0);
        let make = || csv_core::ReaderBuilder::new().delimiter(delimiter).build();
        let quotes = self.quotes.get_or_insert_with(make);
        quotes.reset();
        let (_, _, written, fields) = quotes.read_record(bare, &mut self.bytes, &mut self.ends);
        let (_, _, _, more) =
            quotes.read_record(&[], &mut self.bytes[written..], &mut self.ends[fields..]);
        let mut start = 0;
        let fields = self.ends[..fields + more]
            .iter()
            .map(move |&end| std::mem::replace(&mut start, end)..end);
        fields
            .map(|range| self.bytes[range].trim_ascii())
            .filter(move |field| byte.is_some() || !field.is_empty())
    }
}

/// Joins pairs of fields into numbers; empty if some pair is not one.
fn pairs(fields: &[Vec<u8>]) -> Vec<Vec<u8>> {
    let joined = |pair: &[Vec<u8>]| match pair {
        [whole, part]
            if !part.is_empty() && part.iter().all(u8::is_ascii_digit) && is_whole(whole) =>
        {
            Some([whole.as_slice(), b",", part].concat())
        }
        _ => None,
    };
    fields.chunks(2).map(joined).collect::<Option<_>>().unwrap_or_default()
}

/// Tests for digits with an optional sign.
pub fn is_whole(field: &[u8]) -> bool {
    let digits = field.strip_prefix(b"-").or(field.strip_prefix(b"+")).unwrap_or(field);
    !digits.is_empty() && digits.iter().all(u8::is_ascii_digit)
}

#[cfg(test)]
mod tests {
    use super::*;

    const COMMA: Reading =
        Reading { delimiter: Delimiter::Comma, decimal_comma: false, paired: false };

    fn fields(line: &str, reading: Reading) -> Vec<String> {
        Splitter::new(reading)
            .split(line.as_bytes())
            .into_iter()
            .map(|field| String::from_utf8(field).unwrap())
            .collect()
    }

    #[test]
    fn quotes_hold_delimiters_and_quotes() {
        assert_eq!(fields(r#""a, b", 2,"3","4 ""x""""#, COMMA), ["a, b", "2", "3", r#"4 "x""#]);
        assert_eq!(fields(r#" "1.5" , "2.5",  "a, b""#, COMMA), ["1.5", "2.5", "a, b"]);
        assert_eq!(fields(r#"1,"cut"#, COMMA), ["1", "cut"]);
        assert_eq!(fields("", COMMA), [""]);
        assert_eq!(fields("1,,3,", COMMA), ["1", "", "3", ""]);
        let space = Reading { delimiter: Delimiter::Space, ..COMMA };
        assert_eq!(fields("  \"P 1\"\t 2  3 ", space), ["P 1", "2", "3"]);
    }

    #[test]
    fn pairs_are_numbers_or_nothing() {
        let paired = Reading { decimal_comma: true, paired: true, ..COMMA };
        assert_eq!(fields("1,5,-2,25,3,0", paired), ["1,5", "-2,25", "3,0"]);
        assert!(
            fields("1,5,2", paired).is_empty()
                && fields("1,5,2,-5", paired).is_empty()
                && fields("1.5,5", paired).is_empty()
        );
    }
}
