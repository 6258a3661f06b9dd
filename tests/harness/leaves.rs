//! The triangles of a city by leaf, clipped to squares and quantised, for tests and measurements of the mesh codec.

use insula_bake::scene::Scene;
use insula_protocol::mesh::{Mesh, PositionGrid};
use std::collections::{BTreeMap, HashMap};

type Point = [f64; 3];

/// The meshes of squares of `side_m`, quantised to `bits` bits. Vertices at one position are merged.
pub fn leaves(scene: &Scene, side_m: f64, bits: u8) -> Vec<Mesh> {
    let mut squares: BTreeMap<[i64; 2], Vec<[Point; 3]>> = BTreeMap::new();
    for triangle in &scene.triangles {
        let corners = triangle.corners.map(|corner| corner.map(f64::from));
        let range = |axis: usize| {
            let along = corners.map(|corner| (corner[axis] / side_m).floor() as i64);
            along.iter().copied().min().unwrap_or(0)..=along.iter().copied().max().unwrap_or(-1)
        };
        for y in range(1) {
            for x in range(0) {
                let mut polygon = corners.to_vec();
                for (axis, at) in [(0, x), (1, y)] {
                    polygon = clip(&polygon, axis, at as f64 * side_m, false);
                    polygon = clip(&polygon, axis, (at + 1) as f64 * side_m, true);
                }
                for pair in polygon.windows(2).skip(1) {
                    squares.entry([x, y]).or_default().push([polygon[0], pair[0], pair[1]]);
                }
            }
        }
    }
    squares.values().map(|triangles| mesh(triangles, bits)).filter(|mesh| !mesh.triangles.is_empty()).collect()
}

pub fn whole_mesh(scene: &Scene, bits: u8) -> Mesh {
    let triangles: Vec<_> = scene.triangles.iter().map(|t| t.corners.map(|corner| corner.map(f64::from))).collect();
    mesh(&triangles, bits)
}

fn mesh(triangles: &[[Point; 3]], bits: u8) -> Mesh {
    let grid = PositionGrid::enclosing(triangles.as_flattened(), bits);
    let mut numbers = HashMap::new();
    let mut mesh = Mesh { grid, positions: Vec::new(), triangles: Vec::new(), attributes: Vec::new() };
    for triangle in triangles {
        let corners = triangle.map(|corner| {
            let point = grid.nearest(corner);
            *numbers.entry(point).or_insert_with(|| {
                mesh.positions.push(point);
                mesh.positions.len() as u32 - 1
            })
        });
        if corners[0] != corners[1] && corners[1] != corners[2] && corners[2] != corners[0] {
            mesh.triangles.push(corners);
        }
    }
    mesh
}

/// The part of a polygon at or below, or at or above, a coordinate. An edge is split at the same point from both sides.
fn clip(polygon: &[Point], axis: usize, at: f64, below: bool) -> Vec<Point> {
    let is_in = |p: &Point| if below { p[axis] <= at } else { p[axis] >= at };
    let mut out = Vec::with_capacity(polygon.len() + 1);
    for (i, a) in polygon.iter().enumerate() {
        let b = &polygon[(i + 1) % polygon.len()];
        if is_in(a) {
            out.push(*a);
        }
        if is_in(a) != is_in(b) {
            let (low, high) = if a < b { (a, b) } else { (b, a) };
            let share = (at - low[axis]) / (high[axis] - low[axis]);
            let mut draw_list: Point = std::array::from_fn(|k| low[k] + (high[k] - low[k]) * share);
            draw_list[axis] = at;
            if draw_list != *a && draw_list != *b {
                out.push(draw_list);
            }
        }
    }
    out
}
