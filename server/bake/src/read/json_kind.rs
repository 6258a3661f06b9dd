//! What kind of city a JSON document is, by its beginning.

use insula_read_map::vector;
use insula_source::source::{CitySource, open};
use std::io::Read;

/// Bytes at the beginning of a document that are searched.
const SEARCHED_BYTES: u64 = 64 << 10;
/// Longest text of a member that tells the type.
const MAX_TYPE_BYTES: u64 = 1 << 20;

/// Begins each record of GeoJSON as a sequence.
const RECORD_SEPARATOR: u8 = 0x1e;

/// Formats that have the same file extension.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum JsonKind {
    /// A collection of features, a feature or a geometry.
    GeoJson,
    /// 3D Tiles.
    Tileset,
    /// I3S.
    SceneLayer,
    /// Quantized-mesh.
    Terrain,
    /// CityJSON, or no city.
    Other,
}

/// The kind of a document. Text that cannot be read is of another kind: its reader says why.
pub(super) fn of(source: &CitySource<'_>) -> JsonKind {
    let mut start = Vec::new();
    if let Ok(opened) = open(source) {
        // A fault of the file is found again by its reader.
        let _ = opened.reader.take(SEARCHED_BYTES).read_to_end(&mut start);
    }
    if start.trim_ascii_start().first() == Some(&RECORD_SEPARATOR) {
        return JsonKind::GeoJson;
    }
    let has = |text: &str| start.windows(text.len()).any(|window| window == text.as_bytes());
    let type_name = vector::read_type(source, MAX_TYPE_BYTES);
    match type_name.as_deref() {
        Some(name) if vector::is_geojson(name) => JsonKind::GeoJson,
        Some("CityJSON") => JsonKind::Other,
        _ if has("\"geometricError\"") && has("\"asset\"") => JsonKind::Tileset,
        _ if has("\"tiles\"") && has("quantized-mesh") => JsonKind::Terrain,
        _ if has("\"layerType\"") && has("\"store\"") => JsonKind::SceneLayer,
        _ => JsonKind::Other,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_source::source::embedded;

    #[test]
    fn kinds_are_told_by_their_members() {
        let kind = |text: &str| of(&embedded(&[("a.json", text.as_bytes())])[0]);
        assert_eq!(kind(r#"{"features": [], "type": "FeatureCollection"}"#), JsonKind::GeoJson);
        assert_eq!(kind(r#"{"geometry": null, "type": "Feature"}"#), JsonKind::GeoJson);
        assert_eq!(kind("\u{1e}{"), JsonKind::GeoJson);
        assert_eq!(kind(r#"{"type": "CityJSONFeature"}"#), JsonKind::Other);
        assert_eq!(kind(r#"{"asset": {"version": "1.0"}, "geometricError": 5, "root": {}}"#), JsonKind::Tileset);
        assert_eq!(kind(r#"{"id": 0, "layerType": "3DObject", "store": {}}"#), JsonKind::SceneLayer);
        assert_eq!(kind(r#"{"tilejson": "2.1.0", "format": "quantized-mesh-1.0", "tiles": []}"#), JsonKind::Terrain);
        assert_eq!(kind(r#"{"type": "CityJSON", "geometricError": 1, "asset": 2}"#), JsonKind::Other);
        assert_eq!(kind("{"), JsonKind::Other);
    }
}
