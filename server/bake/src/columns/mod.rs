//! Columns: voxels in metres, merged from vertical lines, clipped by walls, and encoded as V-BlockMaps.

pub(crate) mod clip;
pub mod lod;
pub(crate) mod merge;
pub mod parametrise;
pub mod voxels;
