//! Brings photo textures to the level of lit materials: photos carry the light and the exposure of their day.
//!
//! The sources of one folder are one set: they have one factor, so that neighbouring tiles of a data set still fit.

use crate::columns::srgb::{linear_from_srgb, srgb_from_linear};
use crate::error::BakeError;
use crate::sample::texture::read_bilinear;
use crate::scene::scratch_scene::ScratchScene;
use crate::scene::{ObjectKind, SceneTriangle};
use glam::{Vec2, Vec3};

/// Mean luminance that textures of buildings should have: that of a street of plaster, brick, windows and roofs.
const TARGET: f64 = 0.25;
/// A mean that differs from the target by a smaller share is left as it is.
const TOLERANCE: f64 = 0.2;
/// Factors outside would show the noise of dark photos, or make grey of white ones.
const GAIN_RANGE: [f64; 2] = [0.5, 2.5];
/// Linear light above which a factor over 1 compresses instead of clipping.
const KNEE: f32 = 0.6;
/// Most triangles that are measured.
const MAX_MEASURED: u64 = 1 << 16;
/// Most reads along a triangle's side, and the length for one read in metres.
const MAX_READS: f32 = 4.0;
const READ_M: f32 = 2.0;

/// A textured triangle to measure.
struct Measured {
    texture: u32,
    uv: [Vec2; 3],
    rgb: [u8; 3],
    area_m2: f32,
}

/// Measures the textures and changes their level. `set_of_texture` has the set of each photo; the result the factor of
/// each set. Fails if triangles or textures cannot be read.
pub(super) fn level_textures(city: &mut ScratchScene, set_of_texture: &[Option<u32>]) -> Result<Vec<f64>, BakeError> {
    let sets = set_of_texture.iter().flatten().max().map_or(0, |last| *last as usize + 1);
    if sets == 0 {
        return Ok(Vec::new());
    }
    let mut sums = vec![(0.0, 0.0); sets];
    for measured in select(city, set_of_texture)?.chunk_by(|a, b| a.texture == b.texture) {
        let number = measured[0].texture;
        let Some(set) = set_of_texture[number as usize] else { continue };
        let texture = city.textures.get(number)?;
        let (light, area_m2) = &mut sums[set as usize];
        for Measured { uv, rgb, area_m2: own_m2, .. } in measured {
            let base = linear_from_srgb(*rgb);
            let mean = mean_over(uv, *own_m2, |uv| luminance(base * read_bilinear(&texture, uv)));
            *light += mean * f64::from(*own_m2);
            *area_m2 += f64::from(*own_m2);
        }
    }
    let gains: Vec<f64> = sums.iter().map(|&(light, area_m2)| gain(light, area_m2)).collect();
    for (number, set) in set_of_texture.iter().enumerate() {
        let gain = set.map_or(1.0, |set| gains[set as usize]);
        if gain != 1.0 {
            city.textures.set_tone(number as u32, &tone_curve(gain as f32));
        }
    }
    Ok(gains)
}

/// The factor that brings textures with this sum of light times area to the target; 1 if they are near it, or if there is
/// nothing to measure. It has two decimals, so that differences of rounding do not reach the texels.
fn gain(light: f64, area_m2: f64) -> f64 {
    let mean = light / area_m2;
    if mean.is_nan() || (mean / TARGET - 1.0).abs() <= TOLERANCE {
        return 1.0;
    }
    ((TARGET / mean).clamp(GAIN_RANGE[0], GAIN_RANGE[1]) * 100.0).round() / 100.0
}

/// At most [`MAX_MEASURED`] triangles of buildings with photos, evenly from the whole city, sorted by texture so that each
/// texture is loaded once.
fn select(city: &ScratchScene, set_of_texture: &[Option<u32>]) -> Result<Vec<Measured>, BakeError> {
    let (stride, mut textured, mut all) = (city.triangles / MAX_MEASURED + 1, 0u64, Vec::new());
    let mut objects = city.objects.cursor();
    city.try_for_each(|triangle| {
        let material = city.materials[triangle.material as usize];
        let is_building = objects.get(triangle.object as usize)?.kind == ObjectKind::Building;
        if let Some(texture) =
            material.texture.filter(|number| is_building && set_of_texture[*number as usize].is_some())
        {
            if textured.is_multiple_of(stride) {
                let SceneTriangle { uv, .. } = triangle;
                let [a, b, c] = triangle.corners.map(Vec3::from_array);
                let area_m2 = (b - a).cross(c - a).length() * 0.5;
                all.push(Measured { texture, uv: uv.map(Vec2::from_array), rgb: material.rgb, area_m2 });
            }
            textured += 1;
        }
        Ok(())
    })?;
    all.sort_by_key(|measured| measured.texture);
    Ok(all)
}

/// Mean of `read` over a triangle: at the centres of equal triangles into which it is divided.
fn mean_over(uv: &[Vec2; 3], area_m2: f32, read: impl Fn(Vec2) -> f64) -> f64 {
    let rows = (area_m2.sqrt() / READ_M).ceil().clamp(1.0, MAX_READS);
    let (right, up) = ((uv[1] - uv[0]) / rows, (uv[2] - uv[0]) / rows);
    let mut sum = 0.0;
    let rows = rows as u32;
    for j in 0..rows {
        for i in 0..rows - j {
            let corner = uv[0] + right * i as f32 + up * j as f32;
            sum += read(corner + (right + up) / 3.0);
            if i + j + 1 < rows {
                sum += read(corner + (right + up) * (2.0 / 3.0));
            }
        }
    }
    sum / f64::from(rows * rows)
}

fn luminance(rgb: Vec3) -> f64 {
    f64::from(rgb.dot(Vec3::new(0.2126, 0.7152, 0.0722)))
}

/// New value of each 8-bit sRGB value. Light above the knee is compressed, so that white stays white and what is bright
/// keeps its detail.
fn tone_curve(gain: f32) -> [u8; 256] {
    let span = (gain - KNEE) / (1.0 - KNEE);
    let lift = |linear: f32| {
        let over = (linear * gain - KNEE) / (1.0 - KNEE);
        // Slope 1 at the knee, 1 at `span`.
        if over <= 0.0 || gain <= 1.0 {
            linear * gain
        } else {
            KNEE + (1.0 - KNEE) * over / (1.0 + (1.0 - 1.0 / span) * over)
        }
    };
    std::array::from_fn(|v| {
        let linear = linear_from_srgb([v as u8; 3]).to_array().map(lift);
        srgb_from_linear(linear)[0]
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::texture_store::TextureStore;
    use crate::scene::{Material, Scene, SceneObject, SceneTexture};
    use std::sync::Arc;

    #[test]
    fn gain_is_limited_and_small_differences_are_left() {
        for (mean, expected) in
            [(0.25, 1.0), (0.21, 1.0), (0.299, 1.0), (0.125, 2.0), (0.4, 0.63), (0.01, 2.5), (0.9, 0.5)]
        {
            assert_eq!(gain(mean * 7.0, 7.0), expected, "{mean}");
        }
        assert_eq!((gain(0.0, 0.0), gain(0.0, 5.0)), (1.0, 2.5));
    }

    #[test]
    fn tone_curve_is_proportional_below_the_knee_and_keeps_white_and_order() {
        for gain in [0.5, 0.8, 1.3, 2.5] {
            let curve = tone_curve(gain);
            assert!(curve.is_sorted());
            assert_eq!((curve[0], curve[255]), (0, if gain < 1.0 { srgb_from_linear([gain; 3])[0] } else { 255 }));
            assert!(curve[240] < curve[255]);
            let [before, after] = [[80; 3], [curve[80]; 3]].map(|rgb| linear_from_srgb(rgb).x);
            assert!((after / before / gain - 1.0).abs() < 0.02);
        }
    }

    #[test]
    fn each_set_gets_the_factor_of_its_buildings() {
        let texture =
            |v: u8| Some(Arc::new(SceneTexture { width: 2, height: 1, rgb: vec![[v; 3], [0; 3]], is_pattern: false }));
        // The left half of the dark texture, and the right half of both for terrain, which does not count.
        let material = |texture| Material { rgb: [255; 3], texture, is_reflective: false };
        let triangle = |material, object, u: f32| SceneTriangle {
            corners: [[0.0; 3], [9.0, 0.0, 0.0], [0.0, 9.0, 0.0]],
            uv: [[u, 0.5]; 3],
            material,
            object,
        };
        let object = |kind| SceneObject { id: String::new(), kind, base_z_m: 0.0 };
        let scene = Scene {
            triangles: vec![triangle(0, 0, 0.25), triangle(1, 0, 0.25), triangle(0, 1, 0.75), triangle(1, 1, 0.75)],
            objects: vec![object(ObjectKind::Building), object(ObjectKind::Terrain)],
            materials: vec![material(texture(99)), material(texture(137))],
            ..Scene::default()
        };
        let mut city = ScratchScene::from_scene(scene).unwrap();
        let hashes = [0, 1].map(|number| city.textures.hash(number));
        assert_eq!(level_textures(&mut city, &[Some(0), Some(1)]).unwrap(), [2.0, 1.0]);
        let level = |textures: &TextureStore, number| textures.get(number).unwrap().rgb[0][0];
        assert_eq!((level(&city.textures, 0), level(&city.textures, 1)), (137, 137));
        assert_eq!([0, 1].map(|number| city.textures.hash(number) == hashes[number as usize]), [false, true]);
        assert!(level_textures(&mut city, &[]).unwrap().is_empty());
    }
}
