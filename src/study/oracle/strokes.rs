//! The f64 twin of strokes: every stroke against every pixel, in world coordinates, by the formulas
//! of the paper.
//!
//! From points, their derived data and opacities, a view and settings, it computes for every pixel
//! the colour of all blended strokes, and the depths that may hide what is behind. The kernel
//! rounds colours and coverages to 8 bits and depths to f32: colours may be off by a few hundredths
//! where many strokes overlap. Pixels in which roundings may swap two strokes, or which a stroke's
//! edge crosses, are unsure and not compared.

use crate::cloud::Part;
use crate::cloud::colormap::srgb_to_linear;
use crate::cloud::octahedral;
use crate::cloud::strays::relative;
use crate::index::attributes::axes;
use crate::index::attributes::strokes::{Stroke, householder};
use crate::index::format::Axes;
use crate::passes::strokes::brush::{Bristles, turns};
use crate::passes::strokes::surface::{DIRECTIONS, ENCLOSED_PX, NEARER, NEARER_PX};
use crate::passes::strokes::{Blend, LEAST_PX, Order, Settings, Tangents};
use crate::view::{Projection, View};
use glam::{DVec2, DVec3};
use rayon::prelude::*;

/// Relative depth difference below which strokes may be in either order.
const APART: f64 = 1e-5;
/// Share of a stroke's side within which edges and coverages are unsure.
const EDGE: f64 = 1e-4;
/// Cosine of the angle to a stroke's normal below which rays graze it.
const GRAZING: f64 = 0.02;
/// Tolerance of colours, of 1.
const COLOR: f64 = 0.02;

#[derive(Clone, Debug, Default)]
pub struct Pixel {
    pub color: [f64; 4],
    pub depth: f64,
    pub sure: bool,
}

/// Numbers of compared and wrong pixels.
#[derive(Clone, Copy, Debug, Default)]
pub struct Agreement {
    pub pixels: usize,
    pub unsure: usize,
    pub color_off: usize,
    pub depth_off: usize,
    pub worst: f64,
}

pub fn compare(truth: &[Pixel], picture: &[[f32; 4]], depth: &[f32]) -> Agreement {
    let mut agreement = Agreement::default();
    for ((pixel, drawn), z) in truth.iter().zip(picture).zip(depth) {
        if !pixel.sure {
            agreement.unsure += 1;
            continue;
        }
        agreement.pixels += 1;
        let off = (0..4).map(|c| (pixel.color[c] - drawn[c] as f64).abs()).fold(0.0, f64::max);
        agreement.worst = agreement.worst.max(off);
        agreement.color_off += (off > COLOR) as usize;
        let same = pixel.depth == *z as f64 || (*z as f64 / pixel.depth - 1.0).abs() < APART;
        agreement.depth_off += !same as usize;
    }
    agreement
}

/// Returns the tangent of a unit normal that faces the viewer; `along` is the direction of the
/// points' largest spread.
pub fn tangent(tangents: Tangents, n: DVec3, along: DVec3) -> DVec3 {
    match tangents {
        Tangents::Householder => householder(n).0,
        Tangents::Eberly if n.x.abs() > n.y.abs() => DVec3::new(-n.z, 0.0, n.x).normalize(),
        Tangents::Eberly => DVec3::new(0.0, n.z, -n.y).normalize(),
        Tangents::Squareplate => {
            let aside = n.cross(DVec3::new(n.y, n.z, n.x));
            if aside.length_squared() > 1e-6 {
                aside.normalize()
            } else {
                DVec3::new(n.y, -n.x, 0.0).normalize()
            }
        }
        Tangents::Covariance => along,
    }
}

/// The intersection of a ray with a stroke.
struct Fragment {
    /// Index among all strokes.
    stroke: usize,
    depth: f64,
    /// Sort key.
    order: f64,
    /// Coverage of the pixel by the brush, and the light absorbed there.
    coverage: f64,
    alpha: f64,
    color: DVec3,
}

/// A stroke in the world for a view.
struct Painted {
    at: DVec3,
    normal: DVec3,
    tangent: DVec3,
    bitangent: DVec3,
    /// Side lengths `[m]`: along the tangent, and across it.
    sides: DVec2,
    /// Reach of its near ground from the middle, relative to a side.
    near: f64,
    words: [u32; 2],
    color: DVec3,
    opacity: f64,
}

impl Painted {
    /// Returns where a ray meets its plane, relative to its sides, and the depth.
    fn met(&self, origin: DVec3, direction: DVec3) -> Option<(DVec2, f64)> {
        let steep = direction.dot(self.normal);
        let depth = (self.at - origin).dot(self.normal) / steep;
        let off = origin + direction * depth - self.at;
        let uv = DVec2::new(off.dot(self.tangent), off.dot(self.bitangent)) / self.sides;
        (steep < 0.0 && depth > 0.0).then_some((uv, depth))
    }
}

/// The ground in a pixel.
#[derive(Clone, Copy, PartialEq)]
enum Ground {
    None,
    /// Part of a surface if enclosed.
    Far,
    Near,
}

/// The opacity of a point by its number.
pub type Opacity<'o> = &'o dyn Fn(usize) -> f64;

/// Draws all strokes of a part with colours: blended, or the nearest of each pixel, by the
/// settings; not softened.
pub fn paint(
    view: &View,
    settings: &Settings,
    part: &Part,
    strokes: &[Stroke],
    opacity: Opacity,
) -> Vec<Pixel> {
    let easel = Easel::new(view, settings, part, strokes, opacity);
    let [width, height] = view.size;
    let pixel = if settings.blend == Blend::Abuffer { Easel::blended } else { Easel::nearest };
    (0..width * height)
        .map(|k| pixel(&easel, (k % width) as f64 + 0.5, (k / width) as f64 + 0.5))
        .collect()
}

/// Counts the fragments of all pixels.
pub fn fragments(
    view: &View,
    settings: &Settings,
    part: &Part,
    strokes: &[Stroke],
    opacity: Opacity,
) -> u64 {
    let easel = Easel::new(view, settings, part, strokes, opacity);
    let [width, height] = view.size;
    (0..width * height)
        .map(|k| easel.fragments((k % width) as f64 + 0.5, (k / width) as f64 + 0.5).0.len() as u64)
        .sum()
}

/// Counts pairs of consecutive strokes of a pixel that also meet in the pixel right of it or below;
/// and those in the opposite order there, which intersect.
pub fn crossings(view: &View, settings: &Settings, part: &Part, strokes: &[Stroke]) -> [u64; 2] {
    let easel = Easel::new(view, settings, part, strokes, &|_| 1.0);
    let [width, height] = view.size;
    let visible = |k: u32| -> Vec<usize> {
        let (mut fragments, _) =
            easel.fragments((k % width) as f64 + 0.5, (k / width) as f64 + 0.5);
        fragments.sort_by(|a, b| a.order.total_cmp(&b.order));
        let mut light = 1.0;
        let seen = fragments.into_iter().filter(|fragment| {
            let shows = light * fragment.alpha;
            light *= 1.0 - fragment.alpha;
            shows > 1.0 / 255.0
        });
        seen.map(|fragment| fragment.stroke).collect()
    };
    let pixels: Vec<Vec<usize>> = (0..width * height).map(visible).collect();
    let mut counts = [0; 2];
    for k in 0..width * height {
        let beside = [
            (k % width + 1 < width).then_some(k + 1),
            (k + width < width * height).then_some(k + width),
        ];
        for other in beside.into_iter().flatten().map(|k| &pixels[k as usize]) {
            for pair in pixels[k as usize].windows(2) {
                let places = [0, 1].map(|i| other.iter().position(|stroke| *stroke == pair[i]));
                if let [Some(first), Some(second)] = places {
                    counts[0] += 1;
                    counts[1] += (first > second) as u64;
                }
            }
        }
    }
    counts
}

/// All strokes for a view.
struct Easel<'v> {
    view: &'v View,
    order: Order,
    bristles: Bristles,
    /// The ground of a brush, [`Brush::ground`](crate::passes::strokes::brush::Brush::ground).
    ground: f64,
    /// True for each pixel that is surface, and for each where that is sure.
    surface: Vec<(bool, bool)>,
    detail: f64,
    turns: Vec<DVec2>,
    painted: Vec<Painted>,
}

impl<'v> Easel<'v> {
    fn new(
        view: &'v View,
        settings: &Settings,
        part: &Part,
        strokes: &[Stroke],
        opacity: Opacity,
    ) -> Easel<'v> {
        let columns = &part.columns;
        let turns: Vec<DVec2> = turns(settings.noise)
            .into_iter()
            .map(|[c, s]| DVec2::new(c as f64, s as f64))
            .collect();
        let bristles = Bristles::of(settings);
        let axes = axes::of(std::slice::from_ref(part));
        let corner = columns.extent().map_or([0; 3], |extent| extent.low);
        let seen = |(i, stroke): (usize, &Stroke)| {
            let steps = [columns.x[i], columns.y[i], columns.z[i]];
            let color = columns
                .rgb
                .as_ref()
                .map_or([255; 3], |rgb| rgb[i])
                .map(|c| srgb_to_linear(c as f64 / 255.0));
            let at = part.lattice.world(steps.map(i64::from));
            let words = stroke.words(relative(steps, corner));
            let painted = seen(view, settings, &bristles, &turns, &axes, at, words)?;
            let opacity = opacity(i);
            (opacity > 0.0).then_some(Painted {
                color: DVec3::from_array(color),
                opacity,
                ..painted
            })
        };
        let painted = strokes.iter().enumerate().filter_map(seen).collect();
        let ground = settings.brush.ground();
        let mut easel = Easel {
            view,
            order: settings.order,
            bristles,
            ground,
            surface: Vec::new(),
            detail: settings.detail,
            turns,
            painted,
        };
        easel.surface = easel.find_surface();
        easel
    }

    /// Finds near ground, and pixels farther out with near ground close by in [`DIRECTIONS`] of
    /// eight.
    fn find_surface(&self) -> Vec<(bool, bool)> {
        let [width, height] = self.view.size.map(i64::from);
        let most = ENCLOSED_PX as i64;
        let found: Vec<_> = (-most..height + most)
            .flat_map(|y| (-most..width + most).map(move |x| [x, y]))
            .collect();
        let found: Vec<_> =
            found.par_iter().map(|&[x, y]| self.ground(x as f64 + 0.5, y as f64 + 0.5)).collect();
        let at = |x: i64, y: i64| found[((y + most) * (width + 2 * most) + x + most) as usize];
        let surface = |x: i64, y: i64| {
            let (own, mut sure) = at(x, y);
            let ways = (-1..=1)
                .flat_map(|dy| (-1..=1).map(move |dx| [dx, dy]))
                .filter(|way| *way != [0, 0]);
            let seen = |[dx, dy]: [i64; 2]| (1..=most).map(move |k| at(x + k * dx, y + k * dy));
            if own == Ground::Far {
                sure &= ways.clone().flat_map(seen).all(|(_, sure)| sure);
            }
            let enclosed =
                ways.filter(|way| seen(*way).any(|(ground, _)| ground == Ground::Near)).count()
                    >= DIRECTIONS as usize;
            (own == Ground::Near || own == Ground::Far && enclosed, sure)
        };
        (0..height).flat_map(|y| (0..width).map(move |x| surface(x, y))).collect()
    }

    /// Returns the ground at a place of the picture, and whether it is sure.
    fn ground(&self, x: f64, y: f64) -> (Ground, bool) {
        let (origin, direction) = self.view.ray(x, y);
        let (mut found, mut sure) = (Ground::None, true);
        for stroke in &self.painted {
            let Some((uv, _)) = stroke.met(origin, direction) else { continue };
            let off = uv.length();
            sure &= (off - self.ground).abs() > EDGE && (off - stroke.near).abs() > EDGE;
            if off <= stroke.near {
                found = Ground::Near;
            } else if off <= self.ground && found == Ground::None {
                found = Ground::Far;
            }
        }
        (found, sure)
    }

    /// Returns the fragments at a place of the picture `[px]`, and whether they are sure.
    fn fragments(&self, x: f64, y: f64) -> (Vec<Fragment>, bool) {
        let Easel { view, order, bristles, detail, turns, painted, .. } = self;
        let (origin, direction) = view.ray(x, y);
        let (is_surface, mut sure) = self.surface[y as usize * view.size[0] as usize + x as usize];
        let mut fragments: Vec<Fragment> = Vec::new();
        for (number, stroke) in painted.iter().enumerate() {
            let Some((uv, depth)) = stroke.met(origin, direction) else { continue };
            let (steep, edge) = (direction.dot(stroke.normal), uv.abs().max_element());
            if edge > 0.5 + EDGE {
                continue;
            }
            let seed = stroke.words[0] >> 24;
            let (mut covers, mut color) = (coverage(bristles, turns, uv, seed), stroke.color);
            if stroke.words[1] & 1 << 7 != 0 {
                sure &= (1.5 * edge - 0.5).abs() > EDGE;
                let upper =
                    coverage(bristles, turns, DVec2::new(-uv.y, uv.x) * 1.5, seed ^ 0xA5) * detail;
                // Mixed by square roots, as the kernel stores colours.
                let shade = if seed & 1 == 0 { 1.08 } else { 0.92 };
                let root = DVec3::from_array(color.to_array().map(f64::sqrt));
                let mixed = root * (1.0 - upper) + (root * shade).min(DVec3::ONE) * upper;
                color = mixed * mixed;
                covers = covers.max(upper);
            }
            let alpha = covers * stroke.opacity;
            // At grazing angles a small error of the angle is a large one of the depth.
            sure &= -steep > GRAZING * direction.length()
                && (covers - 0.5).abs() > 0.01
                && (alpha * 255.0 - 0.5).abs() > 0.05
                && (edge - 0.5).abs() > EDGE;
            if edge <= 0.5 && alpha * 255.0 >= 0.5 {
                let order = match order {
                    Order::Pixel => depth,
                    Order::Stroke => (stroke.at - view.camera.eye).dot(view.basis.forward),
                };
                fragments.push(Fragment {
                    stroke: number,
                    depth,
                    order,
                    coverage: covers,
                    alpha,
                    color,
                });
            }
        }
        if !is_surface {
            fragments.clear();
        }
        (fragments, sure)
    }

    /// Returns the nearest stroke that hides what is behind it.
    fn nearest(&self, x: f64, y: f64) -> Pixel {
        let (mut fragments, sure) = self.fragments(x, y);
        fragments.retain(|fragment| fragment.coverage >= 0.5);
        fragments.sort_by(|a, b| a.depth.total_cmp(&b.depth));
        let sure = sure
            && fragments
                .get(1)
                .is_none_or(|second| second.depth / fragments[0].depth - 1.0 > APART);
        let Some(first) = fragments.first() else {
            return Pixel { color: [0.0; 4], depth: f64::INFINITY, sure };
        };
        let Painted { color, opacity, .. } = &self.painted[first.stroke];
        let [r, g, b] = (*color * *opacity).to_array();
        Pixel { color: [r, g, b, *opacity], depth: first.depth, sure }
    }

    /// Blends all strokes, each over those behind it.
    fn blended(&self, x: f64, y: f64) -> Pixel {
        let (mut fragments, mut sure) = self.fragments(x, y);
        let hides = fragments
            .iter()
            .filter(|fragment| fragment.coverage >= 0.5)
            .map(|fragment| fragment.depth)
            .reduce(f64::min);
        let nearest = fragments.iter().map(|fragment| fragment.depth).fold(f64::INFINITY, f64::min);
        fragments.sort_by(|a, b| a.order.total_cmp(&b.order));
        // Nearly transparent or hidden strokes may be in either order.
        let visible = fragments.iter().scan(1.0, |light, fragment| {
            let seen = *light > 1e-3;
            *light *= 1.0 - fragment.alpha;
            seen.then_some(fragment.order)
        });
        let orders: Vec<f64> = visible.collect();
        sure &= orders.windows(2).all(|pair| pair[1] / pair[0] - 1.0 > APART);
        let (mut color, mut light) = (DVec3::ZERO, 1.0);
        for fragment in &fragments {
            color += fragment.color * fragment.alpha * light;
            light *= 1.0 - fragment.alpha;
        }
        let [r, g, b] = color.to_array();
        Pixel { color: [r, g, b, 1.0 - light], depth: hides.unwrap_or(nearest), sure }
    }
}

fn seen(
    view: &View,
    settings: &Settings,
    bristles: &Bristles,
    turns: &[DVec2],
    axes: &Axes,
    at: DVec3,
    words: [u32; 2],
) -> Option<Painted> {
    let depth = (at - view.camera.eye).dot(view.basis.forward);
    if depth <= 0.0 {
        return None;
    }
    let (sight, px_per_m) = match view.camera.projection {
        Projection::Perspective => (at - view.camera.eye, view.focal_px() / depth),
        Projection::Orthographic => (view.basis.forward, view.focal_px()),
    };
    let [facing, brush] = words;
    let known = facing & 0xFF_FFFF != 0xFF_FFFF;
    let stored = octahedral::unpack(facing).unwrap_or_else(|| -sight.normalize());
    let normal = if stored.dot(sight) > 0.0 { -stored } else { stored };
    let (t, b) = householder(stored);
    let turn = turns[20 + (brush >> 8 & 255) as usize];
    let tangent = match settings.tangents {
        Tangents::Covariance if known => t * turn.x + b * turn.y,
        Tangents::Covariance => axes.world(householder(axes.own(normal)).0),
        way => axes.world(tangent(way, axes.own(normal), DVec3::ZERO)),
    };
    let radius = f32::from_bits(brush & 0xFFFF_0000) as f64;
    let side = 2.0
        * (bristles.size * radius * px_per_m)
            .clamp(LEAST_PX as f64, settings.largest_px(view.whole))
        / px_per_m;
    let length = 1.0 + settings.long * ((brush & 31) as f64 / 8.0).min(1.0);
    let ground = settings.brush.ground();
    let beyond_px = (NEARER * (ground * side * px_per_m - 1.0).max(0.0)).min(NEARER_PX);
    Some(Painted {
        at,
        normal,
        tangent,
        bitangent: normal.cross(tangent),
        sides: DVec2::new(side * length, side),
        near: ground - beyond_px / (side * px_per_m),
        words,
        color: DVec3::ONE,
        opacity: 1.0,
    })
}

/// Squares of a brush along a side.
const SQUARES: f64 = 32.0;

/// Interpolates coverage between the corners of a brush's squares, 8 bits each.
fn coverage(bristles: &Bristles, turns: &[DVec2], at: DVec2, seed: u32) -> f64 {
    if at.abs().max_element() > 0.5 {
        return 0.0;
    }
    let place = ((at + 0.5) * SQUARES).clamp(DVec2::ZERO, DVec2::splat(SQUARES));
    let square = place.floor().min(DVec2::splat(SQUARES - 1.0));
    let f = place - square;
    let corner = |x: f64, y: f64| {
        (equation(bristles, turns, (square + DVec2::new(x, y)) / SQUARES - 0.5, seed) * 255.0)
            .round()
            / 255.0
    };
    let [upper, lower] = [0.0, 1.0].map(|y| corner(0.0, y) * (1.0 - f.x) + corner(1.0, y) * f.x);
    upper * (1.0 - f.y) + lower * f.y
}

/// Computes equation 1: the sum of Gaussians, each turned about its own middle.
fn equation(bristles: &Bristles, turns: &[DVec2], at: DVec2, seed: u32) -> f64 {
    let mut turn = turns[(seed & 15) as usize];
    let mut sum = 0.0;
    for column in 0..3u32 {
        for row in 0..3u32 {
            if bristles.places() >> (3 * row + column) & 1 == 0 {
                continue;
            }
            let p = at - (DVec2::new(column as f64, row as f64) - 1.0) * bristles.dev;
            let turned = turn.rotate(p);
            let power = (turned.x / bristles.sigma_x).abs().powf(bristles.gamma)
                + (turned.y / bristles.sigma_y).abs().powf(bristles.gamma);
            sum += bristles.amplitude * (-0.5 * power).exp();
        }
        turn = turns[16 + (seed >> (4 + 2 * column) & 3) as usize].rotate(turn);
    }
    sum.min(1.0)
}
