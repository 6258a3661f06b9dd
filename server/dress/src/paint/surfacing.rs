//! Surfaces of paths, roads and squares.

use crate::paint::material::PaintMaterial;
use serde::{Deserialize, Serialize};

/// Surface of a path, a road, a square or a pitch, if the source has one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum Surfacing {
    Asphalt,
    Concrete,
    /// Slabs and blocks with tight joints.
    Paving,
    /// Natural stone with wide joints.
    Setts,
    /// Gravel and water-bound surfaces.
    Gravel,
    Earth,
    Grass,
    Sand,
    Wood,
    /// Red artificial surfaces and clay.
    Clay,
}

impl Surfacing {
    /// By the value of `surface` in OpenStreetMap; `None` for values without a material, such as `paved`.
    #[must_use]
    pub fn of_tag(value: &str) -> Option<Self> {
        let first = value.split([';', ':']).next().unwrap_or_default().trim();
        Some(match first {
            "asphalt" | "chipseal" => Self::Asphalt,
            "concrete" => Self::Concrete,
            "paving_stones" | "bricks" | "brick" | "tiles" | "grass_paver" | "stone" => Self::Paving,
            "sett" | "cobblestone" | "unhewn_cobblestone" => Self::Setts,
            "gravel" | "fine_gravel" | "compacted" | "pebblestone" | "unpaved" | "rock" => Self::Gravel,
            "ground" | "dirt" | "earth" | "mud" | "woodchips" => Self::Earth,
            "grass" | "artificial_turf" => Self::Grass,
            "sand" => Self::Sand,
            "wood" => Self::Wood,
            "clay" | "tartan" | "rubber" => Self::Clay,
            _ => return None,
        })
    }

    /// The material that it is painted with.
    pub fn material(self) -> PaintMaterial {
        match self {
            Self::Asphalt => PaintMaterial::Asphalt,
            Self::Concrete => PaintMaterial::Concrete,
            Self::Paving => PaintMaterial::Paving,
            Self::Setts => PaintMaterial::Setts,
            Self::Gravel => PaintMaterial::Gravel,
            Self::Earth => PaintMaterial::Earth,
            Self::Grass => PaintMaterial::Grass,
            Self::Sand => PaintMaterial::Sand,
            Self::Wood => PaintMaterial::Wood,
            Self::Clay => PaintMaterial::Clay,
        }
    }
}
