//! The nodes that subtrees told of, in one array, with their tiles' states.
//!
//! In: a manifest, [`Subtree`]s, [`TileEvent`]s. Out: [`SceneTree`]. Next: `select` walks it.

use super::tile::{TileEvent, TileRecord};
use glam::DVec3;
use insula_protocol::{
    Manifest, Subtree, TileId,
    route::Layer,
    subtree::{MeshLod, NodeInfo},
};
use insula_shaders::mesh::pages_guess;
use std::collections::HashMap;

/// Pages that a node is thought to take until it has been decoded once.
const PAGES_GUESS: u32 = 6;

/// Place of a node in [`SceneTree::nodes`]; stays valid for good.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct NodeIndex(pub u32);

/// Names anything that can be fetched.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct TileKey {
    /// V-BlockMap, subtree or mesh, as 0, 1 or 2 (so that keys have an order).
    kind: u8,
    /// Which node.
    pub id: TileId,
    /// Which of a mesh's levels of detail, 0 the finest; else 0.
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

    /// The archive it comes from.
    pub const fn layer(self) -> Layer {
        match self.kind {
            0 => Layer::BlockMaps,
            1 => Layer::Subtrees,
            _ => Layer::Meshes,
        }
    }
}

/// One known node. Lengths in metres, world coordinates.
#[derive(Debug, Clone, PartialEq)]
pub struct TreeNode {
    /// Which.
    pub id: TileId,
    /// Middle of its box.
    pub centre: DVec3,
    /// Half of its box's sides.
    pub half: DVec3,
    /// World error.
    pub error_m: f64,
    /// Radius around `centre`; the sphere holds the children's.
    pub radius_m: f64,
    /// The node that it is a quarter of.
    pub parent: Option<NodeIndex>,
    /// Which children exist.
    pub child_mask: u8,
    /// Where they are, once a subtree told of them.
    pub children: [Option<NodeIndex>; 4],
    /// Bytes of its V-BlockMap on the wire.
    pub bytes: u32,
    /// Pages it takes, once decoded.
    pub pages: Option<u32>,
    /// Its V-BlockMap.
    pub tile: TileRecord,
    /// Its mesh, the finest level of detail first; only leaves have one.
    pub lods: Vec<LeafLod>,
}

/// One level of detail of a leaf's mesh.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LeafLod {
    /// World error.
    pub error_m: f64,
    /// Bytes on the wire.
    pub bytes: u32,
    /// Triangles.
    pub triangles: u32,
    /// Pages it takes, or is thought to.
    pub pages: u32,
    /// Its tile.
    pub tile: TileRecord,
}

impl LeafLod {
    fn new(lod: &MeshLod) -> Self {
        let MeshLod { error_m, bytes, triangles, texture_px } = *lod;
        let pages = pages_guess(triangles, texture_px);
        Self { error_m: f64::from(error_m), bytes, triangles, pages, tile: TileRecord::default() }
    }
}

/// Everything known of one city's nodes.
#[derive(Debug, Clone)]
pub struct SceneTree {
    manifest: Manifest,
    nodes: Vec<TreeNode>,
    /// The root's V-BlockMap until the root is known: it may come before its subtree.
    root_tile: TileRecord,
    index: HashMap<TileId, NodeIndex>,
    subtrees: HashMap<TileId, TileRecord>,
    pages_seen: (u64, u64),
    /// Whether leaves' meshes count.
    meshes: bool,
}

impl SceneTree {
    /// Knows nothing but the manifest (which [`Manifest::check`] has passed).
    pub fn new(manifest: Manifest) -> Self {
        Self {
            manifest,
            nodes: Vec::new(),
            root_tile: TileRecord::default(),
            index: HashMap::new(),
            subtrees: HashMap::new(),
            pages_seen: (0, 0),
            meshes: true,
        }
    }

    /// The same, which knows of meshes or does not.
    pub fn with_meshes(self, meshes: bool) -> Self {
        Self { meshes, ..self }
    }

    /// The city.
    pub fn manifest(&self) -> &Manifest {
        &self.manifest
    }

    /// The root, once its subtree is here.
    pub fn root(&self) -> Option<NodeIndex> {
        self.find(TileId::ROOT)
    }

    /// Where `id` is.
    pub fn find(&self, id: TileId) -> Option<NodeIndex> {
        self.index.get(&id).copied()
    }

    /// A node.
    pub fn node(&self, at: NodeIndex) -> &TreeNode {
        &self.nodes[at.0 as usize]
    }

    /// All known nodes.
    pub fn nodes(&self) -> &[TreeNode] {
        &self.nodes
    }

    /// State of a subtree tile.
    pub fn subtree(&self, root: TileId) -> TileRecord {
        self.subtrees.get(&root).copied().unwrap_or_default()
    }

    /// Pages that a node takes, or is thought to.
    pub fn node_pages(&self, at: NodeIndex) -> u32 {
        let (pages, nodes) = self.pages_seen;
        let guess = if nodes >= 8 { pages.div_ceil(nodes) as u32 } else { PAGES_GUESS };
        self.node(at).pages.unwrap_or(guess)
    }

    /// Pages that a tile takes, or is thought to.
    pub fn tile_pages(&self, key: TileKey) -> u32 {
        let Some(at) = self.find(key.id) else { return PAGES_GUESS };
        match key.layer() {
            Layer::Subtrees => 0,
            Layer::BlockMaps => self.node_pages(at),
            Layer::Meshes => self.node(at).lods.get(usize::from(key.lod)).map_or(0, |lod| lod.pages),
        }
    }

    /// Remembers how many pages a node takes.
    pub fn set_pages(&mut self, id: TileId, pages: u32) {
        if let Some(at) = self.find(id)
            && self.nodes[at.0 as usize].pages.replace(pages).is_none()
        {
            self.pages_seen.0 += u64::from(pages);
            self.pages_seen.1 += 1;
        }
    }

    /// Remembers how many pages a mesh takes.
    pub fn set_mesh_pages(&mut self, key: TileKey, pages: u32) {
        if let Some(lod) = self.lod_mut(key) {
            lod.pages = pages;
        }
    }

    fn lod_mut(&mut self, key: TileKey) -> Option<&mut LeafLod> {
        let at = self.find(key.id)?;
        self.nodes[at.0 as usize].lods.get_mut(usize::from(key.lod))
    }

    /// State of anything.
    pub fn tile(&self, key: TileKey) -> Option<TileRecord> {
        match key.layer() {
            Layer::Subtrees => Some(self.subtree(key.id)),
            Layer::BlockMaps => match self.find(key.id) {
                Some(at) => Some(self.node(at).tile),
                None => (key.id == TileId::ROOT).then_some(self.root_tile),
            },
            Layer::Meshes => {
                let node = self.node(self.find(key.id)?);
                node.lods.get(usize::from(key.lod)).map(|lod| lod.tile)
            }
        }
    }

    /// Hands an event to a tile; `false` if it means nothing there.
    pub fn apply(&mut self, key: TileKey, event: TileEvent) -> bool {
        match key.layer() {
            Layer::Subtrees => self.subtrees.entry(key.id).or_default().apply(event),
            Layer::BlockMaps => match self.find(key.id) {
                Some(at) => self.nodes[at.0 as usize].tile.apply(event),
                None => key.id == TileId::ROOT && self.root_tile.apply(event),
            },
            Layer::Meshes => self.lod_mut(key).is_some_and(|lod| lod.tile.apply(event)),
        }
    }

    /// South-west corner and side of a node's square.
    pub fn corner_and_side(&self, id: TileId) -> ([f64; 3], f64) {
        (self.manifest.node_corner(id), self.manifest.node_side_m(id.level()))
    }

    /// Adds a subtree's nodes. Nodes deeper than the manifest says are left out.
    pub fn merge(&mut self, subtree: &Subtree) {
        for info in &subtree.nodes {
            if info.id.level() > self.manifest.depth || self.index.contains_key(&info.id) {
                continue;
            }
            let parent = info.id.parent().and_then(|id| self.find(id));
            if info.id != TileId::ROOT && parent.is_none() {
                continue;
            }
            let at = NodeIndex(self.nodes.len() as u32);
            let node = TreeNode { parent, ..self.make(info) };
            self.nodes.push(node);
            self.index.insert(info.id, at);
            if let Some(parent) = parent {
                self.nodes[parent.0 as usize].children[info.id.quadrant()] = Some(at);
            }
        }
        for mesh in subtree.meshes.iter().filter(|_| self.meshes) {
            let Some(at) = self.find(mesh.id) else { continue };
            let node = &mut self.nodes[at.0 as usize];
            if node.child_mask == 0 && node.lods.is_empty() {
                node.lods = mesh.lods.iter().map(LeafLod::new).collect();
            }
        }
    }

    fn make(&self, info: &NodeInfo) -> TreeNode {
        let (corner, side_m) = self.corner_and_side(info.id);
        let (z_min_m, z_max_m) = (f64::from(info.z_min_m), f64::from(info.z_max_m));
        let centre = DVec3::from(corner) + DVec3::new(side_m * 0.5, side_m * 0.5, (z_min_m + z_max_m) * 0.5);
        let half = DVec3::new(side_m, side_m, z_max_m - z_min_m) * 0.5;
        let leaf = info.id.level() >= self.manifest.depth;
        TreeNode {
            id: info.id,
            centre,
            half,
            error_m: f64::from(info.error_m),
            radius_m: f64::from(info.radius_m),
            parent: None,
            child_mask: if leaf { 0 } else { info.child_mask },
            children: [None; 4],
            bytes: info.blockmap_bytes,
            pages: None,
            tile: if info.id == TileId::ROOT { self.root_tile } else { TileRecord::default() },
            lods: Vec::new(),
        }
    }
}
