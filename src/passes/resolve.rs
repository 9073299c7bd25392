//! KEYS -> LAYERS: depth, point ids and colours of one band, written into the whole picture's images.

use super::project::{Band, Keys};
use super::{Decided, Layers, exposure, luminance};
use crate::cloud::attribute::{Attribute, Shown};
pub use crate::cloud::color::{linear_to_srgb, srgb_to_linear};
use crate::error::Result;
use crate::graph::{Buffer, Dispatch, Graph, Image, Kind};
use crate::resident::Resident;
use crate::shader::{self, resolve::Push, resolve::Spec};
use crate::view::{Projection, View};

/// Images that `record` fills band by band.
pub struct Resolved {
    pub depth: Image,
    pub index: Image,
    pub color: Image,
}

pub fn layers(g: &mut Graph, view: &View) -> Resolved {
    Resolved {
        depth: g.image("depth", view.size, Kind::R32f),
        index: g.image("index", view.size, Kind::R32ui),
        color: g.image("color", view.size, Kind::Rgba32f),
    }
}

/// What turns a point's word into a colour, on the GPU.
pub struct Paint {
    pub(super) shown: Buffer,
    /// Where points say of what kind they are.
    pub(super) kinds: Option<Buffer>,
    /// Where not all points are opaque.
    pub(super) opacities: Option<Buffer>,
    pub(super) table: Buffer,
    /// Of its rows ([`exposure::gains`]).
    pub(super) gains: Vec<f64>,
    /// Where colours are to be averaged: values of 8 bits with one exposure, row by row as in the table. Colours are left to [`luminance`] then.
    pub(super) levels: Option<Buffer>,
    pub(super) mode: u32,
    /// The word at the low end of the ramp, and how much of a table of 256 a word more is.
    pub(super) ramp: [f32; 2],
}

impl Paint {
    /// What is not looked at wants a binding all the same.
    pub(super) fn kinds(&self) -> &Buffer {
        self.kinds.as_ref().unwrap_or(&self.shown)
    }

    pub(super) fn opacities(&self) -> &Buffer {
        self.opacities.as_ref().unwrap_or(&self.shown)
    }

    /// For a later pass.
    pub(super) fn again(&self) -> Paint {
        let again = |buffer: &Option<Buffer>| buffer.as_ref().map(Buffer::alias);
        Paint {
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

/// How words become colours, as glsl/lib/paint.glsl numbers it.
const RGB: u32 = 0;
const RAMP: u32 = 1;
const PALETTE: u32 = 2;
const NORMAL: u32 = 3;
const CONSTANT: u32 = 4;

fn mode(attribute: Attribute) -> u32 {
    match attribute {
        Attribute::Rgb | Attribute::Corrected => RGB,
        Attribute::Intensity | Attribute::Elevation => RAMP,
        Attribute::Class | Attribute::Source | Attribute::Return => PALETTE,
        Attribute::Normal => NORMAL,
        Attribute::White => CONSTANT,
    }
}

pub fn paint(g: &mut Graph, resident: &Resident, decided: &Decided) -> Result<Paint> {
    let Shown { attribute, stretch: [lo, hi], .. } = resident.shown;
    let mode = mode(attribute);
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
    let gains = exposure::gains(resident, decided);
    let table = g.upload("table", &table(attribute, &gains))?;
    let levels = luminance::averages(resident.shown.attribute, decided)
        .then(|| g.upload("levels", &exposure::levels(&gains)))
        .transpose()?;
    Ok(Paint {
        shown,
        kinds,
        opacities,
        table,
        gains,
        levels,
        mode,
        ramp: [lo as f32, 255.0 / (hi as f32 - lo as f32).max(1.0)],
    })
}

pub fn record(
    g: &mut Graph,
    keys: &Keys,
    paint: &Paint,
    band: Band,
    resolved: Resolved,
) -> Resolved {
    let Resolved { mut depth, mut index, mut color } = resolved;
    let push = Push { size: band.size, top: band.top, lo: paint.ramp[0], scale: paint.ramp[1] };
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
    let groups = [band.size[0].div_ceil(64), band.size[1], 1];
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
    /// The layers that effects start from.
    pub fn layers(self, g: &mut Graph, view: &View, resident: &Resident) -> Result<Layers> {
        let Resolved { depth, index, color } = self;
        let (raw, raw_index) = (g.copy("raw", &depth), g.copy("raw index", &index));
        let spacings: Vec<f32> =
            resident.nodes.iter().map(|node| node.spacing as f32).chain([0.0]).collect();
        let spacings = g.upload("spacings", &spacings)?;
        let facings = resident
            .shown
            .normal()
            .map(|word| g.upload("facings", &resident.addresses(word)))
            .transpose()?;
        Ok(Layers {
            depth,
            raw,
            index,
            raw_index,
            color,
            front: None,
            facings,
            marks: None,
            reached: None,
            sums: None,
            lit: None,
            spacings,
            spacing_px: spacing_px(&view.entire(), resident),
            flat_px: 1,
            source: None,
            holes: None,
        })
    }
}

/// Of all nodes that the view can see, the least and the most that their points' spacing may be, pixels.
pub fn spacing_px(view: &View, resident: &Resident) -> [f64; 2] {
    let f = view.focal_px();
    let seen = resident.nodes.iter().filter_map(|node| {
        let (near, far) = view.depths(node.bounds())?;
        Some(match view.camera.projection {
            Projection::Perspective => [node.spacing * f / far, node.spacing * f / near],
            Projection::Orthographic => [node.spacing * f; 2],
        })
    });
    let all = seen.reduce(|all, own| [all[0].min(own[0]), all[1].max(own[1])]);
    // A spacing of 0 at a depth of 0 is no spacing.
    all.map_or([0.0; 2], |range| range.map(|px| if px.is_nan() { 0.0 } else { px }))
}

/// The 256 linear colours that words are looked up in; of colours, as many for every station.
fn table(attribute: Attribute, gains: &[f64]) -> Vec<[f32; 4]> {
    if attribute == Attribute::Rgb {
        return exposure::linear(gains).map(|v| [v as f32, v as f32, v as f32, 1.0]).collect();
    }
    let color = |i| {
        let [r, g, b] = srgb(attribute, i).map(|channel| srgb_to_linear(channel) as f32);
        [r, g, b, 1.0]
    };
    (0..256).map(color).collect()
}

/// Of the 256, one.
fn srgb(attribute: Attribute, i: usize) -> [f64; 3] {
    let t = i as f64 / 255.0;
    match attribute {
        Attribute::Rgb | Attribute::Corrected | Attribute::Intensity => [t; 3],
        Attribute::Elevation => height_ramp(t),
        Attribute::Class => class_color(i),
        // The golden angle keeps neighbouring numbers far apart in hue.
        Attribute::Source | Attribute::Return => hue(i as f64 * 0.381_966),
        Attribute::Normal | Attribute::White => [0.9; 3],
    }
}

/// What a class or a return number is drawn in, 8-bit sRGB.
pub fn code_color(attribute: Attribute, code: u8) -> [u8; 3] {
    srgb(attribute, code as usize).map(|channel| (255.0 * channel).round() as u8)
}

/// What a word is drawn in, 8-bit sRGB, but for shading and rounding.
pub fn color_of(shown: &Shown, word: u32) -> [u8; 3] {
    let [lo, hi] = shown.stretch.map(|end| end as f64);
    let byte = |channel: u32| (word >> (8 * channel) & 255) as u8;
    let entry = match mode(shown.attribute) {
        RGB => return [0, 1, 2].map(byte),
        NORMAL => {
            return [0, 1, 2].map(|axis| {
                (255.0 * (byte(axis) as f64 / 254.0).clamp(0.0, 1.0).powf(1.0 / 2.2)) as u8
            });
        }
        RAMP => ((word as f64 - lo) * 255.0 / (hi - lo).max(1.0)).clamp(0.0, 255.0) as usize,
        PALETTE => byte(0) as usize,
        _ => 0,
    };
    srgb(shown.attribute, entry).map(|channel| (255.0 * channel).round() as u8)
}

/// From deep blue over green and sand to white: lightness rises all the way, so that the ramp also reads in grey.
fn height_ramp(t: f64) -> [f64; 3] {
    const STOPS: [[f64; 3]; 6] = [
        [0.16, 0.22, 0.42],
        [0.13, 0.42, 0.52],
        [0.25, 0.58, 0.44],
        [0.58, 0.70, 0.39],
        [0.90, 0.79, 0.53],
        [0.98, 0.96, 0.92],
    ];
    let at = t * (STOPS.len() - 1) as f64;
    let k = (at as usize).min(STOPS.len() - 2);
    std::array::from_fn(|c| STOPS[k][c] + (STOPS[k + 1][c] - STOPS[k][c]) * (at - k as f64))
}

/// Customary colours of the ASPRS standard classes (LAS 1.4 R15, table 17): ground brown, vegetation green, buildings red, water blue.
fn class_color(class: usize) -> [f64; 3] {
    match class {
        0 | 1 => [0.72, 0.72, 0.72],
        2 => [0.65, 0.50, 0.34],
        3 => [0.60, 0.78, 0.42],
        4 => [0.36, 0.66, 0.31],
        5 => [0.15, 0.50, 0.22],
        6 => [0.82, 0.34, 0.28],
        7 | 18 => [0.90, 0.20, 0.75],
        9 => [0.26, 0.52, 0.85],
        10 => [0.45, 0.35, 0.45],
        11 => [0.48, 0.48, 0.52],
        17 => [0.93, 0.77, 0.35],
        other => hue(other as f64 * 0.381_966),
    }
}

/// A bright, not quite saturated colour of a hue in turns.
fn hue(turns: f64) -> [f64; 3] {
    [0.0, 1.0 / 3.0, 2.0 / 3.0]
        .map(|shift| 0.62 + 0.3 * ((turns - shift) * std::f64::consts::TAU).cos())
}
