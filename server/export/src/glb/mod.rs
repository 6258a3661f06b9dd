//! GLB, the binary form of glTF 2.0, with the objects of the city.
//!
//! [`write_glb`] writes an area as one file. `crate::tiles3d` makes its tiles with the same parts: `boxes` and `content` turn tiles of
//! the city into triangles, `metadata` writes their objects, `builder` collects all in a document.
//!
//! | extension | for | required |
//! |---|---|---|
//! | `KHR_mesh_quantization` | positions of 16 bits | yes |
//! | `EXT_texture_webp` | textures, as the city has them | if there are textures |
//! | `EXT_meshopt_compression` | vertices and triangles of 3D Tiles | in 3D Tiles |
//! | `EXT_mesh_features` | `_FEATURE_ID_0` of each vertex: the row of its object | no |
//! | `EXT_structural_metadata` | the property table of the objects | no |

pub(crate) mod boxes;
pub(crate) mod builder;
pub(crate) mod columns;
mod compress;
pub(crate) mod content;
mod document;
mod error;
pub(crate) mod geometry;
pub(crate) mod matrix;
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

pub use error::ExportError;

use crate::{
    selection::ObjectSelection,
    source::{ExportSource, SourceError},
};
use builder::{GlbBuilder, Packing};
use content::ContentWriter;
use insula_protocol::{Subtree, TileId};
use matrix::{Matrix, subtract};
use metadata::{Rows, add_table};
use objects::ObjectReader;
use reach::Reach;
use serde_json::json;
use std::io::Write;

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
/// its columns if it has no mesh.
///
/// Positions are metres, y up, x to the grid's east and -z to its north, from the middle of the selected area at the city's height
/// zero. `asset.extras` has that point (`origin`, world metres) and the coordinate system (`crs`). Vertices have feature ids, which
/// are rows of a property table with `id` (the object's number), `identifier`, `parent`, `kind`, and the attributes of the schema.
///
/// Fails if a tile cannot be read, if nothing is selected, if the file would have 4 GiB or more, or if `out` fails.
pub fn write_glb(
    source: &dyn ExportSource,
    selection: &ObjectSelection,
    out: &mut dyn Write,
) -> Result<ExportReport, ExportError> {
    let manifest = source.manifest();
    let reader = ObjectReader::new(source);
    let content = ContentWriter::new(source, selection, &reader);
    let mut glb = GlbBuilder::new(manifest, Packing::Plain);
    let mut rows = Rows::default();
    let origin = middle(source, selection);
    let mut triangles = 0;
    for leaf in leaves(source, selection)? {
        let place = Matrix::translation(subtract(manifest.node_corner(leaf), origin));
        triangles += content.add_leaf(&mut glb, &mut rows, leaf, &place)?.triangles as u64;
    }
    if triangles == 0 {
        return Err(ExportError::Nothing(
            "the city has no surface in the selected area, or none of the selected objects",
        ));
    }
    add_table(&mut glb, &reader, &rows, usize::MAX)?;
    glb.gather_nodes(manifest.title.clone(), Matrix::Y_UP.to_array());
    glb.set_extras(json!({ "origin": origin, "crs": manifest.crs }));
    let bytes = glb.finish()?;
    out.write_all(&bytes).map_err(ExportError::writing("the GLB"))?;
    Ok(ExportReport { files: 1, bytes: bytes.len() as u64, triangles, objects: rows.len() as u64 })
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

/// The nodes without children in the selected area, in the order of a traversal by quadrants. Above the deepest level, these are nodes
/// of the surroundings.
fn leaves(source: &dyn ExportSource, selection: &ObjectSelection) -> Result<Vec<TileId>, ExportError> {
    let reach = Reach::new(source, selection)?;
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
