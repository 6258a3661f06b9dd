//! Rays against the finest triangles of a city.

use glam::{DVec3, Vec3A};
use insula_export::leaves::visit_leaf_meshes;
use insula_export::source::ExportSource;
use insula_export::table::ExportError;
use insula_protocol::mesh_tile::NO_OBJECT;
use obvhs::BvhBuildParams;
use obvhs::cwbvh::CwBvh;
use obvhs::cwbvh::builder::build_cwbvh_from_tris;
use obvhs::ray::{Ray, RayHit};
use obvhs::triangle::Triangle;
use std::time::Duration;

/// Most triangles that are in memory, with about 115 bytes each.
const MAX_TRIANGLES: usize = 16 << 20;

/// The triangles of a part of a city.
pub struct CityTriangles {
    bvh: CwBvh,
    triangles: Vec<Triangle>,
    /// For each of `triangles`; `NO_OBJECT` of none.
    objects: Vec<u32>,
    /// World position that the triangles count from.
    origin: DVec3,
    /// Highest corner above `origin`; `None` without triangles.
    highest: Option<f32>,
}

impl CityTriangles {
    /// Reads the triangles of the leaves that an area touches, in world metres. Fails if tiles cannot be read, or if there are too many
    /// triangles.
    pub fn read(source: &dyn ExportSource, area: [[f64; 2]; 2]) -> Result<Self, ExportError> {
        Self::read_at_most(source, area, MAX_TRIANGLES)
    }

    /// The same with a limit of triangles, which those of one leaf may exceed for a moment. Fails as [`CityTriangles::read`] does.
    pub fn read_at_most(
        source: &dyn ExportSource,
        area: [[f64; 2]; 2],
        max_triangles: usize,
    ) -> Result<Self, ExportError> {
        let [min, max] = area;
        let origin = DVec3::new(0.5 * (min[0] + max[0]), 0.5 * (min[1] + max[1]), source.manifest().origin[2]);
        let (mut triangles, mut objects) = (Vec::new(), Vec::new());
        visit_leaf_meshes(source, area, 0.0, &mut |leaf| {
            let corner = |vertex: u32| {
                let position = leaf.positions.get(vertex as usize).copied().unwrap_or_default();
                (DVec3::from(position) - origin).as_vec3a()
            };
            let mesh = &leaf.tile.mesh;
            triangles.extend(mesh.triangles.iter().map(|corners| {
                let [v0, v1, v2] = corners.map(corner);
                Triangle { v0, v1, v2 }
            }));
            objects.extend_from_slice(&leaf.tile.objects);
            // A mesh without any object says so in short.
            objects.resize(triangles.len(), NO_OBJECT);
            if triangles.len() > max_triangles {
                let reason = format!(
                    "more than {max_triangles} triangles around the points; choose fewer points or a smaller --reach"
                );
                return Err(ExportError::TooLarge { format: "an analysis", reason });
            }
            Ok(())
        })?;
        Ok(Self::new(triangles, objects, origin))
    }

    /// The triangles without those of some objects, and with others in world metres, which belong to none.
    #[must_use]
    pub fn changed(self, is_removed: &dyn Fn(u32) -> bool, added: &[[[f64; 3]; 3]]) -> Self {
        let (origin, known) = (self.origin, self.triangles.into_iter().zip(self.objects));
        let (mut triangles, mut objects): (Vec<Triangle>, Vec<u32>) =
            known.filter(|(_, object)| !is_removed(*object)).unzip();
        triangles.extend(added.iter().map(|corners| {
            let [v0, v1, v2] = corners.map(|corner| (DVec3::from(corner) - origin).as_vec3a());
            Triangle { v0, v1, v2 }
        }));
        objects.resize(triangles.len(), NO_OBJECT);
        Self::new(triangles, objects, origin)
    }

    fn new(triangles: Vec<Triangle>, objects: Vec<u32>, origin: DVec3) -> Self {
        let bvh = build_cwbvh_from_tris(&triangles, BvhBuildParams::medium_build(), &mut Duration::default());
        let corners = triangles.iter().flat_map(|triangle| [triangle.v0.z, triangle.v1.z, triangle.v2.z]);
        let highest = corners.reduce(f32::max);
        Self { bvh, triangles, objects, origin, highest }
    }

    /// Whether nothing stands on the way from a place in world metres along a unit vector.
    #[must_use]
    pub fn is_free(&self, from: DVec3, direction: DVec3) -> bool {
        if self.highest.is_none() {
            return true;
        }
        let ray = ray((from - self.origin).as_vec3a(), direction.as_vec3a());
        self.bvh
            .ray_traverse_miss(ray, |ray, at| distance(&self.triangles[self.bvh.primitive_indices[at] as usize], ray))
    }

    /// Height of the highest surface at a place on the map, in world metres; `None` if there is none.
    #[must_use]
    pub fn top(&self, place: [f64; 2]) -> Option<f64> {
        // From just above all: far away, single precision would miss edges.
        let above = self.origin.z + f64::from(self.highest?) + 1.0;
        self.top_below(DVec3::new(place[0], place[1], above))
    }

    /// Height of the highest surface below a place in world metres; `None` if there is none.
    #[must_use]
    pub fn top_below(&self, from: DVec3) -> Option<f64> {
        let (distance, _) = self.first(from, -DVec3::Z)?;
        Some(from.z - distance)
    }

    /// Distance and object of what stands first on the way from a place in world metres along a unit vector; `None` if nothing does.
    #[must_use]
    pub fn first(&self, from: DVec3, direction: DVec3) -> Option<(f64, u32)> {
        self.highest?;
        let ray = ray((from - self.origin).as_vec3a(), direction.as_vec3a());
        let mut hit = RayHit::none();
        self.bvh.ray_traverse(ray, &mut hit, |ray, at| {
            distance(&self.triangles[self.bvh.primitive_indices[at] as usize], ray)
        });
        let is_hit = hit.t < f32::MAX && hit.t.is_finite();
        is_hit.then(|| (f64::from(hit.t), self.objects[self.bvh.primitive_indices[hit.primitive_id as usize] as usize]))
    }
}

/// A ray that leaves all planes along the axes: the hierarchy loses those that run in one, as the top of a level roof is.
fn ray(from: Vec3A, direction: Vec3A) -> Ray {
    let aside = Vec3A::select(direction.cmpeq(Vec3A::ZERO), Vec3A::splat(1e-6), direction);
    Ray::new_inf(from, aside)
}

/// How far barycentric coordinates may be outside, so that no ray passes between two triangles.
const SLACK: f32 = 1e-5;

/// Distance of a triangle along a ray, from either side; infinite if the ray misses it (Moeller and Trumbore, Fast, Minimum Storage
/// Ray/Triangle Intersection, 1997).
fn distance(triangle: &Triangle, ray: &Ray) -> f32 {
    let (a, b) = (triangle.v1 - triangle.v0, triangle.v2 - triangle.v0);
    let across = ray.direction.cross(b);
    let volume = a.dot(across);
    if volume.abs() < 1e-12 {
        return f32::INFINITY;
    }
    let from = ray.origin - triangle.v0;
    let over = from.cross(a);
    let [u, v, t] = [from.dot(across), ray.direction.dot(over), b.dot(over)].map(|value| value / volume);
    let is_inside = u >= -SLACK && v >= -SLACK && u + v <= 1.0 + SLACK;
    if is_inside && t > 0.0 { t } else { f32::INFINITY }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    pub(crate) fn block(low: [f32; 3], high: [f32; 3], object: u32) -> CityTriangles {
        let corner = |i: usize| Vec3A::from_array([0, 1, 2].map(|k| if i >> k & 1 == 0 { low[k] } else { high[k] }));
        let sides = [[0, 1, 3, 2], [4, 5, 7, 6], [0, 1, 5, 4], [2, 3, 7, 6], [0, 2, 6, 4], [1, 3, 7, 5]];
        let triangles = sides.iter().flat_map(|side| {
            let [a, b, c, d] = side.map(corner);
            [Triangle { v0: a, v1: b, v2: c }, Triangle { v0: a, v1: c, v2: d }]
        });
        CityTriangles::new(triangles.collect(), vec![object; 12], DVec3::ZERO)
    }

    #[test]
    fn a_change_has_no_triangles_of_what_is_removed_and_those_that_are_added() {
        let house = block([0.0; 3], [10.0, 10.0, 9.0], 7);
        let roof = [[20.0, 0.0, 30.0], [30.0, 0.0, 30.0], [20.0, 10.0, 30.0]];
        let tops = |city: &CityTriangles| {
            [[5.0, 5.0], [22.0, 2.0]].map(|place| city.top(place).map(|top| (100.0 * top).round() as i64))
        };
        let with = house.changed(&|_| false, &[roof]);
        assert_eq!(tops(&with), [Some(900), Some(3000)]);
        let without = with.changed(&|object| object == 7, &[]);
        assert_eq!(tops(&without), [None, Some(3000)]);
        let (_, object) = without.first(DVec3::new(22.0, 2.0, 40.0), -DVec3::Z).unwrap();
        assert_eq!(object, NO_OBJECT);
    }

    #[test]
    fn no_ray_passes_between_two_triangles() {
        let [a, b, c, d] = [[0.0, 0.0], [20.0, 0.0], [20.0, 12.0], [0.0, 12.0]].map(|[x, y]| Vec3A::new(x, y, 9.0));
        let pair = [Triangle { v0: a, v1: b, v2: c }, Triangle { v0: a, v1: c, v2: d }];
        for i in 0..=200 {
            // Along their common edge, from both sides.
            let place = a + (c - a) * (i as f32 / 200.0);
            for (side, away) in [(1.0, 5.0), (-1.0, 3.0)] {
                let ray = Ray::new_inf(place + Vec3A::Z * side * away, -Vec3A::Z * side);
                let nearest = pair.iter().map(|triangle| distance(triangle, &ray)).fold(f32::INFINITY, f32::min);
                assert!((nearest - away).abs() < 1e-4, "{i}: {nearest}");
            }
        }
        let city = CityTriangles::new(pair.to_vec(), vec![7; 2], DVec3::new(500.0, 600.0, 40.0));
        assert_eq!(
            [city.top([510.0, 606.0]), city.top([503.0, 601.0]), city.top([521.0, 606.0])],
            [Some(49.0), Some(49.0), None]
        );
        assert!(
            !city.is_free(DVec3::new(510.0, 606.0, 45.0), DVec3::Z)
                && city.is_free(DVec3::new(510.0, 606.0, 50.0), DVec3::Z)
        );
        let beside = Ray::new_inf(Vec3A::new(20.1, 6.0, 20.0), -Vec3A::Z);
        assert!(pair.iter().all(|triangle| distance(triangle, &beside) == f32::INFINITY));
    }
}
