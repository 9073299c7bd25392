//! An old town's street, seen along y: two rows of houses, an arcade on the sunny side, trees,
//! cars, lamps, a viaduct, a church.
//!
//! Five scanner stations along the street, each with its own exposure and white balance, and no way
//! to see behind what stands there.

use super::facade::{Ground, House};
use super::light::{Cover, Light};
use super::material::{Material, Wall};
use super::noise::Random;
use super::panel::{Opening, Openings, Panel, Recess};
use super::props::{self, CLASS_BUILDING, CLASS_FURNITURE, CLASS_GROUND, cuboid, pole, roof};
use super::shapes::{Pose, Shape, Solid};
use super::world::{Leaf, Method, Station, Viewpoint, World, solid};
use glam::{DVec2, DVec3};

/// Half the distance between the fronts, metres.
const HALF_WIDTH: f64 = 8.0;
const KERB: f64 = 5.3;
const ROAD: f64 = 3.3;
/// The sill of an arch over the road lies this far below it, so that the road is what one sees.
const SUNK: f64 = 0.05;

const OCHRE: DVec3 = DVec3::new(0.66, 0.43, 0.17);
const ROSE: DVec3 = DVec3::new(0.64, 0.34, 0.26);
const CREAM: DVec3 = DVec3::new(0.72, 0.63, 0.45);
const SAGE: DVec3 = DVec3::new(0.37, 0.46, 0.32);
const SKY: DVec3 = DVec3::new(0.38, 0.50, 0.60);
const BRICK: DVec3 = DVec3::new(0.44, 0.17, 0.105);
const STONE: DVec3 = DVec3::new(0.60, 0.54, 0.43);
const WHITE: DVec3 = DVec3::new(0.74, 0.71, 0.64);
const CLAY: DVec3 = DVec3::new(0.44, 0.165, 0.085);
const SLATE: DVec3 = DVec3::new(0.14, 0.15, 0.17);

struct Row {
    houses: Vec<(Wall, DVec3, DVec3, Ground, f64, usize, usize)>,
    /// Where the row begins, and the side: -1 west, facing east.
    from: f64,
    side: f64,
}

pub fn build(seed: u64) -> World {
    let mut random = Random::new(seed, 0x57EE7, 0);
    let (mut solids, mut leaves) = (Vec::new(), Vec::new());
    ground(&mut solids);
    use Ground::{Arcade, Plain, Shop};
    use Wall::{Brick, Plaster, Stone};
    let rows = [
        Row {
            houses: vec![
                (Plaster, CREAM, STONE, Plain, 9.6, 4, 3),
                (Brick, BRICK, STONE, Shop, 8.4, 3, 3),
                (Plaster, OCHRE, WHITE, Arcade, 13.0, 4, 3),
                (Stone, STONE, WHITE, Arcade, 12.8, 4, 2),
                (Plaster, ROSE, WHITE, Arcade, 9.6, 3, 3),
                (Plaster, SKY, WHITE, Shop, 8.0, 3, 2),
                (Plaster, CREAM, STONE, Plain, 10.2, 4, 3),
            ],
            from: -36.0,
            side: -1.0,
        },
        Row {
            houses: vec![
                (Plaster, ROSE, STONE, Shop, 9.0, 3, 3),
                (Stone, STONE * 0.95, WHITE, Plain, 10.6, 4, 2),
                (Plaster, SAGE, WHITE, Shop, 9.2, 3, 3),
                (Brick, BRICK * 0.9, WHITE, Plain, 11.2, 4, 3),
                (Plaster, OCHRE * 0.95, STONE, Shop, 9.4, 3, 2),
                (Plaster, WHITE, STONE, Plain, 10.8, 4, 3),
                (Brick, BRICK * 1.1, STONE, Shop, 11.4, 4, 2),
            ],
            from: -36.0,
            side: 1.0,
        },
        Row {
            houses: vec![
                (Plaster, SAGE, WHITE, Plain, 10.0, 4, 3),
                (Plaster, OCHRE, WHITE, Shop, 12.0, 4, 2),
                (Brick, BRICK, STONE, Plain, 11.0, 4, 3),
            ],
            from: 51.0,
            side: -1.0,
        },
        Row {
            houses: vec![
                (Plaster, CREAM, STONE, Shop, 11.0, 4, 2),
                (Plaster, ROSE, WHITE, Plain, 10.0, 3, 3),
                (Stone, STONE, WHITE, Plain, 12.0, 4, 2),
            ],
            from: 51.0,
            side: 1.0,
        },
    ];
    let mut part = 10;
    for row in rows {
        let mut y = row.from;
        for (wall, color, trim, ground, width, bays, floors) in row.houses {
            let shutters = [
                None,
                Some(DVec3::new(0.07, 0.20, 0.14)),
                Some(DVec3::new(0.10, 0.20, 0.32)),
                None,
            ][random.below(4)];
            let plain_wall = matches!(wall, Plaster) && !matches!(ground, Arcade);
            let house = House {
                width,
                bays,
                floors,
                wall,
                color,
                trim,
                tile: if random.unit() < 0.7 { CLAY } else { SLATE },
                ground,
                arched_windows: matches!(wall, Stone)
                    || (matches!(ground, Arcade) && part % 2 == 0),
                shutters: shutters.filter(|_| plain_wall),
                balcony: matches!(wall, Brick | Stone) && part % 2 == 1,
                part,
            };
            // Facing east the wall's x runs north, facing west it runs south.
            let corner = if row.side < 0.0 { y } else { y + width };
            let front = Pose {
                origin: DVec3::new(row.side * HALF_WIDTH, corner, 0.0),
                x: DVec3::Y * -row.side,
                y: DVec3::Z,
                z: DVec3::X * -row.side,
            };
            house.build(front, &mut solids, &mut leaves, &mut random);
            y += width;
            part += 1;
        }
    }
    viaduct(&mut solids, 1);
    church(&mut solids, 2);
    let covers = furnish(&mut solids, &mut leaves, 100, &mut random);

    let light = Light {
        sun_direction: DVec3::new(0.40, -0.52, 0.76).normalize(),
        sun: DVec3::new(0.98, 0.88, 0.71),
        sky: DVec3::new(0.37, 0.46, 0.60),
        bounce: DVec3::new(0.24, 0.20, 0.15),
        shadows: true,
        canyon: Some((HALF_WIDTH, 13.0)),
        covers,
    };
    let station = |x: f64, y: f64, gain: f64, tint: [f64; 3]| Station {
        position: DVec3::new(x, y, 1.75),
        gain: DVec3::from(tint) * gain,
    };
    let stations = vec![
        station(-1.3, -21.0, 1.00, [1.00, 1.00, 1.00]),
        station(1.6, 1.5, 0.80, [1.02, 1.00, 0.96]),
        station(-1.0, 24.0, 1.14, [0.97, 1.00, 1.04]),
        station(1.5, 56.0, 0.90, [1.03, 1.00, 0.97]),
        station(0.9, -30.0, 1.07, [0.99, 1.00, 1.02]),
    ];
    let viewpoint = Viewpoint {
        eye: DVec3::new(1.9, -27.5, 1.75),
        target: DVec3::new(-1.5, 10.0, 5.6),
        fov_y: 52.0,
    };
    let mut world = World::new(solids, leaves, light, Method::Stations(stations), viewpoint);
    world.offset = DVec3::new(500_000.0, 5_000_000.0, 100.0);
    world.step = 1e-3;
    world
}

fn ground(solids: &mut Vec<Solid>) {
    let mut flat = |x: [f64; 2], y: [f64; 2], z: f64, material: Material| {
        let panel =
            Panel { size: DVec2::new(x[1] - x[0], y[1] - y[0]), gable: 0.0, openings: None };
        solids.push(solid(
            Pose::at(DVec3::new(x[0], y[0], z)),
            Shape::Panel(panel),
            material,
            0,
            CLASS_GROUND,
        ));
    };
    flat([-45.0, 45.0], [-40.0, 130.0], 0.0, Material::Cobbles);
    flat([-ROAD, ROAD], [-40.0, 92.0], 0.02, Material::Road);
    for side in [-1.0, 1.0] {
        // A kerb stone, then slabs up to the houses; interrupted at the viaduct's square.
        for (from, to) in [(-40.0, 36.5), (50.0, 86.0)] {
            let (middle, half) = ((from + to) / 2.0, (to - from) / 2.0);
            let walk = (HALF_WIDTH - KERB) / 2.0 + 0.05;
            let pose = Pose::at(DVec3::new(side * (KERB + walk), middle, 0.0));
            solids.push(cuboid(pose, [walk, half, 0.13], Material::Paving, 0, CLASS_GROUND));
        }
    }
}

/// A railway viaduct across the street: arches of 10 m on piers, open barrels, a cornice and
/// parapets.
fn viaduct(solids: &mut Vec<Solid>, part: u32) {
    let (from, to, y, depth, height, pitch) = (-42.0, 42.0, 39.5, 5.0, 10.2, 12.0);
    let masonry = Material::Masonry { wall: Wall::Stone, color: STONE * 0.85, salt: 3 };
    let edge = Material::Masonry { wall: Wall::Stone, color: STONE * 1.05, salt: 4 };
    let front =
        Pose { origin: DVec3::new(from, y, 0.0), x: DVec3::X, y: DVec3::Z, z: DVec3::NEG_Y };
    let columns = ((to - from) / pitch) as usize;
    let arch = |k: usize| Opening {
        sill: DVec2::new(pitch * (k as f64 + 0.5), 0.0),
        half_width: 4.9,
        height: 3.4,
        arched: true,
    };
    let cells: Vec<_> = (0..columns).map(|k| Some(arch(k))).collect();
    for opening in cells.iter().flatten() {
        let recess = Shape::Recess(Recess::new(
            Opening { height: opening.height + SUNK, ..*opening },
            depth,
            false,
        ));
        solids.push(solid(
            front.moved(DVec3::new(opening.sill.x, -SUNK, 0.0)),
            recess,
            masonry,
            part,
            CLASS_BUILDING,
        ));
        let rise = opening.top();
        solids.push(cuboid(
            front.moved(DVec3::new(opening.sill.x, rise + 0.25, 0.0)),
            [0.28, 0.45, 0.16],
            edge,
            part,
            CLASS_BUILDING,
        ));
    }
    let openings = Openings { left: 0.0, pitch, columns, rows: vec![0.0], cells };
    let face = Panel {
        size: DVec2::new(to - from, height),
        gable: 0.0,
        openings: Some(Box::new(openings)),
    };
    let facing = Material::Facade {
        wall: Wall::Stone,
        color: STONE * 0.85,
        trim: STONE * 1.1,
        base: 0.0,
        salt: 5,
    };
    for back in [0.0, -depth] {
        solids.push(solid(
            front.moved(DVec3::Z * back),
            Shape::Panel(face.clone()),
            facing,
            part,
            CLASS_BUILDING,
        ));
    }
    let half = (to - from) / 2.0;
    let mut beam = |up: f64, z: f64, half_height: f64, half_depth: f64| {
        solids.push(cuboid(
            front.moved(DVec3::new(half, up, z)),
            [half, half_height, half_depth],
            edge,
            part,
            CLASS_BUILDING,
        ));
    };
    beam(height + 0.12, -depth / 2.0, 0.14, depth / 2.0 + 0.30);
    beam(height + 0.75, 0.0, 0.50, 0.18);
    beam(height + 0.75, -depth, 0.50, 0.18);
    for k in 0..=columns {
        // A pilaster on each pier, up to the parapet.
        let pose = front.moved(DVec3::new(pitch * k as f64, height / 2.0 + 0.7, 0.0));
        solids.push(cuboid(pose, [0.55, height / 2.0 + 0.75, 0.26], edge, part, CLASS_BUILDING));
    }
}

/// The end of the view: a tower with belfry and spire, and the nave's gable behind it.
fn church(solids: &mut Vec<Solid>, part: u32) {
    let (half, height, y) = (3.9, 25.0, 96.0);
    let masonry =
        Material::Facade { wall: Wall::Stone, color: STONE * 1.1, trim: WHITE, base: 0.0, salt: 6 };
    let origin = DVec3::new(-2.4, y, 0.0);
    let rows = vec![0.0, 8.0, 17.0];
    let opening = |u: f64, v: f64, half_width: f64, height: f64| {
        Some(Opening { sill: DVec2::new(u, v), half_width, height, arched: true })
    };
    let cells = vec![
        opening(half, 0.0, 1.3, 2.8),
        opening(half, 10.0, 0.7, 2.6),
        opening(half, 18.5, 1.1, 3.0),
    ];
    let openings =
        Openings { left: 0.0, pitch: 2.0 * half, columns: 1, rows, cells: cells.clone() };
    for (out, x) in [(DVec3::NEG_Y, DVec3::X), (DVec3::X, DVec3::Y), (DVec3::NEG_X, DVec3::NEG_Y)] {
        let pose = Pose { origin: origin + out * half - x * half, x, y: DVec3::Z, z: out };
        let panel = Panel {
            size: DVec2::new(2.0 * half, height),
            gable: 0.0,
            openings: Some(Box::new(openings.clone())),
        };
        solids.push(solid(pose, Shape::Panel(panel), masonry, part, CLASS_BUILDING));
        for opening in cells.iter().flatten() {
            let window =
                Material::Window { trim: STONE, frame: DVec3::splat(0.05), panes: (2, 6), salt: 7 };
            solids.push(solid(
                pose.moved(opening.sill.extend(0.0)),
                Shape::Recess(Recess::new(*opening, 0.6, true)),
                window,
                part,
                CLASS_BUILDING,
            ));
        }
        let dial = pose.point(DVec3::new(half, 15.8, 0.0));
        solids.push(pole(
            dial,
            out,
            1.25,
            0.10,
            Material::Plain(DVec3::new(0.05, 0.08, 0.16)),
            part,
            CLASS_BUILDING,
        ));
        solids.push(pole(dial, out, 1.08, 0.13, Material::Plain(WHITE), part, CLASS_BUILDING));
        for (up, aside, length) in [(1.0, 0.15, 0.42), (0.25, 1.0, 0.30)] {
            let hand = (DVec3::Z * up + x * aside).normalize();
            let pose = Pose {
                origin: dial + hand * length + out * 0.14,
                x: hand,
                y: out.cross(hand),
                z: out,
            };
            solids.push(cuboid(
                pose,
                [length, 0.06, 0.02],
                Material::Plain(DVec3::splat(0.03)),
                part,
                CLASS_BUILDING,
            ));
        }
    }
    let trim = Material::Masonry { wall: Wall::Stone, color: WHITE, salt: 8 };
    for (z, out) in [(8.3, 0.18), (17.2, 0.18), (height, 0.45)] {
        solids.push(cuboid(
            Pose::at(origin + DVec3::Z * z),
            [half + out, half + out, 0.22],
            trim,
            part,
            CLASS_BUILDING,
        ));
    }
    let spire = Material::Tiles { color: SLATE * 1.2, salt: 9 };
    solids.push(solid(
        Pose::at(origin + DVec3::Z * (height + 0.2)),
        roof(half, half, 15.0, half),
        spire,
        part,
        CLASS_BUILDING,
    ));
    let gold = Material::Plain(DVec3::new(0.85, 0.58, 0.14));
    solids.push(pole(
        origin + DVec3::Z * (height + 14.6),
        DVec3::Z,
        0.06,
        2.4,
        gold,
        part,
        CLASS_BUILDING,
    ));
    solids.push(cuboid(
        Pose::at(origin + DVec3::Z * (height + 16.3)),
        [0.5, 0.05, 0.06],
        gold,
        part,
        CLASS_BUILDING,
    ));
    let nave = Pose {
        origin: origin + DVec3::new(-9.0, 5.0, 0.0),
        x: DVec3::X,
        y: DVec3::Z,
        z: DVec3::NEG_Y,
    };
    let gable = Panel { size: DVec2::new(18.0, 12.0), gable: 8.0, openings: None };
    solids.push(solid(nave, Shape::Panel(gable), masonry, part, CLASS_BUILDING));
    let ridge = Pose::facing(origin + DVec3::new(0.0, 15.0, 12.0), DVec3::Y, DVec3::Z);
    solids.push(solid(
        ridge,
        roof(10.0, 9.5, 8.4, 0.0),
        Material::Tiles { color: CLAY, salt: 10 },
        part,
        CLASS_BUILDING,
    ));
}

fn furnish(
    solids: &mut Vec<Solid>,
    leaves: &mut Vec<Leaf>,
    first: u32,
    random: &mut Random,
) -> Vec<Cover> {
    let mut part = first;
    let mut next = || {
        part += 1;
        part
    };
    let trees = [
        (6.3, -13.5, 0.90),
        (6.4, 1.0, 0.92),
        (6.3, 15.5, 0.85),
        (6.4, 30.0, 0.95),
        (-6.4, 31.0, 0.82),
        (-13.0, 47.5, 1.15),
        (14.0, 48.0, 1.2),
        (-20.0, 36.5, 1.1),
        (21.0, 37.0, 1.15),
        (6.4, 60.0, 0.9),
        (-6.4, 68.0, 0.9),
        (11.0, 90.0, 1.2),
        (-14.0, 90.0, 1.2),
    ];
    for (x, y, size) in trees {
        props::tree(solids, leaves, DVec3::new(x, y, 0.1), size, 10_000, 0.068, next(), random);
    }
    let cars = [
        (-4.35, -17.0, 90.0, DVec3::new(0.52, 0.035, 0.03)),
        (-4.30, -6.0, 90.0, DVec3::new(0.62, 0.60, 0.55)),
        (-4.40, 9.5, 90.0, DVec3::new(0.05, 0.13, 0.30)),
        (4.35, -12.0, -90.0, DVec3::new(0.10, 0.25, 0.17)),
        (4.30, 4.5, -90.0, DVec3::new(0.60, 0.44, 0.10)),
        (4.40, 21.5, -90.0, DVec3::new(0.35, 0.36, 0.38)),
        (-4.35, 27.5, 90.0, DVec3::new(0.68, 0.66, 0.62)),
        (1.7, 33.0, 90.0, DVec3::new(0.40, 0.08, 0.06)),
        (-4.35, 58.0, 90.0, DVec3::new(0.06, 0.07, 0.09)),
    ];
    let mut covers = Vec::new();
    for (x, y, degrees, paint) in cars {
        let degrees: f64 = degrees + random.between(-1.5, 1.5);
        props::car(solids, DVec3::new(x, y, 0.0), degrees, paint, next());
        covers.push(Cover {
            centre: DVec2::new(x, y),
            along: DVec2::from_angle(degrees.to_radians()),
            half: DVec2::new(2.1, 0.85),
        });
    }
    for y in [-24.0, -7.5, 9.0, 25.5, 55.0, 72.0] {
        for (x, shift) in [(-5.75, 0.0), (5.75, 4.5)] {
            props::lamp(solids, DVec3::new(x, y + shift, 0.13), next());
        }
    }
    let iron = Material::Plain(DVec3::splat(0.05));
    for k in 0..26 {
        let base = DVec3::new(-5.55, -17.0 + 1.4 * k as f64, 0.13);
        let part = next();
        solids.push(pole(base, DVec3::Z, 0.055, 0.75, iron, part, CLASS_FURNITURE));
        let parameter = Shape::Ellipsoid { semi_axes: DVec3::splat(0.085) };
        solids.push(solid(
            Pose::at(base + DVec3::Z * 0.80),
            parameter,
            iron,
            part,
            CLASS_FURNITURE,
        ));
    }
    covers
}
