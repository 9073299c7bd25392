//! Numbers of points that have no column of their own: those that are asked for are read, by their
//! names.

use std::collections::BTreeSet;
use std::fmt;
use std::str::FromStr;
use std::sync::{LazyLock, Mutex, MutexGuard};

/// A number of each point, as in `--color`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Scalar {
    /// Near infrared, as in the file.
    NearInfrared,
    /// Scan angle `[degrees]`.
    ScanAngle,
    /// Height above a coarse ground surface ([`super::ground`]) `[m]`.
    HeightAboveGround,
    /// Extra bytes of LAS, a property of PLY or a column of a text table, by its name.
    Extra(&'static str),
}

/// Beginning of the names of [`Scalar::Extra`].
const EXTRA: &str = "extra:";

/// Those with a name of their own.
pub const NAMED: [Scalar; 3] = [Scalar::NearInfrared, Scalar::ScanAngle, Scalar::HeightAboveGround];

impl Scalar {
    /// Returns the name of an attribute of a file.
    pub fn extra_name(name: &str) -> String {
        format!("{EXTRA}{name}")
    }

    /// Returns an attribute of a file by its name.
    pub fn extra(name: &str) -> Scalar {
        let mut names = lock(&NAMES);
        let kept = names.get(name).copied();
        Scalar::Extra(kept.unwrap_or_else(|| {
            let name: &'static str = name.to_owned().leak();
            names.insert(name);
            name
        }))
    }

    /// Returns the scalar that a name means in PLY and text.
    pub fn named(name: &str) -> Scalar {
        match name.to_lowercase().replace(['-', ' '], "_").as_str() {
            "near_infrared" | "nir" => Scalar::NearInfrared,
            "scan_angle" => Scalar::ScanAngle,
            _ => Scalar::extra(name),
        }
    }

    /// Tests whether it is the attribute of this name in a file.
    pub fn is_extra(self, name: &str) -> bool {
        matches!(self, Scalar::Extra(own) if own.eq_ignore_ascii_case(name))
    }

    /// Returns what a legend says.
    pub fn title(self) -> String {
        match self {
            Scalar::NearInfrared => "near infrared".into(),
            Scalar::ScanAngle => "scan angle [degrees]".into(),
            Scalar::HeightAboveGround => "height above ground".into(),
            Scalar::Extra(name) => name.into(),
        }
    }
}

impl fmt::Display for Scalar {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Scalar::NearInfrared => write!(f, "nir"),
            Scalar::ScanAngle => write!(f, "scan-angle"),
            Scalar::HeightAboveGround => write!(f, "height-above-ground"),
            Scalar::Extra(name) => write!(f, "{EXTRA}{name}"),
        }
    }
}

impl FromStr for Scalar {
    type Err = ();

    fn from_str(text: &str) -> Result<Scalar, ()> {
        let named = NAMED.into_iter().find(|scalar| scalar.to_string() == text);
        let extra = || text.strip_prefix(EXTRA).filter(|name| !name.is_empty());
        named.or_else(|| extra().map(Scalar::extra)).ok_or(())
    }
}

/// A set of scalars, in order. Each set and each name is kept once, for as long as the process
/// lives.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(into = "Vec<String>", try_from = "Vec<String>")]
pub struct Scalars {
    named: &'static [Scalar],
    /// Choice of all scalars of a file, beside the named ones.
    all: bool,
}

static NAMES: LazyLock<Mutex<BTreeSet<&'static str>>> = LazyLock::new(Mutex::default);
static SETS: LazyLock<Mutex<BTreeSet<&'static [Scalar]>>> = LazyLock::new(Mutex::default);

fn lock<T>(kept: &Mutex<T>) -> MutexGuard<'_, T> {
    kept.lock().unwrap_or_else(|poisoned| poisoned.into_inner())
}

impl Scalars {
    pub const NONE: Scalars = Scalars { named: &[], all: false };
    /// All that a file has. Heights above ground are asked for by name.
    pub const ALL: Scalars = Scalars { named: &[], all: true };

    pub fn is_empty(self) -> bool {
        self.named.is_empty() && !self.all
    }

    pub fn has(self, scalar: Scalar) -> bool {
        self.named.contains(&scalar) || self.all && scalar != Scalar::HeightAboveGround
    }

    /// Returns the attribute of this name in PLY or text, if it is in the set.
    pub fn named(self, name: &str) -> Option<Scalar> {
        let own = Scalar::named(name);
        let extra = self.named.iter().copied().find(|scalar| scalar.is_extra(name));
        extra.or_else(|| self.has(own).then_some(own))
    }

    /// Returns extra bytes of this name, if they are in the set.
    pub fn extra(self, name: &str) -> Option<Scalar> {
        let named = self.named.iter().copied().find(|scalar| scalar.is_extra(name));
        named.or_else(|| self.all.then(|| Scalar::extra(name)))
    }

    /// Returns those that are in the set by name.
    pub fn iter(self) -> impl Iterator<Item = Scalar> {
        self.named.iter().copied()
    }

    /// Returns the union of both sets.
    pub fn and(self, other: Scalars) -> Scalars {
        let both = self.iter().chain(other.iter()).collect();
        Scalars { all: self.all || other.all, ..both }
    }
}

impl From<Scalars> for Vec<String> {
    fn from(scalars: Scalars) -> Vec<String> {
        scalars.iter().map(|scalar| scalar.to_string()).collect()
    }
}

impl TryFrom<Vec<String>> for Scalars {
    type Error = String;

    fn try_from(names: Vec<String>) -> Result<Scalars, String> {
        let scalar = |name: &String| name.parse().map_err(|()| format!("{name:?} is no attribute"));
        names.iter().map(scalar).collect()
    }
}

impl FromIterator<Scalar> for Scalars {
    fn from_iter<I: IntoIterator<Item = Scalar>>(scalars: I) -> Scalars {
        let own: Vec<Scalar> = scalars.into_iter().collect::<BTreeSet<_>>().into_iter().collect();
        if own.is_empty() {
            return Scalars::NONE;
        }
        let mut sets = lock(&SETS);
        let kept = sets.get(own.as_slice()).copied();
        let named = kept.unwrap_or_else(|| {
            let named: &'static [Scalar] = own.leak();
            sets.insert(named);
            named
        });
        Scalars { named, all: false }
    }
}

/// A column of numbers.
#[derive(Clone, Debug, PartialEq)]
pub struct ScalarColumn {
    pub scalar: Scalar,
    /// A number a point; NaN where missing.
    pub numbers: Vec<f64>,
}

/// Lists names, and each family of three or more that are numbered in order as one:
/// `extra:f_rest_0..44`.
pub fn listed(names: &[String]) -> String {
    let mut families: Vec<Vec<&str>> = Vec::new();
    for name in names {
        let follows = |before: &&str| match (numbered(before), numbered(name)) {
            (Some((stem, number)), Some((own, next))) => stem == own && number + 1 == next,
            _ => false,
        };
        match families.last_mut().filter(|family| family.last().is_some_and(follows)) {
            Some(family) => family.push(name),
            None => families.push(vec![name]),
        }
    }
    let word = |family: Vec<&str>| match family[..] {
        [first, _, .., last] if family.len() > 2 => {
            format!("{first}..{}", numbered(last).map_or(0, |(_, number)| number))
        }
        _ => family.join(", "),
    };
    families.into_iter().map(word).collect::<Vec<_>>().join(", ")
}

/// Splits a name that ends in a number.
fn numbered(name: &str) -> Option<(&str, u32)> {
    let stem = name.trim_end_matches(|letter: char| letter.is_ascii_digit());
    let number = &name[stem.len()..];
    let number = number.parse().ok().filter(|value: &u32| value.to_string() == number)?;
    Some((stem, number))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbered_names_are_listed_as_one() {
        let of =
            |names: &[&str]| listed(&names.iter().map(|name| name.to_string()).collect::<Vec<_>>());
        let rest: Vec<String> = (0..45).map(|k| format!("extra:f_rest_{k}")).collect();
        assert_eq!(listed(&rest), "extra:f_rest_0..44");
        assert_eq!(of(&["a1", "a2", "b1", "b2", "b3", "c"]), "a1, a2, b1..3, c");
        assert_eq!(of(&["a0", "a2", "a3", "9", "10", "11"]), "a0, a2, a3, 9..11");
        assert_eq!(of(&["a08", "a09", "a10", "time"]), "a08, a09, a10, time");
        assert_eq!(of(&[]), "");
    }
}
