//! Flat walls with openings, and the recesses behind the openings: what a facade, an arcade and a
//! bridge are made of.
//!
//! A panel is the rectangle [0, width] x [0, height] of its local plane z = 0, with an optional
//! gable on top, minus a regular grid of openings (one an cell at most, so that a ray looks at
//! one). A recess is what one sees through an opening: its jambs, sill and head, and a pane at the
//! back, or nothing at the back for the barrel of an arch bridge.

use glam::{DVec2, DVec3};

/// A hole with a flat or a semicircular head. Local plane coordinates, metres.
#[derive(Clone, Copy, Debug)]
pub struct Opening {
    /// Middle of the sill.
    pub sill: DVec2,
    pub half_width: f64,
    /// From the sill to the flat head, or to the springing of the arch, which rises by `half_width`
    /// above it.
    pub height: f64,
    pub arched: bool,
}

impl Opening {
    pub fn top(&self) -> f64 {
        self.sill.y + self.height + if self.arched { self.half_width } else { 0.0 }
    }

    /// Negative inside, metres (exact beside edges, larger than true outside corners).
    pub fn distance(&self, at: DVec2) -> f64 {
        let p = at - self.sill;
        if self.arched && p.y > self.height {
            DVec2::new(p.x, p.y - self.height).length() - self.half_width
        } else {
            (p.x.abs() - self.half_width).max(-p.y).max(if self.arched {
                f64::NEG_INFINITY
            } else {
                p.y - self.height
            })
        }
    }
}

/// The openings of a facade: columns of equal pitch, rows (floors) of any height.
#[derive(Clone, Debug, Default)]
pub struct Openings {
    pub left: f64,
    pub pitch: f64,
    pub columns: usize,
    /// Lower edges of the rows, ascending; a row ends where the next begins.
    pub rows: Vec<f64>,
    /// Row by row.
    pub cells: Vec<Option<Opening>>,
}

impl Openings {
    pub fn near(&self, at: DVec2) -> Option<&Opening> {
        let column = ((at.x - self.left) / self.pitch).floor();
        if !(column >= 0.0 && (column as usize) < self.columns) {
            return None;
        }
        let row = self.rows.iter().rposition(|&bottom| at.y >= bottom)?;
        self.cells[row * self.columns + column as usize].as_ref()
    }
}

#[derive(Clone, Debug)]
pub struct Panel {
    pub size: DVec2,
    /// Height of a triangle on top, 0 for none.
    pub gable: f64,
    pub openings: Option<Box<Openings>>,
}

impl Panel {
    pub fn contains(&self, at: DVec2) -> bool {
        let top = self.size.y + self.gable * (1.0 - (2.0 * at.x / self.size.x - 1.0).abs());
        at.x >= 0.0
            && at.x <= self.size.x
            && at.y >= 0.0
            && at.y <= top
            && !self
                .openings
                .as_ref()
                .and_then(|o| o.near(at))
                .is_some_and(|o| o.distance(at) < 0.0)
    }

    pub fn intersect(&self, o: DVec3, d: DVec3, t_min: f64, t_max: f64) -> Option<(f64, DVec3)> {
        let t = -o.z / d.z;
        if !(t > t_min && t < t_max) {
            return None;
        }
        self.contains((o + d * t).truncate()).then(|| (t, DVec3::new(0.0, 0.0, -d.z.signum())))
    }
}

/// The inside of an extruded opening: local origin in the middle of the sill, z outwards, the
/// material between z = -depth and 0.
#[derive(Clone, Copy, Debug)]
pub struct Recess {
    pub opening: Opening,
    pub depth: f64,
    /// True if there is a pane at z = -depth.
    pub closed: bool,
}

impl Recess {
    pub fn new(opening: Opening, depth: f64, closed: bool) -> Recess {
        Recess { opening: Opening { sill: DVec2::ZERO, ..opening }, depth, closed }
    }

    pub fn intersect(&self, o: DVec3, d: DVec3, t_min: f64, t_max: f64) -> Option<(f64, DVec3)> {
        let Opening { half_width: half, height, arched, .. } = self.opening;
        let mut best = (t_max, DVec3::ZERO);
        let mut offer = |t: f64, normal: DVec3, on: &dyn Fn(DVec3) -> bool| {
            if t > t_min && t < best.0 && on(o + d * t) {
                best = (t, normal);
            }
        };
        let deep = |p: DVec3| p.z >= -self.depth && p.z <= 0.0;
        if self.closed {
            let inside = |p: DVec3| self.opening.distance(p.truncate()) <= 0.0;
            offer((-self.depth - o.z) / d.z, DVec3::Z, &inside);
        }
        let side = |p: DVec3| deep(p) && p.y >= 0.0 && p.y <= height;
        offer((half - o.x) / d.x, DVec3::NEG_X, &side);
        offer((-half - o.x) / d.x, DVec3::X, &side);
        offer(-o.y / d.y, DVec3::Y, &|p| deep(p) && p.x.abs() <= half);
        if arched {
            let (ox, oy) = (o.x, o.y - height);
            let a = d.x * d.x + d.y * d.y;
            let middle = -(ox * d.x + oy * d.y) / a;
            let (nx, ny) = (ox + d.x * middle, oy + d.y * middle);
            let rest = (half * half - nx * nx - ny * ny) / a;
            if rest >= 0.0 {
                for t in [middle - rest.sqrt(), middle + rest.sqrt()] {
                    let p = o + d * t;
                    offer(t, DVec3::new(-p.x / half, -(p.y - height) / half, 0.0), &|p| {
                        deep(p) && p.y >= height
                    });
                }
            }
        } else {
            offer((height - o.y) / d.y, DVec3::NEG_Y, &|p| deep(p) && p.x.abs() <= half);
        }
        (best.0 < t_max).then_some(best)
    }
}
