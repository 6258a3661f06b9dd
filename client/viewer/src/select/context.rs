//! What all steps of one selection know, and the questions about nodes that they share.

use super::cull;
use super::occlusion_feedback::{OcclusionFeedback, Visibility};
use super::screen_error::ErrorMetric;
use crate::camera::{FrustumPlane, View};
use crate::scene::{NodeIndex, SceneTree, TileRecord, TileState, TreeNode};
use crate::switching::NodeVolume;
use insula_protocol::TileId;
use insula_protocol::visibility_tile::VisibleSet;

/// A node whose visibility is unknown is requested only while its parent's error exceeds this multiple of tau. This bounds how
/// coarse a node is when it comes into view.
const UNKNOWN_TAU_FACTOR: f64 = 16.0;
/// The same for occluded nodes.
pub(crate) const OCCLUDED_TAU_FACTOR: f64 = 64.0;

/// Levels between a leaf and the node that its mesh has its sky from ([`super::meshes::sky_source`]).
const SKY_LEVELS: u8 = 2;

/// The inputs of one selection, and values derived from them.
pub(super) struct SelectionContext<'a> {
    pub(super) view: &'a View,
    pub(super) tree: &'a SceneTree,
    pub(super) feedback: &'a OcclusionFeedback,
    pub(super) planes: [FrustumPlane; 5],
    pub(super) metric: ErrorMetric,
    pub(super) is_camera_still: bool,
    /// What the eye's cell may see, if the eye is in one.
    visible: Option<VisibleSet<'a>>,
}

impl<'a> SelectionContext<'a> {
    pub(super) fn new(view: &'a View, tree: &'a SceneTree, feedback: &'a OcclusionFeedback) -> Self {
        Self {
            view,
            tree,
            feedback,
            planes: view.planes(),
            metric: ErrorMetric::new(view),
            is_camera_still: feedback.is_camera_still(view),
            visible: tree.visible_set(view.camera.position),
        }
    }

    /// Screen-space error of a node's V-BlockMap, or what stands for it with switching distances.
    pub(super) fn error_px(&self, node: &TreeNode) -> f64 {
        if let Some(switching) = &self.view.switching {
            let level = self.tree.mesh_levels() + self.tree.manifest().depth.saturating_sub(node.id.level());
            return switching.error_px(level, &volume_of(node), self.metric.eye);
        }
        self.metric.error_px(node.error_m, node.centre, node.radius_m)
    }

    /// Screen-space error of a level of detail of a leaf's mesh, measured with the leaf's sphere.
    pub(super) fn lod_error_px(&self, leaf: &TreeNode, lod: usize) -> f64 {
        if let Some(switching) = &self.view.switching {
            return switching.error_px(lod as u8, &volume_of(leaf), self.metric.eye);
        }
        self.metric.error_px(leaf.lods[lod].error_m, leaf.centre, leaf.radius_m)
    }

    /// Whether a node lies outside the frustum.
    pub(super) fn is_culled(&self, node: &TreeNode) -> bool {
        !cull::is_box_in_view(&self.planes, node.centre, node.half)
    }

    /// Whether the potentially visible set of the eye's cell lacks a node: nothing of it can be seen from anywhere in the cell.
    pub(super) fn is_hidden(&self, id: TileId) -> bool {
        self.visible.is_some_and(|visible| !visible.may_see(id))
    }

    /// Whether the eye is in a cell whose set is known.
    pub(super) fn has_visible_set(&self) -> bool {
        self.visible.is_some()
    }

    /// Whether an error is so large that visibility does not matter: content of this visibility is requested all the same.
    pub(super) fn is_large_error(&self, error_px: f64, visibility: Visibility) -> bool {
        let factor = if visibility == Visibility::Occluded { OCCLUDED_TAU_FACTOR } else { UNKNOWN_TAU_FACTOR };
        error_px > self.view.tau_px * factor
    }

    /// Whether a node is refined without being fetched itself, because it is of a level that is skipped ([`is_alternate_level`]).
    /// Rays distinguish its children in its ancestor's tile. Only once there is feedback, and not if its tile is resident or
    /// arriving anyway.
    pub(super) fn is_skipped_level(&self, node: &TreeNode) -> bool {
        is_alternate_level(node, self.tree) && self.feedback.has_feedback() && !is_resident_or_arriving(node.tile)
    }

    /// Whether a node on the way to what the eye's cell may see is refined without being fetched itself: it would be drawn for a
    /// moment only. Not the level that meshes have their sky from.
    pub(super) fn skips_way(&self, node: &TreeNode) -> bool {
        let is_sky_source = node.id.level() + SKY_LEVELS == self.tree.manifest().depth;
        self.has_visible_set() && node.parent.is_some() && !is_sky_source && !is_resident_or_arriving(node.tile)
    }

    /// Whether a leaf is refined from its ancestor's tile to its mesh directly. Its V-BlockMap would be drawn only until the
    /// mesh arrives. It is drawn if it is resident or arriving anyway.
    pub(super) fn skips_columns(&self, leaf: &TreeNode) -> bool {
        self.feedback.has_feedback()
            && !is_resident_or_arriving(leaf.tile)
            && leaf.lods.iter().any(|lod| !lod.tile.is_bad())
            && self.error_px(leaf) > self.view.tau_px
    }

    /// Whether anything of a node can be drawn without its ancestors: its own V-BlockMap or mesh, or those of a child in view.
    pub(super) fn is_drawable(&self, index: NodeIndex) -> bool {
        let node = self.tree.node(index);
        let children = node.children.iter().flatten().map(|child| self.tree.node(*child));
        has_resident_tile(node)
            || has_known_children(node)
                && children.into_iter().any(|child| !self.is_culled(child) && has_resident_tile(child))
    }

    /// Whether anything of a child of `node` can be drawn.
    pub(super) fn has_drawable_child(&self, node: &TreeNode) -> bool {
        node.children.iter().flatten().any(|child| self.is_drawable(*child))
    }
}

fn volume_of(node: &TreeNode) -> NodeVolume {
    NodeVolume { centre: node.centre, half: node.half, radius_m: node.radius_m }
}

/// Whether a node's V-BlockMap, or any level of detail of its mesh, is resident.
pub(super) fn has_resident_tile(node: &TreeNode) -> bool {
    node.tile.is_resident() || node.lods.iter().any(|lod| lod.tile.is_resident())
}

/// Whether a node has children, and the subtree that describes them is resident.
pub(super) fn has_known_children(node: &TreeNode) -> bool {
    node.child_mask != 0 && node.children.iter().flatten().count() as u32 == u32::from(node.child_mask).count_ones()
}

/// Whether a node is on one of the levels that may be skipped: every second one, from the leaves' parents upwards.
pub(super) fn is_alternate_level(node: &TreeNode, tree: &SceneTree) -> bool {
    node.parent.is_some() && (tree.manifest().depth ^ node.id.level()) & 1 == 1
}

fn is_resident_or_arriving(tile: TileRecord) -> bool {
    matches!(tile.state(), TileState::Loading | TileState::Decoded | TileState::Resident)
}
