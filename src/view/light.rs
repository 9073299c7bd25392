//! The light: at the camera, at infinity, or at a place; world, f64.

use glam::DVec3;
use serde::Serialize;

/// The one light, white; used by shading and shadows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Light {
    /// At the camera's eye; along the view for an orthographic camera.
    #[default]
    Headlight,
    /// At infinity: the direction in which it travels, world, any length but 0.
    Direction(DVec3),
    /// At a place, world `[m]`.
    Position(DVec3),
}

impl Light {
    /// Tests whether both are the same light, whatever the length of a direction.
    pub(crate) fn is_as(&self, other: &Light) -> bool {
        match (self, other) {
            // Normalised directions differ by rounding.
            (Light::Direction(a), Light::Direction(b)) => {
                (a.normalize() - b.normalize()).length() <= 8.0 * f64::EPSILON
            }
            _ => self == other,
        }
    }

    /// Tests whether `text` describes this light.
    pub(crate) fn is_written(&self, text: &str) -> bool {
        text.parse::<Light>().is_ok_and(|written| written.is_as(self))
    }
}

impl std::str::FromStr for Light {
    type Err = String;

    /// Parses `headlight`, `direction:X,Y,Z` or `position:X,Y,Z`.
    fn from_str(text: &str) -> Result<Light, String> {
        let wrong = || {
            format!("{text:?} is not a light; give headlight, direction:X,Y,Z or position:X,Y,Z")
        };
        if text == "headlight" {
            return Ok(Light::Headlight);
        }
        let (kind, numbers) = text.split_once(':').ok_or_else(wrong)?;
        let numbers: Vec<f64> = numbers
            .split(',')
            .map(|number| number.trim().parse().map_err(|_| wrong()))
            .collect::<Result<_, _>>()?;
        let &[x, y, z] = &numbers[..] else { return Err(wrong()) };
        let place = DVec3::new(x, y, z);
        match kind {
            _ if !place.is_finite() => Err(format!("{text:?} has a number that is not finite")),
            // Its squared length must be normal, to divide by it.
            "direction" => place
                .try_normalize()
                .map(|_| Light::Direction(place))
                .ok_or(format!("{text:?} is not a direction: its length is 0 or out of range")),
            "position" => Ok(Light::Position(place)),
            _ => Err(wrong()),
        }
    }
}

impl std::fmt::Display for Light {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let (kind, place) = match self {
            Light::Headlight => return write!(f, "headlight"),
            Light::Direction(direction) => ("direction", direction),
            Light::Position(position) => ("position", position),
        };
        write!(f, "{kind}:{},{},{}", place.x, place.y, place.z)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_light_is_what_it_is_written_as() {
        let direction = Light::Direction(DVec3::new(1.0, -2.5, -1e-3));
        let position = Light::Position(DVec3::new(500_000.125, 5_000_000.5, 100.0));
        for light in [Light::Headlight, direction, position] {
            assert_eq!(light.to_string().parse(), Ok(light));
        }
        assert_eq!("direction: 0, 0, -1".parse(), Ok(Light::Direction(DVec3::NEG_Z)));
    }

    #[test]
    fn a_direction_has_no_length() {
        let light = |text: &str| text.parse::<Light>().unwrap();
        let sun = light("direction:0.3,0.8,-0.8");
        assert!(
            [
                "direction:0.6,1.6,-1.6",
                "direction:3,8,-8",
                "direction:0.1,0.26666666666666666,-0.26666666666666666"
            ]
            .iter()
            .all(|text| sun.is_as(&light(text)))
        );
        assert!(
            [
                "direction:-0.3,-0.8,0.8",
                "direction:0.3,0.8,-0.800001",
                "position:0.3,0.8,-0.8",
                "headlight"
            ]
            .iter()
            .all(|text| !sun.is_as(&light(text)))
        );
        assert!(
            light("position:1,2,3").is_as(&light("position:1,2,3"))
                && !light("position:1,2,3").is_as(&light("position:2,4,6"))
        );
    }

    #[test]
    fn what_is_no_light_is_refused_with_its_words() {
        let bad = [
            "",
            "sun",
            "direction",
            "direction:",
            "direction:1,2",
            "direction:1,2,3,4",
            "direction:1,2,x",
            "direction:0,0,0",
            "direction:1e-200,0,0",
            "direction:1e200,0,0",
            "position:1,2,inf",
            "position:nan,0,0",
            "torch:1,2,3",
        ];
        for text in bad {
            let said = text.parse::<Light>().expect_err(text);
            assert!(said.contains(&format!("{text:?}")), "{said}");
        }
    }
}
