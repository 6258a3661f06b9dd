//! Options of places.

use crate::placement::AxisOrders;
use std::path::PathBuf;

/// Coordinate systems and places.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct PlacingOptions {
    /// The city's coordinate system, such as `EPSG:25832`; `None` for the first projected one of the sources.
    pub crs: Option<String>,
    /// Folder of geoid grids besides the one that is built in.
    pub grids: Option<PathBuf>,
    /// Longitude and latitude in degrees and height in metres of the origin of mesh files, which have no coordinate system.
    pub at: Option<[f64; 3]>,
    /// West, south, east and north in degrees: objects outside are left out.
    pub bbox_deg: Option<[f64; 4]>,
    /// The same in metres of the city's coordinate system, which a source may decide.
    pub bbox_m: Option<[f64; 4]>,
    /// Orders of coordinates where the user decides.
    pub axis_orders: AxisOrders,
    /// Whether `crs` was found in the sources, and is not that of sources that name none.
    pub is_crs_found: bool,
}
