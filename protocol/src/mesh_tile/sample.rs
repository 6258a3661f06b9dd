//! A mesh tile made by hand, for tests of whoever reads them.
//!
//! In: a box, its colour or picture. Out: a [`MeshTile`]. Next: tests.

use super::{MeshTile, TileTexture};
use crate::mesh::{Attribute, AttributeKind, Mesh, PositionGrid};

/// Corners of a box, bit 0 to the east, bit 1 to the north, bit 2 up: two triangles for each side, seen from outside.
const SIDES: [[usize; 4]; 6] = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [1, 3, 7, 5], [3, 2, 6, 7], [2, 0, 4, 6]];

/// A box from `min` to `max` (metres from the leaf's corner), on a grid of 12 bits: of one colour, or with the whole picture on
/// each of its six sides.
pub fn cuboid(min: [f64; 3], max: [f64; 3], rgb: [u8; 3], texture: Option<TileTexture>) -> MeshTile {
    let corners: [[f64; 3]; 8] =
        std::array::from_fn(|i| std::array::from_fn(|axis| if i >> axis & 1 == 0 { min[axis] } else { max[axis] }));
    let grid = PositionGrid::enclosing(&corners, 12);
    let positions = corners.iter().map(|corner| grid.nearest(*corner)).collect();
    let triangles =
        SIDES.iter().flat_map(|s| [[s[0], s[1], s[2]], [s[0], s[2], s[3]]]).map(|t| t.map(|v| v as u32)).collect();
    let places = (0..36).map(|corner| [0, 1, 2, 0, 2, 3][corner % 6]);
    let attribute = if texture.is_some() {
        Attribute {
            kind: AttributeKind::TexCoord,
            components: 2,
            bits: 12,
            range: [0.0, 1.0 / 4095.0],
            values: vec![[0, 4095, 0, 0], [4095, 4095, 0, 0], [4095, 0, 0, 0], [0, 0, 0, 0]],
            corners: places.collect(),
        }
    } else {
        Attribute {
            kind: AttributeKind::Colour,
            components: 3,
            bits: 8,
            range: [0.0, 1.0 / 255.0],
            values: vec![[u32::from(rgb[0]), u32::from(rgb[1]), u32::from(rgb[2]), 0]],
            corners: vec![0; 36],
        }
    };
    MeshTile { mesh: Mesh { grid, positions, triangles, attributes: vec![attribute] }, texture }
}
