//! The event loop of the window.
//!
//! The window opens at once. While there is no city, it shows the reason, tries to connect again, or offers the cities of the
//! server. Frames are drawn only when something changes; otherwise the loop sleeps.

use super::city_chooser::CityChooser;
use super::city_view::{CityView, CityViewSetup};
use super::connector::{ConnectFns, ConnectedCity, Connector, MAX_PREVIEWS, StartStatus, ViewerEvent};
use super::key_bindings::{self, KeyAction};
use super::overlay::{self, StartNotice};
use super::path_playback::PathPlayback;
use super::settings::{UserSettings, is_window_size};
use super::touchpad::{GestureMotion, motion_of};
use super::viewport::Viewport;
use super::window::ViewerWindow;
use crate::camera_files::PlacedCamera;
use crate::error::{ClientError, Result};
use crate::render::AdapterChoice;
use insula_protocol::text::printable;
use insula_viewer::interaction::camera_control::MoveDirection;
use insula_viewer::sun::{Daylight, SunOptions, parse_time};
use insula_viewer::switching::SwitchDistances;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};
use winit::application::ApplicationHandler;
use winit::dpi::PhysicalPosition;
use winit::event::{ElementState, KeyEvent, MouseButton, StartCause, WindowEvent};
use winit::event_loop::{ActiveEventLoop, ControlFlow, EventLoop};
use winit::keyboard::PhysicalKey;
use winit::window::WindowId;

/// Two clicks within this time are a double click.
const DOUBLE_CLICK: Duration = Duration::from_millis(400);
/// Interval of frames while there is no city.
const NOTICE_INTERVAL: Duration = Duration::from_millis(100);
/// A mouse button that is released within this distance, in pixels, was clicked rather than dragged.
const CLICK_PX: f64 = 4.0;

/// Initial state of the window. `None` takes the user's settings.
pub struct WindowOptions {
    /// What is done before there is a city.
    pub status: StartStatus,
    /// Initial camera; one that overlooks the whole city if `None`.
    pub camera: Option<PlacedCamera>,
    /// The object that is selected at first.
    pub object: Option<u32>,
    pub sun: SunOptions,
    /// Tolerated screen-space error.
    pub tau_px: Option<f64>,
    /// What decides about levels of detail instead.
    pub switching: Option<SwitchDistances>,
    /// Frames a second while the view moves.
    pub fps: f64,
    pub adapter: AdapterChoice,
    pub cache_bytes: u64,
    /// Whether saved images name the city's sources in a corner.
    pub has_captions: bool,
    pub playback: Option<PathPlayback>,
}

/// Creates the event loop. Connections need it first, because they wake it. Fails if there is no screen.
pub fn event_loop() -> Result<EventLoop<ViewerEvent>> {
    EventLoop::with_user_event().build().map_err(|e| {
        tracing::debug!("no event loop: {e}");
        ClientError::Graphics("no window can be opened, there is no screen: set DISPLAY, or use insula snapshot".into())
    })
}

/// Runs until the window is closed. Fails if no window can be opened, or if the ray-caster fails.
pub fn run(event_loop: EventLoop<ViewerEvent>, options: WindowOptions, connect: ConnectFns) -> Result<()> {
    event_loop.set_control_flow(ControlFlow::Wait);
    let settings_path = UserSettings::path();
    let (settings, note) = settings_path.as_deref().map(UserSettings::load).unwrap_or_default();
    if let Some(note) = &note {
        eprintln!("note: {}", printable(note));
    }
    let mut app = ViewerApp {
        connector: Connector::new(connect, event_loop.create_proxy()),
        chooser: None,
        options,
        settings,
        settings_path,
        settings_note: note,
        window: None,
        viewport: None,
        drag_px: None,
        pointer: PhysicalPosition::default(),
        is_ctrl_down: false,
        last_click: None,
        fatal_error: None,
    };
    let ended = event_loop.run_app(&mut app);
    app.store_settings();
    // A choice that is closed is no failure.
    let unconnected = app.connector.error.filter(|_| app.chooser.is_none());
    match (app.fatal_error.or(unconnected), ended) {
        (Some(error), _) => Err(error),
        (None, Err(error)) => Err(ClientError::Graphics(format!("the window system ended the program: {error}"))),
        (None, Ok(())) => Ok(()),
    }
}

/// What the user asked for before there is a city.
enum StartAction {
    Choose(String),
    TryAgain,
}

struct ViewerApp {
    options: WindowOptions,
    connector: Connector,
    /// The cities of the server, while the user is to choose one.
    chooser: Option<CityChooser>,
    settings: UserSettings,
    settings_path: Option<PathBuf>,
    /// Why the settings could not be loaded, until it is shown.
    settings_note: Option<String>,
    window: Option<ViewerWindow>,
    viewport: Option<Box<Viewport>>,
    /// How far the mouse was dragged, while a button is held over the frame.
    drag_px: Option<f64>,
    pointer: PhysicalPosition<f64>,
    is_ctrl_down: bool,
    /// When and where the mouse was clicked last.
    last_click: Option<(Instant, PhysicalPosition<f64>)>,
    /// Why the event loop ended early.
    fatal_error: Option<ClientError>,
}

impl ApplicationHandler<ViewerEvent> for ViewerApp {
    fn resumed(&mut self, event_loop: &ActiveEventLoop) {
        if self.window.is_some() {
            return;
        }
        let adapter = (self.options.adapter, self.options.cache_bytes);
        match ViewerWindow::new(event_loop, "Insula", self.settings.window, adapter) {
            Ok(window) => {
                if self.settings.full_screen {
                    window.set_full_screen(true);
                }
                window.window.request_redraw();
                self.window = Some(window);
                self.connector.start();
            }
            Err(error) => self.fail(event_loop, error),
        }
    }

    fn user_event(&mut self, event_loop: &ActiveEventLoop, event: ViewerEvent) {
        match event {
            ViewerEvent::Arrived => {
                if let Some(viewport) = &mut self.viewport
                    && !viewport.notice_arrival()
                {
                    // Input of the user is handled first.
                    event_loop.set_control_flow(ControlFlow::WaitUntil(Instant::now()));
                    return;
                }
            }
            ViewerEvent::Connected(outcome) => match *outcome {
                Ok(city) => {
                    if let Err(error) = self.open_city(city) {
                        return self.fail(event_loop, error);
                    }
                }
                Err(error) => self.not_connected(error),
            },
            ViewerEvent::Preview(name, preview) => {
                if let (Some(chooser), Some(window)) = (&mut self.chooser, &self.window) {
                    chooser.add_preview(&window.egui, &name, preview.as_deref());
                }
            }
        }
        if let Some(window) = &self.window {
            window.window.request_redraw();
        }
    }

    fn new_events(&mut self, event_loop: &ActiveEventLoop, cause: StartCause) {
        if matches!(cause, StartCause::ResumeTimeReached { .. })
            && !self.go_on(event_loop)
            && let Some(window) = &self.window
        {
            window.window.request_redraw();
        }
    }

    fn window_event(&mut self, event_loop: &ActiveEventLoop, _: WindowId, event: WindowEvent) {
        match event {
            WindowEvent::CloseRequested => event_loop.exit(),
            WindowEvent::Destroyed => self.close(event_loop),
            // The window system may destroy the window meanwhile: winit panics if it is asked for such a one, and its surface fails.
            WindowEvent::RedrawRequested => match catch_unwind(AssertUnwindSafe(|| self.frame())) {
                Ok(Ok(Some(flow))) => event_loop.set_control_flow(flow),
                Ok(Ok(None)) => event_loop.exit(),
                _ if self.window.as_ref().is_some_and(ViewerWindow::is_destroyed) => self.close(event_loop),
                Ok(Err(error)) => self.fail(event_loop, error),
                Err(panic) => resume_unwind(panic),
            },
            event => {
                if self.handle_input(&event) {
                    event_loop.exit();
                }
            }
        }
    }
}

impl ViewerApp {
    /// Ends without the window, whose size and surface cannot be asked for any more.
    fn close(&mut self, event_loop: &ActiveEventLoop) {
        (self.window, self.viewport) = (None, None);
        event_loop.exit();
    }

    fn fail(&mut self, event_loop: &ActiveEventLoop, error: ClientError) {
        self.fatal_error = Some(error);
        event_loop.exit();
    }

    /// Goes on with the final frame or with the idle prefetch, if the view rests. Returns `false` if a frame is due instead.
    fn go_on(&mut self, event_loop: &ActiveEventLoop) -> bool {
        let (Some(window), Some(viewport)) = (&mut self.window, &mut self.viewport) else { return false };
        if viewport.is_drawing() {
            let next = viewport.draw_further(window);
            next.into_iter().for_each(|flow| event_loop.set_control_flow(flow));
            return next.is_some();
        }
        if !viewport.may_prefetch() {
            return false;
        }
        match viewport.prefetch(window) {
            Ok(Some(flow)) => event_loop.set_control_flow(flow),
            Ok(None) => return false,
            Err(error) => self.fail(event_loop, error),
        }
        true
    }

    fn not_connected(&mut self, error: ClientError) {
        if let ClientError::SeveralCities { base, cities } = &error {
            self.connector.draw_previews(cities);
            self.chooser = Some(CityChooser::new(base.clone(), cities, MAX_PREVIEWS));
        }
        self.connector.failed(error);
    }

    /// Fails if no session can be opened, or if the initial camera is not in the city.
    fn open_city(&mut self, city: ConnectedCity) -> Result<()> {
        let Some(window) = &mut self.window else { return Ok(()) };
        self.connector.error = None;
        let camera = self.options.camera.map(|camera| camera.in_city(&city.manifest)).transpose()?;
        let mut sun = self.options.sun;
        if sun.time.is_none() && sun.bearing.is_none() {
            sun.time = self.settings.time.as_deref().and_then(|text| parse_time(text).ok());
        }
        sun.shadows = sun.shadows.or(Some(self.settings.shadows));
        let [width, height] = window.surface.size_px().map(f64::from);
        window.window.set_title(&format!("{} - Insula", printable(&city.manifest.title)));
        let setup = CityViewSetup {
            daylight: Daylight::new(&sun, &city.manifest),
            session: (city.open_session)(window.take_adapter())?,
            address: city.address,
            camera: camera.map(|(_, camera)| camera),
            tau_px: self.options.tau_px.unwrap_or(self.settings.tau_px),
            switching: self.options.switching,
            fps: self.options.fps,
            has_captions: self.options.has_captions,
            playback: self.options.playback.take(),
            open_again: Arc::new({
                let connect = self.connector.connect_again();
                move |adapter| (connect()?.open_session)(adapter)
            }),
            cache_bytes: self.options.cache_bytes,
        };
        let mut view = CityView::new(setup, &self.settings, width / height.max(1.0));
        if let Some(id) = self.options.object {
            view.select_object(Some(id), false);
            if camera.is_none() {
                view.objects.go_to_when_known(id);
            }
        }
        if let Some(note) = self.settings_note.take() {
            view.show_message(note);
        }
        self.viewport = Some(Box::new(Viewport::new(view)));
        Ok(())
    }

    /// Writes the settings. A failure is only reported.
    fn store_settings(&mut self) {
        if let Some(window) = &self.window {
            self.settings.full_screen = window.is_full_screen();
            let size = window.size();
            if !self.settings.full_screen && is_window_size(size) {
                self.settings.window = size;
            }
        }
        if let Some(path) = &self.settings_path
            && let Err(error) = self.settings.store(path)
        {
            eprintln!("note: the settings are not saved: {}", printable(&error.to_string()));
        }
    }

    /// Draws a frame. Returns when to draw the next one, or `None` after the end of a playback.
    fn frame(&mut self) -> Result<Option<ControlFlow>> {
        let Some(window) = &mut self.window else { return Ok(Some(ControlFlow::Wait)) };
        if let Some(viewport) = &mut self.viewport {
            let flow = viewport.frame(window, &mut self.settings)?;
            if std::mem::take(&mut viewport.city.must_store_settings) {
                self.store_settings();
            }
            return Ok(flow);
        }
        self.connector.poll();
        let mut action = None;
        let notice = match &self.connector.error {
            Some(error) if error.is_temporary() => StartNotice::Retrying(format!("{error}\nretrying")),
            Some(error) => StartNotice::Failed(error.to_string()),
            None => StartNotice::Busy(self.options.status.text()),
        };
        let chooser = &self.chooser;
        let mut layout = window.lay_out(|ctx| {
            action = match chooser {
                Some(chooser) => chooser.show(ctx).map(StartAction::Choose),
                None => overlay::start_notice(ctx, &notice).then_some(StartAction::TryAgain),
            }
            .or(action.take());
        });
        window.surface.present(None, &mut layout.shapes)?;
        match action {
            Some(StartAction::Choose(name)) => {
                self.chooser = None;
                self.connector.choose(name);
            }
            Some(StartAction::TryAgain) => {
                self.connector.error = None;
                self.connector.start();
            }
            None => {}
        }
        Ok(Some(ControlFlow::WaitUntil(Instant::now() + NOTICE_INTERVAL)))
    }

    /// Handles any event but redrawing. Returns whether to quit.
    fn handle_input(&mut self, event: &WindowEvent) -> bool {
        let Some(window) = &mut self.window else { return false };
        // When a window gains focus, keys that are down are reported beside their own events. They would count twice.
        if matches!(event, WindowEvent::KeyboardInput { is_synthetic: true, .. }) {
            return false;
        }
        if let WindowEvent::ModifiersChanged(modifiers) = event {
            self.is_ctrl_down = modifiers.state().control_key();
        }
        let is_typing = window.egui.egui_wants_keyboard_input();
        if let WindowEvent::KeyboardInput { event: key, .. } = event
            && !is_typing
        {
            return self.handle_key(key);
        }
        let is_for_overlay = window.handle_event(event);
        let Some(viewport) = &mut self.viewport else { return false };
        let city = &mut viewport.city;
        match event {
            WindowEvent::KeyboardInput { .. } | WindowEvent::Focused(false) => {
                city.control.release_keys();
                self.drag_px = None;
            }
            WindowEvent::Resized(_) | WindowEvent::ScaleFactorChanged { .. } | WindowEvent::Occluded(false) => {
                window.window.request_redraw();
            }
            WindowEvent::ModifiersChanged(modifiers) => {
                city.is_shift_down = modifiers.state().shift_key();
                city.control.set_fast(city.is_shift_down);
            }
            WindowEvent::MouseInput { state, button: MouseButton::Left | MouseButton::Right, .. } => {
                self.handle_button(*state);
            }
            WindowEvent::CursorMoved { position, .. } => self.handle_motion(*position),
            WindowEvent::CursorLeft { .. } => city.readout.pointer_moved(None),
            event => {
                if let Some(motion) = motion_of(event).filter(|_| !is_for_overlay) {
                    perform_gesture(city, motion, window);
                }
            }
        }
        false
    }

    fn handle_button(&mut self, state: ElementState) {
        let (Some(window), Some(viewport)) = (&self.window, &mut self.viewport) else { return };
        let moved_px = self.drag_px.take();
        if state == ElementState::Pressed {
            self.drag_px = (!window.is_over_panel(self.pointer)).then_some(0.0);
        } else if moved_px.is_some_and(|px| px < CLICK_PX) {
            let [width, height] = window.surface.size_px().map(f64::from);
            let at = [self.pointer.x / width, self.pointer.y / height];
            let is_near = |other: PhysicalPosition<f64>| {
                (other.x - self.pointer.x).abs() + (other.y - self.pointer.y).abs() < CLICK_PX
            };
            let now = Instant::now();
            let last = self.last_click.take().filter(|(time, place)| now - *time < DOUBLE_CLICK && is_near(*place));
            match last {
                Some(_) => viewport.city.double_click(at, window),
                None => {
                    self.last_click = Some((now, self.pointer));
                    viewport.city.click(at, window);
                }
            }
        }
    }

    fn handle_motion(&mut self, position: PhysicalPosition<f64>) {
        let (Some(window), Some(viewport)) = (&self.window, &mut self.viewport) else { return };
        let (dx, dy) = (position.x - self.pointer.x, position.y - self.pointer.y);
        if let Some(drag_px) = &mut self.drag_px {
            *drag_px += dx.abs() + dy.abs();
            viewport.city.control.drag(dx, dy);
            window.window.request_redraw();
        }
        self.pointer = position;
        let [width, height] = window.surface.size_px().map(f64::from);
        viewport.city.readout.pointer_moved(Some([position.x / width, position.y / height]));
    }

    /// Handles a key that is not typed into a field. Returns whether to quit.
    fn handle_key(&mut self, event: &KeyEvent) -> bool {
        let Some(window) = &self.window else { return false };
        let (PhysicalKey::Code(code), is_pressed) = (event.physical_key, event.state.is_pressed()) else {
            return false;
        };
        let is_ctrl_down = self.is_ctrl_down && is_pressed;
        let code = key_bindings::code_of(code, &event.logical_key, is_ctrl_down);
        let Some(action) = key_bindings::action_of(code, is_ctrl_down) else { return false };
        if event.repeat {
            return false;
        }
        if let (KeyAction::Move(direction), Some(viewport)) = (action, &mut self.viewport) {
            hold_key(&mut viewport.city, direction, is_pressed, window);
        }
        match action {
            _ if !is_pressed => {}
            KeyAction::Quit => return true,
            KeyAction::EndInnermost => {
                let has_ended = self.viewport.as_mut().is_some_and(|viewport| viewport.city.end_innermost());
                if !has_ended && window.is_full_screen() {
                    window.set_full_screen(false);
                }
                window.window.request_redraw();
            }
            KeyAction::ToggleFullScreen => window.set_full_screen(!window.is_full_screen()),
            action => {
                if let Some(viewport) = &mut self.viewport {
                    viewport.city.perform(action, window, &mut self.settings);
                    window.window.request_redraw();
                }
            }
        }
        false
    }
}

fn hold_key(city: &mut CityView, direction: MoveDirection, is_pressed: bool, window: &ViewerWindow) {
    city.control.set_held(direction, is_pressed, Instant::now());
    window.window.request_redraw();
}

fn perform_gesture(city: &mut CityView, motion: GestureMotion, window: &ViewerWindow) {
    match motion {
        GestureMotion::Wheel(steps) => city.control.turn_wheel(steps),
        GestureMotion::Drag(dx_px, dy_px) => city.control.drag(dx_px, dy_px),
        GestureMotion::Approach(factor) => city.control.zoom(factor),
        GestureMotion::Turn(angle_rad) => city.control.turn(angle_rad),
    }
    window.window.request_redraw();
}
