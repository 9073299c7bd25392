//! A host in wgpu: the picture of `tools/embed.rs`, a triangle through a cloud, in two viewports.
//!
//! ```sh
//! cargo run --release --example embed_wgpu -- scan.laz picture.png
//! ```
//!
//! wgpu's own device lacks features that the renderer needs, so [`open`] makes a Vulkan device with
//! both, and gives it to wgpu. In [`Host::draw`], wgpu draws, then the renderer records into an
//! encoder of its own, then wgpu copies the picture.

use ash::vk::{self, Handle};
use pointillist::renderer::{
    self, Access, Area, Frame, FrameView, Matrices, Picked, Preset, Renderer, RendererOptions,
    Target, Targets, ViewCamera,
};
use std::ffi::c_void;
use std::future::Future;
use std::task::{Context, Poll, Waker};
use wgpu::hal::api::Vulkan;

type Outcome<T> = Result<T, Box<dyn std::error::Error>>;

const SIZE: [u32; 2] = [800, 400];
const HALF: [u32; 2] = [400, 400];
const COLOR: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8Unorm;
const DEPTH: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;

const SHADER: &str = "
@group(0) @binding(0) var<uniform> clip_from_world: array<mat4x4f, 2>;

@vertex fn corner(@builtin(vertex_index) at: u32, @builtin(instance_index) side: u32)
    -> @builtin(position) vec4f {
    var corners = array(vec3f(-1.2, 0.0, -1.0), vec3f(1.2, 0.0, -1.0), vec3f(0.0, 0.0, 1.2));
    return clip_from_world[side] * vec4f(corners[at], 1.0);
}

@fragment fn color() -> @location(0) vec4f {
    return vec4f(0.9, 0.5, 0.1, 1.0);
}
";

fn main() -> Outcome<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [cloud, picture] = &arguments[..] else { return Err("give a cloud and a picture".into()) };
    // SAFETY: the device outlives the renderer; `draw` waits for each frame.
    unsafe {
        let (device, queue, host) = open()?;
        let host =
            Host { renderer: Renderer::new(&host, RendererOptions::default())?, device, queue };
        host.run(cloud, picture)
    }
}

/// Waits for a future of wgpu, which are all ready at once outside of browsers.
fn wait<T>(future: impl Future<Output = T>) -> T {
    let mut future = std::pin::pin!(future);
    loop {
        if let Poll::Ready(found) = future.as_mut().poll(&mut Context::from_waker(Waker::noop())) {
            return found;
        }
    }
}

/// Opens the first device, with what wgpu and the renderer need.
unsafe fn open() -> Outcome<(wgpu::Device, wgpu::Queue, renderer::Host)> {
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor {
        backends: wgpu::Backends::VULKAN,
        ..wgpu::InstanceDescriptor::new_without_display_handle()
    });
    let adapters = wait(instance.enumerate_adapters(wgpu::Backends::VULKAN));
    let adapter = adapters.first().ok_or("no device")?;
    let wanted = wgpu::DeviceDescriptor::default();
    // SAFETY: the device is made from this adapter, with all that wgpu asks of it and more.
    unsafe {
        let hal = adapter.as_hal::<Vulkan>().ok_or("not a device of Vulkan")?;
        let shared = hal.shared_instance();
        let (raw, physical) = (shared.raw_instance(), hal.raw_physical_device());
        let address = shared.entry().static_fn().get_instance_proc_addr as *const c_void;
        renderer::check(address, raw.handle().as_raw(), physical.as_raw())?;

        let extensions = hal.required_device_extensions(wanted.required_features);
        let mut features = hal.physical_device_features(&extensions, wanted.required_features);
        let names: Vec<_> = extensions.iter().map(|name| name.as_ptr()).collect();
        let queues = [vk::DeviceQueueCreateInfo::default().queue_priorities(&[1.0])];
        let mut core = vk::PhysicalDeviceFeatures2::default().features(features.get_core());
        // wgpu enables features one structure each. These are those that it does not name.
        let mut addresses = vk::PhysicalDeviceBufferDeviceAddressFeatures::default();
        let mut scalars = vk::PhysicalDeviceScalarBlockLayoutFeatures::default();
        let mut synchronization = vk::PhysicalDeviceSynchronization2Features::default();
        let mut rendering = vk::PhysicalDeviceDynamicRenderingFeatures::default();
        let mut demotion = vk::PhysicalDeviceShaderDemoteToHelperInvocationFeatures::default();
        let info = vk::DeviceCreateInfo::default()
            .queue_create_infos(&queues)
            .enabled_extension_names(&names);
        let mut info = features
            .add_to_device_create(info)
            .push_next(&mut addresses)
            .push_next(&mut scalars)
            .push_next(&mut synchronization)
            .push_next(&mut rendering)
            .push_next(&mut demotion)
            .push_next(&mut core);
        info.p_enabled_features = std::ptr::null();
        renderer::enable_features(info.p_next.cast_mut(), false)?;
        let device = raw.create_device(physical, &info, None)?;
        let host = renderer::Host {
            get_instance_proc_addr: address,
            instance: raw.handle().as_raw(),
            physical_device: physical.as_raw(),
            device: device.handle().as_raw(),
            queue_family: 0,
            has_int64_atomics: false,
            has_debug_utils: false,
            allocation_callbacks: std::ptr::null(),
            allocate_memory: std::ptr::null(),
            free_memory: std::ptr::null(),
        };
        let (features, limits) = (wanted.required_features, &wanted.required_limits);
        let hints = &wanted.memory_hints;
        let open = hal.device_from_raw(device, None, &extensions, features, limits, hints, 0, 0)?;
        let (device, queue) = adapter.create_device_from_hal(open, &wanted)?;
        Ok((device, queue, host))
    }
}

/// The application; its renderer is dropped before its device.
struct Host {
    renderer: Renderer,
    device: wgpu::Device,
    queue: wgpu::Queue,
}

impl Host {
    /// Draws frames until the cloud is complete and a point is picked, and writes the picture.
    unsafe fn run(mut self, cloud: &str, picture: &str) -> Outcome<()> {
        let images = [COLOR, DEPTH].map(|format| self.image(format));
        let triangle = Triangle::new(&self.device);
        let id = self.renderer.open(&[cloud.into()], &Default::default())?;
        let (mut number, mut pick) = (0, None);
        loop {
            number += 1;
            // SAFETY: the frame before is completed.
            let (settled, pixels) = unsafe { self.draw(&triangle, &images, number) }?;
            let Some(wanted) = pick else {
                if settled && self.renderer.framing(Preset::Front, HALF).is_some() {
                    pick = Some(self.renderer.pick([HALF[0] / 2, HALF[1] / 2]));
                }
                continue;
            };
            match self.renderer.picked(wanted) {
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

    fn image(&self, format: wgpu::TextureFormat) -> wgpu::Texture {
        self.device.create_texture(&wgpu::TextureDescriptor {
            label: None,
            size: wgpu::Extent3d { width: SIZE[0], height: SIZE[1], depth_or_array_layers: 1 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format,
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC,
            view_formats: &[],
        })
    }

    /// Draws a frame and waits for it. Returns whether the cloud is complete, and the pixels.
    unsafe fn draw(
        &mut self,
        triangle: &Triangle,
        images: &[wgpu::Texture; 2],
        number: u64,
    ) -> Outcome<(bool, Vec<u8>)> {
        let [color, depth] = images;
        let views = [color, depth].map(|image| image.create_view(&Default::default()));
        let mut cameras = Vec::new();
        for (side, preset) in [Preset::Fit, Preset::Front].into_iter().enumerate() {
            let Some(mut camera) = self.renderer.framing(preset, HALF) else { continue };
            camera.fov_y = 45.0;
            let camera = ViewCamera::Matrices(Matrices::of(&camera, HALF, 0.01, 1e6)?);
            let area = Area { corner: [(side as u32 * HALF[0]) as i32, 0], size: HALF };
            cameras.push(FrameView { camera, area });
        }
        let encoder = || self.device.create_command_encoder(&Default::default());
        let mut before = encoder();
        triangle.draw(&self.queue, &mut before, &views, &cameras);
        // What the renderer is told below.
        let state = [wgpu::TextureUses::COLOR_TARGET, wgpu::TextureUses::DEPTH_STENCIL_WRITE];
        let transition = |i: usize| wgpu::TextureTransition {
            texture: &images[i],
            selector: None,
            state: state[i],
        };
        before.transition_resources([].into_iter(), [0, 1].map(transition).into_iter());

        let layouts = [
            vk::ImageLayout::COLOR_ATTACHMENT_OPTIMAL,
            vk::ImageLayout::DEPTH_STENCIL_ATTACHMENT_OPTIMAL,
        ];
        let formats = [vk::Format::R8G8B8A8_UNORM, vk::Format::D32_SFLOAT];
        let target = |i: usize| -> Outcome<Target> {
            // SAFETY: image and view live until the frame is completed.
            let (image, view) = unsafe {
                let image = images[i].as_hal::<Vulkan>().ok_or("no image of Vulkan")?;
                let view = views[i].as_hal::<Vulkan>().ok_or("no view of Vulkan")?;
                (image.raw_handle().as_raw(), view.raw_handle().as_raw())
            };
            Ok(Target {
                image,
                view,
                format: formats[i].as_raw(),
                size: SIZE,
                samples: 1,
                before: Access::any(layouts[i].as_raw()),
                after: Access::any(layouts[i].as_raw()),
                clear: false,
            })
        };
        let targets = Targets { depth: Some(target(1)?), ..Targets::of(target(0)?) };
        let frame = Frame { number, safe: number - 1, targets, views: &cameras };
        // An encoder takes commands of wgpu or raw ones, not both.
        let mut raw = encoder();
        // SAFETY: the command buffer is being recorded; the images are as the targets say.
        let report = unsafe {
            raw.as_hal_mut::<Vulkan, _, _>(|encoder| -> Outcome<renderer::FrameReport> {
                let commands = encoder.ok_or("no encoder of Vulkan")?.raw_handle();
                Ok(self.renderer.record(commands.as_raw(), &frame)?)
            })
        }?;
        report.errors.iter().for_each(|error| eprintln!("{error}"));

        let mut after = encoder();
        let row = (4 * SIZE[0]).next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
        let buffer = self.device.create_buffer(&wgpu::BufferDescriptor {
            label: None,
            size: (row * SIZE[1]) as u64,
            usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
            mapped_at_creation: false,
        });
        let layout = wgpu::TexelCopyBufferLayout { bytes_per_row: Some(row), ..Default::default() };
        let to = wgpu::TexelCopyBufferInfo { buffer: &buffer, layout };
        after.copy_texture_to_buffer(color.as_image_copy(), to, color.size());
        self.queue.submit([before, raw, after].map(wgpu::CommandEncoder::finish));
        buffer.map_async(wgpu::MapMode::Read, .., |mapped| mapped.expect("a buffer to read"));
        self.device.poll(wgpu::PollType::wait_indefinitely())?;
        let mapped = buffer.get_mapped_range(..)?;
        let rows = mapped.chunks(row as usize).map(|row| &row[..4 * SIZE[0] as usize]);
        Ok((report.settled, rows.collect::<Vec<_>>().concat()))
    }
}

/// The application's own geometry.
struct Triangle {
    pipeline: wgpu::RenderPipeline,
    matrices: wgpu::Buffer,
    group: wgpu::BindGroup,
}

impl Triangle {
    fn new(device: &wgpu::Device) -> Triangle {
        let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: None,
            source: wgpu::ShaderSource::Wgsl(SHADER.into()),
        });
        let pipeline = device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: None,
            layout: None,
            vertex: wgpu::VertexState {
                module: &module,
                entry_point: None,
                compilation_options: Default::default(),
                buffers: &[],
            },
            primitive: Default::default(),
            depth_stencil: Some(wgpu::DepthStencilState {
                format: DEPTH,
                depth_write_enabled: Some(true),
                depth_compare: Some(wgpu::CompareFunction::Greater),
                stencil: Default::default(),
                bias: Default::default(),
            }),
            multisample: Default::default(),
            fragment: Some(wgpu::FragmentState {
                module: &module,
                entry_point: None,
                compilation_options: Default::default(),
                targets: &[Some(COLOR.into())],
            }),
            multiview_mask: None,
            cache: None,
        });
        let matrices = device.create_buffer(&wgpu::BufferDescriptor {
            label: None,
            size: 2 * 64,
            usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout: &pipeline.get_bind_group_layout(0),
            entries: &[wgpu::BindGroupEntry { binding: 0, resource: matrices.as_entire_binding() }],
        });
        Triangle { pipeline, matrices, group }
    }

    /// Draws it in each view, with reversed depth.
    fn draw(
        &self,
        queue: &wgpu::Queue,
        encoder: &mut wgpu::CommandEncoder,
        [color, depth]: &[wgpu::TextureView; 2],
        cameras: &[FrameView],
    ) {
        // In the clip space of wgpu, y points up.
        let upwards = glam::DMat4::from_scale(glam::DVec3::new(1.0, -1.0, 1.0));
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: color,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations {
                    load: wgpu::LoadOp::Clear(wgpu::Color { r: 0.2, g: 0.2, b: 0.25, a: 1.0 }),
                    store: wgpu::StoreOp::Store,
                },
            })],
            depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                view: depth,
                depth_ops: Some(wgpu::Operations {
                    load: wgpu::LoadOp::Clear(0.0),
                    store: wgpu::StoreOp::Store,
                }),
                stencil_ops: None,
            }),
            ..Default::default()
        });
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &self.group, &[]);
        for (side, FrameView { camera, area }) in (0..).zip(cameras) {
            let ViewCamera::Matrices(Matrices { view, projection }) = camera else { continue };
            let [view, projection] = [view, projection].map(glam::DMat4::from_cols_array);
            let clip = (upwards * projection * view).as_mat4().to_cols_array();
            queue.write_buffer(&self.matrices, 64 * side as u64, bytemuck::bytes_of(&clip));
            let ([x, y], [width, height]) = (area.corner, area.size.map(|side| side as f32));
            pass.set_viewport(x as f32, y as f32, width, height, 0.0, 1.0);
            pass.draw(0..3, side..side + 1);
        }
    }
}
