//! The window's event loop.
//!
//! In: winit's events, a connected city. Out: frames. Next: `surface`.
//!
//! A frame is drawn when something moves, arrives or is asked for; else the loop sleeps.

use super::{
    control::{Control, Motion},
    overlay::{self, MESSAGE_TIME, Settings, Status},
    surface::{Overlay, Surface, image},
};
use crate::{
    cache::pages_for,
    camera::Camera,
    error::{ClientError, Result},
    picture::write_png,
    render::{Adapter, AdapterChoice, AdapterInfo, Look, STILL_SAMPLES, cpu::CpuAdapter, gpu::GpuAdapter},
    session::{Session, Shot},
    sun::Daylight,
};
use insula_shaders::layout::Shading;
use std::{
    sync::Arc,
    time::{Duration, Instant},
};
use winit::{
    application::ApplicationHandler,
    dpi::{LogicalSize, PhysicalPosition},
    event::{ElementState, KeyEvent, MouseButton, MouseScrollDelta, WindowEvent},
    event_loop::{ActiveEventLoop, ControlFlow, EventLoop},
    keyboard::{KeyCode, PhysicalKey},
    window::{Window, WindowId},
};

/// Something arrived from the network.
#[derive(Debug, Clone, Copy)]
pub struct Arrived;

/// A standing picture is drawn again with four rays a pixel after so long.
const REST: Duration = Duration::from_millis(250);
/// While something moves or arrives, frames slower than this are drawn with fewer pixels: a half or a quarter a side.
const SLOW: Duration = Duration::from_millis(45);
/// Coarsest.
const DIVIDE_MOST: u32 = 4;
/// A hidden window looks for arrivals so often.
const RETRY: Duration = Duration::from_millis(100);

/// Makes a session once it is known what draws.
pub type MakeSession = Box<dyn FnOnce((Adapter, AdapterInfo, u32)) -> Session>;

/// How the window begins.
pub struct Start {
    /// Shown in its frame.
    pub title: String,
    /// Where it looks from.
    pub camera: Camera,
    /// The city's diagonal.
    pub size_m: f64,
    /// Height of the ground.
    pub ground_z_m: f64,
    /// Tolerated error.
    pub tau_px: f64,
    /// The sun at first.
    pub daylight: Daylight,
    /// `--adapter`.
    pub adapter: AdapterChoice,
    /// Size of the cache.
    pub cache_bytes: u64,
}

/// An event loop, before the city is connected to (it needs the loop to wake it).
pub fn event_loop() -> Result<EventLoop<Arrived>> {
    EventLoop::with_user_event().build().map_err(|e| {
        tracing::debug!("no event loop: {e}");
        ClientError::Graphics("no window can be opened, there is no screen: set DISPLAY, or use insula snapshot".into())
    })
}

/// Runs until the window is closed.
pub fn run(event_loop: EventLoop<Arrived>, start: Start, make: MakeSession) -> Result<()> {
    event_loop.set_control_flow(ControlFlow::Wait);
    let mut app = App { start, make: Some(make), open: None, failed: None };
    let ended = event_loop.run_app(&mut app);
    match (app.failed, ended) {
        (Some(error), _) => Err(error),
        (None, Err(error)) => Err(ClientError::Graphics(format!("the window system ended the program: {error}"))),
        (None, Ok(())) => Ok(()),
    }
}

struct App {
    start: Start,
    make: Option<MakeSession>,
    open: Option<Open>,
    failed: Option<ClientError>,
}

struct Open {
    window: Arc<Window>,
    surface: Surface,
    session: Session,
    egui: egui::Context,
    input: egui_winit::State,
    settings: Settings,
    control: Control,
    /// Of the settings' daylight.
    look: Look,
    picture: Option<egui::TextureHandle>,
    dragging: bool,
    pointer: PhysicalPosition<f64>,
    last_frame: Instant,
    last_change: Instant,
    frame_time: Duration,
    /// What a frame of all pixels, one ray each, takes.
    full_time: Duration,
    rested: bool,
}

impl ApplicationHandler<Arrived> for App {
    fn resumed(&mut self, event_loop: &ActiveEventLoop) {
        let Some(make) = self.make.take() else { return };
        match Open::new(event_loop, &self.start, make) {
            Ok(open) => self.open.insert(open).window.request_redraw(),
            Err(error) => self.fail(event_loop, error),
        }
    }

    fn user_event(&mut self, _: &ActiveEventLoop, Arrived: Arrived) {
        if let Some(open) = &mut self.open {
            open.rested = false;
            open.window.request_redraw();
        }
    }

    fn new_events(&mut self, _: &ActiveEventLoop, cause: winit::event::StartCause) {
        if let (winit::event::StartCause::ResumeTimeReached { .. }, Some(open)) = (cause, &self.open) {
            open.window.request_redraw();
        }
    }

    fn window_event(&mut self, event_loop: &ActiveEventLoop, _: WindowId, event: WindowEvent) {
        let Some(open) = &mut self.open else { return };
        match event {
            WindowEvent::CloseRequested => event_loop.exit(),
            WindowEvent::RedrawRequested => match open.frame() {
                Ok(flow) => event_loop.set_control_flow(flow),
                Err(error) => self.fail(event_loop, error),
            },
            event => {
                if open.event(&event) {
                    event_loop.exit();
                }
            }
        }
    }
}

impl App {
    fn fail(&mut self, event_loop: &ActiveEventLoop, error: ClientError) {
        self.failed = Some(error);
        event_loop.exit();
    }
}

impl Open {
    fn new(event_loop: &ActiveEventLoop, start: &Start, make: MakeSession) -> Result<Self> {
        let attributes = Window::default_attributes()
            .with_title(format!("{} - Insula", start.title))
            .with_inner_size(LogicalSize::new(1280.0, 720.0));
        let window = event_loop.create_window(attributes).map_err(|e| {
            ClientError::Graphics(format!("no window can be opened ({e}): use insula snapshot instead"))
        })?;
        let window = Arc::new(window);
        let surface = Surface::new(&window, start.cache_bytes)?;
        let session = make(adapter(&surface, start));
        let egui = egui::Context::default();
        egui.set_theme(egui::Theme::Dark);
        let side = surface.device().device.limits().max_texture_dimension_2d as usize;
        let scale = Some(window.scale_factor() as f32);
        let input = egui_winit::State::new(egui.clone(), egui::ViewportId::ROOT, &window, scale, None, Some(side));
        let settings = Settings {
            tau_px: start.tau_px,
            shading: Shading::Lit,
            daylight: start.daylight,
            help: false,
            message: None,
        };
        let now = Instant::now();
        Ok(Self {
            window,
            surface,
            session,
            egui,
            input,
            settings,
            control: Control::new(&start.camera, start.size_m, start.ground_z_m),
            look: start.daylight.look(Shading::Lit, 1),
            picture: None,
            dragging: false,
            pointer: PhysicalPosition::default(),
            last_frame: now,
            last_change: now,
            frame_time: Duration::ZERO,
            full_time: Duration::ZERO,
            rested: false,
        })
    }

    /// Handles anything but redrawing; returns whether to quit.
    fn event(&mut self, event: &WindowEvent) -> bool {
        let for_overlay = match event {
            // Its keys are ours: the overlay has no text fields.
            WindowEvent::KeyboardInput { event, .. } => return self.key(event),
            event => {
                let response = self.input.on_window_event(&self.window, event);
                if response.repaint {
                    self.window.request_redraw();
                }
                response.consumed
            }
        };
        match event {
            WindowEvent::Resized(size) => {
                self.surface.resize(size.width, size.height);
                self.changed();
            }
            WindowEvent::ScaleFactorChanged { .. } | WindowEvent::Occluded(false) => self.changed(),
            WindowEvent::Focused(false) => {
                self.control.release();
                self.dragging = false;
            }
            WindowEvent::ModifiersChanged(modifiers) => self.control.fast(modifiers.state().shift_key()),
            WindowEvent::MouseInput { state, button: MouseButton::Left | MouseButton::Right, .. } => {
                self.dragging = *state == ElementState::Pressed && !for_overlay;
            }
            WindowEvent::CursorMoved { position, .. } => {
                if self.dragging && !for_overlay {
                    self.control.drag(position.x - self.pointer.x, position.y - self.pointer.y);
                    self.changed();
                }
                self.pointer = *position;
            }
            WindowEvent::MouseWheel { delta, .. } if !for_overlay => {
                self.control.wheel(match delta {
                    MouseScrollDelta::LineDelta(_, y) => f64::from(*y),
                    MouseScrollDelta::PixelDelta(at) => at.y / 40.0,
                });
                self.changed();
            }
            _ => {}
        }
        false
    }

    /// The picture will differ: draw soon, and finely only after a rest.
    fn changed(&mut self) {
        self.last_change = Instant::now();
        self.rested = false;
        self.window.request_redraw();
    }

    fn key(&mut self, event: &KeyEvent) -> bool {
        let (PhysicalKey::Code(code), down) = (event.physical_key, event.state.is_pressed()) else { return false };
        let motion = match code {
            KeyCode::KeyW | KeyCode::ArrowUp => Some(Motion::Forward),
            KeyCode::KeyS | KeyCode::ArrowDown => Some(Motion::Back),
            KeyCode::KeyA | KeyCode::ArrowLeft => Some(Motion::Left),
            KeyCode::KeyD | KeyCode::ArrowRight => Some(Motion::Right),
            KeyCode::KeyE | KeyCode::PageUp => Some(Motion::Up),
            KeyCode::KeyQ | KeyCode::PageDown => Some(Motion::Down),
            _ => None,
        };
        if let Some(motion) = motion {
            if !event.repeat {
                // The time that nothing moved does not count.
                self.last_frame = Instant::now();
                self.control.key(motion, down);
            }
        } else if down && !event.repeat {
            match code {
                KeyCode::Escape => return true,
                KeyCode::Tab => self.control.toggle(),
                KeyCode::F1 => self.settings.help = !self.settings.help,
                KeyCode::KeyP => self.screenshot(),
                code => self.settings.shading = shading(code).unwrap_or(self.settings.shading),
            }
        }
        self.changed();
        false
    }

    fn screenshot(&mut self) {
        let shot = self.shot(1);
        let look = Look { samples: STILL_SAMPLES, shading: self.settings.shading, ..self.look };
        let folder = std::env::current_dir().unwrap_or_default();
        let free = (1..).map(|n| folder.join(format!("insula-{n:04}.png"))).find(|path| !path.exists());
        let path = free.unwrap_or_else(|| folder.join("insula.png"));
        let written = self.session.draw(&shot, &look).and_then(|pixels| write_png(&path, &pixels));
        let text = match written {
            Ok(()) => format!("wrote {}", path.display()),
            Err(error) => format!("no picture: {error}"),
        };
        println!("{text}");
        self.settings.message = Some((text, Instant::now() + MESSAGE_TIME));
    }

    fn shot(&self, divide: u32) -> Shot {
        Shot {
            camera: self.control.camera(),
            heading: self.control.heading(),
            size_px: self.surface.size_px().map(|side| (side / divide).max(1)),
            tau_px: self.settings.tau_px,
        }
    }

    /// How much coarser to draw so that a frame is not slow.
    fn divide(&self) -> u32 {
        let mut divide = 1;
        while divide < DIVIDE_MOST && self.full_time / (divide * divide) > SLOW {
            divide *= 2;
        }
        divide
    }

    /// One frame: move, stream, draw; returns when to draw the next.
    fn frame(&mut self) -> Result<ControlFlow> {
        let begin = Instant::now();
        let secs = begin.duration_since(self.last_frame).as_secs_f64().min(0.2);
        self.last_frame = begin;
        if self.control.advance(secs) {
            self.last_change = begin;
            self.rested = false;
        }
        let restless = begin.duration_since(self.last_change) < REST;
        let divide = if restless || !self.session.settled() { self.divide() } else { 1 };
        // Fewer pixels do not mean that less is fetched: what streams must not depend on how fast pixels come.
        self.session.step(&self.shot(1));
        let shot = self.shot(divide);
        let fine = !restless && divide == 1 && self.session.settled();
        let look = Look { samples: if fine { 2 } else { 1 }, shading: self.settings.shading, ..self.look };
        let data = self.session.frame_data(&shot, &look);
        if let Adapter::Cpu(cpu) = self.session.adapter_mut() {
            let picture = image(&cpu.draw(&data));
            self.picture = Some(self.egui.load_texture("picture", picture, egui::TextureOptions::NEAREST));
        }
        let before = (self.settings.tau_px, self.settings.daylight);
        let (overlay, again) = self.lay_out();
        let shown = self.surface.present(self.session.adapter_mut(), &data, &overlay)?;
        self.frame_time = begin.elapsed();
        self.full_time = if fine { self.frame_time / 4 } else { self.frame_time * (divide * divide) };
        self.session.timed(begin.elapsed());
        self.rested = fine && shown;
        if before.1 != self.settings.daylight {
            self.look = self.settings.daylight.look(Shading::Lit, 1);
        }
        if before != (self.settings.tau_px, self.settings.daylight) {
            self.changed();
        }
        Ok(self.next(again, shown))
    }

    fn lay_out(&mut self) -> (Overlay, Duration) {
        let raw = self.input.take_egui_input(&self.window);
        let status = Status::new(&self.session, self.frame_time, self.control.mode(), self.control.speed_m_per_sec());
        let (settings, picture) = (&mut self.settings, self.picture.as_ref());
        let output = self.egui.run_ui(raw, |ui| {
            if let Some(picture) = picture {
                let whole = egui::Rect::from_min_max(egui::pos2(0.0, 0.0), egui::pos2(1.0, 1.0));
                let layer = ui.ctx().layer_painter(egui::LayerId::background());
                layer.image(picture.id(), ui.ctx().content_rect(), whole, egui::Color32::WHITE);
            }
            overlay::show(ui.ctx(), &status, settings);
        });
        self.input.handle_platform_output(&self.window, output.platform_output);
        let again = output.viewport_output.values().map(|v| v.repaint_delay).min().unwrap_or(Duration::MAX);
        let pixels_per_point = output.pixels_per_point;
        let primitives = self.egui.tessellate(output.shapes, pixels_per_point);
        (Overlay { primitives, textures: output.textures_delta, pixels_per_point }, again)
    }

    fn next(&self, again: Duration, shown: bool) -> ControlFlow {
        let now = Instant::now();
        if !shown {
            return ControlFlow::WaitUntil(now + RETRY);
        }
        let streaming = self.session.streaming_now();
        if self.control.moving() || streaming || again.is_zero() {
            self.window.request_redraw();
            return ControlFlow::Wait;
        }
        let mut wake = now.checked_add(again.min(Duration::from_secs(3600)));
        let mut sooner = |at: Option<Instant>| wake = wake.into_iter().chain(at).min();
        if !self.session.settled() {
            // Arrivals wake the loop; retries have their time.
            sooner(Some(self.session.stream().retry_at().unwrap_or(now + RETRY).max(now + RETRY)));
        } else if !self.rested {
            sooner(Some((self.last_change + REST).max(now)));
        }
        sooner(self.settings.message.as_ref().map(|(_, until)| *until));
        wake.map_or(ControlFlow::Wait, ControlFlow::WaitUntil)
    }
}

fn adapter(surface: &Surface, start: &Start) -> (Adapter, AdapterInfo, u32) {
    let pages = pages_for(start.cache_bytes);
    let software = surface.device().is_software();
    if start.adapter == AdapterChoice::Auto && software {
        eprintln!("note: {} is no graphics hardware, the CPU ray-caster draws instead", surface.device().info().name);
    } else if start.adapter != AdapterChoice::Cpu {
        match GpuAdapter::new(surface.device().clone(), pages) {
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

fn shading(code: KeyCode) -> Option<Shading> {
    let at = match code {
        KeyCode::Digit1 | KeyCode::F2 => 0,
        KeyCode::Digit2 | KeyCode::F3 => 1,
        KeyCode::Digit3 | KeyCode::F4 => 2,
        KeyCode::Digit4 | KeyCode::F5 => 3,
        KeyCode::Digit5 | KeyCode::F6 => 4,
        KeyCode::Digit6 | KeyCode::F7 => 5,
        _ => return None,
    };
    Some(Shading::ALL[at])
}
