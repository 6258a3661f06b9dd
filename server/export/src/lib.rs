//! Writes a baked city, or a part of it, in the formats of other programs.
//!
//! | module | contents |
//! |---|---|
//! | `camera` | cameras as in the files of the viewer |
//! | `changes` | what was built, demolished and changed between two cities |
//! | `cityjson` | CityJSON text sequences |
//! | `column_surfaces` | triangles of columns, for nodes without a mesh |
//! | `file`, `format` | the entry of all exports of one file; its formats |
//! | `glb` | GLB files, with identities and attributes of objects |
//! | `land_surface` | land as a surface with few triangles, in place of steps of columns |
//! | `leaves` | the meshes of a city, leaf by leaf |
//! | `raster` | the tops of cells; heights and other values of cells as GeoTIFF |
//! | `rings` | areas of rings, and rings without what is smaller than their precision |
//! | `selection` | which part of a city an export has |
//! | `source` | what an export reads: tiles and objects of a city |
//! | `table` | objects with footprints as CSV, GeoJSON, GeoParquet and FlatGeobuf |
//! | `tiles3d` | 3D Tiles, with an implicit quadtree or all tiles listed |

mod boxes;
pub mod camera;
pub mod changes;
mod cityjson;
mod column_surfaces;
pub mod file;
pub mod format;
mod geometry;
pub mod glb;
mod land_surface;
pub mod leaves;
mod matrix;
pub mod raster;
pub mod rings;
pub mod selection;
pub mod source;
pub mod table;
pub mod tiles3d;
