//! First step of a selection: visits the scene tree from the root, largest error first, and refines nodes until every visible
//! one is accurate enough, or until the budget is spent.
//!
//! # Decisions
//!
//! A node whose screen-space error is at most tau is accurate enough and is drawn as it is. If it is not resident but some of
//! its children are, those are drawn until it arrives: the camera has moved away.
//!
//! A node whose error exceeds tau:
//!
//! | visibility | condition | decision | reason |
//! |---|---|---|---|
//! | visible | it is a leaf with a mesh | request the mesh | a leaf has no children; its mesh takes their place |
//! | visible | otherwise | refine | it is visible and too coarse |
//! | unknown | error over 16 tau | refine | if it is visible, it must not be coarser than that |
//! | unknown | its level is skipped | refine | it is not fetched itself, and the next frame's rays distinguish its children |
//! | unknown | something of a child is resident | refine | it is drawn as finely as possible without fetching anything |
//! | unknown | otherwise | draw as it is | the next frame decides whether it is visible |
//! | occluded | the set of the eye's cell lacks it, and something of a child is resident | refine | it is drawn as finely as possible without fetching anything |
//! | occluded | the set of the eye's cell lacks it | draw as it is | nothing in the cell can see it |
//! | occluded | the camera is still, and a ray has hit it since then | refine into known children | coarsening it would make it protrude above its occluder, become visible, and be refined again: an oscillation |
//! | occluded | the camera moves, error over 64 tau | refine | if it comes into view, it must not be coarser than that |
//! | occluded | otherwise | draw as it is | it contributes nothing to the frame |
//! | any | none of its children is in view | refine, so that nothing is drawn | nothing of it is in view. Drawn whenever it is unknown and refined whenever it is occluded, it would alternate |
//!
//! A leaf with a mesh that is not visible is drawn as it is. A node that must be refined is drawn as it is all the same if
//!
//! | condition | also | reason |
//! |---|---|---|
//! | it has no children | | there is nothing finer |
//! | a child in view is unknown | its subtree is requested | the nodes of that area are not known |
//! | a child in view is bad | | its area would stay empty |
//! | its children exceed the budget | visiting ends, and the error threshold rises to its error | the error is as even as the memory allows |
//!
//! The V-BlockMap of a child of a refined node:
//!
//! | visibility of the child | condition | decision |
//! |---|---|---|
//! | visible | the parent's error is over 16 tau | request ([`RequestReason::LargeError`]) |
//! | visible | otherwise | request ([`RequestReason::Visible`]) |
//! | unknown | the camera moves, the parent's error is over 16 tau, and its columns are not skipped | request ([`RequestReason::LargeError`]) |
//! | occluded | the camera moves, the parent's error is over 64 tau, and its columns are not skipped | request ([`RequestReason::LargeError`]) |
//! | occluded | the set of the eye's cell lacks it | draw what is resident |
//! | unknown, occluded | otherwise | draw what is resident |
//!
//! The request of a node that is then refined itself is dropped if its tile would be drawn for a moment only: its level is
//! skipped, or its error is at most two tau and it was requested as visible.

use super::context::{SelectionContext, has_known_children, has_resident_tile};
use super::occlusion_feedback::Visibility;
use super::priority::{self, RequestReason, TileRequest};
use super::visited::{SelectionScratch, Visit, VisitCandidate};
use super::{Selection, meshes};
use crate::scene::{NodeIndex, TileKey, TreeNode};
use glam::DVec3;
use insula_protocol::{Subtree, TileId};

/// A refined node's own tile is not requested while its error is at most this multiple of tau: the step from there to its
/// children is small.
const LAST_STEP_TAU_FACTOR: f64 = 2.0;

/// Visits the tree. Writes the visits to `scratch`, and statistics and requests for subtrees to `selection`.
pub(super) fn visit_tree(ctx: &SelectionContext<'_>, scratch: &mut SelectionScratch, selection: &mut Selection) {
    scratch.clear();
    let Some(root) = ctx.tree.root() else { return };
    if ctx.is_culled(ctx.tree.node(root)) {
        selection.stats.culled += 1;
        return;
    }
    let mut visitor = Visitor { ctx, scratch, selection };
    let (visibility, request) = (Visibility::Visible, Some(RequestReason::LargeError));
    visitor.push(FoundNode { node: root, visibility, request });
    while let Some(candidate) = visitor.scratch.candidates.pop() {
        if visitor.visit(candidate).is_err() {
            visitor.selection.stats.tau_px = candidate.error_px;
            break;
        }
    }
}

/// The budget of pages or nodes has no room for a refinement.
struct BudgetExceeded;

#[derive(Clone, Copy)]
struct FoundNode {
    node: NodeIndex,
    visibility: Visibility,
    request: Option<RequestReason>,
}

/// Up to four children of a node that are in view, in the order of their quadrants.
type ChildrenInView = [Option<(NodeIndex, Visibility)>; 4];

struct Visitor<'a> {
    ctx: &'a SelectionContext<'a>,
    scratch: &'a mut SelectionScratch,
    selection: &'a mut Selection,
}

impl Visitor<'_> {
    /// Applies the first table of the module documentation to a node.
    fn visit(&mut self, candidate: VisitCandidate) -> Result<(), BudgetExceeded> {
        let VisitCandidate { error_px, visit } = candidate;
        let Visit { node: index, visibility, .. } = self.scratch.visits[visit as usize];
        let node = self.ctx.tree.node(index);
        if error_px <= self.ctx.view.tau_px {
            self.add_stand_ins(visit);
        } else if !node.lods.is_empty() {
            if visibility == Visibility::Visible {
                self.request_mesh(visit)?;
            }
        } else if (self.must_refine(index, visibility, error_px) || self.has_no_child_in_view(node))
            && let Some(children) = self.children_in_view(node, visibility, error_px)
        {
            self.refine(visit, &children)?;
        }
        Ok(())
    }

    /// Whether a node that is too coarse must be refined.
    fn must_refine(&self, index: NodeIndex, visibility: Visibility, error_px: f64) -> bool {
        let ctx = self.ctx;
        let node = ctx.tree.node(index);
        match visibility {
            Visibility::Visible => true,
            Visibility::Unknown => {
                ctx.is_large_error(error_px, visibility) || ctx.is_skipped_level(node) || ctx.has_drawable_child(node)
            }
            Visibility::Occluded if ctx.is_hidden(node.id) => ctx.has_drawable_child(node),
            Visibility::Occluded if ctx.is_camera_still => ctx.feedback.was_visible(index) && has_known_children(node),
            Visibility::Occluded => ctx.is_large_error(error_px, visibility),
        }
    }

    /// Whether a node has children, all known, and none of them is in view.
    fn has_no_child_in_view(&self, node: &TreeNode) -> bool {
        let is_out_of_view = |quadrant: usize| {
            let child = node.children[quadrant];
            child.is_some_and(|child| self.ctx.is_culled(self.ctx.tree.node(child)))
        };
        node.child_mask != 0 && (0..4).filter(|q| node.child_mask >> q & 1 == 1).all(is_out_of_view)
    }

    /// Why the tile of a child is requested, if it is.
    fn child_request(&self, child: NodeIndex, visibility: Visibility, parent_error_px: f64) -> Option<RequestReason> {
        let ctx = self.ctx;
        let is_large_error = ctx.is_large_error(parent_error_px, visibility);
        match visibility {
            Visibility::Visible if !is_large_error => Some(RequestReason::Visible),
            Visibility::Visible => Some(RequestReason::LargeError),
            Visibility::Unknown | Visibility::Occluded => {
                let is_requested = !ctx.is_hidden(ctx.tree.node(child).id)
                    && !ctx.is_camera_still
                    && is_large_error
                    && !ctx.skips_columns(ctx.tree.node(child));
                is_requested.then_some(RequestReason::LargeError)
            }
        }
    }

    /// The children of `node` in view; `None` if there are none, or if one in view is unknown or bad. Requests the subtree of
    /// unknown children.
    fn children_in_view(&mut self, node: &TreeNode, visibility: Visibility, error_px: f64) -> Option<ChildrenInView> {
        if node.child_mask == 0 {
            return None;
        }
        let ctx = self.ctx;
        let mut in_view = ChildrenInView::default();
        let mut is_blocked = false;
        for quadrant in (0..4).filter(|q| node.child_mask >> q & 1 == 1) {
            let Some(child) = node.children[quadrant] else {
                is_blocked |= self.is_unknown_child_in_view(node, quadrant, error_px);
                continue;
            };
            let known = ctx.tree.node(child);
            if ctx.is_culled(known) {
                self.selection.stats.culled += 1;
                continue;
            }
            let found = match ctx.is_hidden(known.id) {
                true => Visibility::Occluded,
                false => ctx.feedback.visibility(child, ctx.tree, ctx.view, visibility),
            };
            in_view[quadrant] = Some((child, found));
            if known.tile.is_bad() {
                self.selection.stats.blocked += 1;
                is_blocked = true;
            }
        }
        (!is_blocked).then_some(in_view)
    }

    /// Whether a child that exists, but is not described by a resident subtree, is in view. Requests its subtree if so.
    fn is_unknown_child_in_view(&mut self, node: &TreeNode, quadrant: usize, error_px: f64) -> bool {
        let ctx = self.ctx;
        let Some(id) = node.id.child(quadrant) else { return false };
        let (corner, side_m) = ctx.tree.corner_and_side(id);
        // The child's heights are unknown. They lie within its parent's.
        let half = DVec3::new(side_m * 0.5, side_m * 0.5, node.half.z);
        let centre = DVec3::new(corner[0] + half.x, corner[1] + half.y, node.centre.z);
        if !super::cull::is_box_in_view(&ctx.planes, centre, half) {
            self.selection.stats.culled += 1;
            return false;
        }
        self.request_subtree(Subtree::root_of(node.id), priority::weight_px(error_px, centre, ctx.view));
        true
    }

    /// Requests a subtree. It is as urgent as the node above it is wrong: without it nothing below can be requested.
    fn request_subtree(&mut self, root: TileId, weight_px: f64) {
        let key = TileKey::subtree(root);
        let requests = &mut self.selection.requests;
        if !self.ctx.tree.subtree(root).is_bad() && !requests.iter().any(|request| request.key == key) {
            let group = priority::group_in_view(Some(weight_px), self.ctx.view.tau_px);
            requests.push(TileRequest { key, group, reason: RequestReason::UnknownChildren, weight_px });
        }
    }

    /// Replaces a visited node by its children in view, if they fit into the budget.
    fn refine(&mut self, visit: u32, children: &ChildrenInView) -> Result<(), BudgetExceeded> {
        let ctx = self.ctx;
        let error_px = self.scratch.visits[visit as usize].error_px;
        let found = children.map(|child| {
            let (node, visibility) = child?;
            Some(FoundNode { node, visibility, request: self.child_request(node, visibility, error_px) })
        });
        let found = || found.iter().flatten().copied();
        let nodes = found().count() as u32;
        let pages: u32 = found().filter(|child| child.request.is_some()).map(|c| ctx.tree.node_pages(c.node)).sum();
        let stats = &self.selection.stats;
        if stats.pages + pages > ctx.view.budget_pages || stats.visited + nodes > ctx.view.budget_nodes {
            return Err(BudgetExceeded);
        }
        self.push_children(visit, found());
        self.drop_momentary_request(visit);
        Ok(())
    }

    /// Drops the request of a refined node whose tile would be drawn for a moment only.
    fn drop_momentary_request(&mut self, visit: u32) {
        let ctx = self.ctx;
        let visit = &mut self.scratch.visits[visit as usize];
        let node = ctx.tree.node(visit.node);
        let is_last_step =
            visit.request == Some(RequestReason::Visible) && visit.error_px <= LAST_STEP_TAU_FACTOR * ctx.view.tau_px;
        if visit.request.is_some()
            && (is_last_step || ctx.is_skipped_level(node) || ctx.skips_way(node))
            && !node.tile.is_resident()
        {
            visit.request = None;
            self.selection.stats.pages -= ctx.tree.node_pages(visit.node);
        }
    }

    /// Lets the resident children of a node that is accurate enough, but not resident, be drawn until it arrives.
    fn add_stand_ins(&mut self, visit: u32) {
        let ctx = self.ctx;
        let Visit { node: index, visibility, .. } = self.scratch.visits[visit as usize];
        let node = ctx.tree.node(index);
        if has_resident_tile(node) || !ctx.is_drawable(index) {
            return;
        }
        let in_view = node.children.iter().flatten().filter(|child| !ctx.is_culled(ctx.tree.node(**child)));
        self.push_children(visit, in_view.map(|child| FoundNode { node: *child, visibility, request: None }));
    }

    /// Notes which level of detail of its mesh a visible leaf needs, within the budget.
    fn request_mesh(&mut self, visit: u32) -> Result<(), BudgetExceeded> {
        let ctx = self.ctx;
        let visit = &mut self.scratch.visits[visit as usize];
        let node = ctx.tree.node(visit.node);
        let skips_columns = visit.request.is_some() && ctx.skips_columns(node);
        let other_pages = self.selection.stats.pages - if skips_columns { ctx.tree.node_pages(visit.node) } else { 0 };
        let free_pages = ctx.view.budget_pages.saturating_sub(other_pages);
        let mut usable = meshes::usable_lods(ctx, node).peekable();
        if usable.peek().is_none() {
            return Ok(());
        }
        let lod = usable.find(|lod| node.lods[*lod].pages <= free_pages).ok_or(BudgetExceeded)?;
        self.selection.stats.pages = other_pages + node.lods[lod].pages;
        visit.mesh_lod = Some(lod as u8);
        if skips_columns {
            visit.request = None;
        }
        Ok(())
    }

    fn push_children(&mut self, visit: u32, children: impl Iterator<Item = FoundNode>) {
        let first = self.scratch.visits.len() as u32;
        children.for_each(|child| self.push(child));
        self.scratch.visits[visit as usize].children = Some(first..self.scratch.visits.len() as u32);
    }

    fn push(&mut self, found: FoundNode) {
        let FoundNode { node, visibility, request } = found;
        let Self { ctx, scratch, selection } = self;
        let error_px = ctx.error_px(ctx.tree.node(node));
        scratch.candidates.push(VisitCandidate { error_px, visit: scratch.visits.len() as u32 });
        scratch.visits.push(Visit { node, error_px, visibility, request, children: None, mesh_lod: None });
        selection.stats.visited += 1;
        selection.stats.not_visible += u32::from(visibility != Visibility::Visible);
        selection.stats.pages += if request.is_some() { ctx.tree.node_pages(node) } else { 0 };
    }
}
