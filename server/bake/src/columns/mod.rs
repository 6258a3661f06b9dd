//! A node's columns: how they are merged from vertical lines, and how they become a V-BlockMap.
//!
//! | module | contents |
//! |---|---|
//! | `voxels` | the columns of a node in metres and linear light |
//! | `column_field` | the surface that V-BlockMaps draw |
//! | `deviation` | how far a node lies from the source |
//! | `clip` | vertical planes that end a column inside its cell |
//! | `merge` | one column from the vertical lines of a cell |
//! | `wall_fit` | the clip that fits a cell's lines and walls best |
//! | `thin_parents` | what is thin in a parent: masts, railings, cables |
//! | `object_votes` | which object a part of a column shows |
//! | `downsample` | a parent's columns from its children's |
//! | `coarser` | whether a node shows the same as its children |
//! | `fill` | appearance for voxels that no surfel reached |
//! | `code_gaps` | which gaps of a column are stored exactly, and which as rows of its wall |
//! | `parametrise` | height codes and texels of a `BlockMap` |
//! | `srgb` | 8-bit sRGB and linear light |

pub(crate) mod clip;
pub(crate) mod coarser;
mod code_gaps;
pub mod column_field;
pub(crate) mod deviation;
pub mod downsample;
pub(crate) mod fill;
pub(crate) mod merge;
pub(crate) mod object_votes;
pub mod parametrise;
pub(crate) mod srgb;
mod thin_parents;
pub mod voxels;
pub(crate) mod wall_fit;
