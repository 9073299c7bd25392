//! Clouds on their way into device memory, and there.

use crate::cloud::attribute::DisplayAttribute;
use crate::cloud::color_scale::ColorScale;
use crate::config::UPLOAD_BYTES;
use crate::error::Result;
use crate::graph::Gpu;
use crate::index::format::Index;
use crate::network::{Traffic, traffic};
use crate::progress::Progress;
use crate::resident::pool::Pool;
use crate::resident::{CloudUpload, Residency, Resident, streaming::Update};
use crate::select::clip::{Clip, Clips};
use crate::select::lod::Detail;
use crate::select::opacity::Opacities;
use crate::view::View;
use crate::view::linear_map::LinearMap;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// A source ready for upload.
pub enum PreparedCloud {
    Files(Box<CloudUpload>),
    Index(Arc<Index>, Box<DisplayAttribute>),
}

/// Longest upload of a frame: half of 33 ms.
const STEP: Duration = Duration::from_millis(16);

/// What a frame may still upload, of all clouds together.
pub struct Allowance {
    pub bytes: u64,
    until: Instant,
}

impl Allowance {
    /// Returns that of a frame that begins.
    pub fn of_frame() -> Allowance {
        Allowance { bytes: UPLOAD_BYTES, until: Instant::now() + STEP }
    }
}

impl PreparedCloud {
    pub fn points(&self) -> u64 {
        match self {
            PreparedCloud::Files(upload) => upload.points(),
            PreparedCloud::Index(index, _) => index.directory.contents.points,
        }
    }

    /// Uploads some of it, as far as is allowed. Returns whether more remains, and how much was
    /// uploaded `[bytes]`.
    pub fn step(
        &mut self,
        gpu: &mut Gpu,
        allowance: &mut Allowance,
        progress: &dyn Progress,
    ) -> Result<(bool, u64)> {
        let PreparedCloud::Files(upload) = self else { return Ok((false, 0)) };
        let (mut before, room_before) = (upload.uploaded(), allowance.bytes);
        let mut remains = true;
        while remains && Instant::now() < allowance.until {
            let room = &mut allowance.bytes;
            remains = upload.upload_nodes(gpu, gpu.workers.count(), room, progress)?;
            // Without progress, room comes with a later frame.
            if std::mem::replace(&mut before, upload.uploaded()) == upload.uploaded() {
                break;
            }
        }
        Ok((remains, room_before - allowance.bytes))
    }

    /// Returns the pages of what is uploaded so far.
    pub fn pool_mut(&mut self) -> Option<&mut Pool> {
        match self {
            PreparedCloud::Files(upload) => upload.pool_mut(),
            PreparedCloud::Index(..) => None,
        }
    }

    /// Completes the upload.
    pub fn finish(self, gpu: &mut Gpu, pool_bytes: u64) -> Result<GpuCloud> {
        Ok(match self {
            PreparedCloud::Files(upload) => GpuCloud::Whole(Box::new(upload.finish(gpu))),
            PreparedCloud::Index(index, shown) => {
                GpuCloud::Parts(Box::new(Residency::open(gpu, index, *shown, pool_bytes)?))
            }
        })
    }
}

/// A cloud in device memory.
pub enum GpuCloud {
    Whole(Box<Resident>),
    Parts(Box<Residency>),
}

/// The selection and reads of a picture of an index, for `--explain`.
#[derive(Clone, Debug, serde::Serialize)]
pub struct SelectionReport {
    pub nodes: usize,
    pub points: u64,
    pub nodes_outside: usize,
    pub nodes_clipped: usize,
    /// Infinite, and null in JSON, if the camera is within a node that is not refined.
    pub largest_error_px: f64,
    pub budget: u64,
    pub lod_px: f64,
    pub bytes_read: u64,
    pub index_bytes: u64,
    /// What was fetched from servers so far; none if the index is a file.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub network: Option<Traffic>,
    pub pool_bytes: u64,
    pub pool_used_bytes: u64,
    /// Unreadable nodes, and a pool that is too small.
    pub notes: Vec<String>,
}

impl GpuCloud {
    /// Waits until all that the view shows is resident; returns at once for a whole cloud.
    pub fn wait_until_resident(
        &mut self,
        gpu: &mut Gpu,
        view: &View,
        detail: &Detail,
        progress: &dyn Progress,
    ) -> Result<Option<SelectionReport>> {
        let GpuCloud::Parts(residency) = self else { return Ok(None) };
        let Update { cut, budget, bytes_read, errors: mut notes, .. } =
            residency.wait_until_resident(gpu, view, detail, progress)?;
        let [pool_bytes, pool_used_bytes] = residency.pool_bytes();
        if budget < detail.budget {
            let pool = pool_bytes >> 20;
            notes.push(format!(
                "the pool of {pool} MiB holds only {} points of this view; --gpu-memory makes it larger",
                cut.points
            ));
        }
        Ok(Some(SelectionReport {
            nodes: cut.nodes.len(),
            points: cut.points,
            nodes_outside: cut.nodes_outside,
            nodes_clipped: cut.nodes_clipped,
            largest_error_px: cut.largest_error_px,
            budget,
            lod_px: detail.lod_px,
            bytes_read,
            index_bytes: residency.index().bytes(),
            network: residency.index().is_remote().then(traffic),
            pool_bytes,
            pool_used_bytes,
            notes,
        }))
    }

    pub fn resident(&self) -> &Resident {
        match self {
            GpuCloud::Whole(resident) => resident,
            GpuCloud::Parts(residency) => residency.resident(),
        }
    }

    /// Returns its pages.
    pub fn pool_mut(&mut self) -> &mut Pool {
        match self {
            GpuCloud::Whole(resident) => resident.pool_mut(),
            GpuCloud::Parts(residency) => residency.resident_mut().pool_mut(),
        }
    }

    /// Sets how numbers and channels become colours.
    pub fn set_scale(&mut self, scale: ColorScale) {
        match self {
            GpuCloud::Whole(resident) => resident.shown.scale = scale,
            GpuCloud::Parts(residency) => residency.resident_mut().shown.scale = scale,
        }
    }

    /// Sets what the cloud is drawn through.
    pub fn set_map(&mut self, map: LinearMap) {
        match self {
            GpuCloud::Whole(resident) => resident.set_map(map),
            GpuCloud::Parts(residency) => residency.resident_mut().set_map(map),
        }
    }

    /// Sets opacities and clip boxes.
    pub fn set_filters(&mut self, opacities: Opacities, mut clips: Clips) {
        let resident = match self {
            GpuCloud::Whole(resident) => resident,
            GpuCloud::Parts(residency) => {
                clips.0.extend(residency.index().hidden.iter().flat_map(Clip::around));
                residency.resident_mut()
            }
        };
        (resident.opacities, resident.clips) = (opacities, clips);
    }
}

impl std::fmt::Display for SelectionReport {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let share = 100.0 * self.bytes_read as f64 / self.index_bytes.max(1) as f64;
        writeln!(
            f,
            "cut: {} points of {} nodes, {} nodes left out (outside of the view); largest projected error {:.3} px (--lod {}, --point-budget {})",
            self.points,
            self.nodes,
            self.nodes_outside,
            self.largest_error_px,
            self.lod_px,
            self.budget
        )?;
        match self.network {
            None => writeln!(f, "read: {} bytes, {share:.2} % of the file", self.bytes_read)?,
            Some(Traffic { requests, bytes }) => {
                writeln!(
                    f,
                    "fetched: {bytes} bytes in {requests} requests; the rest was in the cache"
                )?;
            }
        }
        writeln!(
            f,
            "pool: {} MiB in use of {} MiB at most",
            self.pool_used_bytes >> 20,
            self.pool_bytes >> 20
        )
    }
}
