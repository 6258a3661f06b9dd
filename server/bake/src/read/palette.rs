//! Colours and kinds for what the source leaves uncoloured.
//!
//! In: a surface's semantics or an object's type. Out: a colour, an [`ObjectKind`]. Next: `builder`.

use std::collections::BTreeMap;

use crate::scene::ObjectKind;

/// Default colours, restrained so that shading and not paint shapes the picture.
const DEFAULTS: &[(&str, [u8; 3])] = &[
    // Surfaces of buildings.
    ("RoofSurface", [171, 116, 98]),
    ("OuterFloorSurface", [176, 168, 158]),
    ("WallSurface", [214, 207, 194]),
    ("GroundSurface", [140, 134, 126]),
    ("OuterCeilingSurface", [196, 190, 180]),
    ("ClosureSurface", [204, 198, 188]),
    ("Window", [128, 148, 163]),
    ("Door", [132, 106, 84]),
    // Surfaces of water and traffic.
    ("WaterSurface", [124, 154, 174]),
    ("WaterGroundSurface", [110, 124, 128]),
    ("TrafficArea", [148, 148, 148]),
    ("AuxiliaryTrafficArea", [166, 168, 154]),
    // Whole objects.
    ("Building", [206, 199, 188]),
    ("BuildingPart", [206, 199, 188]),
    ("Bridge", [178, 174, 168]),
    ("CityFurniture", [150, 150, 152]),
    ("LandUse", [170, 176, 146]),
    ("PlantCover", [122, 148, 100]),
    ("Railway", [150, 142, 134]),
    ("Road", [152, 152, 152]),
    ("SolitaryVegetationObject", [112, 142, 92]),
    ("TINRelief", [168, 172, 148]),
    ("TransportSquare", [172, 168, 160]),
    ("WaterBody", [124, 154, 174]),
    ("Waterway", [124, 154, 174]),
];

/// Default colours by CityJSON's names of surfaces and objects.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Palette {
    /// 8-bit sRGB by semantic surface (`RoofSurface`) or object type (`WaterBody`).
    pub by_name: BTreeMap<String, [u8; 3]>,
    /// For everything else, and for OBJ faces without a material.
    pub fallback: [u8; 3],
}

impl Default for Palette {
    fn default() -> Self {
        let by_name = DEFAULTS.iter().map(|&(name, rgb)| (name.to_owned(), rgb)).collect();
        Self { by_name, fallback: [204, 200, 192] }
    }
}

impl Palette {
    /// The surface's colour, else the object's, else the fallback.
    pub(crate) fn colour(&self, semantic: Option<&str>, object_type: &str) -> [u8; 3] {
        let by_semantic = semantic.and_then(|name| self.by_name.get(name));
        *by_semantic.or_else(|| self.by_name.get(object_type)).unwrap_or(&self.fallback)
    }
}

/// Relief is terrain; so is what lies flat on it, unless it is modelled as a volume.
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
    fn the_nearest_name_colours() {
        let palette = Palette::default();
        assert_eq!(palette.colour(Some("RoofSurface"), "Building"), [171, 116, 98]);
        assert_eq!(palette.colour(Some("+Odd"), "WaterBody"), [124, 154, 174]);
        assert_eq!(palette.colour(None, "+Odd"), palette.fallback);
    }

    #[test]
    fn flat_things_are_ground_and_volumes_are_not() {
        assert_eq!(object_kind("TINRelief", true), ObjectKind::Terrain);
        assert_eq!(object_kind("Road", false), ObjectKind::Terrain);
        assert_eq!(object_kind("PlantCover", true), ObjectKind::Building);
        assert_eq!(object_kind("Building", false), ObjectKind::Building);
    }
}
