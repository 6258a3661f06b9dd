//! `plan`: decides everything that depends on the whole city.

use super::job::BakeSteps;
use super::layout::{
    CHUNK_KIND, CityPlan, NUMBERS_KIND, NumberedShape, OWN_RECORDS, OWN_TRIANGLES, PLAN, PLAN_KIND, PlannedChunk,
    PlannedLandmark, PlannedMaterial, PlannedObject, PlannedTexture, REPORT, REPORT_KIND, ROWS_KIND, ROWS_PER_OBJECT,
    chunk_name, numbers_name, rows_name,
};
use super::scan::{fetch, picture_name, put_file, scratch_folder, shapes_name, triangles_name};
use super::sealed::SealedStore;
use crate::error::BakeError;
use crate::ground;
use crate::hash::ShortHash;
use crate::pipeline::far_land::MAX_CELL_M;
use crate::pipeline::frame::CityFrame;
use crate::read::{LandFacts, PartsCity, RECORDS, SceneParts};
use crate::scene::grid::{BLOCK_LEAVES, CityGrid};
use crate::scene::object_numbers::{IdentityKey, NumberedObject, ObjectNumbers};
use crate::scene::partition::{on_lattice, touched_blocks};
use crate::scene::scratch_scene::{ObjectPlacement, ScratchScene, StoredObject};
use crate::scene::texture_store::texture_path;
use crate::scene::{Landmark, ObjectKind, triangle_store};
use insula_protocol::TileId;
use insula_scratch::record_list::RecordList;
use std::collections::{BTreeSet, HashMap, HashSet};
use std::fs;
use std::path::Path;

/// Folder of textures by number.
const TEXTURES: &str = "textures";
/// Boxes of objects are rounded: they are taken to be so much larger, in metres.
const BOX_SLACK_M: f64 = 1.0;
/// Most regions. A country has some ten thousand.
const MAX_REGIONS: usize = 1 << 22;

impl BakeSteps<'_> {
    /// Plans the city from all scans. Fails if a scan is missing, if the sources give no city, or if it is too wide.
    pub(super) fn plan(&self) -> Result<(), BakeError> {
        let objects = self.objects();
        self.progress.stage("plan", 0);
        let folder = scratch_folder()?;
        let parts = self.fetch_parts(folder.path())?;
        let known_textures = parts.textures().len();
        let PartsCity { mut city, surroundings, report, materials, mut first_objects, pictures, own_record_bytes } =
            parts.assemble(&self.config.options.read)?;
        report.warnings().for_each(|warning| self.progress.warn(&warning));
        let cell_m = self.config.options.cell_m;
        let empty = BakeError::Empty { triangles: 0, cell_m };
        let (land, add_ground) = (surroundings.as_ref(), |city: &mut ScratchScene| ground::add(city, cell_m));
        let frame = CityFrame::new(&mut city, land, &self.config, self.progress, add_ground)?;
        let CityFrame { facts, grid, plane_m, .. } = frame;
        let land = surroundings.map(|land| land.facts());
        let numbers = ObjectNumbers::new(&city, &grid, &self.known_numbers()?)?;
        let region_level = grid.depth.saturating_sub(self.region_leaves().ilog2() as u8);
        // Triangles that no scan made, those of terrain and landmarks, are a chunk of their own.
        let scans = self.chunks().len();
        if first_objects.last().is_some_and(|first| *first as usize == city.placements.len()) {
            first_objects.pop();
        } else {
            let own = city.stored.own_file().ok_or(empty)?;
            put_file(objects, OWN_TRIANGLES, own.path())?;
        }
        put_file(objects, OWN_RECORDS, &folder.path().join(RECORDS))?;
        for (number, picture) in pictures.iter().enumerate().skip(known_textures) {
            put_file(objects, &picture_name(*picture), &texture_path(&folder.path().join(TEXTURES), number as u32))?;
        }
        let regions = regions(&city, &grid, region_level, land)?;
        let landmark = |l: &Landmark| (l.object, PlannedLandmark { stone: l.stone, anchor_m: l.anchor_m });
        let landmarks = city.landmarks.iter().map(landmark).collect();
        let planner = ChunkPlanner { city: &city, numbers: &numbers.of_object, pictures: &pictures, landmarks };
        let ends = first_objects.iter().skip(1).copied().chain([city.placements.len() as u32]);
        for (chunk, (first, end)) in first_objects.iter().copied().zip(ends).enumerate() {
            let all = || (0..city.materials.len() as u32).collect();
            let materials: Vec<u32> = materials.get(chunk).cloned().unwrap_or_else(all);
            let mut planned = planner.chunk([first, end], &materials)?;
            if chunk < scans {
                // Scans number their own objects.
                planned.first_object = 0;
            }
            objects.write(&chunk_name(chunk), CHUNK_KIND, &planned)?;
        }
        self.write_rows(&numbers.rows)?;
        self.write_numbers(&city, &numbers)?;
        objects.write(REPORT, REPORT_KIND, &report)?;
        let (chunks, rows) = (first_objects.len(), numbers.rows.len());
        let plan = CityPlan { grid, facts, plane_m, land, region_level, regions, chunks, own_record_bytes, rows };
        objects.write(PLAN, PLAN_KIND, &plan)
    }

    fn write_rows(&self, rows: &RecordList<Option<NumberedObject>>) -> Result<(), BakeError> {
        for (part, first) in (0..rows.len()).step_by(ROWS_PER_OBJECT).enumerate() {
            let range = first..rows.len().min(first + ROWS_PER_OBJECT);
            let mut some: Vec<Option<NumberedObject>> = Vec::with_capacity(range.len());
            rows.for_range(range, |_, row| {
                some.push(*row);
                Ok::<_, BakeError>(())
            })?;
            self.objects().write(&rows_name(part), ROWS_KIND, &some)?;
        }
        Ok(())
    }

    /// Writes the hash of each object's identifier by number, for the job that updates the city.
    fn write_numbers(&self, city: &ScratchScene, numbers: &ObjectNumbers) -> Result<(), BakeError> {
        let objects = self.objects();
        let (mut hashes, mut part) = (Vec::with_capacity(ROWS_PER_OBJECT), 0);
        let mut named = numbers.identifiers(city)?;
        loop {
            let next = named.read_next()?;
            if next.is_none() || hashes.len() == ROWS_PER_OBJECT {
                objects.write(&numbers_name(objects.job, part), NUMBERS_KIND, &hashes)?;
                hashes.clear();
                part += 1;
            }
            let Some(named) = next else { return Ok(()) };
            hashes.push(named);
        }
    }

    /// The numbers of the objects of the city that is updated. They are in memory together.
    fn known_numbers(&self) -> Result<HashMap<IdentityKey, u32>, BakeError> {
        let mut known = HashMap::new();
        let Some(previous) = self.job.previous() else { return Ok(known) };
        let objects = SealedStore { job: previous, ..self.objects() };
        let mut occurrences: HashMap<u64, u32> = HashMap::new();
        for part in 0.. {
            let Some(some) = objects.find::<Vec<(u32, u64)>>(&numbers_name(previous, part), NUMBERS_KIND)? else {
                break;
            };
            for (number, hash) in some {
                let count = occurrences.entry(hash).or_default();
                known.insert((hash, *count), number);
                *count += 1;
            }
        }
        Ok(known)
    }

    /// The plan. Fails if there is none yet, or if it is damaged.
    pub(super) fn read_plan(&self) -> Result<CityPlan, BakeError> {
        let plan: CityPlan = self.objects().read(PLAN, PLAN_KIND)?;
        if plan.is_valid() { Ok(plan) } else { Err(self.objects().damaged(PLAN, "its fields are damaged")) }
    }

    /// All scans with their files, and the textures if their light is measured.
    fn fetch_parts(&self, folder: &Path) -> Result<SceneParts<'_>, BakeError> {
        let objects = self.objects();
        let textures = folder.join(TEXTURES);
        fs::create_dir(&textures).map_err(|cause| BakeError::io(&textures, "created", cause))?;
        // Only for these, the inputs must be at hand.
        let inputs = self.job.has_elevation().then(|| self.list_inputs()).transpose()?;
        let cache_bytes = self.config.texture_cache_bytes();
        let mut parts = SceneParts::new(inputs.as_ref(), &self.config.options.read, folder, &textures, cache_bytes)?;
        for chunk in 0..self.chunks().len() {
            let [triangles, shapes] = ["triangles", "shapes"].map(|name| folder.join(format!("{name}-{chunk}")));
            fetch(objects, &triangles_name(chunk), &triangles)?;
            fetch(objects, &shapes_name(chunk), &shapes)?;
            parts.add(self.head(chunk)?, triangles, &shapes)?;
        }
        for (number, facts) in (0..).zip(parts.textures()) {
            fetch(objects, &picture_name(facts.hash()), &texture_path(&textures, number))?;
        }
        Ok(parts)
    }
}

/// Makes the plans of chunks.
struct ChunkPlanner<'a> {
    city: &'a ScratchScene,
    /// Of each object.
    numbers: &'a RecordList<u32>,
    /// Of each texture.
    pictures: &'a [ShortHash],
    landmarks: HashMap<u32, PlannedLandmark>,
}

impl ChunkPlanner<'_> {
    /// What becomes of the objects from a number to another. Fails if they cannot be read.
    fn chunk(&self, [first, end]: [u32; 2], materials: &[u32]) -> Result<PlannedChunk, BakeError> {
        let city = self.city;
        let mut objects = Vec::with_capacity(end.saturating_sub(first) as usize);
        city.placements.for_range(first as usize..end as usize, |_, ObjectPlacement { offset_m, object }| {
            let shape = |object: u32| {
                let number = self.numbers.get(object as usize)?;
                let StoredObject { kind, base_z_m, .. } = city.objects.get(object as usize)?;
                let landmark = self.landmarks.get(&object).copied();
                Ok::<_, BakeError>(NumberedShape { kind, base_z_m, number, landmark })
            };
            objects.push(PlannedObject { offset_m: *offset_m, shown: object.map(shape).transpose()? });
            Ok::<_, BakeError>(())
        })?;
        let used: BTreeSet<u32> =
            materials.iter().filter_map(|number| city.materials[*number as usize].texture).collect();
        let index: HashMap<u32, u32> = used.iter().copied().zip(0..).collect();
        let material = |number: &u32| {
            let material = city.materials[*number as usize];
            let texture = material.texture.and_then(|texture| index.get(&texture).copied());
            PlannedMaterial { rgb: material.rgb, texture, is_reflective: material.is_reflective }
        };
        let materials = materials.iter().map(material).collect();
        let texture = |number: u32| {
            let (facts, picture) = (city.textures.facts()[number as usize].clone(), self.pictures[number as usize]);
            PlannedTexture { facts, picture }
        };
        let textures = used.into_iter().map(texture).collect();
        Ok(PlannedChunk { first_object: first, objects, first_material: 0, materials, textures })
    }
}

/// Columns and rows of the regions that may have content, along the Hilbert curve. Fails if there are too many.
fn regions(
    city: &ScratchScene,
    grid: &CityGrid,
    level: u8,
    land: Option<LandFacts>,
) -> Result<Vec<[u32; 2]>, BakeError> {
    let side = ((1 << (grid.depth - level)) / BLOCK_LEAVES).max(1);
    let mut found = HashSet::new();
    let mut add = |corners: &[[f64; 3]; 3], slack_m: f64| {
        let [x, y] = touched_blocks(&on_lattice(corners, grid), slack_m, grid).map(|range| range.map(|n| n / side));
        for y in y[0]..=y[1] {
            for x in x[0]..=x[1] {
                found.insert([x, y]);
                if found.len() > MAX_REGIONS {
                    let side_m = grid.block_side_m() * f64::from(side);
                    return Err(BakeError::TooManyBlocks { limit: MAX_REGIONS, side_m });
                }
            }
        }
        Ok(())
    };
    city.objects.try_for_each(|_, object| {
        let [low, high] = object.bounds_m.map(|corner| corner.map(f64::from));
        let has_box = object.kind != ObjectKind::GeneratedGround && (0..3).all(|axis| low[axis] <= high[axis]);
        if has_box { add(&[low, high, high], BOX_SLACK_M) } else { Ok(()) }
    })?;
    // Land that is coarser than a region is the crown's.
    if let Some([low, high]) = land.filter(|_| grid.cell_m_at(level) > MAX_CELL_M).map(|land| land.bounds) {
        let placed = |corner: [f64; 2]| [corner[0] - city.origin[0], corner[1] - city.origin[1], 0.0];
        add(&[placed(low), placed(high), placed(high)], 0.0)?;
    }
    if let Some(own) = city.stored.own_file() {
        let mut placements = city.placements.cursor();
        triangle_store::read_file(own.path(), &mut |triangle| {
            let ObjectPlacement { offset_m, object } = *placements.get(triangle.object as usize)?;
            let placed = |corner: [f32; 3]| std::array::from_fn(|axis| f64::from(corner[axis]) + offset_m[axis]);
            if object.is_some() { add(&triangle.corners.map(placed), 0.0) } else { Ok(()) }
        })?;
    }
    let mut regions: Vec<[u32; 2]> = found.into_iter().filter(|[x, y]| TileId::new(level, *x, *y).is_some()).collect();
    regions.sort_unstable_by_key(|[x, y]| fast_hilbert::xy2h(*x, *y, level));
    Ok(regions)
}
