//! Roofs whose height depends on the distance across the ridge.

use super::RoofFault;
use super::outline::Outline;
use super::plan::{Plan, PlanPoint};
use super::rectangle::{Ridge, extent};

/// Distance of a saltbox's ridge from its short side, as a share of the width.
pub(super) const SALTBOX_RIDGE: f64 = 0.33;
/// Part of the height that the gables of a half-hipped roof keep.
pub(super) const HALF_HIP_RISE: f64 = 0.5;
/// A half-hip takes no more than this share of the ridge.
const MAX_HALF_HIP_SHARE: f64 = 0.4;

/// Heights across the ridge.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Profile {
    Gabled,
    HalfHipped,
    Saltbox,
    Skillion,
    Butterfly,
}

/// A roof between the outermost corners on both sides of the ridge.
pub(super) fn over(outline: &Outline, ridge: &Ridge, profile: Profile) -> Result<Plan, RoofFault> {
    let across = ridge.along.perp();
    let (low, high) = extent(&outline.rings[0], across);
    let width_m = high - low;
    if width_m.is_nan() || width_m <= 0.0 {
        return Err(RoofFault::Turn);
    }
    // From 0 on the right of the ridge to 1 on its left.
    let side = move |point: &PlanPoint| (point.at.dot(across) - low) / width_m;
    let mut plan = Plan::undivided(outline, |_| 0.0);
    let crease = match profile {
        Profile::Skillion => {
            plan.set_rise(side);
            return Ok(plan);
        }
        Profile::Gabled | Profile::HalfHipped | Profile::Butterfly => 0.5,
        Profile::Saltbox => SALTBOX_RIDGE,
    };
    plan.cut(|point| side(point) - crease)?;
    plan.set_rise(|point| (side(point) / crease).min((1.0 - side(point)) / (1.0 - crease)));
    match profile {
        Profile::Butterfly => plan.set_rise(|point| 1.0 - point.rise),
        Profile::HalfHipped => clip_ends(&mut plan, outline, ridge, width_m)?,
        _ => {}
    }
    Ok(plan)
}

/// Lowers both ends of a gabled roof to slopes as steep as the others.
fn clip_ends(plan: &mut Plan, outline: &Outline, ridge: &Ridge, width_m: f64) -> Result<(), RoofFault> {
    let (start, end) = extent(&outline.rings[0], ridge.along);
    let run_m = (width_m / 2.0 * (1.0 - HALF_HIP_RISE)).min(MAX_HALF_HIP_SHARE * (end - start));
    let slope = (1.0 - HALF_HIP_RISE) / run_m;
    if !slope.is_finite() {
        return Err(RoofFault::Turn);
    }
    let at_start = |point: &PlanPoint| HALF_HIP_RISE + slope * (point.at.dot(ridge.along) - start);
    let at_end = |point: &PlanPoint| HALF_HIP_RISE + slope * (end - point.at.dot(ridge.along));
    plan.cut(|point| at_start(point) - point.rise)?;
    plan.cut(|point| at_end(point) - point.rise)?;
    plan.set_rise(|point| point.rise.min(at_start(point)).min(at_end(point)));
    // The middle of the ridge may be outside of the outline.
    let highest = plan.points.iter().map(|point| point.rise).fold(f64::MIN_POSITIVE, f64::max);
    plan.set_rise(|point| point.rise / highest);
    Ok(())
}
