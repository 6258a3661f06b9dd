//! Decides, frame by frame, which requests to start and which to cancel.

use super::request_grouping::PlannedRequest;
use crate::scene::tile::retry_delay;
use crate::scene::{SceneTree, TileEvent, TileKey};
use crate::select::priority::TileRequest;
use std::collections::{HashMap, HashSet};
use std::time::Duration;

/// Most requests in flight, as a multiple of the initial limit.
const MAX_LIMIT_FACTOR: usize = 4;
/// A connection with responses as fast as this is busy with few requests.
const FAST_RESPONSE: Duration = Duration::from_millis(10);
/// Groups are not requested for this time after a failure: what is kept for use without a network is kept tile by tile.
const GROUP_PAUSE: Duration = Duration::from_secs(30);
/// Random variation of response times.
const NOISE: Duration = Duration::from_millis(5);

/// Requests to cancel and to start now.
#[derive(Debug, Default, PartialEq, Eq)]
pub(super) struct RequestPlan {
    pub(super) cancel: Vec<TileKey>,
    /// Most important first.
    pub(super) start: Vec<PlannedRequest>,
}

/// The tiles that are queued, and those whose requests are in flight.
#[derive(Debug)]
pub(super) struct RequestQueue {
    pub(super) concurrency: ConcurrencyLimit,
    pub(super) backoff: Backoff,
    queued: HashSet<TileKey>,
    /// The number of each tile's request.
    in_flight: HashMap<TileKey, u64>,
    /// By number.
    requests: HashMap<u64, RequestInFlight>,
    last_request: u64,
    /// No groups are requested before.
    groups_from: Duration,
}

#[derive(Debug)]
struct RequestInFlight {
    /// Tiles that have not arrived.
    tiles: usize,
    weight: usize,
}

impl RequestQueue {
    /// With at most `limit` requests in flight to begin with.
    pub(super) fn new(limit: usize) -> Self {
        Self {
            concurrency: ConcurrencyLimit::new(limit),
            backoff: Backoff::default(),
            queued: HashSet::new(),
            in_flight: HashMap::new(),
            requests: HashMap::new(),
            last_request: 0,
            groups_from: Duration::ZERO,
        }
    }

    /// Brings the states of the tiles in line with `wanted`, and plans the requests. Tiles that can be had without the network may
    /// start even while the server does not respond. Unless a request has failed shortly before, tiles are requested in groups,
    /// with those of `companions`, which are wanted later.
    pub(super) fn plan(
        &mut self,
        tree: &mut SceneTree,
        wanted: &[TileRequest],
        companions: &[TileRequest],
        now: Duration,
        is_local: impl Fn(TileKey) -> bool,
        has_groups: bool,
    ) -> RequestPlan {
        let cancel = self.forget_unwanted(tree, wanted);
        for TileRequest { key, .. } in wanted {
            if tree.apply(*key, TileEvent::Want { now }) {
                self.queued.insert(*key);
            }
        }
        let limit = self.concurrency.limit();
        let network_limit = self.backoff.limit(now, limit);
        let (mut start, mut candidates) = (Vec::new(), None);
        for TileRequest { key, .. } in wanted {
            let weight: usize = self.requests.values().map(|request| request.weight).sum();
            if weight >= limit {
                break;
            }
            let may_start = weight < network_limit || network_limit < limit && is_local(*key);
            if !self.queued.contains(key) || !may_start {
                continue;
            }
            let is_grouped = now >= self.groups_from && has_groups && !is_local(*key);
            let mut request = PlannedRequest::single(*key);
            if is_grouped {
                let wanted = candidates.get_or_insert_with(|| companions.iter().map(|request| request.key).collect());
                request = PlannedRequest::grouped(*key, wanted, tree);
            }
            start.extend(self.start(request, tree, now));
        }
        RequestPlan { cancel, start }
    }

    /// Records a request that failed through the fault of the network or the server.
    pub(super) fn failed(&mut self, now: Duration, retry_after: Option<Duration>, jitter: f64) {
        self.backoff.failed(now, retry_after, jitter);
        self.concurrency.failed();
        self.groups_from = now + GROUP_PAUSE;
    }

    /// Drops tiles that are no longer wanted. Returns those whose requests are in flight, to be cancelled.
    fn forget_unwanted(&mut self, tree: &mut SceneTree, wanted: &[TileRequest]) -> Vec<TileKey> {
        let keys: HashSet<TileKey> = wanted.iter().map(|request| request.key).collect();
        for key in self.queued.extract_if(|key| !keys.contains(key)) {
            tree.apply(key, TileEvent::Drop);
        }
        let cancelled: Vec<TileKey> = self.in_flight.keys().filter(|key| !keys.contains(key)).copied().collect();
        for key in &cancelled {
            tree.apply(*key, TileEvent::Drop);
            self.request_ended(*key);
        }
        cancelled
    }

    /// Records that a request starts. `None` if none of its tiles waits for one.
    fn start(&mut self, mut request: PlannedRequest, tree: &mut SceneTree, now: Duration) -> Option<PlannedRequest> {
        request.keys.retain(|key| {
            let is_queued = self.queued.remove(key) || tree.apply(*key, TileEvent::Want { now });
            is_queued && tree.apply(*key, TileEvent::Start)
        });
        if request.keys.is_empty() {
            return None;
        }
        self.last_request += 1;
        self.in_flight.extend(request.keys.iter().map(|key| (*key, self.last_request)));
        let in_flight = RequestInFlight { tiles: request.keys.len(), weight: request.weight };
        self.requests.insert(self.last_request, in_flight);
        Some(request)
    }

    /// Records that a tile has arrived, or that its request has failed or is cancelled. Returns whether it was the last one of its
    /// request.
    pub(super) fn request_ended(&mut self, key: TileKey) -> bool {
        let Some(number) = self.in_flight.remove(&key) else { return false };
        let Some(request) = self.requests.get_mut(&number) else { return false };
        request.tiles -= 1;
        let is_last = request.tiles == 0;
        if is_last {
            self.requests.remove(&number);
        }
        is_last
    }
}

/// Adapts the number of requests in flight to the connection: more while responses take no longer for it, fewer when they do.
/// Each response that waits on the connection delays more important ones.
#[derive(Debug)]
pub(super) struct ConcurrencyLimit {
    min_limit: usize,
    limit: usize,
    /// Duration of a response that waits for no other.
    fastest: Duration,
}

impl ConcurrencyLimit {
    fn new(limit: usize) -> Self {
        let min_limit = limit.max(1);
        Self { min_limit, limit: min_limit, fastest: Duration::MAX }
    }

    /// Number of requests that may be in flight.
    pub(super) fn limit(&self) -> usize {
        self.limit
    }

    /// Records a response that came `took` after its request.
    pub(super) fn succeeded(&mut self, took: Duration) {
        // The fastest response is forgotten gradually: the connection may have become slower.
        self.fastest = self.fastest.saturating_add(self.fastest / 256).min(took);
        if self.fastest > FAST_RESPONSE && took < self.fastest + self.fastest / 2 + NOISE {
            self.limit = (self.limit + 1).min(self.min_limit * MAX_LIMIT_FACTOR);
        } else if took > self.fastest * 3 + NOISE {
            self.limit = (self.limit - 1).max(self.min_limit);
        }
    }

    /// Records a request that failed through the fault of the network or the server.
    pub(super) fn failed(&mut self) {
        self.limit = (self.limit / 2).max(self.min_limit);
    }
}

/// Protects a server that does not respond, or is overloaded: after a delay, one request tries, while the others wait.
#[derive(Debug, Default)]
pub(super) struct Backoff {
    failures: u8,
    retry_at: Option<Duration>,
}

impl Backoff {
    /// Number of requests that may be in flight, of `limit`.
    fn limit(&self, now: Duration, limit: usize) -> usize {
        match self.retry_at {
            Some(retry_at) if now < retry_at => 0,
            Some(_) => 1,
            None => limit,
        }
    }

    /// Records a failed request. Requests that started together fail together and count once.
    pub(super) fn failed(&mut self, now: Duration, retry_after: Option<Duration>, jitter: f64) {
        if self.retry_at.is_some_and(|retry_at| now < retry_at) {
            return;
        }
        self.failures = self.failures.saturating_add(1);
        self.retry_at = Some(now + retry_delay(self.failures, retry_after, jitter));
    }

    pub(super) fn succeeded(&mut self) {
        *self = Self::default();
    }

    /// When the next request may start, while the server does not respond.
    pub(super) fn retry_at(&self) -> Option<Duration> {
        self.retry_at
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::TileState;
    use crate::select::tests::{request, tree};
    use insula_protocol::TileId;

    /// All tiles are remote, and those that are wanted later are the same.
    fn planned(
        queue: &mut RequestQueue,
        tree: &mut SceneTree,
        wanted: &[TileRequest],
        now: Duration,
        has_groups: bool,
    ) -> RequestPlan {
        queue.plan(tree, wanted, wanted, now, |_| false, has_groups)
    }

    fn started(plan: &RequestPlan) -> Vec<TileKey> {
        plan.start.iter().flat_map(|request| request.keys.clone()).collect()
    }

    fn wanted(quadrants: &[usize]) -> Vec<TileRequest> {
        quadrants.iter().map(|q| request(TileKey::block_map(TileId::ROOT.child(*q).unwrap()))).collect()
    }

    #[test]
    fn starts_in_order_up_to_the_limit_and_cancels_what_is_not_wanted() {
        let (mut tree, mut queue, now) = (tree(), RequestQueue::new(2), Duration::from_secs(100));
        let all = wanted(&[3, 1, 0, 2]);
        assert_eq!(started(&planned(&mut queue, &mut tree, &all, now, false)), [all[0].key, all[1].key]);
        assert_eq!(planned(&mut queue, &mut tree, &all, now, false), RequestPlan::default());
        assert_eq!(tree.tile(all[2].key).unwrap().state(), TileState::Queued);
        let fewer = wanted(&[1, 2]);
        let plan = planned(&mut queue, &mut tree, &fewer, now, false);
        assert_eq!((&plan.cancel, started(&plan)), (&vec![all[0].key], vec![fewer[1].key]));
        assert_eq!(tree.tile(all[0].key).unwrap().state(), TileState::Unknown);
        assert_eq!(tree.tile(all[2].key).unwrap().state(), TileState::Unknown, "no longer queued");
        queue.request_ended(fewer[0].key);
        tree.apply(fewer[0].key, TileEvent::Refuse);
        let plan = planned(&mut queue, &mut tree, &fewer, now, false);
        assert_eq!(plan, RequestPlan::default(), "bad tiles are not requested again");
    }

    #[test]
    fn neighbours_take_one_request_until_the_last_of_them_has_ended() {
        let (mut tree, mut queue, now) = (tree(), RequestQueue::new(2), Duration::from_secs(100));
        let all = wanted(&[3, 1, 0, 2]);
        let plan = planned(&mut queue, &mut tree, &all, now, true);
        assert_eq!((plan.start.len(), plan.start[0].keys.len()), (1, 4));
        assert!(plan.start[0].group.is_some());
        for request in &all[1..] {
            assert!(!queue.request_ended(request.key));
        }
        assert!(queue.request_ended(all[0].key));
        assert!(!queue.request_ended(all[0].key), "it has ended");
        assert!(queue.requests.is_empty() && queue.in_flight.is_empty());
    }

    #[test]
    fn a_large_group_takes_the_place_of_several_requests() {
        let (mut tree, mut queue, now) = (tree(), RequestQueue::new(3), Duration::from_secs(100));
        let all = wanted(&[0, 1, 2, 3]);
        let keys = vec![all[0].key, all[1].key];
        assert!(queue.start(PlannedRequest { group: None, keys, weight: 2 }, &mut tree, now).is_some());
        let plan = planned(&mut queue, &mut tree, &all, now, false);
        assert_eq!(started(&plan), [all[2].key], "one more fits");
        queue.request_ended(all[0].key);
        assert!(planned(&mut queue, &mut tree, &all, now, false).start.is_empty(), "the group has not ended");
        queue.request_ended(all[1].key);
        assert_eq!(started(&planned(&mut queue, &mut tree, &all, now, false)), [all[3].key]);
    }

    #[test]
    fn dead_server_gets_one_request_at_a_time() {
        let (mut tree, mut queue, mut now) = (tree(), RequestQueue::new(4), Duration::from_secs(100));
        let all = wanted(&[0, 1, 2, 3]);
        assert_eq!(planned(&mut queue, &mut tree, &all, now, false).start.len(), 4);
        for request in &all {
            queue.request_ended(request.key);
            tree.apply(request.key, TileEvent::Fail { now, retry_after: None, jitter: 0.5 });
            queue.failed(now, None, 0.5);
        }
        assert_eq!(queue.backoff.failures, 1);
        assert!(planned(&mut queue, &mut tree, &all, now, false).start.is_empty());
        now += Duration::from_secs(3);
        assert_eq!(started(&planned(&mut queue, &mut tree, &all, now, true)), [all[0].key], "no groups");
        queue.backoff.succeeded();
        assert_eq!(planned(&mut queue, &mut tree, &all, now, true).start.len(), 3, "still no groups");
    }

    #[test]
    fn concurrency_grows_while_responses_are_not_delayed() {
        let ms = Duration::from_millis;
        let mut limit = ConcurrencyLimit::new(12);
        (0..1000).for_each(|_| limit.succeeded(ms(52)));
        assert_eq!(limit.limit(), 48);
        (0..10).for_each(|_| limit.succeeded(ms(400)));
        assert_eq!(limit.limit(), 38, "responses queue on the connection");
        (0..10).for_each(|_| limit.succeeded(ms(120)));
        assert_eq!(limit.limit(), 38);
        (0..3).for_each(|_| limit.failed());
        assert_eq!(limit.limit(), 12);
        (0..1000).for_each(|_| limit.succeeded(ms(1)));
        assert_eq!(limit.limit(), 12, "few requests suffice for a nearby server");
    }

    #[test]
    fn busy_server_gets_no_request_until_its_retry_after() {
        let (mut backoff, now) = (Backoff::default(), Duration::from_secs(100));
        backoff.failed(now, Some(Duration::from_secs(5)), 0.0);
        assert_eq!(backoff.limit(now + Duration::from_millis(4900), 8), 0);
        assert_eq!(backoff.limit(now + Duration::from_secs(5), 8), 1);
        backoff.failed(now + Duration::from_secs(6), Some(Duration::from_secs(9999)), 0.0);
        assert_eq!(backoff.limit(now + Duration::from_secs(36), 8), 1, "no server can demand a longer delay");
    }
}
