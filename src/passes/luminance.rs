//! Luminance correction: colours of one luminance, whichever station each point is from (Kanzok,
//! Linsen and Rosenthal 2012).
//!
//! ```text
//!     project         points -> chunks with points         the walk that finds the front also
//!                                                          finds chunks at most epsilon behind it
//!     luminance_sum   points, front depth -> sums          a second walk over these chunks adds
//!                                                          value and count of points at the front
//!     luminance       sums, color -> color                 hue and saturation of the front point,
//!                                                          mean of all values
//! ```
//! Nothing is corrected where only one station has points (`resident::station_overlap`): these
//! points are not walked again, and pixels keep their colours. Sums are integers, so neither the
//! order of points nor threads change them. Both walks compute depths by the same function, so the
//! front point is always in its own sum (guide: numerics, case 25). Colours arrive as 8-bit values
//! of front points and become linear here. The effect runs before hidden points are removed and
//! holes are filled, so that filling uses corrected colours.

use super::exposure;
use super::project::{self, Drawn, Group, Shallow, Strip, Walk};
use super::resolve::ColorLookup;
use super::{Effect, EffectDecisions, Effects, FrameContext, GBuffer, Reason, Setting, Value};
use crate::cloud::attribute::{Attribute, DisplayAttribute};
use crate::error::{Error, Result};
use crate::graph::{Buffer, Dispatch, Graph, Image};
use crate::shader::{self, luminance as kernel, luminance_sum32, luminance_sum64};
use crate::view::View;
use strum::{EnumString, IntoStaticStr, VariantArray};

pub const SUMMARY: &str =
    "one luminance for all stations: the mean over all points of the front surface of a pixel";

#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Settings {
    pub space: Space,
    /// Side of the square of pixels whose points are averaged with Gaussian weights: 1 or 3; 0: as
    /// many as hold enough points `[px]`.
    pub neighbourhood: f64,
    /// Distance behind the front up to which a point belongs to its surface `[m]`; 0: three point
    /// spacings.
    pub epsilon: f64,
}

/// The channels that are averaged.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
#[derive(EnumString, IntoStaticStr, VariantArray)]
#[strum(serialize_all = "kebab-case")]
#[serde(rename_all = "lowercase")]
pub enum Space {
    /// The largest channel; hue and saturation stay those of the front point.
    #[default]
    Hsv,
    /// Red, green and blue.
    Rgb,
}

impl Default for Settings {
    fn default() -> Self {
        Settings { space: Space::Hsv, neighbourhood: 0.0, epsilon: 0.0 }
    }
}

impl super::Settings for Settings {
    fn list_all(&mut self) -> Vec<Setting<'_>> {
        vec![
            Setting::new(
                "neighbourhood",
                "width of the square whose points are averaged [px]; 0: as wide as enough points need",
                Value::OneOf(&mut self.neighbourhood, &[0.0, 1.0, 3.0]),
            ),
            Setting::new(
                "epsilon",
                "thickness of the front surface [m]; 0: three point spacings",
                Value::Length(&mut self.epsilon, 0.0..=1e9),
            ),
            // For studies.
            Setting::variant("space", Value::Choice(&mut self.space)),
        ]
    }

    /// Pixels without a point do not change.
    fn grows_px(&self, _spacing_px: f64) -> f64 {
        0.0
    }
}

/// Points per pixel from which the average is worth the second walk (Kanzok et al. 2012, sec. 5:
/// seven to ten).
const ENOUGH: f64 = 7.0;

/// See [`super::Effects::reach_px`].
pub fn reach_px(_view: &View, settings: &Settings) -> Option<u32> {
    let of_one = settings.neighbourhood == 1.0;
    Some(!of_one as u32)
}

/// Share of overlapping places that may still differ once all stations have one exposure.
const FEW: f64 = 0.05;

pub fn called_for(context: &FrameContext, _asked: &Effects, before: &EffectDecisions) -> Reason {
    let (stations, density) = (context.stations, super::significant(context.sampling.density));
    let (runs, why) = match () {
        _ if context.points == 0 => (false, "there are no points".to_string()),
        _ if !context.shown.has_luminance() => {
            (false, "points show neither colours nor intensity".to_string())
        }
        _ if context.is_ramped => (false, "points show numbers on a coloured ramp".to_string()),
        _ if context.shown == Attribute::Corrected => {
            (false, "the colours are corrected already".to_string())
        }
        _ if stations < 2 => (false, "there is only one station".to_string()),
        _ if context.overlap.count == 0 => {
            (false, format!("{stations} stations, but no part of the picture shows several"))
        }
        _ if context.sampling.density < ENOUGH => (
            false,
            format!(
                "{stations} stations, but half of the points in view lie less densely than {density} a pixel, and {ENOUGH} are needed; --effect luminance=on"
            ),
        ),
        _ if exposure::is_one(context, before)
            && context.balance.is_some_and(|balance| balance.uneven <= FEW) =>
        {
            (false, "stations hardly differ at one exposure; --effect luminance=on".to_string())
        }
        _ => {
            let shared = super::significant(
                100.0 * context.overlap.count as f64 / context.overlap.seen as f64,
            );
            (
                true,
                format!(
                    "{stations} stations, several in {shared} % of what the picture shows; half of the points in view lie at {density} a pixel or more, where {ENOUGH} tell what they have in common"
                ),
            )
        }
    };
    Reason { runs, why }
}

/// Returns whether values are averaged. Strokes have no points behind each other, and colours of a
/// ramp no mean.
pub fn averages(shown: &DisplayAttribute, decisions: &EffectDecisions) -> bool {
    decisions.runs(Effect::Luminance)
        && !decisions.runs(Effect::Strokes)
        && shown.attribute.has_luminance()
        && !shown.is_ramped()
}

/// The sums of every pixel's points.
pub struct Sums {
    strips: Vec<Summed>,
    /// Lookup of the core passes.
    paint: ColorLookup,
    channels: u32,
    /// Distance behind the front `[m]`.
    pub epsilon: f32,
    /// True for each tile that is corrected; None if all are.
    several: Option<Buffer>,
}

/// Sums of the rows of one strip.
struct Summed {
    /// First row, and the one after the last.
    rows: [u32; 2],
    /// The strip, with adjacent rows for neighbours.
    strip: Strip,
    sums: Buffer,
}

/// Largest number of points that both words of a sum can hold (glsl/lib/luminance.glsl).
pub const MOST_POINTS: u64 = (1 << 28) - 1;

/// Automatic epsilon [point spacings]. Among one to eight, the least that leaves no greater steps
/// than a tenth above the offline reference, and loses no more details (`study luminance`).
const SPACINGS: f64 = 3.0;

/// Returns the radius of the averaged neighbourhood `[px]`. The 3 x 3 weigh as much as four pixels:
/// with four times enough points per pixel, one pixel suffices.
fn around(context: &FrameContext, settings: &Settings) -> u32 {
    let asked = settings.neighbourhood;
    (if asked == 0.0 { context.sampling.density < 4.0 * ENOUGH } else { asked >= 2.0 }) as u32
}

fn epsilon(context: &FrameContext, settings: &Settings) -> f64 {
    if settings.epsilon == 0.0 { SPACINGS * context.sampling.spacing_m } else { settings.epsilon }
}

/// Creates the buffer that the first walk fills for the second; None without correction.
pub fn shallow(
    g: &mut Graph,
    context: &FrameContext,
    settings: &Settings,
    drawn: &Drawn,
    paint: &ColorLookup,
) -> Option<Shallow> {
    paint.levels.is_some().then(|| drawn.shallow(g, epsilon(context, settings) as f32))
}

/// Bytes of a sum: values and count.
const SUM_BYTES: u64 = 8;

/// Returns the sums of all pixels: points at most epsilon behind the front. Errors if there are
/// more points than a sum holds.
pub fn sums(
    g: &mut Graph,
    context: &FrameContext,
    settings: &Settings,
    drawn: &Drawn,
    shallow: &Shallow,
    paint: &ColorLookup,
    front: &Image,
) -> Result<Sums> {
    if drawn.statistics.points_drawn > MOST_POINTS {
        return Err(Error::Request(format!(
            "luminance correction adds up to {MOST_POINTS} points, and {} are drawn; draw fewer with --point-budget, or --effect luminance=off",
            drawn.statistics.points_drawn
        )));
    }
    let ramp = context.shown == Attribute::Intensity;
    let channels = if settings.space == Space::Rgb && !ramp { 3 } else { 1 };
    let words: Vec<u32> = context.overlap.several.iter().map(|&several| several as u32).collect();
    let several =
        (!context.overlap.is_everywhere()).then(|| g.upload("several", &words)).transpose()?;
    let mut sums = Sums {
        strips: Vec::new(),
        paint: paint.again(),
        channels,
        epsilon: shallow.epsilon,
        several,
    };
    let again = Again { context, drawn, shallow, paint, front, channels };
    let [width, height] = context.view.size;
    // Two rows are for neighbours of a strip.
    let limit = g.binding_limit().saturating_sub(2 * SUM_BYTES * channels as u64 * width as u64);
    for Strip { top, size } in project::strips([channels * width, height], SUM_BYTES, limit) {
        let rows = [top, top + size[1]];
        let strip = Strip {
            top: top.saturating_sub(1),
            size: [width, (rows[1] + 1).min(height) - top.saturating_sub(1)],
        };
        let mut words =
            g.buffer("sums", SUM_BYTES * channels as u64 * width as u64 * strip.size[1] as u64);
        g.fill(&mut words, 0);
        walk(g, &again, strip, &mut words);
        sums.strips.push(Summed { rows, strip, sums: words });
    }
    Ok(sums)
}

/// The inputs of the second walk over points.
struct Again<'w> {
    context: &'w FrameContext<'w>,
    drawn: &'w Drawn,
    shallow: &'w Shallow,
    paint: &'w ColorLookup,
    front: &'w Image,
    channels: u32,
}

fn walk(g: &mut Graph, again: &Again, strip: Strip, sums: &mut Buffer) {
    let &Again { context, drawn, shallow, paint, front, channels } = again;
    let Walk { centre, corner, size, near, lanes, perspective, texels, points_per_chunk } =
        Walk::new(g, context.view, strip);
    let (ramp, levels, [lo, scale]) = (
        context.shown == Attribute::Intensity,
        paint.levels.as_ref().unwrap_or(&paint.table),
        paint.ramp,
    );
    let Shallow { chunks: shallow, epsilon } = shallow;
    let top = strip.top;
    for group in drawn.groups.iter().filter(|group| group.again) {
        let &Group { block, planes, filtered, first_chunk, chunk_count, .. } = group;
        let (nodes, chunks, opacities, within) =
            (&drawn.nodes, &drawn.chunks, drawn.opacities(), drawn.within());
        let (pages, tiles) = (&drawn.pages[block], group.tiles());
        if g.gpu.device.int64_atomics {
            let push = luminance_sum64::Push {
                centre,
                corner,
                size,
                near,
                first_chunk,
                chunk_count,
                epsilon: *epsilon,
                top,
                lo,
                scale,
            };
            let spec = luminance_sum64::Spec {
                lanes,
                planes,
                perspective,
                texels,
                points_per_chunk,
                filtered,
                channels,
                ramp,
            };
            g.run(
                shader::LuminanceSum64 {
                    nodes,
                    chunks,
                    shallow,
                    opacities,
                    within,
                    pages,
                    page_words: pages,
                    front,
                    levels,
                    sums,
                    push,
                    spec,
                },
                tiles,
            );
        } else {
            let push = luminance_sum32::Push {
                centre,
                corner,
                size,
                near,
                first_chunk,
                chunk_count,
                epsilon: *epsilon,
                top,
                lo,
                scale,
            };
            let spec = luminance_sum32::Spec {
                lanes,
                planes,
                perspective,
                texels,
                points_per_chunk,
                filtered,
                channels,
                ramp,
            };
            g.run(
                shader::LuminanceSum32 {
                    nodes,
                    chunks,
                    shallow,
                    opacities,
                    within,
                    pages,
                    page_words: pages,
                    front,
                    levels,
                    sums,
                    push,
                    spec,
                },
                tiles,
            );
        }
    }
}

pub fn record(
    g: &mut Graph,
    context: &FrameContext,
    settings: &Settings,
    gbuffer: GBuffer,
) -> GBuffer {
    let GBuffer { mut color, luminance_sums, .. } = gbuffer;
    if let Some(Sums { strips, paint, channels, epsilon, several }) = &luminance_sums {
        let (width, corner) = (context.view.size[0], context.view.corner);
        let around = around(context, settings);
        let (transparent, by_kind, texels) = (
            paint.opacities.is_some(),
            paint.kinds.is_some(),
            g.gpu.device.has_large_texel_buffers,
        );
        let (partly, mode) = (several.is_some(), paint.mode);
        let spec = kernel::Spec {
            channels: *channels,
            around,
            texels,
            transparent,
            by_kind,
            partly,
            mode,
        };
        for Summed { rows, strip, sums } in strips {
            let [lo, scale] = paint.ramp;
            let push = kernel::Push {
                width,
                rows: *rows,
                summed: [strip.top, strip.top + strip.size[1]],
                epsilon: *epsilon,
                lo,
                scale,
                corner,
                tiles_across: context.overlap.size[0],
            };
            g.run(
                shader::Luminance {
                    sums,
                    sum_words: sums,
                    table: &paint.table,
                    levels: paint.levels.as_ref().expect("there are sums"),
                    shown: &paint.shown,
                    kinds: paint.kinds(),
                    opacities: paint.opacities(),
                    front: &gbuffer.projected_depth,
                    index: &gbuffer.index,
                    several: several.as_ref().unwrap_or(&paint.table),
                    color: &mut color,
                    push,
                    spec,
                },
                Dispatch::Groups([width.div_ceil(64), rows[1] - rows[0], 1]),
            );
        }
    }
    GBuffer { color, luminance_sums, ..gbuffer }
}
