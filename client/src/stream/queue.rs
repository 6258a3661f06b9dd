//! Which requests to start and which to cancel, frame by frame.
//!
//! In: [`Wanted`] in order, the tree's states. Out: [`Plan`]. Next: `stream` does it.

use crate::{
    scene::{
        Key, TileEvent, TileState, Tree,
        tile::{RETRY_AFTER_MOST, wait_after},
    },
    select::priority::Wanted,
};
use std::{
    collections::HashSet,
    hash::{BuildHasher, Hasher, RandomState},
    time::{Duration, Instant},
};

/// Most requests in flight, of those at the beginning.
const WINDOW_TIMES: usize = 4;
/// A line that is as short as this is full with few requests.
const NEAR: Duration = Duration::from_millis(10);
/// Answers may take so much longer by chance.
const NOISE: Duration = Duration::from_millis(5);

/// What to do in this frame.
#[derive(Debug, Default, PartialEq, Eq)]
pub struct Plan {
    /// Under way, no longer wanted.
    pub cancel: Vec<Key>,
    /// Wanted most, as many as may be in flight.
    pub start: Vec<Key>,
}

/// What is queued and what is under way.
#[derive(Debug)]
pub struct Queue {
    /// How many requests may be in flight.
    pub window: Window,
    queued: HashSet<Key>,
    flying: HashSet<Key>,
    /// Closed while the server does not answer.
    pub gate: Gate,
}

impl Queue {
    /// With `least` requests in flight to begin with.
    pub fn new(least: usize) -> Self {
        let window = Window::new(least);
        Self { window, queued: HashSet::new(), flying: HashSet::new(), gate: Gate::default() }
    }

    /// Brings the tiles' states in line with `wanted`, and says what follows. `near`: what needs no network may start while
    /// the server does not answer.
    pub fn plan(&mut self, tree: &mut Tree, wanted: &[Wanted], now: Instant, near: impl Fn(Key) -> bool) -> Plan {
        let mut plan = Plan::default();
        let keys: HashSet<Key> = wanted.iter().map(|w| w.key).collect();
        for key in self.queued.extract_if(|key| !keys.contains(key)) {
            tree.apply(key, TileEvent::Drop);
        }
        for key in self.flying.extract_if(|key| !keys.contains(key)) {
            tree.apply(key, TileEvent::Drop);
            plan.cancel.push(key);
        }
        let limit = self.window.limit();
        let open = self.gate.limit(now, limit);
        for Wanted { key, .. } in wanted {
            if tree.apply(*key, TileEvent::Want { now }) {
                self.queued.insert(*key);
            }
            let queued = tree.tile(*key).is_some_and(|tile| tile.state() == TileState::Queued);
            let room = |limit: usize| self.flying.len() < limit;
            let may_start = queued && (room(open) || open < limit && room(limit) && near(*key));
            if may_start && tree.apply(*key, TileEvent::Start) {
                self.queued.remove(key);
                self.flying.insert(*key);
                plan.start.push(*key);
            }
        }
        plan
    }

    /// A request is over, well or not.
    pub fn landed(&mut self, key: Key) {
        self.flying.remove(&key);
    }
}

/// As many requests in flight as keep the line full: more while answers take no longer for it, fewer when they do. Every
/// answer that is queued on the line delays what is wanted more by the time that it comes.
#[derive(Debug)]
pub struct Window {
    least: usize,
    limit: usize,
    /// What an answer takes that waits for no other.
    fastest: Duration,
}

impl Window {
    fn new(least: usize) -> Self {
        let least = least.max(1);
        Self { least, limit: least, fastest: Duration::MAX }
    }

    /// How many may be in flight.
    pub fn limit(&self) -> usize {
        self.limit
    }

    /// An answer came `took` after it was asked for.
    pub fn answered(&mut self, took: Duration) {
        // Forgotten in time: the way may have become longer.
        self.fastest = self.fastest.saturating_add(self.fastest / 256).min(took);
        if self.fastest > NEAR && took < self.fastest + self.fastest / 2 + NOISE {
            self.limit = (self.limit + 1).min(self.least * WINDOW_TIMES);
        } else if took > self.fastest * 3 + NOISE {
            self.limit = (self.limit - 1).max(self.least);
        }
    }

    /// A request failed for no fault of its own.
    pub fn failed(&mut self) {
        self.limit = (self.limit / 2).max(self.least);
    }
}

/// Keeps a dead or busy server from being asked by every tile at once: one request tries, the others wait.
#[derive(Debug, Default)]
pub struct Gate {
    failures: u8,
    open_at: Option<Instant>,
}

impl Gate {
    /// How many requests may be in flight.
    fn limit(&self, now: Instant, limit: usize) -> usize {
        match self.open_at {
            Some(open_at) if now < open_at => 0,
            Some(_) => 1,
            None => limit,
        }
    }

    /// A request failed; requests that were sent together fail together and count once.
    pub fn failed(&mut self, now: Instant, retry_after: Option<Duration>, jitter: f64) {
        if self.open_at.is_some_and(|open_at| now < open_at) {
            return;
        }
        self.failures = self.failures.saturating_add(1);
        let wait = retry_after.map_or_else(|| wait_after(self.failures, jitter), |wait| wait.min(RETRY_AFTER_MOST));
        self.open_at = Some(now + wait);
    }

    /// The server answers.
    pub fn succeeded(&mut self) {
        *self = Self::default();
    }

    /// When the next request may start, if not now.
    pub fn closed_until(&self) -> Option<Instant> {
        self.open_at
    }
}

/// A random number from 0 to 1.
pub fn jitter() -> f64 {
    (RandomState::new().build_hasher().finish() >> 11) as f64 / (1u64 << 53) as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::select::priority::Group;
    use insula_protocol::{Manifest, Subtree, TileId, manifest::CityCounts, subtree::NodeInfo};

    fn tree() -> Tree {
        let manifest = Manifest {
            format_version: 1,
            name: "t".into(),
            title: String::new(),
            version: "0".into(),
            crs: None,
            origin: [0.0; 3],
            root_side_m: 128.0,
            depth: 1,
            node_cells: 64,
            cell_m: 1.0,
            bounds: [[0.0; 3]; 2],
            ground_z_m: 0.0,
            focus: [[0.0; 2], [1.0; 2]],
            has_terrain: false,
            counts: CityCounts::default(),
            attribution: Vec::new(),
            tile_version: 1,
            settings: String::new(),
        };
        let mut tree = Tree::new(manifest);
        let node = |id, child_mask| NodeInfo {
            id,
            child_mask,
            z_min_m: 0.0,
            z_max_m: 1.0,
            error_m: 1.0,
            radius_m: 1.0,
            blockmap_bytes: 1,
        };
        let mut nodes = vec![node(TileId::ROOT, 15)];
        nodes.extend(TileId::ROOT.children().map(|id| node(id, 0)));
        tree.merge(&Subtree { nodes, meshes: Vec::new() });
        tree
    }

    fn wanted(quadrants: &[usize]) -> Vec<Wanted> {
        let key = |q: &usize| Key::block_map(TileId::ROOT.child(*q).unwrap());
        quadrants.iter().map(|q| Wanted { key: key(q), group: Group::Normal, weight: 1.0 }).collect()
    }

    #[test]
    fn starts_in_order_up_to_the_limit_and_cancels_what_is_not_wanted() {
        let (mut tree, mut queue, now) = (tree(), Queue::new(2), Instant::now());
        let all = wanted(&[3, 1, 0, 2]);
        assert_eq!(queue.plan(&mut tree, &all, now, |_| false).start, [all[0].key, all[1].key]);
        assert_eq!(queue.plan(&mut tree, &all, now, |_| false), Plan::default());
        assert_eq!(tree.tile(all[2].key).unwrap().state(), TileState::Queued);
        let fewer = wanted(&[1, 2]);
        let plan = queue.plan(&mut tree, &fewer, now, |_| false);
        assert_eq!((plan.cancel, plan.start), (vec![all[0].key], vec![fewer[1].key]));
        assert_eq!(tree.tile(all[0].key).unwrap().state(), TileState::Unknown);
        assert_eq!(tree.tile(all[2].key).unwrap().state(), TileState::Unknown, "queued and forgotten");
        queue.landed(fewer[0].key);
        tree.apply(fewer[0].key, TileEvent::Refuse);
        assert_eq!(queue.plan(&mut tree, &fewer, now, |_| false), Plan::default(), "bad tiles are not asked for again");
    }

    #[test]
    fn a_dead_server_is_asked_by_one_request_at_a_time() {
        let (mut tree, mut queue, mut now) = (tree(), Queue::new(4), Instant::now());
        let all = wanted(&[0, 1, 2, 3]);
        assert_eq!(queue.plan(&mut tree, &all, now, |_| false).start.len(), 4);
        for want in &all {
            queue.landed(want.key);
            tree.apply(want.key, TileEvent::Fail { now, retry_after: None, jitter: 0.5 });
            queue.gate.failed(now, None, 0.5);
        }
        assert_eq!(queue.gate.failures, 1);
        assert!(queue.plan(&mut tree, &all, now, |_| false).start.is_empty());
        now += Duration::from_secs(3);
        assert_eq!(queue.plan(&mut tree, &all, now, |_| false).start, [all[0].key]);
        queue.gate.succeeded();
        assert_eq!(queue.plan(&mut tree, &all, now, |_| false).start.len(), 3);
    }

    #[test]
    fn more_requests_fly_while_that_delays_none() {
        let ms = Duration::from_millis;
        let mut window = Window::new(12);
        (0..1000).for_each(|_| window.answered(ms(52)));
        assert_eq!(window.limit(), 48);
        (0..10).for_each(|_| window.answered(ms(400)));
        assert_eq!(window.limit(), 38, "the line is full");
        (0..10).for_each(|_| window.answered(ms(120)));
        assert_eq!(window.limit(), 38);
        (0..3).for_each(|_| window.failed());
        assert_eq!(window.limit(), 12);
        (0..1000).for_each(|_| window.answered(ms(1)));
        assert_eq!(window.limit(), 12, "what is near is quick with few");
    }

    #[test]
    fn a_busy_server_is_left_alone_as_long_as_it_asks() {
        let (mut gate, now) = (Gate::default(), Instant::now());
        gate.failed(now, Some(Duration::from_secs(5)), 0.0);
        assert_eq!(gate.limit(now + Duration::from_millis(4900), 8), 0);
        assert_eq!(gate.limit(now + Duration::from_secs(5), 8), 1);
        gate.failed(now + Duration::from_secs(6), Some(Duration::from_secs(9999)), 0.0);
        assert_eq!(gate.limit(now + Duration::from_secs(66), 8), 1);
        assert!((0.0..1.0).contains(&jitter()));
    }
}
