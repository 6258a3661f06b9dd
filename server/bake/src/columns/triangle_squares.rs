//! The triangles in and around a leaf, sorted into squares to find the nearest one.

use crate::{scene::Scene, triangle_distance::squared_distance};
use glam::{DVec2, DVec3};
use insula_protocol::{BlockMap, NODE_CELLS};

/// Squares along a side of the leaf into which triangles are sorted, with as many around it.
const SQUARES: usize = 16;

/// The triangles in and around a leaf, in squares.
pub(super) struct TriangleSquares {
    triangles: Vec<[DVec3; 3]>,
    /// Numbers of the triangles of each square, row by row.
    squares: Vec<Vec<u32>>,
    /// South-west corner of the first square.
    low: DVec2,
    side_m: f64,
}

impl TriangleSquares {
    pub(super) fn new(map: &BlockMap, scene: &Scene, corner: DVec3) -> Self {
        let side_m = f64::from(map.cell_m) * (NODE_CELLS / SQUARES) as f64;
        let place = DVec2::new(f64::from(map.id.x()), f64::from(map.id.y()));
        let low = (place * SQUARES as f64 - SQUARES as f64) * side_m;
        let mut squares = vec![Vec::new(); 9 * SQUARES * SQUARES];
        let mut triangles = Vec::new();
        for triangle in &scene.triangles {
            let corners = triangle.corners.map(|c| DVec3::from(c.map(f64::from)) - corner);
            let [a, b, c] = corners.map(|p| (p.truncate() - low) / side_m);
            let (first, last) = (a.min(b).min(c).floor(), a.max(b).max(c).floor());
            let end = 3.0 * SQUARES as f64 - 1.0;
            if first.max_element() > end || last.min_element() < 0.0 || !first.is_finite() || !last.is_finite() {
                continue;
            }
            let [first, last] = [first, last].map(|v| v.clamp(DVec2::ZERO, DVec2::splat(end)).as_usizevec2());
            for y in first.y..=last.y {
                for x in first.x..=last.x {
                    squares[y * 3 * SQUARES + x].push(triangles.len() as u32);
                }
            }
            triangles.push(corners);
        }
        Self { triangles, squares, low, side_m }
    }

    /// Distance of the nearest triangle, at most `most_m`.
    pub(super) fn distance_m(&self, p: DVec3, most_m: f64) -> f64 {
        let own = ((p.truncate() - self.low) / self.side_m).floor().as_i64vec2();
        let (mut best, n) = (most_m, 3 * SQUARES as i64);
        for ring in 0..n {
            if (ring - 1) as f64 * self.side_m >= best {
                break;
            }
            for (dx, dy) in (-ring..=ring).flat_map(|dy| (-ring..=ring).map(move |dx| (dx, dy))) {
                let (x, y) = (own.x + dx, own.y + dy);
                if dx.abs().max(dy.abs()) == ring && x >= 0 && y >= 0 && x < n && y < n {
                    let near = self.squares[(y * n + x) as usize].iter();
                    let squared = near.map(|t| squared_distance(p, self.triangles[*t as usize]));
                    best = squared.fold(best * best, f64::min).sqrt();
                }
            }
        }
        best
    }
}
