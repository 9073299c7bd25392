//! Statistics of the points that are left, as `info` tells them: ranges of attributes, stations,
//! spacing, strays, exposures. A batch a thread is in memory, whatever the number of points, and
//! files are read in rounds.
//!
//! 1. Ranges and sums of each part, and samples of its positions. Samples are chosen from the lower
//!    corner and by the number of points, which files state. Where these are wrong, or points are
//!    left out, the samples take a round of their own.
//! 2. Neighbours of seeds, for the spacing; distances of points, which tell strays; points of
//!    stations that have colours. Seeds whose neighbours are far take further rounds.
//! 3. If there are strays, where they are.
//!
//! Compressed files are decoded once: a temporary file keeps what further rounds look at.

use super::Selection;
use super::input::{Batch, Input, Read};
use crate::cloud::column_file::ColumnFile;
use crate::cloud::filter::grouped;
use crate::cloud::histograms::{Histograms, Tally};
use crate::cloud::rgb_range::Scale;
use crate::cloud::spacing::{self, Round, Search};
use crate::cloud::strays::{Bins, RobustBounds, Samples, Strays};
use crate::cloud::{ColumnSet, Columns, Station};
use crate::error::Result;
use crate::index::attributes::exposure::{self, Comparison, Exposures};
use crate::progress::Progress;
use glam::DVec3;
use rayon::prelude::*;
use std::borrow::Cow;
use std::collections::BTreeMap;

/// Statistics of all parts together.
#[derive(Debug, PartialEq)]
pub struct Statistics {
    /// One for each part of the input; none for those of which nothing is left.
    pub parts: Vec<PartStatistics>,
    pub stations: Vec<Station>,
    pub spacing: Option<f64>,
    /// Points that lie far outside of their part.
    pub strays: Strays,
    /// Exposures of stations, if two or more have colours.
    pub exposures: Option<Exposures>,
    pub notes: Vec<String>,
}

/// Statistics of the points of a part that are left.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PartStatistics {
    /// Number of the part of the input.
    pub part: usize,
    pub points: u64,
    /// Corners of the box around the points `[lattice steps]`.
    pub ends: Option<[[i32; 3]; 2]>,
    /// World corners of that box.
    pub bounds: Option<(DVec3, DVec3)>,
    /// Columns of the points.
    pub available: ColumnSet,
    pub rgb_scale: Scale,
    /// Least and largest colour.
    pub rgb: Option<[[u8; 3]; 2]>,
    /// Least and largest intensity, as stored.
    pub intensity: Option<[u16; 2]>,
    pub histograms: Histograms,
    /// The largest number of returns.
    pub most_returns: u8,
    /// Points whose return number is 0 or above their number of returns.
    pub impossible_returns: u64,
    /// Least and largest GPS time.
    pub gps_time: Option<[f64; 2]>,
    /// Points without a GPS time.
    pub no_time: u64,
    /// Points without a normal.
    pub no_normal: u64,
}

/// Points of a station, and their colours.
#[derive(Clone, Copy, Default)]
struct Seen {
    points: u64,
    /// Sum of V over the coloured points, and their number.
    value: u64,
    coloured: u64,
}

impl Seen {
    fn join(&mut self, other: Seen) {
        self.points += other.points;
        self.value += other.value;
        self.coloured += other.coloured;
    }
}

/// Ranges and sums of some points of a part.
#[derive(Clone, Default)]
struct Ranges {
    part: PartStatistics,
    /// Points from which those that are left were chosen.
    of: u64,
    tally: Tally,
    samples: Option<Samples>,
    /// Stations by LAS point source id.
    stations: BTreeMap<Option<u16>, Seen>,
}

/// Returns the range around both.
fn widened<T: Copy>(
    one: Option<[T; 2]>,
    other: Option<[T; 2]>,
    least: impl Fn(T, T) -> T,
    most: impl Fn(T, T) -> T,
) -> Option<[T; 2]> {
    let both = |[low, high]: [T; 2], [a, b]: [T; 2]| [least(low, a), most(high, b)];
    one.into_iter().chain(other).reduce(both)
}

/// Returns the least and the largest of values.
fn range<T: Copy>(
    values: &[T],
    least: impl Fn(T, T) -> T,
    most: impl Fn(T, T) -> T,
) -> Option<[T; 2]> {
    let first = *values.first()?;
    let both = |[low, high]: [T; 2], &value: &T| [least(low, value), most(high, value)];
    Some(values.iter().fold([first; 2], both))
}

/// Applies a function to each channel.
fn each<T: Copy, const N: usize>(pick: fn(T, T) -> T) -> impl Fn([T; N], [T; N]) -> [T; N] {
    move |a, b| std::array::from_fn(|axis| pick(a[axis], b[axis]))
}

impl Ranges {
    /// Returns those of points that are left of a number.
    fn of(columns: &Columns, of: usize, mut samples: Option<Samples>) -> Ranges {
        let mut part = PartStatistics {
            points: columns.len() as u64,
            ends: columns.bounds(),
            ..PartStatistics::default()
        };
        if let Some(column) = &columns.rgb {
            part.rgb = range(column, each(u8::min), each(u8::max));
        }
        if let Some(column) = &columns.intensity {
            part.intensity = range(column, u16::min, u16::max);
        }
        if let Some(column) = &columns.returns {
            part.most_returns = column.iter().map(|packed| packed >> 4).max().unwrap_or(0);
            let is_odd = |packed: &&u8| **packed & 15 == 0 || **packed & 15 > **packed >> 4;
            part.impossible_returns = column.iter().filter(is_odd).count() as u64;
        }
        if let Some(column) = &columns.gps_time {
            part.no_time = column.iter().filter(|time| time.is_nan()).count() as u64;
            // Both functions return the number, where one of two is NaN.
            let times = range(column, f64::min, f64::max);
            part.gps_time = times.filter(|[low, _]| !low.is_nan());
        }
        if let Some(column) = &columns.normal {
            part.no_normal = column.iter().filter(|normal| **normal == [0; 3]).count() as u64;
        }
        if let Some(samples) = &mut samples {
            samples.add([&columns.x, &columns.y, &columns.z]);
        }
        let mut ranges = Ranges { part, of: of as u64, samples, ..Ranges::default() };
        ranges.tally.add(columns);
        let mut first = 0;
        let mut seen = |source: Option<u16>, points: usize| {
            let mut own = Seen { points: points as u64, ..Seen::default() };
            for &color in columns.rgb.iter().flat_map(|column| &column[first..first + points]) {
                let value = exposure::value(color);
                own.value += u64::from(value.unwrap_or(0));
                own.coloured += u64::from(value.is_some());
            }
            first += points;
            ranges.stations.entry(source).or_default().join(own);
        };
        match &columns.source {
            Some(column) => {
                column.chunk_by(|a, b| a == b).for_each(|run| seen(Some(run[0]), run.len()))
            }
            None if columns.is_empty() => {}
            None => seen(None, columns.len()),
        }
        ranges
    }

    fn join(&mut self, other: Ranges) {
        let (own, part) = (&mut self.part, other.part);
        own.points += part.points;
        own.ends = widened(own.ends, part.ends, each(i32::min), each(i32::max));
        own.rgb = widened(own.rgb, part.rgb, each(u8::min), each(u8::max));
        own.intensity = widened(own.intensity, part.intensity, u16::min, u16::max);
        own.gps_time = widened(own.gps_time, part.gps_time, f64::min, f64::max);
        own.most_returns = own.most_returns.max(part.most_returns);
        own.impossible_returns += part.impossible_returns;
        own.no_time += part.no_time;
        own.no_normal += part.no_normal;
        self.of += other.of;
        self.tally.join(&other.tally);
        match (&mut self.samples, other.samples) {
            (Some(all), Some(own)) => all.join(own),
            (all @ None, own) => *all = own,
            (Some(_), None) => {}
        }
        for (source, seen) in other.stations {
            self.stations.entry(source).or_default().join(seen);
        }
    }

    /// Returns whether the samples are those of all points.
    fn has_samples(&self) -> bool {
        let Some([low, _]) = self.part.ends else { return true };
        self.samples.as_ref().is_some_and(|samples| samples.are_of(low, self.part.points))
    }
}

/// Returns the points of a batch that are left.
fn left<'b>(batch: &'b Batch) -> Cow<'b, Columns> {
    match batch.left.len() == batch.columns.len() {
        true => Cow::Borrowed(batch.columns),
        false => Cow::Owned(batch.columns.pick(&batch.left)),
    }
}

/// Returns the statistics of all points of files that are left. Errors if there were some, and none
/// are.
pub fn statistics(
    input: &mut Input,
    selection: &Selection,
    progress: &dyn Progress,
) -> Result<Statistics> {
    input.check(&selection.filter)?;
    let (mut ranges, mut notes, kept) = read_ranges(input, selection, progress)?;
    let points: u64 = ranges.iter().map(|own| own.part.points).sum();
    let of: u64 = ranges.iter().map(|own| own.of).sum();
    if points == 0 && of > 0 {
        return Err(selection.leaves_none(input, progress));
    }
    let words = selection.words();
    if !words.is_empty() {
        notes.push(format!("{words} leaves {} of {} points", grouped(points), grouped(of)));
    }
    input.narrow(selection.wanted());
    read_samples(&mut ranges, &Rounds { input, selection, progress, kept: &kept })?;
    for (number, (own, part)) in ranges.iter_mut().zip(input.parts()).enumerate() {
        own.part.part = number;
        own.part.bounds = own.part.ends.map(|ends| part.lattice.world_box(ends));
        own.part.histograms = own.tally.counts();
    }
    let (mut stations, values) = stations(input, &ranges);
    let mut places = Places::new(input, &ranges, &stations, &values);
    let is_compared = places.comparison.is_some();
    let colors = ColumnSet { rgb: is_compared, source: is_compared, ..ColumnSet::default() };
    input.narrow(selection.wanted().and(colors));
    let rounds = Rounds { input, selection, progress, kept: &kept };
    let spacing = places.read(&rounds)?;
    let strays = places.read_strays(&rounds)?;
    let exposures = places.comparison.map(|found| found.exposures(&stations, values));
    let mut parts: Vec<PartStatistics> = ranges.into_iter().map(|own| own.part).collect();
    parts.retain(|part| part.points > 0 || words.is_empty());
    for station in &mut stations {
        station.part = parts.partition_point(|part| part.part < station.part);
    }
    Ok(Statistics { parts, stations, spacing, strays, exposures, notes })
}

/// Reads ranges, and samples where all points are left; again if all colours together have another
/// scale than a sample of them. Keeps points of compressed files.
fn read_ranges(
    input: &Input,
    selection: &Selection,
    progress: &dyn Progress,
) -> Result<(Vec<Ranges>, Vec<String>, Kept)> {
    let is_all = selection.words().is_empty();
    let begin = |part: usize| {
        let (low, points) = input.stated(part).filter(|_| is_all)?;
        Some(Samples::of(low, points))
    };
    let begun: Vec<Option<Samples>> = (0..input.parts().len()).map(begin).collect();
    loop {
        let mut ranges = vec![Ranges::default(); input.parts().len()];
        let mut kept = Kept { file: ColumnFile::new(), parts: vec![Vec::new(); ranges.len()] };
        let look = |batch: &Batch| {
            let (of, columns) = (batch.columns.len(), left(batch));
            let own = Ranges::of(&columns, of, begun[batch.part].clone());
            let block = input.is_compressed(batch.part).then(|| Block::new(&columns, &kept.file));
            Ok((batch.part, own, block))
        };
        let mut blocks: Vec<Vec<Block>> = kept.parts.clone();
        let mut take = |(part, own, block): (usize, Ranges, Option<Block>)| {
            ranges[part].join(own);
            blocks[part].extend(block);
            Ok(())
        };
        let Read { streamed, notes } =
            input.read(&|_| true, selection, progress, &look, &mut take)?;
        if streamed.iter().any(|streamed| streamed.again) {
            continue;
        }
        for (own, streamed) in ranges.iter_mut().zip(&streamed) {
            (own.part.available, own.part.rgb_scale) = (streamed.available, streamed.rgb_scale);
            own.part.rgb.take_if(|_| !streamed.available.rgb);
        }
        // Drops points that do not fit there, which are then read again.
        match kept.file.check() {
            Ok(()) => kept.parts = blocks,
            Err(_) => kept.file = ColumnFile::new(),
        }
        return Ok((ranges, notes, kept));
    }
}

/// What further rounds look at, of compressed files.
struct Kept {
    file: ColumnFile,
    /// Blocks of each part; none of parts that are read again.
    parts: Vec<Vec<Block>>,
}

/// Where points of a batch are in the temporary file.
#[derive(Clone)]
struct Block {
    points: usize,
    places: [u64; 3],
    rgb: Option<u64>,
    source: Option<u64>,
}

impl Block {
    fn new(columns: &Columns, file: &ColumnFile) -> Block {
        Block {
            points: columns.len(),
            places: [&columns.x, &columns.y, &columns.z].map(|column| file.append(column)),
            rgb: columns.rgb.as_deref().map(|column| file.append(column)),
            source: columns.source.as_deref().map(|column| file.append(column)),
        }
    }

    fn columns(&self, file: &ColumnFile) -> Result<Columns> {
        let [x, y, z] = self.places.map(|at| file.read(at, self.points));
        Ok(Columns {
            x: x?,
            y: y?,
            z: z?,
            rgb: self.rgb.map(|at| file.read(at, self.points)).transpose()?,
            source: self.source.map(|at| file.read(at, self.points)).transpose()?,
            ..Columns::default()
        })
    }
}

/// Blocks that are in memory at a time, for each thread.
const BLOCKS: usize = 4;

/// What is read in rounds after the first.
struct Rounds<'r> {
    input: &'r Input,
    selection: &'r Selection,
    progress: &'r dyn Progress,
    kept: &'r Kept,
}

impl Rounds<'_> {
    /// Maps the points of wanted parts that are left, on all threads, and calls `take` with the
    /// results in order.
    fn each<T: Send>(
        &self,
        wants: &dyn Fn(usize) -> bool,
        map: &(dyn Fn(usize, &Columns) -> Result<T> + Sync),
        take: &mut (dyn FnMut(T) -> Result<()> + Send),
    ) -> Result<()> {
        let Rounds { input, selection, progress, kept } = *self;
        let look = |batch: &Batch| map(batch.part, &left(batch));
        if kept.parts.iter().all(Vec::is_empty) {
            return input.read(wants, selection, progress, &look, take).map(drop);
        }
        for part in (0..kept.parts.len()).filter(|&part| wants(part)) {
            let blocks = &kept.parts[part];
            if blocks.is_empty() {
                input.read(&|own| own == part, selection, progress, &look, take)?;
                continue;
            }
            let doing = format!("reading {}", input.parts()[part].title);
            let points = |blocks: &[Block]| blocks.iter().map(|own| own.points as u64).sum::<u64>();
            let (mut done, total) = (0, points(blocks));
            for blocks in blocks.chunks(BLOCKS * rayon::current_num_threads()) {
                let map = |block: &Block| map(part, &block.columns(&kept.file)?);
                let mapped: Vec<T> = blocks.par_iter().map(map).collect::<Result<_>>()?;
                mapped.into_iter().try_for_each(&mut *take)?;
                done += points(blocks);
                progress.tick(&doing, done, total)?;
            }
        }
        Ok(())
    }
}

/// Reads the samples of parts whose corner and number of points were not known.
fn read_samples(ranges: &mut [Ranges], rounds: &Rounds) -> Result<()> {
    let begin = |own: &Ranges| {
        let [low, _] = own.part.ends.filter(|_| !own.has_samples())?;
        Some(Samples::of(low, own.part.points))
    };
    let mut begun: Vec<Option<Samples>> = ranges.iter().map(begin).collect();
    if begun.iter().all(Option::is_none) {
        return Ok(());
    }
    let empty = begun.clone();
    let look = |part: usize, columns: &Columns| {
        let mut samples = empty[part].clone();
        if let Some(samples) = &mut samples {
            samples.add([&columns.x, &columns.y, &columns.z]);
        }
        Ok((part, samples))
    };
    let mut take = |(part, own): (usize, Option<Samples>)| {
        begun[part].as_mut().zip(own).into_iter().for_each(|(all, own)| all.join(own));
        Ok(())
    };
    rounds.each(&|part| empty[part].is_some(), &look, &mut take)?;
    for (own, samples) in ranges.iter_mut().zip(begun) {
        own.samples = samples.or(own.samples.take());
    }
    Ok(())
}

/// Returns the stations, and the mean V of the coloured points of each.
fn stations(input: &Input, ranges: &[Ranges]) -> (Vec<Station>, Vec<Option<f64>>) {
    let (mut stations, mut values) = (Vec::new(), Vec::new());
    for (part, (own, whole)) in ranges.iter().zip(input.parts()).enumerate() {
        let mut seen = own.stations.clone();
        if own.of == 0 && !own.part.available.source {
            seen.insert(None, Seen::default());
        }
        let title = match whole.header.strays {
            true => format!("{}, far outside", whole.title),
            false => whole.title.clone(),
        };
        for (source, Seen { points, value, coloured }) in seen {
            let name = source.map_or(title.clone(), |id| format!("{title} source {id}"));
            stations.push(Station { part, source, name, points });
            let is_coloured = own.part.available.rgb && coloured > 0;
            values.push(is_coloured.then(|| value as f64 / coloured as f64));
        }
    }
    (stations, values)
}

/// Distances between points, and the points of stations.
struct Places {
    ends: Vec<Option<[[i32; 3]; 2]>>,
    search: Option<Search>,
    /// Bins of each part in which there can be strays, and its points in each.
    bins: Vec<Option<(Bins, Vec<u64>)>>,
    comparison: Option<Comparison>,
    /// Number of each station, by part and LAS point source id.
    numbers: BTreeMap<(usize, Option<u16>), u16>,
    /// True for parts with colours.
    coloured: Vec<bool>,
}

impl Places {
    fn new(
        input: &Input,
        ranges: &[Ranges],
        stations: &[Station],
        values: &[Option<f64>],
    ) -> Places {
        let parts = input.parts();
        let count = ranges.iter().map(|own| own.part.points).sum();
        let boxed = |has: &dyn Fn(usize) -> bool| {
            let bounds = (0..parts.len()).filter(|&k| has(k)).filter_map(|k| ranges[k].part.bounds);
            bounds.reduce(|(low, high), (a, b)| (low.min(a), high.max(b)))
        };
        let search = boxed(&|k| !parts[k].header.strays).and_then(|(low, high)| {
            let samples = ranges.iter().zip(parts);
            let samples =
                samples.filter_map(|(own, part)| Some((part.lattice, own.samples.as_ref()?)));
            Search::new(spacing::seeds(samples, count), count, (high - low).max_element())
        });
        let bins = |(own, part): (&Ranges, &super::input::Part)| {
            let ends = own.part.ends.filter(|_| !part.header.strays)?;
            Some((own.samples.as_ref()?.bins(own.part.points, ends)?, Vec::new()))
        };
        let are_compared = values.iter().flatten().count() > 1;
        let numbers = (0u16..).zip(stations);
        Places {
            ends: ranges.iter().map(|own| own.part.ends).collect(),
            search,
            bins: ranges.iter().zip(parts).map(bins).collect(),
            comparison: boxed(&|_| true)
                .filter(|_| are_compared)
                .map(|bounds| Comparison::new(bounds, count)),
            numbers: numbers.map(|(number, own)| ((own.part, own.source), number)).collect(),
            coloured: ranges.iter().map(|own| own.part.available.rgb).collect(),
        }
    }

    /// Reads all points until their spacing is known. Returns the spacing.
    fn read(&mut self, rounds: &Rounds) -> Result<Option<f64>> {
        let input = rounds.input;
        let (mut spacing, mut is_first) = (None, true);
        let has_others = self.comparison.is_some() || self.bins.iter().any(Option::is_some);
        while self.search.is_some() || is_first && has_others {
            let search = self.search.take();
            let watch = |(part, ends): (&super::input::Part, &Option<[[i32; 3]; 2]>)| {
                Some(search.as_ref()?.watch(part.lattice, (*ends)?))
            };
            let watches: Vec<_> = input.parts().iter().zip(&self.ends).map(watch).collect();
            let look = |part: usize, columns: &Columns| {
                if let (Some(search), Some(watch)) = (&search, &watches[part]) {
                    search.look(watch, [&columns.x, &columns.y, &columns.z]);
                }
                if !is_first {
                    return Ok((part, None));
                }
                self.compare(input, part, columns);
                let bins = self.bins[part].as_ref();
                let counts = bins.map(|(bins, _)| bins.count(columns.len(), |i| columns.place(i)));
                Ok((part, counts))
            };
            let mut sums: Vec<Vec<u64>> = vec![Vec::new(); self.bins.len()];
            let mut take = |(part, counts): (usize, Option<Vec<u64>>)| {
                let (sum, counts) = (&mut sums[part], counts.unwrap_or_default());
                sum.resize(counts.len().max(sum.len()), 0);
                sum.iter_mut().zip(counts).for_each(|(sum, own)| *sum += own);
                Ok(())
            };
            rounds.each(&|_| true, &look, &mut take)?;
            if is_first {
                let counted = self.bins.iter_mut().zip(sums);
                counted.for_each(|(bins, sum)| bins.iter_mut().for_each(|own| own.1 = sum.clone()));
            }
            is_first = false;
            match search.map(Search::settle) {
                Some(Round::Wider(wider)) => self.search = Some(wider),
                Some(Round::Found(found)) => spacing = found,
                None => {}
            }
        }
        Ok(spacing)
    }

    /// Adds points of stations to the comparison.
    fn compare(&self, input: &Input, part: usize, columns: &Columns) {
        let Some(comparison) = &self.comparison else { return };
        let Some(rgb) = columns.rgb.as_ref().filter(|_| self.coloured[part]) else { return };
        let lattice = &input.parts()[part].lattice;
        let Columns { x, y, z, source, .. } = columns;
        let number = |source| self.numbers.get(&(part, source)).copied().unwrap_or(0);
        // Neighbours in a file are mostly of one station.
        let mut last = (None, number(None));
        let point = |i: usize| {
            let source = source.as_ref().map(|column| column[i]);
            if source != last.0 {
                last = (source, number(source));
            }
            (lattice.world([x[i], y[i], z[i]].map(i64::from)), last.1, rgb[i])
        };
        comparison.add((0..columns.len()).map(point));
    }

    /// Reads the points beyond the core of their part, if there are some.
    fn read_strays(&self, rounds: &Rounds) -> Result<Strays> {
        let input = rounds.input;
        let core = |bins: &Option<(Bins, Vec<u64>)>| {
            bins.as_ref().and_then(|(bins, counts)| bins.core(counts))
        };
        let cores: Vec<Option<RobustBounds>> = self.bins.iter().map(core).collect();
        let is_far = |part: usize| input.parts()[part].header.strays;
        let look = |part: usize, columns: &Columns| {
            let core = cores[part];
            let is_stray =
                |&i: &usize| is_far(part) || core.is_some_and(|core| !core.has(columns.place(i)));
            let strays: Vec<usize> = (0..columns.len()).filter(is_stray).collect();
            let lattice = &input.parts()[part].lattice;
            let Columns { x, y, z, .. } = columns;
            let world = strays.iter().map(|&i| lattice.world([x[i], y[i], z[i]].map(i64::from)));
            Ok(Strays::listed(strays.len() as u64, world))
        };
        let mut strays = Strays::default();
        let mut take = |own: Strays| {
            strays = std::mem::take(&mut strays).and(own);
            Ok(())
        };
        let has_some = |part: usize| cores[part].is_some() || is_far(part);
        if (0..cores.len()).any(has_some) {
            rounds.each(&has_some, &look, &mut take)?;
        }
        Ok(strays)
    }
}
