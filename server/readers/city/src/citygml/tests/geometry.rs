//! Which surfaces of an object are read.

use super::*;
use crate::citygml::gather::BAD_MATRIX;
use insula_source::affine::TRANSPOSED;
use insula_source::object::{CrsReference, FeatureKind, SurfaceRole};
use insula_source::problems::{INTERIOR, NO_CRS, SEVERAL_SYSTEMS};

#[test]
fn solid_of_references_does_not_double_the_boundary() {
    let content = format!(
        "<bldg:lod2Solid>{}</bldg:lod2Solid>{}{}",
        solid_of(&["p1", "p2"]),
        bounded_by("RoofSurface", &multi_surface(&[polygon("p1", 1)])),
        bounded_by("WallSurface", &multi_surface(&[polygon("p2", 2)])),
    );
    let sink = read_building(&content);
    let roles: Vec<_> = polygons(&sink.objects[0]).iter().map(|surface| surface.role).collect();
    assert_eq!(roles, [SurfaceRole::Roof, SurfaceRole::Wall]);
    assert_eq!(sink.objects[0].lod, Some(2.0));
    assert!(sink.problems.is_empty());
}

#[test]
fn boundary_of_references_gives_the_roles() {
    let reference = r##"<gml:MultiSurface><gml:surfaceMember xlink:href="#p1"/></gml:MultiSurface>"##;
    let content = format!(
        "<bldg:lod2Solid>{}</bldg:lod2Solid>{}",
        solid(&[polygon("p1", 1), polygon("p2", 2)]),
        bounded_by("RoofSurface", reference),
    );
    let sink = read_building(&content);
    let roles: Vec<_> = polygons(&sink.objects[0]).iter().map(|surface| surface.role).collect();
    assert_eq!(roles, [SurfaceRole::Roof, SurfaceRole::Other]);
}

#[test]
fn copies_and_second_models_of_a_boundary_are_left_out() {
    let boundary = bounded_by("RoofSurface", &multi_surface(&[polygon("p1", 1), polygon("p2", 2)]));
    let copy = format!("<bldg:lod2Solid>{}</bldg:lod2Solid>{boundary}", solid(&[polygon("q1", 1), polygon("q3", 3)]));
    assert_eq!(corners(&read_building(&copy).objects[0]), [1.0, 2.0, 3.0]);
    let second = format!("<bldg:lod2Solid>{}</bldg:lod2Solid>{boundary}", solid(&[polygon("q1", 5), polygon("q3", 6)]));
    assert_eq!(corners(&read_building(&second).objects[0]), [1.0, 2.0]);
    let more: Vec<_> = (5..9).map(|x| polygon("", x)).collect();
    let whole = format!("<bldg:lod2Solid>{}</bldg:lod2Solid>{boundary}", solid(&more));
    assert_eq!(corners(&read_building(&whole).objects[0]), [5.0, 6.0, 7.0, 8.0]);
}

#[test]
fn best_level_that_has_surfaces_counts() {
    let lod =
        |level: u32, geometry: &str| format!("<bldg:lod{level}MultiSurface>{geometry}</bldg:lod{level}MultiSurface>");
    let broken = multi_surface(&["<gml:Polygon/>".into()]);
    let content =
        lod(1, &multi_surface(&[polygon("a", 1)])) + &lod(2, &multi_surface(&[polygon("b", 2)])) + &lod(3, &broken);
    let sink = read_building(&content);
    assert_eq!((sink.objects[0].lod, corners(&sink.objects[0])), (Some(2.0), vec![2.0]));
    let flat = "<bldg:lod0FootPrint>".to_owned()
        + &multi_surface(&[polygon("a", 1)])
        + "</bldg:lod0FootPrint><bldg:lod0RoofEdge>"
        + &multi_surface(&[polygon("b", 2)])
        + "</bldg:lod0RoofEdge>";
    let sink = read_building(&flat);
    assert_eq!((sink.objects[0].lod, corners(&sink.objects[0])), (Some(0.0), vec![1.0]));
}

#[test]
fn parts_are_objects_and_keep_their_surfaces() {
    let part = |id: &str, x| {
        let geometry = solid(&[polygon(&format!("{id}p"), x)]);
        format!(
            r#"<bldg:consistsOfBuildingPart><bldg:BuildingPart gml:id="{id}"><bldg:lod2Solid>{geometry}</bldg:lod2Solid></bldg:BuildingPart></bldg:consistsOfBuildingPart>"#
        )
    };
    let content =
        format!("<bldg:lod2Solid>{}</bldg:lod2Solid>{}{}", solid_of(&["ap", "bp"]), part("a", 1), part("b", 2));
    let sink = read_building(&content);
    let summary: Vec<_> = sink.objects.iter().map(|o| (&*o.id, o.parent.as_deref(), o.kind, corners(o))).collect();
    let expected = [
        ("b", None, FeatureKind::Building, vec![]),
        ("a", Some("b"), FeatureKind::BuildingPart, vec![1.0]),
        ("b", Some("b"), FeatureKind::BuildingPart, vec![2.0]),
    ];
    assert_eq!(summary, expected);
    // A block of a lower level than the parts would hide them; surfaces of the same level are kept.
    let block = format!("<bldg:lod1Solid>{}</bldg:lod1Solid>{}", solid(&[polygon("x", 9)]), part("a", 1));
    assert!(corners(&read_building(&block).objects[0]).is_empty());
    let own =
        format!("<bldg:lod2Solid>{}</bldg:lod2Solid>{}", solid(&[polygon("x", 9), polygon("y", 1)]), part("a", 1));
    assert_eq!(corners(&read_building(&own).objects[0]), [9.0]);
}

#[test]
fn installations_belong_to_the_building_and_interiors_do_not() {
    let installation = |property: &str, x| {
        format!(
            "<bldg:{property}><bldg:BuildingInstallation><bldg:lod3Geometry>{}</bldg:lod3Geometry></bldg:BuildingInstallation></bldg:{property}>",
            multi_surface(&[polygon("i", x)])
        )
    };
    let content = format!(
        "<bldg:lod2Solid>{}</bldg:lod2Solid>{}{}{}",
        solid(&[polygon("p", 1)]),
        installation("outerBuildingInstallation", 2),
        installation("interiorBuildingInstallation", 3),
        installation("interiorRoom", 4),
    );
    let sink = read_building(&content);
    assert_eq!((corners(&sink.objects[0]), sink.objects[0].lod), (vec![1.0, 2.0], Some(2.0)));
    assert_eq!(sink.problems, [(INTERIOR, "b".to_owned())]);
}

#[test]
fn windows_have_roles_and_closures_count_only_alone() {
    let window = format!(
        "<bldg:opening><bldg:Window><bldg:lod3MultiSurface>{}</bldg:lod3MultiSurface></bldg:Window></bldg:opening>",
        multi_surface(&[polygon("w", 1)])
    );
    let wall = format!(
        "<bldg:boundedBy><bldg:WallSurface><bldg:lod3MultiSurface>{}</bldg:lod3MultiSurface>{window}</bldg:WallSurface></bldg:boundedBy>",
        multi_surface(&[polygon("p", 2)])
    );
    let sink = read_building(&wall);
    let roles: Vec<_> = polygons(&sink.objects[0]).iter().map(|surface| surface.role).collect();
    assert_eq!(roles, [SurfaceRole::Wall, SurfaceRole::Window]);
    let closure = bounded_by("ClosureSurface", &multi_surface(&[polygon("c", 3)]));
    let with_wall = bounded_by("WallSurface", &multi_surface(&[polygon("d", 4)])) + &closure;
    let with_solid = format!("{with_wall}<bldg:lod2Solid>{}</bldg:lod2Solid>", solid_of(&["c", "d"]));
    assert_eq!(corners(&read_building(&closure).objects[0]), [3.0]);
    assert_eq!(corners(&read_building(&with_wall).objects[0]), [4.0]);
    assert_eq!(corners(&read_building(&with_solid).objects[0]), [4.0]);
}

#[test]
fn orientable_surfaces_turn_and_holes_follow() {
    let ring = |ring: &str, text: &str| {
        format!("<gml:{ring}><gml:LinearRing><gml:posList>{text}</gml:posList></gml:LinearRing></gml:{ring}>")
    };
    let polygon = ring("exterior", "0 0 0 9 0 0 9 9 0 0 0 0") + &ring("interior", "5 1 0 5 2 0 6 2 0 5 1 0");
    let content = format!(
        r#"<bldg:lod2MultiSurface><gml:MultiSurface><gml:surfaceMember><gml:OrientableSurface orientation="-"><gml:baseSurface><gml:Polygon>{polygon}</gml:Polygon></gml:baseSurface></gml:OrientableSurface></gml:surfaceMember></gml:MultiSurface></bldg:lod2MultiSurface>"#
    );
    let sink = read_building(&content);
    let surface = &polygons(&sink.objects[0])[0];
    let expected = [[9.0, 9.0, 0.0], [9.0, 0.0, 0.0], [0.0; 3], [6.0, 2.0, 0.0], [5.0, 2.0, 0.0], [5.0, 1.0, 0.0]];
    assert_eq!((&surface.points[..], &surface.hole_starts[..]), (&expected[..], &[3][..]));
}

#[test]
fn triangles_share_their_vertices() {
    let triangle = |text: &str| {
        format!(
            "<gml:Triangle><gml:exterior><gml:LinearRing><gml:posList>{text}</gml:posList></gml:LinearRing></gml:exterior></gml:Triangle>"
        )
    };
    let triangles =
        triangle("0 0 0 1 0 0 1 1 0 0 0 0") + &triangle("0 0 0 1 1 0 0 1 0") + &triangle("0 0 0 0 0 0 1 1 0");
    let relief = format!(
        r#"<dem:ReliefFeature gml:id="r"><dem:lod>2</dem:lod><dem:reliefComponent><dem:TINRelief><dem:lod>2</dem:lod><dem:extent>{}</dem:extent><dem:tin><gml:TriangulatedSurface><gml:trianglePatches>{triangles}</gml:trianglePatches></gml:TriangulatedSurface></dem:tin></dem:TINRelief></dem:reliefComponent></dem:ReliefFeature>"#,
        polygon("extent", 50)
    );
    let sink = read_2(&member(&relief));
    let Shape::Surfaces { polygons, meshes } = &sink.objects[0].shape else { panic!("{:?}", sink.objects) };
    assert!(polygons.is_empty());
    assert_eq!((meshes[0].positions.len(), &meshes[0].triangles[..]), (4, &[[0, 1, 2], [0, 2, 3]][..]));
    assert_eq!((sink.objects[0].kind, sink.objects[0].lod), (FeatureKind::Relief, Some(2.0)));
    assert_eq!(sink.problems, [("ring has fewer than three points", "r".into())]);
    let other = "<dem:ReliefFeature gml:id='r'><dem:reliefComponent><dem:RasterRelief/></dem:reliefComponent></dem:ReliefFeature>";
    assert_eq!(read_2(&member(other)).skipped, [("relief without triangles", "r".into())]);
}

#[test]
fn templates_are_placed_also_by_reference_and_before_they_are_defined() {
    let tree = |id: &str, x: u32, template: &str| {
        member(&format!(
            r#"<veg:SolitaryVegetationObject gml:id="{id}"><veg:lod3ImplicitRepresentation><core:ImplicitGeometry><core:transformationMatrix>2 0 0 0 0 2 0 0 0 0 2 0 0 0 0 1</core:transformationMatrix>{template}<core:referencePoint><gml:Point><gml:pos>{x} 100 5</gml:pos></gml:Point></core:referencePoint></core:ImplicitGeometry></veg:lod3ImplicitRepresentation></veg:SolitaryVegetationObject>"#
        ))
    };
    let by_reference = r##"<core:relativeGMLGeometry xlink:href="#template"/>"##;
    let members =
        multi_surface(&[polygon("t", 1)]).replacen("<gml:MultiSurface>", r#"<gml:MultiSurface gml:id="template">"#, 1);
    let inline = format!("<core:relativeGMLGeometry>{members}</core:relativeGMLGeometry>");
    let sink = read_2(&(tree("early", 10, by_reference) + &tree("a", 20, &inline) + &tree("late", 30, by_reference)));
    let summary: Vec<_> = sink.objects.iter().map(|o| (&*o.id, polygons(o)[0].points[0])).collect();
    assert_eq!(summary, [("a", [22.0, 100.0, 5.0]), ("late", [32.0, 100.0, 5.0]), ("early", [12.0, 100.0, 5.0])]);
    assert!(sink.problems.is_empty() && sink.skipped.is_empty());
    for (matrix, kind) in [("2 0 0 0 2", BAD_MATRIX), ("0 2 0 0 -2 0 0 0 0 0 2 0 1 0 0 1", TRANSPOSED)] {
        let odd = tree("odd", 20, &inline).replace("2 0 0 0 0 2 0 0 0 0 2 0 0 0 0 1", matrix);
        assert_eq!(read_2(&odd).problems, [(kind, "odd".to_owned())]);
    }
}

#[test]
fn roads_are_made_of_their_areas() {
    let area = |property: &str, class: &str, x| {
        format!(
            "<tran:{property}><tran:{class}><tran:lod2MultiSurface>{}</tran:lod2MultiSurface></tran:{class}></tran:{property}>",
            multi_surface(&[polygon("a", x)])
        )
    };
    let road = format!(
        r#"<tran:Road gml:id="r"><tran:lod1MultiSurface>{}</tran:lod1MultiSurface>{}{}</tran:Road>"#,
        multi_surface(&[polygon("p", 1)]),
        area("trafficArea", "TrafficArea", 2),
        area("auxiliaryTrafficArea", "AuxiliaryTrafficArea", 3),
    );
    let sink = read_2(&member(&road));
    assert_eq!((sink.objects[0].kind, corners(&sink.objects[0])), (FeatureKind::Road, vec![2.0, 3.0]));
}

#[test]
fn reads_version_3_with_default_namespace() {
    let text = format!(
        r##"<CityModel xmlns="http://www.opengis.net/citygml/3.0" xmlns:c="http://www.opengis.net/citygml/construction/3.0"
        xmlns:b="http://www.opengis.net/citygml/building/3.0" xmlns:gml="http://www.opengis.net/gml/3.2" xmlns:xlink="http://www.w3.org/1999/xlink">
        <cityObjectMember><b:Building gml:id="b"><boundary><c:WallSurface><c:fillingSurface><c:WindowSurface><lod3MultiSurface>{}</lod3MultiSurface></c:WindowSurface></c:fillingSurface><lod3MultiSurface>{}</lod3MultiSurface></c:WallSurface></boundary>
        <lod3Solid><gml:Solid><gml:exterior><gml:Shell><gml:surfaceMember xlink:href="#p"/></gml:Shell></gml:exterior></gml:Solid></lod3Solid>
        <b:buildingSubdivision><b:Storey gml:id="s"><lod3Solid>{}</lod3Solid></b:Storey></b:buildingSubdivision></b:Building></cityObjectMember></CityModel>"##,
        multi_surface(&[polygon("w", 2)]),
        multi_surface(&[polygon("p", 1)]),
        solid(&[polygon("x", 8)]),
    );
    let (sink, result) = read_bytes(text.as_bytes());
    result.unwrap();
    assert_eq!(corners(&sink.objects[0]), [1.0, 2.0]);
    assert_eq!((sink.objects[1].parent.as_deref(), &sink.objects[1].shape), (Some("b"), &Shape::None));
    assert!(sink.crs.is_empty());
}

#[test]
fn coordinate_systems_are_passed_on_when_they_change() {
    let building = |srs: &str, x| {
        let geometry = solid(&[polygon("p", x)]).replacen("<gml:Solid>", &format!("<gml:Solid{srs}>"), 1);
        member(&format!("<bldg:Building><bldg:lod1Solid>{geometry}</bldg:lod1Solid></bldg:Building>"))
    };
    let envelope = r#"<gml:boundedBy><gml:Envelope srsName="EPSG:25832"><gml:lowerCorner>0 0</gml:lowerCorner></gml:Envelope></gml:boundedBy>"#;
    let sink =
        read_2(&format!("{envelope}{}{}{}", building("", 1), building(r#" srsName="EPSG:25833""#, 2), building("", 3)));
    let crs = |name: &str| CrsReference::authority(name);
    assert_eq!(sink.crs, [crs("EPSG:25832"), crs("EPSG:25833"), crs("EPSG:25832")]);
    assert_eq!((sink.problems.as_slice(), read_2(&building("", 1)).crs), (&[][..], vec![]));
}

#[test]
fn the_system_of_an_object_before_is_none_of_its_own() {
    let building = |id: &str, place: [f64; 2], size: f64, srs: &str| {
        let [x, y] = place;
        let (east, north) = (x + size, y + size);
        let geometry = format!(
            "<gml:MultiSurface{srs}><gml:surfaceMember><gml:Polygon><gml:exterior><gml:LinearRing><gml:posList>\
             {x} {y} 0 {east} {y} 0 {east} {north} 0 {x} {y} 0</gml:posList></gml:LinearRing></gml:exterior></gml:Polygon>\
             </gml:surfaceMember></gml:MultiSurface>"
        );
        super::building(id, &geometry)
    };
    let zone = |id, srs: &str| building(id, [500_000.0, 5_400_000.0], 10.0, srs);
    let named = r#" srsName="EPSG:25833""#;
    let envelope = r#"<gml:boundedBy><gml:Envelope srsName="EPSG:25832"/></gml:boundedBy>"#;
    let within = zone("c", "").replace("<bldg:lod2", &format!("{envelope}<bldg:lod2"));
    let sink = read_2(&[zone("a", named), zone("b", ""), within].concat());
    assert_eq!(sink.crs, [CrsReference::authority("EPSG:25833"), CrsReference::authority("EPSG:25832")]);
    let [(kind, detail)] = &sink.problems[..] else { panic!("{:?}", sink.problems) };
    assert!(*kind == NO_CRS && detail.starts_with("b: ") && detail.contains("EPSG:25833"), "{detail}");
    // Degrees are none of a system in metres: the sink guesses, once.
    let in_degrees = |id| building(id, [48.1, 11.5], 0.0001, "");
    let sink = read_2(&[zone("a", named), in_degrees("b"), in_degrees("c"), zone("d", named)].concat());
    let names: Vec<_> = sink.crs.iter().map(|crs| crs.name.as_str()).collect();
    assert_eq!((names, sink.problems.len()), (vec!["EPSG:25833", "", "EPSG:25833"], 0));
}

#[test]
fn planning_objects_groups_and_lines() {
    let zone = format!(
        "<urf:UseDistrict gml:id='z'><urf:lod1MultiSurface>{}</urf:lod1MultiSurface></urf:UseDistrict>",
        multi_surface(&[polygon("p", 1)])
    );
    let bare = "<urf:UseDistrict gml:id='y'/>";
    let group = "<grp:CityObjectGroup gml:id='g'><grp:groupMember xlink:href='#z'/></grp:CityObjectGroup>";
    let line = "<tran:Road gml:id='l'><tran:lod0Network><gml:LineString><gml:posList>0 0 0 1 1 1</gml:posList></gml:LineString></tran:lod0Network></tran:Road>";
    let sink = read_2(&[&zone, bare, group, line].map(member).concat());
    let summary: Vec<_> = sink.objects.iter().map(|o| (&*o.id, o.kind, o.shape == Shape::None)).collect();
    let expected = [
        ("z", FeatureKind::LandUse, false),
        ("y", FeatureKind::Generic, true),
        ("g", FeatureKind::Generic, true),
        ("l", FeatureKind::Road, true),
    ];
    assert_eq!(summary, expected);
    assert_eq!(sink.problems, [("only lines or points", "l".into())]);
}

#[test]
fn rings_in_the_forms_of_gml_2_and_single_positions() {
    let rings = [
        "<gml:outerBoundaryIs><gml:LinearRing><gml:coordinates>1,0,0 2,0,0 2,1,0 1,0,0</gml:coordinates></gml:LinearRing></gml:outerBoundaryIs>",
        "<gml:exterior><gml:LinearRing><gml:pos>2 0 0</gml:pos><gml:pos>3 0 0</gml:pos><gml:pos>3 1 0</gml:pos><gml:pos>2 0 0</gml:pos></gml:LinearRing></gml:exterior>",
        "<gml:exterior><gml:Ring><gml:curveMember><gml:LineString><gml:posList>3 0 0 4 0 0 4 1 0</gml:posList></gml:LineString></gml:curveMember><gml:curveMember><gml:LineString><gml:posList>4 1 0 3 0 0</gml:posList></gml:LineString></gml:curveMember></gml:Ring></gml:exterior>",
    ];
    let members: Vec<_> = rings.iter().map(|ring| format!("<gml:Polygon>{ring}</gml:Polygon>")).collect();
    let sink = read_building(&format!("<bldg:lod2MultiSurface>{}</bldg:lod2MultiSurface>", multi_surface(&members)));
    assert_eq!(corners(&sink.objects[0]), [1.0, 2.0, 3.0]);
    assert!(polygons(&sink.objects[0]).iter().all(|surface| surface.points.len() == 3));
}

#[test]
fn rings_of_curves_follow_them() {
    let polygon = |curves: &str| {
        format!(
            "<gml:Polygon><gml:exterior><gml:Ring><gml:curveMember>{curves}</gml:curveMember></gml:Ring></gml:exterior></gml:Polygon>"
        )
    };
    let segments = |content: &str| format!("<gml:Curve><gml:segments>{content}</gml:segments></gml:Curve>");
    let read = |curves: &str| {
        read_building(&format!("<bldg:lod1MultiSurface>{}</bldg:lod1MultiSurface>", multi_surface(&[polygon(curves)])))
    };
    let area = |sink: &insula_source::testing::TestSink| {
        let points = &polygons(&sink.objects[0])[0].points;
        let next = points.iter().cycle().skip(1);
        points.iter().zip(next).map(|([x, y, _], [a, b, _])| (x * b - a * y) / 2.0).sum::<f64>()
    };
    let circle = "<gml:Circle><gml:posList>2 0 5 0 2 5 -2 0 5</gml:posList></gml:Circle>";
    let arcs = "<gml:ArcString><gml:posList>2 0 5 0 2 5 -2 0 5 0 -2 5 2 0 5</gml:posList></gml:ArcString>";
    let half = "<gml:Arc><gml:pos>2 0 5</gml:pos><gml:pos>0 2 5</gml:pos><gml:pos>-2 0 5</gml:pos></gml:Arc>";
    let line = "<gml:LineStringSegment><gml:posList>-2 0 5 2 0 5</gml:posList></gml:LineStringSegment>";
    let back = format!(
        r#"<gml:CompositeCurve><gml:curveMember>{}</gml:curveMember><gml:curveMember><gml:OrientableCurve orientation="-"><gml:baseCurve><gml:LineString><gml:posList>2 0 5 -2 0 5</gml:posList></gml:LineString></gml:baseCurve></gml:OrientableCurve></gml:curveMember></gml:CompositeCurve>"#,
        segments(half)
    );
    let round = 4.0 * std::f64::consts::PI;
    for (curves, expected) in [
        (segments(circle), round),
        (segments(arcs), round),
        (segments(&format!("{half}{line}")), round / 2.0),
        (back, round / 2.0),
    ] {
        let sink = read(&curves);
        assert!((area(&sink) / expected - 1.0).abs() < 1e-3, "{curves}: {}", area(&sink));
        assert!(sink.problems.is_empty() && sink.skipped.is_empty());
    }
    let centre =
        "<gml:CircleByCenterPoint><gml:pos>0 0 5</gml:pos><gml:radius>2</gml:radius></gml:CircleByCenterPoint>";
    for curves in [segments(centre), r##"<gml:Curve xlink:href="#c"/>"##.to_owned()] {
        let sink = read(&curves);
        assert_eq!(sink.skipped, [("ring with a curve that is not read", "b".to_owned())]);
    }
}

#[test]
fn systems_are_found_on_every_element_of_a_surface() {
    for element in ["Solid", "CompositeSurface", "Polygon", "LinearRing", "posList"] {
        let plain = solid(&[polygon("", 1), polygon("", 2)]);
        let named = plain.replace(&format!("<gml:{element}"), &format!(r#"<gml:{element} srsName="EPSG:25832""#));
        let sink = read_building(&format!("<bldg:lod1Solid>{named}</bldg:lod1Solid>"));
        assert_eq!(sink.crs, [CrsReference::authority("EPSG:25832".to_owned())], "{element}");
        assert_eq!(corners(&sink.objects[0]), [1.0, 2.0], "{element}");
    }
}

#[test]
fn surfaces_in_several_systems_are_named() {
    let face = |id: &str, code: u32| {
        polygon(id, 1).replacen("<gml:Polygon", &format!(r#"<gml:Polygon srsName="EPSG:{code}""#), 1)
    };
    let faces = [face("a", 25832), face("c", 25833), face("d", 25832)];
    let sink = read_building(&format!("<bldg:lod1MultiSurface>{}</bldg:lod1MultiSurface>", multi_surface(&faces)));
    assert_eq!(sink.crs, [CrsReference::authority("EPSG:25832")]);
    assert_eq!(sink.problems, [(SEVERAL_SYSTEMS, "b".to_owned())]);
}

#[test]
fn the_system_of_a_template_is_that_of_its_place() {
    let template =
        multi_surface(&[polygon("t", 1)]).replacen("<gml:MultiSurface", r##"<gml:MultiSurface srsName="#local""##, 1);
    let tree = format!(
        r#"<veg:SolitaryVegetationObject gml:id="v"><veg:lod1ImplicitRepresentation><core:ImplicitGeometry><core:relativeGMLGeometry>{template}</core:relativeGMLGeometry><core:referencePoint><gml:Point srsName="EPSG:25832"><gml:pos>7 8 9</gml:pos></gml:Point></core:referencePoint></core:ImplicitGeometry></veg:lod1ImplicitRepresentation></veg:SolitaryVegetationObject>"#
    );
    let sink = read_2(&member(&tree));
    assert_eq!(sink.crs, [CrsReference::authority("EPSG:25832")]);
    assert_eq!((corners(&sink.objects[0]), sink.problems.len()), (vec![8.0], 0));
}

#[test]
fn coordinates_are_read_in_every_style_of_gml() {
    let ring = [[1.5, 0.0, 0.0], [2.5, 0.0, 0.0], [2.5, 1.0, 0.0], [1.5, 0.0, 0.0]];
    let joined = |start: &str, between: &str, end: &str, mark: &str| -> String {
        let position = |point: &[f64; 3]| point.map(|number| number.to_string().replace('.', mark)).join(between);
        ring.iter().map(|point| format!("{start}{}{end}", position(point))).collect()
    };
    let coord =
        ring.map(|[x, y, z]| format!("<gml:coord><gml:X>{x}</gml:X><gml:Y>{y}</gml:Y><gml:Z>{z}</gml:Z></gml:coord>"));
    for content in [
        format!("<gml:posList>{}</gml:posList>", joined(" ", " ", "", ".")),
        format!(r#"<gml:posList decimal=",">{}</gml:posList>"#, joined(" ", " ", "", ",")),
        joined(r#"<gml:pos decimal=",">"#, " ", "</gml:pos>", ","),
        coord.concat(),
        format!("<gml:coordinates>{}</gml:coordinates>", joined(" ", ",", "", ".")),
        format!(r#"<gml:coordinates decimal="," cs=" " ts=";">{}</gml:coordinates>"#, joined("", " ", ";", ",")),
    ] {
        let face = format!(
            "<gml:Polygon><gml:exterior><gml:LinearRing>{content}</gml:LinearRing></gml:exterior></gml:Polygon>"
        );
        let sink = read_building(&format!("<bldg:lod1MultiSurface>{}</bldg:lod1MultiSurface>", multi_surface(&[face])));
        assert!(sink.skipped.is_empty() && sink.problems.is_empty(), "{content}: {:?}", sink.skipped);
        assert_eq!(polygons(&sink.objects[0])[0].points, ring[..3], "{content}");
    }
}

#[test]
fn files_of_converters_declare_many_namespaces() {
    let declared = |count: u32| (0..count).map(|n| format!(" xmlns:n{n}=\"http://n/{n}\"")).collect::<String>();
    let content = format!("<bldg:lod1Solid>{}</bldg:lod1Solid>", solid(&[polygon("a", 1)]));
    let building = |count| member(&format!("<bldg:Building{}>{content}</bldg:Building>", declared(count)));
    assert_eq!(read_2(&building(500)).objects.len(), 1);
    let (_, result) = read_bytes(format!("{HEAD_2}{}{TAIL}", building(2000)).as_bytes());
    let error = result.unwrap_err().to_string();
    assert!(error.contains("more than 1024 namespaces are declared at once"), "{error}");
}
