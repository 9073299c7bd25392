//! Upload of a cloud in two halves: building nodes, which takes long and needs no device, on any
//! thread; and writing pages, a few at a time while frames are drawn.
//!
//! - [`CloudUpload::new`]: statistics of all points
//! - [`CloudUpload::build_nodes`]: nodes of one more part, and its strokes
//! - [`CloudUpload::upload_nodes`]: pages of some more nodes
//!
//! Pages are taken in node order, so that the result does not depend on how the halves interleave.

use super::pages::PAGE_BYTES;
use super::pool::Pool;
use super::{MOST_NODES, Resident, ResidentNode, in_metres};
use crate::cloud::attribute::{Attribute, DisplayAttribute, put, station_numbers};
use crate::cloud::crs::{Reference, Unit};
use crate::cloud::histograms::Histograms;
use crate::cloud::{self, Cloud, Columns, Lattice, Part, Station};
use crate::error::{Error, Result};
use crate::graph::Gpu;
use crate::index::attributes::axes;
use crate::index::attributes::exposure::{self, Values};
use crate::index::attributes::strokes::{self, StrokeCache};
use crate::index::build::pack::{self, Frame};
use crate::index::build::partition::PLACE_WORDS;
use crate::index::format::Axes;
use crate::index::format::Balance;
use crate::index::format::scatter;
use crate::index::format::spacing::spacing;
use crate::index::{self, Arrangement, Node, Partition, Row};
use crate::progress::{self, Progress};
use crate::select::clip::Clips;
use crate::select::opacity::Opacities;
use crate::view::linear_map::LinearMap;
use rayon::prelude::*;
use std::collections::VecDeque;
use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

/// A cloud being uploaded.
pub struct CloudUpload {
    shown: DisplayAttribute,
    stations: Vec<Station>,
    counts: Option<Histograms>,
    balance: Option<Balance>,
    axes: Axes,
    spacing_m: f64,
    points: u64,
    /// True if faces join the points of all parts.
    faces: bool,
    /// Unit of the coordinates.
    unit: Unit,
    /// Cache of strokes that were found before.
    found: Option<Arc<StrokeCache>>,
    /// Parts that are not partitioned yet, with their numbers.
    parts: VecDeque<(usize, Part)>,
    ready: VecDeque<Ready>,
    built_nodes: u64,
    built_points: u64,
    /// Nodes uploaded so far.
    resident: Option<Resident>,
}

/// A partitioned part that needs only pages.
struct Ready {
    lattice: Lattice,
    nodes: Vec<Node>,
    /// Frame of each node, and the station of its points if it is one.
    framed: Vec<(Frame, Option<u32>)>,
    rows: Box<dyn Rows>,
    /// Number of uploaded nodes.
    written: usize,
    /// True if faces join the points of all parts.
    faces: bool,
}

/// Points of nodes, with any number of words each.
trait Rows: Send + Sync {
    fn pack(&self, points: Range<usize>, frame: &Frame, pages: &mut [&mut [u32]]) -> Vec<u32>;
}

impl<const N: usize> Rows for Partition<N> {
    fn pack(&self, points: Range<usize>, frame: &Frame, pages: &mut [&mut [u32]]) -> Vec<u32> {
        pack::pack(&self.rows[points], frame, self.arrangement, pages)
    }
}

impl CloudUpload {
    pub fn new(
        cloud: Cloud,
        shown: DisplayAttribute,
        found: Option<Arc<StrokeCache>>,
    ) -> CloudUpload {
        let values = match shown.attribute {
            Attribute::Intensity => Values::of_intensities(shown.stretch[1]),
            _ => Values::Colors,
        };
        let (balance, points) =
            (shown.coded.then(|| exposure::balance_of(&cloud, &values)).flatten(), cloud.len());
        let counts = shown
            .further
            .kind
            .then(|| Histograms::of(cloud.parts.iter().map(|part| &part.columns)));
        let parts = cloud.parts.iter().map(|part| (&part.header, part.lattice));
        let unit = Reference::of(parts).unit();
        let faces = cloud::have_faces(cloud.parts.iter().map(|part| &part.header));
        let spacing_m = cloud::spacing::spacing(&cloud).unwrap_or(0.0);
        let axes = if shown.further.strokes { axes::of(&cloud.parts) } else { Axes::default() };
        let mut parts: VecDeque<(usize, Part)> = cloud.parts.into_iter().enumerate().collect();
        parts.iter_mut().for_each(|(_, part)| part.columns.keep(shown.wanted()));
        CloudUpload {
            shown,
            unit,
            stations: cloud.stations,
            spacing_m,
            counts,
            balance,
            axes,
            points,
            faces,
            found,
            parts,
            ready: VecDeque::new(),
            built_nodes: 0,
            built_points: 0,
            resident: None,
        }
    }

    pub fn points(&self) -> u64 {
        self.points
    }

    /// Builds the nodes of one more part; returns false if there is none.
    pub fn build_nodes(
        &mut self,
        arrangement: Arrangement,
        progress: &dyn Progress,
    ) -> Result<bool> {
        let Some((number, part)) = self.parts.pop_front() else {
            if let Some(found) = self.found.as_ref().filter(|_| self.shown.further.strokes) {
                found.retain_requested();
            }
            return Ok(false);
        };
        // Stations are listed part by part.
        let first = self.stations.partition_point(|station| station.part < number);
        let end = self.stations.partition_point(|station| station.part <= number);
        let stations = first..end;
        // Nodes need the stations that have no place in the words.
        let ready = match self.shown.words() + self.shown.omits_stations(&stations) as u32 {
            1 => self.organise::<4>(part, stations, arrangement, progress)?,
            2 => self.organise::<5>(part, stations, arrangement, progress)?,
            3 => self.organise::<6>(part, stations, arrangement, progress)?,
            4 => self.organise::<7>(part, stations, arrangement, progress)?,
            5 => self.organise::<8>(part, stations, arrangement, progress)?,
            // Saved light is that of indexes only.
            _ => self.organise::<9>(part, stations, arrangement, progress)?,
        };
        self.built_nodes += ready.nodes.len() as u64;
        self.built_points += ready.nodes.last().map_or(0, |node| node.points.end as u64);
        if self.built_nodes > MOST_NODES {
            return Err(Error::Request(format!(
                "{} points are more than the 4,294,901,760 that fit at once; index the files first",
                self.points
            )));
        }
        self.ready.push_back(ready);
        Ok(true)
    }

    /// Organises a part in rows of `N` words.
    fn organise<const N: usize>(
        &self,
        part: Part,
        stations: Range<usize>,
        arrangement: Arrangement,
        progress: &dyn Progress,
    ) -> Result<Ready> {
        let shown = self.shown;
        let painting = progress::Part { progress, done: self.built_points, total: self.points };
        let strokes = match &self.found {
            _ if !shown.further.strokes => Arc::default(),
            Some(found) => found.of(&part.columns, &part.lattice, &painting)?,
            None => Arc::new(strokes::words(&part.columns, &part.lattice, &painting)?),
        };
        let omitted = shown.omits_stations(&stations);
        let stations = (&self.stations[stations.clone()], stations.start);
        let Part { columns, lattice, .. } = part;
        let words = |columns: &Columns, points: Range<usize>, rows: &mut [Row<N>]| {
            let from = (columns, &lattice);
            shown.write_words(from, stations, points.clone(), rows, PLACE_WORDS);
            if let Some(place) = shown.strokes() {
                let at = PLACE_WORDS + place as usize;
                for (row, words) in rows.iter_mut().zip(&strokes[points.clone()]) {
                    row[at..at + 2].copy_from_slice(words);
                }
            }
            if omitted {
                let numbers = station_numbers(columns, stations, points);
                put(rows, N - 1, numbers.into_iter().map(|number| number as u32));
            }
        };
        let mut partition = index::partition(columns, &words, arrangement, &self.half(progress))?;
        let station = |row: &Row<N>| match omitted {
            true => Some(row[N - 1]),
            false => shown.station(&row[PLACE_WORDS..]),
        };
        let common_station = |rows: &[Row<N>]| match stations {
            ([], _) => None,
            ([_], first) => Some(first as u32),
            _ => station(&rows[0])
                .filter(|&first| rows.iter().all(|row| station(row) == Some(first))),
        };
        let of_node = |node: &Node| {
            let rows = &partition.rows[node.points.clone()];
            (pack::frame(rows), common_station(rows))
        };
        let framed = partition.nodes.par_iter().map(of_node).collect();
        let nodes = std::mem::take(&mut partition.nodes);
        Ok(Ready {
            lattice,
            nodes,
            framed,
            rows: Box::new(partition),
            written: 0,
            faces: self.faces,
        })
    }

    /// Uploads at most `most` nodes of the partitioned parts, whose pages fit in `room` `[bytes]`,
    /// from which they are taken. Returns whether some are left.
    pub fn upload_nodes(
        &mut self,
        gpu: &mut Gpu,
        most: usize,
        room: &mut u64,
        progress: &dyn Progress,
    ) -> Result<bool> {
        let Some(mut ready) = self.ready.pop_front() else { return Ok(false) };
        let half = progress::Part { progress, done: self.built_points, total: 2 * self.points };
        let written = ready.write(self.resident(gpu), gpu, (most, room), &half);
        if ready.written < ready.nodes.len() {
            self.ready.push_front(ready);
        }
        written.map(|()| !self.ready.is_empty())
    }

    /// Returns the number of points that are uploaded.
    pub fn uploaded(&self) -> u64 {
        self.resident.as_ref().map_or(0, |resident| resident.points)
    }

    /// Returns the pages of what is uploaded so far.
    pub fn pool_mut(&mut self) -> Option<&mut Pool> {
        self.resident.as_mut().map(|resident| &mut resident.pool)
    }

    /// Reports progress over both halves: every point is partitioned once and written once.
    fn half<'p>(&self, progress: &'p dyn Progress) -> progress::Part<'p> {
        progress::Part {
            progress,
            done: self.built_points + self.uploaded(),
            total: 2 * self.points,
        }
    }

    fn resident(&mut self, gpu: &mut Gpu) -> &mut Resident {
        self.resident.get_or_insert_with(|| {
            gpu.residents += 1;
            Resident {
                serial: gpu.residents,
                pool: Pool::new(gpu, u32::MAX),
                nodes: Vec::new(),
                shown: self.shown,
                points: 0,
                stations: self.stations.clone(),
                spacing_m: Some(self.spacing_m),
                counts: self.counts.take(),
                balance: self.balance.take(),
                // Normals of files are oriented.
                oriented: self.shown.further.normal,
                axes: self.axes,
                filtered: false,
                opacities: Opacities::default(),
                comes_and_goes: false,
                light: None,
                clips: Clips::default(),
                map: LinearMap::default(),
                unit: self.unit.clone(),
            }
        })
    }

    /// Returns the resident cloud, once everything is uploaded.
    pub fn finish(mut self, gpu: &mut Gpu) -> Resident {
        self.resident(gpu);
        self.resident.expect("made above")
    }
}

impl Ready {
    fn write(
        &mut self,
        resident: &mut Resident,
        gpu: &mut Gpu,
        (most, room): (usize, &mut u64),
        progress: &dyn Progress,
    ) -> Result<()> {
        let Ready { lattice, nodes: all, framed, rows, written, faces } = self;
        let (shown, first, faces) = (resident.shown, resident.nodes.len(), *faces);
        let bytes = |planes: u32| (planes + shown.words()) as u64 * PAGE_BYTES;
        let mut free = *room;
        let fits = |(frame, _): &&(Frame, Option<u32>)| {
            let left = free.checked_sub(bytes(frame.planes));
            free = left.unwrap_or(free);
            left.is_some()
        };
        let count = framed[*written..].iter().take(most).take_while(fits).count();
        let nodes = *written..*written + count;
        for (node, &(frame, station)) in all[nodes.clone()].iter().zip(&framed[nodes.clone()]) {
            let first_page = resident
                .pool
                .take(gpu, frame.planes + shown.words())?
                .expect("a pool without a budget is never full");
            let (count, number) = (node.points.len() as u32, resident.nodes.len() as u32);
            let (lattice, planes) = (*lattice, frame.planes);
            resident.nodes.push(ResidentNode {
                lattice,
                frame,
                count,
                number,
                first_page,
                planes,
                own_spacing: 0.0,
                map: LinearMap::default(),
                clumps: Arc::default(),
                station,
            });
        }
        let start = *written;
        *written = nodes.end;

        let runs = resident.nodes[first..]
            .iter_mut()
            .zip(&all[nodes])
            .map(|(node, range)| {
                (node.first_page, node.frame.planes + shown.words(), (node, range))
            })
            .collect();
        let done = AtomicU64::new(resident.points);
        let count = resident.pool.write(gpu, runs, |(node, range), mut pages| {
            let coarse = rows.pack(range.points.clone(), &node.frame, &mut pages);
            node.own_spacing = in_metres(spacing(&coarse), &node.lattice, &node.frame);
            node.clumps =
                scatter::clumps(&coarse, node.frame.bits, node.lattice.step, faces).into();
            let done = done.fetch_add(range.points.len() as u64, Relaxed);
            progress.tick("organising", done, 0)
        })?;
        resident.points = done.into_inner();
        let took = resident.nodes[first..first + count].iter().map(|node| bytes(node.planes));
        *room -= took.sum::<u64>();
        // The others are written when there is room.
        for node in resident.nodes.drain(first + count..) {
            resident.pool.pages.give(node.first_page, node.planes + shown.words());
        }
        *written = start + count;
        Ok(())
    }
}
