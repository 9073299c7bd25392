//! Picked points in, what they are and what lies between them out: lengths, heights, angles, areas. Pure, f64.

use crate::cloud::attribute::STATION_SHIFT;
use crate::resident::Point;
use glam::DVec3;
use serde_json::{Value, json};

/// Points in the order in which they were picked.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Measure {
    pub points: Vec<Point>,
}

/// Class, return number and station of a point; stations are counted from 1 on, as `info` does.
pub fn kind(point: &Point) -> Option<[u32; 3]> {
    point.kind.map(|kind| [kind & 255, kind >> 8 & 15, (kind >> STATION_SHIFT) + 1])
}

impl Measure {
    fn place(&self, number: usize) -> DVec3 {
        self.points[number].position
    }

    /// Along all points, metres.
    pub fn length(&self) -> f64 {
        self.points.windows(2).map(|pair| pair[0].position.distance(pair[1].position)).sum()
    }

    /// From the first to the last, straight, metres.
    pub fn distance(&self) -> f64 {
        self.ends().map_or(0.0, |[first, last]| first.distance(last))
    }

    /// How much higher the last is than the first, metres.
    pub fn height(&self) -> f64 {
        self.ends().map_or(0.0, |[first, last]| last.z - first.z)
    }

    /// Without the height, metres.
    pub fn horizontal(&self) -> f64 {
        self.ends().map_or(0.0, |[first, last]| (last - first).truncate().length())
    }

    /// At the last but one, degrees; none where points coincide.
    pub fn angle(&self) -> Option<f64> {
        let &[.., a, b, c] = &self.points[..] else { return None };
        let to = |other: Point| (other.position - b.position).try_normalize();
        let (u, v) = (to(a)?, to(c)?);
        // By both the cross and the dot product: exact for small and for flat angles.
        Some(u.cross(v).length().atan2(u.dot(v)).to_degrees())
    }

    /// Within the points, in the plane that fits them best, square metres; none of fewer than three.
    pub fn area(&self) -> Option<f64> {
        let (&first, rest) = self.points.split_first()?;
        // From the first point on, since coordinates are large and areas small.
        let from_first = |point: &Point| point.position - first.position;
        let twice: DVec3 = rest.windows(2).map(|pair| from_first(&pair[0]).cross(from_first(&pair[1]))).sum();
        (rest.len() > 1).then(|| twice.length() / 2.0)
    }

    fn ends(&self) -> Option<[DVec3; 2]> {
        (self.points.len() > 1).then(|| [self.place(0), self.place(self.points.len() - 1)])
    }

    /// A line a point; what is not known is left empty.
    pub fn csv(&self) -> String {
        let line = |point: &Point| {
            let DVec3 { x, y, z } = point.position;
            let kind = kind(point).map_or(",,".into(), |kind| kind.map(|number| number.to_string()).join(","));
            format!("{x},{y},{z},{kind}\n")
        };
        std::iter::once("x,y,z,class,return,station\n".to_string()).chain(self.points.iter().map(line)).collect()
    }

    /// The points as a line, and where there are three or more also what they enclose.
    pub fn geojson(&self) -> Value {
        let mut places: Vec<[f64; 3]> = self.points.iter().map(|point| point.position.to_array()).collect();
        let feature = |geometry: Value, properties: Value| json!({ "type": "Feature", "geometry": geometry, "properties": properties });
        let line = match &places[..] {
            [one] => json!({ "type": "Point", "coordinates": one }),
            _ => json!({ "type": "LineString", "coordinates": places }),
        };
        let facts =
            json!({ "length_m": self.length(), "distance_m": self.distance(), "height_m": self.height(), "angle_deg": self.angle() });
        let mut features = vec![feature(line, facts)];
        if let Some(area) = self.area() {
            // A ring ends where it began.
            places.push(places[0]);
            features.push(feature(json!({ "type": "Polygon", "coordinates": [places] }), json!({ "area_m2": area })));
        }
        json!({ "type": "FeatureCollection", "features": features })
    }
}

/// The last point in every digit, and what lies between all: two lines for a terminal, one where there is one point.
impl std::fmt::Display for Measure {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Some(last) = self.points.last() else { return Ok(()) };
        let DVec3 { x, y, z } = last.position;
        write!(f, "point {}: {x} {y} {z}", self.points.len())?;
        if let Some([class, number, station]) = kind(last) {
            write!(f, " class {class} return {number} station {station}")?;
        }
        if !last.exact {
            write!(f, " (about: the rest of its digits is not loaded)")?;
        }
        if self.points.len() > 1 {
            write!(f, "\ndistance {:.4} m, height {:.4} m, horizontal {:.4} m", self.distance(), self.height(), self.horizontal())?;
        }
        if let Some(angle) = self.angle() {
            write!(f, ", length {:.4} m, angle {angle:.3} degrees", self.length())?;
        }
        self.area().map_or(Ok(()), |area| write!(f, ", area {area:.4} m2"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ORIGIN: DVec3 = DVec3::new(500_000.0, 5_000_000.0, 100.0);

    fn measure(points: &[[f64; 3]]) -> Measure {
        let point = |&p: &[f64; 3]| Point { position: ORIGIN + DVec3::from_array(p), exact: true, kind: Some(6 | 2 << 8 | 1 << 16) };
        Measure { points: points.iter().map(point).collect() }
    }

    fn is(value: f64, wanted: f64) {
        assert!((value - wanted).abs() < 1e-8, "{value} is not {wanted}");
    }

    #[test]
    fn lengths_heights_angles_and_areas_are_those_of_a_slanted_rectangle() {
        let corners = measure(&[[0.0, 0.0, 0.0], [3.0, 0.0, 4.0], [3.0, 2.0, 4.0], [0.0, 2.0, 0.0]]);
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
    fn files_hold_every_digit() {
        let points = measure(&[[1.0 / 3.0, 0.1, 0.2], [7.0, 8.0, 9.0], [0.0, 1.0, 0.0]]);
        let read: Vec<f64> = points.csv().lines().nth(1).unwrap().split(',').map(|number| number.parse().unwrap()).collect();
        assert_eq!((DVec3::from_slice(&read), &read[3..]), (points.place(0), &[6.0, 2.0, 2.0][..]));
        assert!(points.to_string().contains("class 6 return 2 station 2\ndistance"), "{points}");
        let json = points.geojson();
        assert_eq!(json["features"][0]["geometry"]["coordinates"][0][0].as_f64().unwrap(), points.place(0).x);
        let ring = json["features"][1]["geometry"]["coordinates"][0].as_array().unwrap();
        assert_eq!((ring.len(), &ring[0]), (4, &ring[3]));
        assert_eq!(Measure::default().geojson()["features"].as_array().unwrap().len(), 1);
    }
}
