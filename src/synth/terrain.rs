//! Open countryside for the airborne scanner: hills with a river, fields, a village and woods.

use super::bvh::Aabb;
use super::light::Light;
use super::material::Material;
use super::noise::{Random, cell, mottle};
use super::props;
use super::shapes::{Pose, Shape};
use super::world::{Method, Viewpoint, World, solid};
use glam::{DVec2, DVec3};

/// Half the extent of the land, metres.
const HALF: DVec2 = DVec2::new(300.0, 220.0);

/// Hills: (amplitude, wave vector, phase). Sums of sines have exact gradients and a known steepest
/// slope.
const HILLS: [(f64, f64, f64, f64); 6] = [
    (9.0, 0.0110, 0.0060, 0.4),
    (6.0, -0.0080, 0.0150, 1.9),
    (3.0, 0.0240, -0.0170, 4.1),
    (1.2, 0.0530, 0.0410, 2.2),
    (0.5, -0.0900, 0.1050, 0.7),
    (0.15, 0.2700, 0.1900, 5.0),
];
const RIVER_DEPTH: f64 = 4.0;
const RIVER_WIDTH: f64 = 16.0;

/// The ground z = h(x, y) over the rectangle, seen from above.
#[derive(Clone, Copy, Debug)]
pub struct Relief;

/// Where the river runs: x of its middle, and its derivative.
fn river(y: f64) -> (f64, f64) {
    (
        -70.0 + 38.0 * (y * 0.017).sin() + 12.0 * (y * 0.043 + 1.0).sin(),
        38.0 * 0.017 * (y * 0.017).cos() + 12.0 * 0.043 * (y * 0.043 + 1.0).cos(),
    )
}

/// Middle of the road: y at x.
fn lane(x: f64) -> f64 {
    18.0 + 30.0 * (x * 0.012).sin()
}

impl Relief {
    /// Height and gradient.
    pub fn height(&self, x: f64, y: f64) -> (f64, DVec2) {
        let mut h = 0.0;
        let mut slope = DVec2::ZERO;
        for (amplitude, kx, ky, phase) in HILLS {
            let (sin, cos) = (kx * x + ky * y + phase).sin_cos();
            h += amplitude * sin;
            slope += DVec2::new(kx, ky) * (amplitude * cos);
        }
        let (middle, turn) = river(y);
        let away = (x - middle) / RIVER_WIDTH;
        let carved = RIVER_DEPTH * (-away * away).exp();
        let rate = 2.0 * away * carved / RIVER_WIDTH;
        (h - carved, slope + DVec2::new(rate, -rate * turn))
    }

    fn steepest() -> f64 {
        let hills: f64 = HILLS.iter().map(|(a, kx, ky, _)| a * kx.hypot(*ky)).sum();
        // 2 a e^(-a^2) is at most sqrt(2/e); the river's turn is below 1.17.
        hills
            + RIVER_DEPTH / RIVER_WIDTH * (2.0f64 / std::f64::consts::E).sqrt() * 1.17f64.hypot(1.0)
    }

    pub fn bounds(&self) -> Aabb {
        let top: f64 = HILLS.iter().map(|h| h.0).sum();
        Aabb {
            min: DVec3::new(-HALF.x, -HALF.y, -top - RIVER_DEPTH),
            max: DVec3::new(HALF.x, HALF.y, top),
        }
    }

    /// Steps that cannot cross the surface, by its steepest slope, then Newton. Rays come from
    /// above.
    pub fn intersect(&self, o: DVec3, d: DVec3, t_min: f64, t_max: f64) -> Option<(f64, DVec3)> {
        let (mut t, leave) = self.bounds().clip(o, d.recip(), t_min, t_max)?;
        let rate = d.z.abs() + Self::steepest() * d.truncate().length();
        for _ in 0..2000 {
            let p = o + d * t;
            let (height, slope) = self.height(p.x, p.y);
            let above = p.z - height;
            if above.abs() < 1e-10 {
                return (t > t_min && t < leave)
                    .then(|| (t, DVec3::new(-slope.x, -slope.y, 1.0).normalize()));
            }
            let closing = d.z - slope.dot(d.truncate());
            // Within a centimetre and going down, Newton cannot leave for another hill.
            if above < 0.01 && closing < -0.02 * d.length() {
                t -= above / closing;
            } else if above < 0.0 {
                return None;
            } else {
                t += (above / rate).max(1e-9);
            }
            if t > leave {
                return None;
            }
        }
        None
    }
}

/// Fields in strips, a road, the river and its banks.
pub fn land(p: DVec3, n: DVec3) -> DVec3 {
    let away = (p.x - river(p.y).0).abs();
    if away < 8.0 + 1.5 * mottle(p.x * 0.2, p.y * 0.2, 71) {
        return DVec3::new(0.07, 0.13, 0.14) * (0.9 + 0.2 * mottle(p.x * 0.3, p.y * 0.08, 72));
    }
    let road = (p.y - lane(p.x)).abs();
    if road < 3.0 {
        let line = road < 0.12 && (p.x / 4.0).floor().rem_euclid(2.0) == 0.0;
        return DVec3::splat(if line {
            0.55
        } else {
            0.13 + 0.03 * mottle(p.x * 2.0, p.y * 2.0, 73)
        });
    }
    let grass = DVec3::new(0.13, 0.21, 0.055) * (0.7 + 0.6 * mottle(p.x * 0.8, p.y * 0.8, 74));
    if away < 22.0 || road < 7.0 || village(p.x, p.y) < 1.0 {
        return grass;
    }
    if wood(p.x, p.y) {
        return DVec3::new(0.085, 0.095, 0.04) * (0.6 + 0.8 * mottle(p.x * 1.2, p.y * 1.2, 80));
    }
    // Each field has its crop and the direction of its rows.
    let warp = 24.0 * (mottle(p.x * 0.006, p.y * 0.006, 75) - 0.5);
    let (u, v) = ((p.x + warp) / 74.0, (p.y - warp * 0.7) / 52.0);
    let (i, j) = (u.floor() as i64, v.floor() as i64);
    let edge = (u - u.floor()).min(1.0 - (u - u.floor())) * 74.0;
    let edge = edge.min((v - v.floor()).min(1.0 - (v - v.floor())) * 52.0);
    if edge < 1.2 || n.z < 0.85 {
        return grass * 0.8;
    }
    let crop = [
        DVec3::new(0.52, 0.42, 0.16),
        DVec3::new(0.20, 0.30, 0.07),
        DVec3::new(0.32, 0.24, 0.15),
        DVec3::new(0.62, 0.55, 0.10),
        DVec3::new(0.14, 0.24, 0.08),
    ][(cell(i, j, 76) * 5.0) as usize];
    let along = if cell(i, j, 77) < 0.5 { p.x } else { p.y };
    crop * (0.86 + 0.16 * (along * 4.2).sin()) * (0.8 + 0.4 * mottle(p.x * 0.3, p.y * 0.3, 78))
}

/// Below 1 inside the village.
fn village(x: f64, y: f64) -> f64 {
    ((x - 90.0) / 95.0).hypot((y - 40.0) / 62.0)
}

fn wood(x: f64, y: f64) -> bool {
    mottle(x * 0.012, y * 0.012, 79) > 0.57 && village(x, y) > 1.25
}

pub fn build(seed: u64) -> World {
    let relief = Relief;
    let mut random = Random::new(seed, 0x7E44, 0);
    let ground = |x: f64, y: f64| DVec3::new(x, y, relief.height(x, y).0);
    let mut solids =
        vec![solid(Pose::at(DVec3::ZERO), Shape::Terrain { relief }, Material::Land, 0, 2)];
    let mut leaves = Vec::new();
    let mut part = 1;
    let mut taken: Vec<DVec2> = Vec::new();
    for _ in 0..900 {
        let at = DVec2::new(random.between(0.0, 185.0), random.between(-25.0, 105.0));
        let road = (at.y - lane(at.x)).abs();
        if village(at.x, at.y) > 0.95
            || road < 10.0
            || taken.iter().any(|t| t.distance(at) < 17.0)
            || taken.len() >= 46
        {
            continue;
        }
        taken.push(at);
        let direction = (30.0 * 0.012 * (at.x * 0.012).cos()).atan().to_degrees()
            + 90.0 * random.below(2) as f64;
        props::cottage(&mut solids, ground(at.x, at.y), direction, part, &mut random);
        part += 1;
    }
    for _ in 0..6000 {
        let at = DVec2::new(
            random.between(-HALF.x, HALF.x) * 0.98,
            random.between(-HALF.y, HALF.y) * 0.98,
        );
        let away = (at.x - river(at.y).0).abs();
        let wood = wood(at.x, at.y);
        let wanted = wood
            || (12.0..20.0).contains(&away) && random.unit() < 0.25
            || village(at.x, at.y) < 1.0 && random.unit() < 0.12;
        let free = away > 11.0
            && (at.y - lane(at.x)).abs() > 6.0
            && taken.iter().all(|t| t.distance(at) > if wood { 5.0 } else { 8.5 });
        if wanted && free {
            taken.push(at);
            let size = random.between(1.0, 1.6);
            props::tree(
                &mut solids,
                &mut leaves,
                ground(at.x, at.y),
                size,
                220,
                0.50,
                part,
                &mut random,
            );
            part += 1;
        }
    }
    let light = Light { shadows: true, ..Light::studio() };
    let lines = vec![(-225.0, 1.0), (-75.0, 0.90), (75.0, 1.08), (225.0, 0.95)];
    let method = Method::Strips { height: 420.0, half_angle: 13.5, lines };
    let viewpoint = Viewpoint {
        eye: DVec3::new(-120.0, -270.0, 130.0),
        target: DVec3::new(30.0, 20.0, 0.0),
        fov_y: 42.0,
    };
    let mut world = World::new(solids, leaves, light, method, viewpoint);
    world.offset = DVec3::new(500_000.0, 5_000_000.0, 100.0);
    world.step = 1e-3;
    world
}
