//! Places positions of sources in the city's coordinate system.
//!
//! The city's system, the world, is projected, in metres, with heights above sea level. It is the first such system
//! that a source names, or that of `--crs`, or else the zone of UTM of the first position. Sources in the same system
//! pass unchanged; other positions are projected one by one. Heights above the ellipsoid become heights above sea level
//! by the geoid model of the world's vertical datum. Heights of different vertical datums are not converted.

mod earth;
mod first_shape;
mod input;
mod likely;
mod mesh_extent;
mod national;
mod order;
#[cfg(test)]
mod tests;
mod transform;
mod world;

pub use earth::degrees_per_metre;
pub use first_shape::{FirstShape, is_on_globe, width_deg};
use input::SourceInput;
use insula_source::error::InputError;
use insula_source::object::CrsReference;
use insula_source::problems::INEXACT;
use insula_source::report::SourceReport;
pub use mesh_extent::MeshExtent;
pub use order::{AxisOrders, AxisRule};
use std::sync::Arc;
use transform::Transform;
pub use world::World;

/// Positions farther away are faults: the Earth's circumference is 4e7 m.
const MAX_COORDINATE_M: f64 = 1e9;

/// How positions of a source become positions of the world.
#[derive(Debug, Clone)]
pub enum Placement {
    /// The place is unknown: positions are metres, and pass unchanged.
    Unknown,
    /// The source has a system.
    Known(Arc<Placed>),
}

/// The placement of a source with a system.
#[derive(Debug, Clone)]
pub struct Placed {
    reference: CrsReference,
    source_crs: String,
    warnings: Vec<String>,
    /// Kind and text of what was found of the order of the coordinates.
    finding: Option<(&'static str, String)>,
    /// Whether the coordinates were compared with the system.
    is_checked: bool,
    input: SourceInput,
    /// `None` until the world has a system.
    transform: Option<Transform>,
}

impl Placement {
    /// Whether this is the placement of a system as a source names it.
    pub fn is_of(&self, crs: &CrsReference) -> bool {
        matches!(self, Self::Known(placed) if placed.reference == *crs)
    }

    /// Notes the system in the report of its source, and what is known of its accuracy and its order.
    pub fn note_in(&self, report: &mut SourceReport) {
        report.crs = self.source_crs().map(str::to_owned);
        for warning in self.warnings() {
            report.problem(INEXACT, || warning.clone());
        }
        if let Some((kind, text)) = self.finding() {
            report.problem(kind, || text.clone());
        }
    }

    /// Name of the source's system, such as `EPSG:6697`; `None` if the place is unknown.
    pub fn source_crs(&self) -> Option<&str> {
        match self {
            Self::Unknown => None,
            Self::Known(placed) => Some(&placed.source_crs),
        }
    }

    /// What the user must know about the accuracy of the positions.
    pub fn warnings(&self) -> &[String] {
        match self {
            Self::Unknown => &[],
            Self::Known(placed) => &placed.warnings,
        }
    }

    /// Kind and text of what was found of the order of the coordinates.
    pub fn finding(&self) -> Option<&(&'static str, String)> {
        match self {
            Self::Unknown => None,
            Self::Known(placed) => placed.finding.as_ref(),
        }
    }

    /// Whether the map of the source is in feet.
    pub fn is_in_feet(&self) -> bool {
        matches!(self, Self::Known(placed) if placed.input.is_in_feet())
    }

    /// Metres in a unit of the source's heights.
    pub fn height_unit_m(&self) -> f64 {
        match self {
            Self::Unknown => 1.0,
            Self::Known(placed) => placed.input.height_unit_m,
        }
    }

    /// Whether [`Self::settle`] has nothing to do.
    pub fn is_settled(&self) -> bool {
        match self {
            Self::Unknown => true,
            Self::Known(placed) => placed.is_checked && placed.transform.is_some(),
        }
    }

    /// Whether positions are on Earth, but the world has no system yet: [`Self::settle`] must come before
    /// [`Self::position`].
    pub fn needs_world(&self) -> bool {
        matches!(self, Self::Known(placed) if placed.transform.is_none())
    }

    /// Compares the coordinates of the source, of which the first shape is given, with its system, and decides on their
    /// order. Gives the world a system, if it has none: the zone of UTM of the first position. Does nothing the second
    /// time. Fails if the coordinates contradict the system, or if a geoid grid is damaged.
    pub fn settle(&mut self, world: &mut World, label: &str, first: impl Into<FirstShape>) -> Result<(), InputError> {
        let Self::Known(placed) = self else { return Ok(()) };
        if placed.is_checked && placed.transform.is_some() {
            return Ok(());
        }
        let (first, placed) = (first.into(), Arc::make_mut(placed));
        if !std::mem::replace(&mut placed.is_checked, true) {
            let input = (&placed.input, placed.reference.order);
            let order = order::decide(label, &placed.source_crs, input, &first, world.order_facts())?;
            placed.finding = order.finding;
            if order.axes != placed.input.axes {
                placed.input.axes = order.axes;
                if placed.transform.is_some() {
                    // The warnings are there already.
                    placed.transform = world.transform(label, &placed.input, &mut Vec::new())?;
                }
            }
        }
        if placed.transform.is_some() {
            return Ok(());
        }
        if !world.is_settled() {
            let [x, y] = first.position;
            let Some(position_deg) = placed.input.degrees([x, y, first.third]) else { return Ok(()) };
            world.settle_utm(position_deg);
        }
        placed.transform = world.transform(label, &placed.input, &mut placed.warnings)?;
        Ok(())
    }

    /// Position in the world: metres east, north and up, heights above sea level. `p` has coordinates in the source's
    /// order and units. `None` if it is not finite or out of range, or if the projection fails there, or if the world
    /// has no system.
    #[inline]
    pub fn position(&self, p: [f64; 3]) -> Option<[f64; 3]> {
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
