//! The loop that every command shares: stream, then draw.
//!
//! In: a camera each frame. Out: the cut, pictures, counters. Next: `ui::window`, `commands::snapshot`, `commands::fly`.

mod around;
mod flow;
mod tau;
#[cfg(test)]
mod tests;
mod wave;

use crate::{
    cache::{Cache, PAGE_BYTES},
    camera::{Camera, View},
    error::{ClientError, Result},
    render::{Adapter, AdapterInfo, FrameData, Look},
    report::{FrameTimes, Report, TileCounts},
    scene::{Tree, TreeNode},
    select::{
        Selection,
        fade::Fades,
        sight::{Asked, Sight},
    },
    stream::Stream,
};
pub use around::SMALLER;
pub use flow::Shot;
use flow::{Beside, Flow};
use glam::DVec3;
use insula_shaders::cpu::{hit_counts::hit_counts, raycast::Pixels};
use std::{
    sync::atomic::{AtomicBool, Ordering},
    thread::JoinHandle,
    time::{Duration, Instant},
};

/// Frame times that are kept.
const TIMES: usize = 100_000;
/// A picture whose errors are at most so many times tau is nearly as good as it gets.
const NEAR_TIMES_TAU: f64 = 4.0;

/// A ray-caster, what it is called, and how many pages it has room for.
pub type Opened = (Adapter, AdapterInfo, u32);

/// How far a look around has come.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LookAround {
    /// A picture was drawn: go on.
    Looked,
    /// Tiles are to come.
    Waits,
    /// All is here that is seen there; or the picture is not settled; or there is no room for more.
    Done,
}

/// A city that is being looked at.
pub struct Session {
    flow: Flow,
    adapter: Adapter,
    info: AdapterInfo,
    times: Vec<Duration>,
    started: Instant,
    first_picture: Option<Duration>,
    near: Option<Duration>,
    converged: Option<Duration>,
    asked_tau_px: f64,
}

impl Session {
    /// Nothing fetched yet. `pages` is what `adapter` has room for; `started` is when the command began.
    pub fn new(tree: Tree, stream: Stream, (adapter, info, pages): Opened, started: Instant) -> Self {
        Self::with(Flow::new(tree, stream, pages), adapter, info, started)
    }

    /// The same with an adapter that is still being opened: what `first` needs is fetched meanwhile. `pages` is what the
    /// adapter should have room for.
    pub fn open(
        (tree, stream): (Tree, Stream),
        opening: JoinHandle<Result<Opened>>,
        pages: u32,
        first: Option<&Shot>,
        started: Instant,
    ) -> Result<Self> {
        let mut flow = Flow::new(tree, stream, pages);
        if let Some(shot) = first {
            flow.begin(shot, || opening.is_finished());
        }
        let broken = |_| ClientError::Graphics("opening the graphics device was broken off: try --adapter cpu".into());
        let (adapter, info, pages) = opening.join().map_err(broken)??;
        flow.cache = Cache::new(pages);
        Ok(Self::with(flow, adapter, info, started))
    }

    fn with(flow: Flow, adapter: Adapter, info: AdapterInfo, started: Instant) -> Self {
        Self {
            flow,
            adapter,
            info,
            times: Vec::new(),
            started,
            first_picture: None,
            near: None,
            converged: None,
            asked_tau_px: 1.0,
        }
    }

    /// One turn of the loop but for drawing.
    pub fn step(&mut self, shot: &Shot) {
        self.asked_tau_px = shot.tau_px;
        self.flow.step(shot, &mut self.adapter);
        if self.settled() {
            self.converged.get_or_insert(self.started.elapsed());
        }
    }

    /// Runs `draw`; meanwhile the network goes on with what the last step wanted. The atlas stays as it is.
    pub fn during<T>(&mut self, draw: impl FnOnce(&mut Adapter) -> T) -> T {
        let Self { flow, adapter, .. } = self;
        if flow.is_still() {
            return draw(adapter);
        }
        let drawn = AtomicBool::new(false);
        let bell = flow.stream.bell();
        std::thread::scope(|scope| {
            let go_on = || flow.go_on(|| drawn.load(Ordering::Acquire));
            // Without a thread, the network waits.
            let _thread = std::thread::Builder::new().name("insula-flow".into()).spawn_scoped(scope, go_on);
            // A panic must end it too: the scope waits for it.
            let _end = OnDrop(|| {
                drawn.store(true, Ordering::Release);
                bell.ring();
            });
            draw(adapter)
        })
    }

    /// Draws `data`, waits for the pixels, and takes in what they hit.
    pub fn render(&mut self, data: &FrameData) -> Result<Pixels> {
        let pixels = self.during(|adapter| adapter.draw(data))?;
        self.drawn(data);
        self.feed(&data.asked, &hit_counts(&pixels.hit, data.nodes.len()));
        Ok(pixels)
    }

    /// Draws the last selection, waits for the pixels, and takes in what they hit.
    pub fn draw(&mut self, shot: &Shot, look: &Look) -> Result<Pixels> {
        self.render(&self.frame_data(shot, look))
    }

    /// Looks at what a turn would show, if the picture of a shot is settled, and has it fetched. To be called after steps with the
    /// same shot until it is done.
    pub fn look_around(&mut self, shot: &Shot) -> Result<LookAround> {
        match self.flow.beside(shot) {
            Beside::Nothing => Ok(LookAround::Done),
            Beside::Lacking => Ok(LookAround::Waits),
            Beside::Unseen(data) => {
                let pixels = self.during(|adapter| adapter.draw(&data))?;
                self.flow.feed_beside(shot, &data.asked, &hit_counts(&pixels.hit, data.nodes.len()));
                Ok(LookAround::Looked)
            }
        }
    }

    /// Notes that a picture was drawn.
    pub fn drawn(&mut self, data: &FrameData) {
        let elapsed = self.started.elapsed();
        if !data.nodes.is_empty() {
            self.first_picture.get_or_insert(elapsed);
            if data.error_px <= NEAR_TIMES_TAU * self.asked_tau_px {
                self.near.get_or_insert(elapsed);
            }
        }
    }

    /// Waits until something has arrived, at most for `timeout`.
    pub fn wait(&self, timeout: Duration) {
        self.flow.stream.bell().wait(timeout);
    }

    /// The view of a shot, with this cache's budget.
    pub fn view(&self, shot: &Shot, camera: Camera) -> View {
        self.flow.view(shot, camera)
    }

    /// Towards the sun, if what is out of the picture shall cast shadows into it: a [`Look::casting`].
    pub fn set_sun(&mut self, sun: Option<DVec3>) {
        self.flow.set_sun(sun);
    }

    /// Whether squares pass from one level of detail to another in a while ([`crate::select::fade`]); at once unless set.
    pub fn set_fades(&mut self, on: bool) {
        self.flow.fades.set(on);
    }

    /// The next picture shows all as it shall be, at once.
    pub fn end_fades(&mut self) {
        self.flow.fades.forget();
    }

    /// What passes from one level of detail to another.
    pub fn fades(&self) -> &Fades {
        &self.flow.fades
    }

    /// Whether nothing could make the last selection's picture better, and nothing passes.
    pub fn settled(&self) -> bool {
        self.flow.settled()
    }

    /// Whether all that the last selection asks for is here.
    pub fn fetched(&self) -> bool {
        self.flow.fetched()
    }

    /// Whether it is known what the rays of the last selection hit, in a picture of at least this size, and they changed
    /// nothing.
    pub fn is_sighted(&self, size_px: [u32; 2]) -> bool {
        self.flow.is_sighted(size_px)
    }

    /// Whether anything can be drawn.
    pub fn has_picture(&self) -> bool {
        !self.flow.selection.cut.is_empty()
    }

    /// Takes in what the rays of a picture hit: `pixels` of each of the squares that it was drawn with.
    pub fn feed(&mut self, asked: &Asked, pixels: &[u32]) {
        self.flow.feed(asked, pixels);
    }

    /// What the last pictures' rays hit.
    pub fn sight(&self) -> &Sight {
        &self.flow.sight
    }

    /// Whether the next frame has something to upload, or to select anew: no need to wait for the network.
    pub fn streaming_now(&self) -> bool {
        self.flow.streaming_now()
    }

    /// What the last shot asked for.
    pub fn asked_tau_px(&self) -> f64 {
        self.asked_tau_px
    }

    /// An error if the city has no root to begin with, or the server does not answer for `timeout`.
    pub fn check(&self, timeout: Duration) -> Result<()> {
        self.flow.check(timeout)
    }

    /// What the ray-caster needs for the last selection.
    pub fn frame_data(&self, shot: &Shot, look: &Look) -> FrameData {
        self.flow.frame_data(shot, look)
    }

    /// Notes how long a frame took.
    pub fn timed(&mut self, time: Duration) {
        if self.times.len() < TIMES {
            self.times.push(time);
        }
    }

    /// Frames that took `times` the median or longer.
    pub fn stalls(&self, times: f64) -> usize {
        let limit_ms = FrameTimes::new(&self.times).median_ms * times;
        self.times.iter().filter(|time| time.as_secs_f64() * 1e3 >= limit_ms).count()
    }

    /// Tiles that had to leave the cache.
    pub fn evicted(&self) -> u64 {
        self.flow.evicted
    }

    /// Tiles that came again after they had left.
    pub fn fetched_again(&self) -> u64 {
        self.flow.fetched_again
    }

    /// Whether the last selection's picture lacks anything.
    pub fn lacks(&self) -> bool {
        self.flow.lacks()
    }

    /// The ray-caster, for the window.
    pub fn adapter_mut(&mut self) -> &mut Adapter {
        &mut self.adapter
    }

    /// The ray-caster.
    pub fn adapter(&self) -> &Adapter {
        &self.adapter
    }

    /// What draws.
    pub fn adapter_info(&self) -> &AdapterInfo {
        &self.info
    }

    /// What is known of the city.
    pub fn tree(&self) -> &Tree {
        &self.flow.tree
    }

    /// The last selection.
    pub fn selection(&self) -> &Selection {
        &self.flow.selection
    }

    /// The atlas.
    pub fn cache(&self) -> &Cache {
        &self.flow.cache
    }

    /// The network.
    pub fn stream(&self) -> &Stream {
        &self.flow.stream
    }

    /// What it all cost so far.
    pub fn report(&self, tau_px: f64) -> Report {
        let Flow { tree, cache, stream, selection, tiles, .. } = &self.flow;
        let manifest = tree.manifest();
        let bad_meshes = |n: &TreeNode| n.lods.iter().filter(|lod| lod.tile.is_bad()).count();
        let bad = |n: &TreeNode| usize::from(n.tile.is_bad()) + bad_meshes(n);
        let bad = tree.nodes().iter().map(bad).sum::<usize>() as u64;
        let counters = selection.counters;
        let secs = |time: Option<Duration>| time.map(|t| t.as_secs_f64());
        Report {
            city: manifest.name.clone(),
            version: manifest.version.clone(),
            bytes_fetched: stream.http().bytes(),
            requests: stream.http().requests(),
            tiles: TileCounts { bad, ..*tiles },
            frame_times: FrameTimes::new(&self.times),
            time_to_first_picture_secs: secs(self.first_picture),
            time_to_near_picture_secs: secs(self.near),
            time_to_converged_picture_secs: secs(self.converged),
            peak_cache_bytes: cache.peak_bytes(),
            cache_bytes: u64::from(cache.capacity_pages()) * PAGE_BYTES,
            adapter: self.info.clone(),
            tau_px,
            tau_reached_px: counters.tau_px,
            worst_error_px: counters.worst_error_px,
            nodes_drawn: counters.drawn,
            meshes_drawn: counters.meshes,
            triangles_drawn: counters.triangles,
            unconverged_share: None,
        }
    }
}

/// Runs when it goes.
struct OnDrop<F: FnMut()>(F);

impl<F: FnMut()> Drop for OnDrop<F> {
    fn drop(&mut self) {
        (self.0)();
    }
}
