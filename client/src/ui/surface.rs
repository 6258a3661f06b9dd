//! The window's surface: the ray-caster's pixels and the overlay, composed and presented.
//!
//! In: [`FrameData`] or pixels, egui's output. Out: a presented frame. Next: the screen.

use crate::{
    error::{ClientError, Result},
    render::{Adapter, Device},
};
use insula_shaders::{
    cpu::raycast::Pixels,
    gpu::{Compose, Raycaster},
};
use insula_viewer::frame::FrameData;
use std::sync::Arc;
use winit::window::Window;

/// Behind everything, while there is no city.
const EMPTY: wgpu::Color = wgpu::Color { r: 0.09, g: 0.11, b: 0.14, a: 1.0 };

/// Everything that presenting needs.
pub struct Surface {
    surface: wgpu::Surface<'static>,
    config: wgpu::SurfaceConfiguration,
    device: Device,
    compose: Compose,
    painter: egui_wgpu::Renderer,
}

/// egui's part of a frame.
pub struct Overlay {
    /// Triangles.
    pub primitives: Vec<egui::ClippedPrimitive>,
    /// Textures to make and to free.
    pub textures: egui::TexturesDelta,
    /// Scale of the display.
    pub pixels_per_point: f32,
}

impl Surface {
    /// A surface on `window`, and the device that presents to it.
    pub fn new(window: &Arc<Window>, cache_bytes: u64) -> Result<Self> {
        let failed = |e: &dyn std::fmt::Display| {
            let text = e.to_string().replace('\n', " ");
            ClientError::Graphics(format!(
                "the window cannot be drawn to ({text}): install a graphics driver, or use insula snapshot"
            ))
        };
        let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle_from_env());
        let surface = instance.create_surface(window.clone()).map_err(|e| failed(&e))?;
        let device = Device::open(&instance, Some(&surface), cache_bytes).map_err(|e| failed(&e))?;
        let size = window.inner_size();
        let mut config = surface
            .get_default_config(&device.adapter, size.width.max(1), size.height.max(1))
            .ok_or_else(|| failed(&"no surface format"))?;
        let formats = surface.get_capabilities(&device.adapter).formats;
        // egui blends in sRGB: it wants a target that does not encode.
        config.format = formats.iter().copied().find(|f| !f.is_srgb()).unwrap_or(config.format);
        config.present_mode = wgpu::PresentMode::AutoVsync;
        surface.configure(&device.device, &config);
        let compose = Compose::new(&device.device, config.format);
        let painter = egui_wgpu::Renderer::new(&device.device, config.format, egui_wgpu::RendererOptions::default());
        Ok(Self { surface, config, device, compose, painter })
    }

    /// The device, for the ray-caster.
    pub fn device(&self) -> &Device {
        &self.device
    }

    /// Size in pixels.
    pub fn size_px(&self) -> [u32; 2] {
        [self.config.width, self.config.height]
    }

    /// The window has another size.
    pub fn resize(&mut self, width: u32, height: u32) {
        if width > 0 && height > 0 && [width, height] != self.size_px() {
            (self.config.width, self.config.height) = (width, height);
            self.surface.configure(&self.device.device, &self.config);
        }
    }

    /// Draws the city, if there is one, and the overlay, and presents. `Ok(false)`: the surface was not ready, draw again.
    pub fn present(&mut self, city: Option<(&mut Adapter, &FrameData)>, overlay: &Overlay) -> Result<bool> {
        for (id, deltas) in &overlay.textures.set {
            for delta in deltas {
                self.painter.update_texture(&self.device.device, &self.device.queue, *id, delta);
            }
        }
        let shown = self.draw(city, overlay);
        for id in &overlay.textures.free {
            self.painter.free_texture(id);
        }
        shown
    }

    fn draw(&mut self, city: Option<(&mut Adapter, &FrameData)>, overlay: &Overlay) -> Result<bool> {
        use wgpu::CurrentSurfaceTexture as Current;
        let target = match self.surface.get_current_texture() {
            Current::Success(texture) | Current::Suboptimal(texture) => texture,
            Current::Outdated | Current::Lost => {
                self.surface.configure(&self.device.device, &self.config);
                return Ok(false);
            }
            _ => return Ok(false),
        };
        let view = target.texture.create_view(&wgpu::TextureViewDescriptor::default());
        let label = wgpu::CommandEncoderDescriptor { label: Some("frame") };
        let mut encoder = self.device.device.create_command_encoder(&label);
        let mut drawn = None;
        if let Some((Adapter::Gpu(gpu), data)) = city {
            gpu.encode(&mut encoder, data)?;
            gpu.ask(&mut encoder, data);
            drawn = Some(gpu);
        }
        self.compose(&mut encoder, &view, drawn.as_deref().map(|gpu| &gpu.raycaster), overlay);
        self.device.queue.submit([encoder.finish()]);
        if let Some(gpu) = drawn {
            gpu.submitted();
        }
        self.device.queue.present(target);
        Ok(true)
    }

    fn compose(
        &mut self,
        encoder: &mut wgpu::CommandEncoder,
        view: &wgpu::TextureView,
        drawn: Option<&Raycaster>,
        overlay: &Overlay,
    ) {
        let (device, queue) = (&self.device.device, &self.device.queue);
        let size_in_pixels = [self.config.width, self.config.height];
        let screen = egui_wgpu::ScreenDescriptor { size_in_pixels, pixels_per_point: overlay.pixels_per_point };
        let extra = self.painter.update_buffers(device, queue, encoder, &overlay.primitives, &screen);
        debug_assert!(extra.is_empty(), "no paint callbacks are used");
        let attachment = wgpu::RenderPassColorAttachment {
            view,
            depth_slice: None,
            resolve_target: None,
            ops: wgpu::Operations { load: wgpu::LoadOp::Clear(EMPTY), store: wgpu::StoreOp::Store },
        };
        let descriptor = wgpu::RenderPassDescriptor {
            label: Some("compose"),
            color_attachments: &[Some(attachment)],
            ..wgpu::RenderPassDescriptor::default()
        };
        let mut pass = encoder.begin_render_pass(&descriptor).forget_lifetime();
        if let Some(raycaster) = drawn {
            self.compose.draw(device, queue, &mut pass, raycaster, size_in_pixels);
        }
        self.painter.render(&mut pass, &overlay.primitives, &screen);
    }
}

/// The CPU ray-caster's pixels as an image that egui can paint below the overlay.
pub fn image(pixels: &Pixels) -> egui::ColorImage {
    let rgba: Vec<u8> = pixels.colour.iter().flat_map(|c| c.to_le_bytes()).collect();
    egui::ColorImage::from_rgba_unmultiplied([pixels.width_px as usize, pixels.height_px as usize], &rgba)
}
