//! Objects that are no longer there, and their parts.

use super::{embedded, ids};
use insula_dress::footprint::{ENDED, HAZARD};

#[test]
fn parts_of_an_ended_building_are_left_out_with_it() {
    let solid = r#"{"type": "Solid", "lod": "1", "boundaries": [[[[0,3,2,1]],[[4,5,6,7]],[[0,1,5,4]],[[1,2,6,5]],[[2,3,7,6]],[[3,0,4,7]]]]}"#;
    let text = format!(
        r#"{{"type": "CityJSON", "version": "2.0",
        "vertices": [[0,0,0],[9,0,0],[9,9,0],[0,9,0],[0,0,9],[9,0,9],[9,9,9],[0,9,9]], "CityObjects": {{
        "part": {{"type": "BuildingPart", "geometry": [{solid}], "parents": ["old"]}},
        "old": {{"type": "Building", "children": ["part"], "attributes": {{"terminationDate": "2016-08-05"}}}},
        "new": {{"type": "Building", "geometry": [{solid}], "attributes": {{"terminationDate": null}}}}}}}}"#
    );
    let (scene, report) = embedded(&[("a.city.json", text.as_bytes())]).unwrap();
    assert_eq!((ids(&scene), report.sources[0].skipped[ENDED].count), (vec!["new"], 2));
}

#[test]
fn parts_of_an_ended_building_of_citygml_are_left_out_with_it() {
    let solid = |x: u32| {
        let ring = |corners: [[u32; 3]; 4]| {
            let [first, ..] = corners;
            let positions: String =
                corners.iter().chain([&first]).flatten().map(|number| format!("{number} ")).collect();
            format!(
                "<gml:surfaceMember><gml:Polygon><gml:exterior><gml:LinearRing><gml:posList>{positions}</gml:posList></gml:LinearRing></gml:exterior></gml:Polygon></gml:surfaceMember>"
            )
        };
        let e = x + 9;
        let rings = [
            [[x, 0, 0], [x, 9, 0], [e, 9, 0], [e, 0, 0]],
            [[x, 0, 9], [e, 0, 9], [e, 9, 9], [x, 9, 9]],
            [[x, 0, 0], [e, 0, 0], [e, 0, 9], [x, 0, 9]],
        ];
        format!(
            "<bldg:lod2MultiSurface><gml:MultiSurface>{}</gml:MultiSurface></bldg:lod2MultiSurface>",
            rings.map(ring).concat()
        )
    };
    let text = format!(
        r#"<core:CityModel xmlns:core="http://www.opengis.net/citygml/2.0" xmlns:bldg="http://www.opengis.net/citygml/building/2.0" xmlns:gml="http://www.opengis.net/gml">
        <core:cityObjectMember><bldg:Building gml:id="old"><core:terminationDate>2016-08-05</core:terminationDate>
        <bldg:consistsOfBuildingPart><bldg:BuildingPart gml:id="part">{}</bldg:BuildingPart></bldg:consistsOfBuildingPart></bldg:Building></core:cityObjectMember>
        <core:cityObjectMember><bldg:Building gml:id="new"><core:creationDate>2016-08-05</core:creationDate>{}</bldg:Building></core:cityObjectMember>
        </core:CityModel>"#,
        solid(0),
        solid(20)
    );
    let (scene, report) = embedded(&[("a.gml", text.as_bytes())]).unwrap();
    assert_eq!((ids(&scene), report.sources[0].skipped[ENDED].count), (vec!["new"], 2));
}

#[test]
fn what_registers_call_demolished_is_left_out() {
    let feature = |id: &str, state: &str| {
        format!(
            r#"{{"type": "Feature", "id": "{id}", "properties": {{"height": 9, "status": "{state}"}}, "geometry": {{"type": "Polygon",
            "coordinates": [[[4.36, 52.01], [4.3602, 52.01], [4.3602, 52.0102], [4.36, 52.0102], [4.36, 52.01]]]}}}}"#
        )
    };
    let read = |features: &str| {
        let text = format!(r#"{{"type": "FeatureCollection", "features": [{features}]}}"#);
        embedded(&[("a.geojson", text.as_bytes())])
    };
    let (old, new) = (feature("a", "Pand gesloopt"), feature("b", "Pand in gebruik"));
    let (scene, report) = read(&format!("{old}, {new}")).unwrap();
    assert_eq!((ids(&scene), &report.sources[0].skipped[ENDED].first[..]), (vec!["b"], &["a".to_owned()][..]));
    let error = read(&old).unwrap_err().to_string();
    assert!(error.contains(ENDED), "{error}");
}

#[test]
fn files_of_hazard_maps_are_left_out_beside_the_city() {
    let document = |object: &str| {
        format!(
            r#"{{"type": "CityJSON", "version": "2.0", "vertices": [[0,0,0],[9,0,0],[9,9,0],[0,9,9]], "CityObjects": {{{object}}}}}"#
        )
    };
    let geometry =
        r#""geometry": [{"type": "MultiSurface", "lod": "1", "boundaries": [[[0,1,2]], [[0,2,3]], [[0,1,3]]]}]"#;
    let flood = format!(
        r#""flood": {{"type": "WaterBody", {geometry}, "attributes": {{"floodingRiskAttribute": {{"rank": "3"}}}}}}"#
    );
    let house = format!(r#""house": {{"type": "Building", {geometry}}}"#);
    let (flood, house) = (document(&flood), document(&house));
    let files: [(&str, &[u8]); 2] = [("fld.city.json", flood.as_bytes()), ("house.city.json", house.as_bytes())];
    let (scene, report) = embedded(&files).unwrap();
    assert_eq!((ids(&scene), report.sources[0].skipped[HAZARD].count), (vec!["house"], 1));
    let error = embedded(&files[..1]).unwrap_err().to_string();
    assert!(error.contains(HAZARD), "{error}");
    let old = house.replace(r#""type": "Building","#, r#""type": "Building", "attributes": {"status": "demolished"},"#);
    let files: [(&str, &[u8]); 2] = [("house.city.json", house.as_bytes()), ("old.city.json", old.as_bytes())];
    let (scene, report) = embedded(&files).unwrap();
    assert_eq!((ids(&scene), report.sources[1].skipped[ENDED].count), (vec!["house"], 1));
}
