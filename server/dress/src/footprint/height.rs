//! Height of a footprint's prism, from the attribute names of OpenStreetMap, city offices and Overture.

use super::height_names::{self, FIRST, HeightRole, NamedHeight, UnitGuess};
use super::lengths::{grouped_metres, metres, named_lengths, roof_height_m, storeys};
use insula_source::attributes::{AttributeValue, Attributes};
use insula_source::problems::{
    BASE_ABOVE_TOP, CUT_NAME, GUESSED, GUESSED_FROM_LEVELS, MARK_GUESSED, NO_GROUND_HEIGHT, NOT_UNDERSTOOD,
    SEVERAL_VALUES, UNIT_GUESSED,
};
use insula_source::text::values_of;
use insula_source::units::{HeightUnit, metres_of};
use std::ops::RangeInclusive;

const ROOF_LEVELS: &[&str] = &["roof:levels", "roof_level"];
/// Names of the base's height above the ground, for suspended parts such as gangways.
pub(super) const BASE: &[&str] =
    &["min_height", "building:min_height", "render_min_height", "render_min", "base_height"];
/// What Shapefiles leave of `building:min_height`, and of the name of a material.
const CUT_BASE: &str = "building_m";
const BASE_LEVEL: &[&str] = &["building:min_level", "min_level", "min_floor"];

/// Height of a storey, where only the number of storeys is known.
pub(super) const LEVEL_M: f64 = 3.0;
/// Default height: two storeys.
const UNKNOWN_M: f64 = 6.0;
/// Valid heights. Many files write 0 for an unknown height.
const TOP_RANGE_M: RangeInclusive<f64> = 0.01..=2000.0;
/// Of two readings of `1,776 ft`, the larger one counts if the other is lower than this, and it is itself not higher.
const LIKELY_M: [f64; 2] = [2.0, 830.0];
const BASE_RANGE_M: RangeInclusive<f64> = -500.0..=2000.0;
const STOREY_HEIGHTS: &str = "storeyHeightsAboveGround";
const STOREY_RANGE_M: RangeInclusive<f64> = 1.0..=50.0;
/// A building may have all of its storeys in its roof, and a roof may have none.
const LEVELS_RANGE: RangeInclusive<f64> = 0.0..=400.0;
const BASE_LEVEL_RANGE: RangeInclusive<f64> = -20.0..=400.0;
/// Plausible heights above sea level of objects on the ground.
const ELEVATION_RANGE_M: RangeInclusive<f64> = -500.0..=10_000.0;

/// What is known of the heights in attributes besides these.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct HeightHints<'a> {
    /// Attribute that the user names.
    pub field: Option<&'a str>,
    /// Unit of plain numbers that the user gives.
    pub unit: Option<HeightUnit>,
    /// Whether the map is in feet, so that heights without a unit may be, too.
    pub is_map_in_feet: bool,
    /// Height of the ground above sea level in metres, where the plan or an elevation model tells it.
    pub ground_m: Option<f64>,
}

/// Base and top of a prism in metres above the ground; the top is above the base.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BuildingHeight {
    pub base_m: f64,
    pub top_m: f64,
    /// Whether a roof is on top of it: the height is that of counted storeys below the roof.
    pub is_without_roof: bool,
}

impl BuildingHeight {
    /// Determines the height, with a default if nothing is known. Passes guesses and invalid values to `note`, with
    /// their kind and details.
    pub fn of(attributes: &Attributes, hints: HeightHints<'_>, mut note: impl FnMut(&str, &str)) -> Self {
        let named = height_names::find(attributes, hints.unit.is_some());
        let plain_m = unit_of_top_m(attributes, &named, hints);
        let bases = named_lengths(attributes, BASE, plain_m);
        let base_m =
            first_in_range(attributes, bases, BASE_RANGE_M, &mut note).map(|(_, base_m)| base_m).or_else(|| {
                let levels = BASE_LEVEL.iter().filter_map(|name| Some((*name, attributes.named(name)?, 1.0)));
                first_in_range(attributes, levels, BASE_LEVEL_RANGE, &mut note).map(|(_, levels)| levels * LEVEL_M)
            });
        if let Some(top_m) = top_m(attributes, &named, hints, &mut note) {
            let base_m = base_m.or_else(|| cut_base_m(attributes, plain_m, top_m, &mut note)).unwrap_or(0.0);
            if base_m < top_m {
                return Self { base_m, top_m, is_without_roof: false };
            }
            note(BASE_ABOVE_TOP, &format!("{base_m} to {top_m}"));
            return Self { base_m: 0.0, top_m, is_without_roof: false };
        }
        let base_m = base_m.unwrap_or(0.0);
        // Storeys in the place of a height are counted, too.
        let told = of_role(&named, HeightRole::Top, 1.0).filter(|(_, value, _)| storeys(value).is_some());
        let levels = of_role(&named, HeightRole::Levels, 1.0).chain(told);
        if let Some((_, levels)) = first_in_range(attributes, levels, LEVELS_RANGE, &mut note) {
            let roof_levels = ROOF_LEVELS.iter().filter_map(|name| Some((*name, attributes.named(name)?, 1.0)));
            let roof_levels =
                first_in_range(attributes, roof_levels, LEVELS_RANGE, &mut note).map(|(_, number)| number);
            // Storeys are counted below the roof.
            let roof_levels_m = roof_levels.map(|levels| levels * LEVEL_M).filter(|height_m| *height_m > 0.0);
            let roof_m = roof_height_m(attributes, plain_m).or(roof_levels_m);
            let storeys_m = storey_heights_m(attributes, levels);
            let top_m = storeys_m.unwrap_or(levels * LEVEL_M) + roof_m.unwrap_or(0.0);
            if base_m < top_m {
                if storeys_m.is_none() {
                    note(GUESSED_FROM_LEVELS, &format!("{top_m} m"));
                }
                return Self { base_m, top_m, is_without_roof: roof_m.is_none() };
            }
        }
        note(GUESSED, &format!("{UNKNOWN_M} m"));
        Self { base_m, top_m: base_m + UNKNOWN_M, is_without_roof: false }
    }
}

/// The base below a top by a cut name, of which only the number tells that it is one.
fn cut_base_m(attributes: &Attributes, plain_m: f64, top_m: f64, note: &mut impl FnMut(&str, &str)) -> Option<f64> {
    let value = attributes.named(CUT_BASE).filter(|value| value.as_str().is_none())?;
    let base_m = value.as_f64().map(|number| number * plain_m).filter(|base_m| *base_m > 0.0 && *base_m < top_m)?;
    note(CUT_NAME, &format!("{CUT_BASE} is {value}, taken as building:min_height"));
    Some(base_m)
}

/// Height of all storeys together, if CityGML's list has one for each of them, or one for all. Marks of missing ones are none.
fn storey_heights_m(attributes: &Attributes, levels: f64) -> Option<f64> {
    // JSON has each in an attribute of its own.
    let is_item = |rest: &str| rest.strip_prefix('.').is_some_and(|number| number.parse::<u16>().is_ok());
    let is_of_list =
        |name: &str| name.strip_prefix(STOREY_HEIGHTS).is_some_and(|rest| rest.is_empty() || is_item(rest));
    let lists = attributes.iter().filter(|(name, _)| is_of_list(name)).map(|(_, value)| value.to_string());
    let unit_m = match attributes.get(&format!("{STOREY_HEIGHTS}.uom")) {
        Some(unit) => metres_of(unit.as_str()?)?,
        None => 1.0,
    };
    let mut heights_m = Vec::new();
    for text in lists {
        for number in text.split_ascii_whitespace() {
            let height_m = number.parse::<f64>().ok()? * unit_m;
            heights_m.push(Some(height_m).filter(|height_m| STOREY_RANGE_M.contains(height_m))?);
        }
    }
    match heights_m[..] {
        [] => None,
        [height_m] => Some(height_m * levels),
        _ if heights_m.len() as f64 == levels => Some(heights_m.iter().sum()),
        _ => None,
    }
}

/// Whether attributes tell the top of an area, in metres or storeys.
pub fn has_height(attributes: &Attributes, hints: HeightHints<'_>) -> bool {
    hints.field.is_some_and(|field| attributes.get(field).is_some())
        || height_names::find(attributes, hints.unit.is_some()).iter().any(|height| height.role != HeightRole::Ground)
}

/// Whether attributes tell the top above sea level only, and not that of the ground.
pub fn needs_ground(attributes: &Attributes, hints: HeightHints<'_>) -> bool {
    let named = height_names::find(attributes, hints.unit.is_some());
    let has = |role| named.iter().any(|height| height.role == role);
    has(HeightRole::Elevation) && !has(HeightRole::Ground)
}

/// Height above the ground that attributes tell, in metres. Passes guesses and invalid values to `note`, with their kind and details.
pub fn known_height_m(
    attributes: &Attributes,
    hints: HeightHints<'_>,
    mut note: impl FnMut(&str, &str),
) -> Option<f64> {
    top_m(attributes, &height_names::find(attributes, hints.unit.is_some()), hints, &mut note)
}

/// Metres in the unit of plain numbers of the base and the roof.
pub(super) fn plain_unit_m(attributes: &Attributes, hints: HeightHints<'_>) -> f64 {
    unit_of_top_m(attributes, &height_names::find(attributes, hints.unit.is_some()), hints)
}

/// Metres in the unit that is told for the top, which all heights of a building have; else in that of plain numbers.
fn unit_of_top_m(attributes: &Attributes, named: &[NamedHeight<'_>], hints: HeightHints<'_>) -> f64 {
    let told = match hints.field.filter(|field| attributes.get(field).is_some()) {
        Some(field) => height_names::unit_of_name(field),
        None => named
            .iter()
            .find(|height| matches!(height.role, HeightRole::Top | HeightRole::Elevation))
            .and_then(|height| height.unit_m),
    };
    told.unwrap_or(hints.unit.map_or(1.0, HeightUnit::metres))
}

/// Height of the top above the ground by the attributes, except by storeys.
fn top_m(
    attributes: &Attributes,
    named: &[NamedHeight<'_>],
    hints: HeightHints<'_>,
    note: &mut impl FnMut(&str, &str),
) -> Option<f64> {
    let plain_m = hints.unit.map_or(1.0, HeightUnit::metres);
    let by_hand = hints.field.and_then(|field| {
        let unit_m = height_names::unit_of_name(field).unwrap_or(plain_m);
        Some((field, attributes.get(field)?, unit_m))
    });
    let tops = by_hand.into_iter().chain(of_role(named, HeightRole::Top, plain_m));
    let tops = tops.filter(|(_, value, _)| storeys(value).is_none());
    if let Some((name, top_m)) = first_in_range(attributes, tops, TOP_RANGE_M, note) {
        let known = named.iter().find(|height| height.name == name);
        if let Some(guess) = known.and_then(|height| height.unit_guess) {
            let guess = match guess {
                UnitGuess::Publisher => "feet, as its publisher means it".to_owned(),
                UnitGuess::Beside(attribute, unit) => format!("{unit}, as {attribute} says"),
                UnitGuess::Unknown(attribute, unit) => {
                    format!("metres, as {attribute} says {unit}, which is not known")
                }
            };
            note(UNIT_GUESSED, &format!("{name} taken as {guess} (--height-unit)"));
        } else if hints.is_map_in_feet
            && hints.unit.is_none()
            && known.map_or_else(|| height_names::unit_of_name(name), |height| height.unit_m).is_none()
        {
            note(UNIT_GUESSED, &format!("{name} taken as metres, although the map is in feet (--height-unit)"));
        }
        return Some(top_m);
    }
    let (name, top_m) =
        first_in_range(attributes, of_role(named, HeightRole::Elevation, plain_m), ELEVATION_RANGE_M, note)?;
    let ground = first_in_range(attributes, of_role(named, HeightRole::Ground, plain_m), ELEVATION_RANGE_M, note);
    let ground_m = ground.map(|(_, ground_m)| ground_m).or(hints.ground_m);
    if ground_m.is_none() {
        note(NO_GROUND_HEIGHT, &format!("{name} is {top_m}"));
    }
    Some(top_m - ground_m.unwrap_or(0.0)).filter(|height_m| TOP_RANGE_M.contains(height_m))
}

/// Names and values of a role, best first, with metres in the unit of plain numbers.
fn of_role<'n>(
    named: &'n [NamedHeight<'n>],
    role: HeightRole,
    plain_m: f64,
) -> impl Iterator<Item = (&'n str, &'n AttributeValue, f64)> {
    let of_role = named.iter().filter(move |height| height.role == role);
    of_role.map(move |height| (height.name, height.value, height.unit_m.unwrap_or(plain_m)))
}

/// The first of the values that is a number in the range, with its name. Passes the others to `note`, and that a value has several numbers.
pub(super) fn first_in_range<'v>(
    attributes: &Attributes,
    values: impl Iterator<Item = (&'v str, &'v AttributeValue, f64)>,
    range: RangeInclusive<f64>,
    note: &mut impl FnMut(&str, &str),
) -> Option<(&'v str, f64)> {
    for (name, value, unit_m) in values {
        let number = match value {
            AttributeValue::Text(text) if text.trim().is_empty() => continue,
            value => storeys(value).or_else(|| metres(value, unit_m)),
        };
        let decimal = number.filter(|number| range.contains(number));
        let grouped = grouped_metres(value, unit_m).filter(|number| range.contains(number));
        let number = match (decimal, grouped) {
            (Some(decimal), Some(grouped)) => {
                let is_grouped = decimal < LIKELY_M[0] && grouped <= LIKELY_M[1];
                let number = if is_grouped { grouped } else { decimal };
                note(MARK_GUESSED, &format!("{name} is {value}, taken as {number}"));
                Some(number)
            }
            (decimal, grouped) => decimal.or(grouped),
        };
        match number {
            Some(number) => {
                if let Some(others) = other_value(attributes, name, value) {
                    note(SEVERAL_VALUES, &format!("{name} is {others}"));
                }
                return Some((name, number));
            }
            None => note(NOT_UNDERSTOOD, &format!("{name} is {value}")),
        }
    }
    None
}

/// The text of an attribute with several values that differ: `12;15`, or a list of JSON.
pub(super) fn other_value(attributes: &Attributes, name: &str, value: &AttributeValue) -> Option<String> {
    if let Some(list) = name.strip_suffix(FIRST) {
        let second = attributes.get(&format!("{list}.1")).filter(|second| *second != value)?;
        return Some(format!("{value};{second}"));
    }
    let text = value.as_str()?;
    let mut values = values_of(text);
    let first = values.next()?;
    values.any(|other| other != first).then(|| text.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_source::json;

    fn height(properties: &str) -> (f64, f64, Vec<String>) {
        height_with(properties, HeightHints::default())
    }

    fn height_with(properties: &str, hints: HeightHints<'_>) -> (f64, f64, Vec<String>) {
        let mut notes = Vec::new();
        let mut attributes = Attributes::default();
        json::attributes::flatten(&serde_json::from_str(properties).unwrap(), &mut attributes);
        let height = BuildingHeight::of(&attributes, hints, |kind, _| notes.push(kind.to_owned()));
        (height.base_m, height.top_m, notes)
    }

    #[test]
    fn height_is_understood_in_every_spelling() {
        for (text, metres) in [
            ("14.5", 14.5),
            (r#""12""#, 12.0),
            (r#"" 12.5 m""#, 12.5),
            (r#""12,5m""#, 12.5),
            (r#""40 ft""#, 12.192),
            (r#""10'""#, 3.048),
            (r#""12'6\"""#, 3.81),
            (r#""12' 6.5''""#, 3.8227),
            (r#""12′6″""#, 3.81),
            (r#""12’6”""#, 3.81),
            (r#""12,5 mètres""#, 12.5),
            (r#""39 ft 4 in""#, 11.9888),
            (r#""39ft 4in""#, 11.9888),
            (r#""~12""#, 12.0),
            (r#""Ca. 12,5 m""#, 12.5),
            (r#""12 м""#, 12.0),
            (r#""6'4""#, 1.9304),
            (r#""100\"""#, 2.54),
            (r#""12;12""#, 12.0),
            ("[12]", 12.0),
            (r#""12,5""#, 12.5),
        ] {
            let (base_m, top_m, notes) = height(&format!(r#"{{"height": {text}}}"#));
            assert!(base_m == 0.0 && (top_m - metres).abs() < 1e-9 && notes.is_empty(), "{text}: {top_m} {notes:?}");
        }
    }

    #[test]
    fn a_comma_may_be_between_groups_of_digits() {
        for (text, metres, is_guess) in [
            ("1,234.5 ft", 376.2756, false),
            ("1.234,5 cm", 12.345, false),
            // The other reading is no height.
            ("12,345", 12.345, false),
            ("0,750", 0.75, false),
            ("1,776 ft", 541.3248, true),
            ("12,345 mm", 12.345, true),
            ("1,234", 1.234, true),
        ] {
            let (_, top_m, notes) = height(&format!(r#"{{"height": "{text}"}}"#));
            let expected = if is_guess { vec![MARK_GUESSED.to_owned()] } else { vec![] };
            assert!((top_m - metres).abs() < 1e-9 && notes == expected, "{text}: {top_m} {notes:?}");
        }
    }

    #[test]
    fn the_first_of_several_values_counts_and_is_reported() {
        let several = || SEVERAL_VALUES.to_owned();
        for text in [r#""12;15""#, r#""12 | 15""#, r#""12 m\n15 m""#, "[12, 15]", r#"["12 m", "15 m"]"#] {
            assert_eq!(height(&format!(r#"{{"height": {text}}}"#)), (0.0, 12.0, vec![several()]), "{text}");
        }
        for text in [r#""3;4""#, "[3, 4]", r#""3 floors; 4 floors""#, r#""R+2;R+3""#] {
            let notes = vec![several(), GUESSED_FROM_LEVELS.to_owned()];
            assert_eq!(height(&format!(r#"{{"levels": {text}}}"#)), (0.0, 9.0, notes), "{text}");
        }
        let base = r#"{"height": 20, "min_height": "3;5"}"#;
        assert_eq!(height(base), (3.0, 20.0, vec![several()]));
    }

    #[test]
    fn height_takes_precedence_over_levels_and_levels_over_the_default() {
        let all = r#"{"building:levels": 9, "height": null, "building:height": "21", "min_height": 3}"#;
        assert_eq!(height(all), (3.0, 21.0, vec![]));
        let levels = r#"{"levels": "4", "roof:levels": 1, "building:min_level": 1}"#;
        assert_eq!(height(levels), (3.0, 15.0, vec!["height guessed from levels".to_owned()]));
        // All storeys are in the roof, or none.
        let attic = r#"{"building:levels": 0, "roof:levels": 2}"#;
        assert_eq!(height(attic), (0.0, 6.0, vec!["height guessed from levels".to_owned()]));
        let flat = r#"{"building:levels": 3, "roof:levels": 0}"#;
        assert_eq!(height(flat), (0.0, 9.0, vec!["height guessed from levels".to_owned()]));
        for above_ground in ["R+2", "G + 2", "R+2+C"] {
            assert_eq!(height(&format!(r#"{{"levels": "{above_ground}"}}"#)).1, 9.0, "{above_ground}");
        }
        assert_eq!(height(r#"{"building:levels": 0}"#), (0.0, 6.0, vec!["height guessed".to_owned()]));
        assert_eq!(height("{}"), (0.0, 6.0, vec!["height guessed".to_owned()]));
        assert_eq!(height(r#"{"min_height": 10}"#), (10.0, 16.0, vec!["height guessed".to_owned()]));
        // In any case, and as tiles have them.
        assert_eq!(height(r#"{"HEIGHT": 10, "MIN_HEIGHT": 4}"#), (4.0, 10.0, vec![]));
        assert_eq!(height(r#"{"Height": 10, "Building_Min_Height": 4}"#), (4.0, 10.0, vec![]));
        assert_eq!(height(r#"{"render_height": 10, "render_min_height": 4}"#), (4.0, 10.0, vec![]));
        assert_eq!(height(r#"{"height": 10, "base_height": 4}"#), (4.0, 10.0, vec![]));
        // As Shapefiles cut them.
        assert_eq!(height(r#"{"render_hei": 10, "render_min": 4}"#), (4.0, 10.0, vec![]));
        assert_eq!(height(r#"{"building_h": 10, "building_m": 4}"#), (4.0, 10.0, vec![CUT_NAME.to_owned()]));
        for material in [r#""brick""#, "10", "0"] {
            assert_eq!(height(&format!(r#"{{"building_h": 10, "building_m": {material}}}"#)), (0.0, 10.0, vec![]));
        }
        assert_eq!(height(r#"{"NUM_FLOORS": 4, "MIN_FLOOR": 1}"#).0, 3.0);
    }

    #[test]
    fn storeys_have_their_own_heights() {
        let list = |list: &str| format!(r#"{{"storeysAboveGround": 2, "storeyHeightsAboveGround": {list}}}"#);
        for (text, top_m) in [(r#""5 4.5""#, 9.5), ("[5, 4.5]", 9.5), ("4", 8.0), (r#""3.5""#, 7.0)] {
            assert_eq!(height(&list(text)), (0.0, top_m, vec![]), "{text}");
        }
        let feet = r#"{"storeysAboveGround": 2, "storeyHeightsAboveGround": 10, "storeyHeightsAboveGround.uom": "ft"}"#;
        assert_eq!(height(feet), (0.0, 6.096, vec![]));
        for text in [r#""5 4 3""#, r#""-9999 -9999""#, r#""a b""#, "null"] {
            assert_eq!(height(&list(text)), (0.0, 6.0, vec![GUESSED_FROM_LEVELS.to_owned()]), "{text}");
        }
    }

    #[test]
    fn invalid_heights_are_reported_and_ignored() {
        for text in [
            "0", "-3", "1e9", "true", r#""tall""#, r#""12 km""#, r#""5-7""#, r#""nan""#, r#""5'x""#, r#""5'99\"""#,
            r#""5 ft 4 m""#, r#""R+""#,
        ] {
            let (base_m, top_m, notes) = height(&format!(r#"{{"height": {text}, "levels": 2}}"#));
            assert_eq!((base_m, top_m), (0.0, 6.0), "{text}");
            assert_eq!(notes, [NOT_UNDERSTOOD, GUESSED_FROM_LEVELS], "{text}");
        }
        let upside_down = height(r#"{"height": 5, "min_height": 5}"#);
        assert_eq!(upside_down, (0.0, 5.0, vec![BASE_ABOVE_TOP.to_owned()]));
    }

    #[test]
    fn units_come_from_the_value_the_name_the_user_or_the_publisher() {
        let feet = HeightHints { unit: Some(HeightUnit::Foot), ..HeightHints::default() };
        let top = |properties: &str, hints| height_with(properties, hints).1;
        assert_eq!(top(r#"{"HEIGHT": 100}"#, feet), 30.48);
        assert_eq!(top(r#"{"HEIGHT": "100 m"}"#, feet), 100.0);
        assert_eq!(top(r#"{"HEIGHT_M": 100}"#, feet), 100.0);
        assert_eq!(top(r#"{"HEIGHT_FT": 100}"#, HeightHints::default()), 30.48);
        assert_eq!(top(r#"{"STOREYS": 4}"#, feet), 12.0);
        assert_eq!(top(r#"{"h": 10, "height": 5}"#, HeightHints { field: Some("h"), ..feet }), 3.048);
        let new_york = r#"{"heightroof": "100", "groundelev": "30"}"#;
        let (_, top_m, notes) = height(new_york);
        assert_eq!((top_m, notes), (30.48, vec![UNIT_GUESSED.to_owned()]));
        assert_eq!(height(r#"{"height_roo": 100, "doitt_id": 7}"#).1, 30.48);
        assert_eq!(height(r#"{"heightroof": 20}"#), (0.0, 20.0, vec![]));
        // The ground of others is in metres.
        assert_eq!(height(r#"{"roof_elev": 524.5, "ground_elev": 512.5}"#), (0.0, 12.0, vec![]));
        let in_feet = HeightHints { is_map_in_feet: true, ..HeightHints::default() };
        assert_eq!(height_with(r#"{"BLDG_HT": 20}"#, in_feet), (0.0, 20.0, vec![UNIT_GUESSED.to_owned()]));
        assert_eq!(height_with(r#"{"BLDG_HT": "20 m"}"#, in_feet).1, 20.0);
    }

    #[test]
    fn units_may_be_told_by_an_attribute_beside_the_height() {
        for own in [
            r#"{"height": 100, "height_unit": "ft"}"#,
            r#"{"measuredHeight": 100, "measuredHeight.uom": "urn:ogc:def:uom:UCUM::[ft_i]"}"#,
            r#"{"BLDG_HT": 100, "HeightUnits": "Feet"}"#,
            r#"{"height": {"value": 100, "unit": "ft"}}"#,
        ] {
            assert_eq!(height(own), (0.0, 30.48, vec![]), "{own}");
        }
        let beside = r#"{"height": 100, "units": "feet"}"#;
        assert_eq!(height(beside), (0.0, 30.48, vec![UNIT_GUESSED.to_owned()]));
        let metres = HeightHints { unit: Some(HeightUnit::Metre), ..HeightHints::default() };
        assert_eq!(height_with(beside, metres), (0.0, 100.0, vec![]));
        assert_eq!(height_with(r#"{"heightroof": 100, "groundelev": 30}"#, metres), (0.0, 100.0, vec![]));
        let unknown = r#"{"height": 100, "height_unit": "cubits"}"#;
        assert_eq!(height(unknown), (0.0, 100.0, vec![UNIT_GUESSED.to_owned()]));
        assert_eq!(height_with(unknown, metres), (0.0, 100.0, vec![]));
        // Dwellings.
        assert_eq!(height(r#"{"height": 100, "units": 12}"#), (0.0, 100.0, vec![]));
        assert_eq!(height(r#"{"height": "100 m", "unit": "ft"}"#).1, 100.0);
    }

    #[test]
    fn the_base_has_the_unit_of_the_top() {
        for feet in [
            r#"{"HEIGHT_FT": 100, "min_height": 50}"#,
            r#"{"height": 100, "min_height": 50, "height_unit": "ft"}"#,
            r#"{"height": 30.48, "MIN_HEIGHT_FT": 50}"#,
            r#"{"HEIGHT_FT": 100, "min_height": "15.24 m"}"#,
        ] {
            assert_eq!(height(feet), (15.24, 30.48, vec![]), "{feet}");
        }
        let mut attributes = Attributes::default();
        attributes.push("HEIGHT_FT", AttributeValue::Integer(100));
        assert_eq!(plain_unit_m(&attributes, HeightHints::default()), 0.3048);
    }

    #[test]
    fn storeys_in_the_place_of_a_height_are_counted() {
        for text in ["3 floors", "3 storeys", "3 Geschosse", "3 floor", "3 étages", "3 levels"] {
            let notes = vec![GUESSED_FROM_LEVELS.to_owned()];
            assert_eq!(height(&format!(r#"{{"height": "{text}"}}"#)), (0.0, 9.0, notes.clone()), "{text}");
            assert_eq!(height(&format!(r#"{{"levels": "{text}"}}"#)), (0.0, 9.0, notes), "{text}");
        }
        assert_eq!(height(r#"{"height": "3 floors", "measuredHeight": 20}"#).1, 20.0);
        assert_eq!(height(r#"{"height": "3 floors", "levels": 5}"#).1, 15.0);
    }

    #[test]
    fn heights_above_sea_level_are_less_that_of_the_ground() {
        assert_eq!(height(r#"{"b3_h_dak_max": 14.5, "b3_h_maaiveld": -1.5}"#), (0.0, 16.0, vec![]));
        assert_eq!(height(r#"{"h_dak_max": 14.5}"#), (0.0, 14.5, vec![NO_GROUND_HEIGHT.to_owned()]));
        assert_eq!(height(r#"{"h_dak_max": 1, "h_maaiveld": 2}"#), (0.0, 6.0, vec![GUESSED.to_owned()]));
        // The plan may have it, or an elevation model.
        let hints = HeightHints { ground_m: Some(512.5), ..HeightHints::default() };
        assert_eq!(height_with(r#"{"roof_elev": 524.5}"#, hints), (0.0, 12.0, vec![]));
        assert_eq!(height_with(r#"{"roof_elev": 524.5, "ground_elev": 510.5}"#, hints), (0.0, 14.0, vec![]));
    }
}
