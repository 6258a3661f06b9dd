//! `join`: makes the files of the city from the tiles of all regions.

use std::{collections::HashMap, fs};

use super::{
    crown,
    job::Steps,
    layout::{Plan, REPORT, REPORT_KIND, ROWS_KIND, rows_name},
    region,
    region_file::{INDEX_KIND, TileIndex, bytes_name, index_name},
    scan::{fetch, put_file, records_name, scratch_folder},
    sealed::SealedStore,
};
use crate::{
    error::BakeError,
    hash::ShortHash,
    read::{self, ReadReport},
    scene::object_numbers::NumberedObject,
    write::{
        city::{self, CityInput},
        mesh_pack::StoredMesh,
        objects::NumberedRecords,
        tile_bytes::TileBytes,
        tile_pack::{PackId, StoredTile},
        tile_tree::TileTree,
    },
};

/// Folder of the city in the store.
const CITY: &str = "city";

impl Steps<'_> {
    /// Writes the city. Fails if a step before is missing.
    pub fn join(&self) -> Result<(), BakeError> {
        let objects = self.objects();
        let manifest_name = format!("{CITY}/city.json");
        if objects.has(&manifest_name)? {
            return Ok(());
        }
        let plan = self.read_plan()?;
        let folder = scratch_folder()?;
        let (mut tree, mut fingerprints) = self.read_tree(&plan)?;
        let merged = tree.merge_plain_nodes();
        let blocks: std::collections::HashSet<(u32, u32)> =
            merged.iter().map(|id| PackId::of(*id)).map(|pack| (pack.x, pack.y)).collect();
        fingerprints.retain(|(place, _)| !blocks.contains(place));
        let read: ReadReport = objects.read(REPORT, REPORT_KIND)?;
        let mut files = Vec::new();
        for chunk in 0..self.chunks().len() {
            let path = folder.path().join(format!("records-{chunk}"));
            fetch(objects, &records_name(chunk), &path)?;
            files.push((path, self.head(chunk)?.record_bytes));
        }
        let records = read::records_of(files);
        let mut rows: Vec<Option<NumberedObject>> = Vec::with_capacity(plan.rows.min(1 << 20));
        let mut part = 0;
        while rows.len() < plan.rows {
            let more: Vec<Option<NumberedObject>> = objects.read(&rows_name(part), ROWS_KIND)?;
            if more.is_empty() {
                return Err(objects.damaged(&rows_name(part), "its fields are damaged"));
            }
            rows.extend(more);
            part += 1;
        }
        let searchable = self.config.searchable.clone();
        let numbered = NumberedRecords { records: &records, rows: &rows, origin_m: plan.grid.corner, searchable };
        let input = CityInput {
            config: &self.config,
            grid: &plan.grid,
            facts: &plan.facts,
            read: &read,
            tree: &tree,
            fingerprints,
            objects: Some(numbered),
        };
        let city_folder = folder.path().join(CITY);
        self.progress.stage("write", tree.levels().iter().map(|level| level.len() as u64).sum());
        let mut bytes = StoreTiles::new(objects, &plan);
        city::write(input, &mut bytes, &city_folder, |n| self.progress.advance(n))?;
        let failed = |cause| BakeError::io(&city_folder, "read", cause);
        for entry in fs::read_dir(&city_folder).map_err(failed)? {
            let entry = entry.map_err(failed)?;
            let name = format!("{CITY}/{}", entry.file_name().to_string_lossy());
            if name != manifest_name {
                put_file(objects, &name, &entry.path())?;
            }
        }
        put_file(objects, &manifest_name, &city_folder.join("city.json"))
    }

    /// All tiles of the city, and the fingerprints of all blocks row by row.
    fn read_tree(&self, plan: &Plan) -> Result<(TileTree, Vec<((u32, u32), ShortHash)>), BakeError> {
        let objects = self.objects();
        let mut tree = TileTree::new(plan.grid.depth);
        let mut levels: Vec<Vec<StoredTile>> = vec![Vec::new(); usize::from(plan.grid.depth) + 1];
        let (mut meshes, mut fingerprints) = (Vec::new(), Vec::new());
        let regions = (0..plan.regions.len()).map(region::folder_name);
        for folder in regions.chain([crown::FOLDER.to_owned()]) {
            let index: TileIndex = objects.read(&index_name(&folder), INDEX_KIND)?;
            let damaged = || objects.damaged(&index_name(&folder), "its fields are damaged");
            let (tiles, of_region) = index.stored().ok_or_else(damaged)?;
            for tile in tiles {
                levels.get_mut(usize::from(tile.id.level())).ok_or_else(damaged)?.push(tile);
            }
            meshes.extend(of_region);
            fingerprints.extend(index.fingerprints);
        }
        for (level, tiles) in (0..).zip(levels) {
            tree.set(level, tiles);
        }
        tree.set_meshes(meshes);
        fingerprints.sort_unstable_by_key(|((x, y), _)| (*y, *x));
        Ok((tree, fingerprints))
    }
}

/// Tiles in the objects of regions.
struct StoreTiles<'a> {
    objects: SealedStore<'a>,
    plan: &'a Plan,
    regions: HashMap<[u32; 2], u32>,
    /// The bytes that were read last: neighbours follow one another.
    ahead: Option<(String, u64, Vec<u8>)>,
}

/// Bytes that are read at once.
const AHEAD_BYTES: u64 = 1 << 20;

impl<'a> StoreTiles<'a> {
    fn new(objects: SealedStore<'a>, plan: &'a Plan) -> Self {
        Self { objects, plan, regions: plan.region_numbers(), ahead: None }
    }

    /// Bytes of a region's object, or of the crown's if `region` is none.
    fn read(&mut self, region: Option<[u32; 2]>, start: u64, length: u64) -> Result<Vec<u8>, BakeError> {
        let folder = match region {
            None => crown::FOLDER.to_owned(),
            Some(place) => {
                let number = self.regions.get(&place).copied();
                let missing = || self.objects.damaged("plan/plan", "a tile is of no region");
                region::folder_name(number.ok_or_else(missing)? as usize)
            }
        };
        let name = bytes_name(&folder);
        let within = |(known, from, bytes): &(String, u64, Vec<u8>)| {
            let at = usize::try_from(start.checked_sub(*from)?).ok()?;
            (*known == name).then(|| bytes.get(at..at.checked_add(length as usize)?).map(<[u8]>::to_vec))?
        };
        if let Some(found) = self.ahead.as_ref().and_then(within) {
            return Ok(found);
        }
        let failed = |cause| self.objects.failed(&name, cause);
        let size = self.objects.store.size(&name).map_err(failed)?.unwrap_or(0);
        let wanted = length.max(AHEAD_BYTES.min(size.saturating_sub(start)));
        let bytes = self.objects.store.range(&name, start, wanted).map_err(failed)?;
        let found = bytes.get(..length as usize).map(<[u8]>::to_vec);
        self.ahead = Some((name.clone(), start, bytes));
        found.ok_or_else(|| self.objects.damaged(&name, "it is cut short"))
    }
}

impl TileBytes for StoreTiles<'_> {
    fn tile(&mut self, stored: &StoredTile) -> Result<Vec<u8>, BakeError> {
        self.read(self.plan.region_of(stored.id), stored.offset, stored.bytes.into())
    }

    fn mesh(&mut self, stored: &StoredMesh) -> Result<Vec<u8>, BakeError> {
        self.read(self.plan.region_of(stored.id), stored.offset, stored.info.bytes.into())
    }
}
