//! Enums whose values have names: those of the command line, of scene files and of the window.

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
