//! Positions of a source to positions of the world.

use super::earth::Geodetic;
use super::input::{SourceInput, is_on_earth};
use crate::crs::System;
use crate::crs::geoid::Geoid;
use proj4rs::Proj;
use proj4rs::adaptors::transform_vertex_2d;
use std::sync::Arc;

/// Projected positions farther from the origin than this are faults.
const MAX_PROJECTED_M: f64 = 1e8;

/// What happens to a position.
#[derive(Debug, Clone)]
pub(super) enum Transform {
    /// Nothing, bit by bit.
    Identity,
    /// The order of axes and the units change.
    Reorder,
    /// The map changes, heights above sea level do not.
    Map { world: Arc<Proj> },
    /// Heights above the ellipsoid become heights above sea level. `map` is `None` if the map stays the same.
    Heights { map: Option<Arc<Proj>>, geoid: Arc<Geoid> },
    /// Positions in space go to the map.
    Space { world: Arc<Proj>, wgs84: Arc<Proj>, geoid: Arc<Geoid>, origin: Option<Geodetic> },
}

impl Transform {
    /// Position in the world; `None` if it is out of range, or if the projection fails there.
    pub(super) fn position(&self, input: &SourceInput, p: [f64; 3]) -> Option<[f64; 3]> {
        let [x, y, z] = match self {
            Self::Identity => p,
            Self::Reorder => {
                let [x, y] = input.plane_position(p);
                [x, y, height_m(input, p)]
            }
            Self::Map { world } => {
                let [x, y] = project(input, world, input.plane_position(p))?;
                [x, y, height_m(input, p)]
            }
            Self::Heights { map, geoid } => {
                let plane = input.plane_position(p);
                let mut on_earth = input.plane_to_wgs84(plane)?;
                on_earth.height_m = height_m(input, p);
                let [x, y] = match map {
                    Some(world) => project(input, world, plane)?,
                    None => plane,
                };
                [x, y, above_sea_m(geoid, on_earth)?]
            }
            Self::Space { world, wgs84, geoid, origin } => {
                let metres = p.map(|coordinate| coordinate * input.unit);
                let centre = origin.map_or(metres, |origin| origin.local_to_centre(metres));
                let on_earth = Geodetic::from_centre(centre)?;
                let (x, y) = transform_vertex_2d(wgs84, world, (on_earth.longitude_rad, on_earth.latitude_rad)).ok()?;
                [x, y, above_sea_m(geoid, on_earth)?]
            }
        };
        let is_valid = x.abs() <= MAX_PROJECTED_M && y.abs() <= MAX_PROJECTED_M && z.is_finite();
        is_valid.then_some([x, y, z])
    }
}

#[inline]
fn height_m(input: &SourceInput, p: [f64; 3]) -> f64 {
    if input.height_unit_m == 1.0 { p[2] } else { p[2] * input.height_unit_m }
}

fn project(input: &SourceInput, world: &Proj, [x, y]: [f64; 2]) -> Option<[f64; 2]> {
    if matches!(input.horizontal.system, System::Geographic { .. }) && !is_on_earth([x, y]) {
        return None;
    }
    let (x, y) = transform_vertex_2d(&input.plane.as_ref()?.source, world, (x, y)).ok()?;
    Some([x, y])
}

/// Height above sea level of a position with a height above the ellipsoid.
pub(super) fn above_sea_m(geoid: &Geoid, position: Geodetic) -> Option<f64> {
    let degrees = [position.longitude_rad.to_degrees(), position.latitude_rad.to_degrees()];
    Some(position.height_m - geoid.undulation_m(degrees[0], degrees[1])?)
}
