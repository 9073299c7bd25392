//! Draws a finished picture into the host's images: one triangle, with a depth test against what the
//! host has drawn.

use super::host::{Encoding, Target};
use super::projection::Depth;
use crate::error::{Error, Result};
use crate::gpu::kernel::descriptor_type;
use crate::gpu::memory::{RawBuffer, RawImage};
use crate::gpu::raster::{self, Primitives};
use crate::gpu::{BufferDesc, Device, Place, failed};
use crate::graph::{Gpu, Raster};
use crate::passes::encode::Thresholds;
use crate::shader::compose;
use ash::vk::{self, Handle};

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
        if fits(&targets.color) && targets.depth.as_ref().is_none_or(fits) {
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
    /// Whether points' depth is written.
    pub writes_depth: bool,
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

/// Where a picture goes.
pub(super) struct Placement<'p> {
    pub area: Area,
    pub targets: &'p Targets,
    /// Whether the area is cleared, as far as targets ask for it.
    pub first: bool,
    /// Background of a cleared area, linear.
    pub background: [f32; 3],
}

/// Descriptors of a picture.
pub(super) struct Descriptors {
    device: ash::Device,
    pool: vk::DescriptorPool,
    layout: vk::DescriptorSetLayout,
    set: vk::DescriptorSet,
}

impl Drop for Descriptors {
    fn drop(&mut self) {
        // SAFETY: the device has completed the frames that show the picture.
        unsafe {
            self.device.destroy_descriptor_pool(self.pool, None);
            self.device.destroy_descriptor_set_layout(self.layout, None);
        }
    }
}

/// Makes the table that colours are encoded with.
pub(super) fn buckets(gpu: &mut Gpu) -> Result<RawBuffer> {
    let table = Thresholds::new().buckets();
    let bytes: &[u8] = bytemuck::cast_slice(&table);
    let desc = BufferDesc { bytes: bytes.len() as u64, place: Place::Upload };
    let mut buffer = gpu.memory.buffer(&gpu.device, desc, "buckets")?;
    buffer.bytes_mut()[..bytes.len()].copy_from_slice(bytes);
    Ok(buffer)
}

/// Records transitions of the targets, to drawing or back to the host.
pub(super) fn transition(
    device: &Device,
    commands: vk::CommandBuffer,
    targets: &Targets,
    ends: bool,
) {
    use vk::ImageLayout as Layout;
    let color = (&targets.color, Layout::COLOR_ATTACHMENT_OPTIMAL);
    let depth =
        targets.depth.as_ref().map(|target| (target, Layout::DEPTH_STENCIL_ATTACHMENT_OPTIMAL));
    let images: Vec<_> = [Some(color), depth]
        .into_iter()
        .flatten()
        .map(|(target, layout)| target.barrier(device.family, layout, ends))
        .collect();
    // SAFETY: recorded outside of rendering; the host ensures that the images are alive.
    unsafe {
        device.raw.cmd_pipeline_barrier2(
            commands,
            &vk::DependencyInfo::default().image_memory_barriers(&images),
        )
    };
}

/// Clears an area in which nothing is drawn.
pub(super) fn clear(
    gpu: &Gpu,
    commands: vk::CommandBuffer,
    place: &Placement,
    form: Depth,
) -> Result<()> {
    let code = encoding(&place.targets.color, place.targets.encoding)?;
    begin(&gpu.device, commands, place, code, form);
    // SAFETY: ends the rendering begun above.
    unsafe { gpu.device.raw.cmd_end_rendering(commands) };
    Ok(())
}

/// Records the draw of a picture, over what is there unless it is opaque. The targets are in their
/// attachment layouts.
pub(super) fn record(
    gpu: &mut Gpu,
    commands: vk::CommandBuffer,
    place: &Placement,
    descriptors: &Descriptors,
    form: Depth,
    opaque: bool,
) -> Result<()> {
    let (targets, area) = (place.targets, place.area);
    let code = encoding(&targets.color, targets.encoding)?;
    let depth = targets.depth.as_ref();
    let constants = vec![
        (0, code),
        (1, depth.map_or(0, |_| if form.perspective { 1 } else { 2 })),
        (2, opaque as u32),
    ];
    let push = compose::Push {
        corner: area.corner,
        form: [form.a as f32, form.b as f32],
        far: form.far(),
    };
    let draw = raster::Draw {
        stages: &<crate::shader::Compose as Raster>::STAGES,
        constants,
        push: bytemuck::bytes_of(&push).to_vec(),
        primitives: Primitives::Picture,
        count: 1,
        keeps: true,
    };
    let target = raster::Target {
        color: targets.color.vulkan_format(),
        depth: depth.map_or(vk::Format::UNDEFINED, Target::vulkan_format),
        compare: if form.reversed {
            vk::CompareOp::GREATER_OR_EQUAL
        } else {
            vk::CompareOp::LESS_OR_EQUAL
        },
        writes_depth: depth.is_some() && targets.writes_depth,
        blends: !opaque,
    };
    let pipeline = gpu.raster.get(&gpu.device, &draw, target)?;
    let set = descriptors.set;
    let device = &gpu.device.raw;
    begin(&gpu.device, commands, place, code, form);
    let rect = area.rect();
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
        device.cmd_bind_descriptor_sets(commands, bind, pipeline.layout, 1, &[set], &[]);
        let fragment = vk::ShaderStageFlags::FRAGMENT;
        device.cmd_push_constants(commands, pipeline.layout, fragment, 0, &draw.push);
        device.cmd_set_viewport(commands, 0, &[viewport]);
        device.cmd_set_scissor(commands, 0, &[rect]);
        device.cmd_draw(commands, 3, 1, 0, 0);
        device.cmd_end_rendering(commands);
    }
    Ok(())
}

/// Begins rendering into the targets, which clears what they ask for if `first`.
fn begin(device: &Device, commands: vk::CommandBuffer, place: &Placement, code: u32, form: Depth) {
    let Placement { area, targets, first, background } = *place;
    let load = |target: &Target| match first && target.clear {
        true => vk::AttachmentLoadOp::CLEAR,
        false => vk::AttachmentLoadOp::LOAD,
    };
    let attachment = |target: &Target, layout| {
        vk::RenderingAttachmentInfo::default()
            .image_view(vk::ImageView::from_raw(target.view))
            .image_layout(layout)
            .load_op(load(target))
            .store_op(vk::AttachmentStoreOp::STORE)
    };
    let [r, g, b] = background.map(|linear| cleared(linear, code));
    let color = [attachment(&targets.color, vk::ImageLayout::COLOR_ATTACHMENT_OPTIMAL)
        .clear_value(vk::ClearValue { color: vk::ClearColorValue { float32: [r, g, b, 1.0] } })];
    let depth = targets.depth.as_ref().map(|target| {
        attachment(target, vk::ImageLayout::DEPTH_STENCIL_ATTACHMENT_OPTIMAL).clear_value(
            vk::ClearValue {
                depth_stencil: vk::ClearDepthStencilValue { depth: form.far(), stencil: 0 },
            },
        )
    });
    let mut rendering = vk::RenderingInfo::default()
        .render_area(area.rect())
        .layer_count(1)
        .color_attachments(&color);
    if let Some(depth) = &depth {
        rendering = rendering.depth_attachment(depth);
    }
    // SAFETY: the host ensures that the images are alive; their layouts were set by `transition`.
    unsafe { device.raw.cmd_begin_rendering(commands, &rendering) };
}

/// Returns the value to clear with, in the encoding of the shader.
fn cleared(linear: f32, code: u32) -> f32 {
    match code {
        0 => linear,
        1 | 3 => Thresholds::new().encode(linear) as f32 / 255.0,
        _ => {
            let code = Thresholds::new().encode(linear) as f64 / 255.0;
            crate::cloud::colormap::srgb_to_linear(code) as f32
        }
    }
}

/// Makes the descriptors of a picture.
pub(super) fn descriptors(
    gpu: &Gpu,
    buckets: &RawBuffer,
    picture: RawImage,
    depth: RawImage,
) -> Result<Descriptors> {
    let device = &gpu.device.raw;
    let code = &<crate::shader::Compose as Raster>::STAGES[1];
    let layout = raster::set_layout(device, code, vk::ShaderStageFlags::FRAGMENT)?;
    let size = |ty, descriptor_count| vk::DescriptorPoolSize { ty, descriptor_count };
    let sizes = [
        size(vk::DescriptorType::STORAGE_IMAGE, 2),
        size(vk::DescriptorType::STORAGE_TEXEL_BUFFER, 1),
    ];
    let info = vk::DescriptorPoolCreateInfo::default().max_sets(1).pool_sizes(&sizes);
    // SAFETY: a plain creation on a live device.
    let pool = unsafe { device.create_descriptor_pool(&info, None) }
        .map_err(failed("vkCreateDescriptorPool"))?;
    let set = vk::DescriptorSet::null();
    let mut made = Descriptors { device: device.clone(), pool, layout, set };
    let layouts = [layout];
    let info = vk::DescriptorSetAllocateInfo::default().descriptor_pool(pool).set_layouts(&layouts);
    // SAFETY: the pool has room for this set.
    made.set = unsafe { device.allocate_descriptor_sets(&info) }
        .map_err(failed("vkAllocateDescriptorSets"))?[0];
    let image = |image: RawImage| {
        [vk::DescriptorImageInfo::default()
            .image_view(image.view)
            .image_layout(vk::ImageLayout::GENERAL)]
    };
    let (picture, depth, views) = (image(picture), image(depth), [buckets.texels.fours]);
    let writes: Vec<_> = code
        .bindings
        .iter()
        .map(|binding| {
            let write = vk::WriteDescriptorSet::default()
                .dst_set(made.set)
                .dst_binding(binding.bind)
                .descriptor_type(descriptor_type(binding.kind));
            match binding.name {
                "picture" => write.image_info(&picture),
                "depth" => write.image_info(&depth),
                _ => write.texel_buffer_view(&views),
            }
        })
        .collect();
    // SAFETY: images and buffer live until the device has completed the frames that show them.
    unsafe { device.update_descriptor_sets(&writes, &[]) };
    Ok(made)
}
