//! Leaves that are drawn as meshes.

use super::*;

#[test]
fn near_leaves_are_drawn_as_meshes_as_fine_as_they_must_be() {
    let mut tree = SceneTree::new(manifest(DEPTH));
    subtrees(DEPTH, |_| false).into_iter().for_each(|s| tree.merge(&with_meshes(s)));
    let view = view([1030.0, 1015.0, 20.0], [1030.0, 3000.0, 20.0]);
    let (_, selection) = converge(&mut tree, &view, 3);
    let px = |node: &TreeNode, error_m: f64| ErrorMetric::new(&view).error_px(error_m, node.centre, node.radius_m);
    let mut drawn = [0; 4];
    for item in selection.draw_tiles.iter().filter(|item| tree.node(item.node).id.level() == DEPTH) {
        let node = tree.node(item.node);
        let wanted = match px(node, node.error_m) > 1.0 {
            true => Some(node.lods.iter().rposition(|lod| px(node, lod.error_m) <= 1.0).unwrap_or(0) as u8),
            false => None,
        };
        assert_eq!(item.mesh_lod, wanted, "{}", node.id);
        drawn[item.mesh_lod.map_or(3, usize::from)] += 1;
    }
    assert!(drawn.iter().all(|n| *n > 0), "{drawn:?}");
    assert_eq!(selection.stats.meshes, drawn[..3].iter().sum::<u32>());
    assert_eq!(selection.used_meshes.len() as u32, selection.stats.meshes);
    // A finer one that is here serves as well: nothing is fetched on the way back.
    let back = super::view([1030.0, 950.0, 25.0], [1030.0, 3000.0, 20.0]);
    let behind = select(&back, &tree, &mut SelectionScratch::default());
    assert!(behind.requests.iter().all(|w| {
        tree.find(w.key.id).is_none_or(|at| tree.node(at).lods.iter().all(|lod| !lod.tile.is_resident()))
    }));
    // Less memory: never over the budget, and tau says so.
    let tight = View { budget_pages: 500, ..view };
    let selection = select(&tight, &tree, &mut SelectionScratch::default());
    assert!(selection.stats.pages <= 500 && selection.stats.tau_px > 1.0, "{:?}", selection.stats);
    let mut plain = SceneTree::new(manifest(DEPTH)).with_meshes(false);
    subtrees(DEPTH, |_| false).into_iter().for_each(|s| plain.merge(&with_meshes(s)));
    assert!(plain.nodes().all(|node| node.lods.is_empty()));
}

/// A leaf that rays hit passes from what it lies in to its mesh; its columns come if the mesh is lost, or once they are enough.
#[test]
fn seen_leaves_go_without_columns() {
    let mut tree = SceneTree::new(manifest(DEPTH));
    subtrees(DEPTH, |_| false).into_iter().for_each(|s| tree.merge(&with_meshes(s)));
    let near = view([1030.0, 1015.0, 20.0], [1030.0, 3000.0, 20.0]);
    let lost = tree.find(TileId::new(DEPTH, 16, 16).unwrap()).unwrap();
    let lost_id = tree.node(lost).id;
    (0..3).for_each(|lod| refuse(&mut tree, TileKey::mesh(lost_id, lod)));
    let hit = |id: TileId| id.x().abs_diff(16 >> (DEPTH - id.level())) < 3;
    let mut sight = OcclusionFeedback::default();
    load(&mut tree, TileKey::block_map(TileId::ROOT));
    look(&mut sight, &tree, &near, &select(&near, &tree, &mut SelectionScratch::default()), 0, hit);
    let selection = converge_looking(&mut tree, &mut sight, &near, hit);
    let px = |node: &TreeNode, view: &View| ErrorMetric::new(view).error_px(node.error_m, node.centre, node.radius_m);
    let mut meshes = 0;
    for item in &selection.draw_tiles {
        let node = tree.node(item.node);
        let mesh = hit(node.id) && node.id.level() == DEPTH && px(node, &near) > 1.0 && item.node != lost;
        assert_eq!(item.mesh_lod.is_some(), mesh, "{}", node.id);
        assert!(!mesh || item.source != item.node && !node.tile.is_resident(), "{} has columns, too", node.id);
        assert_eq!(selection.mesh_leaves.contains(&item.node), mesh);
        meshes += u32::from(mesh);
    }
    assert!(meshes > 5 && selection.stats.meshes == meshes, "{meshes}");
    // The same columns tell of their sky, whatever else comes.
    let mut full = tree.clone();
    let missing: Vec<TileKey> =
        full.nodes().filter(|n| !n.tile.is_resident()).map(|n| TileKey::block_map(n.id)).collect();
    missing.into_iter().for_each(|key| load(&mut full, key));
    let of_meshes = |tree: &SceneTree, selection: &Selection| {
        let meshes = selection.draw_tiles.iter().filter(|item| item.mesh_lod.is_some());
        meshes.map(|item| [item.node, item.source].map(|at| tree.node(at).id)).collect::<HashSet<_>>()
    };
    let told = of_meshes(&tree, &selection);
    assert!(told.iter().all(|[leaf, by]| leaf.ancestor(DEPTH - 2) == Some(*by)), "{told:?}");
    let after = crate::select::select(&near, &full, &sight, &mut SelectionScratch::default());
    assert!(told.is_subset(&of_meshes(&full, &after)));
    // Their parents are passed over, but for those that were wanted before anybody saw what is in them.
    let meshed = selection.mesh_leaves.iter().filter_map(|at| tree.node(*at).parent);
    let passed_over = meshed.filter(|at| !tree.node(*at).tile.is_resident()).count() as u32;
    assert!(passed_over * 4 > meshes, "{passed_over} of {meshes}");
    assert!(tree.node(lost).tile.is_resident(), "no mesh: its columns");
    assert!(selection.used_meshes.len() == meshes as usize);
    // Back to where columns are enough: they are asked for, and until they are here the mesh is drawn.
    let back = View { tau_px: 40.0, ..near };
    let first = crate::select::select(&back, &tree, &sight, &mut SelectionScratch::default());
    assert_whole(&tree, &back, &first, 0);
    let waits = |item: &&DrawTile| tree.node(item.node).id.level() == DEPTH && item.mesh_lod.is_some();
    let waiting: Vec<&DrawTile> =
        first.draw_tiles.iter().filter(waits).filter(|i| px(tree.node(i.node), &back) <= 40.0).collect();
    let wanted = |at: NodeIndex| first.requests.iter().any(|w| w.key == TileKey::block_map(tree.node(at).id));
    // Or what they lie in, if that would do.
    let comes = |item: &&DrawTile| wanted(item.node) || tree.node(item.node).parent.is_some_and(wanted);
    assert!(waiting.iter().all(comes), "{}", waiting.len());
    let waiting: Vec<NodeIndex> = waiting.iter().map(|item| item.node).filter(|at| wanted(*at)).collect();
    assert!(!waiting.is_empty());
    let rest = converge_looking(&mut tree, &mut sight, &back, hit);
    let columns = |item: &&DrawTile| waiting.contains(&item.node);
    assert!(rest.draw_tiles.iter().filter(columns).all(|item| item.mesh_lod.is_none() && item.source == item.node));
}
