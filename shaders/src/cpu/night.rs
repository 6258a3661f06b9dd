//! What shines at night: stars, the moon, lamps, lit windows. GPU twin: `night.wgsl`.

use super::node::column_word;
use super::ray::SceneRef;
use super::surface::{SurfaceSample, rgb};
use super::words::low_of;
use crate::lanes::{LaneWords, Lanes, OneLane, U};
use crate::layout::FrameUniform;
use glam::{DVec3, IVec3, Vec3};

/// Cells of the grid of stars along the unit sphere's radius, one in how many has a star, and how small stars are.
pub(crate) const STAR_CELLS: f32 = 140.0;
pub(crate) const STAR_RARITY: u32 = 90;
pub(crate) const STAR_SHARPNESS: f32 = 30.0;
/// Angular radius of the moon in radians.
pub(crate) const MOON_RADIUS: f32 = 0.0045;
/// Cosine of the sun's angle to the moon's surface from which it is fully lit: the moon is flatter than a matt sphere.
pub(crate) const MOON_TERMINATOR: f32 = 0.4;
/// Lamps stand in streets: their light begins where this part of the sky is hidden, and grows with it, to all of it after the inverse
/// of the depth. Ground that far from houses has become the plane, which has no lamps: without a beginning, houses stood on islands.
pub(crate) const LAMP_BEGIN: f32 = 0.06;
pub(crate) const LAMP_DEPTH: f32 = 2.6;
/// Share of that light on walls.
pub(crate) const LAMPS_ON_WALLS: f32 = 0.25;
/// Least part of that share on a wall, however open its surroundings are. Occlusion ends a metre or two from a wall's edge: without
/// any light, the edge would look stained.
pub(crate) const LAMPS_IN_THE_OPEN: f32 = 0.4;
/// Height above the street in metres at which their light ends, and below that the metres in which it falls.
pub(crate) const LAMP_TOP_M: f32 = 9.0;
pub(crate) const LAMP_FALL_M: f32 = 7.0;
/// Windows along a wall, and storeys, per metre.
pub(crate) const BAYS_PER_M: f32 = 1.0 / 3.2;
/// Most bays from the world's origin that [`FrameUniform::bays`] counts; a power of two. Then the pattern repeats.
pub(crate) const BAY_COUNT: i32 = 4096;
/// Where the glass begins and ends in a bay and in a storey.
pub(crate) const GLASS_WEST: f32 = 0.28;
pub(crate) const GLASS_EAST: f32 = 0.72;
pub(crate) const GLASS_LOW: f32 = 0.3;
pub(crate) const GLASS_HIGH: f32 = 0.78;
/// Share of the windows that are lit.
pub(crate) const LIT_SHARE: f32 = 0.18;
/// Brightness of the darkest lit window; the brightest has 1.
pub(crate) const WINDOW_MIN: f32 = 0.3;
/// Largest vertical part of a normal that has windows.
pub(crate) const MAX_WINDOW_SLOPE: f32 = 0.3;
/// Walls this many bays apart have other windows lit: a power of two as logarithm.
pub(crate) const WINDOW_DEPTH_SHIFT: u32 = 5;

/// One cell in [`STAR_RARITY`] of a grid over the unit sphere has a star. Few are bright.
pub(super) fn stars(brightest: f32, dir: Vec3) -> f32 {
    if brightest <= 0.0 {
        return 0.0;
    }
    let place = dir * STAR_CELLS;
    let cell = place.floor();
    let hash = scramble_cell(cell.as_ivec3());
    if !hash.is_multiple_of(STAR_RARITY) {
        return 0.0;
    }
    let magnitude = (hash >> 16) as f32 / 65_535.0;
    let apart = (place - cell - 0.5).length_squared();
    brightest * magnitude * magnitude * magnitude * (-STAR_SHARPNESS * apart).exp()
}

/// Radiance of the moon's disc, lit by the sun from its side.
pub(super) fn moon(frame: &FrameUniform, dir: Vec3) -> f32 {
    let [x, y, z, brightness] = frame.light.moon;
    let middle = Vec3::new(x, y, z);
    let offset = (dir - middle) / MOON_RADIUS;
    let from_middle = offset.length_squared();
    if brightness <= 0.0 || from_middle >= 1.0 {
        return 0.0;
    }
    let surface = offset - middle * (1.0 - from_middle).sqrt();
    let lit = (surface.dot(Vec3::from(frame.sun)) / MOON_TERMINATOR).clamp(0.0, 1.0);
    brightness * lit
}

/// Light of lamps that a surface of node number `node` at `p` relative to the camera reflects. Lamps stand in streets: roofs are dark. The
/// street is as high as the surface's column begins, or as the part below the column's gap ends.
pub(super) fn lamp_light(scene: &SceneRef<'_>, node: u32, surface: &SurfaceSample, p: Vec3) -> Vec3 {
    let (street, n) = (scene.frame.light.street, surface.normal);
    let Some(node) = scene.nodes.get(node as usize).filter(|_| street[3] > 0.0) else { return Vec3::ZERO };
    let place = p - Vec3::from(node.corner);
    let above_m = place.z - low_of(column_word(scene, node, place - n * (0.5 * node.cell_m))) * node.z_step_m;
    let share = ((LAMP_TOP_M - above_m) / LAMP_FALL_M).clamp(0.0, 1.0);
    let upright = n.z.abs();
    let open = (surface.ao / (0.5 + 0.5 * upright)).min(1.0);
    let least = LAMPS_IN_THE_OPEN * (1.0 - upright);
    let deep = (LAMP_DEPTH * (1.0 - LAMP_BEGIN - open)).clamp(0.0, 1.0);
    let near = (deep * deep * (3.0 - 2.0 * deep)).max(least) * n.z.max(LAMPS_ON_WALLS);
    surface.albedo * rgb(street) * (near * share * share)
}

/// Light from windows in a wall at `p` relative to the camera, `distance_m` away, with normal `n`. They lie on a grid of bays and
/// storeys. Where a pixel covers a bay, it shows the windows' mean.
pub(super) fn lit_windows(frame: &FrameUniform, p: Vec3, n: Vec3, distance_m: f32) -> Vec3 {
    if n.z.abs() > MAX_WINDOW_SLOPE {
        return Vec3::ZERO;
    }
    let [east, north, up, pixel] = frame.bays;
    let place = p * BAYS_PER_M + Vec3::new(east, north, up);
    let faces_north = n.y.abs() > n.x.abs();
    let (across, deep) = if faces_north { (place.x, place.y) } else { (place.y, place.x) };
    let footprint = (distance_m * pixel * BAYS_PER_M).max(1e-3);
    let glass = covered(across, GLASS_WEST, GLASS_EAST, footprint) * covered(place.z, GLASS_LOW, GLASS_HIGH, footprint);
    let side = (i32::from(faces_north) << 1) | i32::from(n.x + n.y > 0.0);
    let depth = bay_of(deep) >> WINDOW_DEPTH_SHIFT << 2 | side;
    let hash = scramble_cell(IVec3::new(bay_of(across), bay_of(place.z), depth));
    let chance = (hash & 0xffff) as f32 / 65_536.0;
    let lit = if chance < LIT_SHARE {
        glass * (WINDOW_MIN + (1.0 - WINDOW_MIN) * (hash >> 16) as f32 / 65_536.0)
    } else {
        0.0
    };
    let mean = LIT_SHARE * (0.5 + 0.5 * WINDOW_MIN) * (GLASS_EAST - GLASS_WEST) * (GLASS_HIGH - GLASS_LOW);
    let blur = (2.0 * footprint - 0.5).clamp(0.0, 1.0);
    let [r, g, b, _] = frame.light.window;
    Vec3::new(r, g, b) * (lit + (mean - lit) * blur)
}

fn bay_of(v: f32) -> i32 {
    v.floor() as i32 & (BAY_COUNT - 1)
}

/// Share of a footprint around `v` that lies between two places of a unit.
fn covered(v: f32, low: f32, high: f32, footprint: f32) -> f32 {
    let within = v - v.floor();
    let below = |edge: f32| ((edge - within) / footprint + 0.5).clamp(0.0, 1.0);
    below(high) - below(low)
}

/// A word whose bits depend on all bits of a lattice cell's coordinates. It is the same on all devices.
pub fn scramble_cell(cell: IVec3) -> u32 {
    let [x, y, z] = cell.as_uvec3().to_array();
    let scramble = scramble::<OneLane>;
    scramble(scramble(scramble(x).wrapping_add(y)).wrapping_add(z))
}

/// A word whose bits depend on all bits of another (Wang's integer hash, 2007).
#[inline(always)]
pub(super) fn scramble<S: Lanes>(word: U<S>) -> U<S> {
    let h = (word ^ 61) ^ (word >> 16);
    let h = h.wrapping_mul(9);
    let h = h ^ (h >> 4);
    let h = h.wrapping_mul(0x27d4_eb2d);
    h ^ (h >> 15)
}

/// [`FrameUniform::bays`] of a camera at `eye`, with the size of a ray at a distance of one metre.
pub fn bays_of(eye: DVec3, ray_m: f32) -> [f32; 4] {
    let bays = eye * f64::from(BAYS_PER_M);
    let wrapped = |v: f64| v.rem_euclid(f64::from(BAY_COUNT)) as f32;
    [wrapped(bays.x), wrapped(bays.y), wrapped(bays.z), ray_m]
}
