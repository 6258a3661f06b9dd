//! Coordinate systems, geoids, and the places of sources in the city.

pub mod crs;
pub mod earth_place;
pub mod local_frame;
mod mesh_shift;
mod options;
pub mod placement;

pub use options::PlacingOptions;
