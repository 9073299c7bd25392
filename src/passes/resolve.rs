//! Resolves the keys of one strip to depth, point ids and colours, written into the images of the
//! whole picture.

use super::project::{Keys, Strip};
use super::{GBuffer, TileLists};
use crate::cloud::attribute::{Attribute, DisplayAttribute};
use crate::cloud::color_scale::ColorScale;
use crate::cloud::colormap::{self, linear_to_srgb, srgb_to_linear};
use crate::config::POINTS_PER_PAGE;
use crate::error::{Error, Result};
use crate::graph::{Buffer, Dispatch, Graph, Image, Kind};
use crate::index::format::scatter::POINTS_PER_CLUMP;
use crate::resident::Resident;
use crate::shader::{self, Clump, resolve::Push, resolve::Spec};
use crate::view::{Projection, View};

/// The images that `record` fills strip by strip.
pub struct Resolved {
    pub depth: Image,
    pub index: Image,
    pub color: Image,
}

pub fn begin(g: &mut Graph, view: &View) -> Resolved {
    Resolved {
        depth: g.image("depth", view.size, Kind::R32f),
        index: g.image("index", view.size, Kind::R32ui),
        color: g.image("color", view.size, Kind::Rgba32f),
    }
}

/// Buffers that map a point's word to a colour on the GPU.
pub struct ColorLookup {
    pub(super) shown: Buffer,
    /// Kinds of points, if they are known.
    pub(super) kinds: Option<Buffer>,
    /// Opacities, unless all points are opaque.
    pub(super) opacities: Option<Buffer>,
    pub(super) table: Buffer,
    /// Gains of its rows.
    pub(super) gains: Vec<f64>,
    pub(super) scale: ColorScale,
    /// 8-bit values at one exposure, row by row as in the table, if colours are averaged: a later
    /// pass then makes the colours.
    pub(super) levels: Option<Buffer>,
    pub(super) mode: u32,
    /// The word at the low end of the ramp, and table entries (of 256) per unit of the word.
    pub(super) ramp: [f32; 2],
}

impl ColorLookup {
    /// Returns what to bind as kinds; unread bindings need a buffer, too.
    pub(super) fn kinds(&self) -> &Buffer {
        self.kinds.as_ref().unwrap_or(&self.shown)
    }

    pub(super) fn opacities(&self) -> &Buffer {
        self.opacities.as_ref().unwrap_or(&self.shown)
    }

    /// Returns handles to the same buffers for a later pass.
    pub(super) fn again(&self) -> ColorLookup {
        let again = |buffer: &Option<Buffer>| buffer.as_ref().map(Buffer::alias);
        ColorLookup {
            shown: self.shown.alias(),
            kinds: again(&self.kinds),
            opacities: again(&self.opacities),
            table: self.table.alias(),
            gains: self.gains.clone(),
            levels: again(&self.levels),
            ..*self
        }
    }
}

/// Modes of the lookup, as numbered in glsl/lib/color_lookup.glsl.
const RGB: u32 = 0;
const RAMP: u32 = 1;
const PALETTE: u32 = 2;
const NORMAL: u32 = 3;
const CONSTANT: u32 = 4;

fn mode(attribute: Attribute) -> u32 {
    match attribute {
        Attribute::Rgb | Attribute::Corrected => RGB,
        Attribute::Intensity | Attribute::Elevation | Attribute::Time | Attribute::Scalar(_) => {
            RAMP
        }
        Attribute::Class | Attribute::Source | Attribute::Return => PALETTE,
        Attribute::Normal => NORMAL,
        Attribute::White => CONSTANT,
    }
}

/// How colours are looked up.
#[derive(Clone, Debug)]
pub struct ColorRequest {
    /// Factor on the light for every row of the table.
    pub gains: Vec<f64>,
    /// True if a later pass averages colours instead of looking them up.
    pub averaged: bool,
}

impl Default for ColorRequest {
    fn default() -> ColorRequest {
        ColorRequest { gains: vec![1.0], averaged: false }
    }
}

pub fn paint(g: &mut Graph, resident: &Resident, request: &ColorRequest) -> Result<ColorLookup> {
    let mode = mode(resident.shown.attribute);
    let [lo, hi] = row_words(&resident.shown, &request.gains);
    let shown = g.upload("shown", &resident.addresses(0))?;
    let transparent = resident.is_transparent();
    let opacities = transparent
        .then(|| g.upload("opacities", &resident.opacities.table(&resident.stations)))
        .transpose()?;
    let kinds = resident
        .shown
        .kind()
        .filter(|_| transparent)
        .map(|word| g.upload("kinds", &resident.addresses(word)))
        .transpose()?;
    let gains = request.gains.clone();
    let table = g.upload("table", &table(&resident.shown, &gains))?;
    let levels = request
        .averaged
        .then(|| g.upload("levels", &levels(&resident.shown, &gains)))
        .transpose()?;
    Ok(ColorLookup {
        shown,
        kinds,
        opacities,
        table,
        gains,
        scale: resident.shown.scale,
        levels,
        mode,
        ramp: [lo as f32, 255.0 / (hi as f32 - lo as f32).max(1.0)],
    })
}

pub fn record(
    g: &mut Graph,
    keys: &Keys,
    paint: &ColorLookup,
    strip: Strip,
    resolved: Resolved,
) -> Resolved {
    let Resolved { mut depth, mut index, mut color } = resolved;
    let push = Push { size: strip.size, top: strip.top, lo: paint.ramp[0], scale: paint.ramp[1] };
    let (transparent, by_kind, colorless) =
        (paint.opacities.is_some(), paint.kinds.is_some(), paint.levels.is_some());
    let spec = Spec {
        mode: paint.mode,
        texels: g.gpu.device.has_large_texel_buffers,
        transparent,
        by_kind,
        colorless,
        behind: keys.behind,
    };
    let groups = [strip.size[0].div_ceil(64), strip.size[1], 1];
    g.run(
        shader::Resolve {
            keys: &keys.words,
            key_words: &keys.words,
            shown: &paint.shown,
            kinds: paint.kinds(),
            opacities: paint.opacities(),
            table: &paint.table,
            depth: &mut depth,
            index: &mut index,
            color: &mut color,
            push,
            spec,
        },
        Dispatch::Groups(groups),
    );
    Resolved { depth, index, color }
}

impl Resolved {
    /// Returns the G-buffer that effects start from.
    pub fn gbuffer(self, g: &mut Graph, view: &View, resident: &Resident) -> Result<GBuffer> {
        let Resolved { depth, index, color } = self;
        let (projected_depth, projected_index) =
            (g.copy("projected depth", &depth), g.copy("projected index", &index));
        let spacings: Vec<f32> =
            resident.nodes.iter().map(|node| node.spacing() as f32).chain([0.0]).collect();
        let spacings = g.upload("spacings", &spacings)?;
        let clumps = g.upload("clumps", &clumps(resident))?;
        let normal_pages = resident
            .shown
            .normal()
            .map(|word| {
                let pages = g.upload("facings", &resident.addresses(word))?;
                Ok::<_, Error>((pages, *resident.map()))
            })
            .transpose()?;
        Ok(GBuffer {
            depth,
            projected_depth,
            index,
            projected_index,
            color,
            occluder: None,
            accumulation: None,
            normal_pages,
            light_visibility: None,
            shadow_factor: None,
            luminance_sums: None,
            shading: None,
            spacings,
            clumps,
            aside: None,
            spacing_px: spacing_px(&view.entire(), resident),
            flat_px: 1,
            depth_source: None,
            holes: None,
            tile_lists: TileLists::default(),
        })
    }
}

/// Share of the points that are not strays.
const WITHOUT_STRAYS: f64 = 0.99;

/// Returns the clumps of all nodes, each with those of a whole page. The sparsest clumps of a node
/// count as its other points, and the sparsest nodes as the next ones: splats would be balls.
fn clumps(resident: &Resident) -> Vec<Clump> {
    let all = POINTS_PER_PAGE as usize / POINTS_PER_CLUMP;
    let sparsest = resident.spacing_of_share(WITHOUT_STRAYS);
    let mut clumps = vec![Clump::default(); all * resident.nodes.len().max(1)];
    for (to, node) in clumps.chunks_exact_mut(all).zip(&resident.nodes) {
        let (spread, sparsest) = (node.spread(), node.spacing().min(sparsest));
        to.iter_mut().zip(node.clumps.iter()).for_each(|(to, clump)| {
            *to = Clump {
                spacing: (clump.covered() * (clump.spacing * spread).min(sparsest)) as f32,
                scatter: clump.scatter as f32,
            }
        });
    }
    clumps
}

/// Returns the smallest and largest point spacing of all nodes in view `[px]`.
pub fn spacing_px(view: &View, resident: &Resident) -> [f64; 2] {
    let f = view.focal_px();
    let seen = resident.nodes.iter().filter_map(|node| {
        let (near, far) = view.depths(node.bounds())?;
        let spacing = node.spacing();
        Some(match view.camera.projection {
            Projection::Perspective => [spacing * f / far, spacing * f / near],
            Projection::Orthographic => [spacing * f; 2],
        })
    });
    let all = seen.reduce(|all, own| [all[0].min(own[0]), all[1].max(own[1])]);
    // A spacing of 0 at a depth of 0 has no size.
    all.map_or([0.0; 2], |range| range.map(|px| if px.is_nan() { 0.0 } else { px }))
}

/// Returns the words at the ends of the table's rows: those of the ramp, or farther apart if a gain
/// brings words from beyond it.
fn row_words(shown: &DisplayAttribute, gains: &[f64]) -> [f64; 2] {
    let [lo, hi] = shown.ramp_words();
    [lo, (hi / gains.iter().copied().fold(1.0, f64::min)).max(hi)]
}

/// Returns the linear colours of the table: 256, and if the attribute depends on the station 256
/// for each.
fn table(shown: &DisplayAttribute, gains: &[f64]) -> Vec<[f32; 4]> {
    let color = |[r, g, b]: [f64; 3]| [r as f32, g as f32, b as f32, 1.0];
    match mode(shown.attribute) {
        RGB => linear(shown, gains).map(|v| color([v; 3])).collect(),
        RAMP => places(shown, gains)
            .map(|place| color(shown.ramp_at(place).map(srgb_to_linear)))
            .collect(),
        _ => (0..256)
            .map(|i| color(colormap::entry(shown.attribute, &shown.scale, i).map(srgb_to_linear)))
            .collect(),
    }
}

/// Returns where each entry of the rows of numbers lies on the ramp, 0..=1, times its gain.
fn places<'g>(shown: &DisplayAttribute, gains: &'g [f64]) -> impl Iterator<Item = f64> + use<'g> {
    let ([lo, hi], [_, end]) = (shown.ramp_words(), row_words(shown, gains));
    let is_neutral = gains.iter().all(|gain| *gain == 1.0);
    gains.iter().flat_map(move |&gain| {
        (0..256).map(move |i| {
            let share = i as f64 / 255.0;
            let word = gain * (lo + (end - lo) * share);
            if is_neutral { share } else { ((word - lo) / (hi - lo).max(1.0)).clamp(0.0, 1.0) }
        })
    })
}

/// Returns 256 linear values of channels for each gain. The gain is one on the light that was
/// measured, and comes before stretch and tone.
fn linear<'g>(shown: &DisplayAttribute, gains: &'g [f64]) -> impl Iterator<Item = f64> + use<'g> {
    let ([lo, hi], shown) = (shown.ramp_words().map(|end| end / 255.0), *shown);
    let is_plain = [lo, hi] == [0.0, 1.0] && (shown.toned(0.25), shown.toned(0.75)) == (0.25, 0.75);
    gains.iter().flat_map(move |&gain| {
        (0..256).map(move |v| {
            let light = (gain * srgb_to_linear(v as f64 / 255.0)).min(1.0);
            if is_plain {
                return light;
            }
            let channel = if gain == 1.0 { v as f64 / 255.0 } else { linear_to_srgb(light) };
            let place = ((channel - lo) / (hi - lo).max(1.0 / 255.0)).clamp(0.0, 1.0);
            srgb_to_linear(shown.toned(place))
        })
    })
}

/// Returns for each entry of every row the entry of the first row that shows the same: 8-bit sRGB
/// values at one exposure, before stretch and tone.
pub fn levels(shown: &DisplayAttribute, gains: &[f64]) -> Vec<u32> {
    let [lo, end] = row_words(shown, gains);
    let is_ramp = mode(shown.attribute) == RAMP;
    let level = |gain: f64, v: usize| {
        let share = v as f64 / 255.0;
        let evened = match is_ramp {
            _ if gain == 1.0 => share,
            true => (gain * (lo + (end - lo) * share) - lo) / (end - lo).max(1.0),
            false => linear_to_srgb((gain * srgb_to_linear(share)).min(1.0)),
        };
        (255.0 * evened.clamp(0.0, 1.0)).round() as u32
    };
    gains.iter().flat_map(|&gain| (0..256).map(move |v| level(gain, v))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cloud::attribute::tones;

    #[test]
    fn a_factor_of_one_changes_nothing_and_values_grow_with_light() {
        let mut shown = DisplayAttribute::indexed(Attribute::Rgb, [0.0; 2], [0, 255]);
        let at = |shown: &DisplayAttribute, v: usize| {
            let linear: Vec<f64> = linear(shown, &[1.0, 0.5]).collect();
            [linear[v], linear[256 + v]].map(|light| (255.0 * linear_to_srgb(light)).round())
        };
        let dark = DisplayAttribute::indexed(Attribute::Rgb, [0.0; 2], [0, 51]);
        assert_eq!([10, 51, 200].map(|v| at(&dark, v)[0]), [50.0, 255.0, 255.0]);
        // The median of dark colours lies in the middle, unless ends are asked for.
        let mut uneven = DisplayAttribute::indexed(Attribute::Rgb, [0.0; 2], [0, 255]);
        let colors: Vec<[u8; 3]> = (0..=100).map(|v| [v / 4 + v / 51 * 50, 0, 0]).collect();
        uneven.brighten(&tones([&colors[..]].into_iter()));
        let [middle, most] = [12, 73].map(|v| at(&uneven, v)[0]);
        assert!((127.0..=129.0).contains(&middle) && most > 250.0, "{middle} {most}");
        assert_eq!(at(&uneven, 0)[0], 0.0);
        uneven.scale.range = Some([0.0, 100.0]);
        assert_eq!(at(&uneven, 20)[0], 51.0);
        // A gain is one on the light before it is stretched.
        assert!(at(&dark, 51)[1] < 255.0 && at(&dark, 200)[1] == 255.0);
        shown.scale.range = Some([100.0, 200.0]);
        assert_eq!([99, 150, 200].map(|v| at(&shown, v)[0]), [0.0, 128.0, 255.0]);
        // Averages are made before stretch and tone, which the first row adds.
        let levels = |shown: &DisplayAttribute| super::levels(shown, &[1.0, 0.5, 16.0]);
        assert!(
            levels(&shown)
                == levels(&DisplayAttribute::indexed(Attribute::Rgb, [0.0; 2], [0, 255]))
        );
        let levels = levels(&shown);
        assert!((0..256).all(|v| levels[v] == v as u32));
        assert!(levels[256..].chunks(256).all(|row| row.is_sorted()));
        assert_eq!((levels[256 + 255], levels[512 + 255], levels[512 + 100]), (188, 255, 255));
    }

    #[test]
    fn a_gain_on_intensities_moves_them_along_the_ramp() {
        let shown = DisplayAttribute::indexed(Attribute::Intensity, [0.0; 2], [100, 1100]);
        let gains = [1.0, 0.5, 2.0];
        let [lo, hi] = row_words(&shown, &gains);
        assert_eq!([lo, hi], [100.0, 2200.0]);
        let places: Vec<f64> = places(&shown, &gains).collect();
        let place =
            |row: usize, word: f64| places[256 * row + ((word - lo) * 255.0 / (hi - lo)) as usize];
        for (row, word, seen) in
            [(0, 600.0, 0.5), (1, 1200.0, 0.5), (2, 300.0, 0.5), (1, 2200.0, 1.0)]
        {
            assert!((place(row, word) - seen).abs() < 0.02, "{row} {word} {}", place(row, word));
        }
        assert_eq!((place(0, 2000.0), place(2, 1000.0)), (1.0, 1.0));
    }
}
