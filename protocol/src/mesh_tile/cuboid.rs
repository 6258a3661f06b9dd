//! A box as a mesh tile, as test data for all crates that read tiles.

use super::{MeshTile, TileTexture};
use crate::mesh::{Attribute, AttributeKind, Mesh, PositionGrid};

/// The four corners of each side of a box, counter-clockwise from outside. Bit 0 of a corner is east, bit 1 north, bit
/// 2 up.
const SIDES: [[usize; 4]; 6] = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [1, 3, 7, 5], [3, 2, 6, 7], [2, 0, 4, 6]];

/// A box from `min` to `max` (metres from the leaf's corner) on a grid of 12 bits, with one colour, or with the whole
/// texture on each side.
pub fn cuboid(min: [f64; 3], max: [f64; 3], rgb: [u8; 3], texture: Option<TileTexture>) -> MeshTile {
    let corners: [[f64; 3]; 8] =
        std::array::from_fn(|i| std::array::from_fn(|axis| if i >> axis & 1 == 0 { min[axis] } else { max[axis] }));
    let grid = PositionGrid::enclosing(&corners, 12);
    let positions = corners.iter().map(|corner| grid.nearest(*corner)).collect();
    let triangles =
        SIDES.iter().flat_map(|s| [[s[0], s[1], s[2]], [s[0], s[2], s[3]]]).map(|t| t.map(|v| v as u32)).collect();
    let uv_corners = (0..36).map(|corner| [0, 1, 2, 0, 2, 3][corner % 6]);
    let attribute = if texture.is_some() {
        Attribute {
            kind: AttributeKind::TexCoord,
            components: 2,
            bits: 12,
            range: [0.0, 1.0 / 4095.0],
            values: vec![[0, 4095, 0, 0], [4095, 4095, 0, 0], [4095, 0, 0, 0], [0, 0, 0, 0]],
            corners: uv_corners.collect(),
        }
    } else {
        Attribute::colours([rgb], vec![0; 36])
    };
    let mesh = Mesh { grid, positions, triangles, attributes: vec![attribute] };
    MeshTile { mesh, texture, objects: Vec::new(), landmarks: Vec::new() }
}
