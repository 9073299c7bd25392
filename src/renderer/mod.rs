//! A renderer inside another application: it records into the host's command buffers.
//!
//! The host makes instance and device, submits, presents, and owns all images. The renderer has no
//! queue: it submits nothing and waits for nothing. With each frame the host says its number and
//! the last one that the device has completed, so that nothing is freed earlier.
//!
//! ```text
//! Renderer::new(host)            once, on the host's device
//! open, add_points               clouds, loaded on a thread
//! loop: record(commands, frame)  uploads, pictures, and what the host asked for
//!       the host submits
//! drop                           after the device has completed all frames
//! ```
//!
//! Recording clobbers pipelines, descriptor sets, push constants, viewport and scissor of the
//! command buffer; it must be outside of rendering. Calls that may wait for the disk or another
//! thread: dropping a renderer, and removing a cloud that is still being read.
//!
//! All handles are raw numbers, so that hosts need not share our version of a Vulkan crate.

#![deny(missing_docs)]

mod clouds;
mod compose;
mod device_points;
mod explain;
mod governed;
mod host;
mod own_queue;
mod picture;
mod projection;
mod restored;
mod words;

pub use clouds::{CloudId, CloudState, OpenSettings};
pub use compose::{Area, Targets};
pub use device_points::PointBuffer;
pub use host::{Access, Encoding, Host, Requirement, Target, check, enable_features, requirements};
#[doc(hidden)]
pub use own_queue::Done;
pub use projection::{Matrices, ViewCamera};

pub use crate::cloud::color_scale::{ColorScale, Ramp};
pub use crate::cloud::points::{Points, Positions};
pub use crate::config::NO_POINT;
pub use crate::error::{Error, Result};
pub use crate::render::settings::RenderSettings;
pub use crate::select::clip::Clips;
pub use crate::select::opacity::Opacities;
pub use crate::tune::Limit;
pub use crate::view::{Camera, Preset, Projection};

use crate::cloud::filter::Filter;
use crate::config::UPLOAD_BYTES;
use crate::gpu::memory::{Block, RawBuffer, RawImage};
use crate::gpu::{ImageDesc, TestOverrides};
use crate::graph::Gpu;
use crate::passes::Switch;
use crate::render::gpu_cloud::Allowance;
use crate::resident::pages::BLOCK_BYTES;
use crate::select::lod::LodOptions;
use crate::tune::Governor;
use crate::view::View;
use ash::vk::{self, Handle as _};
use clouds::{Entry, Reading};
use compose::{ColorTable, Drawn, Placement};
use glam::DVec3;
use picture::{Drawing, Key, RecordedPicks, RecordedPicture};
use projection::{Depth, Transform, view_of};
use std::collections::VecDeque;
use std::path::PathBuf;
use std::sync::Arc;

/// A view of a frame.
#[derive(Clone, Copy, Debug)]
pub struct FrameView {
    /// Where it is seen from.
    pub camera: ViewCamera,
    /// Where it is drawn in the targets.
    pub area: Area,
}

/// A frame of the host.
#[derive(Clone, Copy, Debug)]
pub struct Frame<'f> {
    /// Number of the frame; each is greater than the one before, and all are above 0.
    pub number: u64,
    /// Last frame that the device has completed; 0 if none.
    pub safe: u64,
    /// Images to draw into.
    pub targets: Targets,
    /// Views that are drawn, in order.
    pub views: &'f [FrameView],
}

/// What a recorded frame shows.
#[derive(Clone, Debug, Default)]
pub struct FrameReport {
    /// True if all points that the views call for are drawn: nothing is being read or uploaded.
    pub settled: bool,
    /// Points drawn in all views.
    pub points: u64,
    /// Nodes of indexes that are missing, or coarser than the views call for.
    pub missing: usize,
    /// Data of clouds that has come to the device since the last frame `[bytes]`: at most 32 MiB of
    /// files and points, and as much of indexes, for all views together.
    pub streamed: u64,
    /// Decisions on each effect, and their reasons, for the first view of the first cloud.
    pub effects: Vec<EffectReport>,
    /// Problems that left something out: unreadable nodes, a cloud that could not be drawn.
    pub errors: Vec<String>,
}

/// Decision on an effect, and its reason.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct EffectReport {
    /// Name as on the command line.
    pub name: &'static str,
    /// True if it runs.
    pub runs: bool,
    /// The reason.
    pub why: String,
}

/// A point that was picked.
#[derive(Clone, Debug, PartialEq)]
pub struct PickedPoint {
    /// Cloud of the point.
    pub cloud: CloudId,
    /// Position in the host's world.
    pub world: DVec3,
    /// Position in the cloud's own coordinates.
    pub position: DVec3,
    /// True if the position is the file's own, to the last bit; if not, the centre of its cell.
    pub exact: bool,
    /// Number of the point, as the ids of its frame have it; `None` if the pixel shows no single
    /// one.
    pub id: Option<u32>,
    /// ASPRS class of that point, 0 if it has none.
    pub class: Option<u8>,
    /// Number of its return, 0 if it has none.
    pub return_number: Option<u8>,
    /// Name of the file or station that it is from.
    pub station: Option<String>,
    /// Colour that it is drawn with before lighting and exposure, 8-bit sRGB.
    pub color: Option<[u8; 3]>,
    /// Number that it is coloured by: its intensity, class, or source as in the file; its elevation
    /// `[m]`, time `[s]` or scalar within 1/65,535 of the cloud's range. `None` of colours and
    /// normals.
    pub value: Option<f64>,
    /// Planar depth `[m]`: in the cloud's units, or in the world's if its transform is no
    /// similarity.
    pub depth: f64,
}

/// A requested pick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PickId(pub u64);

/// State of a pick.
#[derive(Clone, Debug, PartialEq)]
pub enum Picked {
    /// It is answered when the device has completed a frame recorded after the request.
    Pending,
    /// There is no point in the pixel.
    Nothing,
    /// The point.
    Point(PickedPoint),
}

/// Options of a renderer.
#[derive(Clone, Copy, Debug)]
pub struct RendererOptions {
    /// Device memory for nodes of indexes, which share it equally `[bytes]`.
    pub memory_budget: u64,
    /// Most points drawn of an index; by the size of the view if `None`.
    pub point_budget: Option<u64>,
    /// What tests pretend.
    #[doc(hidden)]
    pub overrides: TestOverrides,
}

impl Default for RendererOptions {
    fn default() -> RendererOptions {
        RendererOptions {
            memory_budget: crate::config::POOL_BYTES,
            point_budget: None,
            overrides: TestOverrides::default(),
        }
    }
}

/// What a frame uses until the device has completed it.
struct HeldFrame {
    number: u64,
    pictures: Vec<Arc<RecordedPicture>>,
    /// Place on the front that it was drawn with.
    place: usize,
    /// True if its recording failed, or the host does not submit it: it is never drawn.
    is_dropped: bool,
    /// Number of the last submission before it.
    before: u64,
    /// Picks that it answers, and their pixels in the targets.
    wanted_picks: Vec<(PickId, [u32; 2])>,
    _removed: Vec<Entry>,
    blocks: Vec<Block>,
    copies: Vec<RawBuffer>,
}

impl HeldFrame {
    /// Returns the pictures that it recorded and that are drawn.
    fn drawn(&self) -> impl Iterator<Item = &RecordedPicture> {
        self.pictures
            .iter()
            .map(|picture| &**picture)
            .filter(|picture| picture.frame == self.number && !self.is_dropped)
    }

    /// Returns the picks that it answers.
    fn picks(&self) -> impl Iterator<Item = PickId> {
        let picks = self.drawn().filter_map(|picture| picture.picks.as_ref());
        picks.flat_map(|picks| &picks.pixels).map(|(pick, _)| *pick)
    }
}

/// Time of a pass of a completed frame.
#[derive(Clone, Debug, PartialEq)]
pub struct PassTime {
    /// Name of the pass.
    pub name: String,
    /// Device time `[ms]`.
    pub milliseconds: f64,
}

/// Draws clouds into a host's images; see the module. It is dropped after the device has completed
/// all frames.
pub struct Renderer {
    settings: RenderSettings,
    opacities: Opacities,
    clips: Clips,
    /// Filter of clouds that are added.
    filter: Filter,
    lod: LodOptions,
    scale: ColorScale,
    options: RendererOptions,
    /// The choice of settings for a time or an error; None without one.
    governor: Option<Governor>,
    clouds: Vec<Entry>,
    removed: Vec<Entry>,
    held: VecDeque<HeldFrame>,
    /// Pictures of the last frame, by view and cloud.
    latest: Vec<Arc<RecordedPicture>>,
    revision: u64,
    /// Depth between clouds, where the host gives none.
    own_depth: Option<(RawImage, Block)>,
    next_cloud: u64,
    next_pick: u64,
    wanted_picks: Vec<(PickId, [u32; 2])>,
    answers: Vec<(PickId, Option<PickedPoint>)>,
    times: Vec<PassTime>,
    last_frame: u64,
    /// Problems of frames whose recording failed, for the next report.
    unreported: Vec<String>,
    table: ColorTable,
    // Dropped last: everything else gives its memory back.
    pub(crate) gpu: Gpu,
}

impl Drop for Renderer {
    /// Ends all threads; those that wait for servers unless something else uses them.
    fn drop(&mut self) {
        self.clouds.clear();
        self.removed.clear();
        self.held.clear();
        crate::network::release();
    }
}

impl Renderer {
    /// Creates a renderer on the host's device. Errors name what the device lacks.
    ///
    /// # Safety
    /// The handles of `host` are valid until the renderer is dropped, and what [`requirements`]
    /// lists as required is enabled.
    pub unsafe fn new(host: &Host, options: RendererOptions) -> Result<Renderer> {
        // SAFETY: as the caller ensures.
        Renderer::on(unsafe { Gpu::adopt(&host.device(options.overrides)?) }?, options)
    }

    fn on(mut gpu: Gpu, options: RendererOptions) -> Result<Renderer> {
        let table = ColorTable::new(&mut gpu)?;
        Ok(Renderer {
            settings: RenderSettings::default(),
            opacities: Opacities::default(),
            clips: Clips::default(),
            filter: Filter::default(),
            lod: LodOptions::default(),
            scale: ColorScale::default(),
            options,
            governor: None,
            clouds: Vec::new(),
            removed: Vec::new(),
            held: VecDeque::new(),
            latest: Vec::new(),
            revision: 0,
            own_depth: None,
            next_cloud: 1,
            next_pick: 1,
            wanted_picks: Vec::new(),
            answers: Vec::new(),
            times: Vec::new(),
            last_frame: 0,
            unreported: Vec::new(),
            table,
            gpu,
        })
    }

    /// Opens files, or one index, as a cloud. Returns at once; a thread reads them. Points can be
    /// drawn as strokes if that is the style already, and are filtered if `only` or `not` are set
    /// ([`Renderer::set`]). Errors if there are no files, or no such colour.
    pub fn open(&mut self, files: &[PathBuf], settings: &OpenSettings) -> Result<CloudId> {
        if files.is_empty() {
            return Err(Error::Request("there are no files to open; name at least one".into()));
        }
        let id = self.new_id();
        self.clouds.push(Entry::open(id, files.to_vec(), settings, self.reading())?);
        Ok(id)
    }

    /// Adds points of the host's memory as a cloud; they are copied. Errors if an attribute has
    /// another number of values than there are positions.
    pub fn add_points(&mut self, points: &Points) -> Result<CloudId> {
        let id = self.new_id();
        let entry = Entry::of_points(id, points, self.reading(), &self.gpu.workers)?;
        self.clouds.push(entry);
        Ok(id)
    }

    /// Adds points of a buffer of the host's device as a cloud; the next frame copies them.
    ///
    /// # Errors
    /// If the numbers of `points` make no sense.
    ///
    /// # Safety
    /// The handle is valid until the device has completed the next frame, and the points lie within
    /// the buffer.
    pub unsafe fn add_buffer(&mut self, points: PointBuffer) -> Result<CloudId> {
        let id = self.new_id();
        self.clouds.push(Entry::of_buffer(id, points, self.reading())?);
        Ok(id)
    }

    fn reading(&self) -> Reading {
        let strokes = self.settings.effects.strokes.switch == Switch::On;
        Reading { strokes, filter: self.filter.clone(), lod: self.lod }
    }

    fn new_id(&mut self) -> CloudId {
        self.next_cloud += 1;
        CloudId(self.next_cloud - 1)
    }

    /// Removes a cloud; its memory is freed when the device has completed the frames that drew it.
    pub fn remove(&mut self, cloud: CloudId) -> Result<()> {
        let place = self.place(cloud)?;
        let removed = self.clouds.remove(place);
        // Our own queue has completed all that was drawn.
        if self.gpu.host.is_some() {
            self.removed.push(removed);
        }
        Ok(())
    }

    /// Returns the state of a cloud.
    pub fn state(&self, cloud: CloudId) -> Result<CloudState> {
        Ok(self.clouds[self.place(cloud)?].state())
    }

    /// Returns notes on the files of a cloud: losses and guesses of reading. Empty while it loads.
    pub fn notes(&self, cloud: CloudId) -> Result<&[String]> {
        Ok(&self.clouds[self.place(cloud)?].notes)
    }

    /// Shows or hides a cloud.
    pub fn set_visible(&mut self, cloud: CloudId, visible: bool) -> Result<()> {
        let place = self.place(cloud)?;
        self.clouds[place].visible = visible;
        Ok(())
    }

    /// Moves a cloud: `columns` are those of an affine matrix from its own coordinates to the
    /// host's world, which may also stretch, shear and mirror it. Clip boxes are in the cloud's own
    /// coordinates, lights in the host's world. Strokes need a rotation, a uniform scale and a
    /// translation; other clouds are drawn as points. Errors if the matrix is not affine, or
    /// flattens the cloud; it is then as it was.
    pub fn set_transform(&mut self, cloud: CloudId, columns: &[f64; 16]) -> Result<()> {
        let place = self.place(cloud)?;
        self.revision += 1;
        self.clouds[place].set_transform(columns)
    }

    fn place(&self, cloud: CloudId) -> Result<usize> {
        let found = self.clouds.iter().position(|entry| entry.id == cloud);
        found.ok_or_else(|| Error::Request(format!("there is no cloud {}", cloud.0)))
    }

    /// Returns a camera that frames all clouds that are ready; `None` if there is none.
    pub fn framing(&self, preset: Preset, size: [u32; 2]) -> Option<Camera> {
        let places: Vec<DVec3> = self
            .clouds
            .iter()
            .flat_map(|cloud| cloud.core_points.iter().map(|p| cloud.transform.in_world(*p)))
            .collect();
        let framing = || Camera::framing(preset, &places, size);
        (!places.is_empty()).then(|| self.gpu.workers.run(framing))
    }

    /// Returns the settings: effects, light and background.
    pub fn settings(&self) -> &RenderSettings {
        &self.settings
    }

    /// Replaces the settings.
    pub fn set_settings(&mut self, settings: RenderSettings) {
        self.revision += 1;
        self.settings = settings;
    }

    /// Sets opacities and clip boxes of all clouds, boxes in each cloud's own coordinates.
    pub fn set_filters(&mut self, opacities: Opacities, clips: Clips) {
        self.revision += 1;
        (self.opacities, self.clips) = (opacities, clips);
    }

    /// Sets how numbers and channels become colours.
    pub fn set_color_scale(&mut self, scale: ColorScale) {
        self.revision += 1;
        self.scale = scale;
    }

    /// Requests the point in a pixel of the targets, of the next frame that is recorded. Clouds are
    /// asked, and not the host's geometry in front of them; the host compares depths.
    pub fn pick(&mut self, pixel: [u32; 2]) -> PickId {
        let pick = PickId(self.next_pick);
        self.next_pick += 1;
        self.wanted_picks.push((pick, pixel));
        pick
    }

    /// Returns the answer to a pick, once; it is pending until the device has completed its frame
    /// and another one is recorded. There is nothing in what was answered before, or never
    /// requested.
    pub fn picked(&mut self, pick: PickId) -> Picked {
        let Some(at) = self.answers.iter().position(|(answered, _)| *answered == pick) else {
            let recorded = self.held.iter().flat_map(HeldFrame::picks);
            let mut pending = self.wanted_picks.iter().map(|(own, _)| *own).chain(recorded);
            return match pending.any(|own| own == pick) {
                true => Picked::Pending,
                false => Picked::Nothing,
            };
        };
        self.answers.swap_remove(at).1.map_or(Picked::Nothing, Picked::Point)
    }

    /// Returns the device times of the passes of the last completed frame.
    pub fn pass_times(&self) -> &[PassTime] {
        &self.times
    }

    /// Records a frame. The targets are in their access `before`, and in `after` when it is done.
    ///
    /// # Errors
    /// If numbers do not grow, a target cannot be drawn into, memory is exhausted, or the device is
    /// lost. The command buffer must then be reset or freed, and neither be ended nor submitted.
    /// The frame counts as not drawn, as after [`Renderer::drop_frame`]. A cloud that cannot
    /// be drawn is left out, and named in the report.
    ///
    /// # Safety
    /// `commands` is a command buffer of the renderer's family that is being recorded, outside of
    /// rendering. It is submitted before those of later frames, on one queue, unless the frame is
    /// dropped. The images are alive
    /// until then, and as their targets say. `frame.safe` has been completed by the device.
    pub unsafe fn record(&mut self, commands: u64, frame: &Frame) -> Result<FrameReport> {
        if self.gpu.host.is_none() {
            return Err(Error::Request(
                "this renderer has a device of its own, and no host's commands; call picture"
                    .into(),
            ));
        }
        if frame.number <= self.last_frame || frame.safe >= frame.number {
            return Err(Error::Request(format!(
                "frame {} after frame {}, with {} completed: numbers must grow",
                frame.number, self.last_frame, frame.safe
            )));
        }
        frame.targets.check()?;
        frame.views.iter().try_for_each(|view| view.area.check(&frame.targets))?;
        let commands = vk::CommandBuffer::from_raw(commands);
        let completed = self.gpu.completed_frame(frame.safe, frame.number);
        self.retire(completed)?;
        self.gpu.begin_host_frame(commands, frame.number, completed);
        self.last_frame = frame.number;
        let mut held = HeldFrame {
            number: frame.number,
            pictures: Vec::new(),
            place: self.governor.as_ref().map_or(0, Governor::place),
            is_dropped: false,
            before: 0,
            wanted_picks: Vec::new(),
            _removed: std::mem::take(&mut self.removed),
            blocks: Vec::new(),
            copies: Vec::new(),
        };
        let mut report = FrameReport {
            settled: true,
            errors: std::mem::take(&mut self.unreported),
            ..FrameReport::default()
        };
        let recorded = self.record_frame(commands, frame, &mut held, &mut report);
        match recorded {
            Ok(()) => {
                held.before = self.gpu.end_host_frame();
                self.answer_unmet(&mut held);
                self.latest.clone_from(&held.pictures);
            }
            Err(_) => {
                let last = self.gpu.submitted;
                self.undo(&mut held, last);
                for error in std::mem::take(&mut report.errors) {
                    if !self.unreported.contains(&error) {
                        self.unreported.push(error);
                    }
                }
            }
        }
        self.held.push_back(held);
        recorded.map(|()| report)
    }

    /// Takes back the last recorded frame, which the host neither has submitted nor will, such as
    /// after an image of a swapchain is lost. It counts as not drawn: the next frame, of a greater
    /// number, uploads again what this one did, and answers its picks. Errors if the frame is not
    /// the last one, or its recording failed.
    pub fn drop_frame(&mut self, number: u64) -> Result<()> {
        let Some(mut held) =
            self.held.pop_back_if(|held| held.number == number && !held.is_dropped)
        else {
            let last = self.last_frame;
            return Err(Error::Request(format!(
                "frame {number} cannot be dropped; only the last recorded one can, which is {last} unless it failed"
            )));
        };
        let last = held.before;
        self.undo(&mut held, last);
        self.latest.retain(|picture| picture.frame != number);
        self.wanted_picks.append(&mut held.wanted_picks);
        self.held.push_back(held);
        Ok(())
    }

    /// Goes back to before a frame that is never drawn. `last` is the number of the last
    /// submission.
    fn undo(&mut self, held: &mut HeldFrame, last: u64) {
        self.gpu.drop_host_frame(last);
        held.is_dropped = true;
        let copies = self.clouds.iter_mut().filter_map(|cloud| cloud.drop_frame(held.number));
        held.copies.extend(copies);
    }

    /// Records a frame, and what it holds. After an error nothing more is recorded.
    fn record_frame(
        &mut self,
        commands: vk::CommandBuffer,
        frame: &Frame,
        held: &mut HeldFrame,
        report: &mut FrameReport,
    ) -> Result<()> {
        let mut allowance = Allowance::of_frame();
        for entry in &mut self.clouds {
            entry.copy_again(&mut self.gpu)?;
            entry.advance(&mut self.gpu, self.options.memory_budget, &mut allowance)?;
            let map = entry.transform.map;
            if let Some(cloud) = entry.cloud_mut() {
                cloud.set_filters(self.opacities.clone(), self.clips.clone());
                cloud.set_scale(self.scale);
                cloud.set_map(map);
            }
        }
        self.share_memory()?;
        self.update_clouds(frame.views, report)?;
        let targets = self.with_depth(&frame.targets, held)?;
        compose::transition(&self.gpu.device, commands, &targets, false);
        let kept = self.kept_depth(commands, &targets, report)?;
        let writes_depth = targets.writes_depth || kept.is_some();
        let frame = Frame { targets: Targets { writes_depth, ..targets }, ..*frame };
        for view in frame.views {
            self.record_view(commands, &frame, view, held, report)?;
        }
        if let (Some(copy), Some(depth)) = (&kept, &targets.depth) {
            let whole = targets.whole();
            compose::restore_depth(&self.gpu.device, commands, depth, whole, copy);
        }
        held.copies.extend(kept);
        if frame.views.is_empty() {
            let place =
                placement(frame.targets.whole(), &frame.targets, &self.settings, &self.table);
            compose::clear(&self.gpu, commands, &place, Depth::REVERSED)?;
        }
        compose::transition(&self.gpu.device, commands, &frame.targets, true);
        let waits = |cloud: &Entry| {
            matches!(cloud.state(), CloudState::Loading { .. } | CloudState::Uploading)
        };
        report.streamed = self.clouds.iter().map(|cloud| cloud.streamed).sum();
        report.settled &= report.missing == 0 && !self.clouds.iter().any(waits);
        Ok(())
    }

    /// Answers the picks outside of all views and clouds of a recorded frame, which meet nothing.
    fn answer_unmet(&mut self, held: &mut HeldFrame) {
        let picks = std::mem::take(&mut self.wanted_picks);
        let (met, unmet): (Vec<_>, Vec<_>) =
            picks.into_iter().partition(|(pick, _)| held.picks().any(|own| own == *pick));
        self.answers.extend(unmet.into_iter().map(|(pick, _)| (pick, None)));
        held.wanted_picks = met;
    }

    /// Divides the memory budget among indexes.
    fn share_memory(&mut self) -> Result<()> {
        let indexes = self.clouds.iter().filter(|cloud| cloud.is_index()).count() as u64;
        let share = match self.options.memory_budget {
            all if indexes < 2 => all,
            // In whole blocks, of which more may come later.
            all if all / indexes >= BLOCK_BYTES => all / indexes / BLOCK_BYTES * BLOCK_BYTES,
            all => all / indexes,
        };
        for cloud in &mut self.clouds {
            if cloud.set_memory(&self.gpu, share)? {
                self.revision += 1;
            }
        }
        Ok(())
    }

    /// Loads what the views call for of each cloud, unless all of it is in pictures already.
    fn update_clouds(&mut self, views: &[FrameView], report: &mut FrameReport) -> Result<()> {
        let limits = self.limits();
        let Renderer { gpu, clouds, latest, revision, wanted_picks, .. } = self;
        let indexes = clouds.iter().filter(|cloud| cloud.is_index()).count() as u64;
        let most_in_flight = UPLOAD_BYTES / indexes.max(1);
        for cloud in clouds.iter_mut().filter(|cloud| cloud.shown().is_some()) {
            let is_shown = |view: &FrameView| {
                let shows = |key: &Key| key.shows(cloud.id, view, *revision);
                latest.iter().any(|before| before.settled && shows(&before.key))
            };
            if wanted_picks.is_empty() && views.iter().all(is_shown) {
                continue;
            }
            let own = |view: &FrameView| {
                view_of(&view.camera, &cloud.transform, view.area.size).map(|(own, _)| own).ok()
            };
            // Views that cannot be drawn are named when they are recorded.
            let views: Vec<View> = views.iter().filter_map(own).collect();
            match cloud.update(gpu, &views, &limits, most_in_flight) {
                Ok(errors) => report.errors.extend(errors),
                Err(Error::Request(why)) => {
                    report.errors.push(format!("cloud {}: {why}", cloud.id.0));
                }
                Err(error) => return Err(error),
            }
            report.missing += cloud.missing;
        }
        Ok(())
    }

    /// Adds a depth target of our own if several clouds are drawn and the host gives none. Holds
    /// the memory of one of another size, which frames in flight may use.
    fn with_depth(&mut self, targets: &Targets, held: &mut HeldFrame) -> Result<Targets> {
        if targets.depth.is_some() || self.clouds.len() < 2 {
            return Ok(*targets);
        }
        let desc = ImageDesc::depth(targets.color.size);
        let Gpu { memory, device, .. } = &mut self.gpu;
        let image = match &self.own_depth {
            Some((image, _)) if image.desc == desc => *image,
            _ => {
                let made = memory.image_alone(device, desc, "depth of clouds")?;
                let image = made.0;
                held.blocks.extend(self.own_depth.replace(made).map(|(_, block)| block));
                image
            }
        };
        let attached = vk::ImageLayout::DEPTH_STENCIL_ATTACHMENT_OPTIMAL;
        let target = Target {
            image: image.raw.as_raw(),
            view: image.view.as_raw(),
            format: desc.format.as_raw(),
            size: desc.size,
            samples: 1,
            before: Access::any(vk::ImageLayout::UNDEFINED.as_raw()),
            after: Access::any(attached.as_raw()),
            clear: true,
        };
        Ok(Targets { depth: Some(target), writes_depth: true, copies_depth: true, ..*targets })
    }

    /// Records a copy of the host's depth if clouds are to hide each other, and their depth is not
    /// to be left there.
    fn kept_depth(
        &mut self,
        commands: vk::CommandBuffer,
        targets: &Targets,
        report: &mut FrameReport,
    ) -> Result<Option<RawBuffer>> {
        let several = self.clouds.iter().filter(|cloud| cloud.shown().is_some()).count() > 1;
        let Some(depth) = targets.depth.as_ref().filter(|_| several && !targets.writes_depth)
        else {
            return Ok(None);
        };
        if !targets.copies_depth {
            report.errors.push(
                "clouds lie over each other in their order: depth is not written, and the depth target cannot be copied (copies_depth)".into(),
            );
            return Ok(None);
        }
        compose::copy_depth(&mut self.gpu, commands, depth, targets.whole()).map(Some)
    }

    /// Records the clouds of a view, each over those before it.
    fn record_view(
        &mut self,
        commands: vk::CommandBuffer,
        frame: &Frame,
        view: &FrameView,
        held: &mut HeldFrame,
        report: &mut FrameReport,
    ) -> Result<()> {
        let settings = &self.governed(view.area.size).0;
        let Renderer { gpu, clouds, table, latest, revision, wanted_picks, .. } = self;
        let clears = frame.targets.color.clear;
        let mut place = placement(view.area, &frame.targets, settings, table);
        for cloud in clouds.iter() {
            let (id, transform, settled) = (cloud.id, cloud.transform, cloud.missing == 0);
            let Some(shown) = cloud.shown() else { continue };
            let key = Key {
                cloud: id,
                camera: view.camera,
                size: view.area.size,
                opaque: place.first && clears,
                layers: frame.targets.has_layers(),
                revision: *revision,
            };
            let before = latest.iter().find(|before| before.key == key);
            // Depth that something is in already.
            let depth = frame.targets.depth.as_ref().filter(|depth| !(place.first && depth.clear));
            if depth.is_some() && !frame.targets.copies_depth && shown.is_transparent() {
                let why = format!(
                    "cloud {}: its layers are hidden as one, since the depth target cannot be copied (copies_depth)",
                    id.0
                );
                if !report.errors.contains(&why) {
                    report.errors.push(why);
                }
            }
            let occluding = depth.filter(|_| frame.targets.copies_depth);
            let occluding = occluding.map(|depth| (depth, view.area));
            let drawing = view_of(&view.camera, &transform, view.area.size).map(|(own, form)| {
                let (picks, frame) = (within(wanted_picks, view.area), frame.number);
                Drawing {
                    key,
                    frame,
                    view: own,
                    form,
                    transform,
                    picks,
                    settings,
                    settled,
                    depth: occluding,
                    table,
                }
            });
            let recorded = drawing
                .and_then(|drawing| drawing.record(gpu, shown, before.map(|kept| &**kept), report));
            let picture = match recorded {
                Ok(Some(picture)) => Arc::new(picture),
                Ok(None) => before.expect("shown again").clone(),
                Err(Error::Request(why)) => {
                    report.errors.push(format!("cloud {}: {why}", id.0));
                    continue;
                }
                Err(error) => return Err(error),
            };
            held.pictures.push(picture.clone());
            let drawn = Drawn {
                picture: &picture.descriptors,
                layers: picture.layers.as_ref(),
                form: picture.form,
                distorted: picture.view.is_distorted(),
                opaque: picture.key.opaque,
                cloud: (id.0, transform.axes()),
            };
            compose::record(gpu, commands, &place, &drawn)?;
            report.points += picture.points;
            report.settled &= !picture.waits;
            if report.effects.is_empty() {
                report.effects.clone_from(&picture.effects);
            }
            place.first = false;
        }
        if place.first {
            // Without a cloud, matrices may not be known yet.
            let form = view_of(&view.camera, &Transform::default(), view.area.size)
                .map_or(Depth::REVERSED, |(_, form)| form);
            compose::clear(gpu, commands, &place, form)?;
        }
        Ok(())
    }

    /// Frees what completed frames held, and answers their picks.
    fn retire(&mut self, safe: u64) -> Result<()> {
        while self.held.front().is_some_and(|held| held.number <= safe) {
            let held = self.held.pop_front().expect("just seen");
            let is_drawn = held.drawn().next().is_some();
            if is_drawn {
                self.times.clear();
            }
            // Distance in the host's world, and the point.
            let mut nearest: Vec<(PickId, f64, Option<PickedPoint>)> = Vec::new();
            for picture in held.drawn() {
                let times = picture.recorded.times()?;
                self.times.extend(
                    times.map(|(name, milliseconds)| PassTime {
                        name: name.to_string(),
                        milliseconds,
                    }),
                );
                let Some(picks) = &picture.picks else { continue };
                let scale = picks.transform.unit();
                for (number, &(pick, _)) in picks.pixels.iter().enumerate() {
                    let found = self.found(picture, picks, number);
                    let distance =
                        found.as_ref().map_or(f64::INFINITY, |found| found.depth * scale);
                    match nearest.iter_mut().find(|(other, ..)| *other == pick) {
                        Some(before) if distance < before.1 => *before = (pick, distance, found),
                        Some(_) => {}
                        None => nearest.push((pick, distance, found)),
                    }
                }
            }
            self.answers.extend(nearest.into_iter().map(|(pick, _, found)| (pick, found)));
            if is_drawn {
                let ms = self.times.iter().map(|time| time.milliseconds).sum();
                self.took(held.place, ms);
            }
        }
        Ok(())
    }

    /// Returns the point that a completed picture shows in the pixel of a pick.
    fn found(
        &self,
        picture: &RecordedPicture,
        picks: &RecordedPicks,
        number: usize,
    ) -> Option<PickedPoint> {
        let pixel = picks.pixels[number].1;
        let at = (pixel[1] * picture.view.size[0] + pixel[0]) as usize;
        let depth = picture.recorded.read::<f32>(&picks.depth)[at];
        let point = picture.recorded.read::<u32>(&picks.index)[at];
        if !(depth > 0.0 && depth.is_finite()) {
            return None;
        }
        let cloud = self.clouds.iter().find(|cloud| cloud.id == picture.key.cloud);
        let resident = cloud.and_then(Entry::resident);
        let words =
            &picture.recorded.read::<u32>(&picks.points.words)[picks.points.each * number..];
        let own = resident
            .filter(|_| point != NO_POINT)
            .and_then(|resident| resident.point_of_nodes(&picks.nodes, point, words));
        let kind = own.and_then(|own| own.kind);
        let station = |kind: u32| Some(resident?.stations.get((kind >> 16) as usize)?.name.clone());
        let (position, exact) = own.map_or_else(
            || {
                let [x, y] = pixel.map(|at| at as f64 + 0.5);
                let (origin, direction) = picture.view.ray(x, y);
                (picks.transform.map.own(origin + direction * depth as f64), false)
            },
            |found| (found.position, found.exact),
        );
        Some(PickedPoint {
            cloud: picture.key.cloud,
            world: picks.transform.in_world(position),
            position,
            exact,
            id: (point != NO_POINT).then_some(point),
            class: kind.map(|kind| kind as u8),
            return_number: kind.map(|kind| (kind >> 8 & 15) as u8),
            station: kind.and_then(station),
            color: own.map(|own| own.color),
            value: own.and_then(|own| own.value),
            depth: depth as f64,
        })
    }
}

/// Returns where nothing is drawn yet.
fn placement<'p>(
    area: Area,
    targets: &'p Targets,
    settings: &RenderSettings,
    table: &'p ColorTable,
) -> Placement<'p> {
    let linear =
        |channel: u8| crate::cloud::colormap::srgb_to_linear(channel as f64 / 255.0) as f32;
    let background = settings.background.map(linear);
    Placement { area, targets, first: true, background, table }
}

/// Returns the picks within an area, and their pixels there.
fn within(picks: &[(PickId, [u32; 2])], area: Area) -> Vec<(PickId, [u32; 2])> {
    let place = |&(pick, pixel): &(PickId, [u32; 2])| {
        let at = [0, 1].map(|axis| pixel[axis] as i64 - area.corner[axis] as i64);
        let inside = |axis: usize| (0..area.size[axis] as i64).contains(&at[axis]);
        (inside(0) && inside(1)).then(|| (pick, at.map(|at| at as u32)))
    };
    picks.iter().filter_map(place).collect()
}
