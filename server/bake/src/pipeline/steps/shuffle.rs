//! `shuffle I`: sorts the triangles of a chunk by region.
//!
//! The triangles of a region are a bundle: their objects and materials, then records as in scratch files. The bundles of a chunk are
//! one object, and a second one has their places.

use super::job::BakeSteps;
use super::layout::{
    CHUNK_KIND, CityPlan, OWN_TRIANGLES, PlannedChunk, PlannedMaterial, PlannedObject, PlannedTexture, chunk_name,
};
use super::scan::{fetch, put_file, scratch_folder, triangles_name};
use super::sealed::SealedKind;
use crate::error::BakeError;
use crate::hash::{ShortHash, short_hash};
use crate::scene::SceneTriangle;
use crate::scene::partition::{on_lattice, touched_blocks};
use crate::scene::triangle_store::{self, RECORD_BYTES, from_record, to_record};
use insula_protocol::codec::bincode;
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, HashMap};
use std::fs::{self, File, OpenOptions};
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

const INDEX_KIND: SealedKind = *b"SHUF";
/// Size of the buffers of all regions together.
const BUFFER_BYTES: usize = 16 << 20;
/// Triangles between two reports of progress.
const STEP: u64 = 1 << 16;

/// Name of the places of a chunk's bundles.
pub(super) fn index_name(chunk: usize) -> String {
    format!("shuffle/{chunk}/index")
}

fn data_name(chunk: usize) -> String {
    format!("shuffle/{chunk}/bundles")
}

/// Place of a region's bundle.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct BundlePlace {
    region: u32,
    start: u64,
    length: u64,
    pub(super) hash: ShortHash,
}

/// The triangles of a chunk that a region needs.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Bundle {
    pub(super) head: BundleHead,
    /// With indices into the head's objects and materials.
    pub(super) triangles: Vec<SceneTriangle>,
}

/// What the triangles of a bundle show.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct BundleHead {
    pub(super) objects: Vec<PlannedObject>,
    pub(super) materials: Vec<PlannedMaterial>,
    pub(super) textures: Vec<PlannedTexture>,
}

impl Bundle {
    /// Its length in 8 bytes, the head, the triangles.
    fn to_bytes(&self) -> Option<Vec<u8>> {
        let head = bincode::to_bytes(&self.head).ok()?;
        let mut bytes = (head.len() as u64).to_le_bytes().to_vec();
        bytes.extend(head);
        self.triangles.iter().for_each(|triangle| bytes.extend_from_slice(&to_record(triangle)));
        Some(bytes)
    }

    /// The inverse of [`Self::to_bytes`]; `None` for bytes that are no bundle.
    fn from_bytes(bytes: &[u8]) -> Option<Self> {
        let (length, rest) = bytes.split_first_chunk::<8>()?;
        let (head, records) = rest.split_at_checked(usize::try_from(u64::from_le_bytes(*length)).ok()?)?;
        let head: BundleHead = bincode::long_from_bytes(head).ok()?;
        let (records, rest) = records.as_chunks::<RECORD_BYTES>();
        let triangles: Vec<SceneTriangle> = records.iter().map(from_record).collect();
        let has = |triangle: &SceneTriangle| {
            (triangle.object as usize) < head.objects.len() && (triangle.material as usize) < head.materials.len()
        };
        (rest.is_empty() && triangles.iter().all(has)).then_some(Self { head, triangles })
    }
}

impl BakeSteps<'_> {
    /// Sorts a chunk by region. The last chunk may have the triangles that no scan made. Fails if the plan is missing.
    pub(super) fn shuffle(&self, chunk: usize) -> Result<(), BakeError> {
        let plan = self.read_plan()?;
        self.check_task("shuffle", chunk, plan.chunks)?;
        let objects = self.objects();
        let planned: PlannedChunk = objects.read(&chunk_name(chunk), CHUNK_KIND)?;
        let folder = scratch_folder()?;
        let path = folder.path().join("triangles");
        let name = if chunk < self.chunks().len() { triangles_name(chunk) } else { OWN_TRIANGLES.to_owned() };
        fetch(objects, &name, &path)?;
        let damaged = || objects.damaged(&name, "its triangles are not those of the plan");
        self.progress.stage("shuffle", fs::metadata(&path).map_or(0, |meta| meta.len() / RECORD_BYTES as u64));
        let mut sorter = RegionSorter::new(&plan, folder.path(), self.config.options.sample.margin_m);
        let mut count = 0;
        triangle_store::read_file(&path, &mut |mut triangle| {
            count += 1;
            if count % STEP == 0 {
                self.progress.advance(STEP);
            }
            triangle.object = triangle.object.checked_sub(planned.first_object).ok_or_else(damaged)?;
            triangle.material = triangle.material.checked_sub(planned.first_material).ok_or_else(damaged)?;
            let object = planned.objects.get(triangle.object as usize).ok_or_else(damaged)?;
            if planned.materials.len() <= triangle.material as usize {
                return Err(damaged());
            }
            if object.shown.is_some() { sorter.add(&triangle, object.offset_m) } else { Ok(()) }
        })?;
        sorter.flush()?;
        let (data, places) = sorter.into_bundles(&planned)?;
        put_file(objects, &data_name(chunk), &data)?;
        objects.write(&index_name(chunk), INDEX_KIND, &places)
    }

    /// Chunk and place of each bundle of a region, in the order of the chunks. Fails if a chunk is not shuffled.
    pub(super) fn bundles(&self, chunks: usize, region: usize) -> Result<Vec<(usize, BundlePlace)>, BakeError> {
        let mut found = Vec::new();
        for chunk in 0..chunks {
            let places: Vec<BundlePlace> = self.objects().read(&index_name(chunk), INDEX_KIND)?;
            found.extend(places.into_iter().find(|place| place.region as usize == region).map(|place| (chunk, place)));
        }
        Ok(found)
    }

    /// A bundle of a chunk. Fails if it cannot be read, or is damaged.
    pub(super) fn bundle(&self, chunk: usize, place: BundlePlace) -> Result<Bundle, BakeError> {
        let objects = self.objects();
        let name = data_name(chunk);
        let bytes = objects.store.range(&name, place.start, place.length);
        let bytes = bytes.map_err(|cause| objects.failed(&name, cause))?;
        if short_hash(&blake3::hash(&bytes)) != place.hash {
            return Err(objects.damaged(&name, "a bundle has another hash"));
        }
        Bundle::from_bytes(&bytes).ok_or_else(|| objects.damaged(&name, "a bundle is damaged"))
    }
}

/// Sorts triangles by region, in a file for each.
struct RegionSorter<'a> {
    plan: &'a CityPlan,
    numbers: HashMap<[u32; 2], u32>,
    folder: &'a Path,
    margin_m: f64,
    buffers: BTreeMap<u32, Vec<u8>>,
    buffered: usize,
    /// Regions with a file.
    written: BTreeMap<u32, PathBuf>,
}

impl<'a> RegionSorter<'a> {
    fn new(plan: &'a CityPlan, folder: &'a Path, margin_m: f64) -> Self {
        let (numbers, buffers, written) = (plan.region_numbers(), BTreeMap::new(), BTreeMap::new());
        Self { plan, numbers, folder, margin_m, buffers, buffered: 0, written }
    }

    /// Adds a triangle to all regions that need it. Fails if a file cannot be written.
    fn add(&mut self, triangle: &SceneTriangle, offset_m: [f64; 3]) -> Result<(), BakeError> {
        let exact = triangle.corners.map(|corner| std::array::from_fn(|axis| f64::from(corner[axis]) + offset_m[axis]));
        let side = self.plan.region_blocks();
        let blocks = touched_blocks(&on_lattice(&exact, &self.plan.grid), self.margin_m, &self.plan.grid);
        let [x, y] = blocks.map(|range| range.map(|n| n / side));
        let record = to_record(triangle);
        for place in (y[0]..=y[1]).flat_map(|y| (x[0]..=x[1]).map(move |x| [x, y])) {
            let Some(region) = self.numbers.get(&place) else { continue };
            self.buffers.entry(*region).or_default().extend_from_slice(&record);
            self.buffered += RECORD_BYTES;
        }
        if self.buffered >= BUFFER_BYTES { self.flush() } else { Ok(()) }
    }

    /// Appends all buffers to their files.
    fn flush(&mut self) -> Result<(), BakeError> {
        for (region, buffer) in std::mem::take(&mut self.buffers) {
            let path = self.written.entry(region).or_insert_with(|| self.folder.join(format!("region-{region}")));
            let opened = OpenOptions::new().append(true).create(true).open(&*path);
            let written = opened.and_then(|mut file| file.write_all(&buffer));
            written.map_err(|cause| BakeError::io(path, "written", cause))?;
        }
        self.buffered = 0;
        Ok(())
    }

    /// Writes the bundles, in the order of the regions. Fails if that is not possible.
    fn into_bundles(self, planned: &PlannedChunk) -> Result<(PathBuf, Vec<BundlePlace>), BakeError> {
        let data = self.folder.join("bundles");
        let failed = |cause| BakeError::io(&data, "written", cause);
        let mut writer = BufWriter::new(File::create(&data).map_err(failed)?);
        let (mut start, mut places) = (0, Vec::with_capacity(self.written.len()));
        for (region, path) in &self.written {
            let mut triangles = Vec::new();
            triangle_store::read_file(path, &mut |triangle| {
                triangles.push(triangle);
                Ok(())
            })?;
            fs::remove_file(path).map_err(|cause| BakeError::io(path, "removed", cause))?;
            let bundle = bundle_of(triangles, planned).to_bytes();
            let bytes = bundle.ok_or_else(|| BakeError::Scratch { path: path.clone() })?;
            writer.write_all(&bytes).map_err(failed)?;
            let (length, hash) = (bytes.len() as u64, short_hash(&blake3::hash(&bytes)));
            places.push(BundlePlace { region: *region, start, length, hash });
            start += length;
        }
        writer.flush().map_err(failed)?;
        drop(writer);
        Ok((data, places))
    }
}

/// The bundle of triangles that have a chunk's numbers, which must be in range. It depends on nothing else of the chunk.
fn bundle_of(mut triangles: Vec<SceneTriangle>, planned: &PlannedChunk) -> Bundle {
    let (mut objects, mut materials, mut textures) = (Vec::new(), Vec::new(), Vec::<PlannedTexture>::new());
    let (mut known_objects, mut known_materials, mut known_textures) = (HashMap::new(), HashMap::new(), HashMap::new());
    for triangle in &mut triangles {
        triangle.object = *known_objects.entry(triangle.object).or_insert_with_key(|number| {
            objects.push(planned.objects[*number as usize]);
            objects.len() as u32 - 1
        });
        triangle.material = *known_materials.entry(triangle.material).or_insert_with_key(|number| {
            let material = planned.materials[*number as usize];
            let texture = material.texture.map(|texture| {
                *known_textures.entry(texture).or_insert_with(|| {
                    textures.extend(planned.textures.get(texture as usize).cloned());
                    textures.len() as u32 - 1
                })
            });
            materials.push(PlannedMaterial { texture, ..material });
            materials.len() as u32 - 1
        });
    }
    Bundle { head: BundleHead { objects, materials, textures }, triangles }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pipeline::steps::layout::NumberedShape;
    use crate::scene::ObjectKind;

    fn chunk() -> PlannedChunk {
        let shown = NumberedShape { kind: ObjectKind::Building, base_z_m: 1.5, number: 7, landmark: None };
        let object = |x: f64| PlannedObject { offset_m: [x, 0.0, 0.0], shown: Some(shown) };
        let material = |red: u8| PlannedMaterial { rgb: [red, 2, 3], texture: None, is_reflective: false };
        PlannedChunk {
            first_object: 0,
            objects: (0..5).map(|i| object(f64::from(i))).collect(),
            first_material: 0,
            materials: (10..13).map(material).collect(),
            textures: Vec::new(),
        }
    }

    fn triangle(object: u32, material: u32) -> SceneTriangle {
        SceneTriangle { corners: [[0.5, -1.0, 7.0]; 3], uv: [[0.25; 2]; 3], material, object }
    }

    #[test]
    fn bundles_have_what_their_triangles_show_and_return_from_bytes() {
        let bundle = bundle_of(vec![triangle(3, 2), triangle(1, 2), triangle(3, 0)], &chunk());
        assert_eq!(bundle.head.objects.iter().map(|o| o.offset_m[0]).collect::<Vec<_>>(), [3.0, 1.0]);
        assert_eq!(bundle.head.materials.iter().map(|m| m.rgb[0]).collect::<Vec<_>>(), [12, 10]);
        assert_eq!(
            bundle.triangles.iter().map(|t| (t.object, t.material)).collect::<Vec<_>>(),
            [(0, 0), (1, 0), (0, 1)]
        );
        let bytes = bundle.to_bytes().unwrap();
        assert_eq!(Bundle::from_bytes(&bytes), Some(bundle));
        for cut in 0..bytes.len() {
            let part = Bundle::from_bytes(&bytes[..cut]);
            // Whole triangles at the end may be missing: the hash of the bundle tells.
            assert!(part.is_none() || (bytes.len() - cut).is_multiple_of(RECORD_BYTES), "cut to {cut}");
        }
        let mut bad = bytes.clone();
        bad[..8].copy_from_slice(&u64::MAX.to_le_bytes());
        assert_eq!(Bundle::from_bytes(&bad), None);
        let mut bad = bytes;
        let end = bad.len();
        bad[end - 4..].copy_from_slice(&9_u32.to_le_bytes());
        assert_eq!(Bundle::from_bytes(&bad), None, "an object that the bundle does not have");
    }
}
