//! Buildings of two cities that lie in one place: those of the later one by cells of the map, so that each of the earlier one meets only
//! its neighbours.

use super::shapes::{BuildingShape, BuildingShapes};
use crate::rings::twice_area;
use crate::table::ExportError;
use crate::table::grid::MapPoint;
use i_overlay::core::fill_rule::FillRule;
use i_overlay::core::overlay::{IntOverlayOptions, Overlay, ShapeType};
use i_overlay::core::overlay_rule::OverlayRule;
use i_overlay::core::solver::Solver;

/// Side of a cell in units of the map: 65 m where these are millimetres.
const CELL_SHIFT: u32 = 16;
/// Buildings over more cells are kept apart, and meet all others.
const MAX_CELLS: i64 = 256;
/// Neighbours share less than this of the smaller one, because walls are rounded and drawn twice.
const LEAST_SHARE: f64 = 0.1;
/// Points that are compared for each building, and besides. A building meets a few of some ten points; many upon each other meet all others.
const POINTS_OF_BUILDING: usize = 1000;
const POINTS_BESIDES: usize = 1_000_000;

/// Two buildings that overlap, as indices into the buildings of their cities.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct OverlapPair {
    pub(super) before: u32,
    pub(super) after: u32,
    /// The area that both cover, in square units of the map.
    pub(super) shared: f64,
    /// Their common area as a share of the area of both together.
    pub(super) overlap: f64,
}

/// All pairs that share more than neighbours do, by the number of the earlier building. Fails if so many lie upon each other that they
/// would take hours.
pub(super) fn overlapping(before: &BuildingShapes, after: &BuildingShapes) -> Result<Vec<OverlapPair>, ExportError> {
    let cells = BuildingCells::new(&after.all);
    let mut left = POINTS_OF_BUILDING * (before.all.len() + after.all.len()) + POINTS_BESIDES;
    let mut pairs = Vec::new();
    let mut near = Vec::new();
    for (number, shape) in (0u32..).zip(&before.all) {
        cells.near(shape, &mut near);
        for &other in &near {
            let later = &after.all[other as usize];
            if !touch(shape, later) {
                continue;
            }
            let points = before.rings(shape).chain(after.rings(later)).map(<[MapPoint]>::len).sum::<usize>();
            let Some(rest) = left.checked_sub(points) else {
                let reason = "too many of its buildings lie upon each other; choose a smaller area".to_owned();
                return Err(ExportError::TooLarge { format: "a comparison", reason });
            };
            left = rest;
            let shared = shared_area(before, shape, after, later);
            if shared > 0.0 && shared >= LEAST_SHARE * shape.area.min(later.area) {
                let overlap = shared / (shape.area + later.area - shared);
                pairs.push(OverlapPair { before: number, after: other, shared, overlap });
            }
        }
    }
    Ok(pairs)
}

/// The area that two buildings cover.
fn shared_area(before: &BuildingShapes, a: &BuildingShape, after: &BuildingShapes, b: &BuildingShape) -> f64 {
    // Most buildings stay as they are.
    if before.rings(a).eq(after.rings(b)) {
        return a.area;
    }
    let points = before.rings(a).chain(after.rings(b)).map(<[MapPoint]>::len).sum();
    let mut overlay = Overlay::new_custom(points, IntOverlayOptions::default(), Solver::default());
    before.rings(a).for_each(|ring| overlay.add_contour(ring, ShapeType::Subject));
    after.rings(b).for_each(|ring| overlay.add_contour(ring, ShapeType::Clip));
    let shared = overlay.overlay(OverlayRule::Intersect, FillRule::NonZero);
    0.5 * shared.iter().flatten().map(|ring| twice_area(ring) as f64).sum::<f64>()
}

fn touch(a: &BuildingShape, b: &BuildingShape) -> bool {
    (0..2).all(|k| a.bounds[0][k] < b.bounds[1][k] && b.bounds[0][k] < a.bounds[1][k])
}

/// Buildings by the cells that their bounds touch.
struct BuildingCells {
    /// A cell and the index of a building in it, sorted.
    places: Vec<([i32; 2], u32)>,
    /// Buildings over many cells.
    wide: Vec<u32>,
    count: u32,
}

impl BuildingCells {
    fn new(shapes: &[BuildingShape]) -> Self {
        let mut cells = Self { places: Vec::new(), wide: Vec::new(), count: shapes.len() as u32 };
        for (number, shape) in (0u32..).zip(shapes) {
            match cells_of(shape) {
                Some(own) => cells.places.extend(own.map(|cell| (cell, number))),
                None => cells.wide.push(number),
            }
        }
        cells.places.sort_unstable();
        cells
    }

    /// Fills a list with the indices of the buildings near one, ascending.
    fn near(&self, shape: &BuildingShape, near: &mut Vec<u32>) {
        near.clear();
        let Some(cells) = cells_of(shape) else {
            near.extend(0..self.count);
            return;
        };
        near.extend(&self.wide);
        for cell in cells {
            let first = self.places.partition_point(|(other, _)| *other < cell);
            near.extend(self.places[first..].iter().take_while(|(other, _)| *other == cell).map(|(_, number)| number));
        }
        near.sort_unstable();
        near.dedup();
    }
}

/// The cells that the bounds of a building touch; `None` if they are too many.
fn cells_of(shape: &BuildingShape) -> Option<impl Iterator<Item = [i32; 2]> + use<>> {
    let [low, high] = shape.bounds.map(|corner| corner.map(|v| v >> CELL_SHIFT));
    let count: i64 = [0, 1].map(|k| i64::from(high[k]) - i64::from(low[k]) + 1).iter().product();
    (count <= MAX_CELLS).then(move || (low[0]..=high[0]).flat_map(move |x| (low[1]..=high[1]).map(move |y| [x, y])))
}

#[cfg(test)]
mod tests {
    use super::super::test_shapes::city;
    use super::*;

    #[test]
    fn only_what_overlaps_is_a_pair() {
        // Beside each other, one half in another, and far away over many cells.
        let before = city(&[("a", [0, 0, 10, 10], 9), ("b", [10, 0, 20, 10], 9), ("c", [300, 0, 310, 10], 9)]);
        let after = city(&[("x", [0, 0, 10, 10], 9), ("y", [15, 0, 25, 10], 9), ("z", [305, -9000, 310, 9000], 9)]);
        let pairs = overlapping(&before, &after).unwrap();
        let found: Vec<_> = pairs.iter().map(|pair| (pair.before, pair.after, pair.shared / 1e6)).collect();
        assert_eq!(found, [(0, 0, 100.0), (1, 1, 50.0), (2, 2, 50.0)]);
        assert!((pairs[0].overlap - 1.0).abs() < 1e-9 && (pairs[1].overlap - 1.0 / 3.0).abs() < 1e-9);
    }

    #[test]
    fn buildings_over_many_cells_meet_all_others() {
        let large = city(&[("a", [0, 0, 9000, 9000], 9)]);
        let small = city(&[("x", [8000, 8000, 8010, 8010], 9), ("y", [9100, 0, 9110, 10], 9)]);
        assert!(cells_of(&large.all[0]).is_none());
        let found = |pairs: Vec<OverlapPair>| pairs.iter().map(|pair| [pair.before, pair.after]).collect::<Vec<_>>();
        assert_eq!(found(overlapping(&large, &small).unwrap()), [[0, 0]]);
        assert_eq!(found(overlapping(&small, &large).unwrap()), [[0, 0]]);
    }

    #[test]
    fn many_buildings_upon_each_other_are_refused() {
        let stack = |count: usize| city(&vec![("a", [0, 0, 10, 10], 9); count]);
        let pairs = overlapping(&stack(50), &stack(50)).unwrap();
        assert_eq!(pairs.len(), 2500, "the flats of a tower");
        let error = overlapping(&stack(3000), &stack(3000)).unwrap_err();
        assert!(error.to_string().contains("upon each other"), "{error}");
    }
}
