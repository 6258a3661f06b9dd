//! The loop that every command shares: select, request, decode, upload, draw.
//!
//! In: a camera each frame. Out: the cut, pictures, counters. Next: `ui::window`, `commands::snapshot`, `commands::fly`.

use crate::{
    cache::{Cache, PAGE_BYTES, Packed, Placement},
    camera::{Camera, View},
    error::{ClientError, Result},
    render::{Adapter, AdapterInfo, Drawn, FrameData, Look},
    report::{FrameTimes, Report, TileCounts},
    scene::{Key, TileEvent, Tree, TreeNode},
    select::{
        Scratch, Selection,
        casters::{Casters, casters},
        priority::Group,
        select,
        sight::{Asked, Sight},
    },
    stream::{Arrival, Stream},
};
use glam::DVec3;
use insula_protocol::{Subtree, TileId};
use insula_shaders::cpu::{raycast::Pixels, tally::tally};
use std::{
    collections::{HashSet, VecDeque},
    time::{Duration, Instant},
};

/// Most bytes that one frame uploads; one node may exceed it.
const UPLOAD_BYTES: u64 = 8 << 20;
/// Decoded nodes that may wait for their upload.
const DECODED_NODES: usize = 64;
/// Subtrees that may wait for what they hang on.
const ORPHANS: usize = 16;
/// Share of the atlas that a view may fill; the rest is for what it needed a moment ago.
const BUDGET_SHARE: f64 = 0.85;
/// Frame times that are kept.
const TIMES: usize = 100_000;

/// What one frame is asked for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shot {
    /// Where from.
    pub camera: Camera,
    /// Where the camera will be in a moment, if it moves.
    pub heading: Option<Camera>,
    /// Picture size.
    pub size_px: [u32; 2],
    /// Tolerated error.
    pub tau_px: f64,
}

/// A city that is being looked at.
pub struct Session {
    tree: Tree,
    cache: Cache,
    stream: Stream,
    adapter: Adapter,
    info: AdapterInfo,
    scratch: Scratch,
    selection: Selection,
    /// Towards the sun, if it casts shadows, and what casts them in the last selection.
    sun: Option<DVec3>,
    casters: Casters,
    sight: Sight,
    /// Counts selections that differ from the one before.
    generation: u64,
    last_view: Option<View>,
    decoded: VecDeque<(Key, Packed)>,
    /// Subtrees that came before what they hang on.
    orphans: Vec<(Key, Subtree)>,
    tiles: TileCounts,
    times: Vec<Duration>,
    evicted: u64,
    /// Tiles that were evicted once, and how many of them came again.
    left: HashSet<Key>,
    fetched_again: u64,
    started: Instant,
    first_picture: Option<Duration>,
    converged: Option<Duration>,
    asked_tau_px: f64,
    /// Something came in after the last selection.
    fresh: bool,
}

impl Session {
    /// Nothing fetched yet. `pages` is what `adapter` has room for; `started` is when the command began.
    pub fn new(
        tree: Tree,
        stream: Stream,
        (adapter, info, pages): (Adapter, AdapterInfo, u32),
        started: Instant,
    ) -> Self {
        Self {
            tree,
            cache: Cache::new(pages),
            stream,
            adapter,
            info,
            scratch: Scratch::default(),
            selection: Selection::default(),
            sun: None,
            casters: Casters::default(),
            sight: Sight::default(),
            generation: 0,
            last_view: None,
            decoded: VecDeque::new(),
            orphans: Vec::new(),
            tiles: TileCounts::default(),
            times: Vec::new(),
            evicted: 0,
            left: HashSet::new(),
            fetched_again: 0,
            started,
            first_picture: None,
            converged: None,
            asked_tau_px: 1.0,
            fresh: false,
        }
    }

    /// The view of a shot, with this cache's budget.
    pub fn view(&self, shot: &Shot, camera: Camera) -> View {
        let pages = f64::from(self.cache.capacity_pages()) * BUDGET_SHARE;
        View {
            camera,
            width_px: shot.size_px[0],
            height_px: shot.size_px[1],
            tau_px: shot.tau_px,
            budget_pages: pages as u32,
            budget_nodes: crate::cache::slots_for(pages as u32),
        }
    }

    /// One turn of the loop but for drawing.
    pub fn step(&mut self, shot: &Shot) {
        let now = Instant::now();
        let view = self.view(shot, shot.camera);
        self.cache.begin_frame();
        self.asked_tau_px = shot.tau_px;
        self.fresh = false;
        let selection = select(&view, &self.tree, &self.sight, &mut self.scratch);
        if selection.cut != self.selection.cut || self.last_view != Some(view) {
            self.generation += 1;
        }
        (self.selection, self.last_view) = (selection, Some(view));
        // The coarsest last: of equals, it goes last.
        for at in self.selection.used.iter().rev() {
            self.cache.touch(Key::block_map(self.tree.node(*at).id));
        }
        for key in &self.selection.used_meshes {
            self.cache.touch(*key);
        }
        self.cast(&view);
        if let Some(heading) = shot.heading {
            self.preload(shot, heading);
        }
        self.stream.request(&mut self.tree, &self.selection.wanted, now);
        self.collect(now);
        self.upload();
        let elapsed = self.started.elapsed();
        if !self.selection.cut.is_empty() {
            self.first_picture.get_or_insert(elapsed);
        }
        if self.settled() {
            self.converged.get_or_insert(elapsed);
        }
    }

    /// Towards the sun, if what is out of the picture shall cast shadows into it: a [`Look::casting`].
    pub fn set_sun(&mut self, sun: Option<DVec3>) {
        self.sun = sun;
    }

    /// What casts shadows on the last selection, within the room that this leaves.
    fn cast(&mut self, view: &View) {
        let Selection { counters, .. } = &self.selection;
        let budget_pages =
            (self.cache.capacity_pages() - self.cache.capacity_pages() / 32).saturating_sub(counters.pages);
        let budget_nodes = crate::cache::slots_for(self.cache.capacity_pages()).saturating_sub(counters.visited);
        let view = View { budget_pages, budget_nodes, tau_px: counters.tau_px, ..*view };
        let receivers = self.sight.is_fed().then_some(&self.selection.seen[..]);
        self.casters = self.sun.map(|sun| casters(&view, sun, &self.tree, receivers)).unwrap_or_default();
        for at in self.casters.nodes.iter().rev() {
            self.cache.touch(Key::block_map(self.tree.node(*at).id));
        }
        let wanted: HashSet<Key> = self.selection.wanted.iter().map(|w| w.key).collect();
        self.selection.wanted.extend(self.casters.wanted.iter().filter(|w| !wanted.contains(&w.key)));
    }

    /// What the camera will want in a moment, as long as there is room that nobody uses.
    fn preload(&mut self, shot: &Shot, heading: Camera) {
        let free_share = f64::from(self.cache.free_pages()) / f64::from(self.cache.capacity_pages().max(1));
        if self.selection.wanted.iter().any(|w| w.group == Group::Urgent) || free_share < 0.1 {
            return;
        }
        let ahead = select(&self.view(shot, heading), &self.tree, &self.sight, &mut self.scratch);
        for mut wanted in ahead.wanted {
            if !self.selection.wanted.iter().any(|w| w.key == wanted.key) {
                wanted.group = Group::Preload;
                self.selection.wanted.push(wanted);
            }
        }
    }

    fn collect(&mut self, now: Instant) {
        while self.decoded.len() < DECODED_NODES
            && let Some(arrival) = self.stream.arrival(&mut self.tree, now)
        {
            self.fresh = true;
            match arrival {
                Arrival::Subtree(key, subtree) => {
                    self.orphans.push((key, subtree));
                    self.adopt();
                }
                Arrival::Node(key, node) => {
                    self.tree.set_pages(key.id, node.pages.len() as u32);
                    self.decoded.push_back((key, Packed::Node(node)));
                }
                Arrival::Mesh(key, mesh) => {
                    self.tree.set_mesh_pages(key, mesh.pages.len() as u32);
                    self.decoded.push_back((key, Packed::Mesh(mesh)));
                }
            }
        }
    }

    /// Merges the subtrees whose nodes hang on known ones. The others wait for what they hang on: it is under way, or was
    /// lost and is asked for again; there are few, one a level of subtrees.
    fn adopt(&mut self) {
        while let Some(at) = self.orphans.iter().position(|(key, _)| self.hangs(*key)) {
            let (key, subtree) = self.orphans.swap_remove(at);
            self.tree.merge(&subtree);
            self.tree.apply(key, TileEvent::Upload);
            self.tiles.subtrees += 1;
        }
        if self.orphans.len() > ORPHANS {
            let (key, _) = self.orphans.remove(0);
            self.tree.apply(key, TileEvent::Drop);
        }
    }

    fn hangs(&self, key: Key) -> bool {
        key.id == TileId::ROOT || self.tree.find(key.id).is_some()
    }

    fn upload(&mut self) {
        let mut bytes = 0;
        while bytes < UPLOAD_BYTES
            && let Some((key, packed)) = self.decoded.pop_front()
        {
            bytes += packed.pages().len() as u64 * PAGE_BYTES;
            let is_mesh = matches!(packed, Packed::Mesh(_));
            let (event, evicted) = match self.cache.place(key, packed, &mut self.adapter) {
                Placement::Placed { evicted } => (TileEvent::Upload, evicted),
                Placement::Full { evicted } => (TileEvent::Drop, evicted),
            };
            self.fresh = true;
            let arrived = if is_mesh { &mut self.tiles.meshes } else { &mut self.tiles.blockmaps };
            *arrived += u64::from(event == TileEvent::Upload);
            self.fetched_again += u64::from(self.left.contains(&key));
            self.evicted += evicted.len() as u64;
            self.tree.apply(key, event);
            for key in evicted {
                self.left.insert(key);
                self.tree.apply(key, TileEvent::Drop);
            }
        }
    }

    /// Whether nothing could make the last selection's picture better.
    pub fn settled(&self) -> bool {
        self.fetched() && (self.is_sighted([0, 0]) || !self.sight.is_fed())
    }

    /// Whether all that the last selection asks for is here.
    pub fn fetched(&self) -> bool {
        self.tree.root().is_some() && self.selection.wanted.is_empty() && self.decoded.is_empty()
    }

    /// Whether it is known what the rays of the last selection hit, in a picture of at least this size, and they changed
    /// nothing.
    pub fn is_sighted(&self, size_px: [u32; 2]) -> bool {
        self.sight.has_looked(self.generation, size_px)
    }

    /// Whether anything can be drawn.
    pub fn has_picture(&self) -> bool {
        !self.selection.cut.is_empty()
    }

    /// Takes in what the rays of a picture hit: `pixels` of each of the squares that it was drawn with.
    pub fn feed(&mut self, asked: &Asked, pixels: &[u32]) {
        if !self.sight.has_looked(asked.generation, [asked.view.width_px, asked.view.height_px]) {
            let whole = self.fetched();
            self.sight.feed(asked, pixels, whole, &self.tree);
            self.fresh = true;
        }
    }

    /// What the last pictures' rays hit.
    pub fn sight(&self) -> &Sight {
        &self.sight
    }

    /// Whether the next frame has something to upload, or to select anew: no need to wait for the network.
    pub fn streaming_now(&self) -> bool {
        !self.decoded.is_empty() || self.fresh
    }

    /// What the last shot asked for.
    pub fn asked_tau_px(&self) -> f64 {
        self.asked_tau_px
    }

    /// An error if the city has no root to begin with, or the server does not answer for `timeout`.
    pub fn check(&self, timeout: Duration) -> Result<()> {
        let root_bad = self.tree.subtree(TileId::ROOT).is_bad()
            || self.tree.root().is_some_and(|root| self.tree.node(root).tile.is_bad());
        if root_bad {
            let name = &self.tree.manifest().name;
            return Err(ClientError::Server(format!(
                "the root tile of city {name} is missing or damaged: run insula-server verify on the city"
            )));
        }
        self.stream.check_reachable(Instant::now(), timeout)
    }

    /// What the ray-caster needs for the last selection.
    pub fn frame_data(&self, shot: &Shot, look: &Look) -> FrameData {
        let (cut, casters) = (&self.selection.cut[..], &self.casters.nodes[..]);
        let drawn = Drawn { cut, casters, generation: self.generation };
        FrameData::new(drawn, &self.tree, &self.cache, &self.view(shot, shot.camera), look)
    }

    /// Draws the last selection, waits for the pixels, and takes in what they hit.
    pub fn draw(&mut self, shot: &Shot, look: &Look) -> Result<Pixels> {
        let data = self.frame_data(shot, look);
        let pixels = self.adapter.draw(&data)?;
        self.feed(&data.asked, &tally(&pixels.hit, data.nodes.len()));
        Ok(pixels)
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
        self.evicted
    }

    /// Tiles that came again after they had left.
    pub fn fetched_again(&self) -> u64 {
        self.fetched_again
    }

    /// Whether the last selection's picture lacks anything.
    pub fn lacks(&self) -> bool {
        self.selection.wanted.iter().any(|wanted| wanted.group != Group::Preload)
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
        &self.tree
    }

    /// The last selection.
    pub fn selection(&self) -> &Selection {
        &self.selection
    }

    /// The atlas.
    pub fn cache(&self) -> &Cache {
        &self.cache
    }

    /// The network.
    pub fn stream(&self) -> &Stream {
        &self.stream
    }

    /// What it all cost so far.
    pub fn report(&self, tau_px: f64) -> Report {
        let manifest = self.tree.manifest();
        let bad_meshes = |n: &TreeNode| n.lods.iter().filter(|lod| lod.tile.is_bad()).count();
        let bad = |n: &TreeNode| usize::from(n.tile.is_bad()) + bad_meshes(n);
        let bad = self.tree.nodes().iter().map(bad).sum::<usize>() as u64;
        let counters = self.selection.counters;
        Report {
            city: manifest.name.clone(),
            version: manifest.version.clone(),
            bytes_fetched: self.stream.http().bytes(),
            requests: self.stream.http().requests(),
            tiles: TileCounts { bad, ..self.tiles },
            frame_times: FrameTimes::new(&self.times),
            time_to_first_picture_secs: self.first_picture.map(|t| t.as_secs_f64()),
            time_to_converged_picture_secs: self.converged.map(|t| t.as_secs_f64()),
            peak_cache_bytes: self.cache.peak_bytes(),
            cache_bytes: u64::from(self.cache.capacity_pages()) * PAGE_BYTES,
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
