//! Coordinate systems: units, projections, and positions on the Earth.
//!
//! A [`Crs`] is parsed from WKT of either version (`wkt`) or GeoTIFF keys (`geotiff`). Files
//! without one use metres. Points in degrees are drawn on a local [`Plane`].

pub mod geotiff;
pub mod plane;
pub mod wkt;

use super::catch_panic::catch_panic;
use super::digits::{Digits, round};
use super::{Header, Lattice};
use glam::{DVec2, DVec3};
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

/// Name of what is counted where no unit is known.
const NO_UNIT: &str = "units";

impl Default for Unit {
    fn default() -> Unit {
        Unit::of(1.0, "metre")
    }
}

impl Unit {
    /// Returns the unit of this many metres, by its common name or `name`.
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

    /// Returns the unit of coordinates that have none, as those of meshes.
    pub fn none() -> Unit {
        Unit { name: NO_UNIT.into(), metres: 1.0 }
    }

    pub fn is_none(&self) -> bool {
        self.name == NO_UNIT
    }

    /// Returns a unit by its EPSG number.
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

    /// Formats a length with this many decimals, and metres if the unit is another one.
    pub fn length(&self, length: f64, decimals: usize) -> String {
        let own = format!("{length:.decimals$} {}", self.symbol());
        if self.is_metre() { own } else { format!("{own} ({:.decimals$} m)", length * self.metres) }
    }

    /// Formats an area likewise.
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
    /// Cartesian from the Earth's centre.
    Geocentric,
    #[default]
    Local,
}

/// The coordinate system of a file.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Crs {
    pub name: Option<String>,
    pub epsg: Option<u32>,
    pub kind: Kind,
    /// Unit of lengths; for a geographic system that of the plane its points are drawn on. `None`
    /// if not stated.
    pub unit: Option<Unit>,
    /// Unit of heights, if different.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub height_unit: Option<Unit>,
    /// EPSG number of the system of heights.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub height_epsg: Option<u32>,
    /// Degrees per unit of a geographic system.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub degrees: Option<f64>,
    /// PROJ definition, if the projection is known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub proj: Option<String>,
    /// The local plane of points in angles.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub plane: Option<Plane>,
}

/// A fact of the header that marks columns of angles without a named system.
pub const DEGREES: (&str, &str) = ("coordinates", "longitude and latitude in degrees");

/// Facts that may name a system.
const COORDINATES: [&str; 4] = ["coordinates", "coordinate system", "columns", "units"];

impl Crs {
    /// Returns longitude and latitude on WGS 84.
    pub fn degrees() -> Crs {
        Crs {
            name: Some("longitude and latitude".into()),
            kind: Kind::Geographic,
            unit: Some(Unit::default()),
            degrees: Some(1.0),
            ..Crs::default()
        }
    }

    /// Returns the system of a header, from its own field or its facts.
    pub fn of(header: &Header) -> Option<Crs> {
        let says = |what: &str, text: &str| {
            let text = text.to_lowercase();
            let has = |words: [&str; 2]| {
                text.split(|c: char| !c.is_alphabetic()).any(|word| words.contains(&word))
            };
            COORDINATES.contains(&what) && has(["longitude", "lon"]) && has(["latitude", "lat"])
        };
        let said = || header.facts.iter().any(|(what, text)| says(what, text)).then(Crs::degrees);
        header.system.clone().or_else(said)
    }

    /// Returns the system that a text names: WKT, an EPSG code or a PROJ definition.
    pub fn named(text: &str) -> Option<Crs> {
        if let Some(known) = well_known(text) {
            return wkt::parse(known);
        }
        let text = text.trim();
        let kind = text.split_whitespace().find_map(|word| word.strip_prefix("+proj="))?;
        let kind = match kind {
            "longlat" | "latlong" => return Some(Crs::degrees()),
            "geocent" => Kind::Geocentric,
            _ => Kind::Projected,
        };
        let unit = Some(unit_of(text).unwrap_or_default());
        Some(Crs { kind, unit, name: Some(text.into()), proj: Some(text.into()), ..Crs::default() })
    }

    /// Returns the well-known text of a header, if that states its system.
    pub fn text_of(header: &Header) -> Option<&str> {
        let is_one = |what: &str, text: &str| what == COORDINATES[1] && wkt::parse(text).is_some();
        let found = header.facts.iter().find(|(what, text)| is_one(what, text));
        found.map(|(_, text)| text.as_str())
    }

    /// Adds what the EPSG code implies, if the file states no more or the same.
    fn completed(mut self, of_file: Option<String>) -> Crs {
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

    /// Returns the name and the EPSG number.
    pub fn title(&self) -> String {
        match (&self.name, self.epsg) {
            (Some(name), Some(code)) => format!("{name} (EPSG:{code})"),
            (Some(name), None) => name.clone(),
            (None, Some(code)) => format!("EPSG:{code}"),
            (None, None) => "unnamed".into(),
        }
    }

    /// Returns the unit of lengths; metres if not stated.
    pub fn unit(&self) -> Unit {
        self.unit.clone().unwrap_or_default()
    }

    /// Returns longitude and latitude of a world position `[degrees]`, if the projection is known.
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

/// Returns the well-known text of a text that is WKT or an EPSG code, as `EPSG:32632`.
pub fn well_known(text: &str) -> Option<&str> {
    let code = text.trim().get(..5).filter(|start| start.eq_ignore_ascii_case("EPSG:"));
    match code {
        Some(_) => Some(crs_definitions::from_code(text.trim()[5..].parse().ok()?)?.wkt),
        None => Some(text).filter(|text| wkt::parse(text).is_some()),
    }
}

/// Returns the unit of a definition that PROJ can read.
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

impl fmt::Display for Crs {
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

/// The approximate location of a file's points, in its own coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Median of each axis; strays do not move it.
    pub middle: DVec3,
    /// Range of nearly all points.
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

/// The coordinate system of a cloud, and its significant digits.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Reference {
    /// `None` if no file has one, or files have different ones.
    pub system: Option<Crs>,
    pub digits: Digits,
    /// The unit of lengths where no file states one.
    pub assumed: Unit,
}

impl Reference {
    pub fn of<'a>(parts: impl Iterator<Item = (&'a Header, Lattice)> + Clone) -> Reference {
        let mut systems = parts.clone().map(|(header, _)| &header.system);
        let first = systems.next().cloned().flatten();
        let system = first.filter(|first| systems.all(|system| system.as_ref() == Some(first)));
        // Meshes are drawn in any unit; formats of scans have metres.
        let is_mesh = |(header, _): (&Header, Lattice)| header.is_mesh();
        let is_unknown = parts.clone().next().is_some() && parts.clone().all(is_mesh);
        let assumed = if is_unknown { Unit::none() } else { Unit::default() };
        Reference { system, digits: Digits::of(parts.map(|(_, lattice)| lattice)), assumed }
    }

    /// Returns the unit of lengths; if not stated metres, or none of meshes.
    pub fn unit(&self) -> Unit {
        self.system.as_ref().map_or_else(|| self.assumed.clone(), Crs::unit)
    }

    pub fn height_unit(&self) -> Unit {
        let own = self.system.as_ref().and_then(|system| system.height_unit.clone());
        own.unwrap_or_else(|| self.unit())
    }

    /// Tests whether some file states its unit.
    pub fn says_unit(&self) -> bool {
        self.system.as_ref().is_some_and(|system| system.unit.is_some())
    }

    /// Converts a position to metres, as far as units are known.
    pub fn metres(&self, place: DVec3) -> DVec3 {
        let horizontal = self.unit().metres;
        place * DVec3::new(horizontal, horizontal, self.height_unit().metres)
    }

    /// Returns the unit of heights in units of lengths.
    pub fn height_scale(&self) -> f64 {
        self.height_unit().metres / self.unit().metres
    }

    /// Returns the plane on which angles of the files are drawn, and degrees per unit of these.
    fn plane(&self) -> Option<(Plane, f64)> {
        let system = self.system.as_ref()?;
        Some((system.plane?, system.degrees?))
    }

    /// Tests whether the coordinates of the files are angles, drawn on a plane.
    pub fn has_angles(&self) -> bool {
        self.plane().is_some()
    }

    /// Says what coordinates are where they are not those of the files, after a comma.
    pub fn said(&self) -> String {
        self.plane().map_or(String::new(), |(plane, _)| format!(", {}", plane.words()))
    }

    /// Converts a place on the map from the coordinates of the files to those that are drawn.
    pub fn drawn(&self, place: DVec2) -> DVec2 {
        let angles = |(plane, degrees): (Plane, f64)| plane.place((degrees * place).to_array());
        self.plane().map_or(place, |own| angles(own).into())
    }

    /// Converts a place that is drawn to the coordinates of the files.
    pub fn in_files(&self, place: DVec2) -> DVec2 {
        let angles =
            |(plane, degrees): (Plane, f64)| DVec2::from(plane.lonlat(place.extend(0.0))) / degrees;
        self.plane().map_or(place, angles)
    }

    /// Writes a place that is drawn in the coordinates of the files.
    pub fn words(&self, place: DVec2) -> String {
        let DVec2 { x, y } = match self.has_angles() {
            true => self.in_files(place).map(|angle| round(angle, 9)),
            false => self.digits.round(place.extend(0.0)).truncate(),
        };
        format!("{x},{y}")
    }

    /// Returns longitude, latitude and height `[m]`.
    pub fn on_earth(&self, place: DVec3) -> Option<[f64; 3]> {
        let [lon, lat] = self.system.as_ref()?.lonlat(place)?;
        Some([round(lon, 9), round(lat, 9), round(self.metres(place).z, 4)])
    }
}

/// Returns notes on differences between systems of files opened together.
pub fn differences<'a>(headers: impl Iterator<Item = &'a Header>) -> Option<String> {
    let systems: Vec<Option<&Crs>> = headers.map(|header| header.system.as_ref()).collect();
    let mut units: Vec<Unit> =
        systems.iter().map(|system| system.map(Crs::unit).unwrap_or_default()).collect();
    units.dedup();
    let is_angular = |system: &Option<&Crs>| system.is_some_and(|system| system.plane.is_some());
    if units.len() > 1 {
        let names: Vec<&str> = units.iter().map(|unit| unit.name.as_str()).collect();
        return Some(format!(
            "the files use different units ({}); their numbers are used unchanged",
            names.join(", ")
        ));
    }
    let mut numbers: Vec<u32> =
        systems.iter().filter_map(|system| system.and_then(|system| system.epsg)).collect();
    numbers.sort_unstable();
    numbers.dedup();
    if numbers.len() > 1 {
        let names: Vec<String> = numbers.iter().map(|number| format!("EPSG:{number}")).collect();
        return Some(format!(
            "the files are in different coordinate systems ({}), so they do not lie where they should; convert them to one",
            names.join(", ")
        ));
    }
    let mixed = systems.iter().any(is_angular) && !systems.iter().all(is_angular);
    mixed.then(|| "some files are in degrees and drawn on a local plane, the others are not".into())
}

const NO_DEGREES: &str = "the coordinates are declared as degrees, but are not degrees";

/// Returns the wrong statement that [`settle`] found in a header.
pub fn lie(header: &Header) -> Option<&'static str> {
    let system = header.system.as_ref()?;
    (system.degrees.is_some() && system.unit.is_none()).then_some(NO_DEGREES)
}

/// Moves a part's lattice to a local plane if its coordinates are angles, and records it in the
/// header. `shared` is the plane of all files opened together.
pub fn settle(
    header: &mut Header,
    lattice: Lattice,
    shared: &mut Option<Plane>,
    name: &str,
    notes: &mut Vec<String>,
) -> Lattice {
    let sample = header.sample.take();
    header.system = Crs::of(header);
    let Some(system) = &mut header.system else { return lattice };
    let Some(degrees) = system.degrees.filter(|_| system.kind == Kind::Geographic) else {
        if let (Some(unit), Some(height)) = (&system.unit, &system.height_unit) {
            notes.push(format!(
                "{name}: heights are in {}, distances in {}: slopes look {:.4} times as steep as they are, and measures are converted",
                height.name,
                unit.name,
                unit.metres / height.metres
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
