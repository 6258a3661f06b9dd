//! Ambient occlusion at the vertices of a leaf's landmarks.
//!
//! It is computed once, at the vertices of the finest surface. The vertices of the other levels take the value of the nearest of
//! these. What hides a landmark is itself, in this leaf and in others, and all of the block around it: ground, buildings, other
//! landmarks.

use super::leaf_surface::LeafSurface;
use crate::error::BakeError;
use crate::scene::Scene;
use crate::scene::grid::CityGrid;
use insula_occlusion::{OccludedMesh, OcclusionSettings};
use insula_protocol::TileId;
use insula_protocol::mesh::{Attribute, AttributeKind};
use insula_protocol::mesh_tile::OCCLUSION_BITS;
use insula_simplify::model::TriangleModel;
use std::collections::HashMap;

/// Cubes in which a nearest vertex is searched for, from the point's own outwards.
const MAX_RINGS: i32 = 24;
/// Side of the depth maps in texels. Twice as many take 1.6 times as long and change the error by a fifth at most.
const MAP_PX: u32 = 512;
/// Half the side of the ground plane below a landmark in a city without ground, in metres.
const PLANE_M: f64 = 1000.0;
const MOST: u32 = (1 << OCCLUSION_BITS) - 1;

/// Occlusion at the vertices of a leaf's finest surface.
pub(super) struct LeafOcclusion {
    /// Vertices of landmarks, by the cube that they lie in.
    cubes: HashMap<[i32; 3], Vec<u32>>,
    cube_side: f64,
    positions: Vec<[f64; 3]>,
    /// By vertex, in units of 1 / [`MOST`].
    shares: Vec<u32>,
}

impl LeafOcclusion {
    /// `None` without landmarks in the leaf. Fails if the mesh exceeds the limits of `insula-occlusion`.
    pub(super) fn new(
        scene: &Scene,
        grid: &CityGrid,
        id: TileId,
        surface: &LeafSurface,
    ) -> Result<Option<Self>, BakeError> {
        let is_landmark = |object: &u32| surface.landmarks.iter().any(|landmark| landmark.object == *object);
        let (mut own, mut others) = (Vec::new(), Vec::new());
        for (triangle, object) in surface.model.triangles.iter().zip(&surface.objects) {
            if is_landmark(object) { own.push(*triangle) } else { others.push(*triangle) }
        }
        if own.is_empty() {
            return Ok(None);
        }
        let (positions, triangles) = used_vertices(&surface.model, &own);
        let mut occluders = around(scene, grid, id, surface);
        occluders.extend(others.iter().map(|t| t.map(|vertex| surface.model.positions[vertex as usize])));
        let settings = OcclusionSettings { map_px: MAP_PX, ..OcclusionSettings::default() };
        let mesh = OccludedMesh { positions: &positions, triangles: &triangles };
        let found = insula_occlusion::cpu(mesh, &occluders, settings, &|_| true)
            .map_err(|error| BakeError::Occlusion { tile: id, cause: error.to_string() })?;
        let shares = found.share.iter().map(|share| (share.clamp(0.0, 1.0) * MOST as f32 + 0.5) as u32).collect();
        let cube_side = 2.0 * mean_edge(&positions, &triangles).max(0.5);
        let mut cubes: HashMap<[i32; 3], Vec<u32>> = HashMap::new();
        for (vertex, position) in (0..).zip(&positions) {
            cubes.entry(cube_of(*position, cube_side)).or_default().push(vertex);
        }
        Ok(Some(Self { cubes, cube_side, positions, shares }))
    }

    /// The attribute of a level's vertices.
    pub(super) fn attribute(&self, model: &TriangleModel) -> Attribute {
        let values = model.positions.iter().map(|position| [self.nearest(*position), 0, 0, 0]).collect();
        Attribute {
            kind: AttributeKind::Other,
            components: 1,
            bits: OCCLUSION_BITS,
            range: [0.0, 1.0 / MOST as f32],
            values,
            corners: model.triangles.concat(),
        }
    }

    /// The share at the vertex that is nearest to a point; open if none is near.
    fn nearest(&self, p: [f64; 3]) -> u32 {
        let cube = cube_of(p, self.cube_side);
        let mut best = (f64::INFINITY, MOST);
        for ring in 0..=MAX_RINGS {
            // A vertex in a further ring is at least this far away.
            let least = f64::from(ring - 1).max(0.0) * self.cube_side;
            if best.0 <= least * least {
                break;
            }
            for_each_of_ring(cube, ring, |at| {
                for vertex in self.cubes.get(&at).into_iter().flatten() {
                    let q = self.positions[*vertex as usize];
                    let squared: f64 = (0..3).map(|k| (p[k] - q[k]).powi(2)).sum();
                    if squared < best.0 {
                        best = (squared, self.shares[*vertex as usize]);
                    }
                }
            });
        }
        best.1
    }
}

fn cube_of(p: [f64; 3], side: f64) -> [i32; 3] {
    p.map(|v| (v / side).floor() as i32)
}

/// The cubes at a distance of `ring` along the longest axis.
fn for_each_of_ring([x, y, z]: [i32; 3], ring: i32, mut visit: impl FnMut([i32; 3])) {
    for dz in -ring..=ring {
        for dy in -ring..=ring {
            let is_face = dz.abs() == ring || dy.abs() == ring;
            let step = if is_face || ring == 0 { 1 } else { 2 * ring as usize };
            for dx in (-ring..=ring).step_by(step) {
                visit([x + dx, y + dy, z + dz]);
            }
        }
    }
}

/// The vertices that triangles use, and the triangles by their new numbers.
fn used_vertices(model: &TriangleModel, triangles: &[[u32; 3]]) -> (Vec<[f64; 3]>, Vec<[u32; 3]>) {
    let mut number_of = vec![u32::MAX; model.positions.len()];
    let mut positions = Vec::new();
    let renumbered = triangles.iter().map(|triangle| {
        triangle.map(|vertex| {
            let number = &mut number_of[vertex as usize];
            if *number == u32::MAX {
                *number = positions.len() as u32;
                positions.push(model.positions[vertex as usize]);
            }
            *number
        })
    });
    let renumbered = renumbered.collect();
    (positions, renumbered)
}

fn mean_edge(positions: &[[f64; 3]], triangles: &[[u32; 3]]) -> f64 {
    let length = |[a, b, _]: &[u32; 3]| {
        let (a, b) = (positions[*a as usize], positions[*b as usize]);
        (0..3).map(|k| (a[k] - b[k]).powi(2)).sum::<f64>().sqrt()
    };
    triangles.iter().map(length).sum::<f64>() / triangles.len().max(1) as f64
}

/// The triangles of the block outside of the leaf, in steps of its grid; a plane at the landmark's foot if there is no ground.
fn around(scene: &Scene, grid: &CityGrid, id: TileId, surface: &LeafSurface) -> Vec<[[f64; 3]; 3]> {
    let (side_m, step_m, min) = (grid.node_side_m(id.level()), surface.points.step, surface.points.min);
    let low = [f64::from(id.x()) * side_m, f64::from(id.y()) * side_m, 0.0];
    let place = |p: [f32; 3]| -> [f64; 3] {
        std::array::from_fn(|k| (f64::from(p[k]) - grid.corner[k] - low[k] - min[k]) / step_m)
    };
    let side = f64::from(surface.steps);
    let is_outside = |corners: &[[f64; 3]; 3]| {
        (0..2).any(|k| corners.iter().all(|p| p[k] <= 0.0) || corners.iter().all(|p| p[k] >= side))
    };
    let mut occluders: Vec<[[f64; 3]; 3]> = scene
        .triangles
        .iter()
        .map(|triangle| triangle.corners.map(place))
        // Those that cross the border count twice, which changes nothing.
        .filter(|corners| is_outside(corners) || corners.iter().flat_map(|p| &p[..2]).any(|v| *v < 0.0 || *v > side))
        .collect();
    let has_ground = scene
        .triangles
        .iter()
        .any(|triangle| scene.objects.get(triangle.object as usize).is_some_and(|object| object.kind.is_terrain()));
    if !has_ground {
        let (reach, z) = (PLANE_M / step_m, 0.0);
        let corner = |x: f64, y: f64| [side / 2.0 + x * reach, side / 2.0 + y * reach, z];
        let [a, b, c, d] = [corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)];
        occluders.extend([[a, b, c], [a, c, d]]);
    }
    occluders
}
