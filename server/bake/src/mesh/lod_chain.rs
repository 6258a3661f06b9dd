//! The levels of detail of a leaf.
//!
//! Level 0 is the surface itself. The error allowed grows by [`ERROR_RATIO`] from level to level; that of the last one
//! is just below the error of the leaf's V-BlockMap, which replaces it further away. Errors are measured between the
//! surfaces, because the costs of edge collapses are only means. A level that is hardly smaller than the one before is
//! left out.

use std::collections::HashMap;

use insula_protocol::{
    DecodeError, MeshTile, TileId,
    blockmap::{Quality, voxel_error_m},
    mesh::{Attribute, AttributeKind, Mesh},
    mesh_tile::{MAX_LODS, MAX_TRIANGLES, archive_id},
    subtree::MeshLod,
};

use super::{
    dense_chain,
    leaf_occlusion::LeafOcclusion,
    leaf_surface::LeafSurface,
    surface_distance::{TriangleHash, part_half_diagonals},
    texture_bake::{TextureScale, bake_texture},
};
use crate::{
    error::BakeError,
    model::{CornerLayer, TriangleModel},
    scene::{Scene, grid::CityGrid},
    simplify::{Goal, Simplified, simplify},
};

/// Error allowed in the coarsest level, as a share of the V-BlockMap's error.
const COARSEST_SHARE: f64 = 0.8;
/// Ratio of the errors allowed in successive levels.
const ERROR_RATIO: f64 = 4.0;
/// A level has at most this share of the bytes of the one before.
const MAX_BYTES_SHARE: f64 = 0.7;
/// A simplified surface has at most this share of the triangles of the level before; otherwise it is not encoded.
const MAX_TRIANGLES_SHARE: f64 = 0.8;
/// A surface that does not fit into a tile is simplified to fewer triangles, down to this number.
const MIN_TRIANGLES: usize = 1000;

/// A finished level of detail.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct EncodedLod {
    pub(crate) info: MeshLod,
    /// A mesh tile.
    pub(crate) bytes: Vec<u8>,
}

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
    let mut simplifier = SurfaceSimplifier { surface, part_half_diagonals: Vec::new() };
    for k in 1..MAX_LODS {
        let target_m = COARSEST_SHARE * blockmap_error_m / ERROR_RATIO.powi(i32::from(MAX_LODS - 1 - k));
        let number = lods.len() as u8;
        if target_m < 2.0 * voxel_error_m(step_m) || archive_id(id, number).is_none() {
            continue;
        }
        let max_triangles = (MAX_TRIANGLES_SHARE * triangles_before as f64) as usize;
        let (coarser, moved_m) = match simplifier.simplify_within(target_m, max_triangles) {
            Some(found) => found,
            // Even with the same triangles, a coarser texture may make the tile much smaller.
            None if surface.is_textured() => (solid.clone(), 0.0),
            None => continue,
        };
        let Some(lod) = encoder.encode(&coarser, LodSpec { number, moved_m, texel_m: target_m })? else { continue };
        let finer = &lods[lods.len() - 1];
        if f64::from(lod.info.error_m) < blockmap_error_m
            && lod.bytes.len() as f64 <= MAX_BYTES_SHARE * finer.bytes.len() as f64
        {
            triangles_before = coarser.model.triangles.len();
            let error_m = lod.info.error_m.max(finer.info.error_m);
            lods.push(EncodedLod { info: MeshLod { error_m, ..lod.info }, ..lod });
        }
    }
    Ok(lods)
}

/// Triangles and the objects that they belong to.
#[derive(Debug, Clone)]
pub(super) struct NamedModel {
    pub(super) model: TriangleModel,
    /// Number in the city of each triangle's object.
    pub(super) objects: Vec<u32>,
}

/// What distinguishes a level of detail besides its triangles.
#[derive(Debug, Clone, Copy)]
pub(super) struct LodSpec {
    pub(super) number: u8,
    /// Largest distance from the leaf's surface.
    pub(super) moved_m: f64,
    /// Side of the texture's texels.
    pub(super) texel_m: f64,
}

/// Encodes the levels of detail of one leaf.
pub(super) struct LodEncoder<'a> {
    scene: &'a Scene,
    pub(super) id: TileId,
    pub(super) surface: &'a LeafSurface,
    /// `None` without landmarks.
    occlusion: Option<LeafOcclusion>,
    quality: Quality,
}

impl LodEncoder<'_> {
    /// Level 0 with its triangles: the surface itself, or simplified until it fits into a tile. `None` if that is not
    /// better than the leaf's V-BlockMap, whose error is `blockmap_error_m`.
    fn encode_finest(&self, blockmap_error_m: f64) -> Result<Option<(EncodedLod, NamedModel)>, BakeError> {
        let surface = self.surface;
        let step_m = surface.points.step;
        let mut max_triangles = MAX_TRIANGLES;
        while max_triangles > MIN_TRIANGLES {
            let (named, moved_m) = if surface.model.triangles.len() <= max_triangles {
                (NamedModel { model: surface.model.clone(), objects: surface.objects.clone() }, 0.0)
            } else {
                let goal = Goal { triangles: max_triangles, error: f64::INFINITY };
                let named = simplify_on_grid(surface, (&surface.model, &surface.objects), goal);
                let reach = blockmap_error_m / step_m;
                let moved =
                    TriangleHash::new(&surface.model, reach).max_distance(&named.model, reach, |_| f64::INFINITY);
                (named, moved * step_m)
            };
            if let Some(lod) = self.encode(&named, LodSpec { number: 0, moved_m, texel_m: 2.0 * step_m })? {
                return Ok((f64::from(lod.info.error_m) < blockmap_error_m).then_some((lod, named)));
            }
            max_triangles /= 2;
        }
        Ok(None)
    }

    /// Encodes a level of detail; `None` if it exceeds the limits of a tile.
    pub(super) fn encode(&self, named: &NamedModel, spec: LodSpec) -> Result<Option<EncodedLod>, BakeError> {
        let NamedModel { model, objects } = named;
        let step_m = self.surface.points.step;
        // Rounding to the grid moves a vertex by up to half the diagonal of a grid cube.
        let mut error_m = voxel_error_m(step_m) + spec.moved_m;
        let (attribute, texture) = if self.surface.is_textured() {
            let scale = TextureScale { step_m, texel_m: spec.texel_m };
            let Some(baked) = bake_texture(self.scene, model, scale, self.quality) else { return Ok(None) };
            error_m = error_m.max(baked.texel_m);
            (baked.coordinates, Some(baked.texture))
        } else {
            (colour_attribute(&model.layers[0]), None)
        };
        let positions = model.positions.iter().map(|p| p.map(|v| v as u32)).collect();
        let triangles = model.triangles.clone();
        let occlusion = self.occlusion.as_ref().map(|occlusion| occlusion.attribute(model));
        let attributes = [attribute].into_iter().chain(occlusion).collect();
        let mesh = Mesh { grid: self.surface.points, positions, triangles, attributes };
        let texture_px = texture.as_ref().map_or(0, |texture| texture.pixels());
        let objects = objects.clone();
        let landmarks = self.surface.landmarks.clone();
        match (MeshTile { mesh, texture, objects, landmarks }).encode(self.id, spec.number) {
            Ok(bytes) => {
                // The codec drops duplicate triangles, so they are counted in the decoded tile.
                let tile =
                    MeshTile::decode(self.id, spec.number, &bytes).map_err(BakeError::tile(self.id, "read back"))?;
                let triangles = tile.mesh.triangles.len() as u32;
                let error_m = rounded_up_to_8_bits(error_m);
                let info = MeshLod { error_m, bytes: bytes.len() as u32, triangles, texture_px };
                Ok(Some(EncodedLod { info, bytes }))
            }
            Err(DecodeError::Limit { .. }) => Ok(None),
            Err(other) => Err(BakeError::tile(self.id, "encoded as a mesh")(other)),
        }
    }
}

/// Simplifies a leaf's surface within measured errors.
struct SurfaceSimplifier<'a> {
    surface: &'a LeafSurface,
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
            if self.part_half_diagonals.is_empty() {
                self.part_half_diagonals = part_half_diagonals(original);
            }
            let reach = 1.01 * target;
            let from_coarser =
                TriangleHash::new(original, reach).max_distance(&coarser.model, reach, |_| f64::INFINITY);
            if from_coarser > target {
                continue;
            }
            let bound = |t: usize| self.part_half_diagonals[t];
            let from_original = TriangleHash::new(&coarser.model, reach).max_distance(original, reach, bound);
            if from_original <= target {
                return Some((coarser, from_coarser.max(from_original) * step_m));
            }
        }
        None
    }
}

/// A level of the surface, with its objects, simplified towards `goal` and rounded to the grid again. Vertices on the leaf's
/// border stay.
pub(super) fn simplify_on_grid(
    surface: &LeafSurface,
    (finer, finer_objects): (&TriangleModel, &[u32]),
    goal: Goal,
) -> NamedModel {
    let positions = &finer.positions;
    let is_locked = |vertex: u32| surface.is_on_border(positions[vertex as usize]);
    let Simplified { model: simplified, sources, .. } = simplify(finer, goal, is_locked);
    let mut objects = Vec::with_capacity(sources.len());
    let max_z = f64::from((1u32 << surface.points.bits) - 1);
    let max_xy = f64::from(surface.steps);
    let mut numbers = HashMap::new();
    let mut rounded = TriangleModel::default();
    let number = |position: &[f64; 3]| {
        let [x, y, z] = position.map(f64::round);
        let point = [x.clamp(0.0, max_xy), y.clamp(0.0, max_xy), z.clamp(0.0, max_z)];
        *numbers.entry(point.map(|v| v as u32)).or_insert_with(|| {
            rounded.positions.push(point);
            rounded.positions.len() as u32 - 1
        })
    };
    let vertices: Vec<u32> = simplified.positions.iter().map(number).collect();
    rounded.layers =
        simplified.layers.iter().map(|layer| CornerLayer { corners: Vec::new(), ..layer.clone() }).collect();
    for (t, triangle) in simplified.triangles.iter().enumerate() {
        let [a, b, c] = triangle.map(|vertex| vertices[vertex as usize]);
        if a != b && b != c && c != a {
            rounded.triangles.push([a, b, c]);
            objects.push(finer_objects[sources[t] as usize]);
            for (to, from) in rounded.layers.iter_mut().zip(&simplified.layers) {
                to.corners.extend_from_slice(&from.corners[3 * t..3 * t + 3]);
            }
        }
    }
    NamedModel { model: rounded, objects }
}

/// Corner colours with three bytes per colour; equal colours are stored once.
fn colour_attribute(layer: &CornerLayer) -> Attribute {
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

/// An error with eight bits of precision, so that the errors of many leaves compress well.
fn rounded_up_to_8_bits(error_m: f64) -> f32 {
    let next = if f64::from(error_m as f32) < error_m { (error_m as f32).next_up() } else { error_m as f32 };
    f32::from_bits((next.to_bits() + 0xffff) & 0xffff_0000)
}
