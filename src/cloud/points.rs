//! Points of a program's own memory as a cloud.

use super::float_attributes::convert_intensities;
use super::floats::{ColorUnit, Floats, Point};
use super::input::Input;
use super::strays::Kept;
use super::{Cloud, ColumnSet, Columns, Header, Lattice, Part, las, rgb_range, stations};
use crate::error::{Error, Result};
use crate::progress::Silent;
use glam::DVec3;
use std::path::PathBuf;

/// Positions of points, world `[m]`.
#[derive(Clone, Copy, Debug)]
pub enum Positions<'p> {
    /// Rounded to a lattice finer than f32.
    F32(&'p [[f32; 3]]),
    /// Rounded to a lattice of at most 2^30 steps.
    F64(&'p [[f64; 3]]),
    /// Steps of a lattice, kept as they are: `offset + scale * step`.
    Steps {
        /// Lattice steps of each point.
        steps: &'p [[i32; 3]],
        /// Width of a step along each axis `[m]`.
        scale: [f64; 3],
        /// World position of step 0 `[m]`.
        offset: [f64; 3],
    },
}

impl Positions<'_> {
    fn len(&self) -> usize {
        match self {
            Positions::F32(places) => places.len(),
            Positions::F64(places) => places.len(),
            Positions::Steps { steps, .. } => steps.len(),
        }
    }
}

/// Points with attributes; those that are present have one value for each position.
#[derive(Clone, Copy, Debug)]
pub struct Points<'p> {
    /// Positions of all points.
    pub positions: Positions<'p>,
    /// Colours, sRGB.
    pub colors: Option<&'p [[u8; 3]]>,
    /// Intensities of any range.
    pub intensities: Option<&'p [f32]>,
    /// ASPRS classes.
    pub classes: Option<&'p [u8]>,
}

impl<'p> Points<'p> {
    /// Returns points without attributes.
    pub fn new(positions: Positions<'p>) -> Points<'p> {
        Points { positions, colors: None, intensities: None, classes: None }
    }
}

impl Cloud {
    /// Returns a cloud of these points. Errors if an attribute has another number of values.
    pub fn of_points(points: &Points) -> Result<Cloud> {
        let count = points.positions.len();
        for (name, length) in [
            ("colours", points.colors.map(<[_]>::len)),
            ("intensities", points.intensities.map(<[_]>::len)),
            ("classes", points.classes.map(<[_]>::len)),
        ] {
            if let Some(length) = length.filter(|length| *length != count) {
                return Err(Error::Request(format!(
                    "{length} {name} for {count} positions; give one for each"
                )));
            }
        }
        let mut cloud = Cloud::default();
        let input = Input::made(PathBuf::from("points"), Vec::new());
        let header = Header { format: "points".into(), ..Header::default() };
        let parts = match points.positions {
            Positions::Steps { steps, scale, offset } => {
                vec![on_their_lattice(points, steps, scale, offset, input, header)?]
            }
            _ => {
                let there = ColumnSet {
                    rgb: points.colors.is_some(),
                    intensity: points.intensities.is_some(),
                    class: points.classes.is_some(),
                    ..ColumnSet::default()
                };
                let narrow = matches!(points.positions, Positions::F32(_));
                let mut floats = Floats::new(there, there, narrow, true);
                floats.reserve(count);
                (0..count).for_each(|i| floats.push(&point(points, i)));
                let notes = &mut cloud.notes;
                let unit = ColorUnit::Fields;
                let parts = floats.into_parts(&input, header, unit, None, &Silent, notes)?;
                parts.into_iter().map(|own| own.part).collect()
            }
        };
        for (number, part) in parts.into_iter().enumerate() {
            cloud.stations.extend(stations(&part, number));
            cloud.parts.push(part);
        }
        Ok(cloud)
    }
}

fn point(points: &Points, i: usize) -> Point {
    Point {
        position: match points.positions {
            Positions::F32(places) => places[i].map(f64::from),
            Positions::F64(places) => places[i],
            Positions::Steps { .. } => unreachable!("they have a lattice"),
        },
        rgb: points.colors.map_or([0; 3], |colors| colors[i]),
        intensity: points.intensities.map_or(0.0, |intensities| intensities[i]),
        class: points.classes.map_or(0, |classes| classes[i]),
        ..Point::default()
    }
}

fn on_their_lattice(
    points: &Points,
    steps: &[[i32; 3]],
    scale: [f64; 3],
    offset: [f64; 3],
    input: Input,
    header: Header,
) -> Result<Part> {
    let lattice = Lattice { step: DVec3::from_array(scale), offset: DVec3::from_array(offset) };
    if !(lattice.step.is_finite() && lattice.step.cmpgt(DVec3::ZERO).all()) {
        return Err(Error::Request(format!("a scale of {scale:?}; it must be above 0")));
    }
    if !lattice.offset.is_finite() {
        return Err(Error::Request(format!("an offset of {offset:?}; it must be finite")));
    }
    if let Some(what) = lattice.wrong() {
        return Err(Error::Request(format!("a cloud that {what}")));
    }
    let axis = |axis: usize| steps.iter().map(|step| step[axis]).collect();
    let (intensity, intensity_range) = points.intensities.map(convert_intensities).unzip();
    Ok(Part {
        path: input.path,
        name: None,
        header,
        lattice,
        columns: Columns {
            x: axis(0),
            y: axis(1),
            z: axis(2),
            rgb: points.colors.map(<[_]>::to_vec),
            intensity,
            class: points.classes.map(<[_]>::to_vec),
            extent: Kept::default(),
            ..Columns::default()
        },
        intensity_range: intensity_range.unwrap_or(las::INTENSITY_RANGE),
        rgb_scale: rgb_range::Scale::default(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_are_where_they_were_given() {
        let places = [[500_000.25, 4e6, -1.5], [500_001.0, 4e6 + 2.0, 0.125]];
        let colors = [[1, 2, 3], [4, 5, 6]];
        let points = Points { colors: Some(&colors), ..Points::new(Positions::F64(&places)) };
        let cloud = Cloud::of_points(&points).unwrap();
        let part = &cloud.parts[0];
        let world = |i: usize| {
            let Columns { x, y, z, .. } = &part.columns;
            part.lattice.world([x[i], y[i], z[i]].map(i64::from)).to_array()
        };
        assert_eq!([world(0), world(1)], places);
        assert_eq!(part.columns.rgb.as_deref(), Some(&colors[..]));
        let steps = [[1, 2, 3], [-4, 5, 6]];
        let (scale, offset) = ([0.5; 3], [10.0, 20.0, 30.0]);
        let cloud =
            Cloud::of_points(&Points::new(Positions::Steps { steps: &steps, scale, offset }));
        assert_eq!(cloud.unwrap().bounds().unwrap().0, DVec3::new(8.0, 21.0, 31.5));
    }

    #[test]
    fn intensities_of_any_range_are_kept_on_any_lattice() {
        let (stored, steps) = ([0.25, 0.5, 1.0], [[0, 0, 0], [1, 0, 0], [2, 0, 0]]);
        let places = steps.map(|step| step.map(f64::from));
        let on_lattice = Positions::Steps { steps: &steps, scale: [1.0; 3], offset: [0.0; 3] };
        for positions in [Positions::F64(&places), on_lattice] {
            let points = Points { intensities: Some(&stored), ..Points::new(positions) };
            let part = Cloud::of_points(&points).unwrap().parts.remove(0);
            assert_eq!(part.columns.intensity.unwrap(), [0, 21845, 65535]);
            assert_eq!(part.intensity_range, [0.25, 1.0]);
        }
    }

    #[test]
    fn what_does_not_fit_is_refused() {
        let points = Points { classes: Some(&[1]), ..Points::new(Positions::F32(&[[0.0; 3]; 2])) };
        let error = Cloud::of_points(&points).unwrap_err().to_string();
        assert_eq!(error, "1 classes for 2 positions; give one for each");
    }
}
