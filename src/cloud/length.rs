//! Lengths as users write them: numbers, with or without a unit.

/// A length.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Length {
    /// In the unit of the coordinates.
    OfCoordinates(f64),
    /// `[m]`
    Metres(f64),
}

/// Units that are written after a number, and how long they are `[m]`. Names come before their
/// ends.
const WRITTEN: [(&str, f64); 6] = [
    ("mm", 0.001),
    ("cm", 0.01),
    ("km", 1000.0),
    ("m", 1.0),
    ("ftUS", 1200.0 / 3937.0),
    ("ft", 0.3048),
];

/// Lists the units that may be written after a number.
pub fn units() -> String {
    WRITTEN.map(|(unit, _)| unit).join(", ")
}

impl Default for Length {
    fn default() -> Length {
        Length::OfCoordinates(0.0)
    }
}

impl Length {
    /// Returns the length in the unit of the coordinates, which is this many metres.
    pub fn counted_in(self, unit_m: f64) -> f64 {
        match self {
            Length::OfCoordinates(length) => length,
            Length::Metres(metres) => metres / unit_m,
        }
    }

    /// Returns the number that was written.
    pub fn number(self) -> f64 {
        let (Length::OfCoordinates(number) | Length::Metres(number)) = self;
        number
    }
}

impl std::str::FromStr for Length {
    type Err = String;

    fn from_str(text: &str) -> Result<Length, String> {
        let unit = WRITTEN.iter().find_map(|(unit, m)| Some((text.strip_suffix(unit)?, m)));
        let number = unit.map_or(text, |(number, _)| number).trim();
        let number = number.parse().ok().filter(|number: &f64| number.is_finite());
        let number = number.ok_or_else(|| {
            format!("{text:?} is not a length, such as 0.25, 0.25m or 10ft; units are {}", units())
        })?;
        Ok(unit.map_or(Length::OfCoordinates(number), |(_, m)| Length::Metres(number * m)))
    }
}

impl std::fmt::Display for Length {
    /// Formats as it is parsed.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Length::OfCoordinates(number) => write!(f, "{number}"),
            Length::Metres(number) => write!(f, "{number}m"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_are_in_the_unit_that_is_written_after_them() {
        let read = |text: &str| text.parse::<Length>();
        assert_eq!(read("0.25"), Ok(Length::OfCoordinates(0.25)));
        assert_eq!(read("10m"), Ok(Length::Metres(10.0)));
        assert_eq!(read("10 m"), Ok(Length::Metres(10.0)));
        assert_eq!(read("10ft"), Ok(Length::Metres(10.0 * 0.3048)));
        assert_eq!(read("3937ftUS"), Ok(Length::Metres(1200.0)));
        for (text, metres) in [("20mm", 0.02), ("5cm", 0.05), ("1km", 1000.0)] {
            assert_eq!(read(text), Ok(Length::Metres(metres)));
        }
        assert!(read("3meter").unwrap_err().ends_with("units are mm, cm, km, m, ftUS, ft"));
        for wrong in ["", "m", "1dm", "x", "infm", "nan"] {
            assert!(read(wrong).is_err(), "{wrong}");
        }
        assert_eq!(Length::Metres(3.048).counted_in(0.3048), 10.0);
        assert_eq!(Length::OfCoordinates(3.0).counted_in(0.3048), 3.0);
        for length in [Length::Metres(0.5), Length::OfCoordinates(0.25)] {
            assert_eq!(read(&length.to_string()), Ok(length));
        }
    }
}
