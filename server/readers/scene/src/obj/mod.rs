//! Wavefront OBJ with MTL. A malformed face costs only itself.

mod faces;
mod grouping;
mod materials;
mod mtl;
mod parse;

use faces::shape_of;
use grouping::{group_faces, is_terrain, report_others};
use insula_dress::polygon::MAX_CORNERS;
use insula_source::attributes::Attributes;
use insula_source::error::InputError;
use insula_source::input::Input;
use insula_source::object::{FeatureKind, ObjectSink, SourceObject};
use materials::load_materials;
use parse::{NONE, ObjFace, ObjFile};

/// No system has positions on Earth with larger coordinates.
const MAX_COORDINATE: f64 = 1e9;

/// Reads the objects or groups of a file, or else its connected parts, as buildings or terrain. Positions are those of the file:
/// the caller sets the place and which axis is up. Fails if the file cannot be read or exceeds the size limit.
pub fn read(input: &Input<'_>, sink: &mut dyn ObjectSink) -> Result<(), InputError> {
    // The parser knows the limit, and says so.
    let mut opened = Input { max_bytes: u64::MAX, ..*input }.open()?;
    let bytes_read = opened.bytes_read;
    let file = parse::parse(input.label, &mut opened.reader, input.max_bytes, sink, &|| bytes_read.get())?;
    let faces = usable_faces(&file, sink);
    let materials = load_materials(input, &file, &faces, sink);
    let groups = group_faces(&file, &faces, stem(input.name));
    report_others(&file, &faces, &groups, sink);
    let mut order: Vec<usize> = (0..faces.len()).collect();
    order.sort_by_key(|&i| groups.of_face[i]);
    for run in order.chunk_by(|&a, &b| groups.of_face[a] == groups.of_face[b]) {
        let id = groups.ids[groups.of_face[run[0]] as usize].clone();
        let (kind, source_type) =
            if is_terrain(&id) { (FeatureKind::Relief, "terrain") } else { (FeatureKind::Building, "object") };
        let of_object: Vec<&ObjFace> = run.iter().map(|&i| &faces[i]).collect();
        let shape = shape_of(&file, &of_object, &materials, sink);
        let (source_type, attributes) = (source_type.to_owned(), Attributes::default());
        sink.add(SourceObject { id, parent: None, kind, source_type, lod: None, attributes, shape })?;
    }
    Ok(())
}

/// The file's name without folders and extensions.
fn stem(name: &str) -> &str {
    let name = name.rsplit('/').next().unwrap_or(name);
    let end = name.to_ascii_lowercase().rfind(".obj").unwrap_or(name.len());
    &name[..end]
}

/// The faces whose corners all exist and have valid positions.
fn usable_faces(file: &ObjFile, sink: &mut dyn ObjectSink) -> Vec<ObjFace> {
    let count = file.positions.len();
    let is_valid = |corner: &[u32; 2]| file.positions[corner[0] as usize].iter().all(|c| c.abs() <= MAX_COORDINATE);
    let mut usable = Vec::with_capacity(file.faces.len());
    for face in &file.faces {
        let corners = file.corners_of(face);
        let line = face.line;
        if let Some([position, _]) = corners.iter().find(|corner| corner[0] as usize >= count) {
            let detail = match *position {
                NONE => format!("line {line}: no vertex index, of {count}"),
                position => format!("line {line}: vertex index {} out of range of {count}", u64::from(position) + 1),
            };
            sink.problem("vertex index out of range", detail);
        } else if !corners.iter().all(is_valid) {
            sink.problem("coordinate not a number or beyond 1e9 m", format!("line {line}"));
        } else if corners.len() > MAX_CORNERS {
            sink.problem("polygon too large", format!("line {line}: {} corners", corners.len()));
        } else {
            usable.push(*face);
        }
    }
    usable
}
