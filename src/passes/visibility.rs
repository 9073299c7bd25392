//! Visibility: depths of projected points in, the same without hidden layers out, and which pixels have to be filled (Pintus et al. 2011, sec. 4).
//!
//! ```text
//!     classify     depth -> tiles           what each tile of 8 x 8 pixels holds
//!     gaps         tiles -> gaps            how far apart points are where a tile, or two by two of them, lie within a surface
//!     assign       tiles, gaps -> lists     which tiles have to be looked at, and how far around: a list a kernel
//!     pack_depth   depth -> the same in the form that kernels read; only where a tile is listed
//!     visibility   depth, lists -> a bit a pixel, and the list of tiles with invisible pixels; once a kernel
//!     hide         takes those pixels out of the layers
//! ```
//! A tile is skipped where nothing in it can be invisible. Let no two adjacent pixels of it and its neighbours differ in depth by more than `slope` pixels' width. The cotangent of the angle to a
//! neighbour is then at most `sqrt(2) slope r.r` plus a part by which the ray leans, `r.r` = 1 + lean^2; leaning lowers one sector's solid angle and raises the opposite one's by at least as much, but
//! for the spread of directions within a sector, less than 0.71 lean; `lead` only opens cones. So the sum of solid angles is at least 2 pi (1 - cos) at that cotangent, and `slope` is where that is `threshold`.

use super::{BLOCK_PX, Decided, Effects, Holes, LIST_HEADER, Layers, Reason, Scene, Setting, Switch, TILE_PX, Value, fill, significant, tiles};
use crate::graph::{Graph, Kind, Tiles};
use crate::shader::{self, Tile, assign, classify, gaps, hide, pack_depth, visibility};
use crate::view::{Projection, View};
use std::f64::consts::{SQRT_2, TAU};

pub const SUMMARY: &str = "removes hidden layers that shine through between points, and finds the holes, by the empty cone towards the camera";

#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Settings {
    /// Width of the neighbourhood, pixels, odd; 0: by the density of points, a tile at a time.
    pub kernel: f64,
    /// Width of an automatic kernel, in spacings of the points.
    pub reach: f64,
    /// Into which the neighbourhood is divided: 4, 8 or 16.
    pub sectors: f64,
    /// A pixel without a point is background from so much on, steradians: less than one sector's share demands that all are closed, and so keeps notches of silhouettes open.
    pub holes: f64,
    /// Which tiles are looked at.
    pub tiles: Looked,
    /// A pixel is visible from so much empty solid angle on, steradians.
    pub threshold: f64,
    /// How far in front of a point a neighbour at the rim of a wide kernel has to be to close a cone, pixels' width; what is nearer to the ray by as much less ([`own_slope`]). 0: any, as in the paper.
    pub lead: f64,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Looked {
    /// Those where something can be invisible.
    #[default]
    Needed,
    /// All; with a fixed kernel the picture is the same.
    All,
}

impl Default for Settings {
    fn default() -> Self {
        Settings { kernel: 0.0, reach: 5.5, sectors: 8.0, tiles: Looked::Needed, threshold: 2.1, holes: 0.7, lead: 7.0 }
    }
}

impl super::Settings for Settings {
    fn list(&mut self) -> Vec<Setting<'_>> {
        let number = Value::Number;
        vec![
            Setting { name: "kernel", about: "width of the neighbourhood, pixels; 0: from the spacing of the points", value: Value::OneOf(&mut self.kernel, &[0.0, 3.0, 5.0, 7.0, 9.0, 11.0, 13.0, 15.0]) },
            Setting { name: "reach", about: "width of an automatic kernel, in spacings of the points", value: number(&mut self.reach, 0.0..=100.0) },
            Setting { name: "sectors", about: "parts of the neighbourhood", value: Value::OneOf(&mut self.sectors, &[4.0, 8.0, 16.0]) },
            Setting { name: "holes", about: "empty solid angle from which a pixel without a point is background, steradians", value: number(&mut self.holes, 0.0..=TAU) },
            Setting { name: "tiles", about: "which tiles are looked at; the picture is the same", value: Value::Choice(&mut self.tiles) },
            Setting { name: "threshold", about: "empty solid angle from which a pixel is visible, steradians", value: number(&mut self.threshold, 0.0..=TAU) },
            Setting { name: "lead", about: "how far in front of a point a neighbour at the rim of a wide kernel has to be to hide it, pixels' width; 0: any", value: number(&mut self.lead, 0.0..=1e9) },
        ]
    }

    /// Between points pixels become unknown.
    fn grows_px(&self, _spacing_px: f64) -> f64 {
        MARGIN_PX as f64
    }
}

/// Of automatic kernels, pixels: a list of tiles each, and then comes the list of tiles with holes. Those after the first `FINE` look at every second pixel. Every kernel is a pipeline, which software
/// devices take a fifth of a second to make.
pub const WIDTHS: [u32; 9] = [3, 5, 7, 9, 11, 15, 19, 23, 31];
const KERNELS: u32 = WIDTHS.len() as u32;
const FINE: u32 = 6;
/// Points of a tile and its neighbours are of one surface where none is farther behind the nearest, pixels' width: two tiles', so that slopes are.
pub const FRONT_PX: f64 = 16.0;
/// Where points are strewn it is the sparser ones that gaps are between: this times the mean spacing, which is what counting finds. With less, the back of the dragon shows through its sparse parts; with
/// more, nothing is gained there, and more of what truly shows between things is lost.
pub const SPARSER: f64 = 1.4;
/// What is counted is at most so many times the node's spacing: a few stray points are no surface. Of layers behind others it is not asked: they have gaps where those in front have taken points with them.
pub const SPARSEST: f64 = 2.0;
/// Of a point's own surface, towards the camera, as it is taken to be at most: 45 degrees. With more, surfaces a few pixels behind each other show through each other; with less, contours grow.
pub const STEEPEST: f64 = 1.0;
/// As in glsl/lib/tile.glsl.
const MARGIN_PX: u32 = 16;
/// By how much images are larger than the picture at most: whole tiles, and margins.
pub const BEYOND_PX: u32 = 2 * MARGIN_PX + TILE_PX;

/// As [`super::Effects::reach_px`]. Of the widest kernel; and which one it is, tiles decide with the blocks around theirs.
pub fn reach_px(_view: &View, settings: &Settings) -> Option<u32> {
    Some(settings.kernel.max(fill::WIDEST) as u32 / 2 + 1 + 2 * BLOCK_PX)
}

pub fn called_for(scene: &Scene, asked: &Effects, _before: &Decided) -> Reason {
    match scene.points {
        0 => Reason { runs: false, why: "there is nothing to hide".to_string() },
        _ if asked.fill.switch != Switch::Off && asked.fill.settings.method == fill::Method::Dobrev => beside_masks(scene),
        _ => Reason { runs: true, why: "points are sparse somewhere, and what lies behind shines through; tiles without gaps are skipped".to_string() },
    }
}

/// Before filling by masks.
fn beside_masks(scene: &Scene) -> Reason {
    let apart_px = (SPARSER * scene.sampling.spacing_px()).max(scene.sampling.apart_px);
    let runs = apart_px > fill::APART_PX;
    let why = match runs {
        true => format!("sparser points are {} pixels apart, and masks close gaps only between those up to {}", significant(apart_px), fill::APART_PX),
        false => "filling by masks hides what is occluded".to_string(),
    };
    Reason { runs, why }
}

pub fn record(g: &mut Graph, scene: &Scene, settings: &Settings, layers: Layers) -> Layers {
    let view = scene.view;
    let Layers { mut depth, mut index, mut color, .. } = layers;
    let across = tiles(view.size);
    let count = across[0] * across[1];
    let stride = LIST_HEADER + count;
    let perspective = view.camera.projection == Projection::Perspective;
    let px_per_unit = view.focal_px() as f32;

    let mut facts = g.buffer("tiles", std::mem::size_of::<Tile>() as u64 * count as u64);
    let push = classify::Push { size: view.size, tiles: across, px_per_unit, slope: slope(view, settings.threshold) as f32, front_px: FRONT_PX as f32 };
    g.run(
        shader::Classify { depth: &depth, index: &index, spacings: &layers.spacings, tiles: &mut facts, push, spec: classify::Spec { perspective } },
        Tiles::Groups([count.div_ceil(64), 1, 1]),
    );

    let [gaps, wide_gaps] = [("gaps", 1), ("wide gaps", 2)].map(|(name, span)| {
        let blocks = across.map(|tiles| tiles.div_ceil(span));
        let count = blocks[0] * blocks[1];
        let mut gaps = g.buffer(name, 4 * count as u64);
        let push = gaps::Push { tiles: across, blocks, px_per_unit, front_px: span as f32 * FRONT_PX as f32 };
        let spec = gaps::Spec { perspective, tiles: span };
        g.run(shader::Gaps { tiles: &facts, gaps: &mut gaps, push, spec }, Tiles::Groups([count.div_ceil(64), 1, 1]));
        gaps
    });

    let packed_at = (KERNELS + 1) * stride;
    let mut lists = g.buffer("lists", 4 * (packed_at + 2 * LIST_HEADER) as u64);
    g.fill(&mut lists, 0);
    let sparsest = if layers.front.is_none() { SPARSEST } else { 1.0 };
    // A kernel that no tile can ask for is not even made.
    let [least_list, most_list] = match settings.kernel {
        0.0 => [layers.spacing_px[0], sparsest * layers.spacing_px[1]].map(|px| list_of(px * settings.reach)),
        width => [list_of(width); 2],
    };
    let packed_size = [TILE_PX * across[0] + 2 * MARGIN_PX, (TILE_PX * across[1] + 2 * MARGIN_PX) / 4];
    let pack_groups = [packed_size[0].div_ceil(64), packed_size[1]];
    let push = assign::Push {
        tiles: across,
        px_per_unit,
        stride,
        widths: WIDTHS.map(|width| width as f32),
        fine: FINE,
        least_list,
        most_list,
        pixels_per_spacing: settings.reach as f32,
        front_px: FRONT_PX as f32,
        sparser: SPARSER as f32,
        sparsest: sparsest as f32,
        all: (settings.tiles == Looked::All) as u32,
        packed_at,
        pack_groups,
    };
    g.run(shader::Assign { tiles: &facts, gaps: &gaps, wide_gaps: &wide_gaps, lists: &mut lists, push, spec: assign::Spec { perspective } }, Tiles::Groups([count.div_ceil(64), 1, 1]));

    let packed = [1, 2].map(|span| {
        let mut packed = g.image("packed depth", packed_size, Kind::Rgba32f);
        let push = pack_depth::Push { size: view.size, packed_size, margin: MARGIN_PX as i32 };
        let needed = Tiles::From(&lists, packed_at + (span - 1) * LIST_HEADER);
        g.run(shader::PackDepth { depth: &depth, packed_depth: &mut packed, push, spec: pack_depth::Spec { span } }, needed);
        packed
    });

    let mut invisible = g.buffer("invisible", 4 * TILE_PX as u64 * count as u64);
    let mut kernels = g.buffer("kernels", 4 * count as u64);
    g.fill(&mut kernels, 0);
    let holes_at = KERNELS * stride;
    let sectors = if settings.sectors < 8.0 { 4 } else if settings.sectors < 16.0 { 8 } else { 16 };
    for list in least_list..=most_list {
        let kernel = Kernel::of(list, settings);
        let Kernel { span, radius } = kernel;
        let push = visibility::Push {
            size: view.size,
            centre: view.centre().map(|at| at as f32),
            tiles_across: across[0],
            at: list * stride,
            holes_at,
            px_per_unit,
            threshold: (settings.threshold * sectors as f64 / TAU) as f32,
            holes: (settings.holes * sectors as f64 / TAU) as f32,
            own_slope: own_slope(settings, kernel).powi(2) as f32,
        };
        let spec = visibility::Spec { radius, sectors, perspective, stride: span, texels: g.gpu.device.texels };
        let counted = lists.racing();
        let tiles = Tiles::From(&counted, list * stride);
        g.run(shader::Visibility { depth: &depth, packed_depth: &packed[span as usize - 1], listed_words: &counted, lists: &mut lists, invisible: &mut invisible, kernels: &mut kernels, push, spec }, tiles);
    }

    let push = hide::Push { tiles_across: across[0], at: holes_at };
    g.run(
        shader::Hide { lists: &lists, invisible: &invisible, depth: &mut depth, index: &mut index, color: &mut color, push },
        Tiles::From(&lists, holes_at),
    );
    Layers { depth, index, color, holes: Some(Holes { lists, at: holes_at, kernels, widest: Kernel::of(most_list, settings).width() }), ..layers }
}

/// The list of the least kernel that is at least so wide, or of the widest; as in glsl/assign.comp.
fn list_of(pixels: f64) -> u32 {
    (0..KERNELS - 1).find(|&list| WIDTHS[list as usize] as f64 >= pixels).unwrap_or(KERNELS - 1)
}

/// Which neighbours a pixel looks at.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Kernel {
    /// Pixels from one to the next: with 2, the nearest of 2 x 2 pixels, itself at their top left, stands for a neighbour.
    pub span: u32,
    /// Neighbours to either side.
    pub radius: u32,
}

impl Kernel {
    /// 3, 5, .. 15 pixels wide, or 19, 23, .. 31.
    pub fn of_width(width: u32) -> Kernel {
        if width <= 15 { Kernel { span: 1, radius: (width / 2).max(1) } } else { Kernel { span: 2, radius: (width - 3) / 4 } }
    }

    fn of(list: u32, settings: &Settings) -> Kernel {
        Kernel::of_width(if settings.kernel == 0.0 { WIDTHS[list as usize] } else { settings.kernel as u32 })
    }

    /// Pixels: both sides, and the pixel itself or the 2 x 2 that it is one of.
    pub fn width(self) -> u32 {
        2 * self.span * self.radius + 2 * self.span - 1
    }

    /// Neighbours of a pixel.
    pub fn taps(self) -> u32 {
        (2 * self.radius + 1).pow(2) - 1
    }
}

/// Slope of its own surface, towards the camera, that a point is not hidden by, as a cotangent of the angle at it between the ray to the camera and a neighbour: nothing that rises less closes a cone. Without it,
/// points of a surface that rises away from something nearer lose their cones to both, and what is nearer grows over them. It is [`STEEPEST`], and less where kernels are so wide that what lies
/// `lead` pixels' width behind would show.
pub fn own_slope(settings: &Settings, kernel: Kernel) -> f64 {
    (settings.lead / (kernel.span * kernel.radius) as f64).min(STEEPEST)
}

/// How much adjacent pixels may differ in depth, in pixels' widths, so that none can be invisible; see above.
fn slope(view: &View, threshold: f64) -> f64 {
    let cos = 1.0 - threshold / TAU;
    let cotangent = cos / (1.0 - cos * cos).sqrt();
    let lean = match view.camera.projection {
        Projection::Perspective => (view.whole[0] as f64).hypot(view.whole[1] as f64) / 2.0 / view.focal_px(),
        Projection::Orthographic => 0.0,
    };
    ((cotangent - 0.71 * lean) / (SQRT_2 * (1.0 + lean * lean))).max(0.0)
}

/// Tiles that each kernel looked at, and those with pixels to be filled, from the words of the buffer `lists` after a frame.
pub fn listed<'l>(size: [u32; 2], settings: &Settings, lists: &'l [u32]) -> (Vec<(Kernel, &'l [u32])>, &'l [u32]) {
    let [across, down] = tiles(size);
    let of = |list: u32| {
        let at = (list * (LIST_HEADER + across * down)) as usize;
        let length = lists.get(at + 3).copied().unwrap_or_default() as usize;
        let first = at + LIST_HEADER as usize;
        lists.get(first..first + length).unwrap_or_default()
    };
    ((0..KERNELS).map(|list| (Kernel::of(list, settings), of(list))).collect(), of(KERNELS))
}
