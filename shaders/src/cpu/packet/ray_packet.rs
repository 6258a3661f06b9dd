//! The rays of a packet: their pixels, directions, and points of the sun.

use super::lanes::{F, M, U, Vec3s, float_u, lane_numbers, lanes_of, splat, splat_u};
use super::trace::{TracedRays, trace};
use crate::cpu::ray::SceneRef;
use crate::cpu::raycast::{ray_directions, sun_axes, sun_direction, thresholds};
use crate::layout::{FrameUniform, GOLDEN_TURN};
use crate::tone::gradient_noise;
use fearless_simd::prelude::*;
use glam::Vec2;
use std::f32::consts::TAU;

/// A ray of the frame: its pixel, and its number in that.
#[derive(Clone, Copy)]
pub(super) struct FrameRay {
    /// Column, and row of the frame.
    pub(super) x: u32,
    pub(super) y: u32,
    pub(super) sample: u32,
}

/// Rays in the lanes of a packet.
#[derive(Clone, Copy)]
pub(super) struct RayPacket<S: Simd> {
    /// Columns and rows of their pixels.
    x: U<S>,
    y: U<S>,
    /// Numbers in their pixels, and columns and rows in those.
    sample: U<S>,
    column: U<S>,
    row: U<S>,
    lanes: M<S>,
}

/// A block of neighbouring pixels, which has as many as a packet has rays.
#[derive(Clone, Copy)]
pub(super) struct PixelBlock {
    left: u32,
    top: u32,
    wide: u32,
    high: u32,
}

/// Where the pixels of a block are written to.
#[derive(Clone, Copy)]
pub(super) struct PixelRows {
    pub(super) block: PixelBlock,
    pub(super) width: u32,
    pub(super) rows: u32,
}

impl PixelRows {
    /// Sets the pixels of the block that are inside.
    #[inline(always)]
    pub(super) fn write<T>(self, out: &mut [T], value: impl Fn(usize) -> T) {
        let PixelBlock { left, top, wide, high } = self.block;
        let inside = wide.min(self.width - left);
        for row in 0..high.min(self.rows - top) {
            let begin = ((top + row) * self.width + left) as usize;
            let Some(pixels) = out.get_mut(begin..begin + inside as usize) else { return };
            for (pixel, column) in pixels.iter_mut().zip(0..) {
                *pixel = value((row * wide + column) as usize);
            }
        }
    }
}

/// The blocks of `lanes` pixels that `count` pixels of whole rows are made of. Those at the ends may be partly outside.
pub(super) fn blocks_of(width: u32, count: usize, lanes: u32) -> impl Iterator<Item = PixelBlock> {
    let rows = count as u32 / width.max(1);
    let high = match (rows, lanes) {
        (1, _) => 1,
        (_, 16..) => 4,
        _ => 2,
    };
    let wide = lanes / high;
    (0..rows)
        .step_by(high as usize)
        .flat_map(move |top| (0..width).step_by(wide as usize).map(move |left| PixelBlock { left, top, wide, high }))
}

/// Rays for the pixels of rows from row `first`, `count` in all, in the order of blocks of `lanes` neighbours.
pub(super) fn in_blocks(width: u32, first: u32, count: usize, lanes: u32) -> Vec<FrameRay> {
    let rows = count as u32 / width.max(1);
    let mut rays = Vec::with_capacity(count);
    for PixelBlock { left, top, wide, high } in blocks_of(width, count, lanes) {
        for y in top..(top + high).min(rows) {
            rays.extend((left..(left + wide).min(width)).map(|x| FrameRay { x, y: first + y, sample: 0 }));
        }
    }
    rays
}

impl<S: Simd> RayPacket<S> {
    /// Rays of a frame of `samples` along a pixel's side.
    #[inline(always)]
    pub(super) fn new(simd: S, rays: &[FrameRay], samples: u32) -> Self {
        let zeros = splat_u(simd, 0);
        let lanes = M::<S>::from_bitmask(simd, (1u64 << rays.len().min(F::<S>::LEN)) - 1);
        let mut packet = Self { x: zeros, y: zeros, sample: zeros, column: zeros, row: zeros, lanes };
        for (lane, ray) in rays.iter().enumerate().take(F::<S>::LEN) {
            (packet.x[lane], packet.y[lane], packet.sample[lane]) = (ray.x, ray.y, ray.sample);
            (packet.column[lane], packet.row[lane]) = (ray.sample % samples, ray.sample / samples);
        }
        packet
    }

    /// The rays of this number of the pixels in a block of rows of `[width, rows]` pixels, the first of which is row `first` of the
    /// frame.
    #[inline(always)]
    pub(super) fn of_block(
        simd: S,
        block: PixelBlock,
        (first, [width, rows]): (u32, [u32; 2]),
        (samples, sample): (u32, u32),
    ) -> Self {
        let lane = lane_numbers(simd);
        let down = lane >> block.wide.ilog2();
        let (x, y) = ((lane & (block.wide - 1)) + block.left, down + block.top);
        let lanes = x.simd_lt(splat_u(simd, width)) & y.simd_lt(splat_u(simd, rows));
        let (column, row) = (splat_u(simd, sample % samples), splat_u(simd, sample / samples));
        Self { x, y: y + first, sample: splat_u(simd, sample), column, row, lanes }
    }

    /// Directions of the rays, of `samples` along a pixel's side; without, those of the pixels' centres.
    #[inline(always)]
    pub(super) fn direction(&self, simd: S, frame: &FrameUniform, samples: Option<u32>) -> Vec3s<S> {
        let (mut right, mut down) = (splat(simd, 0.5), splat(simd, 0.5));
        if let Some(n) = samples {
            right = (float_u::<S>(self.column) + 0.5) / n as f32;
            down = (float_u::<S>(self.row) + 0.5) / n as f32;
        }
        ray_directions(simd, frame, [float_u::<S>(self.x) + right, float_u::<S>(self.y) + down])
    }

    // Vector instructions of a CPU need it in the function that has them. WebAssembly has one set, and would have three copies to fetch.
    #[cfg_attr(not(target_arch = "wasm32"), inline(always))]
    #[cfg_attr(target_arch = "wasm32", inline(never))]
    pub(super) fn trace(
        &self,
        simd: S,
        scene: &SceneRef<'_>,
        samples: u32,
        (dir, airlight): (Vec3s<S>, Vec3s<S>),
    ) -> TracedRays<S> {
        let sun = self.sun(simd, scene.frame, samples);
        trace(
            simd,
            scene,
            self.lanes,
            (dir, sun, airlight),
            thresholds::<S>([self.x, self.y], [self.column, self.row], samples),
        )
    }

    /// Points of the sun's disc.
    #[inline(always)]
    fn sun(&self, simd: S, frame: &FrameUniform, samples: u32) -> Vec3s<S> {
        let mut sun = Vec3s::splat(simd, frame.sun.into());
        if frame.shadow_m <= 0.0 || frame.sun_radius <= 0.0 {
            return sun;
        }
        let (axes, rays) = (sun_axes(frame), (samples * samples) as f32);
        for lane in lanes_of::<S>(self.lanes) {
            let mut turn = Vec2::from_angle(TAU * gradient_noise(self.x[lane], self.y[lane]));
            for _ in 0..self.sample[lane] {
                turn = turn.rotate(GOLDEN_TURN);
            }
            sun.set_lane(lane, sun_direction(frame, &axes, (self.sample[lane] as f32 + 0.5) / rays, turn));
        }
        sun
    }
}
