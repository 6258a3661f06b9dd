//! The mesh of a node, decoded.

use insula_source::object::TriangleMesh;
use std::collections::BTreeMap;

#[derive(Debug, Default, PartialEq)]
pub(super) struct NodeMesh {
    /// Relative to the centre of the node: x and y in its system, heights in their unit.
    pub(super) offsets: Vec<[f64; 3]>,
    /// v down; one for each vertex, or empty.
    pub(super) uv: Vec<[f32; 2]>,
    /// One for each vertex, or empty.
    pub(super) colours: Vec<[u8; 3]>,
    /// The part of the texture (u and v, lowest and highest, of 65535) that each vertex repeats; or empty.
    pub(super) regions: Vec<[u16; 4]>,
    /// Below the number of vertices.
    pub(super) triangles: Vec<[u32; 3]>,
    /// Feature of each triangle: an index into `features`, or [`NO_FEATURE`].
    pub(super) triangle_features: Vec<u32>,
    pub(super) features: Vec<u64>,
}

/// The feature of triangles without one.
pub(super) const NO_FEATURE: u32 = u32::MAX;
/// What `remap` has of vertices that are not used yet.
const UNUSED: u32 = u32::MAX;

impl NodeMesh {
    /// The triangles of each feature, with only the vertices that they use. `place` maps offsets to positions; `material` is
    /// put into each.
    pub(super) fn by_feature(
        &self,
        place: &dyn Fn([f64; 3]) -> [f64; 3],
        material: Option<u32>,
    ) -> Vec<(Option<usize>, TriangleMesh)> {
        let mut groups: BTreeMap<u32, Vec<usize>> = BTreeMap::new();
        for (i, feature) in self.triangle_features.iter().enumerate() {
            groups.entry(*feature).or_default().push(i);
        }
        let has_colours = self.colours.iter().any(|colour| *colour != [255; 3]);
        let mut remap = vec![UNUSED; self.offsets.len()];
        let mut meshes = Vec::with_capacity(groups.len());
        for (feature, triangles) in groups {
            let mut mesh = TriangleMesh { material, ..TriangleMesh::default() };
            let mut used = Vec::new();
            for triangle in triangles.iter().filter_map(|i| self.triangles.get(*i)) {
                let corners = triangle.map(|vertex| {
                    let index = vertex as usize;
                    if remap[index] == UNUSED {
                        remap[index] = mesh.positions.len() as u32;
                        used.push(index);
                        mesh.positions.push(place(self.offsets[index]));
                        if let Some([u, v]) = self.uv.get(index) {
                            mesh.uv.push([*u, 1.0 - v]);
                        }
                        if has_colours {
                            mesh.colours.extend(self.colours.get(index));
                        }
                    }
                    remap[index]
                });
                mesh.triangles.push(corners);
            }
            used.into_iter().for_each(|index| remap[index] = UNUSED);
            meshes.push(((feature != NO_FEATURE).then_some(feature as usize), mesh));
        }
        meshes
    }

    /// Checks that all lists fit together. Fails with what does not.
    pub(super) fn check(&self) -> Result<(), &'static str> {
        let count = self.offsets.len();
        let fits = |length: usize| length == 0 || length == count;
        if !fits(self.uv.len()) || !fits(self.colours.len()) || !fits(self.regions.len()) {
            return Err("its attributes differ in length");
        }
        if self.triangles.iter().flatten().any(|vertex| *vertex as usize >= count) {
            return Err("a triangle has a vertex that does not exist");
        }
        if self.triangle_features.len() != self.triangles.len() {
            return Err("its features do not fit its triangles");
        }
        Ok(())
    }
}
