//! Meshes of a baked city, drawn by the client's rule or all at one level of detail.

use crate::baked::Baked;
use crate::draw_list::DrawList;
use crate::view::{Camera, FrameSpec};
use anyhow::{Context, Result};
use glam::DVec3;
use insula_protocol::{TileId, TileKind, mesh_tile};
use insula_shaders::mesh::PackedMesh;
use insula_viewer::cache::PackedTile;
use insula_viewer::decode::{DecodedTile, decode};
use insula_viewer::scene::TileKey;
use insula_viewer::select::screen_error::ErrorMetric;
use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::ops::Range;

impl Baked {
    /// Number of a leaf's levels of detail; 0 without a mesh.
    pub fn lods(&self, id: TileId) -> u8 {
        self.meshes.get(&id).map_or(0, |lods| lods.len() as u8)
    }

    /// Bytes, triangles and error in metres of a level of detail.
    pub fn lod(&self, id: TileId, lod: u8) -> Option<(u32, u32, f32)> {
        self.meshes.get(&id)?.get(usize::from(lod)).map(|lod| (lod.bytes, lod.triangles, lod.error_m))
    }

    /// The level of detail that the client draws for a leaf; `None` for its V-BlockMap.
    pub fn drawn_lod(&self, id: TileId, camera: &Camera, spec: &FrameSpec, tau_px: f64) -> Option<u8> {
        let (lods, node) = (self.meshes.get(&id)?, self.nodes.get(&id)?);
        let focal_px = f64::from(spec.height_px) / (2.0 * (camera.fov_y_deg.to_radians() / 2.0).tan());
        let half_m = self.manifest().node_side_m(id.level()) / 2.0;
        let middle_m = f64::from(node.z_min_m + node.z_max_m) / 2.0;
        let centre = DVec3::from(self.manifest().node_corner(id)) + DVec3::new(half_m, half_m, middle_m);
        let metric = ErrorMetric { eye: camera.position.into(), focal_px };
        let px = |error_m: f32| metric.error_px(f64::from(error_m), centre, node.radius_m.into());
        let good = lods.iter().rposition(|lod| px(lod.error_m) <= tau_px).unwrap_or(0);
        (px(node.error_m) > tau_px).then_some(good as u8)
    }

    /// Whether the projected error of a leaf's V-BlockMap lies in `px`.
    pub fn passes(&self, id: TileId, camera: &Camera, spec: &FrameSpec, px: Range<f64>) -> bool {
        let above = |px: f64| self.drawn_lod(id, camera, spec, px).is_some();
        above(px.start) && !above(px.end)
    }

    /// A leaf's mesh, decoded as the client does it.
    pub fn mesh(&self, id: TileId, lod: u8) -> Result<PackedMesh> {
        let place = mesh_tile::archive_id(id, lod).context("the level of detail is too high")?;
        let bytes = self.store.tile(TileKind::Mesh, place)?.with_context(|| format!("no mesh {id} {lod}"))?;
        match decode(TileKey::mesh(id, lod), &bytes).with_context(|| format!("mesh {id} {lod}"))? {
            DecodedTile::Packed(PackedTile::Mesh(mesh, _)) => Ok(*mesh),
            other => anyhow::bail!("{other:?} is no mesh"),
        }
    }

    /// Draws these nodes. A node for which `lod` returns a level of detail is drawn as a mesh, with the sky occlusion of the
    /// columns two levels above it, as in the client.
    pub fn draw_list_with_meshes(&self, ids: &[TileId], lod: impl Fn(TileId) -> Option<u8>) -> Result<DrawList> {
        let mut draw_list = self.draw_list(&[])?;
        let mut maps = HashMap::new();
        for id in ids {
            let Some(lod) = lod(*id).filter(|_| self.lods(*id) > 0) else {
                draw_list.add(&self.map(*id)?);
                continue;
            };
            let by = id.ancestor(id.level().saturating_sub(2)).context("no such level")?;
            let map = match maps.entry(by) {
                Entry::Occupied(known) => known.into_mut(),
                Entry::Vacant(new) => new.insert(self.map(by)?),
            };
            draw_list.add_in(*id, map);
            draw_list.add_mesh(*id, self.mesh(*id, lod.min(self.lods(*id) - 1))?);
        }
        Ok(draw_list)
    }
}
