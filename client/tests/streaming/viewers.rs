//! Clients of the test server, drawn by the CPU ray-caster.

use super::{fixture_city::ORIGIN, test_server::TestServer};
use glam::DVec3;
use insula_client::{
    args::GlobalArgs,
    commands::connect::connect,
    render::{Adapter, AdapterChoice, OpenedAdapter},
    session::Session,
    stream::{
        BackgroundFetcher,
        fetch::{Http, HttpOptions},
    },
};
use insula_viewer::{
    camera::Camera,
    frame::RenderSettings,
    scene::SceneTree,
    streamer::{Downloads, FrameRequest, Streamer},
};
use std::{
    sync::Arc,
    time::{Duration, Instant},
};

/// Size of the frames.
pub(crate) const WIDTH_PX: usize = 160;
const HEIGHT_PX: usize = 90;
/// Index of the pixel in the middle of a frame.
pub(crate) const CENTRE: usize = HEIGHT_PX / 2 * WIDTH_PX + WIDTH_PX / 2;
/// Longest time that a frame may take to settle.
pub(crate) const TIMEOUT: Duration = Duration::from_secs(60);

pub(crate) fn global_args() -> GlobalArgs {
    GlobalArgs {
        adapter: AdapterChoice::Cpu,
        cache_mib: 256,
        no_meshes: false,
        disk_cache_mib: None,
        city: None,
        tau: 1.0,
        timeout: 5,
        follow_redirects: false,
    }
}

/// A frame from `position` to `target`, in metres from the city's corner.
pub(crate) fn request(position: [f64; 3], target: [f64; 3]) -> FrameRequest {
    let origin = DVec3::from(ORIGIN);
    let camera = Camera::look_at(origin + DVec3::from(position), origin + DVec3::from(target), DVec3::Z, 1.0).unwrap();
    FrameRequest { camera, heading: None, size_px: [WIDTH_PX as u32, HEIGHT_PX as u32], tau_px: 1.0, switching: None }
}

/// A view along a street.
pub(crate) fn street() -> FrameRequest {
    request([31.0, -20.0, 15.0], [31.0, 200.0, 5.0])
}

/// The `step`-th position of a camera that moves sideways along the city's edge, `step_m` metres each.
pub(crate) fn sideways(step: u32, step_m: f64) -> FrameRequest {
    let x = step_m * f64::from(step);
    request([x, -20.0, 30.0], [x, 100.0, 0.0])
}

pub(crate) fn open_session(server: &TestServer, cache_mib: u64) -> Session {
    open_session_with(server, cache_mib, HttpOptions::default())
}

pub(crate) fn open_session_with(server: &TestServer, cache_mib: u64, options: HttpOptions) -> Session {
    let (tree, downloads, opened) = connect_to(server, cache_mib, options);
    Session::new(tree, downloads, opened, Instant::now())
}

fn connect_to(
    server: &TestServer,
    cache_mib: u64,
    options: HttpOptions,
) -> (SceneTree, Downloads<BackgroundFetcher>, OpenedAdapter) {
    let http = Arc::new(Http::with_options(None, options).unwrap());
    let city = connect(&http, &server.url, &global_args()).unwrap();
    let downloads = BackgroundFetcher::downloads(http, city.source, 12, None);
    (SceneTree::new(city.manifest), downloads, Adapter::headless(AdapterChoice::Cpu, cache_mib << 20).unwrap())
}

/// Updates a session until its frame is settled, without drawing. `each` sees every frame.
pub(crate) fn settle(session: &mut Session, request: &FrameRequest, mut each: impl FnMut(&Session)) {
    let begin = Instant::now();
    loop {
        session.update(request);
        each(session);
        if session.is_settled() {
            return;
        }
        assert!(begin.elapsed() < TIMEOUT, "{:?}", session.selection());
        session.wait(Duration::from_millis(2));
    }
}

/// Draws every frame until it is settled. Each must cover all of the ground. Returns the colours of the last frame.
pub(crate) fn draw_until_settled(session: &mut Session) -> Vec<u32> {
    draw_each_until_settled(session, |_| {})
}

/// Like [`draw_until_settled`]; `each` sees every frame before it is drawn.
pub(crate) fn draw_each_until_settled(session: &mut Session, mut each: impl FnMut(&Session)) -> Vec<u32> {
    let (request, begin) = (street(), Instant::now());
    loop {
        session.update(&request);
        if session.has_frame() {
            each(session);
            let pixels = session.draw(&request, &RenderSettings::default()).unwrap();
            for row in 60..HEIGHT_PX {
                let ground = &pixels.distance[row * WIDTH_PX + 20..row * WIDTH_PX + 140];
                assert!(ground.iter().all(|d| d.is_finite()), "a hole in row {row}");
            }
        }
        session.update(&request);
        if session.is_settled() && session.has_frame() {
            return session.draw(&request, &RenderSettings::default()).unwrap().colour;
        }
        assert!(begin.elapsed() < TIMEOUT, "{:?}", session.selection().stats);
        session.wait(Duration::from_millis(5));
    }
}

/// A streamer whose clock runs ahead while nothing is in flight, so that tests need not wait for changes over time: the
/// adaptive error threshold and cross-fades.
pub(crate) struct FastClockViewer {
    pub(crate) streamer: Streamer<BackgroundFetcher>,
    adapter: Adapter,
    started: Instant,
    /// How far the clock runs ahead.
    ahead: Duration,
}

impl FastClockViewer {
    /// Step of the clock while nothing is in flight.
    const STEP: Duration = Duration::from_millis(50);

    pub(crate) fn new(server: &TestServer, cache_mib: u64) -> Self {
        let (tree, downloads, opened) = connect_to(server, cache_mib, HttpOptions::default());
        let streamer = Streamer::new(tree, downloads, opened.pages);
        Self { streamer, adapter: opened.adapter, started: Instant::now(), ahead: Duration::ZERO }
    }

    /// One frame, without drawing.
    pub(crate) fn update(&mut self, request: &FrameRequest) {
        if self.streamer.is_idle() {
            self.ahead += Self::STEP;
        } else {
            self.streamer.downloads().fetcher().notifier().wait(Duration::from_millis(2));
        }
        self.streamer.update(request, &mut self.adapter, self.started.elapsed() + self.ahead);
    }

    /// Updates until the frame is settled. `each` sees every frame.
    pub(crate) fn settle(&mut self, request: &FrameRequest, mut each: impl FnMut(&Streamer<BackgroundFetcher>)) {
        let begin = Instant::now();
        loop {
            self.update(request);
            each(&self.streamer);
            if self.streamer.is_settled() {
                return;
            }
            assert!(begin.elapsed() < TIMEOUT, "{:?}", self.streamer.selection());
        }
    }
}
