//! The sky, the plane where there is no column, and the air before surfaces, for the rays of a packet. The scalar code is
//! [`shade`](crate::cpu::shade).

use super::lanes::{
    F, FastExtremes, I, M, U, Vec3s, always, float, lanes_of, map4, quadruples, splat, splat_i, splat_u, to_u,
};
use super::shade::{Radiances, apply_haze};
use crate::atmosphere::{MIE_G, PHASE_SCALE};
use crate::cpu::night::{moon, stars};
use crate::cpu::shade::{DISC, DISC_INNER, DISC_OUTER, MIN_GROUND_DESCENT, PLANE_CLEAR_M, PLANE_FADE, reflected};
use crate::cpu::surface::rgb;
use crate::layout::{FrameUniform, SKY_AZIMUTHS, SKY_HEIGHTS, SkyTable};
use crate::light::SKY_LOW;
use fearless_simd::prelude::*;
use glam::{Vec2, Vec3};

/// Columns of the sky's tables, and how far the rays are towards the next ones.
struct SkyColumns<S: Simd> {
    left: I<S>,
    part: F<S>,
}

/// The air's light in directions `dir`.
#[inline(always)]
pub(super) fn airlight<S: Simd>(simd: S, frame: &FrameUniform, dir: Vec3s<S>) -> Vec3s<S> {
    let (columns, length) = SkyColumns::new(simd, frame, dir);
    let row = splat_i(simd, 0);
    let (smooth, forward) = (columns.read(simd, &frame.light.sky, row), columns.read(simd, &frame.light.glow, row));
    let level = Vec3s::<S> { x: dir.x / length, y: dir.y / length, z: splat(simd, SKY_LOW) };
    smooth.add(forward.scale(phase(simd, frame, level)))
}

/// Metres to the plane where there is no column, infinity for the rays that miss it.
#[inline(always)]
pub(super) fn ground_distance<S: Simd>(simd: S, frame: &FrameUniform, dir: Vec3s<S>) -> F<S> {
    let infinity = splat(simd, f32::INFINITY);
    if frame.ground == 0 || frame.ground_z_m >= 0.0 {
        return infinity;
    }
    dir.z.simd_gt(splat(simd, -MIN_GROUND_DESCENT)).select(infinity, splat(simd, frame.ground_z_m) / dir.z)
}

/// Light from beyond all nodes for the rays in `lanes`, `ground_m` metres from the plane.
#[inline(always)]
pub(super) fn background<S: Simd>(
    simd: S,
    frame: &FrameUniform,
    lanes: M<S>,
    (dir, airlight, ground_m): (Vec3s<S>, Vec3s<S>, F<S>),
) -> Radiances<S> {
    let zero3 = Vec3s::splat(simd, Vec3::ZERO);
    let mut light = Radiances::<S> { sky: zero3, sun: zero3 };
    let on_ground = lanes & ground_m.simd_lt(splat(simd, f32::INFINITY));
    if on_ground.any_true() {
        let plane = reflected(frame, rgb(frame.light.plane), Vec3::Z, 1.0);
        let plane = Radiances::<S> { sky: Vec3s::splat(simd, plane.sky), sun: Vec3s::splat(simd, plane.sun) };
        let beyond = (ground_m - PLANE_CLEAR_M).fast_max(splat(simd, 0.0));
        light = apply_haze(simd, frame, &plane, (dir, airlight), ground_m + beyond * PLANE_FADE);
    }
    let in_sky = lanes & !on_ground;
    if in_sky.any_true() {
        let above = sky(simd, frame, dir).add(celestial_light(simd, frame, in_sky, dir));
        light.sky = Vec3s::select(on_ground, light.sky, above);
        light.sun = Vec3s::select(on_ground, light.sun, zero3);
    }
    light
}

/// Light that the air scatters from directions above the horizon.
#[inline(always)]
fn sky<S: Simd>(simd: S, frame: &FrameUniform, dir: Vec3s<S>) -> Vec3s<S> {
    let (zero, one) = (splat(simd, 0.0), splat(simd, 1.0));
    let height = ((dir.z - SKY_LOW) / (1.0 - SKY_LOW)).fast_max(zero).sqrt() * (SKY_HEIGHTS - 1) as f32;
    let row = height.to_int::<I<S>>().min(splat_i(simd, SKY_HEIGHTS as i32 - 2));
    let (columns, _) = SkyColumns::new(simd, frame, dir);
    let part = height - float::<S>(row);
    let read = always(
        #[inline(always)]
        |table: &SkyTable| {
            let (low, high) = (columns.read(simd, table, row), columns.read(simd, table, row + 1));
            low.scale(one - part).add(high.scale(part))
        },
    );
    read(&frame.light.sky).add(read(&frame.light.glow).scale(phase(simd, frame, dir)))
}

/// Light of the sun's disc, the moon and the stars.
#[inline(always)]
fn celestial_light<S: Simd>(simd: S, frame: &FrameUniform, lanes: M<S>, dir: Vec3s<S>) -> Vec3s<S> {
    let light = &frame.light;
    let (zero, one) = (splat(simd, 0.0), splat(simd, 1.0));
    let edge = (splat(simd, DISC_OUTER) - from_sun(simd, frame, dir)) / (DISC_OUTER - DISC_INNER);
    let edge = edge.fast_max(zero).fast_min(one);
    let sun = Vec3s::splat(simd, rgb(light.sun)).scale(edge * (DISC * light.disc));
    let (mut star, mut lunar) = (zero, zero);
    if light.stars > 0.0 || light.moon[3] > 0.0 {
        for lane in lanes_of::<S>(lanes) {
            star[lane] = stars(light.stars, dir.lane(lane));
            lunar[lane] = moon(frame, dir.lane(lane));
        }
    }
    sun.map(
        #[inline(always)]
        |v| v + star + lunar,
    )
}

impl<S: Simd> SkyColumns<S> {
    /// And the horizontal length of `dir`.
    #[inline(always)]
    fn new(simd: S, frame: &FrameUniform, dir: Vec3s<S>) -> (Self, F<S>) {
        let side = Vec2::from(frame.light.side);
        let (one, least) = (splat(simd, 1.0), splat(simd, 1e-4));
        let length = (dir.x * dir.x + dir.y * dir.y).sqrt().fast_max(least);
        let along = ((dir.x * side.x + dir.y * side.y) / length).fast_max(-one).fast_min(one);
        let column = (along * 0.5 + 0.5) * (SKY_AZIMUTHS - 1) as f32;
        let left = column.to_int::<I<S>>().min(splat_i(simd, SKY_AZIMUTHS as i32 - 2));
        (Self { left, part: column - float::<S>(left) }, length)
    }

    /// Rows of a table, between the columns.
    #[inline(always)]
    fn read(&self, simd: S, table: &SkyTable, row: I<S>) -> Vec3s<S> {
        let cells = table.as_flattened();
        let first = cell_numbers::<S>(row, self.left);
        let common = first[0];
        let (left, right) = if first.simd_eq(splat_u(simd, common)).all_true() {
            let cell = always(
                #[inline(always)]
                |at: u32| {
                    map4(
                        cells.get(at as usize).copied().unwrap_or_default(),
                        #[inline(always)]
                        |v| splat(simd, v),
                    )
                },
            );
            (cell(common), cell(common + 1))
        } else {
            let cell = always(
                #[inline(always)]
                |at: U<S>| {
                    let words = quadruples(
                        simd,
                        #[inline(always)]
                        |lane| bytemuck::cast(cells.get(at[lane] as usize).copied().unwrap_or_default()),
                    );
                    map4(
                        words,
                        #[inline(always)]
                        |word| word.bitcast::<F<S>>(),
                    )
                },
            );
            (cell(first), cell(first + 1))
        };
        let rest = splat(simd, 1.0) - self.part;
        let channel = always(
            #[inline(always)]
            |c: usize| left[c] * rest + right[c] * self.part,
        );
        Vec3s::<S> { x: channel(0), y: channel(1), z: channel(2) }
    }
}

/// Numbers of the cells of a sky's table.
#[inline(always)]
fn cell_numbers<S: Simd>(row: I<S>, column: I<S>) -> U<S> {
    to_u::<S>(row * SKY_AZIMUTHS as i32 + column)
}

/// The phase function of Henyey and Greenstein for the angles between `dir` and the sun.
#[inline(always)]
fn phase<S: Simd>(simd: S, frame: &FrameUniform, dir: Vec3s<S>) -> F<S> {
    let near = splat(simd, 1.0) / (from_sun(simd, frame, dir) * MIE_G + (1.0 - MIE_G) * (1.0 - MIE_G));
    near * PHASE_SCALE * near.sqrt()
}

/// Squared distance from the sun on the unit sphere.
#[inline(always)]
fn from_sun<S: Simd>(simd: S, frame: &FrameUniform, dir: Vec3s<S>) -> F<S> {
    let apart = dir.sub(Vec3s::splat(simd, frame.sun.into()));
    apart.dot(apart)
}
