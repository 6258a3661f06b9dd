//! Which tiles are requested together.
//!
//! The tiles of a rectangle of nodes are fetched with the fewest bytes, if each request counts as some bytes, too: as a whole, or in two
//! halves, each of which is fetched as a whole or in halves again ([decision 24](../../../../docs/decisions/0024-groups.md)).

use crate::scene::{SceneTree, TileKey, TileState};
use insula_protocol::{TileGroup, TileId, TileKind, tile_group};
use std::collections::HashSet;

/// A request more costs as much as so many unwanted bytes.
const REQUEST_COST_BYTES: u64 = 5000;
/// Bytes that count as one request towards the number in flight.
const REQUEST_BYTES: u64 = 4096;

/// One request.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct PlannedRequest {
    /// `None` for a single tile.
    pub(super) group: Option<TileGroup>,
    /// The wanted tiles.
    pub(super) keys: Vec<TileKey>,
    /// How much of the number of requests in flight it takes up, at least 1.
    pub(super) weight: usize,
}

impl PlannedRequest {
    /// A request for one tile.
    pub(super) fn single(key: TileKey) -> Self {
        Self { group: None, keys: vec![key], weight: 1 }
    }

    /// The request for `key` and for those of the `wanted` tiles that are fetched together with it.
    pub(super) fn grouped(key: TileKey, wanted: &HashSet<TileKey>, tree: &SceneTree) -> Self {
        let mut sizes = (1..=tile_group::MAX_DOUBLINGS).rev();
        let group = sizes.find_map(|doublings| TileGroup::around(key.kind(), key.id, doublings, key.lod));
        let found = group.and_then(|group| {
            let plan = GroupPlan { key, wanted, tree };
            plan.cheapest(group.first(), group.doublings()).request
        });
        found.unwrap_or_else(|| Self::single(key))
    }
}

/// How the tiles around a tile are fetched.
struct GroupPlan<'a> {
    key: TileKey,
    wanted: &'a HashSet<TileKey>,
    tree: &'a SceneTree,
}

/// The tiles of a rectangle of nodes, and the cheapest way to fetch those that are wanted.
#[derive(Default)]
struct RectanglePlan {
    /// Bytes of the responses and the costs of the requests.
    cost: u64,
    all_bytes: u64,
    wanted_bytes: u64,
    keys: Vec<TileKey>,
    /// Whether it is not known which tiles there are: then there is no group of all of them.
    is_unknown: bool,
    /// The request that has the plan's tile, if the rectangle has that.
    request: Option<PlannedRequest>,
}

impl GroupPlan<'_> {
    /// Of `2^doublings` nodes, the south-western one being `first`.
    fn cheapest(&self, first: TileId, doublings: u8) -> RectanglePlan {
        let Some(smaller) = doublings.checked_sub(1) else { return self.of_tile(first) };
        let halves = TileGroup::halves(first, doublings);
        let mut plan = RectanglePlan::default();
        for half in halves.into_iter().flatten().map(|first| self.cheapest(first, smaller)) {
            plan.cost += half.cost;
            plan.all_bytes += half.all_bytes;
            plan.wanted_bytes += half.wanted_bytes;
            plan.keys.extend(half.keys);
            plan.is_unknown |= half.is_unknown;
            plan.request = plan.request.or(half.request);
        }
        let whole = REQUEST_COST_BYTES + plan.all_bytes;
        let fits = plan.all_bytes <= tile_group::MAX_TILES_BYTES as u64;
        if plan.keys.len() > 1 && fits && !plan.is_unknown && whole <= plan.cost {
            plan.cost = whole;
            plan.request = plan.request.and_then(|_| {
                let group = TileGroup::new(self.key.kind(), first, doublings, self.key.lod)?;
                let weight = plan.wanted_bytes.div_ceil(REQUEST_BYTES).max(1) as usize;
                Some(PlannedRequest { group: Some(group), keys: plan.keys.clone(), weight })
            });
        }
        plan
    }

    /// Of the tile of one node.
    fn of_tile(&self, id: TileId) -> RectanglePlan {
        let key = match self.key.kind() {
            TileKind::Mesh => TileKey::mesh(id, self.key.lod),
            TileKind::Subtree => TileKey::subtree(id),
            _ => TileKey::block_map(id),
        };
        let Some(bytes) = self.tree.tile_bytes(key).map(u64::from) else {
            return RectanglePlan { is_unknown: self.tree.may_have_unlisted(id), ..RectanglePlan::default() };
        };
        let may_start =
            self.tree.tile(key).is_some_and(|tile| matches!(tile.state(), TileState::Unknown | TileState::Queued));
        if !may_start || !self.wanted.contains(&key) {
            return RectanglePlan { all_bytes: bytes, ..RectanglePlan::default() };
        }
        RectanglePlan {
            cost: REQUEST_COST_BYTES + bytes,
            all_bytes: bytes,
            wanted_bytes: bytes,
            keys: vec![key],
            is_unknown: false,
            request: (key == self.key).then(|| PlannedRequest::single(key)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::select::tests::tree;

    fn keys(ids: impl IntoIterator<Item = TileId>) -> HashSet<TileKey> {
        ids.into_iter().map(TileKey::block_map).collect()
    }

    fn id(level: u8, x: u32, y: u32) -> TileId {
        TileId::new(level, x, y).unwrap()
    }

    #[test]
    fn wanted_neighbours_are_fetched_together() {
        let tree = tree();
        let first = id(5, 16, 8);
        let alone = PlannedRequest::grouped(TileKey::block_map(first), &keys([first]), &tree);
        assert_eq!(alone, PlannedRequest::single(TileKey::block_map(first)));
        for doublings in 1..=tile_group::MAX_DOUBLINGS {
            let group = TileGroup::around(TileKind::BlockMap, first, doublings, 0).unwrap();
            let request = PlannedRequest::grouped(TileKey::block_map(first), &keys(group.nodes()), &tree);
            assert_eq!(request.group, Some(group));
            assert_eq!(request.keys.len(), group.node_count());
        }
    }

    #[test]
    fn a_group_with_too_many_unwanted_tiles_is_not_fetched() {
        let tree = tree();
        let group = TileGroup::new(TileKind::BlockMap, id(5, 16, 8), 4, 0).unwrap();
        let nodes: Vec<TileId> = group.nodes().collect();
        let but_two = PlannedRequest::grouped(TileKey::block_map(nodes[0]), &keys(nodes[..14].to_vec()), &tree);
        assert_eq!((but_two.group, but_two.keys.len()), (Some(group), 14));
        let half = PlannedRequest::grouped(TileKey::block_map(nodes[0]), &keys(nodes[..8].to_vec()), &tree);
        assert_eq!((half.group.map(TileGroup::node_count), half.keys.len()), (Some(8), 8));
    }
}
