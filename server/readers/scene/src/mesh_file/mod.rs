//! PLY, STL and OFF meshes: each file is one object, in metres with z up.

mod ply;
mod ply_colour;
mod ply_faces;
#[cfg(test)]
mod tests;
mod weld;

use crate::mesh_unit::told_unit;
use insula_dress::polygon::is_fan;
use insula_simplify::model::{ModelError, off, stl};
use insula_source::attributes::Attributes;
use insula_source::error::InputError;
use insula_source::input::Input;
use insula_source::object::{FeatureKind, ObjectSink, Shape, SourceObject, Surface, TriangleMesh};
use insula_source::packed::unpacked_name;
use insula_source::problems::MESH_UNIT;
use std::borrow::Cow;
use weld::Welder;

/// Extensions of the file formats that this reader reads; `.gz` may follow.
const EXTENSIONS: [&str; 3] = [".ply", ".stl", ".off"];
/// Comments are within so many bytes, and the title of an STL within these.
const HEAD_BYTES: usize = 1 << 12;
const TITLE_BYTES: usize = 80;

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
    let is_off = unpacked_name(input.name).to_ascii_lowercase().ends_with(".off");
    if let Some(detail) = comments(&bytes, is_off).iter().find_map(|comment| told_unit("header", comment)) {
        sink.problem(MESH_UNIT, detail);
    }
    let mesh = if bytes.starts_with(b"ply") {
        ply::read(input.label, id, &bytes, sink)?
    } else if is_off {
        read_off(input.label, &bytes)?
    } else {
        read_stl(input.label, id, &bytes, sink)?
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

/// The comments at the head of a file; of an STL, its title.
fn comments(bytes: &[u8], is_off: bool) -> Vec<Cow<'_, str>> {
    let lines = bytes[..bytes.len().min(HEAD_BYTES)].split(|byte| *byte == b'\n');
    if !bytes.starts_with(b"ply") && !is_off {
        return lines.take(1).map(|line| String::from_utf8_lossy(&line[..line.len().min(TITLE_BYTES)])).collect();
    }
    let comment = |line: &&[u8]| ["comment ", "obj_info ", "#"].iter().any(|start| line.starts_with(start.as_bytes()));
    lines.take_while(|line| !line.starts_with(b"end_header")).filter(comment).map(String::from_utf8_lossy).collect()
}

/// Reads an OFF file. Fails if it is none, or is damaged.
fn read_off(label: &str, bytes: &[u8]) -> Result<FileMesh, InputError> {
    let (mut triangles, mut polygons) = (Vec::new(), Vec::new());
    let add = |positions: &[[f64; 3]], corners: &[u32]| {
        let points: Vec<[f64; 3]> = corners.iter().map(|corner| positions[*corner as usize]).collect();
        if is_fan(&points) {
            triangles.extend(corners.windows(2).skip(1).map(|pair| [corners[0], pair[0], pair[1]]));
        } else {
            polygons.push(Surface { points, ..Surface::default() });
        }
    };
    let positions = off::each_face(bytes, add).map_err(|error| damaged(label, &error))?;
    let meshes = vec![TriangleMesh { positions, triangles, ..TriangleMesh::default() }];
    Ok(FileMesh { source_type: "OFF mesh", polygons, meshes })
}

/// Reads an STL. Fails if it is damaged.
fn read_stl(label: &str, id: &str, bytes: &[u8], sink: &mut dyn ObjectSink) -> Result<FileMesh, InputError> {
    let mut welder = Welder::default();
    stl::each_triangle(bytes, |corners| welder.add(corners)).map_err(|error| damaged(label, &error))?;
    let faults =
        [(welder.not_finite, "position is not a number"), (welder.degenerate, "triangle with two equal corners")];
    for (count, kind) in faults.into_iter().filter(|(count, _)| *count > 0) {
        sink.problem(kind, format!("{id}: {count} triangles"));
    }
    Ok(FileMesh { source_type: "STL", meshes: vec![welder.finish()], ..FileMesh::default() })
}

fn damaged(label: &str, error: &ModelError) -> InputError {
    InputError::damaged(label, "mesh", error.to_string())
}

/// The file's name without folders and extensions; `mesh` if nothing is left.
fn stem(name: &str) -> &str {
    let name = name.rsplit('/').next().unwrap_or(name);
    let lower = name.to_ascii_lowercase();
    let end = EXTENSIONS.iter().filter_map(|extension| lower.rfind(extension)).max().unwrap_or(name.len());
    let stem = name.get(..end).unwrap_or(name).trim();
    if stem.is_empty() { "mesh" } else { stem }
}
