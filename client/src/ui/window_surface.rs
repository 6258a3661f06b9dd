//! The surface of the window: composes the ray-caster's pixels and the overlay, and presents them.

use crate::{
    error::{ClientError, Result},
    render::{Adapter, GpuDevice},
};
use insula_shaders::{
    cpu::raycast::Pixels,
    gpu::{Compose, DeviceQueue, Raycaster},
};
use insula_viewer::frame::FrameData;
use std::sync::Arc;
use winit::window::Window;

/// Background while there is no city.
const BACKGROUND: wgpu::Color = wgpu::Color { r: 0.09, g: 0.11, b: 0.14, a: 1.0 };

/// The surface, the device that presents to it, and the passes of a frame.
pub struct WindowSurface {
    surface: wgpu::Surface<'static>,
    config: wgpu::SurfaceConfiguration,
    device: GpuDevice,
    compose: Compose,
    painter: egui_wgpu::Renderer,
}

/// What egui paints in a frame.
pub struct OverlayShapes {
    pub primitives: Vec<egui::ClippedPrimitive>,
    /// Textures to create and to free.
    pub textures: egui::TexturesDelta,
    /// Scale of the display.
    pub pixels_per_point: f32,
}

/// The city in a frame.
pub struct SceneFrame<'a> {
    pub adapter: &'a mut Adapter,
    pub data: &'a FrameData,
}

impl WindowSurface {
    /// A surface on `window`. Fails if no device can present to it.
    pub fn new(window: &Arc<Window>, cache_bytes: u64) -> Result<Self> {
        let failed = |e: &dyn std::fmt::Display| {
            let text = e.to_string().replace('\n', " ");
            ClientError::Graphics(format!(
                "no GPU can draw to the window ({text}): install a graphics driver, or use insula snapshot"
            ))
        };
        let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle_from_env());
        let surface = instance.create_surface(window.clone()).map_err(|e| failed(&e))?;
        let device = GpuDevice::open(&instance, Some(&surface), cache_bytes).map_err(|e| failed(&e))?;
        let size = window.inner_size();
        let mut config = surface
            .get_default_config(&device.adapter, size.width.max(1), size.height.max(1))
            .ok_or_else(|| failed(&"no surface format"))?;
        let formats = surface.get_capabilities(&device.adapter).formats;
        // egui blends in sRGB, so the target must not encode to sRGB itself.
        config.format = formats.iter().copied().find(|f| !f.is_srgb()).unwrap_or(config.format);
        config.present_mode = wgpu::PresentMode::AutoVsync;
        surface.configure(&device.device, &config);
        let compose = Compose::new(&device.device, config.format);
        let painter = egui_wgpu::Renderer::new(&device.device, config.format, egui_wgpu::RendererOptions::default());
        Ok(Self { surface, config, device, compose, painter })
    }

    /// The device, for the ray-caster.
    pub fn device(&self) -> &GpuDevice {
        &self.device
    }

    /// Width and height in pixels.
    pub fn size_px(&self) -> [u32; 2] {
        [self.config.width, self.config.height]
    }

    /// Adapts the surface to a new size of the window, in pixels.
    pub fn resize(&mut self, width: u32, height: u32) {
        if width > 0 && height > 0 && [width, height] != self.size_px() {
            (self.config.width, self.config.height) = (width, height);
            self.surface.configure(&self.device.device, &self.config);
        }
    }

    /// Draws the scene, if there is one, and the overlay, and presents them. Returns `false` if the surface was not ready:
    /// the frame must be drawn again. Fails if the ray-caster fails.
    pub fn present(&mut self, scene: Option<SceneFrame<'_>>, overlay: &OverlayShapes) -> Result<bool> {
        for (id, deltas) in &overlay.textures.set {
            for delta in deltas {
                self.painter.update_texture(&self.device.device, &self.device.queue, *id, delta);
            }
        }
        let is_presented = self.draw(scene, overlay);
        for id in &overlay.textures.free {
            self.painter.free_texture(id);
        }
        is_presented
    }

    fn draw(&mut self, scene: Option<SceneFrame<'_>>, overlay: &OverlayShapes) -> Result<bool> {
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
        if let Some(SceneFrame { adapter: Adapter::Gpu(gpu), data }) = scene {
            gpu.encode(&mut encoder, data)?;
            gpu.encode_query(&mut encoder, data);
            let on = DeviceQueue { device: &self.device.device, queue: &self.device.queue };
            self.compose.measure(on, &mut encoder, &gpu.raycaster, [self.config.width, self.config.height]);
            drawn = Some(gpu);
        }
        self.compose(&mut encoder, &view, drawn.as_deref().map(|gpu| &gpu.raycaster), overlay);
        self.device.queue.submit([encoder.finish()]);
        if let Some(gpu) = drawn {
            gpu.query_submitted();
        }
        self.device.queue.present(target);
        Ok(true)
    }

    /// Records the pass that writes the ray-caster's pixels, if any, and the overlay into `view`.
    fn compose(
        &mut self,
        encoder: &mut wgpu::CommandEncoder,
        view: &wgpu::TextureView,
        drawn: Option<&Raycaster>,
        overlay: &OverlayShapes,
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
            ops: wgpu::Operations { load: wgpu::LoadOp::Clear(BACKGROUND), store: wgpu::StoreOp::Store },
        };
        let descriptor = wgpu::RenderPassDescriptor {
            label: Some("compose"),
            color_attachments: &[Some(attachment)],
            ..wgpu::RenderPassDescriptor::default()
        };
        let mut pass = encoder.begin_render_pass(&descriptor).forget_lifetime();
        if let Some(raycaster) = drawn {
            self.compose.draw(device, &mut pass, raycaster);
        }
        self.painter.render(&mut pass, &overlay.primitives, &screen);
    }
}

/// Converts the CPU ray-caster's pixels to an image that egui can paint below the overlay.
pub fn color_image(pixels: &Pixels) -> egui::ColorImage {
    let rgba: Vec<u8> = pixels.colour.iter().flat_map(|c| c.to_le_bytes()).collect();
    egui::ColorImage::from_rgba_unmultiplied([pixels.width_px as usize, pixels.height_px as usize], &rgba)
}
