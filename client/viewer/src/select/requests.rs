//! Third step of a selection: the requests for missing tiles, and their order.

use super::context::SelectionContext;
use super::priority::{self, PriorityGroup, RequestReason, TileRequest};
use super::screen_error::MIN_DISTANCE_M;
use super::visited::{Cover, SelectionScratch, Visit};
use super::{Selection, meshes};
use crate::scene::TileKey;
use glam::DVec3;
use insula_protocol::blockmap::voxel_error_m;
use insula_protocol::subtree::LEVELS;
use insula_protocol::{Subtree, TileId};

/// Distance at which the weight of a tile that is requested as visible has fallen to half, in metres.
const HALF_WEIGHT_M: f64 = 64.0;

/// Requests tiles that every selection depends on, whatever it visits.
pub(super) fn request_entry_points(ctx: &SelectionContext<'_>, selection: &mut Selection) {
    request_subtrees_at_eye(ctx, selection);
    let visibility = ctx.tree.missing_visibility(ctx.view.camera.position);
    selection.requests.extend(visibility.map(TileRequest::entry_point));
    if ctx.tree.root().is_none() {
        request_unknown_root(ctx, selection);
    }
}

/// Requests the subtrees of all levels below the eye. So a jump to an unknown place takes two round trips, one for metadata and
/// one for tiles, however deep the city is.
fn request_subtrees_at_eye(ctx: &SelectionContext<'_>, selection: &mut Selection) {
    let (view, tree, manifest) = (ctx.view, ctx.tree, ctx.tree.manifest());
    let in_root = (view.camera.position - DVec3::from(manifest.origin)) / manifest.root_side_m;
    let is_inside = |v: f64| (0.0..1.0).contains(&v);
    if !is_inside(in_root.x) || !is_inside(in_root.y) {
        return;
    }
    let height_m = (view.camera.position.z - manifest.ground_z_m).max(MIN_DISTANCE_M);
    for level in (0..manifest.depth).step_by(usize::from(LEVELS)).skip(1) {
        let nodes_across = f64::from(1u32 << level);
        let (x, y) = ((in_root.x * nodes_across) as u32, (in_root.y * nodes_across) as u32);
        let Some(id) = TileId::new(level, x, y) else { return };
        let is_too_coarse = voxel_error_m(manifest.cell_m_at(level)) * view.focal_px() / height_m > view.tau_px;
        let is_parent_known = id.parent().map(Subtree::root_of).is_some_and(|root| tree.subtree(root).is_resident());
        let may_exist = match tree.find(id) {
            Some(index) => tree.node(index).child_mask != 0,
            None => !is_parent_known,
        };
        let tile = tree.subtree(id);
        if is_too_coarse && may_exist && tile.is_resident() {
            selection.used_subtrees.push(id);
        } else if is_too_coarse && may_exist && !tile.is_bad() {
            selection.requests.push(TileRequest::entry_point(TileKey::subtree(id)));
        }
    }
}

/// Requests the root's tile together with the subtree that describes it: there always is a root.
fn request_unknown_root(ctx: &SelectionContext<'_>, selection: &mut Selection) {
    let key = TileKey::block_map(TileId::ROOT);
    if ctx.tree.tile(key).is_some_and(|tile| !tile.is_resident() && !tile.is_bad()) {
        selection.requests.push(TileRequest::entry_point(key));
    }
    if !ctx.tree.subtree(TileId::ROOT).is_bad() {
        selection.requests.push(TileRequest::entry_point(TileKey::subtree(TileId::ROOT)));
    }
}

/// Requests the missing tiles of all visited nodes that the view asks for, and sorts all requests.
pub(super) fn request_missing_tiles(
    ctx: &SelectionContext<'_>,
    scratch: &mut SelectionScratch,
    selection: &mut Selection,
) {
    let tau_px = selection.stats.tau_px;
    let requests = &mut selection.requests;
    scratch.for_each(ctx.tree, |visit, cover| {
        requests.extend(block_map_request(ctx, visit, cover, tau_px));
        requests.extend(meshes::mesh_request(ctx, visit, cover, tau_px));
    });
    keep_only_pending_root(ctx, requests);
    priority::sort(requests);
}

fn block_map_request(
    ctx: &SelectionContext<'_>,
    visit: &Visit,
    cover: Option<Cover>,
    tau_px: f64,
) -> Option<TileRequest> {
    let reason = visit.request?;
    let node = ctx.tree.node(visit.node);
    if node.tile.is_resident() || node.tile.is_bad() {
        return None;
    }
    let (group, error_px) = match reason {
        // The nearest first, whatever its error: it may occlude the rest.
        RequestReason::Visible => {
            let distance_m = node.centre.distance(ctx.view.camera.position);
            (PriorityGroup::Normal, ctx.view.tau_px / (1.0 + distance_m / HALF_WEIGHT_M))
        }
        _ => (priority::group_in_view(cover.map(|cover| cover.error_px), tau_px), visit.error_px),
    };
    let weight_px = priority::weight_px(error_px, node.centre, ctx.view);
    Some(TileRequest { key: TileKey::block_map(node.id), group, reason, weight_px })
}

/// While the root's tile is missing, requests nothing but that and the entry points: nothing can be drawn without the root,
/// and on a slow connection everything else would delay it.
fn keep_only_pending_root(ctx: &SelectionContext<'_>, requests: &mut Vec<TileRequest>) {
    let Some(root) = ctx.tree.root().map(|root| ctx.tree.node(root)) else { return };
    let root_key = TileKey::block_map(root.id);
    let is_missing = !root.tile.is_resident() && !root.tile.is_bad();
    if is_missing && requests.iter().any(|request| request.key == root_key) {
        requests.retain(|request| request.key == root_key || request.reason == RequestReason::EntryPoint);
    }
}
