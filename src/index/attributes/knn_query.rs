//! Neighbour queries across the leaves of an index.
//!
//! ```text
//! search the own tree; its results bound the distance of others
//! search the leaves beside it, nearest first, until their boxes are farther than the results
//! ```
//!
//! Nothing is missed where a leaf ends, however far a point's neighbours are. Results are the same
//! for one tree of all points as for many (points at equal distance are ordered by position and
//! colour), so that derived attributes do not depend on how a cloud is cut.

use super::kd_tree::{Neighbour, Query, keep_nearest};
use super::leaf_cache::{Leaf, LeafCache, Near};
use crate::error::Result;
use glam::DVec3;

/// Most points within a radius; the radius is halved until there are no more: a million points in
/// one place tell no more of a surface than some.
const MAX_WITHIN: usize = 4096;

/// Range of bytes of neighbouring leaves that are held.
const HELD_BYTES: std::ops::RangeInclusive<u64> = (12 << 20)..=(48 << 20);

/// First search distance as a part of the leaf's width, and growth of later ones.
const FIRST_REACH: f64 = 1.0 / 16.0;
const GROWTH: f64 = 3.0;
/// Growth if the distance is known: slightly more, so that the next point finds its neighbours
/// there too.
const KNOWN_GROWTH: f64 = 1.25;

pub struct KnnQuery<'s> {
    own: &'s Leaf,
    leaf_cache: Option<(&'s LeafCache<'s>, usize)>,
    of_any_lattice: bool,
    /// Leaves within `covered` `[m]` of the own leaf's box.
    near: Vec<Near>,
    covered: f64,
    /// Bytes of leaves held.
    held: u64,
}

impl<'s> KnnQuery<'s> {
    /// Creates queries of a single tree.
    pub fn alone(own: &'s Leaf) -> KnnQuery<'s> {
        KnnQuery {
            own,
            leaf_cache: None,
            of_any_lattice: false,
            near: Vec::new(),
            covered: f64::INFINITY,
            held: 0,
        }
    }

    /// Creates queries of a leaf, among leaves on its own lattice or on any.
    pub fn of(
        leaf_cache: &'s LeafCache<'s>,
        node: usize,
        own: &'s Leaf,
        of_any_lattice: bool,
    ) -> KnnQuery<'s> {
        KnnQuery {
            own,
            leaf_cache: Some((leaf_cache, node)),
            of_any_lattice,
            near: Vec::new(),
            covered: -1.0,
            held: 0,
        }
    }

    pub fn own(&self) -> &'s Leaf {
        self.own
    }

    /// Returns the vector from a point to a neighbour on the same lattice `[steps]`.
    pub fn steps_to(&self, place: usize, neighbour: &Neighbour) -> DVec3 {
        let at = self.own.tree.query(place).at;
        match neighbour.tree {
            0 => self.own.tree.steps_between(at, neighbour.place as usize),
            tree => {
                let near = &self.near[tree as usize - 1];
                leaf_of(near).tree.steps_between(near.seen_from(at), neighbour.place as usize)
            }
        }
    }

    pub fn color(&self, neighbour: &Neighbour) -> [u8; 3] {
        self.leaf(neighbour).colors[neighbour.place as usize]
    }

    fn leaf(&self, neighbour: &Neighbour) -> &Leaf {
        if neighbour.tree == 0 {
            self.own
        } else {
            leaf_of(&self.near[neighbour.tree as usize - 1])
        }
    }

    /// Returns the order of points at equal distance: position, then colour.
    fn rank(&self, neighbour: &Neighbour) -> ([i64; 3], [u8; 3]) {
        let leaf = self.leaf(neighbour);
        let at = leaf.tree.steps(neighbour.place as usize);
        (
            [0, 1, 2].map(|axis| leaf.origin[axis] + at[axis] as i64),
            leaf.colors.get(neighbour.place as usize).copied().unwrap_or_default(),
        )
    }

    /// Finds at most `most` points nearest to a point, without coincident ones, nearest first. Ties
    /// are broken arbitrarily.
    pub fn nearest(&mut self, place: usize, most: usize, found: &mut Vec<Neighbour>) -> Result<()> {
        found.clear();
        let search = |own: &Self, query: Query, found: &mut Vec<Neighbour>| {
            own.leaf_at(query).tree.add_nearest(query, most, found)
        };
        let reach = |found: &[Neighbour]| {
            if found.len() < most { f64::INFINITY } else { found[most - 1].squared }
        };
        self.search(place, found, &search, &reach)
    }

    /// Finds the same points in no order, twice as fast if they are many. `known` is a squared
    /// distance that they do not exceed, or infinite. Returns the squared distance of the farthest
    /// `[m2]`.
    pub fn nearest_in_any_order(
        &mut self,
        place: usize,
        most: usize,
        known: f64,
        found: &mut Vec<Neighbour>,
    ) -> Result<f64> {
        found.clear();
        let beyond = std::cell::Cell::new(known);
        let search = |own: &Self, query: Query, found: &mut Vec<Neighbour>| {
            let mut least = beyond.get();
            own.leaf_at(query).tree.sift(
                query,
                most,
                &mut least,
                &|neighbour| own.rank(neighbour),
                found,
            );
            keep_nearest(found, most, &|neighbour| own.rank(neighbour));
            if found.len() == most {
                least =
                    least.min(found.iter().map(|neighbour| neighbour.squared).fold(0.0, f64::max));
            }
            beyond.set(least);
        };
        self.search(place, found, &search, &|_| beyond.get())?;
        Ok(found.iter().map(|neighbour| neighbour.squared).fold(0.0, f64::max))
    }

    /// Finds every point within a radius of a point, without coincident ones, in no order. The
    /// radius is halved while there are too many; returns the radius used.
    pub fn within(
        &mut self,
        place: usize,
        mut radius: f64,
        found: &mut Vec<Neighbour>,
    ) -> Result<f64> {
        loop {
            found.clear();
            let (squared, fits) = (radius * radius, std::cell::Cell::new(true));
            let search = |own: &Self, query: Query, found: &mut Vec<Neighbour>| {
                let tree = &own.leaf_at(query).tree;
                fits.set(fits.get() && tree.add_within(query, squared, MAX_WITHIN, found));
            };
            let reach = |_: &[Neighbour]| if fits.get() { squared } else { -1.0 };
            self.search(place, found, &search, &reach)?;
            if fits.get() {
                return Ok(radius);
            }
            radius /= 2.0;
        }
    }

    fn leaf_at(&self, query: Query) -> &Leaf {
        if query.tree == 0 { self.own } else { leaf_of(&self.near[query.tree as usize - 1]) }
    }

    fn search(
        &mut self,
        place: usize,
        found: &mut Vec<Neighbour>,
        search: &dyn Fn(&Self, Query, &mut Vec<Neighbour>),
        reach: &dyn Fn(&[Neighbour]) -> f64,
    ) -> Result<()> {
        let query = self.own.tree.query(place);
        search(self, query, found);
        let Some((leaf_cache, _)) = self.leaf_cache else { return Ok(()) };
        if self.held > leaf_cache.hold.clamp(*HELD_BYTES.start(), *HELD_BYTES.end()) {
            self.near.iter_mut().for_each(|near| near.leaf = None);
            self.held = 0;
        }
        let step = self.own.tree.step();
        let mut next = 0;
        loop {
            while let Some(near) = self.near.get_mut(next).filter(|near| near.away <= reach(found))
            {
                if near.away_from(query.at, step) <= reach(found) {
                    if near.leaf.is_none() {
                        let leaf = leaf_cache.leaf(near.node)?;
                        self.held += leaf.bytes();
                        near.leaf = Some(leaf);
                    }
                    let query = Query { at: near.seen_from(query.at), tree: next as u32 + 1 };
                    search(self, query, found);
                }
                next += 1;
            }
            if !self.widen(reach(found)) {
                return Ok(());
            }
        }
    }

    /// Widens the list of near leaves unless all within `squared` are known. Known leaves keep
    /// their place in the list.
    fn widen(&mut self, squared: f64) -> bool {
        let Some((leaf_cache, node)) = self.leaf_cache else { return false };
        if self.covered * self.covered >= squared && self.covered >= 0.0
            || self.covered > leaf_cache.diagonal
        {
            return false;
        }
        let own = &leaf_cache.directory.nodes[node];
        let step = self.own.tree.step();
        let width = (DVec3::from_array(own.extent.map(f64::from)) * step)
            .max_element()
            .max(step.max_element());
        let farther = (GROWTH * self.covered).max(FIRST_REACH * width);
        self.covered = farther.min(KNOWN_GROWTH * squared.sqrt());
        let mut near = leaf_cache.beside(node, self.covered, self.of_any_lattice);
        near.iter_mut()
            .zip(&mut self.near)
            .for_each(|(near, before)| near.leaf = before.leaf.take());
        self.near = near;
        true
    }
}

fn leaf_of(near: &Near) -> &Leaf {
    near.leaf.as_deref().expect("what was searched is at hand")
}
