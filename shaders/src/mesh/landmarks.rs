//! What the triangles of landmarks carry besides others: smooth normals, occlusion and the landmark that they belong to.

use super::LANDMARK_OCCLUSION_BIT;
use glam::{Vec2, Vec3};
use insula_protocol::mesh::Mesh;
use insula_protocol::mesh_tile::{LandmarkObject, MAX_LANDMARKS};
use serde::{Deserialize, Serialize};
use std::collections::HashMap;

/// Cosine of the largest angle between triangles that are one smooth surface; across larger angles there is an edge.
const SMOOTH_COSINE: f32 = 0.5;

/// Where a landmark is in a mesh, in the coordinates of its positions.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct LandmarkBounds {
    /// 1 + number of its stone, 0 without.
    pub stone: u32,
    /// Origin of the stone's pattern.
    pub anchor_m: [f32; 3],
    /// Corners of a box around its triangles.
    pub low_m: [f32; 3],
    pub high_m: [f32; 3],
}

#[derive(Debug, Default)]
pub(super) struct PackedLandmarks {
    /// By number: 1 + number of the stone, and the pattern's origin.
    pub(super) entries: Vec<[u32; 4]>,
    /// The third vec4 of each triangle; empty without landmarks.
    pub(super) of_triangle: Vec<[u32; 4]>,
    pub(super) bounds: Vec<LandmarkBounds>,
}

impl PackedLandmarks {
    /// `objects` are those of the triangles.
    pub(super) fn new(mesh: &Mesh, objects: &[u32], landmarks: &[LandmarkObject]) -> Self {
        if landmarks.is_empty() || objects.len() != mesh.triangles.len() {
            return Self::default();
        }
        let entry = |landmark: &LandmarkObject| {
            let [x, y, z] = landmark.anchor_m.map(f32::to_bits);
            [landmark.stone.map_or(0, |stone| 1 + u32::from(stone)), x, y, z]
        };
        let entries: Vec<[u32; 4]> = landmarks.iter().take(MAX_LANDMARKS).map(entry).collect();
        let number_of: HashMap<u32, u32> =
            (1..).zip(landmarks.iter().take(MAX_LANDMARKS)).map(|(k, l)| (l.object, k)).collect();
        let numbers: Vec<u32> = objects.iter().map(|object| number_of.get(object).copied().unwrap_or(0)).collect();
        let normals = CornerNormals::new(mesh, &numbers);
        let of_triangle = (0..mesh.triangles.len()).map(|t| triangle_words(mesh, &normals, &numbers, t)).collect();
        let bounds = landmarks.iter().take(MAX_LANDMARKS).zip(1..).map(|(landmark, number)| {
            let triangles = mesh.triangles.iter().zip(&numbers).filter(|(_, of)| **of == number);
            bounds_of(mesh, landmark, triangles.flat_map(|(triangle, _)| *triangle))
        });
        let bounds = bounds.collect();
        Self { entries, of_triangle, bounds }
    }
}

fn bounds_of(mesh: &Mesh, landmark: &LandmarkObject, vertices: impl Iterator<Item = u32>) -> LandmarkBounds {
    let (mut low, mut high) = ([u32::MAX; 3], [0; 3]);
    for position in vertices.filter_map(|vertex| mesh.positions.get(vertex as usize)) {
        for axis in 0..3 {
            (low[axis], high[axis]) = (low[axis].min(position[axis]), high[axis].max(position[axis]));
        }
    }
    let metres =
        |code: [u32; 3]| std::array::from_fn(|k| (mesh.grid.min[k] + f64::from(code[k]) * mesh.grid.step) as f32);
    LandmarkBounds {
        stone: landmark.stone.map_or(0, |stone| 1 + u32::from(stone)),
        anchor_m: landmark.anchor_m,
        low_m: metres(low.map(|code| code.min(u16::MAX.into()))),
        high_m: metres(high),
    }
}

fn triangle_words(mesh: &Mesh, normals: &CornerNormals, numbers: &[u32], t: usize) -> [u32; 4] {
    let number = numbers[t];
    if number == 0 {
        return [0; 4];
    }
    let occlusion = mesh.attributes.get(1);
    let share = |corner: usize| {
        let Some(attribute) = occlusion else { return 0 };
        let most = (1u32 << attribute.bits.min(16)) - 1;
        let value =
            attribute.corners.get(corner).and_then(|at| attribute.values.get(*at as usize)).map_or(most, |v| v[0]);
        (value.min(most) * 255 + most / 2) / most
    };
    let corner = |k: usize| pack_normal(normals.of_corner(t, k)) | share(3 * t + k) << 24;
    let bit = if occlusion.is_some() { LANDMARK_OCCLUSION_BIT } else { 0 };
    [corner(0), corner(1), corner(2), number | bit]
}

/// Normals at the corners of landmarks' triangles: means over the triangles around a point, by area.
struct CornerNormals {
    /// Twice the area long, by triangle; zero for triangles of no landmark.
    of_triangle: Vec<Vec3>,
    /// Number of the point at each corner; equal points have one number.
    points: Vec<[u32; 3]>,
    /// Triangles around each point: places in `around` where they begin.
    starts: Vec<u32>,
    around: Vec<u32>,
}

impl CornerNormals {
    fn new(mesh: &Mesh, numbers: &[u32]) -> Self {
        let position = |vertex: u32| mesh.positions.get(vertex as usize).copied().unwrap_or_default();
        let mut number_of = HashMap::new();
        let mut point = |vertex: u32| {
            let next = number_of.len() as u32;
            *number_of.entry(position(vertex)).or_insert(next)
        };
        let points: Vec<[u32; 3]> = mesh
            .triangles
            .iter()
            .zip(numbers)
            .map(|(triangle, number)| if *number == 0 { [u32::MAX; 3] } else { triangle.map(&mut point) })
            .collect();
        let of_triangle = (mesh.triangles.iter().zip(numbers)).map(|(triangle, number)| {
            let [a, b, c] = triangle.map(|vertex| Vec3::from_array(position(vertex).map(|v| v as f32)));
            if *number == 0 { Vec3::ZERO } else { (b - a).cross(c - a) }
        });
        let of_triangle = of_triangle.collect();
        let mut starts = vec![0u32; number_of.len() + 1];
        let used = || points.iter().flatten().filter(|point| **point != u32::MAX);
        used().for_each(|point| starts[*point as usize + 1] += 1);
        (1..starts.len()).for_each(|k| starts[k] += starts[k - 1]);
        let mut next = starts.clone();
        let mut around = vec![0; used().count()];
        for (t, corners) in (0..).zip(&points) {
            for point in corners.iter().filter(|point| **point != u32::MAX) {
                let place = &mut next[*point as usize];
                around[*place as usize] = t;
                *place += 1;
            }
        }
        Self { of_triangle, points, starts, around }
    }

    /// The normal at corner `k` of triangle `t`, of any length.
    fn of_corner(&self, t: usize, k: usize) -> Vec3 {
        let (own, point) = (self.of_triangle[t], self.points[t][k] as usize);
        let direction = own.normalize_or_zero();
        let range = self.starts[point] as usize..self.starts[point + 1] as usize;
        let near = self.around[range].iter().map(|other| self.of_triangle[*other as usize]);
        let sum: Vec3 = near.filter(|normal| normal.dot(direction) >= SMOOTH_COSINE * normal.length()).sum();
        if sum.length_squared() > 0.0 { sum } else { Vec3::Z }
    }
}

/// The octahedral normal of a vector that is not zero, in 24 bits.
pub(crate) fn pack_normal(n: Vec3) -> u32 {
    let n = n / (n.x.abs() + n.y.abs() + n.z.abs()).max(1e-20);
    let sign = |v: f32| if v >= 0.0 { 1.0 } else { -1.0 };
    let at = if n.z >= 0.0 {
        Vec2::new(n.x, n.y)
    } else {
        Vec2::new((1.0 - n.y.abs()) * sign(n.x), (1.0 - n.x.abs()) * sign(n.y))
    };
    let code = |v: f32| ((v * 0.5 + 0.5).clamp(0.0, 1.0) * 4095.0 + 0.5) as u32;
    code(at.x) | code(at.y) << 12
}
