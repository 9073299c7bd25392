//! What all steps of a build work on, and how it is to be built.

use super::build_chunk::BuiltNode;
use super::point_record::Colors;
use super::spill_bucket::Spill;
use crate::cloud::color::RgbRange;
use crate::cloud::histograms::Tally;
use crate::cloud::stream::Source;
use crate::cloud::table::TextOptions;
use crate::cloud::{ColumnSet, ReadOptions};
use crate::config::INDEX_MEMORY;
use crate::index::format::merge::Gains;
use crate::index::format::samples::DerivedPlanes;
use crate::index::format::{Contents, IndexedPart, Writer};
use crate::progress::Progress;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};

/// How to build.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// Bytes, beside the program itself.
    pub memory: u64,
    pub threads: usize,
    pub wanted: ColumnSet,
    /// Refuse files that are cut off or lie, instead of indexing what is readable.
    pub strict: bool,
    /// How text files are read.
    pub text: TextOptions,
    /// As [`ReadOptions::rgb_range`].
    pub rgb_range: Option<RgbRange>,
    /// What is found out of the points beside what the files say.
    pub derive: DerivedPlanes,
}

impl Options {
    /// As `index` does it when nothing is asked for but how to read.
    pub fn reading(read: &ReadOptions) -> Options {
        Options { text: read.text, rgb_range: read.rgb_range, ..Options::usual(read.strict) }
    }

    /// As `index` does it when nothing is asked for.
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
    /// The most points that a chunk may have.
    pub(super) fn chunk_points(&self) -> u64 {
        let points = self.memory / 4 / self.threads as u64 / CHUNK_BYTES_PER_POINT;
        points.clamp(*CHUNK_POINTS.start(), *CHUNK_POINTS.end())
    }

    /// What buckets may take: what growing chunks leaves, and where memory is short a good part of it.
    pub(super) fn bucket_bytes(&self) -> u64 {
        let chunks = 2 * self.threads as u64 * self.chunk_points() * CHUNK_BYTES_PER_POINT + BESIDE;
        self.memory.saturating_sub(chunks).max(self.memory * 3 / 8)
    }
}

/// Bytes that a thread needs for each point of the chunk it grows: record, sorting, planes.
const CHUNK_BYTES_PER_POINT: u64 = 96;

/// The program, what readers hold, what waits to be written.
const BESIDE: u64 = 192 << 20;
const CHUNK_POINTS: std::ops::RangeInclusive<u64> = (1 << 17)..=(1 << 19);

pub(super) struct Builder<'a> {
    pub sources: &'a [Source],
    pub options: &'a Options,
    pub progress: &'a dyn Progress,
    pub writer: &'a Writer,
    pub spill: &'a Spill,
    pub contents: Contents,
    /// By the numbers of their sources.
    pub parts: Vec<Option<IndexedPart>>,
    pub colors: Vec<Colors>,
    pub intensities: Vec<u64>,
    pub tally: Tally,
    /// Of the planes written so far.
    pub end: u64,
    pub nodes: Vec<BuiltNode>,
    pub roots: Vec<u32>,
    /// The same of trees of strays.
    pub far_roots: Vec<u32>,
    /// Of every lattice, where its tree starts, steps.
    pub corners: Vec<[i64; 3]>,
    /// Of the stations, by part and source.
    pub numbers: BTreeMap<(u16, u16), u16>,
    pub gains: Option<Arc<Gains>>,
}

pub(super) fn lock<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(|poisoned| poisoned.into_inner())
}
