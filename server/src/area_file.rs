//! The file of an area on the map.

use insula_archive::file::read_text;
use insula_bake::read::EarthPlace;
use insula_export::selection::{Polygon, area_around};
use serde_json::Value;
use std::path::Path;

const MAX_BYTES: u64 = 16 << 20;
const MAX_DEPTH: u32 = 16;

/// All polygons of a GeoJSON file on the map of a city with these bounds. They may be in degrees, as GeoJSON has them, or in metres of the
/// city's coordinate system. Fails with file and reason if there is none, or if their places cannot be known.
pub(crate) fn read_polygons(
    path: &Path,
    city: [[f64; 2]; 2],
    place: Option<&EarthPlace>,
) -> Result<Vec<Polygon>, String> {
    let wrong = |reason: &str| format!("{}: {reason}", path.display());
    let text = read_text(path, MAX_BYTES).map_err(|error| wrong(&error.to_string()))?;
    let json: Value = serde_json::from_str(&text).map_err(|error| wrong(&error.to_string()))?;
    let mut polygons = Vec::new();
    let is_valid = add_polygons(&json, &mut polygons, 0).is_some();
    if !is_valid || polygons.is_empty() {
        return Err(wrong("no GeoJSON polygon, in degrees or in metres of the city's coordinate system"));
    }
    bring_to_map(&mut polygons.iter_mut().flatten().flatten().collect::<Vec<_>>(), city, place).map_err(wrong)?;
    Ok(polygons)
}

/// As [`read_polygons`]. Fails also if they have no place in common with the city.
pub(crate) fn polygons_in_city(
    path: &Path,
    city: [[f64; 2]; 2],
    place: Option<&EarthPlace>,
) -> Result<Vec<Polygon>, String> {
    let polygons = read_polygons(path, city, place)?;
    if meets(polygons.iter().flatten().flatten().copied(), city) {
        return Ok(polygons);
    }
    let reason =
        "beyond the city: write longitude before latitude in degrees, or metres of the city's coordinate system";
    Err(format!("{}: {reason}", path.display()))
}

/// Whether the rectangle around some points has a place in common with a city between two corners.
fn meets(points: impl Iterator<Item = [f64; 2]>, city: [[f64; 2]; 2]) -> bool {
    let [low, high] = area_around(points);
    (0..2).all(|axis| low[axis] <= city[1][axis] && city[0][axis] <= high[axis])
}

/// Brings the points of a file to the map of a city with these bounds: they may be in degrees, or in metres of the city. Fails if their
/// places cannot be known.
pub(crate) fn bring_to_map(
    points: &mut [&mut [f64; 2]],
    city: [[f64; 2]; 2],
    place: Option<&EarthPlace>,
) -> Result<(), &'static str> {
    let is_in_degrees = points.iter().all(|[x, y]| x.abs() <= 180.0 && y.abs() <= 90.0);
    if !is_in_degrees || meets(points.iter().map(|point| **point), city) {
        return Ok(());
    }
    let place = place
        .ok_or("it is in degrees, but it is not known where on Earth this city lies: write it in metres of the city")?;
    for point in points {
        **point = place.on_map(**point).ok_or("it is out of the city's coordinate system")?;
    }
    Ok(())
}

/// Adds the polygons of a collection, a feature or a geometry; `None` if one is malformed.
fn add_polygons(json: &Value, polygons: &mut Vec<Polygon>, depth: u32) -> Option<()> {
    let point = |point: &Value| Some([point.get(0)?.as_f64()?, point.get(1)?.as_f64()?]);
    let ring = |ring: &Value| ring.as_array()?.iter().map(point).collect::<Option<Vec<_>>>();
    let polygon = |rings: &Value| rings.as_array()?.iter().map(ring).collect::<Option<Polygon>>();
    let mut add_all = |list: &Value| {
        let is_deeper = depth < MAX_DEPTH;
        list.as_array().filter(|_| is_deeper)?.iter().try_for_each(|part| add_polygons(part, polygons, depth + 1))
    };
    match json.get("type").and_then(Value::as_str) {
        Some("FeatureCollection") => add_all(json.get("features")?)?,
        Some("GeometryCollection") => add_all(json.get("geometries")?)?,
        Some("Polygon") => polygons.push(polygon(json.get("coordinates")?)?),
        Some("MultiPolygon") => {
            for rings in json.get("coordinates")?.as_array()? {
                polygons.push(polygon(rings)?);
            }
        }
        // Of what has no area, nothing is selected.
        _ => json.get("geometry").map_or(Some(()), |geometry| add_polygons(geometry, polygons, depth + 1))?,
    }
    Some(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_polygons_count_in_degrees_and_in_metres() {
        let folder = tempfile::tempdir().unwrap();
        let place = EarthPlace::of("EPSG:25832").unwrap();
        let city = [[691_000.0, 5_334_000.0], [692_000.0, 5_335_000.0]];
        let read = |text: &str, place: Option<&EarthPlace>| {
            let path = folder.path().join("a.geojson");
            std::fs::write(&path, text).unwrap();
            read_polygons(&path, city, place)
        };
        let polygon = |ring: &str| format!(r#"{{"type": "Polygon", "coordinates": [{ring}]}}"#);
        let feature = |geometry: &str| format!(r#"{{"type": "Feature", "properties": {{}}, "geometry": {geometry}}}"#);
        let ring = "[[691000, 5334000], [691500, 5334000], [691500, 5334500]]";
        let metres = vec![vec![vec![[691_000.0, 5_334_000.0], [691_500.0, 5_334_000.0], [691_500.0, 5_334_500.0]]]];
        assert_eq!(read(&polygon(ring), None), Ok(metres.clone()));
        let multi = format!(r#"{{"type": "MultiPolygon", "coordinates": [[{ring}], [{ring}]]}}"#);
        let point = feature(r#"{"type": "Point", "coordinates": [1, 2]}"#);
        let all = [point, feature(&multi), feature(&polygon(ring)), feature("null")].join(",");
        let all = format!(r#"{{"type": "FeatureCollection", "features": [{all}]}}"#);
        assert_eq!(read(&all, None), Ok([&metres[..]; 3].concat()));
        let degrees = polygon("[[11.567, 48.13], [11.57, 48.13], [11.57, 48.14]]");
        let found = read(&degrees, Some(&place)).unwrap();
        assert!((found[0][0][0][0] - 691_000.0).abs() < 10.0, "{found:?}");
        assert!(read(&degrees, None).unwrap_err().contains("not known where on Earth"));
        for wrong in ["{}", r#"{"type": "Polygon", "coordinates": [[["a", 1]]]}"#, r#"{"type": "Polygon"}"#] {
            assert!(read(wrong, None).unwrap_err().contains("no GeoJSON polygon"), "{wrong}");
        }
    }

    #[test]
    fn polygons_beyond_the_city_are_told() {
        let folder = tempfile::tempdir().unwrap();
        let place = EarthPlace::of("EPSG:25832").unwrap();
        let city = [[691_000.0, 5_334_000.0], [692_000.0, 5_335_000.0]];
        let read = |ring: &str| {
            let path = folder.path().join("a.geojson");
            std::fs::write(&path, format!(r#"{{"type": "Polygon", "coordinates": [{ring}]}}"#)).unwrap();
            polygons_in_city(&path, city, Some(&place))
        };
        assert_eq!(read("[[11.567, 48.13], [11.57, 48.13], [11.57, 48.14]]").unwrap().len(), 1);
        assert_eq!(read("[[691900, 5334000], [693000, 5334000], [693000, 5334500]]").unwrap().len(), 1);
        // In metres of somewhere else, and latitudes before longitudes.
        for ring in ["[[0, 0], [500, 0], [500, 500]]", "[[48.13, 11.567], [48.13, 11.57], [48.14, 11.57]]"] {
            let error = read(ring).unwrap_err();
            assert!(error.contains("a.geojson: ") && error.contains("city"), "{error}");
        }
    }
}
