//! What the handlers of one worker thread share.

use super::state::AppState;
use super::tile_cache::TileCache;
use axum::extract::FromRef;
use std::sync::Arc;

/// The server's state with the tile cache of one thread. Cheap to clone.
#[derive(Debug, Clone)]
pub(super) struct ThreadState {
    pub(super) app: AppState,
    pub(super) tiles: Arc<TileCache>,
}

impl FromRef<ThreadState> for AppState {
    fn from_ref(state: &ThreadState) -> Self {
        state.app.clone()
    }
}
