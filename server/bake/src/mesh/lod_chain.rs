//! The levels of detail of a leaf.
//!
//! Level 0 is the surface itself. The error allowed grows by [`ERROR_RATIO`] from level to level; that of the last one
//! is just below the error of the leaf's V-BlockMap, which replaces it further away. Errors are measured between the
//! surfaces, because the costs of edge collapses are only means. A level that is hardly smaller than the one before is
//! left out.

use super::dense_chain;
use super::leaf_occlusion::LeafOcclusion;
use super::leaf_surface::LeafSurface;
use super::lod_encoder::{EncodedLod, LodEncoder, LodSpec, NamedModel, simplify_on_grid};
use super::texture_bake::whole_texels_m;
use crate::error::BakeError;
use crate::scene::Scene;
use crate::scene::grid::CityGrid;
use glam::DVec3;
use insula_protocol::blockmap::{Quality, voxel_error_m};
use insula_protocol::mesh_tile::{MAX_LODS, archive_id};
use insula_protocol::subtree::MeshLod;
use insula_protocol::{MeshTile, TileId};
use insula_simplify::disjoint_sets::DisjointSets;
use insula_simplify::model::TriangleModel;
use insula_simplify::simplify::Goal;
use insula_simplify::surface::Surface;
use std::collections::HashMap;

/// Error allowed in the coarsest level, as a share of the V-BlockMap's error.
const COARSEST_SHARE: f64 = 0.8;
/// Ratio of the errors allowed in successive levels.
const ERROR_RATIO: f64 = 4.0;
/// A level has at most this share of the bytes of the one before.
const MAX_BYTES_SHARE: f64 = 0.7;
/// A simplified surface has at most this share of the triangles of the level before; otherwise it is not encoded.
const MAX_TRIANGLES_SHARE: f64 = 0.8;

/// Encodes all levels of detail that are worth their bytes, the finest first.
pub(super) fn encode_lods(
    scene: &Scene,
    grid: &CityGrid,
    id: TileId,
    surface: &LeafSurface,
    quality: Quality,
) -> Result<Vec<EncodedLod>, BakeError> {
    let step_m = surface.points.step;
    let blockmap_error_m = voxel_error_m(grid.cell_m);
    let occlusion = LeafOcclusion::new(scene, grid, id, surface)?;
    let encoder = LodEncoder { scene, id, surface, occlusion, quality };
    let Some((finest, solid)) = encoder.encode_finest(blockmap_error_m)? else { return Ok(Vec::new()) };
    let mut lods = vec![finest];
    if !surface.landmarks.is_empty() {
        dense_chain::add_levels(&encoder, &mut lods, solid, blockmap_error_m)?;
        return Ok(lods);
    }
    let mut triangles_before = solid.model.triangles.len();
    let whole_m = if surface.is_textured() { whole_texels_m(scene, &solid.model, step_m) } else { 0.0 };
    let mut is_mostly_texture = whole_m > 0.0 && mostly_texture(id, 0, &lods[0])?;
    let mut simplifier = SurfaceSimplifier { surface, source: None, part_half_diagonals: Vec::new() };
    for k in 1..MAX_LODS {
        let target_m = COARSEST_SHARE * blockmap_error_m / ERROR_RATIO.powi(i32::from(MAX_LODS - 1 - k));
        let number = lods.len() as u8;
        if target_m < 2.0 * voxel_error_m(step_m) || archive_id(id, number).is_none() {
            continue;
        }
        // The same texels take about the same bytes.
        if target_m < whole_m && is_mostly_texture {
            continue;
        }
        let max_triangles = (MAX_TRIANGLES_SHARE * triangles_before as f64) as usize;
        let (coarser, moved_m) = match simplifier.simplify_within(target_m, max_triangles) {
            Some(found) => found,
            // Even with the same triangles, a coarser texture may make the tile much smaller.
            None if surface.is_textured() && target_m >= whole_m => (solid.clone(), 0.0),
            None => continue,
        };
        let Some(lod) = encoder.encode(&coarser, LodSpec { number, moved_m, texel_m: target_m })? else { continue };
        let finer = &lods[lods.len() - 1];
        if f64::from(lod.info.error_m) < blockmap_error_m
            && lod.bytes.len() as f64 <= MAX_BYTES_SHARE * finer.bytes.len() as f64
        {
            triangles_before = coarser.model.triangles.len();
            let error_m = lod.info.error_m.max(finer.info.error_m);
            is_mostly_texture = target_m < whole_m && mostly_texture(id, number, &lod)?;
            lods.push(EncodedLod { info: MeshLod { error_m, ..lod.info }, ..lod });
        }
    }
    Ok(lods)
}

/// Whether the texture takes so much of a level's tile that one with fewer triangles would hardly be smaller.
fn mostly_texture(id: TileId, number: u8, lod: &EncodedLod) -> Result<bool, BakeError> {
    let tile = MeshTile::decode(id, number, &lod.bytes).map_err(BakeError::tile(id, "read back"))?;
    let texture_bytes = tile.texture.map_or(0, |texture| texture.bytes.len());
    Ok(texture_bytes as f64 > MAX_BYTES_SHARE * lod.bytes.len() as f64)
}

/// Simplifies a leaf's surface within measured errors.
struct SurfaceSimplifier<'a> {
    surface: &'a LeafSurface,
    /// What the others are compared with; `None` until it is needed.
    source: Option<Surface>,
    /// Of each triangle of the surface; empty until they are needed.
    part_half_diagonals: Vec<f64>,
}

impl SurfaceSimplifier<'_> {
    /// A simplified surface no further than `target_m` from the original, and its distance in metres. `None` if it
    /// would have no triangles, or more than `max_triangles`.
    fn simplify_within(&mut self, target_m: f64, max_triangles: usize) -> Option<(NamedModel, f64)> {
        let original = &self.surface.model;
        let step_m = self.surface.points.step;
        let target = target_m / step_m;
        // The error of a collapse is a mean. The largest distance is more, so smaller goals are tried as well.
        for share in [1.0, 0.5, 0.25] {
            let goal = Goal { triangles: 0, error: share * target };
            let coarser = simplify_on_grid(self.surface, (original, &self.surface.objects), goal);
            if coarser.model.triangles.is_empty() || coarser.model.triangles.len() > max_triangles {
                return None;
            }
            if self.source.is_none() {
                self.source = Surface::of_model(original);
                self.part_half_diagonals = part_half_diagonals(original);
            }
            let (source, spacing) = (self.source.as_ref()?, 1.01 * target);
            let from_coarser = source.distance_of(&coarser.model, spacing, |_| f64::INFINITY);
            if from_coarser > target {
                continue;
            }
            let bound = |t: usize| self.part_half_diagonals[t];
            let from_original = Surface::of_model(&coarser.model)?.distance_of(original, spacing, bound);
            if from_original <= target {
                return Some((coarser, from_coarser.max(from_original) * step_m));
            }
        }
        None
    }
}

/// For each triangle, half the diagonal of the bounding box of its connected part: if the part is removed, no point of
/// it is further than this from where the part was.
fn part_half_diagonals(model: &TriangleModel) -> Vec<f64> {
    let mut parts = DisjointSets::new(model.positions.len());
    for [a, b, c] in &model.triangles {
        parts.union(*a, *b);
        parts.union(*a, *c);
    }
    let mut boxes: HashMap<u32, [DVec3; 2]> = HashMap::new();
    for (v, position) in (0..).zip(&model.positions) {
        let p = DVec3::from(*position);
        let part_box = boxes.entry(parts.find(v)).or_insert([p, p]);
        *part_box = [part_box[0].min(p), part_box[1].max(p)];
    }
    let half_diagonal = |triangle: &[u32; 3]| {
        let [low, high] = boxes.get(&parts.find(triangle[0])).copied().unwrap_or_default();
        (high - low).length() / 2.0
    };
    model.triangles.iter().map(half_diagonal).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn half_diagonals_are_those_of_the_connected_parts() {
        let square = [[0.0, 0.0, 0.0], [10.0, 0.0, 0.0], [10.0, 10.0, 0.0], [0.0, 10.0, 0.0]];
        let triangle = [[50.0, 0.0, 0.0], [53.0, 0.0, 0.0], [53.0, 4.0, 0.0]];
        let positions = square.into_iter().chain(triangle).collect();
        let triangles = vec![[0, 1, 2], [0, 2, 3], [4, 5, 6]];
        let half = part_half_diagonals(&TriangleModel { positions, triangles, layers: Vec::new() });
        assert!((half[0] - 50f64.sqrt()).abs() < 1e-9 && half[0] == half[1] && half[2] == 2.5);
    }
}
