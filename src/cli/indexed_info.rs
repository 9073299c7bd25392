//! `pointillist info cloud.pnti`: what an index was built from, and its tree. The same of an octree
//! on a server.
//!
//! The JSON object has `points`, `bounds`, `unit`, `unit_is_stated`, `spacing`, `strays`, `parts`,
//! `stations`, `notes` as `info` gives them of files (but no ranges of attributes: those would need
//! every point), of `exposures` the `balance` where it was found, where they were counted `classes`
//! [{`class`, `points`}] and `returns` [{`return`, `points`}], and `index` {`bytes`,
//! `bytes_per_point`, `nodes`, `leaves`, `inner`, `roots`, `levels` [{`level`, `nodes`, `samples`,
//! `spacing`}], `planes` {name: bytes}, `leaf_points` {`least`, `median`, `most`}}.

use super::info::{
    Bounds, Class, LISTED, Spacing, gain, listed, system_words, uneven, unit_words, write_bounds,
};
use crate::cloud::Station;
use crate::cloud::attribute::Attribute;
use crate::cloud::crs::Unit;
use crate::cloud::histograms::Histograms;
use crate::cloud::scalar::{self, Scalar};
use crate::cloud::spacing::{self, Around};
use crate::cloud::strays::Strays;
use crate::error::{Error, Result};
use crate::index::format::Balance;
use crate::index::format::{Index, IndexedPart, PLANES, Plane, Refinement};
use crate::render::index_samples;
use glam::DVec3;
use rayon::prelude::*;
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt::Write;

const HOW_SPACING: &str = "the root of the area that each of the eight nearest places has, the upper quartile of about 2000 places of 64 leaves";

#[derive(Serialize)]
struct Report<'a> {
    points: u64,
    bounds: Option<Bounds>,
    unit: Unit,
    unit_is_stated: bool,
    spacing: Spacing,
    /// Strays among the samples of the roots.
    strays: Strays,
    index: Tree,
    /// What `--color` can show.
    colors: Vec<String>,
    parts: &'a [IndexedPart],
    stations: &'a [Station],
    #[serde(skip_serializing_if = "Option::is_none")]
    classes: Option<Vec<Class>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    returns: Option<Vec<Returned>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    exposures: Option<Exposures<'a>>,
    notes: &'a [String],
}

/// Points with one return number.
#[derive(Serialize)]
pub struct Returned {
    #[serde(rename = "return")]
    number: u8,
    points: u64,
}

impl Returned {
    pub fn list(counts: &Histograms) -> Vec<Returned> {
        counts.returns.iter().map(|&(number, points)| Returned { number, points }).collect()
    }
}

#[derive(Serialize)]
struct Exposures<'a> {
    balance: &'a Balance,
}

#[derive(Serialize)]
struct Tree {
    bytes: u64,
    bytes_per_point: f64,
    nodes: usize,
    leaves: usize,
    inner: usize,
    roots: u32,
    levels: Vec<Level>,
    /// Bytes of each plane over all nodes.
    planes: BTreeMap<String, u64>,
    leaf_points: LeafPoints,
}

#[derive(Serialize)]
struct Level {
    level: u8,
    nodes: usize,
    samples: u64,
    /// Widest cell of the inner nodes [m]; None if there are none.
    spacing: Option<f64>,
}

#[derive(Serialize)]
struct LeafPoints {
    least: u32,
    median: u32,
    most: u32,
}

/// Returns the report, as text or JSON.
pub fn report(index: &Index, json: bool) -> Result<String> {
    let (contents, reference) = (&index.directory.contents, index.reference());
    let report = Report {
        points: contents.points,
        bounds: contents
            .bounds
            .map(|ends| ends.map(|end| reference.digits.round(end)))
            .map(|[min, max]| Bounds { min, max }),
        unit: reference.unit(),
        unit_is_stated: reference.says_unit(),
        spacing: Spacing { value: spacing(index)?, how: HOW_SPACING },
        strays: index_samples::strays(index),
        index: Tree::new(index),
        colors: colors(index),
        parts: &contents.parts,
        stations: &contents.stations,
        classes: contents.counts.as_ref().map(Class::list),
        returns: contents.counts.as_ref().map(Returned::list),
        exposures: contents.balance.as_ref().map(|balance| Exposures { balance }),
        notes: &contents.notes,
    };
    if json {
        return serde_json::to_string_pretty(&report).map_err(|error| {
            Error::Request(format!("the report cannot be written as JSON: {error}"))
        });
    }
    Ok(report.text(index))
}

/// Tests whether an index is a file NAME.pnti.
fn is_own(index: &Index) -> bool {
    index.refinement == Refinement::Replaces
}

/// Returns the names of all that points can show.
fn colors(index: &Index) -> Vec<String> {
    let named = Attribute::NAMED.into_iter().filter(|&attribute| index.shows(attribute));
    let names: Vec<String> = named.map(Attribute::name).collect();
    let kept = index.directory.contents.scalar.clone().filter(|kept| !names.contains(kept));
    // Found when it is asked for.
    let height = Scalar::HeightAboveGround.to_string();
    names.into_iter().chain(kept).chain([height]).collect()
}

impl Tree {
    fn new(index: &Index) -> Tree {
        let nodes = index.nodes();
        let mut leaves: Vec<u32> =
            nodes.iter().filter(|node| node.is_leaf()).map(|node| node.count).collect();
        leaves.sort_unstable();
        let mut levels = Vec::new();
        for level in 0..=nodes.iter().map(|node| node.level).max().unwrap_or(0) {
            let on_level = || nodes.iter().filter(|node| node.level == level);
            levels.push(Level {
                level,
                nodes: on_level().count(),
                samples: on_level().map(|node| node.count as u64).sum(),
                spacing: on_level()
                    .map(|node| node.spacing)
                    .filter(|&spacing| spacing > 0.0)
                    .reduce(f64::max),
            });
        }
        let contents = &index.directory.contents;
        let bytes_of = |plane| {
            nodes.iter().filter(|node| node.has(plane)).map(|node| node.range(plane).1).sum::<u64>()
        };
        let planes = PLANES
            .iter()
            .map(|&(plane, _)| {
                let scalar = contents.scalar.clone().filter(|_| plane == Plane::GpsTime);
                (scalar.unwrap_or(format!("{plane:?}").to_lowercase()), bytes_of(plane))
            })
            // Octrees of other programs have none in their files.
            .filter(|(_, bytes)| *bytes > 0 && is_own(index));
        Tree {
            bytes: index.bytes(),
            bytes_per_point: index.bytes() as f64 / index.directory.contents.points.max(1) as f64,
            nodes: nodes.len(),
            leaves: leaves.len(),
            inner: nodes.len() - leaves.len(),
            roots: index.directory.roots,
            levels,
            planes: planes.collect(),
            leaf_points: LeafPoints {
                least: leaves.first().copied().unwrap_or(0),
                median: leaves.get(leaves.len() / 2).copied().unwrap_or(0),
                most: leaves.last().copied().unwrap_or(0),
            },
        }
    }
}

impl Report<'_> {
    fn text(&self, index: &Index) -> String {
        let mut out = format!("{}\n", index.path().display());
        let mut line = |what: &str, value: String| {
            let _ = writeln!(out, "  {what:<18} {value}");
        };
        let own = || self.parts.first().map(|part| part.header.format.clone());
        let format = if is_own(index) { None } else { own() };
        line("format", format.unwrap_or("pointillist index".into()));
        line("points", self.points.to_string());
        write_bounds(&mut line, &self.bounds, index.reference().system.as_ref());
        line("unit", unit_words(&self.unit, self.unit_is_stated));
        let value = self
            .spacing
            .value
            .map_or("unknown, fewer than two places".into(), |value| self.unit.length(value, 6));
        line("spacing", format!("{value} ({})", self.spacing.how));
        line("--color", scalar::listed(&self.colors));
        let tree = &self.index;
        line(
            "size",
            format!("{} MiB, {:.1} bytes a point", tree.bytes >> 20, tree.bytes_per_point),
        );
        line(
            "tree",
            format!("{} leaves, {} inner nodes, {} roots", tree.leaves, tree.inner, tree.roots),
        );
        line(
            "leaves",
            format!(
                "{} to {} points, median {}",
                tree.leaf_points.least, tree.leaf_points.most, tree.leaf_points.median
            ),
        );
        for Level { level, nodes, samples, spacing } in &tree.levels {
            let spacing = spacing.map_or(String::new(), |spacing| {
                format!(", samples up to {} apart", self.unit.length(spacing, 4))
            });
            line(
                if *level == 0 { "levels" } else { "" },
                format!("{level}: {nodes} nodes, {samples} samples{spacing}"),
            );
        }
        for (number, (plane, bytes)) in tree.planes.iter().enumerate() {
            line(
                if number == 0 { "planes" } else { "" },
                format!(
                    "{plane}: {} MiB, {:.2} bytes a point",
                    bytes >> 20,
                    *bytes as f64 / self.points.max(1) as f64
                ),
            );
        }
        for part in self.parts {
            let name = part.name.as_ref().map(|name| format!(", {name}")).unwrap_or_default();
            line(
                "from",
                format!(
                    "{}{name}: {}, {} points",
                    part.path.display(),
                    part.header.format,
                    part.points
                ),
            );
            part.header.system.iter().for_each(|system| line("crs", system_words(system)));
        }
        if let Some(classes) = self.classes.as_ref().filter(|classes| !classes.is_empty()) {
            line("classes", listed(classes.iter().map(|class| (class.class, class.points))));
        }
        if let Some(returns) = self.returns.as_ref().filter(|returns| !returns.is_empty()) {
            line(
                "returns",
                listed(returns.iter().map(|returned| (returned.number, returned.points))),
            );
        }
        line("stations", self.stations.len().to_string());
        let balance = self.exposures.as_ref().map(|exposures| exposures.balance);
        for (number, station) in self.stations.iter().enumerate().take(LISTED) {
            line(
                "",
                format!("{}: {} points{}", station.name, station.points, gain(balance, number)),
            );
        }
        balance.into_iter().for_each(|balance| line("balance", uneven(balance)));
        if self.stations.len() > LISTED {
            line("", format!("and {} more; --json lists them all", self.stations.len() - LISTED));
        }
        self.strays.note().into_iter().for_each(|said| line("strays", said));
        self.notes.iter().for_each(|note| line("note", note.clone()));
        out.truncate(out.trim_end().len());
        out
    }
}

/// Returns the spacing of points within leaves spread evenly through the tree; none of one place.
fn spacing(index: &Index) -> Result<Option<f64>> {
    const LEAVES: usize = 64;
    let leaves: Vec<usize> =
        (0..index.nodes().len()).filter(|&node| index.nodes()[node].is_leaf()).collect();
    let asked: Vec<usize> =
        leaves.iter().copied().step_by(leaves.len().div_ceil(LEAVES).max(1)).collect();
    let points: u64 = asked.iter().map(|&leaf| index.nodes()[leaf].count as u64).sum();
    let every = points.div_ceil(spacing::SEEDS).max(1) as usize;
    let positions = |&leaf: &usize| {
        let count = index.nodes()[leaf].position_planes() as usize;
        (leaf, PLANES[..count].iter().map(|(plane, _)| *plane).collect())
    };
    index.ahead(&asked.iter().map(positions).collect::<Vec<_>>());
    let of_leaf = |&leaf: &usize| {
        let places: Vec<DVec3> = index.samples(leaf)?.iter().map(|(place, _)| *place).collect();
        let apart = |&seed: &DVec3| {
            let mut around = Around::NONE;
            let others = places
                .iter()
                .map(|place| (place.distance_squared(seed), *place))
                .filter(|(square, _)| *square > 0.0);
            others.for_each(|(square, place)| around.add(square, place));
            around.apart()
        };
        Ok(places.iter().step_by(every).filter_map(apart).collect::<Vec<_>>())
    };
    let apart = asked.par_iter().map(of_leaf).collect::<Result<Vec<_>>>()?;
    let mut apart = apart.concat();
    let count = apart.len();
    Ok(spacing::quartile(&mut apart, count))
}
