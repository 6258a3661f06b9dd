//! Ground truth: the source's triangles, ray-traced.

use crate::view::{Camera, FrameSpec};
use glam::{DVec3, Vec3, Vec3A};
use insula_bake::scene::{Scene, SceneTexture};
use insula_shaders::cpu::raycast::Pixels;
use insula_shaders::cpu::shade::{Airlight, background, encode_srgb, linear_of};
use insula_shaders::layout::NO_NODE;
use insula_simplify::surface::nearest_on_triangle;
use obvhs::BvhBuildParams;
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::builder::build_bvh2_from_tris;
use obvhs::ray::{Ray, RayHit};
use obvhs::triangle::Triangle;
use rayon::prelude::*;
use std::time::Duration;

/// Tolerance of barycentric coordinates, so that no ray passes between two triangles.
const SLACK: f64 = 1e-6;

/// A scene with a BVH.
pub struct Truth {
    pub scene: Scene,
    bvh: Bvh2,
}

/// A ray's hit of the source.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    pub distance_m: f64,
    pub triangle: u32,
}

impl Truth {
    pub fn new(scene: Scene) -> Self {
        let corner = |c: [f32; 3]| Vec3A::from_array(c);
        let triangles: Vec<Triangle> = scene
            .triangles
            .iter()
            .map(|t| Triangle { v0: corner(t.corners[0]), v1: corner(t.corners[1]), v2: corner(t.corners[2]) })
            .collect();
        let bvh = build_bvh2_from_tris(&triangles, BvhBuildParams::medium_build(), &mut Duration::default());
        Self { scene, bvh }
    }

    pub fn bounds(&self) -> [DVec3; 2] {
        let corners = self.scene.triangles.iter().flat_map(|t| t.corners);
        corners.fold([DVec3::INFINITY, DVec3::NEG_INFINITY], |[low, high], c| {
            let c = DVec3::from(c.map(f64::from));
            [low.min(c), high.max(c)]
        })
    }

    /// The nearest hit from `o` (scene coordinates) along the unit vector `d`.
    pub fn cast(&self, o: DVec3, d: DVec3) -> Option<Hit> {
        let ray = Ray::new_inf(o.as_vec3a(), d.as_vec3a());
        let mut hit = RayHit::none();
        self.bvh.ray_traverse(ray, &mut hit, |_, at| {
            self.intersect(self.bvh.primitive_indices[at], o, d).map_or(f32::INFINITY, |(t, ..)| t as f32)
        });
        let triangle = *self.bvh.primitive_indices.get(hit.primitive_id as usize)?;
        self.intersect(triangle, o, d).map(|(distance_m, ..)| Hit { distance_m, triangle })
    }

    /// Whether an object of this identifier has a surface within `slack_m` of a hit, along its ray.
    pub fn shows(&self, identifier: &str, o: DVec3, d: DVec3, hit: &Hit, slack_m: f64) -> bool {
        let mut found = false;
        self.bvh.ray_traverse(Ray::new_inf(o.as_vec3a(), d.as_vec3a()), &mut RayHit::none(), |_, at| {
            let triangle = self.bvh.primitive_indices[at];
            let is_near = self.intersect(triangle, o, d).is_some_and(|(t, ..)| (t - hit.distance_m).abs() <= slack_m);
            let object = self.scene.triangles[triangle as usize].object;
            found |= is_near && self.scene.objects[object as usize].id == identifier;
            // No hit shortens the ray.
            f32::INFINITY
        });
        found
    }

    /// Distance and the weights of the second and third corner (Moller and Trumbore 1997).
    fn intersect(&self, triangle: u32, o: DVec3, d: DVec3) -> Option<(f64, f64, f64)> {
        let [a, b, c] = self.corners(triangle);
        let (e1, e2) = (b - a, c - a);
        let p = d.cross(e2);
        let det = e1.dot(p);
        if det == 0.0 {
            return None;
        }
        let s = (o - a) / det;
        let u = s.dot(p);
        let q = s.cross(e1);
        let v = d.dot(q);
        let t = e2.dot(q);
        (u >= -SLACK && v >= -SLACK && u + v <= 1.0 + SLACK && t >= 0.0).then_some((t, u, v))
    }

    fn corners(&self, triangle: u32) -> [DVec3; 3] {
        self.scene.triangles[triangle as usize].corners.map(|c| DVec3::from(c.map(f64::from)))
    }

    /// Renders the source: albedo, distance, and the index of the triangle as `hit`.
    pub fn render(&self, camera: &Camera, spec: &FrameSpec) -> Pixels {
        let o = DVec3::from(camera.position) - DVec3::from(self.scene.origin);
        let axes = camera.axes(spec);
        let pixels = spec.width_px * spec.height_px;
        let seen: Vec<(u32, f32, u32)> = (0..pixels)
            .into_par_iter()
            .map(|i| {
                let d = axes.ray(spec, i % spec.width_px, i / spec.width_px);
                let Some(hit) = self.cast(o, d) else { return (SKY, f32::INFINITY, NO_NODE) };
                (self.colour(&hit, o, d), hit.distance_m as f32, hit.triangle)
            })
            .collect();
        let mut out = Pixels { width_px: spec.width_px, height_px: spec.height_px, ..Pixels::default() };
        for (colour, distance, hit) in seen {
            out.colour.push(colour);
            out.distance.push(distance);
            out.hit.push(hit);
        }
        out
    }

    /// The source's albedo with `side` x `side` rays per pixel, averaged in linear light in front of the ray-caster's sky; and
    /// for each pixel whether all rays hit a textured surface.
    pub fn albedo(&self, camera: &Camera, spec: &FrameSpec, side: u32) -> (Vec<u32>, Vec<bool>) {
        let o = DVec3::from(camera.position) - DVec3::from(self.scene.origin);
        let fine = FrameSpec { width_px: spec.width_px * side, height_px: spec.height_px * side, ..*spec };
        let axes = camera.axes(&fine);
        let frame = camera.frame(&fine);
        let pixel = |i: u32| {
            let (x, y) = (i % spec.width_px * side, i / spec.width_px * side);
            let (mut sum, mut textured) = (Vec3::ZERO, true);
            for s in 0..side * side {
                let d = axes.ray(&fine, x + s % side, y + s / side);
                let hit = self.cast(o, d);
                textured &= hit.is_some_and(|hit| self.is_textured(hit.triangle));
                sum += match hit {
                    Some(hit) => linear_of(self.colour(&hit, o, d)),
                    None => background(&frame, d.as_vec3(), &Airlight::new(&frame, d.as_vec3())).sky,
                };
            }
            (encode_srgb(sum / (side * side) as f32), textured)
        };
        (0..spec.width_px * spec.height_px).into_par_iter().map(pixel).unzip()
    }

    fn is_textured(&self, triangle: u32) -> bool {
        let material = self.scene.triangles[triangle as usize].material;
        self.scene.materials.get(material as usize).is_some_and(|material| material.texture.is_some())
    }

    /// 8-bit sRGB of the surface at a hit.
    fn colour(&self, hit: &Hit, o: DVec3, d: DVec3) -> u32 {
        let triangle = &self.scene.triangles[hit.triangle as usize];
        let Some(material) = self.scene.materials.get(triangle.material as usize) else { return SKY };
        let mut rgb = material.rgb;
        if let (Some(texture), Some((_, u, v))) = (&material.texture, self.intersect(hit.triangle, o, d)) {
            let [a, b, c] = triangle.uv.map(|uv| uv.map(f64::from));
            let at = [0, 1].map(|k| a[k] * (1.0 - u - v) + b[k] * u + c[k] * v);
            let texel = nearest(texture, at);
            rgb = std::array::from_fn(|k| product(rgb[k], texel[k]));
        }
        u32::from_le_bytes([rgb[0], rgb[1], rgb[2], 255])
    }

    /// Distance from `p` (scene coordinates) to the nearest triangle; infinity beyond `most_m`. Searches within `start_m`
    /// first.
    pub fn distance_to_surface(&self, p: DVec3, start_m: f64, most_m: f64) -> f64 {
        let mut reach_m = start_m;
        loop {
            // Bounds are in f32.
            let reach = Vec3A::splat(reach_m as f32 * 1.001 + p.abs().max_element() as f32 * 1e-6);
            let mut best = f64::INFINITY;
            self.bvh.aabb_traverse(Aabb::new(p.as_vec3a() - reach, p.as_vec3a() + reach), |bvh, node| {
                let node = &bvh.nodes[node as usize];
                for at in node.first_index..node.first_index + node.prim_count {
                    let corners = self.corners(bvh.primitive_indices[at as usize]);
                    best = best.min(nearest_on_triangle(p, corners).distance(p));
                }
                true
            });
            if best <= reach_m {
                return best;
            }
            if reach_m >= most_m {
                return f64::INFINITY;
            }
            reach_m = (reach_m * 2.0).min(most_m);
        }
    }

    /// Whether the bounds of any triangle come within `reach_m` of `p` in x and y, between the heights `z_m`.
    pub fn anything_near(&self, p: DVec3, reach_m: f64, z_m: [f64; 2]) -> bool {
        let low = DVec3::new(p.x - reach_m, p.y - reach_m, z_m[0]);
        let high = DVec3::new(p.x + reach_m, p.y + reach_m, z_m[1]);
        let mut found = false;
        self.bvh.aabb_traverse(Aabb::new(low.as_vec3a(), high.as_vec3a()), |bvh, node| {
            let node = &bvh.nodes[node as usize];
            found |= (node.first_index..node.first_index + node.prim_count).any(|at| {
                let corners = self.corners(bvh.primitive_indices[at as usize]);
                let least = corners.into_iter().fold(DVec3::INFINITY, DVec3::min);
                let most = corners.into_iter().fold(DVec3::NEG_INFINITY, DVec3::max);
                least.cmple(high).all() && most.cmpge(low).all()
            });
            !found
        });
        found
    }
}

const SKY: u32 = 0xffe6_d2be;

fn product(a: u8, b: u8) -> u8 {
    if a == 255 { b } else { (f64::from(a) * f64::from(b) / 255.0).round() as u8 }
}

fn nearest(texture: &SceneTexture, [u, v]: [f64; 2]) -> [u8; 3] {
    let wrap = |x: f64, n: u32| ((x * f64::from(n)).floor() as i64).rem_euclid(i64::from(n.max(1))) as usize;
    let (x, y) = (wrap(u, texture.width), wrap(1.0 - v, texture.height));
    texture.rgb.get(y * texture.width as usize + x).copied().unwrap_or_default()
}
