//! Shadows: how much of a light reaches each point, and with it shaded colour (Dobrev et al. 2010,
//! sec. 6).
//!
//! ```text
//!     for every sample of the light, for every picture that it sees the cloud in:
//!         project       points -> keys                    the core's pass, through the camera of
//!                                                         the light, over all resident nodes
//!         shadow_...    keys -> depth limit               depth that light reaches in each texel
//!                                                         (depth_limit.rs)
//!         shadow_test   points, limits -> visibility      one more sample for points no deeper;
//!                                                         index peeling gives the same (peel.rs)
//!     shadow_apply      visibility, index, color -> color
//! ```
//! Colours are shaded before hidden points are removed and holes are filled, so that filling uses
//! shaded colours. If Phong lighting runs, the visibility of each pixel is kept instead. It is
//! filled like the colour and scales the light: ka + m (kd + ks).
//!
//! The visibility of a point is a byte, by point id, and does not depend on the camera. It is kept
//! while the light and the nodes stay; then only the last pass runs. Samples of a light can be cast
//! over several frames, with the same result. Points have no normals: the slope of a surface is
//! measured in the light's depths.

pub mod area_light_samples;
pub mod bake_index;
pub mod cameras;
mod depth_limit;
pub mod invalidation;
mod peel;

pub use depth_limit::{Layer, Reached, reach};

use super::project::{self, Drawn, Precision, Shallow, Strip};
use super::{Effect, EffectDecisions, Effects, FrameContext, GBuffer, Reason, Setting, Value};
use crate::config::{POINTS_PER_PAGE, SUN};
use crate::error::{Error, Result};
use crate::graph::{Buffer, Dispatch, Graph, Image, Kind};
use crate::resident::{IDENTITY_WORDS, Resident, ResidentNode};
use crate::shader::{self, shadow_test};
use crate::view::View;
use crate::view::light::Light;
use cameras::LightCamera;
use glam::DVec3;
use invalidation::Changed;
use std::ops::Range;
use strum::{EnumString, IntoStaticStr, VariantArray};

pub const SUMMARY: &str = "shadows of --light, or of a sun if that is a headlight";

#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Settings {
    pub method: Method,
    /// Samples of the light; 1: its middle, hard shadows.
    pub samples: f64,
    pub pattern: area_light_samples::Pattern,
    /// Radius of the light: half its angle if directional `[degrees]`, else `[m]`.
    pub radius: f64,
    /// Longer side of the light's picture `[texels]`; 0: from the point spacing.
    pub size: f64,
    /// Share of the colour without light, if no lighting runs; Phong lighting has its own.
    pub ambient: f64,
    /// Distance behind the surface that the light sees within which a point belongs to it, across
    /// the surface `[m]`; 0: the layer distance of the picture, and at least the bound of guide:
    /// numerics, case 13.
    pub layer: f64,
    /// Lower bound if `layer` is 0 `[m]`: the layer distance of the picture. Set by the frame.
    #[serde(skip)]
    pub least: f64,
    /// Width of the gaps that are closed in the light's picture `[texels]`.
    pub fill: f64,
    /// Largest number of passes of index peeling; 0: until one reaches nothing, 512 at most.
    pub peels: f64,
    /// Smallest <v, n>: steeper surfaces count as this steep.
    pub limit: f64,
}

/// How lit points are found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
#[derive(EnumString, IntoStaticStr, VariantArray)]
#[strum(serialize_all = "kebab-case")]
#[serde(rename_all = "lowercase")]
pub enum Method {
    /// Compares every point with the light's depth.
    #[default]
    Depth,
    /// Peels points off the light's picture, one per texel at a time.
    Index,
}

impl Default for Settings {
    fn default() -> Self {
        Settings {
            method: Method::Depth,
            samples: 1.0,
            pattern: area_light_samples::Pattern::Stratified,
            radius: 0.5,
            size: 0.0,
            ambient: 0.35,
            layer: 0.0,
            least: 0.0,
            fill: 2.0,
            peels: 0.0,
            limit: 0.2,
        }
    }
}

/// Largest number of samples: a byte counts them, even if three pictures of a cube see a point.
const MOST_SAMPLES: f64 = 64.0;

impl super::Settings for Settings {
    fn list_all(&mut self) -> Vec<Setting<'_>> {
        let number = Value::Number;
        vec![
            Setting::new(
                "samples",
                "points on the light; 1: hard shadows",
                Value::Whole(&mut self.samples, 1.0..=MOST_SAMPLES),
            ),
            Setting::new(
                "radius",
                "radius of the light: degrees (at most 45) if directional, metres if it has a position",
                number(&mut self.radius, 0.0..=1e6),
            ),
            Setting::new(
                "size",
                "longer side of the shadow map [texels]; 0: from the point spacing",
                Value::Whole(&mut self.size, 0.0..=4096.0),
            ),
            Setting::new(
                "ambient",
                "fraction of the colour in full shadow; if phong runs, phong=ambient applies instead",
                number(&mut self.ambient, 0.0..=1.0),
            ),
            // For studies.
            Setting::variant("method", Value::Choice(&mut self.method)),
            Setting::variant("pattern", Value::Choice(&mut self.pattern)),
            Setting::variant("layer", Value::Length(&mut self.layer, 0.0..=1e9)),
            Setting::variant("fill", Value::Whole(&mut self.fill, 0.0..=16.0)),
            Setting::variant("peels", Value::Whole(&mut self.peels, 0.0..=4096.0)),
            Setting::variant("limit", number(&mut self.limit, 0.01..=1.0)),
        ]
    }

    /// Pixels without a point do not change.
    fn grows_px(&self, _spacing_px: f64) -> f64 {
        0.0
    }
}

/// See [`super::Effects::reach_px`].
pub fn reach_px(_view: &View, _settings: &Settings) -> Option<u32> {
    Some(0)
}

pub fn called_for(context: &FrameContext, _asked: &Effects, _before: &EffectDecisions) -> Reason {
    let why = match context.points {
        0 => "there are no points",
        _ if context.has_saved_shadows => {
            return Reason { runs: true, why: "saved shadows cost nothing".into() };
        }
        _ => {
            "they cost two walks over all points for every sample of the light, and run only with --effect shadows=on"
        }
    };
    Reason { runs: false, why: why.to_string() }
}

/// Visibility of the light from each point.
pub struct LightVisibility {
    /// Number of samples that reach each point, one byte by point id.
    pub counts: Buffer,
    /// If shadows are saved: the value that means fully lit; `counts` then holds the page of each
    /// node's values.
    pub saved: Option<u32>,
    /// Texels where index peeling of this frame ended early, if it cast any.
    pub unpeeled: Option<Buffer>,
    /// True if lighting follows and takes it into account.
    pub apart: bool,
    /// Statistics for `--explain`.
    pub facts: Facts,
}

/// Statistics of casting.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Facts {
    /// True if shadows were saved for the whole cloud: no pass casts them.
    pub saved: bool,
    pub samples: u32,
    /// Samples that are cast so far.
    pub cast: u32,
    /// Nodes whose points this frame has tested; the others were kept.
    #[serde(alias = "marked")]
    pub tested: u32,
    /// Pictures of the light, over all samples.
    pub pictures: u32,
    /// Size of the first picture `[texels]`.
    pub size: [u32; 2],
    /// How often it is halved to close gaps where points are sparse.
    #[serde(default)]
    pub halvings: u32,
    /// Side of a texel `[m]`, in the middle of the cloud if the light has a position.
    pub texel_m: f64,
    /// Distance behind a surface that faces the light where shadow begins `[m]`. On a slanted
    /// surface it is measured across the surface.
    pub layer_m: f64,
}

impl Facts {
    fn new(
        cameras: &[LightCamera],
        bounds: (DVec3, DVec3),
        settings: &Settings,
        unit_m: f64,
    ) -> Facts {
        let samples = settings.samples as u32;
        let Some(LightCamera { view: first, halvings, spacing_m, .. }) = cameras.first() else {
            return Facts { samples, cast: samples, ..Facts::default() };
        };
        let layer = Layer::new(first, bounds, settings);
        let middle = (bounds.0 + bounds.1) / 2.0 - first.camera.eye;
        let texel_m = layer.texel * if layer.perspective { middle.length() } else { 1.0 };
        // The picture that closes gaps between points there.
        let taken = cameras::halvings(spacing_m / texel_m, f64::INFINITY).min(*halvings);
        let layer_m = layer.metres + layer.texels * texel_m * (1u64 << taken) as f64;
        Facts {
            saved: false,
            samples,
            cast: samples,
            tested: 0,
            pictures: cameras.len() as u32,
            size: first.size,
            halvings: *halvings,
            texel_m: texel_m * unit_m,
            layer_m: layer_m * unit_m,
        }
    }
}

fn plural(count: u32) -> &'static str {
    if count == 1 { "" } else { "s" }
}

impl std::fmt::Display for Facts {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let [width, height] = self.size;
        let halved = if self.halvings == 0 {
            String::new()
        } else {
            format!(", and {} coarser where points are sparse in it", self.halvings)
        };
        write!(
            f,
            "{}{} sample{} of the light, {} cast, points of {} nodes tested by this frame, {} picture{} each of {width} x {height} texels of {:.6} m{}; shadow begins {:.6} m behind a surface",
            if self.saved { "saved ones, of all points, so that no light pass runs; " } else { "" },
            self.samples,
            plural(self.samples),
            self.cast,
            self.tested,
            self.pictures,
            plural(self.pictures),
            self.texel_m,
            halved,
            self.layer_m
        )
    }
}

/// Returns the visibility of the light from all points; None if shadows do not run. At most
/// `at_once` samples are added to those that are kept, and one if there are none; None adds all.
/// Errors if there are more nodes than the device binds.
pub fn light_visibility(
    g: &mut Graph,
    context: &FrameContext,
    resident: &Resident,
    effects: &Effects,
    decisions: &EffectDecisions,
    at_once: Option<u32>,
) -> Result<Option<LightVisibility>> {
    if !decisions.runs(Effect::Shadows) {
        return Ok(None);
    }
    let visibility = match saved(g, context, resident) {
        Some(saved) => Some(saved?),
        None => counted(
            g,
            context,
            resident,
            &Settings { least: context.asked_layer_m, ..effects.shadows.settings },
            at_once,
        )?,
    };
    Ok(visibility
        .map(|visibility| LightVisibility { apart: decisions.runs(Effect::Phong), ..visibility }))
}

fn counted(
    g: &mut Graph,
    context: &FrameContext,
    resident: &Resident,
    settings: &Settings,
    at_once: Option<u32>,
) -> Result<Option<LightVisibility>> {
    let Some(bounds) = bounds(resident) else { return Ok(None) };
    let bytes = resident.nodes.len() as u64 * POINTS_PER_PAGE as u64;
    if bytes.next_power_of_two() > g.binding_limit() {
        return Err(Error::Request(format!(
            "shadows of {} nodes are too many for this device, which binds {} at most; use a lower --point-budget or --effect shadows=off",
            resident.nodes.len(),
            g.binding_limit() / POINTS_PER_PAGE as u64
        )));
    }
    let samples = settings.samples as u32;
    let wanted = |kept: u32| at_once.map_or(samples, |more| (kept + more).clamp(1, samples));
    let around = cameras::Wanted::around(
        resident,
        bounds,
        context.sampling.spacing_m,
        settings,
        context.light,
    );
    let places =
        area_light_samples::spread(area_light_samples::places(samples, settings.pattern, 0));
    let views = |samples: Range<u32>| -> Result<Vec<LightCamera>> {
        let of = places[samples.start as usize..samples.end as usize]
            .iter()
            .map(|&place| cameras::cameras(context.light, &around, place));
        Ok(of.collect::<Result<Vec<_>>>()?.concat())
    };
    let facts = Facts::new(
        &cameras::cameras(context.light, &around, places[0])?,
        around.bounds,
        settings,
        context.unit_m,
    );

    let (light, nodes) =
        (cache_key(context, resident, settings, &around), resident.nodes_identity());
    let cache_key = [light.as_slice(), &nodes].concat();
    let place = (0..2)
        .find(|&place| {
            g.persistent_state(PLACES[place]).is_some_and(|(of, _)| of.starts_with(&light))
        })
        .unwrap_or(0);
    let before = g
        .persistent_state(PLACES[place])
        .filter(|(of, _)| of.starts_with(&light))
        .map(|(of, steps)| (of.to_vec(), steps));
    // If few samples are cast per frame, changed nodes start again with one sample.
    if let Some((before, kept)) = before.filter(|(before, kept)| {
        *before != cache_key
            && settings.method == Method::Depth
            && (*kept == 1 || at_once != Some(0))
    }) && let sights = views(0..kept)?
        && let Some(Changed { stay, again }) = invalidation::changed(
            &before[light.len()..],
            resident,
            &sights.iter().map(|sight| sight.view).collect::<Vec<_>>(),
            travel_px(settings, &sights),
        )
    {
        let end = wanted(kept);
        let bytes_before =
            (before.len() - light.len()) as u64 / IDENTITY_WORDS as u64 * POINTS_PER_PAGE as u64;
        let (old, _) = g.persistent(PLACES[place], bytes_before, before, |held| held)?;
        let (counts, _) = g.persistent(PLACES[1 - place], bytes, cache_key, |_| end)?;
        g.invalidate(PLACES[place]);
        let mut tally = Tally::new(g, counts, false);
        let page = POINTS_PER_PAGE as u64;
        let parts =
            stay.iter().map(|&[from, to]| [from as u64 * page, to as u64 * page, page]).collect();
        g.copy_parts("keep light visibility", &old, &mut tally.light_visibility, parts);
        for sight in sights {
            let casters =
                invalidation::casters(&sight.view, resident, &again, travel_px(settings, &[sight]));
            let receivers: Vec<_> = again.iter().map(|&number| &resident.nodes[number]).collect();
            cast_on(
                g,
                &sight,
                resident,
                [&casters, &receivers],
                around.bounds,
                settings,
                &mut tally,
            )?;
        }
        for view in views(kept..end)? {
            cast(g, &view, resident, around.bounds, settings, &mut tally)?;
        }
        return Ok(Some(LightVisibility {
            counts: tally.light_visibility,
            unpeeled: Some(tally.unpeeled),
            saved: None,
            apart: false,
            facts: Facts { cast: end, tested: again.len() as u32, ..facts },
        }));
    }
    let (counts, kept) = g.persistent(PLACES[place], bytes, cache_key, wanted)?;
    let end = wanted(kept);
    if end == kept {
        return Ok(Some(LightVisibility {
            counts,
            unpeeled: None,
            saved: None,
            apart: false,
            facts: Facts { cast: end, ..facts },
        }));
    }
    let mut tally = Tally::new(g, counts, kept > 0);
    for view in views(kept..end)? {
        cast(g, &view, resident, around.bounds, settings, &mut tally)?;
    }
    Ok(Some(LightVisibility {
        counts: tally.light_visibility,
        unpeeled: Some(tally.unpeeled),
        saved: None,
        apart: false,
        facts: Facts { cast: end, tested: resident.nodes.len() as u32, ..facts },
    }))
}

/// Names of two persistent buffers: values for changed nodes go to the other one, next to those
/// they are copied from.
const PLACES: [&str; 2] = ["light visibility", "light visibility beside"];

/// Returns the distance in the light's pictures over which a texel may change the limit of another,
/// and one texel for rounding `[px]`.
fn travel_px(settings: &Settings, sights: &[LightCamera]) -> f64 {
    let coarsest = sights.iter().map(|sight| sight.halvings).max().unwrap_or(0);
    // Texels of a halved picture are this wide.
    (settings.fill + 2.0) * (1u64 << coarsest) as f64
}

/// Returns saved visibility that points have brought, if it is of this light.
fn saved(
    g: &mut Graph,
    context: &FrameContext,
    resident: &Resident,
) -> Option<Result<LightVisibility>> {
    let (word, contents) = (resident.shown.light()?, resident.saved_light()?);
    // Unknown fields of a file from elsewhere keep their defaults.
    let facts: Facts = serde_json::from_value(contents.facts.clone()).unwrap_or_default();
    let pages = context
        .light
        .is_written(&contents.light)
        .then(|| g.upload("saved light visibility", &resident.addresses(word)))?;
    Some(pages.map(|counts| LightVisibility {
        counts,
        unpeeled: None,
        saved: Some(contents.full),
        apart: false,
        facts: Facts { saved: true, ..facts },
    }))
}

/// Returns a cache key of all that the visibility depends on, except the nodes.
fn cache_key(
    context: &FrameContext,
    resident: &Resident,
    settings: &Settings,
    around: &cameras::Wanted,
) -> Vec<u64> {
    let (kind, place) = match context.light {
        Light::Headlight => (0, SUN),
        Light::Direction(direction) => (1, direction),
        Light::Position(position) => (2, position),
    };
    // All settings except the darkness of shadows.
    let Settings {
        method,
        samples,
        pattern,
        radius,
        size,
        ambient: _,
        layer,
        least,
        fill,
        peels,
        limit,
    } = *settings;
    let numbers =
        [place.x, place.y, place.z, samples, radius, size, layer, least, fill, peels, limit]
            .map(f64::to_bits);
    let (low, high) = around.bounds;
    let seen = [low.x, low.y, low.z, high.x, high.y, high.z, around.spacing_m].map(f64::to_bits);
    [kind, method as u64, pattern as u64]
        .into_iter()
        .chain(numbers)
        .chain(seen)
        .chain(resident.cloud_identity())
        .collect()
}

/// Buffers that are filled while shadows are cast.
pub struct Tally {
    /// Number of samples that reach each point, one byte by point id.
    pub light_visibility: Buffer,
    /// Texels where index peeling ended early.
    pub unpeeled: Buffer,
}

impl Tally {
    /// Starts at zero, or continues with the samples that are counted already.
    pub fn new(g: &mut Graph, light_visibility: Buffer, goes_on: bool) -> Tally {
        let mut tally = Tally { light_visibility, unpeeled: g.buffer("unpeeled", 4) };
        if !goes_on {
            g.fill(&mut tally.light_visibility, 0);
        }
        g.fill(&mut tally.unpeeled, 0);
        tally
    }
}

/// Returns the world bounds of all points.
fn bounds(resident: &Resident) -> Option<(DVec3, DVec3)> {
    resident.nodes.iter().map(|node| node.bounds()).reduce(|(a, b), (c, d)| (a.min(c), b.max(d)))
}

/// Adds one sample to every point that the light reaches. Returns the depth limits. `bounds` are
/// world bounds of what the light sees.
pub fn cast(
    g: &mut Graph,
    sight: &LightCamera,
    resident: &Resident,
    bounds: (DVec3, DVec3),
    settings: &Settings,
    tally: &mut Tally,
) -> Result<Reached> {
    let all: Vec<_> = resident.nodes.iter().collect();
    cast_on(g, sight, resident, [&all, &all], bounds, settings, tally)
}

/// Adds one sample to the points of `receivers`, with shadows cast by others.
fn cast_on(
    g: &mut Graph,
    sight: &LightCamera,
    resident: &Resident,
    [casters, receivers]: [&[&ResidentNode]; 2],
    bounds: (DVec3, DVec3),
    settings: &Settings,
    tally: &mut Tally,
) -> Result<Reached> {
    let camera = &sight.view;
    let mut drawn = project::draw_some(g, camera, resident, casters, Precision::Auto)?;
    let layer = Layer::of(sight, bounds, settings);
    let mut shallow = drawn.shallow(g, layer.deepest as f32);
    let keys = project::record(
        g,
        camera,
        &drawn,
        None,
        Some(&mut shallow),
        Strip { top: 0, size: camera.size },
    )
    .words;
    let reached = reach(g, camera, &keys, &layer);
    let numbers =
        |nodes: &[&ResidentNode]| nodes.iter().map(|node| node.number).collect::<Vec<_>>();
    if numbers(casters) != numbers(receivers) {
        drawn = project::draw_some(g, camera, resident, receivers, Precision::Auto)?;
        shallow = drawn.all_shallow(g);
    }
    match settings.method {
        Method::Depth => {
            by_depth(g, camera, &drawn, &shallow, &reached.limit, &mut tally.light_visibility)
        }
        Method::Index => {
            peel::record(g, camera, &drawn, &reached.limit, settings.peels as u32, tally)?
        }
    }
    Ok(reached)
}

/// Adds one sample to every point no deeper than its texel's limit, in chunks that may have such
/// points.
fn by_depth(
    g: &mut Graph,
    camera: &View,
    drawn: &Drawn,
    shallow: &Shallow,
    limit: &Buffer,
    light_visibility: &mut Buffer,
) {
    let walk = project::Walk::new(g, camera, Strip { top: 0, size: camera.size });
    for group in &drawn.groups {
        let project::Walk {
            centre,
            corner,
            size,
            near,
            lanes,
            perspective,
            texels,
            points_per_chunk,
        } = walk;
        let project::Group { first_chunk, chunk_count, planes, filtered, .. } = *group;
        let push = shadow_test::Push { centre, corner, size, near, first_chunk, chunk_count };
        let spec =
            shadow_test::Spec { lanes, planes, perspective, texels, points_per_chunk, filtered };
        let (pages, opacities, within) =
            (&drawn.pages[group.block], drawn.opacities(), drawn.within());
        g.run(
            shader::ShadowTest {
                nodes: &drawn.nodes,
                chunks: &drawn.chunks,
                shallow: &shallow.chunks,
                opacities,
                within,
                pages,
                page_words: pages,
                limit,
                limit_words: limit,
                light_visibility,
                push,
                spec,
            },
            group.tiles(),
        );
    }
}

pub fn record(
    g: &mut Graph,
    context: &FrameContext,
    settings: &Settings,
    gbuffer: GBuffer,
) -> GBuffer {
    match &gbuffer.light_visibility {
        Some(visibility) if visibility.apart => shadow_factor(g, context.view.size, gbuffer),
        Some(visibility) => GBuffer {
            color: shaded(g, context.view.size, visibility, settings.ambient, &gbuffer),
            ..gbuffer
        },
        None => gbuffer,
    }
}

/// Looks up the visibility of each pixel's point, if lighting follows; again after pixels were
/// given other points.
pub fn shadow_factor(g: &mut Graph, size: [u32; 2], gbuffer: GBuffer) -> GBuffer {
    let shadow_factor = gbuffer
        .light_visibility
        .as_ref()
        .filter(|visibility| visibility.apart)
        .map(|visibility| shaded(g, size, visibility, 0.0, &gbuffer));
    GBuffer { shadow_factor, ..gbuffer }
}

fn shaded(
    g: &mut Graph,
    size: [u32; 2],
    visibility: &LightVisibility,
    ambient: f64,
    gbuffer: &GBuffer,
) -> Image {
    let mut shaded =
        g.image(if visibility.apart { "shadow factor" } else { "shaded" }, size, Kind::Rgba32f);
    let full = visibility.saved.unwrap_or(visibility.facts.cast);
    let push = shader::shadow_apply::Push { size, full: full as f32, ambient: ambient as f32 };
    let spec =
        shader::shadow_apply::Spec { saved: visibility.saved.is_some(), apart: visibility.apart };
    let GBuffer { index, color, .. } = gbuffer;
    g.run(
        shader::ShadowApply {
            index,
            light_visibility: &visibility.counts,
            saved: &visibility.counts,
            color,
            shaded: &mut shaded,
            push,
            spec,
        },
        Dispatch::PerPixel,
    );
    shaded
}
