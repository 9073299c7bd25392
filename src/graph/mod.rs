//! The render graph: passes are recorded in order, and order of recording is order of execution.
//!
//! In: typed shader structs (`crate::shader`, generated) over handles. Out: a submission whose barriers, dropped passes and reused memory the pure
//! [`plan`] has decided. Handles are not `Clone`, so Rust's own borrow rules refuse one image as input and output of a pass.

pub mod plan;
mod record;
mod tiles;

pub use crate::gpu::{Access, BufferDesc, Code, ImageDesc, Kind, Place};
pub use record::PendingSubmission;
pub use tiles::{ReusedImages, TileList};

use crate::error::{Error, Result};
use crate::gpu::kernel::Kernels;
use crate::gpu::memory::{Memory, RawBuffer, Texels};
use crate::gpu::timeline::Timeline;
use crate::gpu::{Device, raster};
use crate::progress::Progress;
use ash::vk;
use plan::{Pass, Plan, Resource, Shape};
use tiles::TileMask;

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct ResourceId(pub usize);

/// An image of this frame.
#[derive(Debug)]
pub struct Image {
    id: ResourceId,
    pub desc: ImageDesc,
}

impl Image {
    /// A second handle, for a pass that reads of a pixel what it then writes there, or a later one; and of an image that passes are recorded over again ([`ReusedImages`]).
    pub(crate) fn alias(&self) -> Image {
        Image { id: self.id, desc: self.desc }
    }
}

/// A buffer of this frame.
#[derive(Debug)]
pub struct Buffer {
    id: ResourceId,
    pub desc: BufferDesc,
}

impl Buffer {
    /// A second handle, for a shader that reads a buffer while it writes it atomically, and takes a stale value as well as a fresh one.
    pub fn racy_alias(&self) -> Buffer {
        self.alias()
    }

    /// A second handle, for a later pass that reads what this one names.
    pub fn alias(&self) -> Buffer {
        Buffer { id: self.id, desc: self.desc }
    }
}

/// What generated code asks of a handle.
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

/// What `build.rs` implements for every compute shader.
pub trait Shader {
    const CODE: Code;
    /// In the order of `CODE.bindings`.
    fn resources(&self) -> Vec<ResourceId>;
    fn push(&self) -> &[u8];
    fn constants(&self) -> Vec<(u32, u32)>;
}

/// What `build.rs` implements for every pair of a vertex and a fragment shader.
pub trait Raster {
    const STAGES: [Code; 2];
    /// Of each stage, in the order of its bindings.
    fn resources(&self) -> [Vec<ResourceId>; 2];
    fn push(&self) -> &[u8];
    fn constants(&self) -> Vec<(u32, u32)>;
}

/// What a pass draws.
#[derive(Clone, Copy, Debug)]
pub enum Vertices<'b> {
    /// So many points of a vertex buffer of f32 x, y, z.
    Points(&'b Buffer, u32),
    /// So many squares, whose corners the vertex stage makes up.
    Squares(u32),
}

/// Over what a pass is dispatched.
#[derive(Clone, Copy, Debug)]
pub enum Dispatch<'l> {
    /// Every pixel of the first image that the pass writes.
    PerPixel,
    /// The same, and of no image is another pixel read than the one that is written: it may be written over what is read there for the last time.
    PerPixelInPlace,
    /// So many texels, each with four rows of pixels.
    PerPackedTexel([u32; 2]),
    /// Workgroups that take eight tiles of 8 x 8 pixels at a time, for so many tiles.
    PerEightTiles(u32),
    /// So many workgroups.
    Groups([u32; 3]),
    /// As many workgroups as three words of a buffer say, from this word on: tiles that an earlier pass has listed.
    Indirect(&'l Buffer, u32),
}

/// How many workgroups a pass has.
#[derive(Clone, Copy)]
pub(crate) enum Groups {
    Fixed([u32; 3]),
    /// Three words at this byte of a buffer.
    Indirect(ResourceId, u64),
}

/// What the GPU is to do in a pass.
pub(crate) enum Work {
    /// `resources` of the bindings in order; of a shader that could keep to an area and does not, without the last one.
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
    Clear {
        image: ResourceId,
    },
    /// From a byte to a byte, so many.
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
        /// Of each stage, in the order of its bindings.
        resources: [Vec<ResourceId>; 2],
        vertices: Option<ResourceId>,
        /// Colour and depth.
        attachments: [ResourceId; 2],
    },
}

/// Vulkan's names of an imported buffer.
#[derive(Clone, Copy)]
pub(crate) struct Import {
    raw: vk::Buffer,
    texels: Texels,
}

/// The device and what outlives a frame: memory, kernels.
pub struct Gpu {
    // In this order they are dropped: all of them before the device.
    pub kernels: Kernels,
    pub raster: raster::Rasters,
    /// Raised by every submission when the device is done with it, to the number of submissions so far.
    pub completed: Timeline,
    pub submitted: u64,
    /// As [`crate::gpu::DeviceOptions::lost_after`].
    pub(crate) lost_after: Option<u64>,
    /// As [`crate::gpu::DeviceOptions::surface_lost_after`].
    pub(crate) surface_lost_after: Option<u64>,
    /// Clouds that have been made resident so far.
    pub residents: u64,
    /// Submissions that nobody waits for.
    detached: Vec<PendingSubmission>,
    pub memory: Memory,
    pub device: Device,
}

impl Gpu {
    pub fn open(options: &crate::gpu::DeviceOptions) -> Result<Gpu> {
        let device = Device::open(options)?;
        let memory = Memory::new(&device)?;
        let completed = Timeline::new(&device, &memory.alive, "completed")?;
        let (kernels, raster) = (Kernels::new(&device), raster::Rasters::new(&device));
        Ok(Gpu {
            kernels,
            raster,
            completed,
            submitted: 0,
            lost_after: options.lost_after,
            surface_lost_after: options.surface_lost_after,
            residents: 0,
            detached: Vec::new(),
            memory,
            device,
        })
    }

    /// Waits for submissions that nobody has waited for.
    pub fn wait_detached(&mut self) -> Result<()> {
        std::mem::take(&mut self.detached)
            .into_iter()
            .try_for_each(|pending| pending.finish(self).map(|frame| frame.recycle(self)))
    }
}

impl Drop for Gpu {
    fn drop(&mut self) {
        // Who used the device has heard what it said.
        let _ = self.wait_detached();
    }
}

/// Passes that the device decides on as one.
struct Predicate {
    /// Those that they want, and the buffer that will hold them.
    wanted: ResourceId,
    words: Vec<[u32; 3]>,
    /// Those that they get.
    groups: ResourceId,
}

/// Passes of one gate at most.
pub const MAX_PREDICATED_PASSES: usize = 1024;

/// One frame being recorded.
pub struct Graph<'g> {
    pub gpu: &'g mut Gpu,
    passes: Vec<Pass>,
    work: Vec<Work>,
    resources: Vec<Resource>,
    /// Contents of upload buffers, by resource; made when they are asked for.
    uploads: Vec<(ResourceId, RawBuffer)>,
    imports: Vec<(ResourceId, Import)>,
    /// Buffers that outlive the frame and are changed by it: name, what they are made of, and how many steps of that they hold then.
    persistent: Vec<(ResourceId, String, Vec<u64>, u32)>,
    progress: Option<&'g dyn Progress>,
    /// Where passes are recorded that the device may skip.
    predicate: Option<Predicate>,
    /// Contents of upload buffers that are known when all has been recorded.
    wanted: Vec<(ResourceId, Vec<[u32; 3]>)>,
    /// What passes keep to that can.
    tile_mask: Option<TileMask>,
    reused: Option<ReusedImages>,
    /// For tests of the tests: record no barriers at all.
    pub without_barriers: bool,
}

impl<'g> Graph<'g> {
    pub fn new(gpu: &'g mut Gpu) -> Graph<'g> {
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
            without_barriers: false,
        }
    }

    /// With someone who listens, and may stop the frame, where it takes long: on software devices, between its passes.
    pub fn with_progress(self, progress: &'g dyn Progress) -> Graph<'g> {
        Graph { progress: Some(progress), ..self }
    }

    /// Another submission, which is to be done before this one, with the same listener.
    pub fn preceding(&mut self) -> Graph<'_> {
        Graph { progress: self.progress, ..Graph::new(self.gpu) }
    }

    /// A transient image; its contents are undefined until a pass writes them.
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

    /// A buffer that passes write for the CPU, which reads it after the submission.
    pub fn readback(&mut self, name: &str, bytes: u64) -> Buffer {
        let desc = BufferDesc { bytes, place: Place::Download };
        Buffer { id: self.add(name, Shape::Buffer(desc)), desc }
    }

    /// A transient buffer; its contents are undefined until a pass writes them.
    pub fn buffer(&mut self, name: &str, bytes: u64) -> Buffer {
        let desc = BufferDesc { bytes, place: Place::Device };
        Buffer { id: self.add(name, Shape::Buffer(desc)), desc }
    }

    /// A buffer that holds `words` from the start. Sizes are rounded up, so that frames find each other's buffers on the shelf.
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

    /// A buffer that somebody else owns, reads only, and keeps alive until the submission has been waited for.
    pub fn import(&mut self, name: &str, buffer: &RawBuffer) -> Buffer {
        let desc = BufferDesc { place: Place::Imported, ..buffer.desc };
        let id = self.add(name, Shape::Buffer(desc));
        self.imports.push((id, Import { raw: buffer.raw, texels: buffer.texels }));
        Buffer { id, desc }
    }

    /// A buffer that outlives the frame, by its name, and how many steps it holds of what is made of `cache_key`, in steps. Passes of this frame add those up to `wanted`, of how many it already holds.
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
            // Until the device has been given all of them.
            self.gpu.memory.set_persistent_state(name, None);
            self.persistent.push((id, name.to_string(), cache_key, wanted));
        }
        Ok((Buffer { id, desc }, held))
    }

    /// What the kept buffer of this name was made of, and how many steps of that it holds; none where it holds nothing.
    pub fn persistent_state(&self, name: &str) -> Option<(&[u64], u32)> {
        self.gpu.memory.persistent_state(name)
    }

    /// That nobody needs what a kept buffer holds any more; passes of this frame may still read it.
    pub fn invalidate(&mut self, name: &str) {
        self.gpu.memory.invalidate(name);
    }

    /// A second handle of a transient buffer, for who counts what passes did.
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

    /// Bytes that one storage buffer binding may have.
    pub fn binding_limit(&self) -> u64 {
        self.gpu.device.limits.max_storage_buffer_range as u64
    }

    /// The same of a buffer that is gathered from as words, too, where the device has texel buffers for that.
    pub fn gathered_limit(&self) -> u64 {
        let device = &self.gpu.device;
        let texels = if device.has_large_texel_buffers {
            4 * device.limits.max_texel_buffer_elements as u64
        } else {
            u64::MAX
        };
        self.binding_limit().min(texels)
    }

    /// A pass that runs a compute shader.
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

    /// Records passes that run only where the device says so: `decide` records a pass from the workgroups that they want to those that they get, three words a pass. TileMask another gate, that one decides.
    /// What only they write is undefined where they do not run. Clears and copies run in any case.
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

    /// Passes that keep to an area, of those that can: shaders that include area.glsl. Devices whose texel buffers are too small for a list work on the whole picture, which shows the same.
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

    /// Passes that are recorded over the images that they had the time before.
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

    /// The workgroups of a pass, or where the device finds them.
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

    /// A pass that sets every word of a buffer.
    pub fn fill(&mut self, buffer: &mut Buffer, word: u32) {
        let name = format!("clear {}", self.resources[buffer.id.0].name);
        self.push(&name, vec![(buffer.id, Access::Write)], Work::Fill { buffer: buffer.id, word });
    }

    /// A pass that sets every texel of an image to 0.
    pub fn clear(&mut self, image: &mut Image) {
        let name = format!("clear {}", self.resources[image.id.0].name);
        self.push(&name, vec![(image.id, Access::Write)], Work::Clear { image: image.id });
    }

    /// A pass that copies an image, for a reader of what it held before later passes change it in place. Dropped like any other where nobody reads the copy.
    pub fn copy(&mut self, name: &str, from: &Image) -> Image {
        let to = self.image_of(name, from.desc);
        self.push(
            &format!("keep {name}"),
            vec![(from.id, Access::Read), (to.id, Access::Write)],
            Work::CopyImage { from: from.id, to: to.id },
        );
        to
    }

    /// A pass that copies parts of a buffer into another: from a byte, to a byte, so many bytes.
    pub fn copy_parts(&mut self, name: &str, from: &Buffer, to: &mut Buffer, parts: Vec<[u64; 3]>) {
        if !parts.is_empty() {
            let uses = vec![(from.id, Access::Read), (to.id, Access::Modify)];
            self.push(name, uses, Work::CopyParts { from: from.id, to: to.id, parts });
        }
    }

    /// A pass that draws through the rasteriser: into a colour and a depth attachment, over what they hold where that is to be kept.
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

    /// A pass that copies an image to a buffer, row by row.
    pub fn copy_out(&mut self, from: &Image, to: &mut Buffer) {
        let name = format!("copy {}", self.resources[from.id.0].name);
        self.push(
            &name,
            vec![(from.id, Access::Read), (to.id, Access::Write)],
            Work::CopyOut { image: from.id, buffer: to.id },
        );
    }

    /// Asks for an image's contents after the submission.
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

    /// Asks for a buffer's contents after the submission.
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

    /// The plan of what has been recorded so far, if nothing but `wanted` is asked of it. Pure; `--explain` prints it.
    pub fn plan(&self, wanted: &[ResourceId]) -> Plan {
        plan::plan(&self.passes, &self.resources, wanted, self.gpu.device.max_allocation)
    }

    /// Plans, records and submits. What is in a download buffer, or `wanted`, is what the frame is for; passes that serve neither are dropped.
    pub fn submit_async(self, wanted: &[ResourceId]) -> Result<PendingSubmission> {
        Ok(self.begin(wanted)?.0)
    }

    /// The same, and nobody waits for it; later submissions begin when it is done. Its number, as [`Gpu::completed`] counts.
    pub fn submit_detached(self, wanted: &[ResourceId]) -> Result<u64> {
        let (pending, gpu) = self.begin(wanted)?;
        gpu.detached.push(pending);
        let (done, left) =
            std::mem::take(&mut gpu.detached).into_iter().partition(PendingSubmission::is_done);
        gpu.detached = left;
        let done: Vec<PendingSubmission> = done;
        done.into_iter()
            .try_for_each(|pending| pending.finish(gpu).map(|frame| frame.recycle(gpu)))?;
        Ok(gpu.submitted)
    }

    /// The same, and waits.
    pub fn submit_and_wait(self, wanted: &[ResourceId]) -> Result<CompletedSubmission> {
        let (pending, gpu) = self.begin(wanted)?;
        pending.finish(gpu)
    }

    fn begin(mut self, wanted: &[ResourceId]) -> Result<(PendingSubmission, &'g mut Gpu)> {
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
        let plan =
            plan::plan(&self.passes, &self.resources, &wanted, self.gpu.device.max_allocation);
        record::launch(self, plan)
    }
}

/// A finished submission.
pub struct CompletedSubmission {
    pub plan: Plan,
    /// Milliseconds on the device of each pass that ran, in order.
    pub passes: Vec<(String, f64)>,
    downloads: Vec<(ResourceId, RawBuffer)>,
}

impl CompletedSubmission {
    /// What a [`Graph::download`] brought.
    pub fn read<T: bytemuck::Pod>(&self, download: &Buffer) -> &[T] {
        let (_, raw) = self
            .downloads
            .iter()
            .find(|(id, _)| *id == download.id)
            .expect("a buffer from Graph::download of this frame");
        bytemuck::cast_slice(&raw.bytes()[..download.desc.bytes as usize])
    }

    /// Gives the download buffers back for the next frame.
    pub fn recycle(self, gpu: &mut Gpu) {
        for (_, raw) in self.downloads {
            gpu.memory.recycle_buffer(raw);
        }
    }

    /// Milliseconds of all passes whose name starts with `prefix`.
    pub fn ms(&self, prefix: &str) -> f64 {
        self.passes.iter().filter(|(name, _)| name.starts_with(prefix)).map(|(_, ms)| ms).sum()
    }
}

/// An error of a submission that was asked for more than the device takes.
pub(crate) fn too_large(name: &str, bytes: u64, limit: u64) -> Error {
    Error::Request(format!(
        "{name} would be {} MiB, and this device binds at most {} MiB; ask for a smaller --size",
        bytes >> 20,
        limit >> 20
    ))
}

/// The layout that every image of a frame is in: compute passes need no other, and barriers then need no images.
pub(crate) const LAYOUT: vk::ImageLayout = vk::ImageLayout::GENERAL;
