//! Selections frame by frame, in hand-made trees.

mod meshes;
mod occlusion;
mod random;
mod refinement;
mod shadows;
mod switching;
mod transitions;

use super::*;
use crate::camera::Camera;
use crate::scene::{NodeIndex, TileEvent, TileKey, TreeNode};
use glam::DVec3;
use insula_protocol::subtree::{MeshLod, NodeInfo, NodeMesh};
use insula_protocol::{Manifest, Subtree, TileId};
use insula_test_support::small_city::empty_manifest;
use occlusion_feedback::OcclusionQuery;
use priority::{PriorityGroup, RequestReason, TileRequest};
use screen_error::ErrorMetric;
use std::collections::HashSet;
use std::time::Duration;

const DEPTH: u8 = 5;
const SIDE_M: f64 = 64.0 * 32.0;
const ORIGIN: DVec3 = DVec3::new(500_000.0, 4_000_000.0, 10.0);
const NOW: Duration = Duration::from_secs(100);

fn manifest(depth: u8) -> Manifest {
    Manifest { origin: ORIGIN.to_array(), bounds: [[0.0; 3]; 2], ..empty_manifest(depth) }
}

/// The subtrees of a full tree of `depth`, without the nodes that `skip` names and what lies below them.
fn subtrees(depth: u8, skip: impl Fn(TileId) -> bool) -> Vec<Subtree> {
    let mut roots = vec![TileId::ROOT];
    let mut all = Vec::new();
    while let Some(root) = roots.pop() {
        let (mut ids, mut nodes, mut next) = (vec![root], Vec::new(), 0);
        while let Some(&id) = ids.get(next) {
            next += 1;
            let children: Vec<TileId> = id.children().filter(|c| c.level() <= depth && !skip(*c)).collect();
            let child_mask = children.iter().fold(0, |mask, c| mask | 1 << c.quadrant());
            let side_m = SIDE_M as f32 / f32::from(1u16 << id.level());
            nodes.push(NodeInfo {
                id,
                child_mask,
                z_min_m: 0.0,
                z_max_m: 30.0,
                error_m: side_m / 64.0,
                radius_m: (side_m * side_m * 0.5 + 15.0 * 15.0).sqrt(),
                blockmap_bytes: 1,
            });
            if id.level() < root.level() + 5 {
                ids.extend(children);
            } else if child_mask != 0 {
                roots.push(id);
            }
        }
        all.push(Subtree { nodes, ..Subtree::default() });
    }
    all
}

/// Gives each leaf a mesh of three levels of detail.
fn with_meshes(mut subtree: Subtree) -> Subtree {
    let lod = |error_m: f32| MeshLod { error_m, bytes: 1, triangles: 900, texture_px: 0 };
    let leaves = subtree.nodes.iter().filter(|node| node.child_mask == 0);
    let lods = || [0.02, 0.1, 0.4].map(lod).to_vec();
    subtree.meshes = leaves.map(|leaf| NodeMesh { id: leaf.id, lods: lods() }).collect();
    subtree
}

/// A full tree without resident tiles.
pub(crate) fn tree() -> SceneTree {
    let mut tree = SceneTree::new(manifest(DEPTH));
    subtrees(DEPTH, |_| false).iter().for_each(|s| tree.merge(s));
    tree
}

/// A tree of the leaf in the south-west and the nodes above it, without resident tiles.
pub(crate) fn tree_of_one_leaf() -> SceneTree {
    let mut tree = SceneTree::new(manifest(DEPTH));
    subtrees(DEPTH, |id| id.x() > 0 || id.y() > 0).iter().for_each(|s| tree.merge(s));
    tree
}

/// A view of 640 x 360 pixels with a large budget. Coordinates are relative to the city's origin.
pub(crate) fn view(position: [f64; 3], target: [f64; 3]) -> View {
    let (position, target) = (DVec3::from(position) + ORIGIN, DVec3::from(target) + ORIGIN);
    let camera = Camera::look_at(position, target, DVec3::Z, 1.0).unwrap();
    View { budget_pages: 1_000_000, budget_nodes: 100_000, ..View::of(camera, [640, 360]) }
}

/// A view to the north from the middle of the city, 20 m above the ground.
fn street_view() -> View {
    view([1030.0, 1015.0, 20.0], [1030.0, 3000.0, 20.0])
}

/// A request for a visible tile that is twice too coarse.
pub(crate) fn request(key: TileKey) -> TileRequest {
    TileRequest { key, group: PriorityGroup::Normal, reason: RequestReason::Visible, weight_px: 2.0 }
}

fn apply_all(tree: &mut SceneTree, key: TileKey, events: &[TileEvent]) {
    for event in events {
        assert!(tree.apply(key, *event), "{key:?} {event:?}");
    }
}

pub(crate) fn load(tree: &mut SceneTree, key: TileKey) {
    let want = TileEvent::Want { now: NOW };
    apply_all(tree, key, &[want, TileEvent::Start, TileEvent::Arrive, TileEvent::Upload]);
}

fn load_root(tree: &mut SceneTree) {
    load(tree, TileKey::block_map(TileId::ROOT));
}

fn refuse(tree: &mut SceneTree, key: TileKey) {
    apply_all(tree, key, &[TileEvent::Want { now: NOW }, TileEvent::Start, TileEvent::Refuse]);
}

fn select_with(view: &View, tree: &SceneTree, feedback: &OcclusionFeedback) -> Selection {
    select(view, tree, feedback, &mut SelectionScratch::default())
}

/// Selects without occlusion feedback: everything in the frustum is visible.
fn select_in_view(view: &View, tree: &SceneTree) -> Selection {
    select_with(view, tree, &OcclusionFeedback::default())
}

fn ids_of<'a>(tree: &SceneTree, nodes: impl IntoIterator<Item = &'a NodeIndex>) -> Vec<TileId> {
    nodes.into_iter().map(|node| tree.node(*node).id).collect()
}

/// The nodes whose tiles are drawn, sorted, each once.
fn drawn_sources(tree: &SceneTree, selection: &Selection) -> Vec<TileId> {
    let mut ids = ids_of(tree, selection.draw_tiles.iter().map(|tile| &tile.source));
    ids.sort();
    ids.dedup();
    ids
}

fn resident_nodes(tree: &SceneTree) -> Vec<TileId> {
    tree.nodes().filter(|node| node.tile.is_resident()).map(|node| node.id).collect()
}

fn error_px(view: &View, node: &TreeNode, error_m: f64) -> f64 {
    ErrorMetric::new(view).error_px(error_m, node.centre, node.radius_m)
}

/// The corners `[min, max]` of a node's area, relative to the city's origin, in metres.
fn area(id: TileId) -> [[f64; 2]; 2] {
    let side_m = SIDE_M / f64::from(1u32 << id.level());
    let min = [id.x(), id.y()].map(|i| f64::from(i) * side_m);
    [min, min.map(|v| v + side_m)]
}

/// Asserts that the draw list contains exactly one of each leaf in view and its ancestors, and that each of its entries is drawn
/// from a resident tile of its node or of an ancestor.
fn assert_no_holes(tree: &SceneTree, view: &View, selection: &Selection, frame: usize) {
    let draw_list: HashSet<TileId> = selection.draw_tiles.iter().map(|tile| tree.node(tile.node).id).collect();
    assert_eq!(draw_list.len(), selection.draw_tiles.len(), "frame {frame}: a node is drawn twice");
    for tile in &selection.draw_tiles {
        let [node, source] = [tile.node, tile.source].map(|index| tree.node(index));
        if let Some(lod) = tile.mesh_lod {
            assert!(node.lods[usize::from(lod)].tile.is_resident(), "frame {frame}: {} has no such mesh", node.id);
        }
        assert!(source.tile.is_resident() && node.id.ancestor(source.id.level()) == Some(source.id), "frame {frame}");
    }
    let planes = view.planes();
    for node in tree.nodes() {
        let line = (0..=node.id.level()).filter_map(|level| node.id.ancestor(level));
        let drawn = line.filter(|id| draw_list.contains(id)).count();
        assert!(drawn <= 1, "frame {frame}: {} is drawn {drawn} times", node.id);
        let has_no_known_child = node.children.iter().all(Option::is_none);
        // Of a node whose children are unknown, only the quadrants that exist count.
        let mut quadrants = (0..4)
            .filter(|q| node.child_mask == 0 || node.child_mask >> q & 1 == 1)
            .map(|q| node.centre + DVec3::new(f64::from(q & 1) - 0.5, f64::from(q >> 1) - 0.5, 0.0) * node.half);
        let half = node.half * DVec3::new(0.5, 0.5, 1.0);
        if has_no_known_child && quadrants.any(|centre| cull::is_box_in_view(&planes, centre, half)) {
            assert_eq!(drawn, 1, "frame {frame}: a hole at {}", node.id);
        }
    }
}

/// Loads `count` requested tiles a frame until nothing is requested. Returns the number of frames and the last selection.
fn converge(tree: &mut SceneTree, view: &View, count: usize) -> (usize, Selection) {
    let mut worst_px = f64::INFINITY;
    for frame in 0..10_000 {
        let selection = select_in_view(view, tree);
        if frame > 0 {
            assert_no_holes(tree, view, &selection, frame);
            assert!(selection.stats.worst_error_px <= worst_px, "coarser than the frame before");
            worst_px = selection.stats.worst_error_px;
        }
        if selection.requests.is_empty() {
            return (frame, selection);
        }
        selection.requests.iter().take(if frame == 0 { 1 } else { count }).for_each(|w| load(tree, w.key));
    }
    panic!("never converges");
}

/// Reports a frame whose rays hit only the nodes of the draw list that `is_hit` names.
fn report(
    feedback: &mut OcclusionFeedback,
    tree: &SceneTree,
    view: &View,
    selection: &Selection,
    is_hit: impl Fn(TileId) -> bool,
) {
    let nodes: Vec<NodeIndex> = selection.draw_tiles.iter().map(|tile| tile.node).collect();
    let pixels: Vec<u32> = nodes.iter().map(|node| u32::from(is_hit(tree.node(*node).id))).collect();
    let query = OcclusionQuery { nodes, view: *view, generation: 0 };
    feedback.update(&query, &pixels, selection.requests.is_empty(), tree);
}

/// Loads the root, and reports a frame in which only that is resident.
fn report_first_frame(
    feedback: &mut OcclusionFeedback,
    tree: &mut SceneTree,
    view: &View,
    is_hit: impl Fn(TileId) -> bool,
) {
    load_root(tree);
    report(feedback, tree, view, &select_in_view(view, tree), is_hit);
}

/// Like [`converge`], with occlusion feedback after each frame.
fn converge_with(
    feedback: &mut OcclusionFeedback,
    tree: &mut SceneTree,
    view: &View,
    is_hit: impl Fn(TileId) -> bool,
) -> Selection {
    for frame in 0..1000 {
        let selection = select_with(view, tree, feedback);
        if frame > 0 {
            assert_no_holes(tree, view, &selection, frame);
        }
        selection.requests.iter().take(3).for_each(|w| load(tree, w.key));
        report(feedback, tree, view, &selection, &is_hit);
        let has_settled =
            selection.requests.is_empty() && select_with(view, tree, feedback).draw_tiles == selection.draw_tiles;
        if has_settled {
            return selection;
        }
    }
    panic!("never settles");
}
