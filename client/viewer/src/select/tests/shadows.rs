//! Shadow casters.

use super::*;
use shadow_casters::{ShadowCasters, shadow_casters};

/// The nodes in which the way from `ground` (relative to the city's origin) to the sun lies, up to 30 m: the leaf at each metre.
fn leaves_towards_sun(ground: DVec3, sun: DVec3) -> impl Iterator<Item = TileId> {
    let points = (1..30).map(move |up| ground + sun * (f64::from(up) / sun.z));
    let inside = points.take_while(|p| p.x.min(p.y) >= 0.0 && p.x.max(p.y) < SIDE_M);
    inside.map(|p| TileId::new(DEPTH, (p.x / 64.0) as u32, (p.y / 64.0) as u32).unwrap())
}

#[test]
fn shadow_casters_cover_the_way_from_receivers_to_the_sun() {
    let mut tree = tree();
    let view = view([300.0, 300.0, 25.0], [700.0, 900.0, 0.0]);
    let sun = DVec3::new(0.7, -0.5, 0.25).normalize_or(DVec3::Z);
    let mut all = shadow_casters(&view, sun, &tree, None);
    while !all.requests.is_empty() {
        all.requests.iter().for_each(|w| load(&mut tree, w.key));
        all = shadow_casters(&view, sun, &tree, None);
    }
    let all = ids_of(&tree, &all.nodes);
    // The coarse columns of a node would be seen where it has no child.
    let is_ancestor = |a: &TileId, of: &TileId| a.level() < of.level() && of.ancestor(a.level()) == Some(*a);
    assert!(all.iter().all(|a| !all.iter().any(|b| is_ancestor(a, b))));
    let contains = |casters: &[TileId], leaf: TileId| (2..=DEPTH).any(|l| casters.contains(&leaf.ancestor(l).unwrap()));
    let planes = view.planes();
    let ground = |i: u32| DVec3::new(f64::from(i % 200) * 10.0 + 5.0, f64::from(i / 200) * 10.0 + 5.0, 0.1);
    let is_in_view = |p: &DVec3| planes.iter().all(|plane| plane.normal.dot(ORIGIN + *p) + plane.offset >= 0.0);
    let mut checked = 0;
    for ground in (0..40_000).map(ground).filter(is_in_view) {
        for leaf in leaves_towards_sun(ground, sun) {
            assert!(contains(&all, leaf), "{ground} {leaf}");
            checked += 1;
        }
    }
    assert!(checked > 10_000, "{checked}");
    assert!(all.len() < 400 && all.iter().any(|id| id.level() == DEPTH), "{} of {}", all.len(), tree.len());

    let receiver = tree.find(TileId::new(DEPTH, 9, 11).unwrap()).unwrap();
    let selection = Selection { unoccluded: vec![receiver], ..Selection::default() };
    let of_one = ids_of(&tree, &shadow_casters(&view, sun, &tree, Some(&selection)).nodes);
    assert!(!of_one.is_empty() && of_one.len() * 4 < all.len(), "{} of {}", of_one.len(), all.len());
    for leaf in leaves_towards_sun(DVec3::new(9.5 * 64.0, 11.5 * 64.0, 0.1), sun) {
        assert!(contains(&of_one, leaf), "{leaf}");
    }

    let within_budget = shadow_casters(&View { budget_pages: 200, ..view }, sun, &tree, None).nodes.len();
    assert!(within_budget > 0 && within_budget < all.len(), "{within_budget}");
    let night = DVec3::new(0.6, 0.0, -0.8);
    assert_eq!(shadow_casters(&view, night, &tree, None), ShadowCasters::default());
}
