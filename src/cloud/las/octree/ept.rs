//! Entwine Point Tiles: `ept.json`, lists of nodes in `ept-hierarchy`, and a file a node in
//! `ept-data`, either LAZ or rows of a schema.

use super::super::header::{self, ExtraBytes, Layout, check_lattice};
use super::super::laz::{Outcome, POINTS_PER_BYTE};
use super::super::records::{Fields, Lane};
use super::super::{Las, Places, Stretch};
use super::layout::{Attribute, F32, Place, Plan, Said, U8, WIDTHS};
use super::{Key, MOST_JSON, NodeReader, Octree, Opened, is_inside, named};
use crate::cloud::crs::Crs;
use crate::cloud::input::{Folder, Input, Meter};
use crate::cloud::stream::BATCH;
use crate::cloud::{ColumnSet, Lattice};
use crate::error::{Error, Result};
use crate::progress::Silent;
use glam::DVec3;
use rayon::prelude::*;
use serde::Deserialize;
use serde::de::{Deserializer, MapAccess, Visitor};
use std::collections::{HashMap, HashSet};
use std::fmt;

/// Lists that are requested ahead.
const LISTS: usize = 64;

/// Files whose change shows that the cloud changed: the first list, and the root.
pub const FILES: [&str; 3] =
    ["ept-hierarchy/0-0-0-0.json", "ept-data/0-0-0-0.laz", "ept-data/0-0-0-0.bin"];

#[derive(Deserialize)]
struct Description {
    bounds: [f64; 6],
    #[serde(rename = "boundsConforming")]
    conforming: Option<[f64; 6]>,
    #[serde(rename = "dataType")]
    data: String,
    points: u64,
    schema: Vec<Dimension>,
    span: f64,
    #[serde(default)]
    srs: System,
    version: String,
}

#[derive(Deserialize)]
struct Dimension {
    name: String,
    #[serde(rename = "type")]
    kind: String,
    size: usize,
    scale: Option<f64>,
    offset: Option<f64>,
    maximum: Option<f64>,
}

#[derive(Default, Deserialize)]
#[serde(default)]
struct System {
    authority: Option<String>,
    horizontal: Option<String>,
    wkt: Option<String>,
}

/// The lists of nodes, as far as they are read.
#[derive(Default)]
struct Lists {
    nodes: HashMap<Key, u64>,
    read: HashSet<Key>,
    waiting: Vec<Key>,
}

/// Entries of a list: numbers of points, or -1 for a list of its own.
struct Entries<'t>(Vec<(&'t str, i64)>);

/// Files of nodes.
struct Ept {
    folder: Folder,
    /// Ending of their names.
    ending: &'static str,
    nodes: Vec<(Key, u64)>,
    points: Points,
}

enum Points {
    /// LAZ files of this layout. Records are decoded as a whole, if they are kept.
    Packed {
        layout: Box<Likeness>,
        keeps_records: bool,
    },
    Rows(Plan),
}

/// Properties that the files of all nodes share.
#[derive(PartialEq)]
struct Likeness {
    format: u8,
    record_bytes: usize,
    lattice: Lattice,
    extra: Vec<(String, u8)>,
}

impl Likeness {
    fn of(layout: &Layout) -> Likeness {
        let name = |extra: &ExtraBytes| (extra.name.clone(), extra.kind);
        Likeness {
            format: layout.format,
            record_bytes: layout.record_bytes,
            lattice: layout.lattice,
            extra: layout.extra_bytes.iter().map(name).collect(),
        }
    }
}

impl fmt::Display for Likeness {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let Likeness { format, record_bytes, lattice: Lattice { step, offset }, extra } = self;
        let extra = extra.len();
        write!(
            f,
            "points of format {format} in {record_bytes} bytes with {extra} extra attributes, in steps of {step} from {offset}"
        )
    }
}

pub fn open(input: &Input, text: &[u8], keeps_records: bool) -> Result<Opened> {
    let said: Description = serde_json::from_slice(text)
        .map_err(|error| input.wrong(format!("does not describe an EPT cloud: {error}")))?;
    let [x, y, z, ..] = said.bounds;
    let (corner, high) = (DVec3::new(x, y, z), DVec3::from_slice(&said.bounds[3..]));
    let (sides, spacing) = (high - corner, (high - corner).max_element() / said.span);
    let is_box = corner.is_finite() && sides.is_finite() && sides.min_element() > 0.0;
    if !(is_box && said.span >= 1.0 && spacing > 0.0) {
        return Err(input.wrong(format!(
            "has an octree of an impossible box: {corner} to {high}, span {}",
            said.span
        )));
    }
    let folder = input.folder();
    let plan = match said.data.as_str() {
        "laszip" => None,
        "binary" => {
            let attributes = said.schema.iter().map(|dimension| dimension.checked(input));
            Some(Plan::new(input, attributes.collect::<Result<_>>()?)?)
        }
        other => {
            return Err(
                input.wrong(format!("has nodes of the type {other}; laszip and binary are read"))
            );
        }
    };
    let row = plan.as_ref().map(|plan| plan.row_bytes() as u64);
    let lists = Lists::read(input)?;
    let mut nodes: Vec<(Key, u64)> =
        lists.nodes.into_iter().filter(|(_, points)| *points > 0).collect();
    nodes.sort_unstable();
    let ending = if plan.is_some() { "bin" } else { "laz" };
    let chunk = |(number, (key, points)): (usize, &(Key, u64))| {
        if folder.is_remote() {
            // A server would have to be asked for each length; files are checked when they are
            // read.
            let bytes = row.map_or(Some(0), |row| points.checked_mul(row));
            let too_many = || input.wrong(format!("has a list that claims {points} points a node"));
            let bytes = bytes.ok_or_else(too_many)?;
            return Ok((*key, Stretch { at: number as u64, bytes, points: *points }));
        }
        let path = folder.path_of(&name_of(*key, ending));
        let bytes = std::fs::metadata(&path).map_err(|error| Error::io("open", &path, error))?;
        let bytes = bytes.len();
        let fits = match row {
            Some(row) => points.checked_mul(row) == Some(bytes),
            None => *points <= bytes.saturating_mul(POINTS_PER_BYTE),
        };
        if !fits {
            return Err(Error::format(
                &path,
                format!("has {bytes} bytes, but its list claims {points} points"),
            ));
        }
        Ok((*key, Stretch { at: number as u64, bytes, points: *points }))
    };
    let chunks: Vec<(Key, Stretch)> =
        nodes.par_iter().enumerate().map(|(n, node)| chunk((n, node))).collect::<Result<_>>()?;
    let bytes = chunks.iter().fold(input.length, |sum, (_, chunk)| sum.saturating_add(chunk.bytes));
    let there: u64 = nodes.iter().map(|(_, points)| points).sum();
    let lie = format!("declares {} points, but its nodes have {there}", said.points);
    let lies = Some(lie).filter(|_| said.points != there).into_iter().collect();
    let bounds = said.conforming.map(|[a, b, c, d, e, f]| [[a, b, c], [d, e, f]]);
    let system = said.srs.text();
    let format = format!("EPT {} {}", said.version, said.data);
    let (mut layout, points) = match plan {
        Some(plan) => {
            let lattice = said.lattice(input)?;
            let compressed = false;
            let layout = plan.layout(Said {
                format,
                points: there,
                lattice,
                bounds,
                system,
                compressed,
                lies,
            });
            (layout, Points::Rows(plan))
        }
        None => {
            let Some((key, _)) = nodes.first() else {
                return Err(input.wrong("has no points"));
            };
            let node = folder.open(&name_of(*key, ending))?;
            let own = header::read(&node, &mut Vec::new())?;
            let likeness = Box::new(Likeness::of(&own));
            let mut layout = Layout { points: there, lies, ..own };
            layout.kept.has_more = false;
            let header = &mut layout.header;
            header.format = format!("{format}, {}", header.format);
            (header.points, header.bounds) = (Some(there), bounds);
            header.system = Crs::named(&system).or(header.system.take());
            (layout, Points::Packed { layout: likeness, keeps_records })
        }
    };
    layout.header.points = Some(said.points);
    let octree =
        Octree { corner, sides, spacing, nodes: Octree::nodes_of(chunks.into_iter()), bytes };
    Ok(Opened { layout, octree, reader: Box::new(Ept { folder, ending, nodes, points }) })
}

/// Returns the name of a node's file.
fn name_of(key: Key, ending: &str) -> String {
    format!("ept-data/{}.{ending}", named(key))
}

impl Description {
    /// Returns the lattice of rows.
    fn lattice(&self, input: &Input) -> Result<Lattice> {
        let axis = |name: &str| {
            let own = self.schema.iter().find(|own| own.name == name);
            own.and_then(|own| own.scale)
                .map(|scale| (scale, own.and_then(|own| own.offset).unwrap_or_default()))
        };
        let (Some(x), Some(y), Some(z)) = (axis("X"), axis("Y"), axis("Z")) else {
            return Err(input.wrong("has positions without a scale"));
        };
        let (step, offset) = (DVec3::new(x.0, y.0, z.0), DVec3::new(x.1, y.1, z.1));
        check_lattice(input, step, offset)?;
        if step.min_element() <= 0.0 {
            return Err(input.wrong(format!("has the negative scale {step}")));
        }
        Ok(Lattice { step, offset })
    }
}

impl Dimension {
    fn checked(&self, input: &Input) -> Result<Attribute> {
        let kinds = match self.kind.as_str() {
            "unsigned" => [U8, 3, 5, 7],
            "signed" => [2, 4, 6, 8],
            "float" => [0, 0, F32, 10],
            _ => [0; 4],
        };
        let kind =
            kinds.into_iter().find(|&kind| kind > 0 && WIDTHS[kind as usize - 1] == self.size);
        let kind = kind.ok_or_else(|| {
            input.wrong(format!(
                "has a dimension {} of type {} in {} bytes",
                self.name, self.kind, self.size
            ))
        })?;
        Ok(Attribute {
            name: self.name.clone(),
            kind,
            elements: 1,
            scale: self.scale.unwrap_or(1.0),
            offset: self.offset.unwrap_or(0.0),
            most: self.maximum,
        })
    }
}

impl System {
    /// Returns WKT, or the code of the horizontal system.
    fn text(&self) -> String {
        let code = || Some(format!("{}:{}", self.authority.as_ref()?, self.horizontal.as_ref()?));
        let wkt = self.wkt.clone().filter(|text| !text.is_empty());
        wkt.or_else(code).unwrap_or_default()
    }
}

impl<'de> Deserialize<'de> for Entries<'de> {
    fn deserialize<D: Deserializer<'de>>(from: D) -> std::result::Result<Self, D::Error> {
        struct Map;
        impl<'de> Visitor<'de> for Map {
            type Value = Entries<'de>;

            fn expecting(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
                f.write_str("nodes with their numbers of points")
            }

            fn visit_map<A: MapAccess<'de>>(
                self,
                mut map: A,
            ) -> std::result::Result<Entries<'de>, A::Error> {
                let mut entries = Vec::new();
                while let Some(entry) = map.next_entry()? {
                    entries.push(entry);
                }
                Ok(Entries(entries))
            }
        }
        from.deserialize_map(Map)
    }
}

/// Parses the name of a node.
fn key_of(name: &str) -> Option<Key> {
    let mut numbers = name.split('-').map(|number| number.parse().ok());
    let key = [numbers.next()??, numbers.next()??, numbers.next()??, numbers.next()??];
    (numbers.next().is_none() && named(key) == name).then_some(key)
}

/// Tests whether a node is another, or below it.
fn is_below(key: Key, other: Key) -> bool {
    let shift = key[0] - other[0];
    shift >= 0 && (1..4).all(|axis| key[axis] >> shift == other[axis])
}

impl Lists {
    /// Reads all lists. Each is of one node and those below it, and none is read twice.
    fn read(input: &Input) -> Result<Lists> {
        let mut lists = Lists { waiting: vec![[0; 4]], ..Lists::default() };
        let folder = input.folder();
        let name = |root: &Key| format!("ept-hierarchy/{}.json", named(*root));
        while let Some(root) = lists.waiting.pop() {
            folder.ahead(lists.waiting.iter().rev().take(LISTS).map(name));
            let list = folder.open(&name(&root))?;
            let text = list.take(0, list.length.min(MOST_JSON + 1))?;
            if text.len() as u64 > MOST_JSON {
                return Err(list.wrong(format!("is larger than {} MiB", MOST_JSON >> 20)));
            }
            let Entries(entries) = serde_json::from_slice(&text)
                .map_err(|error| list.wrong(format!("is no list of nodes: {error}")))?;
            for (name, points) in entries {
                let wrong = |what: &str| list.wrong(format!("has a node {name} {what}"));
                let key = key_of(name)
                    .filter(|key| is_inside(*key))
                    .ok_or_else(|| wrong("that is no place in an octree"))?;
                if !is_below(key, root) {
                    return Err(wrong(&format!("outside of {}", named(root))));
                }
                match points {
                    -1 if key == root => return Err(wrong("whose list is this one")),
                    -1 if !lists.read.insert(key) => return Err(wrong("whose list is known")),
                    -1 => lists.waiting.push(key),
                    0.. => {
                        if lists.nodes.insert(key, points as u64).is_some() {
                            return Err(wrong("that comes twice"));
                        }
                    }
                    _ => return Err(wrong(&format!("of {points} points"))),
                }
            }
        }
        Ok(lists)
    }
}

impl NodeReader for Ept {
    fn ahead(&self, chunks: &[Stretch]) {
        let key = |chunk: &Stretch| self.nodes[chunk.at as usize].0;
        self.folder.ahead(chunks.iter().map(|chunk| name_of(key(chunk), self.ending)));
    }

    fn records(
        &self,
        chunk: &Stretch,
        wanted: ColumnSet,
        take: &mut dyn FnMut(&[u8]) -> Result<()>,
    ) -> Result<Outcome> {
        let (key, all) = self.nodes[chunk.at as usize];
        match &self.points {
            Points::Rows(plan) => {
                let input = self.folder.open(&name_of(key, self.ending))?;
                let expected = all * plan.row_bytes() as u64;
                if input.length != expected {
                    return Err(input.wrong(format!(
                        "has {} bytes, but its list claims {all} points",
                        input.length
                    )));
                }
                let (stride, mut block) = (plan.row_bytes(), Vec::new());
                let bytes = plan.attributes.iter().map(Attribute::bytes);
                let at = bytes.scan(0, |at, bytes| Some(std::mem::replace(at, *at + bytes)));
                let places: Vec<Place> = at.map(|at| Place { at, stride }).collect();
                for start in (0..chunk.points).step_by(BATCH) {
                    let count = (chunk.points - start).min(BATCH as u64) as usize;
                    let mut rows = vec![0; count * stride];
                    input.read_exactly(start * stride as u64, &mut rows)?;
                    block.clear();
                    plan.write(&rows, &places, 0..count, &mut block)
                        .map_err(|what| input.wrong(format!("has a point with {what}")))?;
                    take(&block)?;
                }
                Ok(None)
            }
            Points::Packed { layout, keeps_records } => {
                let input = self.folder.open(&name_of(key, self.ending))?;
                let las = Las::located(&input, wanted, *keeps_records, &mut Vec::new())?;
                if las.points() != all {
                    let points = las.points();
                    let what = format!("has {points} points, but its list says {all}");
                    return Err(input.wrong(what));
                }
                let own = Likeness::of(&las.layout);
                if own != **layout {
                    return Err(input.wrong(format!("has {own}, but the root has {layout}")));
                }
                let mut lane = Forward { held: Vec::new(), take };
                let meter = Meter::new(&Silent, &input, 0);
                let why = match &las.places {
                    Places::Known(stretches) => {
                        let mut block = Vec::new();
                        let mut why = None;
                        for stretch in stretches {
                            why = why
                                .or(las
                                    .one_stretch(&input, stretch, &mut block, &mut lane, &meter)?);
                        }
                        why
                    }
                    Places::Sequence(sequence) => {
                        las.sequence(&input, sequence, &mut lane, &Silent)?
                    }
                };
                Ok(why.map(|why| format!("{}: {why}", input.name())))
            }
        }
    }
}

/// A lane that gives records on.
struct Forward<'f> {
    held: Vec<u8>,
    take: &'f mut dyn FnMut(&[u8]) -> Result<()>,
}

impl Lane for Forward<'_> {
    fn room(&mut self, points: usize) -> usize {
        points.min(BATCH)
    }

    fn put(&mut self, records: &[u8], _: &Fields) {
        self.held.extend_from_slice(records);
    }

    fn settle(&mut self) -> Result<()> {
        (self.take)(&self.held)?;
        self.held.clear();
        Ok(())
    }
}
