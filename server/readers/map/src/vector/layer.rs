//! A layer of features: its name and columns, and what they tell about them.

use insula_dress::footprint::is_height;
use insula_source::object::FeatureKind;
use insula_source::text::split_words;

/// Keys of OpenStreetMap that tell what a feature is. Other tables hardly have two of them.
pub(super) const OSM_KEYS: [&str; 14] = split_words(
    "admin_level aeroway amenity barrier boundary building highway landuse leisure man_made natural railway tourism \
    waterway",
);

/// Words of layers of plants: their points are trees, and their heights those of trees.
const TREES: &[&str] = &split_words::<15>(
    "tree trees vegetation baum baeume bäume boom bomen arbre arbres arbol arboles árboles alberi drzewa",
);

/// Words in names of layers, tables and files, in the languages of the larger publishers.
const WORDS: &[(FeatureKind, &[&str])] = &[
    (FeatureKind::BuildingPart, &["buildingpart", "buildingparts"]),
    (
        FeatureKind::Building,
        &split_words::<19>(
            "building buildings bldg footprint footprints gebouw gebouwen pand panden gebaeude gebäude batiment \
            batiments edificio edificios edifici budynki bygning bygninger",
        ),
    ),
    (FeatureKind::Vegetation, TREES),
    (FeatureKind::Bridge, &["bridge", "bridges"]),
    (FeatureKind::Tunnel, &["tunnel", "tunnels"]),
    (
        FeatureKind::Road,
        &["road", "roads", "street", "streets", "highway", "highways", "wegdeel", "strassen", "routes"],
    ),
    (FeatureKind::Rail, &["rail", "rails", "railway", "railways", "spoor", "tram", "trams"]),
    (
        FeatureKind::Water,
        &split_words::<13>(
            "water waters waterway waterways waterbody waterbodies river rivers lake lakes waterdeel hydro ocean",
        ),
    ),
    (FeatureKind::Vegetation, &["forest", "forests", "wood", "woods", "park", "parks"]),
    (
        FeatureKind::LandUse,
        &["landuse", "landcover", "parcel", "parcels", "plot", "plots", "lots", "perceel", "cadastre", "tessellation"],
    ),
    (FeatureKind::Generic, &["pois", "poi", "places", "boundary", "boundaries", "admin", "districts", "countries"]),
];

/// Columns that all features of Overture have, and those that only its buildings have, but need not.
const OVERTURE_COLUMNS: [&str; 4] = ["id", "sources", "version", "subtype"];
const OVERTURE_BUILDING_COLUMNS: [&str; 8] =
    split_words("has_parts building_id is_underground num_floors roof_shape roof_height roof_color facade_color");

/// Names of columns that only tables of trees have, in lower case without what separates words.
const TREE_COLUMNS: [&str; 26] = split_words(
    "tree baum treeid treeno treenumber treename treetype treespecies treeheight crowndiameter crownwidth spccommon \
    spclatin baumart baumid baumnr baumnummer baumname baumgattung baumhoehe baumhöhe kronendurchmesser stammumfang \
    stammdurchmesser boomsoort boomhoogte",
);
/// Names of columns that tables of trees have, and perhaps those of other plants or of animals.
const SPECIES_COLUMNS: [&str; 9] =
    ["species", "genus", "gattung", "essence", "espece", "espèce", "especie", "botanicalname", "soortnaam"];
/// Those that mean trees beside a height, and anything else without one.
const SORT_COLUMNS: [&str; 3] = ["art", "soort", "genre"];

/// Whether the points of a table are trees, by its columns.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) enum TreeColumns {
    #[default]
    Missing,
    /// Perhaps: they tell a species.
    Species,
    Certain,
}

impl TreeColumns {
    /// By names in lower case.
    fn of(names: &[String]) -> Self {
        let is_one_of = |name: &String, known: &[&str]| {
            known.iter().any(|known| name.chars().filter(|c| c.is_alphanumeric()).eq(known.chars()))
        };
        let has = |known: &[&str]| names.iter().any(|name| is_one_of(name, known));
        if has(&TREE_COLUMNS) {
            Self::Certain
        } else if has(&SPECIES_COLUMNS) || has(&SORT_COLUMNS) && names.iter().any(|name| is_height(name)) {
            Self::Species
        } else {
            Self::Missing
        }
    }
}

/// What the names of columns tell about features.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Columns {
    /// Features of all kinds are in one table: an area is a building only if its attributes say so.
    pub(super) is_mixed: bool,
    /// The columns are keys of OpenStreetMap.
    pub(super) is_of_osm: bool,
    pub(super) trees: TreeColumns,
}

impl Columns {
    pub(super) fn new<'c>(names: impl Iterator<Item = &'c str>) -> Self {
        let names: Vec<String> = names.map(str::to_lowercase).collect();
        let has = |name: &&str| names.iter().any(|known| known == name);
        // With other keys, those of buildings are in the same table.
        let is_of_keys = OSM_KEYS.iter().filter(|key| has(key)).count() > 1;
        let is_of_osm = has(&"building") && is_of_keys;
        let is_of_overture = OVERTURE_COLUMNS.iter().all(has);
        let is_mixed = is_of_osm || is_of_overture && !OVERTURE_BUILDING_COLUMNS.iter().any(has);
        // A table of all points has a column of species for some of them.
        let trees = if is_of_keys { TreeColumns::Missing } else { TreeColumns::of(&names) };
        Self { is_mixed, is_of_osm, trees }
    }
}

/// A table or file of features.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(super) struct Layer {
    pub(super) name: String,
    /// What the name says about features whose attributes tell no kind.
    pub(super) kind: Option<FeatureKind>,
    /// The name has a word of plants, not only one that streets and houses are called by, such as `park`.
    pub(super) is_of_trees: bool,
    pub(super) columns: Columns,
}

impl Layer {
    pub(super) fn new<'c>(name: &str, columns: impl Iterator<Item = &'c str>) -> Self {
        let kind = kind_of_name(name);
        let is_of_trees =
            kind == Some(FeatureKind::Vegetation) && words(name).iter().any(|word| TREES.contains(&word.as_str()));
        Self { name: name.to_owned(), kind, is_of_trees, columns: Columns::new(columns) }
    }

    /// The layer of a file by its path: the name without folder and extension, and parts such as `type=building_part`.
    pub(super) fn of_file<'c>(path: &str, columns: impl Iterator<Item = &'c str>) -> Self {
        let file = path.rsplit(['/', '\\']).next().unwrap_or(path);
        let name = file.split_once('.').map_or(file, |(stem, _)| stem);
        let partition = path.split(['/', '\\']).rev().find_map(|part| part.strip_prefix("type="));
        let partition = partition.filter(|part| part.len() < 64);
        Self::new(partition.unwrap_or(name), columns)
    }
}

/// The kind that a name tells: the first kind of [`WORDS`] one of whose words it has.
fn kind_of_name(name: &str) -> Option<FeatureKind> {
    let words = words(name);
    let is_known = |known: &[&str]| words.iter().any(|word| known.contains(&word.as_str()));
    WORDS.iter().find(|(_, known)| is_known(known)).map(|(kind, _)| *kind)
}

fn words(name: &str) -> Vec<String> {
    let lower = name.to_lowercase().replace("building_part", "buildingpart").replace("land_use", "landuse");
    lower.split(|c: char| !c.is_alphabetic()).map(str::to_owned).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_tell_kinds() {
        assert_eq!(kind_of_name("gis_osm_buildings_a_free_1"), Some(FeatureKind::Building));
        assert_eq!(kind_of_name("gis_osm_railways_free_1"), Some(FeatureKind::Rail));
        assert_eq!(kind_of_name("Waterdeel"), Some(FeatureKind::Water));
        assert_eq!(kind_of_name("waterloo"), None);
        assert_eq!(kind_of_name("street_trees"), Some(FeatureKind::Vegetation));
        assert_eq!(kind_of_name("chiyoda_z16_8x8"), None);
        let parts = Layer::of_file("release/theme=buildings/type=building_part/part-0.zstd.parquet", [].into_iter());
        assert_eq!((parts.name.as_str(), parts.kind), ("building_part", Some(FeatureKind::BuildingPart)));
        let file = Layer::of_file("a/Roads.2024.shp.gz", [].into_iter());
        assert_eq!((file.name.as_str(), file.kind), ("Roads", Some(FeatureKind::Road)));
    }

    #[test]
    fn columns_tell_trees() {
        use TreeColumns::{Certain, Missing, Species};
        for (names, expected) in [
            (&["Tree_ID", "species"][..], Certain),
            (&["nr", "Baumhöhe"], Certain),
            (&["id", "GENUS"], Species),
            (&["Art", "Höhe"], Species),
            (&["Art", "Name"], Missing),
            (&["amenity", "natural", "species"], Missing),
            (&["street", "height"], Missing),
        ] {
            assert_eq!(Columns::new(names.iter().copied()).trees, expected, "{names:?}");
        }
    }

    #[test]
    fn tables_of_all_kinds_are_mixed() {
        let is_mixed = |columns: &[&str]| Columns::new(columns.iter().copied()).is_mixed;
        assert!(is_mixed(&["osm_id", "building", "landuse"]));
        assert!(!is_mixed(&["building", "height"]));
        assert!(is_mixed(&["id", "sources", "version", "subtype"]));
        assert!(is_mixed(&["id", "sources", "version", "subtype", "height"]), "infrastructure");
        assert!(!is_mixed(&["id", "sources", "version", "subtype", "has_parts"]));
        assert!(!is_mixed(&["id", "sources", "version"]), "only buildings have no subtype");
    }
}
