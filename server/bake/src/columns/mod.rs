//! Columns: voxels in metres, merged from vertical lines, clipped by walls, and encoded as V-BlockMaps.

pub(crate) mod clip;
pub mod downsample;
pub(crate) mod fill;
pub(crate) mod merge;
pub mod parametrise;
pub(crate) mod srgb;
pub mod voxels;
pub(crate) mod wall_fit;
