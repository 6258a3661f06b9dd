//! Tests of roofs.

mod check;
mod faults;
mod known;
mod plans;
mod random;

use super::*;
use plans::Rings;

pub(super) const SHAPES: [RoofShape; 14] = [
    RoofShape::Flat,
    RoofShape::Gabled,
    RoofShape::HalfHipped,
    RoofShape::Hipped,
    RoofShape::Pyramidal,
    RoofShape::Cone,
    RoofShape::Skillion,
    RoofShape::Gambrel,
    RoofShape::Mansard,
    RoofShape::Round,
    RoofShape::Dome,
    RoofShape::Onion,
    RoofShape::Saltbox,
    RoofShape::Butterfly,
];

/// A roof from 3 to 7 m over a floor at 0.
fn spec(shape: RoofShape) -> RoofSpec {
    RoofSpec { shape, base_m: 0.0, eaves_m: 3.0, top_m: 7.0, direction_deg: None, orientation: None }
}

/// Builds a roof and checks its surface. Returns it with its volume.
fn build_checked(rings: &Rings, spec: &RoofSpec) -> (Vec<Surface>, f64) {
    let surfaces = build(rings, spec).unwrap_or_else(|fault| panic!("{spec:?} over {rings:?}: {fault}"));
    if surfaces.len() < 100 {
        assert_eq!(check::check_no_t_junction(&surfaces, 1e-7), Ok(()), "{spec:?} over {rings:?}");
    }
    match check::check(rings, spec, &surfaces, 1e-5) {
        Ok(volume) => (surfaces, volume),
        Err(what) => panic!("{spec:?} over {rings:?}: {what}"),
    }
}
