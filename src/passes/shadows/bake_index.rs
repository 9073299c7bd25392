//! An INDEX and a light in, marks of all of its points out: in a file beside it, with as much memory as it is told, however large the cloud.
//!
//! ```text
//!     some samples of the light, as many as their pictures fit half of the memory
//!         leaves, as many at a time as fit the other half       project: points -> keys of every picture
//!         the same leaves again                                 light_cover .. light_limit, then shadow_depth: points, limits -> marks, which are added to those of the samples before
//!     inner nodes, from the deepest level up                    of every sample the mean of the points that it stands for
//! ```
//! Marks of leaves are those that a frame with all leaves makes, but for their unit: as large a multiple of a sample as a byte holds, so that means of inner nodes are finer than a sample.

use super::cameras::LightCamera;
use super::{Facts, Layer, Method, Settings, area_light_samples, by_depth, cameras, reach};
use crate::config::POINTS_PER_PAGE;
use crate::error::{Error, Result};
use crate::gpu::memory::RawBuffer;
use crate::gpu::{BufferDesc, Place};
use crate::graph::{Gpu, Graph, Handle};
use crate::index::attributes::shadow_writer::ShadowWriter;
use crate::index::format::Index;
use crate::index::format::shadow_file::ShadowContents;
use crate::passes::project::{self, Band, Precision};
use crate::progress::Progress;
use crate::resident::Resident;
use crate::view::light::Light;
use std::path::Path;

/// What was made.
#[derive(Clone, Copy, Debug)]
pub struct Summary {
    pub facts: Facts,
    pub leaves: usize,
    /// How often all leaves were read.
    pub readings: usize,
    /// Of the file.
    pub bytes: u64,
}

/// A picture that the light sees, and the keys of the points that are in it.
struct Picture {
    sight: LightCamera,
    keys: RawBuffer,
}

/// Casts shadows of all points of an index, within so many bytes, and writes what they leave of the light beside it.
pub fn cast(
    gpu: &mut Gpu,
    index: &Index,
    light: Light,
    settings: &Settings,
    memory: u64,
    path: &Path,
    progress: &dyn Progress,
) -> Result<Summary> {
    if settings.method == Method::Index {
        return Err(Error::Request(
            "shadows of a whole index are cast by comparing depths; leave out method=index".into(),
        ));
    }
    let leaves: Vec<usize> =
        (0..index.nodes().len()).filter(|&node| index.nodes()[node].is_leaf()).collect();
    let bounds = leaves
        .iter()
        .map(|&leaf| index.bounds(&index.nodes()[leaf]))
        .reduce(|(a, b), (c, d)| (a.min(c), b.max(d)));
    let Some(bounds) = bounds else {
        return Err(Error::Request(format!(
            "{} has no points to cast shadows",
            index.path().display()
        )));
    };
    let writer = ShadowWriter::create(path, index)?;
    let samples = settings.samples as u32;
    let mut room = Resident::room(gpu, index, memory / 2);
    let wanted =
        cameras::Wanted::around(&room, bounds, Resident::spacing_of(index, &leaves)?, settings);
    let bounds = wanted.bounds;
    let places =
        area_light_samples::spread(area_light_samples::places(samples, settings.pattern, 0));
    let views = places
        .iter()
        .map(|&place| cameras::cameras(light, &wanted, place))
        .collect::<Result<Vec<_>>>()?;
    let facts = Facts::new(&views[0], bounds, settings);
    let groups = groups(&views, memory / 2);
    let batches = batches(&room, index, &leaves, gpu.device.limits.max_storage_buffer_range as u64);
    let work = Work {
        index,
        settings,
        bounds,
        batches: &batches,
        total: 2 * (groups.len() * batches.len()) as u64,
        progress,
    };
    // What a point has that all of the light reaches.
    let unit = 255 / samples;
    let mut done = 0;
    for (number, group) in groups.iter().enumerate() {
        let mut pictures = Vec::new();
        for &sight in group.iter().flatten() {
            let size = sight.view.size;
            let desc =
                BufferDesc { bytes: 8 * size[0] as u64 * size[1] as u64, place: Place::Device };
            pictures
                .push(Picture { sight, keys: gpu.memory.buffer(&gpu.device, desc, "light keys")? });
        }
        let last = number + 1 == groups.len();
        let marked = work.see(gpu, &mut room, &pictures, &mut done).and_then(|()| {
            work.mark(gpu, &mut room, &pictures, &mut done, |node, counts| {
                let mut sums =
                    if number == 0 { vec![0; counts.len()] } else { writer.get(node)? };
                // On the border of two of the light's pictures both may count a point.
                let scaled =
                    |sum: u8| if last { (sum as u32).min(samples) as u8 * unit as u8 } else { sum };
                sums.iter_mut().zip(counts).for_each(|(sum, count)| *sum = scaled(*sum + count));
                writer.put(node, &sums)
            })
        });
        pictures.into_iter().for_each(|picture| gpu.memory.recycle_buffer(picture.keys));
        marked?;
    }
    room.free(gpu);
    writer.merge_inner_nodes(progress)?;
    let facts_json =
        serde_json::to_value(facts).map_err(|error| Error::Request(error.to_string()))?;
    let contents =
        ShadowContents { light: light.to_string(), full: unit * samples, facts: facts_json };
    let readings = if batches.len() == 1 { 1 } else { 2 * groups.len() };
    Ok(Summary { facts, leaves: leaves.len(), readings, bytes: writer.finish(&contents)? })
}

/// Samples of the light, each with the pictures that it sees the cloud in; as many at a time as their keys take so many bytes, and at least one.
fn groups(views: &[Vec<LightCamera>], bytes: u64) -> Vec<&[Vec<LightCamera>]> {
    let of = |sights: &Vec<LightCamera>| {
        sights
            .iter()
            .map(|LightCamera { view, .. }| 8 * view.size[0] as u64 * view.size[1] as u64)
            .sum::<u64>()
    };
    let (mut groups, mut first, mut taken) = (Vec::new(), 0, 0);
    for (i, sample) in views.iter().enumerate() {
        if i > first && taken + of(sample) > bytes {
            groups.push(&views[first..i]);
            (first, taken) = (i, 0);
        }
        taken += of(sample);
    }
    groups.push(&views[first..]);
    groups
}

/// Leaves that are in the room at a time, whose marks one binding holds.
fn batches(room: &Resident, index: &Index, leaves: &[usize], binding: u64) -> Vec<Vec<usize>> {
    let (mut batches, mut rest) = (Vec::new(), leaves);
    let most = (binding / POINTS_PER_PAGE as u64).max(1) as usize;
    while !rest.is_empty() {
        let (batch, further) = rest.split_at(room.fitting(index, &rest[..rest.len().min(most)]));
        batches.push(batch.to_vec());
        rest = further;
    }
    batches
}

struct Work<'w> {
    index: &'w Index,
    settings: &'w Settings,
    bounds: (glam::DVec3, glam::DVec3),
    batches: &'w [Vec<usize>],
    total: u64,
    progress: &'w dyn Progress,
}

impl Work<'_> {
    /// Brings some leaves, where they are not there.
    fn bring(
        &self,
        gpu: &mut Gpu,
        room: &mut Resident,
        batch: &[usize],
        done: &mut u64,
    ) -> Result<()> {
        self.progress.tick("casting shadows", *done, self.total)?;
        *done += 1;
        if self.batches.len() == 1 && !room.nodes.is_empty() {
            return Ok(());
        }
        room.hold(gpu, self.index, batch)
    }

    /// Points of all leaves -> keys of all pictures.
    fn see(
        &self,
        gpu: &mut Gpu,
        room: &mut Resident,
        pictures: &[Picture],
        done: &mut u64,
    ) -> Result<()> {
        for (number, batch) in self.batches.iter().enumerate() {
            self.bring(gpu, room, batch, done)?;
            let mut g = Graph::new(gpu);
            let mut seen = Vec::new();
            for Picture { sight: LightCamera { view, .. }, keys } in pictures {
                let mut keys = g.import("light keys", keys);
                if number == 0 {
                    g.fill(&mut keys, u32::MAX);
                }
                let drawn = project::draw(&mut g, view, room, Precision::Auto)?;
                project::add(&mut g, view, &drawn, Band { top: 0, size: view.size }, &mut keys);
                seen.push(keys.resource());
            }
            g.submit_and_wait(&seen)?.recycle(gpu);
        }
        Ok(())
    }

    /// How many of the pictures' samples reach each point of all leaves.
    fn mark(
        &self,
        gpu: &mut Gpu,
        room: &mut Resident,
        pictures: &[Picture],
        done: &mut u64,
        mut put: impl FnMut(usize, &[u8]) -> Result<()>,
    ) -> Result<()> {
        for batch in self.batches {
            self.bring(gpu, room, batch, done)?;
            let mut g = Graph::new(gpu);
            let mut marks = g.buffer("marks", batch.len() as u64 * POINTS_PER_PAGE as u64);
            g.fill(&mut marks, 0);
            for Picture { sight, keys } in pictures {
                let (keys, view) = (g.import("light keys", keys), &sight.view);
                let reached =
                    reach(&mut g, view, &keys, &Layer::of(sight, self.bounds, self.settings));
                let drawn = project::draw(&mut g, view, room, Precision::Auto)?;
                let all = drawn.all_shallow(&mut g);
                by_depth(&mut g, view, &drawn, &all, &reached.limit, &mut marks);
            }
            let counts = g.download_buffer(&marks);
            let frame = g.submit_and_wait(&[])?;
            let pages = frame.read::<u8>(&counts).chunks_exact(POINTS_PER_PAGE as usize);
            for (page, (&node, held)) in pages.zip(batch.iter().zip(&room.nodes)) {
                put(node, &page[..held.count as usize])?;
            }
            frame.recycle(gpu);
        }
        Ok(())
    }
}
