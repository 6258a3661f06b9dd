//! `join`: makes the files of the city from the tiles of all regions.
//!
//! The plan reads the indexes of all regions, and knows every byte of the archives but those of the tiles. Parts of the archives are copied
//! by any number of machines, and completed in the end.

use super::job::BakeSteps;
use super::layout::{CityPlan, JOINED, OWN_RECORDS, REPORT, REPORT_KIND, ROWS_KIND, rows_name};
use super::region;
use super::region_file::{INDEX_KIND, TileIndex, index_name};
use super::scan::{fetch, put_file, records_name, scratch_folder};
use super::sealed::{Removed, SealedKind};
use super::store_tiles::{CROWN, CityTiles, StoreTiles, folder_of};
use super::work::PartPiece;
use crate::error::BakeError;
use crate::read::{self, ReadReport};
use crate::scene::object_numbers::NumberedObject;
use crate::write::archive::{self, ArchiveLayout, ListedTile, WrittenArchive, archive_order};
use crate::write::city::{self, BLOCKMAPS_FILE, CityInput, MESHES_FILE, TileArchives};
use crate::write::objects::NumberedRecords;
use crate::write::tile_pack::{StoredMesh, StoredTile};
use crate::write::tile_tree::TileTree;
use insula_archive::city::MANIFEST_FILE;
use insula_archive::mark::{MARK_AT, mark_of};
use insula_protocol::{TileId, mesh_tile};
use insula_scratch::record_list::{RecordList, RecordScratch};
use serde::{Deserialize, Serialize};
use std::collections::{HashMap, HashSet};
use std::fs;
use std::path::Path;

/// Folder of the city in the store.
pub(super) const CITY: &str = "city";
/// Folder of the files that are put into the city when it is complete.
const NEXT: &str = "join/next";
const JOINED_KIND: SealedKind = *b"DONE";
pub(super) const JOIN_PLAN: &str = "join/plan";
const JOIN_KIND: SealedKind = *b"JOIN";
const PART_KIND: SealedKind = *b"PART";
const RECEIPT_KIND: SealedKind = *b"RCPT";
/// Least size of the parts of an archive, except for the last one: object stores take 5 MiB to 5 GiB.
const PART_BYTES: u64 = 64 << 20;
/// Most parts of an archive: object stores take 10,000.
const MAX_PARTS: u64 = 9000;

/// Name of what a part has.
fn part_name(part: usize) -> String {
    format!("join/part-{part}")
}

/// Name of the store's receipt for a part.
fn receipt_name(part: usize) -> String {
    format!("join/receipt-{part}")
}

/// The archives that are joined.
#[derive(Debug, Serialize, Deserialize)]
struct JoinPlan {
    archives: Vec<JoinedArchive>,
    /// Number of parts of all archives.
    parts: usize,
}

/// An archive whose parts are copied.
#[derive(Debug, Serialize, Deserialize)]
struct JoinedArchive {
    name: String,
    /// By which the store knows the parts.
    ticket: String,
    bytes: u64,
}

#[derive(Debug, Serialize, Deserialize)]
struct ArchivePart {
    /// Index of its archive.
    archive: u32,
    /// Number in its archive.
    number: u32,
    /// Of its bytes in the archive.
    start: u64,
    pieces: Vec<PartPiece>,
}

/// What the store says of a part that it has.
#[derive(Debug, Serialize, Deserialize)]
struct Receipt {
    ticket: String,
    archive: u32,
    receipt: String,
}

impl BakeSteps<'_> {
    /// Plans the city's archives from the indexes of all regions, and writes all files that are small beside them. Fails if a step before is missing.
    pub(super) fn join_plan(&self) -> Result<(), BakeError> {
        let objects = self.objects();
        let plan = self.read_plan()?;
        let folder = scratch_folder()?;
        let tiles = self.read_tiles(&plan)?;
        let mut bytes = StoreTiles::new(objects, &plan, &tiles);
        let mut joins = vec![self.lay_out(BLOCKMAPS_FILE, self.archived_tiles(&plan, &tiles)?, &bytes)?];
        let meshes = self.archived_meshes(&plan, &tiles)?;
        if !meshes.is_empty() {
            joins.push(self.lay_out(MESHES_FILE, meshes, &bytes)?);
        }
        let city_folder = folder.path().join(CITY);
        fs::create_dir(&city_folder).map_err(|cause| BakeError::io(&city_folder, "created", cause))?;
        let archives =
            TileArchives { blockmaps: joins[0].written.clone(), meshes: joins.get(1).map(|join| join.written.clone()) };
        let version = self.write_others(&plan, &tiles, &mut bytes, archives, folder.path(), &city_folder)?;
        joins.iter_mut().for_each(|join| join.mark(&version));
        let failed = |cause| BakeError::io(&city_folder, "read", cause);
        for entry in fs::read_dir(&city_folder).map_err(failed)? {
            let entry = entry.map_err(failed)?;
            let name = entry.file_name().to_string_lossy().into_owned();
            // Who finds the manifest reads the city, so it waits for the end; with it all files, if they replace those of another city.
            let waits = name == MANIFEST_FILE || self.job.previous().is_some();
            put_file(objects, &format!("{}/{name}", if waits { NEXT } else { CITY }), &entry.path())?;
        }
        let mut join_plan = JoinPlan { archives: Vec::new(), parts: 0 };
        for join in joins {
            let (name, bytes) = (format!("{CITY}/{}", join.name), join.written.bytes);
            let ticket = objects.store.begin_parts(&name, bytes).map_err(|cause| objects.failed(&name, cause))?;
            for part in join.parts(join_plan.archives.len() as u32) {
                objects.write(&part_name(join_plan.parts), PART_KIND, &part)?;
                join_plan.parts += 1;
            }
            join_plan.archives.push(JoinedArchive { name, ticket, bytes });
        }
        objects.write(JOIN_PLAN, JOIN_KIND, &join_plan)
    }

    /// Copies a part of an archive. Fails if there is no plan.
    pub(super) fn join_part(&self, part: usize) -> Result<(), BakeError> {
        let join_plan: JoinPlan = self.objects().read(JOIN_PLAN, JOIN_KIND)?;
        self.check_task("join-part", part, join_plan.parts)?;
        let objects = self.objects();
        let ArchivePart { archive, number, start, pieces } = objects.read(&part_name(part), PART_KIND)?;
        let damaged = || objects.damaged(&part_name(part), "its fields are damaged");
        let JoinedArchive { name, ticket, .. } = join_plan.archives.get(archive as usize).ok_or_else(damaged)?;
        let known: Option<Receipt> = objects.find(&receipt_name(part), RECEIPT_KIND)?;
        if known.is_some_and(|receipt| receipt.ticket == *ticket) {
            return Ok(());
        }
        let put = objects.store.put_pieces(name, ticket, number, start, pieces);
        let receipt = put.map_err(|cause| objects.failed(name, cause))?;
        objects.write(&receipt_name(part), RECEIPT_KIND, &Receipt { ticket: ticket.clone(), archive, receipt })
    }

    /// Completes the archives, then the city, and removes tiles that only the city before had. Fails if a part is missing.
    pub(super) fn join_finish(&self) -> Result<(), BakeError> {
        let objects = self.objects();
        let join_plan: JoinPlan = objects.read(JOIN_PLAN, JOIN_KIND)?;
        let mut receipts: Vec<Vec<String>> = vec![Vec::new(); join_plan.archives.len()];
        for part in 0..join_plan.parts {
            let found: Receipt = objects.read(&receipt_name(part), RECEIPT_KIND)?;
            let missing = || BakeError::StepMissing { work: objects.store.address(), name: part_name(part) };
            let archive = join_plan.archives.get(found.archive as usize).filter(|a| a.ticket == found.ticket);
            archive.ok_or_else(missing)?;
            receipts[found.archive as usize].push(found.receipt);
        }
        for (JoinedArchive { name, ticket, bytes }, receipts) in join_plan.archives.iter().zip(receipts) {
            if let Err(cause) = objects.store.finish_parts(name, ticket, &receipts) {
                // Another run has completed it, if it is there.
                let size = objects.store.size(name).map_err(|cause| objects.failed(name, cause))?;
                if size != Some(*bytes) {
                    return Err(objects.failed(name, cause));
                }
            }
        }
        let folder = scratch_folder()?;
        let mut files = objects.store.list(NEXT).map_err(|cause| objects.failed(NEXT, cause))?;
        files.sort_by_key(|name| name.ends_with(MANIFEST_FILE));
        for (number, name) in files.iter().enumerate() {
            let path = folder.path().join(number.to_string());
            fetch(objects, name, &path)?;
            put_file(objects, &name.replacen(NEXT, CITY, 1), &path)?;
        }
        self.remove_unused()?;
        objects.write(JOINED, JOINED_KIND, &())
    }

    /// Removes tiles and files that only the city before had.
    fn remove_unused(&self) -> Result<(), BakeError> {
        let Some(previous) = self.job.previous() else { return Ok(()) };
        let objects = self.objects();
        let list = |folder: &str| objects.store.list(folder).map_err(|cause| objects.failed(folder, cause));
        let plan = self.read_plan()?;
        let mut used = HashSet::new();
        for region in 0..plan.regions.len() {
            let index: TileIndex = objects.read(&index_name(&region::folder_name(region)), INDEX_KIND)?;
            used.extend(index.bytes.rsplit_once('/').map(|(folder, _)| folder.to_owned()));
        }
        let is_unused = |name: &String| name.rsplit_once('/').is_none_or(|(folder, _)| !used.contains(folder));
        let mut unused: Vec<String> = list(region::TILES)?.into_iter().filter(is_unused).collect();
        unused.extend(list(&format!("numbers/{previous}"))?);
        let join_plan: JoinPlan = objects.read(JOIN_PLAN, JOIN_KIND)?;
        let is_joined = |name: &String| join_plan.archives.iter().any(|archive| archive.name == *name);
        let kept: HashSet<String> = list(NEXT)?.iter().map(|name| name.replacen(NEXT, CITY, 1)).collect();
        unused.extend(list(CITY)?.into_iter().filter(|name| !kept.contains(name) && !is_joined(name)));
        let mut removed = Removed::default();
        removed.remove(objects.store, &unused)?;
        self.warn_of_kept(&removed);
        Ok(())
    }

    /// Number of parts of the archives. Fails if there is no plan of the join.
    pub(super) fn join_parts(&self) -> Result<usize, BakeError> {
        let join_plan: JoinPlan = self.objects().read(JOIN_PLAN, JOIN_KIND)?;
        Ok(join_plan.parts)
    }

    /// Writes the files besides the archives of V-BlockMaps and meshes into `city_folder`. `scratch` is for what they are made of. Returns
    /// the city's version.
    fn write_others(
        &self,
        plan: &CityPlan,
        tiles: &CityTiles,
        bytes: &mut StoreTiles<'_>,
        archives: TileArchives,
        scratch: &Path,
        city_folder: &Path,
    ) -> Result<String, BakeError> {
        let objects = self.objects();
        let read: ReadReport = objects.read(REPORT, REPORT_KIND)?;
        let mut files = Vec::new();
        for chunk in 0..self.chunks().len() {
            let path = scratch.join(format!("records-{chunk}"));
            fetch(objects, &records_name(chunk), &path)?;
            files.push((path, self.head(chunk)?.record_bytes));
        }
        let own = scratch.join("records");
        fetch(objects, OWN_RECORDS, &own)?;
        files.push((own, plan.own_record_bytes));
        let records = read::records_of(files);
        let mut rows = RecordList::new(&RecordScratch::in_folder(scratch));
        let mut part = 0;
        while rows.len() < plan.rows {
            let more: Vec<Option<NumberedObject>> = objects.read(&rows_name(part), ROWS_KIND)?;
            if more.is_empty() {
                return Err(objects.damaged(&rows_name(part), "its fields are damaged"));
            }
            more.into_iter().for_each(|row| rows.push(row));
            part += 1;
        }
        let (origin_m, searchable) = (plan.grid.corner, self.config.options.search_attributes.clone());
        let numbered = NumberedRecords { records: &records, rows: &rows, origin_m, searchable };
        let input = CityInput {
            config: &self.config,
            grid: &plan.grid,
            facts: &plan.facts,
            read: &read,
            tree: &tiles.tree,
            fingerprints: tiles.fingerprints.clone(),
            objects: Some(numbered),
            base: None,
        };
        self.progress.stage("write", 0);
        let written = city::write_others(input, bytes, archives, city_folder, self.progress)?;
        Ok(written.manifest.version)
    }

    fn read_tiles(&self, plan: &CityPlan) -> Result<CityTiles, BakeError> {
        let objects = self.objects();
        let mut levels: Vec<Vec<StoredTile>> = vec![Vec::new(); usize::from(plan.grid.depth) + 1];
        let (mut meshes, mut fingerprints) = (Vec::new(), Vec::new());
        let (mut of_regions, mut of_crown) = (HashMap::new(), HashSet::new());
        self.progress.stage("indexes", plan.regions.len() as u64 + 1);
        for region in all_regions(plan) {
            let index = self.tile_index(region)?;
            let damaged = || objects.damaged(&index_name(&folder_of(region)), "its fields are damaged");
            if index.meshes.iter().any(|(mesh, _)| mesh_tile::archive_id(mesh.id, mesh.lod).is_none()) {
                return Err(damaged());
            }
            let is_root = |id: TileId| region == CROWN && id.level() == plan.region_level;
            of_crown.extend(index.tiles.iter().map(|(tile, _)| tile.id).filter(|id| is_root(*id)));
            for (tile, _) in index.tiles {
                levels.get_mut(usize::from(tile.id.level())).ok_or_else(damaged)?.push(tile);
            }
            meshes.extend(index.meshes.into_iter().map(|(mesh, _)| mesh));
            fingerprints.extend(index.fingerprints);
            of_regions.insert(region, index.bytes);
            self.progress.advance(1);
        }
        let mut tree = TileTree::new(plan.grid.depth);
        for (level, tiles) in (0..).zip(levels) {
            tree.set(level, tiles);
        }
        tree.set_meshes(meshes);
        tree.merge_plain_nodes(&mut fingerprints);
        fingerprints.sort_unstable_by_key(|((x, y), _)| (*y, *x));
        Ok(CityTiles { tree, fingerprints, objects: of_regions, of_crown })
    }

    /// The index of a region's tiles, or of those of the crown.
    fn tile_index(&self, region: u32) -> Result<TileIndex, BakeError> {
        self.objects().read(&index_name(&folder_of(region)), INDEX_KIND)
    }

    /// The tiles of V-BlockMaps that the city has, in the archive's order.
    fn archived_tiles(&self, plan: &CityPlan, city: &CityTiles) -> Result<Vec<ArchivedTile>, BakeError> {
        let mut all = Vec::with_capacity(city.tree.levels().iter().map(Vec::len).sum());
        for region in all_regions(plan) {
            let stored = self.tile_index(region)?.tiles.into_iter();
            let stored = stored.filter(|(tile, _)| city.tree.get(tile.id).is_some());
            all.extend(stored.map(|(StoredTile { id, offset, bytes, .. }, hash)| {
                let tile = ListedTile { id, bytes, hash };
                ArchivedTile { tile, region, start: offset }
            }));
        }
        Ok(all)
    }

    /// The same of the meshes.
    fn archived_meshes(&self, plan: &CityPlan, city: &CityTiles) -> Result<Vec<ArchivedTile>, BakeError> {
        let mut all = Vec::with_capacity(city.tree.meshes().len());
        if city.tree.meshes().is_empty() {
            return Ok(all);
        }
        for region in all_regions(plan) {
            let stored = self.tile_index(region)?.meshes.into_iter();
            let stored = stored.filter(|(mesh, _)| !city.tree.mesh(mesh.id).is_empty());
            all.extend(stored.filter_map(|(StoredMesh { id, lod, info, offset }, hash)| {
                let tile = ListedTile { id: mesh_tile::archive_id(id, lod)?, bytes: info.bytes, hash };
                Some(ArchivedTile { tile, region, start: offset })
            }));
        }
        Ok(all)
    }

    /// Plans an archive of tiles.
    fn lay_out(
        &self,
        name: &'static str,
        mut tiles: Vec<ArchivedTile>,
        stored: &StoreTiles<'_>,
    ) -> Result<PlannedArchive, BakeError> {
        tiles.sort_by_cached_key(|archived| archive_order(archived.tile.id));
        let layout = archive::lay_out(Path::new(name), &tiles, |archived| archived.tile)?;
        let ArchiveLayout { head, distinct, tail, written } = layout;
        let mut pieces = vec![PartPiece::Given(head)];
        for number in distinct {
            let ArchivedTile { tile: ListedTile { bytes, .. }, region, start } = tiles[number as usize];
            let object = stored.object_of(region)?;
            match pieces.last_mut() {
                Some(PartPiece::Stored { object: last, start: from, length })
                    if last == object && *from + *length == start =>
                {
                    *length += u64::from(bytes);
                }
                _ => pieces.push(PartPiece::Stored { object: object.clone(), start, length: bytes.into() }),
            }
        }
        pieces.push(PartPiece::Given(tail));
        Ok(PlannedArchive { name, written, pieces })
    }
}

/// The numbers of all regions, and that of the crown.
fn all_regions(plan: &CityPlan) -> impl Iterator<Item = u32> {
    (0..plan.regions.len() as u32).chain([CROWN])
}

/// A tile in the object of a region.
#[derive(Debug, Clone, Copy)]
struct ArchivedTile {
    /// By its id in the archive.
    tile: ListedTile,
    region: u32,
    start: u64,
}

/// What an archive is joined of.
struct PlannedArchive {
    name: &'static str,
    written: WrittenArchive,
    pieces: Vec<PartPiece>,
}

impl PlannedArchive {
    fn mark(&mut self, version: &str) {
        if let Some(PartPiece::Given(head)) = self.pieces.first_mut()
            && let Some(mark) = head.get_mut(MARK_AT)
        {
            mark.copy_from_slice(&mark_of(version));
        }
    }

    /// Its parts, all but the last of the same size.
    fn parts(&self, archive: u32) -> Vec<ArchivePart> {
        let size = PART_BYTES.max(self.written.bytes.div_ceil(MAX_PARTS));
        cut(&self.pieces, size)
            .into_iter()
            .zip(0..)
            .map(|(pieces, number)| ArchivePart { archive, number, start: u64::from(number) * size, pieces })
            .collect()
    }
}

fn cut(pieces: &[PartPiece], size: u64) -> Vec<Vec<PartPiece>> {
    let mut parts = Vec::new();
    let (mut part, mut filled) = (Vec::new(), 0);
    for piece in pieces {
        let (mut done, length) = (0, piece.length());
        while done < length {
            let taken = (length - done).min(size - filled);
            part.push(piece.section(done, taken));
            (done, filled) = (done + taken, filled + taken);
            if filled == size {
                parts.push(std::mem::take(&mut part));
                filled = 0;
            }
        }
    }
    if !part.is_empty() {
        parts.push(part);
    }
    parts
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_have_all_bytes_in_order() {
        let given = |bytes: std::ops::Range<u8>| PartPiece::Given(bytes.collect());
        let pieces = [
            given(0..7),
            PartPiece::Stored { object: "3".to_owned(), start: 100, length: 20 },
            given(7..9),
            given(9..9),
        ];
        for size in [1, 4, 7, 10, 29, 100] {
            let parts = cut(&pieces, size);
            let lengths: Vec<u64> = parts.iter().map(|part| part.iter().map(PartPiece::length).sum()).collect();
            assert_eq!(lengths.iter().sum::<u64>(), 29);
            let (last, others) = lengths.split_last().unwrap();
            assert!(others.iter().all(|length| *length == size) && (1..=size).contains(last));
            let (mut bytes, mut stored) = (Vec::new(), Vec::new());
            for piece in parts.into_iter().flatten() {
                match piece {
                    PartPiece::Given(some) => bytes.extend(some),
                    PartPiece::Stored { object, start, length } => {
                        stored.extend((start..start + length).map(|n| (object.clone(), n)))
                    }
                }
            }
            assert!(
                bytes == (0..9).collect::<Vec<u8>>()
                    && stored == (100..120).map(|n| ("3".to_owned(), n)).collect::<Vec<_>>()
            );
        }
    }
}
