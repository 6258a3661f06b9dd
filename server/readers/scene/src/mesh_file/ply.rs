//! PLY: vertices with colours and texture coordinates, and faces.

use super::ply_colour::{bytes_of, colour_of};
use super::ply_faces::{FaceBuilder, FaceLayout, Vertices};
use super::{FileMesh, damaged};
use insula_simplify::model::ply_header::{PlyElement, PlyHeader};
use insula_simplify::model::ply_values::{PlyRow, PlyValues};
use insula_source::error::InputError;
use insula_source::object::ObjectSink;

/// Names of texture coordinates, v up.
const UV_NAMES: [[&str; 2]; 4] = [["s", "t"], ["u", "v"], ["texture_u", "texture_v"], ["texcoord_u", "texcoord_v"]];
/// Reads a PLY. Fails if it is damaged or has no faces.
pub(super) fn read(label: &str, id: &str, bytes: &[u8], sink: &mut dyn ObjectSink) -> Result<FileMesh, InputError> {
    let header = PlyHeader::parse(bytes).map_err(|error| damaged(label, &error))?;
    check_faces(label, &header)?;
    let mut values = PlyValues::new(bytes, &header);
    let mut builder: Option<FaceBuilder> = None;
    for element in header.elements.iter().filter(|element| !element.properties.is_empty()) {
        match (element.name.as_str(), &mut builder) {
            ("vertex", None) => {
                let vertices = read_vertices(label, element, &mut values)?;
                builder = Some(FaceBuilder::new(vertices, header.textures.len()));
            }
            ("face" | "tristrips", Some(builder)) => {
                let layout = FaceLayout::of(element);
                read_rows(label, element, &mut values, |row| builder.add(&layout, row))?;
            }
            ("face" | "tristrips", None) => {
                return Err(InputError::unsupported(label, "the PLY has its faces before its vertices"));
            }
            _ => read_rows(label, element, &mut values, |_| {})?,
        }
    }
    Ok(builder.map_or_else(FileMesh::default, |builder| builder.finish(id, &header.textures, sink)))
}

fn check_faces(label: &str, header: &PlyHeader) -> Result<(), InputError> {
    let count = |name: &str| header.elements.iter().filter(|e| e.name == name).map(|e| e.count).max().unwrap_or(0);
    if count("face") > 0 || count("tristrips") > 0 {
        return Ok(());
    }
    let what = match count("vertex") {
        0 => "the PLY is empty".to_owned(),
        points => format!("the PLY is a cloud of {points} points without faces: make a mesh of it first"),
    };
    Err(InputError::unsupported(label, what))
}

fn read_rows(
    label: &str,
    element: &PlyElement,
    values: &mut PlyValues<'_>,
    mut take: impl FnMut(&PlyRow),
) -> Result<(), InputError> {
    let mut row = PlyRow::default();
    for number in 0..element.count {
        values.row(element, &mut row).map_err(|what| {
            let place = format!("{} {number}, byte {}", element.name, values.position());
            InputError::damaged(label, place, what)
        })?;
        take(&row);
    }
    Ok(())
}

fn read_vertices(label: &str, element: &PlyElement, values: &mut PlyValues<'_>) -> Result<Vertices, InputError> {
    let xyz = element.places(["x", "y", "z"]);
    let xyz = xyz.ok_or_else(|| InputError::damaged(label, "header", "the vertices have no x, y and z"))?;
    let uv = UV_NAMES.iter().find_map(|names| element.places(*names));
    let colour = colour_of(element);
    let (mut vertices, mut floats) = (Vertices::default(), Vec::new());
    read_rows(label, element, values, |row| {
        vertices.positions.push(xyz.map(|place| row.single(place)));
        if let Some(uv) = uv {
            vertices.uv.push(uv.map(|place| row.single(place) as f32));
        }
        match &colour {
            Some(colour) if colour.is_float => floats.push(colour.numbers(row)),
            Some(colour) => vertices.colours.push(colour.of(row)),
            None => {}
        }
    })?;
    if !floats.is_empty() {
        vertices.colours = bytes_of(&floats);
    }
    Ok(vertices)
}
