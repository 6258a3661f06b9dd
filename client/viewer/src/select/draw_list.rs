//! Second step of a selection: the draw list.
//!
//! It has one entry for each node that was visited and not refined, drawn from its own tile, or from its part of the nearest
//! resident ancestor's. No area waits for the areas beside it.

use super::context::SelectionContext;
use super::meshes;
use super::occlusion_feedback::Visibility;
use super::selection::{DrawTile, Selection};
use super::visited::{Cover, SelectionScratch, Visit};
use crate::scene::TileKey;

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
