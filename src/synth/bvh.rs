//! A bounding volume hierarchy over the primitives of a scene, walked in the order in which a ray
//! meets the boxes.
//!
//! Built top down by the surface area heuristic with 16 bins (Wald 2007); walked front to back with
//! a small stack. The walk hands out primitive numbers and takes back hit distances.

use glam::DVec3;

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Aabb {
    pub min: DVec3,
    pub max: DVec3,
}

impl Aabb {
    pub const EMPTY: Aabb = Aabb { min: DVec3::INFINITY, max: DVec3::NEG_INFINITY };

    pub fn union(self, other: Aabb) -> Aabb {
        Aabb { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    pub fn including(self, p: DVec3) -> Aabb {
        Aabb { min: self.min.min(p), max: self.max.max(p) }
    }

    pub fn grown(self, by: f64) -> Aabb {
        Aabb { min: self.min - by, max: self.max + by }
    }

    pub fn centre(self) -> DVec3 {
        (self.min + self.max) * 0.5
    }

    /// Returns half the surface, which suffices for the heuristic.
    fn area(self) -> f64 {
        let d = (self.max - self.min).max(DVec3::ZERO);
        d.x * d.y + d.y * d.z + d.z * d.x
    }

    /// Returns the part of a ray inside the box within [t_min, t_max]. `inverse` is 1/direction; a
    /// NaN (0 x infinity, the origin in the plane of a face along the ray) drops out of min and
    /// max, which keeps the box.
    pub fn clip(
        &self,
        origin: DVec3,
        inverse: DVec3,
        t_min: f64,
        t_max: f64,
    ) -> Option<(f64, f64)> {
        let (a, b) = ((self.min - origin) * inverse, (self.max - origin) * inverse);
        let enter = t_min.max(a.x.min(b.x)).max(a.y.min(b.y)).max(a.z.min(b.z));
        let leave = t_max.min(a.x.max(b.x)).min(a.y.max(b.y)).min(a.z.max(b.z));
        (enter <= leave).then_some((enter, leave))
    }
}

/// A node: if `count` is 0 an inner one with children `first` and `first + 1`, else a leaf over
/// `order[first .. first + count]`.
struct Node {
    bounds: Aabb,
    first: u32,
    count: u32,
}

pub struct Bvh {
    nodes: Vec<Node>,
    order: Vec<u32>,
}

const BINS: usize = 16;
const LEAF: usize = 3;
const STACK: usize = 64;

impl Bvh {
    pub fn build(boxes: &[Aabb]) -> Bvh {
        let mut bvh = Bvh {
            nodes: vec![Node { bounds: Aabb::EMPTY, first: 0, count: 0 }],
            order: (0..boxes.len() as u32).collect(),
        };
        let mut todo = vec![(0usize, 0usize, boxes.len(), 0usize)];
        while let Some((node, first, end, depth)) = todo.pop() {
            let order = &mut bvh.order[first..end];
            let bounds = order.iter().fold(Aabb::EMPTY, |b, &i| b.union(boxes[i as usize]));
            // Slightly larger: the clip's division errs by an ulp, and a flat box must not lose its
            // surface.
            bvh.nodes[node].bounds = bounds.grown(1e-9);
            let middle =
                if end - first <= LEAF || depth + 8 > STACK { None } else { split(order, boxes) };
            match middle {
                None => {
                    (bvh.nodes[node].first, bvh.nodes[node].count) =
                        (first as u32, (end - first) as u32)
                }
                Some(middle) => {
                    let child = bvh.nodes.len();
                    bvh.nodes[node].first = child as u32;
                    bvh.nodes.extend([0, 1].map(|_| Node {
                        bounds: Aabb::EMPTY,
                        first: 0,
                        count: 0,
                    }));
                    todo.push((child, first, first + middle, depth + 1));
                    todo.push((child + 1, first + middle, end, depth + 1));
                }
            }
        }
        bvh
    }

    /// Renumbers the primitives from `first` in tree order, so that those tested together are
    /// adjacent in memory. Returns their old numbers in that order.
    pub fn renumber(&mut self, first: u32) -> Vec<u32> {
        let mut old = Vec::new();
        for primitive in self.order.iter_mut().filter(|p| **p >= first) {
            old.push(*primitive);
            *primitive = first + old.len() as u32 - 1;
        }
        old
    }

    pub fn bounds(&self) -> Aabb {
        self.nodes[0].bounds
    }

    /// Calls `test(primitive, t_max)` front to back; it returns the distance of a hit nearer than
    /// `t_max`, which becomes the new `t_max`. Returns whether there was a hit; `any` stops at the
    /// first one.
    pub fn walk(
        &self,
        origin: DVec3,
        direction: DVec3,
        t_min: f64,
        mut t_max: f64,
        any: bool,
        mut test: impl FnMut(u32, f64) -> Option<f64>,
    ) -> bool {
        let inverse = direction.recip();
        let mut stack = [(0u32, 0.0f64); STACK];
        let mut height = 0;
        let mut found = false;
        if self.order.is_empty() {
            return false;
        }
        if let Some((t, _)) = self.nodes[0].bounds.clip(origin, inverse, t_min, t_max) {
            stack[0] = (0, t);
            height = 1;
        }
        while height > 0 {
            height -= 1;
            let (index, enter) = stack[height];
            if enter > t_max {
                continue;
            }
            let node = &self.nodes[index as usize];
            if node.count > 0 {
                for &primitive in
                    &self.order[node.first as usize..(node.first + node.count) as usize]
                {
                    if let Some(t) = test(primitive, t_max) {
                        t_max = t;
                        found = true;
                        if any {
                            return true;
                        }
                    }
                }
                continue;
            }
            let child = |i: u32| {
                self.nodes[i as usize]
                    .bounds
                    .clip(origin, inverse, t_min, t_max)
                    .map(|(t, _)| (i, t))
            };
            match (child(node.first), child(node.first + 1)) {
                (Some(a), Some(b)) => {
                    let (near, far) = if a.1 <= b.1 { (a, b) } else { (b, a) };
                    stack[height] = far;
                    stack[height + 1] = near;
                    height += 2;
                }
                (Some(only), None) | (None, Some(only)) => {
                    stack[height] = only;
                    height += 1;
                }
                (None, None) => {}
            }
        }
        found
    }
}

/// Reorders `order` into two halves. Returns the length of the first; `None` if one leaf is cheaper
/// (all centres coincide).
fn split(order: &mut [u32], boxes: &[Aabb]) -> Option<usize> {
    let centres = order.iter().fold(Aabb::EMPTY, |b, &i| b.including(boxes[i as usize].centre()));
    let extent = centres.max - centres.min;
    let mut best = (f64::INFINITY, 0, 0);
    let bin = |i: u32, axis: usize| {
        let at = (boxes[i as usize].centre()[axis] - centres.min[axis]) / extent[axis];
        ((at * BINS as f64) as usize).min(BINS - 1)
    };
    for axis in 0..3 {
        if extent[axis] <= 0.0 {
            continue;
        }
        let mut bins = [(Aabb::EMPTY, 0usize); BINS];
        for &i in order.iter() {
            let b = &mut bins[bin(i, axis)];
            *b = (b.0.union(boxes[i as usize]), b.1 + 1);
        }
        let mut above = [0.0; BINS];
        let mut sum = (Aabb::EMPTY, 0usize);
        for k in (1..BINS).rev() {
            sum = (sum.0.union(bins[k].0), sum.1 + bins[k].1);
            above[k] = if sum.1 == 0 { 0.0 } else { sum.0.area() * sum.1 as f64 };
        }
        let mut sum = (Aabb::EMPTY, 0usize);
        for k in 1..BINS {
            sum = (sum.0.union(bins[k - 1].0), sum.1 + bins[k - 1].1);
            if sum.1 > 0 && sum.1 < order.len() {
                let cost = sum.0.area() * sum.1 as f64 + above[k];
                if cost < best.0 {
                    best = (cost, axis, k);
                }
            }
        }
    }
    if !best.0.is_finite() {
        return None;
    }
    let mut low: Vec<u32> = order.iter().copied().filter(|&i| bin(i, best.1) < best.2).collect();
    let middle = low.len();
    low.extend(order.iter().copied().filter(|&i| bin(i, best.1) >= best.2));
    order.copy_from_slice(&low);
    Some(middle)
}
