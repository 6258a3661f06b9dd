//! Metadata of a JSON file: coordinate system, titles, attributions, licences.

use crate::object::{Description, ObjectSink};
use serde_json::Value;

/// Between a title and the attribution, which ends in a parenthesis.
const DATA_MARK: &str = " (data: ";

/// Passes the titles, attributions and licences to the sink. Returns the name of the coordinate system.
pub fn describe(metadata: &Value, sink: &mut dyn ObjectSink) -> Option<String> {
    let mut crs = None;
    walk(metadata, "", sink, &mut crs);
    // The name of CityJSON before 1.0, which some writers still have.
    crs.or_else(|| system_in(metadata.get("crs")?))
}

/// Finds members at any depth: some files put them into arrays and extensions.
fn walk(value: &Value, within: &str, sink: &mut dyn ObjectSink, crs: &mut Option<String>) {
    match value {
        Value::Array(entries) => entries.iter().for_each(|entry| walk(entry, within, sink, crs)),
        Value::Object(members) => {
            for (name, member) in members {
                if name.eq_ignore_ascii_case("referenceSystem") {
                    *crs = crs.take().or_else(|| system_in(member));
                } else if let Value::String(text) = member {
                    note(name, within, text.trim(), sink);
                } else {
                    walk(member, name, sink, crs);
                }
            }
        }
        _ => {}
    }
}

/// The name of a coordinate system that is written as a text, as a code, or as GeoJSON has it.
fn system_in(value: &Value) -> Option<String> {
    match value {
        Value::String(text) => Some(text.trim().to_owned()).filter(|text| !text.is_empty()),
        Value::Number(code) => code.as_u64().map(|code| format!("EPSG:{code}")),
        Value::Object(members) => {
            ["properties", "name", "epsg", "code"].iter().find_map(|name| system_in(members.get(*name)?))
        }
        _ => None,
    }
}

fn note(name: &str, within: &str, text: &str, sink: &mut dyn ObjectSink) {
    let Some(what) = description(name, within) else { return };
    // CityJSON has no member for it: exports write it after the title.
    let parts = text.strip_suffix(')').and_then(|text| text.split_once(DATA_MARK));
    match parts.filter(|_| what == Description::Title) {
        Some((title, attribution)) => {
            sink.describe(Description::Title, title);
            sink.describe(Description::Attribution, attribution);
        }
        None => sink.describe(what, text),
    }
}

/// The text about a source in the member `name` of the object `within`; `None` if there is none.
pub fn description(name: &str, within: &str) -> Option<Description> {
    match name.to_ascii_lowercase().as_str() {
        "title" => Some(Description::Title),
        "contactname" | "organization" | "organisation" | "attribution" | "copyright" => Some(Description::Attribution),
        // In extended metadata, the origin of a part of the data.
        "description" if within == "source" => Some(Description::Attribution),
        "license" | "licence" | "datasetlicense" | "uselimitation" => Some(Description::Licence),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::TestSink;

    #[test]
    fn systems_are_texts_codes_or_objects() {
        for (system, expected) in [
            (serde_json::json!(" EPSG:7415 "), Some("EPSG:7415")),
            (serde_json::json!(7415), Some("EPSG:7415")),
            (
                serde_json::json!({"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::7415"}}),
                Some("urn:ogc:def:crs:EPSG::7415"),
            ),
            (serde_json::json!({"epsg": 7415}), Some("EPSG:7415")),
            (serde_json::json!(""), None),
            (serde_json::json!({"properties": [{"name": 1}]}), None),
        ] {
            let metadata = serde_json::json!({ "referenceSystem": system });
            assert_eq!(describe(&metadata, &mut TestSink::default()).as_deref(), expected, "{metadata}");
        }
    }

    #[test]
    fn an_attribution_in_a_title_is_none_of_it() {
        let mut sink = TestSink::default();
        describe(&serde_json::json!({ "title": "Delft (data: TU (3D), licence: CC0)" }), &mut sink);
        let expected =
            [(Description::Title, "Delft".to_owned()), (Description::Attribution, "TU (3D), licence: CC0".to_owned())];
        assert_eq!(sink.described, expected);
    }

    #[test]
    fn systems_have_their_old_name_if_they_have_no_other() {
        let mut sink = TestSink::default();
        let old = serde_json::json!({"crs": {"epsg": 7415}});
        assert_eq!(describe(&old, &mut sink).as_deref(), Some("EPSG:7415"));
        let both = serde_json::json!({"crs": {"epsg": 7415}, "referenceSystem": "EPSG:28992"});
        assert_eq!(describe(&both, &mut sink).as_deref(), Some("EPSG:28992"));
    }

    #[test]
    fn members_are_found_in_arrays_and_extensions() {
        let metadata = serde_json::json!([{
            "title": "Cape Town", "referenceSystem": "EPSG:32734",
            "datasetPointOfContact": {"contactName": "somebody"},
            "+metadata-extended": {"lineage": [{"source": [
                {"description": "OpenStreetMap contributors", "sourceReferenceSystem": "EPSG:4326"}]}],
                "license": "CC BY 4.0", "description": "not an origin"}
        }]);
        let mut sink = TestSink::default();
        assert_eq!(describe(&metadata, &mut sink).as_deref(), Some("EPSG:32734"));
        let texts = |of: Description| {
            let mut found: Vec<&str> = Vec::new();
            found.extend(sink.described.iter().filter(|(what, _)| *what == of).map(|(_, text)| text.as_str()));
            found.sort_unstable();
            found
        };
        assert_eq!(texts(Description::Title), ["Cape Town"]);
        assert_eq!(texts(Description::Attribution), ["OpenStreetMap contributors", "somebody"]);
        assert_eq!(texts(Description::Licence), ["CC BY 4.0"]);
    }
}
