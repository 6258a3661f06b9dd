//! Which leaves are drawn as meshes, and at which level of detail.
//!
//! In: a leaf of the cut that is seen and whose V-BlockMap is not good enough. Out: the level of detail to ask for, the one to
//! draw. Next: `select` cuts and wants.
//!
//! The coarsest one within tau serves, else the finest; while it is not here, the nearest one that is, else the V-BlockMap.
//! Where a leaf's V-BlockMap is within tau, that is drawn: both look the same from there.

use super::{Scratch, Selection, Visit, Visitor, error, priority, priority::Wanted};
use crate::{
    camera::{NEAR_M, View},
    scene::{Key, Lod, NodeIndex, Tree, TreeNode},
};

/// Projected error of a level of detail, by its leaf's sphere.
fn error_px(node: &TreeNode, lod: &Lod, view: &View) -> f64 {
    error::error_px(lod.error_m, node.centre, node.radius_m, view.camera.position, view.focal_px(), NEAR_M)
}

impl Visitor<'_> {
    /// Notes which level of detail a visited leaf needs; `false` if the budget has no room for any.
    pub(super) fn ask_mesh(&self, visit: u32, scratch: &mut Scratch, selection: &mut Selection) -> bool {
        let node = self.tree.node(scratch.visits[visit as usize].at);
        let best = best(node, self.view);
        let room = self.view.budget_pages.saturating_sub(selection.counters.pages);
        let mut there = (best..node.lods.len()).filter(|lod| !node.lods[*lod].tile.is_bad()).peekable();
        if there.peek().is_none() {
            return true;
        }
        let Some(lod) = there.find(|lod| node.lods[*lod].pages <= room) else { return false };
        selection.counters.pages += node.lods[lod].pages;
        scratch.visits[visit as usize].mesh = Some(lod as u8);
        true
    }
}

/// The coarsest level of detail within tau, of those that are here if there are any; else the finest.
fn best(node: &TreeNode, view: &View) -> usize {
    let good = |lod: &Lod| !lod.tile.is_bad() && error_px(node, lod, view) <= view.tau_px;
    let here = node.lods.iter().rposition(|lod| lod.tile.is_resident() && good(lod));
    here.or_else(|| node.lods.iter().rposition(good)).unwrap_or(0)
}

/// The level of detail that is drawn in the square of `visit`, whose tile is that of `from`, and how wrong it is.
pub(super) fn drawn(visit: &Visit, from: NodeIndex, view: &View, tree: &Tree) -> Option<(u8, f64)> {
    let node = tree.node(visit.at);
    if from != visit.at || visit.error_px <= view.tau_px {
        return None;
    }
    let here = |lod: &usize| node.lods[*lod].tile.is_resident();
    let asked = usize::from(visit.mesh.unwrap_or(0));
    let lod = (asked..node.lods.len()).find(here).or_else(|| (0..asked).rev().find(here))?;
    Some((lod as u8, error_px(node, &node.lods[lod], view)))
}

/// Counts what is drawn, and keeps what was asked for.
pub(super) fn count(visit: &Visit, drawn: Option<u8>, tree: &Tree, selection: &mut Selection) {
    let node = tree.node(visit.at);
    if let Some(lod) = drawn.and_then(|lod| node.lods.get(usize::from(lod))) {
        selection.counters.meshes += 1;
        selection.counters.triangles += u64::from(lod.triangles);
    }
    // What is drawn only because it is here may go at any time: the V-BlockMap is drawn then.
    if let Some(lod) = drawn.filter(|_| drawn == visit.mesh) {
        selection.used_meshes.push(Key::mesh(node.id, lod));
    }
}

/// The mesh that `visit` asks for, if it is missing. Its V-BlockMap comes first: it tells whether the leaf is seen at all.
pub(super) fn wanted(
    visit: &Visit,
    cover: Option<(NodeIndex, f64)>,
    view: &View,
    tree: &Tree,
    tau_px: f64,
) -> Option<Wanted> {
    let node = tree.node(visit.at);
    let lod = visit.mesh?;
    let tile = node.lods.get(usize::from(lod))?.tile;
    if !node.tile.is_resident() || tile.is_resident() || tile.is_bad() {
        return None;
    }
    let drawn_px = match drawn(visit, visit.at, view, tree) {
        Some((_, error_px)) => Some(error_px),
        None => cover.map(|(_, error_px)| error_px),
    };
    let weight = priority::weight(visit.error_px, node.centre, view);
    Some(Wanted { key: Key::mesh(node.id, lod), group: priority::group(drawn_px, tau_px), weight })
}
