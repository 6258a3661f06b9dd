//! What a feature is, from its attributes: those of OpenStreetMap and of Overture.

use insula_source::attributes::{AttributeValue, Attributes};
use insula_source::object::FeatureKind;
use insula_source::text::{is_one_of, split_words};

/// An attribute and its values; without values, all but `no`.
type Tag = (&'static str, &'static [&'static str]);

/// It is of buildings, too.
const HARBOUR_USE: Tag = ("landuse", &["harbour"]);

/// Tags by kind, the more certain ones first.
const TAGS: &[(FeatureKind, &[Tag])] = &[
    (FeatureKind::Bridge, &[("man_made", &["bridge"])]),
    (
        FeatureKind::Furniture,
        &[
            ("highway", &["street_lamp", "bus_stop", "traffic_signals", "stop", "give_way", "crossing", "milestone"]),
            ("man_made", &["street_cabinet", "flagpole", "manhole"]),
            ("amenity", &["bench", "waste_basket", "post_box", "bicycle_parking", "drinking_water", "fountain"]),
        ],
    ),
    (FeatureKind::Road, &[("highway", &[]), ("area:highway", &[])]),
    (
        FeatureKind::Rail,
        &[("railway", &["rail", "light_rail", "tram", "subway", "narrow_gauge", "monorail", "funicular"])],
    ),
    (
        FeatureKind::Water,
        &[
            ("natural", &["water", "bay", "strait"]),
            ("water", &[]),
            ("waterway", &["riverbank", "dock", "river", "canal", "stream", "ditch", "drain"]),
            ("landuse", &["reservoir", "basin"]),
            ("leisure", &["marina", "swimming_pool"]),
        ],
    ),
    (
        FeatureKind::Vegetation,
        &[
            ("natural", &["wood", "tree", "tree_row", "scrub", "heath", "grassland", "shrubbery"]),
            ("landuse", &["forest", "grass", "meadow", "orchard", "vineyard", "village_green", "flowerbed"]),
            ("leisure", &["park", "garden", "nature_reserve"]),
        ],
    ),
    (
        FeatureKind::LandUse,
        &[
            (
                "landuse",
                &split_words::<23>(
                    "residential commercial retail industrial port farmland farmyard allotments cemetery \
                    railway construction brownfield greenfield quarry landfill military garages recreation_ground \
                    religious education institutional plant_nursery greenhouse_horticulture",
                ),
            ),
            ("leisure", &["pitch", "playground", "golf_course", "track", "dog_park"]),
            ("natural", &["beach", "sand", "bare_rock", "scree", "wetland"]),
            ("amenity", &["parking"]),
        ],
    ),
    // A harbour with a tag of land is land use.
    (FeatureKind::Water, &[("harbour", &[]), HARBOUR_USE, ("seamark:type", &["harbour_basin", "lock_basin", "dock"])]),
];

/// Attributes that only buildings have: `landuse` and the like then say what the building is for.
const BUILDING_ATTRIBUTES: [&str; 8] =
    split_words("height building:levels building:height measuredHeight measured_height num_floors levels floors");

/// Subtypes of Overture's other themes than buildings.
const OVERTURE_SUBTYPES: &[(FeatureKind, &[&str])] = &[
    (FeatureKind::Bridge, &["bridge"]),
    (FeatureKind::Road, &["road"]),
    (FeatureKind::Rail, &["rail"]),
    (
        FeatureKind::Water,
        &["water", "river", "lake", "stream", "pond", "canal", "reservoir", "ocean", "human_made", "wastewater"],
    ),
    (FeatureKind::Vegetation, &["forest", "tree", "shrub", "grass", "park", "protected"]),
    (FeatureKind::LandUse, &["agriculture", "cemetery", "golf", "recreation", "developed", "sand", "rock", "wetland"]),
];

/// Subtypes of Overture's buildings.
const OVERTURE_BUILDING_SUBTYPES: &[&str] = &split_words::<13>(
    "agricultural civic commercial education entertainment industrial medical military outbuilding religious \
    residential service transportation",
);
/// Attributes that only Overture's buildings have.
const OVERTURE_BUILDING_ATTRIBUTES: &[&str] =
    &["num_floors", "facade_color", "facade_material", "roof_shape", "roof_color", "roof_material", "roof_height"];

/// Classes of Overture's subtype `physical` that are water.
const OVERTURE_WATERS: &[&str] = &["bay", "strait", "lagoon", "sea", "ocean", "fairway", "tidal_channel"];

/// Classes of Overture's land use that are water.
const OVERTURE_HARBOURS: &[&str] = &["marina", "harbour", "harbor", "dock"];

/// The kind of a feature by its attributes; `None` if they do not tell. What is said to be a building is one, whatever else
/// is said.
pub fn kind_of(attributes: &Attributes) -> Option<FeatureKind> {
    let value = |name: &str| {
        let text = attributes.named(name).and_then(AttributeValue::as_str).map(|text| text.trim().to_lowercase());
        text.filter(|text| !matches!(text.as_str(), "" | "no" | "n" | "f" | "false" | "0" | "none" | "null"))
    };
    if value("building").is_some() {
        return Some(FeatureKind::Building);
    }
    if value("building:part").is_some() {
        return Some(FeatureKind::BuildingPart);
    }
    if value("amenity").is_some_and(|amenity| amenity == "shelter") {
        return Some(FeatureKind::Building);
    }
    if is_of_overture(attributes) {
        return of_overture(attributes);
    }
    let is_building = BUILDING_ATTRIBUTES.iter().any(|name| attributes.named(name).is_some());
    // In capitals, a name without known values may mean anything else, such as the supply of water.
    let has = |(name, values): &Tag| match values.is_empty() {
        true => attributes.get(name).is_some() && value(name).is_some(),
        false => value(name).is_some_and(|value| is_one_of(&value, values)),
    };
    let found = TAGS.iter().find(|(_, tags)| tags.iter().any(has)).map(|(kind, _)| *kind);
    let is_quay = value("surface").is_some() || value("industrial").is_some();
    let found = found.map(|kind| if has(&HARBOUR_USE) && is_quay { FeatureKind::LandUse } else { kind });
    found.filter(|kind| !is_building || *kind != FeatureKind::LandUse && !has(&HARBOUR_USE))
}

/// Whether a feature has the members that all of Overture have. GeoJSON may have the identifier elsewhere.
fn is_of_overture(attributes: &Attributes) -> bool {
    let is_text = |name: &str| attributes.get(name).is_some_and(|value| value.as_str().is_some());
    (is_text("id") || attributes.get("version").is_some())
        && (is_text("sources.0.dataset") || is_text("sources.0.property"))
}

fn of_overture(attributes: &Attributes) -> Option<FeatureKind> {
    let text = |name: &str| attributes.get(name).and_then(AttributeValue::as_str);
    let is_of_buildings = text("theme") == Some("buildings");
    if attributes.get("building_id").is_some() || is_of_buildings && text("type") == Some("building_part") {
        return Some(FeatureKind::BuildingPart);
    }
    if is_of_buildings || is_overture_building(attributes) {
        return Some(FeatureKind::Building);
    }
    let subtype = attributes.get("subtype")?.as_str()?;
    let class = attributes.get("class").and_then(AttributeValue::as_str);
    if class.is_some_and(|class| OVERTURE_HARBOURS.contains(&class)) {
        return Some(FeatureKind::Water);
    }
    if subtype == "physical" && class.is_some_and(|class| OVERTURE_WATERS.contains(&class)) {
        return Some(FeatureKind::Water);
    }
    OVERTURE_SUBTYPES.iter().find(|(_, known)| known.contains(&subtype)).map(|(kind, _)| *kind)
}

/// Whether a feature of Overture that names no theme is a building. All that only buildings have is optional.
fn is_overture_building(attributes: &Attributes) -> bool {
    let has = |name: &str| attributes.get(name).is_some();
    let subtype = attributes.get("subtype").and_then(AttributeValue::as_str);
    // Masts and the like have a height and a subtype, too.
    has("has_parts")
        || has("is_underground")
        || OVERTURE_BUILDING_ATTRIBUTES.iter().any(|name| has(name))
        || has("height") && subtype.is_none_or(|subtype| OVERTURE_BUILDING_SUBTYPES.contains(&subtype))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn kind(pairs: &[(&str, &str)]) -> Option<FeatureKind> {
        let mut attributes = Attributes::default();
        pairs.iter().for_each(|(name, value)| attributes.push(name, AttributeValue::from_untyped(value)));
        kind_of(&attributes)
    }

    #[test]
    fn tags_tell_kinds() {
        assert_eq!(kind(&[("building", "yes"), ("natural", "water")]), Some(FeatureKind::Building));
        assert_eq!(kind(&[("building:part", "yes")]), Some(FeatureKind::BuildingPart));
        assert_eq!(kind(&[("building", "no"), ("natural", "water")]), Some(FeatureKind::Water));
        assert_eq!(kind(&[("amenity", "shelter")]), Some(FeatureKind::Building));
        assert_eq!(kind(&[("highway", "residential")]), Some(FeatureKind::Road));
        assert_eq!(kind(&[("highway", "street_lamp")]), Some(FeatureKind::Furniture));
        assert_eq!(kind(&[("railway", "abandoned")]), None);
        assert_eq!(kind(&[("landuse", "forest")]), Some(FeatureKind::Vegetation));
        assert_eq!(kind(&[("landuse", "residential")]), Some(FeatureKind::LandUse));
        assert_eq!(kind(&[("landuse", "residential"), ("height", "12")]), None, "the use of a building");
        assert_eq!(kind(&[("natural", "wetland;water")]), Some(FeatureKind::Water), "the most certain one");
        assert_eq!(kind(&[("NATURAL", "Water")]), Some(FeatureKind::Water), "as in a Shapefile");
        assert_eq!(kind(&[("BUILDING", "N"), ("WATER", "City"), ("LANDUSE", "forest")]), Some(FeatureKind::Vegetation));
        assert_eq!(kind(&[("leisure", "marina")]), Some(FeatureKind::Water));
        assert_eq!(kind(&[("harbour", "yes")]), Some(FeatureKind::Water));
        assert_eq!(kind(&[("harbour", "yes"), ("landuse", "harbour")]), Some(FeatureKind::Water));
        assert_eq!(kind(&[("landuse", "harbour")]), Some(FeatureKind::Water));
        assert_eq!(kind(&[("landuse", "harbour"), ("surface", "concrete")]), Some(FeatureKind::LandUse));
        assert_eq!(kind(&[("landuse", "harbour"), ("height", "12")]), None, "the use of a building");
        assert_eq!(kind(&[("landuse", "port")]), Some(FeatureKind::LandUse));
        assert_eq!(kind(&[("name", "x")]), None);
    }

    #[test]
    fn members_of_overture_tell_kinds() {
        let source = ("sources.0.dataset", "OpenStreetMap");
        assert_eq!(kind(&[("id", "a"), source, ("building_id", "b")]), Some(FeatureKind::BuildingPart));
        assert_eq!(kind(&[("id", "a"), source, ("has_parts", "true")]), Some(FeatureKind::Building));
        assert_eq!(kind(&[("id", "a"), source, ("subtype", "road"), ("class", "primary")]), Some(FeatureKind::Road));
        assert_eq!(kind(&[("id", "a"), source, ("subtype", "physical"), ("class", "bay")]), Some(FeatureKind::Water));
        assert_eq!(kind(&[("id", "a"), source, ("subtype", "physical"), ("class", "cape")]), None);
        let marina = [("id", "a"), source, ("subtype", "recreation"), ("class", "marina")];
        assert_eq!(kind(&marina), Some(FeatureKind::Water));
        assert_eq!(kind(&[("id", "a"), source, ("subtype", "residential")]), None);
        let house = [("id", "a"), source, ("version", "1"), ("class", "house"), ("subtype", "residential")];
        assert_eq!(kind(&[&house[..], &[("height", "10")]].concat()), Some(FeatureKind::Building));
        assert_eq!(kind(&[&house[..], &[("num_floors", "3")]].concat()), Some(FeatureKind::Building));
        assert_eq!(kind(&[&house[..], &[("theme", "buildings")]].concat()), Some(FeatureKind::Building));
        let part = [("theme", "buildings"), ("type", "building_part")];
        assert_eq!(kind(&[&house[..], &part].concat()), Some(FeatureKind::BuildingPart));
        assert_eq!(
            kind(&[("version", "1"), source, ("height", "9")]),
            Some(FeatureKind::Building),
            "no class is known"
        );
        assert_eq!(kind(&[("id", "a"), source, ("subtype", "tower"), ("class", "mast"), ("height", "90")]), None);
        assert_eq!(kind(&[("building_id", "7")]), None, "a building's own number");
    }
}
