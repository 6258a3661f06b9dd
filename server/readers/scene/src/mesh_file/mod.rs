//! PLY, STL and OFF meshes: each file is one object, in metres with z up.

mod ply;
mod ply_faces;
mod ply_header;
mod ply_places;
mod ply_values;
mod stl;
#[cfg(test)]
mod tests;
mod weld;

use insula_simplify::model::{ModelError, ModelFormat, TriangleModel};
use insula_source::attributes::Attributes;
use insula_source::error::InputError;
use insula_source::input::Input;
use insula_source::object::{FeatureKind, ObjectSink, Shape, SourceObject, Surface, TriangleMesh};

/// Extensions of the file formats that this reader reads; `.gz` may follow.
const EXTENSIONS: [&str; 3] = [".ply", ".stl", ".off"];

/// Geometry of a file.
#[derive(Debug, Default)]
struct FileMesh {
    source_type: &'static str,
    polygons: Vec<Surface>,
    meshes: Vec<TriangleMesh>,
}

/// Reads a PLY, STL or OFF file as one building, whose identifier is the file's name without extension. Positions are metres east,
/// north and up of a place that the caller sets.
///
/// Fails if the file is damaged, or a PLY without faces.
pub fn read(input: &Input<'_>, sink: &mut dyn ObjectSink) -> Result<(), InputError> {
    let bytes = input.read_all(input.max_bytes)?;
    let id = stem(input.name);
    let mesh = if bytes.starts_with(b"ply") {
        ply::read(input.label, id, &bytes, sink)?
    } else if input.name.to_ascii_lowercase().contains(".off") {
        read_off(input.label, &bytes)?
    } else {
        stl::read(input.label, id, &bytes, sink)?
    };
    let is_empty = mesh.polygons.is_empty() && mesh.meshes.iter().all(|mesh| mesh.triangles.is_empty());
    if is_empty {
        sink.skip("mesh has no triangles", id.to_owned());
    } else {
        sink.add(SourceObject {
            id: id.to_owned(),
            parent: None,
            kind: FeatureKind::Building,
            source_type: mesh.source_type.to_owned(),
            lod: None,
            attributes: Attributes::default(),
            shape: Shape::Surfaces { polygons: mesh.polygons, meshes: mesh.meshes },
        })?;
    }
    sink.tick(input.files.len(input.name).unwrap_or(0));
    Ok(())
}

/// Reads an OFF file. Fails if it is none, or is damaged.
fn read_off(label: &str, bytes: &[u8]) -> Result<FileMesh, InputError> {
    let damaged = |error: ModelError| InputError::damaged(label, "mesh", error.to_string());
    let TriangleModel { positions, triangles, .. } = TriangleModel::read(bytes, ModelFormat::Off).map_err(damaged)?;
    let meshes = vec![TriangleMesh { positions, triangles, ..TriangleMesh::default() }];
    Ok(FileMesh { source_type: "OFF mesh", meshes, ..FileMesh::default() })
}

/// The file's name without folders and extensions; `mesh` if nothing is left.
fn stem(name: &str) -> &str {
    let name = name.rsplit('/').next().unwrap_or(name);
    let lower = name.to_ascii_lowercase();
    let end = EXTENSIONS.iter().filter_map(|extension| lower.rfind(extension)).max().unwrap_or(name.len());
    let stem = name.get(..end).unwrap_or(name).trim();
    if stem.is_empty() { "mesh" } else { stem }
}
