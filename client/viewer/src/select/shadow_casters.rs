//! Which nodes may cast a shadow into view: a selection of its own beside that of the view.
//!
//! The shadow volume of a node is its box, swept along the light until it is below all ground, or for `MAX_SHADOW_M`. A node
//! is selected if its shadow volume meets the frustum and, where occlusion is known, a node that is not occluded. Nodes that are
//! also in view are drawn as finely as the view asks for; the shadow casters fill in the rest, more coarsely.

use super::context::has_known_children;
use super::priority::{self, PriorityGroup, RequestReason, TileRequest};
use super::screen_error::ErrorMetric;
use super::{Selection, cull};
use crate::camera::{FrustumPlane, View};
use crate::scene::{NodeIndex, SceneTree, TileKey, TreeNode};
use glam::DVec3;
use insula_protocol::Subtree;
use std::collections::HashSet;

/// The edge of a shadow may be wrong by this multiple of tau.
const SHADOW_TAU_FACTOR: f64 = 3.0;
/// Longest shadow, in metres. A low sun's shadows would cross the whole city; haze hides them.
pub(crate) const MAX_SHADOW_M: f64 = 3000.0;
/// Number of times that the error threshold is doubled, at most, until the shadow casters fit into the budget.
const MAX_DOUBLINGS: u32 = 8;

/// What the rays towards the sun need, besides the draw list.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ShadowCasters {
    /// Resident nodes, ancestors before their descendants, without those whose children replace them. Must not be evicted.
    pub nodes: Vec<NodeIndex>,
    /// Tiles to fetch, most important first.
    pub requests: Vec<TileRequest>,
    /// Nodes that the selection visited.
    pub(crate) visited: Vec<NodeIndex>,
    pages: u32,
}

/// The shadow casters of a frame; none while the sun is below the horizon.
///
/// `sun` is a unit vector towards the sun. Shadows fall on the nodes of `selection` that are not occluded, or on everything in
/// view without one; leaves that it draws as meshes cast their own shadows. The budget is that of `view`: the error threshold
/// doubles until the shadow casters fit.
pub fn shadow_casters(view: &View, sun: DVec3, tree: &SceneTree, selection: Option<&Selection>) -> ShadowCasters {
    let Some(root) = tree.root().filter(|_| sun.z > 0.0) else { return ShadowCasters::default() };
    let node = tree.node(root);
    let mut walker = ShadowWalker {
        view,
        tree,
        planes: view.planes(),
        metric: ErrorMetric::new(view),
        sun,
        receivers: selection.map(|selection| &selection.unoccluded[..]),
        mesh_leaves: selection.into_iter().flat_map(|selection| selection.mesh_leaves.iter().copied()).collect(),
        lowest_m: node.centre.z - node.half.z,
        tau_px: view.tau_px * SHADOW_TAU_FACTOR,
    };
    for _ in 0..MAX_DOUBLINGS {
        if let Some(mut casters) = walker.walk(root) {
            priority::sort(&mut casters.requests);
            return casters;
        }
        walker.tau_px *= 2.0;
    }
    ShadowCasters::default()
}

struct ShadowWalker<'a> {
    view: &'a View,
    tree: &'a SceneTree,
    planes: [FrustumPlane; 5],
    metric: ErrorMetric,
    sun: DVec3,
    /// Nodes that shadows may fall on; `None` if everything in view counts.
    receivers: Option<&'a [NodeIndex]>,
    /// Leaves that cast shadows as meshes already.
    mesh_leaves: HashSet<NodeIndex>,
    /// Height at which all shadows end.
    lowest_m: f64,
    tau_px: f64,
}

impl ShadowWalker<'_> {
    /// Selects from `root` down; `None` if the result exceeds the budget.
    fn walk(&self, root: NodeIndex) -> Option<ShadowCasters> {
        let mut casters = ShadowCasters::default();
        let mut open = vec![root];
        while let Some(index) = open.pop() {
            if !self.may_cast(index) {
                continue;
            }
            let node = self.tree.node(index);
            casters.pages += self.tree.node_pages(index);
            casters.visited.push(index);
            if casters.pages > self.view.budget_pages || casters.visited.len() > self.view.budget_nodes as usize {
                return None;
            }
            let error_px = self.error_px(node, self.shadow_sweep(node));
            let is_refined = error_px > self.tau_px;
            if !node.tile.is_resident() {
                if !node.tile.is_bad() {
                    casters.requests.push(request(TileKey::block_map(node.id), error_px));
                }
            } else if !(is_refined && self.is_replaced(node)) {
                casters.nodes.push(index);
            }
            if is_refined {
                self.refine(node, error_px, &mut open, &mut casters);
            }
        }
        Some(casters)
    }

    /// Whether the shadow volume of a node meets the view, and the node casts no shadow as a mesh already.
    fn may_cast(&self, index: NodeIndex) -> bool {
        let node = self.tree.node(index);
        let sweep = self.shadow_sweep(node);
        !self.mesh_leaves.contains(&index)
            && cull::is_swept_box_in_view(&self.planes, node.centre, node.half, sweep)
            && self.may_shade_receiver(node, sweep)
    }

    /// Whether the children of a node cast all of its shadows. Its own columns would also be seen where it has no child: coarse ground
    /// reaches further than fine ground does, and deep below the plane.
    fn is_replaced(&self, node: &TreeNode) -> bool {
        let is_settled = |child: &NodeIndex| self.tree.node(*child).tile.is_resident() || !self.may_cast(*child);
        has_known_children(node) && node.children.iter().flatten().all(is_settled)
    }

    /// Adds the known children of a node, and requests its subtree if there are others.
    fn refine(&self, node: &TreeNode, error_px: f64, open: &mut Vec<NodeIndex>, casters: &mut ShadowCasters) {
        let existing = (0..4).filter(|q| node.child_mask >> q & 1 == 1);
        let known: Vec<NodeIndex> = existing.clone().filter_map(|q| node.children[q]).collect();
        let subtree = Subtree::root_of(node.id);
        if known.len() < existing.count() && !self.tree.subtree(subtree).is_bad() {
            casters.requests.push(request(TileKey::subtree(subtree), error_px));
        }
        open.extend(known);
    }

    /// Whether the shadow of a node may fall on a receiver.
    fn may_shade_receiver(&self, node: &TreeNode, sweep: DVec3) -> bool {
        let Some(receivers) = self.receivers else { return true };
        let (low, high) = (DVec3::ZERO.min(sweep), DVec3::ZERO.max(sweep));
        let across = DVec3::new(-sweep.y, sweep.x, 0.0).normalize_or_zero();
        receivers.iter().map(|index| self.tree.node(*index)).any(|receiver| {
            let (offset, reach) = (receiver.centre - node.centre, receiver.half + node.half);
            let is_along = offset.cmpge(low - reach).all() && offset.cmple(high + reach).all();
            is_along && across.dot(offset).abs() <= across.abs().dot(reach)
        })
    }

    /// The vector along which a node's box is swept to give its shadow volume.
    fn shadow_sweep(&self, node: &TreeNode) -> DVec3 {
        let fall_m = (node.centre.z + node.half.z - self.lowest_m).max(0.0);
        -self.sun * (fall_m / self.sun.z).min(MAX_SHADOW_M)
    }

    /// Screen-space error of a node's shadow where that is nearest to the eye.
    fn error_px(&self, node: &TreeNode, sweep: DVec3) -> f64 {
        let to_eye = self.view.camera.position - node.centre;
        let along = (to_eye.dot(sweep) / sweep.length_squared().max(1e-12)).clamp(0.0, 1.0);
        self.metric.error_px(node.error_m, node.centre + sweep * along, node.radius_m)
    }
}

fn request(key: TileKey, weight_px: f64) -> TileRequest {
    TileRequest { key, group: PriorityGroup::Shadow, reason: RequestReason::ShadowCaster, weight_px }
}
