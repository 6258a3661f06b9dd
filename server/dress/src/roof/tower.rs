//! Roofs of scaled outlines around a centre: pyramids, domes and onions.

use super::plan::{Plan, PlanPoint};
use super::{Outline, RoofFault, gables};
use glam::DVec2;

/// The centre is at least this share of the wall's distance from the corners inside of each wall's line.
const SIGHT_SINE: f64 = 1e-3;

/// A scaled outline: scale and height, from 0 to 1. The apex at height 1 is not one of them.
pub(super) type Step = (f64, f64);

pub(super) const PYRAMID: &[Step] = &[];

/// An onion dome, which is widest at a quarter of its height.
pub(super) const ONION: &[Step] = &[
    (1.12, 0.06),
    (1.22, 0.14),
    (1.25, 0.24),
    (1.18, 0.35),
    (1.0, 0.46),
    (0.72, 0.57),
    (0.44, 0.68),
    (0.22, 0.79),
    (0.08, 0.9),
];

/// A half of an ellipsoid.
pub(super) fn dome(steps: usize) -> Vec<Step> {
    let angle = |i: usize| std::f64::consts::FRAC_PI_2 * i as f64 / steps as f64;
    (1..steps).map(|i| (libm::cos(angle(i)), libm::sin(angle(i)))).collect()
}

/// A roof from the outline over the steps to an apex above the centroid. If the centroid does not see all walls, a hipped
/// roof.
pub(super) fn over(outline: &Outline, steps: &[Step]) -> Result<Plan, RoofFault> {
    let Some(centre) = seeing_centre(outline) else { return gables::hipped(outline) };
    let corners = &outline.rings[0];
    let count = corners.len();
    let mut points: Vec<PlanPoint> = corners.iter().map(|&at| PlanPoint { at, rise: 0.0 }).collect();
    for (scale, rise) in steps {
        points.extend(corners.iter().map(|&at| PlanPoint { at: centre + (at - centre) * *scale, rise: *rise }));
    }
    let apex = points.len();
    points.push(PlanPoint { at: centre, rise: 1.0 });
    let mut faces = Vec::with_capacity(count * (steps.len() + 1));
    for step in 0..steps.len() {
        let number = |i: usize| step * count + i % count;
        faces
            .extend((0..count).map(|i| vec![vec![number(i), number(i + 1), number(i + 1) + count, number(i) + count]]));
    }
    let last = steps.len() * count;
    faces.extend((0..count).map(|i| vec![vec![last + i, last + (i + 1) % count, apex]]));
    let is_overhanging = steps.iter().any(|(scale, _)| *scale > 1.0);
    Ok(Plan { points, faces, is_overhanging })
}

/// The centroid, if it is inside of each wall's line.
fn seeing_centre(outline: &Outline) -> Option<DVec2> {
    let [ring] = &outline.rings[..] else { return None };
    let mut sum = DVec2::ZERO;
    let first = ring[0];
    for pair in ring.windows(2) {
        let [a, b] = [pair[0] - first, pair[1] - first];
        sum += (a + b) * a.perp_dot(b);
    }
    let centre = first + sum / (6.0 * outline.area_m2);
    let does_see =
        |(a, b): (DVec2, DVec2)| (b - a).perp_dot(centre - a) > SIGHT_SINE * (b - a).length() * a.distance(centre);
    super::simple::edges(ring).all(does_see).then_some(centre)
}
