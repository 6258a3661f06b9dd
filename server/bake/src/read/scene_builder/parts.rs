//! Builders of cities that are read in parts.

use serde::{Deserialize, Serialize};

use super::SceneBuilder;
use super::pending::PendingObject;
use crate::error::BakeError;
use crate::scene::object_records::ObjectRecords;
use crate::scene::scratch_scene::{ObjectIdentity, StoredMaterial};
use crate::scene::triangle_store::TriangleStore;

/// The objects of a part.
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
        let objects = PartObjects { pending: self.pending, parents: self.parents };
        Ok(BuilderParts { objects, materials: self.materials, record_bytes })
    }

    /// A builder of a city whose objects are added part by part.
    pub(crate) fn of_parts(cell_m: f64) -> Self {
        Self { records: ObjectRecords::Parts(Vec::new()), ..Self::new(TriangleStore::Memory(Vec::new()), cell_m) }
    }

    /// Adds the objects of a part. `first_source` is the number of its first source, and `record_bytes` the size of the records
    /// of all parts before.
    pub(crate) fn add_part(&mut self, objects: PartObjects, first_source: u32, record_bytes: u64) {
        let PartObjects { pending, parents } = objects;
        self.pending.extend(pending.into_iter().map(|mut object| {
            object.source += first_source as usize;
            object.relation.record = object.relation.record.map(|record| record.after(record_bytes));
            object
        }));
        self.parents.extend(parents.into_iter().map(|identity| ObjectIdentity {
            source: identity.source + first_source,
            record: identity.record.after(record_bytes),
            ..identity
        }));
    }

    /// Sets the triangles of all parts.
    pub(crate) fn set_triangles(&mut self, triangles: TriangleStore) {
        self.triangles = triangles;
    }
}
