//! Objects of every kind, alike in all forms of a file.

use super::map::{Map, read_bytes, read_limited, read_map};
use crate::osm::collect::Limits;
use insula_source::attributes::AttributeValue;
use insula_source::object::{CrsReference, Description, FeatureKind, Shape, SourceObject, Strip};
use insula_source::testing::{TestSink, gzip};

/// A map with an object of each form, parts, and multipolygons.
fn town() -> Map {
    let mut map = Map::default();
    map.nodes.push((1, [10, 20], vec![("natural", "tree"), ("height", "12 m")]));
    map.rectangle(10, [0, 0, 1000, 800], &[("building", "yes"), ("building:levels", "3"), ("name", "A & \"B\"")]);
    map.rectangle(11, [5000, 0, 6000, 800], &[("building", "house"), ("height", "9")]);
    map.rectangle(12, [5000, 0, 5500, 800], &[("building:part", "yes"), ("height", "9")]);
    map.rectangle(13, [5500, 0, 6000, 800], &[("building:part", "yes"), ("height", "6")]);
    map.way(20, &[1000, 1100, 1300], &[("highway", "primary"), ("lanes", "2")]);
    map.way(21, &[1000, 1100], &[("waterway", "stream")]);
    map.way(22, &[1000, 1101], &[("natural", "tree_row")]);
    map.way(23, &[1001, 1101], &[("barrier", "fence")]);
    map.rectangle(30, [0, 5000, 9000, 9000], &[]);
    map.rectangle(31, [1000, 6000, 2000, 7000], &[("landuse", "grass")]);
    map.relation(40, &[('w', 30, "outer"), ('w', 31, "inner")], &[("type", "multipolygon"), ("natural", "water")]);
    map
}

fn by_id<'s>(sink: &'s TestSink, id: &str) -> &'s SourceObject {
    sink.objects.iter().find(|object| object.id == id).unwrap_or_else(|| panic!("no {id} in {:?}", sink.objects))
}

/// Objects whose rings begin anywhere and turn in any direction.
fn unturned(objects: &[SourceObject]) -> Vec<SourceObject> {
    let mut objects = objects.to_vec();
    for object in &mut objects {
        if let Shape::Footprints(footprints) = &mut object.shape {
            let rings = footprints.iter_mut().flat_map(|footprint| &mut footprint.rings);
            for ring in rings {
                ring.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
                ring.dedup();
            }
        }
    }
    objects
}

#[test]
fn every_form_of_a_file_has_the_same_objects() {
    let map = town();
    let xml = map.xml().into_bytes();
    let expected = read_map(&map);
    assert_eq!(expected.objects.len(), 9);
    assert_eq!(expected.skipped, [("outline covered by its building parts", "way/11".to_owned())]);
    let files = [
        ("map.osm.gz", gzip(&xml)),
        ("map.osm.pbf", map.pbf(true)),
        ("MAP.OSM.PBF", map.pbf(false)),
        ("placed.osm.pbf", map.pbf_of_placed_ways()),
    ];
    for (name, bytes) in files {
        let (sink, read) = read_bytes(name, &bytes);
        read.unwrap();
        assert_eq!(unturned(&sink.objects), unturned(&expected.objects), "{name}");
        assert_eq!((&sink.skipped, &sink.problems), (&expected.skipped, &expected.problems), "{name}");
        assert_eq!(sink.bytes_done, bytes.len() as u64);
    }
    assert_eq!(expected.crs, [CrsReference::east_first("OGC:CRS84")]);
    assert_eq!(
        expected.described,
        [
            (Description::Attribution, "OpenStreetMap contributors".to_owned()),
            (Description::Licence, "ODbL 1.0".to_owned())
        ]
    );
}

#[test]
fn objects_have_their_identifiers_types_and_attributes() {
    let sink = read_map(&town());
    let house = by_id(&sink, "way/10");
    assert_eq!((house.kind, &*house.source_type), (FeatureKind::Building, "building=yes"));
    assert_eq!(house.attributes.get("building:levels"), Some(&AttributeValue::Integer(3)));
    assert_eq!(house.attributes.get("name"), Some(&AttributeValue::Text("A & \"B\"".to_owned())));
    let Shape::Footprints(plans) = &house.shape else { panic!("{house:?}") };
    assert_eq!(plans[0].rings, [[[0.0, 0.0], [1e-4, 0.0], [1e-4, 8e-5], [0.0, 8e-5], [0.0, 0.0]]]);
    let tree = by_id(&sink, "node/1");
    assert_eq!((tree.kind, &tree.shape), (FeatureKind::Vegetation, &Shape::Points(vec![[1e-6, 2e-6].into()])));
    assert_eq!(tree.attributes.get("height"), Some(&AttributeValue::Text("12 m".to_owned())));
    let road = by_id(&sink, "way/20");
    let points = vec![[0.0, 0.0], [5e-4, 0.0], [5.5e-4, 0.0]];
    assert_eq!(
        (road.kind, &road.shape),
        (FeatureKind::Road, &Shape::Strips(vec![Strip { points, width_m: 6.0, ..Strip::default() }]))
    );
    // The row is 66 m long.
    assert!(matches!(&by_id(&sink, "way/22").shape, Shape::Points(trees) if trees.len() == 9));
    let water = by_id(&sink, "relation/40");
    assert!(matches!(&water.shape, Shape::Footprints(plans) if plans.len() == 1 && plans[0].rings.len() == 2));
    assert_eq!(by_id(&sink, "way/12").parent.as_deref(), Some("way/11"));
}

#[test]
fn small_rounds_give_the_same_objects() {
    let map = town();
    let expected = read_map(&map);
    let sorted = |mut sink: TestSink| {
        sink.objects.sort_by(|a, b| a.id.cmp(&b.id));
        sink.skipped.sort();
        (sink.objects, sink.skipped)
    };
    let expected = sorted(expected);
    for (name, bytes) in [("map.osm", map.xml().into_bytes()), ("map.pbf", map.pbf(true))] {
        for (way_refs, member_refs) in [(1, 1), (5, 100), (100, 9)] {
            let limits = Limits { way_refs, member_refs, relation_refs: 1000 };
            let (sink, read) = read_limited(name, &bytes, limits, None);
            read.unwrap();
            assert_eq!(sorted(sink), expected, "{name} {limits:?}");
        }
    }
    let limits = Limits { way_refs: 100, member_refs: 1, relation_refs: 1 };
    let (sink, _) = read_limited("map.pbf", &map.pbf(true), limits, None);
    assert!(sink.skipped.contains(&("multipolygon too large", "relation/40".to_owned())), "{:?}", sink.skipped);
}

#[test]
fn what_an_extract_lacks_is_reported() {
    let mut map = Map::default();
    for (id, x) in [(1, 0), (2, 100), (3, 200), (4, 300)] {
        map.node(id, [x, x]);
    }
    map.way(1, &[1, 2, 9, 1], &[("building", "yes")]);
    map.way(2, &[1, 2, 9, 3, 4], &[("highway", "service")]);
    map.way(3, &[1, 8, 9], &[("highway", "service")]);
    map.way(4, &[1, 2, 3, 4], &[("building", "yes")]);
    map.way(5, &[1, 1], &[("highway", "service")]);
    map.way(6, &[1, 2, 1], &[("building", "yes")]);
    map.way(7, &[], &[("building", "yes")]);
    let sink = read_map(&map);
    let skipped: Vec<(&str, &str)> = sink.skipped.iter().map(|(reason, id)| (*reason, &**id)).collect();
    assert_eq!(
        skipped,
        [
            ("outside of the extract", "way/1"),
            ("outside of the extract", "way/3"),
            ("ring is not closed", "way/4"),
            ("line has fewer than two points", "way/5"),
            ("ring has fewer than three points", "way/6"),
            ("ring is not closed", "way/7"),
        ]
    );
    assert_eq!(sink.problems, [("partly outside of the extract", "way/2".to_owned())]);
    let Shape::Strips(strips) = &sink.objects[0].shape else { panic!("{:?}", sink.objects) };
    assert_eq!(strips.iter().map(|strip| strip.points.len()).collect::<Vec<_>>(), [2, 2]);
}

#[test]
fn objects_outside_of_a_wanted_area_are_left_out() {
    let (sink, read) = read_limited("map.pbf", &town().pbf(true), Limits::default(), Some([-1e-4, -1e-4, 5e-5, 5e-5]));
    read.unwrap();
    let ids: Vec<&str> = sink.objects.iter().map(|object| &*object.id).collect();
    assert_eq!(ids, ["node/1", "way/10", "way/20", "way/21", "way/22"]);
}

#[test]
fn maps_of_editors_are_read() {
    let text = r#"<osm version='0.6' generator='JOSM'>
        <node id='-1' lat='0' lon='0'/><node id='-2' lat='0' lon='0.001'/><node id='-3' action='modify' lat='0.001' lon='0'/>
        <node id='-4' action='delete' lat='0' lon='0'><tag k='natural' v='tree'/></node>
        <node id='5'/>
        <way id='-7'><nd ref='-1'/><nd ref='-2'/><nd ref='-3'/><nd ref='-1'/><tag k='building' v='yes'/></way>
        <way id='-8' visible='false'><nd ref='-1'/><nd ref='-2'/><tag k='highway' v='service'/></way>
    </osm>"#;
    let (sink, read) = read_bytes("map.osm", text.as_bytes());
    read.unwrap();
    let ids: Vec<&str> = sink.objects.iter().map(|object| &*object.id).collect();
    assert_eq!((ids, sink.problems.len(), sink.skipped.len()), (vec!["way/-7"], 0, 0));
}

#[test]
fn positions_may_be_where_ways_and_relations_name_nodes() {
    let place = |[lon, lat]: [&str; 2]| format!("lat='{lat}' lon='{lon}'");
    let corners = [["0", "0"], ["0.001", "0"], ["0.001", "0.001"], ["0", "0.001"], ["0", "0"]];
    let refs: String = (0..5).map(|i| format!("<nd ref='{}' {}/>", i % 4 + 1, place(corners[i]))).collect();
    let open = |corners: &[[&str; 2]]| -> String { corners.iter().map(|at| format!("<nd {}/>", place(*at))).collect() };
    let text = format!(
        "<osm><way id='1'><bounds minlat='0' minlon='0' maxlat='0.001' maxlon='0.001'/>{refs}<tag k='building' v='yes'/></way>
        <way id='2'><nd ref='1' {}/><nd ref='9'/><nd ref='3' {}/><nd ref='4' {}/><tag k='highway' v='service'/></way>
        <relation id='5'><member type='node' ref='1' lat='1' lon='1'/>
            <member type='way' ref='8' role='outer'>{}</member><member type='way' ref='9' role='outer'>{}</member>
            <tag k='type' v='multipolygon'/><tag k='building' v='yes'/></relation>
        <relation id='6'><member type='way' ref='8' role='outer'>{}</member><member type='way' ref='10' role='outer'><nd/><nd {}/></member>
            <tag k='type' v='multipolygon'/><tag k='building' v='yes'/></relation>
        <relation id='7'><member type='way' ref='11' role='outer'/><tag k='type' v='multipolygon'/><tag k='building' v='yes'/></relation>
        </osm>",
        place(corners[0]),
        place(corners[2]),
        place(corners[3]),
        open(&corners[..3]),
        open(&corners[2..]),
        open(&corners[..3]),
        place(corners[3]),
    );
    let (sink, read) = read_bytes("map.osm", text.as_bytes());
    read.unwrap();
    let Shape::Footprints(plans) = &by_id(&sink, "way/1").shape else { panic!("{:?}", sink.objects) };
    assert_eq!(plans[0].rings[0], [[0.0, 0.0], [0.001, 0.0], [0.001, 0.001], [0.0, 0.001], [0.0, 0.0]]);
    let Shape::Footprints(plans) = &by_id(&sink, "relation/5").shape else { panic!("{:?}", sink.objects) };
    assert_eq!((plans.len(), plans[0].rings[0].len()), (1, 5));
    assert_eq!(sink.objects.len(), 3, "and a road");
    let skipped: Vec<(&str, &str)> = sink.skipped.iter().map(|(reason, id)| (*reason, &**id)).collect();
    let outside = "outside of the extract";
    assert_eq!(skipped, [(outside, "relation/6"), (outside, "relation/7")]);
    assert_eq!(sink.problems, [("partly outside of the extract", "way/2".to_owned())]);
}
