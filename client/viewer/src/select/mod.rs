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
//! 3. `requests` lists the missing tiles in the order in which they are fetched.
//!
//! docs/selection.md explains the policy.

mod context;
pub mod cull;
pub(crate) mod horizon_culling;
mod meshes;
pub mod occlusion_feedback;
pub mod priority;
mod requests;
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
use insula_protocol::TileId;
use occlusion_feedback::{OcclusionFeedback, Visibility};
use priority::TileRequest;
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
    requests::request_entry_points(&ctx, &mut selection);
    visit::visit_tree(&ctx, scratch, &mut selection);
    list_drawn(&ctx, scratch, &mut selection);
    requests::request_missing_tiles(&ctx, scratch, &mut selection);
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
