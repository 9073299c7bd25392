//! Words of the command line, of scene files and of the window: names of an enum's values, lists.

use std::str::FromStr;
use strum::VariantArray;

/// An enum whose values have names. It derives `EnumString`, `IntoStaticStr` and `VariantArray`.
pub trait Named: Copy + Send + Sync + 'static {
    /// All values, in the order in which they are listed.
    const ALL: &'static [Self];

    fn name(self) -> &'static str;

    /// Returns the value of this name, or of an old one. Errors name those that there are.
    fn named(name: &str) -> Result<Self, String>;
}

impl<E> Named for E
where
    E: Copy + FromStr + Into<&'static str> + VariantArray + Send + Sync,
{
    const ALL: &'static [E] = E::VARIANTS;

    fn name(self) -> &'static str {
        self.into()
    }

    fn named(name: &str) -> Result<E, String> {
        name.parse().map_err(|_| {
            let names: Vec<&str> = E::VARIANTS.iter().map(|&value| value.into()).collect();
            format!("there is no {name:?}; there are: {}", names.join(", "))
        })
    }
}

/// Most conditions, clip boxes or opacity rules of a list: every point is compared with each.
const MOST_WORDS: usize = 1000;

/// Returns the values of a list of words. Errors if one is wrong or the list is too long.
pub fn parse_list<T, W>(words: impl IntoIterator<Item = W>) -> Result<Vec<T>, String>
where
    T: FromStr<Err = String>,
    W: AsRef<str>,
{
    let mut values = Vec::new();
    for word in words {
        if values.len() == MOST_WORDS {
            let word = word.as_ref();
            return Err(format!("{word:?} is one too many: at most {MOST_WORDS} are allowed"));
        }
        values.push(word.as_ref().parse()?);
    }
    Ok(values)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cloud::filter::Condition;

    #[test]
    fn lists_are_bounded() {
        let list = |length| parse_list::<Condition, _>(vec!["class=2"; length]);
        assert_eq!(list(MOST_WORDS).unwrap().len(), MOST_WORDS);
        let said = list(MOST_WORDS + 1).unwrap_err();
        assert_eq!(said, "\"class=2\" is one too many: at most 1000 are allowed");
    }
}
