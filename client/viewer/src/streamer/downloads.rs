//! Requests in flight: starts and cancels them, and turns their outcomes into tile states and decoded tiles.
//!
//! Fetching and decoding happen elsewhere, behind [`TileFetcher`]. Everything is bounded: requests in flight by
//! [`RequestQueue`], decoded tiles by the fetcher.

use super::request_grouping::PlannedRequest;
use super::request_queue::{RequestPlan, RequestQueue};
use crate::decode::DecodedTile;
use crate::scene::{SceneTree, TileEvent, TileKey};
use crate::select::priority::TileRequest;
use crate::source::FetchError;
use insula_protocol::TileGroup;
use std::collections::{HashMap, VecDeque};
use std::time::Duration;

/// Pause before a tile that was damaged repeatedly is requested once more. A proxy's bad copy often lives no longer.
const RECHECK_PAUSE: Duration = Duration::from_secs(20);

/// Outcome of one request.
#[derive(Debug)]
pub struct FetchOutcome {
    pub key: TileKey,
    /// The number that [`TileFetcher::start`] was given.
    pub ticket: u64,
    /// Whether it was read without the network, so that it says nothing about the server.
    pub is_local: bool,
    /// From the request to the last byte.
    pub duration: Duration,
    /// The decoded tile, or why there is none.
    pub result: Result<DecodedTile, FetchError>,
}

/// Fetches and decodes tiles in the background; implemented by each shell.
pub trait TileFetcher {
    /// Starts to fetch and decode a tile. `ticket` distinguishes this request from earlier ones for the same tile.
    fn start(&mut self, key: TileKey, ticket: u64);
    /// Starts to fetch several tiles of a group, each with its ticket, by one request, and to decode them. Each has its own outcome.
    fn start_group(&mut self, _group: TileGroup, members: &[(TileKey, u64)]) {
        members.iter().for_each(|(key, ticket)| self.start(*key, *ticket));
    }
    /// Whether several tiles can be fetched by one request.
    fn has_groups(&self) -> bool {
        false
    }
    /// Gives up the request for a tile. Its outcome may still arrive and is ignored then.
    fn cancel(&mut self, key: TileKey);
    /// The next finished request, if any. Never blocks.
    fn poll(&mut self) -> Option<FetchOutcome>;
    /// Whether a tile can be had without the network.
    fn is_local(&self, _key: TileKey) -> bool {
        false
    }
    /// A random number in 0..1, which spreads retries.
    fn jitter(&mut self) -> f64;
}

struct InFlight {
    ticket: u64,
    since: Duration,
}

/// All requests of a session.
pub struct Downloads<F> {
    fetcher: F,
    queue: RequestQueue,
    in_flight: HashMap<TileKey, InFlight>,
    last_ticket: u64,
    failing_since: Option<Duration>,
    last_success: Duration,
    last_error: String,
    /// Why this source will never serve the city.
    fatal: Option<String>,
    /// Tiles that were damaged repeatedly, and when each is requested once more.
    rechecks: VecDeque<(Duration, TileKey)>,
}

impl<F: TileFetcher> Downloads<F> {
    /// No requests yet. At most `limit` are in flight to begin with; the limit adapts to the connection.
    pub fn new(fetcher: F, limit: usize) -> Self {
        Self {
            fetcher,
            queue: RequestQueue::new(limit),
            in_flight: HashMap::new(),
            last_ticket: 0,
            failing_since: None,
            last_success: Duration::ZERO,
            last_error: String::new(),
            fatal: None,
            rechecks: VecDeque::new(),
        }
    }

    /// Cancels requests that are no longer wanted and starts the most important others, with those of `companions` that can be
    /// fetched together with them. Returns how many tiles were requested.
    pub(super) fn request(
        &mut self,
        tree: &mut SceneTree,
        wanted: &[TileRequest],
        companions: &[TileRequest],
        now: Duration,
    ) -> usize {
        let (is_local, has_groups) = (|key| self.fetcher.is_local(key), self.fetcher.has_groups());
        let RequestPlan { cancel, start } = self.queue.plan(tree, wanted, companions, now, is_local, has_groups);
        for key in cancel {
            if self.in_flight.remove(&key).is_some() {
                self.fetcher.cancel(key);
            }
        }
        start.iter().map(|request| self.start(request, now)).sum()
    }

    /// Starts a request. Returns the number of its tiles.
    fn start(&mut self, request: &PlannedRequest, now: Duration) -> usize {
        let ticket = |key: &TileKey| {
            self.last_ticket += 1;
            self.in_flight.insert(*key, InFlight { ticket: self.last_ticket, since: now });
            (*key, self.last_ticket)
        };
        let members: Vec<(TileKey, u64)> = request.keys.iter().map(ticket).collect();
        match request.group {
            Some(group) => self.fetcher.start_group(group, &members),
            None => members.iter().for_each(|(key, ticket)| self.fetcher.start(*key, *ticket)),
        }
        members.len()
    }

    /// The next tile that was fetched and decoded, if any. Requests that failed before it change the state of their tile.
    pub(super) fn poll(&mut self, tree: &mut SceneTree, now: Duration) -> Option<(TileKey, DecodedTile)> {
        loop {
            let FetchOutcome { key, ticket, is_local, duration, result } = self.fetcher.poll()?;
            if self.in_flight.get(&key).is_none_or(|flight| flight.ticket != ticket) {
                continue; // Cancelled after it had finished.
            }
            self.in_flight.remove(&key);
            let is_request_complete = self.queue.request_ended(key);
            match result {
                Ok(decoded) => {
                    if !is_local {
                        self.source_responded();
                        if is_request_complete {
                            self.queue.concurrency.succeeded(duration);
                        }
                    }
                    self.last_success = now;
                    tree.apply(key, TileEvent::Arrive);
                    return Some((key, decoded));
                }
                Err(error) => self.failed(tree, key, &error, now),
            }
        }
    }

    fn source_responded(&mut self) {
        self.failing_since = None;
        self.queue.backoff.succeeded();
    }

    fn failed(&mut self, tree: &mut SceneTree, key: TileKey, error: &FetchError, now: Duration) {
        tracing::debug!("{} {}: {error}", key.kind().path_segment(), key.id);
        let jitter = self.fetcher.jitter();
        if error.is_of_tile_alone() {
            self.source_responded();
        } else {
            self.queue.failed(now, error.retry_after(), jitter);
            self.failing_since.get_or_insert(now);
        }
        if let FetchError::Unusable(why) = error {
            self.fatal = Some(why.clone());
        }
        self.last_error = error.to_string();
        let event = error.event(now, jitter);
        tree.apply(key, event);
        let is_given_up = tree.tile(key).is_some_and(|tile| tile.is_bad());
        if matches!(event, TileEvent::Damage { .. }) && is_given_up {
            self.rechecks.push_back((now + RECHECK_PAUSE, key));
        }
    }

    /// Allows one more request for each tile that was given up [`RECHECK_PAUSE`] ago because it was damaged.
    pub(super) fn recheck_damaged(&mut self, tree: &mut SceneTree, now: Duration) {
        while let Some((_, key)) = self.rechecks.front().copied().filter(|(due, _)| *due <= now) {
            self.rechecks.pop_front();
            tree.apply(key, TileEvent::Recheck);
        }
    }

    /// When the next tile that was given up may be requested once more.
    pub fn recheck_at(&self) -> Option<Duration> {
        self.rechecks.front().map(|(due, _)| *due)
    }

    /// The fetcher.
    pub fn fetcher(&self) -> &F {
        &self.fetcher
    }

    /// Number of requests that may be in flight.
    pub(super) fn limit(&self) -> usize {
        self.queue.concurrency.limit()
    }

    /// When the request for a tile started, if it is in flight.
    pub(super) fn started_at(&self, key: TileKey) -> Option<Duration> {
        self.in_flight.get(&key).map(|flight| flight.since)
    }

    /// Number of requests in flight.
    pub fn in_flight(&self) -> usize {
        self.in_flight.len()
    }

    /// Since when no request has succeeded; `None` while the source responds.
    pub fn failing_since(&self) -> Option<Duration> {
        self.failing_since
    }

    /// Since when requests have been in flight and none has succeeded; `None` if nothing is in flight.
    pub fn waiting_since(&self) -> Option<Duration> {
        let oldest = self.in_flight.values().map(|flight| flight.since).min();
        oldest.map(|since| since.max(self.last_success))
    }

    /// The error of the last failed request; empty if none failed.
    pub fn last_error(&self) -> &str {
        &self.last_error
    }

    /// Why the source will never serve the city, if so.
    pub(super) fn fatal_error(&self) -> Option<&str> {
        self.fatal.as_deref()
    }

    /// When the next retry may start, while the source does not respond.
    pub fn retry_at(&self) -> Option<Duration> {
        self.queue.backoff.retry_at()
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::Unresponsive;
    use super::*;
    use crate::scene::TileState;
    use crate::select::tests::{request, tree};
    use insula_protocol::TileId;

    #[test]
    fn damaged_tiles_are_requested_again_after_a_pause() {
        let (mut tree, mut downloads) = (tree(), Downloads::new(Unresponsive::new(Some(FetchError::Broken)), 4));
        let wanted = [request(TileKey::block_map(TileId::ROOT.child(1).unwrap()))];
        let mut now = Duration::from_secs(100);
        let mut started = 0;
        while !tree.tile(wanted[0].key).unwrap().is_bad() {
            started += downloads.request(&mut tree, &wanted, &wanted, now);
            assert!(downloads.poll(&mut tree, now).is_none());
            now += Duration::from_secs(1);
        }
        assert!((2..10).contains(&started), "{started} requests");
        assert_eq!(downloads.request(&mut tree, &wanted, &wanted, now), 0);
        let due = downloads.recheck_at().unwrap();
        downloads.recheck_damaged(&mut tree, due - Duration::from_millis(1));
        assert_eq!(downloads.request(&mut tree, &wanted, &wanted, due), 0, "too early");
        downloads.recheck_damaged(&mut tree, due);
        assert_eq!((downloads.request(&mut tree, &wanted, &wanted, due), downloads.recheck_at()), (1, None));
        assert!(downloads.poll(&mut tree, due).is_none());
        assert_eq!(tree.tile(wanted[0].key).unwrap().state(), TileState::Bad);
        assert_eq!(downloads.recheck_at(), Some(due + RECHECK_PAUSE));
    }
}
