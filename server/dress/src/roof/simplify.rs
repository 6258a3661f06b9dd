//! Walls of an outline: runs of edges that are straight but for the precision of the data.

use super::{Outline, simple};
use glam::DVec2;

/// Corners nearer than this to a wall's line are on it.
const STRAIGHT_M: f64 = 0.01;
/// Corners that turn by more than this are no part of a straight wall.
const STRAIGHT_DEG: f64 = 3.0;

/// A straight wall between two corners of a ring.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Side {
    pub(super) from: usize,
    pub(super) to: usize,
    /// Corners between the ends that are nearly on the line.
    pub(super) between: Vec<usize>,
    /// Numbers of the neighbouring sides.
    pub(super) previous: usize,
    pub(super) next: usize,
}

/// The sides of all rings in the order of their corners. With `is_exact`, every edge is a side.
pub(super) fn sides(outline: &Outline, is_exact: bool) -> Vec<Side> {
    let mut sides = Vec::new();
    for (ring, numbers) in outline.rings.iter().zip(outline.ring_numbers()) {
        let kept = if is_exact { (0..ring.len()).collect() } else { ends(ring) };
        let first = sides.len();
        for (i, &corner) in kept.iter().enumerate() {
            let to = kept[(i + 1) % kept.len()];
            let between = between(ring.len(), corner, to).map(|k| numbers[k]).collect();
            let [previous, next] = [first + (i + kept.len() - 1) % kept.len(), first + (i + 1) % kept.len()];
            sides.push(Side { from: numbers[corner], to: numbers[to], between, previous, next });
        }
    }
    sides
}

/// Indices between two corners of a ring.
fn between(count: usize, from: usize, to: usize) -> impl Iterator<Item = usize> {
    let steps = (to + count - from - 1) % count;
    (1..=steps).map(move |step| (from + step) % count)
}

/// Indices of the corners at which straight walls end.
fn ends(ring: &[DVec2]) -> Vec<usize> {
    let mut kept: Vec<usize> = (0..ring.len()).collect();
    while kept.len() > 3 {
        let count = kept.len();
        let candidates = (0..count).filter_map(|i| {
            let [before, corner, after] = [kept[(i + count - 1) % count], kept[i], kept[(i + 1) % count]];
            deviation(ring, before, corner, after).map(|deviation_m| (deviation_m, i))
        });
        match candidates.min_by(|a, b| a.0.total_cmp(&b.0)) {
            Some((_, i)) => kept.remove(i),
            None => break,
        };
    }
    kept
}

/// Distance of the farthest corner between two others from their line; `None` if `corner` is not on a straight wall between
/// them.
fn deviation(ring: &[DVec2], before: usize, corner: usize, after: usize) -> Option<f64> {
    let [a, b, c] = [before, corner, after].map(|i| ring[i]);
    let (u, v) = (b - a, c - b);
    if u.dot(v) <= libm::cos(STRAIGHT_DEG.to_radians()) * u.length() * v.length() {
        return None;
    }
    let distances = between(ring.len(), before, after).map(|i| simple::distance(a, c, ring[i]));
    let farthest_m = distances.fold(0.0, f64::max);
    (farthest_m <= STRAIGHT_M).then_some(farthest_m)
}
