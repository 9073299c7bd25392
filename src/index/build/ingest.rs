//! Reads files into chunks of neighbouring points, and finds stations and their exposure gains: all
//! that is known before the first node is built.

use super::build_chunk::{PIECE_POINTS, TreeLayout, TreeSpec};
use super::builder::{Survey, lock};
use super::kd_cell::KdCell;
use super::point_record::{Batch, Colors, Layout};
use super::spill_bucket::{self, Bucket, Grid, Sorter, Spill};
use crate::cloud::attribute::tones;
use crate::cloud::histograms::Tally;
use crate::cloud::stream::{self, Source};
use crate::cloud::{ColumnSet, Columns, Lattice, Station};
use crate::error::{Error, Result};
use crate::index::attributes::exposure;
use crate::index::format::samples::{Cell, DerivedPlanes};
use crate::index::format::{Balance, Contents, IndexedPart};
use glam::DVec3;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};

/// Sources on one lattice.
pub struct Group {
    pub lattice: Lattice,
    /// Source numbers, and offsets of their coordinates.
    pub members: Vec<(usize, [i64; 3])>,
}

/// Receiver of the points of a group, from any thread.
pub trait Collector: Sync {
    fn add(&self, batch: &Batch, sorter: &mut Sorter) -> Result<()>;
}

/// Points in a grid of buckets.
pub struct Gridded<'a> {
    pub grid: Grid,
    pub spill: &'a Spill,
}

impl Collector for Gridded<'_> {
    fn add(&self, batch: &Batch, sorter: &mut Sorter) -> Result<()> {
        self.grid.add(batch, sorter, self.spill)
    }
}

/// Fills the places of points on the lattice of a tree with this corner. Returns all bits that
/// occur in their coordinates.
pub fn cells_of(
    columns: &Columns,
    shift: [i64; 3],
    corner: [i64; 3],
    cells: &mut Vec<Cell>,
) -> u64 {
    cells.clear();
    let at = |v: i32, axis: usize| (v as i64 + shift[axis] - corner[axis]) as u64;
    let mut bits = 0;
    for ((&x, &y), &z) in columns.x.iter().zip(&columns.y).zip(&columns.z) {
        let q = [at(x, 0), at(y, 1), at(z, 2)];
        bits |= q[0] | q[1] | q[2];
        cells.push(q.map(|v| v as u32));
    }
    bits
}

/// Groups sources with equal steps whose offsets differ by whole steps, to a thousandth of one.
pub fn group(sources: &[Source]) -> Vec<Group> {
    let mut groups: Vec<Group> = Vec::new();
    for (number, source) in sources.iter().enumerate() {
        let own = source.lattice();
        let shift = |group: &Group| {
            let steps = (own.offset - group.lattice.offset) / own.step;
            let whole = steps.round();
            let agrees = own.step == group.lattice.step
                && (steps - whole).abs().max_element() < 1e-3
                && whole.abs().max_element() < 2f64.powi(31);
            agrees.then(|| whole.to_array().map(|v| v as i64))
        };
        match groups.iter_mut().find_map(|group| shift(group).map(|shift| (group, shift))) {
            Some((group, shift)) => group.members.push((number, shift)),
            None => groups.push(Group { lattice: own, members: vec![(number, [0; 3])] }),
        }
    }
    groups
}

/// A group whose files have been read.
pub struct Ingested {
    pub group: Group,
    pub tree: TreeLayout,
    pub points: u64,
    /// Points by part and source.
    stations: BTreeMap<(u16, u16), u64>,
    /// The box around each member's points, on the tree's lattice; `None` without points.
    pub boxes: Vec<Option<[Cell; 2]>>,
}

impl Ingested {
    /// Returns whether its points are strays.
    pub fn is_of_strays(&self, sources: &[Source]) -> bool {
        self.group.members.iter().all(|&(number, _)| sources[number].header().strays)
    }
}

/// Points of one kd-cell, few enough to be built at once.
pub struct Chunk {
    pub cell: KdCell,
    pub buckets: Vec<Bucket>,
}

/// Returns a box of points on the lattice of a tree with this corner.
pub fn on_tree(bounds: [[i32; 3]; 2], shift: [i64; 3], corner: [i64; 3]) -> [Cell; 2] {
    let at = |q: i32, axis: usize| (q as i64 + shift[axis] - corner[axis]) as u32;
    bounds.map(|q| [0, 1, 2].map(|axis| at(q[axis], axis)))
}

impl Survey<'_> {
    /// Passes all points of a group to a collector for their tree's layout, in the stated box; if
    /// points lie outside, again in their own box.
    pub fn ingest<C: Collector>(
        &mut self,
        group: Group,
        collector: &dyn Fn(u32, Layout) -> C,
    ) -> Result<(Ingested, C)> {
        let union = |boxes: &mut dyn Iterator<Item = ([[i32; 3]; 2], [i64; 3])>| {
            boxes.fold(([i64::MAX; 3], [i64::MIN; 3]), |(low, high), (own, shift)| {
                let at = |corner: [i32; 3], axis: usize| corner[axis] as i64 + shift[axis];
                (
                    [0, 1, 2].map(|axis| low[axis].min(at(own[0], axis))),
                    [0, 1, 2].map(|axis| high[axis].max(at(own[1], axis))),
                )
            })
        };
        let stated =
            union(&mut group.members.iter().filter_map(|&(number, shift)| {
                Some((self.sources[number].stated_bounds()?, shift))
            }));
        let has = group.members.iter().fold(ColumnSet::default(), |has, &(number, _)| {
            has.and(self.sources[number].available())
        });
        // Several stations need a number per point, even if no file names them.
        let has = ColumnSet {
            source: has.source || group.members.len() > 1 || self.sources.len() > 1,
            // A scalar takes the place of times.
            gps_time: has.gps_time || !has.scalars.is_empty(),
            ..has
        };
        let parts: Vec<u16> = group.members.iter().map(|&(number, _)| number as u16).collect();
        let (mut cube, mut is_true) = (stated, false);
        let taken = self.spill.taken();
        loop {
            let extent = (0..3)
                .map(|axis| (cube.1[axis].saturating_sub(cube.0[axis])).max(0))
                .max()
                .unwrap_or(0) as u64;
            let bits = (64 - extent.leading_zeros()).max(1);
            if bits > 32 && !is_true {
                // Wrong headers: an empty box, which no point lies in, until the true one is known.
                cube = union(&mut std::iter::empty());
                continue;
            }
            if bits > 32 {
                return Err(Error::Request(format!(
                    "the files lie {extent} steps of their lattice apart, more than 2^32; index them separately"
                )));
            }
            let corner = if cube.0[0] == i64::MAX { [0; 3] } else { cube.0 };
            let layout = Layout::new(has, bits, &parts);
            let collector = collector(bits, layout);
            let outside = AtomicBool::new(false);
            let stations = Mutex::new(BTreeMap::<(u16, u16), u64>::new());
            let tally = Mutex::new(Tally::default());
            let brightest = Mutex::new(vec![0; 256]);
            let sorters = Mutex::new(Vec::<(Sorter, Vec<Cell>, Vec<u64>)>::new());
            let mut points = 0;
            let (mut own, mut worlds) = (Vec::new(), Vec::new());
            let mut notes = Vec::new();
            let (mut found, mut again) = (ColumnSet::default(), false);
            for &(number, shift) in &group.members {
                let part = number as u16;
                let streamed = self.sources[number].stream(self.progress, &|batch| {
                    if outside.load(Relaxed) {
                        return Ok(());
                    }
                    let (mut sorter, mut cells, mut intensities) =
                        lock(&sorters).pop().unwrap_or_default();
                    let columns = batch.columns;
                    if cells_of(columns, shift, corner, &mut cells) >> bits != 0 {
                        outside.store(true, Relaxed);
                        return Ok(());
                    }
                    let batch = Batch { cells: &cells, columns, part };
                    collector.add(&batch, &mut sorter)?;
                    let mut counts = BTreeMap::new();
                    match &columns.source {
                        Some(source) => source.chunk_by(|a, b| a == b).for_each(|run| {
                            *counts.entry((part, run[0])).or_insert(0) += run.len() as u64
                        }),
                        None => drop(counts.insert((part, 0), columns.x.len() as u64)),
                    }
                    let mut all = lock(&stations);
                    counts
                        .into_iter()
                        .for_each(|(station, points)| *all.entry(station).or_insert(0) += points);
                    drop(all);
                    let mut own = Tally::default();
                    own.add(columns);
                    lock(&tally).join(&own);
                    let own = tones(columns.rgb.as_deref().into_iter());
                    lock(&brightest).iter_mut().zip(own).for_each(|(sum, own)| *sum += own);
                    intensities.resize(1 << 16, 0);
                    let seen = columns.intensity.iter().flatten();
                    seen.for_each(|&v| intensities[v as usize] += 1);
                    lock(&sorters).push((sorter, cells, intensities));
                    Ok(())
                })?;
                points += streamed.points;
                self.colors[number] =
                    if streamed.available.rgb { Colors::Bytes } else { Colors::Black };
                again |= streamed.again;
                found = found.and(streamed.available);
                notes.extend(streamed.notes.clone());
                own.push(streamed.bounds.map(|bounds| (bounds, shift)));
                worlds.extend(
                    streamed.bounds.map(|bounds| self.sources[number].lattice().world_box(bounds)),
                );
                self.part(number, &group, &streamed);
            }
            let true_box = union(&mut own.iter().flatten().copied());
            let outside = outside.into_inner();
            if outside || again {
                drop(collector);
                self.spill.forget(taken);
                if !outside {
                    continue;
                }
                if cube == true_box {
                    return Err(Error::Request(format!(
                        "{} changed while it was read",
                        self.sources[group.members[0].0].path().display()
                    )));
                }
                (cube, is_true) = (true_box, true);
                continue;
            }
            self.contents.notes.extend(notes);
            self.contents.points += points;
            self.tally.join(&lock(&tally));
            let brightest: Vec<u64> = std::mem::take(&mut *lock(&brightest));
            self.tones.iter_mut().zip(brightest).for_each(|(sum, own)| *sum += own);
            for (_, _, counts) in lock(&sorters).iter() {
                self.intensities.iter_mut().zip(counts).for_each(|(sum, count)| *sum += count);
            }
            worlds.into_iter().for_each(|own| self.widen(own));
            let lattice_number = self.lattice(&group.lattice, corner)?;
            // All-black colours count as none, which only the points can tell.
            let has = ColumnSet { rgb: found.rgb, ..has };
            // Without colours there is no luminance.
            let derive = DerivedPlanes {
                luminance: self.options.derive.luminance && has.rgb,
                ..self.options.derive
            };
            let kind = TreeSpec {
                has,
                derive,
                corner,
                bits,
                lattice: group.lattice,
                lattice_number,
                gains: None,
            };
            let on_tree = |(bounds, shift)| on_tree(bounds, shift, corner);
            let ingested = Ingested {
                boxes: own.into_iter().map(|own| own.map(on_tree)).collect(),
                group,
                tree: TreeLayout { kind, layout },
                points,
                stations: stations.into_inner().unwrap_or_else(|poisoned| poisoned.into_inner()),
            };
            return Ok((ingested, collector));
        }
    }

    /// Cuts a grid's buckets into chunks.
    pub fn cut(&self, grid: Grid, layout: Layout) -> Result<Vec<Chunk>> {
        let mut chunks = Vec::new();
        let limit = self.options.chunk_points();
        let cut = Cut { limit, layout, colors: &self.colors, spill: self.spill };
        cut.cut(grid, 0, 0, &mut chunks)?;
        let buckets = chunks.par_iter_mut().flat_map(|chunk| &mut chunk.buckets);
        buckets.try_for_each(|bucket| bucket.close(self.spill))?;
        Ok(chunks)
    }

    /// Adds the lattice of a tree, and the one that starts at its corner. Returns the first number.
    pub fn lattice(&mut self, lattice: &Lattice, corner: [i64; 3]) -> Result<u16> {
        let number = self.contents.lattices.len();
        // Two more are reserved for nodes above several trees.
        if number + 4 > 1 << 16 {
            return Err(Error::Request(format!(
                "files on more than {} different lattices are more than one index takes",
                number / 2
            )));
        }
        self.contents
            .lattices
            .extend([[lattice.step, lattice.offset], [lattice.step, lattice.world(corner)]]);
        self.corners.extend([corner; 2]);
        Ok(number as u16)
    }

    fn part(&mut self, number: usize, group: &Group, streamed: &stream::Streamed) {
        let source = &self.sources[number];
        // Scalars can be read from the file only.
        let mut header = source.header().clone();
        (header.scalars, header.columns) = Default::default();
        // A note has reported bounds that are not finite.
        header.bounds.take_if(|corners| !corners.as_flattened().iter().all(|v| v.is_finite()));
        self.parts[number] = Some(IndexedPart {
            path: source.path().to_owned(),
            name: source.name().map(str::to_owned),
            header,
            step: group.lattice.step,
            offset: source.lattice().offset,
            points: streamed.points,
            intensity_range: source.intensity_range(),
            rgb_bits: streamed.rgb_scale.bits(),
            rgb_scale: streamed.rgb_scale,
        });
    }

    fn widen(&mut self, own: (DVec3, DVec3)) {
        let own = [own.0.min(own.1), own.0.max(own.1)];
        self.contents.bounds = Some(
            self.contents.bounds.map_or(own, |[low, high]| [low.min(own[0]), high.max(own[1])]),
        );
    }

    /// Numbers the stations, part by part.
    pub fn stations<'t>(&mut self, trees: impl Iterator<Item = &'t Ingested>) -> Result<()> {
        let all: BTreeMap<(u16, u16), u64> = trees
            .flat_map(|tree| &tree.stations)
            .map(|(station, points)| (*station, *points))
            .collect();
        if all.len() > 1 << 16 {
            return Err(Error::Request(format!(
                "{} stations are more than the 65,536 that one index takes",
                all.len()
            )));
        }
        for (number, ((part, source), points)) in all.into_iter().enumerate() {
            self.numbers.insert((part, source), number as u16);
            let from = &self.sources[part as usize];
            let has_sources = from.available().source;
            let name = if has_sources {
                format!("{} source {source}", from.title())
            } else {
                from.title()
            };
            self.contents.stations.push(Station {
                part: part as usize,
                source: has_sources.then_some(source),
                name,
                points,
            });
        }
        Ok(())
    }

    /// Returns a function that numbers the station of a part and a source; repeated requests are
    /// cached.
    pub fn numbered(&self) -> impl Fn(u16, u16) -> u16 {
        let last = std::cell::Cell::new(((u16::MAX, u16::MAX), 0));
        move |part: u16, source: u16| {
            if last.get().0 != (part, source) {
                // A crafted plan may lack it.
                let number = self.numbers.get(&(part, source)).copied().unwrap_or_default();
                last.set(((part, source), number));
            }
            last.get().1
        }
    }

    /// Finds the exposure gains of the stations' colours and intensities, if possible. `records`
    /// passes all records of a tree to a function, from any thread.
    pub fn balances<'t, T>(
        &self,
        trees: impl Iterator<Item = (&'t Ingested, T)>,
        records: impl Fn(&Ingested, T, &(dyn Fn(&[u8]) + Sync)) -> Result<()>,
    ) -> Result<[Option<Balance>; 2]> {
        let Contents { stations, points, bounds, intensity_stretch, .. } = &self.contents;
        let Some([low, high]) = bounds.filter(|_| stations.len() > 1) else {
            return Ok([None, None]);
        };
        let [colors, intensities] = [(); 2].map(|()| exposure::Sample::new((low, high), *points));
        let greys = exposure::greys(intensity_stretch[1]);
        let has_intensity: Vec<bool> =
            self.sources.iter().map(|source| source.available().intensity).collect();
        // On the files' own lattices, so that points are bit-identical to those of a cloud in
        // memory.
        let mut own: Vec<_> =
            self.sources.iter().map(|source| (source.lattice(), [0; 3])).collect();
        for (ingested, of) in trees {
            let Ingested { group, tree: TreeLayout { kind, layout }, .. } = ingested;
            if !kind.has.rgb && !kind.has.intensity {
                continue;
            }
            for &(number, shift) in &group.members {
                own[number].1 = [0, 1, 2].map(|axis| kind.corner[axis] - shift[axis]);
            }
            records(ingested, of, &|records| {
                let (number, mut found) = (self.numbered(), [Vec::new(), Vec::new()]);
                for record in records.chunks_exact(layout.bytes) {
                    let (q, part) = (layout.cell(record), layout.part(record));
                    let (lattice, from) = &own[part as usize];
                    let place = lattice.world([0, 1, 2].map(|axis| q[axis] as i64 + from[axis]));
                    let Some(cell) = colors.cell(place) else { continue };
                    let station = number(part, layout.source(record));
                    if kind.has.rgb {
                        let color = layout.color(record, &self.colors);
                        found[0].extend(exposure::point(cell, station, color));
                    }
                    if kind.has.intensity && has_intensity[part as usize] {
                        let grey = greys[layout.intensity(record) as usize];
                        found[1].extend(exposure::point(cell, station, [grey; 3]));
                    }
                }
                let [of_colors, of_intensities] = found;
                colors.keep(of_colors);
                intensities.keep(of_intensities);
            })?;
        }
        Ok([colors, intensities].map(|sample| exposure::of_sample(sample, stations)))
    }

    /// Passes the records of chunks to a function.
    pub fn look(&self, chunks: &[Chunk], look: &(dyn Fn(&[u8]) + Sync)) -> Result<()> {
        chunks.par_iter().try_for_each(|chunk| {
            self.progress.tick("comparing stations", 0, 1)?;
            let mut look = |records: &[u8]| look(records);
            chunk.buckets.iter().try_for_each(|bucket| bucket.look(self.spill, &mut look))
        })
    }
}

/// How a grid is cut into chunks.
struct Cut<'a> {
    /// Most points of a chunk, of places with few.
    limit: u64,
    layout: Layout,
    /// Those of every part.
    colors: &'a [Colors],
    spill: &'a Spill,
}

impl Cut<'_> {
    /// Cuts a grid's buckets into chunks, in Morton order. The grid covers the cell decided by
    /// `depth` bits of the code with the value `prefix`.
    fn cut(&self, grid: Grid, depth: u32, prefix: u128, chunks: &mut Vec<Chunk>) -> Result<()> {
        let (levels, is_finest) = (grid.levels, grid.is_finest());
        let (points, buckets): (Vec<u64>, Vec<spill_bucket::Contents>) =
            grid.into_buckets().into_iter().unzip();
        let mut starts = vec![0u64];
        starts.extend(points.iter().scan(0, |sum, points| {
            *sum += points;
            Some(*sum)
        }));
        let mut ranges = Vec::new();
        largest(&starts, 0..buckets.len(), self.limit, &mut ranges);
        let mut buckets = buckets.into_iter().enumerate();
        for range in ranges {
            let open = range.len().trailing_zeros();
            let (depth, prefix) = (
                depth + 3 * levels - open,
                prefix << (3 * levels - open) | (range.start >> open) as u128,
            );
            let mut own = Vec::new();
            for (_, contents) in
                buckets.by_ref().skip_while(|(i, _)| *i < range.start).take(range.len())
            {
                match contents {
                    spill_bucket::Contents::Points(bucket) => own.push(bucket),
                    spill_bucket::Contents::Finer(finer) => {
                        self.cut(finer, depth, prefix, chunks)?
                    }
                }
            }
            let has_many = starts[range.end] - starts[range.start] > self.limit;
            if is_finest && has_many && open == 0 {
                // One place.
                for bucket in own {
                    let pieces =
                        bucket.pieces(&self.layout, self.colors, PIECE_POINTS, self.spill)?;
                    chunks.extend(pieces.into_iter().map(|piece| Chunk {
                        cell: KdCell { depth, prefix },
                        buckets: vec![piece],
                    }));
                }
            } else if !own.is_empty() {
                chunks.push(Chunk { cell: KdCell { depth, prefix }, buckets: own });
            }
        }
        Ok(())
    }
}

/// Finds the largest runs of cells with at most `limit` points, or single cells, that cover all
/// occupied ones.
pub fn largest(
    starts: &[u64],
    cells: std::ops::Range<usize>,
    limit: u64,
    ranges: &mut Vec<std::ops::Range<usize>>,
) {
    let points = starts[cells.end] - starts[cells.start];
    if points == 0 {
        return;
    }
    if cells.len() == 1 || points <= limit {
        return ranges.push(cells);
    }
    let middle = cells.start + cells.len() / 2;
    largest(starts, cells.start..middle, limit, ranges);
    largest(starts, middle..cells.end, limit, ranges);
}
