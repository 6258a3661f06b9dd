//! Joins the visible parts of surfaces to shapes: the union of those of one object and colour.

use crate::{
    convex::{PagePoint, cross},
    error::{DrawError, DrawProgress, DrawStep, advance},
};
use i_overlay::{
    core::{
        fill_rule::FillRule,
        overlay::{IntOverlayOptions, Overlay, ShapeType},
        overlay_rule::OverlayRule,
        solver::Solver,
    },
    i_shape::int::shape::IntShapes,
};
use rayon::prelude::*;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Points this near to the line between their neighbours are left out, in units. Cells of the subdivision leave such points.
const TIDY_UNITS: f64 = 2.0;

/// Closed rings: outer ones counter-clockwise, holes clockwise.
pub(crate) type Rings = Vec<Vec<PagePoint>>;

/// The union of each group of rings. Fails if it is stopped.
pub(crate) fn unions(groups: Vec<Rings>, progress: DrawProgress<'_>) -> Result<Vec<Rings>, DrawError> {
    let (count, done) = (groups.len().max(1) as f64, AtomicUsize::new(0));
    groups
        .into_par_iter()
        .map(|rings| {
            let number = done.fetch_add(1, Ordering::Relaxed);
            if number % 64 == 0 {
                advance(progress, DrawStep::Join, number as f64 / count)?;
            }
            Ok(tidied(overlay(&rings, &Rings::new(), OverlayRule::Subject)))
        })
        .collect()
}

/// What is in `rings` and not in `holes`.
pub(crate) fn difference(rings: &Rings, holes: &Rings) -> Rings {
    tidied(overlay(rings, holes, OverlayRule::Difference))
}

fn overlay(subject: &Rings, clip: &Rings, rule: OverlayRule) -> IntShapes<i32> {
    let points = subject.iter().chain(clip).map(Vec::len).sum();
    let mut overlay = Overlay::new_custom(points, IntOverlayOptions::default(), Solver::default());
    for (rings, kind) in [(subject, ShapeType::Subject), (clip, ShapeType::Clip)] {
        rings.iter().for_each(|ring| overlay.add_contour(ring, kind));
    }
    overlay.overlay(rule, FillRule::NonZero)
}

fn tidied(shapes: IntShapes<i32>) -> Rings {
    shapes.into_iter().flatten().map(tidy).filter(|ring| !is_sliver(ring)).collect()
}

/// Twice the signed area of a ring in square units.
pub(crate) fn twice_area(ring: &[PagePoint]) -> i128 {
    let Some(first) = ring.first() else { return 0 };
    ring.windows(2).map(|pair| i128::from(cross(*first, pair[0], pair[1]))).sum()
}

fn distance(a: PagePoint, b: PagePoint) -> f64 {
    (f64::from(a.x) - f64::from(b.x)).hypot(f64::from(a.y) - f64::from(b.y))
}

/// Rings wider than `width` units. A ring is as wide as a strip of its area and length.
pub(crate) fn without_narrow(mut rings: Rings, width: f64) -> Rings {
    rings.retain(|ring| {
        let length: f64 = (0..ring.len()).map(|i| distance(ring[i], ring[(i + 1) % ring.len()])).sum();
        twice_area(ring).unsigned_abs() as f64 > width * length
    });
    rings
}

/// Whether a ring is no wider than rounding makes it.
fn is_sliver(ring: &[PagePoint]) -> bool {
    let length: f64 = (0..ring.len()).map(|i| distance(ring[i], ring[(i + 1) % ring.len()])).sum();
    ring.len() < 3 || twice_area(ring).unsigned_abs() as f64 <= 2.0 * TIDY_UNITS * length
}

/// The ring without points that are on the line between their neighbours. Of two neighbours, one pass removes one.
fn tidy(mut ring: Vec<PagePoint>) -> Vec<PagePoint> {
    loop {
        let count = ring.len();
        let mut kept = Vec::with_capacity(count);
        let mut was_removed = false;
        for i in 0..count {
            let [before, at, after] = [i + count - 1, i, i + 1].map(|j| ring[j % count]);
            let is_last_beside_removed = i + 1 == count && kept.first() != ring.first();
            let is_on_line = cross(before, after, at).unsigned_abs() as f64 <= TIDY_UNITS * distance(before, after);
            was_removed = !was_removed && !is_last_beside_removed && is_on_line;
            if !was_removed {
                kept.push(at);
            }
        }
        if kept.len() == count || kept.len() < 3 {
            return kept;
        }
        ring = kept;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square(x: i32, y: i32, side: i32) -> Vec<PagePoint> {
        [[x, y], [x + side, y], [x + side, y + side], [x, y + side]].map(|[x, y]| PagePoint::new(x, y)).to_vec()
    }

    #[test]
    fn cells_of_one_object_become_one_ring() {
        let cells: Rings = (0..9).map(|i| square(1000 * (i % 3), 1000 * (i / 3), 1000)).collect();
        let joined = unions(vec![cells], &|_, _| true).unwrap();
        assert_eq!(joined[0].len(), 1);
        assert_eq!((joined[0][0].len(), twice_area(&joined[0][0])), (4, 18_000_000));
        let gap = vec![square(0, 0, 1000), square(1000, 0, 1000)];
        let frame = difference(&vec![square(0, 0, 3000)], &vec![square(1000, 1000, 1000)]);
        assert_eq!(frame.len(), 2);
        assert_eq!(unions(vec![gap], &|_, _| true).unwrap()[0].len(), 1);
    }
}
