//! Makes translucency maps with the ray-caster (Mischitelli 2007, section 5.2.1). GPU twin: `translucency_map.wgsl`.

use super::landmark::unpack_normal;
use super::ray::{NodeRay, Ray, RayCounts, RayHit, RaySegment, SceneRef};
use super::raycast::threshold_of;
use super::translucency::{MapAxes, SAME_ANCHOR_M, map_entered, map_height};
use super::walk::walk_grid;
use super::ward::{MIN_FACING, mean_transmitted, transmitted};
use crate::mesh::{ORIGINS_PER_M, pack_normal};
use crate::parallel::*;
use crate::translucency::{COARSEST_PX, OCCUPIED, TranslucencyMap, map_words};
use glam::{Vec2, Vec3};

/// The words of map `number` of the frame, finest level first; empty if the frame does not have it.
pub fn make_map(scene: &SceneRef<'_>, number: usize) -> Vec<u32> {
    let Some(map) = scene.frame.translucency.get(number).filter(|map| map.width_px >= COARSEST_PX) else {
        return Vec::new();
    };
    let axes = MapAxes::new(scene.frame.sun.into(), Vec2::from(scene.frame.light.side));
    let texel = |i: u32| texel_from_sun(scene, map, &axes, [i % map.width_px, i / map.width_px]);
    let finest: Vec<[u32; 2]> = (0..map.width_px * map.width_px).into_par_iter().map(texel).collect();
    let mut words: Vec<u32> = finest.iter().map(|texel| texel[0]).chain(finest.iter().map(|texel| texel[1])).collect();
    add_levels(&mut words, map);
    words
}

/// Appends the coarser levels to the finest one of a map.
pub fn add_levels(words: &mut Vec<u32>, map: &TranslucencyMap) {
    words.reserve(map_words(map.width_px) as usize - words.len());
    let (mut width, mut first) = (map.width_px, 0);
    while width > COARSEST_PX {
        let next = words.len();
        let half = width / 2;
        let mean = |i: u32| {
            let corner = 2 * (i / half * width + i % half);
            let texel = |step: u32| {
                let place = first + (corner + step) as usize;
                [words[place], words[place + (width * width) as usize]]
            };
            mean_texel([0, 1, width, width + 1].map(texel), map.radius_m)
        };
        let level: Vec<[u32; 2]> = (0..half * half).map(mean).collect();
        words.extend(level.iter().map(|texel| texel[0]));
        words.extend(level.iter().map(|texel| texel[1]));
        (first, width) = (next, half);
    }
}

/// The mean of four texels: of the surface that most light enters.
fn mean_texel(four: [[u32; 2]; 4], radius_m: f32) -> [u32; 2] {
    let (mut entered, mut height, mut normal, mut weight) = (0.0, 0.0, Vec3::ZERO, 0.0);
    for [low, high] in four {
        if high & OCCUPIED != 0 {
            let share = map_entered(low) + 1e-3;
            entered += map_entered(low) * 0.25;
            height += map_height(low, radius_m) * share;
            normal += unpack_normal(high) * share;
            weight += share;
        }
    }
    if weight > 0.0 { texel_words(entered, height / weight, normal, radius_m) } else { [0, 0] }
}

/// A texel of a surface. `normal` may have any length.
pub fn texel_words(entered: f32, height_m: f32, normal: Vec3, radius_m: f32) -> [u32; 2] {
    let height = ((height_m / radius_m * 0.5 + 0.5).clamp(0.0, 1.0) * 65_535.0 + 0.5) as u32;
    let entered = (entered.clamp(0.0, 1.0) * 65_535.0 + 0.5) as u32;
    [height | entered << 16, pack_normal(normal) | OCCUPIED]
}

/// Share of the light on a surface that enters the stone, over the mean of all directions (equation 5.4).
pub fn entered_share(alpha: f32, cosine: f32) -> f32 {
    transmitted(alpha, cosine.clamp(MIN_FACING, 1.0)) / mean_transmitted(alpha)
}

fn texel_from_sun(scene: &SceneRef<'_>, map: &TranslucencyMap, axes: &MapAxes, [x, y]: [u32; 2]) -> [u32; 2] {
    let frame = scene.frame;
    let centre = Vec3::from(map.centre);
    let place = (Vec2::new(x as f32, y as f32) + 0.5) * (2.0 / map.width_px as f32) - 1.0;
    let start = centre + (axes.right * place.x + axes.up * place.y + axes.sun) * map.radius_m;
    let origin = (start * ORIGINS_PER_M + 0.5).floor() / ORIGINS_PER_M;
    let eye_m = (centre.length() - map.radius_m).max(0.0);
    let into = RaySegment { origin, dir: -axes.sun, reach_m: 2.0 * map.radius_m, eye_m, to_sun: false };
    let out = RaySegment { origin, dir: axes.sun, reach_m: frame.shadow_m, eye_m, to_sun: true };
    let seen = cast(scene, into, [x, y]);
    let anchor = origin + into.dir * seen.distance_m - seen.stone_point;
    if !seen.is_hit || seen.stone == 0 || anchor.distance(map.anchor.into()) > SAME_ANCHOR_M {
        return [0, 0];
    }
    let cosine = seen.normal.dot(axes.sun);
    let is_lit = cosine > 0.0 && !(frame.shadow_m > 0.0 && cast(scene, out, [x, y]).is_hit);
    let entered = if is_lit { entered_share(map.alpha, cosine) } else { 0.0 };
    let height_m = (origin + into.dir * seen.distance_m - centre).dot(axes.sun);
    texel_words(entered, height_m, seen.normal, map.radius_m)
}

fn cast(scene: &SceneRef<'_>, segment: RaySegment, pixel: [u32; 2]) -> RayHit {
    let threshold = threshold_of(pixel, 1, 0);
    let mut ray =
        Ray { scene, segment, threshold, hit: RayHit::NOTHING, node: NodeRay::default(), counts: RayCounts::default() };
    if scene.frame.levels != 0 {
        walk_grid(&mut ray);
    }
    ray.hit
}
