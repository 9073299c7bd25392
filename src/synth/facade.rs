//! One town house: a front with rows of recessed windows over a shop, a door or an arcade,
//! cornices, roof, dormers, chimneys.
//!
//! A front's own axes: x along the wall, y up, z out over the pavement; its origin is the lower
//! left corner, seen from the street.

use super::material::{Material, Wall};
use super::noise::Random;
use super::panel::{Opening, Openings, Panel, Recess};
use super::props::{CLASS_BUILDING, CLASS_FURNITURE, cuboid, pole, roof};
use super::shapes::{Pose, Shape, Solid};
use super::world::{Leaf, solid};
use glam::{DVec2, DVec3};

#[derive(Clone, Copy, PartialEq)]
pub enum Ground {
    /// Arches on piers, a gallery behind them.
    Arcade,
    /// Wide windows under an awning.
    Shop,
    /// Windows and an arched door.
    Plain,
}

#[derive(Clone, Copy)]
pub struct House {
    pub width: f64,
    pub bays: usize,
    /// Above the ground floor.
    pub floors: usize,
    pub wall: Wall,
    pub color: DVec3,
    pub trim: DVec3,
    pub tile: DVec3,
    pub ground: Ground,
    pub arched_windows: bool,
    pub shutters: Option<DVec3>,
    pub balcony: bool,
    pub part: u32,
}

pub const DEPTH: f64 = 11.0;
const GROUND_M: f64 = 4.5;
const FLOOR_M: f64 = 3.25;
const WALL_M: f64 = 0.55;

impl House {
    pub fn height(&self) -> f64 {
        GROUND_M + FLOOR_M * self.floors as f64 + 0.35
    }

    fn salt(&self) -> u64 {
        self.part as u64 * 977
    }

    fn openings(&self) -> Openings {
        let pitch = self.width / self.bays as f64;
        let mut rows = vec![0.0];
        rows.extend((0..self.floors).map(|f| GROUND_M + 0.1 + FLOOR_M * f as f64));
        let mut cells = Vec::new();
        for (row, &bottom) in rows.iter().enumerate() {
            for column in 0..self.bays {
                let u = pitch * (column as f64 + 0.5);
                let opening = |half_width: f64, sill: f64, height: f64, arched: bool| Opening {
                    sill: DVec2::new(u, sill),
                    half_width,
                    height,
                    arched,
                };
                let door = column == self.bays / 2;
                cells.push(Some(match (row, self.ground) {
                    (0, Ground::Arcade) => {
                        opening(pitch / 2.0 - 0.36, 0.14, 3.75 - (pitch / 2.0 - 0.36), true)
                    }
                    (0, Ground::Shop) if !door => {
                        opening((pitch / 2.0 - 0.28).min(1.25), 0.75, 2.25, false)
                    }
                    (0, _) if door => opening(0.72, 0.14, 2.25, true),
                    (0, _) => opening(0.58, 1.15, 1.55, true),
                    // Windows get lower towards the roof, as in most old towns.
                    _ => {
                        let height = 1.95 - 0.16 * (row - 1) as f64;
                        opening(
                            0.56,
                            bottom + 0.62,
                            if self.arched_windows { height - 0.4 } else { height },
                            self.arched_windows,
                        )
                    }
                }));
            }
        }
        Openings { left: 0.0, pitch, columns: self.bays, rows, cells }
    }

    pub fn build(
        &self,
        front: Pose,
        solids: &mut Vec<Solid>,
        leaves: &mut Vec<Leaf>,
        random: &mut Random,
    ) {
        let (w, h, part) = (self.width, self.height(), self.part);
        let openings = self.openings();
        let facade = Material::Facade {
            wall: self.wall,
            color: self.color,
            trim: self.trim,
            base: GROUND_M - 0.25,
            salt: self.salt(),
        };
        let panel = |gable: f64, size: DVec2, openings: Option<Openings>| {
            Shape::Panel(Panel { size, gable, openings: openings.map(Box::new) })
        };
        let mut push = |pose: Pose, shape: Shape, material: Material| {
            solids.push(solid(pose, shape, material, part, CLASS_BUILDING))
        };
        push(front, panel(0.0, DVec2::new(w, h), Some(openings.clone())), facade);

        // Party walls, with gables where the neighbour is lower, and the back.
        let masonry =
            Material::Masonry { wall: Wall::Plaster, color: self.color * 0.9, salt: self.salt() };
        let rise = DEPTH * 0.40;
        for x in [0.0, w] {
            let pose = Pose {
                origin: front.point(DVec3::new(x, 0.0, -DEPTH)),
                x: front.z,
                y: front.y,
                z: -front.x,
            };
            push(pose, panel(rise, DVec2::new(DEPTH, h), None), masonry);
        }
        push(
            front.moved(DVec3::new(0.0, 0.0, -DEPTH)),
            panel(0.0, DVec2::new(w, h), None),
            masonry,
        );

        let on_roof = Pose {
            origin: front.point(DVec3::new(w / 2.0, h, -DEPTH / 2.0)),
            x: front.x,
            y: -front.z,
            z: front.y,
        };
        push(
            on_roof.moved(DVec3::Z * 0.12),
            roof(w / 2.0 + 0.02, DEPTH / 2.0 + 0.45, rise + 0.2, 0.0),
            Material::Tiles { color: self.tile, salt: self.salt() },
        );

        let trim =
            Material::Masonry { wall: Wall::Stone, color: self.trim * 0.95, salt: self.salt() };
        let mut ledge = |y: f64, half_height: f64, out: f64| {
            let pose = front.moved(DVec3::new(w / 2.0, y, 0.0));
            solids.push(cuboid(
                pose,
                [w / 2.0 + 0.03, half_height, out],
                trim,
                part,
                CLASS_BUILDING,
            ));
        };
        ledge(h - 0.10, 0.14, 0.42);
        ledge(h - 0.32, 0.09, 0.24);
        ledge(GROUND_M - 0.16, 0.10, 0.16);
        ledge(0.25, 0.12, 0.05);

        for (index, opening) in openings.cells.iter().enumerate() {
            let Some(opening) = opening else { continue };
            self.opening(front, index / self.bays, index, *opening, solids, leaves, random);
        }
        if self.ground == Ground::Arcade {
            self.gallery(front, &openings, solids);
        }
        if self.balcony {
            self.balcony(front, solids);
        }
        let bays = self.bays;
        for bay in (0..bays).step_by(2).filter(|_| self.part % 3 != 1) {
            self.dormer(
                front.moved(DVec3::new(w / bays as f64 * (bay as f64 + 0.5), h + 0.55, -0.75)),
                solids,
            );
        }
        let brick = Material::Masonry {
            wall: Wall::Brick,
            color: DVec3::new(0.40, 0.17, 0.11),
            salt: self.salt(),
        };
        for x in [0.6, w - 0.6] {
            let top = h + rise + 0.5;
            solids.push(cuboid(
                front.moved(DVec3::new(x, top - 0.6, -DEPTH * 0.4)),
                [0.35, 1.3, 0.5],
                brick,
                part,
                CLASS_BUILDING,
            ));
            for z in [-0.22, 0.22] {
                let pot = front.point(DVec3::new(x, top + 0.7, -DEPTH * 0.4 + z));
                solids.push(pole(
                    pot,
                    DVec3::Z,
                    0.12,
                    0.45,
                    Material::Plain(self.tile),
                    part,
                    CLASS_BUILDING,
                ));
            }
        }
    }

    #[allow(clippy::too_many_arguments)]
    fn opening(
        &self,
        front: Pose,
        row: usize,
        index: usize,
        opening: Opening,
        solids: &mut Vec<Solid>,
        leaves: &mut Vec<Leaf>,
        random: &mut Random,
    ) {
        let part = self.part;
        let arcade = row == 0 && self.ground == Ground::Arcade;
        let at = |x: f64, y: f64, z: f64| {
            front.moved(DVec3::new(opening.sill.x + x, opening.sill.y + y, z))
        };
        let door = row == 0 && opening.sill.y < 0.5;
        let oak = DVec3::new(0.16, 0.075, 0.035);
        let frame = if door {
            oak
        } else {
            [DVec3::splat(0.72), DVec3::new(0.10, 0.17, 0.12), DVec3::new(0.30, 0.17, 0.09)]
                [part as usize % 3]
        };
        let panes = if door {
            (2, 3)
        } else if row == 0 {
            (3, 2)
        } else {
            (2, 3)
        };
        let window = Material::Window {
            trim: self.trim * 0.92,
            frame,
            panes,
            salt: self.salt() + index as u64,
        };
        let depth = if arcade { WALL_M } else { 0.30 };
        solids.push(solid(
            at(0.0, 0.0, 0.0),
            Shape::Recess(Recess::new(opening, depth, !arcade)),
            window,
            part,
            CLASS_BUILDING,
        ));
        let stone = Material::Masonry {
            wall: Wall::Plaster,
            color: self.trim,
            salt: self.salt() + index as u64,
        };
        if !door && !arcade {
            solids.push(cuboid(
                at(0.0, -0.06, 0.03),
                [opening.half_width + 0.20, 0.055, 0.15],
                stone,
                part,
                CLASS_BUILDING,
            ));
        }
        if row > 0 && !opening.arched {
            solids.push(cuboid(
                at(0.0, opening.height + 0.22, 0.0),
                [opening.half_width + 0.22, 0.07, 0.14],
                stone,
                part,
                CLASS_BUILDING,
            ));
        }
        if arcade || (row > 0 && opening.arched) {
            // A keystone.
            let rise = opening.height + opening.half_width;
            solids.push(cuboid(
                at(0.0, rise + 0.10, 0.0),
                [0.12, 0.20, 0.09],
                stone,
                part,
                CLASS_BUILDING,
            ));
        }
        if let (Some(color), true) = (self.shutters, row > 0) {
            for side in [-1.0, 1.0] {
                let pose = at(side * (opening.half_width * 1.5 + 0.02), opening.height / 2.0, 0.03);
                solids.push(cuboid(
                    pose,
                    [opening.half_width * 0.47, opening.height / 2.0, 0.025],
                    Material::Plain(color),
                    part,
                    CLASS_BUILDING,
                ));
                for slat in 0..8 {
                    let pose = pose.moved(DVec3::new(
                        0.0,
                        opening.height * (slat as f64 / 8.0 - 0.44),
                        0.025,
                    ));
                    solids.push(cuboid(
                        pose,
                        [opening.half_width * 0.40, 0.05, 0.014],
                        Material::Plain(color * 0.8),
                        part,
                        CLASS_BUILDING,
                    ));
                }
            }
        }
        if row > 0 && random.unit() < 0.30 && !self.balcony {
            let clay = Material::Plain(DVec3::new(0.36, 0.15, 0.08));
            solids.push(cuboid(
                at(0.0, 0.10, 0.16),
                [opening.half_width * 0.85, 0.10, 0.11],
                clay,
                part,
                CLASS_BUILDING,
            ));
            let bloom = [
                DVec3::new(0.70, 0.05, 0.06),
                DVec3::new(0.72, 0.20, 0.38),
                DVec3::new(0.75, 0.50, 0.08),
            ][random.below(3)];
            for i in 0..70 {
                let x = random.between(-0.9, 0.9) * opening.half_width;
                let (y, z) = (random.between(0.12, 0.42), 0.16 + random.between(-0.13, 0.20));
                let normal = (front.z
                    + front.y * random.between(-0.2, 1.2)
                    + front.x * random.normal() * 0.6)
                    .normalize();
                let albedo = if i % 3 == 0 { bloom } else { DVec3::new(0.10, 0.21, 0.05) };
                leaves.push(Leaf {
                    centre: at(x, y, z).origin,
                    normal,
                    radius: random.between(0.035, 0.07),
                    albedo,
                    part,
                });
            }
        }
        if row == 0 && self.ground == Ground::Shop && !door {
            let slope = (front.z * 0.80 - front.y * 0.60).normalize();
            let origin = front.point(DVec3::new(
                opening.sill.x - opening.half_width - 0.1,
                opening.top() + 0.45,
                0.05,
            ));
            let pose = Pose { origin, x: front.x, y: slope, z: front.x.cross(slope) };
            let colors = [
                DVec3::new(0.74, 0.70, 0.62),
                [
                    DVec3::new(0.55, 0.06, 0.05),
                    DVec3::new(0.05, 0.22, 0.16),
                    DVec3::new(0.07, 0.12, 0.34),
                ][part as usize % 3],
            ];
            let cloth = Panel {
                size: DVec2::new(opening.half_width * 2.0 + 0.2, 1.35),
                gable: 0.0,
                openings: None,
            };
            solids.push(solid(
                pose,
                Shape::Panel(cloth),
                Material::Stripes { colors, width: 0.22 },
                part,
                CLASS_FURNITURE,
            ));
        }
    }

    /// Behind the arches: their inner face, a ceiling, and a wall with shop windows.
    fn gallery(&self, front: Pose, arches: &Openings, solids: &mut Vec<Solid>) {
        let (part, w, depth) = (self.part, self.width, 3.4);
        let plaster = Material::Masonry {
            wall: Wall::Plaster,
            color: DVec3::new(0.66, 0.58, 0.46),
            salt: self.salt(),
        };
        let mut push = |pose: Pose, shape: Shape, material: Material| {
            solids.push(solid(pose, shape, material, part, CLASS_BUILDING))
        };
        let sheet = |height: f64, openings: Option<Openings>| {
            Shape::Panel(Panel {
                size: DVec2::new(w, height),
                gable: 0.0,
                openings: openings.map(Box::new),
            })
        };
        let rows = vec![arches.rows[0]];
        let inner = Openings { rows, cells: arches.cells[..self.bays].to_vec(), ..arches.clone() };
        push(
            front.moved(DVec3::new(0.0, 0.0, -WALL_M)),
            sheet(GROUND_M - 0.2, Some(inner)),
            plaster,
        );
        let ceiling = Pose {
            origin: front.point(DVec3::new(0.0, GROUND_M - 0.2, -WALL_M - depth)),
            x: front.x,
            y: front.z,
            z: -front.y,
        };
        push(ceiling, sheet(depth, None), plaster);
        let floor =
            Pose { origin: front.point(DVec3::new(0.0, 0.131, -WALL_M - depth)), ..ceiling };
        push(floor, sheet(depth + WALL_M, None), Material::Paving);
        let back = front.moved(DVec3::new(0.0, 0.0, -WALL_M - depth));
        let pitch = arches.pitch;
        let shop = |column: usize| Opening {
            sill: DVec2::new(pitch * (column as f64 + 0.5), 0.55),
            half_width: pitch * 0.34,
            height: 2.5,
            arched: false,
        };
        let cells: Vec<_> = (0..self.bays).map(|c| Some(shop(c))).collect();
        for (index, opening) in cells.iter().flatten().enumerate() {
            let window = Material::Window {
                trim: self.trim * 0.8,
                frame: DVec3::new(0.14, 0.07, 0.035),
                panes: (3, 2),
                salt: self.salt() + 50 + index as u64,
            };
            let pose = back.moved(opening.sill.extend(0.0));
            push(pose, Shape::Recess(Recess::new(*opening, 0.25, true)), window);
        }
        push(
            back,
            sheet(
                GROUND_M,
                Some(Openings { left: 0.0, pitch, columns: self.bays, rows: vec![0.0], cells }),
            ),
            plaster,
        );
    }

    fn balcony(&self, front: Pose, solids: &mut Vec<Solid>) {
        let (part, half) = (self.part, self.width * 0.30);
        let at = |x: f64, y: f64, z: f64| {
            front.moved(DVec3::new(self.width / 2.0 + x, GROUND_M + 0.5 + y, z))
        };
        let stone = Material::Masonry { wall: Wall::Plaster, color: self.trim, salt: self.salt() };
        let iron = Material::Plain(DVec3::splat(0.03));
        let mut bar = |pose: Pose, half: [f64; 3], material: Material| {
            solids.push(cuboid(pose, half, material, part, CLASS_BUILDING))
        };
        bar(at(0.0, 0.0, 0.5), [half, 0.08, 0.5], stone);
        for x in [-half + 0.3, half - 0.3] {
            bar(at(x, -0.25, 0.3), [0.10, 0.20, 0.28], stone);
        }
        bar(at(0.0, 1.0, 0.95), [half, 0.025, 0.03], iron);
        bar(at(0.0, 0.16, 0.95), [half, 0.015, 0.02], iron);
        let count = (half * 2.0 / 0.13) as i32;
        for k in 0..=count {
            let x = -half + 2.0 * half * k as f64 / count as f64;
            solids.push(pole(
                at(x, 0.05, 0.95).origin,
                front.y,
                0.012,
                0.95,
                iron,
                part,
                CLASS_BUILDING,
            ));
        }
    }

    fn dormer(&self, middle: Pose, solids: &mut Vec<Solid>) {
        let part = self.part;
        let (half, height) = (0.72, 1.45);
        let opening =
            Opening { sill: DVec2::new(half, 0.25), half_width: 0.45, height: 0.55, arched: true };
        let openings = Openings {
            left: 0.0,
            pitch: 2.0 * half,
            columns: 1,
            rows: vec![0.0],
            cells: vec![Some(opening)],
        };
        let panel = Panel {
            size: DVec2::new(2.0 * half, height),
            gable: 0.55,
            openings: Some(Box::new(openings)),
        };
        let left = middle.moved(DVec3::new(-half, 0.0, 0.0));
        let plaster =
            Material::Masonry { wall: Wall::Plaster, color: self.trim, salt: self.salt() };
        solids.push(solid(left, Shape::Panel(panel), plaster, part, CLASS_BUILDING));
        let window = Material::Window {
            trim: self.trim,
            frame: DVec3::splat(0.66),
            panes: (2, 2),
            salt: self.salt() + 90,
        };
        solids.push(solid(
            left.moved(opening.sill.extend(0.0)),
            Shape::Recess(Recess::new(opening, 0.2, true)),
            window,
            part,
            CLASS_BUILDING,
        ));
        for side in [-half, half] {
            solids.push(cuboid(
                middle.moved(DVec3::new(side, height / 2.0, -1.4)),
                [0.05, height / 2.0, 1.4],
                plaster,
                part,
                CLASS_BUILDING,
            ));
        }
        // Ridge away from the street.
        let top = Pose {
            origin: middle.point(DVec3::new(0.0, height, -1.3)),
            x: middle.z,
            y: middle.x,
            z: middle.y,
        };
        solids.push(solid(
            top,
            roof(1.5, half + 0.15, 0.65, 0.0),
            Material::Tiles { color: self.tile, salt: self.salt() },
            part,
            CLASS_BUILDING,
        ));
    }
}
