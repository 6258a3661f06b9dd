//! Decides, frame by frame, which requests to start and which to cancel.

use crate::{
    scene::{SceneTree, TileEvent, TileKey, TileState, tile::retry_delay},
    select::priority::TileRequest,
};
use std::{collections::HashSet, time::Duration};

/// Most requests in flight, as a multiple of the initial limit.
const MAX_LIMIT_FACTOR: usize = 4;
/// A connection with responses as fast as this is busy with few requests.
const FAST_RESPONSE: Duration = Duration::from_millis(10);
/// Random variation of response times.
const NOISE: Duration = Duration::from_millis(5);

/// Requests to cancel and to start now.
#[derive(Debug, Default, PartialEq, Eq)]
pub(super) struct RequestPlan {
    pub(super) cancel: Vec<TileKey>,
    /// Most important first.
    pub(super) start: Vec<TileKey>,
}

/// The tiles that are queued, and those whose requests are in flight.
#[derive(Debug)]
pub(super) struct RequestQueue {
    pub(super) concurrency: ConcurrencyLimit,
    pub(super) backoff: Backoff,
    queued: HashSet<TileKey>,
    in_flight: HashSet<TileKey>,
}

impl RequestQueue {
    /// With at most `limit` requests in flight to begin with.
    pub(super) fn new(limit: usize) -> Self {
        Self {
            concurrency: ConcurrencyLimit::new(limit),
            backoff: Backoff::default(),
            queued: HashSet::new(),
            in_flight: HashSet::new(),
        }
    }

    /// Brings the states of the tiles in line with `wanted`, and plans the requests. Tiles that are `is_local`, that is, can be had
    /// without the network, may start even while the server does not respond.
    pub(super) fn plan(
        &mut self,
        tree: &mut SceneTree,
        wanted: &[TileRequest],
        now: Duration,
        is_local: impl Fn(TileKey) -> bool,
    ) -> RequestPlan {
        let mut plan = RequestPlan::default();
        let keys: HashSet<TileKey> = wanted.iter().map(|request| request.key).collect();
        for key in self.queued.extract_if(|key| !keys.contains(key)) {
            tree.apply(key, TileEvent::Drop);
        }
        for key in self.in_flight.extract_if(|key| !keys.contains(key)) {
            tree.apply(key, TileEvent::Drop);
            plan.cancel.push(key);
        }
        let limit = self.concurrency.limit();
        let network_limit = self.backoff.limit(now, limit);
        for TileRequest { key, .. } in wanted {
            if tree.apply(*key, TileEvent::Want { now }) {
                self.queued.insert(*key);
            }
            let is_queued = tree.tile(*key).is_some_and(|tile| tile.state() == TileState::Queued);
            let is_below = |limit: usize| self.in_flight.len() < limit;
            let may_start =
                is_queued && (is_below(network_limit) || network_limit < limit && is_below(limit) && is_local(*key));
            if may_start && tree.apply(*key, TileEvent::Start) {
                self.queued.remove(key);
                self.in_flight.insert(*key);
                plan.start.push(*key);
            }
        }
        plan
    }

    /// Records that a request has ended, successfully or not.
    pub(super) fn request_ended(&mut self, key: TileKey) {
        self.in_flight.remove(&key);
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

    /// Records a response.
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
    use crate::select::tests::{request, tree};
    use insula_protocol::TileId;

    fn wanted(quadrants: &[usize]) -> Vec<TileRequest> {
        quadrants.iter().map(|q| request(TileKey::block_map(TileId::ROOT.child(*q).unwrap()))).collect()
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
        assert_eq!(tree.tile(all[2].key).unwrap().state(), TileState::Unknown, "no longer queued");
        queue.request_ended(fewer[0].key);
        tree.apply(fewer[0].key, TileEvent::Refuse);
        let plan = queue.plan(&mut tree, &fewer, now, |_| false);
        assert_eq!(plan, RequestPlan::default(), "bad tiles are not requested again");
    }

    #[test]
    fn dead_server_gets_one_request_at_a_time() {
        let (mut tree, mut queue, mut now) = (tree(), RequestQueue::new(4), Duration::from_secs(100));
        let all = wanted(&[0, 1, 2, 3]);
        assert_eq!(queue.plan(&mut tree, &all, now, |_| false).start.len(), 4);
        for request in &all {
            queue.request_ended(request.key);
            tree.apply(request.key, TileEvent::Fail { now, retry_after: None, jitter: 0.5 });
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
