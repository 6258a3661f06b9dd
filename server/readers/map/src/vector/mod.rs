//! GIS vector formats: GeoJSON, FlatGeobuf, GeoPackage, Shapefile, GeoParquet, and CSV with well-known text.
//!
//! All give features with attributes and a geometry; what those become is the same for all of them. A level polygon is an
//! area on the map; polygons that are not level, multipatches, TINs and polyhedral surfaces are surfaces in space; lines are
//! strips; points stay points. Arcs are divided into short lines.
//!
//! Overture: parts of buildings have their building as parent. A building whose parts are in the input too is left to the
//! sink, which knows both.

mod csv;
mod feature;
mod flatgeobuf;
mod geojson;
mod geometry;
#[cfg(feature = "sqlite")]
mod geopackage;
#[cfg(feature = "parquet")]
mod geoparquet;
mod layer;
mod local;
mod rings;
mod shape;
mod shapefile;
#[cfg(test)]
mod tests;
mod told;
mod wkb;
mod wkt;

pub use csv::read as read_csv;
pub use flatgeobuf::read as read_flatgeobuf;
pub use geojson::{is_type as is_geojson, read as read_geojson, read_type};
#[cfg(feature = "sqlite")]
pub use geopackage::read as read_geopackage;
#[cfg(feature = "parquet")]
pub use geoparquet::read as read_geoparquet;
#[cfg(not(all(feature = "parquet", feature = "sqlite")))]
use insula_source::{error::InputError, input::Input, object::ObjectSink};
pub use shapefile::read as read_shapefile;

/// Fails: SQLite is left out of this program.
#[cfg(not(feature = "sqlite"))]
pub fn read_geopackage(input: &Input<'_>, _: &mut dyn ObjectSink) -> Result<(), InputError> {
    Err(InputError::left_out(input.label, "sqlite"))
}

/// Fails: Parquet is left out of this program.
#[cfg(not(feature = "parquet"))]
pub fn read_geoparquet(input: &Input<'_>, _: &mut dyn ObjectSink) -> Result<(), InputError> {
    Err(InputError::left_out(input.label, "parquet"))
}
