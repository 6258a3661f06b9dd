//! Shapes of stone, their translucency maps by a depth buffer, and the light that leaves them by brute force.

use anyhow::{Context, Result};
use glam::{Vec2, Vec3};
use insula_shaders::cpu::translucency::{MapAxes, gathered};
use insula_shaders::cpu::translucency_map::{add_levels, entered_share, texel_words};
use insula_shaders::stone::Stone;
use insula_shaders::translucency::{Dipole, MapPlace, TranslucencyMap};
use insula_test_support::rng::Rng;

/// Triangles with normals at their corners, in metres.
#[derive(Debug, Clone, Default)]
pub struct Shape {
    pub points: Vec<Vec3>,
    pub normals: Vec<Vec3>,
    pub triangles: Vec<[u32; 3]>,
}

#[derive(Debug, Clone, Copy)]
pub struct SurfacePoint {
    pub at: Vec3,
    pub normal: Vec3,
}

impl Shape {
    /// A closed surface around the origin, whose radius and normal depend on the direction.
    pub fn ball(steps: u32, radius: impl Fn(Vec3) -> f32) -> Self {
        let direction = |i: u32, j: u32| {
            let (theta, phi) =
                (i as f32 / steps as f32 * std::f32::consts::PI, j as f32 / steps as f32 * std::f32::consts::PI);
            Vec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos())
        };
        let mut shape = Self::default();
        for i in 0..=steps {
            shape.points.extend((0..=2 * steps).map(|j| direction(i, j) * radius(direction(i, j))));
        }
        let at = |i: u32, j: u32| i * (2 * steps + 1) + j;
        for i in 0..steps {
            for j in 0..2 * steps {
                shape.triangles.push([at(i, j), at(i + 1, j), at(i + 1, j + 1)]);
                shape.triangles.push([at(i, j), at(i + 1, j + 1), at(i, j + 1)]);
            }
        }
        shape.with_normals()
    }

    /// A box around the origin with these half sides.
    pub fn slab(half: Vec3) -> Self {
        let mut shape = Self::default();
        for axis in 0..3 {
            for sign in [-1.0f32, 1.0] {
                let mut normal = Vec3::ZERO;
                normal[axis] = sign;
                let (u, v) = (Vec3::AXES[(axis + 1) % 3], Vec3::AXES[(axis + 2) % 3]);
                let first = shape.points.len() as u32;
                for (a, b) in [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)] {
                    shape.points.push((normal + u * a + v * b) * half);
                    shape.normals.push(normal);
                }
                let [p, q] = if sign > 0.0 { [1, 2] } else { [2, 1] };
                shape.triangles.push([first, first + p, first + q]);
                let [p, q] = if sign > 0.0 { [2, 3] } else { [3, 2] };
                shape.triangles.push([first, first + p, first + q]);
            }
        }
        shape
    }

    /// A flat palm and five fingers of 12 mm thickness that spread from it.
    pub fn hand() -> Self {
        let fingers = [-60f32, -25.0, 0.0, 22.0, 45.0].map(|degrees| {
            let angle = degrees.to_radians();
            Vec3::new(angle.sin(), 0.0, angle.cos())
        });
        Self::ball(160, |d| {
            let palm = 1.0 / (d / Vec3::new(0.032, 0.010, 0.036)).length();
            let finger = |along: &Vec3| {
                let (cosine, sine) = (d.dot(*along), d.cross(*along).length());
                if cosine > 0.0 { (0.006 / sine.max(1e-3)).min(0.075) } else { 0.0 }
            };
            fingers.iter().map(finger).fold(palm, f32::max)
        })
    }

    /// Normals as means over the triangles around each point; equal points have one normal.
    pub fn with_normals(mut self) -> Self {
        let mut sums = std::collections::HashMap::new();
        let key = |p: Vec3| (p * 1e6).round().as_ivec3();
        for t in &self.triangles {
            let [a, b, c] = t.map(|v| self.points[v as usize]);
            for p in [a, b, c] {
                *sums.entry(key(p)).or_insert(Vec3::ZERO) += (b - a).cross(c - a);
            }
        }
        self.normals =
            self.points.iter().map(|p| sums.get(&key(*p)).map_or(Vec3::Z, |n| n.normalize_or(Vec3::Z))).collect();
        self
    }

    /// Points of the surface, evenly by area.
    pub fn samples(&self, count: usize, seed: u64) -> (Vec<SurfacePoint>, f32) {
        let area_of = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|v| self.points[v as usize]);
            (b - a).cross(c - a).length() * 0.5
        };
        let total: f64 = self.triangles.iter().map(|t| f64::from(area_of(t))).sum();
        let mut rng = Rng::new(seed);
        let (mut before, mut next, mut points) = (0.0, 0usize, Vec::with_capacity(count));
        for t in &self.triangles {
            before += f64::from(area_of(t)) / total;
            while points.len() < count && (next as f64 + 0.5) / count as f64 <= before {
                let (mut u, mut v) = (rng.unit() as f32, rng.unit() as f32);
                if u + v > 1.0 {
                    (u, v) = (1.0 - u, 1.0 - v);
                }
                let mix = |of: &[Vec3]| {
                    let [a, b, c] = t.map(|k| of[k as usize]);
                    a + (b - a) * u + (c - a) * v
                };
                points.push(SurfacePoint { at: mix(&self.points), normal: mix(&self.normals).normalize_or(Vec3::Z) });
                next += 1;
            }
        }
        (points, total as f32)
    }
}

/// The surface nearest to the sun by texel, and its normal.
pub struct DepthBuffer {
    pub width_px: u32,
    pub radius_m: f32,
    pub texels: Vec<Option<(f32, Vec3)>>,
}

impl DepthBuffer {
    pub fn new(shape: &Shape, axes: &MapAxes, radius_m: f32, width_px: u32) -> Self {
        let mut texels = vec![None; (width_px * width_px) as usize];
        let place =
            |p: Vec3| (Vec2::new(p.dot(axes.right), p.dot(axes.up)) / radius_m * 0.5 + 0.5) * width_px as f32 - 0.5;
        for t in &shape.triangles {
            let [a, b, c] = t.map(|v| place(shape.points[v as usize]));
            let z = t.map(|v| shape.points[v as usize].dot(axes.sun));
            let n = t.map(|v| shape.normals[v as usize]);
            let area = (b - a).perp_dot(c - a);
            if area.abs() < 1e-12 {
                continue;
            }
            let (low, high) = (
                a.min(b).min(c).ceil().max(Vec2::ZERO),
                a.max(b).max(c).floor().min(Vec2::splat(width_px as f32 - 1.0)),
            );
            for y in low.y as i32..=high.y as i32 {
                for x in low.x as i32..=high.x as i32 {
                    let p = Vec2::new(x as f32, y as f32);
                    let (u, v) = ((p - a).perp_dot(c - a) / area, (b - a).perp_dot(p - a) / area);
                    if u < -1e-5 || v < -1e-5 || u + v > 1.00001 {
                        continue;
                    }
                    let height = z[0] + (z[1] - z[0]) * u + (z[2] - z[0]) * v;
                    let texel = &mut texels[(y as u32 * width_px + x as u32) as usize];
                    if texel.is_none_or(|(other, _)| other < height) {
                        *texel = Some((height, n[0] + (n[1] - n[0]) * u + (n[2] - n[0]) * v));
                    }
                }
            }
        }
        Self { width_px, radius_m, texels }
    }

    /// Whether nothing is between a point and the sun.
    pub fn is_lit(&self, axes: &MapAxes, point: SurfacePoint) -> bool {
        let place = Vec2::new(point.at.dot(axes.right), point.at.dot(axes.up)) / self.radius_m * 0.5 + 0.5;
        let at = (place * self.width_px as f32).as_uvec2();
        let texel = 2.0 * self.radius_m / self.width_px as f32;
        let cosine = point.normal.dot(axes.sun);
        let bias = 2.0 * texel / cosine.max(0.05);
        cosine > 0.0
            && self
                .texels
                .get((at.y * self.width_px + at.x) as usize)
                .is_some_and(|found| found.is_none_or(|(z, _)| z <= point.at.dot(axes.sun) + bias))
    }
}

/// A stone's light on a shape from a sun.
pub struct LitShape {
    pub shape: Shape,
    pub axes: MapAxes,
    pub dipole: Dipole,
    pub map: TranslucencyMap,
    pub words: Vec<u32>,
    /// Points that light enters, with the share of the sun's light on them times their area.
    entries: Vec<(SurfacePoint, f32)>,
}

impl LitShape {
    pub fn new(shape: Shape, sun: Vec3, stone: &Stone, width_px: u32, samples: usize) -> Result<Self> {
        let side = Vec2::new(sun.x, sun.y).normalize_or(Vec2::X);
        let axes = MapAxes::new(sun, side);
        let radius_m = 1.02 * shape.points.iter().map(|p| p.length()).fold(0.0, f32::max);
        let place = MapPlace { centre: Vec3::ZERO, radius_m, anchor: Vec3::ZERO };
        let map = TranslucencyMap::new(stone, &place, width_px, 21, 0)
            .context("no light passes through the stone, or not far enough for the map")?;
        let buffer = DepthBuffer::new(&shape, &axes, radius_m, width_px);
        let texel = |texel: &Option<(f32, Vec3)>| {
            texel.map_or([0, 0], |(height, normal)| {
                let cosine = normal.normalize_or(sun).dot(sun);
                let entered = if cosine > 0.0 { entered_share(map.alpha, cosine) } else { 0.0 };
                texel_words(entered, height, normal, radius_m)
            })
        };
        let texels: Vec<[u32; 2]> = buffer.texels.iter().map(texel).collect();
        let mut words: Vec<u32> = texels.iter().map(|t| t[0]).chain(texels.iter().map(|t| t[1])).collect();
        add_levels(&mut words, &map);
        let fine = DepthBuffer::new(&shape, &axes, radius_m, 2048);
        let (points, area) = shape.samples(samples, 5);
        let area = area / points.len() as f32;
        let entries = points.into_iter().filter(|p| fine.is_lit(&axes, *p)).map(|p| {
            let cosine = p.normal.dot(sun);
            (p, entered_share(map.alpha, cosine) * cosine * area)
        });
        let entries = entries.collect();
        let dipole = Dipole::of(stone).context("no light passes through the stone")?;
        Ok(Self { shape, axes, dipole, map, words, entries })
    }

    /// Light that leaves at a point, by all points that it enters.
    pub fn exact(&self, at: Vec3) -> Vec3 {
        let sum: glam::DVec3 = self
            .entries
            .iter()
            .map(|(p, light)| (self.dipole.reflectance(p.at, p.normal, at) * *light).as_dvec3())
            .sum();
        sum.as_vec3() / self.dipole.plane_reflectance()
    }

    /// The same by taps.
    pub fn by_taps(&self, at: Vec3, taps: u32) -> Vec3 {
        gathered(&self.words, &TranslucencyMap { taps, ..self.map }, &self.axes, at)
    }
}

/// Errors of a filter over points of a shape.
#[derive(Debug, Clone, Copy)]
pub struct FilterError {
    /// Mean of the difference over the mean of the exact light.
    pub of_mean: f32,
    /// Mean of the differences over the exact light, where that is at least a hundredth of the sun's.
    pub relative: f32,
    /// Mean of the light by taps over the mean of the exact light.
    pub bias: f32,
}

pub fn filter_error(lit: &LitShape, taps: u32, points: usize) -> FilterError {
    let (points, _) = lit.shape.samples(points, 77);
    let (mut apart, mut exact_sum, mut found_sum, mut relative, mut counted) = (0.0, 0.0, 0.0, 0.0, 0);
    for p in points {
        let (exact, found) = (lit.exact(p.at), lit.by_taps(p.at, taps));
        for k in 0..3 {
            apart += (exact[k] - found[k]).abs();
            exact_sum += exact[k];
            found_sum += found[k];
            if exact[k] > 0.01 {
                relative += (exact[k] - found[k]).abs() / exact[k];
                counted += 1;
            }
        }
    }
    FilterError { of_mean: apart / exact_sum, relative: relative / counted as f32, bias: found_sum / exact_sum }
}
