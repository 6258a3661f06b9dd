//! Builds a city from objects: shares equal materials, chooses the origin and leaves out strays.

mod bases;
mod finish;
mod landmarks;
mod pending;
mod strays;
#[cfg(test)]
mod tests;
mod twins;

use crate::error::BakeError;
use crate::read::proposal_options::RemovedObject;
use crate::scene::object_records::{ObjectRecords, RecordPlace, SourceRecord};
use crate::scene::scratch_scene::{ObjectIdentity, StoredMaterial};
use crate::scene::triangle_store::TriangleStore;
use crate::scene::{ObjectKind, SceneTriangle};
pub(crate) use bases::AnchoredBuilding;
use glam::Vec3;
pub(crate) use insula_dress::world_triangle::WorldTriangle;
use insula_objects::FeatureKind;
use insula_scratch::record_list::{RecordList, RecordScratch};
use insula_source::problems::{FAR, REMOVED};
use insula_source::report::SourceReport;
pub(crate) use landmarks::PendingLandmark;
use pending::PendingObject;
pub(crate) use pending::{ObjectRelation, OpenObject};
use serde::{Deserialize, Serialize};
use std::collections::HashMap;

/// No projected system has positions on Earth with larger coordinates.
pub(crate) const MAX_COORDINATE_M: f64 = 1e9;
/// An object that is longer is left out.
const MAX_OBJECT_M: f64 = 400_000.0;

/// An object that is smaller in all directions, in cells, may fall between the lines that sample it.
const MIN_CELLS: f32 = 0.25;

pub(crate) use crate::scene::scratch_scene::hash_of_id;

/// Collects the objects of a city.
pub(crate) struct SceneBuilder {
    pending: RecordList<PendingObject>,
    triangles: TriangleStore,
    /// Objects without a shape of which others may be parts.
    parents: RecordList<ObjectIdentity>,
    records: ObjectRecords,
    landmarks: Vec<PendingLandmark>,
    materials: Vec<StoredMaterial>,
    material_numbers: HashMap<StoredMaterial, u32>,
    cell_m: f64,
}

/// Whether a position is finite and within [`MAX_COORDINATE_M`].
pub(crate) fn is_valid_position(p: [f64; 3]) -> bool {
    p.iter().all(|c| c.abs() <= MAX_COORDINATE_M)
}

impl SceneBuilder {
    /// `cell_m` is the side of a leaf's column, by which an object is judged as too large.
    pub(crate) fn new(triangles: TriangleStore, cell_m: f64) -> Self {
        let records = ObjectRecords::for_triangles(&triangles);
        let (pending, parents) = (RecordList::default(), RecordList::default());
        let (landmarks, materials) = (Vec::new(), Vec::new());
        let material_numbers = HashMap::new();
        Self { pending, triangles, parents, records, landmarks, materials, material_numbers, cell_m }
    }

    /// Number of a material. Equal ones have the same.
    pub(crate) fn material(&mut self, material: StoredMaterial) -> u32 {
        let next = self.materials.len() as u32;
        let index = *self.material_numbers.entry(material).or_insert(next);
        if index == next {
            self.materials.push(material);
        }
        index
    }

    /// Bytes that triangles take in memory.
    pub(crate) fn held_bytes(&self) -> u64 {
        self.triangles.held_bytes()
    }

    pub(crate) fn colour(&self, material: u32) -> [u8; 3] {
        self.materials[material as usize].rgb
    }

    /// Adds a whole object.
    #[cfg(test)]
    fn add(&mut self, source: usize, id: &str, kind: ObjectKind, faces: &[WorldTriangle], report: &mut SourceReport) {
        let mut open = OpenObject::new(kind);
        self.push(&mut open, faces);
        self.close(source, id, open, report);
    }

    /// Adds triangles to an object that is closed later. Every corner must be valid (see
    /// [`is_valid_position`]). Only one object may be open.
    pub(crate) fn push(&mut self, open: &mut OpenObject, faces: &[WorldTriangle]) {
        let Some(first) = faces.first() else { return };
        let anchor = *open.anchor.get_or_insert(first.corners[0]);
        let object = self.pending.len() as u32;
        for face in faces {
            let face = if open.kind == ObjectKind::Terrain { face.facing_up() } else { *face };
            let corners = face.corners.map(|corner| std::array::from_fn(|axis| (corner[axis] - anchor[axis]) as f32));
            for corner in &corners {
                for axis in 0..3 {
                    open.min[axis] = open.min[axis].min(corner[axis]);
                    open.max[axis] = open.max[axis].max(corner[axis]);
                }
            }
            open.hash_triangle(&corners);
            let [a, b, c] = corners.map(Vec3::from_array);
            open.surface_m2 += f64::from((b - a).cross(c - a).length()) * 0.5;
            self.triangles.push(SceneTriangle { corners, uv: face.uv, material: face.material, object });
        }
        open.triangles += faces.len() as u64;
    }

    /// Ends an object and counts it in the report. One without triangles is not added, one that is too large for the
    /// cell size is left out.
    pub(crate) fn close(&mut self, source: usize, id: &str, open: OpenObject, report: &mut SourceReport) {
        let kind = if open.kind == ObjectKind::Terrain { FeatureKind::Relief } else { FeatureKind::Generic };
        let record = SourceRecord { identifier: id.to_owned(), kind, attributes: Vec::new() };
        let relation = ObjectRelation { record: Some(self.add_record(record)), ..ObjectRelation::default() };
        self.close_related(source, id, open, relation, report);
    }

    /// Keeps what a source says of an object, for its [`ObjectRelation`].
    pub(crate) fn add_record(&mut self, record: SourceRecord) -> RecordPlace {
        self.records.push(record)
    }

    /// Adds an object without a shape, of which others may be parts.
    pub(crate) fn add_parent(&mut self, source: usize, id: &str, relation: ObjectRelation) {
        let Some(record) = relation.record else { return };
        let parent_hash = relation.parent;
        self.parents.push(ObjectIdentity { record, source: source as u32, id_hash: hash_of_id(id), parent_hash });
    }

    /// As [`Self::close`], with what the source tells of the object's parent and level of detail.
    pub(crate) fn close_related(
        &mut self,
        source: usize,
        id: &str,
        open: OpenObject,
        relation: ObjectRelation,
        report: &mut SourceReport,
    ) {
        let Some(mut object) = open.into_pending(source, id) else { return };
        object.relation = relation;
        if let Some((reason, detail)) = object.size_fault(self.cell_m) {
            report.skip(reason, || format!("{id}: {detail}"));
            object.is_dropped = true;
        } else {
            if (0..3).all(|axis| object.extent_m(axis) < f64::from(MIN_CELLS) * self.cell_m) {
                report.problem("smaller than a quarter of a cell", || id.to_owned());
            }
            report.objects += 1;
            report.triangles += object.triangles;
            if object.kind == ObjectKind::Terrain {
                report.terrain_triangles += object.triangles;
            }
        }
        self.pending.push(object);
    }

    /// Ends an object that is left out although some of its triangles were added.
    pub(crate) fn abandon(&mut self, source: usize, id: &str, open: OpenObject) {
        if let Some(object) = open.into_pending(source, id) {
            self.pending.push(PendingObject { is_dropped: true, ..object });
        }
    }

    /// Number of objects so far, for [`Self::abandon_since`].
    pub(crate) fn len(&self) -> usize {
        self.pending.len()
    }

    /// Leaves out all objects since there were `len`, and what was added of one that is not closed. Fails if the objects cannot be read
    /// or written.
    pub(crate) fn abandon_since(&mut self, len: usize) -> Result<(), BakeError> {
        for number in len..self.pending.len() {
            self.pending.update(number, |object| object.is_dropped = true)?;
        }
        // Triangles of an object that was never closed have this number.
        self.pending.push(PendingObject { is_dropped: true, ..PendingObject::default() });
        Ok(())
    }
}

fn subtract_from_report(object: &PendingObject, report: &mut SourceReport) {
    report.objects -= 1;
    report.triangles -= object.triangles;
    if object.kind == ObjectKind::Terrain {
        report.terrain_triangles -= object.triangles;
    }
}

fn remove_from_report(object: &PendingObject, distance_m: f64, report: &mut SourceReport) {
    subtract_from_report(object, report);
    report.skip(FAR, || format!("{}: {:.0} km away", object.id, distance_m / 1000.0));
}

/// Sides of the boxes of one object in two cities are at most this far apart: a city has them in decimetres.
const SAME_BOX_M: f64 = 0.2;
/// A lower object has no height of its own.
const NO_HEIGHT_M: f64 = 1e-6;

impl SceneBuilder {
    /// Leaves out objects that are known by their identifiers and places. Returns how many, and corrects the reports. Fails if the objects
    /// cannot be read or written.
    pub(crate) fn drop_removed(
        &mut self,
        removed: &[RemovedObject],
        sources: &mut [SourceReport],
    ) -> Result<u64, BakeError> {
        let mut boxes: HashMap<u64, Vec<[[f64; 2]; 2]>> = HashMap::new();
        for object in removed {
            boxes.entry(hash_of_id(&object.identifier)).or_default().push(object.bounds_m);
        }
        let mut count = 0;
        self.pending.replace_each(|_, object| {
            let is_same = |[low, high]: &[[f64; 2]; 2]| {
                let is_near = |a: f64, b: f64| (a - b).abs() <= SAME_BOX_M;
                (0..2).all(|axis| is_near(object.low(axis), low[axis]) && is_near(object.high(axis), high[axis]))
            };
            if object.is_dropped || !boxes.get(&object.id_hash).is_some_and(|known| known.iter().any(is_same)) {
                return Ok::<_, BakeError>(None);
            }
            let report = &mut sources[object.source];
            subtract_from_report(object, report);
            report.skip(REMOVED, || object.id.to_string());
            count += 1;
            Ok(Some(PendingObject { is_dropped: true, ..object.clone() }))
        })?;
        Ok(count)
    }

    /// Lifts the objects since there were `first`, if they have no heights of their own: the lowest of them is at 0. Fails if the objects
    /// cannot be read or written.
    pub(crate) fn lift_from_zero(&mut self, first: usize, by_m: f64) -> Result<(), BakeError> {
        let mut lowest_m = f64::INFINITY;
        for number in first..self.pending.len() {
            let object = self.pending.get(number)?;
            lowest_m = if object.is_dropped { lowest_m } else { lowest_m.min(object.low(2)) };
        }
        if lowest_m.abs() > NO_HEIGHT_M {
            return Ok(());
        }
        for number in first..self.pending.len() {
            self.pending.update(number, |object| {
                object.anchor[2] += by_m;
                object.ground_m = object.ground_m.map(|ground_m| ground_m + by_m);
            })?;
        }
        Ok(())
    }
}

#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct PartObjects {
    pending: Vec<PendingObject>,
    parents: Vec<ObjectIdentity>,
}

impl PartObjects {
    /// Whether all objects are of one of so many sources.
    pub(crate) fn is_valid(&self, sources: usize) -> bool {
        self.pending.iter().all(|object| object.is_dropped || object.source < sources)
            && self.parents.iter().all(|parent| (parent.source as usize) < sources)
    }

    /// Number of triangles, without those of objects that are left out.
    pub(crate) fn triangles(&self) -> u64 {
        self.pending.iter().filter(|object| !object.is_dropped).map(|object| object.triangles).sum()
    }
}

/// What a builder of a part has.
pub(crate) struct BuilderParts {
    pub(crate) objects: PartObjects,
    pub(crate) materials: Vec<StoredMaterial>,
    /// Size of the file of records.
    pub(crate) record_bytes: u64,
}

impl SceneBuilder {
    /// Ends the writing of a part. Fails if its files could not be written.
    pub(crate) fn into_parts(mut self) -> Result<BuilderParts, BakeError> {
        self.triangles.finish()?;
        let record_bytes = self.records.bytes();
        self.records.finish()?;
        let objects = PartObjects { pending: self.pending.into_memory(), parents: self.parents.into_memory() };
        Ok(BuilderParts { objects, materials: self.materials, record_bytes })
    }

    /// A builder of a city whose objects are added part by part, and kept in scratch files.
    pub(crate) fn of_parts(cell_m: f64, scratch: &RecordScratch) -> Self {
        let records = ObjectRecords::Parts(Vec::new());
        let mut builder = Self { records, ..Self::new(TriangleStore::Memory(Vec::new()), cell_m) };
        builder.keep_in(scratch);
        builder
    }

    /// Adds the objects of a part. `first_source` is the number of its first source, and `record_bytes` the size of the records
    /// of all parts before.
    pub(crate) fn add_part(&mut self, objects: PartObjects, first_source: u32, record_bytes: u64) {
        let PartObjects { pending, parents } = objects;
        for mut object in pending {
            object.source += first_source as usize;
            object.relation.record = object.relation.record.map(|record| record.after(record_bytes));
            self.pending.push(object);
        }
        for identity in parents {
            let (source, record) = (identity.source + first_source, identity.record.after(record_bytes));
            self.parents.push(ObjectIdentity { source, record, ..identity });
        }
    }

    /// Sets the triangles of all parts, and where further triangles and records are kept.
    pub(crate) fn set_stores(&mut self, records: ObjectRecords, triangles: TriangleStore) {
        (self.records, self.triangles) = (records, triangles);
    }
}
