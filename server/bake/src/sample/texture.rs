//! The colour of a piece of surface.
//!
//! In: a triangle and a point on it. Out: linear RGB, averaged over the piece. Next: `attributes` sums it up per voxel.

use crate::scene::{Scene, SceneTexture};
use glam::{Vec2, Vec3};
use std::sync::LazyLock;

/// Most texture reads along a piece's side: 8 x 8 are enough where a texture has 16 texels to the half cell.
const MAX_TAPS: u32 = 8;

static LINEAR_OF_SRGB: LazyLock<[f32; 256]> = LazyLock::new(|| {
    std::array::from_fn(|i| {
        let v = i as f32 / 255.0;
        if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
    })
});

/// An 8-bit sRGB colour as linear light.
pub(crate) fn linear(rgb: [u8; 3]) -> Vec3 {
    Vec3::from_array(rgb.map(|v| LINEAR_OF_SRGB[usize::from(v)]))
}

/// Linear light, 0 to 1, as 8-bit sRGB.
pub(crate) fn srgb(rgb: [f32; 3]) -> [u8; 3] {
    rgb.map(|v| {
        let v = v.clamp(0.0, 1.0);
        let s = if v <= 0.003_130_8 { v * 12.92 } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 };
        (s * 255.0 + 0.5) as u8
    })
}

/// Colour of the square of side `size_m` around `p` on the scene's triangle `source`, whose corners in the caller's
/// coordinates are `corners`. Texels beyond the triangle's rim are not read: in an atlas they belong to something else.
pub(super) fn colour(scene: &Scene, source: u32, corners: &[Vec3; 3], p: Vec3, size_m: f32) -> Vec3 {
    let triangle = &scene.triangles[source as usize];
    let Some(material) = scene.materials.get(triangle.material as usize) else { return Vec3::splat(0.5) };
    let base = linear(material.rgb);
    let Some(texture) = &material.texture else { return base };
    let uv = triangle.uv.map(Vec2::from_array);
    let (e1, e2) = (corners[1] - corners[0], corners[2] - corners[0]);
    let along = e1.normalize_or(Vec3::X);
    let across = e1.cross(e2).normalize_or(Vec3::Z).cross(along);
    let taps = taps(texture, uv, e1.cross(e2).length() * 0.5, size_m);
    let mut sum = Vec3::ZERO;
    let mut count = 0.0;
    for i in 0..taps * taps {
        let offset = |k: u32| ((k as f32 + 0.5) / taps as f32 - 0.5) * size_m;
        let q = p + along * offset(i % taps) + across * offset(i / taps);
        if let Some(bary) = barycentric(e1, e2, q - corners[0], 1e-3) {
            sum += read(texture, uv[0] * bary.x + uv[1] * bary.y + uv[2] * bary.z);
            count += 1.0;
        }
    }
    if count > 0.0 {
        return base * sum / count;
    }
    let centre = barycentric(e1, e2, p - corners[0], f32::INFINITY).unwrap_or(Vec3::splat(1.0 / 3.0));
    let inside = centre.max(Vec3::ZERO) / centre.max(Vec3::ZERO).element_sum().max(1e-6);
    base * read(texture, uv[0] * inside.x + uv[1] * inside.y + uv[2] * inside.z)
}

fn taps(texture: &SceneTexture, uv: [Vec2; 3], area_m2: f32, size_m: f32) -> u32 {
    let texels = (uv[1] - uv[0]).perp_dot(uv[2] - uv[0]).abs() * 0.5 * texture.width as f32 * texture.height as f32;
    let per_m = (texels / area_m2.max(1e-9)).sqrt();
    ((size_m * per_m).ceil() as u32).clamp(1, MAX_TAPS)
}

/// Weights of the corners at `q` (relative to the first); `None` if it lies beyond the rim by more than `slack`.
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

/// Bilinear, repeating; v grows upwards, rows downwards.
pub(crate) fn read(texture: &SceneTexture, uv: Vec2) -> Vec3 {
    let (width, height) = (texture.width.max(1), texture.height.max(1));
    let x = uv.x * width as f32 - 0.5;
    let y = (1.0 - uv.y) * height as f32 - 0.5;
    let (fx, fy) = (x - x.floor(), y - y.floor());
    let wrap = |v: f32, n: u32| (v.floor() as i64).rem_euclid(i64::from(n)) as u32;
    let (x0, y0) = (wrap(x, width), wrap(y, height));
    let (x1, y1) = ((x0 + 1) % width, (y0 + 1) % height);
    let texel = |x: u32, y: u32| texture.rgb.get((y * width + x) as usize).map_or(Vec3::ZERO, |rgb| linear(*rgb));
    texel(x0, y0).lerp(texel(x1, y0), fx).lerp(texel(x0, y1).lerp(texel(x1, y1), fx), fy)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn srgb_round_trips() {
        for v in 0..=255 {
            assert_eq!(srgb(linear([v; 3]).to_array()), [v; 3]);
        }
    }

    #[test]
    fn v_grows_upwards() {
        let texture = SceneTexture { width: 1, height: 2, rgb: vec![[255, 0, 0], [0, 0, 255]] };
        assert!(read(&texture, Vec2::new(0.5, 0.75)).x > 0.99);
        assert!(read(&texture, Vec2::new(0.5, 0.25)).z > 0.99);
    }
}
