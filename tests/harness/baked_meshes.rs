//! A baked city's meshes, drawn by the client's rule or all at one level of detail.
//!
//! In: a baked city, a camera. Out: a cut with meshes. Next: what compares pictures.

use crate::{
    baked::Baked,
    cut::Cut,
    view::{Camera, Picture},
};
use anyhow::{Context, Result};
use glam::DVec3;
use insula_protocol::{TileId, TileKind, mesh_tile};
use insula_shaders::mesh::PackedMesh;
use insula_viewer::{
    cache::PackedTile,
    decode::{DecodedTile, decode},
    scene::TileKey,
    select::screen_error::ErrorMetric,
};
use std::{
    collections::{HashMap, hash_map::Entry},
    ops::Range,
};

impl Baked {
    /// Levels of detail of a leaf's mesh; 0 if it has none.
    pub fn lods(&self, id: TileId) -> u8 {
        self.meshes.get(&id).map_or(0, |lods| lods.len() as u8)
    }

    /// Bytes, triangles and error in metres of a level of detail.
    pub fn lod(&self, id: TileId, lod: u8) -> Option<(u32, u32, f32)> {
        self.meshes.get(&id)?.get(usize::from(lod)).map(|lod| (lod.bytes, lod.triangles, lod.error_m))
    }

    /// Which level of detail a leaf is drawn at, by the client's rule; `None`: its V-BlockMap.
    pub fn drawn_lod(&self, id: TileId, camera: &Camera, picture: &Picture, tau_px: f64) -> Option<u8> {
        let (lods, node) = (self.meshes.get(&id)?, self.nodes.get(&id)?);
        let focal_px = f64::from(picture.height_px) / (2.0 * (camera.fov_y_deg.to_radians() / 2.0).tan());
        let half_m = self.manifest().node_side_m(id.level()) / 2.0;
        let middle_m = f64::from(node.z_min_m + node.z_max_m) / 2.0;
        let centre = DVec3::from(self.manifest().node_corner(id)) + DVec3::new(half_m, half_m, middle_m);
        let metric = ErrorMetric { eye: camera.position.into(), focal_px };
        let px = |error_m: f32| metric.error_px(f64::from(error_m), centre, node.radius_m.into());
        let good = lods.iter().rposition(|lod| px(lod.error_m) <= tau_px).unwrap_or(0);
        (px(node.error_m) > tau_px).then_some(good as u8)
    }

    /// Whether a leaf's V-BlockMap is wrong by so many pixels.
    pub fn passes(&self, id: TileId, camera: &Camera, picture: &Picture, px: Range<f64>) -> bool {
        let above = |px: f64| self.drawn_lod(id, camera, picture, px).is_some();
        above(px.start) && !above(px.end)
    }

    /// A leaf's mesh, as the client decodes it.
    pub fn mesh(&self, id: TileId, lod: u8) -> Result<PackedMesh> {
        let place = mesh_tile::archive_id(id, lod).context("no such mesh")?;
        let bytes = self.store.tile(TileKind::Mesh, place)?.with_context(|| format!("no mesh {id} {lod}"))?;
        match decode(TileKey::mesh(id, lod), &bytes).with_context(|| format!("mesh {id} {lod}"))? {
            DecodedTile::Packed(PackedTile::Mesh(mesh)) => Ok(*mesh),
            other => anyhow::bail!("{other:?} is no mesh"),
        }
    }

    /// These nodes; `lod` says which of them are drawn as meshes, whose sky the columns tell that the client lets tell.
    pub fn cut_with_meshes(&self, ids: &[TileId], lod: impl Fn(TileId) -> Option<u8>) -> Result<Cut> {
        let mut cut = self.cut(&[])?;
        let mut told = HashMap::new();
        for id in ids {
            let Some(lod) = lod(*id).filter(|_| self.lods(*id) > 0) else {
                cut.add(&self.map(*id)?);
                continue;
            };
            let by = id.ancestor(id.level().saturating_sub(2)).context("no such level")?;
            let map = match told.entry(by) {
                Entry::Occupied(known) => known.into_mut(),
                Entry::Vacant(new) => new.insert(self.map(by)?),
            };
            cut.add_in(*id, map);
            cut.add_mesh(*id, self.mesh(*id, lod.min(self.lods(*id) - 1))?);
        }
        Ok(cut)
    }
}
