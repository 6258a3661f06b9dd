//! Random meshes for nodes of a random city: boxes, loose triangles and slivers, with colours or a texture.

use crate::random::RandomCity;
use crate::rng::Rng;
use anyhow::{Context, Result};
use glam::{DVec3, Vec3};
use insula_protocol::TileId;
use insula_protocol::mesh::{Attribute, AttributeKind, Mesh, PositionGrid};
use insula_protocol::mesh_tile::NO_OBJECT;
use insula_shaders::mesh::{MeshTexture, PackedMesh};

#[derive(Debug, Clone)]
pub struct RandomMesh {
    pub id: TileId,
    pub mesh: Mesh,
    /// Image of its texture coordinates.
    pub texture: Option<MeshTexture>,
}

/// Draws a share of the nodes of `city` as random meshes.
pub fn add(city: &mut RandomCity, rng: &mut Rng, share: f64) -> Result<Vec<RandomMesh>> {
    let mut meshes = Vec::new();
    for map in &city.maps {
        if !rng.chance(share) {
            continue;
        }
        let side_m = city.area.root_side_m / f64::from(1u32 << map.id.level());
        let made = mesh(rng, map.id, side_m, map.z_base_m());
        let objects = objects_of(&made.mesh);
        let packed = PackedMesh::new(&made.mesh, made.texture.as_ref(), &objects, &[]).context("a random mesh")?;
        city.draw_list.add_mesh(map.id, packed);
        meshes.push(made);
    }
    Ok(meshes)
}

/// The objects of its triangles: a box is one, and every fifth box has none.
fn objects_of(mesh: &Mesh) -> Vec<u32> {
    let object = |triangle: usize| if triangle / 12 % 5 == 4 { NO_OBJECT } else { (triangle / 12) as u32 };
    (0..mesh.triangles.len()).map(object).collect()
}

fn mesh(rng: &mut Rng, id: TileId, side_m: f64, z_m: f64) -> RandomMesh {
    let bits = rng.between(14, 16) as u8; // So fine that hardly two faces lie in one plane.
    let step = side_m / f64::from((1u32 << bits) - 1);
    let grid = PositionGrid { min: [0.0, 0.0, z_m], step, bits };
    let most = (1u32 << bits) - 1;
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    let boxes = [0, 1, 8, 60][rng.below(4)];
    for _ in 0..boxes {
        let size = |rng: &mut Rng| 1 + rng.below(most as usize / 6) as u32;
        let sides = [size(rng), size(rng), size(rng)];
        let low = sides.map(|side| rng.below((most - side) as usize) as u32);
        let corner = |k: u32| std::array::from_fn(|axis| low[axis] + sides[axis] * (k >> axis & 1));
        let first = positions.len() as u32;
        positions.extend((0..8).map(corner));
        const FACES: [[u32; 4]; 6] =
            [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        for [a, b, c, d] in FACES.map(|face| face.map(|k| first + k)) {
            triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    for _ in 0..[1, 5, 400][rng.below(3)] {
        let reach = [3, most / 20 + 1, most][rng.below(3)];
        let middle: [u32; 3] = std::array::from_fn(|_| rng.below(most as usize) as u32);
        let first = positions.len() as u32;
        for _ in 0..3 {
            positions.push(middle.map(|v| (v + rng.below(reach as usize) as u32).min(most)));
        }
        triangles.push([first, first + 1, first + 2]);
    }
    let texture = rng.chance(0.6).then(|| texture(rng));
    let (kind, components, bits) =
        if texture.is_some() { (AttributeKind::TexCoord, 2, 12) } else { (AttributeKind::Colour, 3, 8) };
    let value = |rng: &mut Rng| {
        let mut value = [0; 4];
        value[..components as usize].fill_with(|| rng.below(1 << bits) as u32);
        value
    };
    let values: Vec<[u32; 4]> = (0..64).map(|_| value(rng)).collect();
    let corners = (0..3 * triangles.len()).map(|_| rng.below(64) as u32).collect();
    let range = [0.0, 1.0 / ((1u32 << bits) - 1) as f32];
    let attributes = vec![Attribute { kind, components, bits, range, values, corners }];
    RandomMesh { id, mesh: Mesh { grid, positions, triangles, attributes }, texture }
}

/// Large spots, so that few pixels lie on an edge.
fn texture(rng: &mut Rng) -> MeshTexture {
    let (width_px, height_px) = (1 + rng.below(200) as u32, 1 + rng.below(200) as u32);
    let spots: Vec<u32> = (0..64).map(|_| rng.below(1 << 24) as u32).collect();
    let spot = |x: u32, y: u32| spots[(x * 4 / width_px + y * 4 / height_px * 8) as usize];
    let texels = (0..height_px).flat_map(|y| (0..width_px).map(move |x| (x, y))).map(|(x, y)| spot(x, y)).collect();
    MeshTexture { width_px, height_px, texels }
}

/// The distance along `dir` from `eye` to the nearest triangle of all meshes, and its normal. Every triangle is tested, in f64.
/// `slack` enlarges the triangles, in barycentric coordinates.
pub fn nearest(city: &RandomCity, meshes: &[RandomMesh], eye: DVec3, dir: DVec3, slack: f64) -> Option<(f64, Vec3)> {
    let mut best: Option<(f64, Vec3)> = None;
    for RandomMesh { id, mesh, .. } in meshes {
        let side_m = city.area.root_side_m / f64::from(1u32 << id.level());
        let corner = DVec3::from(city.area.origin) + DVec3::new(f64::from(id.x()), f64::from(id.y()), 0.0) * side_m;
        let places: Vec<DVec3> = mesh.positions_m().map(|p| corner + DVec3::from(p)).collect();
        for [a, b, c] in mesh.triangles.iter().map(|t| t.map(|at| places[at as usize])) {
            let (e1, e2, from) = (b - a, c - a, eye - a);
            let p = dir.cross(e2);
            let scale = 1.0 / e1.dot(p);
            let (u, q) = (from.dot(p) * scale, from.cross(e1));
            let (v, t) = (dir.dot(q) * scale, e2.dot(q) * scale);
            let inside = u >= -slack && v >= -slack && u + v <= 1.0 + slack && t >= 0.0;
            if inside && best.is_none_or(|(nearest, _)| t < nearest) {
                let n = e1.cross(e2).normalize_or_zero();
                best = Some((t, (if n.dot(dir) < 0.0 { n } else { -n }).as_vec3()));
            }
        }
    }
    best
}
