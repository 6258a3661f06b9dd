//! What an object of a tile is, judged by its attributes and by the names of its files.

use insula_source::attributes::{AttributeValue, Attributes};
use insula_source::object::FeatureKind;
use insula_source::text::split_words;

/// Attributes whose value is an identifier, the best first. Compared without case, `_`, `:` and `-`.
const ID_NAMES: [&str; 14] = split_words(
    "gmlid id globalid buildingid elementid featureid objectid guid uuid identifier osmid bin uniqueid name",
);
/// Attributes whose value names a class. Compared in the same way.
const CLASS_NAMES: [&str; 9] =
    ["featuretype", "classname", "class", "citygmlclass", "objecttype", "category", "layer", "type", "topiccategory"];
/// Words of names and classes, by the kinds that they mean. No two kinds have a common word.
const WORDS: [(FeatureKind, &[&str]); 12] = [
    (FeatureKind::Bridge, &["bridge", "bridges", "brid"]),
    (FeatureKind::Tunnel, &["tunnel", "tunnels", "tun"]),
    (FeatureKind::Rail, &["railway", "railways", "rail", "rwy"]),
    (FeatureKind::Road, &["road", "roads", "street", "streets", "tran", "transportation"]),
    (FeatureKind::Water, &["water", "waterbody", "waterway", "wtr", "river", "lake"]),
    (
        FeatureKind::Vegetation,
        &split_words::<8>("tree trees vegetation veg solitaryvegetationobject plantcover plants forest"),
    ),
    (FeatureKind::LandUse, &["landuse", "luse"]),
    (FeatureKind::Furniture, &["furniture", "cityfurniture", "frn", "lamp", "lamps", "streetlight"]),
    (
        FeatureKind::Relief,
        &split_words::<9>("terrain relief dem dtm ground elevation tinrelief reliefparty relieffeature"),
    ),
    (FeatureKind::Generic, &["generic", "gen", "genericcityobject"]),
    (FeatureKind::Building, &split_words::<9>("building buildings bldg house houses wall roof door window")),
    (FeatureKind::BuildingPart, &["buildingpart", "consistsofbuildingpart"]),
];

/// The name in lower case without what separates words.
fn plain(name: &str) -> String {
    name.chars().filter(|c| c.is_alphanumeric()).flat_map(char::to_lowercase).collect()
}

/// The first attribute, in the order of `names`, that is not empty.
fn first_of<'a>(attributes: &'a Attributes, names: &[&str]) -> Option<&'a AttributeValue> {
    let named: Vec<_> = attributes.iter().map(|(name, value)| (plain(name), value)).collect();
    names.iter().find_map(|wanted| {
        let found = named.iter().find(|(name, value)| name == wanted && value.as_str() != Some(""))?;
        Some(found.1)
    })
}

/// The identifier that the attributes of a feature have.
pub(crate) fn id_of(attributes: &Attributes) -> Option<String> {
    first_of(attributes, &ID_NAMES).map(|value| value.to_string().trim().to_owned()).filter(|id| !id.is_empty())
}

/// The class that the attributes of a feature name.
pub(crate) fn class_of(attributes: &Attributes) -> Option<&str> {
    first_of(attributes, &CLASS_NAMES).and_then(AttributeValue::as_str)
}

/// The level of detail that the attributes of a feature name.
pub(crate) fn lod_of(attributes: &Attributes) -> Option<f32> {
    let lod = first_of(attributes, &["lod", "levelofdetail"])?.as_f64()?;
    (0.0..10.0).contains(&lod).then_some(lod as f32)
}

/// The kind that a class or a name tells: the first word that is known. Words are separated by anything but letters, and by
/// capital letters after small ones.
pub(crate) fn kind_of_name(name: &str) -> Option<FeatureKind> {
    let kind_of_word = |word: &str| WORDS.iter().find(|(_, known)| known.contains(&word)).map(|(kind, _)| *kind);
    let mut words = Vec::new();
    for part in name.split(|c: char| !c.is_alphabetic()).filter(|part| !part.is_empty()) {
        if let Some(kind) = kind_of_word(&part.to_lowercase()) {
            return Some(kind);
        }
        let mut start = 0;
        let mut was_small = false;
        for (at, c) in part.char_indices() {
            if was_small && c.is_uppercase() {
                words.push(part[start..at].to_lowercase());
                start = at;
            }
            was_small = c.is_lowercase();
        }
        words.push(part[start..].to_lowercase());
    }
    words.iter().find_map(|word| kind_of_word(word))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_tell_the_kind() {
        let cases = [
            ("bldg:Building", Some(FeatureKind::Building)),
            ("tran:Road", Some(FeatureKind::Road)),
            ("veg:SolitaryVegetationObject", Some(FeatureKind::Vegetation)),
            ("tiles/tree-beech-1-0.glb", Some(FeatureKind::Vegetation)),
            ("CityFurniture", Some(FeatureKind::Furniture)),
            ("BuildingPart", Some(FeatureKind::BuildingPart)),
            ("MyTerrainTiles", Some(FeatureKind::Relief)),
            ("streets", Some(FeatureKind::Road)),
            ("content/0/0.glb", None),
            ("treeline", None),
            ("", None),
        ];
        for (name, kind) in cases {
            assert_eq!(kind_of_name(name), kind, "{name}");
        }
    }

    #[test]
    fn identifiers_are_found_under_many_names() {
        let attributes = |members: &[(&str, &str)]| {
            let mut attributes = Attributes::default();
            members.iter().for_each(|(name, value)| attributes.push(name, AttributeValue::Text((*value).to_owned())));
            attributes
        };
        assert_eq!(id_of(&attributes(&[("name", "Kerk"), ("gml:id", "a1")])).as_deref(), Some("a1"));
        assert_eq!(id_of(&attributes(&[("_gml_id", ""), ("Name", "Kerk ")])).as_deref(), Some("Kerk"));
        assert_eq!(id_of(&attributes(&[("height", "4")])), None);
        let mut numbered = Attributes::default();
        numbered.push("id", AttributeValue::Integer(7));
        assert_eq!(id_of(&numbered).as_deref(), Some("7"));
        assert_eq!(class_of(&attributes(&[("feature_type", "tran:Road")])), Some("tran:Road"));
    }
}
