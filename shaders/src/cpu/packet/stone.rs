//! The stones that the rays of a packet hit, evaluated one after the other.

use super::hits::Hits;
use super::lanes::{M, Vec2s, Vec3s, first_lane, splat, splat_u};
use crate::cpu::mesh::MIN_COSINE;
use crate::cpu::raycast::{pixel_m, stone_numbered};
use crate::cpu::stone::{StonePoints, StoneSurfaces, stone_surfaces};
use crate::layout::FrameUniform;
use fearless_simd::prelude::*;
use glam::Vec3;

/// The stones that the rays in `lanes` have hit; anything in the other lanes.
#[inline(always)]
pub(super) fn stones_of<S: Simd>(
    simd: S,
    frame: &FrameUniform,
    lanes: M<S>,
    hits: &Hits<S>,
    dir: Vec3s<S>,
) -> StoneSurfaces<S> {
    let zero = splat(simd, 0.0);
    let nothing = Vec3s::splat(simd, Vec3::ZERO);
    let mut surfaces = StoneSurfaces::<S> { albedo: nothing, f0: nothing, alpha: Vec2s::<S> { x: zero, y: zero } };
    let normal = hits.normal.normalize_or(simd, -dir);
    let cosine = normal.dot(dir).abs().max(splat(simd, MIN_COSINE)).sqrt();
    let footprint_m = hits.distance_m * pixel_m(frame) / cosine;
    let mut left = lanes;
    while left.any_true() {
        let number = hits.stone[first_lane::<S>(left)];
        let group = left & hits.stone.simd_eq(splat_u(simd, number));
        left &= !group;
        let Some(stone) = stone_numbered(frame, number) else { continue };
        let points = StonePoints { lanes: group, p_m: hits.stone_point, normal, ao: hits.ao, footprint_m };
        let found = stone_surfaces(simd, stone, &points);
        surfaces.albedo = Vec3s::select(group, found.albedo, surfaces.albedo);
        surfaces.f0 = Vec3s::select(group, found.f0, surfaces.f0);
        surfaces.alpha.x = group.select(found.alpha.x, surfaces.alpha.x);
        surfaces.alpha.y = group.select(found.alpha.y, surfaces.alpha.y);
    }
    surfaces
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cpu::instruction_set::InstructionSet;
    use crate::cpu::packet::lanes::{F, once};
    use crate::cpu::stone::stone_surface;
    use crate::stone::PRESETS;
    use insula_test_support::rng::Rng;

    /// Values of all rays.
    fn lanes<S: Simd>(simd: S, mut value: impl FnMut() -> f32) -> F<S> {
        F::<S>::from_fn(simd, |_| value())
    }

    fn compare<S: Simd>(simd: S, what: &str) {
        let mut rng = Rng::new(9);
        for (name, stone) in &PRESETS {
            for round in 0..400 {
                let mut between = |low: f64, high: f64| rng.range(low, high) as f32;
                let footprint = f64::from(round) / 400.0;
                let points = StonePoints::<S> {
                    lanes: M::<S>::splat(simd, true),
                    p_m: Vec3s::<S> {
                        x: lanes(simd, || between(-40.0, 40.0)),
                        y: lanes(simd, || between(-40.0, 40.0)),
                        z: lanes(simd, || between(-5.0, 30.0)),
                    },
                    normal: Vec3s::<S> {
                        x: lanes(simd, || between(-1.0, 1.0)),
                        y: lanes(simd, || between(-1.0, 1.0)),
                        z: lanes(simd, || between(-1.0, 1.0)),
                    },
                    ao: lanes(simd, || between(0.0, 1.0)),
                    // From less than a grain to more than a vein, also in the same packet.
                    footprint_m: lanes(simd, || 10f32.powf(between(-4.0, -3.0 + 3.0 * footprint))),
                };
                let found = simd.vectorize(once!(|| stone_surfaces(simd, stone, &points)));
                for lane in 0..F::<S>::LEN {
                    let normal = points.normal.lane(lane);
                    let (p_m, ao, footprint_m) = (points.p_m.lane(lane), points.ao[lane], points.footprint_m[lane]);
                    let expected = stone_surface(stone, p_m, normal, ao, footprint_m);
                    assert_eq!(found.lane(lane, normal), expected, "{name} at {p_m}, {footprint_m} m, {what}");
                }
            }
        }
    }

    #[test]
    fn packets_of_stones_are_those_of_single_points() {
        for set in InstructionSet::all() {
            with_lanes!(set, |simd| compare(simd, set.name()), ());
        }
    }
}
