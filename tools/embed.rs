//! A host in Rust: an offscreen Vulkan program that draws a triangle through a cloud, in two
//! viewports, and picks a point.
//!
//! ```sh
//! cargo run --release --example embed -- scan.laz picture.png
//! ```
//!
//! Everything but [`draw_cloud`] is what any Vulkan program has: a device, images, a command
//! buffer, and geometry of its own.

use ash::vk::{self, Handle};
use pointillist::renderer::{
    self, Access, Area, Frame, FrameView, Host, Matrices, Picked, Preset, Renderer,
    RendererOptions, Target, Targets, ViewCamera,
};
use std::ffi::c_void;

type Outcome<T> = Result<T, Box<dyn std::error::Error>>;

const SIZE: [u32; 2] = [800, 400];
const HALF: [u32; 2] = [400, 400];

fn main() -> Outcome<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [cloud, picture] = &arguments[..] else { return Err("give a cloud and a picture".into()) };
    // SAFETY: the program follows the rules of Vulkan, and the renderer is dropped before the
    // device.
    unsafe {
        let vulkan = Vulkan::new()?;
        let mut renderer = Renderer::new(&vulkan.host(), RendererOptions::default())?;
        let id = renderer.open(&[cloud.into()], &Default::default())?;
        let (mut number, mut pick) = (0, None);
        loop {
            number += 1;
            let commands = vulkan.begin()?;
            let settled = draw_cloud(&vulkan, &mut renderer, commands, number)?;
            let pixels = vulkan.submit(commands)?;
            let Some(wanted) = pick else {
                if settled && renderer.framing(Preset::Front, HALF).is_some() {
                    pick = Some(renderer.pick([HALF[0] / 2, HALF[1] / 2]));
                }
                continue;
            };
            match renderer.picked(wanted) {
                Picked::Pending => continue,
                Picked::Point(point) => println!("picked {} of {id:?}", point.world),
                Picked::Nothing => println!("picked nothing"),
            }
            let file = std::io::BufWriter::new(std::fs::File::create(picture)?);
            let mut encoder = png::Encoder::new(file, SIZE[0], SIZE[1]);
            encoder.set_color(png::ColorType::Rgba);
            encoder.write_header()?.write_image_data(&pixels)?;
            return Ok(());
        }
    }
}

/// Records the host's triangle and the cloud. Returns whether the cloud is drawn completely.
unsafe fn draw_cloud(
    vulkan: &Vulkan,
    renderer: &mut Renderer,
    commands: vk::CommandBuffer,
    number: u64,
) -> Outcome<bool> {
    let attachment = |image: &Image, layout: vk::ImageLayout, after: vk::ImageLayout| Target {
        image: image.image.as_raw(),
        view: image.view.as_raw(),
        format: image.format.as_raw(),
        size: SIZE,
        samples: 1,
        before: Access::any(layout.as_raw()),
        after: Access::any(after.as_raw()),
        clear: false,
    };
    let (drawn, depth) = (
        vk::ImageLayout::COLOR_ATTACHMENT_OPTIMAL,
        vk::ImageLayout::DEPTH_STENCIL_ATTACHMENT_OPTIMAL,
    );
    let color = attachment(&vulkan.color, drawn, vk::ImageLayout::TRANSFER_SRC_OPTIMAL);
    let depth = Some(attachment(&vulkan.depth, depth, depth));
    let targets = Targets { depth, ..Targets::of(color) };
    let mut views = Vec::new();
    for (side, preset) in [Preset::Fit, Preset::Front].into_iter().enumerate() {
        let Some(mut camera) = renderer.framing(preset, HALF) else { continue };
        camera.fov_y = 45.0;
        let camera = Matrices::of(&camera, HALF, 0.01, 1e6)?;
        let area = Area { corner: [(side as u32 * HALF[0]) as i32, 0], size: HALF };
        views.push(FrameView { camera: ViewCamera::Matrices(camera), area });
    }
    // SAFETY: the command buffer is being recorded; the images are as the targets say.
    unsafe {
        vulkan.draw_triangle(commands, &views);
        let frame = Frame { number, safe: number - 1, targets, views: &views };
        let report = renderer.record(commands.as_raw(), &frame)?;
        for error in report.errors {
            eprintln!("{error}");
        }
        Ok(report.settled)
    }
}

struct Image {
    image: vk::Image,
    view: vk::ImageView,
    memory: vk::DeviceMemory,
    format: vk::Format,
    aspect: vk::ImageAspectFlags,
}

struct Vulkan {
    entry: ash::Entry,
    instance: ash::Instance,
    physical: vk::PhysicalDevice,
    device: ash::Device,
    queue: vk::Queue,
    pool: vk::CommandPool,
    color: Image,
    depth: Image,
    buffer: vk::Buffer,
    memory: vk::DeviceMemory,
    layout: vk::PipelineLayout,
    pipeline: vk::Pipeline,
}

impl Vulkan {
    unsafe fn new() -> Outcome<Vulkan> {
        // SAFETY: plain creations, in order.
        unsafe {
            let entry = ash::Entry::load()?;
            let application = vk::ApplicationInfo::default().api_version(vk::API_VERSION_1_3);
            let info = vk::InstanceCreateInfo::default().application_info(&application);
            let instance = entry.create_instance(&info, None)?;
            let physical = *instance.enumerate_physical_devices()?.first().ok_or("no device")?;
            let address = entry.static_fn().get_instance_proc_addr as *const c_void;
            renderer::check(address, instance.handle().as_raw(), physical.as_raw())?;

            let mut v12 = vk::PhysicalDeviceVulkan12Features::default();
            let mut v13 = vk::PhysicalDeviceVulkan13Features::default();
            let mut features =
                vk::PhysicalDeviceFeatures2::default().push_next(&mut v12).push_next(&mut v13);
            renderer::enable_features((&raw mut features).cast(), false)?;
            let queues = [vk::DeviceQueueCreateInfo::default()
                .queue_family_index(0)
                .queue_priorities(&[1.0])];
            let info = vk::DeviceCreateInfo::default()
                .queue_create_infos(&queues)
                .push_next(&mut features);
            let device = instance.create_device(physical, &info, None)?;
            let queue = device.get_device_queue(0, 0);
            let info = vk::CommandPoolCreateInfo::default()
                .flags(vk::CommandPoolCreateFlags::RESET_COMMAND_BUFFER);
            let pool = device.create_command_pool(&info, None)?;

            use vk::ImageUsageFlags as Usage;
            let memory = instance.get_physical_device_memory_properties(physical);
            let (color, depth) = (vk::ImageAspectFlags::COLOR, vk::ImageAspectFlags::DEPTH);
            let usage = Usage::COLOR_ATTACHMENT | Usage::TRANSFER_SRC;
            let color = image(&device, &memory, vk::Format::R8G8B8A8_UNORM, usage, color)?;
            let usage = Usage::DEPTH_STENCIL_ATTACHMENT;
            let depth = image(&device, &memory, vk::Format::D32_SFLOAT, usage, depth)?;
            let info = vk::BufferCreateInfo::default()
                .size(4 * (SIZE[0] * SIZE[1]) as u64)
                .usage(vk::BufferUsageFlags::TRANSFER_DST);
            let buffer = device.create_buffer(&info, None)?;
            let needs = device.get_buffer_memory_requirements(buffer);
            let visible =
                vk::MemoryPropertyFlags::HOST_VISIBLE | vk::MemoryPropertyFlags::HOST_COHERENT;
            let memory = allocate(&device, &memory, needs, visible)?;
            device.bind_buffer_memory(buffer, memory, 0)?;
            let (layout, pipeline) = triangle(&device)?;
            Ok(Vulkan {
                entry,
                instance,
                physical,
                device,
                queue,
                pool,
                color,
                depth,
                buffer,
                memory,
                layout,
                pipeline,
            })
        }
    }

    fn host(&self) -> Host {
        Host {
            get_instance_proc_addr: self.entry.static_fn().get_instance_proc_addr as *const c_void,
            instance: self.instance.handle().as_raw(),
            physical_device: self.physical.as_raw(),
            device: self.device.handle().as_raw(),
            queue_family: 0,
            has_int64_atomics: false,
            has_debug_utils: false,
            allocation_callbacks: std::ptr::null(),
            allocate_memory: std::ptr::null(),
            free_memory: std::ptr::null(),
        }
    }

    /// Begins a command buffer, and clears the images.
    unsafe fn begin(&self) -> Outcome<vk::CommandBuffer> {
        // SAFETY: the frame before has been waited for.
        unsafe {
            let info = vk::CommandBufferAllocateInfo::default()
                .command_pool(self.pool)
                .command_buffer_count(1);
            let commands = self.device.allocate_command_buffers(&info)?[0];
            self.device.begin_command_buffer(commands, &vk::CommandBufferBeginInfo::default())?;
            let barriers = [&self.color, &self.depth].map(|image| {
                vk::ImageMemoryBarrier2::default()
                    .src_stage_mask(vk::PipelineStageFlags2::ALL_COMMANDS)
                    .dst_stage_mask(vk::PipelineStageFlags2::ALL_COMMANDS)
                    .dst_access_mask(vk::AccessFlags2::MEMORY_READ | vk::AccessFlags2::MEMORY_WRITE)
                    .new_layout(vk::ImageLayout::ATTACHMENT_OPTIMAL)
                    .image(image.image)
                    .subresource_range(whole(image.aspect))
            });
            self.device.cmd_pipeline_barrier2(
                commands,
                &vk::DependencyInfo::default().image_memory_barriers(&barriers),
            );
            Ok(commands)
        }
    }

    /// Draws a triangle in each view, with reversed depth.
    unsafe fn draw_triangle(&self, commands: vk::CommandBuffer, views: &[FrameView]) {
        let attachment = |image: &Image, clear| {
            vk::RenderingAttachmentInfo::default()
                .image_view(image.view)
                .image_layout(vk::ImageLayout::ATTACHMENT_OPTIMAL)
                .load_op(vk::AttachmentLoadOp::CLEAR)
                .store_op(vk::AttachmentStoreOp::STORE)
                .clear_value(clear)
        };
        let grey = vk::ClearColorValue { float32: [0.2, 0.2, 0.25, 1.0] };
        let color = [attachment(&self.color, vk::ClearValue { color: grey })];
        let depth = attachment(&self.depth, vk::ClearValue::default());
        let rendering = vk::RenderingInfo::default()
            .render_area(rectangle([0, 0], SIZE))
            .layer_count(1)
            .color_attachments(&color)
            .depth_attachment(&depth);
        // SAFETY: the command buffer is being recorded; the pipeline has these formats.
        unsafe {
            self.device.cmd_begin_rendering(commands, &rendering);
            let bind = vk::PipelineBindPoint::GRAPHICS;
            self.device.cmd_bind_pipeline(commands, bind, self.pipeline);
            for FrameView { camera, area } in views {
                let ViewCamera::Matrices(Matrices { view, projection }) = camera else { continue };
                let clip =
                    glam::DMat4::from_cols_array(projection) * glam::DMat4::from_cols_array(view);
                let clip = clip.as_mat4().to_cols_array();
                let viewport = vk::Viewport {
                    x: area.corner[0] as f32,
                    y: area.corner[1] as f32,
                    width: area.size[0] as f32,
                    height: area.size[1] as f32,
                    min_depth: 0.0,
                    max_depth: 1.0,
                };
                self.device.cmd_set_viewport(commands, 0, &[viewport]);
                self.device.cmd_set_scissor(commands, 0, &[rectangle(area.corner, area.size)]);
                let stage = vk::ShaderStageFlags::VERTEX;
                let bytes = bytemuck::bytes_of(&clip);
                self.device.cmd_push_constants(commands, self.layout, stage, 0, bytes);
                self.device.cmd_draw(commands, 3, 1, 0, 0);
            }
            self.device.cmd_end_rendering(commands);
        }
    }

    /// Submits, waits, and returns the pixels.
    unsafe fn submit(&self, commands: vk::CommandBuffer) -> Outcome<Vec<u8>> {
        // SAFETY: the command buffer is being recorded; the queue is waited for.
        unsafe {
            let region = vk::BufferImageCopy::default()
                .image_extent(vk::Extent3D { width: SIZE[0], height: SIZE[1], depth: 1 })
                .image_subresource(vk::ImageSubresourceLayers {
                    aspect_mask: vk::ImageAspectFlags::COLOR,
                    layer_count: 1,
                    ..Default::default()
                });
            let layout = vk::ImageLayout::TRANSFER_SRC_OPTIMAL;
            let (image, buffer) = (self.color.image, self.buffer);
            self.device.cmd_copy_image_to_buffer(commands, image, layout, buffer, &[region]);
            self.device.end_command_buffer(commands)?;
            let commands = [commands];
            let submit = vk::SubmitInfo::default().command_buffers(&commands);
            self.device.queue_submit(self.queue, &[submit], vk::Fence::null())?;
            self.device.queue_wait_idle(self.queue)?;
            self.device.free_command_buffers(self.pool, &commands);
            let (bytes, flags) = (4 * (SIZE[0] * SIZE[1]) as u64, vk::MemoryMapFlags::empty());
            let mapped = self.device.map_memory(self.memory, 0, bytes, flags)?;
            let pixels = std::slice::from_raw_parts(mapped.cast(), bytes as usize).to_vec();
            self.device.unmap_memory(self.memory);
            Ok(pixels)
        }
    }
}

impl Drop for Vulkan {
    fn drop(&mut self) {
        // SAFETY: the queue is idle, and the renderer is gone.
        unsafe {
            self.device.destroy_pipeline(self.pipeline, None);
            self.device.destroy_pipeline_layout(self.layout, None);
            self.device.destroy_buffer(self.buffer, None);
            self.device.free_memory(self.memory, None);
            for image in [&self.color, &self.depth] {
                self.device.destroy_image_view(image.view, None);
                self.device.destroy_image(image.image, None);
                self.device.free_memory(image.memory, None);
            }
            self.device.destroy_command_pool(self.pool, None);
            self.device.destroy_device(None);
            self.instance.destroy_instance(None);
        }
    }
}

fn rectangle([x, y]: [i32; 2], [width, height]: [u32; 2]) -> vk::Rect2D {
    vk::Rect2D { offset: vk::Offset2D { x, y }, extent: vk::Extent2D { width, height } }
}

fn whole(aspect_mask: vk::ImageAspectFlags) -> vk::ImageSubresourceRange {
    vk::ImageSubresourceRange { aspect_mask, level_count: 1, layer_count: 1, ..Default::default() }
}

unsafe fn allocate(
    device: &ash::Device,
    memory: &vk::PhysicalDeviceMemoryProperties,
    needs: vk::MemoryRequirements,
    flags: vk::MemoryPropertyFlags,
) -> Outcome<vk::DeviceMemory> {
    let fits = |kind: &u32| {
        needs.memory_type_bits >> kind & 1 == 1
            && memory.memory_types[*kind as usize].property_flags.contains(flags)
    };
    let kind = (0..memory.memory_type_count).find(fits).ok_or("no memory of this kind")?;
    let info =
        vk::MemoryAllocateInfo::default().allocation_size(needs.size).memory_type_index(kind);
    // SAFETY: a plain allocation.
    Ok(unsafe { device.allocate_memory(&info, None) }?)
}

unsafe fn image(
    device: &ash::Device,
    memory: &vk::PhysicalDeviceMemoryProperties,
    format: vk::Format,
    usage: vk::ImageUsageFlags,
    aspect: vk::ImageAspectFlags,
) -> Outcome<Image> {
    let info = vk::ImageCreateInfo::default()
        .image_type(vk::ImageType::TYPE_2D)
        .format(format)
        .extent(vk::Extent3D { width: SIZE[0], height: SIZE[1], depth: 1 })
        .mip_levels(1)
        .array_layers(1)
        .samples(vk::SampleCountFlags::TYPE_1)
        .usage(usage);
    // SAFETY: plain creations on a live device.
    unsafe {
        let image = device.create_image(&info, None)?;
        let needs = device.get_image_memory_requirements(image);
        let memory = allocate(device, memory, needs, vk::MemoryPropertyFlags::DEVICE_LOCAL)?;
        device.bind_image_memory(image, memory, 0)?;
        let info = vk::ImageViewCreateInfo::default()
            .image(image)
            .view_type(vk::ImageViewType::TYPE_2D)
            .format(format)
            .subresource_range(whole(aspect));
        let view = device.create_image_view(&info, None)?;
        Ok(Image { image, view, memory, format, aspect })
    }
}

/// Makes the pipeline of the triangle.
unsafe fn triangle(device: &ash::Device) -> Outcome<(vk::PipelineLayout, vk::Pipeline)> {
    let words = |bytes: &[u8]| bytemuck::pod_collect_to_vec::<u8, u32>(bytes);
    let vertex = words(include_bytes!(concat!(env!("OUT_DIR"), "/triangle.vert.spv")));
    let fragment = words(include_bytes!(concat!(env!("OUT_DIR"), "/triangle.frag.spv")));
    let push =
        [vk::PushConstantRange { stage_flags: vk::ShaderStageFlags::VERTEX, offset: 0, size: 64 }];
    let input = vk::PipelineVertexInputStateCreateInfo::default();
    let assembly = vk::PipelineInputAssemblyStateCreateInfo::default()
        .topology(vk::PrimitiveTopology::TRIANGLE_LIST);
    let viewport =
        vk::PipelineViewportStateCreateInfo::default().viewport_count(1).scissor_count(1);
    let rasterization = vk::PipelineRasterizationStateCreateInfo::default().line_width(1.0);
    let samples = vk::PipelineMultisampleStateCreateInfo::default()
        .rasterization_samples(vk::SampleCountFlags::TYPE_1);
    let depth = vk::PipelineDepthStencilStateCreateInfo::default()
        .depth_test_enable(true)
        .depth_write_enable(true)
        .depth_compare_op(vk::CompareOp::GREATER);
    let written = [vk::PipelineColorBlendAttachmentState::default()
        .color_write_mask(vk::ColorComponentFlags::RGBA)];
    let blend = vk::PipelineColorBlendStateCreateInfo::default().attachments(&written);
    let states = [vk::DynamicState::VIEWPORT, vk::DynamicState::SCISSOR];
    let dynamic = vk::PipelineDynamicStateCreateInfo::default().dynamic_states(&states);
    let formats = [vk::Format::R8G8B8A8_UNORM];
    let mut rendering = vk::PipelineRenderingCreateInfo::default()
        .color_attachment_formats(&formats)
        .depth_attachment_format(vk::Format::D32_SFLOAT);
    // SAFETY: plain creations on a live device.
    unsafe {
        let info = vk::PipelineLayoutCreateInfo::default().push_constant_ranges(&push);
        let layout = device.create_pipeline_layout(&info, None)?;
        let module = |code: &[u32]| {
            device.create_shader_module(&vk::ShaderModuleCreateInfo::default().code(code), None)
        };
        let modules = [module(&vertex)?, module(&fragment)?];
        let stages = [vk::ShaderStageFlags::VERTEX, vk::ShaderStageFlags::FRAGMENT];
        let stages = [0, 1].map(|k| {
            vk::PipelineShaderStageCreateInfo::default()
                .stage(stages[k])
                .module(modules[k])
                .name(c"main")
        });
        let info = vk::GraphicsPipelineCreateInfo::default()
            .stages(&stages)
            .vertex_input_state(&input)
            .input_assembly_state(&assembly)
            .viewport_state(&viewport)
            .rasterization_state(&rasterization)
            .multisample_state(&samples)
            .depth_stencil_state(&depth)
            .color_blend_state(&blend)
            .dynamic_state(&dynamic)
            .layout(layout)
            .push_next(&mut rendering);
        let made = device.create_graphics_pipelines(vk::PipelineCache::null(), &[info], None);
        modules.into_iter().for_each(|module| device.destroy_shader_module(module, None));
        Ok((layout, made.map_err(|(_, code)| code)?[0]))
    }
}
