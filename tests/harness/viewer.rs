//! A client in this process, frame by frame.

use crate::view::Camera;
use anyhow::{Context, Result, ensure};
use glam::DVec3;
use insula_client::{
    args::GlobalArgs,
    commands::headless::open_session,
    render::AdapterChoice,
    session::Session,
    stream::{fetch::Http, simulated_link::SimulatedLink},
};
use insula_protocol::{Manifest, TileId};
use insula_shaders::cpu::raycast::Pixels;
use insula_viewer::{camera, frame::RenderSettings, scene::tile::TileState, streamer::FrameRequest};
use std::{
    path::Path,
    time::{Duration, Instant},
};

/// Picture size.
const SIZE_PX: [u32; 2] = [640, 360];
/// Between two frames.
const FRAME: Duration = Duration::from_millis(5);

/// A session over a city at any place, which draws with the CPU.
pub fn open(place: &Path, cache_mib: u32) -> Result<Session> {
    open_over(None, place, cache_mib)
}

/// The same over a simulated link.
pub fn open_over(link: Option<SimulatedLink>, place: &Path, cache_mib: u32) -> Result<Session> {
    Ok(open_session(&place.display().to_string(), &global(cache_mib), Some(Http::new(link)?), None)?)
}

/// Fetches all that is in the frustum, seen or not: nothing is drawn.
pub fn fetch_all(session: &mut Session, shot: &FrameRequest, timeout: Duration) -> Result<()> {
    loop {
        session.update(shot);
        session.check(timeout)?;
        if session.is_fetched() {
            return Ok(());
        }
        std::thread::sleep(Duration::from_millis(1));
    }
}

fn global(cache_mib: u32) -> GlobalArgs {
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
    /// The client.
    pub session: Session,
    /// What it looks at.
    pub shot: FrameRequest,
}

impl Viewer {
    /// Connects; `camera` is chosen once the city is known.
    pub fn connect(url: &str, camera: impl FnOnce(&Manifest) -> Camera) -> Result<Self> {
        let session = open_session(url, &global(256), None, None)?;
        let shot = shot(&camera(session.tree().manifest()))?;
        Ok(Self { session, shot })
    }

    /// Turns to another view.
    pub fn look(&mut self, camera: &Camera) -> Result<()> {
        self.shot = shot(camera)?;
        Ok(())
    }

    /// One frame, then a pause. Once a picture was drawn, it is drawn again whenever what is drawn changes.
    pub fn step(&mut self) -> Result<()> {
        self.session.update(&self.shot);
        if self.session.feedback().has_feedback() && !self.session.has_feedback(SIZE_PX) {
            self.draw()?;
        }
        std::thread::sleep(FRAME);
        Ok(())
    }

    /// Frames until `done`; an error after `most`.
    pub fn until(&mut self, most: Duration, mut done: impl FnMut(&mut Self) -> Result<bool>) -> Result<()> {
        let begin = Instant::now();
        loop {
            self.step()?;
            if done(self)? {
                return Ok(());
            }
            let selection = self.session.selection();
            ensure!(begin.elapsed() < most, "not within {most:?}: {:?}", selection.stats);
        }
    }

    /// The picture of the last frame's cut.
    pub fn draw(&mut self) -> Result<Pixels> {
        let look = RenderSettings { samples: 1, ..RenderSettings::default() };
        Ok(self.session.draw(&self.shot, &look)?)
    }

    /// Tiles of which a request is under way.
    pub fn loading(&self) -> Vec<TileId> {
        let nodes = self.session.tree().nodes();
        nodes.filter(|node| node.tile.state() == TileState::Loading).map(|node| node.id).collect()
    }
}

fn shot(view: &Camera) -> Result<FrameRequest> {
    let [position, target, up] = [view.position, view.target, view.up].map(DVec3::from);
    let camera = camera::Camera::look_at(position, target, up, view.fov_y_deg.to_radians()).context("looks nowhere")?;
    Ok(FrameRequest { camera, heading: None, size_px: SIZE_PX, tau_px: 1.0 })
}

/// The city from above, from the south; `turned_away`: from the same place, the other way.
pub fn overlook(manifest: &Manifest, turned_away: bool) -> Camera {
    let [low, high] = manifest.bounds.map(DVec3::from);
    let size = high - low;
    let middle = ((low + high) / 2.0).with_z(low.z);
    let position = middle + DVec3::new(0.0, -size.y * 0.55, 0.35 * size.truncate().min_element());
    let ahead = middle - position;
    Camera::looking(position, position + if turned_away { ahead * DVec3::new(-1.0, -1.0, 1.0) } else { ahead })
}
