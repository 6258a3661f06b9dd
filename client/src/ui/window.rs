//! The window with its surface and its overlay, with or without a city in it.

use super::window_surface::{OverlayShapes, WindowSurface, color_image};
use crate::error::{ClientError, Result};
use crate::render::{AdapterChoice, GpuDevice, OpenedAdapter, Trial};
use insula_protocol::text::printable;
use insula_shaders::cpu::raycast::Pixels;
use insula_viewer::cache::pages_for;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Duration;
use winit::dpi::{LogicalSize, PhysicalPosition};
use winit::event::WindowEvent;
use winit::event_loop::ActiveEventLoop;
use winit::window::{Fullscreen, Window};

/// A window, its surface and its overlay.
pub struct ViewerWindow {
    pub window: Arc<Window>,
    pub surface: WindowSurface,
    pub egui: egui::Context,
    input: egui_winit::State,
    /// The city, below the overlay.
    background: Background,
    /// The ray-caster, until it is taken.
    opening: Option<JoinHandle<Result<OpenedAdapter>>>,
    /// Number of cache pages that it is to hold.
    pages: u32,
}

/// What is painted below the overlay.
enum Background {
    /// There is no city.
    Empty,
    /// Pixels of the CPU ray-caster, as a texture.
    Image(egui::TextureHandle),
    /// The same, which the surface copies.
    Copied,
    /// The scene's texture on the GPU.
    Scene(egui::TextureId),
}

/// Result of [`ViewerWindow::lay_out`].
pub struct OverlayLayout {
    pub shapes: OverlayShapes,
    /// After this time, the overlay must be laid out again.
    pub repaint_after: Duration,
}

impl ViewerWindow {
    /// Opens a window of `size` points, and begins to open its ray-caster. Fails if there is no screen, or if no device can present to
    /// it.
    pub fn new(
        event_loop: &ActiveEventLoop,
        title: &str,
        size: [u32; 2],
        (choice, cache_bytes): (AdapterChoice, u64),
    ) -> Result<Self> {
        let attributes = Window::default_attributes()
            .with_title(title)
            .with_min_inner_size(LogicalSize::new(200.0, 150.0))
            .with_inner_size(LogicalSize::new(size[0], size[1]));
        let window = event_loop.create_window(attributes).map_err(|e| {
            ClientError::Graphics(format!("no window can be opened ({e}): use insula snapshot instead"))
        })?;
        let window = Arc::new(window);
        let surface = WindowSurface::new(&window, cache_bytes)?;
        let egui = egui::Context::default();
        egui.set_theme(egui::Theme::Dark);
        let max_side = surface.device().device.limits().max_texture_dimension_2d as usize;
        let scale = Some(window.scale_factor() as f32);
        let input = egui_winit::State::new(egui.clone(), egui::ViewportId::ROOT, &window, scale, None, Some(max_side));
        let opening = open_adapter(surface.device().clone(), choice, cache_bytes);
        let (background, pages) = (Background::Empty, pages_for(cache_bytes));
        Ok(Self { window, surface, egui, input, background, opening, pages })
    }

    /// Passes an event to the overlay. Returns whether the overlay consumed it.
    pub fn handle_event(&mut self, event: &WindowEvent) -> bool {
        if let WindowEvent::Resized(size) = event {
            self.surface.resize(size.width, size.height);
        }
        let response = self.input.on_window_event(&self.window, event);
        if response.repaint {
            self.window.request_redraw();
        }
        response.consumed
    }

    /// Whether a panel of the last frame covers a position, in pixels. The overlay itself knows of a motion only after the next
    /// frame, which may be later than a click.
    pub fn is_over_panel(&self, at: PhysicalPosition<f64>) -> bool {
        let scale = self.egui.pixels_per_point();
        let at = egui::pos2(at.x as f32 / scale, at.y as f32 / scale);
        self.egui.layer_id_at(at).is_some_and(|layer| layer.order != egui::Order::Background)
    }

    /// Sets the image below the overlay: the frame of the CPU ray-caster.
    pub fn set_background(&mut self, pixels: &Pixels) {
        if self.surface.keep_frame(pixels) {
            self.background = Background::Copied;
            return;
        }
        let nearest = egui::TextureOptions::NEAREST;
        self.background = Background::Image(self.egui.load_texture("frame", color_image(pixels), nearest));
    }

    /// Shows what the GPU draws below the overlay.
    pub fn show_scene(&mut self) {
        self.surface.forget_frame();
        self.background = Background::Scene(self.surface.scene_texture());
    }

    /// Lays the overlay out.
    pub fn lay_out(&mut self, mut add_panels: impl FnMut(&egui::Context)) -> OverlayLayout {
        let raw_input = self.input.take_egui_input(&self.window);
        let background = match &self.background {
            Background::Empty | Background::Copied => None,
            Background::Image(image) => Some(image.id()),
            Background::Scene(id) => Some(*id),
        };
        let output = self.egui.run_ui(raw_input, |ui| {
            if let Some(background) = background {
                let whole = egui::Rect::from_min_max(egui::pos2(0.0, 0.0), egui::pos2(1.0, 1.0));
                let layer = ui.ctx().layer_painter(egui::LayerId::background());
                layer.image(background, ui.ctx().content_rect(), whole, egui::Color32::WHITE);
            }
            add_panels(ui.ctx());
        });
        self.input.handle_platform_output(&self.window, output.platform_output);
        let repaint_after = output.viewport_output.values().map(|v| v.repaint_delay).min().unwrap_or(Duration::MAX);
        let pixels_per_point = output.pixels_per_point;
        let primitives = self.egui.tessellate(output.shapes, pixels_per_point);
        let shapes = OverlayShapes { primitives, textures: output.textures_delta, pixels_per_point };
        OverlayLayout { shapes, repaint_after }
    }

    /// Whether the window fills the screen.
    pub fn is_full_screen(&self) -> bool {
        self.window.fullscreen().is_some()
    }

    /// Makes the window fill the screen, or not.
    pub fn set_full_screen(&self, is_full_screen: bool) {
        self.window.set_fullscreen(is_full_screen.then_some(Fullscreen::Borderless(None)));
        tracing::debug!("full screen {}", if is_full_screen { "on" } else { "off" });
    }

    /// Whether the window system has destroyed the window: only then, winit panics when it is asked for the size.
    pub fn is_destroyed(&self) -> bool {
        catch_unwind(AssertUnwindSafe(|| self.window.inner_size())).is_err()
    }

    /// Inner size in points.
    pub fn size(&self) -> [u32; 2] {
        // The window system may have destroyed the window: winit panics when it is asked for the size then.
        let scale = self.window.scale_factor();
        self.surface.size_px().map(|side| (f64::from(side) / scale).round() as u32)
    }

    /// The ray-caster: on the surface's device, or on the CPU if that is requested, faster, or all that works. Waits until it is open.
    pub fn take_adapter(&mut self) -> OpenedAdapter {
        let opened = self.opening.take().and_then(|opening| opening.join().ok()).unwrap_or_else(|| {
            Err(ClientError::Graphics("the ray-caster cannot be opened on a thread of its own".into()))
        });
        opened.unwrap_or_else(|error| {
            eprintln!("note: {}, using the CPU instead", printable(&error.to_string()));
            OpenedAdapter::cpu(self.pages)
        })
    }
}

/// Opens the ray-caster on another thread: shaders are compiled, and a software driver is tried, while the city is being found.
fn open_adapter(
    device: GpuDevice,
    choice: AdapterChoice,
    cache_bytes: u64,
) -> Option<JoinHandle<Result<OpenedAdapter>>> {
    let open = move || OpenedAdapter::choose(choice, || Ok(device), Trial::Now, cache_bytes);
    std::thread::Builder::new().name("insula-adapter".into()).spawn(open).ok()
}
