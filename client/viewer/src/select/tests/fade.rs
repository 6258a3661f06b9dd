//! Squares that pass from one level of detail to another.

use super::*;
use crate::select::transitions::{DrawSource, FADE_SECS, MAX_FADING, Transitions};
use insula_shaders::layout::FADE_RAYS;

/// A frame of sixty in a second.
const FRAME_SECS: f64 = 1.0 / 60.0;

pub(super) fn on() -> Transitions {
    let mut fades = Transitions::default();
    fades.set_enabled(true);
    fades
}

/// A step, after which every square of the cut shows something that is resident, and what else is shown lies in one.
pub(super) fn step(fades: &mut Transitions, tree: &SceneTree, selection: &Selection, secs: f64) -> bool {
    let told = fades.step(selection, tree, secs);
    let shown: HashSet<NodeIndex> = fades.tiles().iter().map(|s| s.node).collect();
    assert_eq!(shown.len(), fades.tiles().len(), "a square is shown twice");
    for item in &selection.draw_tiles {
        assert!(shown.contains(&item.node), "a hole");
    }
    let line = |id: TileId| (0..=id.level()).filter_map(move |level| id.ancestor(level));
    for shown in fades.tiles() {
        let [id, of] = [shown.node, shown.owner].map(|at| tree.node(at).id);
        assert!(line(id).any(|id| id == of) && selection.draw_tiles.iter().any(|item| item.node == shown.owner));
        let (face, old) = shown.sources();
        for DrawSource { source: from, mesh_lod: mesh } in [Some(face), old.map(|(old, _)| old)].into_iter().flatten() {
            let node = tree.node(from);
            assert!(node.tile.is_resident() && line(id).any(|id| id == node.id), "{id} shows {}", node.id);
            let lods = &tree.node(shown.node).lods;
            assert!(mesh.is_none_or(|lod| lods[usize::from(lod)].tile.is_resident()));
        }
        assert!(old.is_none_or(|(old, rays)| old != face && (1..FADE_RAYS as u8).contains(&rays)));
        assert_eq!(fades.covering(shown.node, tree).map(|s| s.node), Some(shown.node));
    }
    assert!(fades.fading_count() <= MAX_FADING);
    told
}

fn all_of(tree: &mut SceneTree, level: u8) {
    let ids: Vec<TileId> = tree.nodes().map(|node| node.id).filter(|id| id.level() == level).collect();
    ids.into_iter().for_each(|id| load(tree, TileKey::block_map(id)));
}

/// The cut for a level, all squares of which are here.
fn cut_at(tree: &SceneTree, level: u8) -> Selection {
    let at_level = |node: &&TreeNode| node.id.level() == level;
    let squares: Vec<NodeIndex> = tree.nodes().filter(at_level).map(|node| tree.find(node.id).unwrap()).collect();
    let cut = squares.iter().map(|at| DrawTile { node: *at, source: *at, mesh_lod: None }).collect();
    Selection { draw_tiles: cut, unoccluded: squares, ..Selection::default() }
}

fn loaded() -> SceneTree {
    let mut tree = tree();
    (0..=DEPTH).for_each(|level| all_of(&mut tree, level));
    tree
}

#[test]
fn finer_squares_come_a_share_at_a_time_and_so_do_coarser_ones() {
    let tree = loaded();
    let mut fades = on();
    step(&mut fades, &tree, &cut_at(&tree, 1), FRAME_SECS);
    assert_eq!(fades.fading_count(), 0, "what was not drawn before is right at once");
    for (to, level) in [(2, 2), (1, 2)] {
        let cut = cut_at(&tree, to);
        let (mut last, mut told, mut frames) = (FADE_RAYS as u8, 0, 0);
        loop {
            told += usize::from(step(&mut fades, &tree, &cut, FRAME_SECS));
            if fades.fading_count() == 0 {
                break;
            }
            frames += 1;
            for shown in fades.tiles().iter().filter(|s| tree.node(s.node).id.level() == level) {
                let (face, old) = shown.sources();
                let levels = [Some(face), old.map(|(old, _)| old)].map(|f| f.map(|f| tree.node(f.source).id.level()));
                // The first frame is as the one before.
                match frames {
                    1 => assert_eq!(levels, [Some(3 - to), None]),
                    _ => assert_eq!(levels, [Some(to), Some(3 - to)]),
                }
                let rays = old.map_or(FADE_RAYS as u8, |(_, rays)| rays);
                assert!(frames == 1 || rays == last || rays + 6 > last && rays < last, "{rays} after {last}");
            }
            let rays = fades.tiles().iter().filter_map(|s| s.sources().1).map(|(_, rays)| rays).min();
            last = rays.unwrap_or(last);
        }
        assert!((frames as f64 * FRAME_SECS - FADE_SECS).abs() < 2.0 * FRAME_SECS, "{frames} frames");
        assert_eq!(told, 2, "when there is something to be told, and at the end");
        assert_eq!(fades.tiles().len(), cut.draw_tiles.len());
    }
    // A slow device's frame is a fade by itself.
    step(&mut fades, &tree, &cut_at(&tree, 3), 0.3);
    step(&mut fades, &tree, &cut_at(&tree, 3), 0.3);
    assert_eq!(fades.fading_count(), 0);
}

#[test]
fn what_changes_on_the_way_goes_on_from_there() {
    let tree = loaded();
    let mut fades = on();
    step(&mut fades, &tree, &cut_at(&tree, 1), FRAME_SECS);
    let levels = |fades: &Transitions| {
        let faces = fades.tiles().iter().map(|s| s.sources());
        let level = |face: DrawSource| tree.node(face.source).id.level();
        let all: HashSet<(u8, Option<(u8, u8)>)> =
            faces.map(|(face, old)| (level(face), old.map(|(old, rays)| (level(old), rays)))).collect();
        all
    };
    for _ in 0..4 {
        step(&mut fades, &tree, &cut_at(&tree, 2), FRAME_SECS);
    }
    let before = levels(&fades);
    assert_eq!(before.len(), 1);
    // Split once more: every part goes on with its part of what it was.
    step(&mut fades, &tree, &cut_at(&tree, 3), 0.0);
    assert_eq!((levels(&fades), fades.tiles().len()), (before, 64));
    // And back to the root: all parts stay.
    step(&mut fades, &tree, &cut_at(&tree, 0), FRAME_SECS);
    assert_eq!(fades.tiles().len(), 65);
    let mut frames = 0;
    while fades.fading_count() > 0 {
        step(&mut fades, &tree, &cut_at(&tree, 0), FRAME_SECS);
        frames += 1;
    }
    assert!((25..40).contains(&frames), "{frames}");
    assert_eq!((fades.tiles().len(), levels(&fades)), (1, HashSet::from([(0, None)])));
}

#[test]
fn what_leaves_the_cache_or_was_not_seen_does_not_fade() {
    let mut tree = loaded();
    let mut fades = on();
    step(&mut fades, &tree, &cut_at(&tree, 1), FRAME_SECS);
    let finer = cut_at(&tree, 2);
    (0..3).for_each(|_| assert!(!step(&mut fades, &tree, &finer, FRAME_SECS)));
    assert_eq!((fades.fading_count(), fades.fading_sources().count()), (16, 32));
    let gone = TileId::new(1, 0, 0).unwrap();
    tree.apply(TileKey::block_map(gone), TileEvent::Drop);
    assert!(step(&mut fades, &tree, &finer, FRAME_SECS), "what is seen of it at once is told");
    assert_eq!(fades.fading_count(), 12);
    for shown in fades.tiles().iter().filter(|s| tree.node(s.node).id.parent() == Some(gone)) {
        assert_eq!(shown.sources(), (DrawSource { source: shown.node, mesh_lod: None }, None));
    }
    // Hidden until now; what is not seen any more, or still not, may yet show over what hides it.
    for (before, now, passing) in [(false, true, 0), (true, false, 64), (false, false, 64)] {
        let hide = |cut: Selection, seen: bool| if seen { cut } else { Selection { unoccluded: Vec::new(), ..cut } };
        let mut fades = on();
        step(&mut fades, &tree, &hide(cut_at(&tree, 2), before), FRAME_SECS);
        step(&mut fades, &tree, &hide(cut_at(&tree, 3), now), FRAME_SECS);
        assert_eq!(fades.fading_count(), passing);
    }
    let mut off = Transitions::default();
    step(&mut off, &tree, &cut_at(&tree, 2), FRAME_SECS);
    step(&mut off, &tree, &cut_at(&tree, 3), FRAME_SECS);
    assert!(off.fading_count() == 0 && off.tiles().len() == 64);
}

#[test]
fn no_more_than_so_many_pass_at_a_time() {
    let mut tree = SceneTree::new(manifest(7));
    subtrees(7, |_| false).iter().for_each(|s| tree.merge(s));
    (5..=7).for_each(|level| all_of(&mut tree, level));
    let mut fades = on();
    let cuts = [6, 7, 5].map(|level| cut_at(&tree, level));
    for (cut, passing) in [(&cuts[0], 0), (&cuts[1], MAX_FADING), (&cuts[2], MAX_FADING)] {
        fades.step(cut, &tree, FRAME_SECS);
        assert_eq!(fades.fading_count(), passing);
        assert!(fades.tiles().len() <= cut.draw_tiles.len() + MAX_FADING);
    }
}

/// What a select of the real thing gives: it fades, and comes to rest as it would have at once.
#[test]
fn at_rest_all_is_as_without() {
    let mut tree = tree();
    let view = view([1030.0, 1015.0, 20.0], [1030.0, 3000.0, 20.0]);
    let (mut fades, mut scratch, mut passed) = (on(), SelectionScratch::default(), false);
    load(&mut tree, TileKey::block_map(TileId::ROOT));
    loop {
        let selection = select(&view, &tree, &mut scratch);
        step(&mut fades, &tree, &selection, FRAME_SECS);
        passed |= fades.fading_count() > 0;
        selection.requests.iter().take(5).for_each(|w| load(&mut tree, w.key));
        if selection.requests.is_empty() && fades.fading_count() == 0 {
            let faces: Vec<_> = fades.tiles().iter().map(|s| (s.node, s.sources())).collect();
            let meant = selection
                .draw_tiles
                .iter()
                .map(|i| (i.node, (DrawSource { source: i.source, mesh_lod: i.mesh_lod }, None)));
            assert_eq!(faces, meant.collect::<Vec<_>>());
            break;
        }
    }
    assert!(passed);
}
