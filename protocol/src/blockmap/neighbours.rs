//! Neighbouring columns, and the predictor that is shared by heights and colours.

use super::NODE_CELLS;

/// Width of a node's grid with a rim of empty cells, so that every cell has eight neighbours.
pub(super) const WIDTH: usize = NODE_CELLS + 2;

/// The index of column `i` in the grid with a rim.
pub(super) fn rim_index(i: usize) -> usize {
    (i / NODE_CELLS + 1) * WIDTH + i % NODE_CELLS + 1
}

/// The index of the column `[dx, dy]` cells from column `i`, if it lies in the node.
#[inline]
pub(super) fn neighbour(i: usize, [dx, dy]: [i32; 2]) -> Option<usize> {
    let n = NODE_CELLS as i32;
    let (x, y) = (i as i32 % n + dx, i as i32 / n + dy);
    ((0..n).contains(&x) && (0..n).contains(&y)).then_some((y * n + x) as usize)
}

/// The LOCO-I predictor from two neighbours `a` and `b` with `c` between them (Weinberger et al. 2000).
#[inline]
pub(super) fn median(a: i32, b: i32, c: i32) -> i32 {
    let (low, high) = if a < b { (a, b) } else { (b, a) };
    if c >= high {
        low
    } else if c <= low {
        high
    } else {
        a + b - c
    }
}
