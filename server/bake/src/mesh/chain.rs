//! A leaf's levels of detail.
//!
//! In: a leaf's [`Surface`]. Out: [`Lod`]s, the finest first. Next: `write`.
//!
//! The finest is the surface itself. Each coarser one may be four times as wrong as the one before it, the coarsest nearly as
//! wrong as the leaf's V-BlockMap; one that is hardly smaller than the one before is left out. Errors are measured, not
//! believed.

use std::collections::HashMap;

use insula_protocol::{
    DecodeError, MeshTile, TileId,
    blockmap::Quality,
    mesh::{Attribute, AttributeKind, Mesh},
    mesh_tile::{MAX_LODS, MAX_TRIANGLES, archive_id},
    subtree::MeshLod,
};

use super::{
    Lod,
    distance::{Near, half_diagonals},
    lattice::Surface,
    picture,
};
use crate::{
    columns::voxels::HALF_DIAGONAL,
    error::BakeError,
    model::{CornerLayer, TriangleModel},
    scene::{Scene, grid::CityGrid},
    simplify::{Goal, simplify},
};

/// Share of the V-BlockMap's error that the coarsest level of detail may have.
const COARSEST: f64 = 0.8;
/// Between one level of detail's error and the next one's.
const RATIO: f64 = 4.0;
/// A level of detail has at most this share of the bytes of the one before.
const GAIN: f64 = 0.7;
/// A plain one has at most this share of the triangles of the one before: else it is not even coded.
const FEWER: f64 = 0.8;
/// Half the diagonal of a cube of side 1: what a grid loses of its step.
const HALF_CUBE: f64 = 0.866_025_403_784_438_6;

/// All levels of detail that are worth their bytes.
pub(super) fn chain(
    scene: &Scene,
    grid: &CityGrid,
    id: TileId,
    surface: &Surface,
    quality: Quality,
) -> Result<Vec<Lod>, BakeError> {
    let step_m = surface.points.step;
    let coarse_m = HALF_DIAGONAL * grid.cell_m;
    let maker = Maker { scene, id, surface, quality };
    let Some((finest, model)) = maker.finest(coarse_m)? else { return Ok(Vec::new()) };
    let mut lods = vec![finest];
    let mut before = model.triangles.len();
    let mut half = Vec::new();
    for k in 1..MAX_LODS {
        let target_m = COARSEST * coarse_m / RATIO.powi(i32::from(MAX_LODS - 1 - k));
        let number = lods.len() as u8;
        if target_m < 2.0 * HALF_CUBE * step_m || archive_id(id, number).is_none() {
            continue;
        }
        let few = FEWER * before as f64;
        let (coarser, moved_m) = match surface.coarser(target_m, few as usize, &mut half) {
            Some(found) => found,
            None if surface.is_textured() => (model.clone(), 0.0),
            None => continue,
        };
        let Some(lod) = maker.lod(&coarser, number, (moved_m, target_m))? else { continue };
        let finer = &lods[lods.len() - 1];
        if f64::from(lod.info.error_m) < coarse_m && lod.bytes.len() as f64 <= GAIN * finer.bytes.len() as f64 {
            before = coarser.triangles.len();
            let error_m = lod.info.error_m.max(finer.info.error_m);
            lods.push(Lod { info: MeshLod { error_m, ..lod.info }, ..lod });
        }
    }
    Ok(lods)
}

struct Maker<'a> {
    scene: &'a Scene,
    id: TileId,
    surface: &'a Surface,
    quality: Quality,
}

impl Maker<'_> {
    /// The surface itself, or as many of its triangles as a tile may have. `None` if that would be no better than the leaf's
    /// V-BlockMap, whose error is `coarse_m`.
    fn finest(&self, coarse_m: f64) -> Result<Option<(Lod, TriangleModel)>, BakeError> {
        let surface = self.surface;
        let step_m = surface.points.step;
        let mut most = MAX_TRIANGLES;
        while most > 1000 {
            let is_whole = surface.model.triangles.len() <= most;
            let model = if is_whole {
                surface.model.clone()
            } else {
                surface.simplified(Goal { triangles: most, error: f64::INFINITY })
            };
            let moved_m = if is_whole {
                0.0
            } else {
                let reach = coarse_m / step_m;
                Near::new(&surface.model, reach).farthest(&model, reach, |_| f64::INFINITY) * step_m
            };
            if let Some(lod) = self.lod(&model, 0, (moved_m, 2.0 * step_m))? {
                return Ok((f64::from(lod.info.error_m) < coarse_m).then_some((lod, model)));
            }
            most /= 2;
        }
        Ok(None)
    }

    /// `None` if there is too much of it for a tile.
    fn lod(&self, model: &TriangleModel, number: u8, (moved_m, texel_m): (f64, f64)) -> Result<Option<Lod>, BakeError> {
        let step_m = self.surface.points.step;
        let mut error_m = HALF_CUBE * step_m + moved_m;
        let (attribute, texture) = if self.surface.is_textured() {
            let Some(dress) = picture::dress(self.scene, model, (step_m, texel_m), self.quality) else {
                return Ok(None);
            };
            error_m = error_m.max(dress.texel_m);
            (dress.attribute, Some(dress.texture))
        } else {
            (colours(&model.layers[0]), None)
        };
        let positions = model.positions.iter().map(|p| p.map(|v| v as u32)).collect();
        let triangles = model.triangles.clone();
        let mesh = Mesh { grid: self.surface.points, positions, triangles, attributes: vec![attribute] };
        let texture_px = texture.as_ref().map_or(0, |texture| texture.pixels());
        match (MeshTile { mesh, texture }).encode(self.id, number) {
            Ok(bytes) => {
                // What was there twice is there once.
                let tile = MeshTile::decode(self.id, number, &bytes).map_err(BakeError::tile(self.id, "read back"))?;
                let triangles = tile.mesh.triangles.len() as u32;
                let info = MeshLod { error_m: rounded_up(error_m), bytes: bytes.len() as u32, triangles, texture_px };
                Ok(Some(Lod { info, bytes }))
            }
            Err(DecodeError::Limit { .. }) => Ok(None),
            Err(other) => Err(BakeError::tile(self.id, "encoded as a mesh")(other)),
        }
    }
}

impl Surface {
    /// At most so many triangles, no further away than `target_m`, and how far; `None` if that cannot be.
    fn coarser(&self, target_m: f64, triangles: usize, half: &mut Vec<f64>) -> Option<(TriangleModel, f64)> {
        let target = target_m / self.points.step;
        // What a collapse is thought to cost is a mean: the largest distance is more.
        for share in [1.0, 0.5, 0.25] {
            let coarser = self.simplified(Goal { triangles: 0, error: share * target });
            if coarser.triangles.is_empty() || coarser.triangles.len() > triangles {
                return None;
            }
            if half.is_empty() {
                *half = half_diagonals(&self.model);
            }
            let reach = 1.01 * target;
            let there = Near::new(&self.model, reach).farthest(&coarser, reach, |_| f64::INFINITY);
            if there > target {
                continue;
            }
            let back = Near::new(&coarser, reach).farthest(&self.model, reach, |t| half[t]);
            if back <= target {
                return Some((coarser, there.max(back) * self.points.step));
            }
        }
        None
    }

    /// Fewer triangles, on the grid again; what is on the leaf's border stays.
    fn simplified(&self, goal: Goal) -> TriangleModel {
        let positions = &self.model.positions;
        let simplified = simplify(&self.model, goal, |vertex| self.is_on_border(positions[vertex as usize])).model;
        let last = f64::from((1u32 << self.points.bits) - 1);
        let mut numbers = HashMap::new();
        let mut settled = TriangleModel::default();
        let number = |position: &[f64; 3]| {
            let [x, y, z] = position.map(f64::round);
            let most = f64::from(self.steps);
            let place = [x.clamp(0.0, most), y.clamp(0.0, most), z.clamp(0.0, last)];
            *numbers.entry(place.map(|v| v as u32)).or_insert_with(|| {
                settled.positions.push(place);
                settled.positions.len() as u32 - 1
            })
        };
        let vertices: Vec<u32> = simplified.positions.iter().map(number).collect();
        let layers = simplified.layers.iter();
        settled.layers = layers.map(|layer| CornerLayer { corners: Vec::new(), ..layer.clone() }).collect();
        for (t, triangle) in simplified.triangles.iter().enumerate() {
            let [a, b, c] = triangle.map(|vertex| vertices[vertex as usize]);
            if a != b && b != c && c != a {
                settled.triangles.push([a, b, c]);
                for (to, from) in settled.layers.iter_mut().zip(&simplified.layers) {
                    to.corners.extend_from_slice(&from.corners[3 * t..3 * t + 3]);
                }
            }
        }
        settled
    }
}

/// As three bytes a colour, each once.
fn colours(layer: &CornerLayer) -> Attribute {
    let mut numbers = HashMap::new();
    let mut values = Vec::new();
    let number = |value: &u32| {
        let rgb = [0, 1, 2].map(|k| (layer.values[*value as usize][k] * 255.0 + 0.5).clamp(0.0, 255.0) as u32);
        *numbers.entry(rgb).or_insert_with(|| {
            values.push([rgb[0], rgb[1], rgb[2], 0]);
            values.len() as u32 - 1
        })
    };
    let corners = layer.corners.iter().map(number).collect();
    Attribute { kind: AttributeKind::Colour, components: 3, bits: 8, range: [0.0, 1.0 / 255.0], values, corners }
}

/// To eight bits of precision, so that many leaves' errors take few bytes.
fn rounded_up(error_m: f64) -> f32 {
    let next = if f64::from(error_m as f32) < error_m { (error_m as f32).next_up() } else { error_m as f32 };
    f32::from_bits((next.to_bits() + 0xffff) & 0xffff_0000)
}
