//! Whether the coordinates of a source fit its system, and in which of two orders they are.

use super::first_shape::FirstShape;
use super::input::{Habit, SourceInput};
use super::likely::{self, Region};
use crate::crs;
use crate::crs::{Area, Axes, System};
use glob::{MatchOptions, Pattern};
use insula_source::error::InputError;
use insula_source::object::AxisOrder;
use insula_source::problems::{EITHER_ORDER, OUTSIDE, SWAPPED};
use std::str::FromStr;

/// A source may reach so far beyond the area of use of its system, which is in whole degrees.
const REACH_DEG: f64 = 1.5;
/// Systems are used beyond their area, such as zones of UTM for a whole country, but hardly so far.
pub(super) const FAR_DEG: f64 = 3.0;

/// Order of coordinates that the user decides on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
enum AxisChoice {
    /// As declared, unless only the other order is plausible.
    #[default]
    Auto,
    /// East or longitude first.
    EastNorth,
    /// North or latitude first.
    NorthEast,
}

/// An order of coordinates, for all inputs or for those whose path or name fits a pattern.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct AxisRule {
    inputs: Option<Pattern>,
    choice: AxisChoice,
}

impl FromStr for AxisRule {
    type Err = String;

    /// Parses `auto`, `en` or `ne`, or such as `north/*.gml=ne` with `*`, `?` and `[...]`. Fails with what is invalid.
    fn from_str(text: &str) -> Result<Self, String> {
        let (pattern, word) = text.rsplit_once('=').map_or((None, text), |(pattern, word)| (Some(pattern), word));
        let choice = match &*word.to_ascii_lowercase() {
            "auto" => AxisChoice::Auto,
            "en" => AxisChoice::EastNorth,
            "ne" => AxisChoice::NorthEast,
            _ => return Err(format!("{text}: expected auto, en or ne, or such as 'north/*.gml=ne'")),
        };
        let inputs = pattern.map(Pattern::new).transpose().map_err(|error| format!("{text}: {error}"))?;
        Ok(Self { inputs, choice })
    }
}

/// Orders of coordinates by input; of the rules that fit, the last counts.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct AxisOrders(Vec<AxisRule>);

impl AxisOrders {
    /// The orders of some rules.
    pub fn new(rules: impl IntoIterator<Item = AxisRule>) -> Self {
        Self(rules.into_iter().collect())
    }

    /// The choice for an input by its path.
    fn of(&self, label: &str) -> AxisChoice {
        let options = MatchOptions { case_sensitive: false, ..MatchOptions::default() };
        let name = label.rsplit(['/', '\\']).next().unwrap_or(label);
        let fits = |pattern: &Pattern| [label, name].iter().any(|text| pattern.matches_with(text, options));
        let found = self.0.iter().rev().find(|rule| rule.inputs.as_ref().is_none_or(fits));
        found.map_or(AxisChoice::Auto, |rule| rule.choice)
    }
}

/// The order of a source's coordinates, and what to tell about it.
#[derive(Debug, PartialEq)]
pub(super) struct Order {
    pub(super) axes: Axes,
    /// Kind and text.
    pub(super) finding: Option<(&'static str, String)>,
}

/// Decides on the order of the coordinates of a source by its first shape. `name` is that of its system. Fails if they
/// contradict the system in either order.
pub(super) fn decide(
    label: &str,
    name: &str,
    (input, order): (&SourceInput, AxisOrder),
    first: &FirstShape,
    (orders, region): (&AxisOrders, Region),
) -> Result<Order, InputError> {
    let declared = input.axes;
    let keep = |finding| Ok(Order { axes: declared, finding });
    let is_on_map = matches!(input.horizontal.system, System::Geographic { .. } | System::Projected(_));
    if !is_on_map || first.is_origin() {
        return keep(None);
    }
    let by_hand = match orders.of(label) {
        AxisChoice::Auto => None,
        AxisChoice::EastNorth => Some(Axes::EAST_NORTH),
        AxisChoice::NorthEast => Some(Axes::NORTH_EAST),
    };
    let [x, y] = first.position;
    if let Some(axes) = by_hand {
        return match place(input, axes, [x, y]) {
            None if is_degrees(input) => Err(contradiction(label, name, input, first)),
            _ => Ok(Order { axes, finding: None }),
        };
    }
    // The signs of coordinates that count towards west or south tell more than areas.
    let swapped = declared.swapped().filter(|_| matches!(input.habit, Habit::None | Habit::ZonePrefix { .. }));
    let places = [Some(declared), swapped].map(|axes| place(input, axes?, [x, y]));
    let area = input.horizontal.area();
    let fits = |place: Option<[f64; 2]>, reach_deg: f64| {
        place.filter(|place| area.is_none_or(|area| area.contains(*place, reach_deg)))
    };
    let telling = |other: &str| {
        let [first, second] = if declared == Axes::EAST_NORTH { ["east", "north"] } else { ["north", "east"] };
        let read = |place: Option<[f64; 2]>| {
            place.map_or("nowhere on Earth".to_owned(), |[lon, lat]| format!("at {lon:.4}, {lat:.4}"))
        };
        let [own, turned] = places.map(read);
        format!(
            "{name}: {x}, {y} is {own} (longitude, latitude) with {first} first, as declared, and {turned} with {second} \
             first{other} (--axis-order)"
        )
    };
    // In the area of use of a whole continent, or of the Earth, the sea tells, unless the format leaves no doubt.
    let has_seas = area.map_or(is_degrees(input) && !order.is_fixed(), Area::is_wide);
    let is_at_sea = |place: [f64; 2]| has_seas && !crs::is_near_land(place);
    match (fits(places[0], REACH_DEG), fits(places[1], 0.0), swapped) {
        (Some(_), None, _) => keep(None),
        (None, Some(_), Some(axes)) => Ok(Order { axes, finding: Some((SWAPPED, telling(", which is taken"))) }),
        (Some(own), Some(other), Some(axes)) => match [own, other].map(|place| region.has(place)) {
            [false, true] => {
                Ok(Order { axes, finding: Some((SWAPPED, telling(", near the other inputs, which is taken"))) })
            }
            _ if is_at_sea(own) && !is_at_sea(other) => {
                Ok(Order { axes, finding: Some((SWAPPED, telling(", on land, which is taken"))) })
            }
            [true, false] => keep(None),
            _ if is_at_sea(other) && !is_at_sea(own) => keep(None),
            _ if order.is_fixed() => keep(None),
            _ if fits(places[0], 0.0).is_none() => {
                Ok(Order { axes, finding: Some((SWAPPED, telling(", within its area of use, which is taken"))) })
            }
            _ => keep(Some((EITHER_ORDER, telling("; the declaration is followed")))),
        },
        _ if is_degrees(input) && places == [None, None] => Err(contradiction(label, name, input, first)),
        _ if !is_degrees(input) && first.looks_like_degrees() => Err(contradiction(label, name, input, first)),
        _ => keep(places[0].filter(|place| area.is_some_and(|area| !area.contains(*place, FAR_DEG))).map(
            |[lon, lat]| {
                let likely = likely::text(first.position, region);
                (OUTSIDE, format!("{name}: {x}, {y} is at {lon:.4}, {lat:.4} (longitude, latitude){likely}"))
            },
        )),
    }
}

fn is_degrees(input: &SourceInput) -> bool {
    matches!(input.horizontal.system, System::Geographic { .. })
}

/// Longitude and latitude of coordinates in an order; `None` if they are not on Earth.
fn place(input: &SourceInput, axes: Axes, [x, y]: [f64; 2]) -> Option<[f64; 2]> {
    input.degrees_with(axes, [x, y, 0.0]).filter(|place| place.iter().all(|degrees| degrees.is_finite()))
}

/// The error of coordinates that cannot be those of their system.
fn contradiction(label: &str, name: &str, input: &SourceInput, first: &FirstShape) -> InputError {
    let [x, y] = first.position;
    let (own, found, likely) = match is_degrees(input) {
        true => ("degrees", "metres", likely::text(first.position, Region::default())),
        false => ("lengths", "degrees", "; likely EPSG:4326".to_owned()),
    };
    InputError::misplaced(
        label,
        format!(
            "its coordinate system {name} is in {own}, but its first coordinates are {x}, {y}, as in {found}{likely}; \
             correct the name of the system in the file, or reproject it with ogr2ogr -s_srs EPSG:... -t_srs {name}"
        ),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn orders_are_by_input_and_the_last_counts() {
        let orders = AxisOrders::new(["en", "tokyo/*=ne", "*.gml=auto"].map(|text| text.parse().unwrap()));
        assert_eq!(orders.of("a/b.json"), AxisChoice::EastNorth);
        assert_eq!(orders.of("tokyo/b.json"), AxisChoice::NorthEast);
        assert_eq!(orders.of("tokyo/b.GML"), AxisChoice::Auto);
        assert_eq!(AxisOrders::default().of("a"), AxisChoice::Auto);
        assert!("xy".parse::<AxisRule>().is_err() && "[=ne".parse::<AxisRule>().is_err());
    }
}
