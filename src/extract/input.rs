//! Files or an index as batches of points, with those that are left.

use super::Selection;
use crate::cloud::crs::Reference;
use crate::cloud::filter::{Compiled, Filter};
use crate::cloud::ground::{self, Surface};
use crate::cloud::histograms::{CLASSES, RETURNS};
use crate::cloud::las::Las;
use crate::cloud::rgb_range::Scale;
use crate::cloud::scalar::{Scalar, Scalars};
use crate::cloud::stream::{self, Source, Streamed};
use crate::cloud::up::Up;
use crate::cloud::{Cloud, ColumnSet, Columns, Header, Lattice, ReadOptions, Station};
use crate::error::{Error, Result};
use crate::index::format::Index;
use crate::progress::Progress;
use crate::select::clip::Clips;
use crate::select::opacity::Opacities;
use crate::select::slab::Slab;
use glam::DVec3;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Mutex;

/// Leaves of an index that are in memory at a time, for each thread.
const LEAVES: usize = 4;

/// Files, or an index.
pub enum Input {
    Files {
        sources: Vec<Source>,
        parts: Vec<Part>,
        notes: Vec<String>,
        /// Ground from which heights count, if these are wanted.
        ground: Option<Surface>,
    },
    Index {
        index: Box<Index>,
        parts: Vec<Part>,
        notes: Vec<String>,
    },
}

/// Points on one lattice.
pub struct Part {
    pub path: PathBuf,
    /// The scan's own name within its file, if any.
    pub name: Option<String>,
    /// Name of the file or scan.
    pub title: String,
    /// Lattice on which points are drawn, filtered and clipped.
    pub lattice: Lattice,
    /// Lattice of the file itself: another one if its coordinates are angles.
    pub own: Lattice,
    pub available: ColumnSet,
    pub intensity_range: [f64; 2],
    pub rgb_scale: Scale,
    pub header: Header,
    /// World corners of its points, by the file's header, on its own lattice.
    pub bounds: Option<(DVec3, DVec3)>,
}

/// Outcome of reading.
pub struct Read {
    pub notes: Vec<String>,
    /// Summaries of the files, or scans of files, that were read; none of an index. Their notes are
    /// above.
    pub streamed: Vec<Streamed>,
}

/// Points of a part.
pub struct Batch<'b> {
    pub part: usize,
    pub columns: &'b Columns,
    /// Coordinates count from here `[lattice steps]`.
    pub shift: [i64; 3],
    /// The points as records of their LAS file; empty for other inputs.
    pub records: &'b [u8],
    /// LAS point source id of each value of [`Columns::source`]; `None` if these are ids.
    pub ids: Option<&'b [u16]>,
    /// Numbers of the points that are left.
    pub left: Vec<u32>,
}

impl Batch<'_> {
    /// Returns the coordinates of a point `[lattice steps]`.
    pub fn steps(&self, i: usize) -> [i64; 3] {
        let Columns { x, y, z, .. } = self.columns;
        let own = [x[i], y[i], z[i]];
        [0, 1, 2].map(|axis| own[axis] as i64 + self.shift[axis])
    }

    /// Returns the LAS point source id of a point; 0 if it has none.
    pub fn source(&self, i: usize) -> u16 {
        let stored = self.columns.source.as_ref().map_or(0, |column| column[i]);
        self.ids.map_or(stored, |ids| ids.get(stored as usize).copied().unwrap_or(0))
    }
}

impl Input {
    /// Opens files with all of their attributes, or one index.
    pub fn open(
        paths: &[PathBuf],
        options: &ReadOptions,
        progress: &dyn Progress,
    ) -> Result<Input> {
        let above = options.wanted.scalars.has(Scalar::HeightAboveGround);
        if let [path] = paths
            && Index::is_one(path)
        {
            let mut index = Box::new(Index::open(path)?);
            let note = if above { index.find_ground(progress)? } else { None };
            let parts = parts_of(&index);
            return Ok(Input::Index { index, parts, notes: note.into_iter().collect() });
        }
        let mut notes = Vec::new();
        let sources = stream::open(paths, options, progress, &mut notes)?;
        let mut parts: Vec<Part> = sources.iter().map(Part::of).collect();
        let ground =
            if above { Surface::of(&Streams { sources: &sources, progress })? } else { None };
        if let Some(ground) = &ground {
            notes.push(ground.note());
            let above = Scalars::from_iter([Scalar::HeightAboveGround]);
            let own = parts.iter_mut().map(|part| &mut part.available.scalars);
            own.for_each(|scalars| *scalars = scalars.and(above));
        }
        Ok(Input::Files { sources, parts, notes, ground })
    }

    /// Returns a cloud that was read whole.
    pub fn of_cloud(cloud: Cloud) -> Input {
        let sources: Vec<Source> = cloud.parts.into_iter().map(Source::of_part).collect();
        let parts = sources.iter().map(Part::of).collect();
        Input::Files { sources, parts, notes: Vec::new(), ground: None }
    }

    pub fn parts(&self) -> &[Part] {
        match self {
            Input::Files { parts, .. } | Input::Index { parts, .. } => parts,
        }
    }

    /// Returns the unit, the digits and the coordinate system of all parts.
    pub fn reference(&self) -> Reference {
        Reference::of(self.parts().iter().map(|part| (&part.header, part.lattice)))
    }

    pub fn is_index(&self) -> bool {
        matches!(self, Input::Index { .. })
    }

    /// Returns the LAS file of a part.
    pub fn las(&self, part: usize) -> Option<&Las> {
        match self {
            Input::Files { sources, .. } => sources[part].las(),
            Input::Index { .. } => None,
        }
    }

    /// Returns whether the points of a part have to be decompressed each time.
    pub fn is_compressed(&self, part: usize) -> bool {
        self.las(part).is_some_and(|las| las.layout.compressed)
    }

    /// Returns the number of points, by the headers of files.
    pub fn points(&self) -> u64 {
        match self {
            Input::Files { sources, .. } => sources.iter().map(Source::points).sum(),
            Input::Index { index, .. } => index.directory.contents.points,
        }
    }

    /// Returns the lower corner `[lattice steps]` and the number of points of a part, by the header
    /// of its file.
    pub fn stated(&self, part: usize) -> Option<([i32; 3], u64)> {
        match self {
            Input::Files { sources, .. } => {
                let [low, _] = sources[part].stated_bounds()?;
                Some((low, sources[part].points()))
            }
            Input::Index { .. } => None,
        }
    }

    /// Reads only these columns of files from now on.
    pub fn narrow(&mut self, wanted: ColumnSet) {
        if let Input::Files { sources, .. } = self {
            sources.iter_mut().for_each(|source| source.narrow(wanted));
        }
    }

    fn available(&self) -> ColumnSet {
        self.parts().iter().fold(ColumnSet::default(), |set, part| set.and(part.available))
    }

    /// Errors if a filter looks at an attribute that no point has.
    pub fn check(&self, filter: &Filter) -> Result<()> {
        match self {
            Input::Index { index, .. } => index.compile(filter).map(drop),
            Input::Files { .. } => filter
                .check(self.available(), &|_| "`pointillist info` lists their attributes".into()),
        }
    }

    /// Maps every batch on all threads, and calls `take` with the results in order. Returns notes.
    pub fn each<T: Send>(
        &self,
        selection: &Selection,
        progress: &dyn Progress,
        map: &(dyn Fn(&Batch) -> Result<T> + Sync),
        take: &mut (dyn FnMut(T) -> Result<()> + Send),
    ) -> Result<Vec<String>> {
        Ok(self.read(&|_| true, selection, progress, map, take)?.notes)
    }

    /// Maps the batches of the files, or scans of files, that are wanted.
    pub fn read<T: Send>(
        &self,
        wants: &dyn Fn(usize) -> bool,
        selection: &Selection,
        progress: &dyn Progress,
        map: &(dyn Fn(&Batch) -> Result<T> + Sync),
        take: &mut (dyn FnMut(T) -> Result<()> + Send),
    ) -> Result<Read> {
        let (clips, slab, parts) = (&selection.clips, selection.slab, self.parts());
        match self {
            Input::Files { sources, notes, ground, .. } => {
                let opaque = Opaque::of_files(&selection.opacities, sources, progress)?;
                let mut read = Read { notes: notes.clone(), streamed: Vec::new() };
                for (part, source) in sources.iter().enumerate().filter(|(part, _)| wants(*part)) {
                    let filter = &selection.filter.compile_for(
                        source.path(),
                        source.name(),
                        parts[part].intensity_range,
                        source.available().source,
                    );
                    let chosen = Chosen { filter, clips, slab, opaque: &opaque };
                    let lattice = &parts[part].lattice;
                    let each = |&stream::Batch { columns, records, .. }: &stream::Batch| {
                        let shift = [0; 3];
                        let above = ground.as_ref().map(|ground| {
                            let above = ground.column(ground::Batch {
                                columns,
                                lattice,
                                shift,
                                corner: [0; 3],
                            });
                            let scalars = columns.scalars.iter().cloned().chain([above]).collect();
                            Columns { scalars, ..columns.clone() }
                        });
                        let columns = above.as_ref().unwrap_or(columns);
                        let left = chosen.left(Some(part), columns, lattice, shift);
                        map(&Batch { part, columns, shift, records, ids: None, left })
                    };
                    let mut streamed = source.stream_in_order(progress, &each, take)?;
                    read.notes.append(&mut streamed.notes);
                    read.streamed.push(streamed);
                }
                Ok(read)
            }
            Input::Index { index, notes, .. } => {
                let contents = &index.directory.contents;
                let opaque = Opaque::of(&selection.opacities, &contents.stations, Vec::new())?;
                let filter = &index.compile(&selection.filter)?;
                let chosen = Chosen { filter, clips, slab, opaque: &opaque };
                let id = |station: &Station| station.source.unwrap_or(0);
                let ids: Vec<u16> = contents.stations.iter().map(id).collect();
                let wanted = index.available();
                let of_leaf = |&leaf: &usize| {
                    let record = &index.nodes()[leaf];
                    let columns = &index.columns(leaf, wanted)?;
                    let (part, shift) = (record.lattice as usize / 2, record.origin);
                    let left = chosen.left(None, columns, &parts[part].lattice, shift);
                    map(&Batch { part, columns, shift, records: &[], ids: Some(&ids), left })
                };
                let all = 0..index.nodes().len();
                let is_asked = |&node: &usize| {
                    let record = &index.nodes()[node];
                    let meets = |slab: Slab| slab.meets(index.bounds(record));
                    record.is_leaf() && slab.is_none_or(meets)
                };
                let leaves: Vec<usize> = all.filter(is_asked).collect();
                let points = |leaves: &[usize]| -> u64 {
                    leaves.iter().map(|&leaf| index.nodes()[leaf].points).sum()
                };
                let title = parts.first().map_or("the index", |part| &part.title);
                let (doing, mut done, total) = (format!("reading {title}"), 0, points(&leaves));
                for leaves in leaves.chunks(LEAVES * rayon::current_num_threads()) {
                    let mapped: Vec<T> = leaves.par_iter().map(of_leaf).collect::<Result<_>>()?;
                    mapped.into_iter().try_for_each(&mut *take)?;
                    done += points(leaves);
                    progress.tick(&doing, done, total)?;
                }
                Ok(Read { notes: notes.clone(), streamed: Vec::new() })
            }
        }
    }
}

impl Part {
    fn of(source: &Source) -> Part {
        Part {
            path: source.path().to_owned(),
            name: source.name().map(str::to_owned),
            title: source.title(),
            lattice: source.lattice(),
            own: source.own_lattice(),
            available: source.available(),
            intensity_range: source.intensity_range(),
            rgb_scale: source.rgb_scale(),
            header: source.header().clone(),
            bounds: source.stated_bounds().map(|bounds| source.own_lattice().world_box(bounds)),
        }
    }
}

/// Returns a part for every tree of an index: its leaves are on the lattice of their files.
fn parts_of(index: &Index) -> Vec<Part> {
    let contents = &index.directory.contents;
    let first = contents.parts.first();
    let ColumnSet { gps_time: has_times, scalars, .. } = index.available();
    let of_tree = |(tree, lattices): (usize, &[[DVec3; 2]])| {
        let [step, offset] = lattices[0];
        let own = Lattice { step, offset };
        let nodes = index.nodes().iter().filter(|node| node.lattice as usize / 2 == tree);
        let available = nodes.fold(ColumnSet::default(), |set, node| set.and(node.available()));
        Part {
            path: index.path().to_owned(),
            name: None,
            title: index.path().file_name().unwrap_or_default().to_string_lossy().into_owned(),
            lattice: own,
            own,
            available: ColumnSet {
                gps_time: available.gps_time && has_times,
                scalars,
                ..available
            },
            intensity_range: first.map_or([0.0, 65535.0], |part| part.intensity_range),
            rgb_scale: Scale::default(),
            header: Header {
                system: index.reference().system,
                facts: first.map_or(Vec::new(), |part| part.header.facts.clone()),
                ..Header::default()
            },
            bounds: contents.bounds.map(|[lo, hi]| (lo, hi)),
        }
    };
    contents.lattices.chunks(2).enumerate().map(of_tree).collect()
}

/// Files as points among which the ground is found.
struct Streams<'s> {
    sources: &'s [Source],
    progress: &'s dyn Progress,
}

impl ground::Points for Streams<'_> {
    fn count(&self) -> u64 {
        self.sources.iter().map(Source::points).sum()
    }

    fn each(&self, sink: &(dyn Fn(ground::Batch) + Sync)) -> Result<()> {
        for source in self.sources.iter().filter(|source| !source.header().strays) {
            let lattice = &source.lattice();
            let corner = source.stated_bounds().map_or([0; 3], |[low, _]| low);
            source.stream(self.progress, &|batch| {
                let columns = batch.columns;
                sink(ground::Batch { columns, lattice, shift: [0; 3], corner });
                Ok(())
            })?;
        }
        Ok(())
    }

    fn up(&self) -> Up {
        Up::Z
    }

    fn reference(&self) -> Reference {
        let headers = self.sources.iter().map(|source| (source.header(), source.lattice()));
        Reference::of(headers)
    }
}

/// A selection for the points of a part.
struct Chosen<'c> {
    filter: &'c Compiled,
    clips: &'c Clips,
    slab: Option<Slab>,
    opaque: &'c Opaque,
}

impl Chosen<'_> {
    fn has_all(&self) -> bool {
        let Chosen { filter, clips, slab, opaque } = self;
        filter.has_all() && clips.active() == 0 && slab.is_none() && opaque.factors.is_empty()
    }

    /// Returns the numbers of the points that are left. `part` is `None` for an index, whose
    /// points have station numbers.
    fn left(
        &self,
        part: Option<usize>,
        columns: &Columns,
        lattice: &Lattice,
        shift: [i64; 3],
    ) -> Vec<u32> {
        if self.has_all() {
            return (0..columns.len() as u32).collect();
        }
        let left = self.filter.left(columns, lattice, shift);
        let clips = (self.clips.active() > 0).then_some(self.clips);
        let is_left = |i: usize| {
            let place = || {
                let own = [columns.x[i], columns.y[i], columns.z[i]];
                lattice.world([0, 1, 2].map(|axis| own[axis] as i64 + shift[axis]))
            };
            left[i]
                && clips.is_none_or(|clips| clips.keep(place()))
                && self.slab.is_none_or(|slab| slab.place(place()).is_some())
                && self.opaque.has(part, columns, i)
        };
        (0..columns.len()).filter(|&i| is_left(i)).map(|i| i as u32).collect()
    }
}

/// Which kinds of points have an opacity above 0.
struct Opaque {
    /// Factors as [`Opacities::table`]; empty without rules.
    factors: Vec<f32>,
    /// Part and source id of every station of files, if rules name stations.
    stations: Vec<(usize, Option<u16>)>,
}

impl Opaque {
    fn of(
        opacities: &Opacities,
        stations: &[Station],
        places: Vec<(usize, Option<u16>)>,
    ) -> Result<Opaque> {
        if opacities.0.is_empty() {
            return Ok(Opaque { factors: Vec::new(), stations: places });
        }
        if let Some(lost) = opacities.lost(stations) {
            return Err(Error::Request(format!("--opacity: {lost}")));
        }
        Ok(Opaque { factors: opacities.table(stations), stations: places })
    }

    /// Reads the stations of all points first, if rules name stations.
    fn of_files(
        opacities: &Opacities,
        sources: &[Source],
        progress: &dyn Progress,
    ) -> Result<Opaque> {
        if !opacities.name_stations() {
            return Opaque::of(opacities, &[], Vec::new());
        }
        let mut stations = Vec::new();
        for (part, source) in sources.iter().enumerate() {
            let counts = Mutex::new(BTreeMap::<Option<u16>, u64>::new());
            source.stream(progress, &|batch| {
                let mut counts = counts.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
                match &batch.columns.source {
                    Some(ids) => {
                        ids.iter().for_each(|id| *counts.entry(Some(*id)).or_default() += 1)
                    }
                    None => *counts.entry(None).or_default() += batch.columns.len() as u64,
                }
                Ok(())
            })?;
            let counts = counts.into_inner().unwrap_or_else(|poisoned| poisoned.into_inner());
            let title = source.title();
            stations.extend(counts.into_iter().map(|(source, points)| Station {
                part,
                source,
                name: source.map_or(title.clone(), |id| format!("{title} source {id}")),
                points,
            }));
        }
        let places = stations.iter().map(|station| (station.part, station.source)).collect();
        Opaque::of(opacities, &stations, places)
    }

    fn has(&self, part: Option<usize>, columns: &Columns, i: usize) -> bool {
        if self.factors.is_empty() {
            return true;
        }
        let byte =
            |column: &Option<Vec<u8>>| column.as_ref().map_or(0, |column| column[i] as usize);
        let source = columns.source.as_ref().map(|column| column[i]);
        let station = match part {
            None => source.unwrap_or(0) as usize,
            Some(part) => self.stations.binary_search(&(part, source)).unwrap_or(0),
        };
        let number = byte(&columns.returns) & 15;
        [byte(&columns.class), CLASSES + number, CLASSES + RETURNS + station]
            .iter()
            .all(|&at| self.factors[at] > 0.0)
    }
}
