//! Which nodes to draw for a view, and which tiles to fetch for a better picture (design 4 and 8).
//!
//! In: [`View`], [`Tree`]. Out: [`Selection`]. Next: `stream::queue` asks, `render::frame` draws.
//!
//! Pure: knows neither wgpu nor HTTP nor the time. Three steps: **visit** from the root by falling error until everything
//! in view is good enough (or the cache's budget is spent: then tau has risen to the error of what was refused), **cut**
//! what can be drawn of it, **want** what is missing. A parent stays in the cut until all its children in view are
//! resident; so the cut covers what the root covers, and never holds a node and its descendant.

pub mod casters;
pub mod cull;
pub mod error;
pub mod priority;
#[cfg(test)]
mod tests;

use crate::{
    camera::{NEAR_M, Plane, View},
    scene::{Key, NodeIndex, Tree, TreeNode},
};
use glam::DVec3;
use insula_protocol::{Subtree, TileId};
use priority::Wanted;
use std::{cmp::Ordering, collections::BinaryHeap, ops::Range};

/// What a frame draws and lacks.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Selection {
    /// Nodes to draw, all resident.
    pub cut: Vec<NodeIndex>,
    /// Resident nodes that this view needs (the cut and its ancestors), coarsest first: not to be evicted.
    pub used: Vec<NodeIndex>,
    /// Tiles to fetch, in order.
    pub wanted: Vec<Wanted>,
    /// The counts.
    pub counters: Counters,
}

/// Counts of one selection.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Counters {
    /// Nodes looked at.
    pub visited: u32,
    /// Children outside the frustum.
    pub culled: u32,
    /// Nodes in the cut.
    pub drawn: u32,
    /// Refinements given up because a child is bad.
    pub blocked: u32,
    /// Pages of all visited nodes.
    pub pages: u32,
    /// The view's tau, or what it rose to because the budget was spent.
    pub tau_px: f64,
    /// Largest projected error that is drawn.
    pub worst_error_px: f64,
}

/// Memory that is used again from frame to frame.
#[derive(Debug, Clone, Default)]
pub struct Scratch {
    visits: Vec<Visit>,
    heap: BinaryHeap<Candidate>,
    renderable: Vec<bool>,
    stack: Vec<(u32, Option<f64>)>,
}

#[derive(Debug, Clone)]
struct Visit {
    at: NodeIndex,
    error_px: f64,
    /// Children in view, as visits; `None` if not refined.
    children: Option<Range<u32>>,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Candidate {
    error_px: f64,
    visit: u32,
}

impl Eq for Candidate {}

impl Ord for Candidate {
    fn cmp(&self, other: &Self) -> Ordering {
        self.error_px.total_cmp(&other.error_px).then(other.visit.cmp(&self.visit))
    }
}

impl PartialOrd for Candidate {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

/// Selects for one frame.
pub fn select(view: &View, tree: &Tree, scratch: &mut Scratch) -> Selection {
    let mut selection = Selection::default();
    selection.counters.tau_px = view.tau_px;
    Visitor { view, tree, planes: view.planes(), eye: view.camera.position, focal_px: view.focal_px() }
        .visit(scratch, &mut selection);
    cut(tree, scratch, &mut selection);
    want(view, tree, scratch, &mut selection);
    selection
}

/// What became of a node that should be refined.
enum Children {
    /// It has none: as good as it gets.
    None,
    /// A subtree is missing, or a child is bad: it stays.
    Stays,
    /// The ones in view.
    InView([Option<NodeIndex>; 4]),
}

struct Visitor<'a> {
    view: &'a View,
    tree: &'a Tree,
    planes: [Plane; 5],
    eye: DVec3,
    focal_px: f64,
}

impl Visitor<'_> {
    fn error_px(&self, node: &TreeNode) -> f64 {
        error::error_px(node.error_m, node.centre, node.radius_m, self.eye, self.focal_px, NEAR_M)
    }

    fn visit(&self, scratch: &mut Scratch, selection: &mut Selection) {
        scratch.visits.clear();
        scratch.heap.clear();
        let Some(root) = self.tree.root() else {
            self.want_subtree(TileId::ROOT, f64::INFINITY, selection);
            return;
        };
        let node = self.tree.node(root);
        if !cull::in_view(&self.planes, node.centre, node.half) {
            selection.counters.culled += 1;
            return;
        }
        self.push(root, scratch, selection);
        while let Some(Candidate { error_px, visit }) = scratch.heap.pop() {
            if error_px <= self.view.tau_px {
                break;
            }
            let at = scratch.visits[visit as usize].at;
            let Children::InView(children) = self.children(at, error_px, selection) else { continue };
            let (nodes, pages) = self.cost(&children);
            let counters = &selection.counters;
            if counters.pages + pages > self.view.budget_pages || counters.visited + nodes > self.view.budget_nodes {
                selection.counters.tau_px = error_px;
                break;
            }
            let first = scratch.visits.len() as u32;
            for child in children.into_iter().flatten() {
                self.push(child, scratch, selection);
            }
            scratch.visits[visit as usize].children = Some(first..scratch.visits.len() as u32);
        }
    }

    fn push(&self, at: NodeIndex, scratch: &mut Scratch, selection: &mut Selection) {
        let error_px = self.error_px(self.tree.node(at));
        scratch.heap.push(Candidate { error_px, visit: scratch.visits.len() as u32 });
        scratch.visits.push(Visit { at, error_px, children: None });
        selection.counters.visited += 1;
        selection.counters.pages += self.tree.pages_of(at);
    }

    fn cost(&self, children: &[Option<NodeIndex>; 4]) -> (u32, u32) {
        let known = children.iter().flatten();
        known.fold((0, 0), |(nodes, pages), child| (nodes + 1, pages + self.tree.pages_of(*child)))
    }

    fn children(&self, at: NodeIndex, error_px: f64, selection: &mut Selection) -> Children {
        let node = self.tree.node(at);
        if node.child_mask == 0 {
            return Children::None;
        }
        let mut in_view = [None; 4];
        let mut stays = false;
        for quadrant in (0..4).filter(|q| node.child_mask >> q & 1 == 1) {
            let Some(child) = node.children[quadrant] else {
                stays |= self.unknown_child(node, quadrant, error_px, selection);
                continue;
            };
            let known = self.tree.node(child);
            if !cull::in_view(&self.planes, known.centre, known.half) {
                selection.counters.culled += 1;
            } else {
                in_view[quadrant] = Some(child);
                if known.tile.is_bad() {
                    selection.counters.blocked += 1;
                    stays = true;
                }
            }
        }
        if stays { Children::Stays } else { Children::InView(in_view) }
    }

    /// A child that exists but whose subtree is not here; returns whether it is in view.
    fn unknown_child(&self, node: &TreeNode, quadrant: usize, error_px: f64, selection: &mut Selection) -> bool {
        let Some(id) = node.id.child(quadrant) else { return false };
        let (corner, side_m) = self.tree.square(id);
        // Its heights are not known: within its parent's.
        let half = DVec3::new(side_m * 0.5, side_m * 0.5, node.half.z);
        let centre = DVec3::new(corner[0] + half.x, corner[1] + half.y, node.centre.z);
        if !cull::in_view(&self.planes, centre, half) {
            selection.counters.culled += 1;
            return false;
        }
        let root = Subtree::root_of(node.id);
        self.want_subtree(root, priority::weight(error_px, centre, self.view), selection);
        true
    }

    fn want_subtree(&self, id: TileId, weight: f64, selection: &mut Selection) {
        if !self.tree.subtree(id).is_bad() {
            // Nothing below can even be asked for without it: as urgent as its node is wrong.
            let drawn_error_px = weight.is_finite().then_some(weight);
            let group = priority::group(drawn_error_px, self.view.tau_px);
            selection.wanted.push(Wanted { key: Key::subtree(id), group, weight });
        }
    }
}

/// Refined nodes whose children in view can all be drawn are replaced by them, from the root down.
fn cut(tree: &Tree, scratch: &mut Scratch, selection: &mut Selection) {
    let Scratch { visits, renderable, stack, .. } = scratch;
    let all = |renderable: &[bool], children: &Range<u32>| children.clone().all(|c| renderable[c as usize]);
    renderable.clear();
    renderable.resize(visits.len(), false);
    // Children stand behind their parents: from the back, each one's children are done.
    for (i, visit) in visits.iter().enumerate().rev() {
        let resident = tree.node(visit.at).tile.is_resident();
        renderable[i] = resident || visit.children.as_ref().is_some_and(|c| all(renderable, c));
        if resident {
            selection.used.push(visit.at);
        }
    }
    selection.used.reverse();
    stack.clear();
    stack.extend((!visits.is_empty()).then_some((0, None)));
    while let Some((i, _)) = stack.pop() {
        let visit = &visits[i as usize];
        match &visit.children {
            Some(children) if all(renderable, children) => stack.extend(children.clone().map(|c| (c, None))),
            _ if tree.node(visit.at).tile.is_resident() => {
                selection.cut.push(visit.at);
                let worst = &mut selection.counters.worst_error_px;
                *worst = worst.max(visit.error_px);
            }
            _ => {}
        }
    }
    selection.counters.drawn = selection.cut.len() as u32;
}

/// Every visited node that is not resident is wanted; how urgently depends on what is drawn in its place.
fn want(view: &View, tree: &Tree, scratch: &mut Scratch, selection: &mut Selection) {
    let Scratch { visits, renderable, stack, .. } = scratch;
    stack.clear();
    stack.extend((!visits.is_empty()).then_some((0, None)));
    while let Some((i, cover)) = stack.pop() {
        let visit = &visits[i as usize];
        let node = tree.node(visit.at);
        let resident = node.tile.is_resident();
        if !resident && !node.tile.is_bad() {
            let group = priority::group(cover, selection.counters.tau_px);
            let weight = priority::weight(visit.error_px, node.centre, view);
            selection.wanted.push(Wanted { key: Key::block_map(node.id), group, weight });
        }
        let cover = if resident { Some(visit.error_px) } else { cover };
        if let Some(children) = &visit.children {
            // Below a node whose children are drawn, each child is its own cover.
            let replaced = children.clone().all(|c| renderable[c as usize]);
            stack.extend(children.clone().map(|c| (c, if replaced { None } else { cover })));
        }
    }
    // Nothing can be drawn without the root: on a thin link all else would only keep it waiting.
    let root_pending = tree.root().map(|root| tree.node(root)).filter(|root| {
        !root.tile.is_resident()
            && !root.tile.is_bad()
            && selection.wanted.iter().any(|w| w.key == Key::block_map(root.id))
    });
    if let Some(root) = root_pending {
        selection.wanted.retain(|wanted| wanted.key == Key::block_map(root.id));
    }
    priority::sort(&mut selection.wanted);
}
