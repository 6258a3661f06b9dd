//! Metadata of a JSON file: coordinate system, titles, attributions, licences.

use insula_protocol::manifest::shorten_text;
use serde_json::Value;

use crate::object::Description;
use crate::report::SourceReport;

/// Further titles, attributions or licences of a source are left out.
const MAX_TEXTS: usize = 1000;

/// Fills the report's titles, attributions and licences. Returns the name of the coordinate system.
pub fn describe(metadata: &Value, report: &mut SourceReport) -> Option<String> {
    let mut crs = None;
    walk(metadata, "", report, &mut crs);
    crs
}

/// Finds members at any depth: some files put them into arrays and extensions.
fn walk(value: &Value, within: &str, report: &mut SourceReport, crs: &mut Option<String>) {
    match value {
        Value::Array(entries) => entries.iter().for_each(|entry| walk(entry, within, report, crs)),
        Value::Object(members) => {
            for (name, member) in members {
                if let Value::String(text) = member {
                    note(name, within, text, report, crs);
                } else {
                    walk(member, name, report, crs);
                }
            }
        }
        _ => {}
    }
}

fn note(name: &str, within: &str, text: &str, report: &mut SourceReport, crs: &mut Option<String>) {
    let text = text.trim();
    if name.eq_ignore_ascii_case("referenceSystem") {
        if crs.is_none() && !text.is_empty() {
            *crs = Some(text.to_owned());
        }
        return;
    }
    let list = match description(name, within) {
        Some(Description::Title) => &mut report.titles,
        Some(Description::Attribution) => &mut report.attributions,
        Some(Description::Licence) => &mut report.licences,
        None => return,
    };
    match add_text(list, text) {
        TextFault::None => {}
        TextFault::TooMany => report.problem("too many texts in the metadata", || name.to_owned()),
        TextFault::TooLong => {
            report.problem("text in the metadata too long, cut", || format!("{name}: {} bytes", text.len()));
        }
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

/// What became of a text.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TextFault {
    None,
    TooMany,
    /// It is cut.
    TooLong,
}

/// Adds a text to a list of titles, attributions or licences, unless the list has it.
pub fn add_text(list: &mut Vec<String>, text: &str) -> TextFault {
    let text = text.trim();
    let short = shorten_text(text);
    if text.is_empty() || list.iter().any(|known| known == short) {
        return TextFault::None;
    }
    if list.len() >= MAX_TEXTS {
        return TextFault::TooMany;
    }
    list.push(short.to_owned());
    if short.len() < text.len() { TextFault::TooLong } else { TextFault::None }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::SourceFormat;

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
        assert_eq!(describe(&metadata, &mut report).as_deref(), Some("EPSG:32734"));
        assert_eq!(report.titles, ["Cape Town"]);
        assert_eq!(report.attributions.len(), 2);
        assert!(report.attributions.contains(&"OpenStreetMap contributors".to_owned()));
        assert_eq!(report.licences, ["CC BY 4.0"]);
    }
}
