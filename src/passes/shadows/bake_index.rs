//! Casts shadows of all points of an index into a file beside it, with bounded memory whatever the
//! size of the cloud.
//!
//! ```text
//!     as many samples of the light as their pictures fit half of the memory
//!         as many leaves at a time as fit the other half
//!             project                            points -> keys of every picture
//!         the same leaves again
//!             shadow_occupancy .. shadow_depth_limit, shadow_test
//!                                                points, limits -> visibility, added to earlier samples
//!     inner nodes, from the deepest level up     mean of the points that a sample stands for
//! ```
//! Leaves get the values of a frame with all leaves, except for their unit: the largest multiple of
//! a sample that fits a byte, so that means of inner nodes are finer than one sample.

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
use crate::passes::project::{self, Precision, Strip};
use crate::progress::Progress;
use crate::resident::Resident;
use crate::view::light::Light;
use std::path::Path;

/// Statistics of what was cast.
#[derive(Clone, Copy, Debug)]
pub struct Summary {
    pub facts: Facts,
    pub leaves: usize,
    /// Number of times that all leaves were read.
    pub readings: usize,
    /// Size of the file.
    pub bytes: u64,
}

/// A picture of the light with the keys of the points in it.
struct Picture {
    sight: LightCamera,
    keys: RawBuffer,
}

/// Casts shadows of all points of an index within `memory` bytes and writes them to `path`. Errors
/// for method=index, for an index without points, and if the file cannot be written.
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
            "shadows of an index are cast by comparing depths, not with method=index".into(),
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
    let wanted = cameras::Wanted::around(
        &room,
        bounds,
        Resident::spacing_of(index, &leaves)?,
        settings,
        light,
    );
    let bounds = wanted.bounds;
    let places =
        area_light_samples::spread(area_light_samples::places(samples, settings.pattern, 0));
    let views = places
        .iter()
        .map(|&place| cameras::cameras(light, &wanted, place))
        .collect::<Result<Vec<_>>>()?;
    let facts = Facts::new(&views[0], bounds, settings, room.unit_m());
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
    // Value of a point that one sample reaches.
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
        let counted = work.see(gpu, &mut room, &pictures, &mut done).and_then(|()| {
            work.count_samples(gpu, &mut room, &pictures, &mut done, |node, counts| {
                let mut sums =
                    if number == 0 { vec![0; counts.len()] } else { writer.get(node)? };
                // Two pictures of the light may count a point on their border.
                let scaled =
                    |sum: u8| if last { (sum as u32).min(samples) as u8 * unit as u8 } else { sum };
                sums.iter_mut().zip(counts).for_each(|(sum, count)| *sum = scaled(*sum + count));
                writer.put(node, &sums)
            })
        });
        drop(pictures);
        counted?;
    }
    writer.merge_inner_nodes(progress)?;
    let facts_json =
        serde_json::to_value(facts).map_err(|error| Error::Request(error.to_string()))?;
    let contents =
        ShadowContents { light: light.to_string(), full: unit * samples, facts: facts_json };
    let readings = if batches.len() == 1 { 1 } else { 2 * groups.len() };
    Ok(Summary { facts, leaves: leaves.len(), readings, bytes: writer.finish(&contents)? })
}

/// Groups samples, each with its pictures, so that their keys take at most `bytes`; at least one
/// sample per group.
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

/// Splits leaves into batches that fit the room and whose values fit one binding.
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
    /// Uploads a batch of leaves, unless it is resident.
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

    /// Projects the points of all leaves into all pictures.
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
                project::add(&mut g, view, &drawn, Strip { top: 0, size: view.size }, &mut keys);
                seen.push(keys.resource());
            }
            g.submit_and_wait(&seen)?;
        }
        Ok(())
    }

    /// Counts, for each point of all leaves, the samples of the pictures that reach it.
    fn count_samples(
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
            let mut light_visibility =
                g.buffer("light visibility", batch.len() as u64 * POINTS_PER_PAGE as u64);
            g.fill(&mut light_visibility, 0);
            for Picture { sight, keys } in pictures {
                let (keys, view) = (g.import("light keys", keys), &sight.view);
                let reached =
                    reach(&mut g, view, &keys, &Layer::of(sight, self.bounds, self.settings));
                let drawn = project::draw(&mut g, view, room, Precision::Auto)?;
                let all = drawn.all_shallow(&mut g);
                by_depth(&mut g, view, &drawn, &all, &reached.limit, &mut light_visibility);
            }
            let counts = g.download_buffer(&light_visibility);
            let frame = g.submit_and_wait(&[])?;
            let pages = frame.read::<u8>(&counts).chunks_exact(POINTS_PER_PAGE as usize);
            for (page, (&node, held)) in pages.zip(batch.iter().zip(&room.nodes)) {
                put(node, &page[..held.count as usize])?;
            }
        }
        Ok(())
    }
}
