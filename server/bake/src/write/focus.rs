//! The first view of a city: the area in which most of its buildings stand.

use crate::scene::grid::CityGrid;
use insula_objects::FeatureKind;

/// Boxes of objects are marked in a grid of at most this many levels: 512 cells along a side.
const MOST_LEVELS: u8 = 9;
/// A gap of this share of the extent, in which there is no leaf, divides a city: between its parts there is nothing to see.
const GAP_SHARE: f64 = 0.35;
/// Smaller gaps, in leaves, divide nothing: one sees both sides.
const MIN_GAP: u32 = 16;

/// The number of buildings and other standing objects whose bounding boxes touch each cell of a grid over the city. Terrain and land use do
/// not count: they may reach far beyond the buildings.
#[derive(Debug)]
pub(crate) struct Standing {
    /// From the scene's origin to the grid's corner.
    corner_m: [f64; 2],
    cell_m: f64,
    /// Cells along a side, a power of two.
    side: usize,
    /// From one leaf along a side to the number of its cell.
    shift: u8,
    /// For `side + 1` cells along a side: the numbers, or their differences along both axes until they are summed.
    counts: Vec<i64>,
}

impl Standing {
    /// An empty grid over a city.
    pub(crate) fn new(grid: &CityGrid) -> Self {
        let level = grid.depth.min(MOST_LEVELS);
        let side = 1 << level;
        let counts = vec![0; (side + 1) * (side + 1)];
        let (corner_m, cell_m) = ([grid.corner[0], grid.corner[1]], grid.node_side_m(level));
        Self { corner_m, cell_m, side, shift: grid.depth - level, counts }
    }

    /// Whether an object of this kind is seen from afar. What nothing is known of, as of meshes, may be a whole city.
    pub(crate) fn stands(kind: FeatureKind) -> bool {
        kind.is_of_building() || matches!(kind, FeatureKind::Bridge | FeatureKind::Generic)
    }

    /// Adds the box of an object: its lowest and highest corner relative to the scene's origin. The cost does not depend on its size.
    pub(crate) fn add(&mut self, bounds_m: [[f32; 3]; 2]) {
        let cell = |v_m: f32, axis: usize| {
            // A negative number becomes the first cell.
            let cell = ((f64::from(v_m) - self.corner_m[axis]) / self.cell_m) as usize;
            cell.min(self.side - 1)
        };
        let [low, high] = [0, 1].map(|end| [0, 1].map(|axis| cell(bounds_m[end][axis], axis) + end));
        let row = self.side + 1;
        for (x, y, change) in [(low[0], low[1], 1), (high[0], low[1], -1), (low[0], high[1], -1), (high[0], high[1], 1)]
        {
            self.counts[y * row + x] += change;
        }
    }

    /// Sums the differences, after the last object.
    pub(crate) fn finish(mut self) -> Self {
        let row = self.side + 1;
        for i in 0..self.counts.len() {
            let before = |reach: usize, is_there: bool| if is_there { self.counts[i - reach] } else { 0 };
            let (has_west, has_south) = (i % row > 0, i >= row);
            let sum = before(1, has_west) + before(row, has_south) - before(row + 1, has_west && has_south);
            self.counts[i] += sum;
        }
        self
    }

    /// The leaves where something stands, or all, if nothing does anywhere.
    fn only(&self, leaves: Vec<([u32; 2], u32)>) -> Vec<([u32; 2], u32)> {
        let is_built = |[x, y]: [u32; 2]| {
            let cell = (y >> self.shift) as usize * (self.side + 1) + (x >> self.shift) as usize;
            self.counts.get(cell).is_some_and(|count| *count > 0)
        };
        let built: Vec<_> = leaves.iter().copied().filter(|(leaf, _)| is_built(*leaf)).collect();
        if built.is_empty() { leaves } else { built }
    }
}

/// [`of_leaves`] of the leaves where something stands. `None` without leaves.
pub(super) fn of_city(leaves: Vec<([u32; 2], u32)>, standing: Option<&Standing>) -> Option<[[u32; 2]; 2]> {
    of_leaves(match standing {
        Some(standing) => standing.only(leaves),
        None => leaves,
    })
}

/// The leaves in the south-west and north-east corner of the rectangle between the first and the ninth decile of the leaves' bytes, along x
/// and along y. Of a city that is divided by wide gaps, only the part with most bytes counts. `None` without leaves.
fn of_leaves(mut leaves: Vec<([u32; 2], u32)>) -> Option<[[u32; 2]; 2]> {
    while let Some(part) = (0..2).find_map(|axis| heavier_part(&mut leaves, axis)) {
        leaves = part;
    }
    let mut ends = [[0; 2]; 2];
    for axis in 0..2 {
        leaves.sort_unstable_by_key(|(leaf, bytes)| (leaf[axis], *bytes));
        for (end, share) in ends.iter_mut().zip([0.1, 0.9]) {
            let wanted = share * weight(&leaves);
            let mut sum = 0.0;
            let found = leaves.iter().find(|(_, bytes)| {
                sum += f64::from(*bytes);
                sum >= wanted
            });
            end[axis] = found.or(leaves.last())?.0[axis];
        }
    }
    Some(ends)
}

/// The part before or after the widest gap along an axis, whichever has more bytes; `None` if no gap is wide.
fn heavier_part(leaves: &mut [([u32; 2], u32)], axis: usize) -> Option<Vec<([u32; 2], u32)>> {
    leaves.sort_unstable_by_key(|(leaf, _)| leaf[axis]);
    let at = |i: usize| leaves[i].0[axis];
    let after = (1..leaves.len()).max_by_key(|i| at(*i) - at(*i - 1))?;
    let (gap, extent) = (at(after) - at(after - 1), at(leaves.len() - 1) - at(0));
    if gap < MIN_GAP || f64::from(gap) < GAP_SHARE * f64::from(extent) {
        return None;
    }
    let (before, after) = leaves.split_at(after);
    Some(if weight(before) >= weight(after) { before } else { after }.to_vec())
}

fn weight(leaves: &[([u32; 2], u32)]) -> f64 {
    leaves.iter().map(|(_, bytes)| f64::from(*bytes)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The leaves of a square.
    fn square(corner: [u32; 2], side: u32, bytes: u32) -> Vec<([u32; 2], u32)> {
        (0..side * side).map(|i| ([corner[0] + i % side, corner[1] + i / side], bytes)).collect()
    }

    #[test]
    fn the_middle_four_fifths_are_seen_first() {
        assert_eq!(of_leaves(square([100, 200], 20, 7)), Some([[101, 201], [117, 217]]));
        assert_eq!(of_leaves(vec![([3, 4], 0)]), Some([[3, 4]; 2]));
        assert_eq!(of_leaves(Vec::new()), None);
    }

    #[test]
    fn land_beside_the_houses_is_not_seen_first() {
        // A heavy elevation model in the north-east, of one object; houses in the south-west, one over four leaves, and beside a road.
        let grid = CityGrid { corner: [-640.0, 100.0, 0.0], depth: 9, cell_m: 1.0 };
        let leaves = || [square([0, 0], 10, 5), square([200, 200], 100, 900)].concat();
        let marked = |objects: &[(FeatureKind, [f32; 4])]| {
            let mut standing = Standing::new(&grid);
            for (kind, [west, south, east, north]) in objects {
                if Standing::stands(*kind) {
                    standing.add([[west - 640.0, south + 100.0, 0.0], [east - 640.0, north + 100.0, 9.0]]);
                }
            }
            of_city(leaves(), Some(&standing.finish()))
        };
        let land = (FeatureKind::Relief, [12_800.0, 12_800.0, 19_200.0, 19_200.0]);
        let road = (FeatureKind::Road, [0.0, 0.0, 639.0, 639.0]);
        let house = (FeatureKind::Building, [130.0, 195.0, 200.0, 260.0]);
        assert_eq!(marked(&[land, road, house]), Some([[2, 3], [3, 4]]));
        // Everything, where nothing stands.
        assert_eq!(marked(&[land, road]), of_city(leaves(), None));
        // Boxes that reach beyond the grid are cut.
        let far = (FeatureKind::Generic, [-1e6, -1e6, 1e6, 1e6]);
        assert_eq!(marked(&[land, house, far]), of_city(leaves(), None));
        // Cells of several leaves.
        let deep = CityGrid { depth: 11, ..grid };
        let mut standing = Standing::new(&deep);
        standing.add([[-640.0, 100.0, 0.0], [-639.0, 101.0, 9.0]]);
        assert_eq!(of_city(leaves(), Some(&standing.finish())), Some([[0, 0], [3, 3]]));
    }

    #[test]
    fn of_parts_far_apart_the_heaviest_is_seen() {
        let parts =
            |bytes: u32| [square([0, 0], 10, 500), square([300, 10], 10, bytes), square([310, 400], 10, 400)].concat();
        assert_eq!(of_leaves(parts(600)), Some([[300, 10], [308, 18]]));
        assert_eq!(of_leaves(parts(50)), Some([[0, 0], [8, 8]]));
        // A river of 10 leaves between two halves.
        let halves = [square([0, 0], 10, 5), square([20, 0], 10, 5)].concat();
        assert_eq!(of_leaves(halves), Some([[1, 0], [27, 8]]));
    }
}
