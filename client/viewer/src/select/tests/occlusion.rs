//! Nodes that rays do not hit, and nodes that come into view.

use super::*;

#[test]
fn occluded_nodes_are_neither_fetched_nor_drawn_finely() {
    let view = view([1024.0, 10.0, 10.0], [1024.0, 1000.0, 10.0]);
    let mut all = tree();
    converge(&mut all, &view, 5);
    // A wall: nothing farther north than 200 m is visible.
    let is_before_wall = |id: TileId| area(id)[0][1] < 200.0;
    let (mut tree, mut feedback) = (tree(), OcclusionFeedback::default());
    let selection = converge_with(&mut feedback, &mut tree, &view, is_before_wall);
    let [few, many] = [&tree, &all].map(|tree| resident_nodes(tree).len());
    assert!(few * 2 < many, "{few} of {many}");
    assert!(selection.stats.not_visible > 0);
    for tile in &selection.draw_tiles {
        let node = tree.node(tile.node);
        let is_accurate = error_px(&view, node, node.error_m) <= 1.0 || node.id.level() == DEPTH;
        assert!(!is_before_wall(node.id) || tile.source == tile.node && is_accurate, "{}", node.id);
    }
    // The wall falls: the frame becomes that of the frustum alone.
    let selection = converge_with(&mut feedback, &mut tree, &view, |_| true);
    assert_eq!(drawn_sources(&tree, &selection), drawn_sources(&all, &select_in_view(&view, &all)));
}

#[test]
fn occluded_nodes_beside_visible_ones_are_not_fetched_while_the_camera_is_still() {
    // A wall at 1100 m. Rays hit what reaches in front of it, however coarse it is.
    let is_before_wall = |id: TileId| area(id)[0][1] < 1100.0 && area(id)[1][1] > 1015.0;
    let (mut tree, mut feedback) = (tree(), OcclusionFeedback::default());
    report_first_frame(&mut feedback, &mut tree, &street_view(), is_before_wall);
    converge_with(&mut feedback, &mut tree, &street_view(), is_before_wall);
    let resident = resident_nodes(&tree);
    assert!(resident.iter().filter(|id| id.level() == DEPTH).count() > 4, "{resident:?}");
    assert!(resident.iter().all(|id| is_before_wall(*id)), "{resident:?}");
}

/// A node that becomes visible, finer, occluded, coarser, and visible again would flicker. Whatever rays hit, what they hit once
/// must not become coarser while the camera is still.
#[test]
fn visible_nodes_never_become_coarser_while_the_camera_is_still() {
    let view = street_view();
    for seed in 1..40u64 {
        let mut tree = tree();
        let mut feedback = OcclusionFeedback::default();
        // Nodes that were hit, each with the node whose tile was drawn.
        let mut hits: Vec<[TileId; 2]> = Vec::new();
        load_root(&mut tree);
        for frame in 0..60u64 {
            let selection = select_with(&view, &tree, &feedback);
            assert_no_holes(&tree, &view, &selection, frame as usize);
            let draw_list: Vec<[TileId; 2]> =
                selection.draw_tiles.iter().map(|t| [t.node, t.source].map(|index| tree.node(index).id)).collect();
            let lies_in = |a: TileId, b: TileId| a.ancestor(b.level()) == Some(b);
            for [node, source] in &draw_list {
                let is_finer = |[hit, hit_source]: &&[TileId; 2]| {
                    (lies_in(*node, *hit) || lies_in(*hit, *node)) && hit_source.level() > source.level()
                };
                let finer = hits.iter().find(is_finer);
                assert_eq!(finer, None, "seed {seed}, frame {frame}: {node} is drawn from {source}");
            }
            selection.requests.iter().take(2).for_each(|w| load(&mut tree, w.key));
            let is_hit = |id: TileId| {
                let hash = u64::from(id.x()) * 31 + u64::from(id.y()) * 17 + u64::from(id.level()) * 7;
                (hash ^ frame).wrapping_mul(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15)) >> 62 == 0
            };
            hits.extend(draw_list.into_iter().filter(|[node, _]| is_hit(*node)));
            report(&mut feedback, &tree, &view, &selection, is_hit);
        }
        assert!(hits.iter().any(|[_, source]| source.level() == DEPTH), "{seed}");
    }
}

#[test]
fn nodes_that_a_turn_brings_into_view_are_drawn_as_finely_as_they_are_resident() {
    let mut tree = tree();
    let (north, east) = (street_view(), view([1030.0, 1015.0, 20.0], [3000.0, 1015.0, 20.0]));
    converge(&mut tree, &north, 5);
    converge(&mut tree, &east, 5);
    let mut feedback = OcclusionFeedback::default();
    converge_with(&mut feedback, &mut tree, &north, |id| id.y().is_multiple_of(8));
    let selection = select_with(&north, &tree, &feedback);
    assert!(selection.stats.not_visible > 0 && selection.requests.is_empty());
    let turned = select_with(&east, &tree, &feedback);
    assert_no_holes(&tree, &east, &turned, 0);
    assert!(turned.requests.is_empty(), "nodes of unknown visibility are not fetched");
    let planes = north.planes();
    let new_sources = |selection: &Selection| {
        let is_new = |tile: &&DrawTile| {
            let node = tree.node(tile.node);
            !cull::is_box_inside_view(&planes, node.centre, node.half)
        };
        let mut ids = ids_of(&tree, selection.draw_tiles.iter().filter(is_new).map(|tile| &tile.source));
        ids.sort();
        ids
    };
    let expected = new_sources(&select_in_view(&east, &tree));
    assert!(expected.len() > 10);
    assert_eq!(new_sources(&turned), expected);
}

#[test]
fn visible_nodes_stay_fine_in_a_turn_although_other_tiles_are_missing() {
    let mut tree = tree();
    let mut feedback = OcclusionFeedback::default();
    let is_near = |id: TileId| {
        let [[x_min, y_min], [x_max, y_max]] = area(id);
        x_min < 1060.0 && x_max > 1000.0 && y_min < 1300.0 && y_max > 1015.0
    };
    let before = converge_with(&mut feedback, &mut tree, &street_view(), is_near);
    let visible = before.draw_tiles.iter().filter(|tile| is_near(tree.node(tile.node).id)).map(|tile| tile.source);
    let visible: Vec<NodeIndex> = visible.collect();
    assert!(visible.iter().filter(|source| tree.node(**source).id.level() == DEPTH).count() >= 4, "{visible:?}");
    let mut missing = 0;
    for degrees in [-30.0, -10.0, -3.0, 3.0, 10.0, 30.0f64] {
        let view = View { camera: street_view().camera.turned(-degrees), ..street_view() };
        let selection = select_with(&view, &tree, &feedback);
        assert_no_holes(&tree, &view, &selection, 0);
        missing += selection.requests.len();
        let planes = view.planes();
        for source in &visible {
            let node = tree.node(*source);
            let is_drawn = selection.draw_tiles.iter().any(|tile| tile.source == *source);
            assert!(is_drawn || !cull::is_box_in_view(&planes, node.centre, node.half), "{} at {degrees}", node.id);
        }
    }
    assert!(missing > 0, "tiles that are not resident come into view");
}

#[test]
fn children_are_drawn_until_their_parent_is_resident_when_the_camera_moves_away() {
    let mut tree = tree();
    let near = street_view();
    let mut feedback = OcclusionFeedback::default();
    // One child of each parent.
    let is_hit = |id: TileId| id.level() < DEPTH || id.quadrant() == 0;
    report_first_frame(&mut feedback, &mut tree, &near, is_hit);
    let before = converge_with(&mut feedback, &mut tree, &near, is_hit);
    let is_leaf = |tile: &&DrawTile| tree.node(tile.source).id.level() == DEPTH;
    let leaves: Vec<DrawTile> = before.draw_tiles.iter().filter(is_leaf).copied().collect();
    assert!(leaves.len() > 5, "{}", leaves.len());
    let mut checked = 0;
    for tau_px in [2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 16.0] {
        let away = View { tau_px, ..near };
        let selection = select_with(&away, &tree, &feedback);
        assert_no_holes(&tree, &away, &selection, 0);
        let is_accurate = |node: &TreeNode| error_px(&near, node, node.error_m) <= tau_px;
        // The parent is accurate enough and not resident; the node above it is not accurate enough.
        let must_stay = |tile: &&DrawTile| {
            let mut ancestors = std::iter::successors(tree.node(tile.node).parent, |index| tree.node(*index).parent);
            let mut next = || ancestors.next().map(|index| tree.node(index));
            next().is_some_and(|parent| is_accurate(parent) && !parent.tile.is_resident())
                && next().is_some_and(|above| !is_accurate(above))
        };
        for tile in leaves.iter().filter(must_stay) {
            assert!(selection.draw_tiles.contains(tile), "{} at {tau_px}", tree.node(tile.node).id);
            checked += 1;
        }
    }
    assert!(checked > 5, "{checked}");
}

/// Such a node would be drawn as long as it is unknown, and refined into nothing as soon as it is occluded, in turn.
#[test]
fn nodes_without_children_in_view_are_not_drawn_in_turn() {
    let node = TileId::new(1, 1, 0).unwrap();
    let mut tree = SceneTree::new(manifest(DEPTH));
    // Only its north-western child exists, which is behind the camera.
    let is_missing = |id: TileId| id.level() == 2 && id.x() / 2 == 1 && id.y() / 2 == 0 && id.quadrant() != 2;
    subtrees(DEPTH, is_missing).iter().for_each(|s| tree.merge(s));
    // Its error is above tau and below 16 tau.
    let view = View { tau_px: 1000.0, ..view([1800.0, 100.0, 20.0], [3000.0, 100.0, 20.0]) };
    load_root(&mut tree);
    let mut feedback = OcclusionFeedback::default();
    for _ in 0..2 {
        let query = OcclusionQuery { nodes: vec![tree.find(node).unwrap()], view, generation: 0 };
        feedback.update(&query, &[9], false, &tree);
    }
    let selection = converge_with(&mut feedback, &mut tree, &view, |_| false);
    assert!(selection.draw_tiles.iter().all(|tile| tree.node(tile.node).id != node));
}
