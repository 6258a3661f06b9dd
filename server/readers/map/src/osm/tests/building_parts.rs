//! Which outlines of buildings are left out, and whose the parts are.

use super::map::{Map, read_map};
use insula_source::attributes::AttributeValue;
use insula_source::object::{FeatureKind, Shape, SourceObject};
use insula_source::testing::TestSink;

type Tag = (&'static str, &'static str);
/// Bounds and tags of a part.
type Part = ([i64; 4], &'static [Tag]);

const PART: (&str, &str) = ("building:part", "yes");

/// Identifiers of the buildings, and those of the parts with their parents.
fn found(sink: &TestSink) -> (Vec<&str>, Vec<(&str, Option<&str>)>) {
    let of = |kind| sink.objects.iter().filter(move |object| object.kind == kind);
    let buildings = of(FeatureKind::Building).map(|object| &*object.id).collect();
    (buildings, of(FeatureKind::BuildingPart).map(|object| (&*object.id, object.parent.as_deref())).collect())
}

/// An outline of 1000 by 1000 with tags, and parts of it.
fn building(tags: &[Tag], parts: &[Part]) -> TestSink {
    let mut map = Map::default();
    map.rectangle(1, [0, 0, 1000, 1000], &[&[("building", "office")], tags].concat());
    for (id, (bounds, tags)) in (2..).zip(parts) {
        map.rectangle(id, *bounds, &[&[PART], *tags].concat());
    }
    read_map(&map)
}

#[test]
fn an_outline_that_its_parts_cover_is_left_out() {
    let sink = building(&[], &[([0, 0, 500, 1000], &[]), ([500, 0, 1000, 1000], &[("building:colour", "red")])]);
    assert_eq!(found(&sink), (vec![], vec![("way/2", Some("way/1")), ("way/3", Some("way/1"))]));
    assert_eq!(sink.skipped, [("outline covered by its building parts", "way/1".to_owned())]);
    let use_of_part = sink.objects[1].attributes.get("building");
    assert_eq!(use_of_part, Some(&AttributeValue::Text("office".to_owned())), "inherited");
}

#[test]
fn an_outline_is_kept_where_its_parts_are_not_all_of_it() {
    // A tower.
    let sink = building(&[("height", "30")], &[([0, 0, 300, 300], &[("height", "60")])]);
    assert_eq!(found(&sink), (vec!["way/1"], vec![("way/2", Some("way/1"))]));
    // Most of the building: an outline as high as its highest part tells the height of the whole.
    let most: &[Part] = &[([0, 0, 700, 1000], &[("height", "20")])];
    assert_eq!(found(&building(&[("height", "20")], most)).0.len(), 0);
    assert_eq!(found(&building(&[("height", "12")], most)).0.len(), 1);
    assert_eq!(found(&building(&[], most)).0.len(), 1);
    // Storeys on top of the outline.
    let upper: &[Part] = &[([0, 0, 1000, 1000], &[("building:levels", "7"), ("building:min_level", "2")])];
    assert_eq!(found(&building(&[("building:levels", "2")], upper)).0.len(), 1);
    // A part over a passage.
    let passage: &[Part] = &[([0, 0, 700, 1000], &[]), ([700, 0, 1000, 1000], &[("min_height", "4")])];
    assert_eq!(found(&building(&[], passage)).0.len(), 0);
}

#[test]
fn a_storey_that_is_tagged_as_outline_and_part_is_kept() {
    let below: &[Part] = &[([0, 0, 1000, 1000], &[("building:levels", "7")])];
    let storey = [PART, ("building:min_level", "7"), ("building:levels", "8")];
    assert_eq!(found(&building(&storey, below)).0, ["way/1"]);
    // An outline on the ground is left out, however it is tagged.
    assert_eq!(found(&building(&[PART], below)).0.len(), 0);
}

#[test]
fn a_part_belongs_to_the_outline_in_which_most_of_it_lies() {
    let mut map = Map::default();
    map.rectangle(1, [0, 0, 1000, 1000], &[("building", "yes")]).rectangle(
        2,
        [1000, 0, 2000, 1000],
        &[("building", "yes")],
    );
    map.rectangle(3, [900, 0, 1900, 1000], &[PART]).rectangle(4, [5000, 0, 6000, 1000], &[PART]);
    // Touches only.
    map.rectangle(5, [-500, 0, 0, 1000], &[PART]);
    let sink = read_map(&map);
    let parts = vec![("way/3", Some("way/2")), ("way/4", None), ("way/5", None)];
    assert_eq!(found(&sink), (vec!["way/1"], parts));
}

#[test]
fn a_relation_names_the_outline_of_parts() {
    let mut map = Map::default();
    map.rectangle(1, [0, 0, 1000, 1000], &[("building", "yes")]).rectangle(
        2,
        [0, 0, 1000, 1000],
        &[("building", "yes")],
    );
    map.rectangle(3, [0, 0, 1000, 1000], &[PART]);
    map.rectangle(4, [5000, 0, 6000, 1000], &[]);
    map.relation(6, &[('w', 4, "outer")], &[("type", "multipolygon"), PART]);
    map.relation(
        7,
        &[('w', 2, "outline"), ('w', 3, "part"), ('r', 6, "part"), ('r', 7, "part")],
        &[("type", "building")],
    );
    let sink = read_map(&map);
    assert_eq!(found(&sink), (vec!["way/1"], vec![("way/3", Some("way/2")), ("relation/6", Some("way/2"))]));
}

#[test]
fn an_outline_with_a_court_is_covered_by_the_parts_around_it() {
    let mut map = Map::default();
    map.rectangle(1, [0, 0, 1000, 1000], &[]).rectangle(2, [100, 100, 900, 900], &[]);
    map.relation(1, &[('w', 1, "outer"), ('w', 2, "inner")], &[("type", "multipolygon"), ("building", "yes")]);
    map.rectangle(3, [0, 0, 100, 1000], &[PART]).rectangle(4, [900, 0, 1000, 1000], &[PART]);
    map.rectangle(5, [0, 0, 1000, 100], &[PART]).rectangle(6, [0, 900, 1000, 1000], &[PART]);
    // A pavilion in the court.
    map.rectangle(7, [400, 400, 500, 500], &[PART]);
    let sink = read_map(&map);
    assert_eq!(sink.skipped, [("outline covered by its building parts", "relation/1".to_owned())]);
    let parents: Vec<Option<&str>> = found(&sink).1.into_iter().map(|(_, parent)| parent).collect();
    assert_eq!(parents, [Some("relation/1"), Some("relation/1"), Some("relation/1"), Some("relation/1"), None]);
}

/// Whether each area stands on others, by identifier.
fn support(sink: &TestSink) -> Vec<(&str, bool)> {
    let is_supported = |object: &SourceObject| match &object.shape {
        Shape::Footprints(plans) => plans[0].is_supported,
        other => panic!("{other:?}"),
    };
    sink.objects.iter().map(|object| (&*object.id, is_supported(object))).collect()
}

#[test]
fn a_roof_needs_no_posts_where_what_it_stands_on_is_mapped() {
    const COLUMN: &[Tag] = &[("building:part", "column")];
    let roof = |parts: &[Part]| {
        let mut map = Map::default();
        map.rectangle(1, [0, 0, 1000, 1000], &[("building", "roof")]);
        for (id, (bounds, tags)) in (2..).zip(parts) {
            map.rectangle(id, *bounds, tags);
        }
        read_map(&map)
    };
    assert_eq!(support(&roof(&[])), [("way/1", false)]);
    assert_eq!(support(&roof(&[([10, 10, 30, 30], COLUMN)])), [("way/1", true), ("way/2", false)]);
    assert_eq!(support(&roof(&[([1500, 10, 1530, 30], COLUMN)])), [("way/1", false), ("way/2", false)]);
    // A part that is the whole roof stands for it.
    let part: &[Tag] = &[("building:part", "roof"), ("height", "6")];
    assert_eq!(support(&roof(&[([0, 0, 1000, 1000], part)])), [("way/2", false)]);
    let both: &[Part] = &[([0, 0, 1000, 1000], part), ([10, 10, 30, 30], COLUMN)];
    assert_eq!(support(&roof(both)), [("way/2", true), ("way/3", false)]);
    // The roof over a part of a house does not stand for the house.
    let mut map = Map::default();
    map.rectangle(1, [0, 0, 1000, 1000], &[("building", "office"), ("height", "9")]);
    map.rectangle(2, [0, 0, 1000, 1000], &[("building:part", "roof"), ("height", "10")]);
    assert_eq!(support(&read_map(&map)), [("way/1", true), ("way/2", false)]);
}
