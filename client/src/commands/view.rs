//! `insula view`: a city in a window.

#[cfg(feature = "embedded")]
use super::embedded::{BakeJob, CacheRoot, find_baked};
use super::headless::{INITIAL_REQUESTS, settle};
use super::{FindPlace, connect, proposal};
use crate::args::{GlobalArgs, ViewArgs};
use crate::camera_files::{PlacedCamera, given_camera, read_path};
use crate::error::{ClientError, Result};
use crate::render::OpenedAdapter;
use crate::session::Session;
use crate::stream::city::OpenedCity;
use crate::stream::fetch::Http;
use crate::stream::{BackgroundFetcher, Wake};
use crate::ui::city_chooser::CityPreview;
use crate::ui::connector::{ConnectFn, ConnectFns, ConnectedCity, PreviewFn, StartStatus, ViewerEvent};
use crate::ui::event_loop::{self, WindowOptions};
use crate::ui::path_playback::PathPlayback;
use crate::ui::view_link::ViewLink;
use insula_shaders::layout::Shading;
use insula_shaders::look::Look;
use insula_viewer::cache::pages_for;
use insula_viewer::camera::Camera;
use insula_viewer::interaction::frame_pacing::FRAME_RATE;
use insula_viewer::scene::SceneTree;
use insula_viewer::streamer::FrameRequest;
use insula_viewer::sun::{Daylight, SunOptions, SunTime};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Longest attempt to connect, in seconds. The window shows the error and tries again.
const ATTEMPT_SECS: u32 = 3;

/// Size of a city's preview, its cache, and the longest time to load it.
const PREVIEW_PX: [u32; 2] = [224, 126];
const PREVIEW_CACHE_BYTES: u64 = 48 << 20;
const PREVIEW_TIMEOUT: Duration = Duration::from_secs(5);

/// Runs the command until the window is closed. Fails if an argument is invalid, or if no window can be opened.
pub(super) fn run(args: &ViewArgs, global: &GlobalArgs) -> Result<()> {
    proposal::files(args.proposal.as_deref())?;
    let link = ViewLink::parse(args.place.place())?;
    let first = FirstView {
        status: StartStatus::new(format!("connecting to {}", link.location)),
        camera: args.camera.as_deref().map(given_camera).transpose()?.or(link.camera.map(PlacedCamera::from)),
        time: link.time,
        look: link.look,
        object: link.object,
    };
    let place = args.place.place().to_owned();
    open_window(first, Box::new(move |_| Ok(place.clone())), args, global)
}

/// Opens a window that bakes the city of `job` and shows it.
#[cfg(feature = "embedded")]
pub(super) fn open_baked(job: BakeJob, cache: CacheRoot, args: &ViewArgs, global: &GlobalArgs) -> Result<()> {
    let first = FirstView {
        status: StartStatus::new("opening the city".into()),
        camera: None,
        time: None,
        look: None,
        object: None,
    };
    open_window(first, find_baked(job, cache), args, global)
}

/// What a window begins with.
struct FirstView {
    status: StartStatus,
    camera: Option<PlacedCamera>,
    time: Option<SunTime>,
    look: Option<Look>,
    object: Option<u32>,
}

/// Shows the city that `find` finds.
fn open_window(first: FirstView, find: FindPlace, args: &ViewArgs, global: &GlobalArgs) -> Result<()> {
    let started = Instant::now();
    let path = args.path.as_deref().map(read_path).transpose()?;
    let (switching, _) = args.switch.switching(global.tau).map_err(ClientError::Usage)?;
    let event_loop = event_loop::event_loop()?;
    let http = Arc::new(Http::with_options(None, global.http_options())?);
    let options = WindowOptions {
        status: first.status,
        camera: first.camera,
        object: first.object,
        sun: args.sun.or_link(first.time, first.look).into(),
        tau_px: (global.tau != GlobalArgs::DEFAULT_TAU_PX).then_some(global.tau),
        switching,
        fps: args.fps.unwrap_or(FRAME_RATE),
        adapter: global.adapter,
        cache_bytes: u64::from(global.cache_mib) << 20,
        has_captions: !args.pictures.no_caption,
        playback: path.map(|path| PathPlayback::new(path, args.seconds)),
    };
    let proxy = event_loop.create_proxy();
    // Sending fails only after the event loop has ended.
    let wake: Wake = Arc::new(move || {
        let _ = proxy.send_event(ViewerEvent::Arrived);
    });
    let global = GlobalArgs { timeout: global.timeout.min(ATTEMPT_SECS), ..global.clone() };
    let has_transitions = !args.no_fades;
    let has_meshes = !global.no_meshes;
    let connector = Arc::new(CityConnector { find, http, global, status: options.status.clone() });
    let previews = connector.clone();
    let proposal = args.proposal.clone();
    let preview: PreviewFn = Arc::new(move |name| previews.preview(name).ok());
    let connect: ConnectFn = Arc::new(move |name| {
        let (mut city, http, wake) = (connector.connect(name)?, connector.http.clone(), wake.clone());
        let proposal = proposal::open(proposal.as_deref(), &http, &mut city)?;
        let (manifest, address) = (city.manifest.clone(), city.address.clone());
        let open_session = move |adapter| {
            let source = Arc::clone(&city.source);
            let downloads = BackgroundFetcher::downloads(Arc::clone(&http), source, INITIAL_REQUESTS, Some(wake));
            let tree = SceneTree::new(city.manifest).with_meshes(has_meshes);
            let mut session = Session::new(tree, downloads, adapter, started).with_objects(http, city.source);
            session.set_transitions(has_transitions);
            session.with_proposal(proposal)
        };
        Ok(ConnectedCity { manifest, address, open_session: Box::new(open_session) })
    });
    event_loop::run(event_loop, options, ConnectFns { connect, preview })
}

struct CityConnector {
    find: FindPlace,
    http: Arc<Http>,
    global: GlobalArgs,
    status: StartStatus,
}

impl CityConnector {
    fn connect(&self, name: Option<&str>) -> Result<OpenedCity> {
        let place = (self.find)(&self.status)?;
        let city = name.map(str::to_owned).or_else(|| self.global.city.clone());
        connect(&self.http, &place, &GlobalArgs { city, ..self.global.clone() })
    }

    /// Draws the city from above with little memory and few tiles.
    fn preview(&self, name: &str) -> Result<CityPreview> {
        let city = self.connect(Some(name))?;
        let [low, high] = city.manifest.bounds;
        let aspect = f64::from(PREVIEW_PX[0]) / f64::from(PREVIEW_PX[1]);
        let camera = Camera::overview(&city.manifest, aspect);
        let daylight = Daylight::new(&SunOptions::default(), &city.manifest);
        let downloads = BackgroundFetcher::downloads(self.http.clone(), city.source, INITIAL_REQUESTS, None);
        let tree = SceneTree::new(city.manifest).with_meshes(false);
        let adapter = OpenedAdapter::cpu(pages_for(PREVIEW_CACHE_BYTES));
        let mut session = Session::new(tree, downloads, adapter, Instant::now());
        let request = FrameRequest { camera, heading: None, size_px: PREVIEW_PX, tau_px: 2.0, switching: None };
        settle(&mut session, &request, PREVIEW_TIMEOUT)?;
        let pixels = session.draw(&request, &daylight.render_settings(Shading::Lit, 2))?;
        Ok(CityPreview { size_m: [high[0] - low[0], high[1] - low[1]], pixels })
    }
}
