//! From where the samples are seen: space carving by maps of the nearest triangle (Vacca 2008, 3.4.1; design 5, step 2).
//!
//! In: [`Block`], crossings and candidates. Out: their sightings. Next: `solids`, `attributes`.
//!
//! A map keeps the nearest triangle's id, and a sample asks that triangle's plane: depths compared at texel centres leak.

use super::{
    SampleSettings,
    attributes::TOP_Z,
    candidates::{Candidate, TURNS},
    crossings::{Crossing, Crossings, SURE, UNSURE},
    directions,
    local::{Block, LocalTriangle},
    scan::scan,
};
use glam::{Vec2, Vec3};
use rayon::prelude::*;

/// Sky directions that crossings look at: half of the geometry's 64, the other half of which would look from below.
const CROSSING_DIRECTIONS: usize = 48;
/// Sky directions after which a candidate's back that was never seen is given up.
const BACK_DIRECTIONS: usize = 16;
/// Sky directions after which a candidate that was never seen is dropped: it lies inside.
const FIRST_DIRECTIONS: usize = 48;
/// Samples a task.
const CHUNK: usize = 4096;

/// Looks at the block from everywhere.
pub(super) fn look(
    block: &Block,
    settings: &SampleSettings,
    crossings: &mut Crossings,
    candidates: &mut Vec<Candidate>,
) {
    let mut pending: Vec<u32> = (0..crossings.list.len() as u32)
        .filter(|i| crossings.list[*i as usize].wants(true) || crossings.list[*i as usize].wants(false))
        .collect();
    let mut map = Map::default();
    let low = directions::low(settings.low_directions);
    for (i, direction) in low.iter().enumerate() {
        map.draw(block, *direction);
        sight_crossings(block, &map, crossings, &mut pending);
        sight_candidates(block, &map, candidates, i, i < BACK_DIRECTIONS);
    }
    for (i, direction) in directions::sky(settings.sky_directions).iter().enumerate() {
        map.draw(block, *direction);
        if i == FIRST_DIRECTIONS {
            candidates.retain(|c| c.sightings != [0; 2]);
        }
        if i < CROSSING_DIRECTIONS {
            sight_crossings(block, &map, crossings, &mut pending);
        }
        sight_candidates(block, &map, candidates, i, i < BACK_DIRECTIONS);
    }
}

fn sight_crossings(block: &Block, map: &Map, crossings: &mut Crossings, pending: &mut Vec<u32>) {
    let (lines, step, offset) = (crossings.lines[0], crossings.step_m, crossings.offset_m);
    let look = |c: &Crossing| {
        let triangle = &block.triangles[c.triangle as usize];
        let up = if triangle.normal.z > 0.0 { triangle.normal } else { -triangle.normal };
        let above = up.dot(map.w) > 0.0;
        let place = |i: usize| (i as f32 + 0.5) * step + offset;
        let p = Vec3::new(place(c.line as usize % lines), place(c.line as usize / lines), c.z);
        let open = c.wants(above) && (above || !through_floor(triangle, p, map.w));
        let seen = open && map.sees(block, p, if above { up } else { -up }, c.triangle);
        let sure = above || map.shows(block, p, triangle);
        seen.then_some((above, if sure { SURE } else { UNSURE }))
    };
    let list = &crossings.list;
    let sighted: Vec<(u32, (bool, u8))> = pending
        .par_chunks(CHUNK)
        .flat_map_iter(|chunk| chunk.iter().filter_map(|i| Some((*i, look(&list[*i as usize])?))).collect::<Vec<_>>())
        .collect();
    for (i, (above, weight)) in sighted {
        crossings.list[i as usize].sighted(above, weight);
    }
    let list = &crossings.list;
    pending.retain(|i| list[*i as usize].wants(true) || list[*i as usize].wants(false));
}

/// Whether the look at an underside comes up through the ground that its object stands on: a shell without a floor would
/// show its inside to a viewer who cannot be there.
fn through_floor(triangle: &LocalTriangle, p: Vec3, direction: Vec3) -> bool {
    if direction.z >= 0.0 {
        return false;
    }
    let [west, south, east, north] = triangle.footprint_m;
    let exit = |d: f32, at: f32, low: f32, high: f32| match d {
        d if d > 1e-6 => (high - at) / d,
        d if d < -1e-6 => (low - at) / d,
        _ => f32::INFINITY,
    };
    let out = exit(direction.x, p.x, west, east).min(exit(direction.y, p.y, south, north));
    p.z + out * direction.z < triangle.base_z_m
}

fn sight_candidates(block: &Block, map: &Map, candidates: &mut [Candidate], direction: usize, backs: bool) {
    let sky = map.w.z > 0.0;
    candidates.par_chunks_mut(CHUNK).for_each(|chunk| {
        for candidate in chunk {
            let turn = sky && direction % TURNS == usize::from(candidate.turn);
            if !turn && sky && direction >= FIRST_DIRECTIONS {
                continue;
            }
            let triangle = &block.triangles[candidate.triangle as usize];
            // Tops are seen from the sky; from below, only undersides and walls under roofs need a look.
            if !sky && (triangle.terrain || triangle.normal.z > TOP_Z) {
                continue;
            }
            let cos = triangle.normal.dot(map.w);
            let side = usize::from(cos < 0.0);
            if side == 1 && (triangle.terrain || !(backs || candidate.sightings[1] > 0)) {
                continue;
            }
            let unseen = candidate.sightings[side] == 0;
            if !(turn || unseen) || (!sky && through_floor(triangle, candidate.p, map.w)) {
                continue;
            }
            let normal = if side == 1 { -triangle.normal } else { triangle.normal };
            if map.sees(block, candidate.p, normal, candidate.triangle) {
                candidate.sightings[side] += 1;
                if turn {
                    candidate.sky[side] += cos.abs();
                }
            }
        }
    });
}

/// The nearest triangles as seen from one direction.
#[derive(Debug, Default)]
struct Map {
    u: Vec3,
    v: Vec3,
    /// Towards the viewer.
    w: Vec3,
    corner: Vec2,
    texel_m: f32,
    texels_per_m: f32,
    size: [usize; 2],
    /// Triangle + 1, 0 where there is none.
    ids: Vec<u32>,
    depths: Vec<f32>,
    /// Per triangle: `w = x * u + y * v + z` in map coordinates.
    planes: Vec<Vec3>,
    tolerance_m: f32,
}

impl Map {
    fn draw(&mut self, block: &Block, direction: Vec3) {
        self.aim(block, direction);
        self.ids.clear();
        self.ids.resize(self.size[0] * self.size[1], 0);
        self.depths.clear();
        self.depths.resize(self.size[0] * self.size[1], f32::NEG_INFINITY);
        self.planes.clear();
        self.planes.resize(block.triangles.len(), Vec3::ZERO);
        for (index, triangle) in block.triangles.iter().enumerate() {
            self.draw_triangle(triangle, index);
        }
    }

    /// Axes and extent: what the block's box projects to.
    fn aim(&mut self, block: &Block, direction: Vec3) {
        self.w = direction;
        (self.u, self.v) = direction.any_orthonormal_pair();
        self.texel_m = block.cell_m * 0.5;
        self.texels_per_m = 1.0 / self.texel_m;
        self.tolerance_m = block.cell_m * 0.02;
        let [width, height] = block.extent_m();
        let rim = block.cell_m;
        let (mut low, mut high) = (Vec2::MAX, Vec2::MIN);
        for i in 0..8 {
            let corner = Vec3::new(
                if i & 1 == 0 { -rim } else { width + rim },
                if i & 2 == 0 { -rim } else { height + rim },
                block.z_range[i >> 2] + if i & 4 == 0 { -rim } else { rim },
            );
            let p = self.flat(corner);
            (low, high) = (low.min(p), high.max(p));
        }
        self.corner = low - self.texel_m;
        let size = ((high - self.corner) / self.texel_m).ceil() + 2.0;
        self.size = [size.x as usize, size.y as usize];
    }

    fn flat(&self, p: Vec3) -> Vec2 {
        Vec2::new(p.dot(self.u), p.dot(self.v))
    }

    fn draw_triangle(&mut self, triangle: &LocalTriangle, index: usize) {
        let cos = triangle.normal.dot(self.w);
        if cos.abs() < 1e-3 || (triangle.terrain && cos < 0.0) {
            return;
        }
        let corners = triangle.corners.map(|c| self.flat(c) - self.corner);
        // On the plane, n.p is constant: w = (n.c - n.u * u - n.v * v) / n.w.
        let (a, b) = (-triangle.normal.dot(self.u) / cos, -triangle.normal.dot(self.v) / cos);
        let first = corners[0];
        let plane = Vec3::new(a, b, triangle.corners[0].dot(self.w) - a * first.x - b * first.y);
        self.planes[index] = plane;
        let width = self.size[0];
        let (texel, ids, depths) = (self.texel_m, &mut self.ids, &mut self.depths);
        scan(corners.map(|c| [c.x, c.y]), texel, self.size, |row, first, end| {
            let base = plane.y * (row as f32 + 0.5) * texel + plane.z;
            let run = row * width + first..row * width + end;
            for (i, (depth, id)) in depths[run.clone()].iter_mut().zip(&mut ids[run]).enumerate() {
                let w = plane.x * ((first + i) as f32 + 0.5) * texel + base;
                if w > *depth {
                    *depth = w;
                    *id = index as u32 + 1;
                }
            }
        });
    }

    /// The ids of the four texels around a place on the map; `None` outside.
    fn around(&self, at: Vec2) -> Option<[u32; 4]> {
        let texel = at * self.texels_per_m - 0.5;
        if texel.x < 0.0 || texel.y < 0.0 {
            return None;
        }
        let (x, y) = (texel.x as usize, texel.y as usize);
        if x + 1 >= self.size[0] || y + 1 >= self.size[1] {
            return None;
        }
        let first = y * self.size[0] + x;
        let second = first + self.size[0];
        Some([self.ids[first], self.ids[first + 1], self.ids[second], self.ids[second + 1]])
    }

    /// Whether any texel around `p` shows the surface of `triangle`: itself, or one that goes on from it.
    fn shows(&self, block: &Block, p: Vec3, triangle: &LocalTriangle) -> bool {
        let shown = |id: u32| {
            let other = &block.triangles[id as usize - 1];
            let near = other.normal.dot(other.corners[0] - p).abs() < block.cell_m;
            near && other.normal.dot(triangle.normal).abs() > 0.7
        };
        let ids = self.around(self.flat(p) - self.corner);
        ids.is_some_and(|ids| ids.iter().any(|id| *id != 0 && shown(*id)))
    }

    /// Whether the surface at `p` with `normal` (towards the viewer) of `triangle` is seen: the triangles in all four texels
    /// around let it be.
    fn sees(&self, block: &Block, p: Vec3, normal: Vec3, triangle: u32) -> bool {
        let at = self.flat(p) - self.corner;
        let w = p.dot(self.w);
        let Some(ids) = self.around(at) else { return true };
        let mut last = triangle + 1;
        for id in ids {
            if id == 0 || id == triangle + 1 || id == last {
                continue;
            }
            last = id;
            let plane = self.planes[id as usize - 1];
            if plane.x * at.x + plane.y * at.y + plane.z <= w + self.tolerance_m {
                continue;
            }
            // A triangle wholly behind the sample's own plane hides nothing of it: its plane was asked beyond its rim.
            let other = &block.triangles[id as usize - 1];
            if other.corners.iter().any(|c| normal.dot(*c - p) > self.tolerance_m) {
                return false;
            }
        }
        true
    }
}
