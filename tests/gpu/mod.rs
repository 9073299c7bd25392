//! A cloud and a view in, all layers out, on one validated device a process and way of projecting.

#![allow(dead_code, reason = "every test file is a crate of its own and uses a part of this")]

use glam::DVec3;
use pointillist::cloud::attribute::Shown;
use pointillist::cloud::{Cloud, Columns, Header, Lattice, Part};
use pointillist::frame;
use pointillist::gpu::Wish;
use pointillist::graph::{Gpu, Graph};
use pointillist::look::{self, Wishes};
use pointillist::passes::{Scene, project::Statistics};
use pointillist::progress::Silent;
use pointillist::resident::{Resident, ResidentNode};
use pointillist::view::{Camera, Projection, View};
use std::sync::{Mutex, OnceLock};

/// How keys are made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Way {
    Compute64,
    Compute32,
}

pub const WAYS: [Way; 2] = [Way::Compute64, Way::Compute32];

/// Runs `work` on the process's device. Without a Vulkan device, or without its validation layers, the test fails.
pub fn with<T>(way: Way, work: impl FnOnce(&mut Gpu) -> T) -> T {
    static DEVICES: [OnceLock<Mutex<Gpu>>; 2] = [const { OnceLock::new() }; 2];
    let wish = Wish { validate: true, no_int64_atomics: way == Way::Compute32, ..Wish::default() };
    let device =
        DEVICES[way as usize].get_or_init(|| Mutex::new(Gpu::open(&wish).expect("tests need a Vulkan 1.3 device with validation layers")));
    // A test that failed while holding the device left nothing half done on it: submissions are waited for.
    work(&mut device.lock().unwrap_or_else(|poisoned| poisoned.into_inner()))
}

/// All that a frame leaves behind.
#[derive(Clone, Debug)]
pub struct Layers {
    pub depth: Vec<f32>,
    pub index: Vec<u32>,
    pub color: Vec<[f32; 4]>,
    pub picture: Vec<[f32; 4]>,
    pub nodes: Vec<ResidentNode>,
    pub statistics: Statistics,
}

impl Layers {
    /// As bits, so that NaN equals itself and -0 differs from 0.
    pub fn bits(&self) -> (Vec<u32>, &[u32], &[u32], &[u32]) {
        (self.depth.iter().map(|z| z.to_bits()).collect(), &self.index, bytes(&self.color), bytes(&self.picture))
    }

    /// HARD_CASES 0.5, for what may hold no infinity; depth may, where nothing is.
    pub fn assert_finite(&self) {
        let wild = |word: &&u32| **word & 0x7F80_0000 == 0x7F80_0000;
        assert_eq!(bytes(&self.color).iter().chain(bytes(&self.picture)).filter(wild).count(), 0, "NaN or infinite colours");
        let depths = self.depth.iter().zip(&self.index);
        assert_eq!(
            depths.filter(|&(z, &id)| !z.is_finite() && (id != u32::MAX || *z != f32::INFINITY)).count(),
            0,
            "NaN or infinite depths"
        );
    }
}

fn bytes(colors: &[[f32; 4]]) -> &[u32] {
    bytemuck::cast_slice(colors)
}

pub fn draw(way: Way, cloud: &Cloud, view: &View, wishes: &Wishes) -> Layers {
    with(way, |gpu| {
        let (shown, _) = Shown::automatic(cloud);
        let resident = Resident::fill(gpu, cloud.clone(), shown, &Silent).expect("resident");
        let look = look::decide(wishes, &Scene { view, points: resident.points });
        let mut g = Graph::new(gpu);
        let outcome = frame::record(&mut g, view, &resident, &look).expect("recorded");
        let images = [&outcome.layers.depth, &outcome.layers.index, &outcome.layers.color, &outcome.picture];
        let [depth, index, color, picture] = images.map(|image| g.download(image));
        let frame = g.submit(&[]).expect("drawn, and no validation message");
        let layers = Layers {
            depth: frame.read(&depth).to_vec(),
            index: frame.read(&index).to_vec(),
            color: frame.read(&color).to_vec(),
            picture: frame.read(&picture).to_vec(),
            nodes: resident.nodes.clone(),
            statistics: outcome.statistics,
        };
        frame.shelve(gpu);
        resident.free(gpu);
        layers
    })
}

/// xorshift64 (Marsaglia 2003): tests need variety and the same numbers every time.
pub struct Random(pub u64);

impl Random {
    pub fn bits(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0
    }

    /// Uniform in lo..hi.
    pub fn within(&mut self, lo: f64, hi: f64) -> f64 {
        lo + (hi - lo) * (self.bits() >> 11) as f64 / (1u64 << 53) as f64
    }
}

pub fn part(lattice: Lattice, points: &[[i32; 3]], rgb: Option<Vec<[u8; 3]>>) -> Part {
    let column = |axis: usize| points.iter().map(|p| p[axis]).collect();
    let columns = Columns { x: column(0), y: column(1), z: column(2), rgb, ..Columns::default() };
    Part { path: "memory".into(), name: None, header: Header::default(), lattice, columns, intensity_range: [0.0, 65535.0], rgb_bits: 8 }
}

pub fn cloud(parts: Vec<Part>) -> Cloud {
    Cloud { parts, ..Cloud::default() }
}

/// `count` coloured points on bumpy surfaces in a cube of `width` steps around the lattice's origin.
pub fn bumpy(count: usize, width: i32, random: &mut Random) -> (Vec<[i32; 3]>, Vec<[u8; 3]>) {
    let half = width as f64 / 2.0;
    let point = |random: &mut Random| {
        let (u, v) = (random.within(-1.0, 1.0), random.within(-1.0, 1.0));
        let layer = (random.bits() % 3) as f64 * 0.4 - 0.4;
        let z = layer + 0.1 * (5.0 * u).sin() * (7.0 * v).cos() + random.within(-0.002, 0.002);
        [u, v, z].map(|c| (c * half) as i32)
    };
    let points: Vec<_> = (0..count).map(|_| point(random)).collect();
    let colors = points.iter().map(|_| random.bits().to_le_bytes()).map(|b| [b[0] | 1, b[1], b[2]]).collect();
    (points, colors)
}

pub fn perspective(eye: DVec3, target: DVec3, fov_y: f64) -> Camera {
    Camera { eye, target, up: DVec3::Z, fov_y, projection: Projection::Perspective, ortho_height: None }
}

pub fn orthographic(eye: DVec3, target: DVec3, height: f64) -> Camera {
    Camera { projection: Projection::Orthographic, ortho_height: Some(height), ..perspective(eye, target, 60.0) }
}
