//! A host draws clouds into its own images, beside its own geometry, on its own queue.

mod affine;
mod lifetimes;
mod ownership;
mod picks;
mod wrong_calls;

use crate::counting::{self, allocations, heap_bytes, objects};
use crate::files;
use crate::gpu::division_error;
use crate::index_file::indexed;
use ash::vk::{self, Handle};
use glam::DVec3;
use pointillist::cloud::colormap::linear_to_srgb;
use pointillist::gpu::{Device, DeviceOptions, TestOverrides};
use pointillist::graph::Graph;
use pointillist::passes::{Effects, Switch, encode};
use pointillist::progress::Silent;
use pointillist::render::frame;
use pointillist::render::settings::{FrameConfig, RenderSettings, Style};
use pointillist::render::source::{OpenOptions, Source};
use pointillist::renderer::{
    Access, Area, Camera, CloudState, Encoding, Frame, FrameReport, FrameView, Host, Limit,
    Matrices, NO_POINT, OpenSettings, Picked, PointBuffer, Points, Positions, Preset, Renderer,
    RendererOptions, Target, Targets, ViewCamera,
};
use pointillist::resident::Resident;
use pointillist::view::View;
use std::path::PathBuf;

const SIZE: [u32; 2] = [320, 240];
const COLOR: vk::Format = vk::Format::R8G8B8A8_UNORM;
const DEPTH: vk::Format = vk::Format::D32_SFLOAT;
const IDS: vk::Format = vk::Format::R32G32_UINT;
const NORMALS: vk::Format = vk::Format::R32G32B32A32_SFLOAT;

/// An application with a device, two images, and a buffer to read and write them through.
struct Application {
    device: Device,
    commands: vk::CommandBuffer,
    pool: vk::CommandPool,
    fence: vk::Fence,
    color: HostImage,
    depth: HostImage,
    ids: HostImage,
    normals: HostImage,
    /// Ids and normals of the last frame that drew them.
    layers: (Vec<[u32; 2]>, Vec<[f32; 4]>),
    staging: vk::Buffer,
    staging_memory: vk::DeviceMemory,
    mapped: *mut u8,
    frame: u64,
    /// Messages of the validation layers about the last frame.
    said: pointillist::error::Result<()>,
    /// Time that recording the last frame took.
    recorded: std::time::Duration,
    /// Family that owns all images between the host's work and the renderer's.
    owner: Option<u32>,
}

struct HostImage {
    image: vk::Image,
    view: vk::ImageView,
    memory: vk::DeviceMemory,
    format: vk::Format,
}

/// Room for points behind the images' texels.
const POINT_BYTES: usize = 1 << 21;
const PIXELS: usize = (SIZE[0] * SIZE[1]) as usize;

impl Application {
    fn new(color: vk::Format) -> Application {
        let device =
            Device::open(&DeviceOptions { validate: true, ..DeviceOptions::default() }).unwrap();
        // SAFETY: plain creations on a live device, destroyed in drop.
        unsafe {
            let raw = &device.raw;
            let info = vk::CommandPoolCreateInfo::default()
                .queue_family_index(device.family)
                .flags(vk::CommandPoolCreateFlags::RESET_COMMAND_BUFFER);
            let pool = raw.create_command_pool(&info, None).unwrap();
            let info =
                vk::CommandBufferAllocateInfo::default().command_pool(pool).command_buffer_count(1);
            let commands = raw.allocate_command_buffers(&info).unwrap()[0];
            let fence = raw.create_fence(&vk::FenceCreateInfo::default(), None).unwrap();
            use vk::ImageUsageFlags as Usage;
            let copied = Usage::TRANSFER_SRC | Usage::TRANSFER_DST;
            let color = HostImage::new(&device, color, Usage::COLOR_ATTACHMENT | copied);
            let depth = HostImage::new(&device, DEPTH, Usage::DEPTH_STENCIL_ATTACHMENT | copied);
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
                owner: None,
                device,
            }
        }
    }

    fn host(&self) -> Host {
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

    fn renderer(&self) -> Renderer {
        // SAFETY: tests drop the renderer before the application.
        unsafe { Renderer::new(&self.host(), RendererOptions::default()) }.unwrap()
    }

    /// Returns targets that are cleared, and read by copies afterwards.
    fn targets(&self) -> Targets {
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
        Targets { depth, ids, normals, ..Targets::of(target(&self.color)) }
    }

    /// Draws a frame, about which the validation layers say nothing.
    fn draw(
        &mut self,
        renderer: &mut Renderer,
        targets: Targets,
        views: &[FrameView],
        before: Option<(&[[u8; 4]], &[f32])>,
    ) -> (FrameReport, Vec<u8>, Vec<f32>) {
        let drawn = self.submit(renderer, targets, views, before);
        std::mem::replace(&mut self.said, Ok(())).unwrap();
        drawn
    }

    /// Records and submits a frame, waits, and reads colour and depth back. `before` fills the
    /// images first.
    fn submit(
        &mut self,
        renderer: &mut Renderer,
        targets: Targets,
        views: &[FrameView],
        before: Option<(&[[u8; 4]], &[f32])>,
    ) -> (FrameReport, Vec<u8>, Vec<f32>) {
        self.frame += 1;
        let (raw, commands) = (&self.device.raw, self.commands);
        let texel = if self.color.format == vk::Format::R16G16B16A16_SFLOAT { 8 } else { 4 };
        let depth_at = 16 * PIXELS;
        // SAFETY: every object is alive, and the fence is waited for before the next frame.
        unsafe {
            let info = vk::CommandBufferBeginInfo::default()
                .flags(vk::CommandBufferUsageFlags::ONE_TIME_SUBMIT);
            raw.begin_command_buffer(commands, &info).unwrap();
            if let Some((color, depth)) = before {
                std::ptr::copy_nonoverlapping(color.as_ptr().cast(), self.mapped, 4 * PIXELS);
                let place = self.mapped.add(depth_at);
                std::ptr::copy_nonoverlapping(depth.as_ptr().cast(), place, 4 * PIXELS);
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
            self.give_up(&targets);
            let frame = Frame { number: self.frame, safe: self.frame - 1, targets, views };
            let began = std::time::Instant::now();
            let report = renderer.record(commands.as_raw(), &frame).unwrap();
            self.recorded = began.elapsed();
            self.take_back(&targets);
            let [ids_at, normals_at] = [20 * PIXELS, 32 * PIXELS];
            let layers = [(&self.ids, ids_at as u64), (&self.normals, normals_at as u64)];
            let layers = if targets.ids.is_some() { &layers[..] } else { &[] };
            for &(image, at) in
                [(&self.color, 0), (&self.depth, depth_at as u64)].iter().chain(layers)
            {
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
            self.said = self.device.take_validation_errors();
            let color = std::slice::from_raw_parts(self.mapped, texel * PIXELS).to_vec();
            let ids = self.mapped.add(ids_at).cast();
            let normals = self.mapped.add(normals_at).cast();
            self.layers = (
                std::slice::from_raw_parts(ids, PIXELS).to_vec(),
                std::slice::from_raw_parts(normals, PIXELS).to_vec(),
            );
            let depth = self.mapped.add(depth_at).cast::<f32>();
            (report, color, std::slice::from_raw_parts(depth, PIXELS).to_vec())
        }
    }

    /// Draws until everything that the views call for is drawn.
    fn settle(
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
        panic!("the picture never settles");
    }
}

impl Application {
    /// Records frames, which are not submitted, until one fails. Returns its error.
    fn first_error(&self, renderer: &mut Renderer, views: &[FrameView]) -> String {
        let (raw, commands) = (&self.device.raw, self.commands);
        for number in 1..500 {
            let frame = Frame { number, safe: number - 1, targets: self.targets(), views };
            // SAFETY: every object is alive, and no frame is in flight.
            let recorded = unsafe {
                raw.begin_command_buffer(commands, &Default::default()).unwrap();
                let recorded = renderer.record(commands.as_raw(), &frame);
                raw.end_command_buffer(commands).unwrap();
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
unsafe fn allocate(
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
    fn new(device: &Device, format: vk::Format, usage: vk::ImageUsageFlags) -> HostImage {
        HostImage::on(device, &device.raw, format, usage)
    }

    /// Makes an image on a device of the same physical device.
    fn on(
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

    fn region(&self, at: u64) -> vk::BufferImageCopy {
        let [width, height] = SIZE;
        vk::BufferImageCopy::default()
            .buffer_offset(at)
            .image_extent(vk::Extent3D { width, height, depth: 1 })
            .image_subresource(vk::ImageSubresourceLayers {
                aspect_mask: range(self.format).aspect_mask,
                layer_count: 1,
                ..Default::default()
            })
    }

    /// # Safety
    /// The command buffer is being recorded.
    unsafe fn transition(
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

fn range(format: vk::Format) -> vk::ImageSubresourceRange {
    let aspect_mask =
        if format == DEPTH { vk::ImageAspectFlags::DEPTH } else { vk::ImageAspectFlags::COLOR };
    vk::ImageSubresourceRange { aspect_mask, level_count: 1, layer_count: 1, ..Default::default() }
}

/// Writes a scan and returns its path, and a camera.
fn scan(folder: &std::path::Path) -> (PathBuf, Camera) {
    let path = folder.join("torus.las");
    files::scan(&path, pointillist::synth::SceneKind::Torus, 100_000);
    let options = pointillist::cloud::ReadOptions::new(Default::default(), false);
    let cloud = pointillist::cloud::read(std::slice::from_ref(&path), &options, &Silent).unwrap();
    let camera = Camera::framing(Preset::Fit, &cloud.core_points(), SIZE);
    (path, camera)
}

const WHOLE: Area = Area { corner: [0, 0], size: SIZE };

fn view_of(camera: Camera) -> FrameView {
    let camera = ViewCamera::Camera { camera, near: 0.01, far: f64::INFINITY };
    FrameView { camera, area: WHOLE }
}

/// A picture as `render` draws it.
struct Rendered {
    /// Red, green and blue of each pixel.
    color: Vec<u8>,
    /// Planar depths.
    depth: Vec<f32>,
    ids: Vec<u32>,
    normals: Vec<[f32; 4]>,
}

/// Draws as `render` does.
fn rendered(path: &std::path::Path, camera: Camera, settings: &RenderSettings) -> Rendered {
    let options = DeviceOptions { validate: true, ..DeviceOptions::default() };
    let mut gpu = pointillist::graph::Gpu::open(&options).unwrap();
    let opening = OpenOptions {
        read: pointillist::cloud::ReadOptions::new(
            pointillist::cloud::ColumnSet { rgb: true, intensity: true, ..Default::default() },
            false,
        ),
        filter: Default::default(),
        index: None,
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

#[test]
fn a_renderer_with_a_device_of_its_own_draws_the_same_and_refuses_frames_of_hosts() {
    let folder = tempfile::tempdir().unwrap();
    let (path, camera) = scan(folder.path());
    let options = DeviceOptions { validate: true, ..DeviceOptions::default() };
    let mut renderer = Renderer::open_device(&options, RendererOptions::default()).unwrap();
    let cloud = renderer.open(std::slice::from_ref(&path), &OpenSettings::default()).unwrap();
    renderer.wait(cloud).unwrap();
    let expected = rendered(&path, camera, &RenderSettings::default());
    assert_eq!(renderer.picture(cloud, camera, SIZE).unwrap(), expected.color);

    let application = Application::new(COLOR);
    let (targets, mut hosted) = (application.targets(), application.renderer());
    let frame = Frame { number: 1, safe: 0, targets, views: &[] };
    // SAFETY: it is refused before anything is used.
    let refused = unsafe { renderer.record(0, &frame) }.unwrap_err();
    assert!(refused.to_string().contains("device of its own"), "{refused}");
    let cloud = hosted.open(std::slice::from_ref(&path), &OpenSettings::default()).unwrap();
    let refused = hosted.wait(cloud).unwrap_err();
    assert!(refused.to_string().contains("host's device"), "{refused}");
    let missing = renderer.open(&[folder.path().join("missing.las")], &OpenSettings::default());
    assert!(renderer.wait(missing.unwrap()).unwrap_err().to_string().contains("missing.las"));
}

#[test]
fn a_limit_changes_pictures_as_far_as_it_asks_and_none_changes_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let (path, camera) = scan(folder.path());
    let options = DeviceOptions { validate: true, ..DeviceOptions::default() };
    let mut renderer = Renderer::open_device(&options, RendererOptions::default()).unwrap();
    let cloud = renderer.open(std::slice::from_ref(&path), &OpenSettings::default()).unwrap();
    renderer.wait(cloud).unwrap();
    let plain = renderer.picture(cloud, camera, SIZE).unwrap();
    // The fastest settings of all; the most accurate, which are the renderer's own.
    renderer.set_limit(Some(Limit::Pixels(100.0))).unwrap();
    assert_ne!(renderer.picture(cloud, camera, SIZE).unwrap(), plain);
    renderer.set("error", "0.000000001px").unwrap();
    assert!(renderer.set("time", "soon").unwrap_err().to_string().contains("not a time"));
    assert_eq!(renderer.picture(cloud, camera, SIZE).unwrap(), plain);
    // Whatever a minute is enough for, after some pictures.
    renderer.set_limit(Some(Limit::Time(60_000.0))).unwrap();
    let mut pictures = (0..12).map(|_| renderer.picture(cloud, camera, SIZE).unwrap());
    assert_eq!(pictures.next_back().unwrap(), plain);
    renderer.set_limit(None).unwrap();
    assert_eq!(renderer.picture(cloud, camera, SIZE).unwrap(), plain);
}

fn without_alpha(color: &[u8]) -> Vec<u8> {
    color.chunks(4).flat_map(|pixel| &pixel[..3]).copied().collect()
}

#[test]
fn an_embedded_frame_is_that_of_render_byte_for_byte() {
    let folder = tempfile::tempdir().unwrap();
    let (path, camera) = scan(folder.path());
    let all = ["edl=on", "shadows=on", "ao=on", "antialias=on"];
    let styles = [Style::Surface, Style::Surface, Style::Strokes];
    for (style, effects) in styles.into_iter().zip([&[][..], &all, &[]]) {
        let effects_of_style = Effects::of(style);
        let mut settings = RenderSettings { effects: effects_of_style, ..Default::default() };
        effects.iter().for_each(|effect| settings.effects.set(effect).unwrap());
        let expected = rendered(&path, camera, &settings);
        let mut application = Application::new(COLOR);
        let mut renderer = application.renderer();
        renderer.set_settings(settings);
        let cloud = renderer.open(std::slice::from_ref(&path), &OpenSettings::default()).unwrap();
        let targets = application.targets();
        let (report, color, depth) = application.settle(&mut renderer, targets, &[view_of(camera)]);
        assert_eq!(renderer.state(cloud).unwrap(), CloudState::Ready);
        assert!(report.points > 0 && report.effects.iter().any(|effect| effect.runs));
        assert!(without_alpha(&color) == expected.color, "colours differ, {style:?} {effects:?}");
        let division = division_error(&application.device);
        let (ids, normals) = &application.layers;
        for (i, (&host, &planar)) in depth.iter().zip(&expected.depth).enumerate() {
            let seen = planar.is_finite() && planar > 0.0;
            let id = if seen { [expected.ids[i], cloud.0 as u32] } else { [NO_POINT, 0] };
            assert_eq!(ids[i], id, "pixel {i}");
            let [x, y, z, _] = if seen { expected.normals[i] } else { [0.0; 4] };
            assert_eq!(normals[i], [x, y, z, 0.0], "pixel {i}");
            let expected = if planar.is_finite() && planar > 0.0 { 0.01f32 / planar } else { 0.0 };
            let error = (host - expected).abs();
            assert!(error <= division * expected, "pixel {i}: {host}, {expected}");
        }
        // A second frame is the same, and takes no new memory.
        let (_, again, _) = application.draw(&mut renderer, targets, &[view_of(camera)], None);
        assert!(again == color);
        drop(renderer);
    }
}

/// Device memory by functions of the host.
mod device_memory {
    use super::*;
    use std::collections::HashMap;
    use std::sync::Mutex;

    /// The functions of the last device, the sizes of what is allocated, and the most bytes of it.
    /// They are another device's after its libraries have been loaded again.
    static REAL: Mutex<Option<(vk::PFN_vkAllocateMemory, vk::PFN_vkFreeMemory)>> = Mutex::new(None);
    pub static HELD: Mutex<Option<HashMap<vk::DeviceMemory, u64>>> = Mutex::new(None);
    pub static MOST: Mutex<u64> = Mutex::new(u64::MAX);

    pub fn of(device: &Device) {
        let real = device.raw.fp_v1_0();
        *REAL.lock().unwrap() = Some((real.allocate_memory, real.free_memory));
    }

    fn real() -> (vk::PFN_vkAllocateMemory, vk::PFN_vkFreeMemory) {
        REAL.lock().unwrap().expect("set for every device")
    }

    pub fn bytes() -> u64 {
        HELD.lock().unwrap().get_or_insert_default().values().sum()
    }

    pub unsafe extern "system" fn allocate(
        device: vk::Device,
        info: *const vk::MemoryAllocateInfo<'_>,
        callbacks: *const vk::AllocationCallbacks<'_>,
        memory: *mut vk::DeviceMemory,
    ) -> vk::Result {
        // SAFETY: the caller's arguments are passed on.
        unsafe {
            let size = (*info).allocation_size;
            if bytes() + size > *MOST.lock().unwrap() {
                return vk::Result::ERROR_OUT_OF_DEVICE_MEMORY;
            }
            let result = real().0(device, info, callbacks, memory);
            if result == vk::Result::SUCCESS {
                HELD.lock().unwrap().get_or_insert_default().insert(*memory, size);
            }
            result
        }
    }

    pub unsafe extern "system" fn free(
        device: vk::Device,
        memory: vk::DeviceMemory,
        callbacks: *const vk::AllocationCallbacks<'_>,
    ) {
        HELD.lock().unwrap().get_or_insert_default().remove(&memory).expect("allocated here");
        // SAFETY: the caller's arguments are passed on.
        unsafe { real().1(device, memory, callbacks) }
    }
}

#[test]
fn device_memory_is_the_hosts() {
    let folder = tempfile::tempdir().unwrap();
    let (path, camera) = scan(folder.path());
    let settled = |functions: Option<[*const std::ffi::c_void; 2]>| {
        let mut application = Application::new(COLOR);
        device_memory::of(&application.device);
        let [allocate_memory, free_memory] = functions.unwrap_or([std::ptr::null(); 2]);
        let host = Host { allocate_memory, free_memory, ..application.host() };
        // SAFETY: the renderer is dropped before the application.
        let mut renderer = unsafe { Renderer::new(&host, RendererOptions::default()) }.unwrap();
        renderer.open(std::slice::from_ref(&path), &OpenSettings::default()).unwrap();
        let targets = application.targets();
        let color = application.settle(&mut renderer, targets, &[view_of(camera)]).1;
        (color, device_memory::bytes())
    };
    let own = device_memory::allocate as vk::PFN_vkAllocateMemory as *const std::ffi::c_void;
    let free = device_memory::free as vk::PFN_vkFreeMemory as *const std::ffi::c_void;
    let (expected, none) = settled(None);
    let (color, held) = settled(Some([own, free]));
    assert!(color == expected && none == 0 && held > 0, "{held} bytes");
    assert_eq!(device_memory::bytes(), 0, "all is given back");

    // A host may refuse; both functions are needed.
    *device_memory::MOST.lock().unwrap() = 1 << 20;
    let application = Application::new(COLOR);
    device_memory::of(&application.device);
    let host = Host { allocate_memory: own, free_memory: free, ..application.host() };
    // SAFETY: as above.
    let error = match unsafe { Renderer::new(&host, RendererOptions::default()) } {
        Ok(mut renderer) => {
            renderer.open(std::slice::from_ref(&path), &OpenSettings::default()).unwrap();
            application.first_error(&mut renderer, &[view_of(camera)])
        }
        Err(error) => error.to_string(),
    };
    assert!(error.contains("MiB of device memory"), "{error}");
    assert_eq!(device_memory::bytes(), 0, "all is given back");
    let half = Host { free_memory: std::ptr::null(), ..host };
    // SAFETY: as above.
    let error = unsafe { Renderer::new(&half, RendererOptions::default()) }.err().unwrap();
    assert!(error.to_string().contains("free_memory is null"), "{error}");
}

#[test]
fn a_host_that_encodes_gets_the_same_codes() {
    let folder = tempfile::tempdir().unwrap();
    let (path, camera) = scan(folder.path());
    let mut pictures = Vec::new();
    for format in [COLOR, vk::Format::R8G8B8A8_SRGB] {
        let mut application = Application::new(format);
        let mut renderer = application.renderer();
        renderer.open(std::slice::from_ref(&path), &OpenSettings::default()).unwrap();
        let targets = application.targets();
        pictures.push(application.settle(&mut renderer, targets, &[view_of(camera)]).1);
    }
    assert!(without_alpha(&pictures[0]) == without_alpha(&pictures[1]));
}

/// Formats of more bits, and of another order, have the same colours.
#[test]
fn colours_are_those_of_eight_bits_in_every_format() {
    let folder = tempfile::tempdir().unwrap();
    let (path, camera) = scan(folder.path());
    let draw = |format, encoding| {
        let mut application = Application::new(format);
        let mut renderer = application.renderer();
        renderer.open(std::slice::from_ref(&path), &OpenSettings::default()).unwrap();
        let mut targets = application.targets();
        targets.encoding = encoding;
        application.settle(&mut renderer, targets, &[view_of(camera)]).1
    };
    let eight = draw(COLOR, Encoding::Srgb);
    // Codes 0..=1 of red, green and blue.
    let ten_bits = |texel: &[u8]| {
        let word = u32::from_le_bytes(texel.try_into().unwrap());
        [0, 10, 20].map(|shift| (word >> shift & 1023) as f64 / 1023.0)
    };
    let half = |texel: &[u8]| {
        [0, 2, 4].map(|at| half::f16::from_le_bytes([texel[at], texel[at + 1]]).to_f64())
    };
    let encoded = |texel: &[u8]| half(texel).map(linear_to_srgb);
    let swapped = |texel: &[u8]| [2, 1, 0].map(|at| texel[at] as f64 / 255.0);
    type Codes<'c> = &'c dyn Fn(&[u8]) -> [f64; 3];
    let (srgb, linear) = (Encoding::Srgb, Encoding::Linear);
    // Devices may round a stored value either way (Vulkan 1.3, "Conversion From Floating-Point to
    // Normalized Fixed-Point").
    let cases: [(_, _, Codes, f64); 4] = [
        (vk::Format::B8G8R8A8_UNORM, srgb, &swapped, 0.0),
        (vk::Format::A2B10G10R10_UNORM_PACK32, srgb, &ten_bits, 1.0 / 1023.0),
        (vk::Format::R16G16B16A16_SFLOAT, srgb, &half, 1.0 / 2048.0),
        // The steps of halves, encoded.
        (vk::Format::R16G16B16A16_SFLOAT, linear, &encoded, 1.0 / 2048.0),
    ];
    for (format, encoding, codes, step) in cases {
        let picture = draw(format, encoding);
        let texels = picture.chunks_exact(picture.len() / PIXELS).zip(eight.chunks_exact(4));
        let (mut most, mut opaque) = (0.0f64, 0);
        for (texel, eight) in texels {
            // Eight bits are rounded before and after they are multiplied by the coverage.
            let roundings = if eight[3] == 255 { 0.5 } else { 1.0 };
            if encoding == Encoding::Linear && eight[3] < 255 {
                continue;
            }
            opaque += (eight[3] == 255) as usize;
            let codes = codes(texel);
            let off = [0, 1, 2].map(|c| (codes[c] - eight[c] as f64 / 255.0).abs());
            most = off.into_iter().fold(most, |most, off| most.max(off - roundings / 255.0));
        }
        println!("{format:?} {encoding:?}: {most} beside rounding, of {step}");
        assert!(most <= step && opaque > 10_000, "{format:?} {encoding:?}: {most} {opaque}");
        // Eight bits are not what it was made from.
        let distinct: std::collections::HashSet<&[u8]> =
            picture.chunks_exact(picture.len() / PIXELS).collect();
        let of_eight: std::collections::HashSet<&[u8]> = eight.chunks_exact(4).collect();
        assert!(distinct.len() >= of_eight.len(), "{} {}", distinct.len(), of_eight.len());
    }
}

#[test]
fn host_geometry_and_points_hide_each_other() {
    let folder = tempfile::tempdir().unwrap();
    let (path, camera) = scan(folder.path());
    let mut application = Application::new(COLOR);
    let mut renderer = application.renderer();
    renderer.open(&[path], &OpenSettings::default()).unwrap();
    let (cleared, view) = (application.targets(), View::new(camera, SIZE).unwrap());
    let (_, alone, depth) = application.settle(&mut renderer, cleared, &[view_of(camera)]);
    // A triangle through the scan, of which the host knows its depth in f64.
    let middle = camera.target;
    let corners = [(-1.2, -1.0, -0.7), (1.3, -0.8, 0.2), (0.1, 1.2, 0.9)].map(|(x, y, z)| {
        let basis = view.basis;
        middle + basis.right * x + basis.up * y + basis.forward * z
    });
    let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
    let triangle = |x: usize, y: usize| {
        let (origin, direction) = view.ray(x as f64 + 0.5, y as f64 + 0.5);
        let t = (corners[0] - origin).dot(normal) / direction.dot(normal);
        let hit = origin + direction * t;
        let inside = (0..3).all(|i| {
            let (a, b) = (corners[i], corners[(i + 1) % 3]);
            (b - a).cross(hit - a).dot(normal) >= 0.0
        });
        (inside && t > 0.0).then_some(t)
    };
    let host: Vec<Option<f64>> =
        (0..PIXELS).map(|i| triangle(i % SIZE[0] as usize, i / SIZE[0] as usize)).collect();
    let colors: Vec<[u8; 4]> = host
        .iter()
        .map(|t| if t.is_some() { [200, 10, 20, 255] } else { [1, 2, 3, 255] })
        .collect();
    let depths: Vec<f32> = host.iter().map(|t| t.map_or(0.0, |t| (0.01 / t) as f32)).collect();
    let over = {
        let mut targets = cleared;
        let copied = Access::any(vk::ImageLayout::TRANSFER_DST_OPTIMAL.as_raw());
        targets.color = Target { clear: false, before: copied, ..targets.color };
        targets.depth = targets.depth.map(|depth| Target { clear: false, before: copied, ..depth });
        targets
    };
    let (_, both, both_depth) =
        application.draw(&mut renderer, over, &[view_of(camera)], Some((&colors, &depths)));
    let (mut of_host, mut of_points) = (0, 0);
    for i in 0..PIXELS {
        let (points, triangle) = (depth[i], depths[i]);
        let pixel: [u8; 4] = both[4 * i..][..4].try_into().unwrap();
        if points >= triangle && points > 0.0 {
            assert_eq!(pixel, alone[4 * i..][..4], "points are nearer in pixel {i}");
            of_points += 1;
        } else {
            assert_eq!(pixel, colors[i], "the host is nearer in pixel {i}");
            of_host += host[i].is_some() as u32;
        }
        assert_eq!(both_depth[i], points.max(triangle), "pixel {i}");
    }
    assert!(of_host > 1000 && of_points > 1000, "{of_host} {of_points}");
}

#[test]
fn points_of_memory_are_picked_where_they_are() {
    let mut application = Application::new(COLOR);
    let mut renderer = application.renderer();
    let place = |i: u32| [5e5 + (i % 300) as f64 / 64.0, 4e6 + (i / 300) as f64 / 64.0, 12.5];
    let places: Vec<[f64; 3]> = (0..90_000).map(place).collect();
    let colors: Vec<[u8; 3]> = (0..90_000).map(|i| [(i % 250) as u8, 120, 30]).collect();
    let points = Points { colors: Some(&colors), ..Points::new(Positions::F64(&places)) };
    let cloud = renderer.add_points(&points).unwrap();
    let moved = [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 100.0, 0.0, 0.0, 1.0];
    let targets = application.targets();
    let top = |renderer: &Renderer| view_of(renderer.framing(Preset::Fit, SIZE).unwrap());
    let start = view_of(Camera {
        eye: DVec3::new(5e5, 4e6, 30.0),
        target: DVec3::new(5e5, 4e6, 0.0),
        up: DVec3::Y,
        fov_y: 40.0,
        projection: pointillist::renderer::Projection::Perspective,
        ortho_height: None,
    });
    application.settle(&mut renderer, targets, &[start]);
    let unmoved = top(&renderer);
    let (_, before, _) = application.draw(&mut renderer, targets, &[unmoved], None);
    let pick = renderer.pick([160, 120]);
    let nothing = renderer.pick([0, 0]);
    assert_eq!(renderer.picked(pick), Picked::Pending);
    application.draw(&mut renderer, targets, &[unmoved], None);
    application.draw(&mut renderer, targets, &[unmoved], None);
    let Picked::Point(point) = renderer.picked(pick) else { panic!("a point in the middle") };
    assert!(point.exact && point.cloud == cloud);
    assert!(places.contains(&point.position.to_array()), "{point:?}");
    assert!(point.id.is_some() && point.class == Some(0), "{point:?}");
    let own = places.iter().position(|place| *place == point.position.to_array()).unwrap();
    assert!(point.color == Some(colors[own]) && point.value.is_none(), "{point:?}");
    let (report, ..) = application.draw(&mut renderer, targets, &[unmoved], None);
    let told = renderer.explain(&report);
    for line in ["frame: settled, 90000 points", "cloud 1: ready", "effect fill: ", "pass "] {
        assert!(told.contains(line), "{line}: {told}");
    }
    assert_eq!(renderer.picked(nothing), Picked::Nothing);
    // Moved with the camera, nothing changes on the screen.
    renderer.set_transform(cloud, &moved).unwrap();
    let moved = top(&renderer);
    let (_, after, _) = application.settle(&mut renderer, targets, &[moved]);
    let differing = before.iter().zip(&after).filter(|(a, b)| a != b).count();
    assert!(differing < before.len() / 200, "{differing} bytes");
    renderer.set("style", "strokes").unwrap();
    let (report, ..) = application.draw(&mut renderer, targets, &[moved], None);
    assert!(report.errors[0].contains("drawn as points") && report.points > 0);
    let refused = renderer.set("effect", "edl=perhaps").unwrap_err().to_string();
    assert!(refused.contains("perhaps"), "{refused}");
    renderer.set_visible(cloud, false).unwrap();
    let (_, empty, _) = application.draw(&mut renderer, targets, &[unmoved], None);
    let background = RenderSettings::default().background;
    assert!(empty.chunks(4).all(|pixel| pixel[..3] == background));
    renderer.remove(cloud).unwrap();
    assert!(renderer.state(cloud).is_err());
}

/// Points in a buffer of the device are those of memory.
#[test]
fn points_of_a_buffer_are_drawn_like_those_of_memory() {
    let mut application = Application::new(COLOR);
    let place = |i: u32| [(i % 300) as f32 / 64.0, (i / 300) as f32 / 64.0, (i % 7) as f32 / 8.0];
    let places: Vec<[f32; 3]> = (0..90_000).map(place).collect();
    let colors: Vec<[u8; 3]> = (0..90_000).map(|i| [(i % 250) as u8, 120, 30]).collect();
    let mut bytes = Vec::new();
    for (place, color) in places.iter().zip(&colors) {
        bytes.extend(place.iter().flat_map(|axis| axis.to_le_bytes()));
        bytes.extend(color.iter().chain(&[0; 5]));
    }
    assert!(bytes.len() < POINT_BYTES);
    let offset = 48 * PIXELS;
    // SAFETY: the buffer has room there, and no frame is in flight.
    unsafe {
        let to = application.mapped.add(offset);
        std::ptr::copy_nonoverlapping(bytes.as_ptr(), to, bytes.len());
    }
    let buffer = PointBuffer {
        buffer: application.staging.as_raw(),
        offset: offset as u64,
        stride: 20,
        count: 90_000,
        color_offset: Some(12),
    };
    let targets = application.targets();
    let camera = Camera {
        eye: DVec3::new(2.0, 2.0, 9.0),
        target: DVec3::new(2.0, 2.0, 0.0),
        up: DVec3::Y,
        fov_y: 40.0,
        projection: pointillist::renderer::Projection::Perspective,
        ortho_height: None,
    };
    let mut renderer = application.renderer();
    let points = Points { colors: Some(&colors), ..Points::new(Positions::F32(&places)) };
    let cloud = renderer.add_points(&points).unwrap();
    let (_, of_memory, _) = application.settle(&mut renderer, targets, &[view_of(camera)]);
    renderer.remove(cloud).unwrap();
    // SAFETY: the buffer lives as long as the application.
    let cloud = unsafe { renderer.add_buffer(buffer) }.unwrap();
    assert!(matches!(renderer.state(cloud).unwrap(), CloudState::Loading { .. }));
    let (report, of_buffer, _) = application.settle(&mut renderer, targets, &[view_of(camera)]);
    assert!(report.points > 0 && of_buffer == of_memory);
    // SAFETY: refused before anything is read.
    let refused = unsafe { renderer.add_buffer(PointBuffer { stride: 8, ..buffer }) };
    assert!(refused.unwrap_err().to_string().contains("stride of at least 15 bytes"));
}

/// A renderer moves to the host's render thread.
#[test]
fn a_renderer_is_sent_between_threads() {
    fn is_send<T: Send>() {}
    is_send::<Renderer>();
}

#[test]
fn a_settled_frame_is_recorded_in_no_time_and_makes_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let (path, camera) = scan(folder.path());
    let mut application = Application::new(COLOR);
    let mut renderer = application.renderer();
    renderer.open(&[path], &OpenSettings::default()).unwrap();
    let targets = Targets { ids: None, normals: None, ..application.targets() };
    let views = [view_of(camera)];
    let (_, first, _) = application.settle(&mut renderer, targets, &views);
    let made = objects().made;
    let mut times = Vec::with_capacity(50);
    let mut heap = Vec::with_capacity(50);
    for _ in 0..50 {
        let (_, color, _) = application.draw(&mut renderer, targets, &views, None);
        assert!(color == first);
        times.push(application.recorded.as_secs_f64() * 1e3);
        drop(color);
        heap.push(heap_bytes());
    }
    assert_eq!(objects().made, made, "Vulkan objects were made");
    // Queues of frames may grow at first.
    assert_eq!(heap[49], heap[10], "{heap:?}");
    times.sort_by(f64::total_cmp);
    println!("recorded in {:.3} ms (median), {:.3} ms (worst)", times[25], times[49]);
    assert!(times[25] < 0.3, "{times:?}");
}

#[test]
fn clouds_hide_each_other_with_and_without_depth_of_the_host() {
    let mut application = Application::new(COLOR);
    let mut renderer = application.renderer();
    // Two crossing planes.
    let plane = |slope: f64| -> Vec<[f64; 3]> {
        let place = |i: u32| {
            let [x, y] = [i % 400, i / 400].map(|k| k as f64 / 200.0 - 1.0);
            [x, y, slope * x]
        };
        (0..160_000).map(place).collect()
    };
    let colors = [[250, 20, 20], [20, 20, 250]].map(|color: [u8; 3]| vec![color; 160_000]);
    for (slope, colors) in [0.5, -0.5].into_iter().zip(&colors) {
        let places = plane(slope);
        let points = Points { colors: Some(colors), ..Points::new(Positions::F64(&places)) };
        renderer.add_points(&points).unwrap();
    }
    let mut settings = RenderSettings::points();
    settings.effects.set("fill=on").unwrap();
    renderer.set_settings(settings);
    let camera = Camera {
        eye: DVec3::new(0.0, 0.0, 3.0),
        target: DVec3::ZERO,
        up: DVec3::Y,
        fov_y: 30.0,
        projection: pointillist::renderer::Projection::Perspective,
        ortho_height: None,
    };
    let with = application.targets();
    let without = Targets { depth: None, ..with };
    for targets in [with, without] {
        let (report, color, _) = application.settle(&mut renderer, targets, &[view_of(camera)]);
        assert!(report.points > 0);
        let pixel = |x: usize| &color[4 * (120 * SIZE[0] as usize + x)..][..3];
        // The red plane is higher on the right, the blue one on the left.
        assert!(pixel(230)[0] > 100 && pixel(230)[2] < 50, "{:?}", pixel(230));
        assert!(pixel(90)[2] > 100 && pixel(90)[0] < 50, "{:?}", pixel(90));
    }
}

#[test]
fn frames_of_random_calls_leave_the_picture_of_a_fresh_start() {
    let folder = tempfile::tempdir().unwrap();
    let (path, camera) = scan(folder.path());
    let index = indexed(&[&path], "");
    let mut application = Application::new(COLOR);
    let targets = application.targets();
    let mut fresh = application.renderer();
    fresh.open(std::slice::from_ref(&index), &OpenSettings::default()).unwrap();
    let (_, expected, _) = application.settle(&mut fresh, targets, &[view_of(camera)]);
    drop(fresh);
    application.frame = 0;
    let mut renderer = application.renderer();
    let mut random = 1u64;
    let mut next = |below: u64| {
        random ^= random << 13;
        random ^= random >> 7;
        random ^= random << 17;
        random % below
    };
    let mut clouds = Vec::new();
    let place = [[0.0f32; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.3]];
    let mut growth = Vec::new();
    for frame in 0..1000 {
        match next(8) {
            0 if clouds.len() < 4 => {
                clouds.push(
                    renderer.open(std::slice::from_ref(&index), &OpenSettings::default()).unwrap(),
                );
            }
            1 if clouds.len() < 4 => {
                let points = Points::new(Positions::F32(&place));
                clouds.push(renderer.add_points(&points).unwrap());
            }
            2 if !clouds.is_empty() => {
                let cloud = clouds.swap_remove(next(clouds.len() as u64) as usize);
                renderer.remove(cloud).unwrap();
            }
            3 if !clouds.is_empty() => {
                let cloud = clouds[next(clouds.len() as u64) as usize];
                renderer.set_visible(cloud, next(2) == 0).unwrap();
            }
            4 => drop(renderer.pick([next(320) as u32, next(240) as u32])),
            5 => {
                let effect = ["edl=on", "edl=off", "fill=on", "ao=on"][next(4) as usize];
                renderer.set("effect", effect).unwrap();
            }
            _ => {}
        }
        let size = [48 + 16 * next(6) as u32, 48 + 16 * next(6) as u32];
        let area = Area { corner: [next(100) as i32, next(80) as i32], size };
        let mut moved = camera;
        moved.eye += DVec3::splat(next(10) as f64 / 10.0);
        let size = SIZE.map(|side| side / 2);
        let whole = FrameView { area: Area { corner: [0, 0], size }, ..view_of(camera) };
        let views = [FrameView { area, ..view_of(moved) }, whole];
        let (report, ..) =
            application.draw(&mut renderer, targets, &views[..1 + next(2) as usize], None);
        assert_eq!(report.errors, Vec::<String>::new(), "frame {frame}");
        growth.push(objects().alive);
    }
    // As many are alive at the most in the last quarter as in the second.
    let most = |frames: std::ops::Range<usize>| *growth[frames].iter().max().unwrap();
    println!("objects alive: {} at most, then {}", most(250..500), most(750..1000));
    assert!(most(750..1000) <= most(250..500) * 11 / 10, "{growth:?}");
    clouds.into_iter().for_each(|cloud| renderer.remove(cloud).unwrap());
    renderer.set_settings(RenderSettings::default());
    renderer.open(&[index], &OpenSettings::default()).unwrap();
    let (_, settled, _) = application.settle(&mut renderer, targets, &[view_of(camera)]);
    assert!(settled == expected);
    drop(renderer);
    assert_eq!(objects().alive, 0, "objects outlive the renderer");
    let allocations = allocations();
    assert!(allocations.alive == 0 && allocations.made > 0, "{allocations:?}");
}

#[test]
fn two_views_of_matrices_share_a_target() {
    let folder = tempfile::tempdir().unwrap();
    let (path, camera) = scan(folder.path());
    let mut application = Application::new(COLOR);
    let mut renderer = application.renderer();
    renderer.open(&[path], &OpenSettings::default()).unwrap();
    let half = [SIZE[0] / 2, SIZE[1]];
    let views = [0, 1].map(|side| FrameView {
        camera: ViewCamera::Matrices(Matrices::of(&camera, half, 0.1, f64::INFINITY).unwrap()),
        area: Area { corner: [side * half[0] as i32, 0], size: half },
    });
    let targets = application.targets();
    let (_, color, _) = application.settle(&mut renderer, targets, &views);
    let row = |y: usize, side: usize| {
        &color[4 * (y * SIZE[0] as usize + side * half[0] as usize)..][..4 * half[0] as usize]
    };
    assert!((0..SIZE[1] as usize).all(|y| row(y, 0) == row(y, 1)));
    assert!(row(120, 0).chunks(4).any(|pixel| pixel != &row(0, 0)[..4]));
}

#[test]
fn what_cannot_be_recorded_is_an_error_and_nothing_else() {
    let mut application = Application::new(COLOR);
    let mut renderer = application.renderer();
    let targets = application.targets();
    let camera = Camera {
        eye: DVec3::ZERO,
        target: DVec3::Y,
        up: DVec3::Z,
        fov_y: 40.0,
        projection: pointillist::renderer::Projection::Perspective,
        ortho_height: None,
    };
    let (report, color, _) = application.draw(&mut renderer, targets, &[view_of(camera)], None);
    assert!(report.settled && color.chunks(4).all(|pixel| pixel == &color[..4]));
    let wrong = |renderer: &mut Renderer, targets: Targets, number, safe| {
        let frame = Frame { number, safe, targets, views: &[] };
        // SAFETY: refused before anything is recorded.
        unsafe { renderer.record(0, &frame) }.unwrap_err().to_string()
    };
    assert!(wrong(&mut renderer, targets, 1, 0).contains("numbers must grow"));
    assert!(wrong(&mut renderer, targets, 5, 5).contains("numbers must grow"));
    let mut many = targets;
    many.depth.iter_mut().for_each(|depth| depth.samples = 4);
    assert!(wrong(&mut renderer, many, 5, 1).contains("4 samples per pixel; resolve"));
    let beyond = Area { corner: [1, 0], size: SIZE };
    let views = [FrameView { area: beyond, ..view_of(camera) }];
    let frame = Frame { number: 5, safe: 1, targets, views: &views };
    // SAFETY: refused before anything is recorded.
    let refused = unsafe { renderer.record(0, &frame) }.unwrap_err().to_string();
    assert!(refused.contains("not within the targets"), "{refused}");
    let swapped = Targets { color: targets.depth.unwrap(), ..targets };
    assert!(wrong(&mut renderer, swapped, 5, 1).contains("D32_SFLOAT"));
    let missing = renderer.open(&["/no/such.las".into()], &OpenSettings::default()).unwrap();
    while matches!(renderer.state(missing).unwrap(), CloudState::Loading { .. }) {
        application.draw(&mut renderer, targets, &[view_of(camera)], None);
    }
    let CloudState::Failed(why) = renderer.state(missing).unwrap() else { panic!() };
    assert!(why.contains("/no/such.las"), "{why}");
}

/// Pages go through a ring of mapped memory, whose copies are recorded with the host's frames. The
/// file has more points than the ring holds.
#[test]
fn a_device_whose_memory_is_not_mapped_draws_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("torus.las");
    crate::files::scan(&path, pointillist::synth::SceneKind::Torus, 7_000_000);
    let index = crate::index_file::indexed(&[&path], "");
    let (_, camera) = scan(folder.path());
    for file in [path, index] {
        let pictures = [false, true].map(|unmapped| {
            let mut application = Application::new(COLOR);
            let overrides = TestOverrides { unmapped, ..TestOverrides::default() };
            let options = RendererOptions { overrides, ..RendererOptions::default() };
            // SAFETY: the renderer is dropped before the application.
            let mut renderer = unsafe { Renderer::new(&application.host(), options) }.unwrap();
            renderer.open(std::slice::from_ref(&file), &OpenSettings::default()).unwrap();
            let targets = application.targets();
            application.settle(&mut renderer, targets, &[view_of(camera)]).1
        });
        assert!(pictures[0] == pictures[1], "{}", file.display());
    }
}

/// What the host says about its images is what is recorded: a lie is found.
#[test]
fn a_host_that_lies_about_a_layout_is_caught() {
    let mut application = Application::new(COLOR);
    let mut renderer = application.renderer();
    let honest = application.targets();
    application.draw(&mut renderer, honest, &[], None);
    let mut lying = honest;
    lying.color.before = Access::any(vk::ImageLayout::SHADER_READ_ONLY_OPTIMAL.as_raw());
    lying.color.clear = false;
    application.submit(&mut renderer, lying, &[], None);
    let said = std::mem::replace(&mut application.said, Ok(())).unwrap_err().to_string();
    assert!(said.contains("SHADER_READ_ONLY_OPTIMAL"), "{said}");
}
