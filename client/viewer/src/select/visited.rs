//! The part of the scene tree that a selection visits: every visited node, and what can be drawn in its area.

use super::occlusion_feedback::Visibility;
use super::priority::RequestReason;
use crate::scene::{NodeIndex, SceneTree};
use std::cmp::Ordering;
use std::collections::BinaryHeap;
use std::ops::Range;

/// Memory that selections reuse from frame to frame.
#[derive(Debug, Clone, Default)]
pub struct SelectionScratch {
    /// Visited nodes; the first is the root, and parents come before their children.
    pub(super) visits: Vec<Visit>,
    /// Nodes that wait to be visited.
    pub(super) candidates: BinaryHeap<VisitCandidate>,
    stack: Vec<(u32, Option<Cover>)>,
}

#[derive(Debug, Clone)]
pub(super) struct Visit {
    pub(super) node: NodeIndex,
    pub(super) error_px: f64,
    pub(super) visibility: Visibility,
    /// Why the view asks for the node's V-BlockMap; `None` if it does not, and the node is drawn from what is resident.
    pub(super) request: Option<RequestReason>,
    /// The visits of its children in view; `None` if the node is not refined.
    pub(super) children: Option<Range<u32>>,
    /// Level of detail of its mesh that the view asks for.
    pub(super) mesh_lod: Option<u8>,
}

/// A node that waits to be visited, ordered by error; of equal errors, the one found first comes first.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct VisitCandidate {
    pub(super) error_px: f64,
    pub(super) visit: u32,
}

impl Eq for VisitCandidate {}

impl Ord for VisitCandidate {
    fn cmp(&self, other: &Self) -> Ordering {
        self.error_px.total_cmp(&other.error_px).then(other.visit.cmp(&self.visit))
    }
}

impl PartialOrd for VisitCandidate {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

/// The resident V-BlockMap that covers a node's area.
#[derive(Debug, Clone, Copy)]
pub(super) struct Cover {
    /// The node itself, or its nearest resident ancestor among the visited ones.
    pub(super) source: NodeIndex,
    /// Screen-space error of `source`.
    pub(super) error_px: f64,
}

impl Visit {
    /// The cover that the node's own V-BlockMap gives, if it is resident.
    fn own_cover(&self, tree: &SceneTree) -> Option<Cover> {
        tree.node(self.node).tile.is_resident().then_some(Cover { source: self.node, error_px: self.error_px })
    }
}

impl SelectionScratch {
    /// The nodes that the last selection visited.
    pub(crate) fn visited_nodes(&self) -> impl Iterator<Item = NodeIndex> {
        self.visits.iter().map(|visit| visit.node)
    }

    pub(super) fn clear(&mut self) {
        self.visits.clear();
        self.candidates.clear();
    }

    /// Calls `f` with every visit, from the root down, and with the cover of its area.
    pub(super) fn for_each(&mut self, tree: &SceneTree, mut f: impl FnMut(&Visit, Option<Cover>)) {
        let Self { visits, stack, .. } = self;
        stack.clear();
        stack.extend((!visits.is_empty()).then_some((0, None)));
        while let Some((i, inherited)) = stack.pop() {
            let visit = &visits[i as usize];
            let cover = visit.own_cover(tree).or(inherited);
            f(visit, cover);
            stack.extend(visit.children.iter().flat_map(Clone::clone).map(|child| (child, cover)));
        }
    }
}
