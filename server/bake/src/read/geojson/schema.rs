//! The part of GeoJSON's structure (RFC 7946) that is used.

use serde::Deserialize;
use serde_json::value::RawValue;
use serde_json::{Map, Value};

use crate::error::json_message;
use crate::read::json::position::JsonPosition;
use crate::read::object::Footprint;

/// A polygon: its outer ring, then its holes. Invalid coordinates are NaN.
type PolygonRings = Vec<Vec<JsonPosition>>;

#[derive(Deserialize, Default)]
#[serde(default)]
pub(super) struct GeoJsonFeature {
    #[serde(rename = "type")]
    pub(super) kind: String,
    id: Value,
    #[serde(deserialize_with = "or_default")]
    pub(super) properties: Map<String, Value>,
    pub(super) geometry: Option<GeoJsonGeometry>,
}

#[derive(Deserialize, Default)]
#[serde(default)]
pub(super) struct GeoJsonGeometry {
    #[serde(rename = "type")]
    pub(super) kind: String,
    coordinates: Option<Box<RawValue>>,
    geometries: Vec<GeoJsonGeometry>,
}

/// Some writers put `null` for a feature without properties.
fn or_default<'de, D: serde::Deserializer<'de>>(deserializer: D) -> Result<Map<String, Value>, D::Error> {
    Ok(Option::deserialize(deserializer)?.unwrap_or_default())
}

impl GeoJsonFeature {
    /// The feature's identifier: its own, else one among its properties.
    pub(super) fn id(&self) -> Option<String> {
        let inside = ["id", "@id", "gml_id"].into_iter().filter_map(|name| self.properties.get(name));
        std::iter::once(&self.id).chain(inside).find_map(|value| match value {
            Value::String(text) if !text.is_empty() => Some(text.clone()),
            Value::Number(number) => Some(number.to_string()),
            _ => None,
        })
    }
}

impl GeoJsonGeometry {
    /// All polygons of the geometry and of its parts; none for points and lines. Fails with the reason if the
    /// coordinates are malformed.
    pub(super) fn footprints(&self) -> Result<Vec<Footprint>, String> {
        let text = self.coordinates.as_ref().map_or("[]", |raw| raw.get());
        let polygons: Result<Vec<PolygonRings>, serde_json::Error> = match self.kind.as_str() {
            "Polygon" => serde_json::from_str(text).map(|polygon| vec![polygon]),
            "MultiPolygon" => serde_json::from_str(text),
            "GeometryCollection" => {
                let parts: Result<Vec<_>, _> = self.geometries.iter().map(GeoJsonGeometry::footprints).collect();
                return Ok(parts?.concat());
            }
            _ => Ok(Vec::new()),
        };
        let on_map = |ring: &Vec<JsonPosition>| ring.iter().map(|JsonPosition([x, y, _])| [*x, *y]).collect();
        let footprint = |rings: &PolygonRings| Footprint { rings: rings.iter().map(on_map).collect() };
        polygons.map(|polygons| polygons.iter().map(footprint).collect()).map_err(|error| json_message(&error))
    }
}
