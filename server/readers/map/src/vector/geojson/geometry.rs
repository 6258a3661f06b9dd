//! Geometries of GeoJSON and JSON-FG.

use super::schema::{GeoJsonGeometry, name_of};
use crate::vector::geometry::{Geometry, MALFORMED, MAX_DEPTH, Polygon, Ring, TOO_DEEP, UNKNOWN_TYPE, is_same_place};
use insula_dress::palette::area_vector;
use insula_place::crs;
use insula_source::arc::divide_arcs;
use insula_source::error::json_message;
use insula_source::json::position::JsonPosition;
use serde::Deserialize;

/// Types whose documents are read as one feature without properties.
pub(super) const GEOMETRY_TYPES: [&str; 7] =
    ["Point", "MultiPoint", "LineString", "MultiLineString", "Polygon", "MultiPolygon", "GeometryCollection"];

/// Whether a text is a geometry, as some portals have it in a column of a table.
pub(in crate::vector) fn looks_like_geometry(text: &str) -> bool {
    text.trim_start().starts_with('{') && text.contains("\"coordinates\"")
}

/// Reads a geometry that is a text of its own, and the code of its system if it tells one. Fails with the reason for skipping the feature.
pub(in crate::vector) fn parse_geometry(text: &str) -> Result<(Geometry, Option<u32>), &'static str> {
    let geometry: GeoJsonGeometry = serde_json::from_str(text).map_err(|_| MALFORMED)?;
    let name = geometry.crs.as_ref().and_then(|crs| name_of(crs).ok().flatten());
    let code = name.and_then(|name| crs::resolve(&name).ok()?.horizontal.code);
    Ok((geometry.read().map_err(|fault| fault.reason)?, code))
}

/// Why a geometry cannot be read.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Fault {
    pub(super) reason: &'static str,
    pub(super) detail: Option<String>,
}

impl From<&'static str> for Fault {
    fn from(reason: &'static str) -> Self {
        Self { reason, detail: None }
    }
}

type JsonRing = Vec<JsonPosition>;

impl GeoJsonGeometry {
    /// All parts of the geometry. Heights that some positions lack are no numbers.
    pub(super) fn read(&self) -> Result<Geometry, Fault> {
        let mut geometry = Geometry::default();
        self.add_to(&mut geometry, 0)?;
        geometry.settle_heights();
        Ok(geometry)
    }

    fn add_to(&self, into: &mut Geometry, depth: u32) -> Result<(), Fault> {
        if depth > MAX_DEPTH {
            return Err(TOO_DEEP.into());
        }
        match self.kind.as_str() {
            "Point" => into.push_point(self.parse::<JsonPosition>()?.map_or([f64::NAN; 3], |JsonPosition(at)| at)),
            "MultiPoint" => self.list::<JsonPosition>()?.iter().for_each(|JsonPosition(at)| into.push_point(*at)),
            "LineString" => into.push_line(ring(self.list()?)),
            "MultiLineString" => self.list()?.into_iter().for_each(|line| into.push_line(ring(line))),
            "Polygon" => into.push_polygon(polygon(self.list()?)),
            "MultiPolygon" => self.list()?.into_iter().for_each(|rings| into.push_polygon(polygon(rings))),
            "Polyhedron" => self.add_shells(self.list()?, into),
            "MultiPolyhedron" => self.list()?.into_iter().for_each(|shells| self.add_shells(shells, into)),
            "Prism" => self.add_prism(into)?,
            "CircularString" | "CompoundCurve" => into.push_line(self.curve(depth)?),
            "CurvePolygon" => {
                let rings: Result<Polygon, Fault> = self.geometries.iter().map(|part| part.curve(depth + 1)).collect();
                into.push_polygon(rings?);
            }
            "GeometryCollection" | "MultiPrism" | "MultiCurve" | "MultiSurface" => {
                // Prisms of an older draft.
                let parts: Vec<Self> = if self.kind == "MultiPrism" { self.draft_prisms()? } else { Vec::new() };
                for part in self.geometries.iter().chain(&self.prisms).chain(&parts) {
                    part.add_to(into, depth + 1)?;
                }
            }
            kind => {
                let detail = format!("\"{}\"", kind.chars().take(64).collect::<String>());
                return Err(Fault { reason: UNKNOWN_TYPE, detail: Some(detail) });
            }
        }
        Ok(())
    }

    /// The coordinates; `None` without any.
    fn parse<'t, T: Deserialize<'t>>(&'t self) -> Result<Option<T>, Fault> {
        let Some(text) = &self.coordinates else { return Ok(None) };
        let parsed = serde_json::from_str(text.get());
        parsed.map_err(|error| Fault { reason: "malformed coordinates", detail: Some(json_message(&error)) })
    }

    fn list<'t, T: Deserialize<'t>>(&'t self) -> Result<Vec<T>, Fault> {
        Ok(self.parse()?.unwrap_or_default())
    }

    fn draft_prisms(&self) -> Result<Vec<Self>, Fault> {
        let text = self.coordinates.as_ref().map_or("[]", |raw| raw.get());
        serde_json::from_str(text)
            .map_err(|error| Fault { reason: "malformed coordinates", detail: Some(json_message(&error)) })
    }

    /// Adds the faces of shells: the outer one, then cavities.
    fn add_shells(&self, shells: Vec<Vec<Vec<JsonRing>>>, into: &mut Geometry) {
        into.is_surface = true;
        shells.into_iter().flatten().for_each(|face| into.push_polygon(polygon(face)));
    }

    /// Adds the faces of a prism. Its base has a height of its own, unless `lower` tells it.
    fn add_prism(&self, into: &mut Geometry) -> Result<(), Fault> {
        let (Some(base), Some(upper)) = (&self.base, self.upper) else {
            return Err("prism without a base or an upper height".into());
        };
        let rings: Vec<Polygon> = match base.kind.as_str() {
            "Polygon" => vec![polygon(base.list()?)],
            "MultiPolygon" => base.list()?.into_iter().map(polygon).collect(),
            _ => return Err("prism whose base is no polygon".into()),
        };
        into.is_surface = true;
        for plan in rings {
            let low = |[x, y, z]: [f64; 3]| [x, y, self.lower.unwrap_or(if z.is_finite() { z } else { 0.0 })];
            let high = |[x, y, _]: [f64; 3]| [x, y, upper];
            let turned = (0..).zip(plan).map(|(number, ring)| turned(ring, number == 0));
            let (mut floor, mut roof) = (Polygon::new(), Polygon::new());
            for ring in turned {
                floor.push(ring.iter().rev().map(|at| low(*at)).collect());
                roof.push(ring.iter().map(|at| high(*at)).collect());
                for pair in ring.windows(2) {
                    let [a, b] = [pair[0], pair[1]];
                    into.push_polygon(vec![vec![low(a), low(b), high(b), high(a), low(a)]]);
                }
            }
            into.push_polygon(floor);
            into.push_polygon(roof);
        }
        Ok(())
    }

    /// The positions of a curve, with its arcs divided.
    fn curve(&self, depth: u32) -> Result<Ring, Fault> {
        if depth > MAX_DEPTH {
            return Err(TOO_DEEP.into());
        }
        match self.kind.as_str() {
            "LineString" => Ok(ring(self.list()?)),
            "CircularString" => Ok(divide_arcs(&ring(self.list()?))),
            "CompoundCurve" => {
                let mut line = Ring::new();
                for part in &self.geometries {
                    let part = part.curve(depth + 1)?;
                    let is_joined = is_same_place(line.last(), part.first());
                    line.extend(part.into_iter().skip(usize::from(is_joined)));
                }
                Ok(line)
            }
            _ => Err("curve of unknown type".into()),
        }
    }
}

fn ring(positions: JsonRing) -> Ring {
    positions.into_iter().map(|JsonPosition(position)| position).collect()
}

fn polygon(rings: Vec<JsonRing>) -> Polygon {
    rings.into_iter().map(ring).collect()
}

/// The ring, closed, counter-clockwise on the map if it is the outer one, else clockwise.
fn turned(mut ring: Ring, is_outer: bool) -> Ring {
    if !is_same_place(ring.first(), ring.last()) {
        ring.extend(ring.first().copied());
    }
    let on_map: Ring = ring.iter().map(|[x, y, _]| [*x, *y, 0.0]).collect();
    if (area_vector(&on_map).z < 0.0) == is_outer {
        ring.reverse();
    }
    ring
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Geometry, Fault> {
        serde_json::from_str::<GeoJsonGeometry>(text).unwrap().read()
    }

    #[test]
    fn geometries_of_all_types_are_read() {
        let points = read(r#"{"type": "MultiPoint", "coordinates": [[1, 2, 3], [4, 5, 6]]}"#).unwrap();
        assert_eq!((points.points.len(), points.has_z), (2, true));
        let lines = read(r#"{"type": "MultiLineString", "coordinates": [[[1, 2, 3], [4, 5]], []]}"#).unwrap();
        assert!(lines.has_z && lines.lines[0][0] == [1.0, 2.0, 3.0] && lines.lines[0][1][2].is_nan(), "{lines:?}");
        let plain = read(r#"{"type": "MultiLineString", "coordinates": [[[1, 2], [4, 5]], []]}"#).unwrap();
        assert_eq!((plain.lines, plain.has_z), (vec![vec![[1.0, 2.0, 0.0], [4.0, 5.0, 0.0]]], false));
        let arc = r#"{"type": "CircularString", "coordinates": [[0, 0], [1, 1], [2, 0]]}"#;
        let straight = r#"{"type": "LineString", "coordinates": [[2, 0], [0, 0]]}"#;
        let curve = format!(r#"{{"type": "CompoundCurve", "geometries": [{arc}, {straight}]}}"#);
        let area = read(&format!(r#"{{"type": "CurvePolygon", "geometries": [{curve}]}}"#)).unwrap();
        assert_eq!((area.polygons[0][0].len(), area.polygons[0][0].last()), (47, Some(&[0.0, 0.0, 0.0])));
        let prism = r#"{"type": "Prism", "lower": 3, "upper": 9,
            "base": {"type": "Polygon", "coordinates": [[[0, 0], [0, 4], [4, 4], [4, 0], [0, 0]]]}}"#;
        let body = read(&format!(r#"{{"type": "MultiPrism", "geometries": [{prism}]}}"#)).unwrap();
        assert!(body.is_surface && body.has_z && body.polygons.len() == 6, "{body:?}");
        assert!(area_vector(&body.polygons[5][0]).z > 0.0 && area_vector(&body.polygons[4][0]).z < 0.0);
        let multi = format!(r#"{{"type": "MultiPrism", "prisms": [{prism}, {prism}]}}"#);
        assert_eq!(read(&multi).unwrap().polygons.len(), 12);
        let draft = format!(r#"{{"type": "MultiPrism", "coordinates": [{prism}, {prism}]}}"#);
        assert_eq!(read(&draft).unwrap().polygons.len(), 12);
    }

    #[test]
    fn faulty_geometries_say_why() {
        let reason = |text: &str| read(text).unwrap_err();
        assert_eq!(reason(r#"{"type": "Klein"}"#).detail.as_deref(), Some("\"Klein\""));
        assert_eq!(reason(r#"{"type": "Polygon", "coordinates": 7}"#).reason, "malformed coordinates");
        assert_eq!(reason(r#"{"type": "Prism", "upper": 7}"#).reason, "prism without a base or an upper height");
        let mut deep = r#"{"type": "Point", "coordinates": [1, 2]}"#.to_owned();
        for _ in 0..20 {
            deep = format!(r#"{{"type": "GeometryCollection", "geometries": [{deep}]}}"#);
        }
        assert_eq!(reason(&deep).reason, TOO_DEEP);
        assert!(read(r#"{"type": "Polygon"}"#).unwrap().is_empty());
    }
}
