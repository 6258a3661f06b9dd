//! Fetches tiles, and has other workers decode them.

use bytes::Bytes;
use futures_util::future::{AbortHandle, abortable};
use insula_protocol::{DecodeError, TileGroup, TileKind};
use insula_viewer::decode::{DecodedTile, decode_index};
use insula_viewer::scene::TileKey;
use insula_viewer::source::group_request::GroupRequest;
use insula_viewer::source::{FetchError, TileSource};
use insula_viewer::streamer::{FetchOutcome, TileFetcher};
use insula_viewer::transfer;
use insula_web_host::host::{Host, key_numbers};
use js_sys::{Reflect, Uint8Array};
use std::cell::RefCell;
use std::collections::{HashMap, VecDeque};
use std::rc::Rc;
use std::sync::Arc;
use wasm_bindgen::{JsCast, JsValue};
use wasm_bindgen_futures::{JsFuture, spawn_local};
use web_time::Instant;

/// A [`TileFetcher`] on promises. Outcomes that wait are bounded by the requests in flight.
pub(crate) struct BrowserFetcher {
    host: Host,
    source: Arc<dyn TileSource>,
    tasks: HashMap<TileKey, AbortHandle>,
    outcomes: Rc<RefCell<VecDeque<FetchOutcome>>>,
}

impl BrowserFetcher {
    pub(crate) fn new(host: Host, source: Arc<dyn TileSource>) -> Self {
        Self { host, source, tasks: HashMap::new(), outcomes: Rc::default() }
    }

    /// Fetches a tile in the background as `response` does, and has it decoded.
    fn spawn(
        &mut self,
        key: TileKey,
        ticket: u64,
        response: impl Future<Output = Result<Bytes, FetchError>> + 'static,
    ) {
        let (host, outcomes) = (self.host.clone(), self.outcomes.clone());
        let (task, handle) = abortable(async move {
            let begin = Instant::now();
            let response = response.await;
            let duration = begin.elapsed();
            let result = match response {
                Ok(bytes) => decode_elsewhere(&host, key, bytes).await,
                Err(error) => Err(error),
            };
            // The damaged bytes may be in a cache of the browser, which would answer with them for ever.
            if let Err(FetchError::Damaged(_) | FetchError::Broken | FetchError::Archive(_)) = &result {
                host.bypass_caches();
            }
            outcomes.borrow_mut().push_back(FetchOutcome { key, ticket, is_local: false, duration, result });
            host.wake();
        });
        self.tasks.insert(key, handle);
        spawn_local(async move {
            // An aborted task has no outcome.
            let _ = task.await;
        });
    }
}

impl TileFetcher for BrowserFetcher {
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
            task.abort();
        }
    }

    fn poll(&mut self) -> Option<FetchOutcome> {
        let outcome = self.outcomes.borrow_mut().pop_front()?;
        self.tasks.remove(&outcome.key);
        Some(outcome)
    }

    fn jitter(&mut self) -> f64 {
        js_sys::Math::random()
    }
}

impl Drop for BrowserFetcher {
    fn drop(&mut self) {
        self.tasks.values().for_each(AbortHandle::abort);
    }
}

/// Decodes a tile in another worker, except subtrees and visibility, which are small.
async fn decode_elsewhere(host: &Host, key: TileKey, bytes: Bytes) -> Result<DecodedTile, FetchError> {
    if matches!(key.kind(), TileKind::Subtree | TileKind::Visibility) {
        return decode_index(key, &bytes).map_err(FetchError::Damaged);
    }
    let decoded = JsFuture::from(host.decode(&key_numbers(key), Uint8Array::from(&bytes[..]))).await;
    let decoded: Uint8Array = decoded.map_err(|reason| not_decoded(&reason))?.unchecked_into();
    transfer::from_bytes(&decoded.to_vec()).map(DecodedTile::Packed).map_err(FetchError::Damaged)
}

/// The module that decodes meshes may not have come: then the tile is not at fault.
fn not_decoded(reason: &JsValue) -> FetchError {
    match Reflect::get(reason, &"isTemporary".into()) {
        Ok(is_temporary) if is_temporary.is_truthy() => {
            FetchError::Network("the module that decodes meshes cannot be fetched".into())
        }
        _ => FetchError::Damaged(DecodeError::Invalid("a tile that does not decode")),
    }
}
