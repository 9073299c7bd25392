//! Procedural albedo of surfaces: brick, stone, plaster, tiles, paving, paint.
//!
//! Albedo is linear RGB. The second value is the visible share of the sky, 1 in the open, which
//! darkens deep recesses.

use super::noise::{cell, mottle};
use super::shapes::{Shape, Solid};
use super::terrain;
use glam::{DVec2, DVec3};

#[derive(Clone, Copy, Debug)]
pub enum Wall {
    Plaster,
    Brick,
    Stone,
}

#[derive(Clone, Copy, Debug)]
pub enum Material {
    Plain(DVec3),
    /// A board of two colours, each field `size` metres.
    Checks {
        colors: [DVec3; 2],
        size: f64,
    },
    /// Parallels and meridians, on spheres and tori (`bands` around, `rings` along).
    Globe {
        colors: [DVec3; 2],
        bands: f64,
        major: f64,
    },
    /// The front of a house: its wall, lighter surrounds at openings and corners, rusticated stone
    /// up to `base`.
    Facade {
        wall: Wall,
        color: DVec3,
        trim: DVec3,
        base: f64,
        salt: u64,
    },
    /// Any masonry, by its dominant direction.
    Masonry {
        wall: Wall,
        color: DVec3,
        salt: u64,
    },
    /// The inside of an opening: jambs of `trim`, a window with `panes` across and down at the
    /// back.
    Window {
        trim: DVec3,
        frame: DVec3,
        panes: (u32, u32),
        salt: u64,
    },
    /// Rows of clay or slate; rows follow the contour lines of the roof.
    Tiles {
        color: DVec3,
        salt: u64,
    },
    Road,
    Cobbles,
    Paving,
    Stripes {
        colors: [DVec3; 2],
        width: f64,
    },
    /// A car's cabin: glass all round below a painted roof.
    Cabin {
        paint: DVec3,
    },
    Bark,
    /// Open countryside.
    Land,
}

/// Returns the brick or block in running bond, and the distance from the nearest joint `[m]`.
fn bond(u: f64, v: f64, length: f64, height: f64) -> (i64, i64, f64) {
    let row = (v / height).floor();
    let shifted = u / length + 0.5 * (row.rem_euclid(2.0));
    let column = shifted.floor();
    let (across, up) = ((shifted - column) * length, v - row * height);
    (column as i64, row as i64, across.min(length - across).min(up).min(height - up))
}

fn mix(a: DVec3, b: DVec3, t: f64) -> DVec3 {
    a + (b - a) * t.clamp(0.0, 1.0)
}

/// Returns the wall's albedo at (u, v), v up.
fn masonry(wall: Wall, color: DVec3, u: f64, v: f64, salt: u64) -> DVec3 {
    match wall {
        Wall::Plaster => {
            let weather = 0.90 + 0.16 * mottle(u * 0.7, v * 0.5, salt)
                - 0.05 * mottle(u * 9.0, v * 3.0, salt + 7);
            let streak = 0.06 * (mottle(u * 3.0, v * 0.15, salt + 3) - 0.5);
            color * (weather + streak)
        }
        Wall::Brick => {
            let (i, j, joint) = bond(u, v, 0.25, 0.077);
            let tone = 0.72 + 0.5 * cell(i, j, salt);
            let hue = cell(i, j, salt + 1);
            let brick =
                color * DVec3::new(tone, tone * (0.90 + 0.15 * hue), tone * (0.85 + 0.25 * hue));
            let wet = 0.9 + 0.2 * mottle(u * 0.6, v * 0.4, salt);
            mix(DVec3::new(0.46, 0.43, 0.38), brick, (joint - 0.004) / 0.006) * wet
        }
        Wall::Stone => {
            let (i, j, joint) = bond(u, v, 0.72, 0.36);
            let tone =
                0.84 + 0.26 * cell(i, j, salt) + 0.12 * (mottle(u * 5.0, v * 5.0, salt) - 0.5);
            mix(color * 0.5, color * tone, (joint - 0.006) / 0.014)
        }
    }
}

/// Returns plane coordinates on a surface of any direction: along and up `[m]`.
fn unrolled(p: DVec3, n: DVec3) -> (f64, f64) {
    let a = n.abs();
    if a.z > 0.8 {
        (p.x, p.y)
    } else if a.x > a.y {
        (p.y, p.z)
    } else {
        (p.x, p.z)
    }
}

/// Returns albedo and openness of `solid` at a point: `p`, `n` in the scene (n towards the viewer),
/// `local` and `local_normal` in the solid.
pub fn albedo(
    solid: &Solid,
    p: DVec3,
    n: DVec3,
    local: DVec3,
    local_normal: DVec3,
) -> (DVec3, f64) {
    let open = |color: DVec3| (color, 1.0);
    match solid.material {
        Material::Plain(color) => open(color),
        Material::Checks { colors, size } => {
            let odd =
                ((local.x / size).floor() + (local.y / size).floor()).rem_euclid(2.0) as usize;
            open(colors[odd] * (0.88 + 0.24 * mottle(local.x * 2.0, local.y * 2.0, 5)))
        }
        Material::Globe { colors, bands, major } => {
            let around = local.y.atan2(local.x);
            let along = local.z.atan2(local.x.hypot(local.y) - major);
            let wave = (bands * around).cos()
                * (if major > 0.0 { 4.0 * along } else { bands * along }).cos();
            open(mix(colors[0], colors[1], 0.5 + 2.5 * wave))
        }
        Material::Facade { wall, color, trim, base, salt } => {
            open(facade(solid, local, wall, color, trim, base, salt))
        }
        Material::Masonry { wall, color, salt } => {
            let (u, v) = unrolled(p, n);
            open(masonry(wall, color, u, v, salt))
        }
        Material::Window { trim, frame, panes, salt } => {
            window(solid, local, local_normal, trim, frame, panes, salt)
        }
        Material::Tiles { color, salt } => {
            // Along the slope lengths are longer than heights: undo it, so that tiles are of one
            // size on any roof.
            let (along, up) = if n.x.abs() > n.y.abs() {
                (p.y, p.z / n.x.abs())
            } else {
                (p.x, p.z / n.y.abs().max(0.2))
            };
            let (i, j, _) = bond(along, up, 0.22, 0.30);
            let lap = (up / 0.30).rem_euclid(1.0);
            let tone =
                0.72 + 0.45 * cell(i, j, salt) + 0.25 * (mottle(along * 0.5, up * 0.5, salt) - 0.5);
            open(color * tone * (0.62 + 0.38 * (lap * 4.0).min(1.0)))
        }
        Material::Road => open(road(p)),
        Material::Cobbles => {
            let bend = 0.10 * (mottle(p.x * 0.8, p.y * 0.8, 31) - 0.5);
            let (i, j, joint) = bond(p.x + bend, p.y + bend, 0.16, 0.12);
            let tone = 0.17 + 0.14 * cell(i, j, 32);
            let warm = cell(i, j, 33);
            let stone = DVec3::new(
                tone * (1.0 + 0.16 * warm),
                tone * (1.0 + 0.04 * warm),
                tone * (1.0 - 0.08 * warm),
            );
            open(mix(DVec3::splat(0.075), stone, (joint - 0.004) / 0.012))
        }
        Material::Paving => {
            if n.z < 0.7 {
                return open(
                    DVec3::new(0.36, 0.35, 0.33)
                        * (0.85 + 0.3 * cell((p.y / 1.2).floor() as i64, 0, 41)),
                );
            }
            let (i, j, joint) = bond(p.y, p.x, 0.9, 0.6);
            let tone =
                0.33 + 0.12 * cell(i, j, 42) + 0.08 * (mottle(p.x * 1.5, p.y * 1.5, 43) - 0.5);
            open(mix(
                DVec3::splat(0.15),
                DVec3::new(tone * 1.04, tone, tone * 0.93),
                (joint - 0.005) / 0.010,
            ))
        }
        Material::Stripes { colors, width } => {
            open(colors[(local.x / width).floor().rem_euclid(2.0) as usize])
        }
        Material::Cabin { paint } => {
            let glass =
                DVec3::new(0.035, 0.045, 0.055) * (0.7 + 1.6 * (local.z - 0.1).clamp(0.0, 1.0));
            let pillar = (local.x.abs() - 0.12).abs() < 0.05 && local_normal.y.abs() > 0.5;
            open(if local_normal.z > 0.9 || pillar || local.z < 0.06 { paint } else { glass })
        }
        Material::Bark => {
            let groove = mottle(p.x * 14.0 + p.y * 14.0, p.z * 2.5, 51);
            open(DVec3::new(0.20, 0.155, 0.115) * (0.55 + 0.9 * groove))
        }
        Material::Land => open(terrain::land(p, n)),
    }
}

fn facade(
    solid: &Solid,
    local: DVec3,
    wall: Wall,
    color: DVec3,
    trim: DVec3,
    base: f64,
    salt: u64,
) -> DVec3 {
    let Shape::Panel(panel) = &solid.shape else { return color };
    let (u, v) = (local.x, local.y);
    if v < base {
        // Rusticated: large blocks with wide, dark joints.
        let (i, j, joint) = bond(u, v, 0.95, 0.42);
        let tone = 0.88 + 0.2 * cell(i, j, salt) + 0.10 * (mottle(u * 4.0, v * 4.0, salt) - 0.5);
        let block = mix(trim, color, 0.30);
        return mix(block * 0.38, block * tone, (joint - 0.012) / 0.016)
            * (0.82 + 0.18 * (v / 0.8).min(1.0));
    }
    let corner = u.min(panel.size.x - u);
    let course = (v / 0.36).floor();
    if corner < if course.rem_euclid(2.0) == 0.0 { 0.55 } else { 0.35 } && v < panel.size.y {
        let joint = (v - course * 0.36).min(course * 0.36 + 0.36 - v);
        return mix(
            trim * 0.55,
            trim * (0.9 + 0.16 * cell(course as i64, (u > 1.0) as i64, salt)),
            (joint - 0.006) / 0.012,
        );
    }
    let surround = panel
        .openings
        .as_ref()
        .and_then(|o| o.near(DVec2::new(u, v)))
        .map_or(f64::INFINITY, |o| o.distance(DVec2::new(u, v)));
    if surround < 0.17 {
        return trim
            * (0.94 + 0.12 * mottle(u * 6.0, v * 6.0, salt))
            * (0.7 + 0.3 * ((0.17 - surround) / 0.02).min(1.0));
    }
    masonry(wall, color, u, v, salt)
}

fn window(
    solid: &Solid,
    local: DVec3,
    normal: DVec3,
    trim: DVec3,
    frame: DVec3,
    panes: (u32, u32),
    salt: u64,
) -> (DVec3, f64) {
    let Shape::Recess(recess) = &solid.shape else { return (trim, 1.0) };
    // Jambs see less sky the deeper they are.
    let depth = (-local.z / recess.opening.half_width.max(0.4)).clamp(0.0, 1.5);
    let open = 1.0 - 0.42 * depth;
    if normal.z < 0.5 || !recess.closed {
        return (trim * (0.95 + 0.1 * mottle(local.z * 8.0, local.y * 8.0, salt)), open);
    }
    let opening = &recess.opening;
    let edge = -opening.distance(local.truncate());
    let (across, down) = (panes.0 as f64, panes.1 as f64);
    let (u, v) =
        ((local.x / opening.half_width + 1.0) * 0.5 * across, local.y / opening.top() * down);
    let bar = |t: f64, size: f64| (t - t.round()).abs() * size < 0.022;
    let inner = |t: f64, count: f64| t > 0.5 && t < count - 0.5;
    let bars = inner(u, across) && bar(u, 2.0 * opening.half_width / across)
        || inner(v, down) && bar(v, opening.top() / down);
    if edge < 0.065 || bars {
        return (frame, open);
    }
    // Glass: the dark of a room, a little sky towards the top, and behind some windows a curtain.
    let up = local.y / opening.top();
    let mood = cell(salt as i64, 5, 62);
    let sheen = ((local.x * 0.6 + local.y * 0.9) * 1.7 + mood * 6.0).sin().max(0.0);
    let room = DVec3::new(0.030, 0.034, 0.040) * (0.7 + mood)
        + DVec3::new(0.09, 0.13, 0.17) * (up * up * mood + 0.35 * sheen * sheen);
    let curtain = cell(salt as i64, 9, 61);
    let folds = 0.8 + 0.2 * (local.x * 40.0).sin();
    let drawn =
        curtain > 0.6 && (local.x.abs() > opening.half_width * (1.35 - curtain) && up > 0.08);
    (if drawn { DVec3::new(0.36, 0.33, 0.28) * folds } else { room }, open)
}

/// Returns asphalt with a patched surface, a dashed middle line, lines at the edges and a zebra
/// crossing.
fn road(p: DVec3) -> DVec3 {
    let grain = 0.085
        + 0.035 * mottle(p.x * 18.0, p.y * 18.0, 21)
        + 0.045 * mottle(p.x * 0.35, p.y * 0.2, 22);
    let tracks = 0.012 * ((p.x.abs() - 1.35).abs() / 0.35).min(1.0);
    let asphalt = DVec3::new(grain * 1.03, grain, grain * 0.96) + tracks;
    let worn = mottle(p.x * 5.0, p.y * 5.0, 23);
    let paint = mix(DVec3::splat(0.58), asphalt, (worn - 0.52) * 5.0);
    let zebra = (-16.5..-13.5).contains(&p.y)
        && (p.x / 0.5).floor().rem_euclid(2.0) == 0.0
        && p.x.abs() < 2.9;
    let dashes = p.x.abs() < 0.06
        && (p.y / 3.0).floor().rem_euclid(2.0) == 0.0
        && !(-18.5..-11.5).contains(&p.y);
    if zebra || dashes { paint } else { asphalt }
}
