//! Leaves that are drawn as meshes.

use super::*;

fn tree_with_meshes() -> SceneTree {
    let mut tree = SceneTree::new(manifest(DEPTH));
    subtrees(DEPTH, |_| false).into_iter().for_each(|s| tree.merge(&with_meshes(s)));
    tree
}

#[test]
fn near_leaves_are_drawn_as_the_coarsest_mesh_within_tau() {
    let mut tree = tree_with_meshes();
    let view = street_view();
    let (_, selection) = converge(&mut tree, &view, 3);
    let is_accurate = |node: &TreeNode, error_m: f64| error_px(&view, node, error_m) <= 1.0;
    let mut drawn = [0; 4];
    for tile in selection.draw_tiles.iter().filter(|tile| tree.node(tile.node).id.level() == DEPTH) {
        let node = tree.node(tile.node);
        let best_lod = node.lods.iter().rposition(|lod| is_accurate(node, lod.error_m)).unwrap_or(0) as u8;
        assert_eq!(tile.mesh_lod, (!is_accurate(node, node.error_m)).then_some(best_lod), "{}", node.id);
        drawn[tile.mesh_lod.map_or(3, usize::from)] += 1;
    }
    assert!(drawn.iter().all(|n| *n > 0), "{drawn:?}");
    assert_eq!(selection.stats.meshes, drawn[..3].iter().sum::<u32>());
    assert_eq!(selection.used_meshes.len() as u32, selection.stats.meshes);

    let back = super::view([1030.0, 950.0, 25.0], [1030.0, 3000.0, 20.0]);
    let has_resident_mesh =
        |id: TileId| tree.find(id).is_some_and(|i| tree.node(i).lods.iter().any(|lod| lod.tile.is_resident()));
    let requests = select_in_view(&back, &tree).requests;
    assert!(requests.iter().all(|w| !has_resident_mesh(w.key.id)), "a finer resident mesh is drawn instead");

    let stats = select_in_view(&View { budget_pages: 500, ..view }, &tree).stats;
    assert!(stats.pages <= 500 && stats.tau_px > 1.0, "{stats:?}");
}

#[test]
fn the_finest_meshes_are_good_enough_for_any_tau() {
    let mut tree = tree_with_meshes();
    let view = View { tau_px: 0.001, ..street_view() };
    let (_, selection) = converge(&mut tree, &view, 3);
    let stats = &selection.stats;
    assert!(stats.meshes > 9 && stats.worst_error_px > view.tau_px, "{stats:?}");
    assert_eq!(stats.visible_error_px, 0.0, "{stats:?}");
    let coarse = select_in_view(&view, &tree_with_meshes()).stats;
    assert_eq!(coarse.visible_error_px, coarse.worst_error_px, "nothing is resident");
}

#[test]
fn meshes_can_be_disabled() {
    let mut tree = SceneTree::new(manifest(DEPTH)).with_meshes(false);
    subtrees(DEPTH, |_| false).into_iter().for_each(|s| tree.merge(&with_meshes(s)));
    assert!(tree.nodes().all(|node| node.lods.is_empty()));
}

/// A tree, feedback and selection after all visible leaves but `lost` got their meshes.
struct ConvergedMeshes {
    tree: SceneTree,
    feedback: OcclusionFeedback,
    selection: Selection,
    /// Its mesh is bad.
    lost: NodeIndex,
}

fn is_hit(id: TileId) -> bool {
    id.x().abs_diff(16 >> (DEPTH - id.level())) < 3
}

fn converge_meshes() -> ConvergedMeshes {
    let (mut tree, mut feedback) = (tree_with_meshes(), OcclusionFeedback::default());
    let id = TileId::new(DEPTH, 16, 16).unwrap();
    (0..3).for_each(|lod| refuse(&mut tree, TileKey::mesh(id, lod)));
    report_first_frame(&mut feedback, &mut tree, &street_view(), is_hit);
    let selection = converge_with(&mut feedback, &mut tree, &street_view(), is_hit);
    ConvergedMeshes { lost: tree.find(id).unwrap(), tree, feedback, selection }
}

#[test]
fn visible_leaves_are_refined_to_meshes_without_fetching_their_columns() {
    let ConvergedMeshes { tree, selection, lost, .. } = converge_meshes();
    for tile in &selection.draw_tiles {
        let node = tree.node(tile.node);
        let is_near_leaf = node.id.level() == DEPTH && error_px(&street_view(), node, node.error_m) > 1.0;
        let has_mesh = is_hit(node.id) && is_near_leaf && tile.node != lost;
        assert_eq!(tile.mesh_lod.is_some(), has_mesh, "{}", node.id);
        assert!(!has_mesh || tile.source != tile.node && !node.tile.is_resident(), "{} has columns, too", node.id);
        assert_eq!(selection.mesh_leaves.contains(&tile.node), has_mesh);
    }
    let meshes = selection.mesh_leaves.len();
    assert!(meshes > 5 && selection.stats.meshes as usize == meshes && selection.used_meshes.len() == meshes);
    assert!(tree.node(lost).tile.is_resident(), "without a mesh, the columns are fetched");
    // Their parents are of a skipped level. Some were requested before the first feedback.
    let parents = selection.mesh_leaves.iter().filter_map(|index| tree.node(*index).parent);
    let skipped = parents.filter(|index| !tree.node(*index).tile.is_resident()).count();
    assert!(skipped * 4 > meshes, "{skipped} of {meshes}");
}

#[test]
fn sky_of_a_mesh_comes_from_the_same_node_whatever_is_resident() {
    let ConvergedMeshes { tree, feedback, selection, .. } = converge_meshes();
    let sky_sources = |tree: &SceneTree, selection: &Selection| -> HashSet<[TileId; 2]> {
        let meshes = selection.draw_tiles.iter().filter(|tile| tile.mesh_lod.is_some());
        meshes.map(|tile| [tile.node, tile.source].map(|index| tree.node(index).id)).collect()
    };
    let before = sky_sources(&tree, &selection);
    assert!(before.iter().all(|[leaf, source]| leaf.ancestor(DEPTH - 2) == Some(*source)), "{before:?}");
    let mut full = tree.clone();
    for node in tree.nodes().filter(|node| !node.tile.is_resident()) {
        load(&mut full, TileKey::block_map(node.id));
    }
    let after = select_with(&street_view(), &full, &feedback);
    assert!(before.is_subset(&sky_sources(&full, &after)));
}

#[test]
fn meshes_are_drawn_until_the_columns_are_resident_when_the_camera_moves_away() {
    let ConvergedMeshes { mut tree, mut feedback, .. } = converge_meshes();
    let away = View { tau_px: 40.0, ..street_view() };
    let first = select_with(&away, &tree, &feedback);
    assert_no_holes(&tree, &away, &first, 0);
    let is_accurate_leaf = |node: &TreeNode| node.id.level() == DEPTH && error_px(&away, node, node.error_m) <= 40.0;
    let is_waiting = |tile: &&DrawTile| tile.mesh_lod.is_some() && is_accurate_leaf(tree.node(tile.node));
    let waiting: Vec<NodeIndex> = first.draw_tiles.iter().filter(is_waiting).map(|tile| tile.node).collect();
    let is_requested = |node: NodeIndex| {
        let key = TileKey::block_map(tree.node(node).id);
        first.requests.iter().any(|w| w.key == key)
    };
    for node in &waiting {
        assert!(is_requested(*node) || tree.node(*node).parent.is_some_and(is_requested), "{node:?}");
    }
    let waiting: Vec<NodeIndex> = waiting.into_iter().filter(|node| is_requested(*node)).collect();
    assert!(!waiting.is_empty());
    let settled = converge_with(&mut feedback, &mut tree, &away, is_hit);
    let mut tiles = settled.draw_tiles.iter().filter(|tile| waiting.contains(&tile.node));
    assert!(tiles.all(|tile| tile.mesh_lod.is_none() && tile.source == tile.node));
}
