//! Clip boxes: axis-aligned boxes in the world that keep or remove points, exactly.
//!
//! A point is kept if it lies in at least one `box` (if there are any) and in no `outside` box.
//! Faces belong to their box. `Lattice::world` is monotonic in the lattice step, also after f64
//! rounding. The steps inside a box are therefore found with that function, and the device compares
//! integers. The result equals an f64 comparison of world coordinates anywhere in the world.

use crate::cloud::Lattice;
use crate::cloud::strays::RobustBounds;
use crate::config::BITS_PER_PLANE;
use crate::index::build::pack::Frame;
use crate::names::Named;
use glam::DVec3;
use serde::Serialize;
use strum::{EnumString, IntoStaticStr, VariantArray};

/// The points that a box keeps.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[derive(EnumString, IntoStaticStr, VariantArray)]
#[strum(serialize_all = "kebab-case")]
#[serde(rename_all = "lowercase")]
pub enum Keeps {
    /// Points inside it, together with those inside other such boxes.
    #[default]
    Box,
    /// Points outside of it.
    Outside,
    /// All points; the box is switched off.
    Off,
}

/// One box, written `KIND:X0,Y0,Z0,X1,Y1,Z1`: two opposite corners, world `[m]`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Clip {
    /// Which points it leaves.
    pub keeps: Keeps,
    /// Least coordinates.
    pub min: DVec3,
    /// Greatest coordinates.
    pub max: DVec3,
}

/// All clip boxes.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Clips(pub Vec<Clip>);

/// The part of a node that clip boxes leave.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Left {
    Nothing,
    Everything,
    /// A part, which needs a test of every point.
    Some,
}

/// The cells of a node's finest plane inside a box, both ends included; empty if `least > most`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Within {
    pub least: [i32; 3],
    pub most: [i32; 3],
}

impl std::str::FromStr for Clip {
    type Err = String;

    fn from_str(text: &str) -> Result<Clip, String> {
        let wrong = || {
            format!(
                "{text:?} is not a clip box; give box:X0,Y0,Z0,X1,Y1,Z1, outside:... or off:..."
            )
        };
        let (kind, numbers) = text.split_once(':').ok_or_else(wrong)?;
        let keeps = Keeps::named(kind).map_err(|_| wrong())?;
        let numbers: Vec<f64> = numbers
            .split(',')
            .map(|number| number.trim().parse().map_err(|_| wrong()))
            .collect::<Result<_, _>>()?;
        let &[x0, y0, z0, x1, y1, z1] = &numbers[..] else { return Err(wrong()) };
        if numbers.iter().any(|number| number.is_nan()) {
            return Err(wrong());
        }
        let [a, b] = [DVec3::new(x0, y0, z0), DVec3::new(x1, y1, z1)];
        Ok(Clip { keeps, min: a.min(b), max: a.max(b) })
    }
}

impl std::fmt::Display for Clip {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let kind = self.keeps.name();
        let (a, b) = (self.min, self.max);
        write!(f, "{}:{},{},{},{},{},{}", kind, a.x, a.y, a.z, b.x, b.y, b.z)
    }
}

impl Clip {
    /// Returns six boxes that together remove everything outside a box in the world.
    pub(crate) fn around(core: &RobustBounds) -> [Clip; 6] {
        let all = Clip { keeps: Keeps::Outside, min: DVec3::NEG_INFINITY, max: DVec3::INFINITY };
        std::array::from_fn(|side| {
            let (mut clip, axis) = (all, side % 3);
            match side / 3 {
                0 => clip.max[axis] = core.low[axis].next_down(),
                _ => clip.min[axis] = core.high[axis].next_up(),
            }
            clip
        })
    }

    fn has(&self, p: DVec3) -> bool {
        p.cmpge(self.min).all() && p.cmple(self.max).all()
    }

    fn meets(&self, (min, max): (DVec3, DVec3)) -> bool {
        max.cmpge(self.min).all() && min.cmple(self.max).all()
    }

    fn holds(&self, (min, max): (DVec3, DVec3)) -> bool {
        self.has(min) && self.has(max)
    }

    /// Returns the cells inside the box, with `cell = step << pad` and steps counted from the
    /// frame's origin.
    fn within(&self, lattice: &Lattice, frame: &Frame, planes: u32) -> Within {
        let (pad, dropped) =
            (BITS_PER_PLANE * frame.planes - frame.bits, BITS_PER_PLANE * (frame.planes - planes));
        let mut within = Within { least: [0; 3], most: [-1; 3] };
        for axis in 0..3 {
            let at = |steps: i64| {
                let mut place = [0; 3];
                place[axis] = frame.origin[axis] + steps;
                lattice.world(place)[axis]
            };
            let rises = lattice.step[axis] >= 0.0;
            let (below, above) = (|at: f64| at < self.min[axis], |at: f64| at > self.max[axis]);
            let end = frame.extent[axis] as i64 + 1;
            let first =
                first(end, |steps| if rises { !below(at(steps)) } else { !above(at(steps)) });
            let after =
                self::first(end, |steps| if rises { above(at(steps)) } else { below(at(steps)) });
            if first < after {
                let cell = |steps: i64| ((steps << pad) >> dropped) as i32;
                (within.least[axis], within.most[axis]) = (cell(first), cell(after - 1));
            }
        }
        within
    }
}

/// Returns the first number in `0..end` for which a monotonic predicate holds; `end` if none.
fn first(end: i64, holds: impl Fn(i64) -> bool) -> i64 {
    let (mut low, mut high) = (0, end);
    while low < high {
        let middle = (low + high) / 2;
        if holds(middle) { high = middle } else { low = middle + 1 }
    }
    low
}

impl Clips {
    fn of(&self, keeps: Keeps) -> impl Iterator<Item = &Clip> {
        self.0.iter().filter(move |clip| clip.keeps == keeps)
    }

    /// Returns the number of boxes that are not switched off.
    pub(crate) fn active(&self) -> usize {
        self.0.iter().filter(|clip| clip.keeps != Keeps::Off).count()
    }

    /// Tests whether a point is kept.
    #[doc(hidden)]
    pub fn keep(&self, p: DVec3) -> bool {
        let mut kept = self.of(Keeps::Box).peekable();
        (kept.peek().is_none() || kept.any(|clip| clip.has(p)))
            && !self.of(Keeps::Outside).any(|clip| clip.has(p))
    }

    /// Returns the corners of the keeping boxes, as far as these lie between two corners.
    #[doc(hidden)]
    pub fn corners(&self, (min, max): (DVec3, DVec3)) -> Vec<DVec3> {
        let clips = self.of(Keeps::Box).filter(|clip| clip.meets((min, max)));
        clips
            .flat_map(|clip| {
                let ends = [clip.min.max(min), clip.max.min(max)];
                (0..8).map(move |corner: usize| {
                    DVec3::from([0, 1, 2].map(|axis| ends[corner >> axis & 1][axis]))
                })
            })
            .collect()
    }

    /// Returns what the boxes leave of the points between two corners.
    #[doc(hidden)]
    pub fn left(&self, bounds: (DVec3, DVec3)) -> Left {
        let mut kept = self.of(Keeps::Box).peekable();
        let (all, some) = match kept.peek() {
            None => (true, true),
            Some(_) => kept.fold((false, false), |(all, some), clip| {
                (all || clip.holds(bounds), some || clip.meets(bounds))
            }),
        };
        let (gone, touched) =
            self.of(Keeps::Outside).fold((false, false), |(gone, touched), clip| {
                (gone || clip.holds(bounds), touched || clip.meets(bounds))
            });
        match () {
            () if !some || gone => Left::Nothing,
            () if all && !touched => Left::Everything,
            () => Left::Some,
        }
    }

    /// Returns the corners around what the boxes leave of the space between two corners; None if
    /// nothing. Removing boxes that remove a part of it change nothing.
    pub(crate) fn cut(&self, bounds: (DVec3, DVec3)) -> Option<(DVec3, DVec3)> {
        match self.left(bounds) {
            Left::Nothing => None,
            Left::Everything => Some(bounds),
            Left::Some => {
                let own = |clip: &Clip| (clip.min.max(bounds.0), clip.max.min(bounds.1));
                let kept = self.of(Keeps::Box).filter(|clip| clip.meets(bounds)).map(own);
                Some(kept.reduce(|a, b| (a.0.min(b.0), a.1.max(b.1))).unwrap_or(bounds))
            }
        }
    }

    /// Returns, for a node with [`Left::Some`], its cells within each keeping box (a point must lie
    /// in one of them) and within each removing box (a point must lie in none). Missing planes
    /// count cells on a face as inside.
    #[doc(hidden)]
    pub fn within(
        &self,
        lattice: &Lattice,
        frame: &Frame,
        bounds: (DVec3, DVec3),
        planes: u32,
    ) -> [Vec<Within>; 2] {
        let is_held = self.of(Keeps::Box).any(|clip| clip.holds(bounds));
        let of = |keeps: Keeps| {
            self.of(keeps)
                .filter(|clip| clip.meets(bounds))
                .map(|clip| clip.within(lattice, frame, planes))
        };
        [if is_held { Vec::new() } else { of(Keeps::Box).collect() }, of(Keeps::Outside).collect()]
    }

    /// Returns numbers that are equal for boxes that keep the same points.
    #[doc(hidden)]
    pub fn identity(&self) -> impl Iterator<Item = u64> + '_ {
        let clip = |clip: &Clip| {
            [
                vec![clip.keeps as u64],
                [clip.min, clip.max].map(|p| p.to_array().map(f64::to_bits)).concat(),
            ]
            .concat()
        };
        self.0.iter().filter(|clip| clip.keeps != Keeps::Off).flat_map(clip)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn clips(words: &[&str]) -> Clips {
        Clips(words.iter().map(|word| word.parse().unwrap()).collect())
    }

    #[test]
    fn points_are_there_in_one_of_the_boxes_and_in_none_of_the_holes() {
        let at = |x: f64| DVec3::new(x, 0.0, 0.0);
        let both = clips(&[
            "box:0,-1,-1,2,1,1",
            "box:6,1,1,4,-1,-1",
            "outside:1,-1,-1,5,1,1",
            "off:0,0,0,0,0,0",
        ]);
        let kept: Vec<f64> =
            (-1..=14).map(|half| half as f64 / 2.0).filter(|&x| both.keep(at(x))).collect();
        assert_eq!(kept, [0.0, 0.5, 5.5, 6.0]);
        assert_eq!(both.active(), 3);
        let ends = |a: f64, b: f64| both.left((at(a), at(b)));
        assert_eq!(
            [ends(0.0, 0.5), ends(0.5, 1.0), ends(2.5, 3.0), ends(7.0, 8.0), ends(1.0, 5.0)],
            [Left::Everything, Left::Some, Left::Nothing, Left::Nothing, Left::Nothing]
        );
        assert!(Clips::default().keep(at(9.0)) && clips(&["outside:0,-1,-1,2,1,1"]).keep(at(9.0)));
        assert_eq!(Clips::default().left((at(0.0), at(1.0))), Left::Everything);
        let slab = clips(&["box:-inf,-inf,0,inf,inf,inf"]);
        assert_eq!(slab.left((at(-1e9), at(1e9))), Left::Everything);
        for word in [
            "box:0,-1,-1,2,1,1",
            "outside:0.1,0.2,0.30000000000000004,1,1,1",
            "off:-inf,0,0,inf,1,1",
        ] {
            assert_eq!(word.parse::<Clip>().unwrap().to_string(), word);
        }
        for word in
            ["", "box", "box:1,2,3", "box:0,0,0,1,1,nan", "sphere:0,0,0,1,1,1", "box:0,0,0,1,1,x"]
        {
            assert!(word.parse::<Clip>().is_err(), "{word}");
        }
    }

    /// Faces on, next to and between lattice points, where f64 rounds by half a nanometre, in both
    /// directions.
    #[test]
    fn cells_within_a_box_are_those_whose_places_an_f64_comparison_keeps() {
        for step in [0.001, -0.001, 1e-9] {
            let lattice = Lattice {
                step: DVec3::splat(step),
                offset: DVec3::new(500_000.0, 5_000_000.0, 0.1),
            };
            for (bits, planes) in [(7, 1), (12, 2), (20, 2)] {
                let frame = Frame { origin: [-70; 3], bits, extent: [100; 3], planes };
                let face = |q: i64| lattice.world([q; 3]);
                let nudged = |p: DVec3, ulps: i64| {
                    DVec3::from_array(
                        p.to_array().map(|v| f64::from_bits((v.to_bits() as i64 + ulps) as u64)),
                    )
                };
                for (lo, hi, ulps) in [
                    (-70, 30, 0),
                    (-60, 10, 0),
                    (-60, 10, 1),
                    (-60, 10, -1),
                    (5, 5, 0),
                    (5, 5, 1),
                    (-500, -100, 0),
                    (-80, 90, 0),
                ] {
                    let (a, b) = (nudged(face(lo), ulps), nudged(face(hi), ulps));
                    let clip = Clip { keeps: Keeps::Box, min: a.min(b), max: a.max(b) };
                    let within = clip.within(&lattice, &frame, planes);
                    for q in -70..=30 {
                        let cell = ((q + 70) << (10 * planes - bits)) as i32;
                        let place = lattice.world([q; 3]);
                        for axis in 0..3 {
                            let expected =
                                place[axis] >= clip.min[axis] && place[axis] <= clip.max[axis];
                            assert_eq!(
                                within.least[axis] <= cell && cell <= within.most[axis],
                                expected,
                                "{step} {lo} {hi} {ulps} {q} {axis}"
                            );
                        }
                    }
                }
            }
        }
    }
}
