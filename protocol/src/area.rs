//! Rectangles on the map, as people give them: west, south, east and north.

/// Largest coordinate on a map, in metres.
const MAX_M: f64 = 1e9;

/// Whether these are the sides of a rectangle in degrees.
pub fn is_in_degrees([west, south, east, north]: [f64; 4]) -> bool {
    west < east && south < north && west >= -180.0 && east <= 180.0 && south >= -90.0 && north <= 90.0
}

/// Whether these are the sides of a rectangle in metres of a city's coordinate system.
pub fn is_in_metres([west, south, east, north]: [f64; 4]) -> bool {
    west < east && south < north && [west, south, east, north].iter().all(|side| side.abs() <= MAX_M)
}

/// Corners on the map of the area that a request has in degrees (`bbox`) or in metres (`bbox_metres`); `None` without one. `on_map` gives
/// the corners of an area in degrees, or `None` if these are not known. Fails with what is wrong.
pub fn requested_area(
    bbox: Option<[f64; 4]>,
    bbox_metres: Option<[f64; 4]>,
    on_map: &dyn Fn([f64; 4]) -> Option<[[f64; 2]; 2]>,
) -> Result<Option<[[f64; 2]; 2]>, &'static str> {
    match (bbox, bbox_metres) {
        (Some(_), Some(_)) => Err("at most one of bbox and bbox_metres"),
        (Some(degrees), None) if !is_in_degrees(degrees) => {
            Err("bbox: expected west, south, east and north in degrees; bbox_metres takes metres")
        }
        (Some(degrees), None) => on_map(degrees).map(Some).ok_or(
            "bbox: it is not known where on Earth this city lies, or the area is out of its coordinate system: use bbox_metres",
        ),
        (None, Some(metres)) if !is_in_metres(metres) => {
            Err("bbox_metres: expected west, south, east and north in metres")
        }
        (None, metres) => Ok(metres.map(|[west, south, east, north]| [[west, south], [east, north]])),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rectangles_have_an_extent_on_earth() {
        assert!(is_in_degrees([-1.5, 2.0, 3.0, 4.0]) && is_in_metres([84_500.0, 446_150.0, 84_900.0, 446_500.0]));
        assert!(!is_in_degrees([84_500.0, 446_150.0, 84_900.0, 446_500.0]));
        for wrong in [
            [3.0, 2.0, 1.0, 4.0],
            [1.0, 2.0, 3.0, 2.0],
            [f64::NAN, 1.0, 2.0, 3.0],
            [f64::NEG_INFINITY, 1.0, 2.0, 3.0],
            [1e300, 0.0, 2e300, 1.0],
        ] {
            assert!(!is_in_degrees(wrong) && !is_in_metres(wrong), "{wrong:?}");
        }
    }
}
