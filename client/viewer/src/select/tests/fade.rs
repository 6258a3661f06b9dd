//! Squares that pass from one level of detail to another.

use super::*;
use crate::select::transitions::{DrawSource, FADE_SECS, FADES, Transitions};
use insula_shaders::layout::FADE_RAYS;

/// A frame of sixty in a second.
const FRAME_SECS: f64 = 1.0 / 60.0;

pub(super) fn on() -> Transitions {
    let mut fades = Transitions::default();
    fades.set(true);
    fades
}

/// A step, after which every square of the cut shows something that is resident, and what else is shown lies in one.
pub(super) fn step(fades: &mut Transitions, tree: &SceneTree, selection: &Selection, secs: f64) -> bool {
    let told = fades.step(selection, tree, secs);
    let shown: HashSet<NodeIndex> = fades.shown().iter().map(|s| s.square).collect();
    assert_eq!(shown.len(), fades.shown().len(), "a square is shown twice");
    for item in &selection.draw_tiles {
        assert!(shown.contains(&item.node), "a hole");
    }
    let line = |id: TileId| (0..=id.level()).filter_map(move |level| id.ancestor(level));
    for shown in fades.shown() {
        let [id, of] = [shown.square, shown.of].map(|at| tree.node(at).id);
        assert!(line(id).any(|id| id == of) && selection.draw_tiles.iter().any(|item| item.node == shown.of));
        let (face, old) = shown.faces();
        for DrawSource { from, mesh } in [Some(face), old.map(|(old, _)| old)].into_iter().flatten() {
            let node = tree.node(from);
            assert!(node.tile.is_resident() && line(id).any(|id| id == node.id), "{id} shows {}", node.id);
            let lods = &tree.node(shown.square).lods;
            assert!(mesh.is_none_or(|lod| lods[usize::from(lod)].tile.is_resident()));
        }
        assert!(old.is_none_or(|(old, rays)| old != face && (1..FADE_RAYS as u8).contains(&rays)));
        assert_eq!(fades.over(shown.square, tree).map(|s| s.square), Some(shown.square));
    }
    assert!(fades.passing() <= FADES);
    told
}

fn all_of(tree: &mut SceneTree, level: u8) {
    let ids: Vec<TileId> = tree.nodes().iter().map(|node| node.id).filter(|id| id.level() == level).collect();
    ids.into_iter().for_each(|id| load(tree, TileKey::block_map(id)));
}

/// The cut for a level, all squares of which are here.
fn cut_at(tree: &SceneTree, level: u8) -> Selection {
    let at_level = |node: &&TreeNode| node.id.level() == level;
    let squares: Vec<NodeIndex> =
        tree.nodes().iter().filter(at_level).map(|node| tree.find(node.id).unwrap()).collect();
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
    assert_eq!(fades.passing(), 0, "what was not drawn before is right at once");
    for (to, level) in [(2, 2), (1, 2)] {
        let cut = cut_at(&tree, to);
        let (mut last, mut told, mut frames) = (FADE_RAYS as u8, 0, 0);
        loop {
            told += usize::from(step(&mut fades, &tree, &cut, FRAME_SECS));
            if fades.passing() == 0 {
                break;
            }
            frames += 1;
            for shown in fades.shown().iter().filter(|s| tree.node(s.square).id.level() == level) {
                let (face, old) = shown.faces();
                let levels = [Some(face), old.map(|(old, _)| old)].map(|f| f.map(|f| tree.node(f.from).id.level()));
                // The first frame is as the one before.
                match frames {
                    1 => assert_eq!(levels, [Some(3 - to), None]),
                    _ => assert_eq!(levels, [Some(to), Some(3 - to)]),
                }
                let rays = old.map_or(FADE_RAYS as u8, |(_, rays)| rays);
                assert!(frames == 1 || rays == last || rays + 6 > last && rays < last, "{rays} after {last}");
            }
            let rays = fades.shown().iter().filter_map(|s| s.faces().1).map(|(_, rays)| rays).min();
            last = rays.unwrap_or(last);
        }
        assert!((frames as f64 * FRAME_SECS - FADE_SECS).abs() < 2.0 * FRAME_SECS, "{frames} frames");
        assert_eq!(told, 2, "when there is something to be told, and at the end");
        assert_eq!(fades.shown().len(), cut.draw_tiles.len());
    }
    // A slow device's frame is a fade by itself.
    step(&mut fades, &tree, &cut_at(&tree, 3), 0.3);
    step(&mut fades, &tree, &cut_at(&tree, 3), 0.3);
    assert_eq!(fades.passing(), 0);
}

#[test]
fn what_changes_on_the_way_goes_on_from_there() {
    let tree = loaded();
    let mut fades = on();
    step(&mut fades, &tree, &cut_at(&tree, 1), FRAME_SECS);
    let levels = |fades: &Transitions| {
        let faces = fades.shown().iter().map(|s| s.faces());
        let level = |face: DrawSource| tree.node(face.from).id.level();
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
    assert_eq!((levels(&fades), fades.shown().len()), (before, 64));
    // And back to the root: all parts stay.
    step(&mut fades, &tree, &cut_at(&tree, 0), FRAME_SECS);
    assert_eq!(fades.shown().len(), 65);
    let mut frames = 0;
    while fades.passing() > 0 {
        step(&mut fades, &tree, &cut_at(&tree, 0), FRAME_SECS);
        frames += 1;
    }
    assert!((25..40).contains(&frames), "{frames}");
    assert_eq!((fades.shown().len(), levels(&fades)), (1, HashSet::from([(0, None)])));
}

#[test]
fn what_leaves_the_cache_or_was_not_seen_does_not_fade() {
    let mut tree = loaded();
    let mut fades = on();
    step(&mut fades, &tree, &cut_at(&tree, 1), FRAME_SECS);
    let finer = cut_at(&tree, 2);
    (0..3).for_each(|_| assert!(!step(&mut fades, &tree, &finer, FRAME_SECS)));
    assert_eq!((fades.passing(), fades.kept().count()), (16, 32));
    let gone = TileId::new(1, 0, 0).unwrap();
    tree.apply(TileKey::block_map(gone), TileEvent::Drop);
    assert!(step(&mut fades, &tree, &finer, FRAME_SECS), "what is seen of it at once is told");
    assert_eq!(fades.passing(), 12);
    for shown in fades.shown().iter().filter(|s| tree.node(s.square).id.parent() == Some(gone)) {
        assert_eq!(shown.faces(), (DrawSource { from: shown.square, mesh: None }, None));
    }
    // Hidden until now; what is not seen any more, or still not, may yet show over what hides it.
    for (before, now, passing) in [(false, true, 0), (true, false, 64), (false, false, 64)] {
        let hide = |cut: Selection, seen: bool| if seen { cut } else { Selection { unoccluded: Vec::new(), ..cut } };
        let mut fades = on();
        step(&mut fades, &tree, &hide(cut_at(&tree, 2), before), FRAME_SECS);
        step(&mut fades, &tree, &hide(cut_at(&tree, 3), now), FRAME_SECS);
        assert_eq!(fades.passing(), passing);
    }
    let mut off = Transitions::default();
    step(&mut off, &tree, &cut_at(&tree, 2), FRAME_SECS);
    step(&mut off, &tree, &cut_at(&tree, 3), FRAME_SECS);
    assert!(off.passing() == 0 && off.shown().len() == 64);
}

#[test]
fn no_more_than_so_many_pass_at_a_time() {
    let mut tree = SceneTree::new(manifest(7));
    subtrees(7, |_| false).iter().for_each(|s| tree.merge(s));
    (5..=7).for_each(|level| all_of(&mut tree, level));
    let mut fades = on();
    let cuts = [6, 7, 5].map(|level| cut_at(&tree, level));
    for (cut, passing) in [(&cuts[0], 0), (&cuts[1], FADES), (&cuts[2], FADES)] {
        fades.step(cut, &tree, FRAME_SECS);
        assert_eq!(fades.passing(), passing);
        assert!(fades.shown().len() <= cut.draw_tiles.len() + FADES);
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
        passed |= fades.passing() > 0;
        selection.requests.iter().take(5).for_each(|w| load(&mut tree, w.key));
        if selection.requests.is_empty() && fades.passing() == 0 {
            let faces: Vec<_> = fades.shown().iter().map(|s| (s.square, s.faces())).collect();
            let meant =
                selection.draw_tiles.iter().map(|i| (i.node, (DrawSource { from: i.source, mesh: i.mesh_lod }, None)));
            assert_eq!(faces, meant.collect::<Vec<_>>());
            break;
        }
    }
    assert!(passed);
}
