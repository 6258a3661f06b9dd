//! Triangles of height fields by ROAM (Duchaineau and others 1997, "ROAMing Terrain: Real-time Optimally Adapting
//! Meshes"): right isosceles triangles that are halved where the surface is too far from a sample.
//!
//! - `triangulate` makes the surface of a field in memory for one largest error. `Borders::survey` and
//!   `triangulate_region` make the same surface tile by tile from any source.
//! - `SampledTerrain` turns terrain that exists as triangles into a mesh for one view.
//!
//! All surfaces are closed: each edge has a triangle on both sides or lies on a border of the data, and no vertex lies
//! inside of an edge, between tiles too. A cell's half belongs to the surface if its three corners have data. Triangles
//! that cover both data and places without are halved down to the cells.
//!
//! Every sample is within the largest error of the surface, measured vertically and exactly: a triangle's error is the
//! largest distance of any sample in it, not an estimate from the middles of edges.

mod borders;
mod bounds;
mod deviation;
mod diamond;
mod field;
mod mesh;
mod sampled;
mod surface;
#[cfg(test)]
mod tests;
mod tile;
mod tiling;
mod view_surface;

pub use borders::Borders;
pub use diamond::Place;
pub use field::{HeightField, HeightSource};
pub use mesh::TerrainMesh;
pub use sampled::{ErrorScale, ROOT_STEPS, SampleGrid, SampledTerrain, TerrainFace, ViewMesh};
pub use surface::{TILE_STEPS, triangulate, triangulate_region};
pub use tiling::Tiling;
