//! Whole coordinates on the map, and the order of leaves.

use i_overlay::i_float::int::point::IntPoint;
use insula_protocol::{Manifest, TileId};

/// A place on the map in units of [`MapGrid`].
pub(crate) type MapPoint = IntPoint<i32>;

/// Largest coordinate in units: what the union of polygons allows.
const MAX_UNITS: f64 = (1 << 29) as f64;

/// Whole coordinates from the city's south-west corner: millimetres, or a multiple in a city of over 500 km.
#[derive(Debug, Clone, Copy)]
pub(crate) struct MapGrid {
    /// Of the corner, in millimetres.
    origin_mm: [f64; 2],
    /// A power of two.
    unit_mm: f64,
}

impl MapGrid {
    pub(crate) fn of(manifest: &Manifest) -> Self {
        let mut unit_mm = 1.0;
        while manifest.root_side_m * 1000.0 / unit_mm > MAX_UNITS {
            unit_mm *= 2.0;
        }
        Self { origin_mm: [0, 1].map(|k| (manifest.origin[k] * 1000.0).round()), unit_mm }
    }

    /// The nearest point of a place in world metres.
    pub(crate) fn point(&self, world: [f64; 2]) -> MapPoint {
        let [x, y] = [0, 1].map(|k| {
            let units = (world[k] * 1000.0 - self.origin_mm[k]) / self.unit_mm;
            units.round().clamp(-MAX_UNITS, MAX_UNITS) as i32
        });
        MapPoint::new(x, y)
    }

    /// World metres with three decimals.
    pub(crate) fn world(&self, point: MapPoint) -> [f64; 2] {
        let world = |units: i32, k: usize| (self.origin_mm[k] + f64::from(units) * self.unit_mm) / 1000.0;
        [world(point.x, 0), world(point.y, 1)]
    }

    /// The south-west corner in world metres.
    pub(crate) fn origin(&self) -> [f64; 2] {
        self.origin_mm.map(|v| v / 1000.0)
    }

    /// Length of a unit in metres.
    pub(crate) fn unit_m(&self) -> f64 {
        self.unit_mm / 1000.0
    }

    /// A length in units, at least 1.
    pub(crate) fn units(&self, metres: f64) -> f64 {
        (metres * 1000.0 / self.unit_mm).max(1.0)
    }

    /// Area in square metres of a square of one unit.
    pub(crate) fn unit_area_m2(&self) -> f64 {
        self.unit_m().powi(2)
    }
}

/// The order in which leaves are visited: along a Hilbert curve, so that what is near on the map is near in time.
#[derive(Debug, Clone, Copy)]
pub(crate) struct LeafOrder {
    depth: u8,
}

impl LeafOrder {
    pub(crate) fn of(manifest: &Manifest) -> Self {
        Self { depth: manifest.depth }
    }

    /// Position of the first leaf of a node.
    pub(crate) fn first(self, node: TileId) -> u64 {
        let below = self.depth.saturating_sub(node.level());
        let position = fast_hilbert::xy2h(node.x() << below, node.y() << below, self.depth.max(1));
        position >> (2 * below) << (2 * below)
    }

    /// Position of the last leaf of a node.
    pub(crate) fn last(self, node: TileId) -> u64 {
        let below = self.depth.saturating_sub(node.level());
        self.first(node) + (1 << (2 * below)) - 1
    }

    /// The children of a node in order.
    pub(crate) fn children(self, node: TileId) -> Vec<TileId> {
        let mut children: Vec<TileId> = node.children().collect();
        children.sort_by_key(|child| self.first(*child));
        children
    }

    /// Position of the last leaf that a rectangle touches, in world metres. Leaves beyond the city do not count.
    pub(crate) fn last_in(self, manifest: &Manifest, [min, max]: [[f64; 2]; 2]) -> u64 {
        let leaf_m = manifest.node_side_m(self.depth);
        let end = f64::from((1u32 << self.depth) - 1);
        let leaf = |world: f64, k: usize| ((world - manifest.origin[k]) / leaf_m).floor().clamp(0.0, end) as u32;
        let [low, high] = [min, max].map(|corner| [leaf(corner[0], 0), leaf(corner[1], 1)]);
        let touches = |node: &TileId| {
            let below = self.depth - node.level();
            let first = [node.x() << below, node.y() << below];
            (0..2).all(|k| first[k] <= high[k] && low[k] <= first[k] + ((1 << below) - 1))
        };
        let mut node = TileId::ROOT;
        while node.level() < self.depth {
            match self.children(node).into_iter().rev().find(touches) {
                Some(child) => node = child,
                None => break,
            }
        }
        self.last(node)
    }
}

/// The rectangle of a node on the map, in world metres.
pub(crate) fn node_area(manifest: &Manifest, node: TileId) -> [[f64; 2]; 2] {
    let [x, y, _] = manifest.node_corner(node);
    let side = manifest.node_side_m(node.level());
    [[x, y], [x + side, y + side]]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::table::test_city::manifest;

    #[test]
    fn points_have_three_decimals() {
        let grid = MapGrid::of(&manifest(3));
        let world = [84_999.123_4, 446_000.000_6];
        let point = grid.point(world);
        assert_eq!(grid.world(point), [84_999.123, 446_000.001]);
        assert_eq!((grid.units(0.004), grid.unit_area_m2()), (4.0, 1e-6));
    }

    #[test]
    fn the_last_leaf_of_a_rectangle_is_the_largest_of_its_leaves() {
        let manifest = manifest(4);
        let order = LeafOrder::of(&manifest);
        let leaf_m = manifest.node_side_m(4);
        for [x0, y0, x1, y1] in [[0, 0, 0, 0], [3, 2, 9, 5], [0, 0, 15, 15], [7, 7, 8, 8], [15, 0, 15, 3]] {
            let leaves = (x0..=x1).flat_map(|x| (y0..=y1).map(move |y| TileId::new(4, x, y).unwrap()));
            let expected = leaves.map(|leaf| order.first(leaf)).max();
            let at = |x: u32, y: u32| {
                [manifest.origin[0] + (f64::from(x) + 0.5) * leaf_m, manifest.origin[1] + (f64::from(y) + 0.5) * leaf_m]
            };
            assert_eq!(Some(order.last_in(&manifest, [at(x0, y0), at(x1, y1)])), expected);
        }
        assert_eq!((order.first(TileId::ROOT), order.last(TileId::ROOT)), (0, 255));
    }
}
