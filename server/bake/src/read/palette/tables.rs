//! Built-in colours: measured or plausible albedos of weathered materials, as 8-bit sRGB.
//!
//! In linear light plaster reflects about half, a flat roof a third, tiles and brick a fifth, asphalt a seventh.

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

/// Ground under and between buildings.
pub(super) const GROUND: [u8; 3] = [137, 134, 128];
const WATER: [u8; 3] = [52, 78, 84];
const VEGETATION: [u8; 3] = [84, 102, 62];
const ROAD: [u8; 3] = [110, 110, 110];
const CONCRETE: [u8; 3] = [168, 165, 158];
const METAL: [u8; 3] = [132, 134, 136];

/// Surfaces by their semantics in CityJSON.
pub(super) const SURFACES: &[(&str, Part)] = &[
    ("RoofSurface", Roof),
    ("OuterFloorSurface", Fixed([160, 158, 152])),
    ("WallSurface", Wall),
    ("InteriorWallSurface", Wall),
    ("GroundSurface", Fixed(GROUND)),
    ("FloorSurface", Fixed([160, 158, 152])),
    ("OuterCeilingSurface", Fixed(CONCRETE)),
    ("CeilingSurface", Fixed(CONCRETE)),
    ("ClosureSurface", Wall),
    ("Window", Fixed([88, 100, 110])),
    ("Door", Fixed([112, 92, 74])),
    ("WaterSurface", Fixed(WATER)),
    ("WaterGroundSurface", Fixed([96, 98, 92])),
    ("WaterClosureSurface", Fixed(WATER)),
    ("TrafficArea", Fixed(ROAD)),
    ("AuxiliaryTrafficArea", Fixed([132, 130, 122])),
    ("TransportationMarking", Fixed([192, 190, 184])),
    ("TransportationHole", Fixed([84, 84, 84])),
];

/// Objects by their type in CityJSON.
pub(super) const OBJECTS: &[(&str, Part)] = &[
    ("Building", Shell),
    ("BuildingPart", Shell),
    ("BuildingInstallation", Shell),
    ("BuildingConstructiveElement", Shell),
    ("BuildingFurniture", Fixed([150, 142, 130])),
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
    ("GenericCityObject", Fixed([170, 167, 160])),
    ("LandUse", Fixed([134, 132, 112])),
    ("OtherConstruction", Fixed(CONCRETE)),
    ("PlantCover", Fixed([92, 110, 68])),
    ("Railway", Fixed([116, 110, 104])),
    ("Road", Fixed(ROAD)),
    ("SolitaryVegetationObject", Fixed(VEGETATION)),
    ("TINRelief", Fixed([137, 135, 120])),
    ("TransportSquare", Fixed([142, 140, 134])),
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
pub(super) const OTHER: Part = Fixed([170, 167, 160]);

/// Materials by name, as in OpenStreetMap's `building:material` and `roof:material`.
pub(super) const MATERIALS: &[(&str, [u8; 3])] = &[
    ("asphalt", [100, 100, 102]),
    ("brick", [152, 106, 86]),
    ("concrete", CONCRETE),
    ("copper", [112, 142, 126]),
    ("glass", [104, 118, 126]),
    ("grass", [96, 114, 70]),
    ("metal", METAL),
    ("plaster", [199, 196, 189]),
    ("roof_tiles", [149, 97, 80]),
    ("sandstone", [188, 168, 136]),
    ("slate", [92, 96, 102]),
    ("stone", [164, 158, 148]),
    ("tar_paper", [88, 88, 90]),
    ("wood", [142, 114, 86]),
];

/// Tones of rendered walls: lime white, cream, sand, cool grey.
pub(super) const PLASTER_WALLS: [[u8; 3]; 4] = [[199, 196, 189], [201, 191, 171], [193, 180, 158], [186, 187, 185]];
/// Tones of brick walls.
pub(super) const BRICK_WALLS: [[u8; 3]; 4] = [[152, 106, 86], [160, 120, 98], [140, 98, 84], [170, 142, 116]];
/// Tones of concrete walls.
pub(super) const CONCRETE_WALLS: [[u8; 3]; 4] = [[168, 165, 158], [178, 175, 168], [158, 159, 160], [184, 181, 176]];
/// Tiled roofs.
pub(super) const TILED_ROOF: [u8; 3] = [149, 97, 80];
/// Flat roofs: bitumen with gravel. They do not vary: in a city of flat roofs that would cost bytes and show little.
pub(super) const FLAT_ROOF: [u8; 3] = [160, 160, 157];
/// Roofs of halls: sheet metal.
pub(super) const HALL_ROOF: [u8; 3] = METAL;
