//! Which leaves are drawn as meshes, and at which level of detail.
//!
//! In: a leaf of the cut that is seen and whose V-BlockMap is not good enough. Out: the level of detail to ask for, the one to
//! draw. Next: `select` cuts and wants.
//!
//! The coarsest one within tau serves, else the finest; while it is not here, the nearest one that is, else the V-BlockMap.
//! Where a leaf's V-BlockMap is within tau, that is drawn: both look the same from there.

use super::{Selection, SelectionScratch, Visit, Visitor, error, priority, priority::TileRequest};
use crate::{
    camera::{NEAR_M, View},
    scene::{LeafLod, NodeIndex, SceneTree, TileKey, TileRecord, TileState, TreeNode},
};

/// Projected error of a level of detail, by its leaf's sphere.
fn error_px(node: &TreeNode, lod: &LeafLod, view: &View) -> f64 {
    error::error_px(lod.error_m, node.centre, node.radius_m, view.camera.position, view.focal_px(), NEAR_M)
}

/// Whether a node can be drawn by itself, from its columns or its mesh.
pub(super) fn is_here(node: &TreeNode) -> bool {
    node.tile.is_resident() || node.lods.iter().any(|lod| lod.tile.is_resident())
}

/// Whether a tile is here, or will be in a moment.
pub(super) fn is_under_way(tile: TileRecord) -> bool {
    matches!(tile.state(), TileState::Loading | TileState::Decoded | TileState::Resident)
}

impl Visitor<'_> {
    /// Whether a leaf passes from what it lies in to its mesh: where rays tell which squares are seen, its own columns would be
    /// drawn only until its mesh is here. Those that are here or under way are drawn.
    pub(super) fn skips_columns(&self, node: &TreeNode) -> bool {
        let usable = |lod: &LeafLod| !lod.tile.is_bad();
        self.sight.has_feedback()
            && !is_under_way(node.tile)
            && node.lods.iter().any(usable)
            && self.error_px(node) > self.view.tau_px
    }

    /// Notes which level of detail a visited leaf needs; `false` if the budget has no room for any.
    pub(super) fn ask_mesh(&self, visit: u32, scratch: &mut SelectionScratch, selection: &mut Selection) -> bool {
        let visit = &mut scratch.visits[visit as usize];
        let node = self.tree.node(visit.at);
        let best = best(node, self.view);
        let without = visit.asked && self.skips_columns(node);
        let pages = selection.stats.pages - if without { self.tree.node_pages(visit.at) } else { 0 };
        let room = self.view.budget_pages.saturating_sub(pages);
        let mut there = (best..node.lods.len()).filter(|lod| !node.lods[*lod].tile.is_bad()).peekable();
        if there.peek().is_none() {
            return true;
        }
        let Some(lod) = there.find(|lod| node.lods[*lod].pages <= room) else { return false };
        selection.stats.pages = pages + node.lods[lod].pages;
        visit.mesh = Some(lod as u8);
        visit.asked &= !without;
        true
    }
}

/// The coarsest level of detail within tau, of those that are here if there are any; else the finest.
fn best(node: &TreeNode, view: &View) -> usize {
    let good = |lod: &LeafLod| !lod.tile.is_bad() && error_px(node, lod, view) <= view.tau_px;
    let here = node.lods.iter().rposition(|lod| lod.tile.is_resident() && good(lod));
    here.or_else(|| node.lods.iter().rposition(good)).unwrap_or(0)
}

/// The level of detail that is drawn in the square of `visit`, and how wrong it is.
pub(super) fn drawn(visit: &Visit, view: &View, tree: &SceneTree) -> Option<(u8, f64)> {
    let node = tree.node(visit.at);
    if node.tile.is_resident() && visit.error_px <= view.tau_px {
        return None;
    }
    let here = |lod: &usize| node.lods[*lod].tile.is_resident();
    let asked = usize::from(visit.mesh.unwrap_or(0));
    let lod = (asked..node.lods.len()).find(here).or_else(|| (0..asked).rev().find(here))?;
    Some((lod as u8, error_px(node, &node.lods[lod], view)))
}

/// Whose columns tell how much sky the mesh of a leaf sees: those of the nearest node above it that no way to it passes over,
/// be the leaf's own here or not, so that a picture does not depend on how it was come to. None if that is not here.
pub(super) fn sky_source(leaf: NodeIndex, tree: &SceneTree) -> Option<NodeIndex> {
    let mut above = std::iter::successors(tree.node(leaf).parent, |at| tree.node(*at).parent);
    above.find(|at| !super::is_step(tree.node(*at), tree)).filter(|at| tree.node(*at).tile.is_resident())
}

/// Counts what is drawn, and keeps what was asked for.
pub(super) fn count(visit: &Visit, drawn: Option<u8>, tree: &SceneTree, selection: &mut Selection) {
    let node = tree.node(visit.at);
    if let Some(lod) = drawn.and_then(|lod| node.lods.get(usize::from(lod))) {
        selection.stats.meshes += 1;
        selection.stats.triangles += u64::from(lod.triangles);
    }
    // What is drawn only because it is here may go at any time: the V-BlockMap is drawn then.
    if let Some(lod) = drawn.filter(|_| drawn == visit.mesh) {
        selection.used_meshes.push(TileKey::mesh(node.id, lod));
    }
}

/// The mesh that `visit` asks for, if it is missing. Its V-BlockMap comes first if that is asked for, too.
pub(super) fn wanted(
    visit: &Visit,
    cover: Option<(NodeIndex, f64)>,
    view: &View,
    tree: &SceneTree,
    tau_px: f64,
) -> Option<TileRequest> {
    let node = tree.node(visit.at);
    let lod = visit.mesh?;
    let tile = node.lods.get(usize::from(lod))?.tile;
    if visit.asked && !node.tile.is_resident() || tile.is_resident() || tile.is_bad() {
        return None;
    }
    let drawn_px = match drawn(visit, view, tree) {
        Some((_, error_px)) => Some(error_px),
        None => cover.map(|(_, error_px)| error_px),
    };
    let weight = priority::weight(visit.error_px, node.centre, view);
    Some(TileRequest { key: TileKey::mesh(node.id, lod), group: priority::group(drawn_px, tau_px), weight })
}
