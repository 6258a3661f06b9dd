//! The known nodes of a city in one array, with the states of their tiles.

use super::tile::{TileEvent, TileRecord};
use super::{TileKey, TreeMemory, VisibilityTiles, listing_subtree};
use glam::{DVec2, DVec3};
use insula_protocol::subtree::{MeshLod, NodeInfo};
use insula_protocol::{Manifest, Subtree, TileId, TileKind};
use insula_shaders::mesh::pages_guess;
use insula_shaders::shore::Shore;
use insula_shaders::stone::{MAX_STONES, Stone, StoneParameters};
use std::collections::HashMap;
use std::num::NonZeroU32;

/// Pages that a V-BlockMap is assumed to take until [`MIN_SAMPLES`] have been decoded. After that, the average is assumed.
const DEFAULT_PAGES: u32 = 6;
const MIN_SAMPLES: u64 = 8;

/// Memory for a node: its slot, its entry in the index by id, and what selections record about it.
pub(super) const NODE_BYTES: usize = size_of::<NodeSlot>() + 2 * size_of::<(TileId, NodeIndex)>() + 64;
/// Memory for a leaf's level of detail.
pub(super) const LOD_BYTES: usize = size_of::<LeafLod>();

/// Index of a known node. Stays valid until the node is evicted, and never names another node.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct NodeIndex {
    slot: u32,
    /// Number of the node among all that were ever known.
    serial: NonZeroU32,
}

impl NodeIndex {
    /// Position among [`SceneTree::slots`], which a later node may take over.
    pub(crate) fn slot(self) -> usize {
        self.slot as usize
    }
}

/// A known node. Lengths in metres, world coordinates.
#[derive(Debug, Clone, PartialEq)]
pub struct TreeNode {
    pub id: TileId,
    /// Centre of the node's box.
    pub centre: DVec3,
    /// Half of the box's sides.
    pub half: DVec3,
    /// World-space error of the V-BlockMap.
    pub error_m: f64,
    /// Radius of the bounding sphere around `centre`, which contains the spheres of all children.
    pub radius_m: f64,
    pub parent: Option<NodeIndex>,
    /// Bit q is set if quadrant q has a child.
    pub child_mask: u8,
    /// Known children, by quadrant.
    pub children: [Option<NodeIndex>; 4],
    /// Size of the compressed V-BlockMap.
    pub bytes: u32,
    /// Cache pages of the V-BlockMap, once it has been decoded.
    pub pages: Option<u32>,
    /// State of the V-BlockMap.
    pub tile: TileRecord,
    /// Levels of detail of the node's mesh, finest first. Only leaves have meshes.
    pub lods: Vec<LeafLod>,
}

/// A level of detail of a leaf's mesh.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LeafLod {
    /// World-space error in metres.
    pub error_m: f64,
    /// Size of the compressed mesh.
    pub bytes: u32,
    pub triangles: u32,
    /// Cache pages; an estimate until the mesh has been decoded.
    pub pages: u32,
    pub tile: TileRecord,
}

impl LeafLod {
    fn new(lod: &MeshLod) -> Self {
        let MeshLod { error_m, bytes, triangles, texture_px } = *lod;
        let pages = pages_guess(triangles, texture_px);
        Self { error_m: f64::from(error_m), bytes, triangles, pages, tile: TileRecord::default() }
    }
}

/// Bytes of a subtree tile per node of its deepest level, with those above it.
const SUBTREE_LEAF_BYTES: u32 = 64;

/// Everything known about the nodes of one city.
#[derive(Debug, Clone)]
pub struct SceneTree {
    manifest: Manifest,
    /// Those of the manifest, or as they were edited.
    stones: [Stone; MAX_STONES],
    /// The shore that the manifest tells.
    shore: Option<Shore>,
    slots: Vec<NodeSlot>,
    /// Slots without a node.
    vacant: Vec<u32>,
    last_serial: NonZeroU32,
    /// State of the root's V-BlockMap while the root is unknown: it may arrive before the subtree.
    root_tile: TileRecord,
    index: HashMap<TileId, NodeIndex>,
    pub(super) subtrees: HashMap<TileId, TileRecord>,
    decoded: DecodedPages,
    has_meshes: bool,
    /// Most levels of detail of any leaf's mesh so far.
    mesh_levels: u8,
    pub(super) memory: TreeMemory,
    pub(super) visibility: VisibilityTiles,
}

/// The stones of a manifest. One that this version does not know leaves its landmarks in the colour of their triangles.
fn stones_of(manifest: &Manifest) -> [Stone; MAX_STONES] {
    let mut stones = [Stone::NONE; MAX_STONES];
    for (stone, text) in stones.iter_mut().zip(&manifest.stones) {
        let parameters = serde_json::from_str::<StoneParameters>(text).ok();
        *stone = parameters.and_then(|parameters| parameters.stone().ok()).unwrap_or(Stone::NONE);
    }
    stones
}

/// Where a manifest says that the city ends in the sea.
fn shore_of(manifest: &Manifest) -> Option<Shore> {
    let [x, y, _] = manifest.origin;
    Shore::known(manifest.sea.as_ref()?, DVec2::new(x, y), manifest.cell_m_at(0))
}

/// Place of a node.
#[derive(Debug, Clone)]
struct NodeSlot {
    /// `None` while the slot is vacant.
    serial: Option<NonZeroU32>,
    node: TreeNode,
}

/// Total pages of the V-BlockMaps that have been decoded.
#[derive(Debug, Clone, Copy, Default)]
struct DecodedPages {
    pages: u64,
    nodes: u64,
}

impl SceneTree {
    /// A tree without nodes. `manifest` must have passed [`Manifest::check`].
    pub fn new(manifest: Manifest) -> Self {
        Self {
            stones: stones_of(&manifest),
            shore: shore_of(&manifest),
            manifest,
            slots: Vec::new(),
            vacant: Vec::new(),
            last_serial: NonZeroU32::MIN,
            root_tile: TileRecord::default(),
            index: HashMap::new(),
            subtrees: HashMap::new(),
            decoded: DecodedPages::default(),
            has_meshes: true,
            mesh_levels: 0,
            memory: TreeMemory::default(),
            visibility: VisibilityTiles::default(),
        }
    }

    /// The stones of landmarks, by number.
    pub fn stones(&self) -> &[Stone; MAX_STONES] {
        &self.stones
    }

    /// Where the city ends in the sea, if its manifest tells it.
    pub(crate) fn shore(&self) -> Option<&Shore> {
        self.shore.as_ref()
    }

    /// Draws the landmarks of stone `number` in another stone from the next frame on.
    pub fn set_stone(&mut self, number: usize, stone: Stone) {
        if let Some(place) = self.stones.get_mut(number) {
            *place = stone;
        }
    }

    /// The same tree, with or without leaves' meshes. To be called before any subtree is merged.
    pub fn with_meshes(self, has_meshes: bool) -> Self {
        Self { has_meshes, ..self }
    }

    /// Most levels of detail of any known leaf's mesh.
    pub fn mesh_levels(&self) -> u8 {
        self.mesh_levels
    }

    /// The city's manifest.
    pub fn manifest(&self) -> &Manifest {
        &self.manifest
    }

    /// The root, once its subtree has been merged.
    pub fn root(&self) -> Option<NodeIndex> {
        self.find(TileId::ROOT)
    }

    /// The index of a known node.
    pub fn find(&self, id: TileId) -> Option<NodeIndex> {
        self.index.get(&id).copied()
    }

    /// A node, which must not have been evicted.
    pub fn node(&self, index: NodeIndex) -> &TreeNode {
        debug_assert!(self.is_known(index), "{index:?} was evicted");
        &self.slots[index.slot()].node
    }

    fn node_mut(&mut self, index: NodeIndex) -> &mut TreeNode {
        debug_assert!(self.is_known(index), "{index:?} was evicted");
        &mut self.slots[index.slot()].node
    }

    /// Whether the node of `index` has not been evicted.
    pub fn is_known(&self, index: NodeIndex) -> bool {
        self.slots.get(index.slot()).is_some_and(|slot| slot.serial == Some(index.serial))
    }

    /// All known nodes.
    pub fn nodes(&self) -> impl Iterator<Item = &TreeNode> {
        self.slots.iter().filter(|slot| slot.serial.is_some()).map(|slot| &slot.node)
    }

    /// Number of known nodes.
    pub fn len(&self) -> usize {
        self.index.len()
    }

    /// Whether no node is known.
    pub fn is_empty(&self) -> bool {
        self.index.is_empty()
    }

    /// The most nodes that were known at once: all [`NodeIndex::slot`]s are below this.
    pub(crate) fn slots(&self) -> usize {
        self.slots.len()
    }

    /// Number of the node that became known last.
    pub(crate) fn last_serial(&self) -> NonZeroU32 {
        self.last_serial
    }

    /// State of the subtree below `root`.
    pub fn subtree(&self, root: TileId) -> TileRecord {
        self.subtrees.get(&root).copied().unwrap_or_default()
    }

    /// Cache pages of a node's V-BlockMap; an estimate until it has been decoded once.
    pub(crate) fn node_pages(&self, index: NodeIndex) -> u32 {
        let DecodedPages { pages, nodes } = self.decoded;
        let estimate = if nodes >= MIN_SAMPLES { pages.div_ceil(nodes) as u32 } else { DEFAULT_PAGES };
        self.node(index).pages.unwrap_or(estimate)
    }

    /// Cache pages of a tile; an estimate until it has been decoded once.
    pub(crate) fn tile_pages(&self, key: TileKey) -> u32 {
        let Some(index) = self.find(key.id) else { return DEFAULT_PAGES };
        match key.kind() {
            TileKind::Subtree | TileKind::Objects | TileKind::Visibility => 0,
            TileKind::BlockMap => self.node_pages(index),
            TileKind::Mesh => self.node(index).lods.get(usize::from(key.lod)).map_or(0, |lod| lod.pages),
        }
    }

    /// Length in bytes of a V-BlockMap or a mesh, as it is fetched, or an estimate of that of a subtree; `None` if it is unknown or does
    /// not exist.
    pub(crate) fn tile_bytes(&self, key: TileKey) -> Option<u32> {
        let node = self.node(self.find(key.id)?);
        match key.kind() {
            TileKind::BlockMap => Some(node.bytes),
            TileKind::Mesh => node.lods.get(usize::from(key.lod)).map(|lod| lod.bytes),
            TileKind::Subtree if node.child_mask != 0 => {
                let levels = self.manifest.depth.saturating_sub(key.id.level()).min(insula_protocol::subtree::LEVELS);
                Some(SUBTREE_LEAF_BYTES << (2 * levels))
            }
            _ => None,
        }
    }

    /// Whether an unknown node may exist: the subtree that would list it exists and is not resident.
    pub(crate) fn may_have_unlisted(&self, id: TileId) -> bool {
        let root = listing_subtree(id);
        self.find(id).is_none()
            && !self.subtree(root).is_resident()
            && (root == TileId::ROOT || self.find(root).is_some())
    }

    /// Records the cache pages of a decoded V-BlockMap or mesh.
    pub(crate) fn set_pages(&mut self, key: TileKey, pages: u32) {
        if key.kind() == TileKind::Mesh {
            if let Some(lod) = self.lod_mut(key) {
                lod.pages = pages;
            }
        } else if let Some(index) = self.find(key.id)
            && self.node_mut(index).pages.replace(pages).is_none()
        {
            self.decoded.pages += u64::from(pages);
            self.decoded.nodes += 1;
        }
    }

    fn lod_mut(&mut self, key: TileKey) -> Option<&mut LeafLod> {
        let index = self.find(key.id)?;
        self.node_mut(index).lods.get_mut(usize::from(key.lod))
    }

    /// State of a tile; `None` if its node or level of detail is unknown.
    pub fn tile(&self, key: TileKey) -> Option<TileRecord> {
        match key.kind() {
            TileKind::Subtree => Some(self.subtree(key.id)),
            TileKind::BlockMap => match self.find(key.id) {
                Some(index) => Some(self.node(index).tile),
                None => (key.id == TileId::ROOT).then_some(self.root_tile),
            },
            TileKind::Mesh => {
                let node = self.node(self.find(key.id)?);
                node.lods.get(usize::from(key.lod)).map(|lod| lod.tile)
            }
            TileKind::Objects => None,
            TileKind::Visibility => Some(self.visibility.state(key.id)),
        }
    }

    /// Applies an event to a tile. Returns `false`, and changes nothing, if the tile is unknown or the event has no meaning in its
    /// state.
    pub fn apply(&mut self, key: TileKey, event: TileEvent) -> bool {
        match key.kind() {
            TileKind::Subtree => {
                self.forget_loose_subtrees();
                self.subtrees.entry(key.id).or_default().apply(event)
            }
            TileKind::BlockMap => match self.find(key.id) {
                Some(index) => self.node_mut(index).tile.apply(event),
                None => key.id == TileId::ROOT && self.root_tile.apply(event),
            },
            TileKind::Mesh => self.lod_mut(key).is_some_and(|lod| lod.tile.apply(event)),
            TileKind::Objects => false,
            TileKind::Visibility => self.visibility.apply(key.id, event),
        }
    }

    /// South-west corner and side, in metres, of a node's area.
    pub(crate) fn corner_and_side(&self, id: TileId) -> ([f64; 3], f64) {
        (self.manifest.node_corner(id), self.manifest.node_side_m(id.level()))
    }

    /// Adds a subtree's nodes. Ignores nodes that are known, whose parent is unknown, or that are deeper than the manifest allows.
    pub fn merge(&mut self, subtree: &Subtree) {
        self.mark_listing_used(subtree);
        for info in &subtree.nodes {
            if info.id.level() > self.manifest.depth || self.index.contains_key(&info.id) {
                continue;
            }
            let parent = info.id.parent().and_then(|id| self.find(id));
            if info.id != TileId::ROOT && parent.is_none() {
                continue;
            }
            let node = TreeNode { parent, ..self.new_node(info) };
            let index = self.insert(node);
            self.memory.add_node(info.id, NODE_BYTES);
            if let Some(parent) = parent {
                self.node_mut(parent).children[info.id.quadrant()] = Some(index);
            }
        }
        let has_meshes = self.has_meshes;
        for mesh in subtree.meshes.iter().filter(|_| has_meshes) {
            let Some(index) = self.find(mesh.id) else { continue };
            let node = self.node_mut(index);
            if node.child_mask == 0 && node.lods.is_empty() {
                node.lods = mesh.lods.iter().map(LeafLod::new).collect();
                self.mesh_levels = self.mesh_levels.max(mesh.lods.len() as u8);
                self.memory.add_bytes(mesh.id, mesh.lods.len() * LOD_BYTES);
            }
        }
    }

    fn insert(&mut self, node: TreeNode) -> NodeIndex {
        self.last_serial = self.last_serial.checked_add(1).unwrap_or(NonZeroU32::MIN);
        let (id, serial) = (node.id, self.last_serial);
        let filled = NodeSlot { serial: Some(serial), node };
        let slot = match self.vacant.pop() {
            Some(slot) => {
                self.slots[slot as usize] = filled;
                slot
            }
            None => {
                self.slots.push(filled);
                self.slots.len() as u32 - 1
            }
        };
        let index = NodeIndex { slot, serial };
        self.index.insert(id, index);
        index
    }

    /// Removes a node without known children, and returns it.
    pub(super) fn remove(&mut self, id: TileId) -> Option<TreeNode> {
        let index = self.index.remove(&id)?;
        if let Some(parent) = self.node(index).parent {
            self.node_mut(parent).children[id.quadrant()] = None;
        }
        let slot = self.slots.get_mut(index.slot())?;
        slot.serial = None;
        let removed = slot.node.clone();
        (slot.node.parent, slot.node.children, slot.node.lods) = (None, [None; 4], Vec::new());
        self.vacant.push(index.slot);
        Some(removed)
    }

    /// A node without a parent.
    fn new_node(&self, info: &NodeInfo) -> TreeNode {
        let (corner, side_m) = self.corner_and_side(info.id);
        let (z_min_m, z_max_m) = (f64::from(info.z_min_m), f64::from(info.z_max_m));
        let centre = DVec3::from(corner) + DVec3::new(side_m * 0.5, side_m * 0.5, (z_min_m + z_max_m) * 0.5);
        let half = DVec3::new(side_m, side_m, z_max_m - z_min_m) * 0.5;
        let is_leaf = info.id.level() >= self.manifest.depth;
        TreeNode {
            id: info.id,
            centre,
            half,
            error_m: f64::from(info.error_m),
            radius_m: f64::from(info.radius_m),
            parent: None,
            child_mask: if is_leaf { 0 } else { info.child_mask },
            children: [None; 4],
            bytes: info.blockmap_bytes,
            pages: None,
            tile: if info.id == TileId::ROOT { self.root_tile } else { TileRecord::default() },
            lods: Vec::new(),
        }
    }
}
