//! Parts of a textured surface that stay together in their picture.
//!
//! In: a surface whose corners carry u, v and material. Out: [`Chart`]s. Next: `atlas`, `picture`.

use std::collections::BTreeMap;

use glam::{DVec3, Vec2};

use super::lattice;
use crate::{
    model::TriangleModel,
    scene::{Scene, SceneTexture},
};

/// Charts of one material beyond this many are not looked at for others that they could be merged with.
const MOST_MERGED: usize = 512;
/// Charts are merged if none of both has more texels on a metre than the other by more than this.
const LIKE: f64 = 1.5;

/// Triangles that share one rectangle of a picture.
#[derive(Debug, Clone)]
pub(super) struct Chart {
    pub(super) material: u32,
    pub(super) triangles: Vec<u32>,
    /// Box of the texture coordinates.
    pub(super) low: Vec2,
    pub(super) high: Vec2,
    /// Texels of the source's picture along a metre, 0 if unknown.
    pub(super) px_per_m: f64,
}

/// The picture of a material.
pub(super) fn picture(scene: &Scene, material: u32) -> Option<&SceneTexture> {
    scene.materials.get(material as usize)?.texture.as_deref()
}

/// The texture coordinates of a triangle.
pub(super) fn uv(model: &TriangleModel, t: u32) -> [Vec2; 3] {
    let layer = &model.layers[0];
    [0, 1, 2].map(|k| {
        let [u, v, ..] = layer.values[layer.corners[3 * t as usize + k] as usize];
        Vec2::new(u, v)
    })
}

/// All charts, by material. What has no picture is one chart a material. `step_m` is the length of the model's unit.
pub(super) fn charts(scene: &Scene, model: &TriangleModel, step_m: f64) -> Vec<Chart> {
    let layer = &model.layers[0];
    let material = |t: usize| layer.values[layer.corners[3 * t] as usize][2] as u32;
    let mut parent: Vec<u32> = (0..layer.values.len() as u32).collect();
    for corners in layer.corners.as_chunks::<3>().0 {
        for other in [corners[1], corners[2]] {
            let (a, b) = (root(&mut parent, corners[0]), root(&mut parent, other));
            parent[a.max(b) as usize] = a.min(b);
        }
    }
    let mut found: BTreeMap<(u32, u32), Vec<u32>> = BTreeMap::new();
    for t in 0..model.triangles.len() {
        let material = material(t);
        let part = if lattice::picture_of(scene, material) { root(&mut parent, layer.corners[3 * t]) } else { 0 };
        found.entry((material, part)).or_default().push(t as u32);
    }
    let mut by_material: BTreeMap<u32, Vec<Chart>> = BTreeMap::new();
    for ((material, _), triangles) in found {
        let chart = chart(scene, model, (material, triangles), step_m);
        by_material.entry(material).or_default().push(chart);
    }
    by_material.into_values().flat_map(merged).collect()
}

fn root(parent: &mut [u32], mut v: u32) -> u32 {
    while parent[v as usize] != v {
        parent[v as usize] = parent[parent[v as usize] as usize];
        v = parent[v as usize];
    }
    v
}

fn chart(scene: &Scene, model: &TriangleModel, (material, triangles): (u32, Vec<u32>), step_m: f64) -> Chart {
    let (mut low, mut high) = (Vec2::INFINITY, Vec2::NEG_INFINITY);
    let (mut texels, mut area_m2) = (0.0, 0.0);
    let picture = picture(scene, material);
    let size = picture.map_or(Vec2::ZERO, |texture| Vec2::new(texture.width as f32, texture.height as f32));
    for &t in &triangles {
        let uv = uv(model, t);
        uv.iter().for_each(|uv| (low, high) = (low.min(*uv), high.max(*uv)));
        texels += f64::from(((uv[1] - uv[0]) * size).perp_dot((uv[2] - uv[0]) * size).abs()) / 2.0;
        let [a, b, c] = model.triangles[t as usize].map(|vertex| DVec3::from(model.positions[vertex as usize]));
        area_m2 += (b - a).cross(c - a).length() / 2.0 * step_m * step_m;
    }
    let px_per_m = if texels > 0.0 && area_m2 > 0.0 { (texels / area_m2).sqrt() } else { 0.0 };
    Chart { material, triangles, low, high, px_per_m }
}

/// Charts of one material that lie over each other become one: a picture that is used again and again is there once.
fn merged(mut charts: Vec<Chart>) -> Vec<Chart> {
    let area = |low: Vec2, high: Vec2| (high - low).element_product();
    charts.sort_by(|a, b| {
        let by_area = area(b.low, b.high).total_cmp(&area(a.low, a.high));
        by_area.then(a.triangles[0].cmp(&b.triangles[0]))
    });
    let mut out: Vec<Chart> = Vec::new();
    for chart in charts {
        let is_like = |other: &&mut Chart| {
            let (low, high) = (other.low.min(chart.low), other.high.max(chart.high));
            let alone = area(other.low, other.high) + area(chart.low, chart.high);
            let (less, more) = (other.px_per_m.min(chart.px_per_m), other.px_per_m.max(chart.px_per_m));
            area(low, high) <= alone && more <= LIKE * less
        };
        if let Some(other) = out.iter_mut().take(MOST_MERGED).find(is_like) {
            (other.low, other.high) = (other.low.min(chart.low), other.high.max(chart.high));
            other.px_per_m = other.px_per_m.max(chart.px_per_m);
            other.triangles.extend(chart.triangles);
        } else {
            out.push(chart);
        }
    }
    out
}
