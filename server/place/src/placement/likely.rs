//! Which system coordinates in metres are likely in, for messages.

use super::input::SourceInput;
use crate::crs;
use crate::crs::{Area, Axes};
use insula_source::object::AxisOrder;

/// National systems with many public city models, and zones of UTM with them.
const COMMON: [u32; 26] = [
    25832, 25833, 28992, 2154, 2056, 27700, 31256, 31255, 31254, 31468, 31467, 31466, 31370, 2180, 3006, 3067, 3794,
    5514, 3763, 25830, 25829, 2193, 6677, 3414, 2326, 3346,
];
/// Further systems are not named.
const MAX_NAMES: usize = 3;
/// Coordinates in zones of UTM.
const UTM_EAST_M: std::ops::RangeInclusive<f64> = 100_000.0..=900_000.0;
const UTM_NORTH_M: std::ops::RangeInclusive<f64> = 10_000.0..=9_990_000.0;

/// Places of inputs of one city are within so many degrees of the area of use of its system.
const NEAR_DEG: f64 = 2.0;

/// What is known of the places of a city besides the coordinates of a source.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Region {
    /// West, south, east and north in degrees that the user wants.
    pub(super) wanted_deg: Option<[f64; 4]>,
    /// Area of use of the city's system.
    pub(super) city: Option<Area>,
}

impl Region {
    /// Whether a place lies in it, or near.
    pub(super) fn has(&self, place: [f64; 2]) -> bool {
        let area = self.wanted_deg.map(Area::new).or(self.city);
        area.is_some_and(|area| area.contains(place, NEAR_DEG))
    }
}

/// Names likely systems of coordinates in either order, such as `; likely EPSG:25832`; empty if none is.
pub(super) fn text([x, y]: [f64; 2], region: Region) -> String {
    let is_wanted =
        |place: [f64; 2]| region.wanted_deg.is_none_or(|wanted| crs::Area::new(wanted).contains(place, 1.0));
    let fits = |code: &u32| {
        let Ok(system) = crs::resolve(&format!("EPSG:{code}")) else { return false };
        let (Some(area), Ok(input)) = (system.horizontal.area(), SourceInput::new(&system, AxisOrder::EastFirst))
        else {
            return false;
        };
        [Axes::EAST_NORTH, Axes::NORTH_EAST].into_iter().any(|axes| {
            let place = input.degrees_with(axes, [x, y, 0.0]);
            place.is_some_and(|place| area.contains(place, 0.0) && is_wanted(place))
        })
    };
    let mut names: Vec<String> = COMMON.iter().filter(|code| fits(code)).map(|code| format!("EPSG:{code}")).collect();
    names.truncate(MAX_NAMES);
    let is_utm = |east: f64, north: f64| UTM_EAST_M.contains(&east) && UTM_NORTH_M.contains(&north);
    if is_utm(x, y) || is_utm(y, x) {
        names.push(
            "the zone of UTM of the place (EPSG:32601 to EPSG:32660, in the south EPSG:32701 to EPSG:32760)".into(),
        );
    }
    match names.is_empty() {
        true => String::new(),
        false => format!("; likely {}", names.join(", ")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn likely_systems_are_those_with_a_place_in_their_area() {
        let of = |position| text(position, Region::default());
        assert!(of([85_000.0, 446_000.0]).contains("EPSG:28992"));
        assert!(of([691_000.0, 5_334_000.0]).starts_with("; likely EPSG:25832"));
        assert!(of([4_468_000.0, 5_333_000.0]).contains("EPSG:31468"));
        assert!(of([412_345.5, 1_432_100.25]).contains("zone of UTM"));
        assert_eq!(of([1e9, 1e9]), "");
    }
}
