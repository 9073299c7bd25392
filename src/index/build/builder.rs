//! Options of a build, and the state that all its steps share.

use super::build_chunk::BuiltNode;
use super::point_record::Colors;
use super::spill_bucket::Spill;
use crate::cloud::histograms::Tally;
use crate::cloud::rgb_range::RgbRange;
use crate::cloud::scalar::Scalar;
use crate::cloud::stream::Source;
use crate::cloud::table::TextOptions;
use crate::cloud::{ColumnSet, ReadOptions};
use crate::config::INDEX_MEMORY;
use crate::index::format::samples::DerivedPlanes;
use crate::index::format::{Contents, IndexedPart, Writer};
use crate::index::merge::Gains;
use crate::progress::Progress;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};

/// Options of a build.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// Memory limit beside the program itself `[bytes]`.
    pub memory: u64,
    pub threads: usize,
    pub wanted: ColumnSet,
    /// True if truncated or inconsistent files are errors, instead of indexing what is readable.
    pub strict: bool,
    /// Options of text files.
    pub text: TextOptions,
    /// See [`ReadOptions::rgb_range`].
    pub rgb_range: Option<RgbRange>,
    /// Planes to derive.
    pub derive: DerivedPlanes,
}

impl Options {
    /// Returns default options with these read options, with GPS times or a scalar if they are
    /// wanted; a filter may need times.
    pub fn reading(read: &ReadOptions) -> Options {
        let usual = Options::usual(read.strict);
        let ColumnSet { gps_time, scalars, .. } = read.wanted;
        // Heights above ground are found when they are asked for.
        let is_kept = |own: &Scalar| !gps_time && *own != Scalar::HeightAboveGround;
        let scalars = scalars.iter().filter(is_kept).take(1).collect();
        let wanted = ColumnSet { gps_time, scalars, ..usual.wanted };
        Options { text: read.text, rgb_range: read.rgb_range, wanted, ..usual }
    }

    /// Returns the default options of `index`.
    pub fn usual(strict: bool) -> Options {
        let threads = std::thread::available_parallelism().map_or(1, usize::from);
        let wanted = ColumnSet { gps_time: false, ..ColumnSet::ALL };
        Options {
            memory: INDEX_MEMORY,
            threads,
            wanted,
            strict,
            text: TextOptions::NONE,
            rgb_range: None,
            derive: DerivedPlanes::NONE,
        }
    }
}

impl Options {
    /// Returns the most points of a chunk.
    pub(super) fn chunk_points(&self) -> u64 {
        let points = self.memory / 4 / self.threads as u64 / CHUNK_BYTES_PER_POINT;
        points.clamp(*CHUNK_POINTS.start(), Options::MOST_CHUNK_POINTS)
    }

    /// The most points of a chunk with any memory.
    pub(super) const MOST_CHUNK_POINTS: u64 = *CHUNK_POINTS.end();

    /// Returns the memory for buckets: what building chunks leaves, or a good part of the total if
    /// memory is short `[bytes]`.
    pub(super) fn bucket_bytes(&self) -> u64 {
        let chunks =
            2 * self.threads as u64 * self.chunk_points() * CHUNK_BYTES_PER_POINT + FIXED_BYTES;
        self.memory.saturating_sub(chunks).max(self.memory * 3 / 8)
    }
}

/// Bytes per point of a chunk that a thread needs: record, sorting, planes.
const CHUNK_BYTES_PER_POINT: u64 = 96;

/// Memory of the program, readers, and planes to be written `[bytes]`.
const FIXED_BYTES: u64 = 192 << 20;
const CHUNK_POINTS: std::ops::RangeInclusive<u64> = (1 << 17)..=(1 << 19);

/// Facts of files that are known before the first node is built.
pub(super) struct Survey<'a> {
    pub sources: &'a [Source],
    pub options: &'a Options,
    pub progress: &'a dyn Progress,
    pub spill: &'a Spill,
    pub contents: Contents,
    /// Parts by source number.
    pub parts: Vec<Option<IndexedPart>>,
    pub colors: Vec<Colors>,
    /// Histogram of intensities.
    pub intensities: Vec<u64>,
    /// Histogram of the brightest channels of colours.
    pub tones: Vec<u64>,
    pub tally: Tally,
    /// Corner of the tree of every lattice `[steps]`.
    pub corners: Vec<[i64; 3]>,
    /// Station numbers by part and source.
    pub numbers: BTreeMap<(u16, u16), u16>,
    pub gains: Option<Arc<Gains>>,
}

impl<'a> Survey<'a> {
    pub fn new(
        sources: &'a [Source],
        options: &'a Options,
        progress: &'a dyn Progress,
        spill: &'a Spill,
        contents: Contents,
    ) -> Survey<'a> {
        Survey {
            sources,
            options,
            progress,
            spill,
            contents,
            parts: vec![None; sources.len()],
            colors: vec![Colors::Bytes; sources.len()],
            intensities: vec![0; 1 << 16],
            tones: vec![0; 256],
            tally: Tally::default(),
            corners: Vec::new(),
            numbers: BTreeMap::new(),
            gains: None,
        }
    }
}

/// Nodes being built and written.
pub(super) struct Builder<'a> {
    pub survey: Survey<'a>,
    pub writer: &'a Writer,
    /// End of the planes written so far.
    pub end: u64,
    pub nodes: Vec<BuiltNode>,
    pub roots: Vec<u32>,
    /// Roots of trees of strays.
    pub far_roots: Vec<u32>,
}

impl<'a> Builder<'a> {
    pub fn new(survey: Survey<'a>, writer: &'a Writer) -> Builder<'a> {
        Builder {
            survey,
            writer,
            end: Writer::START,
            nodes: Vec::new(),
            roots: Vec::new(),
            far_roots: Vec::new(),
        }
    }
}

pub(super) fn lock<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(|poisoned| poisoned.into_inner())
}
