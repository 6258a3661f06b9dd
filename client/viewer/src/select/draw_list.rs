//! Second step of a selection: the draw list.
//!
//! It has one entry for each node that was visited and not refined, drawn from its own tile, or from its part of the nearest
//! resident ancestor's. No area waits for the areas beside it.

use super::{
    context::SelectionContext,
    meshes,
    occlusion_feedback::Visibility,
    selection::{DrawTile, Selection},
    visited::{Cover, SelectionScratch, Visit},
};

/// Writes the draw list, what it uses, and its statistics to `selection`.
pub(super) fn build(ctx: &SelectionContext<'_>, scratch: &mut SelectionScratch, selection: &mut Selection) {
    // Tiles that are drawn only because they are resident may be evicted at any time: an ancestor is drawn then.
    let is_used = |visit: &&Visit| visit.request.is_some() && ctx.tree.node(visit.node).tile.is_resident();
    selection.used_nodes.extend(scratch.visits.iter().filter(is_used).map(|visit| visit.node));
    scratch.for_each(ctx.tree, |visit, cover| {
        if let (None, Some(cover)) = (&visit.children, cover) {
            add(ctx, visit, cover, selection);
        }
    });
    selection.stats.drawn = selection.draw_tiles.len() as u32;
}

fn add(ctx: &SelectionContext<'_>, visit: &Visit, cover: Cover, selection: &mut Selection) {
    let mesh = meshes::drawn_lod(ctx, visit);
    let error_px = mesh.map_or(cover.error_px, |mesh| mesh.error_px);
    let mesh_lod = mesh.map(|mesh| mesh.lod);
    let sky_source = mesh_lod.and_then(|_| meshes::sky_source(visit.node, ctx.tree));
    let source = sky_source.unwrap_or(cover.source);
    selection.draw_tiles.push(DrawTile { node: visit.node, source, mesh_lod });
    meshes::record_drawn_lod(visit, mesh_lod, ctx.tree, selection);
    selection.mesh_leaves.extend(visit.mesh_lod.map(|_| visit.node));
    let stats = &mut selection.stats;
    if visit.visibility != Visibility::Occluded {
        selection.unoccluded.push(visit.node);
        stats.worst_error_px = stats.worst_error_px.max(error_px);
    }
    if visit.visibility == Visibility::Visible {
        stats.visible_error_px = stats.visible_error_px.max(error_px);
    }
}
