//! Reads GIS vector formats and OpenStreetMap.

pub mod osm;
pub mod vector;
