//! Reads rasters and elevation models, and makes ground of them.

pub mod elevation;
mod raster;
pub mod relax;

pub use raster::HEIGHTS_M;
