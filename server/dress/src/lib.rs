//! What plans and attributes look like: polygons, roofs, heights, colours, and the painted ground.

pub mod alpha_mask;
pub mod building_base;
pub mod counted_float;
pub mod facade;
pub mod footprint;
pub mod image_cut;
pub mod map_store;
pub mod paint;
pub mod palette;
pub mod polygon;
pub mod roof;
pub mod world_triangle;
