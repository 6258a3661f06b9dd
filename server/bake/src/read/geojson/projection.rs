//! Converts positions to metres: degrees to a UTM zone of WGS84. Positions in projected systems stay as they are.

use proj4rs::Proj;
use proj4rs::adaptors::transform_vertex_2d;
use serde_json::Value;

use super::schema::GeoJsonPolygon;
use crate::read::json::{metadata, position::JsonPosition};
use crate::read::scene_builder::MAX_COORDINATE_M;

/// Latitudes for which UTM is defined.
const UTM_LATITUDES_DEG: std::ops::RangeInclusive<f64> = -80.0..=84.0;
/// Codes of Web Mercator, whose unit can be several times shorter than a metre.
const WEB_MERCATOR: &[&str] = &["EPSG:3857", "EPSG:3785", "EPSG:900913"];

/// How positions become metres.
pub(super) enum InputProjection {
    /// From longitude and latitude. The zone is that of the first valid position, unless another source chose it.
    /// Modern geographic systems differ from WGS84 by a metre or two, which is ignored.
    Degrees(Option<Box<UtmZone>>),
    /// Positions are in metres already.
    Metres,
}

impl InputProjection {
    /// Degrees, the default of GeoJSON. If the city's system is a UTM zone, positions go to that zone.
    pub(super) fn new(city_crs: Option<&str>) -> Self {
        Self::Degrees(city_crs.and_then(UtmZone::from_epsg).map(Box::new))
    }

    /// The EPSG code of the projected system that a `crs` member names; `None` for degrees. Fails with the reason if
    /// the system is not supported.
    pub(super) fn from_crs(crs: &Value) -> Result<Option<String>, String> {
        let name = match &crs["properties"] {
            properties if properties["name"].is_string() => properties["name"].as_str().unwrap_or_default().to_owned(),
            properties if properties["code"].is_number() => format!("EPSG:{}", properties["code"]),
            _ if crs.is_null() => return Ok(None),
            _ => return Err("its \"crs\" has no name; remove it, or export as WGS84".to_owned()),
        };
        if name.to_ascii_uppercase().contains("CRS84") {
            return Ok(None);
        }
        match metadata::epsg(&name) {
            None => Err(format!("its \"crs\" is \"{name}\", not an EPSG code; export it as WGS84")),
            Some(epsg) if metadata::is_degrees(&epsg) => Ok(None),
            Some(epsg) if WEB_MERCATOR.contains(&epsg.as_str()) => {
                Err(format!("its \"crs\" is {epsg}, which distorts lengths; export it as WGS84"))
            }
            Some(epsg) => Ok(Some(epsg)),
        }
    }

    /// Chooses the zone by the first position that has one. Returns its EPSG code if this call chose it.
    pub(super) fn choose_zone(&mut self, polygons: &[GeoJsonPolygon]) -> Option<String> {
        let Self::Degrees(zone @ None) = self else { return None };
        *zone = polygons.iter().flatten().flatten().find_map(UtmZone::containing).map(Box::new);
        zone.as_ref().map(|utm| utm.epsg.clone())
    }

    /// EPSG code of the zone to which degrees are projected, if it is chosen.
    pub(super) fn zone(&self) -> Option<&str> {
        match self {
            Self::Degrees(zone) => zone.as_ref().map(|utm| utm.epsg.as_str()),
            Self::Metres => None,
        }
    }

    /// Position in metres; `None` if it is invalid or no zone is chosen yet.
    pub(super) fn to_metres(&self, position: &JsonPosition) -> Option<[f64; 2]> {
        let [x, y, _] = position.0;
        match self {
            Self::Metres => (x.abs() <= MAX_COORDINATE_M && y.abs() <= MAX_COORDINATE_M).then_some([x, y]),
            Self::Degrees(zone) => zone.as_ref()?.project(position),
        }
    }
}

/// A zone of the universal transverse Mercator projection on WGS84.
pub(super) struct UtmZone {
    epsg: String,
    from: Proj,
    to: Proj,
}

impl UtmZone {
    /// The zone of an EPSG code: `EPSG:32654` is zone 54 north, `EPSG:32754` is zone 54 south.
    fn from_epsg(epsg: &str) -> Option<Self> {
        let code: u32 = epsg.strip_prefix("EPSG:")?.parse().ok()?;
        let (south, zone) = match code {
            32_601..=32_660 => ("", code - 32_600),
            32_701..=32_760 => (" +south", code - 32_700),
            _ => return None,
        };
        let from = Proj::from_proj_string("+proj=longlat +datum=WGS84").ok()?;
        let to = Proj::from_proj_string(&format!("+proj=utm +zone={zone}{south} +datum=WGS84 +units=m")).ok()?;
        Some(Self { epsg: epsg.to_owned(), from, to })
    }

    /// The zone of a position; `None` if it is invalid.
    fn containing(position: &JsonPosition) -> Option<Self> {
        let [longitude, latitude] = degrees(position)?;
        let zone = ((longitude + 180.0) / 6.0).floor().clamp(0.0, 59.0) as u32 + 1;
        Self::from_epsg(&format!("EPSG:{}", if latitude < 0.0 { 32_700 } else { 32_600 } + zone))
    }

    fn project(&self, position: &JsonPosition) -> Option<[f64; 2]> {
        let [longitude, latitude] = degrees(position)?;
        let radians = (longitude.to_radians(), latitude.to_radians());
        let (x, y) = transform_vertex_2d(&self.from, &self.to, radians).ok()?;
        (x.abs() <= MAX_COORDINATE_M && y.abs() <= MAX_COORDINATE_M).then_some([x, y])
    }
}

/// Longitude and latitude, if UTM is defined there.
fn degrees(position: &JsonPosition) -> Option<[f64; 2]> {
    let [longitude, latitude, _] = position.0;
    (longitude.abs() <= 180.0 && UTM_LATITUDES_DEG.contains(&latitude)).then_some([longitude, latitude])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn project_first(longitude: f64, latitude: f64) -> (String, [f64; 2]) {
        let position = JsonPosition([longitude, latitude, f64::NAN]);
        let mut projection = InputProjection::new(None);
        let epsg = projection.choose_zone(&[vec![vec![position]]]).unwrap();
        assert_eq!(
            projection.choose_zone(&[vec![vec![JsonPosition([0.0, 0.0, 0.0])]]]),
            None,
            "the zone is chosen once"
        );
        (epsg, projection.to_metres(&position).unwrap())
    }

    #[test]
    fn positions_around_the_world_are_projected_to_their_zone() {
        // The central meridian of zone 33 on the equator, where 1 degree of longitude is 111.28 km.
        let (epsg, [x, y]) = project_first(15.0, 0.0);
        assert!(epsg == "EPSG:32633" && (x - 500_000.0).abs() < 1e-6 && y.abs() < 1e-6, "{x} {y}");
        let (_, [x, y]) = project_first(16.0, 0.0);
        assert!((x - 611_280.0).abs() < 10.0 && y.abs() < 1e-3, "{x} {y}");
        // The meridian's length from the equator to 45 degrees north is 4,984,944.378 m on WGS84, times 0.9996.
        let (_, [x, y]) = project_first(15.0, 45.0);
        assert!((x - 500_000.0).abs() < 1e-3 && (y - 4_984_944.378 * 0.9996).abs() < 0.002, "{x} {y}");
        let (epsg, [_, south]) = project_first(15.0, -45.0);
        assert_eq!(epsg, "EPSG:32733");
        assert!((south + y - 1e7).abs() < 1e-3, "{south}");
        assert_eq!(project_first(180.0, 10.0).0, "EPSG:32660");
        assert_eq!(project_first(-180.0, 10.0).0, "EPSG:32601");
        assert_eq!(project_first(139.75, 35.69).0, "EPSG:32654");
    }

    #[test]
    fn invalid_positions_have_no_projection() {
        for [longitude, latitude] in [[181.0, 0.0], [0.0, 85.0], [0.0, -80.5], [f64::NAN, 0.0], [0.0, f64::INFINITY]] {
            let position = JsonPosition([longitude, latitude, 0.0]);
            assert!(UtmZone::containing(&position).is_none());
            assert_eq!(InputProjection::new(Some("EPSG:32633")).to_metres(&position), None);
        }
        assert_eq!(InputProjection::Metres.to_metres(&JsonPosition([1e10, 0.0, 0.0])), None);
    }

    #[test]
    fn crs_member_is_understood_in_every_spelling() {
        let named = |text: &str| InputProjection::from_crs(&serde_json::from_str(text).unwrap());
        let name = |name: &str| format!(r#"{{"type": "name", "properties": {{"name": "{name}"}}}}"#);
        for degrees in ["urn:ogc:def:crs:OGC:1.3:CRS84", "EPSG:4326", "urn:ogc:def:crs:EPSG::6668"] {
            assert!(named(&name(degrees)).unwrap().is_none(), "{degrees}");
        }
        assert!(named("null").unwrap().is_none());
        assert_eq!(named(&name("urn:ogc:def:crs:EPSG::28992")).unwrap().unwrap(), "EPSG:28992");
        assert_eq!(named(r#"{"type": "EPSG", "properties": {"code": 6677}}"#).unwrap().unwrap(), "EPSG:6677");
        for wrong in [name("EPSG:3857"), name("Amersfoort"), "{}".to_owned(), "7".to_owned()] {
            assert!(named(&wrong).is_err(), "{wrong}");
        }
    }
}
