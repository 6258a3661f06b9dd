//! The atlas: decoded nodes in a fixed number of bytes.
//!
//! In: [`PackedNode`]s and [`PackedMesh`]es, which of them each frame uses. Out: [`CachedNode`] nodes and [`CachedMesh`]es, words
//! handed to an [`Upload`]. Next: `render::frame` points the ray-caster at them.
//!
//! The memory is taken once and never exceeded. Least recently used goes first; what the current frame uses (the cut and
//! its ancestors) is pinned. Knows no wgpu: tests use a fake, the CPU ray-caster a vector.

mod pages;

use crate::scene::TileKey;
use insula_protocol::TileId;
use insula_shaders::{
    layout::{PAGE_WORDS, PLANES, SUMMARY_WORDS},
    mesh::PackedMesh,
    pack::{PackedNode, Page},
};
use lru::LruCache;
use pages::PagePool;

/// Bytes of a page.
pub const PAGE_BYTES: u64 = PAGE_WORDS as u64 * 4;

/// Where the words go.
pub trait Upload {
    /// Writes one page of the atlas.
    fn write_page(&mut self, page: u32, words: &[u32]);
    /// Writes one node's summary.
    fn write_summary(&mut self, slot: u32, words: &[u32; SUMMARY_WORDS]);
}

/// A resident node: where it is, and what the ray-caster must know of it.
#[derive(Debug, Clone, PartialEq)]
pub struct CachedNode {
    /// Atlas pages, planes first.
    pub pages: Vec<u32>,
    /// Place of its summary.
    pub slot: u32,
    /// Side of a column.
    pub cell_m: f32,
    /// Metres of a height code.
    pub z_step_m: f32,
    /// Height of code 0 above the city's origin.
    pub z_base_m: f64,
    /// Lowest and highest point in codes.
    pub z_range: [f32; 2],
    /// How far quarters lie below that ([`Node::pages_and_quarters`](insula_shaders::layout::Node::pages_and_quarters)).
    pub below: [u8; 4],
    /// The map's `z_shift`.
    pub z_shift: u32,
}

/// A resident mesh.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CachedMesh {
    /// Page that its head is in.
    pub head_page: u32,
    /// Triangles.
    pub triangles: u32,
    /// Lowest and highest point, metres above the city's height zero.
    pub z_m: [f32; 2],
}

/// What is resident under a key.
#[derive(Debug)]
struct CacheEntry {
    what: CacheItem,
    pages: Vec<u32>,
    slot: Option<u32>,
    last_frame: u64,
}

#[derive(Debug)]
enum CacheItem {
    Node(CachedNode),
    Mesh(CachedMesh),
}

/// Something decoded that is to be placed.
#[derive(Debug)]
pub enum PackedTile {
    /// A node's V-BlockMap.
    Node(Box<PackedNode>),
    /// A leaf's mesh.
    Mesh(Box<PackedMesh>),
}

impl PackedTile {
    /// Pages that it takes.
    pub fn pages(&self) -> &[Page] {
        match self {
            Self::Node(node) => &node.pages,
            Self::Mesh(mesh) => &mesh.pages,
        }
    }
}

/// What became of something that was to be placed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum InsertResult {
    /// It is in; these had to go.
    Inserted {
        /// Least recently used first.
        evicted: Vec<TileKey>,
    },
    /// Everything that could go is in use: it is not in. What had gone before that was known is gone.
    Full {
        /// Least recently used first.
        evicted: Vec<TileKey>,
    },
}

/// The atlas's owner.
#[derive(Debug)]
pub struct AtlasCache {
    entries: LruCache<TileKey, CacheEntry>,
    pages: PagePool,
    slots: PagePool,
    frame: u64,
    peak_pages: u32,
}

/// Slots that `pages` pages can ever need: a node takes [`PLANES`] at least.
pub const fn slots_for(pages: u32) -> u32 {
    let slots = pages / PLANES as u32;
    if slots == 0 { 1 } else { slots }
}

/// Pages that fit `bytes`, summaries included.
pub const fn pages_for(bytes: u64) -> u32 {
    let per_page = PAGE_BYTES + (SUMMARY_WORDS as u64 * 4) / PLANES as u64;
    let pages = bytes / per_page;
    if pages > u32::MAX as u64 / PAGE_WORDS as u64 { u32::MAX / PAGE_WORDS as u32 } else { pages as u32 }
}

impl AtlasCache {
    /// Empty, with room for `pages` pages.
    pub fn new(pages: u32) -> Self {
        Self {
            entries: LruCache::unbounded(),
            pages: PagePool::new(pages),
            slots: PagePool::new(slots_for(pages)),
            frame: 1,
            peak_pages: 0,
        }
    }

    /// A new frame: nothing is pinned until it is used.
    pub fn begin_frame(&mut self) {
        self.frame += 1;
    }

    /// Pins `key` for this frame. Touch what may go first among equals first.
    pub fn pin(&mut self, key: TileKey) {
        if let Some(entry) = self.entries.get_mut(&key) {
            entry.last_frame = self.frame;
        }
    }

    /// `key` goes last of what is not pinned. To be called before this frame's [`AtlasCache::pin`]es.
    pub fn promote(&mut self, key: TileKey) {
        self.entries.promote(&key);
    }

    /// A resident node.
    pub fn get(&self, id: TileId) -> Option<&CachedNode> {
        match &self.entries.peek(&TileKey::block_map(id))?.what {
            CacheItem::Node(placed) => Some(placed),
            CacheItem::Mesh(_) => None,
        }
    }

    /// A resident mesh.
    pub fn mesh(&self, id: TileId, lod: u8) -> Option<&CachedMesh> {
        match &self.entries.peek(&TileKey::mesh(id, lod))?.what {
            CacheItem::Mesh(placed) => Some(placed),
            CacheItem::Node(_) => None,
        }
    }

    /// Puts something in, evicting what is least recently used and not pinned. What is in already is placed anew.
    pub fn insert(&mut self, key: TileKey, packed: PackedTile, upload: &mut impl Upload) -> InsertResult {
        self.remove(key);
        let wanted = packed.pages().len() as u32;
        let slots = u32::from(matches!(packed, PackedTile::Node(_)));
        let mut evicted = Vec::new();
        while self.pages.free() < wanted || self.slots.free() < slots {
            match self.evict() {
                Some(key) => evicted.push(key),
                None => return InsertResult::Full { evicted },
            }
        }
        let (Some(pages), Some(slot)) = (self.pages.take(wanted), self.slots.take(slots)) else {
            return InsertResult::Full { evicted };
        };
        let slot = slot.first().copied();
        let what = match packed {
            PackedTile::Node(node) => CacheItem::Node(place_node(*node, &pages, slot.unwrap_or(0), upload)),
            PackedTile::Mesh(mesh) => CacheItem::Mesh(place_mesh(*mesh, &pages, upload)),
        };
        self.entries.put(key, CacheEntry { what, pages, slot, last_frame: self.frame });
        self.peak_pages = self.peak_pages.max(self.pages.used());
        InsertResult::Inserted { evicted }
    }

    fn evict(&mut self) -> Option<TileKey> {
        let (key, entry) = self.entries.peek_lru()?;
        let key = *key;
        if entry.last_frame >= self.frame {
            return None;
        }
        self.remove(key);
        Some(key)
    }

    /// Takes something out.
    pub fn remove(&mut self, key: TileKey) {
        if let Some(entry) = self.entries.pop(&key) {
            self.pages.give(entry.pages);
            self.slots.give(entry.slot);
        }
    }

    /// Resident nodes and meshes.
    pub fn len(&self) -> usize {
        self.entries.len()
    }

    /// Whether nothing is resident.
    pub fn is_empty(&self) -> bool {
        self.entries.is_empty()
    }

    /// Pages in all.
    pub fn capacity_pages(&self) -> u32 {
        self.pages.count()
    }

    /// Pages that nobody owns.
    pub fn free_pages(&self) -> u32 {
        self.pages.free()
    }

    /// Bytes that nodes take now.
    pub fn used_bytes(&self) -> u64 {
        u64::from(self.pages.used()) * PAGE_BYTES
    }

    /// Most bytes that nodes ever took.
    pub fn peak_bytes(&self) -> u64 {
        u64::from(self.peak_pages) * PAGE_BYTES
    }
}

fn place_node(mut node: PackedNode, pages: &[u32], slot: u32, upload: &mut impl Upload) -> CachedNode {
    node.relocate(pages);
    write(&node.pages, pages, upload);
    upload.write_summary(slot, &node.summary);
    let PackedNode { cell_m, z_step_m, z_base_m, z_range, below, z_shift, .. } = node;
    CachedNode { pages: pages.to_vec(), slot, cell_m, z_step_m, z_base_m, z_range, below, z_shift }
}

fn place_mesh(mut mesh: PackedMesh, pages: &[u32], upload: &mut impl Upload) -> CachedMesh {
    mesh.relocate(pages);
    write(&mesh.pages, pages, upload);
    let head_page = pages.first().copied().unwrap_or(0);
    CachedMesh { head_page, triangles: mesh.triangles, z_m: mesh.z_m }
}

fn write(words: &[Page], pages: &[u32], upload: &mut impl Upload) {
    for (page, words) in pages.iter().zip(words) {
        upload.write_page(*page, words);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_protocol::{
        BlockMap, Texel,
        blockmap::{COLUMNS, Column, Strip, strip_rows},
        mesh::{Attribute, Grid, Kind, Mesh},
    };
    use std::collections::HashMap;

    /// Remembers what was written where; every page that a node names must hold that node's words.
    #[derive(Default)]
    struct Fake {
        pages: HashMap<u32, Vec<u32>>,
        summaries: HashMap<u32, [u32; SUMMARY_WORDS]>,
    }

    impl Upload for Fake {
        fn write_page(&mut self, page: u32, words: &[u32]) {
            assert_eq!(words.len(), PAGE_WORDS);
            self.pages.insert(page, words.to_vec());
        }
        fn write_summary(&mut self, slot: u32, words: &[u32; SUMMARY_WORDS]) {
            self.summaries.insert(slot, *words);
        }
    }

    /// No page or slot has two owners, none is lost, none lies outside.
    fn assert_no_leak(cache: &AtlasCache) {
        let mut pages: Vec<u32> = cache.entries.iter().flat_map(|(_, n)| n.pages.clone()).collect();
        let mut slots: Vec<u32> = cache.entries.iter().filter_map(|(_, n)| n.slot).collect();
        assert_eq!(pages.len() as u32, cache.pages.used());
        assert_eq!(slots.len() as u32, cache.slots.used());
        for numbers in [&mut pages, &mut slots] {
            let len = numbers.len();
            numbers.sort_unstable();
            numbers.dedup();
            assert_eq!(numbers.len(), len, "two owners");
        }
        assert!(pages.last().is_none_or(|p| *p < cache.capacity_pages()));
    }

    fn id(x: u32) -> TileKey {
        TileKey::block_map(TileId::new(10, x, 0).unwrap())
    }

    /// A mesh that takes `pages` pages.
    fn mesh(pages: u32) -> PackedTile {
        let colour = Attribute {
            kind: Kind::Colour,
            components: 3,
            bits: 8,
            range: [0.0, 1.0],
            values: vec![[1, 2, 3, 0]],
            corners: vec![0; 3],
        };
        let grid = Grid { min: [0.0; 3], step: 1.0, bits: 8 };
        let triangle = Mesh {
            grid,
            positions: vec![[0; 3], [9, 0, 0], [0, 9, 0]],
            triangles: vec![[0, 1, 2]],
            attributes: vec![colour],
        };
        let mut packed = PackedMesh::new(&triangle, None).unwrap();
        packed.pages.resize(pages as usize, vec![0; PAGE_WORDS].into());
        PackedTile::Mesh(Box::new(packed))
    }

    /// A node of `PLANES + strip_pages` pages whose roofs say `mark`.
    fn node(mark: u8, strip_pages: usize) -> PackedTile {
        let mut columns = vec![None; COLUMNS];
        for i in 0..strip_pages {
            let rows = strip_rows(0, 4095, 4).1;
            let texels = vec![Texel::new([mark; 3], 63, 3); usize::from(rows)];
            let strip = Some(Strip { texels, azimuth: 0 });
            columns[i] = Some(Column { z_max: 4095, strip, roof: Texel::new([mark; 3], 0, 3), ..Column::default() });
        }
        columns[100] = Some(Column { z_max: 7, roof: Texel::new([mark; 3], 0, 3), ..Column::default() });
        let map = BlockMap::from_columns(TileId::ROOT, 1.0, 0, 4, &columns).unwrap();
        PackedTile::Node(Box::new(PackedNode::new(&map)))
    }

    fn mark_of(cache: &AtlasCache, fake: &Fake, key: TileKey) -> Option<u8> {
        let placed = cache.get(key.id)?;
        Some(Texel(fake.pages[&placed.pages[1]][100]).rgb()[0])
    }

    #[test]
    fn least_recently_used_goes_first_and_the_frame_s_nodes_stay() {
        let (mut cache, mut fake) = (AtlasCache::new(16), Fake::default());
        for x in 0..4 {
            assert_eq!(cache.insert(id(x), node(x as u8, 0), &mut fake), InsertResult::Inserted { evicted: vec![] });
        }
        assert_no_leak(&cache);
        cache.begin_frame();
        cache.pin(id(0));
        assert_eq!(cache.insert(id(9), node(9, 0), &mut fake), InsertResult::Inserted { evicted: vec![id(1)] });
        assert_eq!(mark_of(&cache, &fake, id(0)), Some(0));
        assert_eq!(mark_of(&cache, &fake, id(9)), Some(9));
        [id(2), id(3)].into_iter().for_each(|id| cache.pin(id));
        assert_eq!(cache.insert(id(5), node(5, 0), &mut fake), InsertResult::Full { evicted: vec![] });
        assert_no_leak(&cache);
    }

    #[test]
    fn what_is_kept_goes_last_but_goes() {
        let (mut cache, mut fake) = (AtlasCache::new(16), Fake::default());
        (0..4)
            .for_each(|x| assert!(matches!(cache.insert(id(x), node(1, 0), &mut fake), InsertResult::Inserted { .. })));
        cache.begin_frame();
        cache.promote(id(0));
        cache.pin(id(3));
        for gone in [1, 2, 0] {
            assert_eq!(
                cache.insert(id(10 + gone), node(1, 0), &mut fake),
                InsertResult::Inserted { evicted: vec![id(gone)] }
            );
        }
        assert_eq!(cache.insert(id(20), node(1, 0), &mut fake), InsertResult::Full { evicted: vec![] });
        assert_no_leak(&cache);
    }

    #[test]
    fn meshes_and_nodes_share_the_pages() {
        let (mut cache, mut fake) = (AtlasCache::new(16), Fake::default());
        let of = |x: u32, lod: u8| TileKey::mesh(id(x).id, lod);
        cache.insert(id(0), node(7, 0), &mut fake);
        assert_eq!(cache.insert(of(0, 1), mesh(5), &mut fake), InsertResult::Inserted { evicted: vec![] });
        assert_eq!(cache.insert(of(0, 0), mesh(7), &mut fake), InsertResult::Inserted { evicted: vec![] });
        assert!(cache.mesh(id(0).id, 0).is_some() && cache.mesh(id(0).id, 2).is_none());
        assert_eq!(mark_of(&cache, &fake, id(0)), Some(7));
        cache.begin_frame();
        cache.pin(of(0, 1));
        assert_eq!(cache.insert(of(1, 0), mesh(3), &mut fake), InsertResult::Inserted { evicted: vec![id(0)] });
        assert_eq!(cache.insert(of(1, 1), mesh(9), &mut fake), InsertResult::Full { evicted: vec![of(0, 0)] });
        assert_no_leak(&cache);
        assert_eq!(cache.free_pages(), 8);
    }

    #[test]
    fn a_thousand_frames_leak_nothing_and_never_exceed() {
        let (mut cache, mut fake) = (AtlasCache::new(37), Fake::default());
        let mut marks: HashMap<TileKey, u8> = HashMap::new();
        for frame in 0..1000u32 {
            cache.begin_frame();
            let r = |k: u32| frame.wrapping_mul(2_654_435_761).rotate_left(k) >> 7;
            (0..3).for_each(|k| cache.pin(id(r(k) % 20)));
            let (at, mark) = (id(r(5) % 20), (frame % 251) as u8);
            match cache.insert(at, node(mark, (r(9) % 3) as usize), &mut fake) {
                InsertResult::Inserted { evicted } => {
                    evicted.iter().for_each(|id| assert!(marks.remove(id).is_some() && cache.get(id.id).is_none()));
                    marks.insert(at, mark);
                }
                InsertResult::Full { .. } => panic!("three of at most five pages are pinned"),
            }
            assert_no_leak(&cache);
            for (id, mark) in &marks {
                assert_eq!(mark_of(&cache, &fake, *id), Some(*mark), "frame {frame}");
            }
            assert_eq!(marks.len(), cache.len());
        }
        assert!(cache.peak_bytes() <= 37 * PAGE_BYTES && cache.peak_bytes() > 30 * PAGE_BYTES);
    }

    #[test]
    fn sizes() {
        let mib = 1 << 20;
        assert!(u64::from(pages_for(256 * mib)) * PAGE_BYTES <= 256 * mib);
        assert!(pages_for(256 * mib) > 16_000);
        assert_eq!(slots_for(37), 9);
    }
}
