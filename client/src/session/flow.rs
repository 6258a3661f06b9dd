//! What streams: select, request, decode, upload.
//!
//! In: a camera each frame. Out: the cut, what it lacks, counters. Next: `session` draws.
//!
//! The network does not wait for frames: while one is drawn, what arrives is taken in and the next requests start
//! ([`Flow::go_on`]). Only uploads wait, as the atlas is being read.

use super::{
    around::{Around, SMALLER},
    tau::Raised,
    wave::Wave,
};
use crate::{
    cache::{Cache, PAGE_BYTES, Packed, Placement, Upload},
    camera::{Camera, View},
    error::{ClientError, Result},
    render::{Drawn, FrameData, Look},
    report::TileCounts,
    scene::{Key, TileEvent, TileState, Tree},
    select::{
        Counters, HIDDEN_TIMES_TAU, Scratch, Selection,
        casters::{Casters, casters},
        fade::Fades,
        priority::{Group, Wanted},
        select,
        sight::{Asked, Sight},
    },
    stream::{Arrival, Stream},
};
use glam::DVec3;
use insula_protocol::{Subtree, TileId, TileKind};
use std::{
    collections::{HashSet, VecDeque},
    ops::Range,
    time::{Duration, Instant},
};

/// Bytes that a second's frames upload, and least and most bytes that one does; a single node may exceed them.
const UPLOAD_BYTES_PER_SEC: f64 = 512e6;
const UPLOAD_BYTES: Range<f64> = 8e6..64e6;
/// Decoded nodes that may wait for their upload.
const DECODED_BYTES: u64 = 32 << 20;
/// Subtrees that may wait for what they hang on.
const ORPHANS: usize = 16;
/// Share of the atlas that a view may fill; the rest is for what it needed a moment ago.
const BUDGET_SHARE: f64 = 0.85;
/// Share of the atlas that must be free to fetch what only may be wanted.
const SPARE_SHARE: f64 = 0.1;
/// What is over so many times tau is asked for whether it is seen or not.
const UNSEEN_TIMES_TAU: f64 = 4.0;
/// Turns in which the first picture may tell what is seen; after them nobody will.
const BLIND_TURNS: u32 = 8;
/// Requests that start while a picture is drawn, for what only the last one saw: so many times those that may be in flight.
const FINE_TIMES_WINDOW: usize = 2;
/// While nothing arrives, retries are looked after so often.
const PATIENCE: Duration = Duration::from_millis(10);

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

/// What is beside a picture.
pub(super) enum Beside {
    /// A small picture has to be drawn to tell what is seen there.
    Unseen(Box<FrameData>),
    /// Tiles that are to come.
    Lacking,
    /// Nothing that is not known and here.
    Nothing,
}

/// All of a session but what draws.
pub(super) struct Flow {
    pub(super) tree: Tree,
    pub(super) cache: Cache,
    pub(super) stream: Stream,
    pub(super) selection: Selection,
    pub(super) sight: Sight,
    pub(super) fades: Fades,
    pub(super) tiles: TileCounts,
    pub(super) evicted: u64,
    pub(super) fetched_again: u64,
    pub(super) around: Around,
    scratch: Scratch,
    /// Towards the sun, if it casts shadows, and what casts them in the last selection.
    sun: Option<DVec3>,
    casters: Casters,
    /// Counts selections that differ from the one before.
    generation: u64,
    last_view: Option<View>,
    /// What the last selection was for, and when.
    shot: Option<Shot>,
    selected_at: Instant,
    stepped_at: Instant,
    raised: Raised,
    decoded: VecDeque<(Key, Packed)>,
    decoded_bytes: u64,
    uploaded_at: Instant,
    /// Subtrees that came before what they hang on.
    orphans: Vec<(Key, Subtree)>,
    /// Tiles that were evicted once.
    left: HashSet<Key>,
    /// Something came in after the last selection.
    fresh: bool,
    wave: Wave,
    /// Turns since there is something to draw whose picture has told nothing yet.
    blind_turns: u32,
}

impl Flow {
    /// Nothing fetched yet, with room for `pages` pages.
    pub(super) fn new(tree: Tree, stream: Stream, pages: u32) -> Self {
        Self {
            tree,
            cache: Cache::new(pages),
            stream,
            selection: Selection::default(),
            sight: Sight::default(),
            fades: Fades::default(),
            tiles: TileCounts::default(),
            evicted: 0,
            fetched_again: 0,
            around: Around::default(),
            scratch: Scratch::default(),
            sun: None,
            casters: Casters::default(),
            generation: 0,
            last_view: None,
            shot: None,
            selected_at: Instant::now(),
            stepped_at: Instant::now(),
            raised: Raised::default(),
            decoded: VecDeque::new(),
            decoded_bytes: 0,
            uploaded_at: Instant::now(),
            orphans: Vec::new(),
            left: HashSet::new(),
            fresh: false,
            wave: Wave::default(),
            blind_turns: 0,
        }
    }

    /// The view of a shot, with this cache's budget.
    pub(super) fn view(&self, shot: &Shot, camera: Camera) -> View {
        let pages = f64::from(self.cache.capacity_pages()) * BUDGET_SHARE;
        View {
            camera,
            width_px: shot.size_px[0],
            height_px: shot.size_px[1],
            tau_px: shot.tau_px * self.raised.times(),
            budget_pages: pages as u32,
            budget_nodes: crate::cache::slots_for(pages as u32),
        }
    }

    /// One turn of the loop but for drawing.
    pub(super) fn step(&mut self, shot: &Shot, upload: &mut impl Upload) {
        let now = Instant::now();
        self.collect(now);
        self.turn(shot, now);
        // What came in is drawn in this frame.
        if self.upload(upload, now) {
            self.turn(shot, now);
        }
        let secs = now.duration_since(self.stepped_at).as_secs_f64();
        self.stepped_at = now;
        // A picture of other squares than the last one: what it hits shall be told.
        self.generation += u64::from(self.fades.step(&self.selection, &self.tree, secs));
    }

    /// Selects, and asks for what is missing.
    pub(super) fn turn(&mut self, shot: &Shot, now: Instant) {
        self.select(shot, now);
        let wanted = if self.around.is_of(shot) {
            self.beside_it(now)
        } else if self.is_blind() && self.blind_turns < BLIND_TURNS {
            self.blind_turns += u32::from(!self.selection.cut.is_empty());
            self.first(shot.tau_px)
        } else {
            self.wave(&self.selection.wanted, self.selection.wanted.clone(), now)
        };
        self.stream.request(&mut self.tree, &wanted, now);
    }

    /// What is to be asked for now of what lies beside the picture: no more than there is room for that nobody uses.
    fn beside_it(&self, now: Instant) -> Vec<Wanted> {
        let wanted = &self.around.selection().wanted;
        let mut room = self.spare_pages();
        let mut fits = |w: &Wanted| {
            let pages = self.tree.pages_of_tile(w.key);
            let fits = pages <= room;
            room = room.saturating_sub(pages);
            fits
        };
        let asked = wanted.iter().copied().take_while(|w| fits(w)).collect();
        self.wave(wanted, asked, now)
    }

    /// Which of `wanted` are to be asked for now, as `all` are wanted.
    fn wave(&self, all: &[Wanted], wanted: Vec<Wanted>, now: Instant) -> Vec<Wanted> {
        // While nothing comes from the server, what needs none must not wait for what does.
        match self.last_view {
            Some(view) if !self.is_blind() && self.stream.failing_since().is_none() => {
                self.wave.front(all, wanted, (&self.tree, &view), |key| self.stream.begun(key), now)
            }
            _ => wanted,
        }
    }

    /// Whether no picture has told yet what is seen.
    fn is_blind(&self) -> bool {
        !self.sight.is_fed()
    }

    /// What is wanted before a picture has told what is seen: the root, which shows where that is, what tells of near squares, so
    /// that rays tell them apart, and what is under way.
    fn first(&self, tau_px: f64) -> Vec<Wanted> {
        let tells = |w: &Wanted| w.key.layer() == TileKind::Subtree && w.weight > HIDDEN_TIMES_TAU * tau_px;
        let is_first = |w: &&Wanted| w.key == Key::block_map(TileId::ROOT) || tells(w) || self.is_loading(w.key);
        self.selection.wanted.iter().filter(is_first).copied().collect()
    }

    /// What is wanted and wrong by more than `most_px`, or under way, and `more` of the rest.
    fn coarse(&self, most_px: f64, mut more: usize) -> Vec<Wanted> {
        let is_taken = |w: &&Wanted| {
            let is_free = w.weight > most_px || self.is_loading(w.key);
            let is_taken = is_free || more > 0;
            more -= usize::from(is_taken && !is_free);
            is_taken
        };
        self.selection.wanted.iter().filter(is_taken).copied().collect()
    }

    fn select(&mut self, shot: &Shot, now: Instant) {
        self.cache.begin_frame();
        self.fresh = false;
        if self.around.is_of(shot) {
            // The picture rests: what comes now shall not make it another one.
            self.touch();
            self.select_around(shot);
            return;
        }
        self.around.forget();
        let view = self.view(shot, shot.camera);
        let moved = self.shot.replace(*shot) != Some(*shot);
        let selection = select(&view, &self.tree, &self.sight, &mut self.scratch);
        if selection.cut != self.selection.cut || self.last_view != Some(view) {
            self.generation += 1;
        }
        (self.selection, self.last_view) = (selection, Some(view));
        let Counters { tau_px, pages, .. } = self.selection.counters;
        let share = f64::from(pages) / f64::from(view.budget_pages.max(1));
        let secs = now.duration_since(self.selected_at).as_secs_f64();
        self.raised.learn(tau_px / shot.tau_px, share, secs, moved);
        self.selected_at = now;
        self.cast(&view);
        self.touch();
        if let Some(heading) = shot.heading {
            self.preload(shot, heading);
        }
    }

    /// Tells the cache what the selection needs.
    fn touch(&mut self) {
        for (square, face) in self.fades.kept() {
            self.cache.keep(Key::block_map(self.tree.node(face.from).id));
            let leaf = self.tree.node(square).id;
            face.mesh.iter().for_each(|lod| self.cache.keep(Key::mesh(leaf, *lod)));
        }
        // The coarsest last: of equals, it goes last.
        for at in self.selection.used.iter().rev() {
            self.cache.touch(Key::block_map(self.tree.node(*at).id));
        }
        for key in &self.selection.used_meshes {
            self.cache.touch(*key);
        }
        for at in self.casters.nodes.iter().rev() {
            self.cache.touch(Key::block_map(self.tree.node(*at).id));
        }
    }

    /// Begins for a shot before there is an adapter, until there is one.
    pub(super) fn begin(&mut self, shot: &Shot, is_ready: impl Fn() -> bool) {
        self.turn(shot, Instant::now());
        self.go_on(is_ready);
    }

    /// Keeps the network busy for the last shot until `is_over`: takes in what arrives, asks for the next. Whoever ends it
    /// rings the stream's bell, or it takes a moment.
    pub(super) fn go_on(&mut self, is_over: impl Fn() -> bool) {
        let bell = self.stream.bell();
        // What is being drawn will tell what is hidden: only what is coarse is asked for whether it is seen or not, and no more
        // of the rest than lately was seen, nearest first.
        let mut fine = FINE_TIMES_WINDOW * self.stream.window();
        while let Some(shot) = self.shot
            && !is_over()
        {
            bell.wait(PATIENCE);
            let now = Instant::now();
            // Nothing is uploaded meanwhile: only what a subtree tells of can change what is wanted.
            if self.collect(now) {
                self.select(&shot, now);
            }
            let wanted = if self.around.is_of(&shot) {
                self.beside_it(now)
            } else if self.is_blind() {
                self.first(shot.tau_px)
            } else {
                self.wave(&self.selection.wanted, self.coarse(UNSEEN_TIMES_TAU * shot.tau_px, fine), now)
            };
            fine = fine.saturating_sub(self.stream.request(&mut self.tree, &wanted, now));
        }
    }

    fn is_loading(&self, key: Key) -> bool {
        self.tree.tile(key).is_some_and(|tile| tile.state() == TileState::Loading)
    }

    /// Whether nothing is wanted and nothing is under way.
    pub(super) fn is_still(&self) -> bool {
        self.selection.wanted.is_empty() && self.stream.in_flight() == 0
    }

    /// Towards the sun, if what is out of the picture shall cast shadows into it: a [`Look::casting`].
    pub(super) fn set_sun(&mut self, sun: Option<DVec3>) {
        if self.sun != sun {
            self.sun = sun;
            self.around.forget();
        }
    }

    /// What casts shadows on the last selection, within the room that this leaves.
    fn cast(&mut self, view: &View) {
        let Selection { counters, .. } = &self.selection;
        let budget_pages =
            (self.cache.capacity_pages() - self.cache.capacity_pages() / 32).saturating_sub(counters.pages);
        let budget_nodes = crate::cache::slots_for(self.cache.capacity_pages()).saturating_sub(counters.visited);
        let view = View { budget_pages, budget_nodes, tau_px: counters.tau_px, ..*view };
        let picture = self.sight.is_fed().then_some(&self.selection);
        self.casters = self.sun.map(|sun| casters(&view, sun, &self.tree, picture)).unwrap_or_default();
        let wanted: HashSet<Key> = self.selection.wanted.iter().map(|w| w.key).collect();
        self.selection.wanted.extend(self.casters.wanted.iter().filter(|w| !wanted.contains(&w.key)));
    }

    /// What the camera will want in a moment, as long as there is room that nobody uses.
    fn preload(&mut self, shot: &Shot, heading: Camera) {
        if self.selection.wanted.iter().any(|w| w.group == Group::Urgent) || self.spare_pages() == 0 {
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

    /// Pages that may be filled and still leave [`SPARE_SHARE`] free.
    fn spare_pages(&self) -> u32 {
        let kept = (SPARE_SHARE * f64::from(self.cache.capacity_pages())) as u32;
        let decoded = (self.decoded_bytes / PAGE_BYTES) as u32;
        self.cache.free_pages().saturating_sub(kept).saturating_sub(decoded)
    }

    /// Selects what is beside a shot, as long as there is room that nobody uses.
    fn select_around(&mut self, shot: &Shot) {
        if let Some(camera) = self.around.camera() {
            self.around.select(&self.view(shot, camera), &self.tree, &mut self.scratch);
        }
        let first = self.around.selection().wanted.first();
        if self.decoded.is_empty() && first.is_some_and(|w| self.tree.pages_of_tile(w.key) > self.spare_pages()) {
            self.around.end();
        }
    }

    /// What is beside a shot; nothing while the shot's own picture changes, or if there is no room for more.
    pub(super) fn beside(&mut self, shot: &Shot) -> Beside {
        if self.shot != Some(*shot) || !self.settled() || self.is_blind() {
            return Beside::Nothing;
        }
        if !self.around.is_of(shot) {
            self.around.begin(shot, &self.sight);
            self.select_around(shot);
        }
        let small = Shot { size_px: shot.size_px.map(|side| (side / SMALLER).max(1)), ..*shot };
        while let Some(camera) = self.around.camera() {
            if !self.around.has_looked(small.size_px) {
                let around = &self.around;
                let drawn =
                    Drawn { fades: around.shown(), casters: &[], generation: around.generation(), error_px: 0.0 };
                let view = self.view(&small, camera);
                return Beside::Unseen(FrameData::new(drawn, &self.tree, &self.cache, &view, &Look::default()).into());
            }
            if !self.around.selection().wanted.is_empty() || !self.decoded.is_empty() {
                return Beside::Lacking;
            }
            self.around.next(&self.sight);
            self.select_around(shot);
        }
        Beside::Nothing
    }

    /// Takes in what the rays of such a picture hit.
    pub(super) fn feed_beside(&mut self, shot: &Shot, asked: &Asked, pixels: &[u32]) {
        let whole = self.around.selection().wanted.is_empty() && self.decoded.is_empty();
        self.around.feed(asked, pixels, whole, &self.tree);
        self.wave.told_all();
        self.select_around(shot);
    }

    /// Takes in what has arrived; whether nodes became known.
    fn collect(&mut self, now: Instant) -> bool {
        let known = self.tree.nodes().len();
        while self.decoded_bytes < DECODED_BYTES
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
                    self.hold(key, Packed::Node(node));
                }
                Arrival::Mesh(key, mesh) => {
                    self.tree.set_mesh_pages(key, mesh.pages.len() as u32);
                    self.hold(key, Packed::Mesh(mesh));
                }
            }
        }
        self.tree.nodes().len() > known
    }

    fn hold(&mut self, key: Key, packed: Packed) {
        self.decoded_bytes += bytes_of(&packed);
        self.decoded.push_back((key, packed));
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

    /// Puts what is decoded into the cache, as far as a frame has time; whether there was anything.
    fn upload(&mut self, upload: &mut impl Upload, now: Instant) -> bool {
        let secs = now.duration_since(self.uploaded_at).as_secs_f64();
        let most = (secs * UPLOAD_BYTES_PER_SEC).clamp(UPLOAD_BYTES.start, UPLOAD_BYTES.end) as u64;
        self.uploaded_at = now;
        self.wave.pass(now);
        let mut bytes = 0;
        while bytes < most
            && let Some((key, packed)) = self.decoded.pop_front()
        {
            self.decoded_bytes -= bytes_of(&packed);
            bytes += bytes_of(&packed);
            let is_mesh = matches!(packed, Packed::Mesh(_));
            let (event, evicted) = match self.cache.place(key, packed, upload) {
                Placement::Placed { evicted } => (TileEvent::Upload, evicted),
                Placement::Full { evicted } => (TileEvent::Drop, evicted),
            };
            let arrived = if is_mesh { &mut self.tiles.meshes } else { &mut self.tiles.blockmaps };
            *arrived += u64::from(event == TileEvent::Upload);
            self.fetched_again += u64::from(self.left.contains(&key));
            self.evicted += evicted.len() as u64;
            self.tree.apply(key, event);
            self.wave.came(key, self.generation + 1, now);
            for key in evicted {
                self.left.insert(key);
                self.tree.apply(key, TileEvent::Drop);
            }
        }
        bytes > 0
    }

    /// Whether nothing could make the last selection's picture better.
    pub(super) fn settled(&self) -> bool {
        self.fetched()
            && !self.raised.moves()
            && self.fades.passing() == 0
            && (self.is_sighted([0, 0]) || !self.sight.is_fed())
    }

    /// Whether what comes is for what lies beside the picture.
    fn rests(&self) -> bool {
        self.shot.is_some_and(|shot| self.around.is_of(&shot))
    }

    /// Whether all that the last selection asks for is here.
    pub(super) fn fetched(&self) -> bool {
        self.tree.root().is_some() && self.selection.wanted.is_empty() && (self.decoded.is_empty() || self.rests())
    }

    /// Whether it is known what the rays of the last selection hit, in a picture of at least this size, and they changed
    /// nothing.
    pub(super) fn is_sighted(&self, size_px: [u32; 2]) -> bool {
        self.sight.has_looked(self.generation, size_px)
    }

    /// Takes in what the rays of a picture hit: `pixels` of each of the squares that it was drawn with.
    pub(super) fn feed(&mut self, asked: &Asked, pixels: &[u32]) {
        if !self.sight.has_looked(asked.generation, [asked.view.width_px, asked.view.height_px]) {
            let whole = self.fetched();
            self.sight.feed(asked, pixels, whole, &self.tree);
            self.wave.told(asked.generation);
            self.around.forget();
            self.fresh = true;
        }
    }

    /// Whether the next frame has something to upload, or to select anew: no need to wait for the network.
    pub(super) fn streaming_now(&self) -> bool {
        let came = !self.decoded.is_empty() || self.fresh;
        came && !self.rests() || self.raised.moves() || self.fades.passing() > 0
    }

    /// An error if the city has no root to begin with, or the server does not answer for `timeout`.
    pub(super) fn check(&self, timeout: Duration) -> Result<()> {
        let root = [Key::subtree(TileId::ROOT), Key::block_map(TileId::ROOT)];
        if root.iter().any(|key| self.tree.tile(*key).is_some_and(|tile| tile.is_bad())) {
            let name = &self.tree.manifest().name;
            return Err(ClientError::Server(format!(
                "the root tile of city {name} is missing or damaged: run insula-server verify on the city"
            )));
        }
        self.stream.check_reachable(Instant::now(), timeout)
    }

    /// What the ray-caster needs for the last selection.
    pub(super) fn frame_data(&self, shot: &Shot, look: &Look) -> FrameData {
        let (fades, casters) = (&self.fades, &self.casters.nodes[..]);
        let error_px = self.selection.counters.seen_error_px;
        let drawn = Drawn { fades, casters, generation: self.generation, error_px };
        FrameData::new(drawn, &self.tree, &self.cache, &self.view(shot, shot.camera), look)
    }

    /// Whether the last selection's picture lacks anything.
    pub(super) fn lacks(&self) -> bool {
        self.selection.wanted.iter().any(|wanted| wanted.group != Group::Preload)
    }
}

fn bytes_of(packed: &Packed) -> u64 {
    packed.pages().len() as u64 * PAGE_BYTES
}
