//! What can be seen from where the eye is.

use super::key::TileKey;
use super::tree::SceneTree;
use glam::DVec3;
use insula_protocol::visibility_tile::{VisibleSet, block_of_leaf};
use insula_protocol::{Manifest, TileId, VisibilityTile};

/// Eyes this far above the ground plane are in no cell, in metres, unless they are near the ground of a hill.
const MAX_HEIGHT_M: f64 = 60.0;

/// The leaf square that a point is above. `None` outside of the root's area.
fn leaf_at(manifest: &Manifest, point: DVec3) -> Option<TileId> {
    let leaves = f64::from(1u32 << manifest.depth);
    let at = (point - DVec3::from(manifest.origin)) / manifest.root_side_m * leaves;
    let is_inside = |v: f64| (0.0..leaves).contains(&v);
    (is_inside(at.x) && is_inside(at.y)).then(|| TileId::new(manifest.depth, at.x as u32, at.y as u32))?
}

impl SceneTree {
    pub(crate) fn put_visibility(&mut self, tile: VisibilityTile) {
        self.visibility.put(tile);
    }

    /// The missing tile whose cells an eye may be in.
    pub(crate) fn missing_visibility(&self, eye: DVec3) -> Option<TileKey> {
        let manifest = self.manifest();
        if !manifest.street_sets || eye.z > manifest.ground_z_m + MAX_HEIGHT_M {
            return None;
        }
        let id = block_of_leaf(leaf_at(manifest, eye)?);
        let tile = self.visibility.state(id);
        (!tile.is_resident() && !tile.is_bad()).then_some(TileKey::visibility(id))
    }

    /// What an eye may see. `None` if it is in no cell, or if its tile is not resident.
    pub(crate) fn visible_set(&self, eye: DVec3) -> Option<VisibleSet<'_>> {
        let manifest = self.manifest();
        let leaf = leaf_at(manifest, eye)?;
        let tile = self.visibility.get(block_of_leaf(leaf)).filter(|tile| tile.depth == manifest.depth)?;
        tile.set_at(leaf.x(), leaf.y(), eye.z - manifest.origin[2])
    }
}
