//! The part of the structure of GeoJSON (RFC 7946) and JSON-FG that is used.

use insula_source::json::members::{MemberValue, Members};
use serde::Deserialize;
use serde_json::Value;
use serde_json::value::RawValue;

#[derive(Deserialize, Default)]
#[serde(default)]
pub(super) struct GeoJsonFeature {
    #[serde(rename = "type")]
    pub(super) kind: String,
    id: MemberValue,
    #[serde(deserialize_with = "or_default")]
    pub(super) properties: Members,
    pub(super) geometry: Option<GeoJsonGeometry>,
    /// JSON-FG: the geometry in another system, or of another type.
    pub(super) place: Option<GeoJsonGeometry>,
    /// JSON-FG: the system of `place`.
    #[serde(rename = "coordRefSys")]
    pub(super) coord_ref_sys: Option<Value>,
    /// The system of `geometry`, as before RFC 7946.
    pub(super) crs: Option<Value>,
}

#[derive(Deserialize, Default)]
#[serde(default)]
pub(super) struct GeoJsonGeometry {
    #[serde(rename = "type")]
    pub(super) kind: String,
    pub(super) coordinates: Option<Box<RawValue>>,
    /// Its system, as databases write it, before that of its feature.
    pub(super) crs: Option<Value>,
    pub(super) geometries: Vec<GeoJsonGeometry>,
    /// JSON-FG: those of a `MultiPrism`.
    pub(super) prisms: Vec<GeoJsonGeometry>,
    /// JSON-FG: the system of a `place`, before that of its feature.
    #[serde(rename = "coordRefSys")]
    pub(super) coord_ref_sys: Option<Value>,
    /// JSON-FG: plan of a prism, and the heights of its ends.
    pub(super) base: Option<Box<GeoJsonGeometry>>,
    pub(super) lower: Option<f64>,
    pub(super) upper: Option<f64>,
}

/// Some writers put `null` for a feature without properties.
fn or_default<'de, D: serde::Deserializer<'de>>(deserializer: D) -> Result<Members, D::Error> {
    Ok(Option::deserialize(deserializer)?.unwrap_or_default())
}

impl GeoJsonFeature {
    /// The feature's identifier: its own, else one among its properties.
    pub(super) fn id(&self) -> Option<String> {
        let inside = ["id", "@id", "gml_id"].into_iter().filter_map(|name| self.properties.get(name));
        std::iter::once(&self.id).chain(inside).find_map(|value| match value {
            MemberValue::Text(text) if !text.is_empty() => Some(text.clone()),
            MemberValue::Number(number) => Some(number.to_string()),
            _ => None,
        })
    }
}

/// The name of the system in a `crs` member; `None` for the default. Fails with the reason if it has none.
pub(super) fn name_of(crs: &Value) -> Result<Option<String>, String> {
    match &crs["properties"] {
        properties if properties["name"].is_string() => {
            Ok(Some(properties["name"].as_str().unwrap_or_default().to_owned()))
        }
        properties if properties["code"].is_number() => Ok(Some(format!("EPSG:{}", properties["code"]))),
        _ if crs.is_null() => Ok(None),
        _ => Err("its \"crs\" has no name; remove it, or export as WGS84".to_owned()),
    }
}
