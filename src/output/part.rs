//! Parts of a picture or of a camera path, which machines draw that know nothing of each other.

use super::tiled::PIECE;
use std::fmt;
use std::ops::Range;
use std::str::FromStr;

/// Rows of a part of a picture are multiples of this `[px]`, so that its pieces are those of the
/// whole picture.
const ROWS: u32 = PIECE[1];

const MOST_PARTS: u64 = 1_000_000;

/// One of several parts of a picture or of a path, from 1 on: each can be drawn by another machine.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Part {
    number: u64,
    of: u64,
}

impl Part {
    /// Returns the rows of this part `[px]`, from the top down; `None` if it has none.
    pub fn rows(self, height: u32) -> Option<Range<u32>> {
        let blocks = self.range(height.div_ceil(ROWS) as u64);
        let [start, end] =
            [blocks.start, blocks.end].map(|block| (block as u32 * ROWS).min(height));
        (start < end).then_some(start..end)
    }

    /// Returns the numbers of this part among all frames or blocks.
    pub fn range(self, total: u64) -> Range<u64> {
        (self.number - 1) * total / self.of..self.number * total / self.of
    }
}

impl FromStr for Part {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Part, String> {
        let numbers = text.split_once('/').map(|(number, of)| (number.parse(), of.parse()));
        match numbers {
            Some((Ok(number), Ok(of))) if (1..=of).contains(&number) && of <= MOST_PARTS => {
                Ok(Part { number, of })
            }
            _ => Err(format!("{text:?} is not a part such as 3/16, of at most {MOST_PARTS}")),
        }
    }
}

impl fmt::Display for Part {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.number, self.of)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_cover_everything_once() {
        for of in [1, 2, 3, 7, 16] {
            let parts = (1..=of).map(|number| Part { number, of });
            let frames: Vec<u64> = parts.clone().flat_map(|part| part.range(100)).collect();
            assert!(frames.into_iter().eq(0..100));
            for height in [1, 1023, 1024, 1025, 5000] {
                let rows: Vec<u32> =
                    parts.clone().filter_map(|part| part.rows(height)).flatten().collect();
                assert!(rows.into_iter().eq(0..height), "{height} rows in {of} parts");
            }
        }
    }

    #[test]
    fn parts_are_counted_from_one() {
        assert_eq!("3/16".parse(), Ok(Part { number: 3, of: 16 }));
        for wrong in ["", "3", "0/16", "17/16", "3/0", "-1/2", "1/2/3", "a/b", "1/1000001"] {
            let said = wrong.parse::<Part>().unwrap_err();
            assert!(said.contains("is not a part such as 3/16"), "{said}");
        }
    }
}
