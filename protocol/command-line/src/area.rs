//! The part of a city that a command is about.

use clap::Args;
use insula_protocol::area::{is_in_degrees, is_in_metres};

/// A rectangle on the map.
#[derive(Debug, Clone, Copy, Default, PartialEq, Args)]
pub struct AreaArgs {
    /// Only this area, in degrees: objects with the middle in it, and land and cells within its border
    #[arg(long, value_name = "W,S,E,N", value_parser = parse_degrees, allow_hyphen_values = true)]
    pub bbox: Option<[f64; 4]>,
    /// The same in metres of the city's coordinate system
    #[arg(long, value_name = "W,S,E,N", value_parser = parse_metres, allow_hyphen_values = true, conflicts_with = "bbox")]
    pub bbox_metres: Option<[f64; 4]>,
}

impl AreaArgs {
    /// South-west and north-east corner in world metres; `None` without an area. `on_map` gives the box on the map around one in degrees,
    /// or `None` if it is not known where the city lies. Fails then.
    pub fn world_box(
        &self,
        on_map: impl FnOnce([f64; 4]) -> Option<[[f64; 2]; 2]>,
    ) -> Result<Option<[[f64; 2]; 2]>, String> {
        let unknown = "--bbox: it is not known where on Earth this city lies, or the area is out of its coordinate system: give --bbox-metres";
        match (self.bbox, self.bbox_metres) {
            (Some(degrees), _) => on_map(degrees).map(Some).ok_or_else(|| unknown.to_owned()),
            (None, metres) => Ok(metres.map(|[west, south, east, north]| [[west, south], [east, north]])),
        }
    }

    /// As [`Self::world_box`], of a city between two corners. Fails also if the area is [beyond](Self::beyond) it.
    pub fn box_in_city(
        &self,
        city: [[f64; 2]; 2],
        on_map: impl FnOnce([f64; 4]) -> Option<[[f64; 2]; 2]>,
        to_degrees: &dyn Fn([f64; 2]) -> Option<[f64; 2]>,
    ) -> Result<Option<[[f64; 2]; 2]>, String> {
        let area = self.world_box(on_map)?;
        match area.and_then(|area| self.beyond(area, city, to_degrees)) {
            Some(reason) => Err(reason),
            None => Ok(area),
        }
    }

    /// Says that the area, which is `area` in world metres, has no place in common with a city between two corners, and where that lies;
    /// `None` if it has one. `to_degrees` gives the longitude and latitude of a place on the map.
    pub fn beyond(
        &self,
        area: [[f64; 2]; 2],
        city: [[f64; 2]; 2],
        to_degrees: &dyn Fn([f64; 2]) -> Option<[f64; 2]>,
    ) -> Option<String> {
        if (0..2).all(|k| area[0][k] <= city[1][k] && city[0][k] <= area[1][k]) {
            return None;
        }
        let (option, given) = match (self.bbox, self.bbox_metres) {
            (Some(degrees), _) => ("--bbox", degrees),
            (None, metres) => ("--bbox-metres", metres?),
        };
        let lies = bounds_text(city, self.bbox.is_some().then_some(to_degrees));
        let lies = lies.map(|bounds| format!(", which lies in {bounds}")).unwrap_or_default();
        let given = given.map(|number| number.to_string()).join(",");
        Some(format!("{option} {given}: beyond the city{lies}: write west, south, east, north"))
    }
}

/// A rectangle around a city, in the units of the option.
fn bounds_text(city: [[f64; 2]; 2], to_degrees: Option<&dyn Fn([f64; 2]) -> Option<[f64; 2]>>) -> Option<String> {
    let [[west, south], [east, north]] = city;
    let Some(to_degrees) = to_degrees else { return Some(format!("{west:.0},{south:.0},{east:.0},{north:.0}")) };
    let corners = [[west, south], [east, south], [west, north], [east, north]].map(to_degrees);
    let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
    for corner in corners {
        let corner = corner?;
        (low, high) = ([0, 1].map(|k| low[k].min(corner[k])), [0, 1].map(|k| high[k].max(corner[k])));
    }
    Some(format!("{:.4},{:.4},{:.4},{:.4}", low[0], low[1], high[0], high[1]))
}

fn parse_box(text: &str) -> Option<[f64; 4]> {
    let numbers: Option<Vec<f64>> = text.split(',').map(|number| number.trim().parse().ok()).collect();
    numbers?.try_into().ok()
}

fn parse_degrees(text: &str) -> Result<[f64; 4], String> {
    let expected =
        "expected west, south, east and north in degrees, such as 4.35,52.00,4.37,52.02; --bbox-metres takes metres";
    parse_box(text).filter(|corners| is_in_degrees(*corners)).ok_or_else(|| expected.to_owned())
}

fn parse_metres(text: &str) -> Result<[f64; 4], String> {
    let expected = "expected west, south, east and north in metres, separated by commas";
    parse_box(text).filter(|corners| is_in_metres(*corners)).ok_or_else(|| expected.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn areas_are_in_degrees_or_in_metres() {
        assert_eq!(parse_degrees("-1.5,2, 3,4"), Ok([-1.5, 2.0, 3.0, 4.0]));
        assert_eq!(parse_metres("84500,446150,84900,446500"), Ok([84_500.0, 446_150.0, 84_900.0, 446_500.0]));
        let error = parse_degrees("84500,446150,84900,446500").unwrap_err();
        assert!(error.contains("--bbox-metres"), "{error}");
        for wrong in ["1,2,3", "3,2,1,4", "1,2,3,2", "a,2,3,4", "1,2,3,4,5", "", "nan,1,2,3", "-inf,1,2,3"] {
            assert!(parse_degrees(wrong).is_err() && parse_metres(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn degrees_need_a_place_on_earth() {
        let degrees = AreaArgs { bbox: Some([4.0, 52.0, 5.0, 53.0]), bbox_metres: None };
        assert_eq!(degrees.world_box(|_| Some([[1.0, 2.0], [3.0, 4.0]])), Ok(Some([[1.0, 2.0], [3.0, 4.0]])));
        assert!(degrees.world_box(|_| None).unwrap_err().contains("--bbox-metres"));
        let metres = AreaArgs { bbox: None, bbox_metres: Some([1.0, 2.0, 3.0, 4.0]) };
        assert_eq!(metres.world_box(|_| None), Ok(Some([[1.0, 2.0], [3.0, 4.0]])));
        assert_eq!(AreaArgs::default().world_box(|_| None), Ok(None));
    }

    #[test]
    fn areas_beyond_a_city_are_told_with_its_place() {
        let city = [[84_000.0, 446_000.0], [86_000.0, 448_000.0]];
        let to_degrees = |[x, y]: [f64; 2]| Some([x / 20_000.0, y / 8_000.0]);
        let degrees = AreaArgs { bbox: Some([1.0, 2.0, 3.0, 4.5]), bbox_metres: None };
        assert_eq!(
            degrees.beyond([[1.0, 2.0], [3.0, 4.0]], city, &to_degrees).unwrap(),
            "--bbox 1,2,3,4.5: beyond the city, which lies in 4.2000,55.7500,4.3000,56.0000: write west, south, east, north"
        );
        assert!(degrees.beyond([[1.0, 2.0], [3.0, 4.0]], city, &|_| None).unwrap().contains("beyond the city: write"));
        let metres = AreaArgs { bbox: None, bbox_metres: Some([0.0, 0.0, 9.0, 9.0]) };
        let text = metres.beyond([[0.0, 0.0], [9.0, 9.0]], city, &to_degrees).unwrap();
        assert!(text.contains("--bbox-metres 0,0,9,9") && text.contains("84000,446000,86000,448000"), "{text}");
        assert_eq!(metres.beyond([[0.0, 0.0], [84_000.0, 446_000.0]], city, &to_degrees), None);
        assert_eq!(metres.box_in_city(city, |_| None, &to_degrees), Err(text));
        assert_eq!(metres.box_in_city([[0.0; 2]; 2], |_| None, &to_degrees), Ok(Some([[0.0, 0.0], [9.0, 9.0]])));
        assert_eq!(AreaArgs::default().box_in_city(city, |_| None, &to_degrees), Ok(None));
    }
}
