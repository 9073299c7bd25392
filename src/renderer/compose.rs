//! Draws a finished picture into the host's images: a triangle for colour and depth, and one for
//! ids and normals, with a depth test against what the host has drawn.

use super::host::{Access, Encoding, Target};
use super::projection::Depth;
use crate::config::NO_POINT;
use crate::error::{Error, Result};
use crate::gpu::kernel::{Code, descriptor_type};
use crate::gpu::memory::{RawBuffer, RawImage};
use crate::gpu::raster::{self, Primitives};
use crate::gpu::{BufferDesc, Device, LogicalDevice, Place, failed};
use crate::graph::{Gpu, Raster};
use crate::passes::encode::Thresholds;
use crate::shader::{self, compose, compose_layers};
use ash::vk::{self, Handle};
use glam::DVec3;

/// An area of a target `[px]`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Area {
    /// Top left pixel.
    pub corner: [i32; 2],
    /// Width and height.
    pub size: [u32; 2],
}

impl Area {
    /// Errors if nothing can be drawn there.
    pub(super) fn check(&self, targets: &Targets) -> Result<()> {
        let Area { corner: [x, y], size: [width, height] } = *self;
        let fits = |target: &Target| {
            let within = |at: i32, length: u32, whole: u32| {
                at >= 0 && length > 0 && at as u64 + length as u64 <= whole as u64
            };
            within(x, width, target.size[0]) && within(y, height, target.size[1])
        };
        if targets.all().all(|(_, target, _)| fits(target)) {
            return Ok(());
        }
        Err(Error::Request(format!(
            "an area of {width} x {height} pixels at {x}, {y} is not within the targets"
        )))
    }

    fn rect(&self) -> vk::Rect2D {
        let [x, y] = self.corner;
        let [width, height] = self.size;
        vk::Rect2D { offset: vk::Offset2D { x, y }, extent: vk::Extent2D { width, height } }
    }
}

/// The targets of a frame.
#[derive(Clone, Copy, Debug)]
pub struct Targets {
    /// Colour.
    pub color: Target,
    /// How colours are stored.
    pub encoding: Encoding,
    /// Depth that points are hidden by, and that they are written to.
    pub depth: Option<Target>,
    /// True if points' depth is written.
    pub writes_depth: bool,
    /// True if the depth image has the usages of a source and a destination of transfers. Then the
    /// host's geometry hides each layer of translucent points by itself, and several clouds hide
    /// each other even if their depth is not written. Without, the report names what is wrong.
    pub copies_depth: bool,
    /// Ids of the points that are seen, `R32_UINT`, or `R32G32_UINT` with the id of the cloud as
    /// the second; the first is [`NO_POINT`] where nothing is, or no single point. Ids are those of
    /// one frame.
    pub ids: Option<Target>,
    /// Normals of the visible surface in the host's world, of a float or signed normalised format
    /// with four channels; 0 where nothing is.
    pub normals: Option<Target>,
}

impl Targets {
    /// Returns targets of an image with encoded colours alone.
    pub fn of(color: Target) -> Targets {
        let (encoding, depth) = (Encoding::Srgb, None);
        let (ids, normals) = (None, None);
        Targets { color, encoding, depth, writes_depth: true, copies_depth: false, ids, normals }
    }

    /// Returns the area that all targets have.
    pub(super) fn whole(&self) -> Area {
        let sizes = self.all().map(|(_, target, _)| target.size);
        let size = sizes.fold(self.color.size, |a, b| [0, 1].map(|axis| a[axis].min(b[axis])));
        Area { corner: [0, 0], size }
    }

    /// Returns all targets with their names and their layouts while they are drawn into.
    fn all(&self) -> impl Iterator<Item = (&'static str, &Target, vk::ImageLayout)> {
        use vk::ImageLayout as Layout;
        let color = Layout::COLOR_ATTACHMENT_OPTIMAL;
        let depth = Layout::DEPTH_STENCIL_ATTACHMENT_OPTIMAL;
        let named = |name, layout| move |target| (name, target, layout);
        let depth = self.depth.as_ref().map(named("depth", depth));
        let ids = self.ids.as_ref().map(named("ids", color));
        let normals = self.normals.as_ref().map(named("normals", color));
        [Some(("color", &self.color, color)), depth, ids, normals].into_iter().flatten()
    }

    /// Errors if one of them cannot be drawn into.
    pub(super) fn check(&self) -> Result<()> {
        self.all().try_for_each(|(name, target, _)| target.check(name, name == "depth"))?;
        if self.depth.is_some_and(|depth| depth.clear && !self.writes_depth) {
            return Err(Error::Request(
                "the depth target is cleared and not written; leave it out".into(),
            ));
        }
        let wrong = |name: &str, target: &Target, drawn: &str| {
            let format = target.vulkan_format();
            Err(Error::Request(format!(
                "the {name} target has the format {format:?}; {drawn} are drawn into"
            )))
        };
        use vk::Format as F;
        match (&self.ids, &self.normals) {
            (Some(ids), _) if !matches!(ids.vulkan_format(), F::R32_UINT | F::R32G32_UINT) => {
                wrong("ids", ids, "R32_UINT and R32G32_UINT")
            }
            (_, Some(normals))
                if !matches!(
                    normals.vulkan_format(),
                    F::R16G16B16A16_SFLOAT
                        | F::R32G32B32A32_SFLOAT
                        | F::R8G8B8A8_SNORM
                        | F::R16G16B16A16_SNORM
                ) =>
            {
                wrong("normals", normals, "four channels of float or signed normalised formats")
            }
            _ => encoding(&self.color, self.encoding).map(drop),
        }
    }

    /// Tests whether ids or normals are drawn.
    pub(super) fn has_layers(&self) -> bool {
        self.ids.is_some() || self.normals.is_some()
    }
}

/// Values of the shader's `ENCODING`.
fn encoding(target: &Target, encoding: Encoding) -> Result<u32> {
    let format = target.vulkan_format();
    let encodes = matches!(
        format,
        vk::Format::R8G8B8A8_SRGB | vk::Format::B8G8R8A8_SRGB | vk::Format::A8B8G8R8_SRGB_PACK32
    );
    let has_8_bits = matches!(
        format,
        vk::Format::R8G8B8A8_UNORM | vk::Format::B8G8R8A8_UNORM | vk::Format::A8B8G8R8_UNORM_PACK32
    );
    let is_wide = matches!(
        format,
        vk::Format::A2B10G10R10_UNORM_PACK32
            | vk::Format::A2R10G10B10_UNORM_PACK32
            | vk::Format::R16G16B16A16_SFLOAT
            | vk::Format::R16G16B16A16_UNORM
            | vk::Format::R32G32B32A32_SFLOAT
            | vk::Format::B10G11R11_UFLOAT_PACK32
    );
    match (encoding, encodes, has_8_bits, is_wide) {
        (Encoding::Linear, false, true, _) | (Encoding::Linear, _, _, true) => Ok(0),
        (Encoding::Srgb, _, true, _) => Ok(1),
        (_, true, ..) => Ok(2),
        (Encoding::Srgb, _, _, true) => Ok(3),
        _ => Err(Error::Request(format!(
            "the color target has the format {format:?}; 8-bit UNORM and SRGB, 10-bit UNORM, and 16-bit and 32-bit formats of four channels are drawn into"
        ))),
    }
}

/// How linear colours become codes.
pub(super) struct ColorTable {
    thresholds: Thresholds,
    /// The same for shaders.
    buckets: RawBuffer,
}

/// Where a picture goes.
pub(super) struct Placement<'p> {
    pub table: &'p ColorTable,
    pub area: Area,
    pub targets: &'p Targets,
    /// True if the area is cleared, as far as targets ask for it.
    pub first: bool,
    /// Background of a cleared area, linear.
    pub background: [f32; 3],
}

/// Descriptors of a picture.
pub(super) struct Descriptors {
    device: LogicalDevice,
    pool: vk::DescriptorPool,
    layout: vk::DescriptorSetLayout,
    set: vk::DescriptorSet,
}

impl Drop for Descriptors {
    fn drop(&mut self) {
        // SAFETY: the device has completed the frames that show the picture.
        unsafe {
            self.device.destroy(self.pool);
            self.device.destroy(self.layout);
        }
    }
}

impl ColorTable {
    pub fn new(gpu: &mut Gpu) -> Result<ColorTable> {
        let thresholds = Thresholds::new();
        let table = thresholds.buckets();
        let bytes: &[u8] = bytemuck::cast_slice(&table);
        let desc = BufferDesc { bytes: bytes.len() as u64, place: Place::Upload };
        let mut buckets = gpu.memory.buffer(&gpu.device, desc, "buckets")?;
        buckets.bytes_mut()[..bytes.len()].copy_from_slice(bytes);
        Ok(ColorTable { thresholds, buckets })
    }

    /// Returns the value to clear with, in the encoding of the shader.
    fn cleared(&self, linear: f32, code: u32) -> f32 {
        let encoded = || self.thresholds.encode(linear);
        match code {
            0 => linear,
            1 | 3 => encoded() as f32 / 255.0,
            _ => crate::cloud::colormap::srgb_to_linear(encoded() as f64 / 255.0) as f32,
        }
    }
}

/// Records transitions of the targets, to drawing or back to the host.
pub(super) fn transition(
    device: &Device,
    commands: vk::CommandBuffer,
    targets: &Targets,
    ends: bool,
) {
    let images: Vec<_> = targets
        .all()
        .map(|(_, target, layout)| target.barrier(device.family, layout, ends))
        .collect();
    // SAFETY: recorded outside of rendering; the host ensures that the images are alive.
    unsafe {
        device.raw.cmd_pipeline_barrier2(
            commands,
            &vk::DependencyInfo::default().image_memory_barriers(&images),
        )
    };
}

/// Returns a buffer for the depths of an area, row by row.
fn room_for_depth(gpu: &mut Gpu, depth: &Target, area: Area) -> Result<RawBuffer> {
    let [width, height] = area.size.map(u64::from);
    let bytes = width * height * if depth.depth_bits() == 16 { 2 } else { 4 };
    let desc = BufferDesc { bytes: bytes.next_multiple_of(4), place: Place::Device };
    gpu.memory.buffer(&gpu.device, desc, "host depth")
}

/// Records a copy of the depths in an area, which is in its attachment layout, for compute passes
/// and [`restore_depth`].
pub(super) fn copy_depth(
    gpu: &mut Gpu,
    commands: vk::CommandBuffer,
    depth: &Target,
    area: Area,
) -> Result<RawBuffer> {
    let copy = room_for_depth(gpu, depth, area)?;
    let raw = &gpu.device.raw;
    let (image, layout) = (vk::Image::from_raw(depth.image), vk::ImageLayout::TRANSFER_SRC_OPTIMAL);
    between_attachments(&gpu.device, commands, depth, layout, |region| {
        // SAFETY: the host ensures that its image is alive; the copy is held with the frame.
        unsafe { raw.cmd_copy_image_to_buffer(commands, image, layout, copy.raw, &[region(area)]) }
    });
    Ok(copy)
}

/// Records that depths in an area are again as they were when they were copied.
pub(super) fn restore_depth(
    device: &Device,
    commands: vk::CommandBuffer,
    depth: &Target,
    area: Area,
    copy: &RawBuffer,
) {
    let raw = &device.raw;
    let (image, layout) = (vk::Image::from_raw(depth.image), vk::ImageLayout::TRANSFER_DST_OPTIMAL);
    between_attachments(device, commands, depth, layout, |region| {
        // SAFETY: as above.
        unsafe { raw.cmd_copy_buffer_to_image(commands, copy.raw, image, layout, &[region(area)]) }
    });
}

/// Records a transfer of a depth image, which is in its attachment layout before and after, with
/// what returns the region of an area.
fn between_attachments(
    device: &Device,
    commands: vk::CommandBuffer,
    depth: &Target,
    layout: vk::ImageLayout,
    transfer: impl FnOnce(&dyn Fn(Area) -> vk::BufferImageCopy),
) {
    let attached = Target {
        after: Access::any(layout.as_raw()),
        before: Access::any(layout.as_raw()),
        ..*depth
    };
    let barrier = |ends| {
        let attachment = vk::ImageLayout::DEPTH_STENCIL_ATTACHMENT_OPTIMAL;
        let images = [attached.barrier(device.family, attachment, ends)];
        let all = [vk::MemoryBarrier2::default()
            .src_stage_mask(vk::PipelineStageFlags2::ALL_COMMANDS)
            .src_access_mask(vk::AccessFlags2::MEMORY_WRITE)
            .dst_stage_mask(vk::PipelineStageFlags2::ALL_COMMANDS)
            .dst_access_mask(vk::AccessFlags2::MEMORY_READ | vk::AccessFlags2::MEMORY_WRITE)];
        let wait =
            vk::DependencyInfo::default().image_memory_barriers(&images).memory_barriers(&all);
        // SAFETY: recorded outside of rendering; the host ensures that the image is alive.
        unsafe { device.raw.cmd_pipeline_barrier2(commands, &wait) };
    };
    barrier(true);
    transfer(&|area: Area| vk::BufferImageCopy {
        image_subresource: vk::ImageSubresourceLayers {
            aspect_mask: vk::ImageAspectFlags::DEPTH,
            layer_count: 1,
            ..Default::default()
        },
        image_offset: vk::Offset3D { x: area.corner[0], y: area.corner[1], z: 0 },
        image_extent: vk::Extent3D { width: area.size[0], height: area.size[1], depth: 1 },
        ..Default::default()
    });
    barrier(false);
}

/// Clears an area in which nothing is drawn.
pub(super) fn clear(
    gpu: &Gpu,
    commands: vk::CommandBuffer,
    place: &Placement,
    form: Depth,
) -> Result<()> {
    let code = encoding(&place.targets.color, place.targets.encoding)?;
    let layers = place.targets.has_layers().then(|| layers_of(place.targets));
    let all = [layers, Some(colors_of(place, code))];
    for (order, colors) in all.into_iter().flatten().enumerate() {
        begin(&gpu.device, commands, place, &colors, order == 0, form);
        // SAFETY: ends the rendering begun above.
        unsafe { gpu.device.raw.cmd_end_rendering(commands) };
    }
    Ok(())
}

/// What is drawn of a cloud's picture.
pub(super) struct Drawn<'d> {
    pub picture: &'d Descriptors,
    /// Descriptors of ids and normals, if the targets have them.
    pub layers: Option<&'d Descriptors>,
    pub form: Depth,
    /// True if the view is distorted.
    pub distorted: bool,
    pub opaque: bool,
    /// Id of the cloud, and the axes of its normals in the host's world.
    pub cloud: (u64, [DVec3; 3]),
}

/// Records the draw of a picture, over what is there unless it is opaque. The targets are in their
/// attachment layouts.
pub(super) fn record(
    gpu: &mut Gpu,
    commands: vk::CommandBuffer,
    place: &Placement,
    drawn: &Drawn,
) -> Result<()> {
    let (targets, corner) = (place.targets, place.area.corner);
    let Drawn { picture, layers, form, distorted, opaque, cloud: (cloud, axes) } = *drawn;
    let code = encoding(&targets.color, targets.encoding)?;
    let depth = targets.depth.map_or(0, |_| if form.perspective { 1 } else { 2 });
    let (line, far) = ([form.a as f32, form.b as f32], form.far());
    if let Some(layers) = layers {
        let [x, y, z] = axes.map(|axis| axis.as_vec3().to_array());
        let cloud = cloud as u32;
        let push = compose_layers::Push { corner, form: line, far, cloud, x, y, z };
        let triangle = Triangle {
            stages: &<shader::ComposeLayers as Raster>::STAGES,
            constants: vec![(1, depth), (2, distorted as u32)],
            push: bytemuck::bytes_of(&push),
            colors: layers_of(targets),
            clears_depth: true,
            writes_depth: false,
            blends: false,
        };
        draw(gpu, commands, place, form, layers, &triangle)?;
    }
    let push = compose::Push { corner, form: line, far };
    let triangle = Triangle {
        stages: &<shader::Compose as Raster>::STAGES,
        constants: vec![(0, code), (1, depth), (2, opaque as u32)],
        push: bytemuck::bytes_of(&push),
        colors: colors_of(place, code),
        clears_depth: layers.is_none(),
        writes_depth: targets.writes_depth,
        blends: !opaque,
    };
    draw(gpu, commands, place, form, picture, &triangle)
}

/// Colour attachments, with the values they are cleared with; null where a target is missing.
type Colors = Vec<(Option<Target>, vk::ClearColorValue)>;

fn colors_of(place: &Placement, code: u32) -> Colors {
    let [r, g, b] = place.background.map(|linear| place.table.cleared(linear, code));
    vec![(Some(place.targets.color), vk::ClearColorValue { float32: [r, g, b, 1.0] })]
}

fn layers_of(targets: &Targets) -> Colors {
    vec![
        (targets.ids, vk::ClearColorValue { uint32: [NO_POINT, 0, 0, 0] }),
        (targets.normals, vk::ClearColorValue { float32: [0.0; 4] }),
    ]
}

/// A triangle that covers an area.
struct Triangle<'t> {
    stages: &'static [Code; 2],
    constants: Vec<(u32, u32)>,
    push: &'t [u8],
    colors: Colors,
    /// True if no draw of the picture came before.
    clears_depth: bool,
    writes_depth: bool,
    blends: bool,
}

fn draw(
    gpu: &mut Gpu,
    commands: vk::CommandBuffer,
    place: &Placement,
    form: Depth,
    descriptors: &Descriptors,
    triangle: &Triangle,
) -> Result<()> {
    let depth = place.targets.depth.as_ref();
    let draw = raster::Draw {
        stages: triangle.stages,
        constants: triangle.constants.clone(),
        push: triangle.push.to_vec(),
        primitives: Primitives::Picture,
        count: 1,
        keeps: true,
    };
    let format =
        |target: &Option<Target>| target.map_or(vk::Format::UNDEFINED, |t| t.vulkan_format());
    let mut colors = [vk::Format::UNDEFINED; 2];
    triangle.colors.iter().zip(&mut colors).for_each(|((target, _), to)| *to = format(target));
    let target = raster::Target {
        colors,
        depth: depth.map_or(vk::Format::UNDEFINED, Target::vulkan_format),
        compare: if form.reversed {
            vk::CompareOp::GREATER_OR_EQUAL
        } else {
            vk::CompareOp::LESS_OR_EQUAL
        },
        writes_depth: depth.is_some() && triangle.writes_depth,
        blends: triangle.blends,
    };
    let pipeline = gpu.raster.get(&gpu.device, &draw, target)?;
    let device = &gpu.device.raw;
    begin(&gpu.device, commands, place, &triangle.colors, triangle.clears_depth, form);
    let rect = place.area.rect();
    let viewport = vk::Viewport {
        x: rect.offset.x as f32,
        y: rect.offset.y as f32,
        width: rect.extent.width as f32,
        height: rect.extent.height as f32,
        min_depth: 0.0,
        max_depth: 1.0,
    };
    let bind = vk::PipelineBindPoint::GRAPHICS;
    // SAFETY: the pipeline was made for these attachments; the set's layout equals its own.
    unsafe {
        device.cmd_bind_pipeline(commands, bind, pipeline.pipeline);
        device.cmd_bind_descriptor_sets(
            commands,
            bind,
            pipeline.layout,
            1,
            &[descriptors.set],
            &[],
        );
        let fragment = vk::ShaderStageFlags::FRAGMENT;
        device.cmd_push_constants(commands, pipeline.layout, fragment, 0, triangle.push);
        device.cmd_set_viewport(commands, 0, &[viewport]);
        device.cmd_set_scissor(commands, 0, &[rect]);
        device.cmd_draw(commands, 3, 1, 0, 0);
        device.cmd_end_rendering(commands);
    }
    Ok(())
}

/// Begins rendering into colour targets and depth. If the picture is the first of its area, clears
/// what they ask for; depth only if `clears_depth`.
fn begin(
    device: &Device,
    commands: vk::CommandBuffer,
    place: &Placement,
    colors: &Colors,
    clears_depth: bool,
    form: Depth,
) {
    let load = |target: &Target, clears: bool| match place.first && target.clear && clears {
        true => vk::AttachmentLoadOp::CLEAR,
        false => vk::AttachmentLoadOp::LOAD,
    };
    let attachment = |target: &Target, layout, clears| {
        vk::RenderingAttachmentInfo::default()
            .image_view(vk::ImageView::from_raw(target.view))
            .image_layout(layout)
            .load_op(load(target, clears))
            .store_op(vk::AttachmentStoreOp::STORE)
    };
    let color = |(target, color): &(Option<Target>, vk::ClearColorValue)| {
        target.as_ref().map_or_else(vk::RenderingAttachmentInfo::default, |target| {
            attachment(target, vk::ImageLayout::COLOR_ATTACHMENT_OPTIMAL, true)
                .clear_value(vk::ClearValue { color: *color })
        })
    };
    // As many as the pipeline has.
    let count = colors.iter().rposition(|(target, _)| target.is_some()).map_or(0, |last| last + 1);
    let colors: Vec<_> = colors[..count].iter().map(color).collect();
    let depth = place.targets.depth.as_ref().map(|target| {
        let layout = vk::ImageLayout::DEPTH_STENCIL_ATTACHMENT_OPTIMAL;
        attachment(target, layout, clears_depth).clear_value(vk::ClearValue {
            depth_stencil: vk::ClearDepthStencilValue { depth: form.far(), stencil: 0 },
        })
    });
    let mut rendering = vk::RenderingInfo::default()
        .render_area(place.area.rect())
        .layer_count(1)
        .color_attachments(&colors);
    if let Some(depth) = &depth {
        rendering = rendering.depth_attachment(depth);
    }
    // SAFETY: the host ensures that the images are alive; their layouts were set by `transition`.
    unsafe { device.raw.cmd_begin_rendering(commands, &rendering) };
}

/// What a binding of a fragment stage reads.
pub(super) enum Bound<'b> {
    Image(RawImage),
    Table(&'b RawBuffer),
}

/// Makes the descriptors of a picture's colours.
pub(super) fn of_colors(
    gpu: &Gpu,
    table: &ColorTable,
    [picture, depth]: [RawImage; 2],
) -> Result<Descriptors> {
    descriptors(gpu, &<shader::Compose as Raster>::STAGES[1], |name| match name {
        "picture" => Bound::Image(picture),
        "depth" => Bound::Image(depth),
        _ => Bound::Table(&table.buckets),
    })
}

/// Makes the descriptors of a picture's ids and normals.
pub(super) fn of_layers(gpu: &Gpu, [index, normal, depth]: [RawImage; 3]) -> Result<Descriptors> {
    descriptors(gpu, &<shader::ComposeLayers as Raster>::STAGES[1], |name| {
        Bound::Image(match name {
            "index" => index,
            "normal" => normal,
            _ => depth,
        })
    })
}

/// Makes the descriptors of a fragment stage, whose bindings are found by their names.
fn descriptors<'b>(
    gpu: &Gpu,
    code: &Code,
    bound: impl Fn(&str) -> Bound<'b>,
) -> Result<Descriptors> {
    let device = &gpu.device.raw;
    let layout = raster::set_layout(device, code, vk::ShaderStageFlags::FRAGMENT)?;
    let size = |ty, descriptor_count| vk::DescriptorPoolSize { ty, descriptor_count };
    let sizes = [
        size(vk::DescriptorType::STORAGE_IMAGE, 3),
        size(vk::DescriptorType::STORAGE_TEXEL_BUFFER, 1),
    ];
    let info = vk::DescriptorPoolCreateInfo::default().max_sets(1).pool_sizes(&sizes);
    // SAFETY: a plain creation on a live device.
    let pool = unsafe { device.make(&info) }?.keep();
    let (layout, set) = (layout.keep(), vk::DescriptorSet::null());
    let mut made = Descriptors { device: device.clone(), pool, layout, set };
    let layouts = [layout];
    let info = vk::DescriptorSetAllocateInfo::default().descriptor_pool(pool).set_layouts(&layouts);
    // SAFETY: the pool has room for this set.
    made.set = unsafe { device.allocate_descriptor_sets(&info) }
        .map_err(failed("vkAllocateDescriptorSets"))?[0];
    for binding in code.bindings {
        let write = vk::WriteDescriptorSet::default()
            .dst_set(made.set)
            .dst_binding(binding.bind)
            .descriptor_type(descriptor_type(binding.kind));
        let (image, table);
        let write = match bound(binding.name) {
            Bound::Image(bound) => {
                image = [vk::DescriptorImageInfo::default()
                    .image_view(bound.view)
                    .image_layout(vk::ImageLayout::GENERAL)];
                write.image_info(&image)
            }
            Bound::Table(bound) => {
                table = [bound.texels.fours];
                write.texel_buffer_view(&table)
            }
        };
        // SAFETY: images and buffer live until the device has completed the frames that show them.
        unsafe { device.update_descriptor_sets(&[write], &[]) };
    }
    Ok(made)
}
