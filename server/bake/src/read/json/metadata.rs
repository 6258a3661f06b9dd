//! Metadata of a JSON file: coordinate system, titles, attributions, licences.

use insula_protocol::manifest::shorten_text;
use serde_json::Value;

use crate::read::report::SourceReport;

/// EPSG codes of common systems in degrees.
const DEGREES: &[u32] = &[4258, 4269, 4283, 4326, 4612, 4937, 4979, 6668, 6697, 7844];

/// Further titles, attributions or licences of a source are left out.
const MAX_TEXTS: usize = 1000;

/// Fills the report's coordinate system, titles, attributions and licences.
pub(crate) fn describe(metadata: &Value, report: &mut SourceReport) {
    walk(metadata, "", report);
}

/// Finds members at any depth: some files put them into arrays and extensions.
fn walk(value: &Value, within: &str, report: &mut SourceReport) {
    match value {
        Value::Array(entries) => entries.iter().for_each(|entry| walk(entry, within, report)),
        Value::Object(members) => {
            for (name, member) in members {
                if let Value::String(text) = member {
                    note(name, within, text, report);
                } else {
                    walk(member, name, report);
                }
            }
        }
        _ => {}
    }
}

fn note(name: &str, within: &str, text: &str, report: &mut SourceReport) {
    let text = text.trim();
    let list = match name.to_ascii_lowercase().as_str() {
        "title" => &mut report.titles,
        "contactname" | "organization" | "organisation" | "attribution" | "copyright" => &mut report.attributions,
        // In extended metadata, the origin of a part of the data.
        "description" if within == "source" => &mut report.attributions,
        "license" | "licence" | "datasetlicense" | "uselimitation" => &mut report.licences,
        "referencesystem" => {
            report.crs = report.crs.take().or_else(|| epsg(text));
            return;
        }
        _ => return,
    };
    let short = shorten_text(text);
    if text.is_empty() || list.iter().any(|known| known == short) {
        return;
    }
    if list.len() >= MAX_TEXTS {
        report.problem("too many texts in the metadata", || name.to_owned());
        return;
    }
    list.push(short.to_owned());
    if short.len() < text.len() {
        report.problem("text in the metadata too long, cut", || format!("{name}: {} bytes", text.len()));
    }
}

/// Finds an EPSG code in a URL, a URN or a name; returns it as `EPSG:7415`.
pub(crate) fn epsg(reference_system: &str) -> Option<String> {
    if !reference_system.to_ascii_uppercase().contains("EPSG") {
        return None;
    }
    let code = reference_system.trim_end_matches('/').rsplit(|c: char| !c.is_ascii_digit()).next()?;
    let code: u32 = code.parse().ok()?;
    Some(format!("EPSG:{code}"))
}

/// Whether a system such as `EPSG:4326` is in degrees instead of metres.
pub(crate) fn is_degrees(crs: &str) -> bool {
    crs.strip_prefix("EPSG:").and_then(|code| code.parse().ok()).is_some_and(|code: u32| DEGREES.contains(&code))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::read::report::SourceFormat;

    #[test]
    fn epsg_code_is_found_in_every_spelling_of_a_reference_system() {
        let spellings = [
            "urn:ogc:def:crs:EPSG::7415",
            "https://www.opengis.net/def/crs/EPSG/0/7415",
            "http://www.opengis.net/def/crs/EPSG/0/7415/",
            "EPSG:7415",
            "epsg:7415",
        ];
        for spelling in spellings {
            assert_eq!(epsg(spelling).as_deref(), Some("EPSG:7415"), "{spelling}");
        }
        assert_eq!(epsg("urn:ogc:def:crs:OGC:1.3:CRS84"), None);
        assert_eq!(epsg("EPSG:"), None);
        assert!(is_degrees("EPSG:4326") && !is_degrees("EPSG:7415"));
    }

    #[test]
    fn long_texts_are_cut_and_too_many_left_out() {
        let mut report = SourceReport::new("a", SourceFormat::CityJson, 0);
        describe(&serde_json::json!({ "title": "\u{e4}".repeat(1 << 20) }), &mut report);
        assert_eq!(report.titles, ["\u{e4}".repeat(2048)]);
        assert_eq!(report.problems["text in the metadata too long, cut"].first, ["title: 2097152 bytes"]);
        let many: Vec<Value> = (0..1500).map(|i| serde_json::json!({ "license": i.to_string() })).collect();
        describe(&Value::Array(many), &mut report);
        assert_eq!((report.licences.len(), report.problems["too many texts in the metadata"].count), (1000, 500));
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
        let mut report = SourceReport::new("a", SourceFormat::CityJson, 0);
        describe(&metadata, &mut report);
        assert_eq!(report.crs.as_deref(), Some("EPSG:32734"));
        assert_eq!(report.titles, ["Cape Town"]);
        assert_eq!(report.attributions.len(), 2);
        assert!(report.attributions.contains(&"OpenStreetMap contributors".to_owned()));
        assert_eq!(report.licences, ["CC BY 4.0"]);
    }
}
