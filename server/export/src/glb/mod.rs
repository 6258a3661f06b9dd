//! GLB, the binary form of glTF 2.0, with the objects of the city.
//!
//! [`write_glb`] writes an area as one file. `crate::tiles3d` makes its tiles with the same parts: `boxes` and `content` turn tiles of
//! the city into triangles, `metadata` writes their objects, `builder` collects all in a document.
//!
//! | extension | for | required |
//! |---|---|---|
//! | `KHR_mesh_quantization` | positions of 16 bits | yes, but in plain 3D Tiles |
//! | `EXT_texture_webp` | textures, as the city has them | if there are textures, but in plain 3D Tiles |
//! | `EXT_meshopt_compression` | vertices and triangles of 3D Tiles | in 3D Tiles that are not plain |
//! | `EXT_mesh_features` | `_FEATURE_ID_0` of each vertex: the row of its object | no |
//! | `EXT_structural_metadata` | the property table of the objects | no |

pub(crate) mod builder;
pub(crate) mod columns;
mod compress;
pub(crate) mod content;
mod document;
mod error;
mod jpeg;
pub(crate) mod metadata;
pub(crate) mod objects;
pub(crate) mod reach;
mod stone;
#[cfg(test)]
pub(crate) mod test_city;
#[cfg(test)]
pub(crate) mod test_reader;
#[cfg(test)]
mod tests;
mod text_form;
mod view;
mod view_land;
mod view_terrain;

use crate::selection::ObjectSelection;
use crate::source::{ExportSource, SourceError};
use crate::table::city::City;
use crate::{boxes, geometry, matrix};
use builder::{GlbBuilder, Packing};
use content::{ContentWriter, ViewColumns};
pub use error::ExportError;
use glam::{DAffine3, DVec3};
use insula_objects::FeatureKind;
use insula_protocol::mesh_tile::NO_OBJECT;
use insula_protocol::subtree::{NodeInfo, NodeMesh};
use insula_protocol::{Subtree, TileId};
use matrix::{Y_UP, numbers_of};
use metadata::{Rows, add_table};
use reach::Reach;
use serde_json::json;
use std::collections::BTreeSet;
use std::io::Write;
pub use text_form::gltf_of_glb;
pub use view::ExportView;
use view::{NodeMeshes, Part, ViewMesh};
use view_terrain::ViewTerrain;

/// What an export wrote.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct ExportReport {
    /// Files, or tiles with content.
    pub files: u64,
    pub bytes: u64,
    pub triangles: u64,
    /// Objects of the property tables. An object in several tiles counts in each.
    pub objects: u64,
}

/// Writes the selected part of a city as one GLB (glTF 2.0, section 4.4): a node for each leaf with its finest mesh, or with boxes of
/// its columns if it has no mesh. With a view, only what its camera may see, as coarse as the view allows, and the camera: distant
/// nodes have boxes of their columns, and terrain without pictures is a surface without gaps.
///
/// Positions are metres, y up, x to the grid's east and -z to its north, from the middle of the selected area at the city's height
/// zero. `asset.extras` has that point (`origin`, world metres) and the coordinate system (`crs`). Vertices have feature ids, which
/// are rows of a property table with `id` (the object's number), `identifier`, `parent`, `kind`, and the attributes of the schema.
///
/// Fails if a tile cannot be read, if nothing is selected, if the file would have 4 GiB or more, or if `out` fails.
pub fn write_glb(
    source: &dyn ExportSource,
    selection: &ObjectSelection,
    view: Option<&ExportView>,
    out: &mut dyn Write,
) -> Result<ExportReport, ExportError> {
    let manifest = source.manifest();
    let city = City::new(source);
    let mut scene = Scene {
        city: &city,
        content: ContentWriter::new(&city, selection),
        glb: GlbBuilder::new(manifest, Packing::Quantised),
        rows: Rows::default(),
        origin: middle(source, selection),
    };
    let reach = Reach::new(source, selection)?;
    let triangles = match view {
        Some(view) => scene.add_view(view, &reach)?,
        None => scene.add_leaves(&reach)?,
    };
    if triangles == 0 {
        return Err(ExportError::Nothing(
            "the city has no surface in the selected area or view, or none of the selected objects",
        ));
    }
    let Scene { mut glb, rows, origin, .. } = scene;
    add_table(&mut glb, &city, &rows, usize::MAX)?;
    glb.gather_nodes(manifest.title.clone(), numbers_of(Y_UP));
    glb.set_extras(json!({ "origin": origin, "crs": manifest.crs }));
    let bytes = glb.finish()?;
    out.write_all(&bytes).map_err(ExportError::writing("the GLB"))?;
    Ok(ExportReport { files: 1, bytes: bytes.len() as u64, triangles: triangles as u64, objects: rows.len() as u64 })
}

/// A GLB in the making.
struct Scene<'a> {
    city: &'a City<'a>,
    content: ContentWriter<'a>,
    glb: GlbBuilder,
    rows: Rows,
    /// World metres of the scene's origin.
    origin: [f64; 3],
}

impl Scene<'_> {
    /// From metres from a node's south-west corner at the city's height zero to the scene.
    fn place(&self, node: TileId) -> DAffine3 {
        let corner = DVec3::from(self.city.manifest.node_corner(node));
        DAffine3::from_translation(corner - DVec3::from(self.origin))
    }

    /// Adds the finest that there is of all leaves. Returns the number of triangles.
    fn add_leaves(&mut self, reach: &Reach<'_>) -> Result<usize, ExportError> {
        let mut triangles = 0;
        for leaf in leaves(self.city.source, reach)? {
            let place = self.place(leaf);
            triangles += self.content.add_leaf(&mut self.glb, &mut self.rows, leaf, place)?.triangles;
        }
        Ok(triangles)
    }

    /// Adds what a view shows, and its camera. Returns the number of triangles.
    fn add_view(&mut self, view: &ExportView, reach: &Reach<'_>) -> Result<usize, ExportError> {
        let mut terrain = ViewTerrain::default();
        let mut triangles = 0;
        for part in view.parts(self.city.source, reach)? {
            triangles += match part {
                Part::Columns { node, meshes } => self.add_view_columns(node, meshes, &mut terrain)?,
                Part::Mesh(mesh) => self.add_mesh(mesh, &mut terrain)?,
            };
        }
        triangles += terrain.write(&mut self.glb, self.city.manifest, (view, self.origin))?;
        self.glb.add_camera(numbers_of(view.matrix(self.origin)), view.lens(), view::NEAR_M);
        Ok(triangles)
    }

    /// Adds a node's columns, but for its land, which goes to `terrain`, or `meshes` if they have fewer triangles. Returns the number of
    /// triangles.
    fn add_view_columns(
        &mut self,
        node: TileId,
        meshes: Option<NodeMeshes>,
        terrain: &mut ViewTerrain,
    ) -> Result<usize, ExportError> {
        let mut rows = self.rows.clone();
        let Some(ViewColumns { land, boxes, grid }) = self.content.view_columns(&mut rows, node)? else { return Ok(0) };
        let count = land.triangles.len() + boxes.indices.len() / 3;
        if let Some(meshes) = meshes.filter(|meshes| meshes.triangles <= count) {
            return meshes.meshes.into_iter().map(|mesh| self.add_mesh(mesh, terrain)).sum();
        }
        self.rows = rows;
        terrain.add_columns(self.city.manifest, node, land);
        let place = self.place(node);
        ContentWriter::add_surfaces(&mut self.glb, node, vec![(boxes, grid)], place)
    }

    /// Adds a leaf's mesh, but for its terrain, which goes to `terrain` unless it has a picture. Returns the number of triangles.
    fn add_mesh(&mut self, mesh: ViewMesh, terrain: &mut ViewTerrain) -> Result<usize, ExportError> {
        let ViewMesh { leaf, lod } = mesh;
        let missing = || SourceError {
            what: format!("mesh {leaf}, level of detail {lod}"),
            reason: "it is missing: bake the city again".into(),
        };
        let tile = self.city.source.mesh(leaf, lod)?.ok_or_else(missing)?;
        let place = self.place(leaf);
        let mut land = BTreeSet::new();
        for object in tile.objects.iter().copied().chain(tile.objects.is_empty().then_some(NO_OBJECT)) {
            if !land.contains(&object) && self.city.info(object)?.is_none_or(|info| info.kind == FeatureKind::Relief) {
                land.insert(object);
            }
        }
        let has_picture = tile.texture.is_some();
        terrain.has_pictures |= has_picture && !land.is_empty();
        if !has_picture {
            let parts = self.content.mesh_geometry(&tile, leaf, &mut self.rows, &|object| land.contains(&object))?;
            let matrix = place * content::mesh_matrix(&tile);
            parts.into_values().for_each(|geometry| terrain.add(leaf, geometry, matrix));
        }
        let is_shown = |object| has_picture || !land.contains(&object);
        let shown = self.content.add_mesh(&mut self.glb, &mut self.rows, leaf, (&tile, place), &is_shown)?;
        Ok(shown.triangles)
    }
}

/// The world position that becomes the origin: the middle of what is selected of the city, at its height zero.
fn middle(source: &dyn ExportSource, selection: &ObjectSelection) -> [f64; 3] {
    let manifest = source.manifest();
    let [min, max] = manifest.bounds;
    let [mut low, mut high] = [[min[0], min[1]], [max[0], max[1]]];
    if let Some(area) = selection.area() {
        low = [0, 1].map(|k| low[k].max(area[0][k]));
        high = [0, 1].map(|k| high[k].min(area[1][k]));
    }
    [0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1]), manifest.origin[2]]
}

/// The subtree below a node that must have one.
pub(crate) fn subtree_at(source: &dyn ExportSource, root: TileId) -> Result<Subtree, ExportError> {
    let missing =
        || SourceError { what: format!("subtree {root}"), reason: "it is missing: bake the city again".into() };
    source.subtree(root)?.ok_or_else(|| missing().into())
}

/// The mesh of a node without children.
pub(crate) fn mesh_of<'s>(subtree: &'s Subtree, node: &NodeInfo) -> Option<&'s NodeMesh> {
    subtree.meshes.iter().find(|mesh| mesh.id == node.id && node.child_mask == 0)
}

/// The nodes without children that `reach` has, in the order of a traversal by quadrants. Above the deepest level, these are nodes
/// of the surroundings.
fn leaves(source: &dyn ExportSource, reach: &Reach<'_>) -> Result<Vec<TileId>, ExportError> {
    let mut leaves = Vec::new();
    let mut roots = vec![TileId::ROOT];
    while let Some(root) = roots.pop() {
        let subtree = subtree_at(source, root)?;
        for node in &subtree.nodes {
            if !reach.has(node.id) {
                continue;
            }
            let has_children = node.child_mask & 0xf != 0;
            let is_bottom = node.id != root && Subtree::is_root(node.id);
            match (has_children, is_bottom) {
                (true, true) => roots.push(node.id),
                (false, _) => leaves.push(node.id),
                (true, false) => {}
            }
        }
    }
    leaves.sort_unstable();
    leaves.dedup();
    Ok(leaves)
}
