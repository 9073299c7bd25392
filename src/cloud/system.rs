//! What the coordinates of a file mean: their system, its units, and where on the Earth a place is.
//!
//! In: what files say of it, as WKT of either version (`wkt`) or as GeoTIFF keys (`geotiff`). Out: a [`System`]. Files that say nothing have none, and
//! their lengths are taken for metres. Degrees are no lengths: points of such files are drawn on a local [`Plane`].

pub mod geotiff;
pub mod plane;
pub mod wkt;

use super::catch_panic::catch_panic;
use super::digits::{Digits, round};
use super::{Header, Lattice};
use glam::DVec3;
use plane::Plane;
use proj4rs::Proj;
use serde::{Deserialize, Serialize};
use std::fmt;

/// A unit of length.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Unit {
    pub name: String,
    pub metres: f64,
}

const FOOT: f64 = 0.3048;
const SURVEY_FOOT: f64 = 1200.0 / 3937.0;

impl Default for Unit {
    fn default() -> Unit {
        Unit::of(1.0, "metre")
    }
}

impl Unit {
    /// The unit of so many metres, by the name that it has everywhere, or by its own.
    pub fn of(metres: f64, name: &str) -> Unit {
        let is = |other: f64| (metres / other - 1.0).abs() < 1e-9;
        // The two feet differ by two parts in a million, and files round them.
        let known = [(1.0, "metre"), (FOOT, "foot"), (SURVEY_FOOT, "US survey foot")];
        let known = known.into_iter().find(|(other, _)| {
            is(*other) || (*other == SURVEY_FOOT && (metres / other - 1.0).abs() < 2e-7)
        });
        let (metres, name) = known.unwrap_or((metres, name));
        Unit { name: name.into(), metres }
    }

    /// By its number in the EPSG register.
    pub fn numbered(code: u32) -> Option<Unit> {
        match code {
            9001 => Some(Unit::default()),
            9002 => Some(Unit::of(FOOT, "foot")),
            9003 => Some(Unit::of(SURVEY_FOOT, "US survey foot")),
            9005 => Some(Unit::of(0.304_797_265_4, "Clarke's foot")),
            9036 => Some(Unit::of(1000.0, "kilometre")),
            9080 => Some(Unit::of(0.304_799_510_248_146_94, "Indian foot")),
            _ => None,
        }
    }

    pub fn symbol(&self) -> &str {
        match self.name.as_str() {
            "metre" => "m",
            "foot" => "ft",
            "US survey foot" => "ftUS",
            name => name,
        }
    }

    pub fn is_metre(&self) -> bool {
        self.metres == 1.0
    }

    /// A length with so many decimals, metres beside where it has another unit.
    pub fn length(&self, length: f64, decimals: usize) -> String {
        let own = format!("{length:.decimals$} {}", self.symbol());
        if self.is_metre() { own } else { format!("{own} ({:.decimals$} m)", length * self.metres) }
    }

    /// The same of an area.
    pub fn area(&self, area: f64, decimals: usize) -> String {
        let own = format!("{area:.decimals$} {}²", self.symbol());
        if self.is_metre() {
            own
        } else {
            format!("{own} ({:.decimals$} m²)", area * self.metres * self.metres)
        }
    }
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Kind {
    Projected,
    /// Longitude and latitude.
    Geographic,
    /// From the middle of the Earth.
    Geocentric,
    #[default]
    Local,
}

/// The coordinate system of a file.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct System {
    pub name: Option<String>,
    pub epsg: Option<u32>,
    pub kind: Kind,
    /// Of lengths; of a geographic system that of the plane that its points are drawn on. None where the file names none.
    pub unit: Option<Unit>,
    /// Of heights, where they have another one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub height_unit: Option<Unit>,
    /// Of a geographic system, the degrees that its unit has.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub degrees: Option<f64>,
    /// As PROJ writes it, where its projection is known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub proj: Option<String>,
    /// Where points were brought whose coordinates are angles.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub plane: Option<Plane>,
}

/// What a reader says of columns of angles, where nothing else names the system: a fact of the header.
pub const DEGREES: (&str, &str) = ("coordinates", "longitude and latitude in degrees");

/// Facts that may say it.
const COORDINATES: [&str; 4] = ["coordinates", "coordinate system", "columns", "units"];

impl System {
    /// Longitude and latitude on the ellipsoid of GPS.
    pub fn degrees() -> System {
        System {
            name: Some("longitude and latitude".into()),
            kind: Kind::Geographic,
            unit: Some(Unit::default()),
            degrees: Some(1.0),
            ..System::default()
        }
    }

    /// What a header says, in a field of its own or as a fact.
    pub fn of(header: &Header) -> Option<System> {
        let says = |what: &str, text: &str| {
            let text = text.to_lowercase();
            let has = |words: [&str; 2]| {
                text.split(|c: char| !c.is_alphabetic()).any(|word| words.contains(&word))
            };
            COORDINATES.contains(&what) && has(["longitude", "lon"]) && has(["latitude", "lat"])
        };
        let said =
            || header.facts.iter().any(|(what, text)| says(what, text)).then(System::degrees);
        header.system.clone().or_else(said)
    }

    /// With what its EPSG code says, where the file says no more, or the same.
    fn completed(mut self, of_file: Option<String>) -> System {
        let known = self
            .epsg
            .and_then(|code| crs_definitions::from_code(code.try_into().ok()?))
            .map(|def| def.proj4.to_string());
        let known = known.filter(|proj| match (&self.unit, unit_of(proj)) {
            (Some(own), Some(its)) if self.kind == Kind::Projected => {
                (own.metres / its.metres - 1.0).abs() < 1e-9
            }
            _ => true,
        });
        if self.unit.is_none() && self.kind == Kind::Projected {
            self.unit = known.as_deref().and_then(unit_of);
        }
        self.proj = known.or(of_file);
        self
    }

    /// As people say it: its name, and its number in the EPSG register.
    pub fn title(&self) -> String {
        match (&self.name, self.epsg) {
            (Some(name), Some(code)) => format!("{name} (EPSG:{code})"),
            (Some(name), None) => name.clone(),
            (None, Some(code)) => format!("EPSG:{code}"),
            (None, None) => "unnamed".into(),
        }
    }

    /// The unit that lengths are in; metres where nothing says it.
    pub fn unit(&self) -> Unit {
        self.unit.clone().unwrap_or_default()
    }

    /// Longitude and latitude of a place in the world of its cloud, degrees, where that can be known.
    pub fn lonlat(&self, place: DVec3) -> Option<[f64; 2]> {
        if let Some(plane) = &self.plane {
            return Some(plane.lonlat(place));
        }
        let proj = self
            .proj
            .as_ref()
            .filter(|_| matches!(self.kind, Kind::Projected | Kind::Geocentric))?;
        let convert = || -> Option<[f64; 2]> {
            let from = Proj::from_proj_string(proj).ok()?;
            let to = Proj::from_proj_string("+proj=longlat +datum=WGS84 +no_defs").ok()?;
            let mut point =
                (place.x, place.y, if self.kind == Kind::Geocentric { place.z } else { 0.0 });
            proj4rs::transform::transform(&from, &to, &mut point).ok()?;
            Some([point.0.to_degrees(), point.1.to_degrees()])
        };
        let [lon, lat] = catch_panic(convert).ok().flatten()?;
        (lon.abs() <= 360.0 && lat.abs() <= 90.0).then_some([lon, lat])
    }
}

/// The unit of a definition that PROJ can read.
fn unit_of(proj: &str) -> Option<Unit> {
    let value = |key: &str| proj.split_whitespace().find_map(|word| word.strip_prefix(key));
    if let Some(metres) = value("+to_meter=").and_then(|text| text.parse().ok()) {
        return Some(Unit::of(metres, "unit"));
    }
    match value("+units=")? {
        "m" => Some(Unit::default()),
        "ft" => Unit::numbered(9002),
        "us-ft" => Unit::numbered(9003),
        "km" => Unit::numbered(9036),
        _ => None,
    }
}

impl fmt::Display for System {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let kind = match self.kind {
            Kind::Projected => "projected",
            Kind::Geographic => "geographic",
            Kind::Geocentric => "geocentric",
            Kind::Local => "local",
        };
        write!(f, "{}, {kind}", self.title())
    }
}

/// Where some points of a file are, in its own coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Between as many on both sides, axis by axis: strays do not move it.
    pub middle: DVec3,
    /// Between these lie nearly all.
    pub lo: DVec3,
    pub hi: DVec3,
}

impl Sample {
    pub fn of(places: Vec<DVec3>) -> Option<Sample> {
        let sorted = [0, 1, 2].map(|axis| {
            let mut values: Vec<f64> = places.iter().map(|place| place[axis]).collect();
            values.sort_by(f64::total_cmp);
            values
        });
        if places.is_empty() {
            return None;
        }
        let corner = |pick: &dyn Fn(&[f64]) -> Option<f64>| {
            Some(DVec3::new(pick(&sorted[0])?, pick(&sorted[1])?, pick(&sorted[2])?))
        };
        Some(Sample {
            middle: corner(&|values| values.get(values.len() / 2).copied())?,
            lo: corner(&|values| values.get(values.len() / 50).copied())?,
            hi: corner(&|values| values.get(values.len() - 1 - values.len() / 50).copied())?,
        })
    }
}

/// What the coordinates of a cloud mean, and how many of their digits count.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Reference {
    /// None where no file names one, or several name different ones.
    pub system: Option<System>,
    pub digits: Digits,
}

impl Reference {
    pub fn of<'a>(parts: impl Iterator<Item = (&'a Header, Lattice)> + Clone) -> Reference {
        let mut systems = parts.clone().map(|(header, _)| &header.system);
        let first = systems.next().cloned().flatten();
        let system = first.filter(|first| systems.all(|system| system.as_ref() == Some(first)));
        Reference { system, digits: Digits::of(parts.map(|(_, lattice)| lattice)) }
    }

    /// Of lengths: metres where nothing says it.
    pub fn unit(&self) -> Unit {
        self.system.as_ref().map(System::unit).unwrap_or_default()
    }

    pub fn height_unit(&self) -> Unit {
        let own = self.system.as_ref().and_then(|system| system.height_unit.clone());
        own.unwrap_or_else(|| self.unit())
    }

    /// Whether some file says what its unit is.
    pub fn says_unit(&self) -> bool {
        self.system.as_ref().is_some_and(|system| system.unit.is_some())
    }

    /// A place in metres, as far as the units go.
    pub fn metres(&self, place: DVec3) -> DVec3 {
        let horizontal = self.unit().metres;
        place * DVec3::new(horizontal, horizontal, self.height_unit().metres)
    }

    /// Longitude, latitude and height in metres.
    pub fn on_earth(&self, place: DVec3) -> Option<[f64; 3]> {
        let [lon, lat] = self.system.as_ref()?.lonlat(place)?;
        Some([round(lon, 9), round(lat, 9), round(self.metres(place).z, 4)])
    }
}

/// What is to be said of the systems of files that are opened together.
pub fn differences<'a>(headers: impl Iterator<Item = &'a Header>) -> Option<String> {
    let systems: Vec<Option<&System>> = headers.map(|header| header.system.as_ref()).collect();
    let mut units: Vec<Unit> =
        systems.iter().map(|system| system.map(System::unit).unwrap_or_default()).collect();
    units.dedup();
    let is_angular = |system: &Option<&System>| system.is_some_and(|system| system.plane.is_some());
    if units.len() > 1 {
        let names: Vec<&str> = units.iter().map(|unit| unit.name.as_str()).collect();
        return Some(format!(
            "the files use different units ({}); their numbers are used unchanged",
            names.join(", ")
        ));
    }
    let mixed = systems.iter().any(is_angular) && !systems.iter().all(is_angular);
    mixed.then(|| "some files are in degrees and drawn on a local plane, the others are not".into())
}

const NO_DEGREES: &str = "the coordinates are declared as degrees, but are not degrees";

/// What a header was found to have said wrongly when it was [settled](settle).
pub fn lie(header: &Header) -> Option<&'static str> {
    let system = header.system.as_ref()?;
    (system.degrees.is_some() && system.unit.is_none()).then_some(NO_DEGREES)
}

/// Brings a part's lattice to the plane that it is drawn on, where its coordinates are angles, and its header to say so.
/// `shared` is the plane of all files that are opened together.
pub fn settle(
    header: &mut Header,
    lattice: Lattice,
    shared: &mut Option<Plane>,
    name: &str,
    notes: &mut Vec<String>,
) -> Lattice {
    let sample = header.sample.take();
    header.system = System::of(header);
    let Some(system) = &mut header.system else { return lattice };
    let Some(degrees) = system.degrees.filter(|_| system.kind == Kind::Geographic) else {
        if let (Some(unit), Some(height)) = (&system.unit, &system.height_unit) {
            notes.push(format!(
                "{name}: heights are in {}, distances in {}: slanted lengths are wrong",
                height.name, unit.name
            ));
        }
        return lattice;
    };
    let Some(Sample { middle, lo, hi }) = sample else { return lattice };
    let own = shared.or_else(|| Plane::about(middle * degrees));
    let Some(plane) = own.filter(|_| plane::are_degrees(lo * degrees, hi * degrees)) else {
        notes.push(format!("{name}: {NO_DEGREES}; they are used unchanged"));
        system.unit = None;
        return lattice;
    };
    *shared = Some(plane);
    system.plane = Some(plane);
    notes.push(format!("{name}: {plane}"));
    let height = system.height_unit.take().unwrap_or_default();
    if !height.is_metre() {
        notes.push(format!("{name}: heights are in {} and were converted to metres", height.name));
    }
    plane.flatten(lattice, degrees, height.metres)
}
