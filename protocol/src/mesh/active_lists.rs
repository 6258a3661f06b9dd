//! The lists of active vertices around what is conquered, and who is the focus.
//!
//! In: nodes as `conquest` makes them. Out: the focus. Next: `conquest`.
//!
//! A node is one stay of a vertex on a list: after a list was split at a vertex, two nodes stand for it. Lists go round so
//! that what is not conquered lies to the left of the edge from a node to its next.

use super::half_edge::NONE;

/// Free edges from which on nodes wait in one bucket.
const BUCKETS: usize = 64;

/// A stay of a vertex on an active list.
#[derive(Debug, Clone, Copy)]
pub(super) struct ActiveNode {
    /// Which vertex.
    pub(super) vertex: u32,
    /// Edges between its two border edges, on the side that is not conquered.
    pub(super) free: u32,
    /// The node after it; [`NONE`] once it has left.
    pub(super) next: u32,
    /// The node before it.
    pub(super) prev: u32,
    /// The conquered half-edge on the edge to the next node.
    pub(super) edge: u32,
}

/// All active lists.
#[derive(Debug)]
pub(super) struct ActiveLists {
    /// Those that have left too: a node keeps its number.
    pub(super) nodes: Vec<ActiveNode>,
    /// By free edges, the latest last. A node stands there once for each time its free edges changed.
    buckets: [Vec<u32>; BUCKETS],
    lowest: usize,
}

impl ActiveLists {
    pub(super) fn new() -> Self {
        Self { nodes: Vec::new(), buckets: std::array::from_fn(|_| Vec::new()), lowest: BUCKETS }
    }

    /// Appends a node.
    #[inline]
    pub(super) fn add(&mut self, node: ActiveNode) -> u32 {
        self.nodes.push(node);
        self.nodes.len() as u32 - 1
    }

    #[inline]
    pub(super) fn node(&self, node: u32) -> &ActiveNode {
        &self.nodes[node as usize]
    }

    #[inline]
    pub(super) fn node_mut(&mut self, node: u32) -> &mut ActiveNode {
        &mut self.nodes[node as usize]
    }

    /// Says that a node's free edges changed.
    #[inline]
    pub(super) fn wait(&mut self, node: u32) {
        let bucket = (self.node(node).free as usize).min(BUCKETS - 1);
        self.buckets[bucket].push(node);
        self.lowest = self.lowest.min(bucket);
    }

    /// A node of fewest free edges, the latest of them; none once all lists are empty.
    #[inline]
    pub(super) fn focus(&mut self) -> Option<u32> {
        while self.lowest < BUCKETS {
            while let Some(node) = self.buckets[self.lowest].pop() {
                let ActiveNode { next, free, .. } = *self.node(node);
                if next != NONE && (free as usize).min(BUCKETS - 1) == self.lowest {
                    return Some(node);
                }
            }
            self.lowest += 1;
        }
        None
    }
}
