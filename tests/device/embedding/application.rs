//! An application whose images clouds are drawn into, and pictures as `render` draws them.

use super::*;

pub(super) const SIZE: [u32; 2] = [320, 240];
pub(super) const COLOR: vk::Format = vk::Format::R8G8B8A8_UNORM;
pub(super) const DEPTH: vk::Format = vk::Format::D32_SFLOAT;
pub(super) const IDS: vk::Format = vk::Format::R32G32_UINT;
pub(super) const NORMALS: vk::Format = vk::Format::R32G32B32A32_SFLOAT;

/// An application with a device, two images, and a buffer to read and write them through.
pub(super) struct Application {
    pub(super) device: Device,
    pub(super) commands: vk::CommandBuffer,
    pub(super) pool: vk::CommandPool,
    pub(super) fence: vk::Fence,
    pub(super) color: HostImage,
    pub(super) depth: HostImage,
    pub(super) ids: HostImage,
    pub(super) normals: HostImage,
    /// Ids and normals of the last frame that drew them.
    pub(super) layers: (Vec<[u32; 2]>, Vec<[f32; 4]>),
    pub(super) staging: vk::Buffer,
    pub(super) staging_memory: vk::DeviceMemory,
    pub(super) mapped: *mut u8,
    pub(super) frame: u64,
    /// Messages of the validation layers about the last frame.
    pub(super) said: pointillist::error::Result<()>,
    /// Time that recording the last frame took.
    pub(super) recorded: std::time::Duration,
    /// Command buffers of frames in flight, with their fences and the numbers of their frames.
    pub(super) ring: Vec<(vk::CommandBuffer, vk::Fence, u64)>,
    /// Last frame that is completed, as far as the renderer is told.
    pub(super) safe: u64,
    /// Family that owns all images between the host's work and the renderer's.
    pub(super) owner: Option<u32>,
}

pub(super) struct HostImage {
    pub(super) image: vk::Image,
    pub(super) view: vk::ImageView,
    pub(super) memory: vk::DeviceMemory,
    pub(super) format: vk::Format,
}

/// Ids and normals that are filled before a frame, if they come from a transfer.
pub(super) const FILLED: vk::ClearColorValue = vk::ClearColorValue { uint32: [7, 9, 0, 0] };

/// Room for points behind the images' texels.
pub(super) const POINT_BYTES: usize = 1 << 21;
pub(super) const PIXELS: usize = (SIZE[0] * SIZE[1]) as usize;

impl Application {
    pub(super) fn new(color: vk::Format) -> Application {
        Application::with_depth(color, DEPTH)
    }

    pub(super) fn with_depth(color: vk::Format, depth: vk::Format) -> Application {
        Application::made(color, depth, true)
    }

    /// Makes one whose calls are not validated, for times.
    pub(super) fn unchecked() -> Application {
        Application::made(COLOR, DEPTH, false)
    }

    fn made(color: vk::Format, depth: vk::Format, validate: bool) -> Application {
        let device = Device::open(&DeviceOptions { validate, ..DeviceOptions::default() }).unwrap();
        // SAFETY: plain creations on a live device, destroyed in drop.
        unsafe {
            let raw = &device.raw;
            let info = vk::CommandPoolCreateInfo::default()
                .queue_family_index(device.family)
                .flags(vk::CommandPoolCreateFlags::RESET_COMMAND_BUFFER);
            let pool = raw.create_command_pool(&info, None).unwrap();
            let info =
                vk::CommandBufferAllocateInfo::default().command_pool(pool).command_buffer_count(4);
            let buffers = raw.allocate_command_buffers(&info).unwrap();
            let commands = buffers[0];
            let fence = || raw.create_fence(&vk::FenceCreateInfo::default(), None).unwrap();
            let ring = buffers[1..].iter().map(|&commands| (commands, fence(), 0)).collect();
            let fence = fence();
            use vk::ImageUsageFlags as Usage;
            let copied = Usage::TRANSFER_SRC | Usage::TRANSFER_DST;
            let color = HostImage::new(&device, color, Usage::COLOR_ATTACHMENT | copied);
            let depth = HostImage::new(&device, depth, Usage::DEPTH_STENCIL_ATTACHMENT | copied);
            let layer = |format| HostImage::new(&device, format, Usage::COLOR_ATTACHMENT | copied);
            let (ids, normals) = (layer(IDS), layer(NORMALS));
            let usage = vk::BufferUsageFlags::TRANSFER_SRC | vk::BufferUsageFlags::TRANSFER_DST;
            let info = vk::BufferCreateInfo::default()
                .size((48 * PIXELS + POINT_BYTES) as u64)
                .usage(usage);
            let staging = raw.create_buffer(&info, None).unwrap();
            let needs = raw.get_buffer_memory_requirements(staging);
            let flags =
                vk::MemoryPropertyFlags::HOST_VISIBLE | vk::MemoryPropertyFlags::HOST_COHERENT;
            let staging_memory = allocate(&device, &device.raw, needs, flags);
            raw.bind_buffer_memory(staging, staging_memory, 0).unwrap();
            let mapped =
                raw.map_memory(staging_memory, 0, vk::WHOLE_SIZE, Default::default()).unwrap();
            let mapped = mapped.cast();
            Application {
                commands,
                pool,
                fence,
                color,
                depth,
                ids,
                normals,
                layers: Default::default(),
                staging,
                staging_memory,
                mapped,
                frame: 0,
                said: Ok(()),
                recorded: Default::default(),
                ring,
                safe: 0,
                owner: None,
                device,
            }
        }
    }

    pub(super) fn host(&self) -> Host {
        Host {
            get_instance_proc_addr: counting::get_instance_proc_addr(
                self.device.entry.static_fn().get_instance_proc_addr,
            ),
            instance: self.device.instance.handle().as_raw(),
            physical_device: self.device.physical.as_raw(),
            device: self.device.raw.handle().as_raw(),
            queue_family: self.device.family,
            has_int64_atomics: self.device.int64_atomics,
            has_debug_utils: true,
            allocation_callbacks: counting::CALLBACKS.address(),
            allocate_memory: std::ptr::null(),
            free_memory: std::ptr::null(),
        }
    }

    pub(super) fn renderer(&self) -> Renderer {
        // SAFETY: tests drop the renderer before the application.
        unsafe { Renderer::new(&self.host(), RendererOptions::default()) }.unwrap()
    }

    /// Returns points of the application's buffer; no frame may read it.
    pub(super) fn point_buffer(&self, places: &[[f32; 3]]) -> PointBuffer {
        let offset = 48 * PIXELS;
        assert!(12 * places.len() <= POINT_BYTES);
        // SAFETY: the buffer has room there.
        unsafe {
            let to = self.mapped.add(offset).cast::<[f32; 3]>();
            std::ptr::copy_nonoverlapping(places.as_ptr(), to, places.len());
        }
        PointBuffer {
            buffer: self.staging.as_raw(),
            offset: offset as u64,
            stride: 12,
            count: places.len() as u32,
            color_offset: None,
        }
    }

    /// Returns targets that are cleared, and read by copies afterwards.
    pub(super) fn targets(&self) -> Targets {
        let target = |image: &HostImage| Target {
            image: image.image.as_raw(),
            view: image.view.as_raw(),
            format: image.format.as_raw(),
            size: SIZE,
            samples: 1,
            before: Access { stages: 0, access: 0, ..Access::any(0) },
            after: Access {
                layout: vk::ImageLayout::TRANSFER_SRC_OPTIMAL.as_raw(),
                stages: vk::PipelineStageFlags2::COPY.as_raw(),
                access: vk::AccessFlags2::TRANSFER_READ.as_raw(),
                family: Access::SAME_FAMILY,
            },
            clear: true,
        };
        let [ids, normals] = [&self.ids, &self.normals].map(|image| Some(target(image)));
        let depth = Some(target(&self.depth));
        Targets { depth, copies_depth: true, ids, normals, ..Targets::of(target(&self.color)) }
    }

    /// Draws a frame, about which the validation layers say nothing.
    pub(super) fn draw(
        &mut self,
        renderer: &mut Renderer,
        targets: Targets,
        views: &[FrameView],
        before: Option<(&[u8], &[f32])>,
    ) -> (FrameReport, Vec<u8>, Vec<f32>) {
        let drawn = self.submit(renderer, targets, views, before);
        std::mem::replace(&mut self.said, Ok(())).unwrap();
        drawn
    }

    /// Records and submits a frame, waits, and reads colour and depth back. `before` fills the
    /// images first.
    pub(super) fn submit(
        &mut self,
        renderer: &mut Renderer,
        targets: Targets,
        views: &[FrameView],
        before: Option<(&[u8], &[f32])>,
    ) -> (FrameReport, Vec<u8>, Vec<f32>) {
        self.try_submit(renderer, targets, views, before).unwrap()
    }

    /// Submits as [`Application::submit`]; a command buffer that cannot be recorded is dropped.
    pub(super) fn try_submit(
        &mut self,
        renderer: &mut Renderer,
        targets: Targets,
        views: &[FrameView],
        before: Option<(&[u8], &[f32])>,
    ) -> pointillist::error::Result<(FrameReport, Vec<u8>, Vec<f32>)> {
        self.submit_recorded(targets, views, before, |commands, frame| {
            // SAFETY: every object is alive, and the fence is waited for before the next frame.
            unsafe { renderer.record(commands.as_raw(), frame) }
        })
    }

    /// Submits as [`Application::try_submit`] what `record` records.
    pub(super) fn submit_recorded<R, E>(
        &mut self,
        targets: Targets,
        views: &[FrameView],
        before: Option<(&[u8], &[f32])>,
        record: impl FnOnce(vk::CommandBuffer, &Frame) -> std::result::Result<R, E>,
    ) -> std::result::Result<(R, Vec<u8>, Vec<f32>), E> {
        self.frame += 1;
        self.wait_for(self.frame);
        let (raw, commands) = (&self.device.raw, self.commands);
        let texel = match self.color.format {
            vk::Format::R16G16B16A16_SFLOAT => 8,
            vk::Format::R32G32B32A32_SFLOAT => 16,
            _ => 4,
        };
        let depth_at = 16 * PIXELS;
        // SAFETY: every object is alive, and the fence is waited for before the next frame.
        unsafe {
            let info = vk::CommandBufferBeginInfo::default()
                .flags(vk::CommandBufferUsageFlags::ONE_TIME_SUBMIT);
            raw.begin_command_buffer(commands, &info).unwrap();
            if let Some((color, depth)) = before {
                assert_eq!(color.len(), texel * PIXELS);
                std::ptr::copy_nonoverlapping(color.as_ptr(), self.mapped, color.len());
                let (place, texels) = (self.mapped.add(depth_at), self.depth.texels(depth));
                std::ptr::copy_nonoverlapping(texels.as_ptr(), place, texels.len());
                for (image, at) in [(&self.color, 0), (&self.depth, depth_at as u64)] {
                    image.transition(
                        raw,
                        commands,
                        vk::ImageLayout::UNDEFINED,
                        vk::ImageLayout::TRANSFER_DST_OPTIMAL,
                    );
                    let layout = vk::ImageLayout::TRANSFER_DST_OPTIMAL;
                    let region = image.region(at);
                    raw.cmd_copy_buffer_to_image(
                        commands,
                        self.staging,
                        image.image,
                        layout,
                        &[region],
                    );
                }
            }
            let layers = [(&self.ids, targets.ids), (&self.normals, targets.normals)];
            for (image, target) in layers {
                let layout = vk::ImageLayout::TRANSFER_DST_OPTIMAL;
                if target.is_some_and(|target| target.before.layout == layout.as_raw()) {
                    image.transition(raw, commands, vk::ImageLayout::UNDEFINED, layout);
                    let of = [range(image.format)];
                    raw.cmd_clear_color_image(commands, image.image, layout, &FILLED, &of);
                }
            }
            self.give_up(&targets);
            let safe = self.safe.min(self.frame - 1);
            let frame = Frame { number: self.frame, safe, targets, views };
            let began = std::time::Instant::now();
            let report = match record(commands, &frame) {
                Ok(report) => report,
                Err(error) => {
                    raw.reset_command_buffer(commands, Default::default()).unwrap();
                    self.said = self.device.take_validation_errors();
                    return Err(error);
                }
            };
            self.recorded = began.elapsed();
            self.take_back(&targets);
            // What filled the images was read from where they go to now.
            let read = [vk::MemoryBarrier2::default()
                .src_stage_mask(vk::PipelineStageFlags2::COPY)
                .dst_stage_mask(vk::PipelineStageFlags2::COPY)];
            raw.cmd_pipeline_barrier2(
                commands,
                &vk::DependencyInfo::default().memory_barriers(&read),
            );
            let [ids_at, normals_at] = [20 * PIXELS, 32 * PIXELS];
            let layers = [(&self.ids, ids_at as u64), (&self.normals, normals_at as u64)];
            let layers = if targets.ids.is_some() { &layers[..] } else { &[] };
            let depth = targets.depth.map(|_| (&self.depth, depth_at as u64));
            for &(image, at) in [(&self.color, 0)].iter().chain(&depth).chain(layers) {
                let layout = vk::ImageLayout::TRANSFER_SRC_OPTIMAL;
                let region = image.region(at);
                raw.cmd_copy_image_to_buffer(
                    commands,
                    image.image,
                    layout,
                    self.staging,
                    &[region],
                );
            }
            let to_host = [vk::MemoryBarrier2::default()
                .src_stage_mask(vk::PipelineStageFlags2::COPY)
                .src_access_mask(vk::AccessFlags2::TRANSFER_WRITE)
                .dst_stage_mask(vk::PipelineStageFlags2::HOST)
                .dst_access_mask(vk::AccessFlags2::HOST_READ)];
            raw.cmd_pipeline_barrier2(
                commands,
                &vk::DependencyInfo::default().memory_barriers(&to_host),
            );
            raw.end_command_buffer(commands).unwrap();
            let buffers = [commands];
            let submit = vk::SubmitInfo::default().command_buffers(&buffers);
            raw.queue_submit(self.device.own_queue(), &[submit], self.fence).unwrap();
            raw.wait_for_fences(&[self.fence], true, u64::MAX).unwrap();
            raw.reset_fences(&[self.fence]).unwrap();
            self.safe = self.frame;
            self.said = self.device.take_validation_errors();
            let color = std::slice::from_raw_parts(self.mapped, texel * PIXELS).to_vec();
            let ids = self.mapped.add(ids_at).cast();
            let normals = self.mapped.add(normals_at).cast();
            self.layers = (
                std::slice::from_raw_parts(ids, PIXELS).to_vec(),
                std::slice::from_raw_parts(normals, PIXELS).to_vec(),
            );
            let depth = std::slice::from_raw_parts(self.mapped.add(depth_at), 4 * PIXELS);
            Ok((report, color, self.depth.depths(depth)))
        }
    }

    /// Waits for frames of the ring up to this one.
    fn wait_for(&mut self, frame: u64) {
        let raw = &self.device.raw;
        for (_, fence, number) in &mut self.ring {
            if (1..=frame).contains(number) {
                // SAFETY: the fence is that of a frame that was submitted.
                unsafe {
                    raw.wait_for_fences(&[*fence], true, u64::MAX).unwrap();
                    raw.reset_fences(&[*fence]).unwrap();
                }
                *number = 0;
            }
        }
    }

    /// Records and submits a frame, and does not wait for it. The last `lag` frames are in flight,
    /// as far as the renderer is told: from 1 to 3.
    pub(super) fn draw_in_flight(
        &mut self,
        renderer: &mut Renderer,
        targets: Targets,
        views: &[FrameView],
        lag: u64,
    ) -> FrameReport {
        self.frame += 1;
        self.safe = self.safe.max(self.frame.saturating_sub(lag));
        self.wait_for(self.safe);
        let raw = &self.device.raw;
        let (commands, fence, of) =
            self.ring.iter_mut().find(|(.., of)| *of == 0).expect("three frames at the most");
        *of = self.frame;
        // SAFETY: every object is alive until it is waited for.
        let report = unsafe {
            let info = vk::CommandBufferBeginInfo::default()
                .flags(vk::CommandBufferUsageFlags::ONE_TIME_SUBMIT);
            raw.begin_command_buffer(*commands, &info).unwrap();
            let frame = Frame { number: self.frame, safe: self.safe, targets, views };
            let report = renderer.record(commands.as_raw(), &frame).unwrap();
            raw.end_command_buffer(*commands).unwrap();
            let buffers = [*commands];
            let submit = vk::SubmitInfo::default().command_buffers(&buffers);
            raw.queue_submit(self.device.own_queue(), &[submit], *fence).unwrap();
            report
        };
        self.device.take_validation_errors().unwrap();
        report
    }

    /// Records a frame, and drops it.
    pub(super) fn drop_one(
        &mut self,
        renderer: &mut Renderer,
        targets: Targets,
        views: &[FrameView],
    ) {
        self.frame += 1;
        let (raw, commands) = (&self.device.raw, self.commands);
        let frame = Frame { number: self.frame, safe: self.safe, targets, views };
        // SAFETY: every object is alive, and the command buffer is in no frame in flight.
        unsafe {
            raw.begin_command_buffer(commands, &Default::default()).unwrap();
            renderer.record(commands.as_raw(), &frame).unwrap();
            raw.reset_command_buffer(commands, Default::default()).unwrap();
        }
        renderer.drop_frame(self.frame).unwrap();
        self.device.take_validation_errors().unwrap();
    }

    /// Draws until everything that the views call for is drawn.
    pub(super) fn settle(
        &mut self,
        renderer: &mut Renderer,
        targets: Targets,
        views: &[FrameView],
    ) -> (FrameReport, Vec<u8>, Vec<f32>) {
        for _ in 0..2000 {
            let drawn = self.draw(renderer, targets, views, None);
            assert_eq!(drawn.0.errors, Vec::<String>::new());
            if drawn.0.settled {
                return drawn;
            }
            std::thread::sleep(std::time::Duration::from_millis(5));
        }
        let (report, ..) = self.draw(renderer, targets, views, None);
        panic!("the picture never settles: {report:?}");
    }
}

impl Application {
    /// Records frames, which are not submitted, until one fails. Returns its error.
    pub(super) fn first_error(&self, renderer: &mut Renderer, views: &[FrameView]) -> String {
        let (raw, commands) = (&self.device.raw, self.commands);
        for number in 1..500 {
            let frame = Frame { number, safe: number - 1, targets: self.targets(), views };
            // SAFETY: every object is alive, and no frame is in flight.
            let recorded = unsafe {
                raw.begin_command_buffer(commands, &Default::default()).unwrap();
                let recorded = renderer.record(commands.as_raw(), &frame);
                raw.reset_command_buffer(commands, Default::default()).unwrap();
                recorded
            };
            let error = match recorded {
                Ok(report) => report.errors.into_iter().next(),
                Err(error) => Some(error.to_string()),
            };
            if let Some(error) = error {
                return error;
            }
            std::thread::sleep(std::time::Duration::from_millis(5));
        }
        panic!("no frame fails");
    }
}

impl Drop for Application {
    fn drop(&mut self) {
        // SAFETY: every frame has been waited for, and the renderer is gone.
        unsafe {
            let raw = &self.device.raw;
            // A test that failed has frames in flight.
            let _ = raw.device_wait_idle();
            self.ring.iter().for_each(|(_, fence, _)| raw.destroy_fence(*fence, None));
            raw.destroy_buffer(self.staging, None);
            raw.free_memory(self.staging_memory, None);
            raw.destroy_fence(self.fence, None);
            raw.destroy_command_pool(self.pool, None);
            for image in [&self.color, &self.depth, &self.ids, &self.normals] {
                raw.destroy_image_view(image.view, None);
                raw.destroy_image(image.image, None);
                raw.free_memory(image.memory, None);
            }
        }
    }
}

/// # Safety
/// The device is alive.
pub(super) unsafe fn allocate(
    device: &Device,
    raw: &ash::Device,
    needs: vk::MemoryRequirements,
    flags: vk::MemoryPropertyFlags,
) -> vk::DeviceMemory {
    // SAFETY: plain queries and a plain allocation.
    unsafe {
        let memory = device.instance.get_physical_device_memory_properties(device.physical);
        let kind = (0..memory.memory_type_count)
            .find(|&kind| {
                needs.memory_type_bits >> kind & 1 == 1
                    && memory.memory_types[kind as usize].property_flags.contains(flags)
            })
            .unwrap();
        let info =
            vk::MemoryAllocateInfo::default().allocation_size(needs.size).memory_type_index(kind);
        raw.allocate_memory(&info, None).unwrap()
    }
}

impl HostImage {
    pub(super) fn new(
        device: &Device,
        format: vk::Format,
        usage: vk::ImageUsageFlags,
    ) -> HostImage {
        HostImage::on(device, &device.raw, format, usage)
    }

    /// Makes an image on a device of the same physical device.
    pub(super) fn on(
        device: &Device,
        raw: &ash::Device,
        format: vk::Format,
        usage: vk::ImageUsageFlags,
    ) -> HostImage {
        let [width, height] = SIZE;
        let info = vk::ImageCreateInfo::default()
            .image_type(vk::ImageType::TYPE_2D)
            .format(format)
            .extent(vk::Extent3D { width, height, depth: 1 })
            .mip_levels(1)
            .array_layers(1)
            .samples(vk::SampleCountFlags::TYPE_1)
            .usage(usage);
        // SAFETY: plain creations on a live device.
        unsafe {
            let image = raw.create_image(&info, None).unwrap();
            let needs = raw.get_image_memory_requirements(image);
            let memory = allocate(device, raw, needs, vk::MemoryPropertyFlags::DEVICE_LOCAL);
            raw.bind_image_memory(image, memory, 0).unwrap();
            let info = vk::ImageViewCreateInfo::default()
                .image(image)
                .view_type(vk::ImageViewType::TYPE_2D)
                .format(format)
                .subresource_range(range(format));
            let view = raw.create_image_view(&info, None).unwrap();
            HostImage { image, view, memory, format }
        }
    }

    pub(super) fn region(&self, at: u64) -> vk::BufferImageCopy {
        let [width, height] = SIZE;
        vk::BufferImageCopy::default()
            .buffer_offset(at)
            .image_extent(vk::Extent3D { width, height, depth: 1 })
            .image_subresource(vk::ImageSubresourceLayers {
                aspect_mask: match range(self.format).aspect_mask {
                    vk::ImageAspectFlags::COLOR => vk::ImageAspectFlags::COLOR,
                    _ => vk::ImageAspectFlags::DEPTH,
                },
                layer_count: 1,
                ..Default::default()
            })
    }

    /// Returns texels with these depths, as they are copied.
    fn texels(&self, depths: &[f32]) -> Vec<u8> {
        let code = |depth: f32, most: f64| (depth as f64 * most).round() as u32;
        match depth_bits(self.format) {
            Some(16) => depths
                .iter()
                .flat_map(|&depth| (code(depth, 65_535.0) as u16).to_ne_bytes())
                .collect(),
            Some(_) => {
                depths.iter().flat_map(|&depth| code(depth, 16_777_215.0).to_ne_bytes()).collect()
            }
            None => depths.iter().flat_map(|depth| depth.to_ne_bytes()).collect(),
        }
    }

    /// Returns the depths of texels as they are copied.
    fn depths(&self, texels: &[u8]) -> Vec<f32> {
        let words = || bytemuck::cast_slice::<u8, u32>(texels).iter();
        match depth_bits(self.format) {
            Some(16) => {
                let halves = bytemuck::cast_slice::<u8, u16>(&texels[..2 * PIXELS]).iter();
                halves.map(|&code| code as f32 / 65_535.0).collect()
            }
            Some(_) => {
                let depth = |&word: &u32| ((word & 0xFF_FFFF) as f64 / 16_777_215.0) as f32;
                words().map(depth).collect()
            }
            None => words().map(|&word| f32::from_bits(word)).collect(),
        }
    }

    /// # Safety
    /// The command buffer is being recorded.
    pub(super) unsafe fn transition(
        &self,
        device: &ash::Device,
        commands: vk::CommandBuffer,
        from: vk::ImageLayout,
        to: vk::ImageLayout,
    ) {
        let barrier = [vk::ImageMemoryBarrier2::default()
            .src_stage_mask(vk::PipelineStageFlags2::ALL_COMMANDS)
            .dst_stage_mask(vk::PipelineStageFlags2::ALL_COMMANDS)
            .src_access_mask(vk::AccessFlags2::MEMORY_WRITE)
            .dst_access_mask(vk::AccessFlags2::MEMORY_READ | vk::AccessFlags2::MEMORY_WRITE)
            .old_layout(from)
            .new_layout(to)
            .image(self.image)
            .subresource_range(range(self.format))];
        let info = vk::DependencyInfo::default().image_memory_barriers(&barrier);
        // SAFETY: as the caller ensures.
        unsafe { device.cmd_pipeline_barrier2(commands, &info) };
    }
}

/// Returns the bits of a normalised depth; None if it is a float, or a colour.
pub(super) fn depth_bits(format: vk::Format) -> Option<u32> {
    match format {
        vk::Format::D16_UNORM => Some(16),
        vk::Format::X8_D24_UNORM_PACK32 | vk::Format::D24_UNORM_S8_UINT => Some(24),
        _ => None,
    }
}

pub(super) fn range(format: vk::Format) -> vk::ImageSubresourceRange {
    let aspect_mask = match format {
        DEPTH | vk::Format::D16_UNORM | vk::Format::X8_D24_UNORM_PACK32 => {
            vk::ImageAspectFlags::DEPTH
        }
        vk::Format::D24_UNORM_S8_UINT | vk::Format::D32_SFLOAT_S8_UINT => {
            vk::ImageAspectFlags::DEPTH | vk::ImageAspectFlags::STENCIL
        }
        _ => vk::ImageAspectFlags::COLOR,
    };
    vk::ImageSubresourceRange { aspect_mask, level_count: 1, layer_count: 1, ..Default::default() }
}

/// Writes a scan and returns its path, and a camera.
pub(super) fn scan(folder: &std::path::Path) -> (PathBuf, Camera) {
    let path = folder.join("torus.las");
    files::scan(&path, pointillist::synth::SceneKind::Torus, 100_000);
    let options = pointillist::cloud::ReadOptions::new(Default::default(), false);
    let cloud = pointillist::cloud::read(std::slice::from_ref(&path), &options, &Silent).unwrap();
    let camera = Camera::framing(Preset::Fit, &cloud.core_points(), SIZE);
    (path, camera)
}

pub(super) const WHOLE: Area = Area { corner: [0, 0], size: SIZE };

pub(super) fn view_of(camera: Camera) -> FrameView {
    let camera = ViewCamera::Camera { camera, near: 0.01, far: f64::INFINITY };
    FrameView { camera, area: WHOLE }
}

/// A picture as `render` draws it.
pub(super) struct Rendered {
    /// Red, green and blue of each pixel.
    pub(super) color: Vec<u8>,
    /// Planar depths.
    pub(super) depth: Vec<f32>,
    pub(super) ids: Vec<u32>,
    pub(super) normals: Vec<[f32; 4]>,
}

/// Draws as `render` does.
pub(super) fn rendered(
    path: &std::path::Path,
    camera: Camera,
    settings: &RenderSettings,
) -> Rendered {
    let options = DeviceOptions { validate: true, ..DeviceOptions::default() };
    let mut gpu = pointillist::graph::Gpu::open(&options).unwrap();
    let opening = OpenOptions {
        read: pointillist::cloud::ReadOptions::new(
            pointillist::cloud::ColumnSet { rgb: true, intensity: true, ..Default::default() },
            false,
        ),
        filter: Default::default(),
        index: None,
        indexes_octrees: false,
        strokes: false,
        place: None,
        shadows: None,
        fault: None,
    };
    let Source::Files(cloud) = Source::open(&[path.into()], &opening, &Silent).unwrap() else {
        panic!("a small file")
    };
    let (mut shown, _) = pointillist::cloud::attribute::DisplayAttribute::automatic(&cloud);
    shown.further.strokes = settings.effects.strokes.switch == Switch::On;
    let resident = Resident::fill(&mut gpu, cloud, shown, &Silent).unwrap();
    let view = View::new(camera, SIZE).unwrap();
    let config = FrameConfig::new(settings, &view, &resident);
    let mut g = Graph::new(&mut gpu);
    let outcome = frame::record(&mut g, &view, &resident, &config).unwrap();
    let encoded = encode::download(&mut g, &outcome.picture).unwrap();
    let layers = [&outcome.gbuffer.depth, &outcome.gbuffer.index, &outcome.normal];
    let [depth, ids, normals] = layers.map(|layer| g.download(layer));
    let done = g.submit_and_wait(&[]).unwrap();
    Rendered {
        color: encoded.read(&done).concat(),
        depth: done.read(&depth).to_vec(),
        ids: done.read(&ids).to_vec(),
        normals: done.read(&normals).to_vec(),
    }
}

/// Runs the test again, in a process of its own with these variables. Returns what it printed.
pub(super) fn again(variables: &[(&str, String)]) -> String {
    let thread = std::thread::current();
    let test = thread.name().expect("tests have names");
    let mut command = std::process::Command::new(std::env::current_exe().unwrap());
    command.args(["--exact", "--nocapture", test]).envs(variables.iter().cloned());
    let output = command.output().expect("start the test again");
    let printed = crate::program::text(&output.stdout);
    println!("{printed}");
    crate::program::succeeded(&output);
    printed
}
