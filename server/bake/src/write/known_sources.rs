//! Publishers of city models whose name and licence are known, for files that do not say them.

use crate::read::{SourceFormat, SourceReport};

/// A publisher.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct KnownSource {
    /// The name that it asks for.
    pub(super) name: &'static str,
    pub(super) licence: &'static str,
    pub(super) url: &'static str,
    /// Words of which one is in the path of a file, its address, its titles or its attributions; lower case, without separators.
    words: &'static [&'static str],
    /// Attributes of which one is in every file.
    attributes: &'static [&'static str],
}

const PLATEAU: KnownSource = KnownSource {
    name: "Project PLATEAU, MLIT Japan",
    licence: "CC BY 4.0",
    url: "https://www.mlit.go.jp/plateau/",
    // Plateaus are elsewhere, too.
    words: &["projectplateau", "plateaureearth", "plateaugeospatial"],
    attributes: &[],
};
const OPEN_STREET_MAP: KnownSource = KnownSource {
    name: "OpenStreetMap contributors",
    licence: "ODbL 1.0",
    url: "https://www.openstreetmap.org/copyright",
    words: &["openstreetmap", "geofabrik"],
    attributes: &["osm_id", "osm_way_id"],
};
/// The first that fits counts.
static KNOWN: [KnownSource; 6] = [
    KnownSource {
        name: "3DBAG by tudelft3d and 3DGI",
        licence: "CC BY 4.0",
        url: "https://3dbag.nl",
        words: &["3dbag"],
        attributes: &["b3_h_dak_max", "b3_h_maaiveld"],
    },
    PLATEAU,
    OPEN_STREET_MAP,
    KnownSource {
        name: "swisstopo",
        licence: "Open use, source must be named (OGD swisstopo)",
        url: "https://www.swisstopo.admin.ch/en/terms-of-use-free-geodata-and-geoservices",
        words: &["swisstopo", "swissbuildings3d", "swissalti3d", "swisstlm3d", "swissimage", "swisssurface3d"],
        attributes: &[],
    },
    KnownSource {
        name: "Overture Maps Foundation",
        licence: "ODbL 1.0",
        url: "https://overturemaps.org",
        words: &["overturemaps"],
        attributes: &[],
    },
    KnownSource {
        name: "IGN, BD TOPO",
        licence: "Licence Ouverte 2.0",
        url: "https://geoservices.ign.fr/bdtopo",
        words: &["bdtopo"],
        attributes: &[],
    },
];

/// The publisher of a source, by its address or file, by what it says of itself, or by its attributes.
pub(super) fn known_source(source: &SourceReport) -> Option<&'static KnownSource> {
    let about = || source.titles.iter().chain(&source.attributions).chain([&source.path]).map(|text| plain(text));
    let has_word = |known: &&KnownSource| about().any(|text| known.words.iter().any(|word| text.contains(word)));
    let has_attribute =
        |known: &&KnownSource| known.attributes.iter().any(|name| source.attributes.contains_key(*name));
    let has_name = |known: &&KnownSource| **known == PLATEAU && is_plateau_file(&source.path);
    let has_format = |known: &&KnownSource| **known == OPEN_STREET_MAP && source.format == SourceFormat::OpenStreetMap;
    KNOWN.iter().find(|known| has_word(known) || has_attribute(known) || has_name(known) || has_format(known))
}

/// Whether a title is the name of a publisher, and not of a place.
pub(super) fn is_publisher(title: &str) -> bool {
    let title = plain(title);
    KNOWN.iter().any(|known| known.words.contains(&title.as_str()))
}

/// Lower case, without what separates words.
fn plain(text: &str) -> String {
    text.chars().filter(|c| c.is_alphanumeric()).flat_map(char::to_lowercase).collect()
}

/// Whether a file has a name as PLATEAU gives them: mesh code, theme, EPSG code, such as `53394525_bldg_6697_op.gml`.
fn is_plateau_file(path: &str) -> bool {
    const THEMES: [&str; 9] = ["bldg", "brid", "dem", "fld", "frn", "luse", "tran", "tun", "veg"];
    let name = path.rsplit(['/', '\\']).next().unwrap_or_default();
    let mut parts = name.split(['_', '.']);
    let is_number = |part: &str| (4..=11).contains(&part.len()) && part.bytes().all(|byte| byte.is_ascii_digit());
    parts.next().is_some_and(is_number)
        && parts.next().is_some_and(|theme| THEMES.contains(&theme))
        && parts.next().is_some_and(is_number)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn name_of(path: &str, title: &str, attribute: &str) -> Option<&'static str> {
        let mut source = SourceReport::new(path, SourceFormat::CityGml, 0);
        source.titles.push(title.to_owned());
        source.attributes.insert(attribute.to_owned(), Default::default());
        known_source(&source).map(|known| known.name)
    }

    #[test]
    fn publishers_are_known_by_address_file_title_and_attributes() {
        for (path, title, attribute, name) in [
            (
                "https://data.3dbag.nl/v20250903/tiles/9/284/556/9-284-556.city.json.gz",
                "",
                "",
                "3DBAG by tudelft3d and 3DGI",
            ),
            ("a.json", "3D BAG", "", "3DBAG by tudelft3d and 3DGI"),
            ("a.fgb", "", "b3_h_dak_max", "3DBAG by tudelft3d and 3DGI"),
            ("udx/bldg/52397519_bldg_6697_op.gml", "", "", "Project PLATEAU, MLIT Japan"),
            ("https://assets.cms.plateau.reearth.io/assets/x.zip", "", "", "Project PLATEAU, MLIT Japan"),
            ("s3://x/swissBUILDINGS3D_3-0_1407-42.gdb.zip", "", "", "swisstopo"),
            ("roads.shp", "", "osm_id", "OpenStreetMap contributors"),
            ("BDTOPO_3-3_TOUSTHEMES_SHP_D075.7z", "", "", "IGN, BD TOPO"),
        ] {
            assert_eq!(name_of(path, title, attribute), Some(name), "{path} {title} {attribute}");
        }
        for path in
            ["town.obj", "plateau/town.obj", "12_bldg_6697.gml", "52397519_bldg.gml", "bag.json", "bdg_topo.gml"]
        {
            assert_eq!(name_of(path, "Delft", "height"), None, "{path}");
        }
    }

    #[test]
    fn a_publisher_is_no_place() {
        assert!(is_publisher("3DBAG") && is_publisher("3D BAG") && is_publisher("swissBUILDINGS3D"));
        assert!(!is_publisher("Delft") && !is_publisher("Delft, from the 3DBAG") && !is_publisher(""));
    }
}
