//! What a feature is, by its attributes and its layer.

use super::geometry::Geometry;
use super::layer::{Columns, Layer, OSM_KEYS, TreeColumns};
use crate::osm::{NOT_BUILT, kind_by_tags};
use insula_dress::footprint::{HeightHints, has_height, kind_of, known_height_m};
use insula_source::attributes::{AttributeValue, Attributes};
use insula_source::object::FeatureKind;
use insula_source::problems::{KIND_AGAINST_NAME, KIND_BY_NAME, NO_SEA, TREES_BY_COLUMN};

/// Why a feature of OpenStreetMap is left out that is in none of the kinds of a city, as in its own files.
pub(super) const NO_OBJECT: &str = "no object of a city by its tags";

/// Keys of OpenStreetMap that other tables may have, too.
const COMMON_KEYS: [&str; 4] = ["historic", "place", "power", "public_transport"];

/// The kind of a feature; `None` if nothing tells it. Fails with the reason for leaving it out.
pub(super) fn told(
    id: &str,
    attributes: &Attributes,
    geometry: &Geometry,
    layer: &Layer,
    columns: Columns,
    hints: HeightHints<'_>,
) -> Result<Option<FeatureKind>, &'static str> {
    let is_area = !geometry.polygons.is_empty() || !geometry.meshes.is_empty();
    let plain = kind_of(attributes);
    if !is_area && geometry.lines.is_empty() {
        // Points in the file of a park need be no trees.
        let by_layer = layer.kind.filter(|kind| *kind != FeatureKind::Vegetation || layer.is_of_trees);
        let by_columns = (columns.trees != TreeColumns::Missing).then_some(FeatureKind::Vegetation);
        return Ok(plain.or(by_layer).or(by_columns));
    }
    if is_coastline(attributes) {
        return Err(NO_SEA);
    }
    let by_tags = kind_by_tags(attributes, is_area);
    if by_tags == Some(Err(NOT_BUILT)) {
        return Err(NOT_BUILT);
    }
    if matches!(layer.kind, Some(FeatureKind::Building | FeatureKind::BuildingPart)) {
        return Ok(plain.or(layer.kind));
    }
    let has_height = has_height(attributes, hints);
    // The name may be that of a street, as `park_avenue`. A plan with a height is a building, but for trees and bridges.
    let is_plan = is_area && geometry.meshes.is_empty() && !geometry.is_surface;
    let is_told = || known_height_m(attributes, hints, |_, _| ()).is_some();
    let is_standing = is_plan && !layer.is_of_trees && !columns.is_mixed && is_told();
    let has_body = |kind: &FeatureKind| matches!(kind, FeatureKind::Bridge | FeatureKind::Tunnel);
    let by_layer = layer.kind.filter(|kind| !is_standing || has_body(kind));
    let has_id = has_osm_id(id, attributes);
    if !has_id && !columns.is_of_osm && attributes.iter().filter(|(name, _)| is_osm_key(name)).count() < 2 {
        // What else has a height is a building, and the tag says what it is for.
        let by_tags = by_tags.and_then(Result::ok).filter(|_| !has_height);
        return Ok(plain.or(by_tags).or(by_layer));
    }
    match by_tags {
        Some(Ok(kind)) => Ok(Some(kind)),
        // What hides a plan does not hide a body.
        Some(Err(reason)) => plain.map(Some).ok_or(reason),
        None if attributes.iter().any(|(name, _)| tells_another(name)) => match has_height && !has_id {
            true => Ok(plain.or(by_layer)),
            false => Err(NO_OBJECT),
        },
        // Made of OpenStreetMap, without its tags.
        None if layer.kind.is_some() || has_height => Ok(by_layer),
        None => Err(NO_OBJECT),
    }
}

/// The problem of a kind that rests on the name of the layer or of a column alone, or goes against it.
pub(super) fn guess(
    kind: Option<FeatureKind>,
    attributes: &Attributes,
    geometry: &Geometry,
    layer: &Layer,
    columns: Columns,
) -> Option<&'static str> {
    if geometry.polygons.is_empty() && geometry.meshes.is_empty() {
        let is_by_columns = kind == Some(FeatureKind::Vegetation) && geometry.lines.is_empty() && !layer.is_of_trees;
        let is_guess = is_by_columns && columns.trees == TreeColumns::Species && kind_of(attributes).is_none();
        return is_guess.then_some(TREES_BY_COLUMN);
    }
    let by_layer = layer.kind.filter(|kind| !matches!(kind, FeatureKind::Building | FeatureKind::BuildingPart))?;
    match kind {
        None => Some(KIND_AGAINST_NAME),
        Some(kind) if kind != by_layer || kind_of(attributes) == Some(kind) => None,
        Some(kind) => (kind_by_tags(attributes, true) != Some(Ok(kind))).then_some(KIND_BY_NAME),
    }
}

/// Whether a line, or the area within a closed one, is a coast, whose water lies on its right.
fn is_coastline(attributes: &Attributes) -> bool {
    let is_coast = |name: &str| attributes.named(name).and_then(AttributeValue::as_str) == Some("coastline");
    ["natural", "fclass"].into_iter().any(is_coast)
}

fn is_osm_key(name: &str) -> bool {
    OSM_KEYS.iter().any(|key| key.eq_ignore_ascii_case(name))
}

/// Whether an attribute is a tag of what is no building, or no longer one, as `demolished:building`.
fn tells_another(name: &str) -> bool {
    let is_common = COMMON_KEYS.iter().any(|key| key.eq_ignore_ascii_case(name));
    is_osm_key(name) && !name.eq_ignore_ascii_case("building") || is_common || name.ends_with(":building")
}

/// Whether a feature has the identifier of an element of OpenStreetMap, as its programs write it.
fn has_osm_id(id: &str, attributes: &Attributes) -> bool {
    let is_number = |text: &str| text.parse::<i64>().is_ok();
    let is_element =
        |text: &str| ["way/", "relation/"].iter().any(|kind| text.strip_prefix(kind).is_some_and(is_number));
    let is_short = |text: &str| text.strip_prefix(['w', 'r', 'a']).is_some_and(is_number);
    let text = |name: &str| attributes.named(name).and_then(AttributeValue::as_str).map(str::trim);
    let is_given = |name: &str| attributes.named(name).is_some_and(|value| !value.to_string().trim().is_empty());
    is_element(id)
        || ["@id", "full_id"].into_iter().filter_map(text).any(|text| is_element(text) || is_short(text))
        || ["osm_id", "osm_way_id"].into_iter().any(is_given)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What an area or a line is.
    fn kind(id: &str, pairs: &[(&str, &str)], layer: &str, is_area: bool) -> Result<Option<FeatureKind>, &'static str> {
        let mut attributes = Attributes::default();
        pairs.iter().for_each(|(name, value)| attributes.push(name, AttributeValue::from_untyped(value)));
        let ring = vec![[0.0; 3]; 4];
        let geometry = match is_area {
            true => Geometry { polygons: vec![vec![ring]], ..Geometry::default() },
            false => Geometry { lines: vec![ring], ..Geometry::default() },
        };
        let layer = Layer::new(layer, pairs.iter().map(|(name, _)| *name));
        told(id, &attributes, &geometry, &layer, layer.columns, HeightHints::default())
    }

    #[test]
    fn areas_of_openstreetmap_are_what_they_are_in_its_own_files() {
        use FeatureKind::{Building, LandUse, Road, Vegetation, Water};
        let way = ("@id", "way/7");
        for (pairs, expected) in [
            (&[way, ("building", "yes")][..], Ok(Some(Building))),
            (&[way, ("building", "yes"), ("landuse", "retail")], Ok(Some(Building))),
            (&[way, ("boundary", "administrative")], Err(NO_OBJECT)),
            (&[way, ("man_made", "pier")], Ok(Some(Road))),
            (&[way, ("place", "square")], Err(NO_OBJECT)),
            (&[way, ("aeroway", "apron")], Ok(Some(Road))),
            (&[way, ("amenity", "school"), ("height", "9")], Ok(Some(LandUse))),
            (&[way, ("tourism", "zoo")], Err(NO_OBJECT)),
            (&[way, ("barrier", "fence"), ("height", "2")], Err(NO_OBJECT)),
            (&[way, ("demolished:building", "yes"), ("height", "9")], Err(NO_OBJECT)),
            (&[way, ("building", "proposed")], Err(NOT_BUILT)),
            (&[way, ("name", "x")], Err(NO_OBJECT)),
            (&[way, ("height", "9")], Ok(None)),
            (&[("full_id", "w7"), ("power", "substation")], Err(NO_OBJECT)),
            (&[("osm_way_id", "7"), ("leisure", "park")], Ok(Some(Vegetation))),
            (&[("OSM_ID", "7"), ("code", "7201"), ("FCLASS", "forest")], Ok(Some(Vegetation))),
            (&[("osm_id", "7"), ("fclass", "bus_station")], Err(NO_OBJECT)),
            (&[("boundary", "administrative"), ("admin_level", "8")], Err(NO_OBJECT)),
            (&[("natural", "water"), ("place", "islet")], Ok(Some(Water))),
        ] {
            assert_eq!(kind("7", pairs, "export", true), expected, "{pairs:?}");
        }
        assert_eq!(kind("way/7", &[("tourism", "zoo")], "export", true), Err(NO_OBJECT));
        assert_eq!(kind("7", &[way, ("highway", "proposed")], "export", false), Err(NO_OBJECT));
        assert_eq!(kind("7", &[("osm_id", "7"), ("fclass", "track_grade1")], "gis_osm_roads", false), Ok(Some(Road)));
    }

    #[test]
    fn other_tables_have_buildings_without_tags() {
        use FeatureKind::{Building, LandUse, Water};
        for (pairs, layer, expected) in [
            (&[("height", "9")][..], "a", Ok(None)),
            (&[("name", "x")], "a", Ok(None)),
            (&[("amenity", "school"), ("height", "9")], "a", Ok(None)),
            (&[("amenity", "school")], "a", Ok(Some(LandUse))),
            (&[("BUILDING", "demolished")], "a", Err(NOT_BUILT)),
            (&[("landuse", "R2"), ("place", "Ulm"), ("height", "9")], "a", Ok(None)),
            (&[("osm_id", "7"), ("name", "x")], "buildings", Ok(Some(Building))),
            (&[("osm_id", "7"), ("amenity", "school")], "buildings", Ok(Some(Building))),
            (&[("osm_id", "7"), ("fclass", "river")], "gis_osm_water_a_free_1", Ok(Some(Water))),
        ] {
            assert_eq!(kind("7", pairs, layer, true), expected, "{pairs:?}");
        }
    }

    #[test]
    fn names_of_layers_do_not_lay_flat_what_has_a_height() {
        use FeatureKind::{LandUse, Vegetation, Water};
        for (pairs, layer, expected) in [
            (&[("height", "20")][..], "park_avenue", Ok(None)),
            (&[("height", "20")], "lots", Ok(None)),
            (&[("height", "0")], "lots", Ok(Some(LandUse))),
            (&[("name", "x")], "lots", Ok(Some(LandUse))),
            (&[("natural", "water")], "park", Ok(Some(Water))),
            (&[("height", "20")], "street_trees", Ok(Some(Vegetation))),
        ] {
            assert_eq!(kind("7", pairs, layer, true), expected, "{pairs:?} {layer}");
        }
        let point = Geometry { points: vec![[0.0; 3]], ..Geometry::default() };
        for (name, expected) in
            [("park", None), ("parks_and_trees", Some(Vegetation)), ("pois", Some(FeatureKind::Generic))]
        {
            let layer = Layer::new(name, std::iter::empty());
            let attributes = Attributes::default();
            let kind = told("7", &attributes, &point, &layer, layer.columns, HeightHints::default());
            assert_eq!(kind, Ok(expected), "{name}");
        }
    }
}
