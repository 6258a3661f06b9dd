//! A client in this process, stepped frame by frame.

use crate::view::Camera;
use anyhow::{Result, ensure};
use glam::DVec3;
use insula_client::args::GlobalArgs;
use insula_client::commands::headless::open_session;
use insula_client::render::AdapterChoice;
use insula_client::session::Session;
use insula_client::stream::fetch::Http;
use insula_protocol::{Manifest, TileId};
use insula_shaders::cpu::raycast::Pixels;
use insula_viewer::frame::RenderSettings;
use insula_viewer::scene::tile::TileState;
use insula_viewer::streamer::FrameRequest;
use std::path::Path;
use std::time::{Duration, Instant};

const SIZE_PX: [u32; 2] = [640, 360];
/// Time between two frames, in which responses arrive.
const PAUSE: Duration = Duration::from_millis(5);
/// Longest time for [`Viewer::step_until`]. Only a hang takes as long.
const PATIENCE: Duration = Duration::from_secs(120);

/// Opens a city at any place, drawn with the CPU.
pub fn open(place: &Path, cache_mib: u32) -> Result<Session> {
    open_drawn(place, cache_mib, false)
}

/// The same, with columns only or with meshes as well.
pub fn open_drawn(place: &Path, cache_mib: u32, no_meshes: bool) -> Result<Session> {
    let global = GlobalArgs { no_meshes, ..global(cache_mib) };
    Ok(open_session(place.display().to_string(), &global, Some(Http::new(None)?), None, None)?)
}

/// Fetches all tiles in the view frustum, occluded or not.
pub fn fetch_all(session: &mut Session, request: &FrameRequest, timeout: Duration) -> Result<()> {
    loop {
        session.update(request);
        session.check(timeout)?;
        if session.is_fetched() {
            return Ok(());
        }
        std::thread::sleep(Duration::from_millis(1));
    }
}

/// The options of commands, to draw with the CPU.
pub fn global(cache_mib: u32) -> GlobalArgs {
    GlobalArgs {
        adapter: AdapterChoice::Cpu,
        no_meshes: false,
        cache_mib,
        disk_cache_mib: None,
        city: None,
        tau: 1.0,
        timeout: 20,
        follow_redirects: false,
    }
}

/// A client that draws with the CPU.
pub struct Viewer {
    pub session: Session,
    pub request: FrameRequest,
}

impl Viewer {
    /// Connects and sets the camera.
    pub fn connect(url: &str, camera: impl FnOnce(&Manifest) -> Camera) -> Result<Self> {
        let session = open_session(url, &global(256), None, None, None)?;
        let request = request(&camera(session.tree().manifest()))?;
        Ok(Self { session, request })
    }

    pub fn set_camera(&mut self, camera: &Camera) -> Result<()> {
        self.request = request(camera)?;
        Ok(())
    }

    /// Runs one frame, then pauses. After the first frame is drawn, draws again whenever the draw list has changed.
    pub fn step(&mut self) -> Result<()> {
        self.session.update(&self.request);
        if self.session.feedback().has_feedback() && !self.session.has_feedback(SIZE_PX) {
            self.draw()?;
        }
        std::thread::sleep(PAUSE);
        Ok(())
    }

    /// Runs frames until `done`. Fails if that never comes; `what` is expected.
    pub fn step_until(&mut self, what: &str, mut done: impl FnMut(&mut Self) -> Result<bool>) -> Result<()> {
        let begin = Instant::now();
        loop {
            self.step()?;
            if done(self)? {
                return Ok(());
            }
            let stats = self.session.selection().stats;
            ensure!(begin.elapsed() < PATIENCE, "{what}: not within {PATIENCE:?}: {stats:?}");
        }
    }

    /// Draws the last frame.
    pub fn draw(&mut self) -> Result<Pixels> {
        let set_camera = RenderSettings { samples: 1, ..RenderSettings::default() };
        Ok(self.session.draw(&self.request, &set_camera)?)
    }

    /// Tiles that are being fetched.
    pub fn loading(&self) -> Vec<TileId> {
        let nodes = self.session.tree().nodes();
        nodes.filter(|node| node.tile.state() == TileState::Loading).map(|node| node.id).collect()
    }
}

fn request(view: &Camera) -> Result<FrameRequest> {
    let camera = view.to_viewer()?;
    Ok(FrameRequest { camera, heading: None, size_px: SIZE_PX, tau_px: 1.0, switching: None })
}

/// Shows the city from the south and above; with `turned_away`, looks in the opposite direction from the same position.
pub fn overlook(manifest: &Manifest, turned_away: bool) -> Camera {
    let [low, high] = manifest.bounds.map(DVec3::from);
    let size = high - low;
    let middle = ((low + high) / 2.0).with_z(low.z);
    let position = middle + DVec3::new(0.0, -size.y * 0.55, 0.35 * size.truncate().min_element());
    let ahead = middle - position;
    Camera::looking(position, position + if turned_away { ahead * DVec3::new(-1.0, -1.0, 1.0) } else { ahead })
}
