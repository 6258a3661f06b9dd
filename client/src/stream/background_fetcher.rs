//! Fetches and decodes tiles on background threads.
//!
//! Requests run on tokio's threads, decoding on its blocking threads. The frame loop only starts, cancels and polls. Everything
//! is bounded: requests in flight by [`Downloads`], decoders and waiting outcomes by [`BackgroundFetcher`].

use super::fetch::Http;
use super::jitter::jitter;
use super::notifier::Notifier;
use bytes::Bytes;
use insula_protocol::TileGroup;
use insula_viewer::decode::{DecodedTile, decode};
use insula_viewer::scene::TileKey;
use insula_viewer::source::group_request::GroupRequest;
use insula_viewer::source::{FetchError, TileSource};
use insula_viewer::streamer::{Downloads, FetchOutcome, TileFetcher};
use std::collections::HashMap;
use std::sync::Arc;
use std::time::Instant;
use tokio::sync::{Semaphore, mpsc};

/// Outcomes that may wait for the frame loop.
const MAX_WAITING_OUTCOMES: usize = 16;

/// Called from any thread when an outcome is waiting.
pub type Wake = Arc<dyn Fn() + Send + Sync>;

struct FetchTask {
    ticket: u64,
    handle: tokio::task::AbortHandle,
}

/// A [`TileFetcher`] on tokio.
pub struct BackgroundFetcher {
    http: Arc<Http>,
    source: Arc<dyn TileSource>,
    tasks: HashMap<TileKey, FetchTask>,
    decoders: Arc<Semaphore>,
    sender: mpsc::Sender<FetchOutcome>,
    receiver: mpsc::Receiver<FetchOutcome>,
    wake: Option<Wake>,
    notifier: Arc<Notifier>,
}

impl BackgroundFetcher {
    /// Downloads from `source`, with at most `limit` requests in flight to begin with.
    pub fn downloads(
        http: Arc<Http>,
        source: Arc<dyn TileSource>,
        limit: usize,
        wake: Option<Wake>,
    ) -> Downloads<Self> {
        let (sender, receiver) = mpsc::channel(MAX_WAITING_OUTCOMES);
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        let decoders = Arc::new(Semaphore::new(cores.max(2)));
        let (tasks, notifier) = (HashMap::new(), Arc::default());
        Downloads::new(Self { http, source, tasks, decoders, sender, receiver, wake, notifier }, limit)
    }

    /// Notified whenever an outcome is waiting.
    pub fn notifier(&self) -> Arc<Notifier> {
        self.notifier.clone()
    }

    /// The transport and its counters.
    pub fn http(&self) -> &Http {
        &self.http
    }

    /// URL or folder of the city, for messages.
    pub fn location(&self) -> &str {
        self.source.location()
    }

    /// Fetches a tile in the background as `response` does, and decodes it.
    fn spawn(
        &mut self,
        key: TileKey,
        ticket: u64,
        response: impl Future<Output = Result<Bytes, FetchError>> + Send + 'static,
    ) {
        let (source, decoders) = (self.source.clone(), self.decoders.clone());
        let (sender, wake, notifier) = (self.sender.clone(), self.wake.clone(), self.notifier.clone());
        let handle = self.http.spawn(async move {
            let (is_local, begin) = (source.is_local(key), Instant::now());
            let response = response.await;
            let duration = begin.elapsed();
            let result = match response {
                Ok(bytes) => decode_in_background(key, bytes, decoders, source).await,
                Err(error) => Err(error),
            };
            // A closed channel means that the session has ended.
            if sender.send(FetchOutcome { key, ticket, is_local, duration, result }).await.is_ok() {
                notifier.notify();
                if let Some(wake) = wake {
                    wake();
                }
            }
        });
        self.tasks.insert(key, FetchTask { ticket, handle });
    }
}

impl TileFetcher for BackgroundFetcher {
    fn start(&mut self, key: TileKey, ticket: u64) {
        let source = self.source.clone();
        self.spawn(key, ticket, async move { source.tile(key).await });
    }

    fn start_group(&mut self, group: TileGroup, members: &[(TileKey, u64)]) {
        let keys = members.iter().map(|(key, _)| *key).collect();
        let request = GroupRequest::new(self.source.clone(), group, keys);
        for (key, ticket) in members {
            self.spawn(*key, *ticket, request.clone().tile(*key));
        }
    }

    fn has_groups(&self) -> bool {
        self.source.has_groups()
    }

    fn cancel(&mut self, key: TileKey) {
        if let Some(task) = self.tasks.remove(&key) {
            task.handle.abort();
        }
    }

    fn poll(&mut self) -> Option<FetchOutcome> {
        let outcome = self.receiver.try_recv().ok()?;
        if self.tasks.get(&outcome.key).is_some_and(|task| task.ticket == outcome.ticket) {
            self.tasks.remove(&outcome.key);
        }
        Some(outcome)
    }

    fn is_local(&self, key: TileKey) -> bool {
        self.source.is_local(key)
    }

    fn jitter(&mut self) -> f64 {
        jitter()
    }
}

impl Drop for BackgroundFetcher {
    fn drop(&mut self) {
        self.tasks.values().for_each(|task| task.handle.abort());
    }
}

/// Decodes a tile on a blocking thread and reports to `source` whether it was intact. `decoders` bounds the number of
/// decoders. Fails if the tile does not decode.
async fn decode_in_background(
    key: TileKey,
    bytes: Bytes,
    decoders: Arc<Semaphore>,
    source: Arc<dyn TileSource>,
) -> Result<DecodedTile, FetchError> {
    let interrupted = |e: &dyn std::fmt::Display| FetchError::Network(format!("decoding was interrupted: {e}"));
    let permit = decoders.acquire_owned().await.map_err(|e| interrupted(&e))?;
    let work = tokio::task::spawn_blocking(move || {
        let _permit = permit;
        let decoded = decode(key, &bytes);
        match &decoded {
            Ok(_) => source.keep(key, &bytes),
            Err(_) => source.forget(key),
        }
        decoded
    });
    let decoded = work.await.map_err(|e| interrupted(&e))?;
    decoded.map_err(FetchError::Damaged)
}
