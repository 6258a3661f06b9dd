//! Writes the final files of a city.
//!
//! In: the tree of packed tiles, and facts about the sources. Out: `blockmaps.pmtiles`, `subtrees.pmtiles`, as far as the city has
//! them `meshes.pmtiles`, `objects.pmtiles`, `search.index` and `visibility.pmtiles`, then `city.json`, `fingerprints.bin` and
//! `thumbnail.jpg`, synchronised, in the scratch folder.
//! Next: `ScratchFolder::publish` renames them to the output.

use super::archive::{self, WrittenArchive, archive_order};
use super::attributions::{Attributions, is_publisher};
use super::files::write_synced;
use super::fingerprints::Fingerprints;
use super::focus::{self, Standing};
use super::location::locate;
use super::objects::NumberedRecords;
use super::sea::{self, SeaAndLand};
use super::tile_bytes::TileContent;
use super::tile_pack::StoredTile;
use super::tile_tree::{self, TileTree};
use super::{search, thumbnail, visibility};
use crate::config::BakeConfig;
use crate::error::BakeError;
use crate::ground::GroundReport;
use crate::hash::ShortHash;
use crate::progress::Progress;
use crate::read::{HeightUnit, ReadReport};
use crate::release::BaseCity;
use crate::scene::ObjectKind;
use crate::scene::grid::CityGrid;
use crate::scene::scratch_scene::ScratchScene;
use insula_archive::city::{SEARCH_FILE, version_of};
use insula_archive::mark::mark_file;
use insula_archive::{Archive, BakedCity};
use insula_objects::Schema;
use insula_protocol::manifest::{CityCounts, CityMarks, FORMAT_VERSION, HeightReference, Manifest};
use insula_protocol::release::Release;
use insula_protocol::subtree::NodeInfo;
use insula_protocol::text::printable;
use insula_protocol::{NODE_CELLS, TileId, TileKind, mesh_tile, tile};
use insula_visibility::CityExtent;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::collections::HashMap;
use std::path::Path;
use std::sync::{Mutex, PoisonError};
use std::{fs, io};

/// Subtrees in memory: each has up to 1365 nodes.
const SUBTREES_AT_ONCE: usize = 64;

/// The scene's part of the manifest, so that the scene need not be kept until the end.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct SceneFacts {
    pub(crate) origin: [f64; 3],
    pub(crate) bounds: [[f64; 3]; 2],
    pub(crate) ground_z_m: f64,
    pub(crate) has_terrain: bool,
    pub(crate) generated_ground: bool,
    pub(crate) objects: u64,
    pub(crate) triangles: u64,
    pub(crate) crs: Option<String>,
}

impl SceneFacts {
    /// For a city with at least one triangle; `min` and `max` are its bounds relative to its origin.
    /// Fails if the objects cannot be read.
    pub(crate) fn new(city: &ScratchScene, [min, max]: [[f64; 3]; 2]) -> Result<Self, BakeError> {
        let terrain_z = lowest_terrain(city)?;
        let world = |p: [f64; 3]| std::array::from_fn(|axis| p[axis] + city.origin[axis]);
        let base_z = if terrain_z.is_some() { terrain_z } else { median_base(city)? };
        let ground = base_z.map_or(min[2], f64::from);
        Ok(Self {
            origin: city.origin,
            bounds: [world(min), world(max)],
            ground_z_m: city.origin[2] + ground,
            has_terrain: terrain_z.is_some(),
            generated_ground: false,
            objects: city.objects.len() as u64,
            triangles: city.triangles,
            crs: city.crs.clone(),
        })
    }

    /// Takes the plane from the generated ground, if there is some.
    pub(crate) fn set_ground(&mut self, ground: Option<&GroundReport>) {
        if let Some(ground) = ground {
            (self.ground_z_m, self.generated_ground) = (ground.plane_z_m, true);
        }
    }

    /// Lowers the ground to the lowest land around the city, if there is any.
    pub(crate) fn include_land(&mut self, lowest_m: Option<f64>) {
        self.ground_z_m = lowest_m.map_or(self.ground_z_m, |lowest_m| self.ground_z_m.min(lowest_m));
    }
}

fn lowest_terrain(city: &ScratchScene) -> Result<Option<f32>, BakeError> {
    let mut lowest: Option<f32> = None;
    city.objects.try_for_each(|_, object| {
        if object.kind == ObjectKind::Terrain {
            lowest = Some(lowest.map_or(object.base_z_m, |known| known.min(object.base_z_m)));
        }
        Ok::<_, BakeError>(())
    })?;
    Ok(lowest)
}

/// The median of the bases: found by the upper, then by the lower half of their bits, so that they need not be in memory.
fn median_base(city: &ScratchScene) -> Result<Option<f32>, BakeError> {
    let count_keys = |is_counted: &dyn Fn(u32) -> Option<u32>| {
        let mut counts = vec![0_u64; 1 << 16];
        city.objects.try_for_each(|_, object| {
            if let Some(class) = is_counted(ordered_bits(object.base_z_m)).filter(|_| object.base_z_m.is_finite()) {
                counts[class as usize] += 1;
            }
            Ok::<_, BakeError>(())
        })?;
        Ok::<_, BakeError>(counts)
    };
    let class_at = |counts: &[u64], rank: u64| {
        let mut before = 0;
        let class = counts.iter().position(|count| {
            before += count;
            before > rank
        })?;
        Some((class as u32, rank + counts[class] - before))
    };
    let upper = count_keys(&|bits| Some(bits >> 16))?;
    let Some((high, rank)) = class_at(&upper, upper.iter().sum::<u64>() / 2) else { return Ok(None) };
    let lower = count_keys(&|bits| (bits >> 16 == high).then_some(bits & 0xFFFF))?;
    Ok(class_at(&lower, rank).map(|(low, _)| from_ordered_bits(high << 16 | low)))
}

/// Numbers in the order of [`f32::total_cmp`].
fn ordered_bits(value: f32) -> u32 {
    let bits = value.to_bits();
    if bits >> 31 == 1 { !bits } else { bits | 1 << 31 }
}

/// The inverse of [`ordered_bits`].
fn from_ordered_bits(bits: u32) -> f32 {
    f32::from_bits(if bits >> 31 == 1 { bits & !(1 << 31) } else { !bits })
}

/// The input of the final files.
pub(crate) struct CityInput<'a> {
    pub(crate) config: &'a BakeConfig,
    pub(crate) grid: &'a CityGrid,
    pub(crate) facts: &'a SceneFacts,
    pub(crate) read: &'a ReadReport,
    pub(crate) tree: &'a TileTree,
    /// Position (x, y) and hash of each block of leaves.
    pub(crate) fingerprints: Vec<((u32, u32), ShortHash)>,
    /// `None` for a city without sources.
    pub(crate) objects: Option<NumberedRecords<'a>>,
    /// The city that has the tiles which are the same in this one.
    pub(crate) base: Option<&'a BakedCity>,
}

impl<'a> CityInput<'a> {
    fn base_archive(&self, kind: TileKind) -> Option<&'a Archive> {
        self.base.and_then(|city| city.archive(kind))
    }
}

#[derive(Debug)]
pub(crate) struct WrittenCity {
    pub(crate) manifest: Manifest,
    /// Size of all files.
    pub(crate) bytes: u64,
    /// Sources whose name or licence follows from what is known of their publishers.
    pub(crate) filled_in: Vec<String>,
}

/// The archives of V-BlockMaps and of meshes, if there are meshes.
#[derive(Debug)]
pub(crate) struct TileArchives {
    pub(crate) blockmaps: WrittenArchive,
    pub(crate) meshes: Option<WrittenArchive>,
}

/// Names of these archives.
pub(crate) const BLOCKMAPS_FILE: &str = "blockmaps.pmtiles";
pub(crate) const MESHES_FILE: &str = "meshes.pmtiles";

/// Writes the files into `folder`, which must not exist. Fails if a pack cannot be read or a file cannot be written.
pub(crate) fn write(
    input: CityInput<'_>,
    tiles: &mut (dyn TileContent + Send),
    folder: &Path,
    progress: &dyn Progress,
) -> Result<WrittenCity, BakeError> {
    fs::create_dir(folder).map_err(|cause| BakeError::io(folder, "created", cause))?;
    let ids: Vec<TileId> = input.tree.levels().iter().flatten().map(|tile| tile.id).collect();
    let blockmaps = archive::write(&folder.join(BLOCKMAPS_FILE), input.base_archive(TileKind::BlockMap), &ids, |id| {
        progress.advance(1);
        let stored = input.tree.get(id).ok_or_else(|| BakeError::Scratch { path: folder.to_owned() })?;
        tiles.tile(stored)
    })?;
    let has_meshes = !input.tree.meshes().is_empty();
    let meshes = has_meshes.then(|| write_meshes(&input, tiles, &folder.join(MESHES_FILE))).transpose()?;
    write_others(input, tiles, TileArchives { blockmaps, meshes }, folder, progress)
}

/// Writes all files besides `archives`, which are elsewhere or in the folder already. Fails as [`write()`].
pub(crate) fn write_others(
    input: CityInput<'_>,
    tiles: &mut (dyn TileContent + Send),
    archives: TileArchives,
    folder: &Path,
    progress: &dyn Progress,
) -> Result<WrittenCity, BakeError> {
    let TileArchives { blockmaps, meshes } = archives;
    let nodes = tile_tree::describe(input.tree, input.grid);
    let subtrees = write_subtrees(&input, &nodes, &folder.join("subtrees.pmtiles"))?;
    let terminals = nodes.iter().flatten().filter(|node| node.child_mask == 0).map(|node| node.id).collect();
    drop(nodes);
    let mut written: Vec<WrittenArchive> = [blockmaps, subtrees].into_iter().chain(meshes).collect();
    let (mut search, mut buildings, mut standing, mut sea) = (None, 0, None, SeaAndLand::default());
    if let Some(objects) = input.objects.as_ref().filter(|objects| !objects.rows.is_empty()) {
        let mut schema = objects.schema()?;
        label(&mut schema, &input, progress);
        let kinds = objects.kinds()?;
        buildings = objects.buildings(&kinds)?;
        standing = Some(objects.standing(&kinds, input.grid)?);
        sea = objects.sea_and_land(&kinds)?;
        drop(kinds);
        written.push(objects.write(&schema, input.base_archive(TileKind::Objects), &folder.join("objects.pmtiles"))?);
        search = search::write(objects, &schema, &folder.join(SEARCH_FILE))?;
    }
    let mut bytes: u64 = written.iter().map(|archive| archive.bytes).sum();
    let mut hashes: Vec<_> = written.iter().map(|archive| archive.digest).collect();
    if let Some(length) = search {
        bytes += length;
        hashes.push(hash_file(&folder.join(SEARCH_FILE))?);
    }
    let mut manifest = build_manifest(&input, standing.as_ref());
    let search_index = search.map(|_| search::checksum(&folder.join(SEARCH_FILE))).transpose()?;
    manifest.marks = Some(CityMarks { search_index });
    let Attributions { all, filled_in } = Attributions::new(&input.config.options.attribution, input.read);
    manifest.attribution = all;
    manifest.counts.buildings = Some(buildings);
    manifest.sea = sea::ends((input.tree, input.grid), [manifest.origin[0], manifest.origin[1]], &sea, tiles)?;
    if input.config.options.street_sets
        && let Some(sets) =
            write_street_sets(&input, visibility::extent(&manifest, terminals), tiles, folder, progress)?
    {
        bytes += sets.bytes;
        hashes.push(sets.digest);
        manifest.street_sets = true;
    }
    let path = folder.join("city.json");
    manifest.version = version_of(&hashes, &to_json(&manifest, &path)?);
    for path in TileKind::ALL.map(|kind| folder.join(kind.file_name())).iter().filter(|path| path.exists()) {
        mark_file(path, &manifest.version).map_err(|cause| BakeError::io(path, "written", cause))?;
    }
    let json = to_json(&manifest, &path)?;
    write_synced(&path, &json)?;
    bytes += json.len() as u64;
    bytes += Fingerprints { version: manifest.version.clone(), blocks: input.fingerprints }.write(folder)?;
    if input.config.options.picture {
        progress.stage("picture", 0);
        // A city is complete without its picture.
        let beside = input.config.base.as_ref().map_or(folder, |base| base.beside.as_path());
        match thumbnail::write([folder, beside], input.tree, tiles, &manifest, &input.config.thread_pool()?) {
            Ok(length) => bytes += length,
            Err(reason) => progress.warn(&format!("the city has no picture ({}): {reason}", thumbnail::FILE_NAME)),
        }
    }
    Ok(WrittenCity { manifest, bytes, filled_in })
}

/// Gives attributes their labels and units. Warns of labels without effect.
fn label(schema: &mut Schema, input: &CityInput<'_>, progress: &dyn Progress) {
    for unused in schema.set_labels(&input.config.options.labels) {
        progress.warn(&printable(&format!("labels: {unused}")));
    }
    schema.set_known_units(input.config.options.read.height_unit.unwrap_or(HeightUnit::Metre).symbol());
}

/// Writes the archive of subtrees. They are encoded by all threads, some at a time.
fn write_subtrees(input: &CityInput<'_>, nodes: &[Vec<NodeInfo>], path: &Path) -> Result<WrittenArchive, BakeError> {
    let mut roots = tile_tree::subtree_roots(nodes);
    roots.sort_by_cached_key(|root| archive_order(*root));
    let pool = input.config.thread_pool()?;
    let encode = |root: &TileId| tile_tree::encode_subtree(input.tree, nodes, *root);
    let encoded = |roots: &[TileId]| pool.install(|| roots.par_iter().map(encode).collect::<Vec<_>>());
    let mut subtrees = roots.chunks(SUBTREES_AT_ONCE).flat_map(encoded);
    let missing = || BakeError::Scratch { path: path.to_owned() };
    archive::write(path, input.base_archive(TileKind::Subtree), &roots, |_| subtrees.next().ok_or_else(missing)?)
}

/// Writes the archive of what can be seen from streets; `None` if the city has no sets.
fn write_street_sets(
    input: &CityInput<'_>,
    extent: CityExtent,
    tiles: &mut (dyn TileContent + Send),
    folder: &Path,
    progress: &dyn Progress,
) -> Result<Option<WrittenArchive>, BakeError> {
    let tiles = Mutex::new(tiles);
    let read = |id: TileId| {
        let stored = input.tree.get(id).ok_or_else(|| BakeError::Scratch { path: folder.to_owned() })?;
        tiles.lock().unwrap_or_else(PoisonError::into_inner).tile(stored)
    };
    let path = folder.join(TileKind::Visibility.file_name());
    visibility::write_archive(
        (&path, input.base_archive(TileKind::Visibility)),
        extent,
        read,
        input.config.threads,
        progress,
    )
}

/// Writes the archive of meshes, each level of detail under its own tile id.
fn write_meshes(input: &CityInput<'_>, tiles: &mut dyn TileContent, path: &Path) -> Result<WrittenArchive, BakeError> {
    let missing = || BakeError::Scratch { path: path.to_owned() };
    let mut by_id = HashMap::with_capacity(input.tree.meshes().len());
    for mesh in input.tree.meshes() {
        by_id.insert(mesh_tile::archive_id(mesh.id, mesh.lod).ok_or_else(missing)?, mesh);
    }
    let ids: Vec<TileId> = by_id.keys().copied().collect();
    archive::write(path, input.base_archive(TileKind::Mesh), &ids, |id| tiles.mesh(by_id.get(&id).ok_or_else(missing)?))
}

fn to_json(manifest: &Manifest, path: &Path) -> Result<Vec<u8>, BakeError> {
    let mut json = serde_json::to_vec_pretty(manifest).map_err(|cause| BakeError::io(path, "written", cause.into()))?;
    json.push(b'\n');
    Ok(json)
}

/// BLAKE3 of a file's bytes.
fn hash_file(path: &Path) -> Result<[u8; blake3::OUT_LEN], BakeError> {
    let mut hasher = blake3::Hasher::new();
    let hashed = fs::File::open(path).and_then(|mut file| io::copy(&mut file, &mut hasher));
    hashed.map_err(|cause| BakeError::io(path, "read", cause))?;
    Ok(hasher.finalize().into())
}

fn build_manifest(input: &CityInput<'_>, standing: Option<&Standing>) -> Manifest {
    let CityInput { config, grid, facts, read, tree, .. } = input;
    // What names a publisher is no place.
    let is_place = |title: &&String| !is_publisher(title);
    let of_base = || config.base.as_ref().map(|base| base.manifest.title.clone());
    let known_title = config.options.title.clone().or_else(of_base);
    let source_title = || read.sources.iter().flat_map(|source| &source.titles).find(is_place).cloned();
    let per_level = |f: fn(&[StoredTile]) -> u64| tree.levels().iter().map(|level| f(level)).collect();
    let (crs, focus) = (facts.crs.clone().or_else(|| read.crs.clone()), focus(input, standing));
    let location = crs.as_deref().and_then(|crs| locate(crs, focus));
    Manifest {
        format_version: FORMAT_VERSION,
        name: config.name.clone(),
        title: known_title.or_else(source_title).unwrap_or_else(|| config.place.clone()),
        version: String::new(),
        crs,
        origin: std::array::from_fn(|axis| facts.origin[axis] + grid.corner[axis]),
        root_side_m: grid.node_side_m(0),
        depth: grid.depth,
        node_cells: NODE_CELLS as u16,
        cell_m: grid.cell_m,
        bounds: facts.bounds,
        focus,
        ground_z_m: facts.ground_z_m,
        has_terrain: facts.has_terrain,
        generated_ground: facts.generated_ground,
        counts: CityCounts {
            objects: facts.objects,
            triangles: facts.triangles,
            nodes_per_level: per_level(|level| level.len() as u64),
            bytes_per_level: per_level(|level| level.iter().map(|tile| u64::from(tile.bytes)).sum()),
            buildings: None,
        },
        attribution: Vec::new(),
        tile_version: tile::VERSION,
        settings: config.settings.clone(),
        location,
        generated_facades: read.facades.is_some(),
        heights: read.vertical_datum.clone().map(|datum| HeightReference { datum, geoid: read.geoid.clone() }),
        stones: read.stones.clone(),
        street_sets: false,
        marks: None,
        sea: None,
        release: release(input),
    }
}

/// Of which day the city is; `None` if nobody says it.
fn release(input: &CityInput<'_>) -> Option<Release> {
    let (config, base) = (input.config, input.config.base.as_ref());
    let of = base.map_or(config.name.as_str(), |base| base.manifest.release_name()).to_owned();
    let date = config.options.date.clone()?;
    let shared = base.filter(|_| input.base.is_some()).map(BaseCity::shared).unwrap_or_default();
    Some(Release { of, date, bake_origin: input.facts.origin, shared })
}

/// What one sees first of the city: `[min, max]` in world coordinates.
fn focus(input: &CityInput<'_>, standing: Option<&Standing>) -> [[f64; 2]; 2] {
    let CityInput { grid, facts, tree, .. } = input;
    let leaves = tree.level(grid.depth).iter().map(|tile| ([tile.id.x(), tile.id.y()], tile.bytes)).collect();
    let Some(cells) = focus::of_city(leaves, standing) else {
        return [0, 1].map(|end| [facts.bounds[end][0], facts.bounds[end][1]]);
    };
    let side_m = grid.node_side_m(grid.depth);
    let along = |axis: usize, leaf: u32| facts.origin[axis] + grid.corner[axis] + f64::from(leaf) * side_m;
    let low = [0, 1].map(|axis| along(axis, cells[0][axis]).max(facts.bounds[0][axis]));
    let high = [0, 1].map(|axis| (along(axis, cells[1][axis]) + side_m).min(facts.bounds[1][axis]));
    [low, high]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Material, Scene, SceneObject, SceneTriangle};

    fn scene(objects: &[(ObjectKind, f32)]) -> Scene {
        let materials = vec![Material { rgb: [0; 3], texture: None, is_reflective: false }];
        let mut scene = Scene { origin: [1000.0, 2000.0, 50.0], materials, ..Scene::default() };
        for (i, (kind, z)) in objects.iter().enumerate() {
            scene.objects.push(SceneObject { id: i.to_string(), kind: *kind, base_z_m: *z });
            let corners = [[0.0, 0.0, *z], [1.0, 0.0, *z + 1.0], [0.0, 1.0, *z]];
            scene.triangles.push(SceneTriangle { corners, uv: [[0.0; 2]; 3], material: 0, object: i as u32 });
        }
        scene
    }

    #[test]
    fn ground_is_the_lowest_terrain_or_else_the_median_base() {
        use ObjectKind::{Building, Terrain};
        let facts = |objects: &[_]| {
            let bounds = [[0.0, 0.0, -9.0], [1.0, 1.0, 9.0]];
            SceneFacts::new(&ScratchScene::from_scene(scene(objects)).unwrap(), bounds).unwrap()
        };
        let mixed = facts(&[(Building, -9.0), (Terrain, 2.0), (Terrain, 1.0)]);
        assert_eq!((mixed.ground_z_m, mixed.has_terrain), (51.0, true));
        let buildings = facts(&[(Building, -9.0), (Building, 3.0), (Building, 4.0)]);
        assert_eq!((buildings.ground_z_m, buildings.has_terrain), (53.0, false));
        assert_eq!(buildings.bounds, [[1000.0, 2000.0, 41.0], [1001.0, 2001.0, 59.0]]);
        let mut heights: Vec<f32> = (0..777).map(|i| (i * 7919 % 1000) as f32 * 0.37 - 150.0).collect();
        let many: Vec<_> = heights.iter().map(|z| (Building, *z)).collect();
        heights.sort_by(f32::total_cmp);
        assert_eq!(facts(&many).ground_z_m, 50.0 + f64::from(heights[388]));
    }
}
