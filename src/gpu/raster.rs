//! A point list through the rasteriser with a depth test: the way the papers drew points, kept so that `bench project` can compare with it.
//!
//! In: a vertex buffer of f32 x, y, z. Out: the vertex number in an index target, and depth, reversed (near / z) so that f32 loses nothing.

use super::Device;
use super::failed;
use super::memory::RawImage;
use crate::error::Result;
use ash::vk;

/// SPIR-V of the two stages, and what they are to draw.
#[derive(Clone, Debug)]
pub struct Draw {
    pub vertex: &'static [u32],
    pub fragment: &'static [u32],
    /// Push constants of the vertex stage.
    pub push: Vec<u8>,
    pub points: u32,
}

struct Pipeline {
    pipeline: vk::Pipeline,
    layout: vk::PipelineLayout,
}

/// The pipeline, made when it is first drawn with.
pub struct Rasters {
    device: ash::Device,
    made: Option<Pipeline>,
}

impl Rasters {
    pub fn new(device: &Device) -> Rasters {
        Rasters { device: device.raw.clone(), made: None }
    }

    pub fn record(
        &mut self,
        device: &Device,
        commands: vk::CommandBuffer,
        draw: &Draw,
        vertices: vk::Buffer,
        index: &RawImage,
        depth: &RawImage,
    ) -> Result<()> {
        if self.made.is_none() {
            self.made = Some(make(device, draw, index, depth)?);
        }
        let pipeline = self.made.as_ref().expect("made above");
        let [width, height] = index.desc.size;
        let area = vk::Rect2D { extent: vk::Extent2D { width, height }, ..Default::default() };
        let color = [vk::RenderingAttachmentInfo::default()
            .image_view(index.view)
            .image_layout(vk::ImageLayout::GENERAL)
            .load_op(vk::AttachmentLoadOp::CLEAR)
            .store_op(vk::AttachmentStoreOp::STORE)
            .clear_value(vk::ClearValue { color: vk::ClearColorValue { uint32: [u32::MAX; 4] } })];
        let depth = vk::RenderingAttachmentInfo::default()
            .image_view(depth.view)
            .image_layout(vk::ImageLayout::GENERAL)
            .load_op(vk::AttachmentLoadOp::CLEAR)
            .store_op(vk::AttachmentStoreOp::STORE)
            .clear_value(vk::ClearValue { depth_stencil: vk::ClearDepthStencilValue { depth: 0.0, stencil: 0 } });
        let rendering = vk::RenderingInfo::default().render_area(area).layer_count(1).color_attachments(&color).depth_attachment(&depth);
        let viewport = vk::Viewport { width: width as f32, height: height as f32, max_depth: 1.0, ..Default::default() };
        let raw = &device.raw;
        // SAFETY: the graph gives live attachments in GENERAL and a vertex buffer of `points` positions.
        unsafe {
            raw.cmd_begin_rendering(commands, &rendering);
            raw.cmd_bind_pipeline(commands, vk::PipelineBindPoint::GRAPHICS, pipeline.pipeline);
            raw.cmd_set_viewport(commands, 0, &[viewport]);
            raw.cmd_set_scissor(commands, 0, &[area]);
            raw.cmd_bind_vertex_buffers(commands, 0, &[vertices], &[0]);
            raw.cmd_push_constants(commands, pipeline.layout, vk::ShaderStageFlags::VERTEX, 0, &draw.push);
            raw.cmd_draw(commands, draw.points, 1, 0, 0);
            raw.cmd_end_rendering(commands);
        }
        Ok(())
    }
}

impl Drop for Rasters {
    fn drop(&mut self) {
        if let Some(made) = &self.made {
            // SAFETY: every submission has been waited for.
            unsafe {
                self.device.destroy_pipeline(made.pipeline, None);
                self.device.destroy_pipeline_layout(made.layout, None);
            }
        }
    }
}

fn make(device: &Device, draw: &Draw, index: &RawImage, depth: &RawImage) -> Result<Pipeline> {
    let raw = &device.raw;
    let push = [vk::PushConstantRange { stage_flags: vk::ShaderStageFlags::VERTEX, offset: 0, size: draw.push.len() as u32 }];
    let binding = [vk::VertexInputBindingDescription { binding: 0, stride: 12, input_rate: vk::VertexInputRate::VERTEX }];
    let attribute = [vk::VertexInputAttributeDescription { location: 0, binding: 0, format: vk::Format::R32G32B32_SFLOAT, offset: 0 }];
    let input =
        vk::PipelineVertexInputStateCreateInfo::default().vertex_binding_descriptions(&binding).vertex_attribute_descriptions(&attribute);
    let assembly = vk::PipelineInputAssemblyStateCreateInfo::default().topology(vk::PrimitiveTopology::POINT_LIST);
    let viewport = vk::PipelineViewportStateCreateInfo::default().viewport_count(1).scissor_count(1);
    let rasterization = vk::PipelineRasterizationStateCreateInfo::default().line_width(1.0);
    let samples = vk::PipelineMultisampleStateCreateInfo::default().rasterization_samples(vk::SampleCountFlags::TYPE_1);
    let depth_test = vk::PipelineDepthStencilStateCreateInfo::default()
        .depth_test_enable(true)
        .depth_write_enable(true)
        .depth_compare_op(vk::CompareOp::GREATER);
    let written = [vk::PipelineColorBlendAttachmentState::default().color_write_mask(vk::ColorComponentFlags::RGBA)];
    let blend = vk::PipelineColorBlendStateCreateInfo::default().attachments(&written);
    let dynamic_states = [vk::DynamicState::VIEWPORT, vk::DynamicState::SCISSOR];
    let dynamic = vk::PipelineDynamicStateCreateInfo::default().dynamic_states(&dynamic_states);
    let formats = [index.desc.format];
    let mut rendering =
        vk::PipelineRenderingCreateInfo::default().color_attachment_formats(&formats).depth_attachment_format(depth.desc.format);
    // SAFETY: all pointers outlive their calls; the SPIR-V was made by build.rs.
    unsafe {
        let layout = raw
            .create_pipeline_layout(&vk::PipelineLayoutCreateInfo::default().push_constant_ranges(&push), None)
            .map_err(failed("vkCreatePipelineLayout"))?;
        let module = |code| {
            raw.create_shader_module(&vk::ShaderModuleCreateInfo::default().code(code), None).map_err(failed("vkCreateShaderModule"))
        };
        let (vertex, fragment) = (module(draw.vertex)?, module(draw.fragment)?);
        let stage = |stage, module| vk::PipelineShaderStageCreateInfo::default().stage(stage).module(module).name(c"main");
        let stages = [stage(vk::ShaderStageFlags::VERTEX, vertex), stage(vk::ShaderStageFlags::FRAGMENT, fragment)];
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
            .layout(layout)
            .push_next(&mut rendering);
        let pipeline = raw.create_graphics_pipelines(vk::PipelineCache::null(), &[info], None);
        raw.destroy_shader_module(vertex, None);
        raw.destroy_shader_module(fragment, None);
        let pipeline = pipeline.map_err(|(_, code)| code).map_err(failed("vkCreateGraphicsPipelines"))?[0];
        device.name(pipeline, "point_list");
        Ok(Pipeline { pipeline, layout })
    }
}
