//! What cannot be seen from above: in tunnels, below the ground, indoors. The same for OpenStreetMap, Overture and the attributes of
//! city offices.

use super::lengths::length_m;
use insula_source::attributes::{AttributeValue, Attributes};
use insula_source::object::FeatureKind;
use insula_source::text::{first_value, split_words};
use std::borrow::Cow;
use std::ops::RangeInclusive;

/// Why an underground object is skipped.
pub const UNDERGROUND: &str = "underground";
/// Why an object in a tunnel is skipped.
pub const IN_TUNNEL: &str = "in a tunnel";
/// Why an object inside a building is skipped.
pub const INDOORS: &str = "indoors";
/// Why an area of a hazard map is skipped.
pub const HAZARD: &str = "area that a hazard map floods, no water";

/// Names of attributes that say by a truth value that a feature is below the ground; the second as Shapefiles cut it.
const IS_UNDERGROUND: &[&str] = &["is_underground", "is_undergr", "underground", "subterranean"];
/// Names that say so as Shapefiles cut it and in other languages, and by a word only: a number there may be one of storeys.
const IS_UNDERGROUND_BY_WORD: &[&str] = &[
    "undergroun", "unterirdisch", "souterrain", "subterraneo", "subterráneo", "soterrado", "sotterraneo", "interrato",
    "ondergronds", "podziemny", "podzemni", "podzemní", "underjordisk",
];
const IS_TUNNEL: &[&str] = &["tunnel", "is_tunnel", "tunel", "túnel", "galleria"];
/// Names of attributes, each with the value that means below the ground: of INSPIRE, of CityGML and of the German agencies.
const BELOW: &[(&str, &[&str])] = &[
    ("location", &["underground", "underwater", "subsurface"]),
    ("parking", &["underground"]),
    ("verticalposition", &["underground"]),
    ("vertical_position", &["underground"]),
    ("relativetoterrain", &["entirelybelowterrain"]),
    ("lagezurerdoberflaeche", &["1200", "unter der erdoberfläche", "unter der erdoberflaeche"]),
    ("ofl", &["1200", "unter der erdoberfläche", "unter der erdoberflaeche"]),
];
/// Values of `tunnel` that name a kind of tunnel. Others name a passage on the ground: through a building, or below a roof
/// against snow.
const TUNNELS: &[&str] = &["culvert", "flooded"];
/// Names of attributes that are negative below the ground, for all kinds: storeys of OpenStreetMap, levels of Overture, the relative
/// heights of the Dutch, the position of the French and the step of the Swiss base map.
const LEVELS: &[&str] = &[
    "level", "max_level", "building:max_level", "relatievehoogteligging", "relatieveh", "hoogteniveau", "pos_sol",
    "stufe",
];
/// Levels and storeys of buildings. Others are marks of missing ones, such as -9999.
const LEVELS_RANGE: RangeInclusive<f64> = -50.0..=400.0;
/// Words for yes, in the languages of the larger publishers. `T` is that of Shapefiles. All else tells nothing.
const YES: &[&str] = &split_words::<26>(
    "yes y true t 1 1.0 ja j wahr oui vrai si sí verdadero sim vero da да ano tak igen kyllä evet はい 是 예",
);
/// Values of `indoor` of what is inside of a building.
const INDOOR: &[&str] = &["room", "corridor", "area", "wall", "column", "door"];
/// What is below the ground if its `layer` is negative. Roads and water are then in a cutting, or only below a bridge.
const BELOW_BY_LAYER: &[(&str, &[&str])] = &[
    ("railway", &["subway", "platform"]),
    ("public_transport", &["platform"]),
    ("highway", &["platform", "corridor"]),
    ("amenity", &["parking", "bicycle_parking", "motorcycle_parking"]),
    ("leisure", &["swimming_pool"]),
    ("fclass", &["subway"]),
    ("class", &["subway"]),
];

/// The reason why areas and lines of a kind cannot be seen from above; `None` if they can. `tag` gives the value of a name.
pub fn hidden<'t>(kind: FeatureKind, tag: impl Fn(&str) -> Option<Cow<'t, str>>) -> Option<&'static str> {
    let is_building = matches!(kind, FeatureKind::Building | FeatureKind::BuildingPart);
    let is_one_of = |name: &str, values: &[&str]| {
        tag(name).is_some_and(|value| values.iter().any(|known| first_value(&value).eq_ignore_ascii_case(known)))
    };
    let is_in_tunnel = |name: &&str| tag(name).is_some_and(|value| is_true(&value)) || is_one_of(name, TUNNELS);
    if IS_TUNNEL.iter().any(is_in_tunnel) {
        return Some(IN_TUNNEL);
    }
    let is_below_by_layer = tag("layer").and_then(|value| highest(&value)).is_some_and(|layer| layer < 0.0)
        && (is_building || BELOW_BY_LAYER.iter().any(|(name, values)| is_one_of(name, values)));
    let is_below_by_level =
        || LEVELS.iter().any(|name| tag(name).and_then(|value| highest(&value)).is_some_and(|level| level < 0.0));
    let is_word = |value: &str| value.trim().parse::<f64>().is_err();
    let is_underground = IS_UNDERGROUND.iter().any(|name| tag(name).is_some_and(|value| is_true(&value)))
        || IS_UNDERGROUND_BY_WORD.iter().any(|name| tag(name).is_some_and(|value| is_word(&value) && is_true(&value)))
        || BELOW.iter().any(|(name, values)| is_one_of(name, values))
        || is_below_by_layer
        || is_below_by_level()
        || is_building && is_cellar(&tag);
    if is_underground {
        return Some(UNDERGROUND);
    }
    // A building whose inside is mapped may say so with `yes`.
    let is_indoors = is_one_of("indoor", INDOOR) || !is_building && is_one_of("indoor", &["yes", "true", "level"]);
    (is_indoors || is_one_of("location", &["indoor"])).then_some(INDOORS)
}

/// [`hidden`] by attributes, whose names may be spelt as in [`Attributes::named`], and by the flags of Overture's roads and rails.
pub fn is_hidden(kind: FeatureKind, attributes: &Attributes) -> Option<&'static str> {
    let text = |value: &AttributeValue| match value {
        AttributeValue::Text(text) => text.clone(),
        value => value.to_string(),
    };
    let tag = |name: &str| attributes.named(name).map(|value| Cow::Owned::<str>(text(value)));
    hidden(kind, tag).or_else(|| has_tunnel_flag(attributes).then_some(IN_TUNNEL))
}

/// Whether what has the type of water is an area that may be flooded. PLATEAU has them so, because CityGML has no other type for them.
pub fn is_hazard(kind: FeatureKind, attributes: &Attributes) -> bool {
    let is_risk = |name: &str| name.contains("浸水") || name.to_ascii_lowercase().contains("riskattribute");
    let is_flood = |name: &str, value: &AttributeValue| {
        let name = name.rsplit([':', '.']).next().unwrap_or_default();
        matches!(name, "class" | "function") && value.as_str().is_some_and(|text| text.contains("浸水"))
    };
    kind == FeatureKind::Water && attributes.iter().any(|(name, value)| is_risk(name) || is_flood(name, value))
}

/// Whether a flag of Overture says that all of a road or rail is in a tunnel. Flags may be of a part only.
fn has_tunnel_flag(attributes: &Attributes) -> bool {
    let flags = attributes.iter().filter(|(_, value)| value.as_str() == Some("is_tunnel"));
    flags.filter_map(|(name, _)| name.split_once(".values")).any(|(flag, _)| {
        (flag.starts_with("road_flags") || flag.starts_with("rail_flags"))
            && !attributes.iter().any(|(name, _)| name.starts_with(&format!("{flag}.between")))
    })
}

/// Whether a building has storeys below the ground only.
fn is_cellar<'t>(tag: &impl Fn(&str) -> Option<Cow<'t, str>>) -> bool {
    let number = |names: &[&str]| names.iter().find_map(|name| level(&tag(name)?));
    let height_m = ["height", "building:height"].iter().find_map(|name| length_m(&tag(name)?));
    if height_m.is_some_and(|height_m| height_m > 0.0) || number(&["roof:levels"]).is_some_and(|levels| levels > 0.0) {
        return false;
    }
    let begins_below = number(&["building:levels:underground", "num_floors_underground"])
        .is_some_and(|levels| levels > 0.0)
        || number(&["building:min_level", "min_level", "min_floor"]).is_some_and(|level| level < 0.0);
    // Storeys are counted from the ground. Negative ones are below.
    begins_below && number(&["building:levels", "levels", "num_floors"]).is_some_and(|levels| levels <= 0.0)
}

/// Whether a value means yes, in any type or larger language.
pub fn is_yes(value: &AttributeValue) -> bool {
    is_true(&value.to_string())
}

fn is_true(value: &str) -> bool {
    let value = value.trim().to_lowercase();
    YES.contains(&value.as_str())
}

fn level(text: &str) -> Option<f64> {
    text.trim().parse::<f64>().ok().filter(|level| LEVELS_RANGE.contains(level))
}

/// The highest of levels such as `-1`, `-2;-1` or `-2--1`; `None` if they are no numbers.
fn highest(levels: &str) -> Option<f64> {
    let one = |text: &str| {
        let text = text.trim();
        // The first character may be a sign.
        let range = text.char_indices().skip(1).find(|(_, c)| *c == '-');
        level(text).or_else(|| {
            let (low, high) = text.split_at(range?.0);
            Some(level(low)?.max(level(&high[1..])?))
        })
    };
    let all: Option<Vec<f64>> = levels.split([';', ',']).map(one).collect();
    all?.into_iter().reduce(f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;
    use FeatureKind::{Building, BuildingPart, Rail, Road, Water};

    fn reason(kind: FeatureKind, pairs: &[(&str, &str)]) -> Option<&'static str> {
        let mut attributes = Attributes::default();
        pairs.iter().for_each(|(name, value)| attributes.push(name, AttributeValue::from_untyped(value)));
        is_hidden(kind, &attributes)
    }

    #[test]
    fn what_is_below_the_ground_is_hidden_by_any_of_its_attributes() {
        for (kind, pairs) in [
            (Building, &[("location", "underground")][..]),
            (Building, &[("layer", "-1")]),
            (Building, &[("LAYER", "-2;-1")]),
            (Building, &[("level", "-1")]),
            (Building, &[("LOCATION", "Underground")]),
            (Building, &[("UNDERGROUN", "T")]),
            (Building, &[("num_floors", "0"), ("num_floors_underground", "2")]),
            (Building, &[("LEVEL", "-2;-1")]),
            (BuildingPart, &[("level", "-3--1")]),
            (Building, &[("is_underground", "true")]),
            (Building, &[("IS_UNDERGR", "1")]),
            (Building, &[("underground", "Ja")]),
            (Building, &[("Souterrain", "oui")]),
            (Building, &[("UNTERIRDISCH", "J")]),
            (Road, &[("hoogteniveau", "-1")]),
            (Road, &[("STUFE", "-2")]),
            (Building, &[("OFL", "1200")]),
            (Building, &[("lageZurErdoberflaeche", "Unter der Erdoberfläche")]),
            (Water, &[("verticalPosition", "underground")]),
            (Building, &[("relativeToTerrain", "entirelyBelowTerrain")]),
            (Building, &[("building:levels", "0"), ("building:levels:underground", "2")]),
            (BuildingPart, &[("building:min_level", "-2"), ("building:levels", "0")]),
            (BuildingPart, &[("building:min_level", "-2"), ("building:max_level", "-1")]),
            (Road, &[("relatieveHoogteligging", "-1")]),
            (Road, &[("POS_SOL", "-1")]),
            (Rail, &[("railway", "subway"), ("layer", "-2")]),
            (Road, &[("amenity", "parking"), ("parking", "underground")]),
            (Water, &[("location", "underground")]),
        ] {
            assert_eq!(reason(kind, pairs), Some(UNDERGROUND), "{pairs:?}");
        }
        for (kind, pairs, expected) in [
            (Building, &[("building", "train_station"), ("tunnel", "yes")][..], IN_TUNNEL),
            (Road, &[("tunnel", "T")], IN_TUNNEL),
            (Road, &[("Túnel", "Sí")], IN_TUNNEL),
            (Water, &[("tunnel", "culvert")], IN_TUNNEL),
            (Road, &[("road_flags.0.values.0", "is_tunnel")], IN_TUNNEL),
            (Road, &[("indoor", "yes")], INDOORS),
            (Building, &[("indoor", "room")], INDOORS),
        ] {
            assert_eq!(reason(kind, pairs), Some(expected), "{pairs:?}");
        }
    }

    #[test]
    fn areas_of_hazard_maps_are_no_water() {
        let hazard = |kind, name: &str, value: &str| {
            let mut attributes = Attributes::default();
            attributes.push(name, AttributeValue::from_untyped(value));
            is_hazard(kind, &attributes)
        };
        for (name, value) in [
            ("floodingRiskAttribute.rank", "3"),
            ("uro:WaterBodyTsunamiRiskAttribute_depth", "1.5"),
            ("wtr:function", "高潮浸水想定区域"),
            ("浸水ランク", "3m以上5m未満"),
        ] {
            assert!(hazard(Water, name, value), "{name}");
        }
        assert!(!hazard(Water, "function", "河川") && !hazard(Water, "name", "浸水公園"));
        assert!(!hazard(Building, "buildingDisasterRiskAttribute.rank", "3"));
    }

    #[test]
    fn what_is_on_or_above_the_ground_is_not() {
        for (kind, pairs) in [
            (Building, &[("building", "yes")][..]),
            (Building, &[("level", "-1;0")]),
            (Building, &[("UNDERGROUN", "2")]),
            (Building, &[("interrato", "1")]),
            (Building, &[("relativeToTerrain", "substantiallyBelowTerrain")]),
            (Building, &[("OFL", "1400")]),
            (Building, &[("verticalPosition", "onGroundSurface")]),
            (Building, &[("level", "0-2")]),
            (Building, &[("LEVEL", "-9999")]),
            (Building, &[("layer", "-9999")]),
            (Building, &[("num_floors", "-9999"), ("num_floors_underground", "2")]),
            (Building, &[("underground", "n/a")]),
            (Building, &[("underground", "Nein"), ("tunnel", "-")]),
            (Building, &[("is_underground", "-9999"), ("subterranean", "nan")]),
            (Building, &[("building:levels", "3"), ("building:levels:underground", "2")]),
            (Building, &[("building:levels:underground", "1")]),
            (Building, &[("building:levels", "0"), ("building:min_level", "-1"), ("roof:levels", "1")]),
            (Building, &[("building:levels", "0"), ("building:levels:underground", "1"), ("height", "4")]),
            (Building, &[("indoor", "yes"), ("is_underground", "false"), ("tunnel", "no")]),
            (Road, &[("tunnel", "building_passage")]),
            (Building, &[("TUNNEL", "Building_Passage")]),
            (Road, &[("tunnel", "F"), ("layer", "-1")]),
            (Road, &[("road_flags.0.values.0", "is_tunnel"), ("road_flags.0.between.0", "0.5")]),
            (Water, &[("natural", "water"), ("layer", "-1")]),
        ] {
            assert_eq!(reason(kind, pairs), None, "{pairs:?}");
        }
    }

    #[test]
    fn levels_are_read_in_every_spelling() {
        for (text, level) in
            [("-1", -1.0), ("-2;-1", -1.0), ("-2--1", -1.0), ("0-3", 3.0), ("-1;0.5", 0.5), ("2,3", 3.0)]
        {
            assert_eq!(highest(text), Some(level), "{text}");
        }
        assert_eq!((highest("roof"), highest(""), highest("-"), highest("ä-ö")), (None, None, None, None));
    }
}
