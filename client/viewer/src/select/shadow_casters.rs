//! Which nodes may cast a shadow into the picture: a cut of its own beside that of what is seen.
//!
//! In: [`View`], the direction to the sun, [`SceneTree`]. Out: [`ShadowCasters`]. Next: `session` has them fetched, `render::frame` draws
//! them with the cut.
//!
//! A box casts where it lies if it is drawn along the light until below all ground; so it counts if that hull meets the
//! frustum, wherever the box itself is. What is in the picture as well is drawn as finely as the picture asks for: this cut
//! only fills what that one leaves out, and is coarser.

use crate::select::{
    Selection, cull, error,
    priority::{self, TileRequest},
};
use crate::{
    camera::{FrustumPlane, NEAR_M, View},
    scene::{NodeIndex, SceneTree, TileKey, TreeNode},
};
use glam::DVec3;
use insula_protocol::Subtree;
use std::collections::HashSet;

/// A shadow's edge may be wrong by so many times tau.
pub const SHADOW_TAU_FACTOR: f64 = 3.0;
/// Longest shadow that is cast, in metres: a low sun's would reach over the whole city, and haze takes them.
pub const MAX_SHADOW_M: f64 = 3000.0;
/// Times that tau is doubled, at most, for want of memory.
const DOUBLINGS: u32 = 8;

/// What a frame's rays towards the sun need.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ShadowCasters {
    /// Resident nodes, the coarser before the finer ones that lie in them. Not to be evicted.
    pub nodes: Vec<NodeIndex>,
    /// Tiles to fetch, in order.
    pub requests: Vec<TileRequest>,
    /// Pages that all of them take.
    pages: u32,
    visited: u32,
}

struct Walker<'a> {
    view: &'a View,
    tree: &'a SceneTree,
    planes: [FrustumPlane; 5],
    sun: DVec3,
    /// What shadows may fall on; everything in the picture if nobody knows.
    receivers: Option<&'a [NodeIndex]>,
    /// Leaves that cast as the picture shows them.
    meshed: HashSet<NodeIndex>,
    /// Shadows end here.
    low_m: f64,
    tau_px: f64,
}

/// Casters of one frame; `sun` is a unit vector. Shadows fall on the squares of `picture` that are seen (`None`: all in the
/// frustum); its meshes cast their own. The budget is `view`'s; tau rises until they fit. None by night.
pub fn shadow_casters(view: &View, sun: DVec3, tree: &SceneTree, picture: Option<&Selection>) -> ShadowCasters {
    let Some(root) = tree.root().filter(|_| sun.z > 0.0) else { return ShadowCasters::default() };
    let node = tree.node(root);
    let low_m = node.centre.z - node.half.z;
    let tau_px = view.tau_px * SHADOW_TAU_FACTOR;
    let receivers = picture.map(|picture| &picture.unoccluded[..]);
    let meshed = picture.into_iter().flat_map(|picture| picture.mesh_leaves.iter().copied()).collect();
    let mut walker = Walker { view, tree, planes: view.planes(), sun, receivers, meshed, low_m, tau_px };
    for _ in 0..DOUBLINGS {
        let mut casters = ShadowCasters::default();
        if walker.walk(root, &mut casters) {
            priority::sort(&mut casters.requests);
            return casters;
        }
        walker.tau_px *= 2.0;
    }
    ShadowCasters::default()
}

impl Walker<'_> {
    /// From `root` down; whether all of it is within the budget.
    fn walk(&self, root: NodeIndex, casters: &mut ShadowCasters) -> bool {
        let mut open = vec![root];
        while let Some(at) = open.pop() {
            let node = self.tree.node(at);
            let hull = self.hull(node.centre, node.half);
            let in_view = cull::hull_in_view(&self.planes, node.centre, node.half, hull);
            if self.meshed.contains(&at) || !in_view || !self.is_received(node, hull) {
                continue;
            }
            casters.pages += self.tree.node_pages(at);
            casters.visited += 1;
            if casters.pages > self.view.budget_pages || casters.visited > self.view.budget_nodes {
                return false;
            }
            let error_px = self.error_px(node, hull);
            let want = |key| TileRequest { key, group: priority::PriorityGroup::Shadow, weight: error_px };
            match node.tile.is_resident() {
                true => casters.nodes.push(at),
                false if !node.tile.is_bad() => casters.requests.push(want(TileKey::block_map(node.id))),
                false => {}
            }
            if error_px <= self.tau_px {
                continue;
            }
            let there = (0..4).filter(|q| node.child_mask >> q & 1 == 1);
            let known: Vec<NodeIndex> = there.clone().filter_map(|q| node.children[q]).collect();
            if known.len() < there.count() && !self.tree.subtree(Subtree::root_of(node.id)).is_bad() {
                casters.requests.push(want(TileKey::subtree(Subtree::root_of(node.id))));
            }
            open.extend(known);
        }
        true
    }

    /// Whether a node's shadow may fall on anything that is seen.
    fn is_received(&self, node: &TreeNode, hull: DVec3) -> bool {
        let Some(receivers) = self.receivers else { return true };
        let (low, high) = (DVec3::ZERO.min(hull), DVec3::ZERO.max(hull));
        // What lies beside the way of the light.
        let side = DVec3::new(-hull.y, hull.x, 0.0).normalize_or_zero();
        receivers.iter().map(|at| self.tree.node(*at)).any(|on| {
            let (apart, reach) = (on.centre - node.centre, on.half + node.half);
            let along = apart.cmpge(low - reach).all() && apart.cmple(high + reach).all();
            along && side.dot(apart).abs() <= side.abs().dot(reach)
        })
    }

    /// From a box along the light as far as its shadow goes.
    fn hull(&self, centre: DVec3, half: DVec3) -> DVec3 {
        let fall_m = (centre.z + half.z - self.low_m).max(0.0);
        -self.sun * (fall_m / self.sun.z).min(MAX_SHADOW_M)
    }

    /// How wrong its shadow may look where that is nearest.
    fn error_px(&self, node: &TreeNode, hull: DVec3) -> f64 {
        let to_eye = self.view.camera.position - node.centre;
        let along = (to_eye.dot(hull) / hull.length_squared().max(1e-12)).clamp(0.0, 1.0);
        let nearest = node.centre + hull * along;
        error::error_px(node.error_m, nearest, node.radius_m, self.view.camera.position, self.view.focal_px(), NEAR_M)
    }
}
