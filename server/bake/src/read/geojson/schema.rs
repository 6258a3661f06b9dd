//! Serde types of a GeoJSON feature, with the members that JSON-FG adds.

use serde::Deserialize;
use serde::de::DeserializeOwned;
use serde_json::value::RawValue;
use serde_json::{Map, Value};

use crate::error::json_message;
use crate::read::json::position::JsonPosition;
use crate::read::vector::{Geometry, Polygon, Ring, UNKNOWN_TYPE};

type Line = Vec<JsonPosition>;
type Rings = Vec<Line>;

#[derive(Deserialize, Default)]
#[serde(default)]
pub(super) struct GeoJsonFeature {
    #[serde(rename = "type")]
    pub(super) kind: String,
    id: Value,
    #[serde(deserialize_with = "or_default")]
    pub(super) properties: Map<String, Value>,
    pub(super) geometry: Option<GeoJsonGeometry>,
    /// Of JSON-FG: the geometry in `coordRefSys`, with shapes that GeoJSON lacks.
    pub(super) place: Option<GeoJsonGeometry>,
    #[serde(rename = "coordRefSys")]
    pub(super) crs: Value,
}

#[derive(Deserialize, Default)]
#[serde(default)]
pub(super) struct GeoJsonGeometry {
    #[serde(rename = "type")]
    pub(super) kind: String,
    coordinates: Option<Box<RawValue>>,
    geometries: Vec<GeoJsonGeometry>,
}

/// Reads an object or null.
fn or_default<'de, D: serde::Deserializer<'de>>(deserializer: D) -> Result<Map<String, Value>, D::Error> {
    Ok(Option::deserialize(deserializer)?.unwrap_or_default())
}

impl GeoJsonFeature {
    /// The feature's identifier: its own, else that of its properties.
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
    /// The geometry of all parts. Heights count only if all positions have one. Fails with the reason and details.
    pub(super) fn geometry(&self) -> Result<Geometry, (&'static str, String)> {
        let mut geometry = Geometry::default();
        self.add_to(&mut geometry)?;
        let mut has_z = geometry.positions().next().is_some();
        has_z &= geometry.positions().all(|position| position[2].is_finite());
        if !has_z {
            let rings = geometry.polygons.iter_mut().flatten().chain(&mut geometry.lines).flatten();
            rings.chain(&mut geometry.points).for_each(|position| position[2] = 0.0);
        }
        geometry.has_z = has_z;
        Ok(geometry)
    }

    fn add_to(&self, geometry: &mut Geometry) -> Result<(), (&'static str, String)> {
        match self.kind.as_str() {
            "Point" => geometry.push_point(self.parse::<Option<JsonPosition>>()?.map_or([f64::NAN; 3], |at| at.0)),
            "MultiPoint" => self.parse::<Line>()?.into_iter().for_each(|point| geometry.push_point(point.0)),
            "LineString" => geometry.push_line(ring(self.parse()?)),
            "MultiLineString" => self.parse::<Rings>()?.into_iter().for_each(|line| geometry.push_line(ring(line))),
            "Polygon" => geometry.push_polygon(polygon(self.parse()?)),
            "MultiPolygon" => add_polygons(self.parse()?, geometry),
            "Polyhedron" => {
                geometry.is_surface = true;
                self.parse::<Vec<Vec<Rings>>>()?.into_iter().for_each(|shell| add_polygons(shell, geometry));
            }
            "MultiPolyhedron" => {
                geometry.is_surface = true;
                let bodies: Vec<Vec<Vec<Rings>>> = self.parse()?;
                bodies.into_iter().flatten().for_each(|shell| add_polygons(shell, geometry));
            }
            "GeometryCollection" => self.geometries.iter().try_for_each(|part| part.add_to(geometry))?,
            kind => {
                let kind = &kind[..kind.floor_char_boundary(64)];
                return Err((UNKNOWN_TYPE, format!("its geometry is \"{kind}\"")));
            }
        }
        Ok(())
    }

    fn parse<T: DeserializeOwned + Default>(&self) -> Result<T, (&'static str, String)> {
        let Some(raw) = &self.coordinates else { return Ok(T::default()) };
        serde_json::from_str(raw.get()).map_err(|error| ("malformed coordinates", json_message(&error)))
    }
}

fn ring(line: Line) -> Ring {
    line.into_iter().map(|position| position.0).collect()
}

fn polygon(rings: Rings) -> Polygon {
    rings.into_iter().map(ring).collect()
}

fn add_polygons(polygons: Vec<Rings>, geometry: &mut Geometry) {
    polygons.into_iter().for_each(|rings| geometry.push_polygon(polygon(rings)));
}
