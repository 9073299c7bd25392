//! Strokes: points with normals, sizes and clusters in; a painting of them out (dos Anjos et al. 2018).
//!
//! ```text
//!     stroke_brush   settings -> 256 brushes, kept
//!     stroke_bins    points -> how many strokes may touch each tile; read back, since only then is it known how much room they need
//!     stroke_bins    points -> which
//!     strokes        strokes of a tile -> keys, in place of those that project makes: z-buffered strokes; so many of each tile at a time
//!   blend=blur:
//!     stroke_blur    color -> color, across and down
//!   blend=abuffer:
//!     strokes        how many fragments each pixel has; read back; where they are many, again without those that others hide
//!     strokes        the fragments
//!     stroke_sort    fragments -> color, in order; over several frames, where the A-buffer is kept
//! ```
//! No list has a fixed size: each is as long as was counted, and where that is more than the memory allowed the picture is painted in parts, of tiles, and where a single tile has too many, of points; which changes no pixel. Points are looked for around the picture,
//! too, as far as strokes reach: a wider view of the same camera is walked over, and the picture is its middle.

mod abuffer;
pub mod brush;

use super::project::{self, Band, Drawn, Precision};
use super::resolve::{self, Paint, Resolved};
use super::{Decided, Effects, Layers, Reason, Scene, Setting, TILE_PX, Value, tiles};
use crate::error::{Error, Result};
use crate::graph::{Buffer, Graph, Image, Kind, Tiles};
use crate::resident::Resident;
use crate::shader::{self, Canvas, Home, stroke_bins, stroke_blur, stroke_brush, stroke_sort};
use crate::view::{Camera, Projection, View};
use abuffer::Abuffer;
use brush::{Bristles, Brush};
use std::ops::Range;

pub const SUMMARY: &str = "every point a brush stroke along its surface, as large as points are apart there (--style strokes)";

#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Settings {
    pub brush: Brush,
    pub blend: Blend,
    pub sort: Sort,
    pub order: Order,
    pub tangents: Tangents,
    /// Of the brush where 0: see [`Bristles`].
    pub size: f64,
    pub amplitude: f64,
    pub gamma: f64,
    pub sigma_x: f64,
    pub sigma_y: f64,
    pub dev: f64,
    pub gaussians: f64,
    /// Strokes are turned from their tangents by so much at most, degrees.
    pub noise: f64,
    /// How much longer strokes are on clusters that are twice as long as wide.
    pub long: f64,
    /// Half a stroke's side on the screen, at most, pixels.
    pub largest: f64,
    /// Passes of sort=bubble; 0: until everything is in order.
    pub passes: f64,
    /// Of lists and fragments, MiB.
    pub memory: f64,
    /// Radius of blend=blur, pixels.
    pub radius: f64,
}

/// What strokes that lie over each other look like.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Blend {
    /// Each shows through those before it as far as they leave it uncovered.
    #[default]
    Abuffer,
    /// The nearest is all there is; softened.
    Blur,
    /// The nearest is all there is.
    Opaque,
}

/// How the fragments of a pixel are brought into order.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Sort {
    #[default]
    Exact,
    /// A fragment a pass, as a picture that stands still is refined.
    Bubble,
}

/// What the fragments of a pixel are ordered by.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Order {
    /// Their own depths: strokes that lie askew run through each other (the paper's second limitation).
    #[default]
    Pixel,
    /// Those of their strokes' points: a stroke is over another one everywhere.
    Stroke,
}

/// What strokes are painted along.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Tangents {
    #[default]
    Householder,
    Eberly,
    Squareplate,
    /// Where a point's neighbours spread most.
    Covariance,
}

impl Default for Settings {
    fn default() -> Self {
        Settings {
            brush: Brush::default(),
            blend: Blend::default(),
            sort: Sort::default(),
            order: Order::default(),
            tangents: Tangents::default(),
            size: 0.0,
            amplitude: 0.0,
            gamma: 0.0,
            sigma_x: 0.0,
            sigma_y: 0.0,
            dev: 0.0,
            gaussians: 0.0,
            noise: 20.0,
            long: 0.5,
            largest: 96.0,
            passes: 0.0,
            memory: 512.0,
            radius: 2.0,
        }
    }
}

impl super::Settings for Settings {
    fn list(&mut self) -> Vec<Setting<'_>> {
        let number = Value::Number;
        vec![
            Setting { name: "brush", about: "which brush", value: Value::Choice(&mut self.brush) },
            Setting { name: "blend", about: "what strokes over each other look like", value: Value::Choice(&mut self.blend) },
            Setting { name: "sort", about: "how the strokes of a pixel are ordered", value: Value::Choice(&mut self.sort) },
            Setting { name: "order", about: "what it goes by: the depth in each pixel, or that of the whole stroke", value: Value::Choice(&mut self.order) },
            Setting { name: "tangents", about: "what strokes are painted along", value: Value::Choice(&mut self.tangents) },
            Setting { name: "size", about: "half a stroke's side, radii of its point; 0: the brush's own, here and below", value: number(&mut self.size, 0.0..=64.0) },
            Setting { name: "amplitude", about: "of a Gaussian: how opaque", value: number(&mut self.amplitude, 0.0..=64.0) },
            Setting { name: "gamma", about: "its exponent: how square", value: number(&mut self.gamma, 0.0..=16.0) },
            Setting { name: "sigma_x", about: "its width along the tangent, parts of a side", value: number(&mut self.sigma_x, 0.0..=4.0) },
            Setting { name: "sigma_y", about: "and across it", value: number(&mut self.sigma_y, 0.0..=4.0) },
            Setting { name: "dev", about: "from one to the next on the 3 x 3 grid, parts of a side", value: number(&mut self.dev, 0.0..=1.0) },
            Setting { name: "gaussians", about: "of the grid, 6 to 9", value: number(&mut self.gaussians, 0.0..=9.0) },
            Setting { name: "noise", about: "how far strokes are turned at most, degrees", value: number(&mut self.noise, 0.0..=180.0) },
            Setting { name: "long", about: "how much longer strokes are on long clusters", value: number(&mut self.long, 0.0..=1.0) },
            Setting { name: "largest", about: "half a side on the screen at most, pixels", value: number(&mut self.largest, 1.0..=512.0) },
            Setting { name: "passes", about: "of sort=bubble; 0: until all are in order", value: number(&mut self.passes, 0.0..=1e6) },
            Setting { name: "memory", about: "of lists and fragments, MiB; what needs more is painted in parts", value: number(&mut self.memory, 1.0..=65536.0) },
            Setting { name: "radius", about: "of blend=blur, pixels", value: number(&mut self.radius, 1.0..=8.0) },
        ]
    }
}

/// As [`super::Effects::reach_px`]. Strokes themselves are looked for as far as they reach, so only softening counts.
pub fn reach_px(_view: &View, settings: &Settings) -> Option<u32> {
    Some(settings.radius.ceil() as u32)
}

pub fn called_for(_scene: &Scene, _asked: &Effects, _before: &Decided) -> Reason {
    Reason { runs: false, why: "nobody asked for a painting; --style strokes".to_string() }
}

/// Half a side on the screen at least, pixels: a smaller stroke would fall between the pixels' middles.
pub const LEAST_PX: f32 = 1.5;
/// Coverage that hides what is behind from the depth layer, and in z-buffered strokes.
const HIDES: f32 = 0.5;
/// Around the picture, largest half sides: a corner of the longest stroke, seen at an angle.
const MARGIN: f64 = 4.0;
/// As glsl/stroke_brush.comp: 256 brushes of 32 x 32 words.
const BRUSH_WORDS: u32 = 256 * 32 * 32;
const GROUPS_A_ROW: u32 = 65_535;
/// Strokes of each tile that a pass looks at, as in glsl/strokes.comp; and how often all loops of an invocation together may go round on lavapipe, less a margin.
const STROKES_AT_ONCE: usize = 8192;
const ROUNDS: u32 = 60_000;
/// Workgroups that share a chunk there, so that 16 points one after the other may touch thousands of tiles each.
const SLICES: u32 = 32;
/// Where more fragments than this lie over each other, it pays to look for those that nothing can be seen of: to look at all strokes once more.
const MANY: u32 = 2048;
/// Bytes of a stroke in a list, and of a fragment.
const PLACE_BYTES: u64 = 48;
const FRAGMENT_BYTES: u64 = 8;

/// What painting took, for `--explain`.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct Facts {
    /// Strokes in the lists of tiles; one that touches two tiles counts twice.
    pub listed: u64,
    /// Of the A-buffer.
    pub fragments: u64,
    /// That are not in it, because they lie behind one that covers its pixel wholly; no others are left out.
    pub hidden: u64,
    /// In one pixel, at most.
    pub deepest: u32,
    /// In which the picture was painted, because all lists together would have been larger than the memory allowed.
    pub parts: u32,
    /// Of the largest part.
    pub bytes: u64,
    /// On the device, of what was counted beforehand, milliseconds.
    pub counting_ms: f64,
}

impl Facts {
    /// Of an A-buffer that is kept, what later frames say of it.
    fn notes(&self) -> [u64; 5] {
        [self.listed, self.fragments, self.hidden, self.deepest as u64, self.bytes]
    }

    /// Where the memory allowed was reached.
    pub fn note(&self) -> Option<String> {
        let parts = self.parts;
        (parts > 1).then(|| format!("painted in {parts} parts, because the memory allowed was reached; more, and fewer parts, with --abuffer-memory; the picture is the same"))
    }

    fn of([listed, fragments, hidden, deepest, bytes]: [u64; 5]) -> Facts {
        Facts { listed, fragments, hidden, deepest: deepest as u32, parts: 1, bytes, counting_ms: 0.0 }
    }
}

impl std::fmt::Display for Facts {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "{} in the lists of tiles; {} fragments, {} in a pixel at most, none left out but {} wholly behind others; {} MiB, {}",
            self.listed,
            self.fragments,
            self.deepest,
            self.hidden,
            self.bytes.div_ceil(1 << 20),
            self.note().unwrap_or("all at once".into())
        )
    }
}

/// A painted picture.
pub struct Painted {
    pub facts: Facts,
    /// Where its strokes are brought into order over several frames, and these are not all of them: a word to be read after the frame, not 0 where order would still change a pixel.
    pub unordered: Option<Buffer>,
}

/// A frame whose points are painted.
pub struct Painting<'f> {
    /// Wider than the picture by the margin, on all sides.
    wide: View,
    view: &'f View,
    resident: &'f Resident,
    decided: &'f Decided,
    settings: Settings,
    /// Fragments of a pixel that this frame brings into order beside those that are.
    at_once: Option<u32>,
    /// Blended colours of the whole picture.
    blended: Option<Image>,
    unordered: Option<Buffer>,
    facts: Facts,
}

/// None where points are not painted. Of each pixel's fragments `at_once` at most are brought into order beside those that frames before this one have; all, where nothing is said.
pub fn begin<'f>(
    g: &mut Graph,
    view: &'f View,
    resident: &'f Resident,
    effects: &Effects,
    decided: &'f Decided,
    at_once: Option<u32>,
) -> Result<Option<Painting<'f>>> {
    if !decided.runs("strokes") {
        return Ok(None);
    }
    if resident.shown.strokes().is_none() {
        return Err(Error::Request("strokes need to know how points lie, which nobody has found out for these: --style strokes".into()));
    }
    let settings = effects.strokes.settings;
    let blended = (settings.blend == Blend::Abuffer).then(|| g.image("blended", view.size, Kind::Rgba32f));
    let wide = widened(view, margin(&settings));
    Ok(Some(Painting { wide, view, resident, decided, settings, at_once, blended, unordered: None, facts: Facts::default() }))
}

fn margin(settings: &Settings) -> u32 {
    (MARGIN * settings.largest).ceil() as u32
}

/// The same camera with so many pixels more on every side.
fn widened(view: &View, margin: u32) -> View {
    view.window(view.corner.map(|at| at - margin as i32), view.size.map(|side| side + 2 * margin))
}

/// What the passes of one submission share.
struct Desk<'p> {
    drawn: Drawn,
    homes: Buffer,
    canvas: Buffer,
    paint: &'p Paint,
    turns: Buffer,
    brushes: Buffer,
    band: Band,
    tiles: [u32; 2],
}

/// Tiles in a row that are painted at once, and of an A-buffer, tile by tile, how many fragments each of their pixels has.
struct Part {
    tiles: Range<u32>,
    fragments: Vec<u32>,
    /// Where there are many, how deep the nearest lies that covers a pixel wholly: those behind it are none of them.
    hiders: Option<Vec<u32>>,
}

/// Tiles in a row, and the list of their strokes.
struct Bins {
    part: Buffer,
    strokes: Buffer,
    /// Strokes of one of the tiles, at most.
    longest: u32,
}

fn groups(tiles: u32) -> Tiles<'static> {
    Tiles::Groups([tiles.min(GROUPS_A_ROW), tiles.div_ceil(GROUPS_A_ROW), 1])
}

impl Painting<'_> {
    /// Keys of a band, as those of [`project::record`]; and its part of the blended colours.
    pub fn record(&mut self, g: &mut Graph, paint: &Paint, band: Band) -> Result<Buffer> {
        let made_of = self.at_once.filter(|_| self.blended.is_some() && band.size == self.view.size).map(|_| self.made_of(paint));
        if let Some(made_of) = &made_of
            && let Some(notes) = abuffer::held(g, made_of)
        {
            self.facts = Facts::of(notes);
            return self.go_on(g, paint, band, made_of);
        }
        let listed = self.listed(g, band)?;
        let parts = self.parts(g, band, &listed)?;
        let desk = self.lay(g, band, paint)?;
        self.paint(g, &desk, &listed, &parts, made_of.as_deref())
    }

    /// What is painted at once: all, unless that takes more memory than is allowed.
    fn parts(&mut self, g: &mut Graph, band: Band, listed: &[Vec<u32>]) -> Result<Vec<Part>> {
        self.facts.listed += listed.iter().map(|listed| sum(listed)).sum::<u64>();
        let room = self.room(g);
        let mut all = Vec::new();
        let most: Vec<u32> = (0..listed[0].len()).map(|tile| listed.iter().map(|listed| listed[tile]).max().unwrap_or(0)).collect();
        for tiles in parts(&most, room / PLACE_BYTES, 0) {
            if self.blended.is_none() {
                all.push(Part { tiles, fragments: Vec::new(), hiders: None });
                continue;
            }
            let (mut counts, hiders) = self.count(g, band, listed, tiles.clone(), None)?;
            let all_of_them = sum(&counts);
            let hiders = counts.iter().any(|&count| count > MANY).then_some(hiders);
            if hiders.is_some() {
                (counts, _) = self.count(g, band, listed, tiles.clone(), hiders.as_deref())?;
            }
            self.facts.fragments += sum(&counts);
            self.facts.hidden += all_of_them - sum(&counts);
            self.facts.deepest = self.facts.deepest.max(counts.iter().copied().max().unwrap_or(0));
            let per_tile: Vec<u32> = counts.chunks(TILE_PIXELS).map(|tile| tile.iter().sum()).collect();
            all.extend(parts(&per_tile, room / FRAGMENT_BYTES, tiles.start).into_iter().map(|part| {
                let first = (part.start - tiles.start) as usize * TILE_PIXELS;
                let pixels = first..first + part.len() * TILE_PIXELS;
                let hiders = hiders.as_ref().map(|hiders| hiders[pixels.clone()].to_vec());
                Part { tiles: part, fragments: counts[pixels].to_vec(), hiders }
            }));
        }
        Ok(all)
    }

    /// Bytes that lists may have, and fragments.
    fn room(&self, g: &Graph) -> u64 {
        ((self.settings.memory * 1048576.0) as u64 / 2).min(g.binding_limit())
    }

    /// Strokes in the lists, and their fragments laid over each other. What is counted for `made_of` is kept, where all of it is painted at once.
    fn paint(&mut self, g: &mut Graph, desk: &Desk, listed: &[Vec<u32>], parts: &[Part], made_of: Option<&[u64]>) -> Result<Buffer> {
        let room = self.room(g);
        let kept = made_of.filter(|_| parts.len() == 1 && self.size(desk.band).fits(room));
        let mut keys = None;
        for part in parts {
            let of_tiles = |listed: &Vec<u32>| PLACE_BYTES * sum(&listed[part.tiles.start as usize..part.tiles.end as usize]);
            self.facts.parts += listed.len() as u32;
            self.facts.bytes = self.facts.bytes.max(listed.iter().map(of_tiles).max().unwrap_or(0) + abuffer::bytes(sum(&part.fragments)));
            let mut abuffer = match kept {
                Some(made_of) => {
                    let (mut kept, abuffer) = self.keep(g, desk.band, made_of, Some(&part.fragments))?;
                    g.fill(&mut kept, u32::MAX);
                    keys = Some(kept);
                    abuffer
                }
                None => Abuffer::new(g, &part.fragments, last(&self.settings))?,
            };
            let keys = match &mut keys {
                Some(keys) => keys,
                None => keys.insert(self.keys(g, desk.band)),
            };
            let what = if self.blended.is_some() { Kept::Fragments } else { Kept::Nothing };
            let mut counts = g.buffer("counts", 4 * part.tiles.len() as u64 * TILE_PIXELS as u64);
            g.fill(&mut counts, 0);
            let mut hiders = g.upload("hiders", part.hiders.as_deref().unwrap_or(&[0]))?;
            let to = [keys, &mut counts, &mut abuffer.fragments, &mut hiders];
            self.strokes(g, desk, (listed, &part.tiles), &abuffer.starts, (what, part.hiders.is_some()), to)?;
            let deepest = part.fragments.iter().copied().max().unwrap_or(0);
            let tiles = g.upload("part", &[part.tiles.start, part.tiles.end])?;
            self.blend(g, [&desk.canvas, &tiles], desk.band, part.tiles.len() as u32, abuffer, deepest)?;
        }
        Ok(keys.expect("a picture has a part"))
    }

    /// What frames before this one have painted, a few fragments more of it in order.
    fn go_on(&mut self, g: &mut Graph, paint: &Paint, band: Band, made_of: &[u64]) -> Result<Buffer> {
        let canvas = g.upload("canvas", &[self.canvas(band, paint)])?;
        let [across, down] = tiles(band.size);
        let part = g.upload("part", &[0, across * down])?;
        let (keys, abuffer) = self.keep(g, band, made_of, None)?;
        self.blend(g, [&canvas, &part], band, across * down, abuffer, self.facts.deepest)?;
        Ok(keys)
    }

    fn keep(&self, g: &mut Graph, band: Band, made_of: &[u64], counted: Option<&[u32]>) -> Result<(Buffer, Abuffer)> {
        let made_of = [made_of, &self.facts.notes()].concat();
        let last = last(&self.settings).min(self.facts.deepest).max(1);
        let more = self.at_once.unwrap_or(last).max(1);
        abuffer::keep(g, &made_of, &self.size(band), counted, |ordered| ordered.saturating_add(more).min(last))
    }

    /// Of a band, none so far.
    fn keys(&self, g: &mut Graph, band: Band) -> Buffer {
        let mut keys = g.buffer("keys", 8 * band.size[0] as u64 * band.size[1] as u64);
        g.fill(&mut keys, u32::MAX);
        keys
    }

    fn size(&self, band: Band) -> abuffer::Size {
        let ([width, height], [across, down]) = (band.size.map(u64::from), tiles(band.size).map(u64::from));
        abuffer::Size { pixels: width * height, in_tiles: across * down * TILE_PIXELS as u64, fragments: self.facts.fragments }
    }

    /// All that fragments depend on.
    fn made_of(&self, paint: &Paint) -> Vec<u64> {
        let Settings { brush: _, blend, sort: _, order, tangents, size: _, amplitude: _, gamma: _, sigma_x: _, sigma_y: _, dev: _, gaussians: _, noise, long, largest, passes: _, memory: _, radius: _ } =
            self.settings;
        let Bristles { size, amplitude, gamma, sigma_x, sigma_y, dev, gaussians } = Bristles::of(&self.settings);
        let View { camera, size: pixels, whole, corner, basis: _ } = self.view;
        let Camera { eye, target, up, fov_y, projection, ortho_height } = camera;
        let numbers = [size, amplitude, gamma, sigma_x, sigma_y, dev, noise, long, largest, *fov_y, ortho_height.unwrap_or(0.0)];
        let places = [eye, target, up].map(|place| place.to_array()).concat();
        let of_points = self.resident.opacities.table(&self.resident.stations).into_iter().map(f64::from).chain(paint.gains.iter().copied());
        let factors: Vec<u64> = of_points.chain(paint.ramp.map(f64::from)).map(f64::to_bits).collect();
        let choices = [blend as u64, order as u64, tangents as u64, gaussians as u64, *projection as u64, paint.mode as u64, factors.len() as u64];
        let shape = [*pixels, *whole, corner.map(|at| at as u32)].concat();
        let numbers = numbers.into_iter().chain(places).map(f64::to_bits);
        choices.into_iter().chain(shape.into_iter().map(u64::from)).chain(numbers).chain(factors).chain(self.resident.identity()).collect()
    }

    /// Blended colours in place of those of the nearest points.
    pub fn cover(self, resolved: &mut Resolved) -> Painted {
        if let Some(blended) = self.blended {
            resolved.color = blended;
        }
        Painted { facts: self.facts, unordered: self.unordered }
    }

    fn lay<'p>(&self, g: &mut Graph, band: Band, paint: &'p Paint) -> Result<Desk<'p>> {
        // All planes: positions are read by two passes, which have to agree.
        let drawn = project::draw(g, &self.wide, self.resident, Precision::Planes(crate::config::POSITION_PLANES))?;
        let homes: Vec<Home> = self.resident.homes().into_iter().map(|(page, planes)| Home { page, planes }).collect();
        let homes = g.upload("homes", &homes)?;
        let canvas = g.upload("canvas", &[self.canvas(band, paint)])?;
        let turns = g.upload("turns", &brush::turns(self.settings.noise))?;
        let brushes = self.brushes(g, &turns)?;
        Ok(Desk { drawn, homes, canvas, paint, turns, brushes, band, tiles: tiles(band.size) })
    }

    fn canvas(&self, band: Band, paint: &Paint) -> Canvas {
        let Settings { largest, long, tangents, blend, noise, .. } = self.settings;
        let bristles = Bristles::of(&self.settings);
        let basis = &self.view.basis;
        // What covers less leaves no trace.
        let least = if blend == Blend::Abuffer { 0.4 / 255.0 } else { HIDES as f64 };
        Canvas {
            size: band.size,
            tiles: tiles(band.size),
            middle: [self.view.centre()[0] as f32, (self.view.centre()[1] - band.top as f64) as f32],
            focal: self.wide.focal_px() as f32,
            right: basis.right.as_vec3().to_array(),
            down: (-basis.up).as_vec3().to_array(),
            forward: basis.forward.as_vec3().to_array(),
            scale: bristles.size as f32,
            least_px: LEAST_PX,
            largest_px: largest as f32,
            lengthen: long as f32,
            reach: bristles.reach(least, noise).map(|reach| reach as f32),
            word: self.resident.shown.strokes().expect("begin has looked"),
            kind: self.resident.shown.kind().unwrap_or(0),
            tangents: tangents as u32,
            hides: HIDES,
            lo: paint.ramp[0],
            ramp: paint.ramp[1],
        }
    }

    /// The words of all brushes, made where the kept ones are others.
    fn brushes(&self, g: &mut Graph, turns: &Buffer) -> Result<Buffer> {
        let bristles = Bristles::of(&self.settings);
        let made_of = [bristles.amplitude, bristles.gamma, bristles.sigma_x, bristles.sigma_y, bristles.dev, self.settings.noise];
        let made_of = made_of.map(f64::to_bits).into_iter().chain([bristles.places() as u64]).collect();
        let (mut brushes, kept) = g.kept("brushes", 4 * BRUSH_WORDS as u64, made_of, |_| 1)?;
        if kept == 0 {
            let inverse = |sigma: f64| (1.0 / (sigma * sigma)) as f32;
            let push = stroke_brush::Push {
                amplitude: bristles.amplitude as f32,
                exponent: (bristles.gamma / 2.0) as f32,
                across: inverse(bristles.sigma_x),
                along: inverse(bristles.sigma_y),
                apart: bristles.dev as f32,
                gaussians: bristles.places(),
            };
            g.run(shader::StrokeBrush { turns, brushes: &mut brushes, push }, Tiles::Groups([BRUSH_WORDS / 64, 1, 1]));
        }
        Ok(brushes)
    }

    /// Of every tile of a band, how many strokes may touch it; in several turns, each of some of the points, where those of a single tile are more than a list may hold.
    fn listed(&mut self, g: &mut Graph, band: Band) -> Result<Vec<Vec<u32>>> {
        let room = self.room(g) / PLACE_BYTES;
        let mut turns = 1;
        loop {
            let listed = (0..turns).map(|turn| self.tally(g, band, [turn, turns])).collect::<Result<Vec<_>>>()?;
            let most = listed.iter().flatten().copied().max().unwrap_or(0) as u64;
            if most <= room || turns as u64 > most {
                return Ok(listed);
            }
            // Turns are about as long as each other.
            turns = (turns + 1).max((turns as u64 * most * 9 / 8).div_ceil(room) as u32);
        }
    }

    /// Of every tile of a band, how many strokes may touch it.
    fn tally(&mut self, g: &mut Graph, band: Band, turn: [u32; 2]) -> Result<Vec<u32>> {
        let mut counting = g.before();
        let paint = resolve::paint(&mut counting, self.resident, self.decided)?;
        let desk = self.lay(&mut counting, band, &paint)?;
        let count = desk.tiles[0] * desk.tiles[1];
        let part = counting.upload("part", &[0, count, turn[0], turn[1]])?;
        let (mut tallies, mut strokes) = (counting.buffer("tallies", 4 * count as u64), counting.buffer("stroke list", PLACE_BYTES));
        counting.fill(&mut tallies, 0);
        self.walk(&mut counting, &desk, &part, &mut tallies, &mut strokes, 0);
        let tallies = counting.download_buffer(&tallies);
        let frame = counting.submit(&[])?;
        self.facts.counting_ms += frame.ms("");
        let counts = frame.read::<u32>(&tallies).to_vec();
        frame.shelve(g.gpu);
        Ok(counts)
    }

    /// Of every pixel of some tiles, tile by tile, how many fragments it has, before hiders that are known; and how deep the nearest of them lies that covers it wholly.
    fn count(&mut self, g: &mut Graph, band: Band, listed: &[Vec<u32>], tiles: Range<u32>, hiders: Option<&[u32]>) -> Result<(Vec<u32>, Vec<u32>)> {
        let mut counting = g.before();
        let paint = resolve::paint(&mut counting, self.resident, self.decided)?;
        let desk = self.lay(&mut counting, band, &paint)?;
        let starts = counting.upload("starts", &[0u32])?;
        let bytes = 4 * tiles.len() as u64 * TILE_PIXELS as u64;
        let (mut keys, mut fragments, mut counts) = (counting.buffer("keys", 8), counting.buffer("fragments", 8), counting.buffer("counts", bytes));
        [&mut keys, &mut counts].into_iter().for_each(|words| counting.fill(words, 0));
        let what = (Kept::Counts, hiders.is_some());
        let mut hiders = match hiders {
            Some(hiders) => counting.upload("hiders", hiders)?,
            None => {
                let mut hiders = counting.buffer("hiders", bytes);
                counting.fill(&mut hiders, u32::MAX);
                hiders
            }
        };
        self.strokes(&mut counting, &desk, (listed, &tiles), &starts, what, [&mut keys, &mut counts, &mut fragments, &mut hiders])?;
        let found = [&counts, &hiders].map(|words| counting.download_buffer(words));
        let frame = counting.submit(&[])?;
        self.facts.counting_ms += frame.ms("");
        let [counts, hiders] = found.map(|words| frame.read::<u32>(&words)[..tiles.len() * TILE_PIXELS].to_vec());
        frame.shelve(g.gpu);
        Ok((counts, hiders))
    }

    /// Which strokes may touch each of some tiles, of a turn.
    fn bins(&self, g: &mut Graph, desk: &Desk, listed: &[u32], tiles: &Range<u32>, turn: [u32; 2]) -> Result<Bins> {
        let starts = abuffer::sums(&listed[tiles.start as usize..tiles.end as usize]);
        let part = g.upload("part", &[&[tiles.start, tiles.end], &turn[..], &starts[..]].concat())?;
        let mut cursors = g.upload("cursors", &starts)?;
        let mut strokes = g.buffer("stroke list", PLACE_BYTES * starts[tiles.len()].max(1) as u64);
        if desk.drawn.groups.is_empty() {
            // Nobody else writes it.
            g.fill(&mut strokes, 0);
        }
        self.walk(g, desk, &part, &mut cursors, &mut strokes, 1);
        Ok(Bins { part, strokes, longest: starts.windows(2).map(|pair| pair[1] - pair[0]).max().unwrap_or(0) })
    }

    fn walk(&self, g: &mut Graph, desk: &Desk, part: &Buffer, tallies: &mut Buffer, strokes: &mut Buffer, step: u32) {
        let wide = Band { top: desk.band.top, size: desk.band.size.map(|side| side + 2 * margin(&self.settings)) };
        let project::Walk { centre, corner, size, near, lanes, perspective, texels, points_per_chunk } = project::Walk::new(g, &self.wide, wide);
        let slices_of_chunk = if g.gpu.device.is_cpu { SLICES } else { 1 };
        for group in &desk.drawn.groups {
            let project::Group { block, planes, filtered, first_chunk, chunk_count, .. } = *group;
            let push = stroke_bins::Push { centre, corner, size, near, first_chunk, chunk_count };
            let Desk { drawn, homes, canvas, turns, paint, .. } = desk;
            let (mode, transparent, by_kind) = (paint.mode, paint.opacities.is_some(), paint.kinds.is_some());
            let spec = stroke_bins::Spec { lanes, planes, perspective, texels, points_per_chunk, filtered, step, mode, transparent, by_kind, slices_of_chunk };
            let pages = &drawn.pages[block];
            g.run(
                shader::StrokeBins {
                    nodes: &drawn.nodes,
                    chunks: &drawn.chunks,
                    opacities: paint.opacities.as_ref().unwrap_or(drawn.opacities()),
                    within: drawn.within(),
                    pages,
                    page_words: pages,
                    homes,
                    turns,
                    canvases: canvas,
                    part,
                    tallies,
                    strokes,
                    table: &paint.table,
                    push,
                    spec,
                },
                group.slices(slices_of_chunk),
            );
        }
    }

    /// Strokes of some tiles, turn by turn, and of a turn so many of each tile at a time.
    fn strokes(
        &self,
        g: &mut Graph,
        desk: &Desk,
        (listed, tiles): (&[Vec<u32>], &Range<u32>),
        starts: &Buffer,
        (kept, before_hiders): (Kept, bool),
        [keys, counts, fragments, hiders]: [&mut Buffer; 4],
    ) -> Result<()> {
        let (perspective, by_stroke, texels) = (self.is_perspective(), self.settings.order == Order::Stroke, g.gpu.device.texels);
        let spec = shader::strokes::Spec { perspective, fragments: kept as u32, texels, by_stroke, before_hiders };
        for (turn, of_turn) in listed.iter().enumerate() {
            let Bins { part, strokes, longest } = &self.bins(g, desk, of_turn, tiles, [turn as u32, listed.len() as u32])?;
            for before in (0..(*longest).max(1)).step_by(STROKES_AT_ONCE) {
                let (keys, counts, fragments, hiders) = (&mut *keys, &mut *counts, &mut *fragments, &mut *hiders);
                g.run(
                    shader::Strokes {
                        canvases: &desk.canvas,
                        part,
                        strokes,
                        stroke_words: strokes,
                        brushes: &desk.brushes,
                        brush_words: &desk.brushes,
                        starts,
                        keys,
                        counts,
                        fragments,
                        hiders,
                        push: shader::strokes::Push { before },
                        spec,
                    },
                    groups(tiles.len() as u32),
                );
            }
        }
        Ok(())
    }

    /// Fragments of some tiles, so many in a pixel at most -> the colours that they give when as many are in order as shall be.
    fn blend(&mut self, g: &mut Graph, [canvases, part]: [&Buffer; 2], band: Band, tiles: u32, abuffer: Abuffer, deepest: u32) -> Result<()> {
        let Some(color) = &mut self.blended else { return Ok(()) };
        let Abuffer { starts, mut fragments, ordered, kept } = abuffer;
        let wanted = ordered.end.min(deepest);
        // Where there are no more nobody asks whether they are in order.
        let is_last = !kept || wanted == last(&self.settings).min(deepest);
        let mut unordered = if is_last { g.buffer("unordered", 4) } else { g.answer("unordered", 4) };
        g.fill(&mut unordered, 0);
        let spec = stroke_sort::Spec { bubble: kept || self.settings.sort == Sort::Bubble };
        for ordered in steps(ordered.start.min(wanted)..wanted, deepest, g.gpu.device.is_cpu)? {
            let (fragments, unordered) = (&mut fragments, &mut unordered);
            let push = stroke_sort::Push { top: band.top, ordered: ordered.start, wanted: ordered.end };
            g.run(shader::StrokeSort { canvases, part, starts: &starts, fragments, color, unordered, push, spec }, groups(tiles));
        }
        self.unordered = (!is_last).then_some(unordered);
        Ok(())
    }

    fn is_perspective(&self) -> bool {
        self.view.camera.projection == Projection::Perspective
    }
}

const TILE_PIXELS: usize = (TILE_PX * TILE_PX) as usize;

/// Fragments of a pixel that are brought into order before the rest is left out.
fn last(settings: &Settings) -> u32 {
    match (settings.sort, settings.passes as u32) {
        (Sort::Exact, _) | (Sort::Bubble, 0) => u32::MAX,
        (Sort::Bubble, passes) => passes,
    }
}

/// Fragments of a pixel that each pass brings into order, of so many at most: all of them, but on lavapipe, where a pass ends too early that would walk over them too often.
fn steps(wanted: Range<u32>, deepest: u32, is_cpu: bool) -> Result<Vec<Range<u32>>> {
    if !is_cpu {
        return Ok(vec![wanted]);
    }
    if deepest > ROUNDS - 2 {
        return Err(Error::Request(format!(
            "{deepest} strokes lie over each other in one pixel, and a software device brings {} into order at most; look at them from nearer, or with --effect strokes=blend=opaque",
            ROUNDS - 2
        )));
    }
    let mut steps = Vec::new();
    let mut start = wanted.start;
    loop {
        // Those in order are walked over once, the others once for each, and a round more.
        let more = ROUNDS.saturating_sub(start) / (deepest.saturating_sub(start) + 2);
        let end = start.saturating_add(more.max(1)).min(wanted.end);
        steps.push(start..end);
        if end >= wanted.end {
            return Ok(steps);
        }
        start = end;
    }
}

fn sum(counts: &[u32]) -> u64 {
    counts.iter().map(|&count| count as u64).sum()
}

/// What of the fragments is kept.
#[derive(Clone, Copy)]
enum Kept {
    Nothing,
    Counts,
    Fragments,
}

/// Tiles in rows whose counts stay within the most; one tile at least. They are numbered from `first`.
fn parts(counts: &[u32], most: u64, first: u32) -> Vec<Range<u32>> {
    let (mut parts, mut sum, mut start) = (Vec::new(), 0, 0);
    for (k, &count) in counts.iter().enumerate() {
        if k > start && sum + count as u64 > most {
            parts.push(first + start as u32..first + k as u32);
            (sum, start) = (0, k);
        }
        sum += count as u64;
    }
    parts.push(first + start as u32..first + counts.len() as u32);
    parts
}

/// Softens z-buffered strokes, where that is asked for.
pub fn record(g: &mut Graph, scene: &Scene, settings: &Settings, layers: Layers) -> Layers {
    if settings.blend != Blend::Blur {
        return layers;
    }
    let radius = settings.radius.round().min(8.0);
    // Falls to e^-2 at the radius.
    let weights = std::array::from_fn(|k| (-2.0 * (k as f64 / radius).powi(2)).exp() as f32);
    let mut color = layers.color;
    for along in [[1, 0], [0, 1]] {
        let mut blurred = g.image("blurred", scene.view.size, Kind::Rgba32f);
        let push = stroke_blur::Push { size: scene.view.size, along, weights, radius_px: radius as i32 };
        g.run(shader::StrokeBlur { color: &color, blurred: &mut blurred, push }, Tiles::All);
        color = blurred;
    }
    Layers { color, ..layers }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_hold_all_tiles_once_and_no_more_than_they_may() {
        let counts = [3, 0, 5, 9, 1, 1, 1, 0, 20, 2];
        let parts = parts(&counts, 9, 100);
        assert_eq!(parts.iter().flat_map(Clone::clone).collect::<Vec<_>>(), (100..110).collect::<Vec<_>>());
        for part in parts.iter().filter(|part| part.len() > 1) {
            assert!(counts[part.start as usize - 100..part.end as usize - 100].iter().sum::<u32>() <= 9, "{part:?}");
        }
    }
}
