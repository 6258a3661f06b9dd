//! Stones by name.

use super::definition::{BOTH_VEINS, Stone, StoneKind};

/// Names and stones. Colours are estimates from photographs of polished slabs and weathered statues, in linear light.
pub const PRESETS: [(&str, Stone); 9] = [
    ("carrara-marble", CARRARA),
    ("green-marble", GREEN),
    ("red-marble", RED),
    ("black-marble", BLACK),
    ("red-granite", RED_GRANITE),
    ("grey-granite", GREY_GRANITE),
    ("bronze", BRONZE),
    ("limestone", LIMESTONE),
    ("wood", WOOD),
];

const CARRARA: Stone = Stone {
    base: [0.78, 0.77, 0.745],
    kind: StoneKind::Marble as u32,
    vein: [0.27, 0.285, 0.31],
    cells_per_m: 1.0 / 0.3,
    grain: [0.13, 0.14, 0.155],
    octaves: 4,
    f0: [0.045; 3],
    alpha: [0.12; 2],
    vein_width: 0.07,
    veins: BOTH_VEINS,
    blend: [0.85, 0.6],
    variation: 0.35,
    bend: 0.5,
    // Measured for marble by Jensen and others (A Practical Model for Subsurface Light Transport, 2001, figure 5).
    scattering: [2.19, 2.62, 3.00],
    absorption: [0.0021, 0.0041, 0.0071],
    scattering_scale: 1.0,
    ..Stone::NONE
};

const GREEN: Stone = Stone {
    base: [0.022, 0.050, 0.036],
    vein: [0.070, 0.135, 0.095],
    grain: [0.52, 0.60, 0.53],
    cells_per_m: 1.0 / 0.3,
    scattering_scale: 0.0,
    alpha: [0.06; 2],
    vein_width: 0.09,
    blend: [0.9, 0.75],
    variation: 0.5,
    ..CARRARA
};

/// As Rosso Levanto: red and dark red clouds, few white veins.
const RED: Stone = Stone {
    base: [0.235, 0.052, 0.036],
    vein: [0.065, 0.017, 0.015],
    grain: [0.70, 0.60, 0.54],
    vein_width: 0.11,
    blend: [0.8, 0.7],
    ..GREEN
};

/// As Nero Marquina: black, with sharp white veins.
const BLACK: Stone = Stone {
    base: [0.0105, 0.0105, 0.0115],
    vein: [0.034, 0.034, 0.036],
    grain: [0.66, 0.65, 0.63],
    alpha: [0.05; 2],
    vein_width: 0.06,
    blend: [0.5, 0.85],
    ..GREEN
};

const RED_GRANITE: Stone = Stone {
    base: [0.42, 0.155, 0.105],
    kind: StoneKind::Granite as u32,
    vein: [0.36, 0.31, 0.28],
    cells_per_m: 1.0 / 0.012,
    grain: [0.022, 0.020, 0.020],
    octaves: 3,
    f0: [0.045; 3],
    alpha: [0.07; 2],
    blend: [0.28, 0.2],
    variation: 0.45,
    bend: 0.25,
    ..Stone::NONE
};

const GREY_GRANITE: Stone = Stone {
    base: [0.46, 0.455, 0.44],
    vein: [0.22, 0.225, 0.23],
    grain: [0.03, 0.03, 0.032],
    cells_per_m: 1.0 / 0.007,
    alpha: [0.15; 2],
    blend: [0.4, 0.24],
    ..RED_GRANITE
};

const BRONZE: Stone = Stone {
    base: [0.018, 0.012, 0.007],
    kind: StoneKind::Bronze as u32,
    vein: [0.135, 0.235, 0.185],
    cells_per_m: 1.0 / 0.35,
    grain: [0.045, 0.060, 0.042],
    octaves: 5,
    f0: [0.36, 0.225, 0.12],
    alpha: [0.22, 0.28],
    blend: [0.42, 0.4],
    variation: 0.5,
    bend: 0.3,
    ..Stone::NONE
};

const LIMESTONE: Stone = Stone {
    base: [0.58, 0.51, 0.385],
    kind: StoneKind::Limestone as u32,
    vein: [0.38, 0.30, 0.195],
    cells_per_m: 1.0 / 0.12,
    grain: [0.30, 0.25, 0.18],
    octaves: 4,
    f0: [0.04; 3],
    alpha: [0.5; 2],
    blend: [0.75, 0.8],
    variation: 0.4,
    bend: 0.2,
    ..Stone::NONE
};

/// As oak with a matt finish.
const WOOD: Stone = Stone {
    base: [0.45, 0.275, 0.14],
    kind: StoneKind::Wood as u32,
    vein: [0.20, 0.10, 0.042],
    cells_per_m: 1.0 / 0.1,
    grain: [0.27, 0.15, 0.068],
    octaves: 2,
    f0: [0.04; 3],
    alpha: [0.3, 0.4],
    blend: [0.85, 0.5],
    variation: 0.3,
    bend: 0.6,
    ..Stone::NONE
};

impl Stone {
    /// The stone of a name of [`PRESETS`].
    pub fn preset(name: &str) -> Option<Self> {
        PRESETS.iter().find(|(known, _)| *known == name).map(|(_, stone)| *stone)
    }
}
