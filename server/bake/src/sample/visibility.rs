//! From where the samples are seen: space carving by maps of the nearest triangle (Vacca 2008, 3.4.1; design 5, step 2).
//!
//! In: [`LocalBlock`], crossings and candidates. Out: their sightings. Next: `solids`, `attributes`.
//!
//! A map keeps the nearest triangle's id, and a sample asks that triangle's plane: depths compared at texel centres leak.

use super::{
    crossings::{Crossing, Crossings, SURE, UNSURE},
    directions,
    nearest::{self, FacingTriangle},
    settings::{SampleSettings, VisibilityBackend},
};
use crate::sample::{
    local_block::{LocalBlock, LocalTriangle, TOP_Z},
    rasterise::scan,
    surface_samples::{SurfaceSample, TURNS},
};
use glam::{Vec2, Vec3};

/// Sky directions that crossings look at: half of the geometry's 64, the other half of which would look from below.
const CROSSING_DIRECTIONS: usize = 48;
/// Directions, of the sky and of the low ones, after which a candidate's back that was never seen is given up.
const BACK_DIRECTIONS: usize = 16;
/// Sky directions after which a candidate that was never seen, from below neither, is dropped: it lies inside.
const FIRST_DIRECTIONS: usize = 48;

/// Looks at the block from everywhere: from the sky until all is seen that will be, then from below at the rest, then
/// from the remaining sky for the occlusion of what was seen.
pub(super) fn look(
    block: &LocalBlock,
    settings: &SampleSettings,
    crossings: &mut Crossings,
    candidates: &mut Vec<SurfaceSample>,
) {
    let sky = directions::sky(settings.sky_directions);
    let (first, rest) = sky.split_at(FIRST_DIRECTIONS.min(sky.len()));
    let mut pending: Vec<u32> = (0..crossings.list.len() as u32)
        .filter(|i| crossings.list[*i as usize].wants(true) || crossings.list[*i as usize].wants(false))
        .collect();
    let mut map = VisibilityMap { drawn_by: settings.visibility, ..VisibilityMap::default() };
    let mut sheets = sheets_of(candidates);
    for (i, direction) in first.iter().enumerate() {
        map.draw(block, *direction);
        if i < CROSSING_DIRECTIONS {
            sight_crossings(block, &map, crossings, &mut pending);
        }
        let look = DirectionPass { turn: Some(i % TURNS), unseen: true, backs: i < BACK_DIRECTIONS };
        sight_candidates(block, &map, candidates, &mut sheets, look);
    }
    look_from_below(block, settings, (crossings, &mut pending), (candidates, &mut sheets));
    candidates.retain(|candidate| candidate.sightings != [0; 2]);
    sheets = sheets_of(candidates);
    for (i, direction) in rest.iter().enumerate() {
        map.draw(block, *direction);
        let look = DirectionPass { turn: Some((FIRST_DIRECTIONS + i) % TURNS), unseen: false, backs: false };
        sight_candidates(block, &map, candidates, &mut sheets, look);
    }
}

/// Undersides, and what stands under them. Where all shells are closed and stand on the ground, there are none.
fn look_from_below(
    block: &LocalBlock,
    settings: &SampleSettings,
    (crossings, pending): (&mut Crossings, &mut Vec<u32>),
    (candidates, sheets): (&mut [SurfaceSample], &mut [TriangleSamples]),
) {
    let hangs = block.triangles.iter().any(|triangle| hangs(block, triangle));
    if !hangs && pending.is_empty() {
        return;
    }
    let mut map = VisibilityMap { drawn_by: settings.visibility, ..VisibilityMap::default() };
    for (i, direction) in directions::low(settings.low_directions).iter().enumerate() {
        map.draw(block, *direction);
        sight_crossings(block, &map, crossings, pending);
        if hangs {
            let look = DirectionPass { turn: None, unseen: true, backs: i < BACK_DIRECTIONS };
            sight_candidates(block, &map, candidates, sheets, look);
        }
    }
}

/// Whether there may be something to see under it.
fn hangs(block: &LocalBlock, triangle: &LocalTriangle) -> bool {
    let low = triangle.corners.iter().fold(f32::MAX, |m, c| m.min(c.z));
    let above_foot = low > triangle.base_z_m + 1.5 * block.cell_m;
    !triangle.terrain && (!triangle.closed || (triangle.normal.z < -0.1 && above_foot))
}

/// The candidates of one triangle.
#[derive(Debug)]
struct TriangleSamples {
    triangle: u32,
    /// Where the candidates of each turn begin and the last ones end.
    starts: [u32; TURNS + 1],
    /// Whether a candidate's front (back) was not seen yet.
    unseen: [bool; 2],
}

fn sheets_of(candidates: &[SurfaceSample]) -> Vec<TriangleSamples> {
    let mut begin = 0;
    let sheets = candidates.chunk_by(|a, b| a.triangle == b.triangle).map(|sheet| {
        let starts = |turn: usize| begin + sheet.partition_point(|c| usize::from(c.turn) < turn) as u32;
        let starts = std::array::from_fn(starts);
        begin += sheet.len() as u32;
        TriangleSamples { triangle: sheet[0].triangle, starts, unseen: [true; 2] }
    });
    sheets.collect()
}

fn sight_crossings(block: &LocalBlock, map: &VisibilityMap, crossings: &mut Crossings, pending: &mut Vec<u32>) {
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
    pending.retain(|i| {
        let crossing = &mut crossings.list[*i as usize];
        if let Some((above, weight)) = look(crossing) {
            crossing.sighted(above, weight);
        }
        crossing.wants(true) || crossing.wants(false)
    });
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

/// What is asked of the candidates from one direction.
#[derive(Debug, Clone, Copy)]
struct DirectionPass {
    /// Whose occlusion is asked for; `None` for a direction under the horizon.
    turn: Option<usize>,
    /// Whether all are asked that were not seen yet.
    unseen: bool,
    /// Whether backs are among these.
    backs: bool,
}

fn sight_candidates(
    block: &LocalBlock,
    map: &VisibilityMap,
    candidates: &mut [SurfaceSample],
    sheets: &mut [TriangleSamples],
    look: DirectionPass,
) {
    for sheet in sheets {
        let triangle = &block.triangles[sheet.triangle as usize];
        // Tops are seen from the sky; from below, only undersides and walls under roofs need a look.
        if look.turn.is_none() && (triangle.terrain || triangle.normal.z > TOP_Z) {
            continue;
        }
        let cos = triangle.normal.dot(map.w);
        let side = usize::from(cos < 0.0);
        if side == 1 && (triangle.terrain || triangle.closed) {
            continue;
        }
        let normal = if side == 1 { -triangle.normal } else { triangle.normal };
        let sees = |candidate: &SurfaceSample| {
            let inside = look.turn.is_none() && through_floor(triangle, candidate.p, map.w);
            !inside && map.sees(block, candidate.p, normal, sheet.triangle)
        };
        let first_looks = look.unseen && sheet.unseen[side] && (side == 0 || look.backs);
        if first_looks {
            let all = &mut candidates[sheet.starts[0] as usize..sheet.starts[TURNS] as usize];
            let mut unseen = false;
            for candidate in all.iter_mut().filter(|candidate| candidate.sightings[side] == 0) {
                let own_turn = look.turn == Some(usize::from(candidate.turn));
                if !own_turn && sees(candidate) {
                    candidate.sightings[side] += 1;
                }
                unseen |= candidate.sightings[side] == 0;
            }
            sheet.unseen[side] = unseen;
        }
        let Some(turn) = look.turn else { continue };
        let own = &mut candidates[sheet.starts[turn] as usize..sheet.starts[turn + 1] as usize];
        for candidate in own {
            let given_up = side == 1 && candidate.sightings[1] == 0 && !look.backs;
            if !given_up && sees(candidate) {
                candidate.sightings[side] += 1;
                candidate.sky[side] += cos.abs();
            }
        }
    }
}

/// The nearest triangles as seen from one direction.
#[derive(Debug, Default)]
struct VisibilityMap {
    drawn_by: VisibilityBackend,
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

impl VisibilityMap {
    fn draw(&mut self, block: &LocalBlock, direction: Vec3) {
        self.aim(block, direction);
        self.planes.clear();
        self.planes.resize(block.triangles.len(), Vec3::ZERO);
        if self.drawn_by == VisibilityBackend::Gpu
            && let Some(ids) = self.draw_on_device(block)
        {
            self.ids = ids;
            return;
        }
        self.ids.clear();
        self.ids.resize(self.size[0] * self.size[1], 0);
        self.depths.clear();
        self.depths.resize(self.size[0] * self.size[1], f32::NEG_INFINITY);
        for (index, triangle) in block.triangles.iter().enumerate() {
            if let Some(corners) = self.face(triangle, index) {
                self.draw_triangle(corners, index);
            }
        }
    }

    fn draw_on_device(&mut self, block: &LocalBlock) -> Option<Vec<u32>> {
        let mut facing: Vec<FacingTriangle> = Vec::with_capacity(block.triangles.len());
        for (index, triangle) in block.triangles.iter().enumerate() {
            if let Some(corners) = self.face(triangle, index) {
                let place = |i: usize| (corners[i] / self.texel_m).extend(triangle.corners[i].dot(self.w));
                facing.push((std::array::from_fn(place), index as u32 + 1));
            }
        }
        nearest::draw(&facing, self.size)
    }

    /// Axes and extent: what the block's box projects to.
    fn aim(&mut self, block: &LocalBlock, direction: Vec3) {
        self.w = direction;
        // Walls are mostly higher than wide: with a map's rows upright they have fewer, longer runs.
        self.v = direction.cross(Vec3::Z).normalize_or(Vec3::Y);
        self.u = self.v.cross(direction);
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

    /// Keeps the triangle's plane and gives its corners on the map; `None` if it shows no face.
    fn face(&mut self, triangle: &LocalTriangle, index: usize) -> Option<[Vec2; 3]> {
        let cos = triangle.normal.dot(self.w);
        // The nearest surface of a closed shell faces the viewer, as terrain does.
        let one_sided = triangle.terrain || triangle.closed;
        if cos.abs() < 1e-3 || (one_sided && cos < 0.0) {
            return None;
        }
        let corners = triangle.corners.map(|c| self.flat(c) - self.corner);
        // On the plane, n.p is constant: w = (n.c - n.u * u - n.v * v) / n.w.
        let (a, b) = (-triangle.normal.dot(self.u) / cos, -triangle.normal.dot(self.v) / cos);
        let first = corners[0];
        self.planes[index] = Vec3::new(a, b, triangle.corners[0].dot(self.w) - a * first.x - b * first.y);
        Some(corners)
    }

    fn draw_triangle(&mut self, corners: [Vec2; 3], index: usize) {
        let plane = self.planes[index];
        let width = self.size[0];
        let (texel, ids, depths) = (self.texel_m, &mut self.ids, &mut self.depths);
        scan(corners.map(|c| [c.x, c.y]), texel, self.size, |row, first, end| {
            let base = plane.y * (row as f32 + 0.5) * texel + plane.z;
            let run = row * width + first..row * width + end;
            let along = plane.x * texel;
            let start = (first as f32 + 0.5) * along + base;
            // Without branches, so that the compiler takes several texels at once.
            for (i, (depth, id)) in depths[run.clone()].iter_mut().zip(&mut ids[run]).enumerate() {
                let w = i as i32 as f32 * along + start;
                let nearer = w > *depth;
                *depth = if nearer { w } else { *depth };
                *id = if nearer { index as u32 + 1 } else { *id };
            }
        });
    }

    /// The ids of the four texels around a place on the map; `None` outside.
    #[inline]
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
    fn shows(&self, block: &LocalBlock, p: Vec3, triangle: &LocalTriangle) -> bool {
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
    #[inline]
    fn sees(&self, block: &LocalBlock, p: Vec3, normal: Vec3, triangle: u32) -> bool {
        let at = self.flat(p) - self.corner;
        let Some(ids) = self.around(at) else { return true };
        ids == [triangle + 1; 4] || self.let_through(block, (p, at, normal), triangle, ids)
    }

    fn let_through(
        &self,
        block: &LocalBlock,
        (p, at, normal): (Vec3, Vec2, Vec3),
        triangle: u32,
        ids: [u32; 4],
    ) -> bool {
        let w = p.dot(self.w);
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
