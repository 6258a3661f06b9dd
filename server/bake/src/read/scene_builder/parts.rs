//! Builders of cities that are read in parts.

use super::SceneBuilder;
use super::pending::PendingObject;
use crate::error::BakeError;
use crate::scene::object_records::ObjectRecords;
use crate::scene::scratch_scene::{ObjectIdentity, StoredMaterial};
use crate::scene::triangle_store::TriangleStore;
use insula_scratch::record_list::RecordScratch;
use serde::{Deserialize, Serialize};

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
