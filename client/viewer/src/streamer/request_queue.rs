//! Which requests to start and which to cancel, frame by frame.
//!
//! In: [`TileRequest`] in order, the tree's states. Out: [`RequestPlan`]. Next: `stream` does it.

use crate::{
    scene::{
        SceneTree, TileEvent, TileKey, TileState,
        tile::{MAX_RETRY_AFTER, retry_delay},
    },
    select::priority::TileRequest,
};
use std::{collections::HashSet, time::Duration};

/// Most requests in flight, of those at the beginning.
const WINDOW_TIMES: usize = 4;
/// A line that is as short as this is full with few requests.
const NEAR: Duration = Duration::from_millis(10);
/// Answers may take so much longer by chance.
const NOISE: Duration = Duration::from_millis(5);

/// What to do in this frame.
#[derive(Debug, Default, PartialEq, Eq)]
pub struct RequestPlan {
    /// Under way, no longer wanted.
    pub cancel: Vec<TileKey>,
    /// Wanted most, as many as may be in flight.
    pub start: Vec<TileKey>,
}

/// What is queued and what is under way.
#[derive(Debug)]
pub struct RequestQueue {
    /// How many requests may be in flight.
    pub concurrency: ConcurrencyLimit,
    queued: HashSet<TileKey>,
    flying: HashSet<TileKey>,
    /// Closed while the server does not answer.
    pub backoff: Backoff,
}

impl RequestQueue {
    /// With `least` requests in flight to begin with.
    pub fn new(least: usize) -> Self {
        let concurrency = ConcurrencyLimit::new(least);
        Self { concurrency, queued: HashSet::new(), flying: HashSet::new(), backoff: Backoff::default() }
    }

    /// Brings the tiles' states in line with `wanted`, and says what follows. `near`: what needs no network may start while
    /// the server does not answer.
    pub fn plan(
        &mut self,
        tree: &mut SceneTree,
        wanted: &[TileRequest],
        now: Duration,
        near: impl Fn(TileKey) -> bool,
    ) -> RequestPlan {
        let mut plan = RequestPlan::default();
        let keys: HashSet<TileKey> = wanted.iter().map(|w| w.key).collect();
        for key in self.queued.extract_if(|key| !keys.contains(key)) {
            tree.apply(key, TileEvent::Drop);
        }
        for key in self.flying.extract_if(|key| !keys.contains(key)) {
            tree.apply(key, TileEvent::Drop);
            plan.cancel.push(key);
        }
        let limit = self.concurrency.limit();
        let open = self.backoff.limit(now, limit);
        for TileRequest { key, .. } in wanted {
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
    pub fn finished(&mut self, key: TileKey) {
        self.flying.remove(&key);
    }
}

/// As many requests in flight as keep the line full: more while answers take no longer for it, fewer when they do. Every
/// answer that is queued on the line delays what is wanted more by the time that it comes.
#[derive(Debug)]
pub struct ConcurrencyLimit {
    least: usize,
    limit: usize,
    /// What an answer takes that waits for no other.
    fastest: Duration,
}

impl ConcurrencyLimit {
    fn new(least: usize) -> Self {
        let least = least.max(1);
        Self { least, limit: least, fastest: Duration::MAX }
    }

    /// How many may be in flight.
    pub fn limit(&self) -> usize {
        self.limit
    }

    /// An answer came `took` after it was asked for.
    pub fn succeeded(&mut self, took: Duration) {
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
pub struct Backoff {
    failures: u8,
    open_at: Option<Duration>,
}

impl Backoff {
    /// How many requests may be in flight.
    fn limit(&self, now: Duration, limit: usize) -> usize {
        match self.open_at {
            Some(open_at) if now < open_at => 0,
            Some(_) => 1,
            None => limit,
        }
    }

    /// A request failed; requests that were sent together fail together and count once.
    pub fn failed(&mut self, now: Duration, retry_after: Option<Duration>, jitter: f64) {
        if self.open_at.is_some_and(|open_at| now < open_at) {
            return;
        }
        self.failures = self.failures.saturating_add(1);
        let wait = retry_after.map_or_else(|| retry_delay(self.failures, jitter), |wait| wait.min(MAX_RETRY_AFTER));
        self.open_at = Some(now + wait);
    }

    /// The server answers.
    pub fn succeeded(&mut self) {
        *self = Self::default();
    }

    /// When the next request may start, if not now.
    pub fn blocked_until(&self) -> Option<Duration> {
        self.open_at
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        select::priority::{PriorityGroup, RequestReason},
        test_support,
    };
    use insula_protocol::{Subtree, TileId, subtree::NodeInfo};

    fn tree() -> SceneTree {
        let mut tree = SceneTree::new(test_support::manifest(1));
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

    fn wanted(quadrants: &[usize]) -> Vec<TileRequest> {
        let key = |q: &usize| TileKey::block_map(TileId::ROOT.child(*q).unwrap());
        quadrants
            .iter()
            .map(|q| TileRequest {
                key: key(q),
                group: PriorityGroup::Normal,
                reason: RequestReason::Visible,
                weight_px: 1.0,
            })
            .collect()
    }

    #[test]
    fn starts_in_order_up_to_the_limit_and_cancels_what_is_not_wanted() {
        let (mut tree, mut queue, now) = (tree(), RequestQueue::new(2), Duration::from_secs(100));
        let all = wanted(&[3, 1, 0, 2]);
        assert_eq!(queue.plan(&mut tree, &all, now, |_| false).start, [all[0].key, all[1].key]);
        assert_eq!(queue.plan(&mut tree, &all, now, |_| false), RequestPlan::default());
        assert_eq!(tree.tile(all[2].key).unwrap().state(), TileState::Queued);
        let fewer = wanted(&[1, 2]);
        let plan = queue.plan(&mut tree, &fewer, now, |_| false);
        assert_eq!((plan.cancel, plan.start), (vec![all[0].key], vec![fewer[1].key]));
        assert_eq!(tree.tile(all[0].key).unwrap().state(), TileState::Unknown);
        assert_eq!(tree.tile(all[2].key).unwrap().state(), TileState::Unknown, "queued and forgotten");
        queue.finished(fewer[0].key);
        tree.apply(fewer[0].key, TileEvent::Refuse);
        assert_eq!(
            queue.plan(&mut tree, &fewer, now, |_| false),
            RequestPlan::default(),
            "bad tiles are not asked for again"
        );
    }

    #[test]
    fn a_dead_server_is_asked_by_one_request_at_a_time() {
        let (mut tree, mut queue, mut now) = (tree(), RequestQueue::new(4), Duration::from_secs(100));
        let all = wanted(&[0, 1, 2, 3]);
        assert_eq!(queue.plan(&mut tree, &all, now, |_| false).start.len(), 4);
        for want in &all {
            queue.finished(want.key);
            tree.apply(want.key, TileEvent::Fail { now, retry_after: None, jitter: 0.5 });
            queue.backoff.failed(now, None, 0.5);
        }
        assert_eq!(queue.backoff.failures, 1);
        assert!(queue.plan(&mut tree, &all, now, |_| false).start.is_empty());
        now += Duration::from_secs(3);
        assert_eq!(queue.plan(&mut tree, &all, now, |_| false).start, [all[0].key]);
        queue.backoff.succeeded();
        assert_eq!(queue.plan(&mut tree, &all, now, |_| false).start.len(), 3);
    }

    #[test]
    fn more_requests_fly_while_that_delays_none() {
        let ms = Duration::from_millis;
        let mut window = ConcurrencyLimit::new(12);
        (0..1000).for_each(|_| window.succeeded(ms(52)));
        assert_eq!(window.limit(), 48);
        (0..10).for_each(|_| window.succeeded(ms(400)));
        assert_eq!(window.limit(), 38, "the line is full");
        (0..10).for_each(|_| window.succeeded(ms(120)));
        assert_eq!(window.limit(), 38);
        (0..3).for_each(|_| window.failed());
        assert_eq!(window.limit(), 12);
        (0..1000).for_each(|_| window.succeeded(ms(1)));
        assert_eq!(window.limit(), 12, "what is near is quick with few");
    }

    #[test]
    fn a_busy_server_is_left_alone_as_long_as_it_asks() {
        let (mut gate, now) = (Backoff::default(), Duration::from_secs(100));
        gate.failed(now, Some(Duration::from_secs(5)), 0.0);
        assert_eq!(gate.limit(now + Duration::from_millis(4900), 8), 0);
        assert_eq!(gate.limit(now + Duration::from_secs(5), 8), 1);
        gate.failed(now + Duration::from_secs(6), Some(Duration::from_secs(9999)), 0.0);
        assert_eq!(gate.limit(now + Duration::from_secs(66), 8), 1);
    }
}
