//! Which tiles are requested together.
//!
//! A request for a tile takes the largest group around it of which enough is wanted ([decision 24](../../../../docs/decisions/0024-groups.md)).

use crate::scene::{SceneTree, TileKey, TileState};
use insula_protocol::{TileGroup, TileKind, tile_group};
use std::collections::HashSet;

/// Least share of a group's bytes that must be wanted.
const MIN_WANTED_SHARE: f64 = 0.6;
/// Bytes that count as one request towards the number in flight.
const REQUEST_BYTES: u64 = 4096;

#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct PlannedRequest {
    /// `None` for a single tile.
    pub(super) group: Option<TileGroup>,
    pub(super) keys: Vec<TileKey>,
    /// How much of the number of requests in flight it takes up, at least 1.
    pub(super) weight: usize,
}

impl PlannedRequest {
    pub(super) fn single(key: TileKey) -> Self {
        Self { group: None, keys: vec![key], weight: 1 }
    }

    /// The request for `key` and for those of the `wanted` tiles that are fetched together with it.
    pub(super) fn grouped(key: TileKey, wanted: &HashSet<TileKey>, tree: &SceneTree) -> Self {
        let sizes = (1..=tile_group::MAX_DOUBLINGS).rev();
        let groups = sizes.filter_map(|doublings| TileGroup::around(key.kind(), key.id, doublings, key.lod));
        groups.filter_map(|group| Self::of_group(group, wanted, tree)).next().unwrap_or_else(|| Self::single(key))
    }

    /// `None` if too few of the group's tiles are `wanted`, or the group is too large, or it is unknown which tiles it has.
    fn of_group(group: TileGroup, wanted: &HashSet<TileKey>, tree: &SceneTree) -> Option<Self> {
        let (mut all_bytes, mut wanted_bytes, mut keys) = (0u64, 0u64, Vec::new());
        for id in group.nodes() {
            let key = match group.kind() {
                TileKind::Mesh => TileKey::mesh(id, group.lod()),
                TileKind::Subtree => TileKey::subtree(id),
                _ => TileKey::block_map(id),
            };
            let Some(bytes) = tree.tile_bytes(key) else {
                if tree.may_have_unlisted(id) {
                    return None;
                }
                continue;
            };
            all_bytes += u64::from(bytes);
            let may_start =
                tree.tile(key).is_some_and(|tile| matches!(tile.state(), TileState::Unknown | TileState::Queued));
            if may_start && wanted.contains(&key) {
                wanted_bytes += u64::from(bytes);
                keys.push(key);
            }
        }
        let is_wanted = wanted_bytes as f64 >= MIN_WANTED_SHARE * all_bytes as f64;
        let fits = all_bytes <= tile_group::MAX_TILES_BYTES as u64;
        let weight = wanted_bytes.div_ceil(REQUEST_BYTES).max(1) as usize;
        (keys.len() > 1 && is_wanted && fits).then_some(Self { group: Some(group), keys, weight })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::select::tests::tree;
    use insula_protocol::TileId;

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
