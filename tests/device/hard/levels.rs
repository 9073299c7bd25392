//! What a cut of several levels shows of a plane, and what one sees when levels change (guide:
//! numerics, case 31).

use crate::cameras::perspective;
use crate::gpu::{Way, with};
use crate::points::Random;
use glam::DVec3;
use pointillist::cloud::attribute::{Attribute, DisplayAttribute};
use pointillist::index::format::Index;
use pointillist::progress::Silent;
use pointillist::resident::Residency;
use pointillist::select::clip::Clips;
use pointillist::select::lod::{self, Detail};
use pointillist::study::lod::{draw, full};
use pointillist::study::popping;
use pointillist::study::scan::Scan;
use pointillist::synth::SceneKind;
use pointillist::view::View;
use rayon::prelude::*;
use std::collections::HashSet;
use std::sync::OnceLock;

const SIZE: [u32; 2] = [512, 384];

/// Returns points uniformly at random on 4 m x 4 m: a root, a few nodes below it, and many leaves.
fn plane() -> &'static Scan {
    static PLANE: OnceLock<Scan> = OnceLock::new();
    PLANE.get_or_init(|| {
        Scan::new(SceneKind::Plane, |world| world.step, 2_000_000, 31, &Silent).unwrap()
    })
}

fn open(gpu: &mut pointillist::graph::Gpu) -> Residency {
    Residency::open(
        gpu,
        plane().index.clone(),
        DisplayAttribute::indexed(Attribute::Rgb, [0.0, 1.0], [0, 255]),
        u64::MAX,
    )
    .unwrap()
}

/// Returns the mean of the longest sides of cells, of nodes between the root and the leaves.
fn middle_spacing(index: &Index) -> f64 {
    let inner = || {
        index
            .nodes()
            .iter()
            .filter(|node| !node.is_leaf() && node.level > 0)
            .map(|node| node.spacing)
    };
    inner().sum::<f64>() / inner().count() as f64
}

/// Counts of pixels and holes in a band along borders between levels, on the side of the coarser
/// node. Pixels inside of that node at the same depth are the reference.
#[derive(Default, Debug)]
struct Holes {
    pixels: f64,
    holes: f64,
    /// Holes that the band would have if it were inside.
    expected: f64,
}

impl Holes {
    /// Returns how much more often a pixel of the band is a hole.
    fn excess(&self) -> f64 {
        (self.holes - self.expected) / self.pixels
    }
}

/// Distance up to which rows of a node are compared with a row of the band [px]. A row has one
/// depth, since the camera does not roll.
const NEIGHBOURS: usize = 4;
/// Distance from a border at which a node's inside begins [px].
const INSIDE: i32 = 6;

fn count(index: &Index, drawn: &[usize], view: &View, covered: &[bool]) -> Holes {
    let [width, height] = SIZE.map(|side| side as usize);
    let boxes: Vec<_> =
        drawn.iter().map(|&node| (node, index.bounds(&index.nodes()[node]))).collect();
    // The drawn node whose box is nearest to where the pixel's ray meets the plane; `None` near the
    // plane's edge.
    let node_at = |i: usize| {
        let (eye, ray) = view.ray((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
        let centre = plane().world.offset;
        let at = eye + ray * ((centre.z - eye.z) / ray.z);
        let inside = (at - centre).truncate().abs().max_element() < 1.95;
        let away = |(_, (lo, hi)): &(usize, (DVec3, DVec3))| {
            (*lo - at).max(at - *hi).max(DVec3::ZERO).truncate().length_squared()
        };
        let nearest = boxes.iter().min_by(|a, b| away(a).total_cmp(&away(b)));
        nearest.filter(|_| inside && ray.z < 0.0).map(|(node, _)| *node)
    };
    let nodes: Vec<Option<usize>> = (0..width * height).into_par_iter().map(node_at).collect();
    let spacing = |node: usize| index.nodes()[node].spacing;
    // The node with the coarsest cells among a pixel's neighbourhood, and whether all have the
    // same; `None` where a pixel leaves the plane.
    let window = |x: usize, y: usize, radius: i32| {
        let mut coarsest = nodes[y * width + x]?;
        let mut mixed = false;
        for (dx, dy) in
            [-radius, 0, radius].into_iter().flat_map(|dy| [-radius, 0, radius].map(|dx| (dx, dy)))
        {
            let (x, y) = (x as i32 + dx, y as i32 + dy);
            let inside = (0..width as i32).contains(&x) && (0..height as i32).contains(&y);
            let node = if inside { nodes[y as usize * width + x as usize]? } else { return None };
            mixed |= spacing(node) != spacing(coarsest);
            coarsest = if spacing(node) > spacing(coarsest) { node } else { coarsest };
        }
        Some((coarsest, mixed))
    };
    // Pixels and holes by node and row.
    let mut band = vec![[0.0; 2]; index.nodes().len() * height];
    let mut inside = band.clone();
    for (x, y) in (0..height).flat_map(|y| (0..width).map(move |x| (x, y))) {
        let hole = !covered[y * width + x] as usize as f64;
        let add = |counts: &mut Vec<[f64; 2]>, node: usize| {
            counts[node * height + y][0] += 1.0;
            counts[node * height + y][1] += hole;
        };
        match window(x, y, 1) {
            Some((node, true))
                if nodes[y * width + x].is_some_and(|own| spacing(own) == spacing(node)) =>
            {
                add(&mut band, node)
            }
            Some((node, false)) if matches!(window(x, y, INSIDE), Some((_, false))) => {
                add(&mut inside, node)
            }
            _ => {}
        }
    }
    let mut found = Holes::default();
    for (i, &[pixels, holes]) in band.iter().enumerate().filter(|(_, counts)| counts[0] > 0.0) {
        let (node, y) = (i / height, i % height);
        let rows = &inside[node * height + y.saturating_sub(NEIGHBOURS)
            ..=node * height + (y + NEIGHBOURS).min(height - 1)];
        let sum = |k: usize| rows.iter().map(|counts| counts[k]).sum::<f64>();
        if sum(0) >= 64.0 {
            found.pixels += pixels;
            found.holes += holes;
            found.expected += pixels * sum(1) / sum(0);
        }
    }
    found
}

/// Checks that holes are no more frequent at borders. Holes of a band depend on each other, since
/// cells beat with pixels. Views from elsewhere do not, so their spread tells what chance does: if
/// borders had no more holes, the mean excess of V views would exceed t(V - 1) standard errors once
/// in 10,000 times.
fn no_more_at_borders(
    name: &str,
    spacing_px: f64,
    views: impl Fn(&mut Random, f64) -> (View, Detail),
) {
    const VIEWS: usize = 8;
    const T_7: f64 = 7.06;
    let index = &plane().index;
    let mut random = Random(0x3131);
    let all: Vec<Holes> = with(Way::Compute64, |gpu| {
        let mut residency = open(gpu);
        let one = |_| {
            let (view, detail) = views(&mut random, spacing_px);
            residency.wait_until_resident(gpu, &view, &detail, &Silent).unwrap();
            let covered: Vec<bool> = draw(gpu, &view, residency.resident())
                .unwrap()
                .depth
                .iter()
                .map(|z| z.is_finite())
                .collect();
            count(index, residency.drawn(), &view, &covered)
        };
        // Nearer views see fewer nodes, and not always a border.

        (0..8 * VIEWS).map(one).filter(|view| view.pixels >= 100.0).take(VIEWS).collect()
    });
    let n = VIEWS as f64;
    let mean = all.iter().map(Holes::excess).sum::<f64>() / n;
    let error =
        (all.iter().map(|view| (view.excess() - mean).powi(2)).sum::<f64>() / (n - 1.0) / n).sqrt();
    let sum = |of: fn(&Holes) -> f64| all.iter().map(of).sum::<f64>();
    let [band, inside] =
        [sum(|v| v.holes), sum(|v| v.expected)].map(|holes| holes / sum(|v| v.pixels));
    println!(
        "{name}, cells of {spacing_px} px: holes at borders {band:.5}, inside {inside:.5}; excess {mean:.5} +- {error:.5}; {} pixels",
        sum(|v| v.pixels)
    );
    assert_eq!(all.len(), VIEWS, "hardly any view has borders: {all:?}");
    assert!(mean <= T_7 * error, "{name}: more holes at borders: {all:?}");
}

#[test]
fn hard_31_borders_head_on() {
    let index = &plane().index;
    for spacing_px in [0.9, 1.8] {
        no_more_at_borders("head-on", spacing_px, |random, spacing_px| {
            let height = middle_spacing(index) * SIZE[1] as f64
                / 2.0
                / 20f64.to_radians().tan()
                / spacing_px;
            let target = plane().world.offset
                + DVec3::new(random.within(-0.8, 0.8), random.within(-0.8, 0.8), 0.0);
            let camera = perspective(target + DVec3::Z * height, target, 40.0);
            let view = View::new(camera, SIZE).unwrap();
            // Everything is equally far, so only a budget mixes levels: one point too small for all
            // leaves.
            let all =
                lod::choose(index, &[view], &Clips::default(), &full(SIZE), &HashSet::new()).points;
            (view, Detail { budget: all - 1, ..full(SIZE) })
        });
    }
}

#[test]
fn hard_31_borders_tilted() {
    let index = &plane().index;
    for spacing_px in [0.9, 1.8] {
        no_more_at_borders("tilted", spacing_px, |random, spacing_px| {
            let distance = middle_spacing(index) * SIZE[1] as f64
                / 2.0
                / 20f64.to_radians().tan()
                / spacing_px;
            let target = plane().world.offset
                + DVec3::new(random.within(-0.8, 0.8), random.within(-0.8, 0.8), 0.0);
            // Rows are oblique to the nodes' sides, and cross borders and insides.
            let turn = random.within(0.35, 1.2);
            let away = DVec3::new(turn.cos(), turn.sin(), 1.0).normalize();
            let view =
                View::new(perspective(target + away * distance, target, 40.0), SIZE).unwrap();
            // The threshold is the middle of the errors between root and leaves, so that some nodes
            // are refined.
            let mut errors: Vec<f64> = index
                .nodes()
                .iter()
                .filter(|node| !node.is_leaf() && node.level > 0)
                .filter_map(|node| {
                    Some(node.spacing * view.focal_px() / view.least_depth(index.bounds(node))?)
                })
                .collect();
            errors.sort_by(f64::total_cmp);
            (view, Detail { lod_px: errors[errors.len() / 2] * 0.999, ..full(SIZE) })
        });
    }
}

/// A sample stands for points of its cell, which is at most `lod` = 1 px wide. Where its level
/// changes, the drawing moves by at most the diagonal, sqrt 2 px on a plane, and by 0.1 px with the
/// camera. Frames ten apart have moved by 1 px at the picture's edge, and by at least half a pixel
/// in the mean. FLIP grows at most in proportion to the movement, since it saturates. A level
/// change may therefore look like (sqrt 2 + 0.1) / 0.5 = 3 times that movement.
#[test]
fn hard_31_popping() {
    const BOUND: f64 = 3.0;
    let seen = with(Way::Compute64, |gpu| {
        let mut residency = open(gpu);
        let centre = plane().world.offset;
        let camera = perspective(centre + DVec3::new(10.0, -17.0, 14.0), centre, 40.0);
        let size = [256, 192];
        let detail = Detail { budget: u64::MAX, ..Detail::of(size) };

        popping::watch(gpu, &mut residency, camera, size, &detail, 80, &Silent).unwrap()
    });
    let (max, median, moved) = (seen.max, seen.median, seen.moved);
    println!(
        "{} level changes; mean FLIP: at most {max:.4}, median {median:.4}, after one pixel {moved:.4}; bound {:.4}",
        seen.changes,
        BOUND * moved
    );
    assert!(seen.changes > 0 && median > 0.0 && moved > median);
    assert!(
        max <= BOUND * moved,
        "a level change shows: {max} against {moved} of a movement by one pixel"
    );
}
