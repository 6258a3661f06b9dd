//! The visible walls of a block, cut into pieces by cell.

use super::local_block::{LocalBlock, LocalTriangle};
use super::surfels::Surfel;
use crate::columns::wall_fit::WallPiece;
use glam::{IVec2, Vec2, Vec3, Vec3Swizzles};
use std::cmp::Ordering;

/// Walls whose normal has a smaller |z| are vertical: their place in a cell does not depend on the height.
const VERTICAL_NORMAL_Z: f32 = 0.03;

/// The wall pieces of a block by cell.
pub(super) struct CellWalls {
    /// Number of the cell, then the piece; sorted by cell.
    list: Vec<(u32, WallPiece)>,
    /// Width and height of the block in cells, with one cell more on each side.
    size: [i32; 2],
    cell_m: f32,
}

impl CellWalls {
    /// Collects the walls that are visible in at least one surfel. Vertical triangles are cut exactly at the cells'
    /// borders, others are represented by their visible surfels.
    pub(super) fn new(block: &LocalBlock, surfels: &[Surfel]) -> Self {
        let mut walls = Self { list: Vec::new(), size: block.cells.map(|n| n as i32 + 2), cell_m: block.cell_m };
        for of_triangle in surfels.chunk_by(|a, b| a.triangle == b.triangle) {
            let triangle = &block.triangles[of_triangle[0].triangle as usize];
            let [front, back] =
                [0, 1].map(|side| of_triangle.iter().map(|s| u32::from(s.sightings[side])).sum::<u32>());
            if front.max(back) == 0 || !triangle.is_wall() {
                continue;
            }
            let normal = triangle.normal.xy().normalize() * if back > front { -1.0 } else { 1.0 };
            if triangle.normal.z.abs() < VERTICAL_NORMAL_Z {
                cut_at_cell_borders(triangle, block.cell_m, walls.size, |cell, centre, share| {
                    walls.push(cell, normal, centre, triangle.area_m2 * share);
                });
            } else {
                for surfel in of_triangle.iter().filter(|surfel| surfel.is_visible()) {
                    let p = surfel.position.xy();
                    walls.push((p / block.cell_m).floor().as_ivec2(), normal, p, surfel.area_m2);
                }
            }
        }
        walls.list.sort_by_key(|(cell, _)| *cell);
        walls
    }

    /// The pieces in a cell, which is numbered row-major with the cells around the block included.
    pub(super) fn of_cell(&self, cell: u32) -> Vec<WallPiece> {
        let first = self.list.partition_point(|(c, _)| *c < cell);
        let end = first + self.list[first..].partition_point(|(c, _)| *c == cell);
        self.list[first..end].iter().map(|(_, piece)| *piece).collect()
    }

    fn push(&mut self, cell: IVec2, normal: Vec2, p: Vec2, area_m2: f32) {
        let position_m = p - (cell.as_vec2() + 0.5) * self.cell_m;
        let (x, y) = (cell.x + 1, cell.y + 1);
        let [width, height] = self.size;
        if (0..width).contains(&x) && (0..height).contains(&y) {
            self.list.push(((y * width + x) as u32, WallPiece { normal, position_m, area_m2 }));
        }
    }
}

/// Cuts a vertical triangle, seen from above, at the borders of the block's `size` cells. Calls `each` with the cell, the centre of the
/// piece and its share of the triangle's length.
fn cut_at_cell_borders(triangle: &LocalTriangle, cell_m: f32, size: [i32; 2], mut each: impl FnMut(IVec2, Vec2, f32)) {
    let along = triangle.normal.xy().normalize().perp();
    let distance = |corner: &&Vec3| along.dot(corner.xy());
    let ends = [Ordering::Less, Ordering::Greater].map(|order| {
        triangle.corners.iter().reduce(|a, b| if distance(&b).total_cmp(&distance(&a)) == order { b } else { a })
    });
    let [Some(a), Some(b)] = ends.map(|end| end.map(|corner| corner.xy())) else { return };
    let mut cuts = vec![0.0, 1.0];
    for axis in 0..2 {
        let (from, to) = (a[axis] / cell_m, b[axis] / cell_m);
        // Without borders beyond the block, of which a wall of many kilometres has millions.
        let borders =
            (from.min(to).ceil() as i64).max(-2)..=(from.max(to).floor() as i64).min(i64::from(size[axis]) + 2);
        if from != to {
            cuts.extend(borders.map(|border| ((border as f32 - from) / (to - from)).clamp(0.0, 1.0)));
        }
    }
    cuts.sort_by(f32::total_cmp);
    for pair in cuts.windows(2).filter(|pair| pair[1] > pair[0]) {
        let centre = a.lerp(b, 0.5 * (pair[0] + pair[1]));
        each((centre / cell_m).floor().as_ivec2(), centre, pair[1] - pair[0]);
    }
}
