//! Levels of detail by switching distances.

use super::*;
use crate::switching::{SwitchDistances, SwitchVolume};

const DISTANCES_M: [f64; 5] = [150.0, 300.0, 600.0, 900.0, 1200.0];

/// Distance of the eye from a node's box.
fn distance_m(view: &View, node: &TreeNode) -> f64 {
    ((view.camera.position - node.centre).abs() - node.half).max(DVec3::ZERO).length()
}

#[test]
fn each_area_has_the_level_of_its_distance() {
    let switching = SwitchDistances::new(&DISTANCES_M, SwitchVolume::Box);
    let view = View { switching, ..street_view() };
    let mut tree = tree();
    let (_, selection) = converge(&mut tree, &view, 1000);
    let level_at = |node: &TreeNode| DISTANCES_M.iter().filter(|m| distance_m(&view, node) >= **m).count();
    let mut drawn = HashSet::new();
    for tile in &selection.draw_tiles {
        let node = tree.node(tile.node);
        let level = usize::from(DEPTH - node.id.level());
        assert!(level <= level_at(node), "{} is too coarse", node.id);
        if let Some(parent) = node.parent.map(|parent| tree.node(parent)) {
            assert!(level + 1 > level_at(parent), "{} is finer than its parent's distance asks for", node.id);
        }
        drawn.insert(level);
    }
    assert!(drawn.len() >= 3, "{drawn:?}");
}

#[test]
fn meshes_are_finer_levels_than_columns() {
    let mut tree = SceneTree::new(manifest(DEPTH));
    subtrees(DEPTH, |_| false).into_iter().for_each(|subtree| tree.merge(&with_meshes(subtree)));
    let at = |distances_m: &[f64]| {
        let view = View { switching: SwitchDistances::new(distances_m, SwitchVolume::Sphere), ..street_view() };
        let (_, selection) = converge(&mut tree.clone(), &view, 1000);
        selection.draw_tiles.iter().filter_map(|tile| tile.mesh_lod).collect::<HashSet<u8>>()
    };
    assert_eq!(at(&[1e6]), HashSet::from([0]), "nothing is far");
    assert_eq!(at(&[0.1, 0.2, 1e6]), HashSet::from([0, 2]), "the leaf around the eye, and the others");
    assert_eq!(at(&[300.0, 301.0, 302.0]), HashSet::from([0]), "columns beyond");
}
