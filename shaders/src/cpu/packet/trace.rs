//! Rays of a packet from the eye to a surface, and from there towards the sun. The scalar code is `trace` of
//! [`raycast`](crate::cpu::raycast).

use super::grid_walk::walk_grid;
use super::hits::{Hits, Segments};
use super::lanes::{F, FastExtremes, M, U, Vec3s, lanes_of, once, splat, splat_u};
use super::mesh::walk_meshes;
use super::stone::stones_of;
use crate::cpu::night::lamp_light;
use crate::cpu::ray::{RayHit, SUN_LIFT_M, SceneRef};
use crate::cpu::raycast::radiance_with;
use crate::cpu::sea::sea_share;
use crate::cpu::shade::{
    Airlight, Radiances, SurfaceSample, background, ground_distances, hazed, lit_normals, open_sky, plane, reflections,
};
use crate::layout::{FrameUniform, PALETTE_OUTLINED, Shading};
use crate::mesh::ORIGINS_PER_M;
use crate::srgb::linear_colours;
use crate::stone::Stone;
use fearless_simd::prelude::*;
use glam::Vec3;
use insula_protocol::blockmap::flag;

/// Rays that have ended.
pub(super) struct TracedRays<S: Simd> {
    pub(super) rgb: Vec3s<S>,
    pub(super) normal: Vec3s<S>,
    pub(super) distance_m: F<S>,
    pub(super) node: U<S>,
    pub(super) object: U<S>,
    pub(super) is_outlined: M<S>,
}

/// Traces rays from the eye, and those towards the sun from what they hit.
#[inline(always)]
pub(super) fn trace<S: Simd>(
    simd: S,
    scene: &SceneRef<'_>,
    lanes: M<S>,
    (dir, sun, airlight): (Vec3s<S>, Vec3s<S>, Vec3s<S>),
    threshold: U<S>,
) -> TracedRays<S> {
    let frame = scene.frame;
    let (zero, infinity) = (splat(simd, 0.0), splat(simd, f32::INFINITY));
    let origin = Vec3s::splat(simd, Vec3::ZERO);
    let reach_m = f32::INFINITY;
    let segments = Segments { origin, dir, reach_m, eye_m: zero, to_sun: false, threshold };
    let mut seen = Hits::nothing(simd);
    walk(simd, scene, &segments, lanes, &mut seen);
    convert_colours(simd, &mut seen);
    seen.ao = seen.ao.fast_max(splat(simd, frame.light.sky_up[3]));
    let ground_m = ground_distances(simd, frame, dir);
    let mut light = radiances(simd, scene, lanes, &seen, (dir, airlight, ground_m));
    if frame.shadow_m > 0.0 {
        let eye_m = seen.is_hit.select(seen.distance_m, ground_m);
        let largest = light.sun.x.fast_max(light.sun.y).fast_max(light.sun.z);
        // Nothing shadows the sky.
        let lit = lanes & largest.simd_gt(zero) & eye_m.simd_lt(infinity);
        if lit.any_true() {
            let on_plane = dir.scale(eye_m) + Vec3s::splat(simd, Vec3::Z * SUN_LIFT_M);
            let origin = Vec3s::select(seen.is_hit, seen.shadow_origin, on_plane);
            let origin = (origin * ORIGINS_PER_M + 0.5).floor() / ORIGINS_PER_M;
            let segments = Segments { origin, dir: sun, reach_m: frame.shadow_m, eye_m, to_sun: true, threshold };
            let mut shadows = Hits::nothing(simd);
            walk(simd, scene, &segments, lit, &mut shadows);
            light.sun = Vec3s::select(shadows.is_hit, Vec3s::splat(simd, Vec3::ZERO), light.sun);
        }
    }
    let mut is_outlined = M::<S>::splat(simd, false);
    if frame.objects != 0 {
        for lane in lanes_of::<S>(lanes & seen.object.simd_ne(splat_u(simd, 0))) {
            let word = scene.atlas.get(seen.object[lane] as usize).copied().unwrap_or(0);
            is_outlined.set(lane, word & PALETTE_OUTLINED != 0);
        }
    }
    TracedRays {
        rgb: light.sky + light.sun,
        normal: seen.normal,
        distance_m: seen.distance_m,
        node: seen.node,
        object: seen.object,
        is_outlined,
    }
}

/// Not inlined: it is called for rays from the eye and for those towards the sun.
#[inline(always)]
fn walk<S: Simd>(simd: S, scene: &SceneRef<'_>, segments: &Segments<S>, lanes: M<S>, hits: &mut Hits<S>) {
    if scene.frame.levels != 0 {
        simd.vectorize(once!(|| walk_grid(simd, scene, segments, lanes, hits)));
    }
    for (index, node) in scene.additions() {
        let open = if segments.to_sun { lanes & !hits.is_hit } else { lanes };
        simd.vectorize(once!(|| walk_meshes(simd, scene, segments, (node, index), open, hits)));
    }
}

/// Sets the albedos of surfaces whose colours are words.
#[inline(always)]
fn convert_colours<S: Simd>(simd: S, hits: &mut Hits<S>) {
    let is_word = hits.colour.simd_ne(splat_u(simd, 0));
    if is_word.any_true() {
        hits.albedo = Vec3s::select(is_word, linear_colours(simd, hits.colour), hits.albedo);
    }
}

/// Those of `lanes` that see the sea beyond the city.
#[inline(always)]
fn sea_lanes<S: Simd>(
    simd: S,
    frame: &FrameUniform,
    lanes: M<S>,
    hits: &Hits<S>,
    (dir, ground_m): (Vec3s<S>, F<S>),
) -> M<S> {
    let mut found = M::<S>::splat(simd, false);
    for lane in lanes_of::<S>(lanes) {
        let (dir, is_hit) = (dir.lane(lane), hits.is_hit.test(lane));
        let distance_m = if is_hit { hits.distance_m[lane] } else { ground_m[lane] };
        let surface = is_hit.then(|| (hits.albedo.lane(lane), hits.normal.lane(lane).normalize_or(-dir)));
        if distance_m < f32::INFINITY && sea_share(frame, surface, dir * distance_m) > 0.0 {
            found.set(lane, true);
        }
    }
    found
}

/// Light of what the rays in `lanes` have hit, or of what is behind everything.
#[inline(always)]
fn radiances<S: Simd>(
    simd: S,
    scene: &SceneRef<'_>,
    lanes: M<S>,
    hits: &Hits<S>,
    (dir, airlight, ground_m): (Vec3s<S>, Vec3s<S>, F<S>),
) -> Radiances<S> {
    let frame = scene.frame;
    let zero3 = Vec3s::splat(simd, Vec3::ZERO);
    let mut light = Radiances { sky: zero3, sun: zero3 };
    let is_stone = hits.stone.simd_ne(splat_u(simd, 0));
    let is_mirror = (hits.flags & u32::from(flag::REFLECTIVE)).simd_ne(splat_u(simd, 0));
    let mut special = lanes & hits.is_hit & (is_stone | is_mirror);
    if frame.shading != Shading::Lit as u32 || frame.light.window[3] > 0.0 {
        special = lanes;
    }
    if frame.sea_albedo[3] > 0.0 {
        special = special | sea_lanes(simd, frame, lanes & !special, hits, (dir, ground_m));
    }
    let plain = lanes & !special;
    if (plain & hits.is_hit).any_true() {
        let normal = lit_normals(simd, frame, hits.albedo, hits.normal.normalize_or(simd, -dir));
        let mut surfaces = reflections(simd, frame, (hits.albedo, normal, hits.ao));
        if frame.light.street[3] > 0.0 {
            for lane in lanes_of::<S>(plain & hits.is_hit) {
                let hit = hits.lane(scene, lane);
                let RayHit { albedo, ao, flags, level, .. } = hit;
                let surface = SurfaceSample { albedo, ao, normal: normal.lane(lane), flags, level };
                let lamps = lamp_light(scene, hit.node, &surface, dir.lane(lane) * hit.distance_m);
                surfaces.sky.set_lane(lane, surfaces.sky.lane(lane) + lamps);
            }
        }
        light = hazed(simd, frame, &surfaces, (dir, airlight), (hits.distance_m, 1.0));
    }
    let beyond = plain & !hits.is_hit;
    if beyond.any_true() {
        let on_plane = beyond & ground_m.simd_lt(splat(simd, f32::INFINITY));
        if on_plane.any_true() {
            let far = plane(simd, frame, (dir, airlight), ground_m);
            light.sky = Vec3s::select(on_plane, far.sky, light.sky);
            light.sun = Vec3s::select(on_plane, far.sun, light.sun);
        }
        let in_sky = beyond & !on_plane;
        if in_sky.any_true() {
            light.sky = Vec3s::select(in_sky, open_sky(simd, frame, in_sky, dir), light.sky);
            light.sun = Vec3s::select(in_sky, zero3, light.sun);
        }
    }
    if special.all_false() {
        return light;
    }
    let stones = stones_of(simd, frame, special & hits.is_hit & is_stone, hits, dir);
    for lane in lanes_of::<S>(special) {
        let (dir, airlight) = (dir.lane(lane), Airlight { rgb: airlight.lane(lane) });
        let lit = if hits.is_hit.test(lane) {
            let stone = |_: &Stone, surface: &SurfaceSample| stones.lane(lane, surface.normal);
            radiance_with(scene, &hits.lane(scene, lane), dir, &airlight, stone)
        } else {
            background(frame, dir, &airlight)
        };
        light.sky.set_lane(lane, lit.sky);
        light.sun.set_lane(lane, lit.sun);
    }
    light
}
