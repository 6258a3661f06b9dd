//! What waits for what stands in front of it.
//!
//! In: tiles that are wanted, those on their way, those that came and no picture has looked at yet. Out: what to ask for now.
//! Next: `flow` asks.
//!
//! Coarse columns let rays through that finer ones stop: what a ray hits behind a tile that is still to come may not be seen
//! once that is here. So it waits, but never for long.

use crate::{
    camera::View,
    scene::{SceneTree, TileKey, TileState},
    select::{
        OCCLUDED_TAU_FACTOR,
        horizon_culling::{Occluder, may_be_occluded},
        priority::{PriorityGroup, TileRequest},
    },
};
use insula_protocol::route::Layer;
use std::{collections::HashSet, time::Duration};

/// What may be hidden waits no longer than this for an answer, nor for the picture after it: a slow one must not hold up others.
const PATIENCE_IN_FRONT: Duration = Duration::from_millis(250);

/// A tile that came, and the first selection that can draw it: no picture has told yet what it hides.
#[derive(Debug)]
struct Newcomer {
    key: TileKey,
    generation: u64,
    since: Duration,
}

/// Tiles that came and no picture has looked at yet.
#[derive(Debug, Default)]
pub(super) struct OcclusionGate {
    newcomers: Vec<Newcomer>,
}

impl OcclusionGate {
    /// A tile came, which selections from `generation` on can draw.
    pub(super) fn came(&mut self, key: TileKey, generation: u64, now: Duration) {
        self.newcomers.push(Newcomer { key, generation, since: now });
    }

    /// A picture of a selection has told what is seen.
    pub(super) fn told(&mut self, generation: u64) {
        self.newcomers.retain(|newcomer| newcomer.generation > generation);
    }

    /// A picture of all that is here has told what is seen beside it.
    pub(super) fn told_all(&mut self) {
        self.newcomers.clear();
    }

    /// Gives up those that no picture comes to look at.
    pub(super) fn pass(&mut self, now: Duration) {
        self.newcomers.retain(|newcomer| !is_late(newcomer.since, now));
    }

    /// Which of `wanted` are to be asked for now: none that may be hidden by what is on its way of `all` that is wanted, or came
    /// and no picture has looked at yet. Rays may tell that nobody sees it. `begun` tells since when a tile is under way.
    pub(super) fn front(
        &self,
        all: &[TileRequest],
        mut wanted: Vec<TileRequest>,
        (tree, view): (&SceneTree, &View),
        begun: impl Fn(TileKey) -> Option<Duration>,
        now: Duration,
    ) -> Vec<TileRequest> {
        let state = |key: TileKey| tree.tile(key).map(|tile| tile.state());
        let stands = |w: &&TileRequest| {
            let of_picture = w.group <= PriorityGroup::Normal && w.key.layer() != Layer::Subtrees;
            // One that failed may come any time, or never.
            let failed = matches!(state(w.key), Some(TileState::Failed { .. }));
            of_picture && !failed && !begun(w.key).is_some_and(|since| is_late(since, now))
        };
        let coming = all.iter().filter(stands).map(|w| w.key);
        let came = self.newcomers.iter().map(|newcomer| newcomer.key);
        let place = |key: TileKey| tree.find(key.id).map(|at| (key, tree.node(at)));
        let (keys, solids): (Vec<TileKey>, Vec<Occluder>) = coming
            .chain(came)
            .filter_map(place)
            .map(|(key, node)| (key, Occluder { centre: node.centre, half: node.half }))
            .unzip();
        let hidden = may_be_occluded(view.camera.position, &solids);
        let waits: HashSet<TileKey> =
            keys.into_iter().zip(hidden).filter(|(_, hidden)| *hidden).map(|(key, _)| key).collect();
        // What is so wrong is all that there is to be seen yet.
        let most_px = OCCLUDED_TAU_FACTOR * view.tau_px;
        let is_loading = |key: TileKey| state(key) == Some(TileState::Loading);
        wanted.retain(|w| !waits.contains(&w.key) || w.exceeds(most_px) || is_loading(w.key));
        wanted
    }
}

fn is_late(since: Duration, now: Duration) -> bool {
    now.saturating_sub(since) > PATIENCE_IN_FRONT
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        scene::TileEvent,
        select::{
            priority::RequestReason,
            tests::{load, tree, view},
        },
    };
    use insula_protocol::TileId;

    /// Leaves of 64 m, 30 m high: before the eye, half a kilometre behind that, and beside it.
    const PLACES: [(u32, u32); 3] = [(16, 0), (16, 8), (26, 0)];

    #[test]
    fn what_may_be_hidden_waits_until_what_is_in_front_was_looked_at() {
        let [front, behind, beside] = PLACES.map(|(x, y)| TileKey::block_map(TileId::new(5, x, y).unwrap()));
        let view = view([1056.0, -10.0, 2.0], [1056.0, 1000.0, 2.0]);
        let want = |key: TileKey| TileRequest {
            key,
            group: PriorityGroup::Normal,
            reason: RequestReason::Visible,
            weight_px: 2.0,
        };
        let all = [behind, front, beside].map(want);
        let (mut tree, mut wave, now) = (tree(), OcclusionGate::default(), Duration::from_secs(100));
        let asked = |wave: &OcclusionGate, tree: &SceneTree, all: &[TileRequest], begun: Option<Duration>| {
            let begun = |key: TileKey| begun.filter(|_| key == front);
            let front = wave.front(all, all.to_vec(), (tree, &view), begun, now);
            front.into_iter().map(|w| w.key).collect::<Vec<_>>()
        };
        assert_eq!(asked(&wave, &tree, &all, None), [front, beside], "in their order");
        // Whoever is under way stays so; what is very wrong and what is not for the picture do not wait.
        for (weight_px, group) in
            [(65.0, PriorityGroup::Urgent), (2.0, PriorityGroup::Shadow), (2.0, PriorityGroup::Preload)]
        {
            let free = [TileRequest { weight_px, group, ..want(behind) }, want(front)];
            assert_eq!(asked(&wave, &tree, &free, None), [behind, front]);
        }
        for event in [TileEvent::Want { now }, TileEvent::Start] {
            assert!(tree.apply(front, event));
        }
        let ago = |millis: u64| now.checked_sub(Duration::from_millis(millis));
        assert_eq!(asked(&wave, &tree, &all, ago(100)), [front, beside]);
        assert_eq!(asked(&wave, &tree, &all, ago(300)), [behind, front, beside], "too slow to be waited for");
        let mut failed = tree.clone();
        assert!(failed.apply(front, TileEvent::Fail { now, retry_after: None, jitter: 0.0 }));
        assert_eq!(asked(&wave, &failed, &all, None), [behind, front, beside]);
        // It is here: until a picture that it is in was looked at.
        assert!(tree.apply(front, TileEvent::Drop));
        load(&mut tree, front);
        let rest = [behind, beside].map(want);
        assert_eq!(asked(&wave, &tree, &rest, None), [behind, beside]);
        wave.came(front, 5, now);
        wave.told(4);
        assert_eq!(asked(&wave, &tree, &rest, None), [beside]);
        wave.told(5);
        assert_eq!(asked(&wave, &tree, &rest, None), [behind, beside]);
        wave.came(front, 6, now);
        wave.pass(now + Duration::from_millis(200));
        assert_eq!(asked(&wave, &tree, &rest, None), [beside]);
        wave.pass(now + Duration::from_millis(300));
        assert_eq!(asked(&wave, &tree, &rest, None), [behind, beside], "nobody comes to look");
    }
}
