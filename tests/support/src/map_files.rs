//! Small maps as texts.

use std::fmt::Write;

/// An ASCII grid of `size` points, the south-western one at `corner`. `height_m` is given how far east and north of it a point is.
pub fn ascii_grid(corner: [f64; 2], size: [usize; 2], step_m: f64, height_m: impl Fn(f64, f64) -> f64) -> String {
    let ([columns, rows], [x, y]) = (size, corner);
    let mut text = format!("ncols {columns}\nnrows {rows}\nxllcenter {x}\nyllcenter {y}\ncellsize {step_m}\n");
    text.push_str("NODATA_value -9999\n");
    for row in (0..rows).rev() {
        for column in 0..columns {
            write!(text, "{:.4} ", height_m(column as f64 * step_m, row as f64 * step_m)).unwrap();
        }
        text.push('\n');
    }
    text
}

/// A feature of GeoJSON between west, south, east and north end. `members` are its identifier and properties.
pub fn rectangle(members: &str, [west, south, east, north]: [f64; 4]) -> String {
    let ring = format!("[{west},{south}],[{east},{south}],[{east},{north}],[{west},{north}],[{west},{south}]");
    format!(r#"{{"type":"Feature",{members},"geometry":{{"type":"Polygon","coordinates":[[{ring}]]}}}}"#)
}

/// A document of GeoJSON features with coordinates in a system such as `EPSG:25832`.
pub fn feature_collection(crs: &str, features: &[String]) -> String {
    let crs = format!(r#"{{"type":"name","properties":{{"name":"{crs}"}}}}"#);
    format!(r#"{{"type":"FeatureCollection","crs":{crs},"features":[{}]}}"#, features.join(","))
}

/// GeoJSON in EPSG:28992 of a house of 9 m, 20 m wide and 12 m deep with its corner at 85000, 447000, and of two sheds so far away that
/// there is ground around it.
pub fn house_and_sheds() -> String {
    let building =
        |height: u32, bounds_m: [f64; 4]| rectangle(&format!(r#""properties":{{"height":{height}}}"#), bounds_m);
    feature_collection(
        "EPSG:28992",
        &[
            building(9, [85_000.0, 447_000.0, 85_020.0, 447_012.0]),
            building(3, [84_930.0, 446_930.0, 84_934.0, 446_934.0]),
            building(3, [85_080.0, 447_080.0, 85_084.0, 447_084.0]),
        ],
    )
}
