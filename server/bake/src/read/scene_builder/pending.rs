//! Objects while they are read.

use super::{MAX_OBJECT_M, hash_of_id};
use crate::read::duplicates::{DuplicateCandidate, PlacedBox};
use crate::scene::ObjectKind;
use crate::scene::grid::BLOCK_LEAVES;
use crate::scene::object_records::RecordPlace;
use crate::scene::scratch_scene::ObjectIdentity;
use insula_protocol::NODE_CELLS;
use serde::{Deserialize, Serialize};

/// An object with more cells of surface in one block of leaves is left out: the block would need gigabytes. 500 layers
/// over a whole block have as many.
const MAX_BLOCK_CELLS: f64 = 8.2e6;
/// An object that is taller within one block, in cells, is left out: the format has 4096 cells of height.
const MAX_BLOCK_HEIGHT_CELLS: f64 = 32_768.0;
/// Longer identifiers are cut: they are in memory until all sources are read.
const MAX_ID_BYTES: usize = 1024;

/// Facts of an object besides its shape.
#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize)]
pub(crate) struct ObjectRelation {
    /// Of its parent's identifier, see [`hash_of_id`].
    pub(crate) parent: Option<u64>,
    /// Level of detail, if the source has levels.
    pub(crate) lod: Option<f32>,
    /// Whether the object is left out if another one names it as its parent.
    pub(crate) yields_to_parts: bool,
    /// What the source says of the object; `None` for an object that tiles do not name.
    pub(crate) record: Option<RecordPlace>,
}

/// A closed object.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub(crate) struct PendingObject {
    pub(super) id: Box<str>,
    /// See [`hash_of_id`].
    pub(super) id_hash: u64,
    pub(super) kind: ObjectKind,
    pub(super) source: usize,
    /// Whether it is left out, with the reason in the report already.
    pub(super) is_dropped: bool,
    /// What tells whether another object is the same.
    pub(super) relation: ObjectRelation,
    /// Area of all triangles.
    pub(super) surface_m2: f64,
    /// The stored corners are relative to this, because f32 is exact enough only near the object until the origin is
    /// known.
    pub(super) anchor: [f64; 3],
    /// Minimum of the corners relative to the anchor.
    pub(super) min: [f32; 3],
    /// Maximum of the corners relative to the anchor.
    pub(super) max: [f32; 3],
    pub(super) triangles: u64,
    /// Equal for objects whose triangles are the same, relative to the anchor and in the same order.
    pub(super) shape_hash: u64,
    /// Whether it is a building whose source gives its heights.
    pub(super) has_own_base: bool,
    /// World height of the ground below an object whose source says how far it is above it.
    pub(super) ground_m: Option<f64>,
}

impl PendingObject {
    /// Minimum along an axis, in world coordinates.
    pub(super) fn low(&self, axis: usize) -> f64 {
        self.anchor[axis] + f64::from(self.min[axis])
    }

    /// Maximum along an axis, in world coordinates.
    pub(super) fn high(&self, axis: usize) -> f64 {
        self.anchor[axis] + f64::from(self.max[axis])
    }

    /// Its box in world coordinates.
    pub(super) fn place(&self) -> PlacedBox {
        PlacedBox { low: std::array::from_fn(|axis| self.low(axis)), high: std::array::from_fn(|axis| self.high(axis)) }
    }

    /// The object as the search for duplicates takes it.
    pub(super) fn candidate(&self, object: usize) -> DuplicateCandidate {
        let bounds = self.place();
        DuplicateCandidate {
            object,
            source: self.source,
            bounds,
            id: self.id_hash,
            parent: self.relation.parent,
            lod: self.relation.lod.unwrap_or(0.0),
            shape_hash: self.shape_hash,
            is_terrain: self.kind == ObjectKind::Terrain,
        }
    }

    /// By what the object is known; `None` without a record.
    pub(super) fn identity(&self) -> Option<ObjectIdentity> {
        let (source, id_hash, parent_hash) = (self.source as u32, self.id_hash, self.relation.parent);
        self.relation.record.map(|record| ObjectIdentity { record, source, id_hash, parent_hash })
    }

    /// What an object and its parts have in common.
    pub(super) fn group(&self) -> u64 {
        self.relation.parent.unwrap_or(self.id_hash)
    }

    pub(super) fn extent_m(&self, axis: usize) -> f64 {
        f64::from(self.max[axis]) - f64::from(self.min[axis])
    }

    /// Why the object cannot be baked with cells of this size, with details; `None` if it can.
    pub(super) fn size_fault(&self, cell_m: f64) -> Option<(&'static str, String)> {
        let extent_m: [f64; 3] = std::array::from_fn(|axis| self.extent_m(axis));
        if let Some(largest_m) = extent_m.into_iter().reduce(f64::max).filter(|extent_m| *extent_m > MAX_OBJECT_M) {
            return Some(("larger than 400 km", format!("{:.0} km", largest_m / 1000.0)));
        }
        let block_m = cell_m * (NODE_CELLS as u32 * BLOCK_LEAVES) as f64;
        let [share_x, share_y] = [0, 1].map(|axis: usize| (block_m / extent_m[axis]).min(1.0));
        let height_cells = extent_m[2] * share_x.min(share_y) / cell_m;
        if height_cells > MAX_BLOCK_HEIGHT_CELLS {
            let detail = format!(
                "{height_cells:.0} cells high in one block, the limit is {MAX_BLOCK_HEIGHT_CELLS}; use a larger --cell"
            );
            return Some(("too tall for the cell size", detail));
        }
        let cells = self.surface_m2 * share_x * share_y / (cell_m * cell_m);
        (cells > MAX_BLOCK_CELLS).then(|| {
            let detail = format!(
                "{cells:.0} cells of surface in one block, the limit is {MAX_BLOCK_CELLS:.0}; use a larger --cell"
            );
            ("too much surface for the cell size", detail)
        })
    }
}

/// An object whose triangles are added one part after the other, so that they are never in memory together.
#[derive(Default)]
pub(crate) struct OpenObject {
    pub(super) kind: ObjectKind,
    pub(super) anchor: Option<[f64; 3]>,
    pub(super) min: [f32; 3],
    pub(super) max: [f32; 3],
    pub(super) surface_m2: f64,
    /// As [`PendingObject::shape_hash`], of the triangles so far.
    pub(super) shape_hash: u64,
    /// Number of triangles so far.
    pub(crate) triangles: u64,
    /// Whether a wall has a generated facade.
    pub(crate) has_facade: bool,
    /// Whether it is a building whose source gives its heights.
    pub(crate) has_own_base: bool,
    /// World height of the ground below it, if its source says how far it is above it.
    pub(crate) ground_m: Option<f64>,
}

impl OpenObject {
    pub(crate) fn new(kind: ObjectKind) -> Self {
        Self { kind, ..Self::default() }
    }

    /// Adds the corners of a triangle, relative to the anchor, to the hash of the shape.
    pub(super) fn hash_triangle(&mut self, corners: &[[f32; 3]; 3]) {
        // The steps of FNV-1a, with a larger prime and 32 bits at once.
        const PRIME: u64 = 0x9e37_79b9_7f4a_7c15;
        for value in corners.as_flattened() {
            self.shape_hash = (self.shape_hash ^ u64::from(value.to_bits())).wrapping_mul(PRIME).rotate_left(29);
        }
    }

    /// Lowest and highest corner in world coordinates; `None` without triangles.
    pub(crate) fn bounds(&self) -> Option<[[f64; 3]; 2]> {
        let anchor = self.anchor?;
        Some([self.min, self.max].map(|corner| std::array::from_fn(|axis| anchor[axis] + f64::from(corner[axis]))))
    }

    /// `None` without triangles.
    pub(super) fn into_pending(self, source: usize, id: &str) -> Option<PendingObject> {
        let Self { kind, anchor, min, max, surface_m2, shape_hash, triangles, has_own_base, ground_m, .. } = self;
        let anchor = anchor?;
        let id: Box<str> = id[..id.floor_char_boundary(MAX_ID_BYTES)].into();
        let (relation, id_hash) = (ObjectRelation::default(), hash_of_id(&id));
        let is_dropped = false;
        Some(PendingObject {
            id,
            id_hash,
            kind,
            source,
            is_dropped,
            relation,
            surface_m2,
            anchor,
            min,
            max,
            triangles,
            shape_hash,
            has_own_base,
            ground_m,
        })
    }
}
