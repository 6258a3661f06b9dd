//! Identifiers of features, and meshes split by them.

use super::fault::Fault;
use super::schema::FeatureSet;
use super::{FeatureIdValues, FeatureIds, GltfPrimitive, TriangleMesh};
use std::collections::BTreeMap;

/// Label of the identifiers of b3dm.
const BATCH_ID: &str = "_BATCHID";

/// Identifiers of a set with a value for each vertex. Fails if the set names a table that does not exist.
pub(super) fn per_vertex(set: &FeatureSet, values: Vec<u32>, tables: usize) -> Result<FeatureIds, Fault> {
    with_values(set, FeatureIdValues::PerVertex(values), tables)
}

/// Identifiers of a set with one value.
pub(super) fn with_values(set: &FeatureSet, values: FeatureIdValues, tables: usize) -> Result<FeatureIds, Fault> {
    if let Some(table) = set.property_table.filter(|table| *table >= tables) {
        return Err(Fault::missing("property table", table));
    }
    Ok(FeatureIds { label: set.label.clone(), table: set.property_table, null: set.null_feature_id, values })
}

/// The identifiers of b3dm.
pub(super) fn batch_ids(values: Vec<u32>) -> FeatureIds {
    FeatureIds { label: Some(BATCH_ID.into()), table: None, null: None, values: FeatureIdValues::PerVertex(values) }
}

impl FeatureIds {
    /// Identifier of a vertex; `None` if it has no feature.
    pub(crate) fn of_vertex(&self, vertex: u32) -> Option<u32> {
        let id = match &self.values {
            FeatureIdValues::PerVertex(values) => *values.get(vertex as usize)?,
            FeatureIdValues::All(id) => *id,
        };
        (Some(id) != self.null).then_some(id)
    }
}

impl GltfPrimitive {
    /// The triangles of each feature, ascending, with only the vertices that they use; `None` first: those without a feature. A
    /// triangle belongs to the feature of its first vertex. `position` maps each position, `material` is put into each mesh.
    pub(crate) fn meshes_by_feature(
        &self,
        ids: &FeatureIds,
        position: &dyn Fn([f64; 3]) -> [f64; 3],
        material: Option<u32>,
    ) -> Vec<(Option<u32>, TriangleMesh)> {
        let mut groups: BTreeMap<Option<u32>, Vec<[u32; 3]>> = BTreeMap::new();
        for triangle in &self.triangles {
            groups.entry(ids.of_vertex(triangle[0])).or_default().push(*triangle);
        }
        // Numbers of the vertices in the mesh of the group that was written last to each of them.
        let mut numbers = vec![(usize::MAX, 0u32); self.positions.len()];
        let mut meshes = Vec::with_capacity(groups.len());
        for (group, (feature, triangles)) in groups.into_iter().enumerate() {
            let mut mesh = TriangleMesh { triangles, material, ..TriangleMesh::default() };
            let mut triangles = std::mem::take(&mut mesh.triangles);
            for vertex in triangles.as_flattened_mut() {
                let Some(number) = numbers.get_mut(*vertex as usize) else { continue };
                if number.0 != group {
                    *number = (group, mesh.positions.len() as u32);
                    self.push_vertex(*vertex as usize, position, &mut mesh);
                }
                *vertex = number.1;
            }
            mesh.triangles = triangles;
            meshes.push((feature, mesh));
        }
        meshes
    }

    /// The primitive as a mesh. `position` maps each position, `material` is put into the mesh.
    pub(crate) fn mesh(&self, position: &dyn Fn([f64; 3]) -> [f64; 3], material: Option<u32>) -> TriangleMesh {
        TriangleMesh {
            positions: self.positions.iter().map(|p| position(*p)).collect(),
            uv: self.uv.clone(),
            colours: self.colours.clone(),
            triangles: self.triangles.clone(),
            material,
        }
    }

    fn push_vertex(&self, vertex: usize, position: &dyn Fn([f64; 3]) -> [f64; 3], mesh: &mut TriangleMesh) {
        mesh.positions.push(position(self.positions.get(vertex).copied().unwrap_or_default()));
        mesh.uv.extend(self.uv.get(vertex));
        mesh.colours.extend(self.colours.get(vertex));
    }
}
