//! Graphics pipelines that rasterise points, squares and whole pictures with a depth test, into one
//! depth attachment and one or two of colour.
//!
//! Points come from a vertex buffer of f32 x, y, z; the vertex stage generates the others. In draws
//! of a graph, output is one integer target and depth: larger depth wins, and the first among
//! equals; what depth means is up to the shaders. Whole pictures go to a host's images.

use super::kernel::{Code, Constants, descriptor_type};
use super::logical_device::Fresh;
use super::memory::RawImage;
use super::{Device, LogicalDevice};
use crate::error::Result;
use ash::vk;
use std::collections::HashMap;

/// Primitives of a draw.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Primitives {
    /// Points of a vertex buffer.
    Points,
    /// Squares of two triangles each, six consecutive vertices.
    Squares,
    /// A triangle that covers the viewport.
    Picture,
}

/// Formats of the attachments, and how they are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Target {
    /// Undefined where there is none.
    pub colors: [vk::Format; 2],
    /// Undefined if there is no depth attachment.
    pub depth: vk::Format,
    pub compare: vk::CompareOp,
    pub writes_depth: bool,
    /// True if colours, premultiplied by alpha, are blended over what is there.
    pub blends: bool,
}

impl Target {
    /// Returns the formats up to the last one that is defined.
    fn formats(&self) -> &[vk::Format] {
        let defined = self.colors.iter().rposition(|format| *format != vk::Format::UNDEFINED);
        &self.colors[..defined.map_or(0, |last| last + 1)]
    }

    /// Describes the attachments of a draw of a graph.
    pub fn of(color: &RawImage, depth: &RawImage) -> Target {
        Target {
            colors: [color.desc.format, vk::Format::UNDEFINED],
            depth: depth.desc.format,
            compare: vk::CompareOp::GREATER,
            writes_depth: true,
            blends: false,
        }
    }
}

/// A draw without its bindings.
#[derive(Clone, Debug)]
pub struct Draw {
    /// Vertex and fragment stage.
    pub stages: &'static [Code; 2],
    pub constants: Constants,
    pub push: Vec<u8>,
    pub primitives: Primitives,
    pub count: u32,
    /// True if the attachments' contents are kept.
    pub keeps: bool,
}

/// A pipeline and the descriptor set layout of each stage.
pub struct Pipeline {
    pub pipeline: vk::Pipeline,
    pub layout: vk::PipelineLayout,
    pub set_layouts: [vk::DescriptorSetLayout; 2],
}

/// Cache of pipelines by shader, specialisation constants, primitives and target.
pub struct Rasters {
    device: LogicalDevice,
    made: HashMap<(&'static str, Constants, Primitives, Target), Pipeline>,
}

impl Rasters {
    pub fn new(device: &Device) -> Rasters {
        Rasters { device: device.raw.clone(), made: HashMap::new() }
    }

    pub fn get(&mut self, device: &Device, draw: &Draw, target: Target) -> Result<&Pipeline> {
        let key = (draw.stages[0].name, draw.constants.clone(), draw.primitives, target);
        if !self.made.contains_key(&key) {
            let pipeline = make(device, draw, target)?;
            self.made.insert(key.clone(), pipeline);
        }
        Ok(&self.made[&key])
    }
}

impl Drop for Rasters {
    fn drop(&mut self) {
        for made in self.made.values() {
            // SAFETY: every submission has been waited for.
            unsafe {
                self.device.destroy(made.pipeline);
                self.device.destroy(made.layout);
                made.set_layouts.into_iter().for_each(|layout| self.device.destroy(layout));
            }
        }
    }
}

/// Records the draw; pipeline and descriptors must be bound.
pub fn record(
    device: &Device,
    commands: vk::CommandBuffer,
    draw: &Draw,
    vertices: Option<vk::Buffer>,
    color: &RawImage,
    depth: &RawImage,
) {
    let [width, height] = color.desc.size;
    let area = vk::Rect2D { extent: vk::Extent2D { width, height }, ..Default::default() };
    let load = if draw.keeps { vk::AttachmentLoadOp::LOAD } else { vk::AttachmentLoadOp::CLEAR };
    let attachment = |view| {
        let info = vk::RenderingAttachmentInfo::default()
            .image_view(view)
            .image_layout(vk::ImageLayout::GENERAL);
        info.load_op(load).store_op(vk::AttachmentStoreOp::STORE)
    };
    let color = [attachment(color.view)
        .clear_value(vk::ClearValue { color: vk::ClearColorValue { uint32: [u32::MAX; 4] } })];
    let depth = attachment(depth.view).clear_value(vk::ClearValue {
        depth_stencil: vk::ClearDepthStencilValue { depth: 0.0, stencil: 0 },
    });
    let rendering = vk::RenderingInfo::default()
        .render_area(area)
        .layer_count(1)
        .color_attachments(&color)
        .depth_attachment(&depth);
    let viewport = vk::Viewport {
        width: width as f32,
        height: height as f32,
        max_depth: 1.0,
        ..Default::default()
    };
    let vertices_each = match draw.primitives {
        Primitives::Points => 1,
        Primitives::Squares => 6,
        Primitives::Picture => 3,
    };
    let raw = &device.raw;
    // SAFETY: the graph passes live attachments in GENERAL, has bound a pipeline made for them, and
    // for points a vertex buffer with enough positions.
    unsafe {
        raw.cmd_begin_rendering(commands, &rendering);
        raw.cmd_set_viewport(commands, 0, &[viewport]);
        raw.cmd_set_scissor(commands, 0, &[area]);
        if let Some(vertices) = vertices {
            raw.cmd_bind_vertex_buffers(commands, 0, &[vertices], &[0]);
        }
        raw.cmd_draw(commands, vertices_each * draw.count, 1, 0, 0);
        raw.cmd_end_rendering(commands);
    }
}

/// Makes the layout of a stage's descriptor set.
pub fn set_layout<'d>(
    device: &'d LogicalDevice,
    code: &Code,
    stage_flags: vk::ShaderStageFlags,
) -> Result<Fresh<'d, vk::DescriptorSetLayout>> {
    let binding = |binding: &super::Binding| {
        vk::DescriptorSetLayoutBinding::default()
            .binding(binding.bind)
            .descriptor_count(1)
            .stage_flags(stage_flags)
            .descriptor_type(descriptor_type(binding.kind))
    };
    let bindings: Vec<_> = code.bindings.iter().map(binding).collect();
    let info = vk::DescriptorSetLayoutCreateInfo::default().bindings(&bindings);
    // SAFETY: a plain creation on a live device.
    unsafe { device.make(&info) }
}

fn make(device: &Device, draw: &Draw, target: Target) -> Result<Pipeline> {
    let raw = &device.raw;
    let stage_flags = [vk::ShaderStageFlags::VERTEX, vk::ShaderStageFlags::FRAGMENT];
    let push: Vec<_> = (draw.stages.iter().zip(stage_flags))
        .filter(|(code, _)| code.push_bytes > 0)
        .map(|(code, stage_flags)| vk::PushConstantRange {
            stage_flags,
            offset: 0,
            size: code.push_bytes,
        })
        .collect();
    let binding = [vk::VertexInputBindingDescription {
        binding: 0,
        stride: 12,
        input_rate: vk::VertexInputRate::VERTEX,
    }];
    let attribute = [vk::VertexInputAttributeDescription {
        location: 0,
        binding: 0,
        format: vk::Format::R32G32B32_SFLOAT,
        offset: 0,
    }];
    let (input, topology) = match draw.primitives {
        Primitives::Points => (
            vk::PipelineVertexInputStateCreateInfo::default()
                .vertex_binding_descriptions(&binding)
                .vertex_attribute_descriptions(&attribute),
            vk::PrimitiveTopology::POINT_LIST,
        ),
        Primitives::Squares | Primitives::Picture => (
            vk::PipelineVertexInputStateCreateInfo::default(),
            vk::PrimitiveTopology::TRIANGLE_LIST,
        ),
    };
    let assembly = vk::PipelineInputAssemblyStateCreateInfo::default().topology(topology);
    let viewport =
        vk::PipelineViewportStateCreateInfo::default().viewport_count(1).scissor_count(1);
    let rasterization = vk::PipelineRasterizationStateCreateInfo::default().line_width(1.0);
    let samples = vk::PipelineMultisampleStateCreateInfo::default()
        .rasterization_samples(vk::SampleCountFlags::TYPE_1);
    let depth_test = vk::PipelineDepthStencilStateCreateInfo::default()
        .depth_test_enable(target.depth != vk::Format::UNDEFINED)
        .depth_write_enable(target.writes_depth)
        .depth_compare_op(target.compare);
    let over = vk::BlendFactor::ONE_MINUS_SRC_ALPHA;
    let written = [vk::PipelineColorBlendAttachmentState::default()
        .blend_enable(target.blends)
        .src_color_blend_factor(vk::BlendFactor::ONE)
        .dst_color_blend_factor(over)
        .src_alpha_blend_factor(vk::BlendFactor::ONE)
        .dst_alpha_blend_factor(over)
        .color_write_mask(vk::ColorComponentFlags::RGBA); 2];
    let blend = vk::PipelineColorBlendStateCreateInfo::default()
        .attachments(&written[..target.formats().len()]);
    let dynamic_states = [vk::DynamicState::VIEWPORT, vk::DynamicState::SCISSOR];
    let dynamic = vk::PipelineDynamicStateCreateInfo::default().dynamic_states(&dynamic_states);
    let mut rendering = vk::PipelineRenderingCreateInfo::default()
        .color_attachment_formats(target.formats())
        .depth_attachment_format(target.depth);
    let entries: Vec<_> = (draw.constants.iter().enumerate())
        .map(|(i, &(constant_id, _))| vk::SpecializationMapEntry {
            constant_id,
            offset: 4 * i as u32,
            size: 4,
        })
        .collect();
    let values: Vec<u32> = draw.constants.iter().map(|&(_, value)| value).collect();
    let specialization =
        vk::SpecializationInfo::default().map_entries(&entries).data(bytemuck::cast_slice(&values));
    // SAFETY: all pointers outlive their calls; build.rs made the SPIR-V from this repository's
    // GLSL, and the layouts from its reflection.
    unsafe {
        let set_layouts = [
            set_layout(raw, &draw.stages[0], stage_flags[0])?,
            set_layout(raw, &draw.stages[1], stage_flags[1])?,
        ];
        let layout = raw.make(
            &vk::PipelineLayoutCreateInfo::default()
                .set_layouts(&set_layouts.each_ref().map(|layout| **layout))
                .push_constant_ranges(&push),
        )?;
        let module =
            |code: &Code| raw.make(&vk::ShaderModuleCreateInfo::default().code(&code.words()));
        let modules = [module(&draw.stages[0])?, module(&draw.stages[1])?];
        let stage = |k: usize| {
            let flags = [vk::ShaderStageFlags::VERTEX, vk::ShaderStageFlags::FRAGMENT][k];
            vk::PipelineShaderStageCreateInfo::default()
                .stage(flags)
                .module(*modules[k])
                .name(c"main")
                .specialization_info(&specialization)
        };
        let stages = [stage(0), stage(1)];
        let info = vk::GraphicsPipelineCreateInfo::default()
            .stages(&stages)
            .vertex_input_state(&input)
            .input_assembly_state(&assembly)
            .viewport_state(&viewport)
            .rasterization_state(&rasterization)
            .multisample_state(&samples)
            .depth_stencil_state(&depth_test)
            .color_blend_state(&blend)
            .dynamic_state(&dynamic)
            .layout(*layout)
            .push_next(&mut rendering);
        let pipeline = raw.make(&info)?.keep();
        device.name(pipeline, draw.stages[0].name);
        let set_layouts = set_layouts.map(Fresh::keep);
        Ok(Pipeline { pipeline, layout: layout.keep(), set_layouts })
    }
}
