//! Affine maps of space as glTF and 3D Tiles write them.

use glam::{DAffine3, DMat3, DMat4, DVec3};

/// From z up to y up: the map of 3D Tiles 1.1, section "glTF transforms", backwards.
pub(crate) const Y_UP: DAffine3 =
    DAffine3 { matrix3: DMat3::from_cols(DVec3::X, DVec3::NEG_Z, DVec3::Y), translation: DVec3::ZERO };

/// Sixteen numbers, column by column. No zero has a sign.
pub(crate) fn numbers_of(map: DAffine3) -> [f64; 16] {
    DMat4::from(map).to_cols_array().map(|v| v + 0.0)
}

/// Stretches space along its axes, and then moves it.
pub(crate) fn stretched(scale: impl Into<DVec3>, origin: impl Into<DVec3>) -> DAffine3 {
    DAffine3::from_mat3_translation(DMat3::from_diagonal(scale.into()), origin.into())
}
