//! Multipolygons: unordered, touching, nested and broken ones.

use super::map::{Map, read_map};
use insula_source::object::Shape;
use insula_source::testing::TestSink;

const WATER: &[(&str, &str)] = &[("type", "multipolygon"), ("natural", "water")];

/// Number of rings and area in square units, for each polygon of the only object.
fn polygons(sink: &TestSink) -> Vec<(usize, i64)> {
    let [object] = &sink.objects[..] else { panic!("{:?} {:?}", sink.objects, sink.skipped) };
    let Shape::Footprints(plans) = &object.shape else { panic!("{object:?}") };
    let area = |ring: &[[f64; 2]]| {
        assert_eq!(ring.first(), ring.last(), "closed");
        let cross = |pair: &[[f64; 2]]| pair[0][0] * pair[1][1] - pair[1][0] * pair[0][1];
        (ring.windows(2).map(cross).sum::<f64>().abs() * 0.5e14).round() as i64
    };
    let polygon = |rings: &[Vec<[f64; 2]>]| {
        (rings.len(), area(&rings[0]) - rings[1..].iter().map(|ring| area(ring)).sum::<i64>())
    };
    let mut found: Vec<(usize, i64)> = plans.iter().map(|plan| polygon(&plan.rings)).collect();
    found.sort_unstable();
    found
}

/// A grid of nodes with the identifiers `10 * x + y`.
fn grid() -> Map {
    let mut map = Map::default();
    for x in 0..10 {
        for y in 0..10 {
            map.node(10 * x + y, [100 * x, 100 * y]);
        }
    }
    map
}

#[test]
fn rings_are_put_together_from_pieces_in_any_order_and_direction() {
    let mut map = grid();
    map.way(1, &[0, 90], &[]).way(2, &[9, 0], &[]).way(3, &[9, 99, 90], &[]);
    map.way(4, &[22, 52], &[]).way(5, &[22, 25, 55, 52], &[]);
    map.relation(1, &[('w', 3, "outer"), ('w', 5, "inner"), ('w', 1, ""), ('w', 2, "outer"), ('w', 4, "inner")], WATER);
    assert_eq!(polygons(&read_map(&map)), [(2, 810_000 - 90_000)]);
}

#[test]
fn holes_that_share_a_side_become_one() {
    let mut map = grid();
    map.way(1, &[0, 90, 99, 9, 0], &[]);
    map.way(2, &[22, 42, 44, 24, 22], &[]).way(3, &[42, 62, 64, 44, 42], &[]);
    map.relation(1, &[('w', 1, "outer"), ('w', 2, "inner"), ('w', 3, "inner")], WATER);
    assert_eq!(polygons(&read_map(&map)), [(2, 810_000 - 80_000)]);
}

#[test]
fn rings_that_touch_in_a_node_are_rings_of_their_own() {
    let mut map = grid();
    // Two outer rings that touch, one hole that touches both another one and its outer ring.
    map.way(1, &[0, 40, 44, 4, 0], &[]).way(2, &[44, 84, 88, 48, 44], &[]);
    map.way(3, &[44, 65, 66, 56, 44], &[]).way(4, &[66, 76, 77, 67, 66], &[]);
    map.relation(1, &[('w', 1, "outer"), ('w', 2, "outer"), ('w', 3, "inner"), ('w', 4, "inner")], WATER);
    assert_eq!(polygons(&read_map(&map)), [(1, 160_000), (3, 160_000 - 30_000)]);
    // One way that meets itself.
    let mut map = grid();
    map.way(1, &[0, 40, 44, 84, 88, 48, 44, 4, 0], &[]);
    map.relation(1, &[('w', 1, "outer")], WATER);
    assert_eq!(polygons(&read_map(&map)), [(1, 160_000), (1, 160_000)]);
}

#[test]
fn islands_in_holes_are_outer_rings_whatever_the_roles_say() {
    let mut map = grid();
    map.way(1, &[0, 90, 99, 9, 0], &[]).way(2, &[11, 81, 88, 18, 11], &[]).way(3, &[33, 53, 55, 35, 33], &[]);
    map.relation(1, &[('w', 3, "inner"), ('w', 2, "outer"), ('w', 1, "")], WATER);
    assert_eq!(polygons(&read_map(&map)), [(1, 40_000), (2, 810_000 - 490_000)]);
}

#[test]
fn a_way_that_is_named_twice_counts_once() {
    let mut map = grid();
    map.way(1, &[0, 90, 99, 9, 0], &[]);
    map.relation(1, &[('w', 1, "outer"), ('w', 1, "outer"), ('n', 1, "label"), ('r', 1, "outer")], WATER);
    assert_eq!(polygons(&read_map(&map)), [(1, 810_000)]);
}

#[test]
fn broken_multipolygons_are_left_out() {
    let mut map = grid();
    map.way(1, &[0, 90, 99], &[]).way(2, &[0, 90, 99, 9, 0], &[]).way(3, &[0, 90, 99, 9, 0], &[]).way(
        4,
        &[0, 500, 9, 0],
        &[],
    );
    for (id, ways) in [(1, &[1][..]), (2, &[2, 77]), (3, &[2, 3]), (4, &[4]), (5, &[]), (6, &[2, 1])] {
        let members: Vec<(char, i64, &str)> = ways.iter().map(|way| ('w', *way, "outer")).collect();
        map.relation(id, &members, WATER);
    }
    map.relation(7, &[('r', 7, "outer"), ('r', 1, "inner")], WATER);
    let sink = read_map(&map);
    let skipped: Vec<(&str, &str)> = sink.skipped.iter().map(|(reason, id)| (*reason, &**id)).collect();
    assert_eq!(
        skipped,
        [
            ("ring is not closed", "relation/1"),
            ("outside of the extract", "relation/2"),
            ("ring has fewer than three points", "relation/3"),
            ("outside of the extract", "relation/4"),
            ("multipolygon without ways", "relation/5"),
            ("ring is not closed", "relation/6"),
            ("multipolygon without ways", "relation/7"),
        ]
    );
    assert!(sink.objects.is_empty());
}

#[test]
fn tags_on_the_outer_way_are_those_of_the_multipolygon() {
    let mut map = grid();
    map.way(1, &[0, 90, 99, 9, 0], &[("building", "school")]).way(2, &[22, 52, 55, 25, 22], &[("landuse", "grass")]);
    map.relation(1, &[('w', 1, "outer"), ('w', 2, "inner")], &[("type", "multipolygon")]);
    let mut sink = read_map(&map);
    assert_eq!(sink.objects.remove(0).id, "way/2");
    assert_eq!(sink.objects[0].id, "relation/1");
    assert_eq!((&*sink.objects[0].source_type, sink.skipped.len()), ("building=school", 0));
    assert_eq!(polygons(&sink), [(2, 810_000 - 90_000)]);
}

#[test]
fn a_building_with_its_tags_on_the_relation_and_on_its_outer_way_is_there_once() {
    let mut map = grid();
    map.way(1, &[0, 90, 99, 9, 0], &[("building", "yes")]).way(2, &[22, 52, 55, 25, 22], &[]);
    map.relation(1, &[('w', 1, "outer"), ('w', 2, "inner")], &[("type", "multipolygon"), ("building", "retail")]);
    let sink = read_map(&map);
    assert_eq!(sink.skipped, [("outer ring with the tags of its multipolygon", "way/1".to_owned())]);
    assert_eq!(polygons(&sink), [(2, 810_000 - 90_000)]);
    // Other tags are another object.
    map.ways[0].2 = vec![("landuse", "retail")];
    assert_eq!(read_map(&map).objects.len(), 2);
}
