//! The viewer that the engine's worker owns.

use super::fetcher::BrowserFetcher;
use super::frame_job::{DrawnView, FrameJob, Renderer};
use super::navigation::CameraFlight;
use glam::DVec3;
use insula_archive::city::parse_manifest;
use insula_protocol::Manifest;
use insula_shaders::layout::Shading;
use insula_viewer::additions::{AdditionError, PackedAddition};
use insula_viewer::cache::pages_for;
use insula_viewer::camera::{Camera, View};
use insula_viewer::camera_text;
use insula_viewer::collision::CitySolids;
use insula_viewer::interaction::camera_control::CameraControl;
use insula_viewer::interaction::day_animation::DayAnimation;
use insula_viewer::interaction::frame_pacing::FramePacer;
use insula_viewer::interaction::measure::MeasureTool;
use insula_viewer::projection::ray_direction;
use insula_viewer::scene::SceneTree;
use insula_viewer::select::occlusion_feedback::OcclusionQuery;
use insula_viewer::source::server::ServerSource;
use insula_viewer::source::{TileSource, Transport, web_folder};
use insula_viewer::streamer::{Downloads, FrameRequest, Streamer};
use insula_viewer::sun::{Daylight, SunOptions, parse_time};
use insula_viewer::switching::SwitchDistances;
use insula_web_host::commands::ViewerOptions;
use insula_web_host::host::{Host, to_js};
use insula_web_host::messages::{StatusMessage, json};
use insula_web_host::transport::BrowserTransport;
use std::collections::BTreeMap;
use std::sync::Arc;
use wasm_bindgen::prelude::*;
use web_time::Instant;

const INITIAL_REQUESTS: usize = 12;
/// Largest side of a frame in pixels.
const MAX_SIDE_PX: u32 = 8192;
/// How far surfaces are searched along a ray.
const MAX_PICK_M: f64 = 50_000.0;
/// Selectable tolerated errors in pixels.
const TAU_PX: [f64; 2] = [0.25, 16.0];

/// A city in a page.
#[wasm_bindgen]
pub struct CityViewer {
    host: Host,
    source: Arc<dyn TileSource>,
    pub(crate) streamer: Streamer<BrowserFetcher>,
    pub(crate) renderer: Renderer,
    pub(crate) control: CameraControl,
    pub(crate) flight: Option<CameraFlight>,
    pub(crate) daylight: Daylight,
    pub(crate) day: DayAnimation,
    pub(crate) pacer: FramePacer,
    pub(crate) shading: Shading,
    pub(crate) tau_px: f64,
    /// What decides about levels of detail instead.
    pub(crate) switching: Option<SwitchDistances>,
    pub(crate) size_px: [u32; 2],
    /// Size of the picture that is being made.
    pub(crate) picture_px: Option<[u32; 2]>,
    pub(crate) job: Option<FrameJob>,
    /// The frame whose hits a GPU is counting.
    pub(crate) counted: Option<OcclusionQuery>,
    /// Whether the screen shows another view, or other tiles than there are.
    pub(crate) is_stale: bool,
    /// Whether the screen shows another view.
    pub(crate) is_view_new: bool,
    /// When the last frame was drawn.
    pub(crate) drawn_at: Option<Instant>,
    pub(crate) measure: MeasureTool,
    pub(crate) markers: Vec<DVec3>,
    pub(crate) lines: Vec<Vec<DVec3>>,
    /// By the page's numbers.
    pub(crate) models: BTreeMap<u32, PackedAddition>,
    pub(crate) are_models_shown: bool,
    pub(crate) view_state: Option<DrawnView>,
    /// Requests for fine tiles that may still start while the frame is drawn.
    pub(crate) fine_requests: usize,
    /// Number of changes of the objects' styles.
    pub(crate) style_changes: u64,
    cache_bytes: u64,
    status: Option<StatusMessage>,
    started: Instant,
}

#[wasm_bindgen]
impl CityViewer {
    /// A viewer of the city that `options` (JSON, see `ViewerOptions`) describe. Nothing is fetched before the first update. Fails
    /// if the options or the manifest are invalid.
    #[wasm_bindgen(constructor)]
    pub fn new(host: Host, options: &str) -> Result<Self, JsError> {
        let options: ViewerOptions = serde_json::from_str(options).map_err(to_js)?;
        let manifest = parse_manifest(options.manifest.as_bytes()).map_err(to_js)?;
        let transport: Arc<dyn Transport> = Arc::new(BrowserTransport::new(host.clone(), 0));
        let source: Arc<dyn TileSource> = if options.is_folder {
            Arc::new(web_folder::open(&options.base, &manifest, &transport))
        } else {
            Arc::new(ServerSource::new(transport, &options.base, &options.query, &manifest))
        };
        let size_px = clamped_size(options.width, options.height);
        let aspect = f64::from(size_px[0]) / f64::from(size_px[1]);
        let overview = || Camera::overview(&manifest, aspect);
        let camera = options.camera.as_deref().and_then(camera_text::parse).unwrap_or_else(overview);
        let time = options.time.as_deref().and_then(|time| parse_time(time).ok());
        let daylight = Daylight::new(&SunOptions { time, ..SunOptions::default() }, &manifest);
        let control = CameraControl::new(&camera, manifest.ground_z_m);
        let streamer = open_streamer(&host, &source, manifest, pages_for(options.cache_bytes));
        Ok(Self {
            host,
            source,
            streamer,
            renderer: Renderer::cpu(true),
            control,
            flight: None,
            daylight,
            day: DayAnimation::default(),
            pacer: FramePacer::new(Instant::now(), true),
            shading: Shading::Lit,
            tau_px: clamped_tau(options.tau.unwrap_or(1.0)),
            switching: None,
            size_px,
            picture_px: None,
            job: None,
            counted: None,
            is_stale: true,
            is_view_new: true,
            drawn_at: None,
            measure: MeasureTool::default(),
            markers: Vec::new(),
            lines: Vec::new(),
            models: BTreeMap::new(),
            are_models_shown: true,
            view_state: None,
            fine_requests: 0,
            style_changes: 0,
            cache_bytes: options.cache_bytes,
            status: None,
            started: Instant::now(),
        })
    }

    /// The message about the last frame: positions of what the page shows over it.
    pub fn frame(&self) -> String {
        json(&self.frame_message())
    }

    /// The message about the state of streaming if it has changed since the last call.
    pub fn status(&mut self) -> Option<String> {
        let status = self.status_message();
        let is_new = self.status.as_ref() != Some(&status);
        self.status = Some(status);
        self.status.as_ref().filter(|_| is_new).map(json)
    }

    /// Number of tiles that the frame lacks.
    pub fn missing(&self) -> usize {
        self.streamer.missing_tiles()
    }

    /// See [`Streamer::has_frame`].
    pub fn has_frame(&self) -> bool {
        self.streamer.has_frame()
    }

    /// The point of the city at shares of the view's width and height, as x, y, z and the distance; empty if there is none.
    pub fn pick(&self, x: f64, y: f64) -> Vec<f64> {
        let Some((point, distance_m)) = self.surface_at(x, y) else { return Vec::new() };
        vec![point.x, point.y, point.z, distance_m]
    }

    /// A GPU with an atlas of `pages` pages draws from now on. Returns the first writes to it: what is resident, as far as that was kept;
    /// otherwise tiles are fetched again.
    #[wasm_bindgen(js_name = useGpu)]
    pub fn use_gpu(&mut self, pages: u32) -> Vec<u32> {
        let kept = self.renderer.past_writes().filter(|_| pages >= self.streamer.cache().capacity_pages());
        self.renderer = Renderer::gpu();
        match &kept {
            Some(_) => self.streamer.grow_cache(pages),
            // Its atlas is empty or smaller.
            None => self.renew(pages),
        }
        self.pacer.restart(Instant::now(), false);
        (self.job, self.view_state) = (None, None);
        kept.unwrap_or_default()
    }

    /// No GPU will be used: what was kept for it is dropped.
    #[wasm_bindgen(js_name = refuseGpu)]
    pub fn refuse_gpu(&mut self) {
        self.renderer.forget_past_writes();
    }

    /// The workers' atlases are empty and have another size from now on, so tiles are fetched again. Not while a frame is drawn, and not
    /// on a GPU, which keeps its atlas.
    #[wasm_bindgen(js_name = resizeCache)]
    pub fn resize_cache(&mut self, cache_bytes: f64) {
        self.cache_bytes = cache_bytes as u64;
        self.renderer = Renderer::cpu(false);
        self.renew(pages_for(self.cache_bytes));
    }

    /// Draws on the CPU again because the GPU failed. The workers' atlases are empty, so tiles are fetched again.
    #[wasm_bindgen(js_name = loseGpu)]
    pub fn lose_gpu(&mut self, cache_bytes: f64) {
        self.counted = None;
        self.cache_bytes = cache_bytes as u64;
        self.renderer = Renderer::cpu(false);
        self.renew(pages_for(self.cache_bytes));
        self.pacer.restart(Instant::now(), true);
    }
}

impl CityViewer {
    /// Begins again without any tile, but with the page's models. Fails if they are too large, and then is without them.
    pub(crate) fn restart(&mut self, pages: u32) -> Result<(), AdditionError> {
        let (manifest, styles) = (self.streamer.tree().manifest().clone(), self.styles().clone());
        self.streamer = open_streamer(&self.host, &self.source, manifest, pages);
        self.apply_styles(styles);
        (self.job, self.view_state) = (None, None);
        if self.models.is_empty() {
            return Ok(());
        }
        self.streamer.set_additions(self.models.values().cloned().collect(), &mut self.renderer)?;
        self.streamer.show_additions(self.are_models_shown);
        Ok(())
    }

    /// The same. Says in the console why the models are missing.
    pub(crate) fn renew(&mut self, pages: u32) {
        if let Err(error) = self.restart(pages) {
            tracing::warn!("the models are not shown: {error}");
        }
    }

    pub(crate) fn elapsed(&self) -> std::time::Duration {
        self.started.elapsed()
    }

    /// The request for a frame of the whole view, with `divisor` times fewer pixels along each side.
    pub(crate) fn request(&self, divisor: u32) -> FrameRequest {
        let size_px = self.picture_px.unwrap_or(self.size_px).map(|side| (side / divisor).max(1));
        FrameRequest {
            camera: self.control.camera(),
            heading: self.control.heading(),
            size_px,
            tau_px: if self.switching.is_some() { 1.0 } else { self.tau_px },
            switching: self.switching,
        }
    }

    pub(crate) fn view(&self) -> View {
        self.streamer.view(&FrameRequest { size_px: self.size_px, ..self.request(1) }, self.control.camera())
    }

    pub(crate) fn solids(&self) -> CitySolids<'_> {
        CitySolids::new(self.streamer.tree().manifest(), self.streamer.cache())
    }

    /// The point of the city at shares of the view's width and height, and its distance. Outside of the city, the ground is a plane.
    pub(crate) fn surface_at(&self, x: f64, y: f64) -> Option<(DVec3, f64)> {
        let view = self.view();
        let (eye, direction) = (view.camera.position, ray_direction(&view, x, y));
        let point = self.solids().surface_on_way(eye, eye + direction * MAX_PICK_M)?;
        Some((point, point.distance(eye)))
    }
}

fn open_streamer(
    host: &Host,
    source: &Arc<dyn TileSource>,
    manifest: Manifest,
    pages: u32,
) -> Streamer<BrowserFetcher> {
    let fetcher = BrowserFetcher::new(host.clone(), source.clone());
    let tree = SceneTree::new(manifest).with_meshes(true);
    let mut streamer = Streamer::new(tree, Downloads::new(fetcher, INITIAL_REQUESTS), pages);
    streamer.set_transitions(true);
    streamer
}

/// A size in pixels that a frame can have.
pub(crate) fn clamped_size(width: u32, height: u32) -> [u32; 2] {
    [width, height].map(|side| side.clamp(1, MAX_SIDE_PX))
}

/// A tolerated error that can be selected; 1 for what is not a number.
pub(crate) fn clamped_tau(tau_px: f64) -> f64 {
    if tau_px.is_nan() { 1.0 } else { tau_px.clamp(TAU_PX[0], TAU_PX[1]) }
}
