//! Damaged and malicious files.

use super::*;

#[test]
fn every_truncation_is_an_error_and_keeps_whole_objects() {
    let reference = r##"<gml:MultiSurface><gml:surfaceMember xlink:href="#p1"/></gml:MultiSurface>"##;
    let first =
        format!("{HEAD_2}{}", building("early", reference) + &building("a", &multi_surface(&[polygon("p1", 1)])));
    let file = format!("{first}{}{TAIL}", building("ü", &multi_surface(&[polygon("p2", 2)])));
    for length in 0..file.len() {
        let (sink, result) = read_bytes(&file.as_bytes()[..length]);
        assert!(result.is_err(), "{length}");
        if length >= first.len() {
            assert!(sink.objects.iter().any(|object| object.id == "a"), "{length}");
            assert!(sink.objects.iter().any(|object| object.id == "early"), "{length}");
        }
    }
    let (sink, result) = read_bytes(file.as_bytes());
    result.unwrap();
    assert_eq!(sink.objects.len(), 3);
}

#[test]
fn damage_tells_its_place() {
    let file = format!("{HEAD_2}<core:cityObjectMember></core:wrong>");
    let Err(InputError::Damaged { place, .. }) = read_bytes(file.as_bytes()).1 else { panic!("no error") };
    assert_eq!(place, format!("byte {}", HEAD_2.len() + "<core:cityObjectMember>".len()));
}

#[test]
fn other_files_are_refused() {
    for text in ["", "   ", "hello", "<osm/>", "<x:CityModel xmlns:x='http://example.com/'/>", "\u{0}\u{1}"] {
        let error = read_bytes(text.as_bytes()).1.unwrap_err().to_string();
        assert!(error.contains("not CityGML"), "{text}: {error}");
    }
}

#[test]
fn undeclared_prefixes_are_reported_once() {
    let polygon = polygon("p", 1);
    let file = format!(
        "<core:CityModel><core:cityObjectMember><bldg:Building gml:id='b'><bldg:boundedBy><bldg:RoofSurface><bldg:lod2MultiSurface><gml:MultiSurface><gml:surfaceMember>{polygon}</gml:surfaceMember></gml:MultiSurface></bldg:lod2MultiSurface></bldg:RoofSurface></bldg:boundedBy></bldg:Building></core:cityObjectMember></core:CityModel>"
    );
    let (sink, result) = read_bytes(file.as_bytes());
    result.unwrap();
    assert_eq!(corners(&sink.objects[0]), [1.0]);
    assert_eq!(sink.problems, [("namespace prefix not declared", "byte 16: core".into())]);
}

#[test]
fn cyclic_references_end() {
    let cycle = r##"<gml:MultiSurface gml:id="m"><gml:surfaceMember><gml:CompositeSurface gml:id="c"><gml:surfaceMember xlink:href="#m"/>
        <gml:surfaceMember xlink:href="#c"/></gml:CompositeSurface></gml:surfaceMember></gml:MultiSurface>"##;
    let sink = read_2(&building("b", cycle));
    assert_eq!(sink.skipped, [("no usable surface", "b".into())]);
    let implicit = r##"<veg:SolitaryVegetationObject gml:id="v"><veg:lod1ImplicitRepresentation gml:id="i"><core:ImplicitGeometry>
        <core:relativeGMLGeometry xlink:href="#i"/></core:ImplicitGeometry></veg:lod1ImplicitRepresentation></veg:SolitaryVegetationObject>"##;
    assert_eq!(read_2(&member(implicit)).objects.len(), 0);
    let own = r##"<bldg:Building gml:id="b"><bldg:boundedBy xlink:href="#b"/></bldg:Building>"##;
    assert_eq!(read_2(&member(own)).objects.len(), 1);
    let unknown = r##"<gml:MultiSurface><gml:surfaceMember xlink:href="#nowhere"/></gml:MultiSurface>"##;
    let sink = read_2(&building("b", unknown));
    assert_eq!(sink.skipped, [("reference to a surface that the file does not have", "b".into())]);
}

#[test]
fn references_that_double_at_each_step_do_not_explode() {
    let step = |index: u32| {
        let next = index + 1;
        format!(
            r##"<gml:surfaceMember><gml:CompositeSurface gml:id="c{index}"><gml:surfaceMember xlink:href="#c{next}"/><gml:surfaceMember xlink:href="#c{next}"/></gml:CompositeSurface></gml:surfaceMember>"##
        )
    };
    let steps: String = (0..100).map(step).collect();
    let last = format!(
        r##"<gml:surfaceMember><gml:CompositeSurface gml:id="c100">{}</gml:CompositeSurface></gml:surfaceMember>"##,
        surface_members(&[polygon("p", 1)])
    );
    let sink = read_2(&building("b", &format!("<gml:MultiSurface>{steps}{last}</gml:MultiSurface>")));
    assert_eq!(corners(&sink.objects[0]), [1.0]);
    let chain: String = (0..5000)
        .map(|index| format!(r##"<gml:surfaceMember><gml:CompositeSurface gml:id="c{index}"><gml:surfaceMember xlink:href="#c{}"/></gml:CompositeSurface></gml:surfaceMember>"##, index + 1))
        .collect();
    let sink = read_2(&building("b", &format!("<gml:MultiSurface>{chain}</gml:MultiSurface>")));
    assert_eq!(sink.skipped.len(), 1);
}

#[test]
fn faulty_rings_are_problems() {
    let ring = |text: &str| {
        format!(
            "<gml:Polygon><gml:exterior><gml:LinearRing><gml:posList>{text}</gml:posList></gml:LinearRing></gml:exterior></gml:Polygon>"
        )
    };
    let rings = ["0 0 0 1 1 1", "0 0 0 1 0 0 x 1 0 0 0 0", "0 0 0 1 0 0 NaN 1 0 0 0 0", "", "0 0 0 1 0 0 1 1 0 0 0 0"]
        .map(ring);
    let sink = read_2(&building("b", &multi_surface(&rings)));
    assert_eq!(polygons(&sink.objects[0]).len(), 1);
    let expected = [
        ("ring has fewer than three points", "b: 2 times".into()),
        ("coordinates that are no numbers", "b: 2 times".into()),
    ];
    assert_eq!(sink.problems, expected);
    let hole = polygon("p", 1).replace(
        "</gml:Polygon>",
        "<gml:interior><gml:LinearRing><gml:posList>1 1 1</gml:posList></gml:LinearRing></gml:interior></gml:Polygon>",
    );
    let sink = read_2(&building("b", &multi_surface(&[hole])));
    assert_eq!((corners(&sink.objects[0]), sink.problems.len()), (vec![1.0], 1));
}

#[test]
fn entities_are_not_expanded() {
    let bomb = format!(
        "<!DOCTYPE x [<!ENTITY a 'ha'><!ENTITY b '&a;&a;&a;&a;'>]>{}",
        format!(
            "{HEAD_2}{}{TAIL}",
            member("<bldg:Building gml:id='b'><gml:name>&b;&b; &amp; co</gml:name></bldg:Building>")
        )
        .split_once("?>")
        .unwrap()
        .1
    );
    let (sink, result) = read_bytes(bomb.as_bytes());
    result.unwrap();
    assert_eq!(sink.objects[0].attributes.get("name").unwrap().as_str(), Some("& co"));
    assert_eq!(sink.problems, [("entity not expanded", "b".into())]);
}

#[test]
fn deep_elements_are_skipped_or_refused() {
    let nested = |depth| "<gml:x>".repeat(depth) + &"</gml:x>".repeat(depth);
    let sink = read_2(&(building("deep", &nested(300)) + &building("b", &multi_surface(&[polygon("p", 1)]))));
    assert_eq!(sink.skipped, [("elements nested too deeply", "deep".into())]);
    assert_eq!(sink.objects.len(), 1);
    let file = format!("{HEAD_2}{}", "<gml:x>".repeat(100_000));
    assert!(matches!(read_bytes(file.as_bytes()).1, Err(InputError::Damaged { .. })));
}

#[test]
fn polygon_of_a_million_vertices() {
    let mut ring = String::new();
    for index in 0..1_000_000 {
        let angle = f64::from(index) * 1e-6;
        ring += &format!("{:.6} {:.6} 0 ", angle.cos(), angle.sin());
    }
    let polygon = format!(
        "<gml:Polygon><gml:exterior><gml:LinearRing><gml:posList>{ring}</gml:posList></gml:LinearRing></gml:exterior></gml:Polygon>"
    );
    let sink = read_2(&building("b", &multi_surface(&[polygon])));
    assert!(polygons(&sink.objects[0])[0].points.len() > 500_000);
}

#[test]
fn placing_a_template_many_times_is_limited() {
    let template: Vec<_> = (0..2000).map(|x| polygon("", x)).collect();
    let template = multi_surface(&template).replacen("<gml:MultiSurface>", "<gml:MultiSurface gml:id='t'>", 1);
    let place = r##"<veg:lod1ImplicitRepresentation><core:ImplicitGeometry><core:relativeGMLGeometry xlink:href="#t"/></core:ImplicitGeometry></veg:lod1ImplicitRepresentation>"##;
    let first = format!(
        "<veg:lod1ImplicitRepresentation><core:ImplicitGeometry><core:relativeGMLGeometry>{template}</core:relativeGMLGeometry></core:ImplicitGeometry></veg:lod1ImplicitRepresentation>"
    );
    let sink = read_2(&member(&format!("<veg:PlantCover gml:id='v'>{first}{}</veg:PlantCover>", place.repeat(400))));
    let points: usize = polygons(&sink.objects[0]).iter().map(|surface| surface.points.len()).sum();
    assert!(points <= 2 << 20, "{points}");
    assert_eq!(sink.problems[0].0, "too many points in one object");
}

#[test]
fn mixtures_of_elements_never_panic() {
    let parts = [
        "<bldg:Building gml:id='a'>",
        "</bldg:Building>",
        "<gml:Polygon>",
        "</gml:Polygon>",
        "<gml:exterior>",
        "</gml:exterior>",
        "<gml:posList>1 2 3</gml:posList>",
        "<bldg:lod2Solid>",
        "</bldg:lod2Solid>",
        "<gml:Triangle gml:id='t'>",
        "</gml:Triangle>",
        "<gml:surfaceMember xlink:href='#t'/>",
        "<core:ImplicitGeometry>",
        "</core:ImplicitGeometry>",
        "text",
        "&amp;",
        "<gml:pos/>",
        "<core:relativeGMLGeometry xlink:href='#a'/>",
        "<bldg:consistsOfBuildingPart>",
        "</bldg:consistsOfBuildingPart>",
        "<core:cityObjectMember>",
        "</core:cityObjectMember>",
        "<app:surfaceDataMember>",
        "</app:surfaceDataMember>",
        "<app:Appearance>",
    ];
    let mut state = 1u64;
    for _ in 0..3000 {
        let mut file = HEAD_2.to_owned() + "<core:cityObjectMember><bldg:Building>";
        for _ in 0..12 {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            file += parts[(state >> 33) as usize % parts.len()];
        }
        let _ = read_bytes(file.as_bytes());
        read_bytes(balanced(&file).as_bytes()).1.unwrap();
    }
}

/// The file with the end tags that it lacks, and without those that end nothing.
fn balanced(file: &str) -> String {
    let mut open = Vec::new();
    let mut reader = quick_xml::Reader::from_str(file);
    reader.config_mut().allow_unmatched_ends = true;
    reader.config_mut().check_end_names = false;
    let mut balanced = String::new();
    while let Ok(event) = reader.read_event() {
        match event {
            quick_xml::events::Event::Start(start) => {
                balanced += &format!("<{}>", &*start);
                open.push(start.name().as_ref().to_owned());
            }
            quick_xml::events::Event::Empty(empty) => balanced += &format!("<{}/>", &*empty),
            quick_xml::events::Event::Text(text) => balanced += &text,
            quick_xml::events::Event::Eof => break,
            _ => {}
        }
    }
    open.iter().rev().fold(balanced, |balanced, name| balanced + &format!("</{name}>"))
}
