//! Numbers of points that have no column of their own: one of them at a time is read, by its name.

use std::fmt;
use std::str::FromStr;

/// A number of each point, as in `--color`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
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

    /// Parses a name. The name of an extra attribute lives as long as the process.
    fn from_str(text: &str) -> Result<Scalar, ()> {
        let named = NAMED.into_iter().find(|scalar| scalar.to_string() == text);
        let extra = || text.strip_prefix(EXTRA).filter(|name| !name.is_empty());
        named.or_else(|| extra().map(|name| Scalar::Extra(name.to_owned().leak()))).ok_or(())
    }
}
