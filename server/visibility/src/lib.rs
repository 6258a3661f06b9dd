//! Potentially visible sets: which leaves can be seen from the streets of a city.
//!
//! From the V-BlockMaps of a baked city's nodes without children come, for each cell of the space where people walk and stand, the
//! leaves that an eye in it may see ([`CitySets`]). The bake writes them as visibility tiles.
//!
//! The sets are conservative: each has all visible leaves, and may have hidden ones.

mod cells;
mod height_scale;
mod heights;
mod row_tables;
mod settings;
mod shape;
mod sweep;
mod windows;

pub use cells::{CitySets, SWEEPS};
pub use heights::{CityExtent, MAX_LEAF_SQUARES, MIN_LEAF_M, NoSets};
pub use settings::Settings;
