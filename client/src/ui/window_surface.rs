//! The surface of the window: composes the ray-caster's pixels and the overlay, and presents them.

use crate::error::{ClientError, Result};
use crate::render::{GpuAdapter, GpuDevice, graphics_error};
use insula_shaders::cpu::raycast::Pixels;
use insula_shaders::gpu::{Compose, DeviceQueue};
use insula_viewer::frame::FrameData;
use std::sync::Arc;
use winit::window::Window;

/// Format of the texture with the scene: egui expects values in sRGB in a texture that does not convert them.
const SCENE_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8Unorm;
/// Background while there is no city.
const BACKGROUND: wgpu::Color = wgpu::Color { r: 0.09, g: 0.11, b: 0.14, a: 1.0 };

/// The surface, the device that presents to it, and the passes of a frame.
pub struct WindowSurface {
    surface: wgpu::Surface<'static>,
    config: wgpu::SurfaceConfiguration,
    device: GpuDevice,
    compose: Compose,
    painter: egui_wgpu::Renderer,
    /// The last scene that the GPU drew: it stays on the screen while only the overlay changes.
    scene: Option<SceneTexture>,
    /// The last frame of the CPU ray-caster, if it is copied to the surface.
    kept: Option<KeptFrame>,
}

/// A frame of the CPU ray-caster that is copied to the surface, enlarged to its size. A software driver would take longer to paint
/// it as a texture than the CPU for casting its rays.
struct KeptFrame {
    /// r, g, b, 255, r lowest.
    words: Vec<u32>,
    size_px: [u32; 2],
}

struct SceneTexture {
    view: wgpu::TextureView,
    id: egui::TextureId,
    size_px: [u32; 2],
}

/// What egui paints in a frame.
pub struct OverlayShapes {
    pub primitives: Vec<egui::ClippedPrimitive>,
    pub textures: egui::TexturesDelta,
    pub pixels_per_point: f32,
}

/// A frame of the city that the GPU is to draw.
pub struct SceneFrame<'a> {
    pub gpu: &'a mut GpuAdapter,
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
        let device =
            pollster::block_on(GpuDevice::open(&instance, Some(&surface), cache_bytes)).map_err(|e| failed(&e))?;
        let size = window.inner_size();
        let mut config = surface
            .get_default_config(&device.adapter, size.width.max(1), size.height.max(1))
            .ok_or_else(|| failed(&"no surface format"))?;
        let formats = surface.get_capabilities(&device.adapter).formats;
        // egui blends in sRGB, so the target must not encode to sRGB itself.
        config.format = formats.iter().copied().find(|f| !f.is_srgb()).unwrap_or(config.format);
        config.present_mode = wgpu::PresentMode::AutoVsync;
        let copies = surface.get_capabilities(&device.adapter).usages & wgpu::TextureUsages::COPY_DST;
        if device.is_software() {
            config.usage |= copies;
        }
        surface.configure(&device.device, &config);
        let compose = Compose::new(&device.device, SCENE_FORMAT);
        let painter = egui_wgpu::Renderer::new(&device.device, config.format, egui_wgpu::RendererOptions::default());
        Ok(Self { surface, config, device, compose, painter, scene: None, kept: None })
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

    /// Keeps a frame of the CPU ray-caster for copying it to the surface from now on. Returns `false` if an overlay is to paint it
    /// instead: where a GPU does that, or the surface takes no copies.
    pub fn keep_frame(&mut self, pixels: &Pixels) -> bool {
        let has_format =
            [wgpu::TextureFormat::Bgra8Unorm, wgpu::TextureFormat::Rgba8Unorm].contains(&self.config.format);
        if !has_format || !self.config.usage.contains(wgpu::TextureUsages::COPY_DST) {
            return false;
        }
        self.kept = Some(KeptFrame { words: pixels.colour.clone(), size_px: [pixels.width_px, pixels.height_px] });
        true
    }

    /// Forgets such a frame.
    pub fn forget_frame(&mut self) {
        self.kept = None;
    }

    /// The texture that shows the scene as the GPU drew it last, for the overlay to paint below its panels. It has the size of
    /// the surface.
    pub fn scene_texture(&mut self) -> egui::TextureId {
        let size_px = self.size_px();
        if let Some(scene) = self.scene.as_ref().filter(|scene| scene.size_px == size_px) {
            return scene.id;
        }
        let device = &self.device.device;
        let texture = device.create_texture(&wgpu::TextureDescriptor {
            label: Some("scene"),
            size: wgpu::Extent3d { width: size_px[0], height: size_px[1], depth_or_array_layers: 1 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: SCENE_FORMAT,
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::TEXTURE_BINDING,
            view_formats: &[],
        });
        let view = texture.create_view(&wgpu::TextureViewDescriptor::default());
        let nearest = wgpu::FilterMode::Nearest;
        let id = match &self.scene {
            Some(scene) => {
                self.painter.update_egui_texture_from_wgpu_texture(device, &view, nearest, scene.id);
                scene.id
            }
            None => self.painter.register_native_texture(device, &view, nearest),
        };
        self.scene = Some(SceneTexture { view, id, size_px });
        id
    }

    /// Presents the overlay, and below it the scene, which is redrawn if `scene` is given. Returns `false` if the surface was not
    /// ready: the frame must be drawn again. Takes the changes of the overlay's textures in any case. Fails if the ray-caster fails.
    pub fn present(&mut self, scene: Option<SceneFrame<'_>>, overlay: &mut OverlayShapes) -> Result<bool> {
        for (id, deltas) in &overlay.textures.set {
            for delta in deltas {
                self.painter.update_texture(&self.device.device, &self.device.queue, *id, delta);
            }
        }
        let is_presented = self.draw(scene, overlay);
        for id in &overlay.textures.free {
            self.painter.free_texture(id);
        }
        // In builds with debug assertions, egui panics if changes are dropped.
        overlay.textures.clear();
        is_presented
    }

    fn draw(&mut self, scene: Option<SceneFrame<'_>>, overlay: &OverlayShapes) -> Result<bool> {
        use wgpu::CurrentSurfaceTexture as Current;
        let begin = std::time::Instant::now();
        let target = match self.surface.get_current_texture() {
            Current::Success(texture) | Current::Suboptimal(texture) => texture,
            Current::Outdated | Current::Lost => {
                self.surface.configure(&self.device.device, &self.config);
                return Ok(false);
            }
            _ => return Ok(false),
        };
        let acquired = begin.elapsed();
        let view = target.texture.create_view(&wgpu::TextureViewDescriptor::default());
        let label = wgpu::CommandEncoderDescriptor { label: Some("frame") };
        let mut encoder = self.device.device.create_command_encoder(&label);
        let mut drawn = None;
        if let Some(SceneFrame { gpu, data }) = scene {
            gpu.encode(&mut encoder, &data.frame, &data.grid, &data.nodes).map_err(graphics_error)?;
            gpu.encode_query(&mut encoder, data);
            self.draw_scene(&mut encoder, gpu);
            drawn = Some(gpu);
        }
        if let Some(kept) = &self.kept {
            self.copy(kept, &target.texture);
        }
        let copied = begin.elapsed();
        self.draw_overlay(&mut encoder, &view, overlay);
        let recorded = begin.elapsed();
        self.device.queue.submit([encoder.finish()]);
        let submitted = begin.elapsed();
        if let Some(gpu) = drawn {
            gpu.query_submitted();
        }
        self.device.queue.present(target);
        let ms = |time: std::time::Duration| time.as_secs_f64() * 1e3;
        tracing::trace!(
            acquire_ms = ms(acquired),
            copy_ms = ms(copied - acquired),
            record_ms = ms(recorded - copied),
            submit_ms = ms(submitted - recorded),
            show_ms = ms(begin.elapsed() - submitted),
            "surface presented"
        );
        Ok(true)
    }

    /// Copies a frame to the surface. The next commands find it there.
    fn copy(&self, kept: &KeptFrame, target: &wgpu::Texture) {
        let size_px = self.size_px();
        let swaps = self.config.format == wgpu::TextureFormat::Bgra8Unorm;
        let words = kept.enlarged(size_px, swaps);
        let layout =
            wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(size_px[0] * 4), rows_per_image: None };
        let extent = wgpu::Extent3d { width: size_px[0], height: size_px[1], depth_or_array_layers: 1 };
        self.device.queue.write_texture(target.as_image_copy(), bytemuck::cast_slice(&words), layout, extent);
    }

    /// Records the passes that write the ray-caster's pixels into the scene's texture.
    fn draw_scene(&mut self, encoder: &mut wgpu::CommandEncoder, gpu: &GpuAdapter) {
        let Some(scene) = &self.scene else { return };
        let on = DeviceQueue { device: &self.device.device, queue: &self.device.queue };
        self.compose.measure(on, encoder, &gpu.raycaster, scene.size_px);
        let mut pass = begin_pass(encoder, "scene", &scene.view, wgpu::LoadOp::Clear(BACKGROUND));
        self.compose.draw(&self.device.device, &mut pass, &gpu.raycaster);
    }

    fn draw_overlay(&mut self, encoder: &mut wgpu::CommandEncoder, view: &wgpu::TextureView, overlay: &OverlayShapes) {
        let (device, queue) = (&self.device.device, &self.device.queue);
        let screen =
            egui_wgpu::ScreenDescriptor { size_in_pixels: self.size_px(), pixels_per_point: overlay.pixels_per_point };
        let extra = self.painter.update_buffers(device, queue, encoder, &overlay.primitives, &screen);
        debug_assert!(extra.is_empty(), "no paint callbacks are used");
        let load = if self.kept.is_some() { wgpu::LoadOp::Load } else { wgpu::LoadOp::Clear(BACKGROUND) };
        let mut pass = begin_pass(encoder, "overlay", view, load);
        self.painter.render(&mut pass, &overlay.primitives, &screen);
    }
}

impl KeptFrame {
    /// The frame with this size, each pixel that of the nearest one; with red and blue swapped if `swaps`.
    fn enlarged(&self, [width, height]: [u32; 2], swaps: bool) -> Vec<u32> {
        let nearest = |at: u32, size: u32, kept: u32| {
            ((2 * u64::from(at) + 1) * u64::from(kept) / (2 * u64::from(size.max(1)))) as usize
        };
        let columns: Vec<usize> = (0..width).map(|x| nearest(x, width, self.size_px[0])).collect();
        let swapped =
            |word: u32| if swaps { word & 0xff00_ff00 | (word & 0xff) << 16 | word >> 16 & 0xff } else { word };
        let mut words = Vec::with_capacity(width as usize * height as usize);
        let mut last = None;
        for y in 0..height {
            let row = nearest(y, height, self.size_px[1]);
            if last == Some(row) {
                words.extend_from_within(words.len() - width as usize..);
                continue;
            }
            last = Some(row);
            let from = self.words.get(row * self.size_px[0] as usize..).unwrap_or_default();
            words.extend(columns.iter().map(|x| swapped(from.get(*x).copied().unwrap_or_default())));
        }
        words
    }
}

fn begin_pass(
    encoder: &mut wgpu::CommandEncoder,
    label: &'static str,
    view: &wgpu::TextureView,
    load: wgpu::LoadOp<wgpu::Color>,
) -> wgpu::RenderPass<'static> {
    let attachment = wgpu::RenderPassColorAttachment {
        view,
        depth_slice: None,
        resolve_target: None,
        ops: wgpu::Operations { load, store: wgpu::StoreOp::Store },
    };
    let descriptor = wgpu::RenderPassDescriptor {
        label: Some(label),
        color_attachments: &[Some(attachment)],
        ..wgpu::RenderPassDescriptor::default()
    };
    encoder.begin_render_pass(&descriptor).forget_lifetime()
}

/// Converts the CPU ray-caster's pixels to an image that egui can paint below the overlay.
pub fn color_image(pixels: &Pixels) -> egui::ColorImage {
    let rgba: Vec<u8> = pixels.colour.iter().flat_map(|c| c.to_le_bytes()).collect();
    egui::ColorImage::from_rgba_unmultiplied([pixels.width_px as usize, pixels.height_px as usize], &rgba)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kept_frames_are_enlarged_and_swapped() {
        let kept = KeptFrame { words: vec![0xff01_0203, 0xff04_0506], size_px: [2, 1] };
        assert_eq!(kept.enlarged([2, 1], false), kept.words);
        let row = [0xff03_0201, 0xff03_0201, 0xff06_0504, 0xff06_0504];
        assert_eq!(kept.enlarged([4, 2], true), [row, row].concat());
        // A frame that does not divide the surface, as after a change of its size.
        assert_eq!(kept.enlarged([3, 1], false), [kept.words[0], kept.words[1], kept.words[1]]);
    }
}
