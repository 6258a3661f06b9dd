//! Rows of terraced houses on flat ground as meshes of four leaves, which meet in the middle of roofs. What no ray towards
//! the north-east and down can see unless it passes a closed surface is red.

use crate::draw_list::{CityArea, DrawList};
use crate::rng::Rng;
use crate::view::{Camera, FrameSpec};
use anyhow::{Context, Result, ensure};
use glam::DVec3;
use insula_protocol::blockmap::COLUMNS;
use insula_protocol::mesh::{Attribute, Mesh, PositionGrid};
use insula_protocol::{BlockMap, TileId};
use insula_shaders::cpu::raycast::Pixels;
use insula_shaders::layout::Shading;
use insula_shaders::mesh::{PackedMesh, ray_origin};

const LEAF_M: u32 = 64;
/// Steps of a leaf's grid per metre.
const STEPS: u32 = 64;
/// South-west and north-east end of the ground, in x and y.
const GROUND_M: [f64; 2] = [4.0, 124.0];
/// No house is as high.
const ABOVE_M: f64 = 24.0;
/// A frame's pixels, each with one ray.
pub const FRAME: FrameSpec = FrameSpec { width_px: 64, height_px: 64, shading: Shading::Albedo, samples: 1 };
const ROWS: u32 = 7;
const HOUSES: u32 = 15;

/// A point in steps from the south-west corner.
type Point = [u32; 3];

pub struct Terraces {
    pub draw_list: DrawList,
    /// Corners of all triangles, in metres.
    pub triangles: Vec<[DVec3; 3]>,
}

/// Triangles of the four leaves, and for each triangle whether it is hidden.
#[derive(Default)]
struct Builder {
    leaves: [(Vec<[Point; 3]>, Vec<bool>); 4],
}

impl Builder {
    /// A quad within one leaf, its corners counter-clockwise seen from outside.
    fn quad(&mut self, rng: &mut Rng, [a, b, c, d]: [Point; 4], hidden: bool) {
        let halves = if rng.chance(0.5) { [[a, b, c], [a, c, d]] } else { [[a, b, d], [b, c, d]] };
        let low: [u32; 2] = std::array::from_fn(|axis| a[axis].min(b[axis]).min(c[axis]).min(d[axis]));
        let leaf = low.map(|v| v / (LEAF_M * STEPS)).map(|v| v as usize);
        let (triangles, are_hidden) = &mut self.leaves[leaf[0] + 2 * leaf[1]];
        triangles.extend(halves);
        are_hidden.extend([hidden; 2]);
    }

    /// A house with its ridge along x, from eaves and ridge heights in steps. `joined`: the western neighbour is alike.
    fn house(&mut self, rng: &mut Rng, [x, y]: [u32; 2], [eaves, ridge]: [u32; 2], joined: bool) {
        let [half, middle] = [4 * STEPS, y + 4 * STEPS];
        let (y_end, x_end) = (y + 8 * STEPS, x + 2 * half);
        for x in [x, x + half] {
            let e = x + half;
            self.quad(rng, [[x, y, 0], [e, y, 0], [e, y, eaves], [x, y, eaves]], false);
            self.quad(rng, [[e, y_end, 0], [x, y_end, 0], [x, y_end, eaves], [e, y_end, eaves]], true);
            self.quad(rng, [[x, y, eaves], [e, y, eaves], [e, middle, ridge], [x, middle, ridge]], false);
            self.quad(rng, [[x, middle, ridge], [e, middle, ridge], [e, y_end, eaves], [x, y_end, eaves]], false);
        }
        for (south, north, [a, b]) in [(y, middle, [eaves, ridge]), (middle, y_end, [ridge, eaves])] {
            self.quad(rng, [[x, north, 0], [x, south, 0], [x, south, a], [x, north, b]], joined);
            self.quad(rng, [[x_end, south, 0], [x_end, north, 0], [x_end, north, b], [x_end, south, a]], true);
        }
    }
}

impl Terraces {
    pub fn new(seed: u64) -> Result<Self> {
        let (mut builder, mut rng) = (Builder::default(), Rng::new(seed));
        let kinds: [[u32; 2]; 3] = std::array::from_fn(|_| {
            let eaves = 3 * STEPS + rng.below(600) as u32;
            [eaves, eaves + 1 + rng.below(400) as u32]
        });
        for row in 0..ROWS {
            let (south, mut west_kind) = ((16 * row + 12) * STEPS, [0; 2]);
            for house in 0..HOUSES {
                let kind = if rng.chance(0.6) { west_kind } else { kinds[rng.below(3)] };
                let kind = if kind[0] == 0 { kinds[0] } else { kind };
                builder.house(&mut rng, [(8 * house + 4) * STEPS, south], kind, kind == west_kind);
                west_kind = kind;
            }
        }
        let [first, last] = GROUND_M.map(|v| v as u32 / 4);
        for (i, j) in (first..last).flat_map(|j| (first..last).map(move |i| (i, j))) {
            let ([x, y], side) = ([i * 4 * STEPS, j * 4 * STEPS], 4 * STEPS);
            let corners = [[x, y, 0], [x + side, y, 0], [x + side, y + side, 0], [x, y + side, 0]];
            builder.quad(&mut rng, corners, j >= 3 && (j + 1) % 4 < 2 && j < 4 * ROWS + 1);
        }
        builder.finish()
    }
}

/// Sides of the slab, in metres from the south-west corner.
const SLAB_M: [u32; 2] = [4, 60];
const SLAB_Z_M: u32 = 20;
/// A ray that meets the slab's plane nearer to its border than this, in metres, may see the slab or the ground.
const ROUNDING_M: f64 = 4e-5;

/// Fails if a ray that looks down at the border of a large slab sees the slab beyond its border, or the ground within it.
pub fn check_the_end_of_a_slab(seed: u64) -> Result<()> {
    let (mut builder, mut rng) = (Builder::default(), Rng::new(seed));
    let quad = |[low, high]: [u32; 2], z: u32| {
        [[low, low, z], [high, low, z], [high, high, z], [low, high, z]].map(|p| p.map(|v| v * STEPS))
    };
    builder.quad(&mut rng, quad(SLAB_M, SLAB_Z_M), true);
    builder.quad(&mut rng, quad([0, LEAF_M], 0), false);
    let slab = builder.finish()?;
    let [low, high] = SLAB_M.map(f64::from);
    for _ in 0..40 {
        let target = DVec3::new(high, rng.range(low + 1.0, high - 1.0), SLAB_Z_M.into());
        let from = target + DVec3::new(rng.range(-2.0, 2.0), rng.range(-2.0, 2.0), rng.range(3.0, 8.0));
        let camera = Camera { fov_y_deg: 0.03, ..Camera::looking(ray_origin(from), target) };
        let pixels = slab.draw_list.scene(&camera, &FRAME).render();
        for (at, colour) in (0..).zip(&pixels.colour) {
            let dir = camera.ray(&FRAME, at % FRAME.width_px, at / FRAME.width_px);
            let origin = DVec3::from(camera.position);
            let beyond_m = (origin + dir * ((target.z - origin.z) / dir.z)).x - high;
            let sees_slab = colour & 0xff > colour >> 16 & 0xff;
            let is_wrong = beyond_m.abs() > ROUNDING_M && sees_slab == (beyond_m > 0.0);
            ensure!(!is_wrong, "{beyond_m} m beyond the slab's border, a ray sees the slab: {sees_slab}: {camera:?}");
        }
    }
    Ok(())
}

/// A camera that looks at an edge, down to the north-east. Its field of view is from ten millionths of a radian to a tenth.
pub fn camera(terraces: &Terraces, rng: &mut Rng) -> Camera {
    let triangle = terraces.triangles[rng.below(terraces.triangles.len())];
    let first = rng.below(3);
    let (a, b) = (triangle[first], triangle[(first + 1) % 3]);
    // Some look at a corner.
    let target = a.lerp(b, if rng.chance(0.2) { 0.0 } else { rng.unit() });
    let dir = DVec3::new(rng.range(0.15, 1.0), rng.range(0.15, 1.0), -rng.range(0.02, 1.0)).normalize_or(DVec3::X);
    let reach_m = (ABOVE_M - target.z) / -dir.z * 10f64.powf(rng.range(0.0, 1.0));
    let position = ray_origin(target - dir * reach_m);
    let fov_y_deg = 10f64.powf(rng.range(-5.0, -1.0)).to_degrees();
    Camera { fov_y_deg, ..Camera::looking(position, target) }
}

/// A ray that sees what lies this far behind the first surface, in metres, has passed it. Nearer surfaces meet at an edge.
const PASSED_M: f64 = 0.002;

/// Distance to the first triangle on a ray, within a slack at edges.
fn first_surface(triangles: &[[DVec3; 3]], origin: DVec3, dir: DVec3) -> f64 {
    let distance = |[a, b, c]: &[DVec3; 3]| {
        let (e1, e2, start) = (*b - *a, *c - *a, origin - *a);
        let p = dir.cross(e2);
        let scale = 1.0 / e1.dot(p);
        let q = start.cross(e1);
        let (u, v) = (start.dot(p) * scale, dir.dot(q) * scale);
        let is_hit = u >= -1e-9 && v >= -1e-9 && u + v <= 1.0 + 1e-9;
        Some(e2.dot(q) * scale).filter(|t| is_hit && *t > 0.0)
    };
    triangles.iter().filter_map(distance).fold(f64::INFINITY, f64::min)
}

/// Fails if a ray saw something hidden behind another surface, or missed the ground.
pub fn check(terraces: &Terraces, camera: &Camera, pixels: &Pixels) -> Result<()> {
    for (at, colour) in (0..).zip(&pixels.colour) {
        let (x, y) = (at % pixels.width_px, at / pixels.width_px);
        let dir = camera.ray(&FRAME, x, y);
        let end = DVec3::from(camera.position) - dir * (camera.position[2] / dir.z);
        let over_ground = [end.x, end.y].iter().all(|v| *v > GROUND_M[0] + 0.01 && *v < GROUND_M[1] - 0.01);
        let distance = pixels.distance[at as usize];
        ensure!(!over_ground || distance.is_finite(), "pixel {x}, {y} misses the ground: {camera:?}");
        let is_hidden = distance.is_finite() && colour & 0xff > colour >> 16 & 0xff;
        if is_hidden {
            let behind_m = f64::from(distance) - first_surface(&terraces.triangles, camera.position.into(), dir);
            ensure!(behind_m < PASSED_M, "pixel {x}, {y} passes a surface by {behind_m} m: {camera:?}");
        }
    }
    Ok(())
}

impl Builder {
    fn finish(self) -> Result<Terraces> {
        let area = CityArea { origin: [0.0; 3], root_side_m: f64::from(2 * LEAF_M) };
        let mut terraces = Terraces { draw_list: DrawList::new(area), triangles: Vec::new() };
        let no_columns = vec![None; COLUMNS];
        for (leaf, (triangles, are_hidden)) in (0..).zip(self.leaves) {
            let id = TileId::new(1, leaf % 2, leaf / 2).context("a leaf")?;
            let corner = [leaf % 2 * LEAF_M * STEPS, leaf / 2 * LEAF_M * STEPS, 0];
            let metres = |p: Point| DVec3::from(p.map(f64::from)) / f64::from(STEPS);
            terraces.triangles.extend(triangles.iter().map(|corners| corners.map(metres)));
            let relative = |p: Point| std::array::from_fn(|axis| p[axis] - corner[axis]);
            let positions = triangles.iter().flatten().map(|p| relative(*p)).collect();
            let corners = are_hidden.iter().flat_map(|hidden| [u32::from(*hidden); 3]).collect();
            let attributes = vec![Attribute::colours([[0, 0, 255], [255, 0, 0]], corners)];
            let grid = PositionGrid { min: [0.0; 3], step: 1.0 / f64::from(STEPS), bits: 13 };
            let triangles = (0..triangles.len() as u32).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect();
            let mesh = Mesh { grid, positions, triangles, attributes };
            terraces.draw_list.add(&BlockMap::from_columns(id, 1.0, 0, 0, &no_columns).context("an empty node")?);
            terraces.draw_list.add_mesh(id, PackedMesh::new(&mesh, None, &[], &[])?);
        }
        Ok(terraces)
    }
}
