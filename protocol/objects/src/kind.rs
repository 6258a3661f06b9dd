//! What an object of a city is: one list for all formats.

use serde::{Deserialize, Serialize};

/// What an object is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum FeatureKind {
    Building,
    BuildingPart,
    Bridge,
    Tunnel,
    Road,
    Rail,
    Water,
    Vegetation,
    LandUse,
    Furniture,
    Relief,
    Generic,
}

impl FeatureKind {
    /// All kinds with their names on the command line and in reports.
    pub const NAMES: [(&str, Self); 12] = [
        ("building", Self::Building),
        ("building-part", Self::BuildingPart),
        ("bridge", Self::Bridge),
        ("tunnel", Self::Tunnel),
        ("road", Self::Road),
        ("rail", Self::Rail),
        ("water", Self::Water),
        ("vegetation", Self::Vegetation),
        ("land-use", Self::LandUse),
        ("furniture", Self::Furniture),
        ("relief", Self::Relief),
        ("generic", Self::Generic),
    ];

    /// The name on the command line and in reports.
    #[must_use]
    pub fn name(self) -> &'static str {
        Self::NAMES.iter().find(|(_, kind)| *kind == self).map_or("generic", |(name, _)| name)
    }

    /// The kind of an object of CityJSON by its type. Unknown types, such as those of extensions, are generic.
    pub fn of_cityjson_type(name: &str) -> Self {
        match name {
            "BuildingPart" | "BuildingUnit" | "BuildingRoom" | "BuildingStorey" => Self::BuildingPart,
            _ if name.starts_with("Building") => Self::Building,
            _ if name.starts_with("Bridge") => Self::Bridge,
            _ if name.starts_with("Tunnel") => Self::Tunnel,
            "Road" | "TransportSquare" => Self::Road,
            "Railway" => Self::Rail,
            "WaterBody" | "Waterway" => Self::Water,
            "PlantCover" | "SolitaryVegetationObject" => Self::Vegetation,
            "LandUse" => Self::LandUse,
            "CityFurniture" => Self::Furniture,
            "TINRelief" => Self::Relief,
            _ => Self::Generic,
        }
    }

    /// The type of CityJSON by which palettes name the kind.
    pub fn cityjson_type(self) -> &'static str {
        match self {
            Self::Building => "Building",
            Self::BuildingPart => "BuildingPart",
            Self::Bridge => "Bridge",
            Self::Tunnel => "Tunnel",
            Self::Road => "Road",
            Self::Rail => "Railway",
            Self::Water => "WaterBody",
            Self::Vegetation => "PlantCover",
            Self::LandUse => "LandUse",
            Self::Furniture => "CityFurniture",
            Self::Relief => "TINRelief",
            Self::Generic => "GenericCityObject",
        }
    }
}
