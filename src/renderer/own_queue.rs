//! Pictures on a device of our own, submitted to its queue and waited for: what `render`, `view`,
//! `bench` and the Python package draw.
//!
//! Clouds, settings and frames are those of [`Renderer::record`]; only who submits differs.

use super::clouds::Entry;
use super::{Camera, CloudId, CloudState, Renderer, RendererOptions, picture};
use crate::cloud::attribute::DisplayAttribute;
use crate::error::{Error, Result};
use crate::gpu::DeviceOptions;
use crate::graph::{CompletedSubmission, Gpu, Graph, Pause};
use crate::passes::{encode, tile_stats};
use crate::progress::{Progress, Silent};
use crate::render::frame::{self, Outcome};
use crate::render::gpu_cloud::{Allowance, GpuCloud, PreparedCloud, SelectionReport};
use crate::render::scene::Scene;
use crate::render::settings::FrameConfig;
use crate::render::source::Source;
use crate::select::lod::Detail;
use crate::tune::Governor;
use crate::view::View;
use std::time::Duration;

/// A completed picture.
#[doc(hidden)]
pub struct Done<T> {
    /// The submission, with its downloads.
    pub frame: CompletedSubmission,
    /// The value that `ask` returned.
    pub asked: T,
    /// Warnings that only a completed frame can give.
    pub notes: Vec<String>,
}

impl Renderer {
    /// Opens a device for a renderer alone. Errors if there is none, or it lacks a feature.
    pub fn open_device(device: &DeviceOptions, options: RendererOptions) -> Result<Renderer> {
        Renderer::on(Gpu::open(device)?, options)
    }

    /// Returns the name of the device.
    pub fn device_name(&self) -> &str {
        &self.gpu.device.name
    }

    /// Waits until a cloud is on the device. Errors if it cannot be read, or memory is exhausted.
    pub fn wait(&mut self, cloud: CloudId) -> Result<()> {
        let place = self.place(cloud)?;
        if self.gpu.host.is_some() {
            return Err(Error::Request(
                "clouds on a host's device are uploaded with its frames; record some".into(),
            ));
        }
        loop {
            let entry = &mut self.clouds[place];
            let mut allowance = Allowance::of_frame();
            entry.advance(&mut self.gpu, self.options.memory_budget, &mut allowance)?;
            match entry.state() {
                CloudState::Ready => return Ok(()),
                CloudState::Failed(why) => return Err(Error::Request(why)),
                CloudState::Loading { .. } => std::thread::sleep(Duration::from_millis(1)),
                CloudState::Uploading => {}
            }
        }
    }

    /// Draws a picture of a cloud with all that the view calls for, and waits for it. Returns its
    /// pixels: red, green and blue as in a file, row by row from the top left.
    pub fn picture(&mut self, cloud: CloudId, camera: Camera, size: [u32; 2]) -> Result<Vec<u8>> {
        let transform = self.clouds[self.place(cloud)?].transform;
        let view = View::new(transform.camera(camera), size)?;
        let (mut settings, limits) = self.governed(size);
        settings.light = transform.light(settings.light);
        let place = self.governor.as_ref().map_or(0, Governor::place);
        self.load(cloud, &view, &limits.of(size), &Silent)?;
        let (_, own) = self.cloud(cloud)?;
        let config = picture::config(&settings, &view, own.resident());
        let done = self.draw(cloud, &view, &config, &Silent, |g, outcome| {
            encode::download(g, &outcome.picture)
        })?;
        self.took(place, done.frame.passes.iter().map(|(_, ms)| ms).sum());
        Ok(done.asked.read(&done.frame).concat())
    }
}

/// What the programs ask for besides: layers, parts of pictures, reports, progress.
#[doc(hidden)]
impl Renderer {
    /// Sets the device memory for nodes of indexes `[bytes]`.
    pub fn set_memory_budget(&mut self, bytes: u64) {
        self.options.memory_budget = bytes;
    }

    /// Adds files, which are uploaded whole, or an index, of which nothing is uploaded yet.
    pub fn add_source(
        &mut self,
        source: Source,
        shown: DisplayAttribute,
        progress: &dyn Progress,
    ) -> Result<CloudId> {
        let budget = self.options.memory_budget;
        let cloud = source.upload(&mut self.gpu, shown, budget, progress)?;
        let id = self.new_id();
        self.clouds.push(Entry::of_cloud(id, cloud));
        Ok(id)
    }

    /// Adds a prepared cloud; [`Renderer::upload_step`] uploads it.
    pub fn add_prepared(&mut self, prepared: PreparedCloud) -> CloudId {
        let id = self.new_id();
        self.clouds.push(Entry::of_prepared(id, prepared));
        id
    }

    /// Uploads some more of a prepared cloud. Returns whether more remains. Without success the
    /// cloud is removed.
    pub fn upload_step(&mut self, id: CloudId, progress: &dyn Progress) -> Result<bool> {
        let place = self.place(id)?;
        let (budget, mut allowance) = (self.options.memory_budget, Allowance::of_frame());
        let more = self.clouds[place].upload(&mut self.gpu, budget, &mut allowance, progress);
        if more.is_err() {
            self.clouds.remove(place);
        }
        more
    }

    /// Removes all clouds.
    pub fn remove_all(&mut self) {
        self.clouds.clear();
    }

    /// Sets all that a scene shows of clouds: settings, filters and colours.
    pub fn set_scene(&mut self, scene: &Scene) {
        self.set_settings(scene.settings.clone());
        self.set_filters(scene.opacities.clone(), scene.clips.clone());
        self.set_color_scale(scene.scale);
    }

    /// Returns the device, and an uploaded cloud with the renderer's filters and colours.
    pub fn cloud(&mut self, id: CloudId) -> Result<(&mut Gpu, &mut GpuCloud)> {
        let place = self.place(id)?;
        let Renderer { gpu, clouds, opacities, clips, scale, .. } = self;
        let map = clouds[place].transform.map;
        let cloud = clouds[place]
            .cloud_mut()
            .ok_or_else(|| Error::Request(format!("cloud {} is not on the device yet", id.0)))?;
        cloud.set_filters(opacities.clone(), clips.clone());
        cloud.set_scale(*scale);
        cloud.set_map(map);
        Ok((gpu, cloud))
    }

    /// Waits until all that a view shows of a cloud is resident; returns at once for files.
    pub fn load(
        &mut self,
        id: CloudId,
        view: &View,
        detail: &Detail,
        progress: &dyn Progress,
    ) -> Result<Option<SelectionReport>> {
        self.share_memory()?;
        let (gpu, cloud) = self.cloud(id)?;
        cloud.wait_until_resident(gpu, view, detail, progress)
    }

    /// Returns the configuration of a picture.
    pub fn config(&mut self, id: CloudId, view: &View) -> Result<FrameConfig> {
        let settings = self.settings.clone();
        let (_, cloud) = self.cloud(id)?;
        Ok(picture::config(&settings, view, cloud.resident()))
    }

    /// Draws a picture, or a part of one, and waits for it. `ask` requests downloads while it is
    /// recorded.
    pub fn draw<T>(
        &mut self,
        id: CloudId,
        view: &View,
        config: &FrameConfig,
        progress: &dyn Progress,
        ask: impl FnOnce(&mut Graph, &Outcome) -> Result<T>,
    ) -> Result<Done<T>> {
        self.draw_pausing(id, view, config, progress, None, ask)
    }

    /// Draws as [`Renderer::draw`]. A software device calls `pause` every few milliseconds; its
    /// error ends the call.
    pub fn draw_pausing<T>(
        &mut self,
        id: CloudId,
        view: &View,
        config: &FrameConfig,
        progress: &dyn Progress,
        pause: Option<&mut Pause>,
        ask: impl FnOnce(&mut Graph, &Outcome) -> Result<T>,
    ) -> Result<Done<T>> {
        let (gpu, cloud) = self.cloud(id)?;
        let mut g = Graph::new(gpu).with_progress(progress);
        let outcome = frame::record(&mut g, view, cloud.resident(), config)?;
        let asked = ask(&mut g, &outcome)?;
        let warned = tile_stats::Warned::ask(&mut g, &config.effects, &outcome.gbuffer);
        let submitted = match pause {
            Some(pause) => g.submit_pausing(&[], pause)?,
            None => g.submit_async(&[])?,
        };
        let frame = submitted.finish(gpu)?;
        let strokes = outcome.strokes.and_then(|painted| painted.facts.note());
        let notes = warned.note(&frame).into_iter().chain(strokes).collect();
        Ok(Done { frame, asked, notes })
    }
}
