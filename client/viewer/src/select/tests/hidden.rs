//! What rays do not hit, and what comes into view.

use super::*;

#[test]
fn what_is_hidden_is_neither_fetched_nor_drawn_finely() {
    let view = view([1024.0, 10.0, 10.0], [1024.0, 1000.0, 10.0]);
    let fetched = |tree: &SceneTree| tree.nodes().filter(|n| n.tile.is_resident()).count();
    let mut all = tree();
    converge(&mut all, &view, 5);
    // A wall: nothing is seen that is farther north than 200 m.
    let near = |id: TileId| {
        let side = SIDE_M / f64::from(1u32 << id.level());
        f64::from(id.y()) * side < 200.0
    };
    let (mut few, mut sight) = (tree(), OcclusionFeedback::default());
    let selection = converge_looking(&mut few, &mut sight, &view, near);
    assert!(fetched(&few) * 2 < fetched(&all), "{} of {}", fetched(&few), fetched(&all));
    assert!(selection.stats.not_visible > 0 && sight.hit_count() > 0);
    for item in &selection.draw_tiles {
        let node = few.node(item.node);
        let error_px = ErrorMetric::new(&view).error_px(node.error_m, node.centre, node.radius_m);
        // What is seen is as good as without occlusion; what is not is within its own bound.
        if near(node.id) {
            assert!(item.source == item.node && (error_px <= 1.0 || node.id.level() == DEPTH), "{}", node.id);
        }
    }
    // The wall falls: all of it comes, and the picture is that of the frustum alone.
    let selection = converge_looking(&mut few, &mut sight, &view, |_| true);
    let mut whole = ids(&few, &selection);
    whole.sort();
    assert_eq!(whole, ids(&all, &select(&view, &all, &mut SelectionScratch::default())));
}

/// Not even what is very coarse: who stands will never see it.
#[test]
fn what_is_hidden_beside_what_is_seen_is_not_fetched_while_the_camera_stands() {
    let view = view([1030.0, 1015.0, 20.0], [1030.0, 3000.0, 20.0]);
    // A wall at 1100 m: of what is in view, rays hit what reaches this side of it.
    let near = |id: TileId| {
        let side = SIDE_M / f64::from(1u32 << id.level());
        let y = f64::from(id.y()) * side;
        y < 1100.0 && y + side > 1015.0
    };
    let (mut tree, mut sight) = (tree(), OcclusionFeedback::default());
    load(&mut tree, TileKey::block_map(TileId::ROOT));
    look(&mut sight, &tree, &view, &select(&view, &tree, &mut SelectionScratch::default()), 0, near);
    converge_looking(&mut tree, &mut sight, &view, near);
    let here: Vec<TileId> = tree.nodes().filter(|n| n.tile.is_resident()).map(|n| n.id).collect();
    assert!(here.iter().filter(|id| id.level() == DEPTH).count() > 4, "{here:?}");
    let unseen: Vec<&TileId> = here.iter().filter(|id| !near(**id)).collect();
    assert!(unseen.is_empty(), "{unseen:?}");
}

/// What is seen, becomes finer, is hidden by something, becomes coarser, looks over that and is seen again would flicker: whatever
/// rays hit, nothing that they hit once becomes coarser for who stands.
#[test]
fn nothing_that_was_seen_becomes_coarser_while_the_camera_stands() {
    for seed in 1..40u64 {
        let mut tree = tree();
        let view = view([1030.0, 1015.0, 20.0], [1030.0, 3000.0, 20.0]);
        let mut sight = OcclusionFeedback::default();
        let mut seen: Vec<[TileId; 2]> = Vec::new();
        load(&mut tree, TileKey::block_map(TileId::ROOT));
        for frame in 0..60u64 {
            let selection = super::super::select(&view, &tree, &sight, &mut SelectionScratch::default());
            assert_whole(&tree, &view, &selection, frame as usize);
            let id = |at: NodeIndex| tree.node(at).id;
            let cut: Vec<[TileId; 2]> =
                selection.draw_tiles.iter().map(|item| [id(item.node), id(item.source)]).collect();
            let lies_in = |a: TileId, b: TileId| a.ancestor(b.level()) == Some(b);
            for [square, from] in &cut {
                let coarser = |[other, fine]: &&[TileId; 2]| {
                    (lies_in(*square, *other) || lies_in(*other, *square)) && fine.level() > from.level()
                };
                let finer = seen.iter().find(coarser);
                assert_eq!(finer, None, "of {seed} in frame {frame}: {square} is drawn from {from}");
            }
            selection.requests.iter().take(2).for_each(|w| load(&mut tree, w.key));
            let hit = |id: TileId| {
                let name = u64::from(id.x()) * 31 + u64::from(id.y()) * 17 + u64::from(id.level()) * 7;
                (name ^ frame).wrapping_mul(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15)) >> 62 == 0
            };
            seen.extend(cut.into_iter().filter(|[square, _]| hit(*square)));
            look(&mut sight, &tree, &view, &selection, frame, hit);
        }
        assert!(seen.iter().any(|[_, from]| from.level() == DEPTH), "{seed}");
    }
}

#[test]
fn what_a_turn_brings_is_drawn_as_finely_as_it_is_here() {
    let mut tree = tree();
    let (north, east) =
        (view([1030.0, 1015.0, 20.0], [1030.0, 3000.0, 20.0]), view([1030.0, 1015.0, 20.0], [3000.0, 1015.0, 20.0]));
    converge(&mut tree, &north, 5);
    converge(&mut tree, &east, 5);
    let mut sight = OcclusionFeedback::default();
    converge_looking(&mut tree, &mut sight, &north, |id| id.y().is_multiple_of(8));
    let selection = super::super::select(&north, &tree, &sight, &mut SelectionScratch::default());
    assert!(selection.stats.not_visible > 0 && selection.requests.is_empty());
    let turned = super::super::select(&east, &tree, &sight, &mut SelectionScratch::default());
    assert_whole(&tree, &east, &turned, 0);
    assert!(turned.requests.is_empty(), "what nobody has seen yet is not fetched");
    let frustum = select(&east, &tree, &mut SelectionScratch::default());
    let new = |selection: &Selection| {
        let planes = north.planes();
        let outside = |item: &&DrawTile| {
            let node = tree.node(item.node);
            !cull::is_box_inside_view(&planes, node.centre, node.half)
        };
        let mut ids: Vec<TileId> =
            selection.draw_tiles.iter().filter(outside).map(|item| tree.node(item.source).id).collect();
        ids.sort();
        ids
    };
    assert!(new(&frustum).len() > 10);
    assert_eq!(new(&turned), new(&frustum));
}

/// Who turns a little sees what was seen as it was, though much of what comes into view is not here.
#[test]
fn what_was_seen_stays_as_fine_in_a_turn() {
    let mut tree = tree();
    let eye = [1030.0, 1015.0, 20.0];
    let north = view(eye, [1030.0, 3000.0, 20.0]);
    let mut sight = OcclusionFeedback::default();
    let near = |id: TileId| {
        let side = SIDE_M / f64::from(1u32 << id.level());
        let (x, y) = (f64::from(id.x()) * side, f64::from(id.y()) * side);
        x < 1060.0 && x + side > 1000.0 && y < 1300.0 && y + side > 1015.0
    };
    let before = converge_looking(&mut tree, &mut sight, &north, near);
    let seen =
        before.draw_tiles.iter().filter(|item| near(tree.node(item.node).id)).map(|item| tree.node(item.source).id);
    let seen: Vec<TileId> = seen.collect();
    assert!(seen.iter().filter(|id| id.level() == DEPTH).count() >= 4, "{seen:?}");
    let mut missing = 0;
    for degrees in [-30.0, -10.0, -3.0, 3.0, 10.0, 30.0f64] {
        let (sin, cos) = degrees.to_radians().sin_cos();
        let turned = view(eye, [eye[0] + 1000.0 * sin, eye[1] + 1000.0 * cos, 20.0]);
        let after = super::super::select(&turned, &tree, &sight, &mut SelectionScratch::default());
        assert_whole(&tree, &turned, &after, 0);
        missing += after.requests.len();
        let planes = turned.planes();
        for node in seen.iter().filter_map(|id| tree.find(*id)).map(|at| tree.node(at)) {
            let drawn = after.draw_tiles.iter().any(|item| tree.node(item.source).id == node.id);
            assert!(
                drawn || !cull::is_box_in_view(&planes, node.centre, node.half),
                "{} after {degrees} degrees",
                node.id
            );
        }
    }
    assert!(missing > 0, "something that is not here comes into view");
}

/// Who steps back until a coarser level would do sees what is here of the finer one until that is: a part of it, too.
#[test]
fn what_was_seen_stays_as_fine_until_the_coarser_is_here() {
    let mut tree = tree();
    let near = view([1030.0, 1015.0, 20.0], [1030.0, 3000.0, 20.0]);
    let mut sight = OcclusionFeedback::default();
    // Of each four, one.
    let hit = |id: TileId| id.level() < DEPTH || id.quadrant() == 0;
    load(&mut tree, TileKey::block_map(TileId::ROOT));
    look(&mut sight, &tree, &near, &select(&near, &tree, &mut SelectionScratch::default()), 0, hit);
    let before = converge_looking(&mut tree, &mut sight, &near, hit);
    let leaves: Vec<DrawTile> =
        before.draw_tiles.iter().filter(|item| tree.node(item.source).id.level() == DEPTH).copied().collect();
    assert!(leaves.len() > 5, "{}", leaves.len());
    let px = |node: &TreeNode| ErrorMetric::new(&near).error_px(node.error_m, node.centre, node.radius_m);
    let mut waited = 0;
    for tau_px in [2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 16.0] {
        let back = View { tau_px, ..near };
        let after = super::super::select(&back, &tree, &sight, &mut SelectionScratch::default());
        assert_whole(&tree, &back, &after, 0);
        // Their parents would do and are not here; what is above those would not do.
        let waits = |item: &&DrawTile| {
            let mut above = std::iter::successors(tree.node(item.node).parent, |at| tree.node(*at).parent);
            let parent = above.next().map(|at| tree.node(at));
            parent.is_some_and(|parent| px(parent) <= tau_px && !parent.tile.is_resident())
                && above.next().is_some_and(|at| px(tree.node(at)) > tau_px)
        };
        for item in leaves.iter().filter(waits) {
            assert!(after.draw_tiles.contains(item), "{} at {tau_px}", tree.node(item.node).id);
            waited += 1;
        }
    }
    assert!(waited > 5, "{waited}");
}
