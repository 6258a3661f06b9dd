//! Ray-casting the cut (Vacca 2008, 3.5; design 7): what a V-BlockMap looks like.
//!
//! In: [`SceneRef`]. Out: [`Pixels`]. Next: a picture file, or the window.
//!
//! From what it meets, a second ray asks whether the sun is seen (`Leg`). A ray goes from square to square of the grid
//! (`crate::grid`), beginning at the level that its distance asks for, clips itself to a node's heights, walks blocks of 8 x 8
//! cells (Amanatides and Woo 1987) and, where a block's summary lets it, the cells inside. Integer squares and cells are the
//! only state; every crossing is computed from the ray's origin, so that errors do not add up. Functions bear the names that
//! they have in `raycast.wgsl` and stand in the same order.

use super::{
    column::column,
    machine::{floor2, least, most},
    mesh::walk_mesh,
    shade::{Airlight, Lit, Surface, background, develop, encode_srgb, ground_distance, shade, through_haze},
};
use crate::{
    grid::Z_TOP,
    layout::{
        BLOCK_CELLS, DrawNode, FrameUniform, GRID_LEVEL_SHIFT, GRID_MIXED, GRID_NODE_BIT, GRID_NODES, GRID_SHARE_SHIFT,
        MAX_SAMPLES, NO_NODE, SUMMARY_WORDS,
    },
};
use glam::{IVec2, Vec2, Vec3, Vec3Swizzles};
use insula_protocol::NODE_CELLS;
use rayon::prelude::*;

/// All that a picture is made of: the same arrays that the GPU reads.
#[derive(Debug, Clone, Copy)]
pub struct SceneRef<'a> {
    /// Camera and light.
    pub frame: &'a FrameUniform,
    /// Entries of the grid.
    pub grid: &'a [[u32; 2]],
    /// Nodes of the cut.
    pub nodes: &'a [DrawNode],
    /// Block summaries, 64 words a slot.
    pub summaries: &'a [u32],
    /// Pages.
    pub atlas: &'a [u32],
}

/// A finished picture, row by row from the top.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Pixels {
    /// Width.
    pub width_px: u32,
    /// Height.
    pub height_px: u32,
    /// r, g, b, 255 in sRGB, r lowest.
    pub colour: Vec<u32>,
    /// Metres along the pixel's ray, infinity where no column was hit.
    pub distance: Vec<f32>,
    /// Index of the node that was hit, or `NO_NODE`.
    pub hit: Vec<u32>,
}

/// What rays did; per ray or summed up.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct RayCounts {
    /// Rays.
    pub rays: u64,
    /// Nodes that were walked: the ray was between their lowest and highest point.
    pub nodes: u64,
    /// Entries of the grid that were read.
    pub steps: u64,
    /// Words of summaries and atlas that were read.
    pub fetches: u64,
    /// Cells that were looked at.
    pub cells: u64,
}

impl std::ops::AddAssign for RayCounts {
    fn add_assign(&mut self, other: Self) {
        self.rays += other.rays;
        self.nodes += other.nodes;
        self.steps += other.steps;
        self.fetches += other.fetches;
        self.cells += other.cells;
    }
}

/// Most entries of the grid that a ray reads: a guard against damaged grids, far above any real walk.
const MAX_STEPS: u32 = 4096;
/// Light that is left when a ray stops.
pub(super) const OPAQUE: f32 = 0.02;

/// How far above a surface its ray towards the sun begins, in columns: steps between columns of one roof or wall must not
/// cast shadows.
pub(super) const SUN_LIFT_CELLS: f32 = 0.5;
/// The same above the plane where there is no column, in metres.
const SUN_LIFT_M: f32 = 0.05;

/// A way that is walked: from the eye to what is seen, or from there towards the sun.
#[derive(Debug, Clone, Copy)]
pub(super) struct Leg {
    pub(super) from: Vec3,
    pub(super) dir: Vec3,
    /// How far it goes.
    pub(super) reach_m: f32,
    /// How far from the eye it begins.
    eye_m: f32,
    /// It only asks whether anything is in the way.
    pub(super) to_sun: bool,
    /// Which of two nodes it sees where a square passes from one to the other.
    threshold: u32,
}

/// What a ray gathered on its way.
pub(super) struct Gathered {
    /// Sums over what was passed, by the share that is seen of it.
    pub(super) albedo: Vec3,
    pub(super) ao: f32,
    pub(super) normal: Vec3,
    pub(super) mean_m: f32,
    /// Of the last that most of the light came to.
    pub(super) flags: u32,
    pub(super) level: u32,
    /// Share that is still to be seen.
    pub(super) left: f32,
    pub(super) distance_m: f32,
    pub(super) node: u32,
    /// Where the ray towards the sun begins.
    pub(super) sun_from: Vec3,
    pub(super) counts: RayCounts,
}

/// A ray inside a node: position and direction in cells (x, y) and height codes (z), `t` still in metres.
pub(super) struct NodeRay<'a> {
    pub(super) node: &'a DrawNode,
    pub(super) index: u32,
    pub(super) leg: Leg,
    pub(super) o: Vec3,
    pub(super) d: Vec3,
    pub(super) inv: Vec2,
}

/// Draws the whole picture on all cores. Words that point outside the arrays read as zero.
pub fn render(scene: &SceneRef<'_>) -> Pixels {
    let (width, height) = (scene.frame.width_px, scene.frame.height_px);
    let rows: Vec<Vec<(u32, f32, u32)>> =
        (0..height).into_par_iter().map(|y| (0..width).map(|x| pixel(scene, x, y)).collect()).collect();
    let mut out = Pixels { width_px: width, height_px: height, ..Pixels::default() };
    for (colour, distance, hit) in rows.into_iter().flatten() {
        out.colour.push(colour);
        out.distance.push(distance);
        out.hit.push(hit);
    }
    out
}

/// What the picture's centre rays cost.
pub fn count(scene: &SceneRef<'_>) -> RayCounts {
    count_where(scene, |_| true)
}

/// The same of some pixels only, which are numbered row by row from the top.
pub fn count_where(scene: &SceneRef<'_>, counts: impl Fn(usize) -> bool + Sync) -> RayCounts {
    let (width, height) = (scene.frame.width_px, scene.frame.height_px);
    let row = |y: u32| {
        let mut sum = RayCounts::default();
        for x in (0..width).filter(|x| counts((y * width + x) as usize)) {
            let dir = ray_direction(scene.frame, Vec2::new(x as f32, y as f32) + 0.5);
            sum += trace(scene, dir, threshold_of([x, y], 1, 0)).1.counts;
        }
        sum
    };
    let add = |mut a: RayCounts, b: RayCounts| {
        a += b;
        a
    };
    (0..height).into_par_iter().map(row).reduce(RayCounts::default, add)
}

fn pixel(scene: &SceneRef<'_>, x: u32, y: u32) -> (u32, f32, u32) {
    let n = scene.frame.samples.clamp(1, MAX_SAMPLES);
    let mut sum = Vec3::ZERO;
    let (mut distance, mut hit) = (f32::INFINITY, NO_NODE);
    for s in 0..n * n {
        let offset = (Vec2::new((s % n) as f32, (s / n) as f32) + 0.5) / n as f32;
        let dir = ray_direction(scene.frame, Vec2::new(x as f32, y as f32) + offset);
        let (rgb, gathered) = trace(scene, dir, threshold_of([x, y], n, s));
        sum += rgb;
        if s == n * n / 2 {
            (distance, hit) = (gathered.distance_m, gathered.node);
        }
    }
    (encode_srgb(sum / (n * n) as f32), distance, hit)
}

/// From 0 to 63, as even as can be: an ordered pattern of 8 x 8 rays (Bayer 1973). Of 2 x 2 rays a pixel, the one whose hit
/// is told has the least: it is the first to see what is new.
fn threshold_of([x, y]: [u32; 2], samples: u32, sample: u32) -> u32 {
    let (x, y) = (x * samples + sample % samples, y * samples + sample / samples + samples / 2);
    let a = x ^ y;
    (a & 1) << 5 | (y & 1) << 4 | (a & 2) << 2 | (y & 2) << 1 | (a & 4) >> 1 | (y & 4) >> 2
}

fn ray_direction(frame: &FrameUniform, p_px: Vec2) -> Vec3 {
    let ndc = p_px / Vec2::new(frame.width_px as f32, frame.height_px as f32) * 2.0 - 1.0;
    (Vec3::from(frame.forward) + Vec3::from(frame.right) * ndc.x - Vec3::from(frame.up) * ndc.y).normalize_or(Vec3::X)
}

/// No component zero, so that every crossing is a finite number.
fn nonzero(v: Vec2) -> Vec2 {
    let fix = |v: f32| if v.abs() < 1e-12 { 1e-12 } else { v };
    Vec2::new(fix(v.x), fix(v.y))
}

/// 1 along the axes on which the ray climbs, else 0.
pub(super) fn ahead(d: Vec2) -> Vec2 {
    Vec2::new(f32::from(d.x > 0.0), f32::from(d.y > 0.0))
}

/// The light of a ray from the eye, ready for the screen, and what it met.
fn trace(scene: &SceneRef<'_>, dir: Vec3, threshold: u32) -> (Vec3, Gathered) {
    let frame = scene.frame;
    let counts = RayCounts { rays: 1, ..RayCounts::default() };
    let nothing = Gathered {
        albedo: Vec3::ZERO,
        ao: 0.0,
        normal: Vec3::ZERO,
        mean_m: 0.0,
        flags: 0,
        level: 0,
        left: 1.0,
        distance_m: f32::INFINITY,
        node: NO_NODE,
        sun_from: Vec3::ZERO,
        counts,
    };
    let mut gathered = Gathered { ..nothing };
    let leg = Leg { from: Vec3::ZERO, dir, reach_m: f32::INFINITY, eye_m: 0.0, to_sun: false, threshold };
    walk_grid(scene, &leg, &mut gathered);
    let mut eye_m = gathered.distance_m;
    let air = Airlight::new(frame, dir);
    let mut lit = gathered.light(frame, dir, &air);
    if gathered.left > OPAQUE {
        let behind = background(frame, dir, &air);
        lit = Lit { sky: lit.sky + behind.sky * gathered.left, sun: lit.sun + behind.sun * gathered.left };
        if gathered.left > 0.5 {
            eye_m = ground_distance(frame, dir);
            gathered.sun_from = dir * eye_m + Vec3::Z * SUN_LIFT_M;
        }
    }
    let mut seen = 1.0;
    // What is thin before the sky has nowhere to ask from.
    if frame.shadow_m > 0.0 && lit.sun.max_element() > 0.0 && eye_m < f32::INFINITY {
        let mut on_the_way = Gathered { counts: gathered.counts, ..nothing };
        let (from, dir) = (gathered.sun_from, Vec3::from(frame.sun));
        let leg = Leg { from, dir, reach_m: frame.shadow_m, eye_m, to_sun: true, threshold };
        walk_grid(scene, &leg, &mut on_the_way);
        gathered.counts = on_the_way.counts;
        seen = if on_the_way.left > OPAQUE { on_the_way.left } else { 0.0 };
    }
    (develop(frame, lit.sky + lit.sun * seen), gathered)
}

impl Gathered {
    /// Light of all that was passed, as if it were one surface.
    fn light(&self, frame: &FrameUniform, dir: Vec3, air: &Airlight) -> Lit {
        let share = 1.0 - self.left;
        if share <= 0.0 {
            return Lit { sky: Vec3::ZERO, sun: Vec3::ZERO };
        }
        let surface = Surface {
            albedo: self.albedo / share,
            ao: self.ao / share,
            normal: self.normal.normalize_or(-dir),
            flags: self.flags,
            level: self.level,
        };
        let lit = through_haze(frame, shade(frame, &surface), air, self.mean_m / share);
        Lit { sky: lit.sky * share, sun: lit.sun * share }
    }
}

/// In finest squares around the camera's, whose edges are whole numbers.
fn walk_grid(scene: &SceneRef<'_>, leg: &Leg, gathered: &mut Gathered) {
    let frame = scene.frame;
    if frame.levels == 0 {
        return;
    }
    let o = Vec2::from(frame.eye) + leg.from.xy() / frame.side_m;
    let (eye_cell, z_from) = (IVec2::from(frame.eye_cell), frame.z_eye + leg.from.z * frame.z_scale);
    let d = nonzero(leg.dir.xy() / frame.side_m);
    let inv = 1.0 / d;
    let dz = leg.dir.z * frame.z_scale;
    let dz = if dz.abs() < 1e-12 { 1e-12 } else { dz };
    let ahead = ahead(d);
    let (forward, top) = (ahead.as_ivec2(), frame.levels - 1);
    let squares = 1i32 << top;
    let low = (-eye_cell).as_vec2();
    let near = (low + (1.0 - ahead) * squares as f32 - o) * inv;
    let far = (low + ahead * squares as f32 - o) * inv;
    let (za, zb) = ((-1.0 - z_from) / dz, (Z_TOP + 1.0 - z_from) / dz);
    let mut t = most(most(most(near.x, near.y), least(za, zb)), 0.0);
    let t_end = least(least(least(far.x, far.y), most(za, zb)), leg.reach_m);
    if t >= t_end {
        return;
    }
    let mut cell = (floor2(o + d * t) + eye_cell).clamp(IVec2::ZERO, IVec2::splat(squares - 1));
    let mut k = level_at(frame, leg.eye_m + t);
    for _ in 0..MAX_STEPS {
        let (entry, level) = look_up(scene, cell, k);
        gathered.counts.steps += 1;
        let is_node = entry[0] & GRID_NODE_BIT != 0;
        k = if is_node { entry[0] >> GRID_LEVEL_SHIFT & 31 } else { level };
        let corner = cell >> k << k;
        let edge = corner + (forward << k);
        let te = ((edge - eye_cell).as_vec2() - o) * inv;
        let exit = most(least(least(te.x, te.y), t_end), t);
        let (za, zb) = (z_from + dz * t, z_from + dz * exit);
        let meets = least(za, zb) <= (entry[1] >> 16) as f32 + 1.0 && most(za, zb) + 1.0 >= (entry[1] & 0xffff) as f32;
        if meets && entry[0] == GRID_MIXED && k > 0 {
            k -= 1;
            continue;
        }
        if meets && is_node {
            walk_node(scene, seen_by(leg, entry[0]), leg, t, exit, gathered);
        }
        t = exit;
        let mut next = floor2(o + d * t) + eye_cell;
        next = next.clamp(corner, corner + ((1 << k) - 1));
        if te.x <= te.y {
            next.x = edge.x - 1 + forward.x;
        } else {
            next.y = edge.y - 1 + forward.y;
        }
        let inside = next.min_element() >= 0 && next.max_element() < squares;
        if gathered.left <= OPAQUE || t >= t_end || !inside {
            return;
        }
        // The largest square that holds the new place and not the old one: what is larger was seen to be mixed.
        let apart = 31 - ((cell.x ^ next.x) | (cell.y ^ next.y)).leading_zeros();
        k = level_at(frame, leg.eye_m + t).min(apart);
        cell = next;
    }
}

/// The node that a ray sees in a square: the one that the entry names, or the one behind it.
fn seen_by(leg: &Leg, entry: u32) -> u32 {
    (entry & (GRID_NODES as u32 - 1)) + u32::from(leg.threshold < entry >> GRID_SHARE_SHIFT & 63)
}

/// The level whose nodes are good enough at a distance.
fn level_at(frame: &FrameUniform, t: f32) -> u32 {
    // The exponent is the logarithm, rounded down.
    let level = (most(t * frame.level_scale, 1.0).to_bits() >> 23) - 127;
    level.min(frame.levels - 1)
}

/// The entry for a finest square at level `k`, or at the first coarser level whose window holds it, and that level.
fn look_up(scene: &SceneRef<'_>, cell: IVec2, k: u32) -> ([u32; 2], u32) {
    let windows = &scene.frame.windows;
    for (level, [base, log2, low_x, low_y]) in windows.iter().enumerate().skip(k as usize) {
        let place = (cell >> level as i32) - IVec2::new(*low_x, *low_y);
        if (place >> *log2) == IVec2::ZERO {
            let at = base + (place.y << log2) + place.x;
            return (scene.grid.get(at as usize).copied().unwrap_or_default(), level as u32);
        }
    }
    ([0; 2], scene.frame.levels - 1)
}

fn walk_node(scene: &SceneRef<'_>, index: u32, leg: &Leg, t_in: f32, t_out: f32, gathered: &mut Gathered) {
    let Some(node) = scene.nodes.get(index as usize) else { return };
    if node.mesh != 0 {
        walk_mesh(scene, node, index, leg, gathered);
        return;
    }
    let scale = Vec3::new(1.0 / node.cell_m, 1.0 / node.cell_m, 1.0 / node.z_step_m);
    let o = (leg.from - Vec3::from(node.corner)) * scale;
    let d_xy = nonzero(leg.dir.xy() * scale.xy());
    let dz = leg.dir.z * scale.z;
    let dz = if dz.abs() < 1e-12 { 1e-12 } else { dz };
    let a = (node.z_lo - 1.0 - o.z) / dz;
    let b = (node.z_hi + 1.0 - o.z) / dz;
    let t_end = least(t_out, most(a, b));
    let mut t = most(t_in, least(a, b));
    let z = |t: f32| o.z + dz * t;
    let highest = highest_on(node, o.xy() + d_xy * t, o.xy() + d_xy * t_end);
    if t > t_end || least(z(t), z(t_end)) > highest {
        return;
    }
    gathered.counts.nodes += 1;
    let ray = NodeRay { node, index, leg: *leg, o, d: d_xy.extend(dz), inv: 1.0 / d_xy };
    let ahead = ahead(d_xy);
    let step = (ahead * 2.0 - 1.0).as_ivec2();
    let blocks = NODE_CELLS as i32 / BLOCK_CELLS as i32;
    let p = (o.xy() + d_xy * t) / BLOCK_CELLS as f32;
    let mut block = floor2(p).clamp(IVec2::ZERO, IVec2::splat(blocks - 1));
    for _ in 0..2 * blocks {
        let te = ((block.as_vec2() + ahead) * BLOCK_CELLS as f32 - o.xy()) * ray.inv;
        let exit = least(te.x, te.y);
        let t_block = most(least(exit, t_end), t);
        let slot = node.slot() * SUMMARY_WORDS;
        let at = (block.y * blocks + block.x) as usize;
        gathered.counts.fetches += 1;
        let quads = Quads::new(scene.summaries.get(slot + at * 4..).and_then(|words| words.first_chunk()));
        let (za, zb) = (o.z + dz * t, o.z + dz * t_block);
        if least(za, zb) <= quads.high && most(za, zb) >= quads.low {
            walk_block(scene, &ray, (block, &quads), t, t_block, gathered);
            if gathered.left <= OPAQUE {
                return;
            }
        }
        if exit >= t_end {
            return;
        }
        if te.x <= te.y {
            block.x += step.x;
        } else {
            block.y += step.y;
        }
        if block.min_element() < 0 || block.max_element() >= blocks {
            return;
        }
        t = t_block;
    }
}

/// The highest point, and a little more, of the quarters of a node that a ray crosses between two places in it.
fn highest_on(node: &DrawNode, from: Vec2, to: Vec2) -> f32 {
    let half = NODE_CELLS as f32 / 2.0;
    let quarter = |p: Vec2| usize::from(p.x >= half) + 2 * usize::from(p.y >= half);
    let (a, b) = (quarter(from), quarter(to));
    // From a quarter to the opposite one the ray crosses a third.
    let below = if a ^ b == 3 { 0 } else { node.quarter_below(a).min(node.quarter_below(b)) };
    node.z_hi + 1.0 - below as f32 * (node.z_hi - node.z_lo) * (1.0 / 255.0)
}

/// Highest points of a block's quads of 2 x 2 cells, in height codes.
struct Quads {
    /// Of the block, a little beyond what is there, so that rounding hides nothing.
    low: f32,
    high: f32,
    /// Of the tops' six bits.
    step: f32,
    rows: [u32; 4],
}

impl Quads {
    fn new(words: Option<&[u32; 4]>) -> Self {
        let rows = *words.unwrap_or(&[0xff << 24, 0xff << 24, 0, 0]);
        let [a, b, c, d] = rows.map(|word| word >> 24);
        let (low, high) = ((a | b << 8) as f32, (c | d << 8) as f32);
        Self { low: low - 1.0, high: high + 1.0, step: (high - low) * (1.0 / 63.0), rows }
    }

    /// A little above it too.
    fn top(&self, cell: IVec2) -> f32 {
        let (row, shift) = (cell.y as usize >> 1 & 3, (cell.x as u32 >> 1 & 3) * 6);
        self.low + 2.0 + (self.rows[row] >> shift & 63) as f32 * self.step
    }
}

fn walk_block(
    scene: &SceneRef<'_>,
    ray: &NodeRay<'_>,
    (block, quads): (IVec2, &Quads),
    t_in: f32,
    t_end: f32,
    gathered: &mut Gathered,
) {
    let (o, d) = (ray.o.xy(), ray.d.xy());
    let ahead = ahead(d);
    let step = (ahead * 2.0 - 1.0).as_ivec2();
    let low = block * BLOCK_CELLS as i32;
    let high = low + BLOCK_CELLS as i32 - 1;
    let mut t = t_in;
    let mut cell = floor2(o + d * t).clamp(low, high);
    for _ in 0..2 * BLOCK_CELLS {
        let te = (cell.as_vec2() + ahead - o) * ray.inv;
        let exit = least(te.x, te.y);
        let t_cell = most(least(exit, t_end), t);
        let top = quads.top(cell);
        if least(ray.o.z + ray.d.z * t, ray.o.z + ray.d.z * t_cell) <= top {
            gathered.counts.cells += 1;
            column(scene, ray, cell, [t, t_cell], top, gathered);
        }
        if gathered.left <= OPAQUE || exit >= t_end {
            return;
        }
        if te.x <= te.y {
            cell.x += step.x;
        } else {
            cell.y += step.y;
        }
        if cell.cmplt(low).any() || cell.cmpgt(high).any() {
            return;
        }
        t = t_cell;
    }
}
