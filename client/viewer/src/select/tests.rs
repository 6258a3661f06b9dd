//! Frame by frame, with trees built by hand.

mod fade;
mod hidden;
mod meshes;

use super::*;
use crate::{
    camera::Camera,
    scene::{NodeIndex, TileEvent, TileKey, TileState, TreeNode},
    test_support,
};
use glam::DVec3;
use insula_protocol::{
    Manifest, Subtree, TileId,
    subtree::{MeshLod, NodeInfo, NodeMesh},
};
use occlusion_feedback::OcclusionQuery;
use screen_error::ErrorMetric;
use std::{collections::HashSet, time::Duration};

const DEPTH: u8 = 5;
const SIDE_M: f64 = 64.0 * 32.0;

fn manifest(depth: u8) -> Manifest {
    let (origin, focus) = ([500_000.0, 4_000_000.0, 10.0], [[0.0; 2], [1.0; 2]]);
    Manifest { origin, focus, bounds: [[0.0; 3]; 2], ..test_support::manifest(depth) }
}

/// A full tree down to `to` (some quadrants left out by `skip`), as subtrees.
fn subtrees(to: u8, skip: impl Fn(TileId) -> bool) -> Vec<Subtree> {
    let mut roots = vec![TileId::ROOT];
    let mut all = Vec::new();
    while let Some(root) = roots.pop() {
        let (mut ids, mut nodes, mut next) = (vec![root], Vec::new(), 0);
        while let Some(&id) = ids.get(next) {
            next += 1;
            let children: Vec<TileId> = id.children().filter(|c| c.level() <= to && !skip(*c)).collect();
            let child_mask = children.iter().fold(0, |mask, c| mask | 1 << c.quadrant());
            let side = SIDE_M as f32 / f32::from(1u16 << id.level());
            let (z_min_m, z_max_m) = (0.0, 30.0);
            let radius_m = (side * side * 0.5 + 15.0 * 15.0).sqrt();
            nodes.push(NodeInfo {
                id,
                child_mask,
                z_min_m,
                z_max_m,
                error_m: side / 64.0,
                radius_m,
                blockmap_bytes: 1,
            });
            let last = id.level() == root.level() + 5;
            if !last {
                ids.extend(children);
            } else if child_mask != 0 {
                roots.push(id);
            }
        }
        all.push(Subtree { nodes, meshes: Vec::new() });
    }
    all
}

pub(crate) fn tree() -> SceneTree {
    let mut tree = SceneTree::new(manifest(DEPTH));
    subtrees(DEPTH, |_| false).iter().for_each(|s| tree.merge(s));
    tree
}

/// Every leaf has a mesh of three levels of detail.
fn with_meshes(mut subtree: Subtree) -> Subtree {
    let lod = |error_m: f32| MeshLod { error_m, bytes: 1, triangles: 900, texture_px: 0 };
    let leaves = subtree.nodes.iter().filter(|node| node.child_mask == 0);
    let lods = || [0.02, 0.1, 0.4].map(lod).to_vec();
    subtree.meshes = leaves.map(|leaf| NodeMesh { id: leaf.id, lods: lods() }).collect();
    subtree
}

pub(crate) fn view(position: [f64; 3], target: [f64; 3]) -> View {
    let world = DVec3::new(500_000.0, 4_000_000.0, 10.0);
    let (position, target) = (DVec3::from(position) + world, DVec3::from(target) + world);
    let camera = Camera::look_at(position, target, DVec3::Z, 1.0).unwrap();
    View { camera, width_px: 640, height_px: 360, tau_px: 1.0, budget_pages: 1_000_000, budget_nodes: 100_000 }
}

pub(crate) fn load(tree: &mut SceneTree, key: TileKey) {
    for event in
        [TileEvent::Want { now: Duration::from_secs(100) }, TileEvent::Start, TileEvent::Arrive, TileEvent::Upload]
    {
        assert!(tree.apply(key, event), "{key:?} {event:?}");
    }
}

fn refuse(tree: &mut SceneTree, key: TileKey) {
    for event in [TileEvent::Want { now: Duration::from_secs(100) }, TileEvent::Start, TileEvent::Refuse] {
        assert!(tree.apply(key, event));
    }
}

/// By the frustum alone.
fn select(view: &View, tree: &SceneTree, scratch: &mut SelectionScratch) -> Selection {
    super::select(view, tree, &OcclusionFeedback::default(), scratch)
}

/// Whose tiles are drawn, each once.
fn ids(tree: &SceneTree, selection: &Selection) -> Vec<TileId> {
    let mut ids: Vec<TileId> = selection.draw_tiles.iter().map(|item| tree.node(item.source).id).collect();
    ids.sort();
    ids.dedup();
    ids
}

/// Every leaf in view has exactly one of its line (itself and its ancestors) in the cut, and that is drawn from a resident
/// tile of its own line.
fn assert_whole(tree: &SceneTree, view: &View, selection: &Selection, frame: usize) {
    let cut: HashSet<TileId> = selection.draw_tiles.iter().map(|item| tree.node(item.node).id).collect();
    assert_eq!(cut.len(), selection.draw_tiles.len(), "frame {frame}: a square is drawn twice");
    for item in &selection.draw_tiles {
        let [square, from] = [item.node, item.source].map(|at| tree.node(at));
        if let Some(lod) = item.mesh_lod {
            let here = square.lods[usize::from(lod)].tile.is_resident();
            assert!(here, "frame {frame}: {} has no such mesh", square.id);
        }
        assert!(from.tile.is_resident() && square.id.ancestor(from.id.level()) == Some(from.id), "frame {frame}");
    }
    let planes = view.planes();
    for node in tree.nodes() {
        let line = (0..=node.id.level()).filter_map(|l| node.id.ancestor(l));
        let drawn = line.filter(|id| cut.contains(id)).count();
        assert!(drawn <= 1, "frame {frame}: {} is drawn {drawn} times", node.id);
        let leaf = node.children.iter().all(Option::is_none);
        // In view with all its ancestors' boxes, which hold it; of what is not known yet, what exists of it.
        let mut quarters = (0..4)
            .filter(|q| node.child_mask == 0 || node.child_mask >> q & 1 == 1)
            .map(|q| node.centre + DVec3::new(f64::from(q & 1) - 0.5, f64::from(q >> 1) - 0.5, 0.0) * node.half);
        if leaf && quarters.any(|at| cull::is_box_in_view(&planes, at, node.half * DVec3::new(0.5, 0.5, 1.0))) {
            assert_eq!(drawn, 1, "frame {frame}: a hole at {}", node.id);
        }
    }
}

/// Fetches `count` wanted tiles at once; returns how many frames until nothing is wanted.
fn converge(tree: &mut SceneTree, view: &View, count: usize) -> (usize, Selection) {
    let mut scratch = SelectionScratch::default();
    let mut worst = f64::INFINITY;
    for frame in 0..10_000 {
        let selection = select(view, tree, &mut scratch);
        if frame > 0 {
            assert_whole(tree, view, &selection, frame);
            assert!(selection.stats.worst_error_px <= worst, "coarser than the frame before");
            worst = selection.stats.worst_error_px;
        }
        if selection.requests.is_empty() {
            return (frame, selection);
        }
        selection.requests.iter().take(if frame == 0 { 1 } else { count }).for_each(|w| load(tree, w.key));
    }
    panic!("never converges");
}

#[test]
fn every_frame_is_whole_and_finer_than_the_last() {
    for count in [1, 3, 12] {
        let mut tree = tree();
        let view = view([1000.0, -300.0, 200.0], [1000.0, 1000.0, 0.0]);
        let (frames, selection) = converge(&mut tree, &view, count);
        assert!(frames > 10, "{frames}");
        assert!(selection.stats.worst_error_px <= 1.0 || ids(&tree, &selection).iter().any(|i| i.level() == DEPTH));
        assert!(ids(&tree, &selection).iter().any(|id| id.level() < DEPTH), "far nodes stay coarse");
    }
}

#[test]
fn what_is_behind_is_neither_drawn_nor_asked_for() {
    let mut tree = tree();
    let view = view([1024.0, 1024.0, 50.0], [1024.0, 3000.0, 50.0]);
    let (_, selection) = converge(&mut tree, &view, 12);
    assert!(selection.stats.culled > 0);
    for at in &selection.draw_tiles {
        let node = tree.node(at.node);
        assert!(node.centre.y + node.half.y >= 4_000_000.0 + 1024.0 - 1e-6, "{}", node.id);
    }
    let away = super::tests::view([1024.0, -500.0, 50.0], [1024.0, -3000.0, 50.0]);
    let selection = select(&away, &tree, &mut SelectionScratch::default());
    assert!(selection.draw_tiles.is_empty() && selection.requests.is_empty());
}

#[test]
fn turning_and_moving_never_makes_a_hole() {
    let mut tree = tree();
    let mut scratch = SelectionScratch::default();
    load(&mut tree, TileKey::block_map(TileId::ROOT));
    for frame in 0..400 {
        let a = frame as f64 * 0.09;
        let eye = [1024.0 + 700.0 * (a * 0.37).cos(), 1024.0 + 700.0 * (a * 0.23).sin(), 60.0 + 50.0 * a.sin()];
        let target = [eye[0] + a.cos(), eye[1] + a.sin(), eye[2] - 0.3];
        let view = view(eye, target);
        let selection = select(&view, &tree, &mut scratch);
        assert_whole(&tree, &view, &selection, frame);
        selection.requests.iter().take(4).for_each(|w| load(&mut tree, w.key));
        // What this view does not need may vanish at any time (but for the root, which every view uses).
        let used: Vec<TileId> = selection.used_nodes.iter().map(|at| tree.node(*at).id).collect();
        let all: Vec<TileId> = tree.nodes().filter(|n| n.tile.is_resident()).map(|n| n.id).collect();
        for id in all.into_iter().filter(|id| *id != TileId::ROOT && !used.contains(id)) {
            tree.apply(TileKey::block_map(id), TileEvent::Drop);
        }
    }
}

#[test]
fn a_square_waits_for_its_own_tile_alone() {
    let mut tree = tree();
    let view = view([1024.0, 1024.0, 2200.0], [1024.0, 1024.1, 0.0]);
    let mut scratch = SelectionScratch::default();
    load(&mut tree, TileKey::block_map(TileId::ROOT));
    let children: Vec<TileId> = TileId::ROOT.children().collect();
    for here in 0..=4 {
        let selection = select(&view, &tree, &mut scratch);
        for item in &selection.draw_tiles {
            let [square, from] = [item.node, item.source].map(|at| tree.node(at).id);
            let own = children[..here].iter().copied().find(|child| square.ancestor(1) == Some(*child));
            assert_eq!(from, own.unwrap_or(TileId::ROOT), "{square}");
        }
        children.get(here).into_iter().for_each(|child| load(&mut tree, TileKey::block_map(*child)));
    }
}

#[test]
fn a_bad_tile_keeps_its_parent_and_the_rest_converges() {
    let mut tree = tree();
    let bad = TileId::new(2, 1, 1).unwrap();
    refuse(&mut tree, TileKey::block_map(bad));
    let view = view([600.0, 100.0, 300.0], [700.0, 700.0, 0.0]);
    let (_, selection) = converge(&mut tree, &view, 5);
    assert!(selection.stats.blocked > 0);
    let cut = ids(&tree, &selection);
    assert!(cut.contains(&bad.parent().unwrap()), "{cut:?}");
}

#[test]
fn missing_subtrees_are_asked_for_and_their_node_stays() {
    let mut tree = SceneTree::new(manifest(7));
    let mut scratch = SelectionScratch::default();
    let view = view([10.0, 10.0, 40.0], [80.0, 90.0, 0.0]);
    let first = select(&view, &tree, &mut scratch);
    // The whole line below the eye at once: a jump takes two round trips however deep the city is.
    // The root's own tile comes with them.
    let line = [TileId::new(5, 0, 0).unwrap(), TileId::ROOT].map(TileKey::subtree);
    let mut keys: Vec<TileKey> = first.requests.iter().map(|w| w.key).collect();
    keys.sort_by(|a, b| b.cmp(a));
    assert_eq!(keys, [line[0], line[1], TileKey::block_map(TileId::ROOT)]);
    load(&mut tree, TileKey::block_map(TileId::ROOT));
    let all = subtrees(7, |_| false);
    tree.merge(&all[0]);
    for _ in 0..100 {
        let selection = select(&view, &tree, &mut scratch);
        let maps: Vec<TileKey> =
            selection.requests.iter().map(|w| w.key).filter(|k| *k == TileKey::block_map(k.id)).collect();
        if maps.is_empty() {
            break;
        }
        maps.into_iter().for_each(|key| load(&mut tree, key));
    }
    let selection = select(&view, &tree, &mut scratch);
    assert!(!selection.requests.is_empty() && selection.requests.iter().all(|w| w.key == TileKey::subtree(w.key.id)));
    assert!(ids(&tree, &selection).iter().any(|id| id.level() == 5));
    assert_whole(&tree, &view, &selection, 0);
    // One of them is missing on the server: its node stays, without end.
    let lost = selection.requests[0].key;
    refuse(&mut tree, lost);
    all[1..].iter().filter(|s| s.nodes[0].id != lost.id).for_each(|s| tree.merge(s));
    let (_, selection) = converge(&mut tree, &view, 12);
    assert!(ids(&tree, &selection).contains(&lost.id));
}

#[test]
fn nodes_that_do_not_exist_are_no_holes() {
    let mut tree = SceneTree::new(manifest(DEPTH));
    subtrees(DEPTH, |id| id.level() > 1 && (id.x() + id.y()) % 3 == 0).iter().for_each(|s| tree.merge(s));
    let view = view([500.0, -200.0, 150.0], [900.0, 900.0, 0.0]);
    converge(&mut tree, &view, 4);
}

#[test]
fn a_small_budget_raises_tau_and_a_larger_one_lets_it_fall() {
    let mut last = f64::INFINITY;
    for budget_pages in [30, 60, 120, 240, 480, 5000] {
        let mut tree = tree();
        let mut view = view([1000.0, -100.0, 80.0], [1000.0, 1000.0, 0.0]);
        view.budget_pages = budget_pages;
        let (_, selection) = converge(&mut tree, &view, 6);
        let counters = selection.stats;
        assert!(counters.pages <= budget_pages, "{counters:?}");
        assert!(counters.tau_px <= last && counters.tau_px >= 1.0, "{counters:?}");
        last = counters.tau_px;
        // Standing still asks for nothing more: no thrashing.
        assert!(select(&view, &tree, &mut SelectionScratch::default()).requests.is_empty());
    }
    assert_eq!(last, 1.0);
}

#[test]
fn the_root_is_asked_for_alone() {
    let view = view([100.0, 100.0, 80.0], [700.0, 900.0, 0.0]);
    let selection = select(&view, &tree(), &mut SelectionScratch::default());
    assert_eq!(selection.requests.iter().map(|w| w.key).collect::<Vec<_>>(), [TileKey::block_map(TileId::ROOT)]);
}

#[test]
fn the_same_view_gives_the_same_selection() {
    let mut tree = tree();
    load(&mut tree, TileKey::block_map(TileId::ROOT));
    let view = view([100.0, 100.0, 80.0], [700.0, 900.0, 0.0]);
    let mut scratch = SelectionScratch::default();
    let first = select(&view, &tree, &mut scratch);
    select(&super::tests::view([900.0, 100.0, 80.0], [700.0, 900.0, 0.0]), &tree, &mut scratch);
    assert_eq!(select(&view, &tree, &mut scratch), first);
    assert!(first.requests.len() > 20);
}

/// Whatever stands between a place in the picture and the sun is among the casters, and not the whole city is.
#[test]
fn what_casts_into_the_picture_is_there() {
    let mut tree = tree();
    let view = view([300.0, 300.0, 25.0], [700.0, 900.0, 0.0]);
    let sun = DVec3::new(0.7, -0.5, 0.25).normalize_or(DVec3::Z);
    let mut found = shadow_casters::shadow_casters(&view, sun, &tree, None);
    while !found.requests.is_empty() {
        found.requests.iter().for_each(|wanted| load(&mut tree, wanted.key));
        found = shadow_casters::shadow_casters(&view, sun, &tree, None);
    }
    let cast: Vec<TileId> = found.nodes.iter().map(|at| tree.node(*at).id).collect();
    let (planes, origin) = (view.planes(), DVec3::new(500_000.0, 4_000_000.0, 10.0));
    let mut asked = 0;
    for i in 0..40_000u32 {
        let ground = origin + DVec3::new(f64::from(i % 200) * 10.0 + 5.0, f64::from(i / 200) * 10.0 + 5.0, 0.1);
        if !planes.iter().all(|plane| plane.normal.dot(ground) + plane.offset >= 0.0) {
            continue;
        }
        for up in 1..30 {
            let p = ground + sun * (f64::from(up) / sun.z) - origin;
            if p.x.min(p.y) < 0.0 || p.x.max(p.y) >= SIDE_M {
                break;
            }
            let leaf = TileId::new(DEPTH, (p.x / 64.0) as u32, (p.y / 64.0) as u32).unwrap();
            assert!((2..=DEPTH).any(|level| cast.contains(&leaf.ancestor(level).unwrap())), "{ground} {leaf}");
            asked += 1;
        }
    }
    assert!(asked > 10_000, "{asked}");
    assert!(cast.len() < 400 && cast.iter().any(|id| id.level() == DEPTH), "{} of {}", cast.len(), tree.len());
    // Only what shades the squares that are seen.
    let seen = vec![tree.find(TileId::new(DEPTH, 9, 11).unwrap()).unwrap()];
    let one = Selection { unoccluded: seen, ..Selection::default() };
    let shading: Vec<TileId> = shadow_casters::shadow_casters(&view, sun, &tree, Some(&one))
        .nodes
        .iter()
        .map(|at| tree.node(*at).id)
        .collect();
    assert!(!shading.is_empty() && shading.len() * 4 < cast.len(), "{} of {}", shading.len(), cast.len());
    let middle = DVec3::new(9.5 * 64.0, 11.5 * 64.0, 0.1);
    for up in 1..30 {
        let p = middle + sun * (f64::from(up) / sun.z);
        let leaf = TileId::new(DEPTH, (p.x / 64.0) as u32, (p.y / 64.0) as u32).unwrap();
        assert!((2..=DEPTH).any(|level| shading.contains(&leaf.ancestor(level).unwrap())), "{leaf}");
    }
    let tight = View { budget_pages: 200, ..view };
    let fewer = shadow_casters::shadow_casters(&tight, sun, &tree, None).nodes.len();
    assert!(fewer > 0 && fewer < cast.len(), "{fewer} within a budget");
    assert_eq!(
        shadow_casters::shadow_casters(&view, DVec3::new(0.6, 0.0, -0.8), &tree, None),
        shadow_casters::ShadowCasters::default(),
        "by night"
    );
}

/// Tells `sight` that of a cut only those squares were hit.
fn look(
    sight: &mut OcclusionFeedback,
    tree: &SceneTree,
    view: &View,
    selection: &Selection,
    generation: u64,
    hit: impl Fn(TileId) -> bool,
) {
    let squares: Vec<NodeIndex> = selection.draw_tiles.iter().map(|item| item.node).collect();
    let pixels: Vec<u32> = squares.iter().map(|at| u32::from(hit(tree.node(*at).id))).collect();
    sight.update(
        &OcclusionQuery { nodes: squares, view: *view, generation },
        &pixels,
        selection.requests.is_empty(),
        tree,
    );
}

/// Looks and fetches in turn until nothing is wanted.
fn converge_looking(
    tree: &mut SceneTree,
    sight: &mut OcclusionFeedback,
    view: &View,
    hit: impl Fn(TileId) -> bool,
) -> Selection {
    let mut scratch = SelectionScratch::default();
    for frame in 0..1000 {
        let selection = super::select(view, tree, sight, &mut scratch);
        if frame > 0 {
            assert_whole(tree, view, &selection, frame);
        }
        selection.requests.iter().take(3).for_each(|w| load(tree, w.key));
        look(sight, tree, view, &selection, frame as u64, &hit);
        if selection.requests.is_empty()
            && super::select(view, tree, sight, &mut scratch).draw_tiles == selection.draw_tiles
        {
            return selection;
        }
    }
    panic!("never at rest");
}

/// Any tree, any order of arrivals (subtrees before and after what they hang on), failures that pass and that stay,
/// evictions, cameras, budgets and hits: what the root covers is covered.
#[test]
fn there_is_never_a_hole() {
    let mut scratch = SelectionScratch::default();
    let mut deepened = 0;
    for seed in 0..80u64 {
        let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
        let mut random = move |n: u64| {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            (state >> 11) % n
        };
        // Every fourth city is deep, of several subtrees that are asked for one by one.
        let deep = seed % 4 == 0;
        let gaps = if deep { 2 } else { random(5) + 2 };
        let depth = if deep { 7 } else { DEPTH };
        let mut all = subtrees(depth, |id| id.level() > 1 && u64::from(id.x() * 7 + id.y() * 13).is_multiple_of(gaps));
        if seed % 2 == 1 {
            all = all.into_iter().map(with_meshes).collect();
        }
        let mut tree = SceneTree::new(manifest(depth));
        load(&mut tree, TileKey::subtree(TileId::ROOT));
        tree.merge(&all.remove(0));
        load(&mut tree, TileKey::block_map(TileId::ROOT));
        let (mut sight, mut fades, mut now) = (OcclusionFeedback::default(), fade::on(), Duration::from_secs(100));
        for frame in 0..if deep { 25 } else { 60 } {
            let mut place = |most: u64| random(most) as f64;
            let eye = [place(2400) - 200.0, place(2400) - 200.0, place(300) + 1.0];
            let mut view = view(eye, [place(2048), place(2048), place(40)]);
            view.budget_pages = 60 + random(2000) as u32;
            view.tau_px = [0.5, 1.0, 4.0][random(3) as usize];
            for step in 0..4 {
                now += Duration::from_millis(random(300));
                let selection = super::select(&view, &tree, &sight, &mut scratch);
                assert_whole(&tree, &view, &selection, frame);
                fade::step(&mut fades, &tree, &selection, random(300) as f64 / 1e3);
                for wanted in &selection.requests {
                    let key = wanted.key;
                    if !tree.apply(key, TileEvent::Want { now }) || !tree.apply(key, TileEvent::Start) {
                        continue;
                    }
                    let jitter = random(100) as f64 / 100.0;
                    match random(40) {
                        0 if random(10) == 0 => tree.apply(key, TileEvent::Refuse),
                        1..4 => tree.apply(key, TileEvent::Fail { now, retry_after: None, jitter }),
                        4..6 => tree.apply(key, TileEvent::Damage { now, jitter }),
                        6..20 => tree.apply(key, TileEvent::Drop),
                        _ => tree.apply(key, TileEvent::Arrive),
                    };
                    if tree.tile(key).unwrap().state() != TileState::Decoded {
                        continue;
                    }
                    let subtree = all.iter().position(|s| key == TileKey::subtree(s.nodes[0].id));
                    let hangs = tree.find(key.id).is_some();
                    match subtree {
                        Some(at) if hangs => tree.merge(&all.swap_remove(at)),
                        _ if key == TileKey::subtree(key.id) => {
                            tree.apply(key, TileEvent::Drop);
                            continue;
                        }
                        _ => {}
                    }
                    tree.apply(key, TileEvent::Upload);
                }
                let salt = random(1000) as u32;
                if random(3) > 0 {
                    let hit = |id: TileId| (id.x() * 31 + id.y() * 17 + salt).is_multiple_of(3);
                    look(&mut sight, &tree, &view, &selection, frame as u64 * 4 + step, hit);
                }
                let used: HashSet<TileId> = selection.used_nodes.iter().map(|at| tree.node(*at).id).collect();
                let all: Vec<TileId> = tree.nodes().filter(|n| n.tile.is_resident()).map(|n| n.id).collect();
                for id in all.into_iter().filter(|id| *id != TileId::ROOT && !used.contains(id)) {
                    if random(3) == 0 {
                        tree.apply(TileKey::block_map(id), TileEvent::Drop);
                    }
                }
                let leaves: Vec<TileId> = tree.nodes().filter(|n| !n.lods.is_empty()).map(|n| n.id).collect();
                let meshes = leaves.into_iter().flat_map(|id| (0..3).map(move |lod| TileKey::mesh(id, lod)));
                for key in meshes.filter(|key| !selection.used_meshes.contains(key)) {
                    if random(5) == 0 && tree.tile(key).is_some_and(|tile| tile.is_resident()) {
                        tree.apply(key, TileEvent::Drop);
                    }
                }
            }
        }
        deepened += usize::from(tree.nodes().any(|node| node.id.level() > DEPTH));
    }
    assert!(deepened >= 5, "only in {deepened} cities a subtree came");
}
