//! Colours of surfaces that have none in the source, and kinds of objects by type.

use std::collections::BTreeMap;
use std::path::Path;

use serde::Deserialize;

use super::source::read_file;
use crate::error::{InputError, json_message};
use crate::scene::ObjectKind;

/// Larger palette files are refused.
const MAX_BYTES: u64 = 1 << 20;

/// Surfaces by their semantics in CityJSON. Muted colours, so that shading dominates.
const SURFACES: &[(&str, [u8; 3])] = &[
    ("RoofSurface", [171, 116, 98]),
    ("OuterFloorSurface", [176, 168, 158]),
    ("WallSurface", [214, 207, 194]),
    ("InteriorWallSurface", [222, 218, 210]),
    ("GroundSurface", [140, 134, 126]),
    ("FloorSurface", [176, 168, 158]),
    ("OuterCeilingSurface", [196, 190, 180]),
    ("CeilingSurface", [222, 218, 210]),
    ("ClosureSurface", [204, 198, 188]),
    ("Window", [128, 148, 163]),
    ("Door", [132, 106, 84]),
    ("WaterSurface", [124, 154, 174]),
    ("WaterGroundSurface", [110, 124, 128]),
    ("WaterClosureSurface", [124, 154, 174]),
    ("TrafficArea", [148, 148, 148]),
    ("AuxiliaryTrafficArea", [166, 168, 154]),
    ("TransportationMarking", [206, 204, 196]),
    ("TransportationHole", [120, 116, 110]),
];

/// Objects by their type in CityJSON.
const OBJECTS: &[(&str, [u8; 3])] = &[
    ("Building", [206, 199, 188]),
    ("BuildingPart", [206, 199, 188]),
    ("BuildingInstallation", [190, 184, 174]),
    ("BuildingConstructiveElement", [190, 184, 174]),
    ("BuildingFurniture", [170, 160, 148]),
    ("BuildingStorey", [206, 199, 188]),
    ("BuildingRoom", [222, 218, 210]),
    ("BuildingUnit", [206, 199, 188]),
    ("Bridge", [178, 174, 168]),
    ("BridgePart", [178, 174, 168]),
    ("BridgeInstallation", [168, 164, 158]),
    ("BridgeConstructiveElement", [168, 164, 158]),
    ("BridgeConstructionElement", [168, 164, 158]),
    ("BridgeRoom", [178, 174, 168]),
    ("BridgeFurniture", [150, 150, 152]),
    ("CityFurniture", [150, 150, 152]),
    ("CityObjectGroup", [204, 200, 192]),
    ("GenericCityObject", [196, 192, 184]),
    ("LandUse", [170, 176, 146]),
    ("OtherConstruction", [190, 186, 178]),
    ("PlantCover", [122, 148, 100]),
    ("Railway", [150, 142, 134]),
    ("Road", [152, 152, 152]),
    ("SolitaryVegetationObject", [112, 142, 92]),
    ("TINRelief", [168, 172, 148]),
    ("TransportSquare", [172, 168, 160]),
    ("Tunnel", [164, 160, 154]),
    ("TunnelPart", [164, 160, 154]),
    ("TunnelInstallation", [156, 152, 146]),
    ("TunnelConstructiveElement", [156, 152, 146]),
    ("TunnelHollowSpace", [164, 160, 154]),
    ("TunnelFurniture", [150, 150, 152]),
    ("WaterBody", [124, 154, 174]),
    ("Waterway", [124, 154, 174]),
];

/// Materials by name, as in OpenStreetMap's `building:material` and `roof:material`.
const MATERIALS: &[(&str, [u8; 3])] = &[
    ("asphalt", [120, 120, 122]),
    ("brick", [168, 112, 92]),
    ("concrete", [186, 184, 178]),
    ("copper", [128, 158, 140]),
    ("glass", [142, 160, 172]),
    ("grass", [126, 150, 100]),
    ("metal", [158, 162, 166]),
    ("plaster", [216, 209, 196]),
    ("roof_tiles", [174, 112, 90]),
    ("sandstone", [206, 186, 152]),
    ("slate", [112, 116, 122]),
    ("stone", [176, 170, 160]),
    ("tar_paper", [104, 104, 106]),
    ("wood", [160, 130, 100]),
];

/// Colours of surfaces that have none in the source, as 8-bit sRGB.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Palette {
    /// By semantic surface such as `RoofSurface`. These take precedence over `objects`.
    pub surfaces: BTreeMap<String, [u8; 3]>,
    /// By object type such as `WaterBody`.
    pub objects: BTreeMap<String, [u8; 3]>,
    /// By name of a material without a colour, in lower case, such as `brick`.
    pub materials: BTreeMap<String, [u8; 3]>,
    /// For everything else.
    pub fallback: [u8; 3],
}

impl Default for Palette {
    fn default() -> Self {
        let map = |entries: &[(&str, [u8; 3])]| entries.iter().map(|&(name, rgb)| (name.to_owned(), rgb)).collect();
        let (surfaces, objects, materials) = (map(SURFACES), map(OBJECTS), map(MATERIALS));
        Self { surfaces, objects, materials, fallback: [204, 200, 192] }
    }
}

/// A palette file. Its entries replace the defaults.
#[derive(Deserialize, Default)]
#[serde(default, deny_unknown_fields)]
struct PaletteFile {
    surfaces: BTreeMap<String, String>,
    objects: BTreeMap<String, String>,
    materials: BTreeMap<String, String>,
    default: Option<String>,
}

impl Palette {
    /// Reads a palette file. Fails if it cannot be read, is not valid JSON, or has an unknown key or colour, which the
    /// message names.
    pub fn read(path: &Path) -> Result<Self, InputError> {
        let label = path.display().to_string();
        let bytes = read_file(path, MAX_BYTES)?;
        Self::from_json(&bytes).map_err(|what| InputError::Palette { path: label, what })
    }

    fn from_json(text: &[u8]) -> Result<Self, String> {
        let file: PaletteFile = serde_json::from_slice(text)
            .map_err(|error| format!("line {}, column {}: {}", error.line(), error.column(), json_message(&error)))?;
        let mut palette = Self::default();
        for (section, colours, into) in
            [("surfaces", file.surfaces, &mut palette.surfaces), ("objects", file.objects, &mut palette.objects)]
        {
            for (name, colour) in colours {
                // Names of CityJSON extensions begin with a plus.
                if !into.contains_key(&name) && !name.starts_with('+') {
                    return Err(format!("{section}.{name} is unknown; known are {}", join(into.keys())));
                }
                let rgb = parse_entry(&format!("{section}.{name}"), &colour)?;
                into.insert(name, rgb);
            }
        }
        for (name, colour) in file.materials {
            let rgb = parse_entry(&format!("materials.{name}"), &colour)?;
            palette.materials.insert(name.to_lowercase(), rgb);
        }
        if let Some(colour) = file.default {
            palette.fallback = parse_entry("default", &colour)?;
        }
        Ok(palette)
    }

    /// Colour of the surface, else of the object, else the fallback.
    pub(crate) fn colour(&self, semantic: Option<&str>, object_type: &str) -> [u8; 3] {
        let by_semantic = semantic.and_then(|name| self.surfaces.get(name));
        *by_semantic.or_else(|| self.objects.get(object_type)).unwrap_or(&self.fallback)
    }

    /// Colour of a material by name.
    pub(crate) fn material(&self, name: &str) -> Option<[u8; 3]> {
        self.materials.get(&name.trim().to_lowercase()).copied()
    }
}

fn join<'n>(names: impl Iterator<Item = &'n String>) -> String {
    names.map(String::as_str).collect::<Vec<_>>().join(", ")
}

fn parse_entry(key: &str, colour: &str) -> Result<[u8; 3], String> {
    parse_colour(colour)
        .ok_or_else(|| format!("{key}: \"{colour}\" is not a colour; write it as \"#ab7462\" or \"brown\""))
}

/// Converts a component from 0..=1 to 8 bits.
pub(crate) fn unit_to_byte(component: f64) -> u8 {
    (component.clamp(0.0, 1.0) * 255.0).round() as u8
}

/// Parses a CSS colour such as `#ab7462`, `brown` or `rgb(171, 116, 98)`.
pub(crate) fn parse_colour(text: &str) -> Option<[u8; 3]> {
    let [r, g, b, _] = csscolorparser::parse(text.trim()).ok()?.to_rgba8();
    Some([r, g, b])
}

/// Kind of an object by its CityJSON type. Relief is terrain, and so are flat types unless they are modelled as a
/// volume.
pub(crate) fn object_kind(object_type: &str, has_volume: bool) -> ObjectKind {
    match object_type {
        "TINRelief" => ObjectKind::Terrain,
        "LandUse" | "PlantCover" | "Railway" | "Road" | "TransportSquare" | "WaterBody" | "Waterway" if !has_volume => {
            ObjectKind::Terrain
        }
        _ => ObjectKind::Building,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn surface_colour_takes_precedence_over_object_and_fallback() {
        let palette = Palette::default();
        assert_eq!(palette.colour(Some("RoofSurface"), "Building"), [171, 116, 98]);
        assert_eq!(palette.colour(Some("+Odd"), "WaterBody"), [124, 154, 174]);
        assert_eq!(palette.colour(None, "+Odd"), palette.fallback);
        assert_eq!(palette.material(" Brick"), Some([168, 112, 92]));
    }

    #[test]
    fn palette_file_replaces_only_the_colours_it_names() {
        let text = r##"{"surfaces": {"RoofSurface": "#102030", "+Balcony": "white"}, "objects": {"Road": "rgb(1, 2, 3)"},
            "materials": {"Ziegel": "brown"}, "default": "fff"}"##;
        let palette = Palette::from_json(text.as_bytes()).unwrap();
        assert_eq!(palette.colour(Some("RoofSurface"), "Building"), [16, 32, 48]);
        assert_eq!(palette.colour(Some("+Balcony"), "Building"), [255; 3]);
        assert_eq!(palette.colour(None, "Road"), [1, 2, 3]);
        assert_eq!(palette.material("ziegel"), Some([165, 42, 42]));
        assert_eq!(palette.colour(None, "?"), [255; 3]);
        assert_eq!(palette.surfaces["WallSurface"], Palette::default().surfaces["WallSurface"]);
        assert_eq!(Palette::from_json(b"{}").unwrap(), Palette::default());
    }

    #[test]
    fn errors_in_a_palette_file_name_the_key() {
        for (text, part) in [
            (r#"{"surfaces": {"Roof": "red"}}"#, "surfaces.Roof is unknown; known are "),
            (r#"{"objects": {"RoofSurface": "red"}}"#, "objects.RoofSurface is unknown"),
            (r#"{"objects": {"Road": "greyish"}}"#, "objects.Road: \"greyish\" is not a colour"),
            (r#"{"materials": {"brick": ""}}"#, "materials.brick: "),
            (r#"{"default": "12"}"#, "default: "),
            (r#"{"roofs": {}}"#, "unknown field `roofs`"),
            (r#"{"default": 7}"#, "line 1, column 13: invalid type"),
            ("", "line 1, column 0: EOF"),
        ] {
            let error = Palette::from_json(text.as_bytes()).unwrap_err();
            assert!(error.contains(part) && !error.contains('\n'), "{text}: {error}");
        }
    }

    #[test]
    fn flat_types_without_volume_are_terrain() {
        assert_eq!(object_kind("TINRelief", true), ObjectKind::Terrain);
        assert_eq!(object_kind("Road", false), ObjectKind::Terrain);
        assert_eq!(object_kind("PlantCover", true), ObjectKind::Building);
        assert_eq!(object_kind("Building", false), ObjectKind::Building);
    }
}
