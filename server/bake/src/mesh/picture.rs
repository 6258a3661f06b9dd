//! The picture that a leaf's triangles wear.
//!
//! In: a textured surface and how long its texels may be. Out: a [`Dress`]: a packed picture, and where each corner lies in
//! it. Next: `chain`.
//!
//! Texels are means, in linear light, over what of the source's picture the triangles show: what lies beside a chart in the
//! source's own atlas never gets in. Around it lies what it shows at its rim, so that nothing bleeds.

use std::sync::LazyLock;

use glam::{Vec2, Vec2Swizzles, Vec3};
use insula_protocol::{
    blockmap::Quality,
    mesh::{Attribute, AttributeKind},
    mesh_tile::TileTexture,
};

use super::{
    atlas::{self, Atlas},
    charts::{self, Chart},
    lattice,
    wire::{self, Shown},
};
use crate::{
    model::TriangleModel,
    sample::texture::{linear, read, srgb},
    scene::Scene,
};

/// Texels around each chart that show what it shows at its rim.
const PAD: u32 = 1;
/// Side of what has one colour: wide enough for a whole block of the file, wherever it lies.
const PLAIN: u32 = 30;
/// Most reads along a texel's side.
const MOST_TAPS: u32 = 4;
/// Finer than a texel: places in the picture have so many bits more than its side.
const SUB_BITS: u32 = 3;

/// What a surface wears.
pub(super) struct Dress {
    pub(super) texture: TileTexture,
    /// Texture coordinates of all corners.
    pub(super) attribute: Attribute,
    /// Length of the texels that are longer than the source's, 0 if none is.
    pub(super) texel_m: f64,
}

/// Paints the surface's pictures anew, with texels of `texel_m` or longer, none shorter than the source's. `step_m` is the
/// length of the model's unit. `None` if it cannot be packed.
pub(super) fn dress(
    scene: &Scene,
    model: &TriangleModel,
    (step_m, texel_m): (f64, f64),
    quality: Quality,
) -> Option<Dress> {
    let charts = charts::charts(scene, model, step_m);
    let mut texel_m = texel_m;
    // Longer texels until all of it fits.
    for _ in 0..60 {
        let scales: Vec<f64> = charts.iter().map(|chart| (1.0 / (texel_m * chart.px_per_m)).min(1.0)).collect();
        let sizes: Vec<[u32; 2]> = charts.iter().zip(&scales).map(|(chart, s)| size(scene, chart, *s)).collect();
        let padded: Vec<[u32; 2]> = sizes.iter().copied().map(padded).collect();
        let packed = atlas::pack(&padded).and_then(|atlas| {
            let canvas = paint(scene, model, (&charts, &sizes), &atlas);
            let texture = TileTexture { size_px: atlas.size.map(|side| side as u16), bytes: canvas.pack(quality)? };
            let limited = scales.iter().any(|scale| *scale < 1.0);
            let attribute = places(model, (&charts, &sizes), &atlas);
            Some(Dress { texture, attribute, texel_m: if limited { texel_m } else { 0.0 } })
        });
        if packed.is_some() {
            return packed;
        }
        texel_m *= 1.25;
    }
    None
}

/// Texels of a chart, without those around it.
fn size(scene: &Scene, chart: &Chart, scale: f64) -> [u32; 2] {
    let Some(picture) = charts::picture(scene, chart.material) else { return [PLAIN; 2] };
    let extent = chart.high - chart.low;
    let side = |extent: f32, texels: u32| (f64::from(extent) * f64::from(texels) * scale).ceil().max(1.0) as u32;
    [side(extent.x, picture.width), side(extent.y, picture.height)]
}

/// What a chart takes of the atlas: it lies on its longer side.
fn padded([width, height]: [u32; 2]) -> [u32; 2] {
    [width.max(height), width.min(height)].map(|side| side.saturating_add(2 * PAD))
}

/// Where texture coordinates of a chart lie in the picture, in texels.
#[derive(Clone, Copy)]
struct Map {
    low: Vec2,
    scale: Vec2,
    corner: Vec2,
    size: Vec2,
    /// Whether it lies with its columns as rows.
    turned: bool,
}

impl Map {
    fn new(chart: &Chart, size: [u32; 2], place: [u32; 2]) -> Self {
        let size = Vec2::new(size[0] as f32, size[1] as f32);
        let extent = chart.high - chart.low;
        let scale = Vec2::select(extent.cmpgt(Vec2::ZERO), size / extent.max(Vec2::splat(1e-30)), Vec2::ZERO);
        let corner = Vec2::new(place[0] as f32, place[1] as f32) + PAD as f32;
        // v grows upwards, rows downwards.
        let turned = size.y > size.x;
        Self { low: Vec2::new(chart.low.x, chart.high.y), scale: scale * Vec2::new(1.0, -1.0), corner, size, turned }
    }

    /// Relative to the chart's left upper corner.
    fn inside(&self, uv: Vec2) -> Vec2 {
        let p = (uv - self.low) * self.scale;
        let p = Vec2::select(self.scale.cmpeq(Vec2::ZERO), self.size / 2.0, p).clamp(Vec2::ZERO, self.size);
        if self.turned { p.yx() } else { p }
    }

    fn middle(&self) -> Vec2 {
        let middle = self.size / 2.0;
        if self.turned { middle.yx() } else { middle }
    }
}

fn places(model: &TriangleModel, (charts, sizes): (&[Chart], &[[u32; 2]]), atlas: &Atlas) -> Attribute {
    let layer = &model.layers[0];
    let bits = (atlas.size[0].max(atlas.size[1]).ilog2() + 1 + SUB_BITS).clamp(8, 16);
    let most = ((1u32 << bits) - 1) as f32;
    let whole = Vec2::new(atlas.size[0] as f32, atlas.size[1] as f32);
    let mut values = vec![[0; 4]; layer.values.len()];
    for ((chart, size), place) in charts.iter().zip(sizes).zip(&atlas.places) {
        let map = Map::new(chart, *size, *place);
        let is_plain = chart.px_per_m <= 0.0;
        for corner in chart.triangles.iter().flat_map(|t| 3 * t..3 * t + 3) {
            let value = layer.corners[corner as usize];
            let [u, v, ..] = layer.values[value as usize];
            let inside = if is_plain { map.middle() } else { map.inside(Vec2::new(u, v)) };
            let at = ((map.corner + inside) / whole * most + 0.5).floor().clamp(Vec2::ZERO, Vec2::splat(most));
            values[value as usize] = [at.x as u32, at.y as u32, 0, 0];
        }
    }
    Attribute {
        kind: AttributeKind::TexCoord,
        components: 2,
        bits: bits as u8,
        range: [0.0, 1.0 / most],
        values,
        corners: layer.corners.clone(),
    }
}

/// Sums of linear light, and how much went into each.
struct Canvas {
    size: [u32; 2],
    sums: Vec<(Vec3, f32)>,
    /// Where triangles show it.
    shown: Vec<bool>,
}

fn paint(scene: &Scene, model: &TriangleModel, (charts, sizes): (&[Chart], &[[u32; 2]]), atlas: &Atlas) -> Canvas {
    let texels = (atlas.size[0] * atlas.size[1]) as usize;
    let mut canvas = Canvas { size: atlas.size, sums: vec![(Vec3::ZERO, 0.0); texels], shown: vec![false; texels] };
    for ((chart, size), place) in charts.iter().zip(sizes).zip(&atlas.places) {
        let base = linear(lattice::colour(scene, chart.material));
        if let Some(picture) = charts::picture(scene, chart.material) {
            let map = Map::new(chart, *size, *place);
            let texels = (chart.high - chart.low) * Vec2::new(picture.width as f32, picture.height as f32);
            let taps = (texels / map.size).max_element().ceil().clamp(1.0, MOST_TAPS as f32) as u32;
            for &t in &chart.triangles {
                let uv = charts::uv(model, t);
                canvas.triangle(uv.map(|uv| map.inside(uv)), map.corner, taps, |weights| {
                    base * read(picture, uv[0] * weights.x + uv[1] * weights.y + uv[2] * weights.z)
                });
            }
        } else {
            let [width, height] = padded(*size);
            for (x, y) in (0..height).flat_map(|y| (0..width).map(move |x| (x, y))) {
                canvas.add(Vec2::new((place[0] + x) as f32, (place[1] + y) as f32), base);
            }
        }
        canvas.rim(*place, padded(*size));
    }
    canvas
}

impl Canvas {
    /// Adds what a triangle shows, with `taps` x `taps` reads a texel; one at its middle if it meets none of them.
    fn triangle(&mut self, p: [Vec2; 3], corner: Vec2, taps: u32, show: impl Fn(Vec3) -> Vec3) {
        let double = (p[1] - p[0]).perp_dot(p[2] - p[0]);
        let low = (p[0].min(p[1]).min(p[2]) * taps as f32 - 0.5).ceil().as_ivec2();
        let high = (p[0].max(p[1]).max(p[2]) * taps as f32 - 0.5).floor().as_ivec2();
        let mut met = false;
        for row in low.y..=high.y {
            for column in low.x..=high.x {
                let at = (Vec2::new(column as f32, row as f32) + 0.5) / taps as f32;
                let side = |i: usize, k: usize| (p[i] - at).perp_dot(p[k] - at) / double;
                let weights = Vec3::new(side(1, 2), side(2, 0), side(0, 1));
                if double != 0.0 && weights.min_element() >= -1e-4 {
                    self.add(corner + at, show(weights));
                    met = true;
                }
            }
        }
        if !met {
            let middle = (p[0] + p[1] + p[2]) / 3.0;
            self.add(corner + middle, show(Vec3::splat(1.0 / 3.0)));
        }
    }

    fn add(&mut self, at: Vec2, light: Vec3) {
        let (x, y) = ((at.x as u32).min(self.size[0] - 1), (at.y as u32).min(self.size[1] - 1));
        let sum = &mut self.sums[(y * self.size[0] + x) as usize];
        *sum = (sum.0 + light, sum.1 + 1.0);
        self.shown[(y * self.size[0] + x) as usize] = true;
    }

    /// What no triangle showed in a rectangle, but beside what one did, takes the mean of that.
    fn rim(&mut self, [x0, y0]: [u32; 2], [w, h]: [u32; 2]) {
        let width = self.size[0];
        let at = |x: u32, y: u32| ((y0 + y) * width + x0 + x) as usize;
        for (x, y) in (0..h).flat_map(|y| (0..w).map(move |x| (x, y))) {
            let here = at(x, y);
            if self.shown[here] {
                continue;
            }
            let (mut sum, mut count) = (Vec3::ZERO, 0.0);
            for [i, k] in [[0i32, -1], [-1, 0], [1, 0], [0, 1], [-1, -1], [1, -1], [-1, 1], [1, 1]] {
                let (i, k) = (x.wrapping_add_signed(i), y.wrapping_add_signed(k));
                if i < w && k < h && self.shown[at(i, k)] {
                    let (light, weight) = self.sums[at(i, k)];
                    sum += light / weight;
                    count += 1.0;
                }
            }
            if count > 0.0 {
                self.sums[here] = (sum / count, 1.0);
            }
        }
    }

    /// Mean light of each texel as sRGB, and whether it is known.
    fn rgb(&self) -> (Vec<u8>, Vec<bool>) {
        let texel = |(light, weight): &(Vec3, f32)| quick_srgb(*light / weight.max(1.0));
        let known = self.sums.iter().map(|sum| sum.1 > 0.0).collect();
        (self.sums.iter().flat_map(texel).collect(), known)
    }

    /// As a file.
    fn pack(&self, quality: Quality) -> Option<Vec<u8>> {
        let (mut rgb, known) = self.rgb();
        wire::fill(&mut rgb, self.size, &known);
        Shown { size: self.size, rgb: &rgb, shown: &self.shown }.pack(quality)
    }
}

/// The same as `srgb` but for a rounding now and then, from a table.
fn quick_srgb(light: Vec3) -> [u8; 3] {
    const FINE: usize = 1 << 14;
    static TABLE: LazyLock<Vec<u8>> =
        LazyLock::new(|| (0..=FINE).map(|i| srgb([i as f32 / FINE as f32; 3])[0]).collect());
    light.to_array().map(|v| TABLE[(v.clamp(0.0, 1.0) * FINE as f32 + 0.5) as usize])
}
