//! Position of nodes, columns and blocks of leaves.

use insula_protocol::tile_id::MAX_LEVEL;
use insula_protocol::{NODE_CELLS, TileId};
use serde::{Deserialize, Serialize};

/// Leaves along a block's side. The leaves of a block share their visibility maps.
pub const BLOCK_LEAVES: u32 = 2;

/// The city's quadtree in space. Scene coordinates are those of [`crate::scene::Scene`], in metres.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct CityGrid {
    /// South-west corner of the root, and height zero of all nodes, in scene coordinates.
    pub corner: [f64; 3],
    /// Level of the leaves.
    pub depth: u8,
    /// Side of a leaf's column in metres.
    pub cell_m: f64,
}

impl CityGrid {
    /// The smallest root square of side `leaf_side * 2^depth` that covers `[min, max]` (scene coordinates, x and y).
    /// Its corner lies on the world grid of whole leaves, so that a world position always falls into the same cell.
    ///
    /// `world_origin` is the scene's origin. `None` if the city would need more than [`MAX_LEVEL`] levels, or if a
    /// coordinate is not finite.
    pub fn covering(min: [f64; 3], max: [f64; 3], world_origin: [f64; 3], cell_m: f64) -> Option<Self> {
        let leaf_side = cell_m * NODE_CELLS as f64;
        let snap = |v: f64, origin: f64, step: f64| ((v + origin) / step).floor() * step - origin;
        let corner = [
            snap(min[0], world_origin[0], leaf_side),
            snap(min[1], world_origin[1], leaf_side),
            snap(min[2], world_origin[2], cell_m) - cell_m,
        ];
        let side = (max[0] - corner[0]).max(max[1] - corner[1]);
        if !side.is_finite() || !corner[2].is_finite() || leaf_side <= 0.0 {
            return None;
        }
        // `floor + 1` because a point on the far edge belongs to the next leaf.
        let leaves = (side / leaf_side).floor() + 1.0;
        let depth = (0..=MAX_LEVEL).find(|d| f64::from(1u32 << d) >= leaves)?;
        Some(Self { corner, depth, cell_m })
    }

    /// Side of a node of a level, in metres.
    pub fn node_side_m(&self, level: u8) -> f64 {
        self.cell_m_at(level) * NODE_CELLS as f64
    }

    /// Side of a column of a level, in metres.
    pub fn cell_m_at(&self, level: u8) -> f64 {
        self.cell_m * f64::from(1u32 << (self.depth - level))
    }

    /// Side of a block of leaves in metres.
    pub(crate) fn block_side_m(&self) -> f64 {
        self.node_side_m(self.depth) * f64::from(BLOCK_LEAVES)
    }

    /// From the grid's south-west corner to that of a block of leaves, in metres.
    pub(crate) fn block_offset_m(&self, [x, y]: [u32; 2]) -> [f64; 2] {
        [x, y].map(|number| f64::from(number) * self.block_side_m())
    }

    /// The same grid for a scene whose origin, on the map, is the south-west corner of a block of leaves.
    pub(crate) fn around_block(&self, block: [u32; 2]) -> Self {
        let [x, y] = self.block_offset_m(block);
        Self { corner: [-x, -y, self.corner[2]], ..*self }
    }

    /// Step of the lattice of corners on the map, in metres: a power of two, 1/8192 to 1/4096 of a column. Corners of blocks are
    /// on it, and f32 has all of its points within 4096 steps of 1024 of a block's corner: neighbouring blocks have the same
    /// corners.
    pub(crate) fn lattice_m(&self) -> f64 {
        // The exponent of the largest power of two that is not larger, twelve less.
        f64::from_bits((self.cell_m.to_bits() >> 52).saturating_sub(12) << 52)
    }

    /// South-west corner of a node in scene coordinates.
    pub fn node_corner(&self, id: TileId) -> [f64; 2] {
        let side = self.node_side_m(id.level());
        [self.corner[0] + f64::from(id.x()) * side, self.corner[1] + f64::from(id.y()) * side]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn grid_covers_the_bounds_and_snaps_to_whole_leaves() {
        let grid = CityGrid::covering([0.5, -3.0, 7.3], [200.0, 61.0, 50.0], [1000.0, 64.0, 0.0], 1.0).unwrap();
        assert_eq!(grid.corner, [-40.0, -64.0, 6.0]);
        assert_eq!(grid.depth, 2);
        assert_eq!(grid.node_side_m(0), 256.0);
        assert_eq!(grid.node_corner(TileId::new(2, 1, 1).unwrap()), [24.0, 0.0]);
        let on_edge = CityGrid::covering([0.0; 3], [64.0, 1.0, 1.0], [0.0; 3], 1.0).unwrap();
        assert_eq!(on_edge.depth, 1);
        assert!(CityGrid::covering([0.0; 3], [f64::INFINITY; 3], [0.0; 3], 1.0).is_none());
        assert!(CityGrid::covering([0.0; 3], [1e12; 3], [0.0; 3], 1.0).is_none());
    }
}
