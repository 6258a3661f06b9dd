//! Simplification within a distance that is measured, in both directions.

use super::{Goal, Simplified, simplify};
use crate::model::TriangleModel;
use crate::surface::Surface;

/// Points on a surface that tell its distance from another one, besides the vertices.
const SAMPLES: usize = 200_000;
/// A measured distance fits if it is at most this part of the limit: points between the samples may lie further away.
const FITS: f64 = 0.95;
/// Simplifications of [`simplify_within`] until the best one is taken.
const MAX_ATTEMPTS: usize = 8;
/// The search ends once the limits that fit and that do not are this close.
const CLOSE: f64 = 1.15;

/// Simplifies `model` as far as no point of either surface lies further than `limit` from the other one: measured at 200,000
/// points of each and all vertices. The error of the result is the measured distance.
///
/// The errors of collapses are root mean squares, which a single vertex may exceed several times. So the model is simplified with
/// smaller limits until the measured distance fits. If none does, only the repairs are made. `source` is the model's surface.
pub fn simplify_within(model: &TriangleModel, source: &Surface, limit: f64) -> Simplified {
    let (mut best, mut low, mut high): (Option<Simplified>, f64, f64) = (None, 0.0, f64::INFINITY);
    let mut goal = limit;
    for _ in 0..MAX_ATTEMPTS {
        let mut out = simplify(model, Goal { triangles: 0, error: goal }, |_| false);
        out.error = largest_distance(source, &out.model);
        let ratio = out.error / limit;
        if out.error <= limit * FITS {
            low = goal;
            if best.as_ref().is_none_or(|best| out.model.triangles.len() < best.model.triangles.len()) {
                best = Some(out);
            }
        } else {
            high = goal;
        }
        if low >= limit || high <= low * CLOSE || high == 0.0 {
            break;
        }
        goal = if low == 0.0 { goal * (0.9 / ratio).min(0.7) } else { (low * high).sqrt() };
    }
    best.unwrap_or_else(|| Simplified {
        error: 0.0,
        ..simplify(model, Goal { triangles: usize::MAX, error: 0.0 }, |_| false)
    })
}

/// The larger one of the largest distances of both surfaces from each other: the Hausdorff distance. Infinite if nothing is left.
pub fn largest_distance(source: &Surface, model: &TriangleModel) -> f64 {
    let Some(result) = Surface::of_model(model) else { return f64::INFINITY };
    source.largest_distance(&result, SAMPLES).max(result.largest_distance(source, SAMPLES))
}
