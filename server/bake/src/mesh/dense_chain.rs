//! The levels of detail of a leaf with a landmark.
//!
//! A scan has triangles of a few millimetres everywhere, so that a fixed series of errors would leave most of its size between two
//! levels. Here each level has a quarter of the triangles of the one before, whatever error that has.
//!
//! On a smooth surface, facets and the creases between leaves show long before positions are a pixel off: normals are off by more.
//! So the stated errors are larger than the measured ones, and a level is used only from further away.

use super::lod_encoder::{EncodedLod, LodEncoder, LodSpec, NamedModel, rounded_up_to_8_bits, simplify_on_grid};
use crate::error::BakeError;
use insula_protocol::blockmap::voxel_error_m;
use insula_protocol::mesh_tile::{MAX_LODS, archive_id};
use insula_protocol::subtree::MeshLod;
use insula_simplify::simplify::{Goal, largest_distance};
use insula_simplify::surface::Surface;

/// The stated error of a level, in units of the measured one.
const SHADING_FACTOR: f64 = 4.0;
/// The stated error is at most this share of that of the leaf's V-BlockMap, which replaces the meshes further away.
const MAX_ERROR_SHARE: f64 = 0.9;
/// Triangles of a level for each one of the next.
const RATIO: usize = 4;
/// A level with fewer triangles has no coarser one.
const MIN_TRIANGLES: usize = 1000;
/// A level has at most this share of the bytes of the one before.
const MAX_BYTES_SHARE: f64 = 0.7;

/// Adds levels to the finest one, `solid`. Fails if a level cannot be encoded.
pub(super) fn add_levels(
    encoder: &LodEncoder<'_>,
    lods: &mut Vec<EncodedLod>,
    solid: NamedModel,
    blockmap_error_m: f64,
) -> Result<(), BakeError> {
    let step_m = encoder.surface.points.step;
    let Some(source) = Surface::of_model(&encoder.surface.model) else { return Ok(()) };
    let mut finer = solid;
    while lods.len() < usize::from(MAX_LODS) && finer.model.triangles.len() >= MIN_TRIANGLES {
        let number = lods.len() as u8;
        let goal = Goal { triangles: finer.model.triangles.len() / RATIO, error: f64::INFINITY };
        let coarser = simplify_on_grid(encoder.surface, (&finer.model, &finer.objects), goal);
        if archive_id(encoder.id, number).is_none() || coarser.model.triangles.is_empty() {
            break;
        }
        let moved_m = largest_distance(&source, &coarser.model) * step_m;
        let texel_m = moved_m.max(2.0 * voxel_error_m(step_m));
        let Some(lod) = encoder.encode(&coarser, LodSpec { number, moved_m, texel_m })? else { break };
        let before = &lods[lods.len() - 1];
        if f64::from(lod.info.error_m) >= blockmap_error_m {
            break;
        }
        // Regular meshes code so well that their simplified form may be longer.
        if lod.bytes.len() as f64 <= MAX_BYTES_SHARE * before.bytes.len() as f64 {
            let stated_m = (SHADING_FACTOR * f64::from(lod.info.error_m)).min(MAX_ERROR_SHARE * blockmap_error_m);
            let error_m = rounded_up_to_8_bits(stated_m).max(lod.info.error_m).max(before.info.error_m);
            lods.push(EncodedLod { info: MeshLod { error_m, ..lod.info }, ..lod });
        }
        finer = coarser;
    }
    Ok(())
}
