//! Connects to a city on a separate thread, again while the server does not respond.

use super::city_chooser::CityPreview;
use crate::error::{ClientError, ListedCity, Result};
use crate::render::OpenedAdapter;
use crate::session::Session;
use insula_protocol::Manifest;
use insula_protocol::text::printable;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};
use winit::event_loop::EventLoopProxy;

/// Pause between two attempts to connect.
const RECONNECT_AFTER: Duration = Duration::from_secs(2);
/// Most previews that are drawn for a choice.
pub(super) const MAX_PREVIEWS: usize = 60;

/// Event from another thread.
pub enum ViewerEvent {
    /// Something arrived from the network.
    Arrived,
    /// An attempt to connect has ended.
    Connected(Box<Result<ConnectedCity>>),
    /// The named city, from which the user may choose, was drawn; `None` if that failed.
    Preview(String, Option<Box<CityPreview>>),
}

/// Opens a session with an adapter. Fails if the adapter has no room for what a proposal adds.
pub type OpenSessionFn = Box<dyn FnOnce(OpenedAdapter) -> Result<Session> + Send>;

/// A city that was connected to.
pub struct ConnectedCity {
    pub manifest: Manifest,
    /// URL for view links; empty if the city has none.
    pub address: String,
    pub open_session: OpenSessionFn,
}

/// Connects to the named city, or to the only one.
pub type ConnectFn = Arc<dyn Fn(Option<&str>) -> Result<ConnectedCity> + Send + Sync>;
/// Draws the named city as a small picture; `None` if that fails.
pub type PreviewFn = Arc<dyn Fn(&str) -> Option<CityPreview> + Send + Sync>;

/// What the window calls on separate threads.
pub struct ConnectFns {
    pub connect: ConnectFn,
    pub preview: PreviewFn,
}

/// What is being done before there is a city: set by the thread that connects, shown by the window.
#[derive(Debug, Clone)]
pub struct StartStatus(Arc<Mutex<String>>);

impl StartStatus {
    /// A status with a first text.
    pub fn new(text: String) -> Self {
        Self(Arc::new(Mutex::new(text)))
    }

    /// Replaces the text.
    pub fn set(&self, text: String) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = text;
    }

    /// The last text.
    pub fn text(&self) -> String {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}

/// Attempts to connect, until there is a city or an error that another attempt cannot heal.
pub(super) struct Connector {
    fns: ConnectFns,
    proxy: EventLoopProxy<ViewerEvent>,
    /// The city that the user chose.
    name: Option<String>,
    /// Error of the last attempt.
    pub(super) error: Option<ClientError>,
    retry_at: Option<Instant>,
    /// Ends the previews.
    has_choice: Arc<AtomicBool>,
}

impl Connector {
    pub(super) fn new(fns: ConnectFns, proxy: EventLoopProxy<ViewerEvent>) -> Self {
        Self { fns, proxy, name: None, error: None, retry_at: None, has_choice: Arc::default() }
    }

    /// Starts an attempt on a separate thread.
    pub(super) fn start(&mut self) {
        self.retry_at = None;
        let (connect, proxy, name) = (self.fns.connect.clone(), self.proxy.clone(), self.name.clone());
        std::thread::spawn(move || {
            // Sending fails only after the event loop has ended.
            let _ = proxy.send_event(ViewerEvent::Connected(Box::new(connect(name.as_deref()))));
        });
    }

    /// Connects again to the same city, when called.
    pub(super) fn connect_again(&self) -> impl Fn() -> Result<ConnectedCity> + Send + Sync + 'static {
        let (connect, name) = (self.fns.connect.clone(), self.name.clone());
        move || connect(name.as_deref())
    }

    /// Connects to the city that the user chose.
    pub(super) fn choose(&mut self, name: String) {
        self.has_choice.store(true, Ordering::Relaxed);
        (self.name, self.error) = (Some(name), None);
        self.start();
    }

    /// Takes the error of an attempt, and prints it unless it was printed before.
    pub(super) fn failed(&mut self, error: ClientError) {
        let is_known = self.error.as_ref().is_some_and(|known| known.to_string() == error.to_string());
        if !is_known {
            eprintln!("not connected: {}", printable(&error.to_string()));
        }
        self.retry_at = error.is_temporary().then(|| Instant::now() + RECONNECT_AFTER);
        self.error = Some(error);
    }

    /// Starts another attempt if one is due.
    pub(super) fn poll(&mut self) {
        if self.retry_at.is_some_and(|at| at <= Instant::now()) {
            self.start();
        }
    }

    /// Draws the cities one after another on a separate thread, until the user has chosen one.
    pub(super) fn draw_previews(&self, cities: &[ListedCity]) {
        let names: Vec<String> = cities.iter().take(MAX_PREVIEWS).map(|city| city.name.clone()).collect();
        let (preview, proxy) = (self.fns.preview.clone(), self.proxy.clone());
        let has_choice = self.has_choice.clone();
        std::thread::spawn(move || {
            for name in names {
                if has_choice.load(Ordering::Relaxed) {
                    return;
                }
                let drawn = preview(&name).map(Box::new);
                if proxy.send_event(ViewerEvent::Preview(name, drawn)).is_err() {
                    return;
                }
            }
        });
    }
}
