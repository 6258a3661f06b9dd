//! Holes that are filled.

use super::super::super::facts::RasterSize;
use super::super::holes;
use super::assert_heights;

/// A plane with a hole, filled. Returns the largest error, and the number of cells without a height.
fn filled(side: usize, hole: usize, max_gap: usize) -> (f32, usize) {
    let size = RasterSize { width: side as u32, height: side as u32 };
    let plane = |i: usize| (i % side) as f32 * 0.1 + (i / side) as f32 * 0.05;
    let hole = 17..17 + hole;
    let is_hole = |i: usize| hole.contains(&(i % side)) && hole.contains(&(i / side));
    let heights = (0..side * side).map(|i| if is_hole(i) { f32::NAN } else { plane(i) }).collect();
    let filled = holes::fill(heights, size, max_gap);
    let error = |(i, height): (usize, &f32)| if height.is_nan() { 0.0 } else { (height - plane(i)).abs() };
    let worst = filled.iter().enumerate().map(error).fold(0.0, f32::max);
    (worst, filled.iter().filter(|height| height.is_nan()).count())
}

#[test]
fn planes_stay_planes() {
    for (side, hole) in [(40, 1), (40, 2), (100, 10), (100, 40), (200, 60), (200, 120), (400, 240)] {
        let (worst, missing) = filled(side, hole, hole);
        // The plane rises by 0.15 of the hole's width from corner to corner.
        assert!(missing == 0 && worst < 0.003 * hole as f32, "{hole} {worst}");
    }
}

#[test]
fn wide_holes_stay() {
    assert_eq!(filled(60, 21, 20), (0.0, 21 * 21));
}

#[test]
fn only_gaps_between_known_cells_are_filled() {
    let size = RasterSize { width: 6, height: 3 };
    let n = f32::NAN;
    // Not the corner, and not what is beside the last column.
    let heights = vec![n, 1.0, n, n, 1.0, n, 1.0, 1.0, n, n, 1.0, n, 1.0, 1.0, 1.0, n, 1.0, n];
    let expected = [n, 1.0, 1.0, 1.0, 1.0, n, 1.0, 1.0, 1.0, 1.0, 1.0, n, 1.0, 1.0, 1.0, 1.0, 1.0, n];
    assert_heights(&holes::fill(heights.clone(), size, 2), &expected);
    // A gap of the last row only.
    let expected = [n, 1.0, n, n, 1.0, n, 1.0, 1.0, n, n, 1.0, n, 1.0, 1.0, 1.0, 1.0, 1.0, n];
    assert_heights(&holes::fill(heights, size, 1), &expected);
}

#[test]
fn grids_without_heights() {
    let size = RasterSize { width: 3, height: 2 };
    assert_heights(&holes::fill(vec![f32::NAN; 6], size, 9), &[f32::NAN; 6]);
}

#[test]
fn filled_heights_are_between_those_of_the_rim() {
    // A row of lines of different length.
    for side in [5_usize, 16, 33] {
        let size = RasterSize { width: side as u32, height: side as u32 };
        let known = |i: usize| i.is_multiple_of(side) || (i + 1).is_multiple_of(side) || i % 7 == 3;
        let heights = (0..side * side).map(|i| if known(i) { (i % 5) as f32 } else { f32::NAN }).collect();
        let filled = holes::fill(heights, size, side);
        assert!(filled.iter().all(|height| (0.0..=4.0).contains(height)), "{filled:?}");
    }
}
