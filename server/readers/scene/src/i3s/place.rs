//! The coordinate system of a layer and the unit of its heights.

use super::layer::LayerJson;
use insula_source::object::CrsReference;
use insula_source::units::{FOOT_M, US_FOOT_M, metres_of};

/// Codes from here on are Esri's own.
const FIRST_ESRI_CODE: i64 = 100_000;
/// Esri's code for heights over the ellipsoid of WGS 84.
const WGS84_HEIGHT: i64 = 115_700;
/// Codes of systems in degrees are below this one and above 4000.
const DEGREES: std::ops::Range<i64> = 4001..5000;

#[derive(Debug, Clone, PartialEq)]
pub(super) struct LayerPlace {
    /// `None` if the layer does not name a system.
    pub(super) crs: Option<CrsReference>,
    /// Whether x and y are degrees.
    pub(super) is_in_degrees: bool,
    /// Metres of a unit of height.
    pub(super) height_unit_m: f64,
    /// Added to all heights in metres.
    pub(super) height_offset_m: f64,
    /// A unit of heights that is not known.
    pub(super) unknown_unit: Option<String>,
    /// Whether heights are above a ground that the layer does not tell.
    pub(super) is_relative: bool,
}

impl LayerPlace {
    /// `ZFactor` has no part in it: it is the unit of the data that the layer was made of, while the heights of the layer
    /// are in the unit of `heightModelInfo`.
    pub(super) fn new(layer: &LayerJson) -> Self {
        let reference = layer.spatial_reference.as_ref();
        let positive = |code: Option<i64>| code.filter(|code| *code > 0);
        let code = reference.and_then(|reference| positive(reference.latest_wkid).or(positive(reference.wkid)));
        let vertical =
            reference.and_then(|reference| positive(reference.latest_vcs_wkid).or(positive(reference.vcs_wkid)));
        let model = layer.height_model_info.as_ref();
        let height_model = model.and_then(|model| model.height_model.as_deref());
        let is_ellipsoidal = match height_model {
            Some(model) => model.eq_ignore_ascii_case("ellipsoidal"),
            None => vertical == Some(WGS84_HEIGHT),
        };
        let heights = if is_ellipsoidal { "+4979" } else { "" };
        let wkt = reference.and_then(|reference| reference.wkt.clone()).filter(|wkt| !wkt.is_empty());
        let name = match code {
            // Web Mercator, by the codes that came before EPSG's.
            Some(102_100 | 102_113) => Some(format!("EPSG:3857{heights}")),
            Some(code) if code >= FIRST_ESRI_CODE => Some(wkt.unwrap_or_else(|| format!("ESRI:{code}"))),
            Some(code) => Some(format!("EPSG:{code}{heights}")),
            None => wkt.or_else(|| layer.store.as_ref().and_then(|store| store.vertex_crs.clone())),
        };
        let is_in_degrees = match code {
            Some(code) => DEGREES.contains(&code),
            None => name.as_deref().is_some_and(|name| name.ends_with("4326") || name.starts_with("GEOGCS")),
        };
        let elevation = layer.elevation_info.as_ref();
        let offset = elevation.filter(|elevation| elevation.mode.as_deref() == Some("absoluteHeight"));
        let offset_m = offset.and_then(|elevation| {
            Some(elevation.offset? * elevation.unit.as_deref().and_then(metres_of).unwrap_or(1.0))
        });
        let mode = elevation.and_then(|elevation| elevation.mode.as_deref());
        let is_relative = matches!(mode, Some("relativeToGround" | "onTheGround"));
        let unit = model.and_then(|model| model.height_unit.as_deref()).filter(|unit| !unit.trim().is_empty());
        let unit_m = unit.and_then(metres_of);
        let unknown_unit = unit.filter(|_| unit_m.is_none()).map(str::to_owned);
        let unit_m = unit_m.or(vertical.map(unit_of_vertical));
        // Heights are converted here: the unit of the system must not be applied again. It is theirs if no other is told.
        let crs =
            name.map(|name| CrsReference { height_unit_m: unit_m.map(|_| 1.0), ..CrsReference::east_first(name) });
        Self {
            crs,
            is_in_degrees,
            height_unit_m: unit_m.unwrap_or(1.0),
            height_offset_m: offset_m.filter(|offset| offset.is_finite()).unwrap_or(0.0),
            unknown_unit,
            is_relative,
        }
    }
}

/// Metres in the unit of a system of heights. Few are not in metres.
fn unit_of_vertical(code: i64) -> f64 {
    match code {
        // NGVD 29 and NAVD 88, by the codes of EPSG and of Esri.
        5702 | 6360 | 105_703 => US_FOOT_M,
        8228 => FOOT_M,
        _ => 1.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn place(json: &str) -> LayerPlace {
        LayerPlace::new(&serde_json::from_str(json).unwrap())
    }

    #[test]
    fn names_of_systems() {
        let cases = [
            (
                r#"{"spatialReference":{"wkid":4326},"heightModelInfo":{"heightModel":"ellipsoidal"}}"#,
                Some("EPSG:4326+4979"),
                true,
            ),
            (r#"{"spatialReference":{"wkid":4326,"vcsWkid":115700}}"#, Some("EPSG:4326+4979"), true),
            (
                r#"{"spatialReference":{"wkid":4326,"vcsWkid":5773},"heightModelInfo":{"heightModel":"gravity_related_height"}}"#,
                Some("EPSG:4326"),
                true,
            ),
            (r#"{"spatialReference":{"wkid":102100,"latestWkid":3857}}"#, Some("EPSG:3857"), false),
            (r#"{"spatialReference":{"wkid":102100}}"#, Some("EPSG:3857"), false),
            (r#"{"spatialReference":{"wkid":102711}}"#, Some("ESRI:102711"), false),
            (r#"{"spatialReference":{"wkid":-1,"wkt":"PROJCS[..]"}}"#, Some("PROJCS[..]"), false),
            (
                r#"{"store":{"vertexCRS":"http://www.opengis.net/def/crs/EPSG/0/4326"}}"#,
                Some("http://www.opengis.net/def/crs/EPSG/0/4326"),
                true,
            ),
            ("{}", None, false),
        ];
        for (json, name, is_in_degrees) in cases {
            let place = place(json);
            assert_eq!(place.crs.map(|crs| crs.name).as_deref(), name, "{json}");
            assert_eq!(place.is_in_degrees, is_in_degrees, "{json}");
        }
    }

    #[test]
    fn units_of_heights() {
        assert_eq!(place(r#"{"heightModelInfo":{"heightUnit":"us-foot"},"ZFactor":7}"#).height_unit_m, 1200.0 / 3937.0);
        let unknown = place(r#"{"heightModelInfo":{"heightUnit":"cubit"},"ZFactor":0.3048}"#);
        assert_eq!((unknown.height_unit_m, unknown.unknown_unit.as_deref()), (1.0, Some("cubit")));
        for (json, unit_m, of_system) in [
            (r#"{"spatialReference":{"wkid":2263},"heightModelInfo":{"heightUnit":"us-foot"}}"#, US_FOOT_M, Some(1.0)),
            (r#"{"spatialReference":{"wkid":2263,"vcsWkid":105703,"latestVcsWkid":6360}}"#, US_FOOT_M, Some(1.0)),
            (r#"{"spatialReference":{"wkid":2263,"vcsWkid":8228}}"#, FOOT_M, Some(1.0)),
            (r#"{"spatialReference":{"wkid":2263,"vcsWkid":5703}}"#, 1.0, Some(1.0)),
            (r#"{"spatialReference":{"wkid":2263}}"#, 1.0, None),
        ] {
            let place = place(json);
            assert_eq!((place.height_unit_m, place.crs.unwrap().height_unit_m), (unit_m, of_system), "{json}");
        }
        let raised = place(r#"{"elevationInfo":{"mode":"absoluteHeight","offset":10,"unit":"foot"}}"#);
        assert_eq!((raised.height_offset_m, raised.is_relative), (3.048, false));
        assert!(place(r#"{"elevationInfo":{"mode":"relativeToGround","offset":10}}"#).is_relative);
    }
}
