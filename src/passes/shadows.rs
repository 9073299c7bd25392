//! Shadows: a light and the resident points in, a mark for every point out that says how much of the light reaches it, and with it shaded colour (Dobrev et al. 2010, sec. 6).
//!
//! ```text
//!     of every place on the light, of every picture that it sees the cloud in:
//!         project       points -> keys                the trunk's own pass, through the light's camera, of all resident nodes
//!         light_cover   keys -> tiles                 that hold points: those below keep to them and what lies around
//!         light_halve   keys -> depth                 the picture half as wide and high, and again, where some surfaces are sparse in it
//!         light_fill    depth -> depth                closes gaps that light would fall through
//!         light_limit   depth -> limit                how deep light reaches: depth + layer / <v, n>
//!         light_join    limit, coarser limit -> limit     as the coarser picture has it, where what that shows is sparse here
//!         shadow_depth  points, limits -> marks       a sample more for every point that is no deeper; or, with the same marks, index peeling (peel.rs)
//!     shadows           marks, index, color -> color  before points that are hidden are taken out and holes are filled, so that filling fills with shaded colour; or, where Phong lighting runs, how much of
//!                                                     the light reaches each pixel, which is filled beside the colour and takes from what that light adds: ka + m (kd + ks)
//! ```
//! A mark is a byte, by point id, and does not depend on the camera: marks are kept while the light and the nodes stay, and then of all this only the last line runs. Samples of a light can be cast over
//! several frames, and then add up to the same marks.
//! Points have no normals: the slope of the surface comes from the light's own depths.

pub mod cameras;
pub mod changed;
pub mod disc;
mod peel;
pub mod whole;

use super::project::{self, Band, Drawn, Precision, Shallow};
use super::{Decided, Effects, Layers, Reason, Scene, Setting, Value, gate, tiles};
use crate::config::{POINTS_PER_PAGE, SUN};
use crate::error::{Error, Result};
use crate::graph::{Area, Buffer, Graph, Image, Kind, Tiles};
use crate::light::Light;
use crate::resident::{IDENTITY_WORDS, Resident, ResidentNode};
use crate::shader::{self, light_cover, light_fill, light_halve, light_join, light_limit, shadow_depth};
use crate::view::{Projection, View};
use cameras::Sight;
use changed::Changed;
use glam::DVec3;
use std::f64::consts::SQRT_2;
use std::ops::Range;

pub const SUMMARY: &str = "shadows of a light: of --light, or of a sun where that is a headlight";

#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Settings {
    pub method: Method,
    /// Places on the light; 1: its middle, a hard shadow.
    pub samples: f64,
    pub pattern: disc::Pattern,
    /// Of the light: of one far away half its angle, degrees; of one at a place, metres.
    pub radius: f64,
    /// Texels of the longer side of the light's picture; 0: from the spacing of the points.
    pub size: f64,
    /// What is left of a colour that no light reaches, where nothing else says how it is lit: Phong lighting has an ambient part of its own.
    pub ambient: f64,
    /// How far behind the surface that the light sees a point is still of it, metres across the surface; 0: the layer distance of the picture, where one is asked for, and at least what the theorem of
    /// HARD_CASES 13 asks for.
    pub layer: f64,
    /// Where `layer` is 0, it is this at least, metres: the layer distance that the picture was asked for. No setting of its own.
    #[serde(skip)]
    pub least: f64,
    /// Gaps in the light's picture that are closed, texels.
    pub fill: f64,
    /// Passes of index peeling at most; 0: until one marks nothing, 512 at most.
    pub peels: f64,
    /// The least <v, n>: beyond this cosine of the angle to the light surfaces count as no steeper.
    pub limit: f64,
}

/// How points that light reaches are found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Method {
    /// Every point is compared with the light's depth.
    #[default]
    Depth,
    /// Points are peeled off the light's picture, one a texel at a time.
    Index,
}

impl Default for Settings {
    fn default() -> Self {
        Settings { method: Method::Depth, samples: 1.0, pattern: disc::Pattern::Stratified, radius: 0.5, size: 0.0, ambient: 0.35, layer: 0.0, least: 0.0, fill: 2.0, peels: 0.0, limit: 0.2 }
    }
}

/// A byte counts them, also where a point is on the corner of three of a cube's pictures.
const MOST_SAMPLES: f64 = 64.0;

impl super::Settings for Settings {
    fn list(&mut self) -> Vec<Setting<'_>> {
        let number = Value::Number;
        vec![
            Setting { name: "method", about: "how points that light reaches are found", value: Value::Choice(&mut self.method) },
            Setting { name: "samples", about: "places on the light; 1: hard shadows", value: Value::Whole(&mut self.samples, 1.0..=MOST_SAMPLES) },
            Setting { name: "pattern", about: "how they are spread", value: Value::Choice(&mut self.pattern) },
            Setting { name: "radius", about: "of the light: degrees of one far away (45 at most), metres of one at a place", value: number(&mut self.radius, 0.0..=1e6) },
            Setting { name: "size", about: "of the light's picture, texels; 0: from the spacing of the points", value: Value::Whole(&mut self.size, 0.0..=4096.0) },
            Setting { name: "ambient", about: "what is left of a colour in full shadow; of phong, where that runs, its own ambient", value: number(&mut self.ambient, 0.0..=1.0) },
            Setting { name: "layer", about: "layer distance of this effect alone, metres; 0: that of --layer where that is given, and at least what keeps surfaces from shading themselves", value: number(&mut self.layer, 0.0..=1e9) },
            Setting { name: "fill", about: "width of gaps that light does not fall through, texels", value: Value::Whole(&mut self.fill, 0.0..=16.0) },
            Setting { name: "peels", about: "passes of method=index at most, as many as points of a texel can be lit; 0: until nothing is left, 512 at most", value: Value::Whole(&mut self.peels, 0.0..=4096.0) },
            Setting { name: "limit", about: "least cosine of the angle between light and surface", value: number(&mut self.limit, 0.01..=1.0) },
        ]
    }

    /// What holds no point stays as it is.
    fn grows_px(&self, _spacing_px: f64) -> f64 {
        0.0
    }
}

/// As [`super::Effects::reach_px`].
pub fn reach_px(_view: &View, _settings: &Settings) -> Option<u32> {
    Some(0)
}

pub fn called_for(scene: &Scene, _asked: &Effects, _before: &Decided) -> Reason {
    let why = match scene.points {
        0 => "there is nothing to cast any",
        _ if scene.lit => return Reason { runs: true, why: "they were saved, and cost nothing".into() },
        _ => "nobody asked: they cost a walk over all points, twice, for every sample of the light; --effect shadows=on",
    };
    Reason { runs: false, why: why.to_string() }
}

/// How much light reaches each point.
pub struct Marks {
    /// A byte a point, by its id: how many samples of the light reach it, of those that were cast.
    pub counts: Buffer,
    /// Instead of that, of every node the page with the marks that its points have brought, of which so many say that all of the light reaches a point.
    pub saved: Option<u32>,
    /// Lighting comes after, and takes them into account.
    pub apart: bool,
    /// For `--explain`.
    pub facts: Facts,
}

/// How shadows were cast.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Facts {
    /// Once and for all, of the whole cloud: no light pass runs.
    pub saved: bool,
    pub samples: u32,
    /// Of these, those that marks are made of so far.
    pub cast: u32,
    /// Nodes whose points this frame has marked; the others have kept their marks.
    pub marked: u32,
    /// Of the light, of each sample.
    pub pictures: u32,
    /// Texels of the first picture.
    pub size: [u32; 2],
    /// How often it is halved, to close gaps in what is sparse in it.
    #[serde(default)]
    pub halvings: u32,
    /// Side of a texel, metres; in the middle of the cloud, where the light is at a place.
    pub texel_m: f64,
    /// How far behind a surface that faces the light shadow begins, metres: the contact gap. On one at an angle it is as much across the surface.
    pub layer_m: f64,
}

impl Facts {
    fn new(cameras: &[Sight], bounds: (DVec3, DVec3), settings: &Settings) -> Facts {
        let samples = settings.samples as u32;
        let Some(Sight { view: first, halvings, spacing_m, .. }) = cameras.first() else { return Facts { samples, cast: samples, ..Facts::default() } };
        let layer = Layer::new(first, bounds, settings);
        let middle = (bounds.0 + bounds.1) / 2.0 - first.camera.eye;
        let texel_m = layer.texel * if layer.perspective { middle.length() } else { 1.0 };
        // Of the picture that closes gaps between points there.
        let taken = cameras::halvings(spacing_m / texel_m, f64::INFINITY).min(*halvings);
        let layer_m = layer.metres + layer.texels * texel_m * (1u64 << taken) as f64;
        Facts { saved: false, samples, cast: samples, marked: 0, pictures: cameras.len() as u32, size: first.size, halvings: *halvings, texel_m, layer_m }
    }
}

fn plural(count: u32) -> &'static str {
    if count == 1 { "" } else { "s" }
}

impl std::fmt::Display for Facts {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let [width, height] = self.size;
        let halved = if self.halvings == 0 { String::new() } else { format!(", and {} coarser where points are sparse in it", self.halvings) };
        write!(
            f,
            "{}{} sample{} of the light, {} cast, points of {} nodes marked by this frame, {} picture{} each of {width} x {height} texels of {:.6} m{}; shadow begins {:.6} m behind a surface",
            if self.saved { "saved ones, of all points, so that no light pass runs; " } else { "" },
            self.samples, plural(self.samples), self.cast, self.marked, self.pictures, plural(self.pictures), self.texel_m, halved, self.layer_m
        )
    }
}

/// Marks of all points of the frame; none where shadows do not run. Of the light's samples `at_once` at most are added to those that are kept, and one where there are none; all, where nothing is said.
pub fn marks(g: &mut Graph, scene: &Scene, resident: &Resident, effects: &Effects, decided: &Decided, at_once: Option<u32>) -> Result<Option<Marks>> {
    if !decided.runs("shadows") {
        return Ok(None);
    }
    let marks = match saved(g, scene, resident) {
        Some(saved) => Some(saved?),
        None => counted(g, scene, resident, &Settings { least: scene.asked_layer_m, ..effects.shadows.settings }, at_once)?,
    };
    Ok(marks.map(|marks| Marks { apart: decided.runs("phong"), ..marks }))
}

fn counted(g: &mut Graph, scene: &Scene, resident: &Resident, settings: &Settings, at_once: Option<u32>) -> Result<Option<Marks>> {
    let Some(bounds) = bounds(resident) else { return Ok(None) };
    let bytes = resident.nodes.len() as u64 * POINTS_PER_PAGE as u64;
    if bytes.next_power_of_two() > g.binding_limit() {
        return Err(Error::Request(format!(
            "shadows mark {} nodes at once, and this device binds the marks of {} at most; draw fewer with --budget, or --effect shadows=off",
            resident.nodes.len(),
            g.binding_limit() / POINTS_PER_PAGE as u64
        )));
    }
    let samples = settings.samples as u32;
    let wanted = |kept: u32| at_once.map_or(samples, |more| (kept + more).clamp(1, samples));
    let around = cameras::Wanted::around(resident, bounds, scene.spacing_m, settings);
    let places = disc::spread(disc::places(samples, settings.pattern, 0));
    let views = |samples: Range<u32>| -> Result<Vec<Sight>> {
        let of = places[samples.start as usize..samples.end as usize].iter().map(|&place| cameras::cameras(scene.light, &around, place));
        Ok(of.collect::<Result<Vec<_>>>()?.concat())
    };
    let facts = Facts::new(&cameras::cameras(scene.light, &around, places[0])?, around.bounds, settings);

    let (light, nodes) = (made_of(scene, resident, settings, &around), resident.nodes_identity());
    let made_of = [light.as_slice(), &nodes].concat();
    let place = (0..2).find(|&place| g.held(PLACES[place]).is_some_and(|(of, _)| of.starts_with(&light))).unwrap_or(0);
    let before = g.held(PLACES[place]).filter(|(of, _)| of.starts_with(&light)).map(|(of, steps)| (of.to_vec(), steps));
    // A frame that is in a hurry does not cast many samples anew, if only for some nodes: it begins with one.
    if let Some((before, kept)) = before.filter(|(before, kept)| *before != made_of && settings.method == Method::Depth && (*kept == 1 || at_once != Some(0)))
        && let sights = views(0..kept)?
        && let Some(Changed { stay, again }) = changed::changed(&before[light.len()..], resident, &sights.iter().map(|sight| sight.view).collect::<Vec<_>>(), travel_px(settings, &sights))
    {
        let end = wanted(kept);
        let bytes_before = (before.len() - light.len()) as u64 / IDENTITY_WORDS as u64 * POINTS_PER_PAGE as u64;
        let (old, _) = g.kept(PLACES[place], bytes_before, before, |held| held)?;
        let (counts, _) = g.kept(PLACES[1 - place], bytes, made_of, |_| end)?;
        g.forget(PLACES[place]);
        let mut tally = Tally::new(g, counts, false);
        let page = POINTS_PER_PAGE as u64;
        let parts = stay.iter().map(|&[from, to]| [from as u64 * page, to as u64 * page, page]).collect();
        g.copy_parts("stay marks", &old, &mut tally.marks, parts);
        for sight in sights {
            let casters = changed::casters(&sight.view, resident, &again, travel_px(settings, &[sight]));
            let marked: Vec<_> = again.iter().map(|&number| &resident.nodes[number]).collect();
            cast_on(g, &sight, resident, [&casters, &marked], around.bounds, settings, &mut tally)?;
        }
        for view in views(kept..end)? {
            cast(g, &view, resident, around.bounds, settings, &mut tally)?;
        }
        return Ok(Some(Marks { counts: tally.marks, saved: None, apart: false, facts: Facts { cast: end, marked: again.len() as u32, ..facts } }));
    }
    let (counts, kept) = g.kept(PLACES[place], bytes, made_of, wanted)?;
    let end = wanted(kept);
    if end == kept {
        return Ok(Some(Marks { counts, saved: None, apart: false, facts: Facts { cast: end, ..facts } }));
    }
    let mut tally = Tally::new(g, counts, kept > 0);
    for view in views(kept..end)? {
        cast(g, &view, resident, around.bounds, settings, &mut tally)?;
    }
    Ok(Some(Marks { counts: tally.marks, saved: None, apart: false, facts: Facts { cast: end, marked: resident.nodes.len() as u32, ..facts } }))
}

/// Where marks are kept: those of other nodes go to the other one, beside those that they were made of.
const PLACES: [&str; 2] = ["marks", "marks beside"];

/// How far in the light's pictures what one texel shows may change the limit of another, and a texel for rounding.
fn travel_px(settings: &Settings, sights: &[Sight]) -> f64 {
    let coarsest = sights.iter().map(|sight| sight.halvings).max().unwrap_or(0);
    // Within a halved picture; one of its texels is as wide as so many.
    (settings.fill + 2.0) * (1u64 << coarsest) as f64
}

/// Those that points have brought, where they are of this light.
fn saved(g: &mut Graph, scene: &Scene, resident: &Resident) -> Option<Result<Marks>> {
    let (word, contents) = (resident.shown.light()?, resident.light.as_ref()?);
    // Of an index that somebody else has written, what is not known is nothing.
    let facts: Facts = serde_json::from_value(contents.facts.clone()).unwrap_or_default();
    let pages = scene.light.is_written(&contents.light).then(|| g.upload("saved marks", &resident.addresses(word)))?;
    Some(pages.map(|counts| Marks { counts, saved: Some(contents.full), apart: false, facts: Facts { saved: true, ..facts } }))
}

/// All that marks depend on but the nodes.
fn made_of(scene: &Scene, resident: &Resident, settings: &Settings, around: &cameras::Wanted) -> Vec<u64> {
    let (kind, place) = match scene.light {
        Light::Headlight => (0, SUN),
        Light::Direction(direction) => (1, direction),
        Light::Position(position) => (2, position),
    };
    // Of settings, all but how dark shadows are.
    let Settings { method, samples, pattern, radius, size, ambient: _, layer, least, fill, peels, limit } = *settings;
    let numbers = [place.x, place.y, place.z, samples, radius, size, layer, least, fill, peels, limit].map(f64::to_bits);
    let (low, high) = around.bounds;
    let seen = [low.x, low.y, low.z, high.x, high.y, high.z, around.spacing_m].map(f64::to_bits);
    [kind, method as u64, pattern as u64].into_iter().chain(numbers).chain(seen).chain(resident.cloud_identity()).collect()
}

/// What is counted while shadows are cast.
pub struct Tally {
    /// A byte a point, by its id: how many samples of the light reach it.
    pub marks: Buffer,
    /// Texels that index peeling was cut off in.
    pub unpeeled: Buffer,
}

impl Tally {
    /// From nothing, or beside the samples that marks are made of already.
    pub fn new(g: &mut Graph, marks: Buffer, goes_on: bool) -> Tally {
        let mut tally = Tally { marks, unpeeled: g.buffer("unpeeled", 4) };
        if !goes_on {
            g.fill(&mut tally.marks, 0);
        }
        g.fill(&mut tally.unpeeled, 0);
        tally
    }
}

/// World corners of all points.
fn bounds(resident: &Resident) -> Option<(DVec3, DVec3)> {
    resident.nodes.iter().map(|node| node.bounds()).reduce(|(a, b), (c, d)| (a.min(c), b.max(d)))
}

/// A sample more for every point that the camera's light reaches; what the light sees, and how deep it reaches. `bounds` are those that the light sees, world corners.
pub fn cast(g: &mut Graph, sight: &Sight, resident: &Resident, bounds: (DVec3, DVec3), settings: &Settings, tally: &mut Tally) -> Result<Reached> {
    let all: Vec<_> = resident.nodes.iter().collect();
    cast_on(g, sight, resident, [&all, &all], bounds, settings, tally)
}

/// The same for the points of some nodes, of shadows that some cast.
fn cast_on(
    g: &mut Graph,
    sight: &Sight,
    resident: &Resident,
    [casters, marked]: [&[&ResidentNode]; 2],
    bounds: (DVec3, DVec3),
    settings: &Settings,
    tally: &mut Tally,
) -> Result<Reached> {
    let camera = &sight.view;
    let mut drawn = project::draw_some(g, camera, resident, casters, Precision::Auto)?;
    let layer = Layer::of(sight, bounds, settings);
    let mut shallow = drawn.shallow(g, layer.deepest as f32);
    let keys = project::record(g, camera, &drawn, None, Some(&mut shallow), Band { top: 0, size: camera.size }).words;
    let reached = reach(g, camera, &keys, &layer);
    let numbers = |nodes: &[&ResidentNode]| nodes.iter().map(|node| node.number).collect::<Vec<_>>();
    if numbers(casters) != numbers(marked) {
        drawn = project::draw_some(g, camera, resident, marked, Precision::Auto)?;
        shallow = drawn.all_shallow(g);
    }
    match settings.method {
        Method::Depth => by_depth(g, camera, &drawn, &shallow, &reached.limit, &mut tally.marks),
        Method::Index => peel::record(g, camera, &drawn, &reached.limit, settings.peels as u32, tally)?,
    }
    Ok(reached)
}

/// How far behind what the light sees a point still belongs to it.
#[derive(Clone, Copy, Debug)]
pub struct Layer {
    pub perspective: bool,
    /// Side of a texel: metres, or with perspective parts of the depth.
    pub texel: f64,
    /// Across the surface: metres, and sides of a texel.
    pub metres: f64,
    pub texels: f64,
    /// Tangent of the steepest angle to the light.
    pub steepest: f64,
    /// How far behind the nearest point of a texel light may reach at most, metres.
    pub deepest: f64,
    pub fill: u32,
    /// As of a [`Sight`].
    pub margin: u32,
    pub halvings: u32,
    pub spacing_m: f64,
}

impl Layer {
    pub fn of(sight: &Sight, bounds: (DVec3, DVec3), settings: &Settings) -> Layer {
        let &Sight { ref view, margin, halvings, spacing_m } = sight;
        // Who lets light through gaps lets it through wide ones, too.
        let halvings = if settings.fill > 0.0 { halvings } else { 0 };
        Layer { margin, halvings, spacing_m, ..Layer::new(view, bounds, settings) }
    }

    /// The depth up to which points of a surface lie so far apart in this picture that a coarser one closes the gaps between them, metres.
    pub fn sparse_m(&self) -> f32 {
        let apart_px = self.spacing_m / self.texel / cameras::SPARSE;
        match self.perspective {
            true => apart_px as f32,
            false if apart_px > 1.0 => f32::INFINITY,
            false => 0.0,
        }
    }

    /// Of a picture half as wide and high.
    fn halved(&self) -> Layer {
        Layer { texel: 2.0 * self.texel, margin: 0, halvings: self.halvings - 1, ..*self }
    }

    /// HARD_CASES 13: sqrt(2) sides of a texel and a quantum, twice the sides where masks fill from neighbours.
    pub fn new(camera: &View, bounds: (DVec3, DVec3), settings: &Settings) -> Layer {
        let fill = settings.fill as u32;
        let farthest = camera.depths(bounds).map_or(0.0, |(_, farthest)| farthest);
        // A depth is eight roundings off at most, and two depths are compared; positions are quantised far below.
        let quantum = 16.0 * f32::EPSILON as f64 * farthest;
        let perspective = camera.camera.projection == Projection::Perspective;
        let texel = 1.0 / camera.focal_px();
        let across = |(metres, texels): (f64, f64)| metres + texels * texel * if perspective { farthest } else { 1.0 };
        let theorem = (quantum, if fill > 0 { 2.0 * SQRT_2 } else { SQRT_2 });
        let (metres, texels) = match settings.layer {
            0.0 if across(theorem) < settings.least => (settings.least, 0.0),
            0.0 => theorem,
            metres => (metres, 0.0),
        };
        let steepest = (1.0 / (settings.limit * settings.limit) - 1.0).max(0.0).sqrt();
        let across = across((metres, texels));
        // Gaps are closed by what is nearer still; and two quanta for what is rounded on the way.
        let deepest = across * (1.0 + steepest * steepest).sqrt() + 2.0 * quantum;
        Layer { perspective, texel, metres, texels, steepest, deepest, fill, margin: 0, halvings: 0, spacing_m: 0.0 }
    }
}

/// Of every texel of a light's picture, f32, row by row.
pub struct Reached {
    /// What the light sees, gaps closed; infinite where nothing is, and anything farther from points than gaps are closed. None where nothing closes gaps: the depths of the keys.
    pub filled: Option<Buffer>,
    /// How deep it reaches; likewise.
    pub limit: Buffer,
    /// The halved picture that both were joined with, and its depths.
    pub coarser: Option<(Buffer, Box<Reached>)>,
    /// Where they are known.
    area: Area,
}

/// Keys of the light's picture -> how deep it reaches, wherever points are and beside them.
pub fn reach(g: &mut Graph, camera: &View, keys: &Buffer, layer: &Layer) -> Reached {
    reach_of(g, camera.size, (keys, true), layer, f32::INFINITY)
}

/// The same of depths, where that is said; wherever points are that are nearer than `within`, metres, and infinite elsewhere.
fn reach_of(g: &mut Graph, size: [u32; 2], (depth, of_keys): (&Buffer, bool), layer: &Layer, within: f32) -> Reached {
    let across = tiles(size);
    let (count, bytes) = (across[0] * across[1], 4 * size[0] as u64 * size[1] as u64);
    let (perspective, texels) = (layer.perspective, g.gpu.device.texels);
    // All are told the same.
    macro_rules! push {
        ($module:ident, $filled:expr) => {
            $module::Push {
                size,
                texel: layer.texel as f32,
                layer: layer.metres as f32,
                layer_px: layer.texels as f32,
                steepest: layer.steepest as f32,
                filled: $filled as f32,
                within,
                margin: layer.margin,
            }
        };
    }
    let sparse = layer.sparse_m();
    let coarser = (layer.halvings > 0).then(|| {
        let half = size.map(|side| side.div_ceil(2));
        let mut halved = g.buffer("light halved", 4 * half[0] as u64 * half[1] as u64);
        let spec = light_halve::Spec { perspective, texels, of_keys };
        let groups = Tiles::Groups([half[0].div_ceil(64), half[1], 1]);
        g.run(shader::LightHalve { depth, depth_words: depth, halved: &mut halved, push: push!(light_halve, 0), spec }, groups);
        let reached = reach_of(g, half, (&halved, false), &layer.halved(), sparse);
        (halved, Box::new(reached))
    });
    let mut covered = g.buffer("light covered", 4 * count as u64);
    g.fill(&mut covered, 0);
    let spec = light_cover::Spec { perspective, texels, of_keys };
    g.run(shader::LightCover { depth, depth_words: depth, covered: &mut covered, push: push!(light_cover, 0), spec }, Tiles::ByEight(count));
    let area = gate::listed(g, &covered, across, layer.fill as f64);
    let everywhere = within == f32::INFINITY;
    let known = |g: &mut Graph, name: &str| {
        let mut buffer = g.buffer(name, bytes);
        if !everywhere {
            g.fill(&mut buffer, f32::INFINITY.to_bits());
        }
        buffer
    };
    let mut closed: Vec<Buffer> = (0..layer.fill).map(|_| known(g, "light filled")).collect();
    let mut limit = known(g, "light limit");
    g.within(Some(&area), |g| {
        for step in 0..layer.fill as usize {
            let spec = light_fill::Spec { perspective, texels, of_keys: of_keys && step == 0 };
            let (before, after) = closed.split_at_mut(step);
            let depth = before.last().unwrap_or(depth);
            g.run(shader::LightFill { depth, depth_words: depth, filled: &mut after[0], push: push!(light_fill, step), spec }, Tiles::ByEight(count));
        }
        let spec = light_limit::Spec { perspective, texels, of_keys: of_keys && layer.fill == 0 };
        let seen = closed.last().unwrap_or(depth);
        g.run(shader::LightLimit { depth: seen, depth_words: seen, limit: &mut limit, push: push!(light_limit, layer.fill), spec }, Tiles::ByEight(count));
    });
    let mut filled = closed.pop();
    if let (Some(front), Some((_, coarse))) = (&mut filled, &coarser) {
        let coarse_front = coarse.filled.as_ref().expect("pictures are halved where gaps are closed");
        let push = light_join::Push { size, within: sparse };
        let tiles = tiles(size.map(|side| side.div_ceil(2)));
        g.within(Some(&coarse.area), |g| {
            g.run(shader::LightJoin { coarse_front, coarse_limit: &coarse.limit, front, limit: &mut limit, push }, Tiles::ByEight(tiles[0] * tiles[1]));
        });
    }
    Reached { filled, limit, coarser, area }
}

/// A sample more for every point that lies no deeper than its texel's limit, of chunks that have any which may.
fn by_depth(g: &mut Graph, camera: &View, drawn: &Drawn, shallow: &Shallow, limit: &Buffer, marks: &mut Buffer) {
    let walk = project::Walk::new(g, camera, Band { top: 0, size: camera.size });
    for group in &drawn.groups {
        let project::Walk { centre, corner, size, near, lanes, perspective, texels, points_per_chunk } = walk;
        let project::Group { first_chunk, chunk_count, planes, filtered, .. } = *group;
        let push = shadow_depth::Push { centre, corner, size, near, first_chunk, chunk_count };
        let spec = shadow_depth::Spec { lanes, planes, perspective, texels, points_per_chunk, filtered };
        let (pages, opacities, within) = (&drawn.pages[group.block], drawn.opacities(), drawn.within());
        g.run(
            shader::ShadowDepth { nodes: &drawn.nodes, chunks: &drawn.chunks, shallow: &shallow.chunks, opacities, within, pages, page_words: pages, limit, limit_words: limit, marks, push, spec },
            group.tiles(),
        );
    }
}

pub fn record(g: &mut Graph, scene: &Scene, settings: &Settings, layers: Layers) -> Layers {
    match &layers.marks {
        Some(marks) if marks.apart => reached(g, scene.view.size, layers),
        Some(marks) => Layers { color: shaded(g, scene.view.size, marks, settings.ambient, &layers), ..layers },
        None => layers,
    }
}

/// How much of the light reaches the point of each pixel, where lighting comes after: again once pixels were given other points.
pub fn reached(g: &mut Graph, size: [u32; 2], layers: Layers) -> Layers {
    let reached = layers.marks.as_ref().filter(|marks| marks.apart).map(|marks| shaded(g, size, marks, 0.0, &layers));
    Layers { reached, ..layers }
}

fn shaded(g: &mut Graph, size: [u32; 2], marks: &Marks, ambient: f64, layers: &Layers) -> Image {
    let mut shaded = g.image(if marks.apart { "reached" } else { "shaded" }, size, Kind::Rgba32f);
    let full = marks.saved.unwrap_or(marks.facts.cast);
    let push = shader::shadows::Push { size, full: full as f32, ambient: ambient as f32 };
    let spec = shader::shadows::Spec { saved: marks.saved.is_some(), apart: marks.apart };
    let Layers { index, color, .. } = layers;
    g.run(shader::Shadows { index, marks: &marks.counts, saved: &marks.counts, color, shaded: &mut shaded, push, spec }, Tiles::All);
    shaded
}
