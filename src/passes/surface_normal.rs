//! Computes world normals of the visible surface from depth. The pass is dropped if nothing reads
//! them.

use super::GBuffer;
use crate::graph::{Dispatch, Graph, Image, Kind};
use crate::shader::{self, surface_normal::Push, surface_normal::Spec};
use crate::view::{Projection, View};

pub fn record(g: &mut Graph, view: &View, gbuffer: &GBuffer) -> Image {
    let mut normal = g.image("normal", view.size, Kind::Rgba32f);
    let axis = |axis: glam::DVec3| axis.as_vec3().to_array();
    let push = Push {
        size: view.size,
        centre: view.centre().map(|at| at as f32),
        px_per_unit: view.focal_px() as f32,
        right: axis(view.basis.right),
        up: axis(view.basis.up),
        forward: axis(view.basis.forward),
    };
    let spec = Spec { perspective: view.camera.projection == Projection::Perspective };
    g.run(
        shader::SurfaceNormal { depth: &gbuffer.depth, normal: &mut normal, push, spec },
        Dispatch::PerPixel,
    );
    normal
}
