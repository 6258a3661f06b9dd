//! Built-in colours, as 8-bit sRGB: those of a white model, which only tells kinds of surfaces apart. They are lighter than weathered
//! materials (docs/decisions/0025-palette.md).
//!
//! In linear light a flat roof reflects four fifths, plaster two thirds, ground half, asphalt two fifths, tiles and brick a third.

/// What decides the colour of a surface.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Part {
    /// One colour everywhere.
    Fixed([u8; 3]),
    /// Flat or pitched, by its normal.
    Roof,
    /// By the kind of walls of its building.
    Wall,
    /// Roof or wall, by its normal: the source does not tell.
    Shell,
}
use Part::{Fixed, Roof, Shell, Wall};

/// Ground under and between buildings. It differs from the generated ground by one step: materials of one colour are one in steps of a
/// bake, and two in a plain bake, whose fingerprints would differ.
pub(super) const GROUND: [u8; 3] = [190, 190, 186];
const WATER: [u8; 3] = [74, 129, 152];
const VEGETATION: [u8; 3] = [148, 170, 120];
const ROAD: [u8; 3] = [160, 162, 164];
const CONCRETE: [u8; 3] = [206, 204, 197];
const METAL: [u8; 3] = [188, 190, 192];

/// Surfaces by their semantics in CityJSON.
pub(super) const SURFACES: &[(&str, Part)] = &[
    ("RoofSurface", Roof),
    ("OuterFloorSurface", Fixed([204, 202, 197])),
    ("WallSurface", Wall),
    ("InteriorWallSurface", Wall),
    ("GroundSurface", Fixed(GROUND)),
    ("FloorSurface", Fixed([204, 202, 197])),
    ("OuterCeilingSurface", Fixed(CONCRETE)),
    ("CeilingSurface", Fixed(CONCRETE)),
    ("ClosureSurface", Wall),
    ("Window", Fixed([104, 120, 130])),
    ("Door", Fixed([146, 124, 104])),
    ("WaterSurface", Fixed(WATER)),
    ("WaterGroundSurface", Fixed([150, 152, 146])),
    ("WaterClosureSurface", Fixed(WATER)),
    ("TrafficArea", Fixed(ROAD)),
    ("AuxiliaryTrafficArea", Fixed([188, 187, 181])),
    ("TransportationMarking", Fixed([232, 231, 227])),
    ("TransportationHole", Fixed([130, 130, 130])),
];

/// Objects by their type in CityJSON.
pub(super) const OBJECTS: &[(&str, Part)] = &[
    ("Building", Shell),
    ("BuildingPart", Shell),
    ("BuildingInstallation", Shell),
    ("BuildingConstructiveElement", Shell),
    ("BuildingFurniture", Fixed([198, 192, 182])),
    ("BuildingStorey", Shell),
    ("BuildingRoom", Shell),
    ("BuildingUnit", Shell),
    ("Bridge", Fixed(CONCRETE)),
    ("BridgePart", Fixed(CONCRETE)),
    ("BridgeInstallation", Fixed(METAL)),
    ("BridgeConstructiveElement", Fixed(CONCRETE)),
    ("BridgeConstructionElement", Fixed(CONCRETE)),
    ("BridgeRoom", Fixed(CONCRETE)),
    ("BridgeFurniture", Fixed(METAL)),
    ("CityFurniture", Fixed(METAL)),
    ("CityObjectGroup", Fixed(CONCRETE)),
    ("GenericCityObject", Fixed([208, 206, 200])),
    ("LandUse", Fixed([180, 180, 162])),
    ("OtherConstruction", Fixed(CONCRETE)),
    ("PlantCover", Fixed([158, 178, 130])),
    ("Railway", Fixed([168, 163, 157])),
    ("Road", Fixed(ROAD)),
    ("SolitaryVegetationObject", Fixed(VEGETATION)),
    ("TINRelief", Fixed([167, 172, 147])),
    ("TransportSquare", Fixed([190, 188, 183])),
    ("Tunnel", Fixed(CONCRETE)),
    ("TunnelPart", Fixed(CONCRETE)),
    ("TunnelInstallation", Fixed(METAL)),
    ("TunnelConstructiveElement", Fixed(CONCRETE)),
    ("TunnelHollowSpace", Fixed(CONCRETE)),
    ("TunnelFurniture", Fixed(METAL)),
    ("WaterBody", Fixed(WATER)),
    ("Waterway", Fixed(WATER)),
];

/// Surfaces and objects above that are water or glass.
pub(super) const REFLECTIVE: &[&str] = &["Window", "WaterSurface", "WaterBody", "Waterway"];
/// Words in the names of materials of water or glass.
pub(super) const REFLECTIVE_WORDS: &[&str] = &["glass", "water"];

/// Objects of an unknown type.
pub(super) const OTHER: Part = Fixed([208, 206, 200]);

/// Materials by name, as in OpenStreetMap's `building:material` and `roof:material`.
pub(super) const MATERIALS: &[(&str, [u8; 3])] = &[
    ("asphalt", [154, 154, 156]),
    ("brick", [190, 146, 126]),
    ("concrete", CONCRETE),
    ("copper", [160, 188, 174]),
    ("glass", [150, 164, 172]),
    ("grass", [160, 180, 132]),
    ("metal", METAL),
    ("plaster", [221, 217, 207]),
    ("roof_tiles", [192, 131, 107]),
    ("sandstone", [216, 200, 172]),
    ("slate", [146, 150, 156]),
    ("stone", [204, 199, 190]),
    ("tar_paper", [142, 142, 144]),
    ("wood", [188, 164, 136]),
];

/// Tones of rendered walls: lime white, cream, sand, cool grey.
pub(super) const PLASTER_WALLS: [[u8; 3]; 4] = [[221, 217, 207], [222, 214, 200], [219, 210, 195], [217, 217, 213]];
/// Tones of brick walls.
pub(super) const BRICK_WALLS: [[u8; 3]; 4] = [[190, 146, 126], [196, 158, 138], [182, 138, 124], [204, 180, 158]];
/// Tones of concrete walls.
pub(super) const CONCRETE_WALLS: [[u8; 3]; 4] = [[214, 211, 204], [219, 216, 209], [208, 209, 209], [222, 219, 214]];
/// Tiled roofs.
pub(super) const TILED_ROOF: [u8; 3] = [192, 131, 107];
/// Flat roofs: white as card. They do not vary: in a city of flat roofs that would cost bytes and show little.
pub(super) const FLAT_ROOF: [u8; 3] = [230, 229, 225];
/// Roofs of halls: sheet metal.
pub(super) const HALL_ROOF: [u8; 3] = [210, 212, 213];
