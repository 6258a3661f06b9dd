//! Places positions of sources in the city's coordinate system.
//!
//! The city's system, the world, is projected, in metres, with heights above sea level. It is the first such system
//! that a source names, or that of `--crs`, or else the zone of UTM of the first position. Sources in the same system
//! pass unchanged; other positions are projected one by one. Heights above the ellipsoid become heights above sea level
//! by the geoid model of the world's vertical datum. Heights of different vertical datums are not converted.

mod earth;
mod input;
mod national;
#[cfg(test)]
mod tests;
mod transform;
mod world;

use std::sync::Arc;

pub(crate) use world::World;

use super::object::CrsReference;
use crate::error::InputError;
use input::SourceInput;
use transform::Transform;

/// Positions farther away are faults: the Earth's circumference is 4e7 m.
const MAX_COORDINATE_M: f64 = 1e9;

/// How positions of a source become positions of the world.
#[derive(Debug, Clone)]
pub(crate) enum Placement {
    /// The place is unknown: positions are metres, and pass unchanged.
    Unknown,
    /// The source has a system.
    Known(Arc<Placed>),
}

/// The placement of a source with a system.
#[derive(Debug, Clone)]
pub(crate) struct Placed {
    reference: CrsReference,
    source_crs: String,
    warnings: Vec<String>,
    input: SourceInput,
    /// `None` until the world has a system.
    transform: Option<Transform>,
}

impl Placement {
    /// Whether this is the placement of a system as a source names it.
    pub(crate) fn is_of(&self, crs: &CrsReference) -> bool {
        matches!(self, Self::Known(placed) if placed.reference == *crs)
    }

    /// Name of the source's system, such as `EPSG:6697`; `None` if the place is unknown.
    pub(crate) fn source_crs(&self) -> Option<&str> {
        match self {
            Self::Unknown => None,
            Self::Known(placed) => Some(&placed.source_crs),
        }
    }

    /// What the user must know about the accuracy of the positions.
    pub(crate) fn warnings(&self) -> &[String] {
        match self {
            Self::Unknown => &[],
            Self::Known(placed) => &placed.warnings,
        }
    }

    /// Whether positions are on Earth, but the world has no system yet: [`Self::settle`] must come before
    /// [`Self::position`].
    pub(crate) fn needs_world(&self) -> bool {
        matches!(self, Self::Known(placed) if placed.transform.is_none())
    }

    /// Gives the world a system, if it has none: the zone of UTM of the first position, in coordinates of the source.
    /// Does nothing if the world has one, or if UTM is not defined there. Fails if a geoid grid is damaged.
    pub(crate) fn settle(&mut self, world: &mut World, label: &str, first: [f64; 3]) -> Result<(), InputError> {
        let Self::Known(placed) = self else { return Ok(()) };
        if placed.transform.is_some() {
            return Ok(());
        }
        if !world.is_settled() {
            let Some(position_deg) = placed.input.degrees(first) else { return Ok(()) };
            world.settle_utm(position_deg);
        }
        let placed = Arc::make_mut(placed);
        placed.transform = world.transform(label, &placed.input, &mut placed.warnings)?;
        Ok(())
    }

    /// Position in the world: metres east, north and up, heights above sea level. `p` has coordinates in the source's
    /// order and units. `None` if it is not finite or out of range, or if the projection fails there, or if the world
    /// has no system.
    #[inline]
    pub(crate) fn position(&self, p: [f64; 3]) -> Option<[f64; 3]> {
        if !p.iter().all(|coordinate| coordinate.abs() <= MAX_COORDINATE_M) {
            return None;
        }
        match self {
            Self::Unknown => Some(p),
            Self::Known(placed) => match &placed.transform {
                Some(Transform::Identity) => Some(p),
                Some(transform) => transform.position(&placed.input, p),
                None => None,
            },
        }
    }
}
