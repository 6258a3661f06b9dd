//! The active lists: the borders of the traversed region (Touma and Gotsman 1998).
//!
//! Lists are circular and ordered so that the untraversed side lies to the left of the edge from a node to the next.
//! When a list splits at a vertex, the vertex has one node in each part.

use super::half_edge::NONE;

/// Nodes with at least this many free edges, less one, share the last bucket.
const BUCKETS: usize = 64;

/// An occurrence of a vertex in an active list.
#[derive(Debug, Clone, Copy)]
pub(super) struct ActiveNode {
    pub(super) vertex: u32,
    /// Number of edges between the node's two border edges on the untraversed side.
    pub(super) free: u32,
    /// The next node; [`NONE`] once the node was removed.
    pub(super) next: u32,
    pub(super) prev: u32,
    /// The traversed half-edge on the edge to the next node.
    pub(super) edge: u32,
    /// The third vertex of that half-edge's triangle.
    pub(super) opposite: u32,
}

#[derive(Debug)]
pub(super) struct ActiveLists {
    /// All nodes ever added. Removed nodes keep their index.
    pub(super) nodes: Vec<ActiveNode>,
    /// Nodes by their number of free edges, the latest last. A node is added again whenever that number changes.
    buckets: [Vec<u32>; BUCKETS],
    lowest_bucket: usize,
}

impl ActiveLists {
    pub(super) fn new() -> Self {
        Self { nodes: Vec::new(), buckets: std::array::from_fn(|_| Vec::new()), lowest_bucket: BUCKETS }
    }

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

    /// Queues a node whose number of free edges changed.
    #[inline]
    pub(super) fn queue(&mut self, node: u32) {
        let bucket = (self.node(node).free as usize).min(BUCKETS - 1);
        self.buckets[bucket].push(node);
        self.lowest_bucket = self.lowest_bucket.min(bucket);
    }

    /// The node with the fewest free edges, the latest of equals. `None` once all lists are empty.
    #[inline]
    pub(super) fn pop_focus(&mut self) -> Option<u32> {
        while self.lowest_bucket < BUCKETS {
            while let Some(node) = self.buckets[self.lowest_bucket].pop() {
                let ActiveNode { next, free, .. } = *self.node(node);
                if next != NONE && (free as usize).min(BUCKETS - 1) == self.lowest_bucket {
                    return Some(node);
                }
            }
            self.lowest_bucket += 1;
        }
        None
    }
}
