//! The faces of boxes: tops, undersides of what floats, and sides as far down as no neighbour covers them.

use super::merge::{Block, Layer};
use crate::geometry::{Geometry, linear};
use insula_protocol::blockmap::NODE_CELLS;

/// The boxes of both layers: the tops, and what lies below gaps.
pub(super) fn faces(layers: &[Layer; 2]) -> Geometry {
    let mut mesh = Faces::default();
    for block in layers.iter().flat_map(|layer| &layer.blocks) {
        mesh.add_top(block);
        mesh.add_sides(block, layers);
        if block.is_floating {
            mesh.add_underside(block);
        }
    }
    mesh.0
}

/// The corners of a box, counter-clockwise from the south-west. Side `k` leads from corner `k` to the next one.
fn corners(block: &Block) -> [[u16; 2]; 4] {
    let [[x0, y0], [x1, y1]] = [block.min, block.max].map(|corner| corner.map(|at| at as u16));
    [[x0, y0], [x1, y0], [x1, y1], [x0, y1]]
}

#[derive(Default)]
struct Faces(Geometry);

impl Faces {
    fn vertex(&mut self, [x, y]: [u16; 2], z: u16, rgb: [u8; 3], feature: u32) -> u32 {
        self.0.positions.push([x, y, z]);
        self.0.colours.push(rgb.map(linear));
        self.0.features.push(feature);
        self.0.positions.len() as u32 - 1
    }

    fn quad(&mut self, [a, b, c, d]: [u32; 4]) {
        self.0.indices.extend([a, b, c, a, c, d]);
    }

    fn add_top(&mut self, block: &Block) {
        let quad = corners(block).map(|corner| self.vertex(corner, block.high, block.roof, block.feature));
        self.quad(quad);
    }

    fn add_underside(&mut self, block: &Block) {
        let [a, b, c, d] = corners(block).map(|corner| self.vertex(corner, block.low, block.roof, block.feature));
        self.quad([a, d, c, b]);
    }

    /// Sides share the vertices of their corners where these have the same height.
    fn add_sides(&mut self, block: &Block, layers: &[Layer; 2]) {
        let corners = corners(block);
        let mut tops = [None; 4];
        let mut bottoms: [Option<(u16, u32)>; 4] = [None; 4];
        for side in 0..4 {
            let bottom = bottom_of_side(block, side, layers);
            if bottom >= block.high {
                continue;
            }
            let ends = [side, (side + 1) % 4];
            let [low, high] = [true, false].map(|is_low| {
                ends.map(|corner| {
                    let known = if is_low {
                        bottoms[corner].filter(|(z, _)| *z == bottom).map(|(_, v)| v)
                    } else {
                        tops[corner]
                    };
                    known.unwrap_or_else(|| {
                        let z = if is_low { bottom } else { block.high };
                        let vertex = self.vertex(corners[corner], z, block.wall, block.feature);
                        if is_low {
                            bottoms[corner] = Some((bottom, vertex))
                        } else {
                            tops[corner] = Some(vertex)
                        }
                        vertex
                    })
                })
            });
            self.quad([low[0], low[1], high[1], high[0]]);
        }
    }
}

/// How far down a side is visible: to the lowest height up to which a column beside it covers it.
fn bottom_of_side(block: &Block, side: usize, layers: &[Layer; 2]) -> u16 {
    let [along, across] = if side.is_multiple_of(2) { [0, 1] } else { [1, 0] };
    let beside = match side {
        0 | 3 => block.min[across].checked_sub(1),
        _ => Some(block.max[across]).filter(|at| *at < NODE_CELLS),
    };
    // Beyond the node's border, nothing is known.
    let Some(beside) = beside else { return block.low };
    let covered = |at: usize| {
        let mut column = [0; 2];
        (column[along], column[across]) = (at, beside);
        covered_height(block, column[1] * NODE_CELLS + column[0], layers)
    };
    (block.min[along]..block.max[along]).map(covered).min().unwrap_or(block.low)
}

/// The height up to which the solids of a column cover a side of a box without a gap. What does not float is solid to any depth.
fn covered_height(block: &Block, column: usize, [top, below]: &[Layer; 2]) -> u16 {
    let mut height = block.low;
    for layer in [below, top] {
        let Some(other) = layer.of_column[column].and_then(|index| layer.blocks.get(index)) else { continue };
        if !other.is_floating || other.low <= height {
            height = height.max(other.high);
        }
    }
    height
}
