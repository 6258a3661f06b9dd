//! Charts: parts of a textured surface that get one rectangle of the level's texture each.
//!
//! Triangles that share texture coordinates at a vertex belong to one chart. Charts of one material whose rectangles in
//! the source's texture overlap are merged, so that a texture that repeats over many surfaces is stored once.

use super::{has_pattern, texture_of};
use crate::scene::Scene;
use glam::{DVec3, Vec2};
use insula_simplify::disjoint_sets::DisjointSets;
use insula_simplify::model::TriangleModel;
use std::borrow::Cow;
use std::collections::BTreeMap;

/// A chart is compared with at most this many earlier charts of its material.
const MAX_MERGE_CANDIDATES: usize = 512;
/// Charts are merged only if their resolutions, in texels per metre, differ by no more than this factor.
const MAX_RESOLUTION_RATIO: f64 = 1.5;

/// Triangles that share one rectangle of a texture.
#[derive(Debug, Clone)]
pub(super) struct TextureChart {
    /// Index into the scene's materials.
    pub(super) material: u32,
    pub(super) triangles: Vec<u32>,
    /// Lower corner of the box of the texture coordinates.
    pub(super) low: Vec2,
    /// Upper corner of the box of the texture coordinates.
    pub(super) high: Vec2,
    /// Texels of the source's texture per metre; 0 if the material has no texture or the chart has no area.
    pub(super) texels_per_m: f64,
}

impl TextureChart {
    fn new(scene: &Scene, model: &TriangleModel, material: u32, triangles: Vec<u32>, step_m: f64) -> Self {
        let (mut low, mut high) = (Vec2::INFINITY, Vec2::NEG_INFINITY);
        let (mut texels, mut area_m2) = (0.0, 0.0);
        let texture = texture_of(scene, material);
        let size = texture.map_or(Vec2::ZERO, |texture| Vec2::new(texture.width as f32, texture.height as f32));
        for &t in &triangles {
            let uv = triangle_uv(model, t);
            uv.iter().for_each(|uv| (low, high) = (low.min(*uv), high.max(*uv)));
            texels += f64::from(((uv[1] - uv[0]) * size).perp_dot((uv[2] - uv[0]) * size).abs()) / 2.0;
            let [a, b, c] = model.triangles[t as usize].map(|vertex| DVec3::from(model.positions[vertex as usize]));
            area_m2 += (b - a).cross(c - a).length() / 2.0 * step_m * step_m;
        }
        let texels_per_m = if texels > 0.0 && area_m2 > 0.0 { (texels / area_m2).sqrt() } else { 0.0 };
        Self { material, triangles, low, high, texels_per_m }
    }

    /// Whether one rectangle for both charts takes no more texels than two, and their resolutions are similar.
    fn can_merge(&self, other: &Self) -> bool {
        let area = |low: Vec2, high: Vec2| (high - low).element_product();
        let (low, high) = (self.low.min(other.low), self.high.max(other.high));
        let separate = area(self.low, self.high) + area(other.low, other.high);
        let (less, more) = (self.texels_per_m.min(other.texels_per_m), self.texels_per_m.max(other.texels_per_m));
        area(low, high) <= separate && more <= MAX_RESOLUTION_RATIO * less
    }

    fn merge(&mut self, other: Self) {
        (self.low, self.high) = (self.low.min(other.low), self.high.max(other.high));
        self.texels_per_m = self.texels_per_m.max(other.texels_per_m);
        self.triangles.extend(other.triangles);
    }
}

/// The texture coordinates of a triangle's corners.
pub(super) fn triangle_uv(model: &TriangleModel, t: u32) -> [Vec2; 3] {
    let layer = &model.layers[0];
    [0, 1, 2].map(|k| {
        let [u, v, ..] = layer.values[layer.corners[3 * t as usize + k] as usize];
        Vec2::new(u, v)
    })
}

/// Sets of texture coordinates that triangles connect.
fn connected_values(model: &TriangleModel) -> DisjointSets {
    let layer = &model.layers[0];
    let mut sets = DisjointSets::new(layer.values.len());
    for corners in layer.corners.as_chunks::<3>().0 {
        sets.union(corners[0], corners[1]);
        sets.union(corners[0], corners[2]);
    }
    sets
}

/// Moves texture coordinates in patterns by whole repeats, so that charts begin in the first one and more of them
/// overlap.
pub(super) fn fold_patterns<'m>(scene: &Scene, model: &'m TriangleModel) -> Cow<'m, TriangleModel> {
    let layer = &model.layers[0];
    let is_folded: Vec<bool> = layer.values.iter().map(|value| has_pattern(scene, value[2] as u32)).collect();
    if !is_folded.contains(&true) {
        return Cow::Borrowed(model);
    }
    let mut sets = connected_values(model);
    let set_of: Vec<usize> = (0..layer.values.len() as u32).map(|value| sets.find(value) as usize).collect();
    let mut low = vec![Vec2::INFINITY; layer.values.len()];
    for (value, set) in layer.values.iter().zip(&set_of) {
        low[*set] = low[*set].min(Vec2::new(value[0], value[1]));
    }
    let mut folded = model.clone();
    for (i, value) in folded.layers[0].values.iter_mut().enumerate().filter(|(i, _)| is_folded[*i]) {
        let repeats = low[set_of[i]].floor();
        (value[0], value[1]) = (value[0] - repeats.x, value[1] - repeats.y);
    }
    Cow::Owned(folded)
}

/// The charts of a surface, sorted by material. A material without a texture has one chart. `step_m` is the length of
/// the model's unit.
pub(super) fn find_charts(scene: &Scene, model: &TriangleModel, step_m: f64) -> Vec<TextureChart> {
    let layer = &model.layers[0];
    let material_of = |t: usize| layer.values[layer.corners[3 * t] as usize][2] as u32;
    let mut sets = connected_values(model);
    let mut triangles_of: BTreeMap<(u32, u32), Vec<u32>> = BTreeMap::new();
    for t in 0..model.triangles.len() {
        let material = material_of(t);
        let is_textured = texture_of(scene, material).is_some();
        let set = if is_textured { sets.find(layer.corners[3 * t]) } else { 0 };
        triangles_of.entry((material, set)).or_default().push(t as u32);
    }
    let mut by_material: BTreeMap<u32, Vec<TextureChart>> = BTreeMap::new();
    for ((material, _), triangles) in triangles_of {
        let chart = TextureChart::new(scene, model, material, triangles, step_m);
        by_material.entry(material).or_default().push(chart);
    }
    by_material.into_values().flat_map(merge_overlapping).collect()
}

/// Merges charts of one material, the largest first.
fn merge_overlapping(mut charts: Vec<TextureChart>) -> Vec<TextureChart> {
    let area = |chart: &TextureChart| (chart.high - chart.low).element_product();
    charts.sort_by(|a, b| area(b).total_cmp(&area(a)).then(a.triangles[0].cmp(&b.triangles[0])));
    let mut merged: Vec<TextureChart> = Vec::new();
    for chart in charts {
        if let Some(other) = merged.iter_mut().take(MAX_MERGE_CANDIDATES).find(|other| other.can_merge(&chart)) {
            other.merge(chart);
        } else {
            merged.push(chart);
        }
    }
    merged
}
