//! The tiles of a city in the objects of its regions.

use super::layout::{CityPlan, PLAN};
use super::sealed::SealedStore;
use super::{crown, region};
use crate::error::BakeError;
use crate::hash::ShortHash;
use crate::write::tile_bytes::TileContent;
use crate::write::tile_pack::{StoredMesh, StoredTile};
use crate::write::tile_tree::TileTree;
use insula_protocol::TileId;
use lru::LruCache;
use std::collections::{HashMap, HashSet};
use std::num::NonZeroUsize;

/// Stands for the crown among the regions.
pub(super) const CROWN: u32 = u32::MAX;

pub(super) struct CityTiles {
    pub(super) tree: TileTree,
    /// Of all blocks whose leaves the city has, row by row.
    pub(super) fingerprints: Vec<((u32, u32), ShortHash)>,
    /// Name of the object of each region's bytes.
    pub(super) objects: HashMap<u32, String>,
    /// Nodes of the crown at the level of the regions' roots: land.
    pub(super) of_crown: HashSet<TileId>,
}

/// Folder of a region, or of the crown.
pub(super) fn folder_of(region: u32) -> String {
    if region == CROWN { crown::FOLDER.to_owned() } else { region::folder_name(region as usize) }
}

/// Tiles in the objects of regions.
pub(super) struct StoreTiles<'a> {
    pub(super) objects: SealedStore<'a>,
    plan: &'a CityPlan,
    regions: HashMap<[u32; 2], u32>,
    city: &'a CityTiles,
    /// Sizes of the regions' objects.
    sizes: HashMap<u32, u64>,
    /// Segments of the regions' objects, by region and number.
    segments: LruCache<(u32, u64), Vec<u8>>,
}

/// Bytes that are read at once.
const SEGMENT_BYTES: u64 = 1 << 20;
/// Segments in memory: a row of leaves crosses many regions. The compiler checks that it is not zero.
const SEGMENTS: NonZeroUsize = NonZeroUsize::new(48).unwrap();

impl<'a> StoreTiles<'a> {
    pub(super) fn new(objects: SealedStore<'a>, plan: &'a CityPlan, city: &'a CityTiles) -> Self {
        let (sizes, segments) = (HashMap::new(), LruCache::new(SEGMENTS));
        Self { objects, plan, regions: plan.region_numbers(), city, sizes, segments }
    }

    /// Name of the object of a region's bytes. Fails if there is no such region.
    pub(super) fn object_of(&self, region: u32) -> Result<&'a String, BakeError> {
        self.city.objects.get(&region).ok_or_else(|| self.objects.damaged(PLAN, "a tile is of no region"))
    }

    /// The region of a node, or the crown. Fails for a node of neither.
    pub(super) fn region_of(&self, id: TileId) -> Result<u32, BakeError> {
        let Some(place) = self.plan.region_of(id).filter(|_| !self.city.of_crown.contains(&id)) else {
            return Ok(CROWN);
        };
        let missing = || self.objects.damaged(PLAN, "a tile is of no region");
        self.regions.get(&place).copied().ok_or_else(missing)
    }

    /// Bytes of a region's object.
    fn read(&mut self, region: u32, start: u64, length: u32) -> Result<Vec<u8>, BakeError> {
        let (mut found, mut at, end) = (Vec::new(), start, start.saturating_add(length.into()));
        while at < end {
            let number = at / SEGMENT_BYTES;
            let first = number * SEGMENT_BYTES;
            let until = (end - first).min(SEGMENT_BYTES);
            let piece = self.segment(region, number)?.get((at - first) as usize..until as usize);
            let Some(piece) = piece else {
                return Err(self.objects.damaged(self.object_of(region)?, "it is cut short"));
            };
            found.extend_from_slice(piece);
            at = first + until;
        }
        Ok(found)
    }

    /// A segment of a region's object: shorter at the end, empty beyond it.
    fn segment(&mut self, region: u32, number: u64) -> Result<&[u8], BakeError> {
        let name = self.object_of(region)?;
        let store = self.objects.store;
        let read =
            |start: u64, length: u64| if length == 0 { Ok(Vec::new()) } else { store.range(name, start, length) };
        let failed = |cause| self.objects.failed(name, cause);
        let size = match self.sizes.get(&region) {
            Some(size) => *size,
            None => store.size(name).map_err(failed)?.unwrap_or(0),
        };
        self.sizes.insert(region, size);
        let segment = self.segments.try_get_or_insert((region, number), || {
            let start = (number * SEGMENT_BYTES).min(size);
            read(start, SEGMENT_BYTES.min(size - start))
        });
        segment.map(Vec::as_slice).map_err(failed)
    }
}

impl TileContent for StoreTiles<'_> {
    fn tile(&mut self, stored: &StoredTile) -> Result<Vec<u8>, BakeError> {
        self.read(self.region_of(stored.id)?, stored.offset, stored.bytes)
    }

    fn mesh(&mut self, stored: &StoredMesh) -> Result<Vec<u8>, BakeError> {
        self.read(self.region_of(stored.id)?, stored.offset, stored.info.bytes)
    }
}
