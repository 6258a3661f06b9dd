//! Which leaves are drawn as meshes, and at which level of detail.
//!
//! A visible leaf whose V-BlockMap exceeds tau asks for the coarsest level of detail within tau, or for the finest if none is.
//! Until that is resident, the nearest resident level is drawn, coarser ones first; else the V-BlockMap. A resident V-BlockMap
//! within tau is drawn instead of a mesh: both look the same from there.

use super::context::{SelectionContext, is_alternate_level};
use super::priority::{self, RequestReason, TileRequest};
use super::visited::{Cover, Visit};
use crate::scene::{NodeIndex, SceneTree, TileKey, TreeNode};

/// The level of detail that is drawn in a leaf's area.
#[derive(Debug, Clone, Copy)]
pub(super) struct DrawnLod {
    pub(super) lod: u8,
    pub(super) error_px: f64,
    pub(super) triangles: u32,
}

/// The levels of detail that a leaf may ask for, best first: the best one, and those coarser than it; bad ones left out.
pub(super) fn usable_lods(ctx: &SelectionContext<'_>, leaf: &TreeNode) -> impl Iterator<Item = usize> {
    (best_lod(ctx, leaf)..leaf.lods.len()).filter(|lod| !leaf.lods[*lod].tile.is_bad())
}

/// The coarsest resident level of detail within tau; else the coarsest within tau; else the finest.
fn best_lod(ctx: &SelectionContext<'_>, leaf: &TreeNode) -> usize {
    let is_good = |lod: &usize| !leaf.lods[*lod].tile.is_bad() && ctx.lod_error_px(leaf, *lod) <= ctx.view.tau_px;
    let coarsest_first = || (0..leaf.lods.len()).rev().filter(is_good);
    let resident = coarsest_first().find(|lod| leaf.lods[*lod].tile.is_resident());
    resident.or_else(|| coarsest_first().next()).unwrap_or(0)
}

/// The level of detail that is drawn in the area of `visit`, if any.
pub(super) fn drawn_lod(ctx: &SelectionContext<'_>, visit: &Visit) -> Option<DrawnLod> {
    let leaf = ctx.tree.node(visit.node);
    if leaf.tile.is_resident() && visit.error_px <= ctx.view.tau_px {
        return None;
    }
    let is_resident = |lod: &usize| leaf.lods[*lod].tile.is_resident();
    let requested = usize::from(visit.mesh_lod.unwrap_or(0));
    let mut coarser = requested..leaf.lods.len();
    let index = coarser.find(is_resident).or_else(|| (0..requested).rev().find(is_resident))?;
    let lod = &leaf.lods[index];
    Some(DrawnLod { lod: index as u8, error_px: ctx.lod_error_px(leaf, index), triangles: lod.triangles })
}

/// The node whose columns give the sky visibility of a leaf's mesh: its nearest ancestor on a level that is never skipped. The
/// leaf's own columns are not used even if they are resident, so that a frame does not depend on what was fetched before.
/// `None` if the ancestor is not resident.
pub(super) fn sky_source(leaf: NodeIndex, tree: &SceneTree) -> Option<NodeIndex> {
    let mut ancestors = std::iter::successors(tree.node(leaf).parent, |index| tree.node(*index).parent);
    let ancestor = ancestors.find(|index| !is_alternate_level(tree.node(*index), tree));
    ancestor.filter(|index| tree.node(*index).tile.is_resident())
}

/// The request for the mesh that `visit` asks for, if it is missing. A requested V-BlockMap comes first.
pub(super) fn mesh_request(
    ctx: &SelectionContext<'_>,
    visit: &Visit,
    cover: Option<Cover>,
    tau_px: f64,
) -> Option<TileRequest> {
    let leaf = ctx.tree.node(visit.node);
    let lod = visit.mesh_lod?;
    let tile = leaf.lods.get(usize::from(lod))?.tile;
    let is_block_map_missing = visit.request.is_some() && !leaf.tile.is_resident();
    if is_block_map_missing || tile.is_resident() || tile.is_bad() {
        return None;
    }
    let drawn_error_px = drawn_lod(ctx, visit).map(|mesh| mesh.error_px).or(cover.map(|cover| cover.error_px));
    let weight_px = priority::weight_px(visit.error_px, leaf.centre, ctx.view);
    let group = priority::group_in_view(drawn_error_px, tau_px);
    Some(TileRequest { key: TileKey::mesh(leaf.id, lod), group, reason: RequestReason::Mesh, weight_px })
}
