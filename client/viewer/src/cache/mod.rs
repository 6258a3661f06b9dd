//! The tile cache: decoded tiles in the pages of an atlas of fixed size.
//!
//! In: [`PackedNode`]s and [`PackedMesh`]es, and which of them each frame uses. Out: [`CachedNode`]s and [`CachedMesh`]es, and words
//! for an [`Upload`]. Next: `frame` points the ray-caster at them.
//!
//! The memory is allocated once and never exceeded. Tiles that the present frame uses are pinned; of the others, the least
//! recently used is evicted first. The cache knows no GPU API.

mod additions;
mod pages;
#[cfg(test)]
pub(crate) mod tests;

use crate::objects::ObjectStyles;
use crate::scene::TileKey;
use crate::solids::{ColumnSolids, MeshSolids};
use additions::ResidentAdditions;
use insula_protocol::mesh::Mesh;
use insula_protocol::mesh_tile::LandmarkObject;
use insula_protocol::{BlockMap, TileId};
use insula_shaders::layout::{PAGE_WORDS, PLANES, SUMMARY_WORDS};
use insula_shaders::mesh::{LandmarkBounds, MeshTexture, PackError, PackedMesh};
use insula_shaders::pack::{PackedNode, PackedObjects, Page};
use insula_shaders::shore::Shore;
use lru::LruCache;
use pages::PagePool;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Size of an atlas page.
pub const PAGE_BYTES: u64 = PAGE_WORDS as u64 * 4;

/// Memory that the ray-caster reads.
pub trait Upload {
    fn write_page(&mut self, page: u32, words: &[u32]) {
        self.write_words(page * PAGE_WORDS as u32, words);
    }
    /// Writes some words of the atlas from word `at` on, within one page.
    fn write_words(&mut self, at: u32, words: &[u32]);
    fn write_summary(&mut self, slot: u32, words: &[u32; SUMMARY_WORDS]);
}

/// A resident V-BlockMap: where it lies, and what the ray-caster must know about it.
#[derive(Debug, Clone, PartialEq)]
pub struct CachedNode {
    /// Atlas pages, planes first.
    pub pages: Vec<u32>,
    pub slot: u32,
    pub cell_m: f32,
    /// Height of one height code.
    pub z_step_m: f32,
    /// Height of code 0 above the city's origin.
    pub z_base_m: f64,
    /// Lowest and highest point, in height codes.
    pub z_range: [f32; 2],
    /// By how much each quarter stays below the highest point
    /// ([`DrawNode::pages_and_quarters`](insula_shaders::layout::DrawNode::pages_and_quarters)).
    pub below: [u8; 4],
    /// The V-BlockMap's `z_shift`.
    pub z_shift: u32,
    /// Mean log2 of the luminances of its texels.
    pub albedo_log2: f32,
    /// Page of the objects' plane and first word of the palette; zeros without objects.
    pub object_page: u32,
    pub palette: u32,
}

/// A resident mesh.
#[derive(Debug, Clone, PartialEq)]
pub struct CachedMesh {
    pub head_page: u32,
    pub triangles: u32,
    /// Lowest and highest point above the city's origin, in metres.
    pub z_m: [f32; 2],
    /// Its landmarks, in metres from the leaf's corner and the city's origin.
    pub landmarks: Vec<LandmarkBounds>,
}

#[derive(Debug)]
struct CacheEntry {
    item: CacheItem,
    pages: Vec<u32>,
    slot: Option<u32>,
    /// First word of its palette.
    palette: Option<u32>,
    /// The last frame that pinned it.
    last_frame: u64,
}

#[derive(Debug)]
enum CacheItem {
    Node(CachedNode, ColumnSolids),
    Mesh(CachedMesh, MeshSolids),
}

/// A decoded tile, ready for the cache.
#[derive(Debug, Serialize, Deserialize)]
pub enum PackedTile {
    /// A node's V-BlockMap.
    Node(Box<PackedNode>, ColumnSolids),
    /// A leaf's mesh.
    Mesh(Box<PackedMesh>, MeshSolids),
}

impl PackedTile {
    /// Packs a decoded V-BlockMap.
    pub fn node(map: &BlockMap) -> Self {
        Self::Node(Box::new(PackedNode::new(map)), ColumnSolids::new(map))
    }

    /// Packs a decoded mesh with its texture, the objects of its triangles, and the landmarks among them. Fails if it cannot be drawn.
    pub fn mesh(
        mesh: &Mesh,
        texture: Option<&MeshTexture>,
        objects: &[u32],
        landmarks: &[LandmarkObject],
    ) -> Result<Self, PackError> {
        Ok(Self::Mesh(Box::new(PackedMesh::new(mesh, texture, objects, landmarks)?), MeshSolids::new(mesh)))
    }

    /// Content of its pages.
    pub fn pages(&self) -> &[Page] {
        match self {
            Self::Node(node, _) => &node.pages,
            Self::Mesh(mesh, _) => &mesh.pages,
        }
    }
}

/// Result of an insertion. Evicted tiles are listed least recently used first.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum InsertResult {
    /// The tile is resident.
    Inserted { evicted: Vec<TileKey> },
    /// The tile does not fit beside the pinned ones. What was evicted before that turned out stays evicted.
    Full { evicted: Vec<TileKey> },
}

/// Owner of the atlas.
#[derive(Debug)]
pub struct AtlasCache {
    entries: LruCache<TileKey, CacheEntry>,
    pages: PagePool,
    slots: PagePool,
    frame: u64,
    peak_pages: u32,
    /// How objects are drawn.
    styles: ObjectStyles,
    has_styles: bool,
    /// Whether a mesh with landmarks has been resident.
    has_landmarks: bool,
    /// Where the city seems to end in water, once its coarsest V-BlockMap has been resident.
    shore: Option<Shore>,
    /// The resident palettes: their objects, by their first words.
    palettes: BTreeMap<u32, Vec<u32>>,
    additions: ResidentAdditions,
}

/// Slots that tiles in `pages` pages can ever need: a V-BlockMap takes at least [`PLANES`] pages.
pub fn slots_for(pages: u32) -> u32 {
    (pages / PLANES as u32).max(1)
}

/// Pages that fit into `bytes` together with their summaries.
pub fn pages_for(bytes: u64) -> u32 {
    let bytes_per_page = PAGE_BYTES + (SUMMARY_WORDS as u64 * 4) / PLANES as u64;
    (bytes / bytes_per_page).min(u64::from(u32::MAX) / PAGE_WORDS as u64) as u32
}

impl AtlasCache {
    /// An empty cache of `pages` pages.
    pub fn new(pages: u32) -> Self {
        Self {
            entries: LruCache::unbounded(),
            pages: PagePool::new(pages),
            slots: PagePool::new(slots_for(pages)),
            frame: 1,
            peak_pages: 0,
            styles: ObjectStyles::default(),
            has_styles: false,
            has_landmarks: false,
            shore: None,
            palettes: BTreeMap::new(),
            additions: ResidentAdditions::default(),
        }
    }

    /// Starts a frame: nothing is pinned.
    pub fn begin_frame(&mut self) {
        self.frame += 1;
    }

    /// Pins a tile for this frame and makes it the most recently used one.
    pub fn pin(&mut self, key: TileKey) {
        if let Some(entry) = self.entries.get_mut(&key) {
            entry.last_frame = self.frame;
        }
    }

    /// Makes a tile the most recently used one without pinning it. To be called before this frame's [`AtlasCache::pin`]s.
    pub(crate) fn promote(&mut self, key: TileKey) {
        self.entries.promote(&key);
    }

    /// A node's V-BlockMap, if it is resident.
    pub fn get(&self, id: TileId) -> Option<&CachedNode> {
        match &self.entries.peek(&TileKey::block_map(id))?.item {
            CacheItem::Node(node, _) => Some(node),
            CacheItem::Mesh(..) => None,
        }
    }

    /// A level of detail of a leaf's mesh, if it is resident.
    pub fn mesh(&self, id: TileId, lod: u8) -> Option<&CachedMesh> {
        match &self.entries.peek(&TileKey::mesh(id, lod))?.item {
            CacheItem::Mesh(mesh, _) => Some(mesh),
            CacheItem::Node(..) => None,
        }
    }

    /// The shapes of a node's columns, if its V-BlockMap is resident.
    pub(crate) fn column_solids(&self, id: TileId) -> Option<&ColumnSolids> {
        match &self.entries.peek(&TileKey::block_map(id))?.item {
            CacheItem::Node(_, solids) => Some(solids),
            CacheItem::Mesh(..) => None,
        }
    }

    /// The shapes of a level of detail of a leaf's mesh, if it is resident.
    pub(crate) fn mesh_solids(&self, id: TileId, lod: u8) -> Option<&MeshSolids> {
        match &self.entries.peek(&TileKey::mesh(id, lod))?.item {
            CacheItem::Mesh(_, solids) => Some(solids),
            CacheItem::Node(..) => None,
        }
    }

    /// Where the city seems to end in water. Its manifest may know better: [`SceneTree::shore`](crate::scene::SceneTree::shore).
    pub(crate) fn shore(&self) -> Option<&Shore> {
        self.shore.as_ref()
    }

    /// Inserts a tile, evicting the least recently used tiles that are not pinned. Replaces a tile with the same key.
    pub fn insert(&mut self, key: TileKey, packed: PackedTile, upload: &mut impl Upload) -> InsertResult {
        self.remove(key);
        let needed_pages = packed.pages().len() as u32;
        let needed_slots = u32::from(matches!(packed, PackedTile::Node(..)));
        let mut evicted = Vec::new();
        while self.pages.free() < needed_pages || self.slots.free() < needed_slots {
            match self.evict() {
                Some(key) => evicted.push(key),
                None => return InsertResult::Full { evicted },
            }
        }
        let (Some(pages), Some(slot)) = (self.pages.take(needed_pages), self.slots.take(needed_slots)) else {
            return InsertResult::Full { evicted };
        };
        let slot = slot.first().copied();
        let (item, objects) = match packed {
            PackedTile::Node(mut node, solids) => {
                if key == TileKey::block_map(TileId::ROOT) {
                    self.shore = Shore::of(&node);
                }
                node.relocate(&pages);
                let objects = node.objects.take();
                let palette = objects.as_ref().map_or(0, |objects| objects.palette);
                let cached = upload_node(*node, &pages, slot.unwrap_or(0), palette, upload);
                (CacheItem::Node(cached, solids), objects)
            }
            PackedTile::Mesh(mut mesh, solids) => {
                mesh.relocate(&pages);
                self.has_landmarks |= !mesh.landmarks.is_empty();
                let objects = mesh.objects.take();
                (CacheItem::Mesh(upload_mesh(*mesh, &pages, upload), solids), objects)
            }
        };
        let palette = self.keep_palette(objects, upload);
        self.entries.put(key, CacheEntry { item, pages, slot, palette, last_frame: self.frame });
        self.peak_pages = self.peak_pages.max(self.pages.used());
        InsertResult::Inserted { evicted }
    }

    /// Keeps the objects of a tile or addition whose pages were written. Returns the first word of its palette, if it has one.
    fn keep_palette(&mut self, objects: Option<PackedObjects>, upload: &mut impl Upload) -> Option<u32> {
        let PackedObjects { list, palette } = objects?;
        if self.has_styles {
            upload.write_words(palette, &self.styles.words(&list));
        }
        self.palettes.insert(palette, list);
        Some(palette)
    }

    /// The object whose word in a palette has this address, as a frame with [`Shading::Objects`] gives it.
    ///
    /// [`Shading::Objects`]: insula_shaders::layout::Shading::Objects
    pub fn object_at(&self, address: u32) -> Option<u32> {
        let (first, list) = self.palettes.range(..=address).next_back()?;
        list.get((address - first) as usize).copied()
    }

    /// Whether any object is drawn in another way than by its own colours.
    pub(crate) fn has_styles(&self) -> bool {
        self.has_styles
    }

    /// Whether frames read what the triangles of landmarks carry.
    pub(crate) fn has_landmarks(&self) -> bool {
        self.has_landmarks
    }

    /// How objects are drawn.
    pub fn styles(&self) -> &ObjectStyles {
        &self.styles
    }

    /// Draws objects in another way from the next frame on. No tile is fetched or packed again.
    pub fn set_styles(&mut self, styles: ObjectStyles, upload: &mut impl Upload) {
        for (palette, list) in &self.palettes {
            upload.write_words(*palette, &styles.words(list));
        }
        self.has_styles = !styles.is_empty();
        self.styles = styles;
    }

    /// Evicts the least recently used tile; `None` if even that is pinned.
    fn evict(&mut self) -> Option<TileKey> {
        let (key, entry) = self.entries.peek_lru()?;
        let key = *key;
        if entry.last_frame >= self.frame {
            return None;
        }
        self.remove(key);
        Some(key)
    }

    /// Removes a tile.
    pub fn remove(&mut self, key: TileKey) {
        if let Some(entry) = self.entries.pop(&key) {
            if let Some(palette) = entry.palette {
                self.palettes.remove(&palette);
            }
            self.pages.give_back(entry.pages);
            self.slots.give_back(entry.slot);
        }
    }

    /// Has at least `pages` pages from now on. What is resident stays.
    pub fn grow(&mut self, pages: u32) {
        self.pages.grow(pages);
        self.slots.grow(slots_for(pages));
    }

    /// Number of resident tiles.
    pub fn tile_count(&self) -> usize {
        self.entries.len()
    }

    /// Number of pages, free or not.
    pub fn capacity_pages(&self) -> u32 {
        self.pages.count()
    }

    pub(crate) fn free_pages(&self) -> u32 {
        self.pages.free()
    }

    /// Bytes of the pages that are in use.
    pub fn used_bytes(&self) -> u64 {
        u64::from(self.pages.used()) * PAGE_BYTES
    }

    /// Most bytes of pages that were ever in use at once.
    pub fn peak_bytes(&self) -> u64 {
        u64::from(self.peak_pages) * PAGE_BYTES
    }
}

fn upload_node(node: PackedNode, pages: &[u32], slot: u32, palette: u32, upload: &mut impl Upload) -> CachedNode {
    write_pages(&node.pages, pages, upload);
    upload.write_summary(slot, &node.summary);
    let PackedNode { cell_m, z_step_m, z_base_m, z_range, below, z_shift, albedo_log2, .. } = node;
    let object_page = if palette == 0 { 0 } else { pages.last().copied().unwrap_or(0) };
    let pages = pages.to_vec();
    CachedNode { pages, slot, cell_m, z_step_m, z_base_m, z_range, below, z_shift, albedo_log2, object_page, palette }
}

fn upload_mesh(mesh: PackedMesh, pages: &[u32], upload: &mut impl Upload) -> CachedMesh {
    write_pages(&mesh.pages, pages, upload);
    let head_page = pages.first().copied().unwrap_or(0);
    CachedMesh { head_page, triangles: mesh.triangles, z_m: mesh.z_m, landmarks: mesh.landmarks }
}

fn write_pages(words: &[Page], pages: &[u32], upload: &mut impl Upload) {
    for (page, words) in pages.iter().zip(words) {
        upload.write_page(*page, words);
    }
}
