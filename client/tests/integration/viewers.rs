//! Clients of the test server, drawn by the CPU ray-caster.

use super::fixture_city::ORIGIN;
use super::test_server::TestServer;
use glam::DVec3;
use insula_client::args::GlobalArgs;
use insula_client::commands::connect;
use insula_client::render::{Adapter, AdapterChoice, OpenedAdapter};
use insula_client::session::Session;
use insula_client::stream::BackgroundFetcher;
use insula_client::stream::fetch::{Http, HttpOptions};
use insula_shaders::cpu::hit_counts::hit_counts;
use insula_shaders::cpu::raycast::Pixels;
use insula_viewer::camera::Camera;
use insula_viewer::frame::RenderSettings;
use insula_viewer::scene::SceneTree;
use insula_viewer::streamer::{Downloads, FrameRequest, Streamer};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Size of the frames.
pub(crate) const WIDTH_PX: usize = 160;
const HEIGHT_PX: usize = 90;
/// Index of the pixel in the middle of a frame.
pub(crate) const CENTRE: usize = HEIGHT_PX / 2 * WIDTH_PX + WIDTH_PX / 2;
/// Longest time that a frame may take to settle: so long that only a client that hangs takes it.
pub(crate) const TIMEOUT: Duration = Duration::from_secs(120);
/// Limits of a request that no slow machine reaches.
pub(crate) const PATIENT: HttpOptions =
    HttpOptions { connect: TIMEOUT, read: TIMEOUT, body: TIMEOUT, follow_redirects: false };

pub(crate) fn global_args() -> GlobalArgs {
    GlobalArgs {
        adapter: AdapterChoice::Cpu,
        cache_mib: 256,
        no_meshes: false,
        disk_cache_mib: None,
        city: None,
        tau: 1.0,
        timeout: 120,
        follow_redirects: false,
    }
}

/// A frame from `position` to `target`, in metres from the city's corner.
pub(crate) fn request(position: [f64; 3], target: [f64; 3]) -> FrameRequest {
    let origin = DVec3::from(ORIGIN);
    let camera = Camera::look_at(origin + DVec3::from(position), origin + DVec3::from(target), DVec3::Z, 1.0).unwrap();
    FrameRequest { camera, heading: None, size_px: [WIDTH_PX as u32, HEIGHT_PX as u32], tau_px: 1.0, switching: None }
}

pub(crate) fn street() -> FrameRequest {
    request([31.0, -20.0, 15.0], [31.0, 200.0, 5.0])
}

/// The `step`-th position of a camera that moves sideways along the city's edge, `step_m` metres each.
pub(crate) fn sideways(step: u32, step_m: f64) -> FrameRequest {
    let x = step_m * f64::from(step);
    request([x, -20.0, 30.0], [x, 100.0, 0.0])
}

pub(crate) fn open_session(server: &TestServer, cache_mib: u64) -> Session {
    open_session_with(server, cache_mib, PATIENT)
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

/// Updates a session, without drawing, until `is_done`, which sees every frame.
pub(crate) fn update_until(session: &mut Session, request: &FrameRequest, mut is_done: impl FnMut(&Session) -> bool) {
    let begin = Instant::now();
    loop {
        session.update(request);
        if is_done(session) {
            return;
        }
        assert!(begin.elapsed() < TIMEOUT, "{:?}", session.selection());
        session.wait(Duration::from_millis(2));
    }
}

/// Updates a session until its frame is settled, without drawing. `each` sees every frame.
pub(crate) fn settle(session: &mut Session, request: &FrameRequest, mut each: impl FnMut(&Session)) {
    update_until(session, request, |session| {
        each(session);
        session.is_settled()
    });
}

/// Fails if a ray to the ground of [`street`] hits nothing.
fn check_ground(pixels: &Pixels) {
    for row in 60..HEIGHT_PX {
        let ground = &pixels.distance[row * WIDTH_PX + 20..row * WIDTH_PX + 140];
        assert!(ground.iter().all(|d| d.is_finite()), "a hole in row {row}");
    }
}

/// Draws every frame of [`street`] until it is settled. Each must cover all of the ground. Returns the colours of the last frame.
pub(crate) fn draw_until_settled(session: &mut Session) -> Vec<u32> {
    let (request, begin) = (street(), Instant::now());
    loop {
        session.update(&request);
        if session.has_frame() {
            check_ground(&session.draw(&request, &RenderSettings::default()).unwrap());
        }
        session.update(&request);
        if session.is_settled() && session.has_frame() {
            return session.draw(&request, &RenderSettings::default()).unwrap().colour;
        }
        assert!(begin.elapsed() < TIMEOUT, "{:?}", session.selection().stats);
        session.wait(Duration::from_millis(5));
    }
}

/// A streamer with a clock of its own, which stands still while requests are in flight. So what happens over time does not depend on
/// the machine: retries, the adaptive error threshold, cross-fades, and how long a tile waits for those that may occlude it.
pub(crate) struct SimulatedViewer {
    pub(crate) streamer: Streamer<BackgroundFetcher>,
    adapter: Adapter,
    now: Duration,
    /// Whether the clock runs while requests are in flight, too.
    pub(crate) runs_always: bool,
}

impl SimulatedViewer {
    const STEP: Duration = Duration::from_millis(50);

    pub(crate) fn new(server: &TestServer, cache_mib: u64) -> Self {
        let (tree, downloads, opened) = connect_to(server, cache_mib, PATIENT);
        let streamer = Streamer::new(tree, downloads, opened.pages);
        Self { streamer, adapter: opened.adapter, now: Duration::ZERO, runs_always: false }
    }

    pub(crate) fn now(&self) -> Duration {
        self.now
    }

    pub(crate) fn update(&mut self, request: &FrameRequest) {
        let is_waiting = self.streamer.downloads().in_flight() > 0;
        if is_waiting {
            self.streamer.downloads().fetcher().notifier().wait(Duration::from_millis(5));
        }
        if !is_waiting || self.runs_always {
            self.now += Self::STEP;
        }
        self.streamer.update(request, &mut self.adapter, self.now);
    }

    /// Updates until `is_done`, which sees every frame.
    pub(crate) fn update_until(
        &mut self,
        request: &FrameRequest,
        mut is_done: impl FnMut(&Streamer<BackgroundFetcher>) -> bool,
    ) {
        let begin = Instant::now();
        loop {
            self.update(request);
            if is_done(&self.streamer) {
                return;
            }
            assert!(begin.elapsed() < TIMEOUT, "{:?}", self.streamer.selection());
        }
    }

    /// Updates until the frame is settled. `each` sees every frame.
    pub(crate) fn settle(&mut self, request: &FrameRequest, mut each: impl FnMut(&Streamer<BackgroundFetcher>)) {
        self.update_until(request, |streamer| {
            each(streamer);
            streamer.is_settled()
        });
    }

    /// Draws the last selection and reports what its rays hit.
    fn draw(&mut self, request: &FrameRequest) -> Pixels {
        let data = self.streamer.frame_data(request, &RenderSettings::default());
        let pixels = self.adapter.draw(&data).unwrap();
        self.streamer.report_hits(&data.query, &hit_counts(&pixels.hit, data.nodes.len()));
        pixels
    }

    /// Draws every frame of [`street`] until `is_done`, which sees it before. Each must cover all of the ground.
    pub(crate) fn draw_until(&mut self, mut is_done: impl FnMut(&Streamer<BackgroundFetcher>) -> bool) {
        let (request, begin) = (street(), Instant::now());
        loop {
            self.update(&request);
            let has_frame = self.streamer.has_frame();
            if has_frame && is_done(&self.streamer) {
                return;
            }
            if has_frame {
                check_ground(&self.draw(&request));
            }
            assert!(begin.elapsed() < TIMEOUT, "{:?}", self.streamer.selection().stats);
        }
    }

    /// Draws every frame of [`street`] until it is settled. Returns the colours of the last frame.
    pub(crate) fn draw_until_settled(&mut self) -> Vec<u32> {
        self.draw_until(Streamer::is_settled);
        self.draw(&street()).colour
    }
}
