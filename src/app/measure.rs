//! Measures of picked points: lengths, heights, angles and areas, and their files. Pure, f64.

use crate::cloud::attribute::STATION_SHIFT;
use crate::cloud::crs::Reference;
use crate::cloud::digits::{number, round};
use crate::cloud::point_lookup::{Extras, Record, hex};
use crate::resident::Point;
use glam::DVec3;
use serde_json::{Value, json};

/// Picked points, in order.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Measure {
    pub points: Vec<Picked>,
    /// Coordinate system and units.
    pub reference: Reference,
}

/// A picked point, and its record in its file.
#[derive(Clone, Debug, PartialEq)]
pub struct Picked {
    pub point: Point,
    pub record: Looked,
}

/// State of looking a point up in its file.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Looked {
    #[default]
    Underway,
    Found(Box<Record>),
    /// The point is a sample of an index and stands for several points.
    Nowhere,
}

impl Picked {
    pub fn new(point: Point) -> Picked {
        Picked { point, record: Looked::default() }
    }

    pub fn record(&self) -> Option<&Record> {
        if let Looked::Found(record) = &self.record { Some(record) } else { None }
    }
}

/// Returns class, return number and station of a point; stations are counted from 1, as by `info`.
pub fn kind(point: &Point) -> Option<[u32; 3]> {
    point.kind.map(|kind| [kind & 255, kind >> 8 & 15, (kind >> STATION_SHIFT) + 1])
}

impl Measure {
    fn place(&self, number: usize) -> DVec3 {
        self.points[number].point.position
    }

    /// Returns the positions of all points (world).
    pub fn places(&self) -> Vec<DVec3> {
        self.points.iter().map(|picked| picked.point.position).collect()
    }

    /// Returns the positions with heights in the unit of lengths, too.
    fn scaled_places(&self) -> Vec<DVec3> {
        let scale = DVec3::new(1.0, 1.0, self.reference.height_scale());
        self.points.iter().map(|picked| scale * picked.point.position).collect()
    }

    /// Stores the record of the points at a place; returns their numbers, counted from 1.
    pub fn found(&mut self, place: DVec3, record: &Option<Record>) -> Vec<usize> {
        let looked =
            record.clone().map_or(Looked::Nowhere, |record| Looked::Found(Box::new(record)));
        let waiting =
            |picked: &Picked| picked.point.position == place && picked.record == Looked::Underway;
        let found: Vec<usize> =
            (0..self.points.len()).filter(|&number| waiting(&self.points[number])).collect();
        found.iter().for_each(|&number| self.points[number].record = looked.clone());
        found.into_iter().map(|number| number + 1).collect()
    }

    /// Returns the length of the line through all points, in the unit of lengths.
    pub fn length(&self) -> f64 {
        self.scaled_places().windows(2).map(|pair| pair[0].distance(pair[1])).sum()
    }

    /// Returns the straight distance from the first to the last point, in the unit of lengths.
    pub fn distance(&self) -> f64 {
        let places = self.scaled_places();
        if let [first, .., last] = places[..] { first.distance(last) } else { 0.0 }
    }

    /// Returns the height of the last point above the first, in the unit of heights.
    pub fn height(&self) -> f64 {
        self.ends().map_or(0.0, |[first, last]| last.z - first.z)
    }

    /// Returns the horizontal distance from the first to the last point, in the unit of lengths.
    pub fn horizontal(&self) -> f64 {
        self.ends().map_or(0.0, |[first, last]| (last - first).truncate().length())
    }

    /// Returns the angle at the last point but one `[degrees]`; None if points coincide.
    pub fn angle(&self) -> Option<f64> {
        let &[.., a, b, c] = &self.scaled_places()[..] else { return None };
        let to = |other: DVec3| (other - b).try_normalize();
        let (u, v) = (to(a)?, to(c)?);
        // Cross and dot product together are exact for small and for flat angles.
        Some(u.cross(v).length().atan2(u.dot(v)).to_degrees())
    }

    /// Returns the area of the polygon in the plane that fits it best, in squares of the unit of
    /// lengths; None for fewer than three points.
    pub fn area(&self) -> Option<f64> {
        let places = self.scaled_places();
        let (&first, rest) = places.split_first()?;
        // Relative to the first point, since coordinates are large and areas small.
        let from_first = |place: &DVec3| *place - first;
        let twice: DVec3 =
            rest.windows(2).map(|pair| from_first(&pair[0]).cross(from_first(&pair[1]))).sum();
        (rest.len() > 1).then(|| twice.length() / 2.0)
    }

    fn ends(&self) -> Option<[DVec3; 2]> {
        (self.points.len() > 1).then(|| [self.place(0), self.place(self.points.len() - 1)])
    }

    /// Returns a CSV table with a line per point; unknown fields are empty.
    pub fn csv(&self) -> String {
        let line = |picked: &Picked| {
            let place = self.reference.digits.round(picked.point.position);
            let DVec3 { x, y, z } = place;
            let kind = kind(&picked.point)
                .map_or(",,".into(), |kind| kind.map(|number| number.to_string()).join(","));
            let record = picked.record().cloned().unwrap_or_default();
            fn word(number: Option<impl ToString>) -> String {
                number.map_or(String::new(), |number| number.to_string())
            }
            let [r, g, b] = [0, 1, 2].map(|channel| word(record.rgb.map(|rgb| rgb[channel])));
            let (returns, source) = (word(record.returns), word(record.source));
            let (intensity, time) = (word(record.intensity), word(record.gps_time.map(number)));
            let (point, file) = (
                word(picked.record().map(|record| record.point)),
                record.file.replace('"', "\"\""),
            );
            let file = if file.contains([',', '"']) { format!("\"{file}\"") } else { file };
            let Extras { near_infrared, scan_angle_deg, user_data, flags, extra_bytes } =
                record.extras;
            let (infrared, angle, data) =
                (word(near_infrared), word(scan_angle_deg), word(user_data));
            let (flags, extra) = (flags.join(" and "), hex(&extra_bytes));
            format!(
                "{x},{y},{z},{kind},{returns},{source},{intensity},{r},{g},{b},{time},{point},{file},{infrared},{angle},{data},{flags},{extra},{}\n",
                self.unit_columns(place)
            )
        };
        let head = "x,y,z,class,return,station,returns,source,intensity,red,green,blue,gps_time,point,file,near_infrared,scan_angle,user_data,flags,extra_bytes,unit,x_m,y_m,z_m\n";
        std::iter::once(head.to_string()).chain(self.points.iter().map(line)).collect()
    }

    /// Returns the unit columns of a place: its unit, and its coordinates in metres if that is
    /// another unit; empty if no file names a unit.
    fn unit_columns(&self, place: DVec3) -> String {
        let unit = self.reference.unit();
        if !self.reference.says_unit() {
            return ",,,".into();
        }
        if unit.is_metre() && self.reference.height_unit().is_metre() {
            return "m,,,".into();
        }
        let [x, y, z] = self.reference.metres(place).to_array().map(|v| round(v, 4));
        format!("{},{x},{y},{z}", unit.symbol())
    }

    /// Returns GeoJSON: the points as a line, the polygon of three or more, and each point with its
    /// record. Coordinates are longitude and latitude if those are known, else the files' own, with
    /// their system and a note.
    pub fn geojson(&self) -> Value {
        let reference = &self.reference;
        let on_earth: Option<Vec<[f64; 3]>> =
            self.places().into_iter().map(|place| reference.on_earth(place)).collect();
        let is_on_earth = on_earth.is_some();
        let own = || {
            self.places()
                .into_iter()
                .map(|place| reference.digits.round(place).to_array())
                .collect()
        };
        let mut places: Vec<[f64; 3]> = on_earth.unwrap_or_else(own);
        let each = places.clone();
        let feature = |geometry: Value, properties: Value| json!({ "type": "Feature", "geometry": geometry, "properties": properties });
        let line = match &places[..] {
            [one] => json!({ "type": "Point", "coordinates": one }),
            _ => json!({ "type": "LineString", "coordinates": places }),
        };
        let (unit, height_unit) = (reference.unit(), reference.height_unit());
        let [length, distance, height] = [self.length(), self.distance(), self.height()];
        let (to_metres, up) = (unit.metres, height_unit.metres);
        let mut facts = json!({ "angle_deg": self.angle() });
        if !unit.is_none() {
            let metres = [("length_m", length), ("distance_m", distance)];
            metres.into_iter().for_each(|(key, value)| facts[key] = json!(value * to_metres));
            facts["height_m"] = json!(height * up);
        }
        if unit.is_none() || !unit.is_metre() || !height_unit.is_metre() {
            let own = [
                ("length", json!(length)),
                ("distance", json!(distance)),
                ("height", json!(height)),
                ("unit", json!(unit.symbol())),
                ("height_unit", json!(height_unit.symbol())),
            ];
            own.into_iter().for_each(|(key, value)| facts[key] = value);
        }
        let mut features = vec![feature(line, facts)];
        if let Some(area) = self.area() {
            // A ring ends at its first point.
            places.push(places[0]);
            features.push(feature(
                json!({ "type": "Polygon", "coordinates": [places] }),
                match unit.is_none() {
                    true => json!({ "area": area }),
                    false => json!({ "area_m2": area * to_metres * to_metres }),
                },
            ));
        }
        features.extend(self.points.iter().zip(each).map(|(picked, coordinates)| {
            let position = reference.digits.round(picked.point.position).to_array();
            let kind = kind(&picked.point).map(|[class, number, station]| json!({ "class": class, "return": number, "station": station }));
            let properties = json!({ "exact": picked.point.exact, "kind": kind, "position": position, "record": picked.record() });
            feature(json!({ "type": "Point", "coordinates": coordinates }), properties)
        }));
        let mut collection = json!({ "type": "FeatureCollection", "features": features });
        collection["coordinate_system"] = json!(reference.system);
        if !is_on_earth {
            let system = reference.system.as_ref();
            let named = system.map_or("that no file names".into(), |system| system.to_string());
            let unit =
                if reference.says_unit() { format!(", in {}", unit.name) } else { String::new() };
            collection["note"] = json!(format!(
                "coordinates are not longitude and latitude but those of the system of the files: {named}{unit}"
            ));
            if let Some(code) = system.and_then(|system| system.epsg) {
                let name = format!("urn:ogc:def:crs:EPSG::{code}");
                collection["crs"] = json!({ "type": "name", "properties": { "name": name } });
            }
        }
        collection
    }
}

/// Formats the last point with all digits of its lattice and, for several points, the measures
/// between them on a second line.
impl std::fmt::Display for Measure {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Some(last) = self.points.last() else { return Ok(()) };
        let unit = self.reference.unit();
        let last = &last.point;
        let DVec3 { x, y, z } = self.reference.digits.round(last.position);
        write!(f, "point {}: {x} {y} {z}", self.points.len())?;
        if let Some([class, number, station]) = kind(last) {
            write!(f, " class {class} return {number} station {station}")?;
        }
        if !last.exact {
            write!(f, " (approximate: not all of its digits are loaded)")?;
        }
        if self.points.len() > 1 {
            let [distance, horizontal] =
                [self.distance(), self.horizontal()].map(|length| unit.length(length, 4));
            let height = self.reference.height_unit().length(self.height(), 4);
            write!(f, "\ndistance {distance}, height {height}, horizontal {horizontal}")?;
        }
        if let Some(angle) = self.angle() {
            write!(f, ", length {}, angle {angle:.3} degrees", unit.length(self.length(), 4))?;
        }
        self.area().map_or(Ok(()), |area| write!(f, ", area {}", unit.area(area, 4)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cloud::crs::{Crs, Unit};

    const ORIGIN: DVec3 = DVec3::new(500_000.0, 5_000_000.0, 100.0);

    fn measure(points: &[[f64; 3]]) -> Measure {
        let point = |&p: &[f64; 3]| Point {
            position: ORIGIN + DVec3::from_array(p),
            exact: true,
            color: [0; 3],
            value: None,
            kind: Some(6 | 2 << 8 | 1 << 16),
        };
        Measure {
            points: points.iter().map(point).map(Picked::new).collect(),
            ..Measure::default()
        }
    }

    fn is(value: f64, wanted: f64) {
        assert!((value - wanted).abs() < 1e-8, "{value} is not {wanted}");
    }

    #[test]
    fn measures_of_a_slanted_rectangle() {
        let corners =
            measure(&[[0.0, 0.0, 0.0], [3.0, 0.0, 4.0], [3.0, 2.0, 4.0], [0.0, 2.0, 0.0]]);
        is(corners.length(), 12.0);
        is(corners.distance(), 2.0);
        is(corners.height(), 0.0);
        is(corners.angle().unwrap(), 90.0);
        is(corners.area().unwrap(), 10.0);
        let edge = measure(&[[0.0, 0.0, 0.0], [3.0, 0.0, 4.0]]);
        is(edge.distance(), 5.0);
        is(edge.height(), 4.0);
        is(edge.horizontal(), 3.0);
        assert_eq!((edge.angle(), edge.area()), (None, None));
        is(measure(&[[1.0, 0.0, 0.0], [0.0, 0.0, 0.0], [-1.0, 0.0, 0.0]]).angle().unwrap(), 180.0);
        assert_eq!(measure(&[[1.0; 3], [1.0; 3], [2.0; 3]]).angle(), None);
    }

    #[test]
    fn heights_in_another_unit_are_converted() {
        // 3 ft across and 1.2192 m = 4 ft up.
        let mut slope = measure(&[[0.0; 3], [3.0, 0.0, 1.2192], [3.0, 2.0, 1.2192]]);
        slope.reference.system = Some(Crs {
            unit: Some(Unit::of(0.3048, "foot")),
            height_unit: Some(Unit::default()),
            ..Crs::default()
        });
        is(slope.length(), 7.0);
        is(slope.distance(), 29f64.sqrt());
        is(slope.height(), 1.2192);
        is(slope.horizontal(), 13f64.sqrt());
        is(slope.angle().unwrap(), 90.0);
        is(slope.area().unwrap(), 5.0);
        let facts = &slope.geojson()["features"][0]["properties"];
        is(facts["length_m"].as_f64().unwrap(), 7.0 * 0.3048);
        is(facts["height_m"].as_f64().unwrap(), 1.2192);
        assert_eq!((&facts["unit"], &facts["height_unit"]), (&json!("ft"), &json!("m")));
        slope.points.pop();
        is(slope.distance(), 5.0);
    }

    #[test]
    fn exports_hold_every_digit() {
        let points = measure(&[[1.0 / 3.0, 0.1, 0.2], [7.0, 8.0, 9.0], [0.0, 1.0, 0.0]]);
        let mut points = points;
        let record = Record {
            file: "a, b.las".into(),
            point: 41,
            rgb: Some([1, 2, 3]),
            gps_time: Some(0.1 + 0.2),
            ..Record::default()
        };
        assert_eq!(points.found(points.place(0), &Some(record)), [1]);
        assert_eq!(
            (points.found(points.place(0), &None), points.found(points.place(1), &None)),
            (vec![], vec![2])
        );
        let csv = points.csv();
        let row = csv.lines().nth(1).unwrap();
        let read: Vec<f64> = row.split(',').take(6).map(|number| number.parse().unwrap()).collect();
        assert_eq!((DVec3::from_slice(&read), &read[3..]), (points.place(0), &[6.0, 2.0, 2.0][..]));
        assert!(row.ends_with(",,,,1,2,3,0.30000000000000004,41,\"a, b.las\",,,,,,,,,"), "{row}");
        assert!(points.to_string().contains("class 6 return 2 station 2\ndistance"), "{points}");
        let json = points.geojson();
        assert_eq!(
            json["features"][0]["geometry"]["coordinates"][0][0].as_f64().unwrap(),
            points.place(0).x
        );
        let ring = json["features"][1]["geometry"]["coordinates"][0].as_array().unwrap();
        assert_eq!((ring.len(), &ring[0]), (4, &ring[3]));
        assert_eq!(json["features"][2]["properties"]["record"]["point"], 41);
        assert_eq!(Measure::default().geojson()["features"].as_array().unwrap().len(), 1);
    }
}
