//! Picked points in, what lies between them out: lengths, heights, angles, areas. Pure, f64.

use glam::DVec3;
use serde_json::{Value, json};

/// Points in the order in which they were picked.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Measure {
    pub points: Vec<DVec3>,
}

impl Measure {
    /// Along all points, metres.
    pub fn length(&self) -> f64 {
        self.points.windows(2).map(|pair| pair[0].distance(pair[1])).sum()
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
        let (u, v) = ((a - b).try_normalize()?, (c - b).try_normalize()?);
        // By both the cross and the dot product: exact for small and for flat angles.
        Some(u.cross(v).length().atan2(u.dot(v)).to_degrees())
    }

    /// Within the points, in the plane that fits them best, square metres; none of fewer than three.
    pub fn area(&self) -> Option<f64> {
        let (&first, rest) = self.points.split_first()?;
        // From the first point on, since coordinates are large and areas small.
        let twice: DVec3 = rest.windows(2).map(|pair| (pair[0] - first).cross(pair[1] - first)).sum();
        (rest.len() > 1).then(|| twice.length() / 2.0)
    }

    fn ends(&self) -> Option<[DVec3; 2]> {
        (self.points.len() > 1).then(|| [self.points[0], self.points[self.points.len() - 1]])
    }

    /// A line a point.
    pub fn csv(&self) -> String {
        let lines = self.points.iter().map(|p| format!("{},{},{}\n", p.x, p.y, p.z));
        std::iter::once("x,y,z\n".to_string()).chain(lines).collect()
    }

    /// The points as a line, and where there are three or more also what they enclose.
    pub fn geojson(&self) -> Value {
        let mut places: Vec<[f64; 3]> = self.points.iter().map(DVec3::to_array).collect();
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

#[cfg(test)]
mod tests {
    use super::*;

    const ORIGIN: DVec3 = DVec3::new(500_000.0, 5_000_000.0, 100.0);

    fn measure(points: &[[f64; 3]]) -> Measure {
        Measure { points: points.iter().map(|&p| ORIGIN + DVec3::from_array(p)).collect() }
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
        assert_eq!(DVec3::from_slice(&read), points.points[0]);
        let json = points.geojson();
        assert_eq!(json["features"][0]["geometry"]["coordinates"][0][0].as_f64().unwrap(), points.points[0].x);
        let ring = json["features"][1]["geometry"]["coordinates"][0].as_array().unwrap();
        assert_eq!((ring.len(), &ring[0]), (4, &ring[3]));
        assert_eq!(Measure::default().geojson()["features"].as_array().unwrap().len(), 1);
    }
}
