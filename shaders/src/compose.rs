//! Lines at silhouettes and shade where surfaces meet, found from the distances of a frame's pixels. GPU twins:
//! `wgsl/shared/depth.wgsl`, `wgsl/contact.wgsl` and `wgsl/compose.wgsl`.
//!
//! Both work on inverse depths, which are linear across a plane, so that a plane has neither whatever its slope. The shade is that of
//! Alchemy (McGuire et al., "The Alchemy Screen-Space Ambient Obscurance Algorithm", 2011) for one pixel of each block of two by two.

use crate::layout::{ComposeUniform, FrameUniform, GOLDEN_TURN, Shading};
use crate::parallel::*;
use glam::{IVec2, Vec2, Vec3, Vec4, Vec4Swizzles};

/// A pixel that is nearer than the mean of its neighbours by these shares of its depth begins to have a line, and has it.
pub(crate) const LINE_BEGIN: f32 = 0.004;
pub(crate) const LINE_FULL: f32 = 0.02;
/// Depth in metres at which lines have faded.
pub(crate) const LINE_FAR_M: f32 = 2600.0;
/// Metres around a place that shade it, and the most of the picture's height that they take.
pub(crate) const CONTACT_M: f32 = 9.0;
pub(crate) const CONTACT_SHARE: f32 = 1.0 / 12.0;
/// Pixels: where these metres take fewer, there is no shade, and from twice as many on all of it.
pub(crate) const CONTACT_LEAST_PX: f32 = 3.0;
/// Places around a pixel that may shade it.
pub(crate) const CONTACT_TAPS: u32 = 8;
/// Shares of the depth, and of the metres around, by which a place lies above the surface before it shades: distances are rounded.
pub(crate) const CONTACT_DEPTH_SLACK: f32 = 0.0025;
pub(crate) const CONTACT_SLACK: f32 = 0.02;
/// Share of the squared metres around that keeps the nearest places from counting for all, and the share beyond which places are of
/// something else.
pub(crate) const CONTACT_SOFT: f32 = 0.06;
pub(crate) const CONTACT_REACH: f32 = 1.5;
/// Factor from the mean of the places to the shade.
pub(crate) const CONTACT_GAIN: f32 = 1.3;

impl ComposeUniform {
    pub(crate) fn new(frame: &FrameUniform, frame_px: [u32; 2], target_px: [u32; 2]) -> Self {
        let [forward, right, up] = [frame.forward, frame.right, frame.up].map(Vec3::from);
        // A frame is wider or narrower than its direction's unit vector where it is a part of another one.
        let is_whole = frame.shading == Shading::Lit as u32 && (forward.length_squared() - 1.0).abs() < 1e-3;
        let below = if frame.ground != 0 && frame.ground_z_m < 0.0 { 1.0 / frame.ground_z_m } else { 0.0 };
        Self {
            frame_px,
            target_px,
            is_lit: u32::from(frame.shading == Shading::Lit as u32),
            exposure: frame.exposure,
            key: frame.light.key,
            padding: 0.0,
            grade: frame.light.grade,
            edges: if is_whole { frame.edges } else { [0.0; 4] },
            plane: (Vec3::new(forward.z, right.z, up.z) * below).extend(0.0).to_array(),
            tan: [right.length(), up.length()],
            unused: [0; 2],
        }
    }
}

/// Factor for the radiance of each pixel of a frame, whose distances are given; none where the frame has neither lines nor shade.
pub(crate) fn shades(frame: &FrameUniform, distances: &[f32]) -> Option<Vec<f32>> {
    let size = [frame.width_px, frame.height_px];
    let settings = ComposeUniform::new(frame, size, size);
    let [lines, contact, ..] = settings.edges;
    if distances.is_empty() || distances.len() as u64 != u64::from(size[0]) * u64::from(size[1]) {
        return None;
    }
    (lines > 0.0 || contact > 0.0).then(|| DepthPicture::new(&settings, distances).shades())
}

/// The inverse depths of a frame's pixels.
struct DepthPicture<'a> {
    settings: &'a ComposeUniform,
    /// Width and height, not 0.
    size: IVec2,
    distances: &'a [f32],
    inverse: Vec<f32>,
}

impl<'a> DepthPicture<'a> {
    fn new(settings: &'a ComposeUniform, distances: &'a [f32]) -> Self {
        let size = IVec2::from(settings.frame_px.map(|side| side as i32));
        let mut inverse = vec![0.0; distances.len()];
        let width = size.x as usize;
        inverse.par_chunks_mut(width).zip(distances.par_chunks(width)).enumerate().for_each(|(y, (out, distances))| {
            for (x, (out, distance)) in out.iter_mut().zip(distances).enumerate() {
                *out = inverse_depth(settings, ndc(size, IVec2::new(x as i32, y as i32)), *distance);
            }
        });
        Self { settings, size, distances, inverse }
    }

    /// Inverse depth of the pixel nearest to `at`.
    #[inline]
    fn at(&self, at: IVec2) -> f32 {
        let at = at.clamp(IVec2::ZERO, self.size - 1);
        self.inverse[(at.y * self.size.x + at.x) as usize]
    }

    fn shades(&self) -> Vec<f32> {
        let [lines, contact, ..] = self.settings.edges;
        let blocks = (self.size + 1) / 2;
        let shade = if contact > 0.0 { self.block_shades(blocks) } else { Vec::new() };
        let mut out = vec![1.0; self.inverse.len()];
        out.par_chunks_mut(self.size.x as usize).enumerate().for_each(|(y, row)| {
            let y = y as i32;
            for (x, out) in (0..).zip(row) {
                let at = IVec2::new(x, y);
                if lines > 0.0 {
                    *out -= lines * self.line(at);
                }
                if contact > 0.0 {
                    *out *= 1.0 - contact * mean_around(&shade, blocks, at);
                }
            }
        });
        out
    }

    /// How much of a line a pixel has, 0 to 1. What is nearer than its next neighbours must be nearer than those behind them, too: a ray
    /// that slips between two tiles leaves a hole of one pixel, and around that is no silhouette.
    #[inline]
    fn line(&self, at: IVec2) -> f32 {
        if !self.distances[(at.y * self.size.x + at.x) as usize].is_finite() {
            return 0.0;
        }
        let own = self.at(at);
        let nearer = |step: IVec2| own - 0.5 * (self.at(at - step) + self.at(at + step));
        let least = LINE_BEGIN * own;
        let [mut across, mut down] = [nearer(IVec2::X), nearer(IVec2::Y)];
        if across.max(down) <= least {
            return 0.0;
        }
        (across, down) = (across.min(nearer(IVec2::X * 2)), down.min(nearer(IVec2::Y * 2)));
        let t = ((across.max(down) - least) / (own * (LINE_FULL - LINE_BEGIN))).clamp(0.0, 1.0);
        t * t * (3.0 - 2.0 * t) * (1.0 - 1.0 / (own * LINE_FAR_M)).clamp(0.0, 1.0)
    }

    /// The shade of a pixel of each block.
    fn block_shades(&self, blocks: IVec2) -> Vec<f32> {
        let mut out = vec![0.0; (blocks.x * blocks.y) as usize];
        out.par_chunks_mut(blocks.x as usize).enumerate().for_each(|(y, row)| {
            for (x, out) in (0..).zip(row) {
                *out = self.contact(IVec2::new(x, y as i32));
            }
        });
        out
    }

    /// The shade of a block's pixel, 0 to 1.
    fn contact(&self, block: IVec2) -> f32 {
        let at = (block * 2).min(self.size - 1);
        let (own, focal) = (self.at(at), 0.5 * self.size.y as f32 / self.settings.tan[1]);
        let around_px = (CONTACT_M * focal * own).min(self.size.y as f32 * CONTACT_SHARE);
        let fade = (around_px / CONTACT_LEAST_PX - 1.0).min(1.0);
        if fade <= 0.0 || !self.distances[(at.y * self.size.x + at.x) as usize].is_finite() {
            return 0.0;
        }
        // The tangent plane in inverse depth: the flatter one of the two sides.
        let slope = |step: IVec2| {
            let (before, after) = (own - self.at(at - step), self.at(at + step) - own);
            if before.abs() < after.abs() { before } else { after }
        };
        let slope = Vec2::new(slope(IVec2::X), slope(IVec2::Y));
        let from_middle = ndc(self.size, at) * Vec2::from(self.settings.tan) * focal;
        let plane = (slope * focal).extend(own - slope.dot(from_middle));
        let plane_m = 1.0 / plane.length();
        let (depth_m, m_per_px) = (1.0 / own, 1.0 / (own * focal));
        let around_m = around_px * m_per_px;
        let phase = (block.x & 1) + 2 * (block.y & 1);
        let mut turn = [Vec2::X, Vec2::Y, Vec2::NEG_X, Vec2::NEG_Y][phase as usize];
        let mut sum = 0.0;
        for tap in 0..CONTACT_TAPS {
            let share = (tap as f32 + 0.2 + 0.2 * phase as f32) / CONTACT_TAPS as f32;
            let place = (at + (turn * (around_px * share)).round().as_ivec2()).clamp(IVec2::ZERO, self.size - 1);
            turn = GOLDEN_TURN.rotate(turn);
            let (other, step) = (self.at(place), (place - at).as_vec2());
            let depth = 1.0 / other.max(1e-9);
            let above_m = plane_m * (1.0 - (own + slope.dot(step)).max(0.0) * depth);
            let squared = step.length_squared() * m_per_px * m_per_px + (depth - depth_m) * (depth - depth_m);
            let near = (1.0 - squared / (around_m * around_m * CONTACT_REACH)).max(0.0);
            let risen = (above_m - CONTACT_DEPTH_SLACK * depth_m - CONTACT_SLACK * around_m).max(0.0);
            sum += risen * around_m / (squared + CONTACT_SOFT * around_m * around_m) * near * near;
        }
        (sum * CONTACT_GAIN / CONTACT_TAPS as f32).min(1.0) * fade
    }
}

/// Mean of the four blocks around a pixel, which have the taps of all phases.
fn mean_around(shade: &[f32], blocks: IVec2, at: IVec2) -> f32 {
    let first = (at - 1) >> 1_i32;
    let read = |step: IVec2| {
        let block = (first + step).clamp(IVec2::ZERO, blocks - 1);
        shade[(block.y * blocks.x + block.x) as usize]
    };
    0.25 * (read(IVec2::ZERO) + read(IVec2::X) + read(IVec2::Y) + read(IVec2::ONE))
}

/// The middle of a pixel: -1 to 1 to the right and down.
fn ndc(size: IVec2, at: IVec2) -> Vec2 {
    (at.as_vec2() + 0.5) / size.as_vec2() * 2.0 - 1.0
}

/// Inverse depth in metres at a place of the picture; that of the plane without columns where no node was hit, 0 in the sky. What lies
/// below the plane counts as being on it: rays see the ends of generated ground through the plane, a cell deep, and they would be lines.
fn inverse_depth(settings: &ComposeUniform, ndc: Vec2, distance_m: f32) -> f32 {
    let of_plane = Vec4::from(settings.plane).xyz().dot(Vec3::new(1.0, ndc.x, -ndc.y)).max(0.0);
    if distance_m.is_finite() {
        return ((1.0 + (ndc * Vec2::from(settings.tan)).length_squared()).sqrt() / distance_m).max(of_plane);
    }
    of_plane
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;

    const SIDE: u32 = 64;

    /// The shades of a plane 100 m below a camera that looks down, in whose middle is something else, by the distance of the plane there.
    fn shades_with(other_m: impl Fn(f32) -> f32) -> Vec<f32> {
        let frame = FrameUniform {
            forward: [0.0, 0.8, -0.6],
            right: [0.5, 0.0, 0.0],
            up: [0.0, 0.3, 0.4],
            width_px: SIDE,
            height_px: SIDE,
            shading: Shading::Lit as u32,
            ground: 1,
            ground_z_m: -100.0,
            edges: [0.34, 0.85, 0.0, 0.0],
            ..FrameUniform::zeroed()
        };
        let size = IVec2::splat(SIDE as i32);
        let distance = |i: i32| {
            let at = IVec2::new(i % size.x, i / size.x);
            if (at - size / 2).abs().max_element() > 6 {
                return f32::INFINITY;
            }
            let ndc = ndc(size, at);
            let dir = Vec3::from(frame.forward) + Vec3::from(frame.right) * ndc.x - Vec3::from(frame.up) * ndc.y;
            other_m(-100.0 / dir.z * dir.length())
        };
        let distances: Vec<f32> = (0..size.x * size.y).map(distance).collect();
        shades(&frame, &distances).unwrap()
    }

    #[test]
    fn holes_of_one_pixel_have_no_lines() {
        let frame = FrameUniform {
            forward: [0.0, 1.0, 0.0],
            right: [0.5, 0.0, 0.0],
            up: [0.0, 0.0, 0.5],
            width_px: SIDE,
            height_px: SIDE,
            shading: Shading::Lit as u32,
            edges: [0.34, 0.0, 0.0, 0.0],
            ..FrameUniform::zeroed()
        };
        let least = |far: &dyn Fn(u32, u32) -> bool| {
            let distance = |i: u32| if far(i % SIDE, i / SIDE) { 200.0 } else { 100.0 };
            let distances: Vec<f32> = (0..SIDE * SIDE).map(distance).collect();
            shades(&frame, &distances).unwrap().into_iter().fold(1.0, f32::min)
        };
        assert!(least(&|x, y| (x, y) == (32, 32)) > 0.99);
        // A border of two surfaces.
        assert!(least(&|x, _| x >= 32) < 0.7);
        // A mast of one pixel.
        assert!(least(&|x, _| x != 32) < 0.7);
    }

    #[test]
    fn what_is_seen_through_the_plane_has_neither_lines_nor_shade() {
        let least = |shades: Vec<f32>| shades.into_iter().fold(1.0, f32::min);
        assert!(least(shades_with(|plane_m| plane_m + 4.0)) > 0.999);
        // Something above the plane has lines.
        assert!(least(shades_with(|plane_m| plane_m - 10.0)) < 0.9);
    }
}
