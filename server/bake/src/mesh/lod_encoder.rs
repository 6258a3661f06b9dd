//! Encodes a level of detail of a leaf, and simplifies one to the next.

use super::leaf_occlusion::LeafOcclusion;
use super::leaf_surface::LeafSurface;
use super::texture_bake::{TextureScale, bake_texture};
use crate::error::BakeError;
use crate::scene::Scene;
use insula_protocol::blockmap::{Quality, voxel_error_m};
use insula_protocol::mesh::{Attribute, AttributeKind, Mesh};
use insula_protocol::mesh_tile::MAX_TRIANGLES;
use insula_protocol::subtree::MeshLod;
use insula_protocol::{DecodeError, MeshTile, TileId};
use insula_simplify::model::{CornerLayer, TriangleModel};
use insula_simplify::simplify::{Goal, Simplified, simplify};
use insula_simplify::surface::Surface;
use std::collections::HashMap;

/// A surface that does not fit into a tile is simplified to fewer triangles, down to this number.
const MIN_TRIANGLES: usize = 1000;

/// A finished level of detail.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct EncodedLod {
    pub(crate) info: MeshLod,
    /// A mesh tile.
    pub(crate) bytes: Vec<u8>,
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
    pub(super) scene: &'a Scene,
    pub(super) id: TileId,
    pub(super) surface: &'a LeafSurface,
    /// `None` without landmarks.
    pub(super) occlusion: Option<LeafOcclusion>,
    pub(super) quality: Quality,
}

impl LodEncoder<'_> {
    /// Level 0 with its triangles: the surface itself, or simplified until it fits into a tile. `None` if that is not
    /// better than the leaf's V-BlockMap, whose error is `blockmap_error_m`.
    pub(super) fn encode_finest(&self, blockmap_error_m: f64) -> Result<Option<(EncodedLod, NamedModel)>, BakeError> {
        let surface = self.surface;
        let step_m = surface.points.step;
        let mut max_triangles = MAX_TRIANGLES;
        while max_triangles > MIN_TRIANGLES {
            let (named, moved_m) = if surface.model.triangles.len() <= max_triangles {
                (NamedModel { model: surface.model.clone(), objects: surface.objects.clone() }, 0.0)
            } else {
                let goal = Goal { triangles: max_triangles, error: f64::INFINITY };
                let named = simplify_on_grid(surface, (&surface.model, &surface.objects), goal);
                let Some(source) = Surface::of_model(&surface.model) else { return Ok(None) };
                let moved = source.distance_of(&named.model, blockmap_error_m / step_m, |_| f64::INFINITY);
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
        // A coarse level may have lost all triangles of a small landmark.
        let landmarks = self.surface.landmarks.iter().filter(|l| objects.contains(&l.object)).copied().collect();
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
pub(super) fn rounded_up_to_8_bits(error_m: f64) -> f32 {
    let next = if f64::from(error_m as f32) < error_m { (error_m as f32).next_up() } else { error_m as f32 };
    f32::from_bits((next.to_bits() + 0xffff) & 0xffff_0000)
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_protocol::mesh::PositionGrid;
    use insula_protocol::mesh_tile::LandmarkObject;

    #[test]
    fn a_level_without_the_triangles_of_a_landmark_has_no_entry_for_it() {
        let model = TriangleModel {
            positions: vec![[0.0, 0.0, 0.0], [100.0, 0.0, 0.0], [0.0, 100.0, 0.0]],
            triangles: vec![[0, 1, 2]],
            layers: vec![CornerLayer {
                kind: AttributeKind::Colour,
                width: 3,
                values: vec![[0.5, 0.5, 0.5, 0.0]],
                corners: vec![0; 3],
            }],
        };
        let named = NamedModel { model: model.clone(), objects: vec![3] };
        let landmark = |object: u32| LandmarkObject { object, stone: None, anchor_m: [0.0; 3] };
        let surface = LeafSurface {
            points: PositionGrid { min: [0.0; 3], step: 0.01, bits: 16 },
            steps: 4096,
            model,
            objects: vec![3],
            landmarks: vec![landmark(3), landmark(7)],
        };
        let (scene, id) = (Scene::default(), TileId::ROOT);
        let encoder = LodEncoder { scene: &scene, id, surface: &surface, occlusion: None, quality: Quality::Lossless };
        let spec = LodSpec { number: 0, moved_m: 0.0, texel_m: 0.02 };
        let lod = encoder.encode(&named, spec).unwrap().unwrap();
        assert_eq!(MeshTile::decode(id, 0, &lod.bytes).unwrap().landmarks, [landmark(3)]);
    }
}
