//! Presentation: copies the screen buffer, 8-bit RGBA that frames write (`passes::encode`), to the
//! images of a swapchain.
//!
//! A picture that is smaller than the window, as while the camera moves, is scaled up with linear
//! filtering. The buffer is copied, so a swapchain needs only transfers and color attachments,
//! which all support, and it holds the bytes of a PNG file. It stays valid until the next frame:
//! the overlay can change, and the window be uncovered, without drawing again.
//!
//! At most [`FRAMES_IN_FLIGHT`] presentations and the frame after them are on the device. (A
//! software device presents a picture as it copies it, so there it is the frame alone.) What they
//! use is protected as follows:
//!
//! - commands of a presentation, its vertices of the panel, and the semaphore it waits for belong
//!   to a slot, whose fence is waited for before the slot is used again;
//! - the semaphore that a presentation signals belongs to the swapchain's image, which is not
//!   acquired again before it has been shown;
//! - the screen buffer and the small picture exist once. Presentations and frames share a queue,
//!   and each starts with a barrier after everything before it; so the next frame is written after
//!   the last presentation has copied this one, while the CPU is ahead of both;
//! - textures of the panel change when all slots are done;
//! - pages of an index, which frames read and presentations do not, are reused once the frame that
//!   read them is done (`resident::streaming`);
//! - the swapchain, and all of this at the end, is freed when the device is idle.
//!
//! A swapchain that no longer fits its window is recreated before the next picture, and so is a
//! lost surface. [`Present::show`] returns whether it presented, and waits at most a tenth of a
//! second for a window that is not visible.

mod display;
pub mod overlay;
mod overlay_objects;

use crate::error::{Error, Result};
use crate::gpu::logical_device::Fresh;
use crate::gpu::memory::{Block, ImageDesc, RawBuffer, RawImage};
use crate::gpu::{BufferDesc, Device, LogicalDevice, Place, failed};
use crate::graph::Gpu;
use ash::{khr, vk};
use display::Display;
use overlay::{Overlay, OverlayRenderer};
use std::sync::Arc;
use winit::window::Window;

/// Presentations in flight: one is shown while the next is drawn. More would only add latency.
pub const FRAMES_IN_FLIGHT: usize = 2;

/// Longest wait for an image `[ns]`: compositors may hand out none while the window is not visible.
const ACQUIRE_TIMEOUT_NS: u64 = 100_000_000;

/// Commands and synchronisation of one presentation in flight.
struct Slot {
    pool: vk::CommandPool,
    commands: vk::CommandBuffer,
    /// Signaled when the device is done with the commands.
    done: vk::Fence,
    /// Signaled when the image may be written.
    acquired: vk::Semaphore,
}

/// An image of the swapchain.
struct Target {
    image: vk::Image,
    view: vk::ImageView,
    /// Signaled when the image may be shown.
    written: vk::Semaphore,
}

struct Swapchain {
    raw: vk::SwapchainKHR,
    targets: Vec<Target>,
    size: [u32; 2],
    /// The screen buffer: a u32 per pixel of the window; a smaller picture uses the first ones.
    screen: RawBuffer,
    /// Size of the picture in the screen buffer `[px]`; 0 if none has been written.
    picture: [u32; 2],
    /// Image that a smaller picture is scaled from, and its memory.
    small: Option<(RawImage, Block)>,
    /// True if it no longer fits the window.
    stale: bool,
}

/// A window's surface and swapchain.
pub struct Present {
    device: LogicalDevice,
    surfaces: khr::surface::Instance,
    swapchains: khr::swapchain::Device,
    surface: vk::SurfaceKHR,
    format: vk::SurfaceFormatKHR,
    /// True if the surface is lost.
    lost: bool,
    /// Number of pictures until the surface is treated as lost; for tests.
    lost_after: Option<u64>,
    swapchain: Option<Swapchain>,
    slots: Vec<Slot>,
    next: usize,
    overlay_renderer: Option<OverlayRenderer>,
    // Dropped after the surface is destroyed.
    display: Display,
    window: Arc<Window>,
}

impl Present {
    /// Creates a surface and its slots. Some systems require the thread of the window's events.
    pub fn open(gpu: &Gpu, window: Arc<Window>) -> Result<Present> {
        let device = &gpu.device;
        let surfaces = khr::surface::Instance::new(&device.entry, &device.instance);
        let display = Display::connect(&window)?;
        let surface = display.surface(device, &window)?;
        let mut present = Present {
            device: device.raw.clone(),
            swapchains: khr::swapchain::Device::new(&device.instance, &device.raw),
            format: vk::SurfaceFormatKHR::default(),
            surfaces,
            surface,
            lost: false,
            lost_after: gpu.overrides.surface_lost_after,
            swapchain: None,
            slots: Vec::new(),
            next: 0,
            overlay_renderer: None,
            display,
            window,
        };
        present.format = present.choose_format(device)?;
        for _ in 0..FRAMES_IN_FLIGHT {
            present.slots.push(create_slot(device)?);
        }
        Ok(present)
    }

    /// Recreates the swapchain if it does not fit the window's size `[px]`. Returns false if
    /// nothing can be shown, as in a minimised window or one that is gone.
    pub fn fit(&mut self, gpu: &mut Gpu, [width, height]: [u32; 2]) -> Result<bool> {
        let mut asked = self.capabilities(gpu);
        if self.lost || matches!(asked, Err(vk::Result::ERROR_SURFACE_LOST_KHR)) {
            self.recreate_surface(gpu)?;
            asked = self.capabilities(gpu);
            if matches!(asked, Err(vk::Result::ERROR_SURFACE_LOST_KHR)) {
                return Ok(false);
            }
        }
        let can = asked.map_err(failed("vkGetPhysicalDeviceSurfaceCapabilitiesKHR"))?;
        let size = match can.current_extent {
            // The swapchain may choose the size.
            vk::Extent2D { width: u32::MAX, .. } => {
                let (least, most) = (can.min_image_extent, can.max_image_extent);
                [width.clamp(least.width, most.width), height.clamp(least.height, most.height)]
            }
            extent => [extent.width, extent.height],
        };
        if size.contains(&0) || width == 0 || height == 0 {
            return Ok(false);
        }
        if self.swapchain.as_ref().is_none_or(|swapchain| swapchain.stale || swapchain.size != size)
        {
            self.recreate_swapchain(gpu, &can, size)?;
        }
        Ok(true)
    }

    fn capabilities(&self, gpu: &Gpu) -> ash::prelude::VkResult<vk::SurfaceCapabilitiesKHR> {
        // SAFETY: a live surface.
        unsafe {
            self.surfaces
                .get_physical_device_surface_capabilities(gpu.device.physical, self.surface)
        }
    }

    /// Returns whether no picture was written since the swapchain was recreated.
    pub fn is_empty(&self) -> bool {
        self.swapchain.as_ref().is_none_or(|swapchain| swapchain.picture == [0, 0])
    }

    /// Returns the size of the swapchain `[px]`; 0 before [`Present::fit`].
    pub fn size(&self) -> [u32; 2] {
        self.swapchain.as_ref().map_or([0, 0], |swapchain| swapchain.size)
    }

    /// Returns the screen buffer, which frames write: a u32 per pixel, row by row from the top
    /// left, of a picture no larger than the window.
    pub fn screen(&self) -> &RawBuffer {
        &self.swapchain.as_ref().expect("fit was true").screen
    }

    /// Declares that a picture of this size `[px]` has been written to the screen buffer.
    pub fn set_picture_size(&mut self, gpu: &mut Gpu, picture: [u32; 2]) -> Result<()> {
        let swapchain = self.swapchain.as_mut().expect("fit was true");
        let desc = (picture != swapchain.size)
            .then_some(ImageDesc { size: picture, format: self.format.format });
        if swapchain.small.as_ref().map(|(small, _)| small.desc) != desc {
            // Its next user starts after everything in flight.
            swapchain.small = None;
            swapchain.small = desc
                .map(|desc| gpu.memory.image_alone(&gpu.device, desc, "small picture"))
                .transpose()?;
        }
        swapchain.picture = picture;
        Ok(())
    }

    /// Returns whether the lowest byte of a pixel is blue, else red.
    pub fn blue_first(&self) -> bool {
        self.format.format == vk::Format::B8G8R8A8_UNORM
    }

    /// Sets what is drawn over the picture from now on.
    pub fn set_overlay(&mut self, gpu: &Gpu, overlay: Overlay) -> Result<()> {
        if !overlay.textures.is_empty() {
            let done: Vec<_> = self.slots.iter().map(|slot| slot.done).collect();
            // SAFETY: the fences are alive, and signaled or will be.
            unsafe { self.device.wait_for_fences(&done, true, u64::MAX) }
                .map_err(failed("vkWaitForFences"))?;
        }
        if self.overlay_renderer.is_none() {
            self.overlay_renderer = Some(OverlayRenderer::new(&gpu.device, self.format.format)?);
        }
        let pool = self.slots[self.next].pool;
        self.overlay_renderer.as_mut().expect("made above").set_overlay(&gpu.device, pool, overlay)
    }

    /// Presents the picture that the frames submitted before write. Returns false if there is none,
    /// or the window did not take it; then call [`Present::fit`], draw, and try again.
    pub fn show(&mut self, gpu: &Gpu) -> Result<bool> {
        let Some(swapchain) =
            self.swapchain.as_mut().filter(|swapchain| swapchain.picture != [0, 0])
        else {
            return Ok(false);
        };
        let slot = &self.slots[self.next];
        self.lost = self.lost || self.lost_after == Some(0);
        self.lost_after = self.lost_after.and_then(|pictures| pictures.checked_sub(1));
        // SAFETY: the fence is alive and signaled, or will be. Nothing waits for the semaphore,
        // since the slot's last submission is done.
        let acquired = unsafe {
            self.device
                .wait_for_fences(&[slot.done], true, u64::MAX)
                .map_err(failed("vkWaitForFences"))?;
            match self.lost {
                true => Err(vk::Result::ERROR_SURFACE_LOST_KHR),
                false => self.swapchains.acquire_next_image(
                    swapchain.raw,
                    ACQUIRE_TIMEOUT_NS,
                    slot.acquired,
                    vk::Fence::null(),
                ),
            }
        };
        let at = match acquired {
            Ok((at, suboptimal)) => {
                swapchain.stale |= suboptimal;
                at
            }
            Err(vk::Result::TIMEOUT | vk::Result::NOT_READY) => return Ok(false),
            Err(
                code @ (vk::Result::ERROR_OUT_OF_DATE_KHR | vk::Result::ERROR_SURFACE_LOST_KHR),
            ) => {
                swapchain.stale = true;
                self.lost = code == vk::Result::ERROR_SURFACE_LOST_KHR;
                return Ok(false);
            }
            Err(code) => return Err(failed("vkAcquireNextImageKHR")(code)),
        };
        let target = &swapchain.targets[at as usize];
        let stage = vk::PipelineStageFlags2::ALL_COMMANDS;
        let waits = [vk::SemaphoreSubmitInfo::default().semaphore(slot.acquired).stage_mask(stage)];
        let signals =
            [vk::SemaphoreSubmitInfo::default().semaphore(target.written).stage_mask(stage)];
        let commands = [vk::CommandBufferSubmitInfo::default().command_buffer(slot.commands)];
        let submission = vk::SubmitInfo2::default()
            .wait_semaphore_infos(&waits)
            .command_buffer_infos(&commands)
            .signal_semaphore_infos(&signals);
        let (written, shown, places) = ([target.written], [swapchain.raw], [at]);
        let info = vk::PresentInfoKHR::default()
            .wait_semaphores(&written)
            .swapchains(&shown)
            .image_indices(&places);
        // SAFETY: the slot's last commands are done; everything that these use lives until `idle`.
        let presented = unsafe {
            self.device
                .reset_command_pool(slot.pool, vk::CommandPoolResetFlags::empty())
                .map_err(failed("vkResetCommandPool"))?;
            let begin = vk::CommandBufferBeginInfo::default()
                .flags(vk::CommandBufferUsageFlags::ONE_TIME_SUBMIT);
            self.device
                .begin_command_buffer(slot.commands, &begin)
                .map_err(failed("vkBeginCommandBuffer"))?;
            copy(&self.device, slot.commands, swapchain, target.image);
            if let Some(overlay_renderer) = &mut self.overlay_renderer {
                draw_overlay(
                    &self.device,
                    slot.commands,
                    swapchain.size,
                    target,
                    overlay_renderer,
                )?;
            }
            transition(
                &self.device,
                slot.commands,
                target.image,
                vk::ImageLayout::GENERAL,
                vk::ImageLayout::PRESENT_SRC_KHR,
            );
            self.device.end_command_buffer(slot.commands).map_err(failed("vkEndCommandBuffer"))?;
            self.device.reset_fences(&[slot.done]).map_err(failed("vkResetFences"))?;
            self.device
                .queue_submit2(gpu.device.own_queue(), &[submission], slot.done)
                .map_err(failed("vkQueueSubmit2"))?;
            self.swapchains.queue_present(gpu.device.own_queue(), &info)
        };
        self.next = (self.next + 1) % self.slots.len();
        let shown = match presented {
            Ok(suboptimal) => {
                swapchain.stale |= suboptimal;
                true
            }
            Err(
                code @ (vk::Result::ERROR_OUT_OF_DATE_KHR | vk::Result::ERROR_SURFACE_LOST_KHR),
            ) => {
                swapchain.stale = true;
                self.lost = code == vk::Result::ERROR_SURFACE_LOST_KHR;
                false
            }
            Err(code) => return Err(failed("vkQueuePresentKHR")(code)),
        };
        gpu.device.take_validation_errors()?;
        Ok(shown)
    }

    fn wait_idle(&self) {
        // SAFETY: no other thread uses the device's queue. A lost device is idle.
        let _ = unsafe { self.device.device_wait_idle() };
    }

    /// Returns a format with eight bits a channel that is displayed as sRGB. Errors if the device
    /// cannot present to the surface or has no such format.
    fn choose_format(&self, device: &Device) -> Result<vk::SurfaceFormatKHR> {
        // SAFETY: a live surface and a queue family of the device.
        let shows = unsafe {
            self.surfaces.get_physical_device_surface_support(
                device.physical,
                device.family,
                self.surface,
            )
        };
        if !shows.map_err(failed("vkGetPhysicalDeviceSurfaceSupportKHR"))? {
            return Err(Error::Device(format!(
                "{} cannot present to this window; choose another device with --device",
                device.name
            )));
        }
        // SAFETY: a live surface.
        let offered = unsafe {
            self.surfaces.get_physical_device_surface_formats(device.physical, self.surface)
        };
        let offered = offered.map_err(failed("vkGetPhysicalDeviceSurfaceFormatsKHR"))?;
        let fits = |format: &&vk::SurfaceFormatKHR| {
            matches!(format.format, vk::Format::B8G8R8A8_UNORM | vk::Format::R8G8B8A8_UNORM)
                && format.color_space == vk::ColorSpaceKHR::SRGB_NONLINEAR
        };
        let found = offered.iter().find(fits).copied();
        found.ok_or_else(|| {
            Error::Device(format!(
                "the window supports neither B8G8R8A8 nor R8G8B8A8 in sRGB; it supports {offered:?}"
            ))
        })
    }

    /// Replaces a lost surface.
    fn recreate_surface(&mut self, gpu: &mut Gpu) -> Result<()> {
        self.wait_idle();
        self.drop_swapchain();
        // SAFETY: its swapchain is gone.
        unsafe { self.surfaces.destroy_surface(self.surface, None) };
        self.surface = vk::SurfaceKHR::null();
        self.surface = self.display.surface(&gpu.device, &self.window)?;
        self.format = self.choose_format(&gpu.device)?;
        self.overlay_renderer
            .as_mut()
            .map_or(Ok(()), |overlay_renderer| overlay_renderer.set_format(self.format.format))?;
        self.lost = false;
        Ok(())
    }

    fn recreate_swapchain(
        &mut self,
        gpu: &mut Gpu,
        can: &vk::SurfaceCapabilitiesKHR,
        size: [u32; 2],
    ) -> Result<()> {
        self.wait_idle();
        self.drop_swapchain();
        let most = if can.max_image_count == 0 { u32::MAX } else { can.max_image_count };
        let alpha = match can.supported_composite_alpha.contains(vk::CompositeAlphaFlagsKHR::OPAQUE)
        {
            true => vk::CompositeAlphaFlagsKHR::OPAQUE,
            false => vk::CompositeAlphaFlagsKHR::INHERIT,
        };
        let info = vk::SwapchainCreateInfoKHR::default()
            .surface(self.surface)
            .min_image_count((can.min_image_count + 1).min(most))
            .image_format(self.format.format)
            .image_color_space(self.format.color_space)
            .image_extent(vk::Extent2D { width: size[0], height: size[1] })
            .image_array_layers(1)
            .image_usage(vk::ImageUsageFlags::TRANSFER_DST | vk::ImageUsageFlags::COLOR_ATTACHMENT)
            .image_sharing_mode(vk::SharingMode::EXCLUSIVE)
            .pre_transform(can.current_transform)
            .composite_alpha(alpha)
            // Always supported, and without tearing.
            .present_mode(vk::PresentModeKHR::FIFO)
            .clipped(true);
        let desc = BufferDesc { bytes: 4 * size[0] as u64 * size[1] as u64, place: Place::Device };
        let screen = gpu.memory.buffer(&gpu.device, desc, "screen")?;
        // SAFETY: the surface is alive and has no other swapchain.
        let raw = match unsafe { self.swapchains.create_swapchain(&info, None) } {
            Ok(raw) => raw,
            Err(code) => {
                screen.destroy();
                return Err(failed("vkCreateSwapchainKHR")(code));
            }
        };
        let swapchain = self.swapchain.insert(Swapchain {
            raw,
            targets: Vec::new(),
            size,
            screen,
            picture: [0, 0],
            small: None,
            stale: false,
        });
        // SAFETY: a live swapchain.
        let images = unsafe { self.swapchains.get_swapchain_images(raw) }
            .map_err(failed("vkGetSwapchainImagesKHR"))?;
        for image in images {
            let view = vk::ImageViewCreateInfo::default()
                .image(image)
                .view_type(vk::ImageViewType::TYPE_2D)
                .format(self.format.format)
                .subresource_range(WHOLE);
            // SAFETY: an image of the swapchain, which outlives the view.
            let view = unsafe { self.device.make(&view) }?;
            let written = create_semaphore(&gpu.device, "written")?.keep();
            swapchain.targets.push(Target { image, view: view.keep(), written });
        }
        Ok(())
    }

    /// Destroys the swapchain; nothing may be in flight.
    fn drop_swapchain(&mut self) {
        let Some(swapchain) = self.swapchain.take() else { return };
        // SAFETY: see above.
        unsafe {
            for target in &swapchain.targets {
                self.device.destroy(target.view);
                self.device.destroy(target.written);
            }
            self.swapchains.destroy_swapchain(swapchain.raw, None);
        }
        swapchain.screen.destroy();
    }
}

impl Drop for Present {
    /// Waits until nothing is in flight, and frees everything.
    fn drop(&mut self) {
        self.wait_idle();
        self.overlay_renderer = None;
        self.drop_swapchain();
        // SAFETY: nothing is in flight.
        unsafe {
            for slot in &self.slots {
                self.device.destroy(slot.done);
                self.device.destroy(slot.acquired);
                self.device.destroy(slot.pool);
            }
            self.surfaces.destroy_surface(self.surface, None);
        }
    }
}

fn create_semaphore<'d>(device: &'d Device, name: &str) -> Result<Fresh<'d, vk::Semaphore>> {
    // SAFETY: a plain creation on a live device.
    let semaphore = unsafe { device.raw.make(&vk::SemaphoreCreateInfo::default()) }?;
    device.name(*semaphore, name);
    Ok(semaphore)
}

fn create_slot(device: &Device) -> Result<Slot> {
    let pool_info = vk::CommandPoolCreateInfo::default()
        .queue_family_index(device.family)
        .flags(vk::CommandPoolCreateFlags::TRANSIENT);
    let raised = vk::FenceCreateInfo::default().flags(vk::FenceCreateFlags::SIGNALED);
    // SAFETY: plain creations on a live device.
    unsafe {
        let pool = device.raw.make(&pool_info)?;
        let commands =
            vk::CommandBufferAllocateInfo::default().command_pool(*pool).command_buffer_count(1);
        let commands = device
            .raw
            .allocate_command_buffers(&commands)
            .map_err(failed("vkAllocateCommandBuffers"))?[0];
        let done = device.raw.make(&raised)?;
        let acquired = create_semaphore(device, "acquired")?.keep();
        Ok(Slot { pool: pool.keep(), commands, done: done.keep(), acquired })
    }
}

const WHOLE: vk::ImageSubresourceRange = vk::ImageSubresourceRange {
    aspect_mask: vk::ImageAspectFlags::COLOR,
    base_mip_level: 0,
    level_count: 1,
    base_array_layer: 0,
    layer_count: 1,
};

const LAYER: vk::ImageSubresourceLayers = vk::ImageSubresourceLayers {
    aspect_mask: vk::ImageAspectFlags::COLOR,
    mip_level: 0,
    base_array_layer: 0,
    layer_count: 1,
};

/// Copies the screen buffer to an image, which is in layout GENERAL afterwards.
///
/// # Safety
/// The command buffer is being recorded, and all of these live until it is done.
unsafe fn copy(
    device: &ash::Device,
    commands: vk::CommandBuffer,
    swapchain: &Swapchain,
    image: vk::Image,
) {
    let [width, height] = swapchain.picture;
    let region = vk::BufferImageCopy::default()
        .image_extent(vk::Extent3D { width, height, depth: 1 })
        .image_subresource(LAYER);
    let written = vk::ImageLayout::GENERAL;
    // SAFETY: the caller's; the buffer has a u32 for every pixel.
    unsafe {
        transition(device, commands, image, vk::ImageLayout::UNDEFINED, written);
        match &swapchain.small {
            None => device.cmd_copy_buffer_to_image(
                commands,
                swapchain.screen.raw,
                image,
                written,
                &[region],
            ),
            Some((small, _)) => {
                transition(device, commands, small.raw, vk::ImageLayout::UNDEFINED, written);
                device.cmd_copy_buffer_to_image(
                    commands,
                    swapchain.screen.raw,
                    small.raw,
                    written,
                    &[region],
                );
                transition(device, commands, small.raw, written, written);
                let corners = |[x, y]: [u32; 2]| {
                    [vk::Offset3D::default(), vk::Offset3D { x: x as i32, y: y as i32, z: 1 }]
                };
                let scaled = vk::ImageBlit::default()
                    .src_subresource(LAYER)
                    .src_offsets(corners(swapchain.picture))
                    .dst_subresource(LAYER)
                    .dst_offsets(corners(swapchain.size));
                device.cmd_blit_image(
                    commands,
                    small.raw,
                    written,
                    image,
                    written,
                    &[scaled],
                    vk::Filter::LINEAR,
                );
            }
        }
        transition(device, commands, image, written, written);
    }
}

/// Draws the overlay.
///
/// # Safety
/// The contract of [`copy`].
unsafe fn draw_overlay(
    device: &ash::Device,
    commands: vk::CommandBuffer,
    size: [u32; 2],
    target: &Target,
    overlay_renderer: &mut OverlayRenderer,
) -> Result<()> {
    let extent = vk::Extent2D { width: size[0], height: size[1] };
    let color = [vk::RenderingAttachmentInfo::default()
        .image_view(target.view)
        .image_layout(vk::ImageLayout::GENERAL)
        .load_op(vk::AttachmentLoadOp::LOAD)
        .store_op(vk::AttachmentStoreOp::STORE)];
    let area = vk::Rect2D { extent, ..Default::default() };
    let rendering =
        vk::RenderingInfo::default().render_area(area).layer_count(1).color_attachments(&color);
    // SAFETY: the caller's; the renderer's resources live until nothing is in flight.
    unsafe {
        device.cmd_begin_rendering(commands, &rendering);
        let drawn = overlay_renderer.draw(commands, extent);
        device.cmd_end_rendering(commands);
        drawn
    }
}

/// Transitions an image's layout, after all commands before.
///
/// # Safety
/// The contract of [`copy`].
unsafe fn transition(
    device: &ash::Device,
    commands: vk::CommandBuffer,
    image: vk::Image,
    from: vk::ImageLayout,
    to: vk::ImageLayout,
) {
    let (stage, write) = (vk::PipelineStageFlags2::ALL_COMMANDS, vk::AccessFlags2::MEMORY_WRITE);
    let both = write | vk::AccessFlags2::MEMORY_READ;
    let memory = [vk::MemoryBarrier2::default()
        .src_stage_mask(stage)
        .src_access_mask(write)
        .dst_stage_mask(stage)
        .dst_access_mask(both)];
    let images = [vk::ImageMemoryBarrier2::default()
        .src_stage_mask(stage)
        .src_access_mask(write)
        .dst_stage_mask(stage)
        .dst_access_mask(both)
        .old_layout(from)
        .new_layout(to)
        .image(image)
        .subresource_range(WHOLE)];
    // SAFETY: the caller's.
    unsafe {
        device.cmd_pipeline_barrier2(
            commands,
            &vk::DependencyInfo::default().memory_barriers(&memory).image_memory_barriers(&images),
        )
    };
}
