//! Answers questions about a whole city by rays: `points x directions -> visible or not`.
//!
//! | module | contents |
//! |---|---|
//! | `surface` | the tops of a city's cells, with their kinds and buildings |
//! | `kinds` | codes of cells in runs |
//! | `raster` | values of cells in rows along either axis |
//! | `sweep` | the lines of one direction over all cells; shadows of one light |
//! | `horizon` | the steepest slope before each cell of a line |
//! | `walls` | points on the walls of buildings |
//! | `clock`, `sun`, `rule` | times; positions of the sun; when it counts, and how much of it is asked for |
//! | `probable` | what hours count: themselves, or shares of probable sunlight |
//! | `light`, `tally` | what many positions of a light reach; what is counted of it |
//! | `sun_hours` | hours of sun by a rule |
//! | `sky` | sky view factors, vertical sky components |
//! | `solar`, `weather` | irradiation of a year, without clouds or with the weather of a file |
//! | `view_shed` | the places that are visible from a point |
//! | `rays`, `points` | the same for given points, by rays against the finest triangles |
//! | `eye` | eyes that are inside of a building or below the ground |
//! | `evidence`, `canvas` | what a point sees of the sky, as a picture |
//! | `sight`, `vista` | lines of sight between points; what breaks into protected vistas |
//! | `proposal` | a surface with what is added and removed, and how far values change |
//! | `outlines`, `footprint` | polygons of places; what a model covers on the map |
//! | `buildings`, `gathered` | values of roofs and walls as a row for each building, also of a city that is computed part by part |

pub mod buildings;
mod canvas;
pub mod clock;
pub mod evidence;
pub mod eye;
mod footprint;
pub mod gathered;
mod horizon;
mod kinds;
mod light;
pub mod outlines;
pub mod points;
mod probable;
pub mod proposal;
mod raster;
pub mod rays;
pub mod rule;
pub mod sight;
pub mod sky;
pub mod solar;
pub mod sun;
pub mod sun_hours;
pub mod surface;
mod sweep;
mod tally;
#[cfg(test)]
mod test_surface;
pub mod view_shed;
pub mod vista;
pub mod walls;
pub mod weather;
