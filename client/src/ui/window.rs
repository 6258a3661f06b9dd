//! The window's event loop.
//!
//! In: winit's events, a way to connect. Out: frames, settings. Next: `city`, or a page that says what one waits for.
//!
//! The window opens at once and stays: while there is no city it says why and tries again. A frame is drawn when something
//! moves, arrives or is asked for; else the loop sleeps.

use super::{
    city::{City, Opening},
    control::Motion,
    keys::{self, Order},
    overlay,
    settings::Settings,
    shell::Shell,
    tour::Tour,
};
use crate::{
    error::{ClientError, Result},
    render::{Adapter, AdapterChoice, AdapterInfo},
    session::Session,
};
use insula_protocol::Manifest;
use insula_viewer::{
    camera::Camera,
    sun::{Daylight, SunOptions, parse_time},
};
use std::{
    path::PathBuf,
    sync::Arc,
    time::{Duration, Instant},
};
use winit::{
    application::ApplicationHandler,
    dpi::PhysicalPosition,
    event::{ElementState, KeyEvent, MouseButton, MouseScrollDelta, StartCause, WindowEvent},
    event_loop::{ActiveEventLoop, ControlFlow, EventLoop, EventLoopProxy},
    keyboard::PhysicalKey,
    window::WindowId,
};

/// Between two attempts to connect.
const AGAIN: Duration = Duration::from_secs(2);
/// A mouse that moved less than this between down and up has clicked, in pixels.
const CLICK_PX: f64 = 4.0;

/// What wakes the loop.
pub enum Event {
    /// Something arrived from the network.
    Arrived,
    /// An attempt to connect has ended.
    Connected(Box<Result<Found>>),
}

/// Makes a session once it is known what draws.
pub type MakeSession = Box<dyn FnOnce((Adapter, AdapterInfo, u32)) -> Session + Send>;

/// A city that was connected to.
pub struct Found {
    /// What it is.
    pub manifest: Manifest,
    /// Its address for links; empty if it has none.
    pub address: String,
    /// The rest.
    pub make: MakeSession,
}

/// Connects, on a thread of its own.
pub type Connect = Arc<dyn Fn() -> Result<Found> + Send + Sync>;

/// How the window begins.
pub struct Start {
    /// What is connected to, for people.
    pub address: String,
    /// Where it looks from; the whole city unless given.
    pub camera: Option<Camera>,
    /// The light, if it was asked for.
    pub sun: SunOptions,
    /// Tolerated error, if it was asked for.
    pub tau_px: Option<f64>,
    /// `--adapter`.
    pub adapter: AdapterChoice,
    /// Size of the cache.
    pub cache_bytes: u64,
    /// A flight that flies itself.
    pub tour: Option<Tour>,
}

/// An event loop, before anything is connected to (that needs the loop to wake it).
pub fn event_loop() -> Result<EventLoop<Event>> {
    EventLoop::with_user_event().build().map_err(|e| {
        tracing::debug!("no event loop: {e}");
        ClientError::Graphics("no window can be opened, there is no screen: set DISPLAY, or use insula snapshot".into())
    })
}

/// Runs until the window is closed.
pub fn run(event_loop: EventLoop<Event>, start: Start, connect: Connect) -> Result<()> {
    event_loop.set_control_flow(ControlFlow::Wait);
    let settings_at = Settings::path();
    let (settings, note) = settings_at.as_deref().map(Settings::load).unwrap_or_default();
    if let Some(note) = &note {
        eprintln!("note: {note}");
    }
    let mut app = App {
        start,
        connect,
        proxy: event_loop.create_proxy(),
        settings,
        settings_at,
        note,
        shell: None,
        waiting: Waiting::default(),
        city: None,
        drag: None,
        pointer: PhysicalPosition::default(),
        failed: None,
    };
    let ended = event_loop.run_app(&mut app);
    app.store();
    match (app.failed, ended) {
        (Some(error), _) => Err(error),
        (None, Err(error)) => Err(ClientError::Graphics(format!("the window system ended the program: {error}"))),
        (None, Ok(())) => Ok(()),
    }
}

/// While there is no city.
#[derive(Debug, Default)]
struct Waiting {
    wrong: Option<String>,
    again_at: Option<Instant>,
}

struct App {
    start: Start,
    connect: Connect,
    proxy: EventLoopProxy<Event>,
    settings: Settings,
    settings_at: Option<PathBuf>,
    /// What was wrong with the settings, until it was told.
    note: Option<String>,
    shell: Option<Shell>,
    waiting: Waiting,
    city: Option<Box<City>>,
    /// A mouse button is down over the picture, and how far it moved.
    drag: Option<f64>,
    pointer: PhysicalPosition<f64>,
    failed: Option<ClientError>,
}

impl ApplicationHandler<Event> for App {
    fn resumed(&mut self, event_loop: &ActiveEventLoop) {
        if self.shell.is_some() {
            return;
        }
        match Shell::new(event_loop, "Insula", self.settings.window, self.start.cache_bytes) {
            Ok(shell) => {
                if self.settings.full_screen {
                    shell.set_full_screen(true);
                }
                shell.window.request_redraw();
                self.shell = Some(shell);
                self.connect();
            }
            Err(error) => self.fail(event_loop, error),
        }
    }

    fn user_event(&mut self, event_loop: &ActiveEventLoop, event: Event) {
        match event {
            Event::Arrived => {
                if let Some(city) = &mut self.city {
                    if city.rests() {
                        // It may be for what lies beside the picture: first things that people do.
                        city.news = true;
                        event_loop.set_control_flow(ControlFlow::WaitUntil(Instant::now()));
                        return;
                    }
                    city.pace.stir();
                }
            }
            Event::Connected(outcome) => self.connected(*outcome),
        }
        if let Some(shell) = &self.shell {
            shell.window.request_redraw();
        }
    }

    fn new_events(&mut self, event_loop: &ActiveEventLoop, cause: StartCause) {
        if matches!(cause, StartCause::ResumeTimeReached { .. })
            && !self.look_around(event_loop)
            && let Some(shell) = &self.shell
        {
            shell.window.request_redraw();
        }
    }

    fn window_event(&mut self, event_loop: &ActiveEventLoop, _: WindowId, event: WindowEvent) {
        match event {
            WindowEvent::CloseRequested => event_loop.exit(),
            WindowEvent::RedrawRequested => match self.frame() {
                Ok(Some(flow)) => event_loop.set_control_flow(flow),
                Ok(None) => event_loop.exit(),
                Err(error) => self.fail(event_loop, error),
            },
            event => {
                if self.event(&event) {
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

    /// Looks beside the picture, if there is time for that; whether no frame is due.
    fn look_around(&mut self, event_loop: &ActiveEventLoop) -> bool {
        let (Some(shell), Some(city)) = (&self.shell, &mut self.city) else { return false };
        if !city.may_look_around() {
            return false;
        }
        match city.look_around(shell) {
            Ok(Some(flow)) => event_loop.set_control_flow(flow),
            Ok(None) => return false,
            Err(error) => self.fail(event_loop, error),
        }
        true
    }

    /// Tries to connect, on a thread of its own.
    fn connect(&mut self) {
        tracing::info!("connecting: {}", self.start.address);
        self.waiting.again_at = None;
        let (connect, proxy) = (self.connect.clone(), self.proxy.clone());
        std::thread::spawn(move || {
            // A closed loop needs no answer.
            let _ = proxy.send_event(Event::Connected(Box::new(connect())));
        });
    }

    fn connected(&mut self, outcome: Result<Found>) {
        match (outcome, &self.shell) {
            (Ok(found), Some(shell)) => {
                let mut asked = self.start.sun;
                if asked.time.is_none() && asked.bearing.is_none() {
                    asked.time = self.settings.time.as_deref().and_then(|text| parse_time(text).ok());
                }
                asked.shadows = asked.shadows.or(Some(self.settings.shadows));
                let [width, height] = shell.surface.size_px().map(f64::from);
                shell.window.set_title(&format!("{} - Insula", found.manifest.title));
                let opening = Opening {
                    daylight: Daylight::new(&asked, &found.manifest),
                    session: (found.make)(shell.adapter(self.start.adapter, self.start.cache_bytes)),
                    address: found.address,
                    camera: self.start.camera,
                    tau_px: self.start.tau_px.unwrap_or(self.settings.tau_px),
                    tour: self.start.tour.take(),
                };
                let mut city = City::new(opening, &self.settings, width / height.max(1.0));
                if let Some(note) = self.note.take() {
                    city.tell(note);
                }
                self.city = Some(Box::new(city));
            }
            (Err(error), _) => {
                tracing::info!("not connected: {error}");
                self.waiting = Waiting { wrong: Some(error.to_string()), again_at: Some(Instant::now() + AGAIN) };
            }
            (Ok(_), None) => {}
        }
    }

    /// Writes the settings; what stands in the way is told.
    fn store(&mut self) {
        if let Some(shell) = &self.shell {
            self.settings.full_screen = shell.is_full_screen();
            let size = shell.size();
            if !self.settings.full_screen && size.iter().all(|side| (100..=16_384).contains(side)) {
                self.settings.window = size;
            }
        }
        if let Some(path) = &self.settings_at
            && let Err(error) = self.settings.store(path)
        {
            eprintln!("note: the settings are not kept: {error}");
        }
    }

    fn frame(&mut self) -> Result<Option<ControlFlow>> {
        let Some(shell) = &mut self.shell else { return Ok(Some(ControlFlow::Wait)) };
        if let Some(city) = &mut self.city {
            let flow = city.frame(shell, &mut self.settings)?;
            if std::mem::take(&mut city.store) {
                self.store();
            }
            return Ok(flow);
        }
        if self.waiting.again_at.is_some_and(|at| at <= Instant::now()) {
            self.connect();
        }
        let text = match &self.waiting.wrong {
            Some(wrong) => format!("{wrong}\ntrying again"),
            None => format!("connecting to {}", self.start.address),
        };
        let bad = self.waiting.wrong.is_some();
        if let Some(shell) = &mut self.shell {
            let (overlay, _) = shell.lay_out(|ctx| overlay::notice(ctx, &text, bad));
            shell.surface.present(None, &overlay)?;
        }
        Ok(Some(ControlFlow::WaitUntil(Instant::now() + Duration::from_millis(100))))
    }

    /// Handles anything but redrawing; returns whether to quit.
    fn event(&mut self, event: &WindowEvent) -> bool {
        let Some(shell) = &mut self.shell else { return false };
        let typing = shell.egui.egui_wants_keyboard_input();
        if let WindowEvent::KeyboardInput { event: key, .. } = event
            && !typing
        {
            return self.key(key);
        }
        let for_overlay = shell.event(event);
        let Some(city) = &mut self.city else { return false };
        match event {
            WindowEvent::KeyboardInput { .. } | WindowEvent::Focused(false) => {
                city.control.release();
                self.drag = None;
            }
            WindowEvent::Resized(_) | WindowEvent::ScaleFactorChanged { .. } | WindowEvent::Occluded(false) => {
                city.changed(shell);
            }
            WindowEvent::ModifiersChanged(modifiers) => city.control.fast(modifiers.state().shift_key()),
            WindowEvent::MouseInput { state, button: MouseButton::Left | MouseButton::Right, .. } => {
                let moved_px = self.drag.take();
                if *state == ElementState::Pressed {
                    self.drag = (!for_overlay).then_some(0.0);
                } else if moved_px.is_some_and(|px| px < CLICK_PX) {
                    let [width, height] = shell.surface.size_px().map(f64::from);
                    city.click(self.pointer.x / width, self.pointer.y / height, shell);
                }
            }
            WindowEvent::CursorMoved { position, .. } => {
                let (dx, dy) = (position.x - self.pointer.x, position.y - self.pointer.y);
                if let Some(moved_px) = &mut self.drag {
                    *moved_px += dx.abs() + dy.abs();
                    city.control.drag(dx, dy);
                    city.changed(shell);
                }
                self.pointer = *position;
            }
            WindowEvent::MouseWheel { delta, .. } if !for_overlay => {
                city.control.wheel(match delta {
                    MouseScrollDelta::LineDelta(_, y) => f64::from(*y),
                    MouseScrollDelta::PixelDelta(at) => at.y / 40.0,
                });
                city.changed(shell);
            }
            _ => {}
        }
        false
    }

    /// A key that is not typed into a field; returns whether to quit.
    fn key(&mut self, event: &KeyEvent) -> bool {
        let Some(shell) = &self.shell else { return false };
        let (PhysicalKey::Code(code), down) = (event.physical_key, event.state.is_pressed()) else { return false };
        let order = keys::order(code);
        if let (Some(Order::Move(motion)), Some(city), false) = (order, &mut self.city, event.repeat) {
            hold(city, motion, down, shell);
        }
        match order {
            Some(order) if down && !event.repeat => match order {
                Order::Quit => return true,
                Order::FullScreen => shell.set_full_screen(!shell.is_full_screen()),
                order => {
                    if let Some(city) = &mut self.city {
                        city.order(order, shell, &mut self.settings);
                        city.changed(shell);
                    }
                }
            },
            _ => {}
        }
        false
    }
}

fn hold(city: &mut City, motion: Motion, down: bool, shell: &Shell) {
    city.pace.restart(Instant::now());
    city.control.key(motion, down);
    city.changed(shell);
}
