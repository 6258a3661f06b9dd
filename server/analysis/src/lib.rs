//! Answers questions about a whole city by rays: `points x directions -> visible or not`.
//!
//! | module | contents |
//! |---|---|
//! | `surface` | the tops of a city's cells, with their kinds and buildings |
//! | `raster` | values of cells in rows along either axis |
//! | `sweep` | the lines of one direction over all cells; shadows of one light |
//! | `horizon` | the steepest slope before each cell of a line |
//! | `walls` | points on the walls of buildings |
//! | `sun`, `rule` | positions of the sun; when it counts, and how much of it is asked for |
//! | `sun_hours`, `tally` | hours of sun by a rule; what is counted of lit and dark moments |
//! | `sky` | sky view factors, vertical sky components |
//! | `view_shed` | the places that are visible from a point |
//! | `rays`, `points` | the same for given points, by rays against the finest triangles |
//! | `outlines` | polygons of places |
//! | `buildings` | values of roofs and walls as a row for each building |

pub mod buildings;
mod horizon;
pub mod outlines;
pub mod points;
mod raster;
pub mod rays;
pub mod rule;
pub mod sky;
pub mod sun;
pub mod sun_hours;
pub mod surface;
mod sweep;
mod tally;
#[cfg(test)]
mod test_surface;
pub mod view_shed;
pub mod walls;
