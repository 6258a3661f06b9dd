//! Refinement without occlusion feedback, budgets, bad tiles and missing subtrees.

use super::*;

#[test]
fn every_frame_is_complete_and_no_coarser_than_the_last() {
    for count in [1, 3, 12] {
        let mut tree = tree();
        let view = view([1000.0, -300.0, 200.0], [1000.0, 1000.0, 0.0]);
        let (frames, selection) = converge(&mut tree, &view, count);
        assert!(frames > 10, "{frames}");
        let drawn = drawn_sources(&tree, &selection);
        assert!(selection.stats.worst_error_px <= 1.0 || drawn.iter().any(|id| id.level() == DEPTH));
        assert!(drawn.iter().any(|id| id.level() < DEPTH), "far nodes stay coarse");
    }
}

#[test]
fn tiles_behind_the_camera_are_neither_drawn_nor_requested() {
    let mut tree = tree();
    let (_, selection) = converge(&mut tree, &view([1024.0, 1024.0, 50.0], [1024.0, 3000.0, 50.0]), 12);
    assert!(selection.stats.culled > 0);
    for id in ids_of(&tree, selection.draw_tiles.iter().map(|tile| &tile.node)) {
        assert!(area(id)[1][1] >= 1024.0, "{id}");
    }
    let away = select_in_view(&view([1024.0, -500.0, 50.0], [1024.0, -3000.0, 50.0]), &tree);
    assert!(away.draw_tiles.is_empty() && away.requests.is_empty());
}

#[test]
fn turning_and_moving_leaves_no_holes() {
    let mut tree = tree();
    let mut scratch = SelectionScratch::default();
    load_root(&mut tree);
    for frame in 0..400 {
        let a = frame as f64 * 0.09;
        let eye = [1024.0 + 700.0 * (a * 0.37).cos(), 1024.0 + 700.0 * (a * 0.23).sin(), 60.0 + 50.0 * a.sin()];
        let view = view(eye, [eye[0] + a.cos(), eye[1] + a.sin(), eye[2] - 0.3]);
        let selection = select(&view, &tree, &OcclusionFeedback::default(), &mut scratch);
        assert_no_holes(&tree, &view, &selection, frame);
        selection.requests.iter().take(4).for_each(|w| load(&mut tree, w.key));
        // Whatever this view does not use may be evicted. Every view uses the root.
        let used = ids_of(&tree, &selection.used_nodes);
        for id in resident_nodes(&tree).into_iter().filter(|id| *id != TileId::ROOT && !used.contains(id)) {
            tree.apply(TileKey::block_map(id), TileEvent::Drop);
        }
    }
}

#[test]
fn each_node_is_drawn_as_soon_as_its_own_tile_is_resident() {
    let mut tree = tree();
    let view = view([1024.0, 1024.0, 2200.0], [1024.0, 1024.1, 0.0]);
    load_root(&mut tree);
    let children: Vec<TileId> = TileId::ROOT.children().collect();
    for loaded in 0..=4 {
        for tile in &select_in_view(&view, &tree).draw_tiles {
            let [node, source] = [tile.node, tile.source].map(|index| tree.node(index).id);
            let resident = children[..loaded].iter().copied().find(|child| node.ancestor(1) == Some(*child));
            assert_eq!(source, resident.unwrap_or(TileId::ROOT), "{node}");
        }
        children.get(loaded).into_iter().for_each(|child| load(&mut tree, TileKey::block_map(*child)));
    }
}

#[test]
fn parent_of_a_bad_tile_is_drawn_and_the_rest_converges() {
    let mut tree = tree();
    let bad = TileId::new(2, 1, 1).unwrap();
    refuse(&mut tree, TileKey::block_map(bad));
    let (_, selection) = converge(&mut tree, &view([600.0, 100.0, 300.0], [700.0, 700.0, 0.0]), 5);
    assert!(selection.stats.blocked > 0);
    let drawn = drawn_sources(&tree, &selection);
    assert!(drawn.contains(&bad.parent().unwrap()), "{drawn:?}");
}

#[test]
fn missing_subtrees_are_requested_and_the_node_above_is_drawn() {
    let mut tree = SceneTree::new(manifest(7));
    let view = view([10.0, 10.0, 40.0], [80.0, 90.0, 0.0]);
    // All subtrees below the eye at once, and the root's tile with them.
    let mut keys: Vec<TileKey> = select_in_view(&view, &tree).requests.iter().map(|w| w.key).collect();
    keys.sort_by(|a, b| b.cmp(a));
    let below_eye = [TileId::new(5, 0, 0).unwrap(), TileId::ROOT].map(TileKey::subtree);
    assert_eq!(keys, [below_eye[0], below_eye[1], TileKey::block_map(TileId::ROOT)]);
    load_root(&mut tree);
    let all = subtrees(7, |_| false);
    tree.merge(&all[0]);
    let is_block_map = |w: &&TileRequest| w.key == TileKey::block_map(w.key.id);
    let selection = (0..100).find_map(|_| {
        let selection = select_in_view(&view, &tree);
        selection.requests.iter().filter(is_block_map).for_each(|w| load(&mut tree, w.key));
        (!selection.requests.iter().any(|w| is_block_map(&w))).then_some(selection)
    });
    let selection = selection.unwrap();
    assert!(!selection.requests.is_empty() && selection.requests.iter().all(|w| w.key == TileKey::subtree(w.key.id)));
    assert!(drawn_sources(&tree, &selection).iter().any(|id| id.level() == 5));
    assert_no_holes(&tree, &view, &selection, 0);
    // The server lacks one of them: the node above it is drawn for good.
    let lost = selection.requests[0].key;
    refuse(&mut tree, lost);
    all[1..].iter().filter(|s| s.nodes[0].id != lost.id).for_each(|s| tree.merge(s));
    let (_, selection) = converge(&mut tree, &view, 12);
    assert!(drawn_sources(&tree, &selection).contains(&lost.id));
}

#[test]
fn quadrants_without_a_node_are_no_holes() {
    let mut tree = SceneTree::new(manifest(DEPTH));
    subtrees(DEPTH, |id| id.level() > 1 && (id.x() + id.y()) % 3 == 0).iter().for_each(|s| tree.merge(s));
    converge(&mut tree, &view([500.0, -200.0, 150.0], [900.0, 900.0, 0.0]), 4);
}

#[test]
fn smaller_budgets_give_larger_error_thresholds() {
    let mut last_px = f64::INFINITY;
    for budget_pages in [30, 60, 120, 240, 480, 5000] {
        let mut tree = tree();
        let view = View { budget_pages, ..view([1000.0, -100.0, 80.0], [1000.0, 1000.0, 0.0]) };
        let stats = converge(&mut tree, &view, 6).1.stats;
        assert!(stats.pages <= budget_pages, "{stats:?}");
        assert!(stats.tau_px <= last_px && stats.tau_px >= 1.0, "{stats:?}");
        last_px = stats.tau_px;
        assert!(select_in_view(&view, &tree).requests.is_empty(), "a still camera requests nothing more");
    }
    assert_eq!(last_px, 1.0);
}

#[test]
fn missing_root_is_requested_alone() {
    let selection = select_in_view(&view([100.0, 100.0, 80.0], [700.0, 900.0, 0.0]), &tree());
    assert_eq!(selection.requests.iter().map(|w| w.key).collect::<Vec<_>>(), [TileKey::block_map(TileId::ROOT)]);
}

#[test]
fn equal_views_give_equal_selections_whatever_the_scratch_memory_holds() {
    let (mut tree, mut scratch, feedback) = (tree(), SelectionScratch::default(), OcclusionFeedback::default());
    load_root(&mut tree);
    let [a, b] = [100.0, 900.0].map(|x| view([x, 100.0, 80.0], [700.0, 900.0, 0.0]));
    let first = select(&a, &tree, &feedback, &mut scratch);
    select(&b, &tree, &feedback, &mut scratch);
    assert_eq!(select(&a, &tree, &feedback, &mut scratch), first);
    assert!(first.requests.len() > 20);
}
