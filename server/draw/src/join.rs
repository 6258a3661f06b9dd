//! Joins the visible parts of surfaces to shapes: the union of those of one object and colour.

use crate::convex::PagePoint;
use crate::error::{DrawError, DrawProgress, DrawStep, advance};
use i_overlay::core::fill_rule::FillRule;
use i_overlay::core::overlay::{IntOverlayOptions, Overlay, ShapeType};
use i_overlay::core::overlay_rule::OverlayRule;
use i_overlay::core::solver::Solver;
use i_overlay::i_shape::int::shape::IntShapes;
use insula_export::rings::{is_sliver, tidy};
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
    let tidied = shapes.into_iter().flatten().map(|ring| tidy(&ring, TIDY_UNITS)).collect();
    without_narrow(tidied, 2.0 * TIDY_UNITS)
}

/// Rings wider than `width` units. A ring is as wide as a strip of its area and length.
pub(crate) fn without_narrow(mut rings: Rings, width: f64) -> Rings {
    rings.retain(|ring| !is_sliver(ring, 0.0, width));
    rings
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_export::rings::twice_area;

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
