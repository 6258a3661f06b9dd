//! Visible parts of polygons by subdivision of the page (Moldoveanu, "Algoritmul Warnock").
//!
//! A cell of the page has the polygons that may show in it, from the nearest to the farthest. A polygon covers the cell, is inside,
//! cuts its border, or is disjoint. The nearest one that covers the cell hides all that follow. A cell with few polygons is resolved
//! exactly: each polygon without those before it. Another cell is divided into four.

use crate::{
    convex::{Convex, PageRect},
    error::{DrawError, DrawStep, Progress, advance},
};
use rayon::prelude::*;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Cells with at most so many polygons are resolved.
const MAX_RESOLVED: usize = 40;
/// Cells are not divided below this side in units.
const MIN_SIDE: i32 = 1 << 10;
/// Cells are divided at the same time to this depth.
const PARALLEL_DEPTH: u32 = 4;

/// A polygon to draw.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct PagePolygon {
    pub(crate) shape: Convex,
    pub(crate) bounds: PageRect,
    /// Index of the scene's triangle.
    pub(crate) triangle: u32,
    /// Whether it hides what is behind.
    pub(crate) is_opaque: bool,
}

/// A visible part of a polygon.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct VisiblePart {
    /// Index of the polygon.
    pub(crate) polygon: u32,
    pub(crate) shape: Convex,
}

/// The visible parts of `polygons`, which are sorted from the nearest to the farthest, inside `frame`. Fails if there are more than
/// `max_parts`.
pub(crate) fn visible_parts(
    polygons: &[PagePolygon],
    frame: PageRect,
    max_parts: usize,
    progress: Progress<'_>,
) -> Result<Vec<VisiblePart>, DrawError> {
    let subdivision =
        Subdivision { polygons, max_parts, parts: AtomicUsize::new(0), done: AtomicUsize::new(0), progress };
    let all: Vec<u32> = (0..polygons.len() as u32).collect();
    subdivision.cell(&frame, &all, 0)
}

struct Subdivision<'a> {
    polygons: &'a [PagePolygon],
    max_parts: usize,
    parts: AtomicUsize,
    /// Cells of [`PARALLEL_DEPTH`].
    done: AtomicUsize,
    progress: Progress<'a>,
}

impl Subdivision<'_> {
    fn cell(&self, cell: &PageRect, above: &[u32], depth: u32) -> Result<Vec<VisiblePart>, DrawError> {
        if depth == PARALLEL_DEPTH {
            let done = self.done.fetch_add(1, Ordering::Relaxed) as f64;
            advance(self.progress, DrawStep::Subdivide, done / f64::from(1u32 << (2 * PARALLEL_DEPTH)))?;
        }
        let shown = self.shown(cell, above);
        if shown.len() <= MAX_RESOLVED || cell.side() < MIN_SIDE {
            let parts = self.resolve(cell, &shown);
            let all = self.parts.fetch_add(parts.len(), Ordering::Relaxed) + parts.len();
            return if all > self.max_parts {
                Err(DrawError::TooManyParts { limit: self.max_parts })
            } else {
                Ok(parts)
            };
        }
        let quarters = cell.quarters();
        let parts: Result<Vec<Vec<VisiblePart>>, DrawError> = if depth < PARALLEL_DEPTH {
            quarters.par_iter().map(|quarter| self.cell(quarter, &shown, depth + 1)).collect()
        } else {
            quarters.iter().map(|quarter| self.cell(quarter, &shown, depth + 1)).collect()
        };
        Ok(parts?.into_iter().flatten().collect())
    }

    /// The polygons in a cell up to the first one that covers it.
    fn shown(&self, cell: &PageRect, above: &[u32]) -> Vec<u32> {
        let mut shown = Vec::new();
        for &index in above {
            let polygon = &self.polygons[index as usize];
            if !polygon.bounds.overlaps(cell) || polygon.shape.misses(cell) {
                continue;
            }
            shown.push(index);
            if polygon.is_opaque && polygon.shape.covers(cell) {
                break;
            }
        }
        shown
    }

    fn resolve(&self, cell: &PageRect, shown: &[u32]) -> Vec<VisiblePart> {
        let mut parts = Vec::new();
        let mut nearer: Vec<(Convex, PageRect)> = Vec::with_capacity(shown.len());
        for &index in shown {
            let polygon = &self.polygons[index as usize];
            let Some(shape) = polygon.shape.clipped(cell) else { continue };
            let bounds = PageRect::of(&shape.points);
            let mut rest = vec![shape.clone()];
            for (other, other_bounds) in nearer.iter().filter(|(_, other)| other.overlaps(&bounds)) {
                let mut left = Vec::new();
                for part in rest {
                    if PageRect::of(&part.points).overlaps(other_bounds) {
                        part.subtract(other, &mut left);
                    } else {
                        left.push(part);
                    }
                }
                rest = left;
            }
            parts.extend(rest.into_iter().map(|shape| VisiblePart { polygon: index, shape }));
            if polygon.is_opaque {
                nearer.push((shape, bounds));
            }
        }
        parts
    }
}
