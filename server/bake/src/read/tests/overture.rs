//! Buildings of Overture and their parts.

use super::{embedded, ids};

#[test]
fn parts_stand_for_their_outline_unless_they_are_small() {
    let feature = |properties: &str, size: f64| {
        let [east, north] = [4.36 + size, 52.01 + size];
        format!(
            r#"{{"type": "Feature", "properties": {{{properties}, "sources": [{{"dataset": "OpenStreetMap"}}]}}, "geometry": {{"type": "Polygon",
            "coordinates": [[[4.36, 52.01], [{east}, 52.01], [{east}, {north}], [4.36, {north}], [4.36, 52.01]]]}}}}"#
        )
    };
    let kept = |has_parts: &str, size: f64, more: &str| {
        let outline = feature(&format!(r#""id": "b", "height": 20, "has_parts": {has_parts}"#), 0.0004);
        let part = feature(&format!(r#""id": "p", "building_id": "b", "height": 60{more}"#), size);
        let text = format!(r#"{{"type": "FeatureCollection", "features": [{outline}, {part}]}}"#);
        let (scene, _) = embedded(&[("a.geojson", text.as_bytes())]).unwrap();
        ids(&scene).join(" ")
    };
    for has_parts in ["true", "1", "\"True\""] {
        assert_eq!(kept(has_parts, 0.0004, ""), "p", "{has_parts}");
    }
    assert_eq!(kept("false", 0.0004, ""), "b p");
    // A mast on the roof, and a roof without anything below it.
    assert_eq!([kept("true", 0.0001, ""), kept("true", 0.0004, r#", "min_height": 19"#)], ["b p", "b p"]);
}
