//! Plans: cut the index of a survey into jobs that know nothing of each other.
//!
//! ```text
//! plan     reads all files once: lattices, boxes, stations, gains, and how many points each cell of
//!          a grid has; cuts every tree into the largest kd-cells with at most that many points
//! job      reads the files with points in its cells, and builds their nodes into a part (`job`)
//! merge    places the parts in their order, and joins the nodes that they left open (`job`)
//! ```
//!
//! Nodes depend on their points alone, and all else that they depend on is in the plan. So the
//! index has the same bytes as one that is built at once, however many jobs there are, wherever
//! they run and however often.

use super::Options;
use super::build_chunk::{TreeLayout, TreeSpec};
use super::builder::Survey;
use super::ingest::{self, Collector, Ingested, cells_of, group, largest};
use super::kd_cell::KdCell;
use super::point_record::{Batch, Colors, Layout};
use super::spill_bucket::{Sorter, Spill};
use crate::atomic_file::write_atomically;
use crate::cloud::input::Input;
use crate::cloud::rgb_range::RgbRange;
use crate::cloud::table::TextOptions;
use crate::cloud::{ColumnSet, Lattice};
use crate::error::{Error, Result};
use crate::index::format::samples::{Cell, DerivedPlanes};
use crate::index::format::{Contents, morton};
use crate::progress::Progress;
use crate::small_file::{MANY_PICTURES, read_text};
use glam::DVec3;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

const VERSION: u32 = 1;

/// What the jobs of an index have in common.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Plan {
    version: u32,
    /// Hash of all else, which parts name.
    pub(super) hash: String,
    pub files: Vec<PlannedFile>,
    reading: Reading,
    /// The description of the finished index.
    pub(super) contents: Contents,
    /// Parts whose colours are all 0.
    black: Vec<bool>,
    /// Corner of the tree of every lattice `[steps]`.
    pub(super) corners: Vec<[i64; 3]>,
    pub(super) trees: Vec<PlannedTree>,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PlannedFile {
    pub path: PathBuf,
    bytes: u64,
}

/// How files are read.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct Reading {
    wanted: ColumnSet,
    strict: bool,
    delimiter: Option<String>,
    columns: Option<String>,
    scalar: Option<String>,
    rgb_range: Option<RgbRange>,
    derive: DerivedPlanes,
}

/// A tree of files on one lattice.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct PlannedTree {
    pub members: Vec<Member>,
    step: DVec3,
    offset: DVec3,
    has: ColumnSet,
    derive: DerivedPlanes,
    corner: [i64; 3],
    bits: u32,
    lattice_number: u16,
    pub is_of_strays: bool,
    pub jobs: Vec<PlannedJob>,
}

/// A part of a tree.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Member {
    pub part: usize,
    pub shift: [i64; 3],
    /// The box around its points, on the tree's lattice; `None` without points.
    pub bounds: Option<[Cell; 2]>,
}

impl Member {
    /// Returns a box of its points on the tree's lattice.
    pub fn on_tree(&self, bounds: [[i32; 3]; 2], kind: &TreeSpec) -> [Cell; 2] {
        ingest::on_tree(bounds, self.shift, kind.corner)
    }
}

/// Consecutive cells, with their numbers of points.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(super) struct PlannedJob {
    pub cells: Vec<(KdCell, u64)>,
}

impl PlannedJob {
    pub fn points(&self) -> u64 {
        self.cells.iter().map(|(_, points)| points).sum()
    }
}

/// Most cells of a job: each takes 3 MiB of memory while points are read.
const MOST_CELLS: usize = 32;

/// A summary of a plan.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct PlanSummary {
    pub jobs: usize,
    pub points: u64,
    /// Points of the largest job.
    pub most_points: u64,
}

/// Numbers of points of the cells of a grid, in Morton order.
struct Counts {
    shift: u32,
    points: Vec<AtomicU64>,
}

impl Counts {
    /// Most cells per axis, as a power of two: 16 MiB of numbers.
    const LEVELS: u32 = 7;

    fn new(bits: u32) -> Counts {
        let levels = bits.min(Counts::LEVELS);
        let points = (0..1 << (3 * levels)).map(|_| AtomicU64::new(0)).collect();
        Counts { shift: bits - levels, points }
    }
}

impl Collector for Counts {
    fn add(&self, batch: &Batch, _: &mut Sorter) -> Result<()> {
        let number = |q: &Cell| morton::code_63(q.map(|v| v >> self.shift)) as usize;
        for run in batch.cells.chunk_by(|a, b| number(a) == number(b)) {
            self.points[number(&run[0])].fetch_add(run.len() as u64, Relaxed);
        }
        Ok(())
    }
}

/// Plans the index of files: jobs of at most `job_points` points, as far as a grid of 2^7 cells per
/// axis can tell them apart. Writes the plan.
pub fn plan(
    paths: &[PathBuf],
    output: &Path,
    options: &Options,
    job_points: u64,
    progress: &dyn Progress,
) -> Result<PlanSummary> {
    super::with_threads(options, |options| {
        let files = paths.iter().map(|path| PlannedFile::of(path)).collect::<Result<_>>()?;
        let (sources, contents) = super::open(paths, options, progress)?;
        let spill = Spill::new(output, 0)?;
        let mut survey = Survey::new(&sources, options, progress, &spill, contents);
        // A chunk has to fit into a job.
        let job_points = job_points.max(Options::MOST_CHUNK_POINTS);
        let trees = group(&sources)
            .into_iter()
            .map(|group| survey.ingest(group, &|bits, _| Counts::new(bits)))
            .collect::<Result<Vec<_>>>()?;
        survey.settle(trees.iter().map(|(ingested, _)| (ingested, ())), stream_again)?;
        let trees = trees.into_iter().filter(|(ingested, _)| ingested.points > 0);
        let trees = trees.map(|(ingested, counts)| {
            let is_of_strays = ingested.is_of_strays(&sources);
            PlannedTree::new(ingested, counts, is_of_strays, job_points)
        });
        let mut plan = Plan {
            version: VERSION,
            hash: String::new(),
            files,
            reading: Reading::of(options),
            trees: trees.collect(),
            black: survey.colors.iter().map(|colors| *colors == Colors::Black).collect(),
            corners: survey.corners,
            contents: survey.contents,
        };
        plan.hash = plan.hashed()?;
        write_atomically(output, |partial| {
            std::fs::write(partial, plan.text()?).map_err(|error| Error::io("write", output, error))
        })?;
        Ok(plan.summary())
    })
}

/// Passes the records of a tree to a function, read from its files once more.
fn stream_again(
    survey: &Survey,
    ingested: &Ingested,
    (): (),
    look: &(dyn Fn(&[u8]) + Sync),
) -> Result<()> {
    let Ingested { group, tree: TreeLayout { kind, layout }, .. } = ingested;
    for &(number, shift) in &group.members {
        survey.sources[number].stream(survey.progress, &|batch| {
            let (mut cells, columns) = (Vec::new(), batch.columns);
            cells_of(columns, shift, kind.corner, &mut cells);
            let slots: Vec<u32> = (0..cells.len() as u32).collect();
            let mut records = vec![0; cells.len() * layout.bytes];
            let batch = Batch { cells: &cells, columns, part: number as u16 };
            layout.write(&mut records, &slots, &batch);
            look(&records);
            Ok(())
        })?;
    }
    Ok(())
}

impl PlannedFile {
    fn of(path: &Path) -> Result<PlannedFile> {
        Ok(PlannedFile { path: path.to_owned(), bytes: Input::open(path)?.length })
    }
}

impl Reading {
    fn of(options: &Options) -> Reading {
        let Options { wanted, strict, text, rgb_range, derive, .. } = *options;
        Reading {
            wanted,
            strict,
            delimiter: text.delimiter.map(|delimiter| delimiter.to_string()),
            columns: text.columns.map(|columns| columns.to_string()),
            scalar: text.scalar.map(str::to_owned),
            rgb_range,
            derive,
        }
    }

    fn options(&self, memory: u64, threads: usize) -> std::result::Result<Options, String> {
        let Reading { wanted, strict, rgb_range, derive, .. } = *self;
        let text = TextOptions {
            delimiter: self.delimiter.as_deref().map(str::parse).transpose()?,
            columns: self.columns.as_deref().map(str::parse).transpose()?,
            // Lives as long as the process, as a name of the command line does.
            scalar: self.scalar.clone().map(|name| &*name.leak()),
        };
        Ok(Options { memory, threads, wanted, strict, text, rgb_range, derive })
    }
}

impl PlannedTree {
    fn new(ingested: Ingested, counts: Counts, is_of_strays: bool, job_points: u64) -> PlannedTree {
        let Ingested { group, tree: TreeLayout { kind, .. }, boxes, .. } = ingested;
        let levels = kind.bits - counts.shift;
        let counts: Vec<u64> = counts.points.into_iter().map(AtomicU64::into_inner).collect();
        let starts: Vec<u64> = std::iter::once(0)
            .chain(counts.iter().scan(0, |sum, points| {
                *sum += points;
                Some(*sum)
            }))
            .collect();
        let mut ranges = Vec::new();
        largest(&starts, 0..counts.len(), job_points, &mut ranges);
        let mut jobs: Vec<PlannedJob> = Vec::new();
        for range in ranges {
            let (open, points) =
                (range.len().trailing_zeros(), starts[range.end] - starts[range.start]);
            let prefix = (range.start >> open) as u128;
            let has_room = |job: &PlannedJob| {
                job.points() + points <= job_points && job.cells.len() < MOST_CELLS
            };
            if !jobs.last().is_some_and(has_room) {
                jobs.push(PlannedJob::default());
            }
            let cell = KdCell { depth: 3 * levels - open, prefix };
            jobs.last_mut().expect("made above").cells.push((cell, points));
        }
        let members = group.members.iter().zip(boxes);
        PlannedTree {
            members: members
                .map(|(&(part, shift), bounds)| Member { part, shift, bounds })
                .collect(),
            step: kind.lattice.step,
            offset: kind.lattice.offset,
            has: kind.has,
            derive: kind.derive,
            corner: kind.corner,
            bits: kind.bits,
            lattice_number: kind.lattice_number,
            is_of_strays,
            jobs,
        }
    }

    pub fn bits(&self) -> u32 {
        self.bits
    }

    /// Returns the cells of all jobs, in order.
    pub fn cells(&self) -> impl Iterator<Item = KdCell> {
        self.jobs.iter().flat_map(|job| &job.cells).map(|(cell, _)| *cell)
    }

    /// Returns what its nodes have in common, without gains.
    pub fn layout(&self) -> TreeLayout {
        let parts: Vec<u16> = self.members.iter().map(|member| member.part as u16).collect();
        let PlannedTree { step, offset, has, derive, corner, bits, lattice_number, .. } = *self;
        let kind = TreeSpec {
            has,
            derive,
            corner,
            bits,
            lattice: Lattice { step, offset },
            lattice_number,
            gains: None,
        };
        TreeLayout { layout: Layout::new(has, bits, &parts), kind }
    }
}

impl Plan {
    /// Reads a plan. Errors if it is damaged, or of another version.
    pub fn read(path: &Path) -> Result<Plan> {
        let text = read_text(path, MANY_PICTURES)?;
        let wrong = |error: String| {
            Error::format(
                path,
                format!(
                    "is no plan of an index ({error}); make one with `pointillist index FILE... --plan {}`",
                    path.display()
                ),
            )
        };
        let plan: Plan = serde_json::from_str(&text).map_err(|error| wrong(error.to_string()))?;
        plan.check().map_err(wrong)?;
        Ok(plan)
    }
}

impl Plan {
    fn text(&self) -> Result<String> {
        serde_json::to_string_pretty(self).map_err(|error| Error::Request(error.to_string()))
    }

    /// Returns the hash of all but the hash.
    fn hashed(&self) -> Result<String> {
        let text = Plan { hash: String::new(), ..self.clone() }.text()?;
        Ok(blake3::hash(text.as_bytes()).to_hex().to_string())
    }

    /// Returns what contradicts what, if anything.
    fn check(&self) -> std::result::Result<(), String> {
        let Plan { version, hash, contents, black, corners, trees, .. } = self;
        if *version != VERSION {
            return Err(format!("its version is {version}; this pointillist has {VERSION}"));
        }
        if self.hashed().map_err(|error| error.to_string())? != *hash {
            return Err("it was changed after it was made".into());
        }
        let parts = contents.parts.len();
        let fits = |tree: &PlannedTree| {
            let PlannedTree { members, bits, lattice_number, jobs, .. } = tree;
            let cells: Vec<KdCell> = tree.cells().collect();
            (1..=32).contains(bits)
                && members.iter().all(|member| member.part < parts)
                && (*lattice_number as usize) + 1 < contents.lattices.len()
                && jobs.iter().all(|job| (1..=MOST_CELLS).contains(&job.cells.len()))
                && cells.iter().all(|cell| cell.depth <= 3 * bits && KdCell::ALL.has(cell))
                && cells.is_sorted_by(|a, b| a.is_before(*b))
        };
        let is_whole = black.len() == parts
            && corners.len() == contents.lattices.len()
            && contents.stations.iter().all(|station| station.part < parts)
            && trees.iter().all(fits);
        if is_whole { Ok(()) } else { Err("its parts contradict each other".into()) }
    }

    /// Returns all jobs with their trees, in order.
    pub(super) fn jobs(&self) -> impl Iterator<Item = (&PlannedTree, &PlannedJob)> {
        self.trees.iter().flat_map(|tree| tree.jobs.iter().map(move |job| (tree, job)))
    }

    pub fn summary(&self) -> PlanSummary {
        PlanSummary {
            jobs: self.jobs().count(),
            points: self.contents.points,
            most_points: self.jobs().map(|(_, job)| job.points()).max().unwrap_or(0),
        }
    }

    /// Returns options that read files as planned.
    pub(super) fn options(&self, memory: u64, threads: usize) -> Result<Options> {
        self.reading.options(memory, threads).map_err(Error::Request)
    }

    /// Errors if a file has another length than when it was planned.
    pub(super) fn check_files(&self) -> Result<()> {
        let same = |file: &PlannedFile| match PlannedFile::of(&file.path)? == *file {
            true => Ok(()),
            false => Err(changed(&file.path)),
        };
        self.files.iter().try_for_each(same)
    }

    /// Gives a survey what has been found of all files.
    pub(super) fn adopt(&self, survey: &mut Survey) {
        let colors = |&black: &bool| if black { Colors::Black } else { Colors::Bytes };
        survey.colors = self.black.iter().map(colors).collect();
        survey.corners = self.corners.clone();
        survey.numbers = (0..)
            .zip(&self.contents.stations)
            .map(|(number, station)| {
                ((station.part as u16, station.source.unwrap_or_default()), number)
            })
            .collect();
        survey.balance();
    }
}

/// Returns the error of a file that is not the one that was planned.
pub(super) fn changed(path: &Path) -> Error {
    Error::format(path, "has changed since the index was planned; plan it again")
}

/// Returns the path of the part that a job makes, beside its plan.
pub fn part_path(plan: &Path, number: usize) -> PathBuf {
    plan.with_extension(format!("{number}.part"))
}
