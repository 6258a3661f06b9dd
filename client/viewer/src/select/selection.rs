//! The result of a selection.

use super::priority::TileRequest;
use crate::scene::{NodeIndex, TileKey};
use insula_protocol::TileId;

/// One entry of the draw list: a node's area, and the tile that is drawn there.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DrawTile {
    /// Node whose area is covered.
    pub node: NodeIndex,
    /// Node whose V-BlockMap is drawn: `node` itself or an ancestor. Resident.
    pub source: NodeIndex,
    /// Level of detail of `node`'s mesh that is drawn instead of the V-BlockMap. Resident. `source` then gives the sky
    /// visibility of the mesh.
    pub mesh_lod: Option<u8>,
}

/// What a frame draws and what it lacks.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Selection {
    /// The draw list. The areas of its entries do not overlap, and cover everything in view that the root covers.
    pub draw_tiles: Vec<DrawTile>,
    /// Nodes of the draw list that are visible, or whose visibility is unknown; in the order of the draw list.
    pub unoccluded: Vec<NodeIndex>,
    /// Leaves of the draw list that need their mesh, resident or not.
    pub mesh_leaves: Vec<NodeIndex>,
    /// Nodes whose resident V-BlockMaps must not be evicted: those that the view asks for, coarsest first.
    pub used_nodes: Vec<NodeIndex>,
    /// Resident meshes that must not be evicted.
    pub used_meshes: Vec<TileKey>,
    /// Roots of the subtrees around the eye, which must not be evicted even if they are out of view.
    pub used_subtrees: Vec<TileId>,
    /// Tiles to fetch, most important first.
    pub requests: Vec<TileRequest>,
    pub stats: SelectionStats,
}

/// Counts of one selection.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct SelectionStats {
    pub visited: u32,
    /// Children outside the frustum.
    pub culled: u32,
    /// Entries of the draw list.
    pub drawn: u32,
    /// Visited nodes that are occluded, or whose visibility is unknown.
    pub not_visible: u32,
    /// Refinements that a bad child prevented; each bad child counts.
    pub blocked: u32,
    /// Cache pages of all tiles that the view asks for.
    pub pages: u32,
    /// Entries of the draw list that are drawn as meshes.
    pub meshes: u32,
    /// Triangles of those meshes.
    pub triangles: u64,
    /// Error threshold in pixels: the view's tau, or the error of the first node that did not fit into the budget.
    pub tau_px: f64,
    /// Largest screen-space error in the draw list, in pixels, occluded nodes excepted.
    pub worst_error_px: f64,
    /// Largest screen-space error of the visible nodes in the draw list, in pixels. The finest level that exists does not count: it
    /// is good enough however near the eye is.
    pub visible_error_px: f64,
}
