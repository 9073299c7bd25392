//! Draws a cloud and returns all layers, on one validated device per process and projection path.

use crate::cameras::{orthographic, perspective};
use crate::points::{Random, bumpy};
use glam::DVec3;
use pointillist::cloud::attribute::{Attribute, DisplayAttribute};
use pointillist::cloud::{Cloud, Columns, Header, Lattice, Part};
use pointillist::config::NO_POINT;
use pointillist::gpu::{Device, DeviceOptions, TestOverrides};
use pointillist::graph::{Buffer, CompletedSubmission, Gpu, Graph};
use pointillist::index::format::scatter::{Clump, POINTS_PER_CLUMP, SCATTERED};
use pointillist::passes;
use pointillist::passes::project::{Keys, Strip};
use pointillist::passes::{
    EFFECTS, Effects, FrameContext, Switch, antialias, ao, composite, fill, phong, resolve,
    scattered, shape, smooth, splat, visibility,
};
use pointillist::progress::Silent;
use pointillist::render::frame;
use pointillist::render::settings::{FrameConfig, RenderSettings};
use pointillist::resident::{Resident, ResidentNode};
use pointillist::view::View;
use pointillist::view::light::Light;
use std::sync::{Mutex, OnceLock};

/// Projection paths.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Way {
    Compute64,
    Compute32,
    /// `Compute64` on a device whose memory the CPU cannot map.
    Unmapped,
    /// `Compute64` on a device whose texel buffers are small.
    Words,
}

pub const WAYS: [Way; 2] = [Way::Compute64, Way::Compute32];

/// Runs `work` on the process's device. The test fails without a Vulkan device or its validation
/// layers.
pub fn with<T>(way: Way, work: impl FnOnce(&mut Gpu) -> T) -> T {
    static DEVICES: [OnceLock<Mutex<Gpu>>; 4] = [const { OnceLock::new() }; 4];
    let options = DeviceOptions {
        validate: true,
        overrides: TestOverrides {
            no_int64_atomics: way == Way::Compute32,
            unmapped: way == Way::Unmapped,
            no_texels: way == Way::Words,
            ..TestOverrides::default()
        },
        ..DeviceOptions::default()
    };
    let device = DEVICES[way as usize].get_or_init(|| {
        Mutex::new(
            Gpu::open(&options).expect("tests need a Vulkan 1.3 device with validation layers"),
        )
    });
    // A test that failed while holding the device left no work in flight: submissions are waited
    // for.
    work(&mut device.lock().unwrap_or_else(|poisoned| poisoned.into_inner()))
}

/// Returns the largest relative error of a division in a shader. Software devices round correctly;
/// Vulkan grants others 2.5 ulp ("Precision of Individual Operations").
pub fn division_error(device: &Device) -> f32 {
    if device.is_cpu { 0.0 } else { 2.5 * f32::EPSILON }
}

/// All outputs of a frame.
#[derive(Clone, Debug)]
pub struct Layers {
    pub depth: Vec<f32>,
    pub index: Vec<u32>,
    pub color: Vec<[f32; 4]>,
    pub picture: Vec<[f32; 4]>,
    pub nodes: Vec<ResidentNode>,
}

impl Layers {
    /// Returns bits, so that NaN equals itself and -0 differs from 0.
    pub fn bits(&self) -> (Vec<u32>, &[u32], &[u32], &[u32]) {
        (
            self.depth.iter().map(|z| z.to_bits()).collect(),
            &self.index,
            bytes(&self.color),
            bytes(&self.picture),
        )
    }

    /// Checks that all is finite, except depth where nothing is.
    pub fn assert_finite(&self) {
        let wild = |word: &&u32| **word & 0x7F80_0000 == 0x7F80_0000;
        assert_eq!(
            bytes(&self.color).iter().chain(bytes(&self.picture)).filter(wild).count(),
            0,
            "NaN or infinite colours"
        );
        let depths = self.depth.iter().zip(&self.index);
        assert_eq!(
            depths
                .filter(|&(z, &id)| !z.is_finite() && (id != u32::MAX || *z != f32::INFINITY))
                .count(),
            0,
            "NaN or infinite depths"
        );
    }
}

fn bytes(colors: &[[f32; 4]]) -> &[u32] {
    bytemuck::cast_slice(colors)
}

/// Returns settings without effects: points as they are projected.
pub fn bare() -> RenderSettings {
    RenderSettings { effects: nothing(), ..RenderSettings::default() }
}

pub fn draw(way: Way, cloud: &Cloud, view: &View, settings: &RenderSettings) -> Layers {
    with(way, |gpu| {
        let strokes = settings.effects.strokes.switch == Switch::On;
        let resident = upload(gpu, cloud, strokes);
        draw_resident(gpu, &resident, view, settings)
    })
}

/// Brings a cloud to the device, with its strokes if asked for.
pub fn upload(gpu: &mut Gpu, cloud: &Cloud, strokes: bool) -> Resident {
    let (mut shown, _) = DisplayAttribute::automatic(cloud);
    shown.further.strokes = strokes;
    Resident::fill(gpu, cloud.clone(), shown, &Silent).expect("resident")
}

pub fn draw_resident(
    gpu: &mut Gpu,
    resident: &Resident,
    view: &View,
    settings: &RenderSettings,
) -> Layers {
    let config = FrameConfig::new(settings, view, resident);
    let mut g = Graph::new(gpu);
    let outcome = frame::record(&mut g, view, resident, &config).expect("recorded");
    let images =
        [&outcome.gbuffer.depth, &outcome.gbuffer.index, &outcome.gbuffer.color, &outcome.picture];
    let [depth, index, color, picture] = images.map(|image| g.download(image));
    let frame = g.submit_and_wait(&[]).expect("drawn, and no validation message");

    Layers {
        depth: frame.read(&depth).to_vec(),
        index: frame.read(&index).to_vec(),
        color: frame.read(&color).to_vec(),
        picture: frame.read(&picture).to_vec(),
        nodes: resident.nodes.clone(),
    }
}

/// Points that the keys of a [`Canvas`] may refer to.
pub const CANVAS_POINTS: u32 = 2000;

/// The device, and points of random colours: passes run on given keys.
pub struct Canvas<'g> {
    gpu: &'g mut Gpu,
    resident: Resident,
    /// Light of every pixel by its colour.
    pub reached: bool,
    /// Edges of the picture beyond which surfaces continue: left, right, upper, lower.
    pub crossed: [bool; 4],
}

pub fn canvas<T>(work: impl FnOnce(&mut Canvas) -> T) -> T {
    canvas_on(Way::Compute64, work)
}

pub fn canvas_on<T>(way: Way, work: impl FnOnce(&mut Canvas) -> T) -> T {
    with(way, |gpu| {
        let (points, colors) = bumpy(CANVAS_POINTS as usize, 20_000, &mut Random(0xCA75));
        let cloud = cloud(vec![part(
            Lattice { step: DVec3::splat(0.001), offset: DVec3::ZERO },
            &points,
            Some(colors),
        )]);
        let shown = DisplayAttribute::new(Attribute::Rgb, &cloud);
        let resident = Resident::fill(gpu, cloud, shown, &Silent).expect("resident");
        let mut canvas = Canvas { gpu, resident, reached: false, crossed: [true; 4] };
        work(&mut canvas)
    })
}

/// Layers after a pass, as bits.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Stage {
    pub depth: Vec<f32>,
    pub index: Vec<u32>,
    pub color: Vec<[f32; 4]>,
    /// Share of the light that reaches it, if present.
    pub reached: Vec<[f32; 4]>,
}

/// Results of given keys; `None` if the effect is off.
#[derive(Default)]
pub struct Surface {
    pub raw: Stage,
    pub seen: Stage,
    pub splats: Stage,
    pub filled: Stage,
    pub smoothed: Stage,
    /// After Phong lighting.
    pub shaded: Stage,
    pub blended: Stage,
    pub lit: Vec<f32>,
    /// Light after ambient occlusion and blending.
    pub left: Vec<f32>,
    pub picture: Vec<[f32; 4]>,
}

impl Canvas<'_> {
    /// Point spacing [m], equal for all points of the one node.
    pub fn spacing(&self) -> f64 {
        assert_eq!(self.resident.nodes.len(), 1);
        self.resident.nodes[0].spacing()
    }

    /// Spacing [m] of the splat of a point.
    pub fn splat_spacing(&self, id: u32) -> f64 {
        let node = &self.resident.nodes[0];
        let clump = node.clumps.get(id as usize / POINTS_PER_CLUMP);
        clump.map_or(0.0, |clump| clump.covered() * clump.spacing.min(node.spacing()))
    }

    /// Lets the points of every other clump lie on no surface.
    pub fn scatter(&mut self) -> &[ResidentNode] {
        let node = &mut self.resident.nodes[0];
        let scattered = |(k, clump): (usize, &Clump)| {
            let mut clump = *clump;
            clump.scatter = if k % 2 == 0 { 2.0 * SCATTERED } else { 0.0 };
            clump
        };
        node.clumps = node.clumps.iter().enumerate().map(scattered).collect();
        &self.resident.nodes
    }

    pub fn draw(&mut self, view: &View, keys: &[[u32; 2]], effects: &Effects) -> Surface {
        self.draw_in(Light::default(), view, keys, effects)
    }

    pub fn draw_in(
        &mut self,
        light: Light,
        view: &View,
        keys: &[[u32; 2]],
        effects: &Effects,
    ) -> Surface {
        let mut scene = FrameContext::of(view, &self.resident, light);
        scene.sampling.crossed = self.crossed;
        let mut g = Graph::new(self.gpu);
        let uploaded = g.upload("keys", keys).unwrap();
        let paint = resolve::paint(&mut g, &self.resident, &Default::default()).unwrap();
        let resolved = resolve::begin(&mut g, view);
        let resolved = resolve::record(
            &mut g,
            &Keys::nearest(uploaded),
            &paint,
            Strip { top: 0, size: view.size },
            resolved,
        );
        let mut gbuffer = resolved.gbuffer(&mut g, view, &self.resident).unwrap();
        // Depths come from keys here, and are arbitrary.
        gbuffer.spacing_px = [0.0, f64::INFINITY];
        gbuffer.shadow_factor = self.reached.then(|| g.copy("reached", &gbuffer.color));
        let raw = keep(&mut g, &gbuffer);
        let (mut seen, mut splats, mut filled, mut smoothed, mut shaded, mut blended) =
            (None, None, None, None, None, None);
        if effects.scattered.switch != Switch::Off {
            gbuffer = scattered::record(&mut g, &scene, &effects.scattered.settings, gbuffer);
        }
        if effects.visibility.switch != Switch::Off {
            gbuffer = visibility::record(&mut g, &scene, &effects.visibility.settings, gbuffer);
            seen = Some(keep(&mut g, &gbuffer));
        }
        if effects.fill.switch != Switch::Off {
            gbuffer = fill::record(&mut g, &scene, &effects.fill.settings, gbuffer);
            filled = Some(keep(&mut g, &gbuffer));
        }
        if effects.splat.switch != Switch::Off {
            gbuffer = splat::record(&mut g, &scene, &effects.splat.settings, gbuffer);
            splats = Some(keep(&mut g, &gbuffer));
        }
        if effects.smooth.switch != Switch::Off {
            gbuffer = smooth::record(&mut g, &scene, &effects.smooth.settings, gbuffer);
            smoothed = Some(keep(&mut g, &gbuffer));
        }
        if effects.shape.switch != Switch::Off {
            gbuffer = shape::record(&mut g, &scene, &effects.shape.settings, gbuffer);
        }
        if effects.phong.switch != Switch::Off {
            gbuffer = phong::record(&mut g, &scene, &effects.phong.settings, gbuffer);
            shaded = Some(keep(&mut g, &gbuffer));
        }
        let lit = gbuffer.shading.as_ref().map(|lit| g.download(lit));
        if effects.ao.switch != Switch::Off {
            gbuffer = ao::record(&mut g, &scene, &effects.ao.settings, gbuffer);
        }
        if effects.antialias.switch != Switch::Off {
            gbuffer = antialias::record(&mut g, &scene, &effects.antialias.settings, gbuffer);
            blended = Some(keep(&mut g, &gbuffer));
        }
        let left = gbuffer.shading.as_ref().map(|left| g.download(left));
        let picture = composite::record(&mut g, view, [0.1, 0.2, 0.7], &gbuffer);
        let picture = g.download(&picture);
        let frame = g.submit_and_wait(&[]).expect("drawn, and no validation message");
        let stage = |kept: Option<Kept>| kept.map_or(Stage::default(), |kept| read(&frame, &kept));

        Surface {
            raw: stage(Some(raw)),
            seen: stage(seen),
            splats: stage(splats),
            filled: stage(filled),
            smoothed: stage(smoothed),
            shaded: stage(shaded),
            blended: stage(blended),
            lit: lit.map_or(Vec::new(), |lit| frame.read(&lit).to_vec()),
            left: left.map_or(Vec::new(), |left| frame.read(&left).to_vec()),
            picture: frame.read(&picture).to_vec(),
        }
    }
}

/// Outputs of a stage.
type Kept = ([Buffer; 3], Option<Buffer>);

fn keep(g: &mut Graph, gbuffer: &passes::GBuffer) -> Kept {
    let images = [&gbuffer.depth, &gbuffer.index, &gbuffer.color].map(|image| g.download(image));
    (images, gbuffer.shadow_factor.as_ref().map(|image| g.download(image)))
}

fn read(frame: &CompletedSubmission, ([depth, index, color], reached): &Kept) -> Stage {
    Stage {
        depth: frame.read(depth).to_vec(),
        index: frame.read(index).to_vec(),
        color: frame.read(color).to_vec(),
        reached: reached.as_ref().map_or(Vec::new(), |reached| frame.read(reached).to_vec()),
    }
}

pub fn part(lattice: Lattice, points: &[[i32; 3]], rgb: Option<Vec<[u8; 3]>>) -> Part {
    let column = |axis: usize| points.iter().map(|p| p[axis]).collect();
    let columns = Columns { x: column(0), y: column(1), z: column(2), rgb, ..Columns::default() };
    Part {
        path: "memory".into(),
        name: None,
        header: Header::default(),
        lattice,
        columns,
        intensity_range: [0.0, 65535.0],
        rgb_scale: Default::default(),
    }
}

pub fn cloud(parts: Vec<Part>) -> Cloud {
    Cloud { parts, ..Cloud::default() }
}

/// Returns keys with a third of the pixels empty, the others at depths from a millimetre to a
/// megametre: half in steps of ten, half smooth.
pub fn random_keys(size: [u32; 2], points: u32, random: &mut Random) -> Vec<[u32; 2]> {
    let key = |_| {
        let depth = match random.bits() % 6 {
            0 | 1 => return [NO_POINT; 2],
            2 | 3 => 10f64.powi(random.within(-3.0, 6.0) as i32),
            _ => random.within(4.9, 5.1),
        };
        [(random.bits() % points as u64) as u32, (depth as f32).to_bits()]
    };
    (0..size[0] * size[1]).map(key).collect()
}

/// Returns views with a wide angle, so that rays diverge, and ten pixels per metre.
pub fn views(size: [u32; 2]) -> [View; 2] {
    let height = size[1] as f64 / 10.0;
    [perspective(DVec3::ZERO, DVec3::Y, 75.0), orthographic(DVec3::ZERO, DVec3::Y, height)]
        .map(|camera| View::new(camera, size).unwrap())
}

/// Returns effects that are all off.
pub fn nothing() -> Effects {
    let mut effects = Effects::default();
    EFFECTS.iter().for_each(|effect| effects.set_any(&format!("{effect}=off")).unwrap());
    effects
}

/// Returns these effects alone, written as on the command line.
pub fn effects(asked: &[&str]) -> Effects {
    let mut effects = nothing();
    asked.iter().for_each(|asked| effects.set_any(asked).unwrap());
    effects
}
