//! Writes a baked city, or a part of it, in the formats of other programs.
//!
//! | module | contents |
//! |---|---|
//! | `cityjson` | CityJSON text sequences |
//! | `raster` | heights as GeoTIFF |
//! | `selection` | which part of a city an export has |
//! | `glb` | GLB files, with identities and attributes of objects |
//! | `source` | what an export reads: tiles and objects of a city |
//! | `tiles3d` | 3D Tiles with an implicit quadtree |
//! | `table` | objects with footprints as CSV, GeoJSON, GeoParquet and FlatGeobuf; the entry of all exports of one file |

mod cityjson;
mod raster;
pub mod selection;
pub mod glb;
pub mod source;
pub mod tiles3d;
pub mod table;
