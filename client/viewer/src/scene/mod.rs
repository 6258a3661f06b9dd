//! The scene tree: which nodes of a city are known, their bounds and errors, and the states of their tiles.

mod eviction;
pub mod tile;
mod tree;

#[cfg(test)]
pub(crate) use eviction::MAX_SUBTREE_BYTES;
use glam::DVec3;
use insula_protocol::visibility_tile::{VisibleSet, block_of_leaf};
use insula_protocol::{Manifest, Subtree, TileId, TileKind, VisibilityTile, mesh_tile};
use std::cmp::Reverse;
use std::collections::{HashMap, VecDeque};
pub use tile::{TileEvent, TileRecord, TileState};
pub use tree::{LeafLod, NodeIndex, SceneTree, TreeNode};

/// The memory that the nodes of a tree take, by subtree, and which subtrees the present frame uses.
///
/// The nodes that one subtree tile lists become known together and are evicted together. A subtree is in use in a frame if the
/// frame's selection visits one of its nodes, or a node whose children it lists. Then those above it are in use, too.
#[derive(Debug, Clone)]
struct TreeMemory {
    max_bytes: usize,
    bytes: usize,
    /// Bytes of the subtrees that are in use in the present frame.
    used_bytes: usize,
    frame: u64,
    /// By the id of their root.
    subtrees: HashMap<TileId, ResidentSubtree>,
    /// Resident tiles of evicted nodes that the owner of the cache has not taken yet.
    evicted_tiles: Vec<TileKey>,
}

#[derive(Debug, Clone, Default)]
struct ResidentSubtree {
    /// Nodes that it lists, parents before their children. Its root is listed by the subtree above.
    nodes: Vec<TileId>,
    bytes: usize,
    /// The last frame that used it.
    last_frame: u64,
}

impl Default for TreeMemory {
    fn default() -> Self {
        let (subtrees, evicted_tiles) = (HashMap::new(), Vec::new());
        Self { max_bytes: usize::MAX, bytes: 0, used_bytes: 0, frame: 1, subtrees, evicted_tiles }
    }
}

/// The root of the subtree tile that lists a node.
fn listing_subtree(id: TileId) -> TileId {
    id.parent().map_or(TileId::ROOT, Subtree::root_of)
}

impl TreeMemory {
    fn add_node(&mut self, id: TileId, bytes: usize) {
        self.add_bytes(id, bytes).nodes.push(id);
    }

    /// Adds `bytes` to a node. What has just arrived is in use until the next frame.
    fn add_bytes(&mut self, id: TileId, bytes: usize) -> &mut ResidentSubtree {
        let root = listing_subtree(id);
        let subtree = self.subtrees.entry(root).or_default();
        self.used_bytes += if subtree.last_frame == self.frame { bytes } else { subtree.bytes + bytes };
        self.bytes += bytes;
        subtree.bytes += bytes;
        subtree.last_frame = self.frame;
        subtree
    }

    /// Marks a subtree and those above it as used.
    fn mark_used(&mut self, root: TileId) {
        let mut next = Some(root);
        while let Some(root) = next
            && let Some(subtree) = self.subtrees.get_mut(&root)
            && subtree.last_frame != self.frame
        {
            subtree.last_frame = self.frame;
            self.used_bytes += subtree.bytes;
            next = root.parent().map(Subtree::root_of);
        }
    }

    /// Roots of the subtrees that are not in use, in the order in which they may be evicted: those above others come after them.
    fn unused_subtrees(&self) -> Vec<TileId> {
        let unused = self.subtrees.iter().filter(|(_, subtree)| subtree.last_frame != self.frame);
        let mut unused: Vec<_> = unused.map(|(root, subtree)| (subtree.last_frame, Reverse(*root))).collect();
        unused.sort_unstable();
        unused.into_iter().map(|(_, Reverse(root))| root).collect()
    }
}

/// Identifies a tile: a V-BlockMap, a subtree, a level of detail of a mesh, objects, or visibility.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct TileKey {
    /// 0 for V-BlockMaps, 1 for subtrees, 2 for meshes, 3 for objects, 4 for visibility: the first criterion of the order.
    kind: u8,
    /// The node; for a subtree, its root.
    pub id: TileId,
    /// Level of detail of a mesh, 0 being the finest; 0 for other tiles.
    pub lod: u8,
}

impl TileKey {
    /// A node's V-BlockMap.
    pub const fn block_map(id: TileId) -> Self {
        Self { kind: 0, id, lod: 0 }
    }

    /// The subtree below a node.
    pub const fn subtree(id: TileId) -> Self {
        Self { kind: 1, id, lod: 0 }
    }

    /// A level of detail of a leaf's mesh.
    pub const fn mesh(id: TileId, lod: u8) -> Self {
        Self { kind: 2, id, lod }
    }

    /// A block of objects, or their schema, by its place in the archive ([`insula_protocol::object_tile`]).
    pub const fn objects(id: TileId) -> Self {
        Self { kind: 3, id, lod: 0 }
    }

    /// What can be seen from the streets of a node's cells ([`insula_protocol::visibility_tile`]).
    pub const fn visibility(id: TileId) -> Self {
        Self { kind: 4, id, lod: 0 }
    }

    /// The tile at a place of an archive, in a city whose leaves are at level `depth`; `None` if no tile can be there.
    pub fn in_archive(kind: TileKind, place: TileId, depth: u8) -> Option<Self> {
        Some(match kind {
            TileKind::BlockMap => Self::block_map(place),
            TileKind::Subtree => Self::subtree(place),
            TileKind::Mesh => {
                let (leaf, lod) = mesh_tile::from_archive_id(place, depth)?;
                Self::mesh(leaf, lod)
            }
            TileKind::Objects => Self::objects(place),
            TileKind::Visibility => Self::visibility(place),
        })
    }

    /// What the tile holds.
    pub const fn kind(self) -> TileKind {
        match self.kind {
            0 => TileKind::BlockMap,
            1 => TileKind::Subtree,
            2 => TileKind::Mesh,
            3 => TileKind::Objects,
            _ => TileKind::Visibility,
        }
    }
}

/// Most visibility tiles that are kept. Each takes at most 109 kB.
const MAX_VISIBILITY_TILES: usize = 16;

#[derive(Debug, Clone, Default)]
struct VisibilityTiles {
    states: HashMap<TileId, TileRecord>,
    /// The latest last.
    resident: VecDeque<VisibilityTile>,
}

impl VisibilityTiles {
    fn state(&self, id: TileId) -> TileRecord {
        self.states.get(&id).copied().unwrap_or_default()
    }

    fn apply(&mut self, id: TileId, event: TileEvent) -> bool {
        if self.states.len() > 64 * MAX_VISIBILITY_TILES {
            self.states.retain(|_, tile| tile.is_resident());
        }
        self.states.entry(id).or_default().apply(event)
    }

    /// Takes in a decoded tile. The oldest makes room for it.
    fn put(&mut self, tile: VisibilityTile) {
        if self.resident.len() >= MAX_VISIBILITY_TILES
            && let Some(oldest) = self.resident.pop_front()
        {
            self.apply(oldest.id, TileEvent::Drop);
        }
        self.apply(tile.id, TileEvent::Upload);
        self.resident.push_back(tile);
    }

    /// A resident tile.
    fn get(&self, id: TileId) -> Option<&VisibilityTile> {
        self.resident.iter().find(|tile| tile.id == id)
    }
}

/// Eyes this far above the ground plane are in no cell, in metres, unless they are near the ground of a hill.
const MAX_STREET_EYE_M: f64 = 60.0;

/// The leaf square that a point is above. `None` outside of the root's area.
fn leaf_at(manifest: &Manifest, point: DVec3) -> Option<TileId> {
    let leaves = f64::from(1u32 << manifest.depth);
    let at = (point - DVec3::from(manifest.origin)) / manifest.root_side_m * leaves;
    let is_inside = |v: f64| (0.0..leaves).contains(&v);
    (is_inside(at.x) && is_inside(at.y)).then(|| TileId::new(manifest.depth, at.x as u32, at.y as u32))?
}

impl SceneTree {
    pub(crate) fn put_visibility(&mut self, tile: VisibilityTile) {
        self.visibility.put(tile);
    }

    /// The missing tile whose cells an eye may be in.
    pub(crate) fn missing_visibility(&self, eye: DVec3) -> Option<TileKey> {
        let manifest = self.manifest();
        if !manifest.street_sets || eye.z > manifest.ground_z_m + MAX_STREET_EYE_M {
            return None;
        }
        let id = block_of_leaf(leaf_at(manifest, eye)?);
        let tile = self.visibility.state(id);
        (!tile.is_resident() && !tile.is_bad()).then_some(TileKey::visibility(id))
    }

    /// What an eye may see. `None` if it is in no cell, or if its tile is not resident.
    pub(crate) fn visible_set(&self, eye: DVec3) -> Option<VisibleSet<'_>> {
        let manifest = self.manifest();
        let leaf = leaf_at(manifest, eye)?;
        let tile = self.visibility.get(block_of_leaf(leaf)).filter(|tile| tile.depth == manifest.depth)?;
        tile.set_at(leaf.x(), leaf.y(), eye.z - manifest.origin[2])
    }
}
