//! Classes of areas and lines by their tags in OpenStreetMap, which other sources use too.

use crate::paint::class::{AreaClass, LineClass};
use crate::paint::shape::Sidewalks;
use crate::paint::surfacing::Surfacing;
use AreaClass as A;
use LineClass as L;
use insula_source::text::{first_value, is_one_of};

/// How an area is painted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct AreaLook {
    pub class: AreaClass,
    pub surfacing: Option<Surfacing>,
}

/// How a line is painted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LineLook {
    pub class: LineClass,
    pub lanes: Option<u8>,
    pub is_one_way: bool,
    pub sidewalks: Sidewalks,
    pub surfacing: Option<Surfacing>,
}

/// Areas by a key and its values; without values, all but `no`. The first match counts, so land cover
/// comes before land use.
const AREAS: &[(&str, &[&str], AreaClass)] = &[
    ("area:highway", &["footway", "pedestrian", "path", "cycleway", "traffic_island"], A::Pavement),
    ("area:highway", &[], A::Carriageway),
    ("highway", &["pedestrian"], A::Square),
    ("highway", &["footway", "path", "cycleway", "steps", "bridleway"], A::Pavement),
    ("highway", &["platform"], A::Platform),
    ("highway", &["rest_area", "services"], A::Parking),
    ("highway", &["service", "track"], A::Parking),
    ("highway", &["residential", "living_street", "unclassified", "tertiary", "secondary", "primary"], A::Carriageway),
    ("railway", &["platform"], A::Platform),
    ("public_transport", &["platform"], A::Platform),
    ("man_made", &["pier", "breakwater", "quay"], A::Pier),
    ("natural", &["water", "bay", "strait"], A::Water),
    ("waterway", &["riverbank", "dock"], A::Water),
    ("landuse", &["reservoir", "basin", "pond"], A::Water),
    ("leisure", &["swimming_pool"], A::Water),
    ("amenity", &["fountain"], A::Water),
    ("water", &[], A::Water),
    ("amenity", &["parking", "bicycle_parking", "motorcycle_parking"], A::Parking),
    ("amenity", &["marketplace"], A::Square),
    ("place", &["square"], A::Square),
    ("aeroway", &["apron", "helipad", "runway", "taxiway"], A::Carriageway),
    ("leisure", &["pitch", "track"], A::Pitch),
    ("leisure", &["playground"], A::Playground),
    ("natural", &["wood"], A::Forest),
    ("landuse", &["forest"], A::Forest),
    ("natural", &["scrub", "heath", "shrubbery"], A::Scrub),
    ("landuse", &["plant_nursery", "vineyard"], A::Scrub),
    ("natural", &["wetland"], A::Wetland),
    ("natural", &["grassland", "fell", "tundra", "moor"], A::Meadow),
    ("landuse", &["meadow", "orchard", "greenfield"], A::Meadow),
    ("golf", &["fairway", "green", "tee"], A::Grass),
    ("golf", &["rough"], A::Meadow),
    ("landuse", &["grass", "village_green", "flowerbed", "greenery"], A::Grass),
    ("natural", &["sand", "beach", "shingle"], A::Sand),
    ("natural", &["scree", "bare_rock", "glacier", "blockfield"], A::Rock),
    ("natural", &["mud"], A::Construction),
    ("landuse", &["farmland", "farm"], A::Farmland),
    ("landuse", &["recreation_ground", "allotments"], A::Park),
    ("leisure", &["park", "garden", "golf_course", "dog_park", "common"], A::Park),
    ("landuse", &["cemetery"], A::Cemetery),
    ("amenity", &["grave_yard"], A::Cemetery),
    ("landuse", &["railway"], A::RailwayLand),
    ("landuse", &["residential", "garages"], A::Residential),
    (
        "landuse",
        &["industrial", "farmyard", "greenhouse_horticulture", "depot", "harbour", "port", "quarry"],
        A::Industrial,
    ),
    ("landuse", &["construction", "brownfield", "landfill"], A::Construction),
    ("landuse", &["commercial", "retail", "education", "institutional", "religious"], A::Commercial),
    ("amenity", &["school", "kindergarten", "university", "college", "hospital"], A::Commercial),
    ("leisure", &["stadium", "sports_centre"], A::Commercial),
    ("aeroway", &["aerodrome"], A::Meadow),
];

/// Lines by a key and its value. Links are as their roads: their width is their own.
const LINES: &[(&str, &[&str], LineClass)] = &[
    ("highway", &["motorway", "motorway_link"], L::Motorway),
    ("highway", &["trunk", "trunk_link"], L::Trunk),
    ("highway", &["primary", "primary_link"], L::Primary),
    ("highway", &["secondary", "secondary_link"], L::Secondary),
    ("highway", &["tertiary", "tertiary_link"], L::Tertiary),
    ("highway", &["unclassified", "road", "raceway"], L::Unclassified),
    ("highway", &["residential"], L::Residential),
    ("highway", &["living_street"], L::LivingStreet),
    ("highway", &["service", "busway", "bus_guideway"], L::Service),
    ("highway", &["pedestrian"], L::Pedestrian),
    ("highway", &["track"], L::Track),
    ("highway", &["footway"], L::Footway),
    ("highway", &["cycleway"], L::Cycleway),
    ("highway", &["path", "bridleway", "via_ferrata"], L::Path),
    ("highway", &["steps"], L::Steps),
    ("railway", &["rail", "light_rail", "subway", "preserved", "monorail"], L::Rail),
    ("railway", &["narrow_gauge", "funicular", "miniature"], L::NarrowGauge),
    ("railway", &["tram"], L::Tram),
    ("aeroway", &["runway", "stopway"], L::Runway),
    ("aeroway", &["taxiway", "taxilane"], L::Taxiway),
    ("waterway", &["river", "canal", "tidal_channel", "stream", "brook", "drain", "ditch"], L::Waterway),
    ("railway", &["platform"], L::Platform),
    ("highway", &["platform"], L::Platform),
    ("public_transport", &["platform"], L::Platform),
    ("man_made", &["pier", "breakwater", "quay"], L::Pier),
];

/// Roads with a higher limit have no pavements unless their tags say so.
const MAX_TOWN_KMH: f64 = 60.0;

/// How an area with these tags is painted; `None` if it is not. `tag` gives the value of a key.
pub fn area_look<'t>(tag: impl Fn(&str) -> Option<&'t str>) -> Option<AreaLook> {
    let class = find(AREAS, &tag)?;
    let surfacing = tag("surface").and_then(Surfacing::of_tag);
    let usual = match (class, tag("sport")) {
        (A::Pitch, Some("tennis" | "basketball" | "athletics" | "running" | "multi" | "baseball")) => {
            Some(Surfacing::Clay)
        }
        (A::Pitch, Some("beachvolleyball" | "volleyball" | "boules" | "equestrian")) => Some(Surfacing::Sand),
        _ => None,
    };
    Some(AreaLook { class, surfacing: surfacing.or(usual) })
}

/// How a line with these tags is painted; `None` if it is not. `tag` gives the value of a key.
pub fn line_look<'t>(tag: impl Fn(&str) -> Option<&'t str>) -> Option<LineLook> {
    let class = find(LINES, &tag)?;
    let count = |key: &str| first_value(tag(key)?).parse::<u8>().ok();
    Some(LineLook {
        class,
        lanes: if class.is_rail() { count("tracks") } else { count("lanes") },
        is_one_way: match tag("oneway") {
            Some(value) => matches!(value, "yes" | "1" | "true" | "-1"),
            None => class == L::Motorway || tag("junction") == Some("roundabout"),
        },
        sidewalks: sidewalks(&tag),
        surfacing: tag("surface").and_then(Surfacing::of_tag),
    })
}

/// The zebra crossing that a path is, if it is one.
pub fn is_zebra<'t>(tag: impl Fn(&str) -> Option<&'t str>) -> bool {
    let is_crossing = ["footway", "cycleway", "path"].iter().any(|key| tag(key) == Some("crossing"));
    is_crossing
        && (tag("crossing:markings").is_some_and(|value| value.starts_with("zebra"))
            || tag("crossing_ref") == Some("zebra")
            || tag("crossing") == Some("zebra"))
}

fn find<'t, C: Copy>(table: &[(&str, &[&str], C)], tag: &impl Fn(&str) -> Option<&'t str>) -> Option<C> {
    let fits = |(key, values, _): &&(&str, &[&str], C)| {
        tag(key).is_some_and(|value| if values.is_empty() { value != "no" } else { is_one_of(value, values) })
    };
    table.iter().find(fits).map(|(_, _, class)| *class)
}

fn sidewalks<'t>(tag: &impl Fn(&str) -> Option<&'t str>) -> Sidewalks {
    let side = |key: &str| tag(key).map(|value| value == "yes");
    let [both, left, right] = ["sidewalk:both", "sidewalk:left", "sidewalk:right"].map(side);
    match (tag("sidewalk"), left.or(both), right.or(both)) {
        (Some("both" | "yes"), ..) | (None, Some(true), Some(true)) => Sidewalks::Both,
        (Some("left"), ..) | (None, Some(true), _) => Sidewalks::Left,
        (Some("right"), ..) | (None, _, Some(true)) => Sidewalks::Right,
        (Some("no" | "none"), ..) | (None, Some(false), Some(false)) => Sidewalks::None,
        _ if is_rural(tag) => Sidewalks::None,
        _ => Sidewalks::Usual,
    }
}

fn is_rural<'t>(tag: &impl Fn(&str) -> Option<&'t str>) -> bool {
    let is_named = |key: &str| tag(key).is_some_and(|value| value.ends_with("rural"));
    let kmh = tag("maxspeed").and_then(|value| match value.strip_suffix("mph") {
        Some(miles) => miles.trim().parse::<f64>().ok().map(|miles| miles * 1.609),
        None => value.trim().parse().ok(),
    });
    kmh.is_some_and(|kmh| kmh > MAX_TOWN_KMH)
        || ["maxspeed", "maxspeed:type", "source:maxspeed", "zone:traffic"].into_iter().any(is_named)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn value<'t>(tags: &'t [(&str, &str)]) -> impl Fn(&str) -> Option<&'t str> {
        |key| tags.iter().find(|(known, _)| *known == key).map(|(_, value)| *value)
    }

    #[test]
    fn areas_are_what_is_to_be_seen() {
        let class = |tags: &[(&str, &str)]| area_look(value(tags)).map(|look| look.class);
        assert_eq!(class(&[("landuse", "basin"), ("leisure", "park")]), Some(A::Water));
        assert_eq!(class(&[("leisure", "park"), ("natural", "wood")]), Some(A::Forest));
        assert_eq!(class(&[("landuse", "residential"), ("amenity", "parking")]), Some(A::Parking));
        assert_eq!(class(&[("area:highway", "footway")]), Some(A::Pavement));
        assert_eq!(class(&[("area:highway", "primary")]), Some(A::Carriageway));
        assert_eq!(class(&[("water", "no")]), None);
        assert_eq!(class(&[("leisure", "marina")]), None);
        assert_eq!(class(&[]), None);
        let look = area_look(value(&[("leisure", "pitch"), ("sport", "tennis")]));
        assert_eq!(look, Some(AreaLook { class: A::Pitch, surfacing: Some(Surfacing::Clay) }));
    }

    #[test]
    fn lines_have_lanes_and_directions() {
        let look = |tags: &[(&str, &str)]| line_look(value(tags)).unwrap();
        let motorway = look(&[("highway", "motorway_link"), ("lanes", "2;3")]);
        assert_eq!((motorway.class, motorway.lanes, motorway.is_one_way), (L::Motorway, Some(2), true));
        let road = look(&[("highway", "primary"), ("oneway", "no"), ("lanes", "many"), ("surface", "sett")]);
        assert_eq!((road.lanes, road.is_one_way, road.surfacing), (None, false, Some(Surfacing::Setts)));
        assert_eq!(look(&[("railway", "rail"), ("tracks", "2"), ("lanes", "7")]).lanes, Some(2));
        assert!(look(&[("highway", "residential"), ("junction", "roundabout")]).is_one_way);
        assert_eq!(line_look(value(&[("highway", "proposed")])), None);
    }

    #[test]
    fn pavements_are_where_tags_say() {
        let sides = |tags: &[(&str, &str)]| sidewalks(&value(tags));
        assert_eq!(sides(&[]), Sidewalks::Usual);
        assert_eq!(sides(&[("sidewalk", "separate")]), Sidewalks::Usual);
        assert_eq!(sides(&[("sidewalk", "left")]), Sidewalks::Left);
        assert_eq!(sides(&[("sidewalk:both", "yes")]), Sidewalks::Both);
        assert_eq!(sides(&[("sidewalk:both", "no")]), Sidewalks::None);
        assert_eq!(sides(&[("sidewalk:right", "yes"), ("sidewalk:left", "no")]), Sidewalks::Right);
        assert_eq!(sides(&[("maxspeed", "50")]), Sidewalks::Usual);
        assert_eq!(sides(&[("maxspeed", "100")]), Sidewalks::None);
        assert_eq!(sides(&[("maxspeed", "40 mph")]), Sidewalks::None);
        assert_eq!(sides(&[("maxspeed", "100"), ("sidewalk", "both")]), Sidewalks::Both);
        assert_eq!(sides(&[("source:maxspeed", "DE:rural")]), Sidewalks::None);
        assert!(is_zebra(value(&[("footway", "crossing"), ("crossing:markings", "zebra:paired")])));
        assert!(!is_zebra(value(&[("footway", "crossing"), ("crossing", "traffic_signals")])));
    }
}
