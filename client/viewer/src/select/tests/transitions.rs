//! Cross-fades from one level of detail to another.

use super::*;
use crate::select::transitions::{DrawSource, FADE_SECS, MAX_FADING, Transitions};
use insula_shaders::layout::FADE_RAYS;

/// 60 frames a second.
const FRAME_SECS: f64 = 1.0 / 60.0;

pub(super) fn enabled() -> Transitions {
    let mut transitions = Transitions::default();
    transitions.set_enabled(true);
    transitions
}

/// Advances by a frame. Asserts that each node of the draw list is drawn, that each other node lies in one of them, and that all
/// sources are resident. Returns whether feedback is needed.
pub(super) fn step(transitions: &mut Transitions, tree: &SceneTree, selection: &Selection, secs: f64) -> bool {
    let needs_feedback = transitions.step(selection, tree, secs);
    let nodes: HashSet<NodeIndex> = transitions.tiles().iter().map(|t| t.node).collect();
    assert_eq!(nodes.len(), transitions.tiles().len(), "a node is drawn twice");
    let draw_list: HashSet<NodeIndex> = selection.draw_tiles.iter().map(|tile| tile.node).collect();
    assert!(draw_list.is_subset(&nodes), "a hole");
    for tile in transitions.tiles() {
        let id = tree.node(tile.node).id;
        let lies_in = |node: NodeIndex| id.ancestor(tree.node(node).id.level()) == Some(tree.node(node).id);
        assert!(lies_in(tile.owner) && draw_list.contains(&tile.owner));
        let (new, old) = tile.sources();
        for DrawSource { source, mesh_lod } in [Some(new), old.map(|(old, _)| old)].into_iter().flatten() {
            assert!(tree.node(source).tile.is_resident() && lies_in(source), "{id} is drawn from {source:?}");
            let lods = &tree.node(tile.node).lods;
            assert!(mesh_lod.is_none_or(|lod| lods[usize::from(lod)].tile.is_resident()));
        }
        assert!(old.is_none_or(|(old, rays)| old != new && (1..FADE_RAYS as u8).contains(&rays)));
        assert_eq!(transitions.covering(tile.node, tree).map(|t| t.node), Some(tile.node));
    }
    assert!(transitions.fading_count() <= MAX_FADING);
    needs_feedback
}

fn load_level(tree: &mut SceneTree, level: u8) {
    let ids: Vec<TileId> = tree.nodes().map(|node| node.id).filter(|id| id.level() == level).collect();
    ids.into_iter().for_each(|id| load(tree, TileKey::block_map(id)));
}

fn loaded_tree() -> SceneTree {
    let mut tree = tree();
    (0..=DEPTH).for_each(|level| load_level(&mut tree, level));
    tree
}

/// The selection of all nodes of a level, drawn from their own tiles.
fn select_level(tree: &SceneTree, level: u8) -> Selection {
    let of_level = tree.nodes().filter(|node| node.id.level() == level);
    let nodes: Vec<NodeIndex> = of_level.map(|node| tree.find(node.id).unwrap()).collect();
    let draw_tiles = nodes.iter().map(|node| DrawTile { node: *node, source: *node, mesh_lod: None }).collect();
    Selection { draw_tiles, unoccluded: nodes, ..Selection::default() }
}

#[test]
fn nodes_fade_from_old_to_new_level_whether_finer_or_coarser() {
    let tree = loaded_tree();
    let mut transitions = enabled();
    step(&mut transitions, &tree, &select_level(&tree, 1), FRAME_SECS);
    assert_eq!(transitions.fading_count(), 0, "a new node does not cross-fade");
    let source_level = |source: DrawSource| tree.node(source.source).id.level();
    for to_level in [2, 1] {
        let selection = select_level(&tree, to_level);
        let (mut last_rays, mut feedback_count, mut frames) = (FADE_RAYS as u8, 0, 0);
        loop {
            feedback_count += usize::from(step(&mut transitions, &tree, &selection, FRAME_SECS));
            if transitions.fading_count() == 0 {
                break;
            }
            frames += 1;
            for tile in transitions.tiles().iter().filter(|t| tree.node(t.node).id.level() == 2) {
                let (new, old) = tile.sources();
                let levels = (source_level(new), old.map(|(old, _)| source_level(old)));
                // The first frame equals the one before.
                let expected = if frames == 1 { (3 - to_level, None) } else { (to_level, Some(3 - to_level)) };
                assert_eq!(levels, expected);
                let rays = old.map_or(FADE_RAYS as u8, |(_, rays)| rays);
                assert!(frames == 1 || rays + 6 > last_rays && rays < last_rays, "{rays} after {last_rays}");
            }
            let rays = transitions.tiles().iter().filter_map(|t| t.sources().1).map(|(_, rays)| rays).min();
            last_rays = rays.unwrap_or(last_rays);
        }
        assert!((frames as f64 * FRAME_SECS - FADE_SECS).abs() < 2.0 * FRAME_SECS, "{frames} frames");
        assert_eq!(feedback_count, 2, "after a quarter of the time, and at the end");
        assert_eq!(transitions.tiles().len(), selection.draw_tiles.len());
    }
    // A frame that takes longer than a cross-fade completes it.
    step(&mut transitions, &tree, &select_level(&tree, 3), 0.3);
    step(&mut transitions, &tree, &select_level(&tree, 3), 0.3);
    assert_eq!(transitions.fading_count(), 0);
}

#[test]
fn interrupted_fades_continue_from_their_progress() {
    let tree = loaded_tree();
    let mut transitions = enabled();
    step(&mut transitions, &tree, &select_level(&tree, 1), FRAME_SECS);
    let levels = |transitions: &Transitions| -> HashSet<(u8, Option<(u8, u8)>)> {
        let level = |source: DrawSource| tree.node(source.source).id.level();
        let sources = transitions.tiles().iter().map(|t| t.sources());
        sources.map(|(new, old)| (level(new), old.map(|(old, rays)| (level(old), rays)))).collect()
    };
    for _ in 0..4 {
        step(&mut transitions, &tree, &select_level(&tree, 2), FRAME_SECS);
    }
    let before = levels(&transitions);
    assert_eq!(before.len(), 1);
    // Refined once more: all children are as far as their parent was.
    step(&mut transitions, &tree, &select_level(&tree, 3), 0.0);
    assert_eq!((levels(&transitions), transitions.tiles().len()), (before, 64));
    // Coarsened to the root: all nodes stay until they have faded.
    let root = select_level(&tree, 0);
    step(&mut transitions, &tree, &root, FRAME_SECS);
    assert_eq!(transitions.tiles().len(), 65);
    let mut frames = 0;
    while transitions.fading_count() > 0 {
        step(&mut transitions, &tree, &root, FRAME_SECS);
        frames += 1;
    }
    assert!((25..40).contains(&frames), "{frames}");
    assert_eq!((transitions.tiles().len(), levels(&transitions)), (1, HashSet::from([(0, None)])));
}

#[test]
fn eviction_ends_a_fade() {
    let mut tree = loaded_tree();
    let mut transitions = enabled();
    step(&mut transitions, &tree, &select_level(&tree, 1), FRAME_SECS);
    let finer = select_level(&tree, 2);
    (0..3).for_each(|_| assert!(!step(&mut transitions, &tree, &finer, FRAME_SECS)));
    assert_eq!((transitions.fading_count(), transitions.fading_sources().count()), (16, 32));
    let evicted = TileId::new(1, 0, 0).unwrap();
    tree.apply(TileKey::block_map(evicted), TileEvent::Drop);
    assert!(step(&mut transitions, &tree, &finer, FRAME_SECS), "rays see something new");
    assert_eq!(transitions.fading_count(), 12);
    for tile in transitions.tiles().iter().filter(|t| tree.node(t.node).id.parent() == Some(evicted)) {
        assert_eq!(tile.sources(), (DrawSource { source: tile.node, mesh_lod: None }, None));
    }
}

#[test]
fn nodes_that_become_visible_do_not_fade() {
    let tree = loaded_tree();
    let level = |level: u8, is_unoccluded: bool| match is_unoccluded {
        true => select_level(&tree, level),
        false => Selection { unoccluded: Vec::new(), ..select_level(&tree, level) },
    };
    for (was_unoccluded, is_unoccluded, fading) in [(false, true, 0), (true, false, 64), (false, false, 64)] {
        let mut transitions = enabled();
        step(&mut transitions, &tree, &level(2, was_unoccluded), FRAME_SECS);
        step(&mut transitions, &tree, &level(3, is_unoccluded), FRAME_SECS);
        assert_eq!(transitions.fading_count(), fading);
    }
    let mut disabled = Transitions::default();
    step(&mut disabled, &tree, &level(2, true), FRAME_SECS);
    step(&mut disabled, &tree, &level(3, true), FRAME_SECS);
    assert!(disabled.fading_count() == 0 && disabled.tiles().len() == 64);
}

#[test]
fn number_of_fading_nodes_is_bounded() {
    let mut tree = SceneTree::new(manifest(7));
    subtrees(7, |_| false).iter().for_each(|s| tree.merge(s));
    (5..=7).for_each(|level| load_level(&mut tree, level));
    let mut transitions = enabled();
    for (level, fading) in [(6, 0), (7, MAX_FADING), (5, MAX_FADING)] {
        let selection = select_level(&tree, level);
        transitions.step(&selection, &tree, FRAME_SECS);
        assert_eq!(transitions.fading_count(), fading);
        assert!(transitions.tiles().len() <= selection.draw_tiles.len() + MAX_FADING);
    }
}

#[test]
fn settled_frames_equal_those_without_fades() {
    let mut tree = tree();
    let (mut transitions, mut has_faded) = (enabled(), false);
    load_root(&mut tree);
    loop {
        let selection = select_in_view(&street_view(), &tree);
        step(&mut transitions, &tree, &selection, FRAME_SECS);
        has_faded |= transitions.fading_count() > 0;
        selection.requests.iter().take(5).for_each(|w| load(&mut tree, w.key));
        if selection.requests.is_empty() && transitions.fading_count() == 0 {
            let drawn = transitions.tiles().iter().map(|t| (t.node, t.sources()));
            let selected = selection.draw_tiles.iter();
            let selected = selected.map(|t| (t.node, (DrawSource { source: t.source, mesh_lod: t.mesh_lod }, None)));
            assert!(drawn.eq(selected) && has_faded);
            return;
        }
    }
}
