//! Kinds of objects by the names of their types.

use super::names::{Family, Name};
use insula_source::object::FeatureKind;

/// The kind of an object by its type. Objects of planning are areas of land.
pub(super) fn kind_of(name: &Name) -> FeatureKind {
    let local = &*name.local;
    match local {
        "Building" => FeatureKind::Building,
        "BuildingPart" | "BuildingUnit" | "Storey" | "BuildingInstallation" | "BuildingConstructiveElement" => {
            FeatureKind::BuildingPart
        }
        "Road"
        | "Track"
        | "Square"
        | "TransportationComplex"
        | "Section"
        | "Intersection"
        | "TrafficArea"
        | "AuxiliaryTrafficArea" => FeatureKind::Road,
        "Railway" => FeatureKind::Rail,
        "WaterBody" | "Waterway" => FeatureKind::Water,
        "SolitaryVegetationObject" | "PlantCover" => FeatureKind::Vegetation,
        "LandUse" => FeatureKind::LandUse,
        "CityFurniture" => FeatureKind::Furniture,
        "ReliefFeature" | "TINRelief" => FeatureKind::Relief,
        _ if local.starts_with("Bridge") => FeatureKind::Bridge,
        _ if local.starts_with("Tunnel") => FeatureKind::Tunnel,
        _ if name.family == Family::Urf => FeatureKind::LandUse,
        // Types of extensions, such as `IndustrialBuilding`, are named after the types that they extend.
        _ if local.ends_with("Building") => FeatureKind::Building,
        _ if local.ends_with("BuildingPart") => FeatureKind::BuildingPart,
        _ => FeatureKind::Generic,
    }
}

/// Whether an object of the type only groups others.
pub(super) fn is_group(name: &Name) -> bool {
    &*name.local == "CityObjectGroup"
}

/// Whether the type is a relief of another form than triangles.
pub(super) fn is_other_relief(name: &Name) -> bool {
    matches!(&*name.local, "BreaklineRelief" | "RasterRelief" | "MassPointRelief")
}
