//! Analytic scenes and simulated scanners: point clouds whose truth is known, and the demo's
//! picture.
//!
//! ```text
//!     scene, seed -> World (primitives in a BVH) -> scanner -> chunks of points -> LAS or LAZ file
//!                         \-> trace(ray): the truth, in f64, for every study
//! ```
//!
//! Everything is a function of the scene and the seed; threads, machines' load and the day change
//! no byte.

use strum::{EnumString, IntoStaticStr, VariantArray};

pub mod bvh;
pub mod chunk;
mod collect;
pub mod las_file;
pub mod noise;
pub mod shapes;
pub mod world;

mod airborne;
mod area;
mod facade;
mod light;
mod material;
mod panel;
mod props;
mod scanner;
mod simple;
mod street;
mod terrain;
mod terrestrial;
mod torus;

pub use chunk::{Chunk, Lattice};
pub use collect::collect;
pub use las_file::LasFile;
pub use scanner::scan;
pub use terrain::Relief;
pub use terrestrial::reaches;
pub use world::{Hit, Method, Station, Viewpoint, World};

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[derive(EnumString, IntoStaticStr, VariantArray)]
#[strum(serialize_all = "kebab-case")]
pub enum SceneKind {
    /// 4 m x 4 m at z = 0
    Plane,
    /// radius 1 m
    Sphere,
    /// major radius 1 m, minor 0.4 m
    Torus,
    /// three rings inside each other (Dobrev 2010, figure 17): six layers
    NestedTori,
    /// two parallel layers, `--gap` metres apart, the upper one over half of the lower
    Step,
    /// houses, arcade, trees, cars and a bridge, scanned from several stations
    Street,
    /// hills with a village and woods, scanned from the air in overlapping strips
    Terrain,
}

impl SceneKind {
    /// Standard deviation of the range unless the user says otherwise, metres.
    pub fn default_noise(self) -> f64 {
        match self {
            SceneKind::Street => 0.002,
            SceneKind::Terrain => 0.015,
            _ => 0.0,
        }
    }
}

/// The scene itself. `gap` is the distance between the layers of `step`, metres.
pub fn build(scene: SceneKind, seed: u64, gap: f64) -> World {
    match scene {
        SceneKind::Plane => simple::plane(),
        SceneKind::Sphere => simple::sphere(),
        SceneKind::Torus => simple::torus(),
        SceneKind::NestedTori => simple::nested_tori(),
        SceneKind::Step => simple::step(gap),
        SceneKind::Street => street::build(seed),
        SceneKind::Terrain => terrain::build(seed),
    }
}
