//! Selection: which tiles a frame draws, and which missing tiles are fetched.
//!
//! In: [`View`], [`SceneTree`], [`OcclusionFeedback`]. Out: [`Selection`]. Next: `streamer` fetches the requested tiles, `frame`
//! draws the draw list.
//!
//! A pure function: it knows no GPU API, no network and no clock. Three steps:
//!
//! 1. `visit` walks the scene tree, largest screen-space error first, until everything visible is accurate enough or the budget
//!    of cache pages is spent. Its decision table is the heart of this module.
//! 2. `list_drawn` lists what can be drawn of the visited nodes. Every area is drawn from its node's tile or from that of the
//!    nearest resident ancestor, so there are no holes, and rays distinguish areas before their tiles are resident.
//! 3. `request_missing_tiles` lists the missing tiles in the order in which they are fetched.
//!
//! docs/selection.md explains the policy.

mod context;
pub mod cull;
pub(crate) mod horizon_culling;
mod meshes;
pub mod occlusion_feedback;
pub mod priority;
pub mod screen_error;
pub mod shadow_casters;
#[cfg(test)]
pub(crate) mod tests;
pub mod transitions;
mod visit;
mod visited;

use crate::camera::View;
use crate::scene::{NodeIndex, SceneTree, TileKey};
pub(crate) use context::OCCLUDED_TAU_FACTOR;
use context::SelectionContext;
use glam::DVec3;
use insula_protocol::blockmap::voxel_error_m;
use insula_protocol::subtree::LEVELS;
use insula_protocol::{Subtree, TileId};
use occlusion_feedback::{OcclusionFeedback, Visibility};
use priority::{PriorityGroup, RequestReason, TileRequest};
use screen_error::MIN_DISTANCE_M;
pub use visited::SelectionScratch;
use visited::{Cover, Visit};

/// Selects for one frame. `feedback` holds which nodes the rays of the last frames hit.
pub fn select(
    view: &View,
    tree: &SceneTree,
    feedback: &OcclusionFeedback,
    scratch: &mut SelectionScratch,
) -> Selection {
    let ctx = SelectionContext::new(view, tree, feedback);
    let mut selection = Selection::default();
    selection.stats.tau_px = view.tau_px;
    request_entry_points(&ctx, &mut selection);
    visit::visit_tree(&ctx, scratch, &mut selection);
    list_drawn(&ctx, scratch, &mut selection);
    request_missing_tiles(&ctx, scratch, &mut selection);
    selection
}

/// One entry of the draw list: a node's area, and the tile that is drawn there.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DrawTile {
    /// Node whose area is covered.
    pub node: NodeIndex,
    /// Node whose V-BlockMap is drawn: `node` itself or an ancestor. Resident.
    pub source: NodeIndex,
    /// Level of detail of `node`'s mesh that is drawn instead of the V-BlockMap. Resident. `source` then gives the sky
    /// visibility of the mesh.
    pub mesh_lod: Option<u8>,
}

/// What a frame draws and what it lacks.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Selection {
    /// The draw list. The areas of its entries do not overlap, and cover everything in view that the root covers.
    pub draw_tiles: Vec<DrawTile>,
    /// Nodes of the draw list that are visible, or whose visibility is unknown; in the order of the draw list.
    pub unoccluded: Vec<NodeIndex>,
    /// Leaves of the draw list that need their mesh, resident or not.
    pub mesh_leaves: Vec<NodeIndex>,
    /// Nodes whose resident V-BlockMaps must not be evicted: those that the view asks for, coarsest first.
    pub used_nodes: Vec<NodeIndex>,
    /// Resident meshes that must not be evicted.
    pub used_meshes: Vec<TileKey>,
    /// Roots of the subtrees around the eye, which must not be evicted even if they are out of view.
    pub used_subtrees: Vec<TileId>,
    /// Tiles to fetch, most important first.
    pub requests: Vec<TileRequest>,
    pub stats: SelectionStats,
}

/// Counts of one selection.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct SelectionStats {
    pub visited: u32,
    /// Children outside the frustum.
    pub culled: u32,
    /// Entries of the draw list.
    pub drawn: u32,
    /// Visited nodes that are occluded, or whose visibility is unknown.
    pub not_visible: u32,
    /// Refinements that a bad child prevented; each bad child counts.
    pub blocked: u32,
    /// Cache pages of all tiles that the view asks for.
    pub pages: u32,
    /// Entries of the draw list that are drawn as meshes.
    pub meshes: u32,
    /// Triangles of those meshes.
    pub triangles: u64,
    /// Error threshold in pixels: the view's tau, or the error of the first node that did not fit into the budget.
    pub tau_px: f64,
    /// Largest screen-space error in the draw list, in pixels, occluded nodes excepted.
    pub worst_error_px: f64,
    /// Largest screen-space error of the visible nodes in the draw list, in pixels. The finest level that exists does not count: it
    /// is good enough however near the eye is.
    pub visible_error_px: f64,
}

/// Writes the draw list, what it uses, and its statistics to `selection`. No area waits for the areas beside it.
fn list_drawn(ctx: &SelectionContext<'_>, scratch: &mut SelectionScratch, selection: &mut Selection) {
    // Tiles that are drawn only because they are resident may be evicted at any time: an ancestor is drawn then.
    let is_used = |visit: &&Visit| visit.request.is_some() && ctx.tree.node(visit.node).tile.is_resident();
    selection.used_nodes.extend(scratch.visits.iter().filter(is_used).map(|visit| visit.node));
    scratch.for_each(ctx.tree, |visit, cover| {
        if let (None, Some(cover)) = (&visit.children, cover) {
            add_drawn(ctx, visit, cover, selection);
        }
    });
    selection.stats.drawn = selection.draw_tiles.len() as u32;
}

fn add_drawn(ctx: &SelectionContext<'_>, visit: &Visit, cover: Cover, selection: &mut Selection) {
    let stats = &mut selection.stats;
    let (mut source, mut error_px, mut mesh_lod) = (cover.source, cover.error_px, None);
    if let Some(mesh) = meshes::drawn_lod(ctx, visit) {
        source = meshes::sky_source(visit.node, ctx.tree).unwrap_or(source);
        (error_px, mesh_lod) = (mesh.error_px, Some(mesh.lod));
        stats.meshes += 1;
        stats.triangles += u64::from(mesh.triangles);
        // Another level is drawn only because it is resident, and may be evicted at any time: the V-BlockMap is drawn then.
        if mesh_lod == visit.mesh_lod {
            selection.used_meshes.push(TileKey::mesh(ctx.tree.node(visit.node).id, mesh.lod));
        }
    }
    selection.draw_tiles.push(DrawTile { node: visit.node, source, mesh_lod });
    selection.mesh_leaves.extend(visit.mesh_lod.map(|_| visit.node));
    if visit.visibility != Visibility::Occluded {
        selection.unoccluded.push(visit.node);
        stats.worst_error_px = stats.worst_error_px.max(error_px);
    }
    let node = ctx.tree.node(visit.node);
    let is_finest = match mesh_lod {
        Some(lod) => lod == 0,
        None => source == visit.node && node.child_mask == 0 && node.lods.is_empty(),
    };
    if visit.visibility == Visibility::Visible && !is_finest {
        stats.visible_error_px = stats.visible_error_px.max(error_px);
    }
}

/// Distance at which the weight of a tile that is requested as visible has fallen to half, in metres.
const HALF_WEIGHT_M: f64 = 64.0;

/// Requests tiles that every selection depends on, whatever it visits.
fn request_entry_points(ctx: &SelectionContext<'_>, selection: &mut Selection) {
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
fn request_missing_tiles(ctx: &SelectionContext<'_>, scratch: &mut SelectionScratch, selection: &mut Selection) {
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
