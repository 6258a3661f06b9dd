//! The surface of landmarks: smooth normals, occlusion at vertices, and the place in a stone's pattern. GPU twin: `landmark.wgsl`.
//!
//! The third vec4 of a triangle has what each corner carries besides: an octahedral normal of two times 12 bits, and the visible
//! share of the sky in 8 bits above.

use super::ray::Ray;
use crate::layout::DrawNode;
use crate::mesh::{HEAD_VEC4S, LANDMARK_COUNT_SHIFT, LANDMARK_OCCLUSION_BIT, LANDMARK_VEC4S};
use glam::{Vec2, Vec3};

/// Least cosine between a smooth normal and the direction to the viewer. At silhouettes, interpolated normals can turn away.
pub(crate) const MIN_FACING_NORMAL: f32 = 0.02;

/// Where a ray hits a triangle.
#[derive(Debug, Clone, Copy)]
pub(super) struct TrianglePoint {
    /// Address of the triangle in the atlas, in vec4s.
    pub(super) triangle: u32,
    /// Shares of its second and third corner.
    pub(super) u: f32,
    pub(super) v: f32,
    /// -1 if it is seen from behind, else 1.
    pub(super) turned: f32,
}

/// What a landmark's triangle has besides other triangles.
#[derive(Debug, Clone, Copy)]
pub(super) struct LandmarkSurface {
    /// Of length 1, on the side that is seen.
    normal: Vec3,
    /// Visible share of the sky; `None` if the tile does not have it.
    pub(super) sky: Option<f32>,
    /// 1 + number of the stone, 0 without.
    pub(super) stone: u32,
    /// Origin of the stone's pattern, relative to the camera.
    pub(super) origin: Vec3,
}

impl LandmarkSurface {
    /// The smooth normal, turned to the viewer as far as needed. `dir` is the ray's direction.
    pub(super) fn normal_towards(&self, dir: Vec3) -> Vec3 {
        let facing = -self.normal.dot(dir);
        if facing >= MIN_FACING_NORMAL {
            return self.normal;
        }
        (self.normal - dir * (MIN_FACING_NORMAL - facing)).normalize_or(-dir)
    }
}

/// Vec4s of a triangle of a mesh with these facts in its head.
pub(super) fn triangle_stride(info: [u32; 4]) -> u32 {
    if info[2] >> LANDMARK_COUNT_SHIFT > 0 { 3 } else { 2 }
}

/// The landmark that a hit triangle belongs to; `None` if to none.
pub(super) fn landmark_at(
    ray: &mut Ray<'_>,
    node: &DrawNode,
    info: [u32; 4],
    hit: TrianglePoint,
) -> Option<LandmarkSurface> {
    let count = info[2] >> LANDMARK_COUNT_SHIFT;
    if count == 0 || ray.scene.frame.landmarks == 0 {
        return None;
    }
    let words = ray.read_vec4(hit.triangle + 2);
    let turned = hit.turned;
    let number = words[3] & !LANDMARK_OCCLUSION_BIT;
    if number == 0 || number > count {
        return None;
    }
    let entry = ray.read_vec4(node.mesh - 1 + HEAD_VEC4S + (number - 1) * LANDMARK_VEC4S);
    let anchor = Vec3::new(f32::from_bits(entry[1]), f32::from_bits(entry[2]), f32::from_bits(entry[3]));
    let corner = Vec3::new(node.corner[0], node.corner[1], node.mesh_z_m);
    let [a, b, c] = [words[0], words[1], words[2]].map(unpack_normal);
    let normal = (a + (b - a) * hit.u + (c - a) * hit.v) * turned;
    let share = |word: u32| (word >> 24) as f32 / 255.0;
    let [sky_a, sky_b, sky_c] = [share(words[0]), share(words[1]), share(words[2])];
    let sky = sky_a + (sky_b - sky_a) * hit.u + (sky_c - sky_a) * hit.v;
    Some(LandmarkSurface {
        normal: normal.normalize_or(a * turned),
        sky: (words[3] & LANDMARK_OCCLUSION_BIT != 0).then_some(sky),
        stone: entry[0],
        origin: corner + anchor,
    })
}

/// The unit vector of an octahedral normal (Cigolle and others 2014, "A survey of efficient representations for independent unit
/// vectors").
pub(crate) fn unpack_normal(word: u32) -> Vec3 {
    let at = Vec2::new((word & 0xfff) as f32, (word >> 12 & 0xfff) as f32) * (2.0 / 4095.0) - 1.0;
    let z = 1.0 - at.x.abs() - at.y.abs();
    let fold = (-z).max(0.0);
    let folded = Vec2::new(
        if at.x >= 0.0 { at.x - fold } else { at.x + fold },
        if at.y >= 0.0 { at.y - fold } else { at.y + fold },
    );
    folded.extend(z).normalize_or(Vec3::Z)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::pack_normal;

    #[test]
    fn packed_normals_are_close_everywhere() {
        for i in 0..5000 {
            let z = 1.0 - (2 * i + 1) as f32 / 5000.0;
            let angle = i as f32 * 2.399_963;
            let n = (Vec2::from_angle(angle) * (1.0 - z * z).sqrt()).extend(z);
            assert!(unpack_normal(pack_normal(n)).dot(n) > 0.999_998, "{n}");
        }
    }
}
