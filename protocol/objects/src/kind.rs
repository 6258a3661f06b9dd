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
    pub fn name(self) -> &'static str {
        Self::NAMES.iter().find(|(_, kind)| *kind == self).map_or("generic", |(name, _)| name)
    }

    /// Whether an object of this kind whose parent is of the kind `parent` is a part of it, and not a thing of its own: buildings,
    /// bridges and tunnels have parts.
    pub fn is_part_of(self, parent: Self) -> bool {
        let whole = |kind| if kind == Self::BuildingPart { Self::Building } else { kind };
        whole(self) == whole(parent) && (self.is_of_building() || matches!(self, Self::Bridge | Self::Tunnel))
    }

    /// Whether it is a building or a part of one.
    pub fn is_of_building(self) -> bool {
        matches!(self, Self::Building | Self::BuildingPart)
    }

    /// Whether it lies on the ground. The box of such an object is as high as the ground rises below it, which is no height of its own.
    pub fn is_level(self) -> bool {
        matches!(self, Self::Road | Self::Rail | Self::Water | Self::LandUse | Self::Relief)
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_are_of_the_kind_of_their_parent() {
        use FeatureKind::{Bridge, Building, BuildingPart, Furniture, Generic};
        for (kind, parent) in
            [(BuildingPart, Building), (Building, Building), (BuildingPart, BuildingPart), (Bridge, Bridge)]
        {
            assert!(kind.is_part_of(parent), "{kind:?} {parent:?}");
        }
        for (kind, parent) in [(Building, Generic), (Furniture, Building), (Generic, Generic), (Building, Bridge)] {
            assert!(!kind.is_part_of(parent), "{kind:?} {parent:?}");
        }
    }
}
