//! The cache with an atlas in plain memory.

use super::*;
use crate::additions::{AddedObject, AdditionError, FIRST_ADDED, pack};
use glam::DVec3;
use insula_protocol::blockmap::{COLUMNS, MapColumn, WallStrip, strip_rows};
use insula_protocol::mesh::{Attribute, Mesh, PositionGrid};
use insula_protocol::{BlockMap, Texel};
use std::collections::HashMap;

/// Keeps nothing.
pub(crate) struct NoAtlas;

impl Upload for NoAtlas {
    fn write_words(&mut self, _: u32, _: &[u32]) {}
    fn write_summary(&mut self, _: u32, _: &[u32; SUMMARY_WORDS]) {}
}

/// Stores what is written to the atlas.
#[derive(Default)]
struct FakeAtlas {
    pages: HashMap<u32, Vec<u32>>,
}

impl Upload for FakeAtlas {
    fn write_page(&mut self, page: u32, words: &[u32]) {
        assert_eq!(words.len(), PAGE_WORDS);
        self.pages.insert(page, words.to_vec());
    }

    fn write_words(&mut self, at: u32, words: &[u32]) {
        let (page, first) = (at / PAGE_WORDS as u32, at as usize % PAGE_WORDS);
        self.pages.get_mut(&page).unwrap()[first..first + words.len()].copy_from_slice(words);
    }

    fn write_summary(&mut self, _: u32, _: &[u32; SUMMARY_WORDS]) {}
}

/// No page or slot has two owners, none is lost, and none is outside of the atlas.
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

fn mesh(pages: u32) -> PackedTile {
    let grid = PositionGrid { min: [0.0; 3], step: 1.0, bits: 8 };
    let triangle = Mesh {
        grid,
        positions: vec![[0; 3], [9, 0, 0], [0, 9, 0]],
        triangles: vec![[0, 1, 2]],
        attributes: vec![Attribute::colours([[1, 2, 3]], vec![0; 3])],
    };
    let PackedTile::Mesh(mut packed, solids) = PackedTile::mesh(&triangle, None, &[], &[]).unwrap() else { panic!() };
    packed.pages.resize(pages as usize, vec![0; PAGE_WORDS].into());
    PackedTile::Mesh(packed, solids)
}

/// A V-BlockMap of `PLANES + strip_pages` pages whose roofs have `mark` as their colour.
fn node(mark: u8, strip_pages: usize) -> PackedTile {
    let mut columns = vec![None; COLUMNS];
    for i in 0..strip_pages {
        let rows = strip_rows(0, 4095, 4).1;
        let texels = vec![Texel::new([mark; 3], 63); usize::from(rows)];
        let strip = Some(WallStrip { texels, azimuth: 0 });
        columns[i] = Some(MapColumn { z_max: 4095, strip, roof: Texel::new([mark; 3], 0), ..MapColumn::default() });
    }
    columns[100] = Some(MapColumn { z_max: 7, roof: Texel::new([mark; 3], 0), ..MapColumn::default() });
    let map = BlockMap::from_columns(TileId::ROOT, 1.0, 0, 4, &columns).unwrap();
    PackedTile::node(&map)
}

fn read_mark(cache: &AtlasCache, atlas: &FakeAtlas, key: TileKey) -> Option<u8> {
    let node = cache.get(key.id)?;
    Some(Texel(atlas.pages[&node.pages[1]][100]).rgb()[0])
}

#[test]
fn evicts_least_recently_used_first_and_keeps_pinned_tiles() {
    let (mut cache, mut atlas) = (AtlasCache::new(16), FakeAtlas::default());
    for x in 0..4 {
        assert_eq!(cache.insert(id(x), node(x as u8, 0), &mut atlas), InsertResult::Inserted { evicted: vec![] });
    }
    assert_no_leak(&cache);
    cache.begin_frame();
    cache.pin(id(0));
    assert_eq!(cache.insert(id(9), node(9, 0), &mut atlas), InsertResult::Inserted { evicted: vec![id(1)] });
    assert_eq!(read_mark(&cache, &atlas, id(0)), Some(0));
    assert_eq!(read_mark(&cache, &atlas, id(9)), Some(9));
    [id(2), id(3)].into_iter().for_each(|id| cache.pin(id));
    assert_eq!(cache.insert(id(5), node(5, 0), &mut atlas), InsertResult::Full { evicted: vec![] });
    assert_no_leak(&cache);
}

#[test]
fn evicts_promoted_tiles_last_but_evicts_them() {
    let (mut cache, mut atlas) = (AtlasCache::new(16), FakeAtlas::default());
    (0..4).for_each(|x| assert!(matches!(cache.insert(id(x), node(1, 0), &mut atlas), InsertResult::Inserted { .. })));
    cache.begin_frame();
    cache.promote(id(0));
    cache.pin(id(3));
    for gone in [1, 2, 0] {
        assert_eq!(
            cache.insert(id(10 + gone), node(1, 0), &mut atlas),
            InsertResult::Inserted { evicted: vec![id(gone)] }
        );
    }
    assert_eq!(cache.insert(id(20), node(1, 0), &mut atlas), InsertResult::Full { evicted: vec![] });
    assert_no_leak(&cache);
}

#[test]
fn meshes_and_block_maps_share_the_pages() {
    let (mut cache, mut atlas) = (AtlasCache::new(16), FakeAtlas::default());
    let of = |x: u32, lod: u8| TileKey::mesh(id(x).id, lod);
    cache.insert(id(0), node(7, 0), &mut atlas);
    assert_eq!(cache.insert(of(0, 1), mesh(5), &mut atlas), InsertResult::Inserted { evicted: vec![] });
    assert_eq!(cache.insert(of(0, 0), mesh(7), &mut atlas), InsertResult::Inserted { evicted: vec![] });
    assert!(cache.mesh(id(0).id, 0).is_some() && cache.mesh(id(0).id, 2).is_none());
    assert_eq!(read_mark(&cache, &atlas, id(0)), Some(7));
    cache.begin_frame();
    cache.pin(of(0, 1));
    assert_eq!(cache.insert(of(1, 0), mesh(3), &mut atlas), InsertResult::Inserted { evicted: vec![id(0)] });
    assert_eq!(cache.insert(of(1, 1), mesh(9), &mut atlas), InsertResult::Full { evicted: vec![of(0, 0)] });
    assert_no_leak(&cache);
    assert_eq!(cache.free_pages(), 8);
}

#[test]
fn a_thousand_frames_leak_no_page_and_stay_within_capacity() {
    let (mut cache, mut atlas) = (AtlasCache::new(37), FakeAtlas::default());
    let mut marks: HashMap<TileKey, u8> = HashMap::new();
    for frame in 0..1000u32 {
        cache.begin_frame();
        let r = |k: u32| frame.wrapping_mul(2_654_435_761).rotate_left(k) >> 7;
        (0..3).for_each(|k| cache.pin(id(r(k) % 20)));
        let (at, mark) = (id(r(5) % 20), (frame % 251) as u8);
        match cache.insert(at, node(mark, (r(9) % 3) as usize), &mut atlas) {
            InsertResult::Inserted { evicted } => {
                evicted.iter().for_each(|id| assert!(marks.remove(id).is_some() && cache.get(id.id).is_none()));
                marks.insert(at, mark);
            }
            InsertResult::Full { .. } => panic!("at most three tiles of five pages are pinned"),
        }
        assert_no_leak(&cache);
        for (id, mark) in &marks {
            assert_eq!(read_mark(&cache, &atlas, *id), Some(*mark), "frame {frame}");
        }
        assert_eq!(marks.len(), cache.tile_count());
    }
    assert!(cache.peak_bytes() <= 37 * PAGE_BYTES && cache.peak_bytes() > 30 * PAGE_BYTES);
}

#[test]
fn pages_and_slots_fit_the_given_bytes() {
    let mib = 1 << 20;
    assert!(u64::from(pages_for(256 * mib)) * PAGE_BYTES <= 256 * mib);
    assert!(pages_for(256 * mib) > 16_000);
    assert_eq!(slots_for(37), 9);
}

#[test]
fn additions_stay_and_are_drawn_while_they_are_shown() {
    let (mut cache, mut atlas) = (AtlasCache::new(8), FakeAtlas::default());
    let triangle = [[0.0, 0.0, 5.0], [9.0, 0.0, 5.0], [0.0, 9.0, 65.0]];
    let object = AddedObject { name: String::new(), triangles: vec![triangle] };
    let packed = pack(&[object]).unwrap();
    cache.set_additions(packed.clone(), &mut atlas).unwrap();
    assert_eq!((cache.capacity_pages(), cache.tile_pages(), cache.free_pages()), (8, 6, 6));
    let mut nodes = Vec::new();
    assert_eq!(cache.add_nodes(&mut nodes, DVec3::new(0.0, 0.0, 100.0)), [0, 1]);
    assert_eq!((nodes[0].mesh_z_m, nodes[0].z_hi), (-95.0, 60.0));
    let palette = *cache.palettes.keys().next().unwrap();
    for x in 0..9 {
        cache.begin_frame();
        let key = TileKey::mesh(TileId::new(10, x, 0).unwrap(), 0);
        assert!(matches!(cache.insert(key, mesh(2), &mut atlas), InsertResult::Inserted { .. }));
    }
    assert_eq!(cache.object_at(palette), Some(FIRST_ADDED));
    cache.show_additions(false);
    assert_eq!((cache.add_nodes(&mut nodes, DVec3::ZERO), nodes.len()), ([0, 0], 1));
    let refused = AtlasCache::new(3).set_additions(packed, &mut atlas);
    assert_eq!(refused, Err(AdditionError::TooLarge { needed_mib: 1 }));
}
