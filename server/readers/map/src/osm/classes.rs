//! Which elements of OpenStreetMap are objects of a city: classes of tags with their kinds, forms and usual widths.

use super::element::Tags;
use FeatureKind::{Bridge, Building, BuildingPart, Generic, LandUse, Rail, Road, Vegetation, Water};
use insula_dress::footprint::{
    AEROWAY_WIDTHS_M, HIGHWAY_WIDTHS_M, LANE_M, RAILWAY_WIDTHS_M, WATERWAY_WIDTHS_M, hidden, length_m,
};
use insula_source::object::FeatureKind;
use insula_source::text::{first_value, is_one_of, split_words, values_of};
use std::borrow::Cow;

/// What an element's geometry is to be.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Form {
    Area,
    Line {
        width_m: f64,
    },
    /// Trees along a line.
    TreeRow,
}

/// What an element is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Class {
    pub(super) kind: FeatureKind,
    /// The key whose value tells it.
    pub(super) key: &'static str,
    pub(super) form: Form,
}

/// The class of an element.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Verdict {
    /// No object of a city.
    Other,
    /// An object that is left out, with the reason.
    LeftOut(&'static str),
    Object(Class),
}

/// What the element is made of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Outline {
    OpenWay,
    ClosedWay,
    Multipolygon,
}

pub(super) const NOT_CLOSED: &str = "ring is not closed";
/// Reasons for leaving out what stands upright and has no plan.
pub(super) const THIN_WALL: &str = "wall that is mapped as a line, not drawn";
pub(super) const POINT_STRUCTURE: &str = "structure that is mapped as a point, not drawn";
pub(crate) const NOT_BUILT: &str = "not built, or gone";

/// Values of `building` of what does not stand.
const GONE: &[&str] = &["proposed", "planned", "demolished", "razed", "destroyed", "removed", "collapsed"];

/// Values of `man_made` and `barrier` that are drawn as blocks if they have a height.
const STRUCTURES: &[&str] =
    &["tower", "communications_tower", "water_tower", "storage_tank", "silo", "gasometer", "chimney", "obelisk"];
const WALLS: &[&str] = &["wall", "city_wall", "retaining_wall"];

/// Roads and paths on which `lanes` counts.
const WITHOUT_LANES: &[&str] = &["footway", "cycleway", "bridleway", "path", "steps", "track", "via_ferrata"];

/// Distance of neighbouring tracks, for `tracks`.
const TRACK_DISTANCE_M: f64 = 4.0;

/// Widths of what people walk on but is no path.
const PLATFORM_WIDTHS_M: &[(&str, f64)] = &[("platform", 3.0)];
const PIER_WIDTHS_M: &[(&str, f64)] = &[("pier", 3.0), ("breakwater", 6.0)];
const HEDGE_WIDTHS_M: &[(&str, f64)] = &[("hedge", 0.9)];

/// Areas by a key and its values; without values, all but `no`. The first that fits counts.
const AREAS: &[(&str, &[&str], FeatureKind)] = &[
    ("man_made", &["bridge"], Bridge),
    ("area:highway", &[], Road),
    // A roof without walls.
    ("amenity", &["shelter"], Building),
    ("natural", &["water", "bay", "strait"], Water),
    ("waterway", &["riverbank", "dock"], Water),
    ("seamark:type", &["harbour_basin", "lock_basin", "dock"], Water),
    ("landuse", &["reservoir", "basin"], Water),
    // Unless there is a coast, see `is_harbour`.
    ("leisure", &["swimming_pool", "marina"], Water),
    ("amenity", &["fountain"], Water),
    ("water", &[], Water),
    ("natural", &["wood", "scrub", "heath", "grassland", "fell", "tundra", "wetland", "shrubbery", "moor"], Vegetation),
    (
        "landuse",
        &split_words::<11>(
            "forest grass meadow orchard vineyard village_green allotments recreation_ground flowerbed plant_nursery \
            greenery",
        ),
        Vegetation,
    ),
    ("leisure", &["park", "garden", "golf_course", "dog_park", "common"], Vegetation),
    ("golf", &["fairway", "green", "rough", "tee"], Vegetation),
    ("natural", &["sand", "beach", "shingle", "scree", "bare_rock", "glacier", "mud", "blockfield"], LandUse),
    ("leisure", &["pitch", "playground", "track", "stadium", "sports_centre"], LandUse),
    ("amenity", &["parking", "bicycle_parking", "motorcycle_parking"], Road),
    ("highway", &["rest_area", "services"], LandUse),
    ("aeroway", &["apron", "helipad"], Road),
    ("aeroway", &["aerodrome"], LandUse),
    (
        "landuse",
        &split_words::<22>(
            "residential commercial retail industrial farmland farmyard farm greenhouse_horticulture cemetery \
            religious education institutional garages railway quarry landfill brownfield greenfield construction \
            depot port salt_pond",
        ),
        LandUse,
    ),
    ("amenity", &["grave_yard", "school", "kindergarten", "university", "college", "hospital"], LandUse),
    // The last rules: a harbour with a tag of land is land, see also `is_quay`. In a map with a coastline, the coastline decides.
    ("harbour", &[], Water),
    ("landuse", &["harbour"], Water),
];

/// The class of a way or a multipolygon.
pub(super) fn classify(tags: Tags<'_>, outline: Outline) -> Verdict {
    if tags.is_empty() {
        return Verdict::Other;
    }
    for (key, kind) in [("building", Building), ("building:part", BuildingPart)] {
        if let Some(value) = value(tags, key) {
            return building(tags, key, value, kind, outline);
        }
    }
    let has_surface = outline == Outline::Multipolygon
        || outline == Outline::ClosedWay && matches!(tags.get("area"), Some("yes" | "true" | "1"));
    for (key, widths, kind) in [
        ("highway", HIGHWAY_WIDTHS_M, Road),
        ("railway", RAILWAY_WIDTHS_M, Rail),
        ("aeroway", AEROWAY_WIDTHS_M, Road),
        ("waterway", WATERWAY_WIDTHS_M, Water),
        ("railway", PLATFORM_WIDTHS_M, Road),
        ("highway", PLATFORM_WIDTHS_M, Road),
        ("public_transport", PLATFORM_WIDTHS_M, Road),
        ("man_made", PIER_WIDTHS_M, Road),
        ("barrier", HEDGE_WIDTHS_M, Vegetation),
    ] {
        let of_value = value(tags, key)
            .and_then(|text| values_of(text).find_map(|value| widths.iter().find(|(known, _)| *known == value)));
        let Some((value, usual_m)) = of_value else { continue };
        if let Some(reason) = reason_to_hide(tags, kind) {
            return Verdict::LeftOut(reason);
        }
        // These are areas when they are closed, the others only if they say so.
        let is_stage = matches!(*value, "platform" | "pier" | "breakwater") && outline == Outline::ClosedWay;
        let form = if has_surface || is_stage && tags.get("area") != Some("no") {
            Form::Area
        } else {
            Form::Line { width_m: width_m(tags, key, value, *usual_m) }
        };
        return Verdict::Object(Class { kind, key, form });
    }
    if outline != Outline::Multipolygon && tags.get("natural") == Some("tree_row") {
        return Verdict::Object(Class { kind: Vegetation, key: "natural", form: Form::TreeRow });
    }
    structure(tags, outline, has_surface).unwrap_or_else(|| area(tags, outline))
}

/// The class of what stands upright and is no building; `None` without a height, or if nothing tells it.
fn structure(tags: Tags<'_>, outline: Outline, has_surface: bool) -> Option<Verdict> {
    value(tags, "height")?;
    let is_any_of = |key: &str, known: &[&str]| value(tags, key).is_some_and(|value| is_one_of(value, known));
    let is_wall = is_any_of("barrier", WALLS);
    if !is_wall && !is_any_of("man_made", STRUCTURES) {
        return None;
    }
    let key = if is_wall { "barrier" } else { "man_made" };
    Some(match reason_to_hide(tags, Generic) {
        Some(reason) => Verdict::LeftOut(reason),
        None if is_wall && !has_surface => Verdict::LeftOut(THIN_WALL),
        None if outline == Outline::OpenWay => Verdict::LeftOut(NOT_CLOSED),
        None => Verdict::Object(Class { kind: Generic, key, form: Form::Area }),
    })
}

/// Whether a node is a structure that would be drawn if it had a plan.
pub(super) fn is_point_structure(tags: Tags<'_>) -> bool {
    matches!(structure(tags, Outline::Multipolygon, true), Some(Verdict::Object(_)))
}

/// The value of `natural` of a node that is a single plant; `None` if it is none.
pub(super) fn plant(tags: Tags<'_>) -> Option<&str> {
    tags.get("natural").filter(|value| matches!(*value, "tree" | "shrub"))
}

/// Whether an area is a harbour or marina, of which nothing else says that it is water. Where there is a coast, that tells which part
/// of it is.
pub(super) fn is_harbour(class: Class, tags: Tags<'_>) -> bool {
    let is_told = match class.key {
        "leisure" => tags.get("leisure") == Some("marina"),
        "landuse" => tags.get("landuse") == Some("harbour"),
        key => key == "harbour",
    };
    is_told && class.kind == Water
}

/// Whether an area with a tag of harbours is their land: it has a pavement or an industry.
fn is_quay(tags: Tags<'_>, key: &str) -> bool {
    let is_harbour = key == "harbour" || key == "landuse" && tags.get("landuse") == Some("harbour");
    // In tables, a number is the area.
    let is_paved = value(tags, "surface").is_some_and(|surface| surface.starts_with(char::is_alphabetic));
    is_harbour && (is_paved || value(tags, "industrial").is_some())
}

/// Whether tags say nothing of what an element is, so that they may be on the outer ring, as in maps before 2017.
pub(super) fn tell_nothing(tags: Tags<'_>) -> bool {
    const ABOUT_THE_RELATION: &[&[u8]] =
        &[b"type", b"source", b"note", b"fixme", b"created_by", b"attribution", b"comment"];
    tags.iter().all(|(key, _)| ABOUT_THE_RELATION.contains(&key.to_ascii_lowercase().as_slice()))
}

fn building(tags: Tags<'_>, key: &'static str, value: &str, kind: FeatureKind, outline: Outline) -> Verdict {
    if GONE.contains(&value) {
        Verdict::LeftOut(NOT_BUILT)
    } else if let Some(reason) = reason_to_hide(tags, kind) {
        Verdict::LeftOut(reason)
    } else if outline == Outline::OpenWay {
        Verdict::LeftOut(NOT_CLOSED)
    } else {
        Verdict::Object(Class { kind, key, form: Form::Area })
    }
}

fn area(tags: Tags<'_>, outline: Outline) -> Verdict {
    let found = AREAS
        .iter()
        .find(|(key, values, _)| value(tags, key).is_some_and(|value| values.is_empty() || is_one_of(value, values)));
    let Some(&(key, _, kind)) = found else { return Verdict::Other };
    let kind = if is_quay(tags, key) { LandUse } else { kind };
    let is_line = tags.get("area") == Some("no") || key == "leisure" && tags.get("leisure") == Some("track");
    match outline {
        Outline::OpenWay if is_line => Verdict::Other,
        Outline::ClosedWay if tags.get("area") == Some("no") => Verdict::Other,
        Outline::OpenWay => Verdict::LeftOut(NOT_CLOSED),
        _ => match reason_to_hide(tags, kind) {
            Some(reason) => Verdict::LeftOut(reason),
            None => Verdict::Object(Class { kind, key, form: Form::Area }),
        },
    }
}

/// The value of a key, unless it is `no`.
fn value<'a>(tags: Tags<'a>, key: &str) -> Option<&'a str> {
    tags.get(key).filter(|value| *value != "no" && !value.is_empty())
}

/// The reason why an element cannot be seen from above; `None` if it can.
fn reason_to_hide(tags: Tags<'_>, kind: FeatureKind) -> Option<&'static str> {
    hidden(kind, |key| tags.get(key).map(Cow::Borrowed))
}

/// Width of a line in metres: the measured one, that of its lanes or tracks, or the usual one of its class.
fn width_m(tags: Tags<'_>, key: &str, value: &str, usual_m: f64) -> f64 {
    let measured = ["width", "est_width", "width:carriageway"].iter().find_map(|name| length_m(tags.get(name)?));
    if let Some(width_m) = measured.filter(|width_m| (0.3..=1000.0).contains(width_m)) {
        return width_m;
    }
    let count = |name: &str| {
        let count: f64 = first_value(tags.get(name)?).parse().ok()?;
        (1.0..=16.0).contains(&count).then_some(count)
    };
    match key {
        "highway" if !WITHOUT_LANES.contains(&value) => count("lanes").map_or(usual_m, |lanes| lanes * LANE_M),
        "railway" => usual_m + count("tracks").map_or(0.0, |tracks| (tracks - 1.0) * TRACK_DISTANCE_M),
        _ => usual_m,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_dress::footprint::{IN_TUNNEL, INDOORS, UNDERGROUND};

    fn verdict(tags: &[(&str, &str)], outline: Outline) -> Verdict {
        let (mut text, mut spans) = (Vec::new(), Vec::new());
        for (key, value) in tags {
            let start = text.len() as u32;
            text.extend_from_slice(key.as_bytes());
            let middle = text.len() as u32;
            text.extend_from_slice(value.as_bytes());
            spans.push([start, middle, middle, text.len() as u32]);
        }
        classify(Tags { text: &text, spans: &spans }, outline)
    }

    fn class(tags: &[(&str, &str)], outline: Outline) -> (FeatureKind, Form) {
        match verdict(tags, outline) {
            Verdict::Object(class) => (class.kind, class.form),
            verdict => panic!("{tags:?}: {verdict:?}"),
        }
    }

    #[test]
    fn kinds_are_told_by_the_most_telling_tag() {
        use Outline::{ClosedWay, Multipolygon};
        for (tags, outline, kind) in [
            (&[("building", "yes"), ("landuse", "retail")][..], ClosedWay, Building),
            (&[("building", "yes"), ("building:part", "yes")], ClosedWay, Building),
            (&[("building", "no"), ("building:part", "tower")], ClosedWay, BuildingPart),
            (&[("landuse", "basin"), ("natural", "water")], Multipolygon, Water),
            (&[("harbour", "yes")], ClosedWay, Water),
            (&[("harbour", "yes"), ("landuse", "harbour")], ClosedWay, Water),
            (&[("landuse", "harbour")], Multipolygon, Water),
            (&[("seamark:type", "harbour_basin")], ClosedWay, Water),
            (&[("landuse", "harbour"), ("surface", "concrete")], ClosedWay, LandUse),
            (&[("harbour", "yes"), ("landuse", "industrial")], ClosedWay, LandUse),
            (&[("landuse", "port")], ClosedWay, LandUse),
            (&[("landuse", "grass")], ClosedWay, Vegetation),
            (&[("landuse", "unknown;grass")], ClosedWay, Vegetation),
            (&[("natural", "water;wetland")], Multipolygon, Water),
            (&[("leisure", "pitch")], ClosedWay, LandUse),
            (&[("highway", "pedestrian"), ("area", "yes")], ClosedWay, Road),
            (&[("area:highway", "primary")], ClosedWay, Road),
            (&[("amenity", "shelter")], ClosedWay, Building),
            (&[("highway", "pedestrian")], Multipolygon, Road),
            (&[("man_made", "bridge"), ("layer", "1")], ClosedWay, Bridge),
            (&[("man_made", "silo"), ("height", "20")], ClosedWay, Generic),
            (&[("man_made", "silo"), ("building", "silo"), ("height", "20")], ClosedWay, Building),
            (&[("barrier", "city_wall"), ("area", "yes"), ("height", "9")], ClosedWay, Generic),
        ] {
            assert_eq!(class(tags, outline), (kind, Form::Area), "{tags:?}");
        }
        assert_eq!(class(&[("natural", "tree_row")], Outline::OpenWay), (Vegetation, Form::TreeRow));
        for tags in [
            &[][..],
            &[("barrier", "wall")],
            &[("building", "no")],
            &[("natural", "coastline")],
            &[("highway", "proposed")],
        ] {
            assert_eq!(verdict(tags, ClosedWay), Verdict::Other, "{tags:?}");
        }
    }

    #[test]
    fn lines_have_the_width_that_their_tags_tell() {
        let width = |tags: &[(&str, &str)]| match class(tags, Outline::OpenWay).1 {
            Form::Line { width_m } => width_m,
            form => panic!("{tags:?}: {form:?}"),
        };
        assert_eq!(width(&[("highway", "residential")]), 5.5);
        assert_eq!(width(&[("highway", "primary"), ("lanes", "4")]), 12.0);
        assert_eq!(width(&[("highway", "primary"), ("lanes", "4"), ("width", "11,5 m")]), 11.5);
        assert_eq!(width(&[("highway", "primary"), ("lanes", "1e9"), ("width", "nan")]), 7.0);
        assert_eq!(width(&[("highway", "footway"), ("lanes", "4")]), 2.0);
        assert_eq!(width(&[("railway", "tram"), ("tracks", "2")]), 6.6);
        assert_eq!(width(&[("waterway", "river")]), 15.0);
        // Of several values the first that is known.
        assert_eq!(width(&[("highway", "footway;cycleway")]), 2.0);
        assert_eq!(width(&[("highway", "primary"), ("lanes", "4;3")]), 12.0);
        // A roundabout is a line.
        assert_eq!(class(&[("highway", "residential")], Outline::ClosedWay), (Road, Form::Line { width_m: 5.5 }));
    }

    #[test]
    fn what_cannot_be_seen_is_left_out() {
        for (tags, reason) in [
            (&[("building", "yes"), ("layer", "-1")][..], UNDERGROUND),
            (&[("building", "yes"), ("location", "underground")], UNDERGROUND),
            (&[("building", "train_station"), ("tunnel", "yes")], IN_TUNNEL),
            (&[("building:part", "yes"), ("level", "-1")], UNDERGROUND),
            (&[("railway", "platform"), ("layer", "-2")], UNDERGROUND),
            (&[("building", "demolished")], NOT_BUILT),
            (&[("highway", "primary"), ("tunnel", "yes")], IN_TUNNEL),
            (&[("waterway", "stream"), ("tunnel", "culvert")], IN_TUNNEL),
            (&[("highway", "footway"), ("indoor", "yes")], INDOORS),
            (&[("railway", "subway"), ("layer", "-2")], UNDERGROUND),
            (&[("amenity", "parking"), ("parking", "underground")], UNDERGROUND),
        ] {
            assert_eq!(verdict(tags, Outline::ClosedWay), Verdict::LeftOut(reason), "{tags:?}");
        }
        assert_eq!(verdict(&[("building", "yes")], Outline::OpenWay), Verdict::LeftOut(NOT_CLOSED));
        let wall = [("barrier", "wall"), ("height", "2")];
        assert_eq!(verdict(&wall, Outline::ClosedWay), Verdict::LeftOut(THIN_WALL));
        assert_eq!(class(&[("highway", "service"), ("tunnel", "building_passage")], Outline::OpenWay).0, Road);
        assert_eq!(class(&[("highway", "primary"), ("layer", "-1")], Outline::OpenWay).0, Road);
    }
}
