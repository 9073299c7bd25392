//! Named buffers and images, and their memory.
//!
//! gpu-allocator provides the memory. Buffers and blocks give themselves back when they are
//! dropped. What a frame has finished with is recycled: buffers for the
//! same description, memory blocks, in which a frame's images and buffers lie, for a frame of about
//! the same size. Touching fresh pages costs seconds per GiB on a software device, and allocations
//! are slow on every other.

use super::logical_device::Fresh;
use super::{Device, LogicalDevice, failed};
use crate::error::{Error, Result};
use ash::vk;
use gpu_allocator::vulkan::{
    Allocation, AllocationCreateDesc, AllocationScheme, Allocator, AllocatorCreateDesc,
};
use gpu_allocator::{AllocationSizes, MemoryLocation};
use std::collections::HashMap;
use std::mem::ManuallyDrop;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, PoisonError, RwLock};

/// Memory that small buffers and images share. Larger ones have memory of their own, which is freed
/// with them; beside small ones, it would stay.
const SHARED_BYTES: u64 = 8 << 20;

/// Memory kind of a buffer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Place {
    Device,
    /// Written by the CPU through a persistent map, read by the device; device-local if there is
    /// such memory.
    Upload,
    /// Written by the device, read by the CPU.
    Download,
    /// Owned elsewhere, such as pages of resident nodes; outlives the frame and has contents from
    /// the start.
    Imported,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct BufferDesc {
    pub bytes: u64,
    pub place: Place,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct ImageDesc {
    /// Width and height `[px]`.
    pub size: [u32; 2],
    pub format: vk::Format,
}

impl ImageDesc {
    /// Describes a depth attachment.
    pub fn depth(size: [u32; 2]) -> ImageDesc {
        ImageDesc { size, format: vk::Format::D32_SFLOAT }
    }

    /// Describes an attachment of 64-bit keys.
    pub fn keys(size: [u32; 2]) -> ImageDesc {
        ImageDesc { size, format: vk::Format::R32G32_UINT }
    }

    pub fn bytes_per_pixel(&self) -> u64 {
        match self.format {
            vk::Format::R32G32B32A32_SFLOAT => 16,
            vk::Format::R32G32_UINT => 8,
            _ => 4,
        }
    }

    pub fn bytes(&self) -> u64 {
        self.size[0] as u64 * self.size[1] as u64 * self.bytes_per_pixel()
    }

    /// Returns the range that covers the image.
    pub fn whole(&self) -> vk::ImageSubresourceRange {
        let aspect = if self.format == vk::Format::D32_SFLOAT {
            vk::ImageAspectFlags::DEPTH
        } else {
            vk::ImageAspectFlags::COLOR
        };
        vk::ImageSubresourceRange {
            aspect_mask: aspect,
            level_count: 1,
            layer_count: 1,
            ..Default::default()
        }
    }
}

/// Views of a buffer as texels of one and of four 32-bit words; null for downloads.
#[derive(Clone, Copy, Debug, Default)]
pub struct Texels {
    pub words: vk::BufferView,
    pub fours: vk::BufferView,
}

/// A buffer with its memory; mapped unless device-only. When it is dropped, a later frame recycles
/// it; the device must have completed what uses it, or complete it before later submissions.
pub struct RawBuffer {
    parts: Option<BufferParts>,
    freed: Sender<Freed>,
}

impl std::ops::Deref for RawBuffer {
    type Target = BufferParts;

    fn deref(&self) -> &BufferParts {
        self.parts.as_ref().expect("taken by the end only")
    }
}

impl Drop for RawBuffer {
    fn drop(&mut self) {
        // Without a receiver the device is gone, too.
        if let Some(parts) = self.parts.take() {
            let _ = self.freed.send(Freed::Buffer(parts));
        }
    }
}

/// Parts of a buffer.
pub struct BufferParts {
    pub raw: vk::Buffer,
    pub desc: BufferDesc,
    /// Device address, for shaders that read pages by pointer.
    pub address: u64,
    /// Texel views of the whole buffer.
    pub texels: Texels,
    allocation: Allocation,
}

impl RawBuffer {
    pub fn bytes(&self) -> &[u8] {
        self.allocation.mapped_slice().expect("a mapped buffer")
    }

    pub fn bytes_mut(&mut self) -> &mut [u8] {
        let parts = self.parts.as_mut().expect("taken by the end only");
        parts.allocation.mapped_slice_mut().expect("a mapped buffer")
    }

    /// Frees the memory when nothing is in flight, instead of keeping it for later frames.
    pub fn destroy(mut self) {
        if let Some(parts) = self.parts.take() {
            let _ = self.freed.send(Freed::DestroyedBuffer(parts));
        }
    }

    /// Returns a part of a mapped buffer for another thread, valid until `alive` is closed: before
    /// the buffer is freed, or with the device.
    pub fn mapped_range(&self, bytes: std::ops::Range<u64>, alive: &LifetimeGuard) -> MappedRange {
        assert!(bytes.start <= bytes.end && bytes.end <= self.desc.bytes);
        let map = self.allocation.mapped_ptr().expect("a mapped buffer").as_ptr().cast::<u8>();
        MappedRange {
            first: map.wrapping_add(bytes.start as usize),
            length: (bytes.end - bytes.start) as usize,
            alive: alive.clone(),
        }
    }
}

/// A guard of device memory for threads that may outlive the device.
#[derive(Clone)]
pub struct LifetimeGuard {
    own: Arc<RwLock<bool>>,
    /// The guard of the enclosing object.
    parent: Option<Arc<RwLock<bool>>>,
}

impl LifetimeGuard {
    fn new() -> LifetimeGuard {
        LifetimeGuard { own: Arc::new(RwLock::new(true)), parent: None }
    }

    /// Returns a guard of something that ends with the device or before.
    pub fn child(&self) -> LifetimeGuard {
        LifetimeGuard { parent: Some(self.own.clone()), ..LifetimeGuard::new() }
    }

    /// Runs `work` while holding the object alive; returns `otherwise` if it is gone.
    pub fn with_alive<T>(&self, otherwise: T, work: impl FnOnce() -> Result<T>) -> Result<T> {
        let parent = self
            .parent
            .as_ref()
            .map(|parent| parent.read().unwrap_or_else(PoisonError::into_inner));
        let own = self.own.read().unwrap_or_else(PoisonError::into_inner);
        // Both stay locked until the work is done.
        match *own && parent.as_ref().is_none_or(|parent| **parent) {
            true => work(),
            false => Ok(otherwise),
        }
    }

    /// Waits for running work, then runs `last` if this is the first call and the parent is alive.
    pub fn close(&self, last: impl FnOnce()) {
        let parent = self
            .parent
            .as_ref()
            .map(|parent| parent.read().unwrap_or_else(PoisonError::into_inner));
        let mut own = self.own.write().unwrap_or_else(PoisonError::into_inner);
        if std::mem::take(&mut *own) && parent.as_ref().is_none_or(|parent| **parent) {
            last();
        }
    }
}

/// A range of a mapped buffer for another thread to write. Its creator keeps the buffer, and all
/// other access away from the range, until it is dropped.
pub struct MappedRange {
    first: *mut u8,
    length: usize,
    alive: LifetimeGuard,
}

// SAFETY: nothing else accesses the bytes (see above), and any thread may write mapped memory.
unsafe impl Send for MappedRange {}

impl MappedRange {
    pub fn write(&mut self, at: usize, bytes: &[u8]) {
        assert!(
            at.checked_add(bytes.len()).is_some_and(|end| end <= self.length),
            "{} bytes at {at} of {}",
            bytes.len(),
            self.length
        );
        let written = self.alive.with_alive((), || {
            // SAFETY: the range check is above; the map lives as long as the buffer, whose end
            // closes `alive`, and `bytes` cannot overlap memory that only we write.
            unsafe {
                std::ptr::copy_nonoverlapping(bytes.as_ptr(), self.first.add(at), bytes.len())
            };
            Ok(())
        });
        written.expect("writing cannot fail");
    }
}

/// An image placed in a block.
#[derive(Clone, Copy)]
pub struct RawImage {
    pub raw: vk::Image,
    pub view: vk::ImageView,
    pub desc: ImageDesc,
}

/// Most memory requirements that are remembered. A frame has some hundred, each size of a window
/// others.
const MOST_REQUIREMENTS: usize = 2048;

/// Forgets all entries of a map that has the most.
fn make_room<K>(remembered: &mut HashMap<K, MemoryRequirements>) {
    if remembered.len() >= MOST_REQUIREMENTS {
        remembered.clear();
    }
}

/// Memory requirements: size, alignment, and a mask of memory types.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MemoryRequirements {
    pub bytes: u64,
    pub align: u64,
    pub types: u32,
}

/// A device-memory block with the images and buffers placed in it, which may alias each other. When
/// it is dropped, a later frame recycles it.
pub struct Block {
    parts: Option<BlockParts>,
    freed: Sender<Freed>,
}

impl std::ops::Deref for Block {
    type Target = BlockParts;

    fn deref(&self) -> &BlockParts {
        self.parts.as_ref().expect("taken by the end only")
    }
}

impl std::ops::DerefMut for Block {
    fn deref_mut(&mut self) -> &mut BlockParts {
        self.parts.as_mut().expect("taken by the end only")
    }
}

impl Drop for Block {
    fn drop(&mut self) {
        if let Some(parts) = self.parts.take() {
            let _ = self.freed.send(Freed::Block(parts));
        }
    }
}

/// What was dropped.
enum Freed {
    Buffer(BufferParts),
    DestroyedBuffer(BufferParts),
    Block(BlockParts),
}

/// Parts of a block.
pub struct BlockParts {
    requirements: MemoryRequirements,
    allocation: Allocation,
    /// Each with the value of `blocks_asked` when it was last used.
    images: HashMap<(ImageDesc, u64), (RawImage, u64)>,
    /// Likewise.
    buffers: HashMap<(BufferDesc, u64), (vk::Buffer, Texels, u64)>,
    /// Value of `blocks_asked` when it was recycled.
    recycled_at: u64,
}

/// Requests for blocks after which what is unused is freed: blocks, images and buffers within them,
/// and recycled buffers; graphs after which persistent buffers are. A picture or window had another
/// size once, or an effect ran.
const MAX_AGE: u64 = 64;
/// Largest ratio of a block's size to the requested one; larger blocks are left for larger
/// requests.
const MAX_OVERSIZE: u64 = 4;

/// A buffer that outlives the frame, with the cache key of its contents and the number of completed
/// steps; `None` until a frame has filled it.
struct PersistentBuffer {
    buffer: RawBuffer,
    state: Option<(Vec<u64>, u32)>,
    /// Value of `graphs` when it was last used.
    used: u64,
}

/// Creates, recycles and destroys buffers and images. Dropped before the device.
pub struct Memory {
    allocator: ManuallyDrop<Allocator>,
    /// Dropped objects; they arrive from any thread.
    freed: (Sender<Freed>, Receiver<Freed>),
    /// Recycled buffers, each with the value of `blocks_asked` when it was recycled, and the frame
    /// that may use it.
    buffers: HashMap<BufferDesc, Vec<(BufferParts, u64, u64)>>,
    blocks: Vec<BlockParts>,
    /// Buffers to destroy when nothing is in flight, each with the frame that may use it.
    destroyed: Vec<(BufferParts, u64)>,
    /// Frame of a host that is recorded, or was recorded last, and the last one that is completed;
    /// both 0 on a queue of our own.
    frames: [u64; 2],
    blocks_asked: u64,
    /// Number of graphs begun, but for those that precede another one.
    graphs: u64,
    image_requirements: HashMap<ImageDesc, MemoryRequirements>,
    buffer_requirements: HashMap<u64, MemoryRequirements>,
    persistent: HashMap<String, PersistentBuffer>,
    device: LogicalDevice,
    /// True if images may be presented; those of a host's frames are recycled when it is done.
    presents: bool,
    /// Bytes allocated, in use or recycled.
    pub allocated: u64,
    pub alive: LifetimeGuard,
}

impl Memory {
    pub fn new(device: &Device) -> Result<Memory> {
        let allocator = Allocator::new(&AllocatorCreateDesc {
            instance: device.instance.clone(),
            device: (*device.raw).clone(),
            physical_device: device.physical,
            debug_settings: Default::default(),
            buffer_device_address: true,
            allocation_sizes: AllocationSizes::new(SHARED_BYTES, SHARED_BYTES),
        })
        .map_err(|error| Error::Device(format!("cannot set up device memory: {error}")))?;
        Ok(Memory {
            allocator: ManuallyDrop::new(allocator),
            freed: channel(),
            buffers: HashMap::new(),
            blocks: Vec::new(),
            destroyed: Vec::new(),
            frames: [0; 2],
            blocks_asked: 0,
            graphs: 0,
            image_requirements: HashMap::new(),
            buffer_requirements: HashMap::new(),
            persistent: HashMap::new(),
            device: device.raw.clone(),
            presents: device.queue.is_some(),
            allocated: 0,
            alive: LifetimeGuard::new(),
        })
    }

    pub fn buffer(&mut self, device: &Device, desc: BufferDesc, name: &str) -> Result<RawBuffer> {
        self.collect();
        if let Some((parts, ..)) = self.buffers.get_mut(&desc).and_then(Vec::pop) {
            device.name(parts.raw, name);
            return Ok(self.owned_buffer(parts));
        }
        // SAFETY: a plain creation on a live device; memory is bound before the buffer is returned.
        let (raw, requirements) = unsafe {
            let raw = device.raw.make(&buffer_info(desc.bytes))?;
            let requirements = device.raw.get_buffer_memory_requirements(*raw);
            (raw, requirements)
        };
        let location = match desc.place {
            Place::Device => MemoryLocation::GpuOnly,
            Place::Upload | Place::Imported => MemoryLocation::CpuToGpu,
            Place::Download => MemoryLocation::GpuToCpu,
        };
        let allocation = self.allocate(name, requirements, location, true)?;
        // SAFETY: see above.
        let bound = unsafe {
            device.raw.bind_buffer_memory(*raw, allocation.memory(), allocation.offset())
        };
        let texels = bound.map_err(failed("vkBindBufferMemory")).and_then(|()| match desc.place {
            Place::Download => Ok(Texels::default()),
            _ => texels(device, *raw, desc.bytes),
        });
        let texels = match texels {
            Ok(texels) => texels,
            Err(error) => {
                // Memory is freed after what is bound to it.
                drop(raw);
                self.free(allocation);
                return Err(error);
            }
        };
        let raw = raw.keep();
        device.name(raw, name);
        // SAFETY: the buffer has memory.
        let address = unsafe {
            self.device
                .get_buffer_device_address(&vk::BufferDeviceAddressInfo::default().buffer(raw))
        };
        Ok(self.owned_buffer(BufferParts { raw, desc, address, texels, allocation }))
    }

    fn owned_buffer(&self, parts: BufferParts) -> RawBuffer {
        RawBuffer { parts: Some(parts), freed: self.freed.0.clone() }
    }

    fn owned_block(&self, parts: BlockParts) -> Block {
        Block { parts: Some(parts), freed: self.freed.0.clone() }
    }

    /// Takes in what was dropped.
    fn collect(&mut self) {
        while let Ok(freed) = self.freed.1.try_recv() {
            match freed {
                Freed::Buffer(parts) => {
                    let recycled = (parts, self.blocks_asked, self.frames[0]);
                    self.buffers.entry(recycled.0.desc).or_default().push(recycled);
                }
                Freed::DestroyedBuffer(parts) => self.destroyed.push((parts, self.frames[0])),
                Freed::Block(mut block) => {
                    let recycled_at = self.blocks_asked;
                    self.empty(&mut block, recycled_at.saturating_sub(MAX_AGE));
                    self.blocks.push(BlockParts { recycled_at, ..block });
                }
            }
        }
    }

    /// Returns whether buffers wait to be destroyed.
    pub fn has_destroyed(&mut self) -> bool {
        self.collect();
        !self.destroyed.is_empty()
    }

    /// Destroys what waits for that; nothing that uses it may be in flight.
    pub fn destroy_now(&mut self) {
        self.collect();
        std::mem::take(&mut self.destroyed)
            .into_iter()
            .for_each(|(parts, _)| self.destroy_buffer(parts));
    }

    /// Begins a frame of a host, and destroys what only completed ones may use.
    pub fn begin_frame(&mut self, frame: u64, completed: u64) {
        self.collect();
        self.frames = [frame, completed];
        let unused: Vec<_> =
            self.destroyed.extract_if(.., |(_, used_by)| *used_by <= completed).collect();
        unused.into_iter().for_each(|(parts, _)| self.destroy_buffer(parts));
    }

    /// Begins a graph, and frees persistent buffers that went unused. No graph that is still to be
    /// submitted may have one of them.
    pub fn begin_graph(&mut self) {
        self.graphs += 1;
        let is_old = |kept: &PersistentBuffer| kept.used + MAX_AGE < self.graphs;
        let old = self.persistent.extract_if(|_, kept| is_old(kept));
        old.for_each(|(_, kept)| kept.buffer.destroy());
    }

    /// Marks the contents of all persistent buffers as void.
    pub fn invalidate_all(&mut self) {
        self.persistent.values_mut().for_each(|kept| kept.state = None);
    }

    /// Returns the memory requirements of an image.
    pub fn image_requirements(&mut self, device: &Device, desc: ImageDesc) -> MemoryRequirements {
        make_room(&mut self.image_requirements);
        *self.image_requirements.entry(desc).or_insert_with(|| {
            let info = image_info(desc);
            let mut needs = vk::MemoryRequirements2::default();
            // SAFETY: a query that creates no image.
            unsafe {
                self.device.get_device_image_memory_requirements(
                    &vk::DeviceImageMemoryRequirements::default().create_info(&info),
                    &mut needs,
                )
            };
            requirements(device, needs.memory_requirements)
        })
    }

    /// Returns the memory requirements of a device-only buffer.
    pub fn buffer_requirements(&mut self, device: &Device, bytes: u64) -> MemoryRequirements {
        make_room(&mut self.buffer_requirements);
        *self.buffer_requirements.entry(bytes).or_insert_with(|| {
            let info = buffer_info(bytes);
            let mut needs = vk::MemoryRequirements2::default();
            // SAFETY: a query that creates no buffer.
            unsafe {
                self.device.get_device_buffer_memory_requirements(
                    &vk::DeviceBufferMemoryRequirements::default().create_info(&info),
                    &mut needs,
                )
            };
            requirements(device, needs.memory_requirements)
        })
    }

    /// Returns a block that satisfies the requirements. A block that is too small is freed.
    pub fn block(&mut self, wanted: MemoryRequirements) -> Result<Block> {
        self.collect();
        self.blocks_asked += 1;
        let asked = self.blocks_asked;
        let is_old = |recycled_at: u64| recycled_at + MAX_AGE < asked;
        let old: Vec<BlockParts> =
            self.blocks.extract_if(.., |block| is_old(block.recycled_at)).collect();
        old.into_iter().for_each(|block| self.destroy_block(block));
        let (of_size, completed) = (self.buffers.values_mut(), self.frames[1]);
        let old: Vec<_> = of_size
            .flat_map(|recycled| {
                recycled.extract_if(.., |(_, recycled_at, used_by)| {
                    is_old(*recycled_at) && *used_by <= completed
                })
            })
            .collect();
        old.into_iter().for_each(|(buffer, ..)| self.destroy_buffer(buffer));
        self.buffers.retain(|_, recycled| !recycled.is_empty());

        let alike = |block: &BlockParts| {
            block.requirements.types == wanted.types && block.requirements.align >= wanted.align
        };
        let sizes = || {
            self.blocks
                .iter()
                .enumerate()
                .filter(|(_, block)| alike(block))
                .map(|(i, block)| (block.requirements.bytes, i))
        };
        if let Some((_, place)) = sizes()
            .filter(|(bytes, _)| (wanted.bytes..=MAX_OVERSIZE * wanted.bytes).contains(bytes))
            .min()
        {
            let parts = self.blocks.swap_remove(place);
            return Ok(self.owned_block(parts));
        }
        if let Some((_, place)) = sizes().filter(|(bytes, _)| *bytes < wanted.bytes).max() {
            let small = self.blocks.swap_remove(place);
            self.destroy_block(small);
        }
        let requirements = vk::MemoryRequirements {
            size: wanted.bytes,
            alignment: wanted.align,
            memory_type_bits: wanted.types,
        };
        let allocation = self.allocate("a frame", requirements, MemoryLocation::GpuOnly, false)?;
        Ok(self.owned_block(BlockParts {
            requirements: wanted,
            allocation,
            images: HashMap::new(),
            buffers: HashMap::new(),
            recycled_at: 0,
        }))
    }

    /// Returns an image placed at byte `at` of a block.
    pub fn image(
        &mut self,
        device: &Device,
        block: &mut Block,
        at: u64,
        desc: ImageDesc,
        name: &str,
    ) -> Result<RawImage> {
        if let Some((image, used)) = block.images.get_mut(&(desc, at)) {
            *used = self.blocks_asked;
            device.name(image.raw, name);
            return Ok(*image);
        }
        // SAFETY: a plain creation on a live device; memory is bound before the image is returned.
        let raw = unsafe { device.raw.make(&image_info(desc)) }?;
        let view_info = vk::ImageViewCreateInfo::default()
            .image(*raw)
            .view_type(vk::ImageViewType::TYPE_2D)
            .format(desc.format)
            .subresource_range(desc.whole());
        // SAFETY: the block has room there, as its owner ensures; the view is of the image just
        // bound.
        let view = unsafe {
            self.device
                .bind_image_memory(*raw, block.allocation.memory(), block.allocation.offset() + at)
                .map_err(failed("vkBindImageMemory"))?;
            device.raw.make(&view_info)?.keep()
        };
        let raw = raw.keep();
        device.name(raw, name);
        device.name(view, name);
        let image = RawImage { raw, view, desc };
        block.images.insert((desc, at), (image, self.blocks_asked));
        Ok(image)
    }

    /// Returns an image with a block of its own.
    pub fn image_alone(
        &mut self,
        device: &Device,
        desc: ImageDesc,
        name: &str,
    ) -> Result<(RawImage, Block)> {
        let requirements = self.image_requirements(device, desc);
        let mut block = self.block(requirements)?;
        let image = self.image(device, &mut block, 0, desc, name)?;
        Ok((image, block))
    }

    /// Returns a buffer placed at byte `at` of a block.
    pub fn buffer_in(
        &mut self,
        device: &Device,
        block: &mut Block,
        at: u64,
        desc: BufferDesc,
        name: &str,
    ) -> Result<(vk::Buffer, Texels)> {
        if let Some((raw, texels, used)) = block.buffers.get_mut(&(desc, at)) {
            *used = self.blocks_asked;
            let (raw, texels) = (*raw, *texels);
            device.name(raw, name);
            return Ok((raw, texels));
        }
        // SAFETY: as in `image`; the block has room there, as its owner ensures.
        let raw = unsafe {
            let raw = device.raw.make(&buffer_info(desc.bytes))?;
            let at = block.allocation.offset() + at;
            (self.device.bind_buffer_memory(*raw, block.allocation.memory(), at))
                .map_err(failed("vkBindBufferMemory"))?;
            raw
        };
        let texels = texels(device, *raw, desc.bytes)?;
        let raw = raw.keep();
        device.name(raw, name);
        block.buffers.insert((desc, at), (raw, texels, self.blocks_asked));
        Ok((raw, texels))
    }

    /// Waits for presentations, which may still use a block that has been recycled. This is rare.
    fn wait_for_presentation(&self) {
        if self.presents {
            // SAFETY: only this thread submits to the device. A lost device is idle.
            let _ = unsafe { self.device.device_wait_idle() };
        }
    }

    /// Destroys what a block holds and was last used before `since`.
    fn empty(&self, block: &mut BlockParts, since: u64) {
        let images: Vec<_> = block.images.extract_if(|_, (_, used)| *used < since).collect();
        let buffers: Vec<_> = block.buffers.extract_if(|_, (.., used)| *used < since).collect();
        if !images.is_empty() || !buffers.is_empty() {
            self.wait_for_presentation();
        }
        // SAFETY: only the caller has the block, and it is done with it.
        unsafe {
            for (_, (image, _)) in images {
                self.device.destroy(image.view);
                self.device.destroy(image.raw);
            }
            for (_, (buffer, texels, _)) in buffers {
                self.destroy_with_views(buffer, texels);
            }
        }
    }

    fn destroy_block(&mut self, mut block: BlockParts) {
        self.empty(&mut block, u64::MAX);
        self.free(block.allocation);
    }

    /// Returns the persistent buffer of this name, enlarged if needed, and the number of steps it
    /// holds for `cache_key`. Contents of another key are void.
    pub fn persistent_buffer(
        &mut self,
        device: &Device,
        name: &str,
        bytes: u64,
        cache_key: &[u64],
    ) -> Result<(&RawBuffer, u32)> {
        if self.persistent.get(name).is_some_and(|kept| kept.buffer.desc.bytes < bytes) {
            self.persistent.remove(name);
        }
        if !self.persistent.contains_key(name) {
            // Rounded up, so that a buffer that grows frame by frame does not leave one of every
            // size.
            let desc = BufferDesc { bytes: bytes.next_power_of_two(), place: Place::Device };
            let buffer = self.buffer(device, desc, name)?;
            let kept = PersistentBuffer { buffer, state: None, used: 0 };
            self.persistent.insert(name.to_string(), kept);
        }
        let kept = self.persistent.get_mut(name).expect("put there");
        kept.used = self.graphs;
        let steps = kept
            .state
            .as_ref()
            .filter(|(before, _)| before == cache_key)
            .map_or(0, |(_, steps)| *steps);
        if steps == 0 {
            kept.state = None;
        }
        Ok((&kept.buffer, steps))
    }

    /// Returns cache key and completed steps of a persistent buffer; `None` if it holds nothing.
    pub fn persistent_state(&self, name: &str) -> Option<(&[u64], u32)> {
        self.persistent
            .get(name)?
            .state
            .as_ref()
            .map(|(cache_key, steps)| (cache_key.as_slice(), *steps))
    }

    /// Marks the contents of a persistent buffer as void, if there is one of this name.
    pub fn invalidate(&mut self, name: &str) {
        self.persistent.get_mut(name).into_iter().for_each(|kept| kept.state = None);
    }

    /// Sets cache key and completed steps of a persistent buffer; `None` while a frame is filling
    /// it.
    pub fn set_persistent_state(&mut self, name: &str, state: Option<(Vec<u64>, u32)>) {
        self.persistent.get_mut(name).expect("a name that persistent_buffer was asked for").state =
            state;
    }

    fn destroy_buffer(&mut self, buffer: BufferParts) {
        // SAFETY: the caller owned the buffer and the GPU is done with it.
        unsafe { self.destroy_with_views(buffer.raw, buffer.texels) };
        self.free(buffer.allocation);
    }

    /// Destroys a buffer and its views.
    ///
    /// # Safety The GPU is done with them, and nothing else has them.
    unsafe fn destroy_with_views(&self, buffer: vk::Buffer, texels: Texels) {
        // SAFETY: as the caller ensures.
        unsafe {
            self.device.destroy(texels.words);
            self.device.destroy(texels.fours);
            self.device.destroy(buffer);
        }
    }

    fn allocate(
        &mut self,
        name: &str,
        requirements: vk::MemoryRequirements,
        location: MemoryLocation,
        linear: bool,
    ) -> Result<Allocation> {
        let desc = AllocationCreateDesc {
            name,
            requirements,
            location,
            linear,
            allocation_scheme: AllocationScheme::GpuAllocatorManaged,
        };
        let allocation = self.allocator.allocate(&desc).map_err(|error| {
            Error::Device(format!(
                "{name} needs {} MiB of device memory ({error}); a smaller --size or fewer points need less",
                requirements.size >> 20
            ))
        })?;
        self.allocated += allocation.size();
        Ok(allocation)
    }

    fn free(&mut self, allocation: Allocation) {
        self.allocated -= allocation.size();
        self.allocator.free(allocation).expect("an allocation is freed once");
    }
}

impl Drop for Memory {
    fn drop(&mut self) {
        self.alive.close(|| ());
        self.persistent.clear();
        self.destroy_now();
        for (buffer, ..) in std::mem::take(&mut self.buffers).into_values().flatten() {
            self.destroy_buffer(buffer);
        }
        for block in std::mem::take(&mut self.blocks) {
            self.destroy_block(block);
        }
        // SAFETY: dropped once, here, while the device is still alive.
        unsafe { ManuallyDrop::drop(&mut self.allocator) };
    }
}

/// Creates the texel views. They end early on devices with small texel buffers, which read large
/// buffers otherwise ([`Device::has_large_texel_buffers`]).
fn texels(device: &Device, buffer: vk::Buffer, bytes: u64) -> Result<Texels> {
    let words = texels_of(device, buffer, bytes, vk::Format::R32_UINT)?;
    let fours = texels_of(device, buffer, bytes, vk::Format::R32G32B32A32_UINT)?;
    let [words, fours] = [words, fours].map(|view| view.map(Fresh::keep).unwrap_or_default());
    Ok(Texels { words, fours })
}

/// Creates a view of as many whole texels as the buffer and the device allow, if there are any.
fn texels_of(
    device: &Device,
    buffer: vk::Buffer,
    bytes: u64,
    format: vk::Format,
) -> Result<Option<Fresh<'_, vk::BufferView>>> {
    let texel = if format == vk::Format::R32_UINT { 4 } else { 16 };
    let texels = (bytes / texel).min(device.limits.max_texel_buffer_elements as u64);
    let view =
        vk::BufferViewCreateInfo::default().buffer(buffer).format(format).range(texels * texel);
    // SAFETY: the buffer has memory and STORAGE_TEXEL_BUFFER usage; both formats are mandatory for
    // it.
    (texels > 0).then(|| unsafe { device.raw.make(&view) }).transpose()
}

fn buffer_info(bytes: u64) -> vk::BufferCreateInfo<'static> {
    use vk::BufferUsageFlags as Usage;
    let usage = Usage::STORAGE_BUFFER
        | Usage::TRANSFER_SRC
        | Usage::TRANSFER_DST
        | Usage::SHADER_DEVICE_ADDRESS
        | Usage::VERTEX_BUFFER
        | Usage::INDIRECT_BUFFER
        | Usage::STORAGE_TEXEL_BUFFER;
    vk::BufferCreateInfo::default().size(bytes.max(4)).usage(usage)
}

fn image_info(desc: ImageDesc) -> vk::ImageCreateInfo<'static> {
    use vk::ImageUsageFlags as Usage;
    let attachment = match desc.format {
        vk::Format::D32_SFLOAT => Usage::DEPTH_STENCIL_ATTACHMENT,
        // Not all devices support these as storage images.
        vk::Format::B8G8R8A8_UNORM | vk::Format::R8G8B8A8_UNORM | vk::Format::R32G32_UINT => {
            Usage::COLOR_ATTACHMENT
        }
        _ => Usage::STORAGE | Usage::COLOR_ATTACHMENT,
    };
    vk::ImageCreateInfo::default()
        .image_type(vk::ImageType::TYPE_2D)
        .format(desc.format)
        .extent(vk::Extent3D { width: desc.size[0], height: desc.size[1], depth: 1 })
        .mip_levels(1)
        .array_layers(1)
        .samples(vk::SampleCountFlags::TYPE_1)
        .tiling(vk::ImageTiling::OPTIMAL)
        .usage(attachment | Usage::TRANSFER_SRC | Usage::TRANSFER_DST)
}

/// Rounds requirements up to the device's buffer-image granularity.
fn requirements(device: &Device, needs: vk::MemoryRequirements) -> MemoryRequirements {
    let align = needs.alignment.max(device.limits.buffer_image_granularity);
    MemoryRequirements {
        bytes: needs.size.next_multiple_of(align),
        align,
        types: needs.memory_type_bits,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicBool, Ordering::SeqCst};
    use std::sync::mpsc::channel;
    use std::time::Duration;

    #[test]
    fn the_end_waits_for_work_that_needs_it() {
        let device = LifetimeGuard::new();
        let pool = device.child();
        let (done, (begun, has_begun)) = (AtomicBool::new(false), channel());
        std::thread::scope(|scope| {
            scope.spawn(|| {
                let work = || {
                    begun.send(()).unwrap();
                    std::thread::sleep(Duration::from_millis(50));
                    done.store(true, SeqCst);
                    Ok(true)
                };
                assert!(pool.with_alive(false, work).unwrap());
            });
            has_begun.recv().unwrap();
            device.close(|| assert!(done.load(SeqCst), "the work goes on"));
        });
        assert!(!pool.with_alive(false, || Ok(true)).unwrap());
        pool.close(|| panic!("its parent is gone"));
    }
}
