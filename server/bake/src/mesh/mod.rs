//! Leaves' triangles in levels of detail.
//!
//! In: a block's scene and one of its leaves. Out: [`Lod`]s: mesh tiles with what a client must know of them. Next: `write`.
//!
//! `cut` clips triangles to the leaf's square, `lattice` puts them on the grid that all leaves share, `chain` makes fewer of
//! them, `distance` measures how far that went; `charts`, `atlas`, `picture` and `wire` make what they wear.
//!
//! What lies on the leaf's border is cut in the same way by both neighbours, lies on points that both have, and never moves:
//! so any two levels of detail of neighbours meet.

mod atlas;
mod chain;
mod charts;
mod cut;
mod distance;
mod lattice;
mod picture;
mod wire;

use insula_protocol::{TileId, blockmap::Quality, subtree::MeshLod};

use crate::{
    error::BakeError,
    scene::{Scene, grid::CityGrid},
};

/// Raised whenever the same scene and settings would give other meshes than before.
pub const ALGORITHM: u32 = 3;

/// A finished level of detail.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Lod {
    pub(crate) info: MeshLod,
    pub(crate) bytes: Vec<u8>,
}

/// The leaf's levels of detail, the finest first; none where it has no surface, or only what is too small for its grid.
pub(crate) fn leaf(scene: &Scene, grid: &CityGrid, id: TileId, quality: Quality) -> Result<Vec<Lod>, BakeError> {
    match lattice::Surface::gather(scene, grid, id) {
        Some(surface) => chain::chain(scene, grid, id, &surface, quality),
        None => Ok(Vec::new()),
    }
}

#[cfg(test)]
mod tests;
