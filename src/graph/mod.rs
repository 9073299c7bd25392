//! The render graph: passes run in the order in which they are recorded.
//!
//! Input: typed shader structs (`crate::shader`, generated) over handles. Output: a submission
//! whose barriers, dropped passes and memory reuse are decided by the pure [`plan`]. Handles are
//! not `Clone`, so that the borrow checker refuses one image as input and output of a pass.

pub(crate) mod host;
pub mod plan;
pub(crate) mod record;
mod submission;
mod tiles;

pub use crate::gpu::{Access, BufferDesc, Code, ImageDesc, Kind, Place};
pub use record::PendingSubmission;
pub use tiles::{ReusedImages, TileList};

use crate::error::{Error, Result};
use crate::gpu::kernel::Kernels;
use crate::gpu::memory::{Memory, RawBuffer, Texels};
use crate::gpu::timeline::Timeline;
use crate::gpu::{Device, TestOverrides, raster};
use crate::progress::Progress;
use crate::thread_pool::Workers;
use ash::vk;
use host::{Answers, HostQueue};
use plan::{Pass, Plan, Resource, Shape};
use std::collections::HashMap;
use tiles::TileMask;

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct ResourceId(pub usize);

/// An image of the frame.
#[derive(Debug)]
pub struct Image {
    id: ResourceId,
    pub desc: ImageDesc,
}

impl Image {
    /// Returns a second handle, for a pass that reads a pixel before it writes it, for a later
    /// pass, and for images that are reused ([`ReusedImages`]).
    pub(crate) fn alias(&self) -> Image {
        Image { id: self.id, desc: self.desc }
    }
}

/// A buffer of the frame.
#[derive(Debug)]
pub struct Buffer {
    id: ResourceId,
    pub desc: BufferDesc,
}

impl Buffer {
    /// Returns a second handle, for a shader that reads a buffer while it writes it atomically and
    /// accepts stale values.
    pub fn racy_alias(&self) -> Buffer {
        self.alias()
    }

    /// Returns a second handle, for a later pass.
    pub fn alias(&self) -> Buffer {
        Buffer { id: self.id, desc: self.desc }
    }
}

/// Access of generated code to handles.
pub trait Handle {
    fn resource(&self) -> ResourceId;
}

impl Handle for Image {
    fn resource(&self) -> ResourceId {
        self.id
    }
}

impl Handle for Buffer {
    fn resource(&self) -> ResourceId {
        self.id
    }
}

/// A compute shader; `build.rs` implements this for each.
pub trait Shader {
    const CODE: Code;
    /// Returns the resources in the order of `CODE.bindings`.
    fn resources(&self) -> Vec<ResourceId>;
    fn push(&self) -> &[u8];
    fn constants(&self) -> Vec<(u32, u32)>;
}

/// A pair of a vertex and a fragment shader; `build.rs` implements this for each.
pub trait Raster {
    const STAGES: [Code; 2];
    /// Resources of each stage in the order of its bindings.
    fn resources(&self) -> [Vec<ResourceId>; 2];
    fn push(&self) -> &[u8];
    fn constants(&self) -> Vec<(u32, u32)>;
}

/// Vertices of a draw.
#[derive(Clone, Copy, Debug)]
pub enum Vertices<'b> {
    /// Points of a vertex buffer of f32 x, y, z, and their number.
    Points(&'b Buffer, u32),
    /// Number of squares; the vertex stage generates their corners.
    Squares(u32),
}

/// Workgroups of a pass.
#[derive(Clone, Copy, Debug)]
pub enum Dispatch<'l> {
    /// One invocation per pixel of the first image that the pass writes.
    PerPixel,
    /// Like `PerPixel`, for a pass that reads only the pixel it writes: its output may replace an
    /// input that is read for the last time.
    PerPixelInPlace,
    /// One invocation per texel that packs four rows of pixels.
    PerPackedTexel([u32; 2]),
    /// Workgroups that loop over tiles of 8 x 8 pixels, eight at a time; the number of tiles.
    PerEightTiles(u32),
    /// Fixed number of workgroups.
    Groups([u32; 3]),
    /// Workgroup counts read from three words of a buffer, from this word on; an earlier pass wrote
    /// them.
    Indirect(&'l Buffer, u32),
}

/// Workgroup counts of a recorded pass.
#[derive(Clone, Copy)]
pub(crate) enum Groups {
    Fixed([u32; 3]),
    /// Three words at this byte of a buffer.
    Indirect(ResourceId, u64),
}

/// Work of a pass.
pub(crate) enum Work {
    /// `resources` in binding order, without the last if the shader supports a tile list and has
    /// none.
    Run {
        code: Code,
        constants: Vec<(u32, u32)>,
        push: Vec<u8>,
        resources: Vec<ResourceId>,
        groups: Groups,
    },
    CopyImage {
        from: ResourceId,
        to: ResourceId,
    },
    Fill {
        buffer: ResourceId,
        word: u32,
    },
    /// Nothing: the contents of an image are undefined from here on.
    Discard,
    /// Source offset, destination offset and length of each part `[bytes]`.
    CopyParts {
        from: ResourceId,
        to: ResourceId,
        parts: Vec<[u64; 3]>,
    },
    CopyBuffer {
        from: ResourceId,
        to: ResourceId,
        bytes: u64,
    },
    CopyOut {
        image: ResourceId,
        buffer: ResourceId,
    },
    Draw {
        draw: raster::Draw,
        /// Resources of each stage in the order of its bindings.
        resources: [Vec<ResourceId>; 2],
        vertices: Option<ResourceId>,
        /// Colour and depth attachment.
        attachments: [ResourceId; 2],
    },
}

/// Vulkan handles of an imported buffer.
#[derive(Clone, Copy)]
pub(crate) struct Import {
    raw: vk::Buffer,
    texels: Texels,
}

/// What is called between parts of a submission.
pub type Pause<'p> = dyn FnMut(&mut Gpu) -> Result<()> + 'p;

/// The device with everything that outlives a frame: memory, kernels, pipelines.
pub struct Gpu {
    // Fields are dropped in this order, all before the device.
    pub kernels: Kernels,
    pub raster: raster::Rasters,
    /// Timeline that each submission raises to its number when it completes.
    pub completed: Timeline,
    pub submitted: u64,
    pub overrides: TestOverrides,
    /// Number of clouds made resident so far.
    pub residents: u64,
    /// Time of a row of workgroups of each kernel on a software device, as measured last `[s]`.
    paces: HashMap<&'static str, f64>,
    /// Submissions that run detached.
    detached: Vec<PendingSubmission>,
    /// The host that submits, if the device is not ours.
    pub(crate) host: Option<HostQueue>,
    /// Threads that work of the CPU is divided among.
    pub workers: Workers,
    pub memory: Memory,
    pub device: Device,
}

impl Gpu {
    pub fn open(options: &crate::gpu::DeviceOptions) -> Result<Gpu> {
        let mut gpu = Gpu::on(Device::open(options)?)?;
        gpu.overrides = options.overrides;
        Ok(gpu)
    }

    fn on(device: Device) -> Result<Gpu> {
        let workers = Workers::of_process_or_own()?;
        let memory = Memory::new(&device)?;
        let completed = Timeline::new(&device, &memory.alive, "completed")?;
        let (kernels, raster) = (Kernels::new(&device), raster::Rasters::new(&device));
        Ok(Gpu {
            kernels,
            raster,
            completed,
            submitted: 0,
            overrides: TestOverrides::default(),
            residents: 0,
            paces: HashMap::new(),
            detached: Vec::new(),
            host: None,
            workers,
            memory,
            device,
        })
    }

    /// Returns the number of the last submission that the device has completed.
    pub fn completed(&self) -> Result<u64> {
        self.host.as_ref().map_or_else(|| self.completed.value(), |host| Ok(host.safe_frame))
    }

    /// Returns the number of the last submission that may read resident pages: for a host, the
    /// frame being recorded, since its earlier views have commands already.
    pub fn last_reader(&self) -> u64 {
        self.host.as_ref().map_or(self.submitted, |host| host.frame)
    }

    /// Destroys buffers that were dropped, after the submissions that may use them.
    pub fn destroy_dropped(&mut self) {
        if self.host.is_none() && self.memory.has_destroyed() {
            // A lost device has nothing in flight.
            let _ = self.wait_detached();
            self.memory.destroy_now();
        }
    }

    /// Waits for detached submissions. A host's are not waited for.
    pub fn wait_detached(&mut self) -> Result<()> {
        std::mem::take(&mut self.detached)
            .into_iter()
            .try_for_each(|pending| pending.finish(self).map(drop))
    }
}

impl Drop for Gpu {
    fn drop(&mut self) {
        // Errors were already reported to the caller.
        let _ = self.wait_detached();
    }
}

/// Passes that run if a predicate on the device holds.
struct Predicate {
    /// Buffer of the requested workgroup counts.
    wanted: ResourceId,
    words: Vec<[u32; 3]>,
    /// Buffer of the granted workgroup counts.
    groups: ResourceId,
}

/// Most passes of one predicate.
pub const MAX_PREDICATED_PASSES: usize = 1024;

/// A frame being recorded.
pub struct Graph<'g> {
    pub gpu: &'g mut Gpu,
    passes: Vec<Pass>,
    work: Vec<Work>,
    resources: Vec<Resource>,
    /// Upload buffers by resource.
    uploads: Vec<(ResourceId, RawBuffer)>,
    imports: Vec<(ResourceId, Import)>,
    /// Persistent buffers that the frame changes: name, cache key, and steps held afterwards.
    persistent: Vec<(ResourceId, String, Vec<u64>, u32)>,
    progress: Option<&'g dyn Progress>,
    /// The predicate of the passes being recorded.
    predicate: Option<Predicate>,
    /// Requested workgroup counts, uploaded when recording is complete.
    wanted: Vec<(ResourceId, Vec<[u32; 3]>)>,
    /// The tile list of the passes being recorded.
    tile_mask: Option<TileMask>,
    reused: Option<ReusedImages>,
    /// What earlier frames of a host asked for this picture.
    answers: Option<&'g mut Answers>,
    /// Records no barriers, for tests of the tests.
    pub without_barriers: bool,
}

/// What the device answered before a frame.
pub struct Answer {
    /// Words of each buffer that was read.
    pub words: Vec<Vec<u32>>,
    /// Device time `[ms]`.
    pub milliseconds: f64,
}

impl<'g> Graph<'g> {
    pub fn new(gpu: &'g mut Gpu) -> Graph<'g> {
        gpu.memory.begin_graph();
        Graph::empty(gpu)
    }

    fn empty(gpu: &'g mut Gpu) -> Graph<'g> {
        gpu.destroy_dropped();
        Graph {
            gpu,
            passes: Vec::new(),
            work: Vec::new(),
            resources: Vec::new(),
            uploads: Vec::new(),
            imports: Vec::new(),
            persistent: Vec::new(),
            progress: None,
            predicate: None,
            wanted: Vec::new(),
            tile_mask: None,
            reused: None,
            answers: None,
            without_barriers: false,
        }
    }

    /// Reads and keeps answers that take a host several frames ([`Graph::ask`]).
    pub(crate) fn with_answers(self, answers: &'g mut Answers) -> Graph<'g> {
        Graph { answers: Some(answers), ..self }
    }

    /// Reports progress to `progress`, which may cancel the frame between passes; on software
    /// devices only.
    pub fn with_progress(self, progress: &'g dyn Progress) -> Graph<'g> {
        Graph { progress: Some(progress), ..self }
    }

    /// Returns a graph for a submission that precedes this one, with the same progress.
    fn preceding(&mut self) -> Graph<'_> {
        Graph { progress: self.progress, ..Graph::empty(self.gpu) }
    }

    /// Has the device run what `record` records before this graph, and returns the contents of the
    /// download buffers that it returns. A host is not waited for: `None` until the device has
    /// completed the frame that asked. `name` tells the questions of a picture apart.
    pub fn ask(
        &mut self,
        name: &str,
        record: impl FnOnce(&mut Graph) -> Result<Vec<Buffer>>,
    ) -> Result<Option<Answer>> {
        if self.gpu.host.is_some() {
            let Some(answers) = self.answers.take() else { return Err(host::refused()) };
            let answer = answers.ask(self, name, record);
            self.answers = Some(answers);
            return answer;
        }
        let mut before = self.preceding();
        let read = record(&mut before)?;
        let frame = before.submit_and_wait(&[])?;
        let words = read.iter().map(|buffer| frame.read::<u32>(buffer).to_vec()).collect();
        Ok(Some(Answer { words, milliseconds: frame.ms("") }))
    }

    /// Adds a transient image; undefined until a pass writes it.
    pub fn image(&mut self, name: &str, size: [u32; 2], kind: Kind) -> Image {
        let format = kind.format().unwrap_or_else(|| panic!("{name} is an image, not a buffer"));
        self.image_of(name, ImageDesc { size, format })
    }

    pub(crate) fn image_of(&mut self, name: &str, desc: ImageDesc) -> Image {
        if let Some(image) = self.reused.as_mut().and_then(|reused| reused.take(name, desc)) {
            return image;
        }
        let image = Image { id: self.add(name, Shape::Image(desc)), desc };
        self.reused.iter_mut().for_each(|reused| reused.add(name, &image));
        image
    }

    /// Adds a buffer that passes write and the CPU reads after the submission.
    pub fn readback(&mut self, name: &str, bytes: u64) -> Buffer {
        let desc = BufferDesc { bytes, place: Place::Download };
        Buffer { id: self.add(name, Shape::Buffer(desc)), desc }
    }

    /// Adds a transient buffer; undefined until a pass writes it.
    pub fn buffer(&mut self, name: &str, bytes: u64) -> Buffer {
        let desc = BufferDesc { bytes, place: Place::Device };
        Buffer { id: self.add(name, Shape::Buffer(desc)), desc }
    }

    /// Adds a buffer with initial contents. Sizes are rounded up, so that frames can recycle each
    /// other's buffers.
    pub fn upload<T: bytemuck::Pod>(&mut self, name: &str, items: &[T]) -> Result<Buffer> {
        let bytes: &[u8] = bytemuck::cast_slice(items);
        let desc = BufferDesc {
            bytes: (bytes.len() as u64).next_power_of_two().max(256),
            place: Place::Upload,
        };
        let mut raw = self.gpu.memory.buffer(&self.gpu.device, desc, name)?;
        raw.bytes_mut()[..bytes.len()].copy_from_slice(bytes);
        let id = self.add(name, Shape::Buffer(desc));
        self.uploads.push((id, raw));
        Ok(Buffer { id, desc })
    }

    /// Adds a buffer owned by the caller, which is only read and must live until the submission has
    /// been waited for.
    pub fn import(&mut self, name: &str, buffer: &RawBuffer) -> Buffer {
        let desc = BufferDesc { place: Place::Imported, ..buffer.desc };
        let id = self.add(name, Shape::Buffer(desc));
        self.imports.push((id, Import { raw: buffer.raw, texels: buffer.texels }));
        Buffer { id, desc }
    }

    /// Adds the persistent buffer of this name and returns the number of completed steps it holds
    /// for `cache_key`. Passes of this frame extend them to the number that `wanted` returns for
    /// those held.
    pub fn persistent(
        &mut self,
        name: &str,
        bytes: u64,
        cache_key: Vec<u64>,
        wanted: impl FnOnce(u32) -> u32,
    ) -> Result<(Buffer, u32)> {
        let (raw, held) =
            self.gpu.memory.persistent_buffer(&self.gpu.device, name, bytes, &cache_key)?;
        let import = Import { raw: raw.raw, texels: raw.texels };
        let desc = BufferDesc { place: Place::Imported, ..raw.desc };
        let id = self.add(name, Shape::Buffer(desc));
        self.imports.push((id, import));
        let wanted = wanted(held);
        if wanted > held {
            // Void until the submission succeeds.
            self.gpu.memory.set_persistent_state(name, None);
            self.persistent.push((id, name.to_string(), cache_key, wanted));
        }
        Ok((Buffer { id, desc }, held))
    }

    /// Returns cache key and completed steps of a persistent buffer; `None` if it holds nothing.
    pub fn persistent_state(&self, name: &str) -> Option<(&[u64], u32)> {
        self.gpu.memory.persistent_state(name)
    }

    /// Marks a persistent buffer as void after this frame, whose passes may still read it.
    pub fn invalidate(&mut self, name: &str) {
        self.gpu.memory.invalidate(name);
    }

    /// Returns a second handle of the first buffer of this name, for tests.
    pub fn find_buffer(&self, name: &str) -> Option<Buffer> {
        self.resources.iter().enumerate().find_map(|(i, resource)| match resource.shape {
            Shape::Buffer(desc) if resource.name == name => {
                Some(Buffer { id: ResourceId(i), desc })
            }
            _ => None,
        })
    }

    fn add(&mut self, name: &str, shape: Shape) -> ResourceId {
        let Gpu { memory, device, .. } = &mut *self.gpu;
        let requirements = match shape {
            Shape::Image(desc) => Some(memory.image_requirements(device, desc)),
            Shape::Buffer(BufferDesc { bytes, place: Place::Device }) => {
                Some(memory.buffer_requirements(device, bytes))
            }
            Shape::Buffer(_) => None,
        };
        self.resources.push(Resource { name: name.to_string(), shape, requirements });
        ResourceId(self.resources.len() - 1)
    }

    /// Returns the largest storage buffer binding `[bytes]`.
    pub fn binding_limit(&self) -> u64 {
        self.gpu.device.limits.max_storage_buffer_range as u64
    }

    /// Returns the largest buffer that is gathered from as words `[bytes]`: texel buffers where the
    /// device has large ones.
    pub fn gathered_limit(&self) -> u64 {
        let device = &self.gpu.device;
        let texels = if device.has_large_texel_buffers {
            4 * device.limits.max_texel_buffer_elements as u64
        } else {
            u64::MAX
        };
        self.binding_limit().min(texels)
    }

    /// Records a compute pass.
    pub fn run<S: Shader>(&mut self, shader: S, dispatch: Dispatch<'_>) {
        let code = S::CODE;
        let mut resources = shader.resources();
        for (binding, id) in code.bindings.iter().zip(&resources) {
            let found = match self.resources[id.0].shape {
                Shape::Image(desc) => Some(desc.format),
                Shape::Buffer(_) => None,
            };
            assert_eq!(
                binding.kind.format(),
                found,
                "{}: {} got {} of another kind",
                code.name,
                binding.name,
                self.resources[id.0].name
            );
        }
        let tile_mask = self.tile_mask.filter(|_| code.listed.is_some());
        let groups = match (dispatch, tile_mask) {
            (Dispatch::Indirect(list, word), _) => Groups::Indirect(list.id, 4 * word as u64),
            (_, Some(tile_mask)) => tile_mask.groups(),
            (Dispatch::Groups(groups), _) => self.predicate(groups),
            (Dispatch::PerEightTiles(count), _) => {
                let groups = [count.div_ceil(8).min(self.gpu.device.max_workgroups), 1, 1];
                self.predicate(groups)
            }
            (Dispatch::PerPackedTexel([width, height]), _) => {
                self.predicate([width.div_ceil(code.workgroup[0]), height, 1])
            }
            (Dispatch::PerPixel | Dispatch::PerPixelInPlace, _) => {
                let written = code.bindings.iter().zip(&resources).find_map(|(binding, id)| {
                    match self.resources[id.0].shape {
                        Shape::Image(desc) if binding.access != Access::Read => Some(desc.size),
                        _ => None,
                    }
                });
                let [width, height] = written.unwrap_or_else(|| {
                    panic!("{} writes no image, so it needs Dispatch::Groups", code.name)
                });
                self.predicate([
                    width.div_ceil(code.workgroup[0]),
                    height.div_ceil(code.workgroup[1]),
                    1,
                ])
            }
        };
        resources.extend(tile_mask.map(|tile_mask| tile_mask.list));
        let mut uses: Vec<_> = code
            .bindings
            .iter()
            .zip(&resources)
            .map(|(binding, &id)| (id, binding.access))
            .collect();
        if let Groups::Indirect(list, _) = groups {
            uses.push((list, Access::Read));
        }
        let mut constants = shader.constants();
        constants.extend(code.listed.map(|listed| (listed, tile_mask.is_some() as u32)));
        self.push(
            code.name,
            uses,
            Work::Run { code, constants, push: shader.push().to_vec(), resources, groups },
        );
        self.passes.last_mut().expect("pushed").in_place =
            matches!(dispatch, Dispatch::PerPixelInPlace);
    }

    /// Records passes that run only if the device decides so. `decide` records a pass that writes
    /// the granted workgroup counts from the requested ones, three words per pass. Nested calls use
    /// the outer predicate. Outputs of skipped passes are undefined; clears and copies always run.
    pub fn predicated<T>(
        &mut self,
        decide: impl FnOnce(&mut Self, &Buffer, &mut Buffer, u32),
        record: impl FnOnce(&mut Self) -> T,
    ) -> T {
        if self.predicate.is_some() {
            return record(self);
        }
        let desc = BufferDesc {
            bytes: size_of::<[[u32; 3]; MAX_PREDICATED_PASSES]>() as u64,
            place: Place::Upload,
        };
        let wanted = Buffer { id: self.add("wanted groups", Shape::Buffer(desc)), desc };
        let mut groups = self.buffer("groups", desc.bytes);
        decide(self, &wanted, &mut groups, 3 * MAX_PREDICATED_PASSES as u32);
        self.predicate =
            Some(Predicate { wanted: wanted.id, groups: groups.id, words: Vec::new() });
        let recorded = record(self);
        let predicate = self.predicate.take().expect("put there");
        self.wanted.push((predicate.wanted, predicate.words));
        recorded
    }

    /// Restricts passes to a tile list, if their shaders include tile_mask.glsl. Devices with small
    /// texel buffers process the whole picture, with the same result.
    pub fn within_tiles<T>(
        &mut self,
        tiles: Option<&TileList>,
        record: impl FnOnce(&mut Self) -> T,
    ) -> T {
        assert!(self.tile_mask.is_none(), "a tile list within a tile list");
        self.tile_mask =
            tiles.filter(|_| self.gpu.device.has_large_texel_buffers).map(TileMask::new);
        let recorded = record(self);
        self.tile_mask = None;
        recorded
    }

    /// Records passes that reuse the images they had the time before.
    pub fn reusing<T>(
        &mut self,
        reused: &mut ReusedImages,
        record: impl FnOnce(&mut Self) -> T,
    ) -> T {
        assert!(self.reused.is_none(), "reused images within reused images");
        reused.begin();
        self.reused = Some(std::mem::take(reused));
        let recorded = record(self);
        *reused = self.reused.take().expect("put there");
        recorded
    }

    /// Returns the workgroup counts of a pass, or the place where the device reads them.
    fn predicate(&mut self, groups: [u32; 3]) -> Groups {
        let Some(predicate) = &mut self.predicate else { return Groups::Fixed(groups) };
        assert!(
            predicate.words.len() < MAX_PREDICATED_PASSES,
            "more than {MAX_PREDICATED_PASSES} predicated passes"
        );
        predicate.words.push(groups);
        Groups::Indirect(
            predicate.groups,
            (size_of_val(&groups) * (predicate.words.len() - 1)) as u64,
        )
    }

    /// Records a pass that sets every word of a buffer.
    pub fn fill(&mut self, buffer: &mut Buffer, word: u32) {
        let name = format!("clear {}", self.resources[buffer.id.0].name);
        self.push(&name, vec![(buffer.id, Access::Write)], Work::Fill { buffer: buffer.id, word });
    }

    /// Declares that an image has no contents, for passes that write it part by part: each reads
    /// only what others have written.
    pub fn discard(&mut self, image: &mut Image) {
        let name = format!("discard {}", self.resources[image.id.0].name);
        self.push(&name, vec![(image.id, Access::Write)], Work::Discard);
    }

    /// Records a copy of an image, for a reader of contents that later passes change in place.
    /// Dropped if nothing reads the copy.
    pub fn copy(&mut self, name: &str, from: &Image) -> Image {
        let to = self.image_of(name, from.desc);
        self.push(
            &format!("keep {name}"),
            vec![(from.id, Access::Read), (to.id, Access::Write)],
            Work::CopyImage { from: from.id, to: to.id },
        );
        to
    }

    /// Records copies between buffers: source offset, destination offset and length `[bytes]`.
    pub fn copy_parts(&mut self, name: &str, from: &Buffer, to: &mut Buffer, parts: Vec<[u64; 3]>) {
        if !parts.is_empty() {
            let uses = vec![(from.id, Access::Read), (to.id, Access::Modify)];
            self.push(name, uses, Work::CopyParts { from: from.id, to: to.id, parts });
        }
    }

    /// Records a draw into a colour and a depth attachment, over their contents if `keeps`.
    pub fn draw<R: Raster>(
        &mut self,
        shader: R,
        drawn: Vertices<'_>,
        [color, depth]: [&mut Image; 2],
        keeps: bool,
    ) {
        let resources = shader.resources();
        let (primitives, vertices, count) = match drawn {
            Vertices::Points(vertices, count) => {
                (raster::Primitives::Points, Some(vertices.id), count)
            }
            Vertices::Squares(count) => (raster::Primitives::Squares, None, count),
        };
        let bound =
            R::STAGES.iter().zip(&resources).flat_map(|(code, ids)| code.bindings.iter().zip(ids));
        let written = if keeps { Access::Modify } else { Access::Write };
        let uses = bound
            .map(|(binding, &id)| (id, binding.access))
            .chain(vertices.map(|id| (id, Access::Read)));
        let uses = uses.chain([(color.id, written), (depth.id, written)]).collect();
        let draw = raster::Draw {
            stages: &R::STAGES,
            constants: shader.constants(),
            push: shader.push().to_vec(),
            primitives,
            count,
            keeps,
        };
        self.push(
            R::STAGES[0].name,
            uses,
            Work::Draw { draw, resources, vertices, attachments: [color.id, depth.id] },
        );
    }

    /// Records a copy of an image to a buffer, row by row.
    pub fn copy_out(&mut self, from: &Image, to: &mut Buffer) {
        let name = format!("copy {}", self.resources[from.id.0].name);
        self.push(
            &name,
            vec![(from.id, Access::Read), (to.id, Access::Write)],
            Work::CopyOut { image: from.id, buffer: to.id },
        );
    }

    /// Requests an image's contents after the submission.
    pub fn download(&mut self, image: &Image) -> Buffer {
        let name = format!("read {}", self.resources[image.id.0].name);
        let desc = BufferDesc { bytes: image.desc.bytes(), place: Place::Download };
        let buffer = Buffer { id: self.add(&name, Shape::Buffer(desc)), desc };
        self.push(
            &name,
            vec![(image.id, Access::Read), (buffer.id, Access::Write)],
            Work::CopyOut { image: image.id, buffer: buffer.id },
        );
        buffer
    }

    /// Requests a buffer's contents after the submission.
    pub fn download_buffer(&mut self, from: &Buffer) -> Buffer {
        let name = format!("read {}", self.resources[from.id.0].name);
        let desc = BufferDesc { bytes: from.desc.bytes, place: Place::Download };
        let buffer = Buffer { id: self.add(&name, Shape::Buffer(desc)), desc };
        self.push(
            &name,
            vec![(from.id, Access::Read), (buffer.id, Access::Write)],
            Work::CopyBuffer { from: from.id, to: buffer.id, bytes: desc.bytes },
        );
        buffer
    }

    fn push(&mut self, name: &str, uses: Vec<(ResourceId, Access)>, work: Work) {
        self.passes.push(Pass { name: name.to_string(), uses, in_place: false });
        self.work.push(work);
    }

    /// Returns the plan of the passes recorded so far for the outputs `wanted`. Pure; `--explain`
    /// prints it.
    pub fn plan(&self, wanted: &[ResourceId]) -> Plan {
        plan::plan(&self.passes, &self.resources, wanted, self.gpu.device.max_allocation)
    }

    /// Plans, records and submits. Outputs are download buffers and `wanted`; passes that
    /// contribute to neither are dropped.
    pub fn submit_async(self, wanted: &[ResourceId]) -> Result<PendingSubmission> {
        Ok(self.begin(wanted, None)?.0)
    }

    /// Submits as [`Graph::submit_async`], in parts that take a software device a few milliseconds
    /// each, and calls `pause` between them, until a pass writes what is `wanted`. Meanwhile
    /// nothing is in flight; an error ends the submission.
    pub fn submit_pausing(
        self,
        wanted: &[ResourceId],
        pause: &mut Pause,
    ) -> Result<PendingSubmission> {
        Ok(self.begin(wanted, Some(pause))?.0)
    }

    /// Submits without a handle to wait for; later submissions start when it is done. Returns its
    /// number, as [`Gpu::completed`] counts. For a host, records into its current command buffer.
    pub fn submit_detached(self, wanted: &[ResourceId]) -> Result<u64> {
        if self.gpu.host.is_some() {
            return host::record_detached(self, wanted);
        }
        let (pending, gpu) = self.begin(wanted, None)?;
        gpu.detached.push(pending);
        let (done, left) =
            std::mem::take(&mut gpu.detached).into_iter().partition(PendingSubmission::is_done);
        gpu.detached = left;
        let done: Vec<PendingSubmission> = done;
        done.into_iter().try_for_each(|pending| pending.finish(gpu).map(drop))?;
        Ok(gpu.submitted)
    }

    /// Submits and waits.
    pub fn submit_and_wait(self, wanted: &[ResourceId]) -> Result<CompletedSubmission> {
        let (pending, gpu) = self.begin(wanted, None)?;
        pending.finish(gpu)
    }

    fn begin(
        mut self,
        wanted: &[ResourceId],
        pause: Option<&mut Pause>,
    ) -> Result<(PendingSubmission, &'g mut Gpu)> {
        if self.gpu.host.is_some() {
            return Err(host::refused());
        }
        let plan = self.complete(wanted)?;
        record::launch(self, plan, wanted, pause)
    }

    /// Uploads what is known when recording is complete, and plans.
    fn complete(&mut self, wanted: &[ResourceId]) -> Result<Plan> {
        for (id, words) in std::mem::take(&mut self.wanted) {
            let Shape::Buffer(desc) = self.resources[id.0].shape else {
                unreachable!("made by gated")
            };
            let mut raw = self.gpu.memory.buffer(&self.gpu.device, desc, "wanted groups")?;
            raw.bytes_mut()[..size_of_val(&words[..])]
                .copy_from_slice(bytemuck::cast_slice(&words));
            self.uploads.push((id, raw));
        }
        let mut wanted = wanted.to_vec();
        wanted.extend(self.resources.iter().enumerate().filter_map(|(i, resource)| {
            match resource.shape {
                Shape::Buffer(BufferDesc { place: Place::Download, .. }) => Some(ResourceId(i)),
                _ => None,
            }
        }));
        Ok(self.plan(&wanted))
    }
}

/// A completed submission.
pub struct CompletedSubmission {
    pub plan: Plan,
    /// Name and GPU time `[ms]` of each pass, in order.
    pub passes: Vec<(String, f64)>,
    downloads: Vec<(ResourceId, RawBuffer)>,
}

impl CompletedSubmission {
    /// Returns the contents of a download.
    pub fn read<T: bytemuck::Pod>(&self, download: &Buffer) -> &[T] {
        let (_, raw) = self
            .downloads
            .iter()
            .find(|(id, _)| *id == download.id)
            .expect("a buffer from Graph::download of this frame");
        bytemuck::cast_slice(&raw.bytes()[..download.desc.bytes as usize])
    }

    /// Returns the GPU time of all passes whose name starts with `prefix` `[ms]`.
    pub fn ms(&self, prefix: &str) -> f64 {
        self.passes.iter().filter(|(name, _)| name.starts_with(prefix)).map(|(_, ms)| ms).sum()
    }
}

/// Returns the error of a buffer beyond the device's limit.
pub(crate) fn too_large(name: &str, bytes: u64, limit: u64) -> Error {
    Error::Request(format!(
        "{name} would be {} MiB, and this device binds at most {} MiB; ask for a smaller --size",
        bytes >> 20,
        limit >> 20
    ))
}

/// Layout of all images of a frame: compute passes need no other, and barriers then need no images.
pub(crate) const LAYOUT: vk::ImageLayout = vk::ImageLayout::GENERAL;
