//! A tile whose content is read.

use crate::gltf::z_up;
use glam::DMat4;
use insula_source::attributes::Attributes;
use insula_source::object::FeatureKind;

/// The direction that is up in glTF.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum UpAxis {
    X,
    Y,
    Z,
}

impl UpAxis {
    pub(super) fn new(name: Option<&str>) -> Self {
        match name {
            Some("X" | "x") => Self::X,
            Some("Z" | "z") => Self::Z,
            _ => Self::Y,
        }
    }

    pub(super) fn to_z_up(self, [x, y, z]: [f64; 3]) -> [f64; 3] {
        match self {
            Self::X => [-z, y, x],
            Self::Y => z_up([x, y, z]),
            Self::Z => [x, y, z],
        }
    }
}

/// A tile whose content is read.
#[derive(Debug, Clone)]
pub(super) struct Tile {
    /// Name of the file, or the place of a content within the tileset.
    pub(super) name: String,
    /// To the coordinates of the whole tileset.
    pub(super) transform: DMat4,
    pub(super) up: UpAxis,
    /// Metadata of the tile and its content.
    pub(super) attributes: Attributes,
    /// What the names of the files tell.
    pub(super) kind: Option<FeatureKind>,
}
