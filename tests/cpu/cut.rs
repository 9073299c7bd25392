//! The LOD cut: every visible leaf is shown exactly once, within the budget, and never coarser for
//! a smaller threshold.

use crate::ancestors::ancestors;
use crate::cameras::{orthographic, perspective};
use crate::points::{Random, bumpy};
use crate::tree::{Shape, plant};
use glam::DVec3;
use pointillist::index::format::Index;
use pointillist::select::clip::Clips;
use pointillist::select::lod::{Cut, Detail, choose};
use pointillist::view::View;
use proptest::prelude::*;
use std::collections::HashSet;
use std::sync::Arc;

fn forest(seed: u64, shape: &Shape) -> (tempfile::TempDir, Arc<Index>) {
    let folder = tempfile::tempdir().unwrap();
    let (points, colors) = bumpy(6000, 20_000, &mut Random(seed));
    let index = plant(&folder.path().join("forest.pnti"), &points, &colors, shape);
    (folder, index)
}

fn view(seed: u64) -> View {
    let mut random = Random(seed);
    let mut point = |reach: f64| DVec3::from_array([(); 3].map(|()| random.within(-reach, reach)));
    let (eye, target) = (point(25.0), point(8.0));
    let camera = if seed.is_multiple_of(3) {
        orthographic(eye, target, 12.0)
    } else {
        perspective(eye, target, 50.0)
    };
    View::new(camera, [320, 200]).unwrap()
}

fn visible(index: &Index, view: &View, node: usize) -> bool {
    view.least_depth(index.bounds(&index.nodes()[node])).is_some()
}

/// Checks the invariants of a cut. Leaves in `lost` are in none.
fn check(index: &Index, view: &View, budget: u64, cut: &Cut, lost: impl Fn(usize) -> bool) {
    let chosen: HashSet<usize> = cut.nodes.iter().map(|wanted| wanted.node).collect();
    assert_eq!(chosen.len(), cut.nodes.len(), "a node twice");
    assert_eq!(
        cut.points,
        cut.nodes.iter().map(|wanted| index.nodes()[wanted.node].count as u64).sum::<u64>()
    );
    assert!(chosen.iter().all(|&node| visible(index, view, node)));
    for (leaf, _) in index
        .nodes()
        .iter()
        .enumerate()
        .filter(|(leaf, record)| record.is_leaf() && visible(index, view, *leaf))
    {
        let showing = chosen.contains(&leaf) as usize
            + ancestors(index, leaf).filter(|node| chosen.contains(node)).count();
        assert_eq!(showing, 1 - lost(leaf) as usize, "leaf {leaf}");
    }
    let roots = (0..index.directory.roots as usize).filter(|&root| visible(index, view, root));
    let roots: u64 = roots.map(|root| index.nodes()[root].count as u64).sum();
    assert!(cut.points <= budget.max(roots), "{} points, budget {budget}", cut.points);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn a_cut_covers_every_visible_leaf_once_within_its_budget(
        seed in 1u64..1000, budget in 0u64..8000, lod_px in 0.0..40.0f64, leaf_points in 40usize..700, halvings in 1u32..4, roots in 1usize..4,
    ) {
        let (_folder, index) = forest(seed, &Shape { leaf_points, halvings, roots, colored: false });
        let view = view(seed);
        let detail = Detail { budget, lod_px, ..Detail::of(view.size) };
        let cut = choose(&index, &[view], &Clips::default(), &detail, &HashSet::new());
        check(&index, &view, budget, &cut, |_| false);
        prop_assert_eq!(&cut, &choose(&index, &[view], &Clips::default(), &detail, &HashSet::new()));

        // A smaller threshold refines: every node is one of the coarser cut, or below one.
        let finer = choose(&index, &[view], &Clips::default(), &Detail { lod_px: lod_px / 2.0, ..detail }, &HashSet::new());
        let coarse: HashSet<usize> = cut.nodes.iter().map(|wanted| wanted.node).collect();
        for wanted in &finer.nodes {
            prop_assert!(coarse.contains(&wanted.node) || ancestors(&index, wanted.node).any(|node| coarse.contains(&node)));
        }
        prop_assert!(finer.points >= cut.points || finer.nodes_outside > cut.nodes_outside);
    }

    #[test]
    fn what_cannot_be_read_is_in_no_cut_and_only_a_lost_root_leaves_a_hole(seed in 1u64..1000, lost in prop::collection::hash_set(0usize..40, 0..8)) {
        let (_folder, index) = forest(seed, &Shape { leaf_points: 300, ..Shape::default() });
        let view = view(seed);
        let cut = choose(&index, &[view], &Clips::default(), &Detail { budget: u64::MAX, lod_px: 0.0, ..Detail::of(view.size) }, &lost);
        prop_assert!(cut.nodes.iter().all(|wanted| !lost.contains(&wanted.node)));
        // Only a leaf without a readable ancestor may be missing.
        let gone = |leaf: usize| lost.contains(&leaf) && ancestors(&index, leaf).all(|node| lost.contains(&node));
        check(&index, &view, u64::MAX, &cut, gone);
    }
}

#[test]
fn without_a_budget_all_leaves_are_drawn_and_nothing_is_wrong() {
    let (_folder, index) = forest(5, &Shape::default());
    let view =
        View::new(orthographic(DVec3::new(0.0, 0.0, 50.0), DVec3::ZERO, 40.0), [400, 400]).unwrap();
    let cut = choose(
        &index,
        &[view],
        &Clips::default(),
        &Detail { budget: u64::MAX, lod_px: 0.0, ..Detail::of(view.size) },
        &HashSet::new(),
    );
    assert_eq!((cut.points, cut.largest_error_px, cut.nodes_outside), (6000, 0.0, 0));
    let coarse = choose(
        &index,
        &[view],
        &Clips::default(),
        &Detail { budget: u64::MAX, lod_px: 1e9, ..Detail::of(view.size) },
        &HashSet::new(),
    );
    assert_eq!(coarse.nodes.len(), 1);
}
