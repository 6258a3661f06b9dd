//! The colour of a piece of surface, and bilinear texture reads.

use crate::columns::srgb::linear_from_srgb;
use crate::scene::{Scene, SceneTexture};
use glam::{Vec2, Vec3};

/// Most texture reads along a patch's side. A bilinear read covers two texels, so this suffices for 16 texels per side.
const MAX_TAPS: u32 = 8;

/// A square piece of one of the scene's triangles.
#[derive(Debug, Clone, Copy)]
pub(super) struct SurfacePatch<'a> {
    /// Index into the scene's triangles.
    pub(super) triangle: u32,
    /// Corners of the triangle in the caller's coordinates, metres.
    pub(super) corners: &'a [Vec3; 3],
    /// Centre of the patch in the same coordinates.
    pub(super) centre: Vec3,
    pub(super) side_m: f32,
}

/// Mean colour of a patch as linear RGB. Texels outside of the triangle are not read: in a texture atlas they belong to
/// another surface.
pub(super) fn mean_colour(scene: &Scene, patch: SurfacePatch<'_>) -> Vec3 {
    let triangle = &scene.triangles[patch.triangle as usize];
    let Some(material) = scene.materials.get(triangle.material as usize) else { return Vec3::splat(0.5) };
    let base = linear_from_srgb(material.rgb);
    let Some(texture) = &material.texture else { return base };
    let uv = triangle.uv.map(Vec2::from_array);
    let corners = patch.corners;
    let (e1, e2) = (corners[1] - corners[0], corners[2] - corners[0]);
    let along = e1.normalize_or(Vec3::X);
    let across = e1.cross(e2).normalize_or(Vec3::Z).cross(along);
    let taps = taps(texture, uv, e1.cross(e2).length() * 0.5, patch.side_m);
    let mut sum = Vec3::ZERO;
    let mut count = 0.0;
    for i in 0..taps * taps {
        let offset = |k: u32| ((k as f32 + 0.5) / taps as f32 - 0.5) * patch.side_m;
        let p = patch.centre + along * offset(i % taps) + across * offset(i / taps);
        if let Some(weights) = barycentric(e1, e2, p - corners[0], 1e-3) {
            sum += read_bilinear(texture, uv[0] * weights.x + uv[1] * weights.y + uv[2] * weights.z);
            count += 1.0;
        }
    }
    if count > 0.0 {
        return base * sum / count;
    }
    // No read fell into the triangle: read once at the point of the triangle nearest to the centre.
    let centre = barycentric(e1, e2, patch.centre - corners[0], f32::INFINITY).unwrap_or(Vec3::splat(1.0 / 3.0));
    let inside = centre.max(Vec3::ZERO) / centre.max(Vec3::ZERO).element_sum().max(1e-6);
    base * read_bilinear(texture, uv[0] * inside.x + uv[1] * inside.y + uv[2] * inside.z)
}

/// Number of reads along a patch's side: one per texel, up to [`MAX_TAPS`].
fn taps(texture: &SceneTexture, uv: [Vec2; 3], area_m2: f32, side_m: f32) -> u32 {
    let texels = (uv[1] - uv[0]).perp_dot(uv[2] - uv[0]).abs() * 0.5 * texture.width as f32 * texture.height as f32;
    let texels_per_m = (texels / area_m2.max(1e-9)).sqrt();
    ((side_m * texels_per_m).ceil() as u32).clamp(1, MAX_TAPS)
}

/// Barycentric weights of a point relative to the first corner; `None` if one of them is below `-slack`.
fn barycentric(e1: Vec3, e2: Vec3, q: Vec3, slack: f32) -> Option<Vec3> {
    let (d11, d12, d22) = (e1.dot(e1), e1.dot(e2), e2.dot(e2));
    let (q1, q2) = (q.dot(e1), q.dot(e2));
    let det = d11 * d22 - d12 * d12;
    if det <= 0.0 {
        return None;
    }
    let (b, c) = ((d22 * q1 - d12 * q2) / det, (d11 * q2 - d12 * q1) / det);
    let weights = Vec3::new(1.0 - b - c, b, c);
    (weights.min_element() >= -slack).then_some(weights)
}

/// The texture at `uv` as linear RGB: bilinear, repeating, v upwards.
pub(crate) fn read_bilinear(texture: &SceneTexture, uv: Vec2) -> Vec3 {
    let (width, height) = (texture.width.max(1), texture.height.max(1));
    let x = uv.x * width as f32 - 0.5;
    let y = (1.0 - uv.y) * height as f32 - 0.5;
    let (left, top) = (x.floor(), y.floor());
    let (fx, fy) = (x - left, y - top);
    let wrap = |v: f32, n: u32| {
        let v = v as i64;
        // Most reads are inside, and divisions are slow.
        if (0..i64::from(n)).contains(&v) { v as u32 } else { v.rem_euclid(i64::from(n)) as u32 }
    };
    let next = |v: u32, n: u32| if v + 1 < n { v + 1 } else { 0 };
    let (x0, y0) = (wrap(left, width), wrap(top, height));
    let (x1, y1) = (next(x0, width), next(y0, height));
    let texel =
        |x: u32, y: u32| texture.rgb.get((y * width + x) as usize).map_or(Vec3::ZERO, |rgb| linear_from_srgb(*rgb));
    texel(x0, y0).lerp(texel(x1, y0), fx).lerp(texel(x0, y1).lerp(texel(x1, y1), fx), fy)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn v_points_upwards() {
        let texture = SceneTexture { width: 1, height: 2, rgb: vec![[255, 0, 0], [0, 0, 255]], is_pattern: false };
        assert!(read_bilinear(&texture, Vec2::new(0.5, 0.75)).x > 0.99);
        assert!(read_bilinear(&texture, Vec2::new(0.5, 0.25)).z > 0.99);
    }
}
