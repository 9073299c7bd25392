//! Visibility: removes hidden layers from the depths of projected points, and finds the pixels to
//! fill (Pintus et al. 2011, sec. 4).
//!
//! The nearest points of 2 x 2 pixels, of 2 x 2 of those, and so on, are the cloud projected at
//! every resolution, since a minimum is associative. Where points are about a cell apart, every
//! surface is an easy case for one small kernel. Levels judge from the finest on; each decides what
//! it can, and leaves the rest to the next coarser one (rule:
//! glsl/visibility/visibility_levels.comp).
//!
//! ```text
//!     tile_classify        depth -> tiles              contents of each tile of 8 x 8 pixels
//!     depth_pyramid        depth -> nearest points     once per level
//!     visibility_assign    tiles, pyramid -> lists     tiles that each level must judge
//!     pack_depth           depth -> columns of four pixels per texel
//!     visibility           finest level: points and empty pixels; the only one with levels=1
//!     visibility_levels    pyramid, lists -> hidden points       once per coarser level
//!     visibility_assign, visibility_levels             empty pixels: enclosed ones are holes
//!     visibility_vote      verdicts on empty pixels    majorities around them
//!     visibility_apply     removes both from the depths
//!     all but the holes again, if something was hidden: removed points hide and open nothing
//!     visibility_apply     removes all invisible pixels from the G-buffer
//! ```
//! With `levels=1` it is the paper's own method: one kernel of the given width over the picture.
//!
//! A tile is skipped if nothing in it can be invisible. Assume that no two adjacent pixels of it
//! and its neighbours differ in depth by more than `slope` pixel widths. The cotangent of the angle
//! to a neighbour is then at most `sqrt(2) slope r.r` plus a share by which the ray leans, `r.r` =
//! 1 + lean^2. With several levels, nothing is in front if that is below [`STEEPEST`]. With one
//! level, leaning lowers the solid angle of one sector and raises the opposite one by at least as
//! much, except for the spread of directions within a sector, less than 0.71 lean; `lead` only
//! opens cones. So the sum of solid angles is at least 2 pi (1 - cos) at that cotangent, and
//! `slope` is where that is `threshold`.

use super::{
    Effect, EffectDecisions, Effects, FrameContext, GBuffer, Holes, LIST_HEADER, MOST_LEVELS,
    Reason, Setting, Switch, TILE_PX, TileLists, Value, fill, predicate, significant, tiles,
};
use crate::graph::{Buffer, Dispatch, Graph, Image, Kind};
use crate::shader::{
    self, Tile, depth_pyramid, pack_depth, tile_classify, visibility, visibility_apply,
    visibility_assign, visibility_levels, visibility_vote,
};
use crate::view::{Projection, View};
use std::f64::consts::{PI, SQRT_2, TAU};
use strum::{EnumString, IntoStaticStr, VariantArray};

pub const SUMMARY: &str = "removes hidden points that shine through and finds holes, by the empty cone towards the camera";

#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Settings {
    /// Levels of the pyramid; 1: the picture alone.
    pub levels: f64,
    /// Width of the neighbourhood [cells of a level], odd.
    pub kernel: f64,
    /// Sectors of the neighbourhood of a single level: 4, 8 or 16.
    pub sectors: f64,
    /// Empty solid angle from which a pixel without a point is background `[sr]`.
    pub holes: f64,
    /// Tiles that are checked.
    pub tiles: Looked,
    /// Empty solid angle from which a pixel is visible `[sr]`.
    pub threshold: f64,
    /// Points that the surface around would have put into an empty area from which that is an
    /// opening.
    pub expected: f64,
    /// Largest spacing of points on a surface `[px]`, which follows from the picture; 0: any.
    pub sparsest_px: f64,
    /// For a single level: distance in front of a point from which a neighbour at the rim of a wide
    /// kernel closes a cone [pixel widths]; less for neighbours closer to the ray ([`own_slope`]).
    /// 0: any, as in the paper.
    pub lead: f64,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
#[derive(EnumString, IntoStaticStr, VariantArray)]
#[strum(serialize_all = "kebab-case")]
#[serde(rename_all = "lowercase")]
pub enum Looked {
    /// Tiles where something can be invisible.
    #[default]
    Needed,
    /// All tiles; the picture is the same.
    All,
}

impl Default for Settings {
    fn default() -> Self {
        Settings {
            levels: MOST_LEVELS as f64,
            kernel: 7.0,
            sectors: 8.0,
            tiles: Looked::Needed,
            threshold: 2.8,
            holes: 1.0,
            expected: 36.0,
            sparsest_px: 0.0,
            lead: 7.0,
        }
    }
}

impl super::Settings for Settings {
    fn list_all(&mut self) -> Vec<Setting<'_>> {
        let number = Value::Number;
        vec![
            Setting::new(
                "threshold",
                "empty solid angle from which a point is visible [sr]",
                number(&mut self.threshold, 0.0..=TAU),
            ),
            Setting::new(
                "holes",
                "empty solid angle from which a pixel without a point is background [sr]",
                number(&mut self.holes, 0.0..=TAU),
            ),
            // For studies.
            Setting::variant("levels", Value::Whole(&mut self.levels, 1.0..=MOST_LEVELS as f64)),
            Setting::variant(
                "kernel",
                Value::OneOf(&mut self.kernel, &[3.0, 5.0, 7.0, 9.0, 11.0, 13.0, 15.0]),
            ),
            Setting::variant("sectors", Value::OneOf(&mut self.sectors, &[4.0, 8.0, 16.0])),
            Setting::variant("tiles", Value::Choice(&mut self.tiles)),
            Setting::variant("expected", number(&mut self.expected, 0.0..=1e9)),
            Setting::variant("lead", number(&mut self.lead, 0.0..=1e9)),
        ]
    }

    /// Pixels between points become unknown.
    fn grows_px(&self, spacing_px: f64) -> f64 {
        let sparsest = (SPARSEST * spacing_px).max(1.0) * (self.kernel / 2.0).ceil();
        if is_single(self) { self.kernel } else { sparsest.min(kernel_px(self) as f64) }
    }
}

/// Steepest slope towards the camera of a point's own surface: 45 degrees. With more, surfaces a
/// few pixels behind each other show through; with less, contours grow.
pub const STEEPEST: f64 = 1.0;
/// Margin as in glsl/lib/tile.glsl `[px]`.
const MARGIN_PX: u32 = 8;
/// Largest excess of images over the picture `[px]`: whole tiles, and margins.
pub const BEYOND_PX: u32 = 2 * MARGIN_PX + TILE_PX;

/// Rounds of judging points. Points of a middle surface count as openings of the one before it
/// until its own hidden points are gone: 2 % of the dragon's far side shows after one round, 1e-4
/// after two, and a third changes nothing.
const ROUNDS: u32 = 2;

/// See [`super::Effects::reach_px`]: each round looks as far as the widest kernel.
pub fn reach_px(_view: &View, settings: &Settings) -> Option<u32> {
    Some(match is_single(settings) {
        true => settings.kernel as u32 / 2 + 1 + 2 * TILE_PX,
        false => ROUNDS * (kernel_px(settings) + TILE_PX),
    })
}

/// Returns whether it is the paper's own method.
fn is_single(settings: &Settings) -> bool {
    settings.levels == 1.0
}

/// Returns the reach of the coarsest level to either side `[px]`.
fn kernel_px(settings: &Settings) -> u32 {
    (settings.kernel as u32 / 2 + 1) << (settings.levels as u32 - 1)
}

pub fn called_for(context: &FrameContext, asked: &Effects, before: &EffectDecisions) -> Reason {
    match context.points {
        0 => Reason { runs: false, why: "there are no points".to_string() },
        _ if before.runs(Effect::Scattered) && context.sampling.scattered >= 1.0 => Reason {
            runs: false,
            why: "no point in view lies on a surface that could hide others".to_string(),
        },
        _ if asked.fill.switch != Switch::Off && asked.fill.settings.method == fill::Method::Mask => beside_masks(context),
        _ => Reason {
            runs: true,
            why: "hidden points shine through where points are sparse; tiles without gaps are skipped".to_string(),
        },
    }
}

/// Spacing of the sparser points, between which gaps lie, as a multiple of the mean.
const SPARSER: f64 = 1.4;

/// Decides whether to run before filling by masks.
fn beside_masks(context: &FrameContext) -> Reason {
    let apart_px = (SPARSER * context.sampling.spacing_px()).max(context.sampling.apart_px);
    let runs = apart_px > fill::APART_PX;
    let why = match runs {
        true => format!(
            "sparser points are {} pixels apart, and masks only close gaps up to {}",
            significant(apart_px),
            fill::APART_PX
        ),
        false => "filling by masks removes hidden points".to_string(),
    };
    Reason { runs, why }
}

pub fn record(
    g: &mut Graph,
    context: &FrameContext,
    asked: &Settings,
    mut gbuffer: GBuffer,
) -> GBuffer {
    let settings =
        &if gbuffer.accumulation.is_some() { behind(asked, gbuffer.spacing_px[1]) } else { *asked };
    let mut judged = Judged::new(g, context, settings, &gbuffer);
    judged.points(g, &gbuffer.depth, 0);
    if !is_single(settings) {
        judged.empties(g, &gbuffer.depth);
        let holes = judged.holes.alias();
        predicate::only_where(g, &holes, |g| {
            for round in 1..ROUNDS {
                judged.hide(g, &mut gbuffer, false);
                judged.points(g, &gbuffer.depth, round);
            }
        });
    }
    judged.hide(g, &mut gbuffer, true);
    let Judged { holes, kernels, looked_at, .. } = judged;
    let tile_lists = TileLists { looked_at, holes: Some(holes.alias()), ..gbuffer.tile_lists };
    GBuffer {
        holes: Some(Holes { list: holes, kernels, widest: 2 * kernel_px(settings) }),
        tile_lists,
        ..gbuffer
    }
}

/// Spacing up to which points hide what is behind them, as a multiple of their node's; sparser ones
/// are strays. With half as much, hidden points show between the vertices of flat parts of a mesh.
pub const SPARSEST: f64 = 4.0;
/// Spacing up to which points enclose a gap, as a multiple of that which nine tenths of the covered
/// area do not exceed. With four times as much, strays in the void enclose patches between them.
const SPARSEST_BETWEEN: f64 = 2.0;
/// The same for layers behind others: leftovers of the layers in front are strays, and no surface
/// is sparser than its node.
const SPARSEST_BEHIND: f64 = 1.0;
/// Largest kernel there [spacings of the sparsest points].
const BEHIND_SPACINGS: f64 = 5.5;

/// Returns the levels up to cells in which points of a surface may be a cell apart, for the spacing
/// of the sparsest node `[px]`; at least two.
pub fn levels_for(widest_px: f64) -> f64 {
    (SPARSEST * widest_px).max(2.0).log2().floor() + 1.0
}

/// Returns the settings for the spacing of the sparsest points, and for that of nearly all
/// ([`PointDensity::apart_px`](crate::resident::PointDensity::apart_px)) `[px]`.
pub fn settled(asked: &Settings, widest_px: f64, apart_px: f64) -> Settings {
    Settings {
        levels: asked.levels.min(levels_for(widest_px)),
        sparsest_px: SPARSEST_BETWEEN * apart_px,
        ..*asked
    }
}

/// Returns a bit for each edge beyond which surfaces continue: left, right, upper, lower.
fn crossed_bits(crossed: [bool; 4]) -> u32 {
    (0..4).map(|edge| (crossed[edge] as u32) << edge).sum()
}

/// Returns the least density of points on a surface, per pixel.
pub fn least_density(settings: &Settings) -> f64 {
    if settings.sparsest_px > 0.0 { settings.sparsest_px.powi(-2) } else { 0.0 }
}

/// Returns the settings for layers behind others.
fn behind(asked: &Settings, spacing_px: f64) -> Settings {
    let widest = 2.0 * ((BEHIND_SPACINGS * spacing_px - 1.0) / 2.0).ceil() + 1.0;
    let levels = (SPARSEST_BEHIND * spacing_px).max(2.0).log2().floor() + 1.0;
    Settings {
        kernel: asked.kernel.min(widest.max(3.0)),
        levels: asked.levels.min(levels),
        ..*asked
    }
}

/// The pixels that are judged.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Subject {
    Points,
    /// Pixels without a point.
    Empty,
}

/// A picture, and what has been found in it.
struct Judged<'s> {
    view: &'s View,
    settings: &'s Settings,
    /// Tiles across and down.
    across: [u32; 2],
    perspective: bool,
    /// See [`SPARSEST`].
    sparsest: f64,
    /// Edges beyond which surfaces continue ([`crossed_bits`]).
    crossed: u32,
    /// Contents of tiles.
    tiles: Buffer,
    /// List of tiles with invisible pixels.
    holes: Buffer,
    /// Invisible pixels: two words per tile, one bit per pixel (glsl/lib/tile.glsl).
    invisible: Buffer,
    /// Points that may be hidden, likewise: all at first, then those with enough points in front.
    candidates: Buffer,
    /// Pixels without a point that each level has decided, likewise for every level.
    decided: Buffer,
    /// Pyramid of the picture before anything was hidden.
    projected: Option<Pyramid>,
    /// Width of the kernel that found invisible pixels, for each tile `[px]`.
    kernels: Buffer,
    /// Tiles that the first round looked at, a list per level.
    looked_at: Option<Buffer>,
}

impl<'s> Judged<'s> {
    fn new(
        g: &mut Graph,
        context: &FrameContext<'s>,
        settings: &'s Settings,
        gbuffer: &GBuffer,
    ) -> Judged<'s> {
        let view = context.view;
        let across = tiles(view.size);
        let count = (across[0] * across[1]) as u64;
        let mut filled = |name: &str, words: u64, word: u32| {
            let mut buffer = g.buffer(name, 4 * words);
            g.fill(&mut buffer, word);
            buffer
        };
        let holes = filled("holes", LIST_HEADER as u64 + count, 0);
        let [invisible, candidates] = [("invisible", 0), ("candidates", u32::MAX)]
            .map(|(name, word)| filled(name, 2 * count, word));
        let kernels = filled("kernels", count, 0);
        let decided = filled("decided", 2 * count, 0);
        let mut tiles = g.buffer("tiles", std::mem::size_of::<Tile>() as u64 * count);
        let perspective = view.camera.projection == Projection::Perspective;
        let push = tile_classify::Push {
            size: view.size,
            tiles: across,
            px_per_unit: view.focal_px() as f32,
            slope: slope(view, settings) as f32,
        };
        let spec = tile_classify::Spec { perspective };
        let GBuffer { depth, index, spacings, .. } = gbuffer;
        g.run(
            shader::TileClassify { depth, index, spacings, tiles: &mut tiles, push, spec },
            Dispatch::Groups([count.div_ceil(64) as u32, 1, 1]),
        );
        let sparsest = if gbuffer.accumulation.is_none() { SPARSEST } else { SPARSEST_BEHIND };
        Judged {
            sparsest,
            crossed: crossed_bits(context.sampling.crossed),
            view,
            settings,
            across,
            perspective,
            tiles,
            holes,
            invisible,
            candidates,
            kernels,
            decided,
            projected: None,
            looked_at: None,
        }
    }

    fn count(&self) -> u32 {
        self.across[0] * self.across[1]
    }

    fn centre(&self) -> [f32; 2] {
        self.view.centre().map(|at| at as f32)
    }

    fn px_per_unit(&self) -> f32 {
        self.view.focal_px() as f32
    }

    fn radius(&self) -> u32 {
        self.settings.kernel as u32 / 2
    }

    /// Finds the pixels to judge, and the list of tiles for each level.
    fn assign(
        &self,
        g: &mut Graph,
        pyramid: &Pyramid,
        subject: Subject,
        round: u32,
    ) -> [Buffer; 2] {
        let count = self.count();
        let mut asked = g.buffer("asked", 12 * count as u64);
        let mut lists = g.buffer(
            if subject == Subject::Points { "lists" } else { "empty lists" },
            4 * ((self.settings.levels as u32 + 1) * stride(self.across)) as u64,
        );
        g.fill(&mut lists, 0);
        let push = visibility_assign::Push {
            size: self.view.size,
            centre: self.centre(),
            tiles: self.across,
            px_per_unit: self.px_per_unit(),
            stride: stride(self.across),
            levels: self.settings.levels as i32,
            fewest: if is_single(self.settings) { 1 } else { fewest(self.settings, subject) },
            own: STEEPEST as f32,
            sparsest: self.sparsest as f32,
            empties: (subject == Subject::Points && round == 0) as u32,
            all: (self.settings.tiles == Looked::All) as u32,
        };
        let spec = visibility_assign::Spec {
            radius: self.radius(),
            perspective: self.perspective,
            empty: subject == Subject::Empty,
        };
        let (Judged { tiles, invisible, .. }, Pyramid { image: pyramid }) = (self, pyramid);
        let candidates = if subject == Subject::Points { &self.candidates } else { &self.decided };
        let shader = shader::VisibilityAssign {
            tiles,
            pyramid,
            candidates,
            invisible,
            asked: &mut asked,
            lists: &mut lists,
            push,
            spec,
        };
        g.run(shader, Dispatch::Groups([count.div_ceil(64), 1, 1]));
        [asked, lists]
    }

    /// Judges the picture itself: the paper's single kernel, or the finest level, which leaves
    /// points to the next one.
    fn picture(
        &mut self,
        g: &mut Graph,
        depth: &Image,
        [asked, lists]: [&Buffer; 2],
        left: &mut Left,
        round: u32,
    ) {
        let Settings { sectors, threshold, holes, kernel, expected, levels, .. } = *self.settings;
        let (size, across) = (self.view.size, self.across);
        let packed_size =
            [TILE_PX * across[0] + 2 * MARGIN_PX, (TILE_PX * across[1] + 2 * MARGIN_PX) / 4];
        let mut packed_depth = g.image("packed depth", packed_size, Kind::Rgba32f);
        let push = pack_depth::Push {
            size,
            packed_size,
            margin: MARGIN_PX as i32,
            mirror: is_single(self.settings) as u32,
        };
        g.run(
            shader::PackDepth { depth, packed_depth: &mut packed_depth, push },
            Dispatch::PerPixel,
        );
        let single = is_single(self.settings);
        let sectors = match sectors {
            _ if !single => SECTORS as u32,
            few if few < 8.0 => 4,
            some if some < 16.0 => 8,
            _ => 16,
        };
        let in_sectors = |steradians: f64| (steradians * sectors as f64 / TAU) as f32;
        let own_slope = if single {
            own_slope(self.settings, Kernel::of_width(kernel as u32))
        } else {
            STEEPEST
        };
        // List of the tiles that any level needs.
        let at = if single { 0 } else { levels as u32 * stride(across) };
        let push = visibility::Push {
            size,
            centre: self.centre(),
            tiles_across: across[0],
            at,
            empties: (round == 0) as u32,
            px_per_unit: self.px_per_unit(),
            threshold: in_sectors(threshold),
            hole: in_sectors(holes),
            own_slope: own_slope.powi(2) as f32,
            expected: expected as f32,
            fewest: [Subject::Points, Subject::Empty].map(|subject| fewest(self.settings, subject)),
        };
        let texels = g.gpu.device.has_large_texel_buffers;
        let spec = visibility::Spec {
            radius: self.radius(),
            sectors,
            perspective: self.perspective,
            texels,
            finest: !single,
        };
        let Judged { holes, invisible, kernels, decided, candidates: led, .. } = self;
        let Left { to, counts, .. } = left;
        let packed_depth = &packed_depth;
        let shader = shader::Visibility {
            depth,
            packed_depth,
            lists,
            listed_words: lists,
            holes,
            invisible,
            kernels,
            asked,
            asked_words: asked,
            to,
            counts,
            decided,
            led,
            push,
            spec,
        };
        g.run(shader, Dispatch::Indirect(lists, at));
    }

    /// Judges points by every level, from the finest on.
    fn points(&mut self, g: &mut Graph, depth: &Image, round: u32) {
        let pyramid = Pyramid::of(g, self.view, depth, self.settings);
        let lists = self.assign(g, &pyramid, Subject::Points, round);
        self.looked_at.get_or_insert_with(|| lists[1].alias());
        self.candidates = zeros(g, "led", 2 * self.count());
        let mut left = Left::new(g, self.settings, self.view.size);
        self.picture(g, depth, [&lists[0], &lists[1]], &mut left, round);
        for level in 1..self.settings.levels as u32 {
            left.turn();
            self.level(
                g,
                depth,
                &pyramid,
                [&lists[0], &lists[1]],
                &mut left,
                Subject::Points,
                level,
            );
        }
        self.projected.get_or_insert(pyramid);
    }

    /// Judges pixels without a point by the levels after the finest: a hidden point still covers
    /// its pixel.
    fn empties(&mut self, g: &mut Graph, depth: &Image) {
        let Some(pyramid) = self.projected.take() else { return };
        let lists = self.assign(g, &pyramid, Subject::Empty, 0);
        let mut left = Left::none(g);
        self.decided = zeros(g, "decided", (self.settings.levels as u32 + 1) * 2 * self.count());
        for level in 1..self.settings.levels as u32 {
            self.level(
                g,
                depth,
                &pyramid,
                [&lists[0], &lists[1]],
                &mut left,
                Subject::Empty,
                level,
            );
        }
        self.vote(g, &lists);
    }

    /// Settles which pixels without a point are holes, by majorities around them.
    fn vote(&mut self, g: &mut Graph, [asked, lists]: &[Buffer; 2]) {
        let levels = self.settings.levels as u32;
        let push = visibility_vote::Push {
            tiles: self.across,
            stride: 2 * self.count(),
            levels: levels as i32,
            kernel: self.settings.kernel as u32,
            at: levels * stride(self.across),
        };
        let Judged { tiles, invisible, decided, holes, kernels, .. } = self;
        for turn in [false, true] {
            let spec = visibility_vote::Spec { turn };
            g.run(
                shader::VisibilityVote {
                    tiles,
                    asked,
                    invisible,
                    decided,
                    lists,
                    holes,
                    kernels,
                    push,
                    spec,
                },
                Dispatch::Indirect(lists, push.at),
            );
        }
    }

    /// Runs one level of the pyramid, except the finest.
    #[expect(clippy::too_many_arguments, reason = "what a level reads and writes")]
    fn level(
        &mut self,
        g: &mut Graph,
        depth: &Image,
        Pyramid { image: pyramid }: &Pyramid,
        [asked, lists]: [&Buffer; 2],
        left: &mut Left,
        subject: Subject,
        level: u32,
    ) {
        let empty = subject == Subject::Empty;
        let at = level * stride(self.across);
        let push = visibility_levels::Push {
            size: self.view.size,
            centre: self.centre(),
            tiles_across: self.across[0],
            crossed: self.crossed,
            level: level as i32,
            at,
            stride: 2 * self.count(),
            px_per_unit: self.px_per_unit(),
            closed: closed(self.settings, subject) as f32,
            fewest: fewest(self.settings, subject),
            expected: self.settings.expected as f32,
            least_density: least_density(self.settings) as f32,
            own_slope: STEEPEST.powi(2) as f32,
        };
        let spec = visibility_levels::Spec {
            radius: self.radius(),
            perspective: self.perspective,
            empty,
            texels: g.gpu.device.has_large_texel_buffers,
        };
        let Left { from, to, counts } = left;
        let (earlier, counted) = (self.decided.racy_alias(), counts.racy_alias());
        let Judged { holes, invisible, kernels, decided, candidates: led, .. } = self;
        let shader = shader::VisibilityLevels {
            depth,
            pyramid,
            asked,
            asked_words: asked,
            lists,
            listed_words: lists,
            holes,
            from,
            from_words: from,
            to,
            counts,
            decided,
            decided_words: &earlier,
            invisible,
            led,
            kernels,
            push,
            spec,
        };
        g.run(
            shader,
            if empty {
                Dispatch::Indirect(lists, at)
            } else {
                Dispatch::Indirect(&counted, LIST_HEADER * level)
            },
        );
    }

    /// Removes invisible pixels from the depth, or from the whole G-buffer.
    fn hide(&self, g: &mut Graph, gbuffer: &mut GBuffer, all: bool) {
        let GBuffer { depth, index, color, .. } = gbuffer;
        let push = visibility_apply::Push { tiles_across: self.across[0] };
        let Judged { holes, invisible, .. } = self;
        g.run(
            shader::VisibilityApply {
                lists: holes,
                invisible,
                depth,
                index,
                color,
                push,
                spec: visibility_apply::Spec { all },
            },
            Dispatch::Indirect(holes, 0),
        );
    }
}

/// Sectors of the kernels on a pyramid.
const SECTORS: f64 = 8.0;

/// Returns the empty solid angle below which a pixel is invisible, in sectors' hemispheres: 1 is a
/// sector without a point in front.
fn closed(settings: &Settings, subject: Subject) -> f64 {
    let steradians = if subject == Subject::Empty { settings.holes } else { settings.threshold };
    steradians * SECTORS / TAU
}

/// Returns the smallest number of points in front that decides anything: those that close a pixel,
/// one in each sector that may not be empty; or, around a point, those dense enough to call it
/// open.
fn fewest(settings: &Settings, subject: Subject) -> i32 {
    let closing =
        ((SECTORS - closed(settings, subject)).floor() as i32 + 1).clamp(1, SECTORS as i32);
    match subject {
        Subject::Points => closing.min(fewest_around_openings(settings)),
        Subject::Empty => closing,
    }
}

/// Returns the number of points in front without which no pixel is open, as long as cells have one
/// point each; with fewer, coarser levels judge. Few points cover the largest share of neighbours
/// if they lie in a corner of the kernel.
pub fn fewest_around_openings(settings: &Settings) -> i32 {
    const SHARES: [f64; 4] = [0.0, 2.0 / 8.0, 6.0 / 13.0, 12.0 / 21.0];
    let area = PI * (settings.kernel / 2.0).powi(2);
    let opens = |share: &f64| share * area >= settings.expected * (1.0 - share).sqrt();
    SHARES.iter().position(opens).unwrap_or(SHARES.len()) as i32 + 1
}

/// Returns the words of a list.
fn stride(across: [u32; 2]) -> u32 {
    LIST_HEADER + across[0] * across[1]
}

fn zeros(g: &mut Graph, name: &str, words: u32) -> Buffer {
    let mut buffer = g.buffer(name, 4 * words as u64);
    g.fill(&mut buffer, 0);
    buffer
}

/// Points that levels leave to the next one.
struct Left {
    from: Buffer,
    to: Buffer,
    /// Indirect dispatch and number of points left, for each level.
    counts: Buffer,
}

impl Left {
    fn new(g: &mut Graph, settings: &Settings, size: [u32; 2]) -> Left {
        let room = if is_single(settings) { 4 } else { 4 * size[0] as u64 * size[1] as u64 };
        let [from, to] = ["points left over", "points left"].map(|name| g.buffer(name, room));
        Left { from, to, counts: zeros(g, "counts", LIST_HEADER * (settings.levels as u32 + 1)) }
    }

    fn none(g: &mut Graph) -> Left {
        let [from, to, counts] =
            ["no points", "no points left", "no counts"].map(|name| zeros(g, name, 4));
        Left { from, to, counts }
    }

    /// Passes the points that a level has left to the next.
    fn turn(&mut self) {
        std::mem::swap(&mut self.from, &mut self.to);
    }
}

/// Nearest points of every level except the picture itself: depths, places and numbers
/// (glsl/lib/depth_pyramid.glsl).
struct Pyramid {
    image: Image,
}

impl Pyramid {
    fn of(g: &mut Graph, view: &View, picture: &Image, settings: &Settings) -> Pyramid {
        let (size, levels) = (picture.desc.size, settings.levels as u32);
        let level_size = |level: u32| size.map(|side| side.div_ceil(1 << level));
        let [first, second] = [1, 2].map(level_size);
        // A level beyond the coarsest has the densities around its points.
        let below = (2..=levels).map(|level| level_size(level)[1]).sum::<u32>();
        let room = if levels == 1 { [1, 1] } else { [first[0] + second[0], first[1].max(below)] };
        let mut image = g.image("pyramid", room, Kind::Rgba32f);
        // A pass writes one level and reads the one before.
        g.discard(&mut image);
        for level in (1..=levels).filter(|_| levels > 1) {
            let [width, height] = level_size(level);
            let push = depth_pyramid::Push {
                size,
                level: level as i32,
                reach: reach(view, level as usize),
            };
            let perspective = view.camera.projection == Projection::Perspective;
            let spec = depth_pyramid::Spec { first: level == 1, perspective };
            g.run(
                shader::DepthPyramid { depth: picture, pyramid: &mut image, push, spec },
                Dispatch::Groups([width.div_ceil(64), height, 1]),
            );
        }
        Pyramid { image }
    }
}

/// Returns how far the surface of a cell's nearest point may reach behind that: a cell's width,
/// with [`STEEPEST`]. A factor with perspective, otherwise a distance `[m]`.
pub fn reach(view: &View, level: usize) -> f32 {
    let side = STEEPEST * (1u64 << level) as f64 / view.focal_px();
    match view.camera.projection {
        Projection::Perspective => (1.0 + side) as f32,
        Projection::Orthographic => side as f32,
    }
}

/// The neighbourhood of a single level.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Kernel {
    /// Neighbours to either side.
    pub radius: u32,
}

impl Kernel {
    pub fn of_width(width: u32) -> Kernel {
        Kernel { radius: (width / 2).max(1) }
    }

    /// Returns the width `[px]`.
    pub fn width(self) -> u32 {
        2 * self.radius + 1
    }
}

/// Returns the slope of its own surface, towards the camera, that does not hide a point, for a
/// single level: a cotangent of the angle at the point between the ray to the camera and a
/// neighbour. Without it, points of a surface that rises away from a nearer one lose their cones to
/// both, and the nearer one grows over them. It is [`STEEPEST`], or less for kernels so wide that
/// points `lead` pixel widths behind would show.
pub fn own_slope(settings: &Settings, kernel: Kernel) -> f64 {
    (settings.lead / kernel.radius as f64).min(STEEPEST)
}

/// Returns the depth difference of adjacent pixels below which none can be invisible [pixel
/// widths]; see above.
fn slope(view: &View, settings: &Settings) -> f64 {
    let lean = match view.camera.projection {
        Projection::Perspective => {
            (view.whole[0] as f64).hypot(view.whole[1] as f64) / 2.0 / view.focal_px()
        }
        Projection::Orthographic => 0.0,
    };
    if is_single(settings) {
        let cos = 1.0 - settings.threshold / TAU;
        let cotangent = cos / (1.0 - cos * cos).sqrt();
        return ((cotangent - 0.71 * lean) / (SQRT_2 * (1.0 + lean * lean))).max(0.0);
    }
    let steepest = ((STEEPEST - lean) / (SQRT_2 * (1.0 + lean * lean))).max(0.0);
    // Depths grow from step to step with perspective: count the steps across the widest level with
    // cells smaller than a tile, there and down.
    let steps = 2 * (settings.kernel as i32 / 2 + 1) * (TILE_PX as i32 / 2);
    match view.camera.projection {
        Projection::Perspective => steepest / (1.0 + steepest / view.focal_px()).powi(steps),
        Projection::Orthographic => steepest,
    }
}

/// Returns the tiles that each level checked first for hidden points, from the buffer `lists` after
/// a frame, by the level's cell width `[px]`.
pub fn listed(size: [u32; 2], lists: &[u32]) -> Vec<(u32, &[u32])> {
    let stride = stride(tiles(size)) as usize;
    // The last list is of all tiles that any level checked.
    let levels = (lists.len() / stride).saturating_sub(1);
    lists
        .chunks_exact(stride)
        .take(levels)
        .enumerate()
        .map(|(level, list)| (1 << level, in_list(list)))
        .collect()
}

/// Returns the tiles of a list.
pub fn in_list(list: &[u32]) -> &[u32] {
    let length = list.get(LIST_HEADER as usize - 1).copied().unwrap_or_default() as usize;
    list.get(LIST_HEADER as usize..LIST_HEADER as usize + length).unwrap_or_default()
}
