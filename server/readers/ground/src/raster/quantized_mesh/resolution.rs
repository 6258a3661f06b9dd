//! How many pixels a tile has.

use super::mesh::{MAX_COORDINATE, Triangle};
use std::sync::Arc;

/// Pixels along a tile's side: those of most writers' grids, which have 65 points.
pub(super) const MIN_SIDE: u32 = 64;
/// Those of the largest grids that are usual.
const MAX_SIDE: u32 = 512;
/// One of this many triangles may have a shorter side than a pixel. Triangulations have a few small ones.
const SMALL_SHARE: usize = 10;
/// Rounding of coordinates makes sides shorter by up to a unit of some 60.
const TOLERANCE: f32 = 1.02;
/// Pixels are at most this many times as fine as the mean distance of vertices. Triangulations have more vertices at
/// their borders than their heights need.
const MAX_FINER: f64 = 4.0;

/// Pixels along a tile's side, a power of two, so that they are not larger than the distances of vertices in some tiles
/// of the finest level.
pub(super) fn pixels_of_side(meshes: &[Arc<Vec<Triangle>>]) -> u32 {
    let mut lengths: Vec<f32> = meshes.iter().flat_map(|mesh| mesh.iter().map(shortest_side)).collect();
    let index = lengths.len() / SMALL_SHARE;
    if index >= lengths.len() {
        return MIN_SIDE;
    }
    // There are two triangles for each vertex.
    let vertices = lengths.len() as f64 / meshes.len() as f64 / 2.0;
    let enough = MAX_FINER * vertices.sqrt();
    let (_, distance, _) = lengths.select_nth_unstable_by(index, f32::total_cmp);
    let mut side = MIN_SIDE;
    while side < MAX_SIDE && f64::from(side) < enough && MAX_COORDINATE / side as f32 > *distance * TOLERANCE {
        side *= 2;
    }
    side
}

/// The shortest side of a triangle, along the axis on which it is longer.
fn shortest_side(triangle: &Triangle) -> f32 {
    let [a, b, c] = triangle;
    let length = |from: &[f32; 3], to: &[f32; 3]| (from[0] - to[0]).abs().max((from[1] - to[1]).abs());
    length(a, b).min(length(b, c)).min(length(c, a))
}
