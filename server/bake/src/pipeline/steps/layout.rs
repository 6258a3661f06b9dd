//! What the plan decides: the grid and its regions, and what becomes of each object.

use crate::hash::ShortHash;
use crate::read::LandFacts;
use crate::scene::ObjectKind;
use crate::scene::grid::{BLOCK_LEAVES, CityGrid};
use crate::scene::partition::BlockSquare;
use crate::scene::texture_store::TextureFacts;
use crate::write::city::SceneFacts;
use insula_protocol::TileId;
use serde::{Deserialize, Serialize};
use std::collections::HashMap;

/// Folders of what the steps of one job write, which no other job uses.
pub(super) const RESULTS: [&str; 8] = ["temporary", "scan", "plan", "shuffle", "region", "crown", "join", "parts"];

/// Folders of objects that later jobs use, too.
const SHARED: [&str; 4] = ["pic", "tiles", "numbers", "city"];
/// All folders in which steps write.
pub(super) const FOLDERS: [&str; 12] = {
    let mut all = [""; 12];
    let mut at = 0;
    while at < all.len() {
        all[at] = if at < RESULTS.len() { RESULTS[at] } else { SHARED[at - RESULTS.len()] };
        at += 1;
    }
    all
};

/// Name of the object that the last step writes last.
pub(super) const JOINED: &str = "join/joined";
/// Name and kind of the plan's object, which is written last.
pub(super) const PLAN: &str = "plan/plan";
pub(super) const PLAN_KIND: [u8; 4] = *b"PLAN";
/// The report of what was read.
pub(super) const REPORT: &str = "plan/report";
pub(super) const REPORT_KIND: [u8; 4] = *b"READ";
/// The triangles that are of no scan: terrain, landmarks, generated ground.
pub(super) const OWN_TRIANGLES: &str = "plan/triangles";
/// What is known of their objects.
pub(super) const OWN_RECORDS: &str = "plan/records";
pub(super) const CHUNK_KIND: [u8; 4] = *b"CHNK";
pub(super) const ROWS_KIND: [u8; 4] = *b"ROWS";
/// Numbered objects in one object of the store.
pub(super) const ROWS_PER_OBJECT: usize = 1 << 15;

/// Name of what the plan says of a chunk.
pub(super) fn chunk_name(chunk: usize) -> String {
    format!("plan/chunk-{chunk}")
}

/// Name of a part of the hashes of the objects' identifiers, by number, which a later job needs.
pub(super) fn numbers_name(job: &str, part: usize) -> String {
    format!("numbers/{job}/{part}")
}
pub(super) const NUMBERS_KIND: [u8; 4] = *b"NUMS";

/// Name of a part of the numbered objects.
pub(super) fn rows_name(part: usize) -> String {
    format!("plan/rows-{part}")
}

#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct CityPlan {
    pub(super) grid: CityGrid,
    pub(super) facts: SceneFacts,
    /// Height of the plane above the grid's height zero, if generated ground ends at it.
    pub(super) plane_m: Option<f32>,
    /// The land around the city.
    pub(super) land: Option<LandFacts>,
    /// Level of the regions' roots.
    pub(super) region_level: u8,
    /// Column and row of each region that may have content, along the Hilbert curve.
    pub(super) regions: Vec<[u32; 2]>,
    /// Number of chunks, with that of the triangles that are of no scan.
    pub(super) chunks: usize,
    /// Size of the records that are of no scan.
    pub(super) own_record_bytes: u64,
    /// Number of numbered objects.
    pub(super) rows: usize,
}

impl CityPlan {
    /// Whether the regions are those of a grid.
    pub(super) fn is_valid(&self) -> bool {
        let is_region = |[x, y]: &[u32; 2]| TileId::new(self.region_level, *x, *y).is_some();
        self.grid.depth <= insula_protocol::tile_id::MAX_LEVEL
            && self.region_level <= self.grid.depth
            && self.grid.cell_m > 0.0
            && self.regions.iter().all(is_region)
    }

    /// Blocks along the side of a region.
    pub(super) fn region_blocks(&self) -> u32 {
        ((1 << (self.grid.depth - self.region_level)) / BLOCK_LEAVES).max(1)
    }

    pub(super) fn square(&self, region: usize) -> Option<BlockSquare> {
        let side = self.region_blocks();
        let range = |n: u32| [n * side, n * side + side - 1];
        self.regions.get(region).map(|place| BlockSquare { ranges: place.map(range) })
    }

    /// The number of each region by its column and row.
    pub(super) fn region_numbers(&self) -> HashMap<[u32; 2], u32> {
        (0..).zip(&self.regions).map(|(number, place)| (*place, number)).collect()
    }

    /// The region of a node below or at the regions' roots.
    pub(super) fn region_of(&self, id: TileId) -> Option<[u32; 2]> {
        let below = id.level().checked_sub(self.region_level)?;
        Some([id.x() >> below, id.y() >> below])
    }
}

/// What becomes of the objects and materials of a chunk.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct PlannedChunk {
    /// Number in its triangles of the first of `objects`.
    pub(super) first_object: u32,
    pub(super) objects: Vec<PlannedObject>,
    /// Number in its triangles of the first of `materials`.
    pub(super) first_material: u32,
    pub(super) materials: Vec<PlannedMaterial>,
    pub(super) textures: Vec<PlannedTexture>,
}

/// What becomes of an object.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(super) struct PlannedObject {
    /// From the scene's origin to that of its triangles.
    pub(super) offset_m: [f64; 3],
    /// `None` for an object that is left out.
    pub(super) shown: Option<NumberedShape>,
}

/// An object of the city.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(super) struct NumberedShape {
    pub(super) kind: ObjectKind,
    pub(super) base_z_m: f32,
    /// Number in the baked city.
    pub(super) number: u32,
    pub(super) landmark: Option<PlannedLandmark>,
}

/// What makes an object a landmark.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(super) struct PlannedLandmark {
    pub(super) stone: Option<u8>,
    /// Relative to the scene's origin.
    pub(super) anchor_m: [f32; 3],
}

/// A material of the city. Equal ones are the same, in all chunks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub(super) struct PlannedMaterial {
    pub(super) rgb: [u8; 3],
    /// Index into the textures of its chunk or bundle.
    pub(super) texture: Option<u32>,
    pub(super) is_reflective: bool,
}

/// A texture of the city. Equal ones are the same, in all chunks.
#[derive(Debug, Clone, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub(super) struct PlannedTexture {
    pub(super) facts: TextureFacts,
    /// By which its texels are found.
    pub(super) picture: ShortHash,
}
