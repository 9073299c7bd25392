//! LINE -> POINT, as the table says.
//!
//! In: a line. Out: a [`Point`], or why it is none. A field that holds no number its column could have is missing in its place: nothing moves up.

use super::{Delimiter, Reading, Role, Table};
use crate::cloud::floats::Point;
use crate::cloud::text;

/// What a line is.
#[derive(Clone, Debug, PartialEq)]
pub enum Line {
    Point,
    Comment,
    /// The number of points in the block that follows, as PTS has it before each.
    Count(u64),
    /// A position that stands for none, such as -1.70141E+38.
    NoData,
    /// No row of this table, and why.
    Bad(String),
}

/// Where the fields of a column were no numbers.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Missing {
    pub lines: u64,
    /// Counted from 1.
    pub first: u64,
}

impl Missing {
    fn add(&mut self, line: u64) {
        self.join(Missing { lines: 1, first: line });
    }

    /// Adds those of lines that come later.
    pub fn join(&mut self, later: Missing) {
        if self.lines == 0 {
            self.first = later.first;
        }
        self.lines += later.lines;
    }
}

impl Table {
    /// Reads the line with this number into `point`, which is as it begins, and counts the columns that it lacks.
    pub fn line(&self, line: &[u8], number: u64, point: &mut Point, missing: &mut [Missing]) -> Line {
        if is_comment(line, self.reading.delimiter) {
            return Line::Comment;
        }
        if self.count.is_some()
            && let Some(count) = count(line)
        {
            return Line::Count(count);
        }
        if self.reading.paired || line.contains(&b'"') {
            let fields = split(line, self.reading);
            return self.row(fields.iter().map(Vec::as_slice), number, point, missing);
        }
        match self.reading.delimiter.byte() {
            Some(byte) => self.row(line.split(|&b| b == byte).map(<[u8]>::trim_ascii), number, point, missing),
            None => self.row(text::blanks(line), number, point, missing),
        }
    }

    fn row<'a>(&self, mut fields: impl Iterator<Item = &'a [u8]>, number: u64, point: &mut Point, missing: &mut [Missing]) -> Line {
        for (place, column) in self.columns.iter().enumerate() {
            let Some(field) = fields.next() else {
                return Line::Bad(format!("{place} fields, not {}", self.columns.len()));
            };
            if column.role == Role::Other {
                continue;
            }
            match text::number_with(field, self.reading.decimal_comma).filter(|&value| column.role.holds(value)) {
                Some(value) => point.set(column.role, value),
                None if matches!(column.role, Role::Position(_)) => {
                    return Line::Bad(format!("no number for {}", self.title(place)));
                }
                None => {
                    point.set(column.role, f64::NAN);
                    missing[place].add(number);
                }
            }
        }
        if self.lacks_returns {
            point.returns |= point.returns << 4;
        }
        let surplus = fields.by_ref().enumerate().find(|(place, field)| *place > 0 || !field.is_empty());
        if surplus.is_some() && !self.words_at_end {
            return Line::Bad(format!("more than {} fields", self.columns.len()));
        }
        if point.position.iter().any(|&v| stands_for_none(v)) { Line::NoData } else { Line::Point }
    }
}

/// The largest powers that programs write where there is no number: of 32 bits 1E38, 2^127 and the largest there is, and the largest of 64 bits.
fn stands_for_none(v: f64) -> bool {
    (1e37..=3.5e38).contains(&v.abs()) || v.abs() == f64::MAX
}

/// Lines that are no rows: `#`, `//`, `%`; and `;` where it is no delimiter.
pub fn is_comment(line: &[u8], delimiter: Delimiter) -> bool {
    match line.trim_ascii_start() {
        [b'#' | b'%', ..] | [b'/', b'/', ..] => true,
        [b';', ..] => delimiter != Delimiter::Semicolon,
        _ => false,
    }
}

/// What a line of digits alone says.
pub fn count(line: &[u8]) -> Option<u64> {
    let digits = line.trim_ascii();
    if digits.is_empty() || !digits.iter().all(u8::is_ascii_digit) {
        return None;
    }
    std::str::from_utf8(digits).ok()?.parse().ok()
}

/// The fields of a line, quotes taken off.
pub fn split(line: &[u8], reading: Reading) -> Vec<Vec<u8>> {
    let trimmed = |field: &[u8]| field.trim_ascii().to_vec();
    let fields: Vec<Vec<u8>> = match reading.delimiter.byte() {
        Some(byte) if line.contains(&b'"') => quoted(line, byte).iter().map(|field| trimmed(field)).collect(),
        Some(byte) => line.split(|&b| b == byte).map(trimmed).collect(),
        None if line.contains(&b'"') => {
            let spaced: Vec<u8> = line.iter().map(|&byte| if byte == b'\t' { b' ' } else { byte }).collect();
            quoted(spaced.trim_ascii(), b' ').iter().map(|field| trimmed(field)).filter(|field| !field.is_empty()).collect()
        }
        None => text::blanks(line).map(<[u8]>::to_vec).collect(),
    };
    if reading.paired { pairs(&fields) } else { fields }
}

/// Fields by the rules of CSV, within one line. Blanks before a quote are none of its field.
fn quoted(line: &[u8], delimiter: u8) -> Vec<Vec<u8>> {
    let mut bare: Vec<u8> = Vec::with_capacity(line.len());
    for &byte in line {
        if byte == b'"' {
            let kept = bare.iter().rposition(|&byte| byte != b' ').map_or(0, |last| last + 1);
            if kept == 0 || bare[kept - 1] == delimiter {
                bare.truncate(kept);
            }
        }
        bare.push(byte);
    }
    let line = bare.as_slice();
    let mut reader = csv_core::ReaderBuilder::new().delimiter(delimiter).build();
    // One field more than there are delimiters at most; one byte more than the line has, so that nothing is ever full.
    let (mut bytes, mut ends) = (vec![0; line.len() + 1], vec![0; line.len() + 2]);
    let (_, _, written, fields) = reader.read_record(line, &mut bytes, &mut ends);
    let (_, _, _, more) = reader.read_record(&[], &mut bytes[written..], &mut ends[fields..]);
    let mut start = 0;
    ends[..fields + more].iter().map(|&end| bytes[std::mem::replace(&mut start, end)..end].to_vec()).collect()
}

/// Two and two fields as one number; none where some do not make one.
fn pairs(fields: &[Vec<u8>]) -> Vec<Vec<u8>> {
    let joined = |pair: &[Vec<u8>]| match pair {
        [whole, part] if !part.is_empty() && part.iter().all(u8::is_ascii_digit) && is_whole(whole) => {
            Some([whole.as_slice(), b",", part].concat())
        }
        _ => None,
    };
    fields.chunks(2).map(joined).collect::<Option<_>>().unwrap_or_default()
}

/// Digits, perhaps behind a sign.
pub fn is_whole(field: &[u8]) -> bool {
    let digits = field.strip_prefix(b"-").or(field.strip_prefix(b"+")).unwrap_or(field);
    !digits.is_empty() && digits.iter().all(u8::is_ascii_digit)
}

#[cfg(test)]
mod tests {
    use super::*;

    const COMMA: Reading = Reading { delimiter: Delimiter::Comma, decimal_comma: false, paired: false };

    fn fields(line: &str, reading: Reading) -> Vec<String> {
        split(line.as_bytes(), reading).into_iter().map(|field| String::from_utf8(field).unwrap()).collect()
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
        assert!(fields("1,5,2", paired).is_empty() && fields("1,5,2,-5", paired).is_empty() && fields("1.5,5", paired).is_empty());
    }
}
