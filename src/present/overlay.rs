//! The overlay: triangles of the panel, drawn into a swapchain's image after the picture is copied
//! there.

use super::FRAMES_IN_FLIGHT;
use super::overlay_objects::OverlayObjects;
use crate::error::{Error, Result};
use crate::gpu::Device;
use ash::vk;
use egui::epaint::textures::TexturesDelta;
use egui_ash_renderer::allocator::DefaultAllocator;
use egui_ash_renderer::{DynamicRendering, Options, RenderMode, Renderer};

/// Triangles and textures of the panel, until the next layout.
pub struct Overlay {
    pub triangles: Vec<egui::ClippedPrimitive>,
    pub pixels_per_point: f32,
    /// Changes of textures since the last overlay.
    pub textures: TexturesDelta,
}

/// Draws the newest overlay.
pub struct OverlayRenderer {
    renderer: Renderer<DefaultAllocator>,
    triangles: Vec<egui::ClippedPrimitive>,
    pixels_per_point: f32,
    // Dropped after the renderer.
    _objects: OverlayObjects,
}

fn failed(error: egui_ash_renderer::RendererError) -> Error {
    Error::Device(format!("cannot draw the panel: {error}"))
}

fn render_mode(format: vk::Format) -> RenderMode {
    let target = DynamicRendering {
        color_attachment_format: format,
        depth_attachment_format: None,
        stencil_attachment_format: None,
    };
    RenderMode::DynamicRendering(target)
}

impl OverlayRenderer {
    pub fn new(device: &Device, format: vk::Format) -> Result<OverlayRenderer> {
        let options = Options { in_flight_frames: FRAMES_IN_FLIGHT, ..Options::default() };
        // SAFETY: the objects are dropped with the renderer, when nothing of it is in flight.
        let (objects, functions) = unsafe { OverlayObjects::begin(&device.raw) };
        let renderer = Renderer::with_default_allocator(
            &device.instance,
            device.physical,
            functions,
            render_mode(format),
            options,
        );
        let renderer = renderer.map_err(failed)?;
        Ok(OverlayRenderer {
            renderer,
            triangles: Vec::new(),
            pixels_per_point: 1.0,
            _objects: objects,
        })
    }

    /// Changes the format of the images; nothing may be in flight.
    pub fn set_format(&mut self, format: vk::Format) -> Result<()> {
        self.renderer.set_render_mode(render_mode(format)).map_err(failed)
    }

    /// Sets the overlay. If it changes textures, nothing drawn before may be in flight.
    pub fn set_overlay(
        &mut self,
        device: &Device,
        pool: vk::CommandPool,
        overlay: Overlay,
    ) -> Result<()> {
        let Overlay { triangles, pixels_per_point, mut textures } = overlay;
        for (id, deltas) in std::mem::take(&mut textures.set) {
            deltas
                .iter()
                .try_for_each(|delta| {
                    self.renderer.set_texture(device.own_queue(), pool, id, delta)
                })
                .map_err(failed)?;
        }
        for id in std::mem::take(&mut textures.free) {
            self.renderer.free_texture(id).map_err(failed)?;
        }
        (self.triangles, self.pixels_per_point) = (triangles, pixels_per_point);
        Ok(())
    }

    /// Records the triangles, within a rendering into an image of this size.
    pub fn draw(&mut self, commands: vk::CommandBuffer, extent: vk::Extent2D) -> Result<()> {
        self.renderer
            .cmd_draw(commands, extent, self.pixels_per_point, &self.triangles)
            .map_err(failed)
    }
}
