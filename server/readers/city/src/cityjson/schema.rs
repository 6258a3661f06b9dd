//! The part of CityJSON's structure that is used. City objects stay text at first, so that a malformed one costs only
//! itself.

use super::nested::{Filled, Nested};
use insula_source::json::members::entries;
use insula_source::json::position::JsonPosition;
use insula_source::object::unit_to_byte;
use serde::Deserialize;
use serde::de::{Deserializer, IgnoredAny};
use serde_json::Value;
use serde_json::value::RawValue;
use std::collections::BTreeMap;

/// A whole file, the header line of a sequence, or a feature of one: they have the same members.
#[derive(Deserialize, Default)]
#[serde(default)]
pub(crate) struct CityJsonDocument<'a> {
    #[serde(rename = "type")]
    pub(crate) kind: Option<String>,
    pub(crate) version: Option<String>,
    pub(crate) id: Option<String>,
    pub(crate) transform: Option<VertexTransform>,
    #[serde(borrow)]
    pub(crate) metadata: Option<&'a RawValue>,
    #[serde(rename = "CityObjects", borrow)]
    pub(crate) city_objects: RawObjects<'a>,
    pub(crate) vertices: Vec<JsonPosition>,
    /// A [`CityJsonAppearance`]. Unparsed like the templates, so that a fault in it costs only the appearance, not the
    /// file.
    #[serde(borrow)]
    pub(crate) appearance: Option<&'a RawValue>,
    /// [`GeometryTemplates`].
    #[serde(rename = "geometry-templates", borrow)]
    pub(crate) templates: Option<&'a RawValue>,
}

pub(crate) struct ObjectText<'a> {
    pub(crate) id: &'a str,
    pub(crate) json: &'a str,
}

/// Unparsed objects in the order of the file.
#[derive(Default)]
pub(crate) struct RawObjects<'a>(Vec<(String, &'a RawValue)>);

impl RawObjects<'_> {
    pub(crate) fn texts(&self) -> Vec<ObjectText<'_>> {
        self.0.iter().map(|(id, raw)| ObjectText { id, json: raw.get() }).collect()
    }
}

impl<'de: 'a, 'a> Deserialize<'de> for RawObjects<'a> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        entries(deserializer, "a map of city objects").map(Self)
    }
}

/// Converts integer vertices to world positions.
#[derive(Deserialize, Clone, Copy, Debug)]
pub(crate) struct VertexTransform {
    pub(crate) scale: [f64; 3],
    pub(crate) translate: [f64; 3],
}

impl VertexTransform {
    pub(crate) fn apply(&self, p: [f64; 3]) -> [f64; 3] {
        std::array::from_fn(|axis| p[axis] * self.scale[axis] + self.translate[axis])
    }
}

/// Materials and textures.
#[derive(Deserialize, Default)]
#[serde(default)]
pub(crate) struct CityJsonAppearance {
    pub(crate) materials: Vec<CityJsonMaterial>,
    pub(crate) textures: Vec<CityJsonTexture>,
    #[serde(rename = "vertices-texture")]
    pub(crate) vertices_texture: Vec<[f64; 2]>,
    /// Names of themes, of any type, so that an odd one does not cost the appearance.
    #[serde(rename = "default-theme-texture")]
    pub(crate) default_theme_texture: Value,
    #[serde(rename = "default-theme-material")]
    pub(crate) default_theme_material: Value,
}

#[derive(Deserialize, Default)]
#[serde(default)]
pub(crate) struct CityJsonMaterial {
    #[serde(rename = "diffuseColor")]
    pub(crate) diffuse_colour: Option<[f64; 3]>,
    /// 0 (opaque) to 1. Of any type, so that an odd one does not cost the other materials.
    pub(crate) transparency: Value,
}

impl CityJsonMaterial {
    /// Its colour as 8-bit sRGB.
    pub(crate) fn rgb(&self) -> Option<[u8; 3]> {
        self.diffuse_colour.map(|rgb| rgb.map(unit_to_byte))
    }

    /// Whether something can be seen through it.
    pub(crate) fn is_transparent(&self) -> bool {
        self.transparency.as_f64().is_some_and(|share| share > 0.0)
    }
}

#[derive(Deserialize, Default)]
#[serde(default)]
pub(crate) struct CityJsonTexture {
    pub(crate) image: String,
    /// Of any type, so that an odd one does not cost the appearance.
    #[serde(rename = "wrapMode")]
    pub(crate) wrap_mode: Value,
}

/// Geometries that objects place, possibly several times.
#[derive(Deserialize, Default)]
#[serde(default)]
pub(crate) struct GeometryTemplates {
    pub(crate) templates: Vec<CityJsonGeometry>,
    #[serde(rename = "vertices-templates")]
    pub(crate) vertices: Vec<JsonPosition>,
}

#[derive(Deserialize, Default)]
#[serde(default)]
pub(crate) struct CityObject {
    #[serde(rename = "type")]
    pub(crate) kind: String,
    pub(crate) geometry: Option<Vec<CityJsonGeometry>>,
}

#[derive(Deserialize, Default)]
#[serde(default)]
pub(crate) struct CityJsonGeometry {
    #[serde(rename = "type")]
    pub(crate) kind: String,
    pub(crate) lod: CityJsonLod,
    pub(crate) boundaries: Nested,
    pub(crate) semantics: Option<SurfaceSemantics>,
    /// By theme.
    pub(crate) material: Option<BTreeMap<String, ThemeValues>>,
    /// By theme.
    pub(crate) texture: Option<BTreeMap<String, ThemeValues>>,
    pub(crate) template: Option<i64>,
    #[serde(rename = "transformationMatrix")]
    pub(crate) matrix: Option<Vec<f64>>,
}

/// How many levels of nesting are above the surfaces in a geometry's boundaries; `None` if it has no surfaces.
pub(crate) fn shell_depth(kind: &str) -> Option<u32> {
    match kind {
        "MultiSurface" | "CompositeSurface" => Some(0),
        "Solid" => Some(1),
        "MultiSolid" | "CompositeSolid" => Some(2),
        _ => None,
    }
}

#[derive(Deserialize, Default)]
#[serde(default)]
pub(crate) struct SurfaceSemantics {
    pub(crate) surfaces: Vec<SemanticSurface>,
    pub(crate) values: Nested,
}

#[derive(Deserialize, Default)]
#[serde(default)]
pub(crate) struct SemanticSurface {
    #[serde(rename = "type")]
    pub(crate) kind: String,
}

/// A value for the whole geometry (`value`) or per surface (`values`).
#[derive(Deserialize, Default)]
#[serde(default)]
pub(crate) struct ThemeValues {
    pub(crate) value: Nested,
    pub(crate) values: Nested,
}

impl ThemeValues {
    pub(crate) fn get(&self) -> &Nested {
        if self.values == Nested::Null { &self.value } else { &self.values }
    }
}

/// The part of an object that decides which of its geometries are used, and what its parts have in common. It is read
/// before everything else.
#[derive(Deserialize, Default)]
#[serde(default)]
pub(crate) struct ObjectOutline<'a> {
    #[serde(rename = "type")]
    pub(crate) kind: String,
    pub(crate) geometry: Option<Vec<GeometryOutline>>,
    pub(crate) parents: Option<Vec<String>>,
    pub(crate) children: Option<Vec<String>>,
    /// Unparsed, so that odd attributes do not cost the object.
    #[serde(borrow)]
    pub(crate) attributes: Option<&'a RawValue>,
}

#[derive(Deserialize, Default)]
#[serde(default)]
pub(crate) struct GeometryOutline {
    #[serde(rename = "type")]
    pub(crate) kind: String,
    pub(crate) lod: CityJsonLod,
    pub(crate) template: Option<i64>,
    pub(crate) boundaries: Filled,
}

/// A level of detail: a number, written as text since CityJSON 1.1. Negative if unknown.
#[derive(Clone, Copy, Debug, PartialEq, PartialOrd)]
pub(crate) struct CityJsonLod(pub(crate) f64);

impl Default for CityJsonLod {
    fn default() -> Self {
        Self(-1.0)
    }
}

impl<'de> Deserialize<'de> for CityJsonLod {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        #[derive(Deserialize)]
        #[serde(untagged)]
        enum LodMember {
            Number(f64),
            Text(String),
            Other(IgnoredAny),
        }
        let value = match LodMember::deserialize(deserializer)? {
            LodMember::Number(number) => Some(number),
            LodMember::Text(text) => text.trim().parse().ok(),
            LodMember::Other(_) => None,
        };
        Ok(value.filter(|lod: &f64| lod.is_finite()).map_or(Self::default(), Self))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_compare_as_numbers() {
        let lods: Vec<CityJsonLod> = serde_json::from_str(r#"["2.2", "2.1", 2, "1.3", "0", null, "x"]"#).unwrap();
        assert!(lods.windows(2).all(|pair| pair[0] >= pair[1]));
        assert_eq!(lods[2], CityJsonLod(2.0));
        assert_eq!(lods[6], CityJsonLod::default());
    }

    #[test]
    fn objects_keep_their_order_and_missing_coordinates_are_nan() {
        let text = r#"{"CityObjects": {"z": {"a": 1}, "a": 7}, "vertices": [[1, 2.5, 3, 4], [1, null, 3], [9]]}"#;
        let document: CityJsonDocument<'_> = serde_json::from_str(text).unwrap();
        let ids: Vec<_> = document.city_objects.texts().iter().map(|object| (object.id, object.json)).collect();
        assert_eq!(ids, [("z", r#"{"a": 1}"#), ("a", "7")]);
        assert_eq!(document.vertices[0], JsonPosition([1.0, 2.5, 3.0]));
        assert!(document.vertices[1].0[1].is_nan() && document.vertices[2].0[1].is_nan());
    }
}
