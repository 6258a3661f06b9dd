//! Random cities, arrivals, failures, evictions, cameras, budgets and hits.

use super::*;
use crate::scene::TileState;
use crate::select::transitions::Transitions;
use insula_protocol::TileKind;
use insula_test_support::rng::Rng;

struct RandomSession {
    random: Rng,
    tree: SceneTree,
    /// Subtrees that have not arrived.
    missing_subtrees: Vec<Subtree>,
    feedback: OcclusionFeedback,
    transitions: Transitions,
    now: Duration,
}

impl RandomSession {
    /// Every fourth city has several levels of subtrees, every second one has meshes.
    fn new(seed: u64) -> Self {
        let mut random = Rng::new(seed);
        let is_deep = Self::is_deep(seed);
        let gaps = if is_deep { 2 } else { random.below_u32(5) + 2 };
        let depth = if is_deep { 7 } else { DEPTH };
        let is_gap = |id: TileId| id.level() > 1 && (id.x() * 7 + id.y() * 13).is_multiple_of(gaps);
        let mut subtrees = subtrees(depth, is_gap);
        if seed % 2 == 1 {
            subtrees = subtrees.into_iter().map(with_meshes).collect();
        }
        let mut tree = SceneTree::new(manifest(depth));
        load(&mut tree, TileKey::subtree(TileId::ROOT));
        tree.merge(&subtrees.remove(0));
        load_root(&mut tree);
        Self {
            random,
            tree,
            missing_subtrees: subtrees,
            feedback: OcclusionFeedback::default(),
            transitions: super::transitions::enabled(),
            now: NOW,
        }
    }

    fn is_deep(seed: u64) -> bool {
        seed.is_multiple_of(4)
    }

    fn view(&mut self) -> View {
        let mut below = |bound: usize| self.random.below(bound) as f64;
        let eye = [below(2400) - 200.0, below(2400) - 200.0, below(300) + 1.0];
        let mut view = view(eye, [below(2048), below(2048), below(40)]);
        view.budget_pages = 60 + self.random.below_u32(2000);
        view.tau_px = [0.5, 1.0, 4.0][self.random.below(3)];
        view
    }

    fn frame(&mut self, view: &View, number: usize, scratch: &mut SelectionScratch) {
        self.now += Duration::from_millis(u64::from(self.random.below_u32(300)));
        let selection = select(view, &self.tree, &self.feedback, scratch);
        assert_no_holes(&self.tree, view, &selection, number);
        let secs = self.random.below(300) as f64 / 1e3;
        super::transitions::step(&mut self.transitions, &self.tree, &selection, secs);
        selection.requests.iter().for_each(|w| self.fetch(w.key));
        let salt = self.random.below_u32(1000);
        if self.random.below(3) > 0 {
            let is_hit = |id: TileId| (id.x() * 31 + id.y() * 17 + salt).is_multiple_of(3);
            report(&mut self.feedback, &self.tree, view, &selection, is_hit);
        }
        self.evict(&selection);
    }

    /// Requests a tile, which may arrive, fail, or be cancelled.
    fn fetch(&mut self, key: TileKey) {
        let Self { random, tree, missing_subtrees, now, .. } = self;
        let now = *now;
        if !tree.apply(key, TileEvent::Want { now }) || !tree.apply(key, TileEvent::Start) {
            return;
        }
        let jitter = random.below(100) as f64 / 100.0;
        tree.apply(
            key,
            match random.below(40) {
                0 if random.below(10) == 0 => TileEvent::Refuse,
                1..4 => TileEvent::Fail { now, retry_after: None, jitter },
                4..6 => TileEvent::Damage { now, jitter },
                6..20 => TileEvent::Drop,
                _ => TileEvent::Arrive,
            },
        );
        if tree.tile(key).unwrap().state() != TileState::Decoded {
            return;
        }
        if key.kind() == TileKind::Subtree {
            let position = missing_subtrees.iter().position(|s| s.nodes[0].id == key.id);
            match position.filter(|_| tree.find(key.id).is_some()) {
                Some(position) => tree.merge(&missing_subtrees.swap_remove(position)),
                None => {
                    tree.apply(key, TileEvent::Drop);
                    return;
                }
            }
        }
        tree.apply(key, TileEvent::Upload);
    }

    /// Evicts some of the tiles that a selection does not use.
    fn evict(&mut self, selection: &Selection) {
        let Self { random, tree, .. } = self;
        let used: HashSet<TileId> = ids_of(tree, &selection.used_nodes).into_iter().collect();
        for id in resident_nodes(tree).into_iter().filter(|id| *id != TileId::ROOT && !used.contains(id)) {
            if random.below(3) == 0 {
                tree.apply(TileKey::block_map(id), TileEvent::Drop);
            }
        }
        let leaves: Vec<TileId> = tree.nodes().filter(|n| !n.lods.is_empty()).map(|n| n.id).collect();
        let meshes = leaves.into_iter().flat_map(|id| (0..3).map(move |lod| TileKey::mesh(id, lod)));
        for key in meshes.filter(|key| !selection.used_meshes.contains(key)) {
            if random.below(5) == 0 && tree.tile(key).is_some_and(|tile| tile.is_resident()) {
                tree.apply(key, TileEvent::Drop);
            }
        }
    }
}

#[test]
fn random_sessions_have_no_holes() {
    let mut scratch = SelectionScratch::default();
    let mut deepened = 0;
    for seed in 0..80 {
        let mut session = RandomSession::new(seed);
        for frame in 0..if RandomSession::is_deep(seed) { 25 } else { 60 } {
            let view = session.view();
            (0..4).for_each(|_| session.frame(&view, frame, &mut scratch));
        }
        deepened += usize::from(session.tree.nodes().any(|node| node.id.level() > DEPTH));
    }
    assert!(deepened >= 5, "subtrees arrived in {deepened} cities only");
}
