//! Strokes: paints points that have normals, sizes and clusters (dos Anjos et al. 2018).
//!
//! ```text
//!     stroke_brush   settings -> 256 brushes, kept
//!   blend=opaque, blend=blur:
//!     stroke_screen  points -> strokes on the screen
//!     stroke_quads   strokes, rasterised -> ground, and the key of the nearest stroke of each pixel
//!     stroke_surface ground -> mask of surfaces
//!     stroke_keys    keys -> keys on surfaces
//!   blend=blur:
//!     stroke_blur    color -> color, across and down
//!   blend=abuffer:
//!     stroke_screen, stroke_quads, stroke_surface   as above -> mask of surfaces; read back
//!     stroke_bins    points -> number of strokes that may touch each tile; read back to size the lists
//!     stroke_bins    points -> lists of these strokes
//!     stroke_fragments  strokes of a tile, mask -> number of fragments per pixel; read back; if
//!                    there are many, again without those hidden by others
//!     stroke_fragments  the same -> fragments, and keys as above; a chunk of each tile at a time
//!     stroke_sort    fragments -> color, in order; over several frames if the A-buffer is kept
//! ```
//! No list has a fixed size: each is as long as was counted. If it exceeds the allowed memory, the
//! picture is painted in parts of tiles, or of points if a single tile has too many, which changes
//! no pixel. A wider view of the same camera is walked over, since strokes reach into the picture
//! from outside.

mod abuffer;
mod bins;
mod blur;
pub mod brush;
mod constants;
mod fragments;
mod nearest;
mod quads;
mod settings;
mod sort;
mod stats;
pub mod surface;
pub mod tangents;

pub use blur::record;
pub use settings::{Blend, Order, Settings, Sort, Tangents};
pub use stats::Facts;

use super::project::{self, Drawn, Keys, Precision, Strip, Walk};
use super::resolve::{ColorLookup, ColorRequest, Resolved};
use super::{Effect, EffectDecisions, Effects, FrameContext, Reason, TILE_PX, tiles};
use crate::config::POINTS_PER_PAGE;
use crate::error::{Error, Result};
use crate::graph::{Buffer, Dispatch, Graph, Image, Kind};
use crate::resident::Resident;
use crate::shader::Home;
use crate::view::{Projection, View};
use abuffer::Abuffer;
use std::ops::Range;

pub const SUMMARY: &str = "brush strokes along the surface, one per point (--style strokes)";

/// See [`super::Effects::reach_px`]. Strokes are looked for as far as they reach, so only softening
/// counts.
pub fn reach_px(_view: &View, settings: &Settings) -> Option<u32> {
    Some(settings.radius.ceil() as u32)
}

pub fn called_for(_scene: &FrameContext, _asked: &Effects, _before: &EffectDecisions) -> Reason {
    Reason { runs: false, why: "strokes run only with --style strokes".to_string() }
}

/// Smallest half side on the screen `[px]`: smaller strokes would miss pixel centres.
pub const LEAST_PX: f32 = 1.5;
/// Coverage from which a stroke hides what is behind it in depth, and in z-buffered strokes.
const HIDES: f32 = 0.5;
/// Margin around the picture [largest half sides]: a corner of the longest stroke, seen at an
/// angle.
const MARGIN: f64 = 4.0;
const GROUPS_A_ROW: u32 = 65_535;
/// Fragments per pixel from which a second pass that finds hidden ones pays.
const MANY: u32 = 2048;
/// Bytes of a stroke in a list, and of a fragment.
const PLACE_BYTES: u64 = 48;
const FRAGMENT_BYTES: u64 = 8;

/// The result of painting.
pub struct Painted {
    pub facts: Facts,
    /// If strokes are sorted over several frames and are not all sorted: a word to read after the
    /// frame, not 0 if sorting would still change a pixel.
    pub unordered: Option<Buffer>,
    /// True if a host's device still counts: the nearest stroke of each pixel is shown until then.
    pub waits: bool,
}

/// A frame whose points are painted.
pub struct Painting<'f> {
    /// The view with the margin on all sides.
    wide: View,
    view: &'f View,
    resident: &'f Resident,
    request: ColorRequest,
    settings: Settings,
    /// Fragments per pixel that this frame sorts in addition.
    at_once: Option<u32>,
    /// Blended colours of the whole picture.
    blended: Option<Image>,
    unordered: Option<Buffer>,
    waits: bool,
    facts: Facts,
}

/// Begins to paint; None if strokes do not run or nothing is in view. At most `at_once` fragments
/// of each pixel are sorted in addition to those of earlier frames; None sorts all. Errors if
/// strokes were not computed for the points.
pub fn begin<'f>(
    g: &mut Graph,
    view: &'f View,
    resident: &'f Resident,
    effects: &Effects,
    decisions: &EffectDecisions,
    at_once: Option<u32>,
) -> Result<Option<Painting<'f>>> {
    if !decisions.runs(Effect::Strokes) {
        return Ok(None);
    }
    if resident.shown.strokes().is_none() {
        return Err(Error::Request(
            "strokes were not computed for these points; use --style strokes".into(),
        ));
    }
    let settings = effects.strokes.settings;
    let wide = widened(view, margin(view, &settings));
    if resident.seen(&wide).next().is_none() {
        return Ok(None);
    }
    let blended =
        (settings.blend == Blend::Abuffer).then(|| g.image("blended", view.size, Kind::Rgba32f));
    Ok(Some(Painting {
        wide,
        view,
        resident,
        request: super::color_request(resident, decisions),
        settings,
        at_once,
        blended,
        unordered: None,
        waits: false,
        facts: Facts::default(),
    }))
}

fn margin(view: &View, settings: &Settings) -> u32 {
    (MARGIN * settings.largest_px(view.whole)).ceil() as u32 + surface::ENCLOSED_PX
}

/// Returns the same camera with `margin` more pixels on every side.
fn widened(view: &View, margin: u32) -> View {
    view.window(view.corner.map(|at| at - margin as i32), view.size.map(|side| side + 2 * margin))
}

/// Inputs that the passes of one submission share.
struct StrokeInputs<'p> {
    drawn: Drawn,
    homes: Buffer,
    /// Number of points of all drawn nodes.
    places: u32,
    canvas: Buffer,
    paint: &'p ColorLookup,
    turns: Buffer,
    brushes: Buffer,
    strip: Strip,
    tiles: [u32; 2],
}

/// The inputs of a strip's A-buffer.
struct Found {
    /// Not 0 where a surface is, pixel by pixel.
    surface: Vec<u32>,
    /// Number of strokes that may touch each tile, for each turn.
    listed: Vec<Vec<u32>>,
}

/// Consecutive tiles that are painted at once, and the fragments of each of their pixels, tile by
/// tile.
struct Part {
    tiles: Range<u32>,
    fragments: Vec<u32>,
    /// If there are many: depth of the nearest fragment that covers a pixel completely; those
    /// behind it are not stored.
    hiders: Option<Vec<u32>>,
}

fn groups(tiles: u32) -> Dispatch<'static> {
    Dispatch::Groups([tiles.min(GROUPS_A_ROW), tiles.div_ceil(GROUPS_A_ROW), 1])
}

impl Painting<'_> {
    /// Returns strips that fit into `limit` bytes with their surroundings.
    pub fn strips(&self, limit: u64) -> Vec<Strip> {
        let [width, height] = self.view.size;
        let around = 2 * surface::ENCLOSED_PX;
        let strips = project::strips(
            [width + around, height],
            project::KEY_BYTES,
            limit.saturating_sub(8 * (width + around) as u64 * around as u64),
        );
        strips.into_iter().map(|strip| Strip { size: [width, strip.size[1]], ..strip }).collect()
    }

    /// Returns the keys of a strip, as [`project::record`] does, and paints its part of the blended
    /// colours.
    pub fn record(&mut self, g: &mut Graph, paint: &ColorLookup, strip: Strip) -> Result<Keys> {
        let layers = match self.blended {
            Some(_) => self.layers(g, paint, strip)?,
            None => None,
        };
        self.waits |= self.blended.is_some() && layers.is_none();
        Ok(Keys::nearest(match layers {
            Some(keys) => keys,
            None => self.nearest(g, paint, strip)?,
        }))
    }

    /// Asks the device for `N` buffers before the frame.
    fn ask<const N: usize>(
        &mut self,
        g: &mut Graph,
        name: String,
        record: impl FnOnce(&mut Self, &mut Graph) -> Result<[Buffer; N]>,
    ) -> Result<Option<[Vec<u32>; N]>> {
        let answer = g.ask(&name, |before| Ok(record(self, before)?.into()))?;
        Ok(answer.map(|answer| {
            self.facts.counting_ms += answer.milliseconds;
            answer.words.try_into().expect("as many as were recorded")
        }))
    }

    /// Paints all strokes of a strip over each other; `None` while a host's device counts them.
    fn layers(
        &mut self,
        g: &mut Graph,
        paint: &ColorLookup,
        strip: Strip,
    ) -> Result<Option<Buffer>> {
        let cache_key =
            self.at_once.filter(|_| strip.size == self.view.size).map(|_| self.cache_key(paint));
        if let Some(cache_key) = &cache_key
            && let Some(notes) = abuffer::held(g, cache_key)
        {
            self.facts = Facts::of(notes);
            return self.go_on(g, paint, strip, cache_key).map(Some);
        }
        let (surface, listed) = (self.surface(g, strip)?, self.listed(g, strip)?);
        let (Some(surface), Some(listed)) = (surface, listed) else { return Ok(None) };
        let found = Found { surface, listed };
        let Some(parts) = self.parts(g, strip, &found)? else { return Ok(None) };
        let desk = self.bind(g, strip, paint)?;
        self.paint(g, &desk, &found, &parts, cache_key.as_deref()).map(Some)
    }

    /// Returns the parts that are painted at once: one, unless memory is short.
    fn parts(&mut self, g: &mut Graph, strip: Strip, found: &Found) -> Result<Option<Vec<Part>>> {
        let listed = &found.listed;
        self.facts.listed += listed.iter().map(|listed| sum(listed)).sum::<u64>();
        let room = self.room(g, 2);
        let mut all = Vec::new();
        let most: Vec<u32> = (0..listed[0].len())
            .map(|tile| listed.iter().map(|listed| listed[tile]).max().unwrap_or(0))
            .collect();
        for tiles in parts(&most, room / PLACE_BYTES, 0) {
            let Some([mut counts, hiders]) = self.count(g, strip, found, tiles.clone(), None)?
            else {
                return Ok(None);
            };
            let all_of_them = sum(&counts);
            let hiders = counts.iter().any(|&count| count > MANY).then_some(hiders);
            if hiders.is_some() {
                let before = self.count(g, strip, found, tiles.clone(), hiders.as_deref())?;
                let Some([visible, _]) = before else { return Ok(None) };
                counts = visible;
            }
            self.facts.fragments += sum(&counts);
            self.facts.hidden += all_of_them - sum(&counts);
            self.facts.deepest = self.facts.deepest.max(counts.iter().copied().max().unwrap_or(0));
            let per_tile: Vec<u32> =
                counts.chunks(TILE_PIXELS).map(|tile| tile.iter().sum()).collect();
            all.extend(parts(&per_tile, room / FRAGMENT_BYTES, tiles.start).into_iter().map(
                |part| {
                    let first = (part.start - tiles.start) as usize * TILE_PIXELS;
                    let pixels = first..first + part.len() * TILE_PIXELS;
                    let hiders = hiders.as_ref().map(|hiders| hiders[pixels.clone()].to_vec());
                    Part { tiles: part, fragments: counts[pixels].to_vec(), hiders }
                },
            ));
        }
        Ok(Some(all))
    }

    /// Returns the bytes that each of `buffers` buffers may have.
    fn room(&mut self, g: &Graph, buffers: u64) -> u64 {
        let allowed = (self.settings.memory * 1048576.0) as u64 / buffers;
        self.facts.by_device = g.binding_limit() < allowed;
        allowed.min(g.binding_limit())
    }

    /// Paints parts. The A-buffer is kept under `cache_key` if everything is painted at once.
    fn paint(
        &mut self,
        g: &mut Graph,
        desk: &StrokeInputs,
        found: &Found,
        parts: &[Part],
        cache_key: Option<&[u64]>,
    ) -> Result<Buffer> {
        let listed = &found.listed;
        let room = self.room(g, 2);
        let kept = cache_key.filter(|_| parts.len() == 1 && self.size(desk.strip).fits(room));
        let surface = g.upload("surface", &found.surface)?;
        let mut keys = None;
        for part in parts {
            let of_tiles = |listed: &Vec<u32>| {
                PLACE_BYTES * sum(&listed[part.tiles.start as usize..part.tiles.end as usize])
            };
            self.facts.parts += listed.len() as u32;
            self.facts.bytes = self.facts.bytes.max(
                listed.iter().map(of_tiles).max().unwrap_or(0)
                    + abuffer::bytes(sum(&part.fragments)),
            );
            let mut abuffer = match kept {
                Some(cache_key) => {
                    let (mut kept, abuffer) =
                        self.keep(g, desk.strip, cache_key, Some(&part.fragments))?;
                    g.fill(&mut kept, u32::MAX);
                    keys = Some(kept);
                    abuffer
                }
                None => Abuffer::new(g, &part.fragments, self.settings.last())?,
            };
            let keys = match &mut keys {
                Some(keys) => keys,
                None => keys.insert(self.keys(g, desk.strip)),
            };
            let mut counts = g.buffer("counts", 4 * part.tiles.len() as u64 * TILE_PIXELS as u64);
            g.fill(&mut counts, 0);
            let mut hiders = g.upload("hiders", part.hiders.as_deref().unwrap_or(&[0]))?;
            let to = [keys, &mut counts, &mut abuffer.fragments, &mut hiders];
            self.strokes(
                g,
                desk,
                (listed, &surface, &part.tiles),
                &abuffer.starts,
                (true, part.hiders.is_some()),
                to,
            )?;
            let deepest = part.fragments.iter().copied().max().unwrap_or(0);
            let tiles = g.upload("part", &[part.tiles.start, part.tiles.end])?;
            self.blend(
                g,
                [&desk.canvas, &tiles],
                desk.strip,
                part.tiles.len() as u32,
                abuffer,
                deepest,
            )?;
        }
        Ok(keys.expect("a picture has a part"))
    }

    /// Continues with the A-buffer of earlier frames, and sorts a few more fragments.
    fn go_on(
        &mut self,
        g: &mut Graph,
        paint: &ColorLookup,
        strip: Strip,
        cache_key: &[u64],
    ) -> Result<Buffer> {
        let canvas = g.upload("canvas", &[self.canvas(strip, paint)])?;
        let [across, down] = tiles(strip.size);
        let part = g.upload("part", &[0, across * down])?;
        let (keys, abuffer) = self.keep(g, strip, cache_key, None)?;
        self.blend(g, [&canvas, &part], strip, across * down, abuffer, self.facts.deepest)?;
        Ok(keys)
    }

    fn keep(
        &self,
        g: &mut Graph,
        strip: Strip,
        cache_key: &[u64],
        counted: Option<&[u32]>,
    ) -> Result<(Buffer, Abuffer)> {
        let cache_key = [cache_key, &self.facts.notes()].concat();
        let last = self.settings.last().min(self.facts.deepest).max(1);
        let more = self.at_once.unwrap_or(last).max(1);
        abuffer::keep(g, &cache_key, &self.size(strip), counted, |ordered| {
            ordered.saturating_add(more).min(last)
        })
    }

    /// Returns empty keys of a strip.
    fn keys(&self, g: &mut Graph, strip: Strip) -> Buffer {
        let mut keys = g.buffer("keys", 8 * strip.size[0] as u64 * strip.size[1] as u64);
        g.fill(&mut keys, u32::MAX);
        keys
    }

    fn size(&self, strip: Strip) -> abuffer::Size {
        let ([width, height], [across, down]) =
            (strip.size.map(u64::from), tiles(strip.size).map(u64::from));
        abuffer::Size {
            pixels: width * height,
            in_tiles: across * down * TILE_PIXELS as u64,
            fragments: self.facts.fragments,
        }
    }

    /// Replaces colours of the nearest points by the blended ones.
    pub fn cover(self, resolved: &mut Resolved) -> Painted {
        if let Some(blended) = self.blended.filter(|_| !self.waits) {
            resolved.color = blended;
        }
        Painted { facts: self.facts, unordered: self.unordered, waits: self.waits }
    }

    fn bind<'p>(
        &self,
        g: &mut Graph,
        strip: Strip,
        paint: &'p ColorLookup,
    ) -> Result<StrokeInputs<'p>> {
        // All planes, since two passes read positions and must agree.
        let drawn = project::draw(
            g,
            &self.wide,
            self.resident,
            Precision::Planes(crate::config::POSITION_PLANES),
        )?;
        let (places, homes) = self.homes();
        let homes = g.upload("homes", &homes)?;
        let canvas = g.upload("canvas", &[self.canvas(strip, paint)])?;
        let turns = g.upload("turns", &brush::turns(self.settings.noise))?;
        let brushes = self.brushes(g, &turns)?;
        Ok(StrokeInputs {
            drawn,
            homes,
            places,
            canvas,
            paint,
            turns,
            brushes,
            strip,
            tiles: tiles(strip.size),
        })
    }

    /// Returns where nodes lie on the device, and the first place of their points among all that
    /// are drawn, in multiples of four.
    fn homes(&self) -> (u32, Vec<Home>) {
        let mut places = vec![0; self.resident.nodes.len().max(1)];
        self.resident.seen(&self.wide).for_each(|(_, node)| {
            places[(node.first_point() / POINTS_PER_PAGE) as usize] = node.count.next_multiple_of(4)
        });
        let mut first_place = 0;
        let homes =
            self.resident.homes().into_iter().zip(places).map(|((page, planes), places)| {
                first_place += places;
                Home { page, planes, first_place: first_place - places }
            });
        let homes = homes.collect();
        (first_place, homes)
    }

    /// Returns the walk over the points of a strip and its surroundings.
    fn walked(&self, g: &Graph, desk: &StrokeInputs) -> Walk {
        let size = desk.strip.size.map(|side| side + 2 * margin(self.view, &self.settings));
        Walk::new(g, &self.wide, Strip { top: desk.strip.top, size })
    }

    /// Returns the corner of a strip in the whole picture `[px]`.
    fn corner(&self, strip: Strip) -> [f32; 2] {
        [self.view.corner[0] as f32, (self.view.corner[1] + strip.top as i32) as f32]
    }

    fn is_perspective(&self) -> bool {
        self.view.camera.projection == Projection::Perspective
    }
}

const TILE_PIXELS: usize = (TILE_PX * TILE_PX) as usize;

fn sum(counts: &[u32]) -> u64 {
    counts.iter().map(|&count| count as u64).sum()
}

/// Splits tiles, numbered from `first`, into ranges whose counts add up to at most `most`; at least
/// one tile each.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_hold_all_tiles_once_and_no_more_than_they_may() {
        let counts = [3, 0, 5, 9, 1, 1, 1, 0, 20, 2];
        let parts = parts(&counts, 9, 100);
        assert_eq!(
            parts.iter().flat_map(Clone::clone).collect::<Vec<_>>(),
            (100..110).collect::<Vec<_>>()
        );
        for part in parts.iter().filter(|part| part.len() > 1) {
            assert!(
                counts[part.start as usize - 100..part.end as usize - 100].iter().sum::<u32>() <= 9,
                "{part:?}"
            );
        }
    }
}
