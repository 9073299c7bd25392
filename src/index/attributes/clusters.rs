//! Clusters of similar colour (Zhan et al. 2009; dos Anjos et al. 2018, sec. 3.2.1).
//!
//! ```text
//! grow    from every unassigned point, over near neighbours whose colour is within GROW of the
//!         region's mean so far; an explicit queue, since regions are as large as clouds
//! join    touching regions whose mean colours are within JOIN
//! absorb  regions of fewer than LEAST points into the most similar region that they touch
//! ```
//!
//! Sums of colours are integers and all steps follow the order of the points, so that clusters do
//! not depend on the number of threads.

use super::kd_tree::KdTree;
use super::linear_algebra::eigen;
use glam::DVec3;
use rayon::prelude::*;

/// Colour distances, 8 bits per channel: noise within a shade, and a difference that is hardly
/// visible.
const GROW: f64 = 28.0;
const JOIN: f64 = 12.0;
/// Fewest points of a region; smaller ones are noise.
const LEAST: u64 = 12;

/// Number of near neighbours of a point, given by their places in the tree; [`NO_NEIGHBOUR`] if
/// there are fewer.
pub const NEAREST: usize = 8;
pub const NO_NEIGHBOUR: u32 = u32::MAX;

pub struct Clusters {
    /// Cluster of every point, by its place in the tree.
    pub of: Vec<u32>,
    pub clusters: Vec<Cluster>,
}

#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Cluster {
    pub points: u64,
    /// Length over width; 1 if unknown.
    pub elongation: f64,
}

/// A region while it grows and joins others.
#[derive(Clone, Copy, Debug, Default)]
struct Region {
    points: u64,
    color: [u64; 3],
    /// The region that contains it, or itself.
    part_of: u32,
}

impl Region {
    fn add(&mut self, other: &Region) {
        self.points += other.points;
        (0..3).for_each(|c| self.color[c] += other.color[c]);
    }

    fn mean(&self) -> DVec3 {
        let [r, g, b] = self.color.map(|sum| sum as f64 / self.points.max(1) as f64);
        DVec3::new(r, g, b)
    }
}

pub fn clusters(tree: &KdTree, near: &[[u32; NEAREST]], colors: &[[u8; 3]]) -> Clusters {
    let (mut of, mut regions) = grow(near, colors);
    let touching = touching(near, &of);
    join(&mut regions, &touching);
    absorb(&mut regions, &touching);
    // Remaining regions, numbered in order.
    let mut numbers = vec![0; regions.len()];
    let mut clusters = Vec::new();
    for (k, region) in regions.iter().enumerate() {
        if region.part_of as usize == k {
            numbers[k] = clusters.len() as u32;
            clusters.push(Cluster { points: region.points, elongation: 1.0 });
        }
    }
    let last: Vec<u32> = (0..regions.len()).map(|k| numbers[root(&regions, k)]).collect();
    of.par_iter_mut().for_each(|region| *region = last[*region as usize]);
    elongate(tree, &of, &mut clusters);
    Clusters { of, clusters }
}

fn grow(near: &[[u32; NEAREST]], colors: &[[u8; 3]]) -> (Vec<u32>, Vec<Region>) {
    let mut of = vec![NO_NEIGHBOUR; near.len()];
    let mut regions: Vec<Region> = Vec::new();
    let mut queue = std::collections::VecDeque::new();
    for seed in 0..near.len() {
        if of[seed] != NO_NEIGHBOUR {
            continue;
        }
        let number = regions.len() as u32;
        let mut region = Region { part_of: number, ..Region::default() };
        queue.push_back(seed as u32);
        of[seed] = number;
        while let Some(place) = queue.pop_front() {
            region.add(&Region {
                points: 1,
                color: colors[place as usize].map(u64::from),
                part_of: number,
            });
            for &next in near[place as usize].iter().filter(|next| **next != NO_NEIGHBOUR) {
                let [r, g, b] = colors[next as usize].map(f64::from);
                if of[next as usize] == NO_NEIGHBOUR
                    && region.mean().distance_squared(DVec3::new(r, g, b)) <= GROW * GROW
                {
                    of[next as usize] = number;
                    queue.push_back(next);
                }
            }
        }
        regions.push(region);
    }
    (of, regions)
}

/// Returns pairs of touching regions, each once, sorted, the lower number first.
fn touching(near: &[[u32; NEAREST]], of: &[u32]) -> Vec<[u32; 2]> {
    const CHUNK: usize = 1 << 16;
    let of_chunk = |(chunk, near): (usize, &[[u32; NEAREST]])| {
        let pair = |(i, near): (usize, &[u32; NEAREST])| {
            let own = of[chunk * CHUNK + i];
            let others = near
                .iter()
                .filter(|next| **next != NO_NEIGHBOUR)
                .map(|&next| of[next as usize])
                .filter(|&other| other != own);
            others.map(|other| [own.min(other), own.max(other)]).collect::<Vec<_>>()
        };
        let mut pairs: Vec<[u32; 2]> = near.iter().enumerate().flat_map(pair).collect();
        pairs.sort_unstable();
        pairs.dedup();
        pairs
    };
    let mut pairs: Vec<[u32; 2]> =
        near.par_chunks(CHUNK).enumerate().map(of_chunk).flatten_iter().collect();
    pairs.par_sort_unstable();
    pairs.dedup();
    pairs
}

fn root(regions: &[Region], mut region: usize) -> usize {
    while regions[region].part_of as usize != region {
        region = regions[region].part_of as usize;
    }
    region
}

/// Merges the smaller into the larger, so that paths to the root stay short.
fn unite(regions: &mut [Region], a: usize, b: usize) {
    let (small, large) = if regions[a].points < regions[b].points { (a, b) } else { (b, a) };
    let part = regions[small];
    regions[large].add(&part);
    regions[small].part_of = large as u32;
}

fn join(regions: &mut [Region], touching: &[[u32; 2]]) {
    for pair in touching {
        let [a, b] = pair.map(|region| root(regions, region as usize));
        if a != b && regions[a].mean().distance_squared(regions[b].mean()) <= JOIN * JOIN {
            unite(regions, a, b);
        }
    }
}

fn absorb(regions: &mut [Region], touching: &[[u32; 2]]) {
    let mut both: Vec<[u32; 2]> = touching.iter().flat_map(|&[a, b]| [[a, b], [b, a]]).collect();
    both.par_sort_unstable();
    for pairs in both.chunk_by(|a, b| a[0] == b[0]) {
        let own = root(regions, pairs[0][0] as usize);
        if regions[own].points >= LEAST {
            continue;
        }
        let mean = regions[own].mean();
        let others =
            pairs.iter().map(|pair| root(regions, pair[1] as usize)).filter(|&other| other != own);
        let like = others.min_by(|&a, &b| {
            regions[a]
                .mean()
                .distance_squared(mean)
                .total_cmp(&regions[b].mean().distance_squared(mean))
                .then(a.cmp(&b))
        });
        if let Some(like) = like {
            unite(regions, own, like);
        }
    }
}

/// Computes elongations from the covariance of each cluster's points about its first.
fn elongate(tree: &KdTree, of: &[u32], clusters: &mut [Cluster]) {
    #[derive(Clone, Copy, Default)]
    struct Moments {
        first: Option<u32>,
        sum: DVec3,
        squares: [f64; 6],
    }
    let mut moments = vec![Moments::default(); clusters.len()];
    for (place, &cluster) in of.iter().enumerate() {
        let own = &mut moments[cluster as usize];
        let d = tree.between(*own.first.get_or_insert(place as u32) as usize, place);
        own.sum += d;
        let products = [d.x * d.x, d.x * d.y, d.x * d.z, d.y * d.y, d.y * d.z, d.z * d.z];
        (0..6).for_each(|k| own.squares[k] += products[k]);
    }
    for (cluster, Moments { sum, squares, .. }) in clusters.iter_mut().zip(moments) {
        let count = cluster.points.max(1) as f64;
        let m = sum / count;
        let means = [m.x * m.x, m.x * m.y, m.x * m.z, m.y * m.y, m.y * m.z, m.z * m.z];
        let [_, (width, _), (length, _)] =
            eigen(std::array::from_fn(|k| squares[k] / count - means[k]));
        if width > 1e-9 * length {
            cluster.elongation = (length / width).sqrt();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cloud::{Columns, Lattice};

    /// Builds a flat grid of points, one step apart, coloured by position.
    fn painted(width: i32, height: i32, color: impl Fn(i32, i32) -> [u8; 3]) -> (KdTree, Clusters) {
        let at = |k: i32| (k % width, k / width);
        let columns = Columns {
            x: (0..width * height).map(|k| at(k).0).collect(),
            y: (0..width * height).map(|k| at(k).1).collect(),
            z: vec![0; (width * height) as usize],
            ..Columns::default()
        };
        let tree = KdTree::new(&columns, &Lattice { step: DVec3::ONE, offset: DVec3::ZERO });
        let mut found = Vec::new();
        let near: Vec<[u32; NEAREST]> = (0..tree.len())
            .map(|place| {
                tree.nearest(place, NEAREST, &mut found);
                std::array::from_fn(|k| {
                    found.get(k).map_or(NO_NEIGHBOUR, |neighbour| neighbour.place)
                })
            })
            .collect();
        let colors: Vec<[u8; 3]> = (0..tree.len())
            .map(|place| color(tree.steps(place)[0], tree.steps(place)[1]))
            .collect();
        let clusters = clusters(&tree, &near, &colors);
        (tree, clusters)
    }

    #[test]
    fn patches_of_colour_are_clusters_with_their_sizes_and_shapes() {
        let (tree, found) =
            painted(40, 20, |x, _| if x < 10 { [200, 40, 40] } else { [40, 60, 200] });
        assert_eq!(found.clusters.iter().map(|cluster| cluster.points).sum::<u64>(), 800);
        let mut sizes: Vec<u64> = found.clusters.iter().map(|cluster| cluster.points).collect();
        sizes.sort_unstable();
        assert_eq!(sizes, [200, 600]);
        for place in 0..tree.len() {
            let cluster = found.clusters[found.of[place] as usize];
            let red = tree.steps(place)[0] < 10;
            assert_eq!(cluster.points, if red { 200 } else { 600 });
            assert!(
                (cluster.elongation - if red { 2.0 } else { 1.5 }).abs() < 0.02,
                "{}",
                cluster.elongation
            );
        }
    }

    #[test]
    fn specks_are_absorbed_and_like_regions_joined() {
        let (_, found) =
            painted(30, 30, |x, y| if (x, y) == (7, 7) { [255, 255, 255] } else { [60, 120, 60] });
        assert_eq!(found.clusters.len(), 1, "one white point is a speck");
        let (_, found) =
            painted(30, 30, |x, _| if x < 15 { [100, 100, 100] } else { [104, 104, 104] });
        assert_eq!(found.clusters.len(), 1, "four codes are one colour");
        let (_, found) =
            painted(30, 30, |x, _| if x < 15 { [100, 100, 100] } else { [140, 140, 140] });
        assert_eq!(found.clusters.len(), 2);
    }

    #[test]
    fn hard_21_a_region_of_all_points_does_not_overflow_a_stack() {
        let (_, found) = painted(1000, 300, |_, _| [9, 9, 9]);
        assert_eq!(found.clusters.len(), 1);
    }
}
