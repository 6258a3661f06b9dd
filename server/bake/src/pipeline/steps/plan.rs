//! `plan`: decides everything that depends on the whole city.

use std::{
    collections::{BTreeSet, HashSet},
    fs,
    path::Path,
};

use insula_protocol::TileId;

use super::{
    job::BakeSteps,
    layout::{
        CHUNK_KIND, CityPlan, GROUND, NumberedShape, PLAN, PLAN_KIND, PlannedChunk, PlannedMaterial, PlannedObject,
        PlannedTexture, REPORT, REPORT_KIND, ROWS_KIND, ROWS_PER_OBJECT, chunk_name, rows_name,
    },
    scan::{fetch, picture_name, put_file, scratch_folder, triangles_name},
};
use crate::{
    error::BakeError,
    ground::{self, GroundOption, GroundReport},
    hash::ShortHash,
    pipeline::hashed::city_grid,
    read::{PartFiles, PartsCity, SceneParts},
    scene::{
        ObjectKind,
        grid::{BLOCK_LEAVES, CityGrid},
        object_numbers::{NumberedObject, ObjectNumbers},
        partition::{on_lattice, touched_blocks},
        scratch_scene::{ObjectPlacement, ScratchScene},
        texture_store::texture_path,
        triangle_store,
    },
    write::city::SceneFacts,
};

/// Boxes of objects are rounded: they are taken to be so much larger, in metres.
const BOX_SLACK_M: f64 = 1.0;
/// Most regions. A country has some ten thousand.
const MAX_REGIONS: usize = 1 << 22;

impl BakeSteps<'_> {
    /// Plans the city from all scans. Fails if a scan is missing, if the sources give no city, or if it is too wide.
    pub fn plan(&self) -> Result<(), BakeError> {
        let objects = self.objects();
        if objects.has(PLAN)? {
            return Ok(());
        }
        self.progress.stage("plan", 0);
        let folder = scratch_folder()?;
        let (parts, pictures) = self.fetch_parts(folder.path())?;
        let PartsCity { mut city, report, materials, mut first_objects } =
            parts.assemble(&self.read_options, folder.path(), self.config.texture_cache_bytes())?;
        let cell_m = self.config.cell_m;
        let empty = BakeError::Empty { triangles: 0, cell_m };
        let Some(bounds) = city.bounds else { return Err(empty) };
        let mut facts = SceneFacts::new(&city, bounds);
        let ground = match self.config.ground {
            GroundOption::None => None,
            GroundOption::Auto => ground::add(&mut city, cell_m)?,
        };
        facts.set_ground(ground.as_ref());
        let grid = city_grid(&city, city.bounds.unwrap_or(bounds), None, cell_m)?;
        let numbers = ObjectNumbers::new(&city, &grid, &Default::default());
        let region_level = grid.depth.saturating_sub(self.region_leaves().ilog2() as u8);
        // The triangles of generated ground are those of the city's own file.
        let has_ground = ground.is_some();
        if has_ground {
            let own = city.stored.own_file().ok_or(empty)?;
            put_file(objects, GROUND, own.path())?;
            first_objects.push(city.placements.len() as u32 - 1);
        }
        let regions = regions(&city, &grid, region_level)?;
        let planner = ChunkPlanner { city: &city, numbers: &numbers.of_object, pictures: &pictures };
        let ends = first_objects.iter().skip(1).copied().chain([city.placements.len() as u32]);
        for (chunk, (first, end)) in first_objects.iter().copied().zip(ends).enumerate() {
            let of_ground = [city.materials.len() as u32 - 1];
            let materials = materials.get(chunk).map_or(&of_ground[..], Vec::as_slice);
            let mut planned = planner.chunk([first, end], materials);
            if chunk < self.chunks().len() {
                // Scans number their own objects.
                planned.first_object = 0;
            } else {
                planned.first_material = of_ground[0];
            }
            objects.write(&chunk_name(chunk), CHUNK_KIND, &planned)?;
        }
        for (part, rows) in numbers.rows.chunks(ROWS_PER_OBJECT).enumerate() {
            let rows: Vec<Option<NumberedObject>> = rows.to_vec();
            objects.write(&rows_name(part), ROWS_KIND, &rows)?;
        }
        objects.write(REPORT, REPORT_KIND, &report)?;
        let above_zero = |ground: &GroundReport| (ground.plane_z_m - city.origin[2] - grid.corner[2]) as f32;
        let plane_m = ground.as_ref().filter(|ground| !ground.around_terrain).map(above_zero);
        let (chunks, rows) = (first_objects.len(), numbers.rows.len());
        let plan = CityPlan { grid, facts, ground, plane_m, region_level, regions, chunks, rows };
        objects.write(PLAN, PLAN_KIND, &plan)
    }

    /// The plan. Fails if there is none yet, or if it is damaged.
    pub(super) fn read_plan(&self) -> Result<CityPlan, BakeError> {
        let plan: CityPlan = self.objects().read(PLAN, PLAN_KIND)?;
        if plan.is_valid() { Ok(plan) } else { Err(self.objects().damaged(PLAN, "its fields are damaged")) }
    }

    /// All scans with their triangles, and the textures if their light is measured; and by what these are found.
    fn fetch_parts(&self, folder: &Path) -> Result<(SceneParts, Vec<ShortHash>), BakeError> {
        let objects = self.objects();
        let mut parts = Vec::with_capacity(self.chunks().len());
        for chunk in 0..self.chunks().len() {
            let triangles = folder.join(format!("triangles-{chunk}"));
            let head = self.head(chunk)?;
            fetch(objects, &triangles_name(chunk), &triangles)?;
            parts.push(PartFiles { head, triangles });
        }
        let textures = folder.join("textures");
        fs::create_dir(&textures).map_err(|cause| BakeError::io(&textures, "created", cause))?;
        let facts = SceneParts::textures(&parts);
        for (number, facts) in (0..).zip(&facts) {
            fetch(objects, &picture_name(facts.hash()), &texture_path(&textures, number))?;
        }
        Ok((SceneParts { parts, textures }, facts.iter().map(|facts| facts.hash()).collect()))
    }
}

/// Makes the plans of chunks.
struct ChunkPlanner<'a> {
    city: &'a ScratchScene,
    /// Of each object.
    numbers: &'a [u32],
    /// Of each texture.
    pictures: &'a [ShortHash],
}

impl ChunkPlanner<'_> {
    /// What becomes of the objects from a number to another.
    fn chunk(&self, [first, end]: [u32; 2], materials: &[u32]) -> PlannedChunk {
        let city = self.city;
        let object = |placement: &ObjectPlacement| {
            let shown = placement.object.map(|object| {
                let number = self.numbers[object as usize];
                let object = &city.objects[object as usize];
                NumberedShape { kind: object.kind, base_z_m: object.base_z_m, number }
            });
            PlannedObject { offset_m: placement.offset_m, shown }
        };
        let objects = city.placements[first as usize..end as usize].iter().map(object).collect();
        let material = |number: &u32| {
            let material = city.materials[*number as usize];
            let (rgb, texture, is_reflective) = (material.rgb, material.texture, material.is_reflective);
            PlannedMaterial { number: *number, rgb, texture, is_reflective }
        };
        let materials: Vec<PlannedMaterial> = materials.iter().map(material).collect();
        let used: BTreeSet<u32> = materials.iter().filter_map(|material| material.texture).collect();
        let texture = |number: u32| {
            let (facts, picture) = (city.textures.facts()[number as usize].clone(), self.pictures[number as usize]);
            PlannedTexture { number, facts, picture }
        };
        let textures = used.into_iter().map(texture).collect();
        PlannedChunk { first_object: first, objects, first_material: 0, materials, textures }
    }
}

/// Columns and rows of the regions that may have content, along the Hilbert curve. Fails if there are too many.
fn regions(city: &ScratchScene, grid: &CityGrid, level: u8) -> Result<Vec<[u32; 2]>, BakeError> {
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
    for object in city.objects.iter().filter(|object| object.kind != ObjectKind::GeneratedGround) {
        let [low, high] = object.bounds_m.map(|corner| corner.map(f64::from));
        if (0..3).all(|axis| low[axis] <= high[axis]) {
            add(&[low, high, high], BOX_SLACK_M)?;
        }
    }
    if let Some(own) = city.stored.own_file() {
        triangle_store::read_file(own.path(), &mut |triangle| {
            add(&triangle.corners.map(|corner| corner.map(f64::from)), 0.0)
        })?;
    }
    let mut regions: Vec<[u32; 2]> = found.into_iter().filter(|[x, y]| TileId::new(level, *x, *y).is_some()).collect();
    regions.sort_unstable_by_key(|[x, y]| fast_hilbert::xy2h(*x, *y, level));
    Ok(regions)
}
