//! The window itself, with or without a city in it.
//!
//! In: winit's window, egui. Out: laid out overlays, presented frames. Next: `window`, `city`.

use super::surface::{Overlay, Surface};
use crate::{
    error::{ClientError, Result},
    render::{Adapter, AdapterChoice, AdapterInfo, CpuAdapter, GpuAdapter},
};
use insula_viewer::cache::pages_for;
use std::{sync::Arc, time::Duration};
use winit::{
    dpi::LogicalSize,
    event::WindowEvent,
    event_loop::ActiveEventLoop,
    window::{Fullscreen, Window},
};

/// A window, its surface, its overlay.
pub struct Shell {
    /// The system's.
    pub window: Arc<Window>,
    /// Where frames go.
    pub surface: Surface,
    /// Lays out.
    pub egui: egui::Context,
    input: egui_winit::State,
    picture: Option<egui::TextureHandle>,
}

impl Shell {
    /// Opens a window.
    pub fn new(event_loop: &ActiveEventLoop, title: &str, size: [u32; 2], cache_bytes: u64) -> Result<Self> {
        let attributes = Window::default_attributes()
            .with_title(title)
            .with_min_inner_size(LogicalSize::new(200.0, 150.0))
            .with_inner_size(LogicalSize::new(size[0], size[1]));
        let window = event_loop.create_window(attributes).map_err(|e| {
            ClientError::Graphics(format!("no window can be opened ({e}): use insula snapshot instead"))
        })?;
        let window = Arc::new(window);
        let surface = Surface::new(&window, cache_bytes)?;
        let egui = egui::Context::default();
        egui.set_theme(egui::Theme::Dark);
        let side = surface.device().device.limits().max_texture_dimension_2d as usize;
        let scale = Some(window.scale_factor() as f32);
        let input = egui_winit::State::new(egui.clone(), egui::ViewportId::ROOT, &window, scale, None, Some(side));
        Ok(Self { window, surface, egui, input, picture: None })
    }

    /// Hands an event to the overlay; returns whether it was meant for it.
    pub fn event(&mut self, event: &WindowEvent) -> bool {
        if let WindowEvent::Resized(size) = event {
            self.surface.resize(size.width, size.height);
        }
        let response = self.input.on_window_event(&self.window, event);
        if response.repaint {
            self.window.request_redraw();
        }
        response.consumed
    }

    /// The picture below the overlay, if it does not come from the surface's own device.
    pub fn set_picture(&mut self, picture: egui::ColorImage) {
        self.picture = Some(self.egui.load_texture("picture", picture, egui::TextureOptions::NEAREST));
    }

    /// Lays the overlay out; also after how long it wants to be laid out again.
    pub fn lay_out(&mut self, mut add: impl FnMut(&egui::Context)) -> (Overlay, Duration) {
        let raw = self.input.take_egui_input(&self.window);
        let picture = self.picture.as_ref();
        let output = self.egui.run_ui(raw, |ui| {
            if let Some(picture) = picture {
                let whole = egui::Rect::from_min_max(egui::pos2(0.0, 0.0), egui::pos2(1.0, 1.0));
                let layer = ui.ctx().layer_painter(egui::LayerId::background());
                layer.image(picture.id(), ui.ctx().content_rect(), whole, egui::Color32::WHITE);
            }
            add(ui.ctx());
        });
        self.input.handle_platform_output(&self.window, output.platform_output);
        let again = output.viewport_output.values().map(|v| v.repaint_delay).min().unwrap_or(Duration::MAX);
        let pixels_per_point = output.pixels_per_point;
        let primitives = self.egui.tessellate(output.shapes, pixels_per_point);
        (Overlay { primitives, textures: output.textures_delta, pixels_per_point }, again)
    }

    /// Whether it fills the screen.
    pub fn is_full_screen(&self) -> bool {
        self.window.fullscreen().is_some()
    }

    /// Fills the screen, or not.
    pub fn set_full_screen(&self, full: bool) {
        self.window.set_fullscreen(full.then_some(Fullscreen::Borderless(None)));
    }

    /// Inner size in points.
    pub fn size(&self) -> [u32; 2] {
        let size = self.window.inner_size().to_logical::<f64>(self.window.scale_factor());
        [size.width.round() as u32, size.height.round() as u32]
    }

    /// What draws: the surface's device, or the CPU if that is better or asked for.
    pub fn adapter(&self, choice: AdapterChoice, cache_bytes: u64) -> (Adapter, AdapterInfo, u32) {
        let pages = pages_for(cache_bytes);
        let device = self.surface.device();
        if choice == AdapterChoice::Auto && device.is_software() {
            eprintln!("note: {} is no graphics hardware, the CPU ray-caster draws instead", device.info().name);
        } else if choice != AdapterChoice::Cpu {
            match GpuAdapter::new(device.clone(), pages) {
                Ok(gpu) => {
                    let (info, pages) = (gpu.device.info(), gpu.pages());
                    return (Adapter::Gpu(Box::new(gpu)), info, pages);
                }
                Err(reason) => {
                    tracing::debug!("the graphics device does not draw: {reason}");
                    eprintln!("note: the graphics device cannot run the ray-caster, the CPU draws instead");
                }
            }
        }
        (Adapter::Cpu(CpuAdapter::new(pages)), AdapterInfo::cpu(), pages)
    }
}
