//! One texture for a level of detail, resampled from the source's textures.
//!
//! Each chart gets a rectangle of the texture. A texel is the mean, in linear light, of what the chart's triangles show
//! in it; nothing else of the source's texture can bleed in. The texels around a chart continue its colours, so that
//! filtering in the client does not mix neighbouring charts.
//!
//! Generated patterns are copied by their own texels, or by means of 2 x 2, 4 x 4 and so on. Equal windows then have equal
//! texels, of which lossless compression stores one.

use super::charts::{TextureChart, find_charts, fold_patterns, triangle_uv};
use super::texture_canvas::TextureCanvas;
use super::{atlas, base_colour, has_pattern, texture_of};
use crate::columns::srgb::linear_from_srgb;
use crate::sample::texture::read_bilinear;
use crate::scene::{Scene, SceneTexture};
use glam::{Vec2, Vec2Swizzles, Vec3};
use insula_protocol::blockmap::Quality;
use insula_protocol::mesh::{Attribute, AttributeKind};
use insula_protocol::mesh_tile::TileTexture;
use insula_simplify::model::TriangleModel;

/// Texels around each chart that continue its colours.
const PADDING: u32 = 1;
/// Side of the chart of a material without a texture: with its padding it contains a whole 16 x 16 block of the WebP
/// file, wherever it lies.
const PLAIN_SIDE: u32 = 30;
/// Most reads of the source's texture along a texel's side.
const MAX_TAPS: f32 = 4.0;
/// Most reads of a pattern along a texel's side.
const MAX_PATTERN_TAPS: u32 = 16;
/// Share of a texel by which a chart may exceed a pattern's texels, so that rounding adds none.
const PATTERN_SLACK: f32 = 0.01;
/// Bits of a texture coordinate below one texel.
const SUBTEXEL_BITS: u32 = 3;
/// How often the texels are enlarged until everything fits, and by how much each time.
const MAX_ENLARGEMENTS: u32 = 60;
const ENLARGEMENT: f64 = 1.25;

/// Lengths that decide the size of a texture.
#[derive(Debug, Clone, Copy)]
pub(super) struct TextureScale {
    /// Unit of the model's positions.
    pub(super) step_m: f64,
    /// Least side of a texel.
    pub(super) texel_m: f64,
}

/// The texture of a level of detail.
pub(super) struct BakedTexture {
    pub(super) texture: TileTexture,
    /// Texture coordinates of all corners.
    pub(super) coordinates: Attribute,
    /// Side of the texels that are larger than the source's; 0 if none is.
    pub(super) texel_m: f64,
}

/// Resamples the surface's textures. Texels are no smaller than `scale.texel_m`, and no smaller than the source's. They
/// are enlarged until everything fits; `None` if nothing helps.
pub(super) fn bake_texture(
    scene: &Scene,
    model: &TriangleModel,
    scale: TextureScale,
    quality: Quality,
) -> Option<BakedTexture> {
    let model = &*fold_patterns(scene, model);
    let charts = find_charts(scene, model, scale.step_m);
    let mut texel_m = scale.texel_m;
    for _ in 0..MAX_ENLARGEMENTS {
        let baked = bake_at(scene, model, &charts, texel_m, quality);
        if baked.is_some() {
            return baked;
        }
        texel_m *= ENLARGEMENT;
    }
    None
}

/// Side of texels up to which a texture keeps all of its source's: a model's textures of smaller texels are the same.
pub(super) fn whole_texels_m(scene: &Scene, model: &TriangleModel, step_m: f64) -> f64 {
    let model = &*fold_patterns(scene, model);
    let charts = find_charts(scene, model, step_m);
    charts.iter().fold(f64::INFINITY, |least, chart| least.min(1.0 / chart.texels_per_m))
}

/// `None` if the charts or the file are too large.
fn bake_at(
    scene: &Scene,
    model: &TriangleModel,
    charts: &[TextureChart],
    texel_m: f64,
    quality: Quality,
) -> Option<BakedTexture> {
    let scales: Vec<f64> = charts.iter().map(|chart| chart_scale(scene, chart, texel_m)).collect();
    let bounds: Vec<[Vec2; 2]> = charts.iter().zip(&scales).map(|(chart, s)| chart_bounds(scene, chart, *s)).collect();
    let of_chart = |i: usize| chart_size(texture_of(scene, charts[i].material), bounds[i], scales[i]);
    let sizes: Vec<[u32; 2]> = (0..charts.len()).map(of_chart).collect();
    let padded: Vec<[u32; 2]> = sizes.iter().copied().map(padded_size).collect();
    let atlas = atlas::pack(&padded)?;
    let placed: Vec<PlacedChart<'_>> = charts
        .iter()
        .zip(&sizes)
        .zip(&bounds)
        .zip(&atlas.positions)
        .map(|(((chart, size), bounds), position)| PlacedChart::new(chart, *bounds, *size, *position))
        .collect();
    let canvas = paint(scene, model, &placed, atlas.size);
    let is_photo = |chart: &TextureChart| texture_of(scene, chart.material).is_some_and(|texture| !texture.is_pattern);
    let bytes = if charts.iter().any(is_photo) { canvas.encode(quality)? } else { canvas.encode_pattern()? };
    let is_resampled = scales.iter().any(|scale| *scale < 1.0);
    Some(BakedTexture {
        texture: TileTexture { size_px: atlas.size.map(|side| side as u16), bytes },
        coordinates: texture_coordinates(model, &placed, atlas.size),
        texel_m: if is_resampled { texel_m } else { 0.0 },
    })
}

/// Texels of a chart per texel of its source along a side, at most 1. That of a pattern is rounded up to 1/2, 1/4 and so
/// on.
fn chart_scale(scene: &Scene, chart: &TextureChart, texel_m: f64) -> f64 {
    let wanted = (1.0 / (texel_m * chart.texels_per_m)).min(1.0);
    if !has_pattern(scene, chart.material) {
        return wanted;
    }
    let mut scale = 1.0;
    while scale / 2.0 >= wanted && scale * f64::from(MAX_PATTERN_TAPS) > 1.0 {
        scale /= 2.0;
    }
    scale
}

/// Lower and upper corner of the texture coordinates that a chart shows: in a pattern, at the borders of texels.
fn chart_bounds(scene: &Scene, chart: &TextureChart, scale: f64) -> [Vec2; 2] {
    let TextureChart { low, high, .. } = *chart;
    let Some(texture) = texture_of(scene, chart.material).filter(|texture| texture.is_pattern) else {
        return [low, high];
    };
    let texels = Vec2::new(texture.width as f32, texture.height as f32) * scale as f32;
    let first = (low * texels + PATTERN_SLACK).floor();
    [first / texels, (high * texels - PATTERN_SLACK).ceil().max(first + 1.0) / texels]
}

/// Width and height of a chart in texels, without padding.
fn chart_size(texture: Option<&SceneTexture>, [low, high]: [Vec2; 2], scale: f64) -> [u32; 2] {
    let Some(texture) = texture else { return [PLAIN_SIDE; 2] };
    let extent = high - low;
    let side = |extent: f32, texels: u32| (f64::from(extent) * f64::from(texels) * scale).ceil().max(1.0) as u32;
    [side(extent.x, texture.width), side(extent.y, texture.height)]
}

/// The rectangle that a chart takes of the atlas. It is never taller than wide.
fn padded_size([width, height]: [u32; 2]) -> [u32; 2] {
    [width.max(height), width.min(height)].map(|side| side.saturating_add(2 * PADDING))
}

/// A chart in its rectangle of the texture, which maps texture coordinates of the source to texels.
struct PlacedChart<'a> {
    chart: &'a TextureChart,
    /// Upper left texel of the rectangle.
    position: [u32; 2],
    /// Width and height of the rectangle.
    padded: [u32; 2],
    /// Source coordinates of the chart's upper left corner.
    origin: Vec2,
    /// Texels per unit of the source's coordinates; 0 along an axis in which the chart has no extent.
    scale: Vec2,
    /// Upper left corner inside the padding, in texels.
    corner: Vec2,
    /// Size in texels, without padding, before turning.
    size: Vec2,
    /// Whether the chart's columns are rows of the texture.
    is_turned: bool,
}

impl<'a> PlacedChart<'a> {
    fn new(chart: &'a TextureChart, [low, high]: [Vec2; 2], size: [u32; 2], position: [u32; 2]) -> Self {
        let padded = padded_size(size);
        let size = Vec2::new(size[0] as f32, size[1] as f32);
        let extent = high - low;
        let scale = Vec2::select(extent.cmpgt(Vec2::ZERO), size / extent.max(Vec2::splat(1e-30)), Vec2::ZERO);
        Self {
            chart,
            position,
            padded,
            // v points upwards, rows run downwards.
            origin: Vec2::new(low.x, high.y),
            scale: scale * Vec2::new(1.0, -1.0),
            corner: Vec2::new(position[0] as f32, position[1] as f32) + PADDING as f32,
            size,
            is_turned: size.y > size.x,
        }
    }

    /// Texel coordinates of `uv` relative to `corner`.
    fn texel_at(&self, uv: Vec2) -> Vec2 {
        let p = (uv - self.origin) * self.scale;
        let p = Vec2::select(self.scale.cmpeq(Vec2::ZERO), self.size / 2.0, p).clamp(Vec2::ZERO, self.size);
        if self.is_turned { p.yx() } else { p }
    }

    /// Source coordinates of a position relative to `corner`; the inverse of [`Self::texel_at`], also in the padding.
    fn uv_at(&self, texel: Vec2) -> Vec2 {
        self.origin + if self.is_turned { texel.yx() } else { texel } / self.scale
    }

    /// The middle relative to `corner`.
    fn middle(&self) -> Vec2 {
        let middle = self.size / 2.0;
        if self.is_turned { middle.yx() } else { middle }
    }
}

/// The texture coordinates of all corners in the packed texture.
fn texture_coordinates(model: &TriangleModel, placed: &[PlacedChart<'_>], size: [u32; 2]) -> Attribute {
    let layer = &model.layers[0];
    let bits = (size[0].max(size[1]).ilog2() + 1 + SUBTEXEL_BITS).clamp(8, 16);
    let max = ((1u32 << bits) - 1) as f32;
    let whole = Vec2::new(size[0] as f32, size[1] as f32);
    let mut values = vec![[0; 4]; layer.values.len()];
    for placed in placed {
        let is_plain = placed.chart.texels_per_m <= 0.0;
        for corner in placed.chart.triangles.iter().flat_map(|t| 3 * t..3 * t + 3) {
            let value = layer.corners[corner as usize];
            let [u, v, ..] = layer.values[value as usize];
            let texel = if is_plain { placed.middle() } else { placed.texel_at(Vec2::new(u, v)) };
            let at = ((placed.corner + texel) / whole * max + 0.5).floor().clamp(Vec2::ZERO, Vec2::splat(max));
            values[value as usize] = [at.x as u32, at.y as u32, 0, 0];
        }
    }
    Attribute {
        kind: AttributeKind::TexCoord,
        components: 2,
        bits: bits as u8,
        range: [0.0, 1.0 / max],
        values,
        corners: layer.corners.clone(),
    }
}

fn paint(scene: &Scene, model: &TriangleModel, placed: &[PlacedChart<'_>], size: [u32; 2]) -> TextureCanvas {
    let mut canvas = TextureCanvas::new(size);
    for placed in placed {
        let chart = placed.chart;
        let base = linear_from_srgb(base_colour(scene, chart.material));
        let texture = texture_of(scene, chart.material);
        if let Some(pattern) = texture.filter(|texture| texture.is_pattern) {
            draw_pattern(&mut canvas, placed, pattern, base);
            continue;
        }
        if let Some(texture) = texture {
            let texels = (chart.high - chart.low) * Vec2::new(texture.width as f32, texture.height as f32);
            let taps = (texels / placed.size).max_element().ceil().clamp(1.0, MAX_TAPS) as u32;
            for &t in &chart.triangles {
                let uv = triangle_uv(model, t);
                let corners = uv.map(|uv| placed.texel_at(uv));
                canvas.draw_triangle(corners, placed.corner, taps, |weights| {
                    base * read_bilinear(texture, uv[0] * weights.x + uv[1] * weights.y + uv[2] * weights.z)
                });
            }
        } else {
            canvas.fill_rectangle(placed.position, placed.padded, base);
        }
        canvas.extend_into_padding(placed.position, placed.padded);
    }
    canvas
}

/// Fills the rectangle of a pattern's chart. Its reads are at the centres of the pattern's texels.
fn draw_pattern(canvas: &mut TextureCanvas, placed: &PlacedChart<'_>, pattern: &SceneTexture, base: Vec3) {
    let taps = ((pattern.width as f32 / placed.scale.x.abs()).round() as u32).clamp(1, MAX_PATTERN_TAPS);
    let [width, height] = placed.padded;
    for (x, y) in (0..height).flat_map(|y| (0..width).map(move |x| (x, y))) {
        let texel = Vec2::new(x as f32, y as f32) - PADDING as f32;
        for (i, j) in (0..taps).flat_map(|j| (0..taps).map(move |i| (i, j))) {
            let read = texel + (Vec2::new(i as f32, j as f32) + 0.5) / taps as f32;
            canvas.add(placed.corner + read, base * read_bilinear(pattern, placed.uv_at(read)));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Material;
    use insula_protocol::mesh_tile::decode_webp;
    use insula_simplify::model::{CornerLayer, TriangleModel};
    use std::collections::HashSet;
    use std::sync::Arc;

    /// A checkerboard of 8 x 8 texels of three colours.
    fn pattern() -> SceneTexture {
        let colour = |i: u32| [[200, 190, 180], [50, 60, 70], [120, 110, 100]][((i % 8 + i / 8) % 3) as usize];
        SceneTexture { width: 8, height: 8, rgb: (0..64).map(colour).collect(), is_pattern: true }
    }

    /// A square of 4 x 4 m that shows the texture coordinates from `low` to `high`.
    fn square([low, high]: [[f32; 2]; 2]) -> TriangleModel {
        let positions = vec![[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [4.0, 0.0, 4.0], [0.0, 0.0, 4.0]];
        let value = |u: f32, v: f32| [u, v, 0.0, 0.0];
        let values =
            vec![value(low[0], low[1]), value(high[0], low[1]), value(high[0], high[1]), value(low[0], high[1])];
        let corners = vec![0, 1, 2, 0, 2, 3];
        let layers = vec![CornerLayer { kind: AttributeKind::Other, width: 3, values, corners }];
        TriangleModel { positions, triangles: vec![[0, 1, 2], [0, 2, 3]], layers }
    }

    #[test]
    fn patterns_keep_their_texels_wherever_a_chart_begins() {
        let materials = vec![Material { rgb: [255; 3], texture: Some(Arc::new(pattern())), is_reflective: false }];
        let scene = Scene { materials, ..Scene::default() };
        for (range, expected_px) in [([[0.0, 0.0], [2.0, 1.0]], [16, 8]), ([[40.3, 7.1], [41.05, 7.6]], [7, 5])] {
            let scale = TextureScale { step_m: 1.0, texel_m: 1e-3 };
            let baked = bake_texture(&scene, &square(range), scale, Quality::Decibels(30.0)).unwrap();
            assert!(baked.texture.size_px.iter().zip(expected_px).all(|(have, need)| u32::from(*have) >= need));
            let rgb = decode_webp(&baked.texture.bytes, baked.texture.size_px.map(u32::from)).unwrap();
            let colours: HashSet<[u8; 3]> = rgb.as_chunks::<3>().0.iter().copied().collect();
            let known: HashSet<[u8; 3]> = pattern().rgb.into_iter().chain([[0; 3]]).collect();
            assert!(colours.is_subset(&known), "{colours:?}");
        }
    }

    #[test]
    fn coarser_patterns_have_texels_of_whole_texels() {
        let materials = vec![Material { rgb: [255; 3], texture: Some(Arc::new(pattern())), is_reflective: false }];
        let scene = Scene { materials, ..Scene::default() };
        let model = square([[0.0, 0.0], [3.0, 3.0]]);
        let chart = &find_charts(&scene, &model, 1.0)[0];
        // 24 texels along 4 m.
        assert_eq!(
            [0.1, 0.2, 0.4, 100.0].map(|texel_m| chart_scale(&scene, chart, texel_m)),
            [1.0, 1.0, 0.5, 1.0 / 16.0]
        );
        assert_eq!(chart_bounds(&scene, chart, 0.5), [Vec2::ZERO, Vec2::splat(3.0)]);
        let odd = TextureChart { low: Vec2::splat(0.3), high: Vec2::splat(0.499), ..chart.clone() };
        assert_eq!(chart_bounds(&scene, &odd, 0.5), [Vec2::splat(0.25), Vec2::splat(0.5)]);
    }
}
