//! GeoTIFF keys to a system.
//!
//! The three records of a LAS file hold keys, numbers and texts. They give name, EPSG code, kind
//! and units, and the parameters of the commonest projections without a code. Keys that point
//! outside their record are ignored.

use super::{Crs, Kind, Unit};

/// The contents of the three records.
#[derive(Clone, Debug, Default)]
pub struct Records {
    pub keys: Vec<u8>,
    pub numbers: Vec<u8>,
    pub texts: Vec<u8>,
}

const MODEL: u16 = 1024;
const CITATION: u16 = 1026;
const GEOGRAPHIC: u16 = 2048;
const GEOGRAPHIC_CITATION: u16 = 2049;
const ANGULAR_UNIT: u16 = 2054;
const PROJECTED: u16 = 3072;
const PROJECTED_CITATION: u16 = 3073;
const PROJECTION: u16 = 3075;
const LINEAR_UNIT: u16 = 3076;
const LINEAR_UNIT_METRES: u16 = 3077;
const VERTICAL: u16 = 4096;
const VERTICAL_UNIT: u16 = 4099;

/// A value that is defined by other keys.
const OF_THE_USER: u16 = 32767;

impl Records {
    pub fn system(&self) -> Option<Crs> {
        let model = self.short(MODEL);
        let [projected, geographic] =
            [PROJECTED, GEOGRAPHIC].map(|key| self.short(key).filter(|code| *code != 0));
        let kind = match model {
            Some(1) => Kind::Projected,
            Some(2) => Kind::Geographic,
            Some(3) => Kind::Geocentric,
            _ if projected.is_some() => Kind::Projected,
            _ if geographic.is_some() => Kind::Geographic,
            _ => return None,
        };
        let code = if kind == Kind::Projected { projected } else { geographic };
        let epsg = code.filter(|code| *code != OF_THE_USER).map(u32::from);
        let unit = self.linear_unit();
        let degrees = (kind == Kind::Geographic).then(|| self.degrees());
        let height = self.short(VERTICAL_UNIT).and_then(|code| Unit::numbered(code.into()));
        let (unit, height) = if degrees.is_some() {
            (Some(Unit::default()), height.or(unit))
        } else {
            (unit, height)
        };
        let height_unit = height.filter(|height| unit.as_ref().is_some_and(|unit| unit != height));
        let citations = if kind == Kind::Projected {
            [PROJECTED_CITATION, CITATION]
        } else {
            [CITATION, GEOGRAPHIC_CITATION]
        };
        let name = citations
            .into_iter()
            .find_map(|key| self.text(key))
            .or_else(|| self.text(GEOGRAPHIC_CITATION));
        let height_epsg =
            self.short(VERTICAL).filter(|code| ![0, OF_THE_USER].contains(code)).map(u32::from);
        let system =
            Crs { name, epsg, kind, unit, height_unit, height_epsg, degrees, ..Crs::default() };
        let proj = system
            .unit
            .as_ref()
            .filter(|_| kind == Kind::Projected)
            .and_then(|unit| self.projection(unit));
        Some(system.completed(proj))
    }

    fn linear_unit(&self) -> Option<Unit> {
        match self.short(LINEAR_UNIT)? {
            OF_THE_USER => self
                .number(LINEAR_UNIT_METRES)
                .filter(|metres| *metres > 0.0)
                .map(|metres| Unit::of(metres, "unit")),
            code => Unit::numbered(code.into()),
        }
    }

    /// Returns the degrees per unit of angles.
    fn degrees(&self) -> f64 {
        match self.short(ANGULAR_UNIT) {
            Some(9101) => 1f64.to_degrees(),
            Some(9105 | 9106) => 0.9,
            _ => 1.0,
        }
    }

    /// Returns Transverse Mercator, Lambert's conic with two parallels, or Albers', as a PROJ
    /// definition.
    fn projection(&self, unit: &Unit) -> Option<String> {
        let number = |keys: &[u16]| keys.iter().find_map(|&key| self.number(key));
        // Natural origin, false origin, centre.
        let latitude = number(&[3081, 3085, 3089])?;
        let longitude = number(&[3080, 3084, 3088])?;
        let east = number(&[3082, 3086, 3090]).unwrap_or(0.0) * unit.metres;
        let north = number(&[3083, 3087, 3091]).unwrap_or(0.0) * unit.metres;
        let parallels =
            || Some(format!("+lat_1={} +lat_2={}", self.number(3078)?, self.number(3079)?));
        let own = match self.short(PROJECTION)? {
            1 => format!("+proj=tmerc +k={}", number(&[3092]).unwrap_or(1.0)),
            8 => format!("+proj=lcc {}", parallels()?),
            11 => format!("+proj=aea {}", parallels()?),
            _ => return None,
        };
        let to_metre = unit.metres;
        Some(format!(
            "{own} +lat_0={latitude} +lon_0={longitude} +x_0={east} +y_0={north} +ellps=GRS80 +to_meter={to_metre} +no_defs"
        ))
    }

    /// Returns a key's four numbers: key, record of its value, length, and offset or value.
    fn entry(&self, key: u16) -> Option<[u16; 4]> {
        let word = |bytes: &[u8]| u16::from_le_bytes([bytes[0], bytes[1]]);
        // The first entry is the header with their count.
        self.keys
            .chunks_exact(8)
            .skip(1)
            .map(|entry| [0, 2, 4, 6].map(|at| word(&entry[at..])))
            .find(|entry| entry[0] == key)
    }

    fn short(&self, key: u16) -> Option<u16> {
        self.entry(key).filter(|entry| entry[1] == 0).map(|entry| entry[3])
    }

    fn number(&self, key: u16) -> Option<f64> {
        let [_, record, _, at] = self.entry(key)?;
        let bytes =
            (record == 34736).then(|| self.numbers.get(8 * at as usize..8 * at as usize + 8))??;
        Some(f64::from_le_bytes(bytes.try_into().ok()?)).filter(|number| number.is_finite())
    }

    fn text(&self, key: u16) -> Option<String> {
        let [_, record, length, at] = self.entry(key)?;
        let bytes = (record == 34737)
            .then(|| self.texts.get(at as usize..at as usize + length as usize))??;
        let text = String::from_utf8_lossy(bytes)
            .trim_matches(|c: char| c == '|' || c == '\0' || c.is_whitespace())
            .to_string();
        (!text.is_empty() && text != "unknown").then_some(text)
    }
}
