//! The visibility tiles of a session.

use super::tile::{TileEvent, TileRecord};
use insula_protocol::{TileId, VisibilityTile};
use std::collections::{HashMap, VecDeque};

/// Most tiles that are kept. Each takes at most 109 kB.
const CAPACITY: usize = 16;

#[derive(Debug, Clone, Default)]
pub(super) struct VisibilityTiles {
    states: HashMap<TileId, TileRecord>,
    /// The latest last.
    resident: VecDeque<VisibilityTile>,
}

impl VisibilityTiles {
    pub(super) fn state(&self, id: TileId) -> TileRecord {
        self.states.get(&id).copied().unwrap_or_default()
    }

    pub(super) fn apply(&mut self, id: TileId, event: TileEvent) -> bool {
        if self.states.len() > 64 * CAPACITY {
            self.states.retain(|_, tile| tile.is_resident());
        }
        self.states.entry(id).or_default().apply(event)
    }

    /// Takes in a decoded tile. The oldest makes room for it.
    pub(super) fn put(&mut self, tile: VisibilityTile) {
        if self.resident.len() >= CAPACITY
            && let Some(oldest) = self.resident.pop_front()
        {
            self.apply(oldest.id, TileEvent::Drop);
        }
        self.apply(tile.id, TileEvent::Upload);
        self.resident.push_back(tile);
    }

    /// A resident tile.
    pub(super) fn get(&self, id: TileId) -> Option<&VisibilityTile> {
        self.resident.iter().find(|tile| tile.id == id)
    }
}
