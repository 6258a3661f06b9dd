//! From wanted tiles to decoded nodes.
//!
//! In: the selection's [`Wanted`], in order. Out: [`Arrival`]s. Next: `cache`.
//!
//! The requests run on tokio's threads, decoding on its blocking threads; the frame loop only starts, cancels and
//! collects. Everything is bounded: requests in flight, decoders at work, arrivals waiting.

pub mod bell;
pub mod decode;
pub mod fetch;
pub mod link;
pub mod queue;
pub mod source;

use crate::{
    error::{ClientError, Result},
    scene::{Key, TileEvent, Tree},
    select::priority::Wanted,
};
use bell::Bell;
use decode::Decoded;
use fetch::{FetchError, Http};
use insula_protocol::Subtree;
use insula_shaders::{mesh::PackedMesh, pack::PackedNode};
use queue::Queue;
use source::Source;
use std::{
    collections::HashMap,
    sync::Arc,
    time::{Duration, Instant},
};
use tokio::sync::{Semaphore, mpsc};

/// Arrivals that may wait for the frame loop.
const ARRIVALS: usize = 16;

/// Called from any thread when something has arrived.
pub type Wake = Arc<dyn Fn() + Send + Sync>;

/// Something new.
#[derive(Debug)]
pub enum Arrival {
    /// A node, to be put into the cache: the tile is decoded.
    Node(Key, Box<PackedNode>),
    /// A leaf's mesh, to be put into the cache: the tile is decoded.
    Mesh(Key, Box<PackedMesh>),
    /// A subtree, to be merged into the tree: the tile is decoded.
    Subtree(Key, Subtree),
}

struct Message {
    key: Key,
    ticket: u64,
    /// It came without a network, which tells nothing of it.
    near: bool,
    /// From the request to the last byte.
    took: Duration,
    outcome: Result<Decoded, FetchError>,
}

struct Flight {
    ticket: u64,
    begun: Instant,
    task: tokio::task::AbortHandle,
}

/// The frame loop's end of the stream.
pub struct Stream {
    http: Arc<Http>,
    source: Arc<dyn Source>,
    queue: Queue,
    flights: HashMap<Key, Flight>,
    decoders: Arc<Semaphore>,
    sender: mpsc::Sender<Message>,
    receiver: mpsc::Receiver<Message>,
    wake: Option<Wake>,
    bell: Arc<Bell>,
    tickets: u64,
    failing_since: Option<Instant>,
    last_error: String,
    /// Why nothing more will ever come.
    over: Option<String>,
}

impl Stream {
    /// For the city at `source`, with `in_flight` requests at once to begin with.
    pub fn new(http: Arc<Http>, source: Arc<dyn Source>, in_flight: usize, wake: Option<Wake>) -> Self {
        let (sender, receiver) = mpsc::channel(ARRIVALS);
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        Self {
            http,
            source,
            queue: Queue::new(in_flight),
            flights: HashMap::new(),
            decoders: Arc::new(Semaphore::new(cores.max(2))),
            sender,
            receiver,
            wake,
            bell: Arc::default(),
            tickets: 0,
            failing_since: None,
            last_error: String::new(),
            over: None,
        }
    }

    /// Cancels what is no longer wanted and starts what is wanted most; how many it started.
    pub fn request(&mut self, tree: &mut Tree, wanted: &[Wanted], now: Instant) -> usize {
        let near = |key| self.source.is_near(key);
        let plan = self.queue.plan(tree, wanted, now, near);
        for key in plan.cancel {
            if let Some(flight) = self.flights.remove(&key) {
                flight.task.abort();
            }
        }
        let started = plan.start.len();
        for key in plan.start {
            self.start(key, now);
        }
        started
    }

    fn start(&mut self, key: Key, begun: Instant) {
        self.tickets += 1;
        let (ticket, source, decoders) = (self.tickets, self.source.clone(), self.decoders.clone());
        let (sender, wake, bell) = (self.sender.clone(), self.wake.clone(), self.bell.clone());
        let task = self.http.spawn(async move {
            let (near, begin) = (source.is_near(key), Instant::now());
            let answer = source.tile(key).await;
            let took = begin.elapsed();
            let outcome = match answer {
                Ok(bytes) => decode::on_worker(key, bytes, decoders, source).await,
                Err(error) => Err(error),
            };
            // A closed channel: the session is over, nobody listens.
            if sender.send(Message { key, ticket, near, took, outcome }).await.is_ok() {
                bell.ring();
                if let Some(wake) = wake {
                    wake();
                }
            }
        });
        self.flights.insert(key, Flight { ticket, begun, task });
    }

    /// The next thing that has arrived, if any; failures are dealt with on the way.
    pub fn arrival(&mut self, tree: &mut Tree, now: Instant) -> Option<Arrival> {
        loop {
            let Message { key, ticket, near, took, outcome } = self.receiver.try_recv().ok()?;
            if self.flights.get(&key).is_none_or(|flight| flight.ticket != ticket) {
                continue; // Cancelled while it was on its way.
            }
            self.flights.remove(&key);
            self.queue.landed(key);
            match outcome {
                Ok(decoded) => {
                    if !near {
                        self.succeeded();
                        self.queue.window.answered(took);
                    }
                    tree.apply(key, TileEvent::Arrive);
                    return Some(match decoded {
                        Decoded::Node(node) => Arrival::Node(key, node),
                        Decoded::Mesh(mesh) => Arrival::Mesh(key, mesh),
                        Decoded::Subtree(subtree) => Arrival::Subtree(key, subtree),
                    });
                }
                Err(error) => self.failed(tree, key, error, now),
            }
        }
    }

    fn succeeded(&mut self) {
        self.failing_since = None;
        self.queue.gate.succeeded();
    }

    fn failed(&mut self, tree: &mut Tree, key: Key, error: FetchError, now: Instant) {
        tracing::debug!("{} {}: {error}", key.layer().path_segment(), key.id);
        let jitter = queue::jitter();
        let event = match &error {
            FetchError::Missing => TileEvent::Refuse,
            FetchError::Damaged(_) | FetchError::Broken => TileEvent::Damage { now, jitter },
            FetchError::Busy { retry_after, .. } => TileEvent::Fail { now, retry_after: *retry_after, jitter },
            FetchError::Network(_) | FetchError::Archive(_) | FetchError::Unusable(_) => {
                TileEvent::Fail { now, retry_after: None, jitter }
            }
        };
        match &error {
            FetchError::Missing | FetchError::Damaged(_) | FetchError::Broken => self.succeeded(),
            FetchError::Busy { retry_after, .. } => self.queue.gate.failed(now, *retry_after, jitter),
            FetchError::Network(_) | FetchError::Archive(_) | FetchError::Unusable(_) => {
                self.queue.gate.failed(now, None, jitter);
            }
        }
        if !matches!(error, FetchError::Missing | FetchError::Damaged(_) | FetchError::Broken) {
            self.queue.window.failed();
            self.failing_since.get_or_insert(now);
        }
        if let FetchError::Unusable(why) = &error {
            self.over = Some(why.clone());
        }
        self.last_error = error.to_string();
        tree.apply(key, event);
    }

    /// Rings when something has arrived.
    pub fn bell(&self) -> Arc<Bell> {
        self.bell.clone()
    }

    /// Requests that may be under way.
    pub fn window(&self) -> usize {
        self.queue.window.limit()
    }

    /// Since when a tile is under way, if it is.
    pub fn begun(&self, key: Key) -> Option<Instant> {
        self.flights.get(&key).map(|flight| flight.begun)
    }

    /// Requests under way.
    pub fn in_flight(&self) -> usize {
        self.flights.len()
    }

    /// An error, once the server has answered nothing for `timeout`.
    pub fn check_reachable(&self, now: Instant, timeout: Duration) -> Result<()> {
        if let Some(why) = &self.over {
            return Err(ClientError::Server(why.clone()));
        }
        match self.failing_since {
            Some(since) if now.duration_since(since) >= timeout => Err(ClientError::Server(format!(
                "no answer from {} for {} s ({}): check that it runs, or give --timeout",
                self.source.place(),
                timeout.as_secs(),
                self.last_error
            ))),
            _ => Ok(()),
        }
    }

    /// Since when the server has not answered.
    pub fn failing_since(&self) -> Option<Instant> {
        self.failing_since
    }

    /// What was wrong with the last answer that was not as it should be; empty if none was.
    pub fn last_error(&self) -> &str {
        &self.last_error
    }

    /// The transport and its counters.
    pub fn http(&self) -> &Http {
        &self.http
    }

    /// When to look again although nothing arrived: retries wait for their time.
    pub fn retry_at(&self) -> Option<Instant> {
        self.queue.gate.closed_until()
    }
}

impl Drop for Stream {
    fn drop(&mut self) {
        self.flights.values().for_each(|flight| flight.task.abort());
    }
}
