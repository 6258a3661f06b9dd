//! What features of GIS formats are whose attributes are tags of OpenStreetMap: the same as in its own files.

use super::classes::{Outline, Verdict, classify};
use super::element::Tags;
use insula_source::attributes::{AttributeValue, Attributes};
use insula_source::object::FeatureKind;
use insula_source::text::split_words;

/// Keys that count whatever their value is. In capitals they may mean anything else, such as the supply of water.
const ONLY_AS_SPELT: &[&str] = &["water", "harbour", "area:highway"];
/// Keys with the values that Geofabrik's Shapefiles have as `fclass` of areas. Others are those of several keys, or of none.
const AREA_CLASSES: &[(&str, &[&str])] = &[
    ("building", &["building"]),
    ("natural", &["water", "wetland", "glacier", "beach", "scrub", "heath"]),
    ("waterway", &["riverbank", "dock"]),
    (
        "leisure",
        &split_words::<9>("park pitch playground golf_course dog_park stadium sports_centre swimming_pool marina"),
    ),
    ("man_made", &["pier"]),
    ("amenity", &["parking", "school", "kindergarten", "university", "college", "hospital"]),
    ("aeroway", &["apron", "helipad"]),
    (
        "landuse",
        &split_words::<16>(
            "reservoir forest grass meadow orchard vineyard allotments recreation_ground residential industrial \
            commercial retail farmland farmyard cemetery quarry",
        ),
    ),
];
/// Keys of lines. No two of them have a common value.
const LINE_KEYS: &[&str] = &["highway", "railway", "waterway", "aeroway"];

/// The kind of an area or a line by its tags, or the reason for leaving it out; `None` if it is no object of a city.
pub(crate) fn kind_by_tags(attributes: &Attributes, is_area: bool) -> Option<Result<FeatureKind, &'static str>> {
    let mut tags = TagText::default();
    for (name, value) in attributes.iter() {
        let key = name.to_ascii_lowercase();
        if key == name || !ONLY_AS_SPELT.contains(&&*key) {
            tags.push(if key == "building_part" { "building:part" } else { &key }, value);
        }
    }
    if let Some(class) = attributes.named("fclass") {
        let is_known = |values: &[&str]| class.as_str().is_some_and(|class| values.contains(&class));
        let of_area = AREA_CLASSES.iter().filter(|(_, values)| is_area && is_known(values)).map(|(key, _)| *key);
        of_area.chain(LINE_KEYS.iter().copied().filter(|_| !is_area)).for_each(|key| tags.push(key, class));
    }
    let outline = if is_area { Outline::Multipolygon } else { Outline::OpenWay };
    match classify(Tags { text: &tags.text, spans: &tags.spans }, outline) {
        Verdict::Object(class) => Some(Ok(class.kind)),
        Verdict::LeftOut(reason) => Some(Err(reason)),
        Verdict::Other => None,
    }
}

/// Tags in the form of a file's.
#[derive(Default)]
struct TagText {
    text: Vec<u8>,
    spans: Vec<[u32; 4]>,
}

impl TagText {
    /// Adds a tag, unless its value says that there is nothing.
    fn push(&mut self, key: &str, value: &AttributeValue) {
        let value = value.to_string().trim().to_lowercase();
        if matches!(value.as_str(), "" | "no" | "n" | "f" | "false" | "0" | "none" | "null") {
            return;
        }
        let mut part = |text: &str| {
            let start = self.text.len() as u32;
            self.text.extend_from_slice(text.as_bytes());
            [start, self.text.len() as u32]
        };
        let ([a, b], [c, d]) = (part(key), part(&value));
        self.spans.push([a, b, c, d]);
    }
}

#[cfg(test)]
mod tests {
    use super::super::classes::NOT_BUILT;
    use super::*;

    #[test]
    fn tags_of_any_table_are_those_of_a_map() {
        use FeatureKind::{Building, BuildingPart, LandUse, Road, Vegetation, Water};
        let kind = |key: &str, value: &str, is_area| {
            let mut attributes = Attributes::default();
            attributes.push(key, AttributeValue::from_untyped(value));
            kind_by_tags(&attributes, is_area)
        };
        for (key, value, expected) in [
            ("building", "yes", Some(Ok(Building))),
            ("BUILDING_PART", "Yes", Some(Ok(BuildingPart))),
            ("building", "demolished", Some(Err(NOT_BUILT))),
            ("building", "F", None),
            ("NATURAL", "Water", Some(Ok(Water))),
            ("WATER", "City", None),
            ("man_made", "pier", Some(Ok(Road))),
            ("amenity", "school", Some(Ok(LandUse))),
            ("boundary", "administrative", None),
            ("fclass", "residential", Some(Ok(LandUse))),
            ("fclass", "forest", Some(Ok(Vegetation))),
            ("fclass", "building", Some(Ok(Building))),
            ("fclass", "marina", Some(Ok(Water))),
            ("fclass", "pier", Some(Ok(Road))),
            ("LANDUSE", "Harbour", Some(Ok(Water))),
            ("fclass", "national_park", None),
        ] {
            assert_eq!(kind(key, value, true), expected, "{key}={value}");
        }
        assert_eq!(kind("fclass", "residential", false), Some(Ok(Road)));
        assert_eq!(kind("fclass", "river", false), Some(Ok(Water)));
        assert_eq!(kind("fclass", "track_grade1", false), None);
    }
}
