//! The roof that attributes describe, in the names of OpenStreetMap's Simple 3D Buildings and of Overture.

use super::height::{BuildingHeight, HeightHints, LEVEL_M, first_in_range, other_value, plain_unit_m};
use super::lengths::{ROOF_HEIGHT, ROOF_HEIGHT_RANGE_M, ROOF_SHAPE, length_m, named_lengths, number, text};
use crate::roof;
use crate::roof::{RoofOrientation, RoofShape, RoofSpec};
use insula_source::attributes::{AttributeValue, Attributes};
use insula_source::problems::SEVERAL_VALUES;
use insula_source::text::first_value;

/// Names, also as Shapefiles cut them.
const LEVELS: &[&str] = &["roof:levels", "roof_level"];
const DIRECTION: &[&str] = &["roof:direction", "roof:slope:direction", "roof_direc"];
const ORIENTATION: &[&str] = &["roof:orientation", "roof_orien"];
const ANGLE: &[&str] = &["roof:angle"];
/// Kind of the problem that no shape is known.
const UNKNOWN_SHAPE: &str = "shape of roof not known, made flat";
/// Kind of the problem that a direction or an angle is not one.
const NOT_UNDERSTOOD: &str = "value of a roof not understood, left out";
/// A roof leaves at least this much of the building's height to the walls, unless its own height says otherwise.
const LEAST_WALL_SHARE: f64 = 0.35;

/// A roof as attributes describe it. Missing values follow from the shape.
#[derive(Debug, Clone, PartialEq)]
pub struct RoofTags {
    shape: RoofShape,
    height_m: Option<f64>,
    direction_deg: Option<f64>,
    orientation: Option<RoofOrientation>,
    angle_deg: Option<f64>,
}

impl RoofTags {
    /// The described roof; `None` for a flat one. Passes values that are not understood to `note`, with their kind and details.
    pub fn of(attributes: &Attributes, hints: HeightHints<'_>, mut note: impl FnMut(&str, &str)) -> Option<Self> {
        let name = text(attributes, ROOF_SHAPE)?;
        let Some(shape) = roof::roof_shape_by_name(name) else {
            note(UNKNOWN_SHAPE, name);
            return None;
        };
        if shape == RoofShape::Flat {
            return None;
        }
        let heights = named_lengths(attributes, ROOF_HEIGHT, plain_unit_m(attributes, hints));
        let height_m =
            first_in_range(attributes, heights, ROOF_HEIGHT_RANGE_M, &mut note).map(|(_, height_m)| height_m);
        let levels_m = number(attributes, LEVELS, 1.0).map(|levels| levels * LEVEL_M);
        let angle = |value: &AttributeValue| degrees(value).filter(|angle_deg| (1.0..=85.0).contains(angle_deg));
        Some(Self {
            shape,
            height_m: height_m.or(levels_m.filter(|height_m| ROOF_HEIGHT_RANGE_M.contains(height_m))),
            direction_deg: first(attributes, DIRECTION, direction_deg, &mut note),
            orientation: first(attributes, ORIENTATION, orientation, &mut note),
            angle_deg: first(attributes, ANGLE, angle, &mut note),
        })
    }

    /// The roof over a plan, between the heights of its building.
    pub fn spec(&self, rings: &[Vec<[f64; 2]>], height: &BuildingHeight) -> RoofSpec {
        let room_m = height.top_m - height.base_m;
        let usual_m = roof::default_roof_height(self.shape, rings, self.angle_deg);
        let (top_m, roof_m) = match self.height_m {
            Some(roof_m) => (height.top_m, roof_m.min(room_m)),
            None if height.is_without_roof => (height.top_m + usual_m, usual_m),
            None => (height.top_m, usual_m.min(room_m * (1.0 - LEAST_WALL_SHARE))),
        };
        RoofSpec {
            shape: self.shape,
            base_m: height.base_m,
            eaves_m: top_m - roof_m,
            top_m,
            direction_deg: self.direction_deg,
            orientation: self.orientation,
        }
    }
}

/// The first of the named values that is understood. Passes the others to `note`, and that one has several values.
fn first<T>(
    attributes: &Attributes,
    names: &[&str],
    understood: impl Fn(&AttributeValue) -> Option<T>,
    note: &mut impl FnMut(&str, &str),
) -> Option<T> {
    for name in names {
        let Some(value) = attributes.named(name) else { continue };
        match understood(value) {
            Some(found) => {
                if let Some(others) = other_value(attributes, name, value) {
                    note(SEVERAL_VALUES, &format!("{name} is {others}"));
                }
                return Some(found);
            }
            None if value.as_str().is_some_and(|text| text.trim().is_empty()) => {}
            None => note(NOT_UNDERSTOOD, &format!("{name} is {value}")),
        }
    }
    None
}

fn degrees(value: &AttributeValue) -> Option<f64> {
    let number = match value.as_str() {
        Some(text) => length_m(first_value(text).trim_end_matches(['°', 'º'])),
        None => value.as_f64(),
    };
    number.filter(|degrees| degrees.is_finite())
}

/// Degrees from north, clockwise: a number or a point of the compass such as `SSW`.
fn direction_deg(value: &AttributeValue) -> Option<f64> {
    const POINTS: [&str; 16] =
        ["N", "NNE", "NE", "ENE", "E", "ESE", "SE", "SSE", "S", "SSW", "SW", "WSW", "W", "WNW", "NW", "NNW"];
    let named = |text: &str| POINTS.iter().position(|point| point.eq_ignore_ascii_case(first_value(text)));
    let point = value.as_str().and_then(named).map(|point| point as f64 * 22.5);
    point.or_else(|| degrees(value)).map(|degrees| degrees.rem_euclid(360.0))
}

fn orientation(value: &AttributeValue) -> Option<RoofOrientation> {
    match first_value(value.as_str()?) {
        "across" => Some(RoofOrientation::Across),
        "along" => Some(RoofOrientation::Along),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_source::attributes::AttributeValue;
    use insula_source::units::HeightUnit;

    fn attributes(entries: &[(&str, &str)]) -> Attributes {
        let mut attributes = Attributes::default();
        entries.iter().for_each(|(name, value)| attributes.push(name, AttributeValue::Text((*value).to_owned())));
        attributes
    }

    #[test]
    fn directions_are_degrees_or_points_of_the_compass() {
        let direction = |text: &str| direction_deg(&AttributeValue::Text(text.to_owned()));
        for (text, degrees) in [("90", 90.0), ("SSW", 202.5), ("n", 0.0), ("-90", 270.0), ("400", 40.0), ("90°", 90.0)]
        {
            assert_eq!(direction(text), Some(degrees), "{text}");
        }
        assert_eq!(direction("up"), None);
        assert_eq!(direction_deg(&AttributeValue::Float(90.0)), Some(90.0));
    }

    #[test]
    fn values_that_are_not_understood_or_several_are_noted() {
        let tags = attributes(&[
            ("roof:shape", "gabled"),
            ("roof:height", "2;3"),
            ("roof:direction", "up"),
            ("roof:orientation", "diagonal"),
            ("roof:angle", "30°"),
        ]);
        let mut notes = Vec::new();
        let roof = RoofTags::of(&tags, HeightHints::default(), |kind, detail| notes.push(format!("{kind}: {detail}")));
        let roof = roof.unwrap();
        assert_eq!((roof.height_m, roof.direction_deg, roof.angle_deg), (Some(2.0), None, Some(30.0)));
        let expected = [
            format!("{SEVERAL_VALUES}: roof:height is 2;3"),
            format!("{NOT_UNDERSTOOD}: roof:direction is up"),
            format!("{NOT_UNDERSTOOD}: roof:orientation is diagonal"),
        ];
        assert_eq!(notes, expected);
    }

    #[test]
    fn counted_storeys_are_below_the_roof() {
        let square = vec![vec![[0.0, 0.0], [10.0, 0.0], [10.0, 10.0], [0.0, 10.0]]];
        let eaves_and_top = |tags: &[(&str, &str)]| {
            let tags = attributes(&[&[("roof:shape", "gabled")][..], tags].concat());
            let height = BuildingHeight::of(&tags, HeightHints::default(), |_, _| ());
            let spec = RoofTags::of(&tags, HeightHints::default(), |_, _| ()).unwrap().spec(&square, &height);
            (spec.eaves_m, spec.top_m)
        };
        assert_eq!(eaves_and_top(&[("building:levels", "3"), ("roof:height", "2")]), (9.0, 11.0));
        assert_eq!(eaves_and_top(&[("building:levels", "3"), ("roof:height", "2"), ("roof:levels", "1")]), (9.0, 11.0));
        assert_eq!(eaves_and_top(&[("building:levels", "3"), ("roof:levels", "1")]), (9.0, 12.0));
        assert_eq!(eaves_and_top(&[("num_floors", "2"), ("min_floor", "1"), ("roof_height", "2")]), (6.0, 8.0));
        let usual = eaves_and_top(&[("building:levels", "3")]);
        assert!(usual.0 == 9.0 && usual.1 > 9.5, "{usual:?}");
        assert_eq!(eaves_and_top(&[("building:levels", "3"), ("roof:levels", "0")]), usual);
        let flat = attributes(&[("building:levels", "3"), ("roof:shape", "flat"), ("roof:height", "1")]);
        assert_eq!(BuildingHeight::of(&flat, HeightHints::default(), |_, _| ()).top_m, 9.0);
    }

    #[test]
    fn a_roof_is_inside_of_a_given_height_and_above_counted_levels() {
        let square = vec![vec![[0.0, 0.0], [10.0, 0.0], [10.0, 10.0], [0.0, 10.0]]];
        let roof = |tags: &[(&str, &str)], height: BuildingHeight| {
            let spec =
                RoofTags::of(&attributes(tags), HeightHints::default(), |_, _| ()).unwrap().spec(&square, &height);
            (spec.eaves_m, spec.top_m)
        };
        let given = BuildingHeight { base_m: 0.0, top_m: 12.0, is_without_roof: false };
        assert_eq!(roof(&[("roof:shape", "gabled"), ("roof:height", "4 m")], given), (8.0, 12.0));
        assert_eq!(roof(&[("roof_shape", "hipped"), ("roof_height", "40")], given), (0.0, 12.0));
        let feet = HeightHints { unit: Some(HeightUnit::Foot), ..HeightHints::default() };
        for (value, expected_m) in [("10", 3.048), ("10 m", 10.0)] {
            let tags = attributes(&[("roof:shape", "gabled"), ("roof:height", value)]);
            assert_eq!(RoofTags::of(&tags, feet, |_, _| ()).unwrap().height_m, Some(expected_m), "{value}");
        }
        assert_eq!(roof(&[("ROOF_SHAPE", "Gabled"), ("ROOF_HEIGH", "3")], given), (9.0, 12.0), "as in a Shapefile");
        let counted = BuildingHeight { is_without_roof: true, ..given };
        let (eaves_m, top_m) = roof(&[("roof:shape", "gabled")], counted);
        assert!(eaves_m == 12.0 && top_m > 13.0, "{eaves_m} {top_m}");
        assert_eq!(RoofTags::of(&attributes(&[("roof:shape", "flat")]), HeightHints::default(), |_, _| ()), None);
    }
}
