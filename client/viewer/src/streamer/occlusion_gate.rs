//! The occlusion gate: holds back requests for tiles that may turn out to be occluded.
//!
//! Coarse columns let rays through that finer ones stop. So a tile behind one in flight may be occluded after the arrival.
//! It waits until a frame has been drawn with its possible occluders, for 250 ms at most.

use crate::camera::View;
use crate::scene::{SceneTree, TileKey, TileState};
use crate::select::OCCLUDED_TAU_FACTOR;
use crate::select::horizon_culling::{Occluder, may_be_occluded};
use crate::select::priority::{PriorityGroup, TileRequest};
use insula_protocol::TileKind;
use std::collections::HashSet;
use std::time::Duration;

/// Longest time that a tile is waited for, and that the frame after its arrival is waited for.
const PATIENCE: Duration = Duration::from_millis(250);

/// A tile that arrived, and that no frame with feedback has shown yet.
#[derive(Debug)]
struct UnseenTile {
    key: TileKey,
    /// The first draw list that can contain it.
    generation: u64,
    arrived_at: Duration,
}

#[derive(Debug, Default)]
pub(super) struct OcclusionGate {
    unseen: Vec<UnseenTile>,
}

/// What the gate needs to know about tiles.
pub(super) struct GateInputs<'a, S> {
    pub(super) tree: &'a SceneTree,
    pub(super) view: &'a View,
    /// When the request for a tile started, if it is in flight.
    pub(super) started_at: S,
    pub(super) now: Duration,
}

impl OcclusionGate {
    /// Records that a tile has arrived; draw lists from `generation` on can contain it.
    pub(super) fn tile_arrived(&mut self, key: TileKey, generation: u64, now: Duration) {
        self.unseen.push(UnseenTile { key, generation, arrived_at: now });
    }

    /// Records that feedback of a draw list was taken in.
    pub(super) fn feedback_received(&mut self, generation: u64) {
        self.unseen.retain(|tile| tile.generation > generation);
    }

    /// Records that feedback was taken in of a frame with all resident tiles.
    pub(super) fn complete_feedback_received(&mut self) {
        self.unseen.clear();
    }

    /// Stops waiting for frames that take too long.
    pub(super) fn drop_expired(&mut self, now: Duration) {
        self.unseen.retain(|tile| !is_expired(tile.arrived_at, now));
    }

    /// Removes from `requests` the tiles that may be occluded by tiles in front of them, as long as those are among the `all` that
    /// are wanted and on their way, or have arrived and no frame with feedback has shown them.
    pub(super) fn filter(
        &self,
        all: &[TileRequest],
        mut requests: Vec<TileRequest>,
        inputs: &GateInputs<'_, impl Fn(TileKey) -> Option<Duration>>,
    ) -> Vec<TileRequest> {
        let tree = inputs.tree;
        let state = |key: TileKey| tree.tile(key).map(|tile| tile.state());
        let is_on_its_way = |request: &&TileRequest| {
            let is_in_view = request.group <= PriorityGroup::Normal
                && !matches!(request.key.kind(), TileKind::Subtree | TileKind::Visibility);
            // A failed tile may arrive at any time, or never.
            let has_failed = matches!(state(request.key), Some(TileState::Failed { .. }));
            let is_late = (inputs.started_at)(request.key).is_some_and(|since| is_expired(since, inputs.now));
            is_in_view && !has_failed && !is_late
        };
        let coming = all.iter().filter(is_on_its_way).map(|request| request.key);
        let unseen = self.unseen.iter().map(|tile| tile.key);
        let bounds = |key: TileKey| tree.find(key.id).map(|index| (key, tree.node(index)));
        let (keys, boxes): (Vec<TileKey>, Vec<Occluder>) = coming
            .chain(unseen)
            .filter_map(bounds)
            .map(|(key, node)| (key, Occluder { centre: node.centre, half: node.half }))
            .unzip();
        let occluded = may_be_occluded(inputs.view.camera.position, &boxes);
        let waiting: HashSet<TileKey> =
            keys.into_iter().zip(occluded).filter(|(_, occluded)| *occluded).map(|(key, _)| key).collect();
        // A tile with so large an error is requested whether it is occluded or not.
        let large_error_px = OCCLUDED_TAU_FACTOR * inputs.view.tau_px;
        requests.retain(|request| {
            !waiting.contains(&request.key)
                || request.exceeds(large_error_px)
                || state(request.key) == Some(TileState::Loading)
        });
        requests
    }
}

fn is_expired(since: Duration, now: Duration) -> bool {
    now.saturating_sub(since) > PATIENCE
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::TileEvent;
    use crate::select::tests::{load, request, tree, view};
    use insula_protocol::TileId;

    const NOW: Duration = Duration::from_secs(100);

    /// Leaves of 64 m, 30 m high: in front of the eye, half a kilometre behind that, and beside it.
    fn leaves() -> [TileKey; 3] {
        [(16, 0), (16, 8), (26, 0)].map(|(x, y)| TileKey::block_map(TileId::new(5, x, y).unwrap()))
    }

    /// The requests of `all` that pass; the front leaf has been in flight for `front_ms`, if that is given.
    fn passing(gate: &OcclusionGate, tree: &SceneTree, all: &[TileRequest], front_ms: Option<u64>) -> Vec<TileKey> {
        let [front, ..] = leaves();
        let started_at = |key: TileKey| {
            front_ms.filter(|_| key == front).and_then(|millis| NOW.checked_sub(Duration::from_millis(millis)))
        };
        let view = view([1056.0, -10.0, 2.0], [1056.0, 1000.0, 2.0]);
        let inputs = GateInputs { tree, view: &view, started_at, now: NOW };
        gate.filter(all, all.to_vec(), &inputs).into_iter().map(|request| request.key).collect()
    }

    #[test]
    fn occludable_tiles_wait_for_tiles_in_front_of_them() {
        let [front, behind, beside] = leaves();
        let all = [behind, front, beside].map(request);
        let (mut tree, gate) = (tree(), OcclusionGate::default());
        assert_eq!(passing(&gate, &tree, &all, None), [front, beside], "in their order");
        // Tiles with a large error, and tiles out of view, do not wait.
        for (weight_px, group) in
            [(65.0, PriorityGroup::Urgent), (2.0, PriorityGroup::Shadow), (2.0, PriorityGroup::Preload)]
        {
            let free = [TileRequest { weight_px, group, ..request(behind) }, request(front)];
            assert_eq!(passing(&gate, &tree, &free, None), [behind, front]);
        }
        for event in [TileEvent::Want { now: NOW }, TileEvent::Start] {
            assert!(tree.apply(front, event));
        }
        assert_eq!(passing(&gate, &tree, &all, Some(100)), [front, beside]);
        assert_eq!(passing(&gate, &tree, &all, Some(300)), [behind, front, beside], "too slow to wait for");
        assert!(tree.apply(front, TileEvent::Fail { now: NOW, retry_after: None, jitter: 0.0 }));
        assert_eq!(passing(&gate, &tree, &all, None), [behind, front, beside]);
    }

    #[test]
    fn occludable_tiles_wait_until_a_frame_shows_the_tiles_in_front() {
        let [front, behind, beside] = leaves();
        let (mut tree, mut gate) = (tree(), OcclusionGate::default());
        load(&mut tree, front);
        let rest = [behind, beside].map(request);
        assert_eq!(passing(&gate, &tree, &rest, None), [behind, beside]);
        gate.tile_arrived(front, 5, NOW);
        gate.feedback_received(4);
        assert_eq!(passing(&gate, &tree, &rest, None), [beside]);
        gate.feedback_received(5);
        assert_eq!(passing(&gate, &tree, &rest, None), [behind, beside]);
        gate.tile_arrived(front, 6, NOW);
        gate.drop_expired(NOW + Duration::from_millis(200));
        assert_eq!(passing(&gate, &tree, &rest, None), [beside]);
        gate.drop_expired(NOW + Duration::from_millis(300));
        assert_eq!(passing(&gate, &tree, &rest, None), [behind, beside], "no feedback arrives");
    }
}
