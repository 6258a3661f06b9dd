//! Wavefront OBJ with MTL. A face that is wrong costs only itself.
//!
//! In: a source, its libraries and pictures. Out: objects in the builder and a [`SourceReport`]. Next: `builder`.

mod mtl;
mod objects;
mod parse;
#[cfg(test)]
mod tests;

use std::collections::HashMap;

use super::builder::{WorldTriangle, is_sane};
use super::cityjson::byte;
use super::error::InputError;
use super::polygon::MAX_CORNERS;
use super::report::{SourceFormat, SourceReport};
use super::source::{CitySource, open, read_beside};
use super::{ByteProgress, ReadContext, UpAxis};
use crate::scene::ObjectKind;
use mtl::MtlMaterial;
use objects::{FaceGroups, group, is_terrain};
use parse::{NONE, ObjFace, ObjFile};

/// A material library of more bytes is not read.
const MAX_LIBRARY_BYTES: u64 = 64 << 20;

/// Reads a source.
pub(crate) fn read(
    reading: &mut ReadContext<'_>,
    source: &CitySource<'_>,
    tick: ByteProgress<'_>,
) -> Result<SourceReport, InputError> {
    let mut report = SourceReport::new(&source.label, SourceFormat::Obj, source.bytes);
    let mut opened = open(source)?;
    let taken = opened.taken;
    let limit = reading.options.max_source_bytes;
    let mut model = parse::parse(&mut opened.reader, limit, &mut report, &|| tick(taken.get()))?;
    if reading.options.obj_up == UpAxis::Y {
        model.positions.iter_mut().for_each(|p| *p = [p[0], -p[2], p[1]]);
    }
    let polygons = usable(&model, &mut report);
    let library = library(&model, source, &mut report);
    let paints = paints(&model, &polygons, &library, (&mut *reading, source), &mut report);
    let objects = group(&model, &polygons, stem(&source.name));
    add_objects(reading, &model, &polygons, (&objects, &paints), &mut report);
    Ok(report)
}

/// The file's name without folders and extensions.
fn stem(name: &str) -> &str {
    let name = name.rsplit('/').next().unwrap_or(name);
    let end = name.to_ascii_lowercase().rfind(".obj").unwrap_or(name.len());
    &name[..end]
}

/// The polygons whose corners all exist and lie somewhere.
fn usable(model: &ObjFile, report: &mut SourceReport) -> Vec<ObjFace> {
    let count = model.positions.len();
    let mut usable = Vec::with_capacity(model.polygons.len());
    for polygon in &model.polygons {
        let corners = &model.corners[polygon.first..polygon.first + polygon.len as usize];
        let line = polygon.line;
        if let Some([position, _]) = corners.iter().find(|corner| corner[0] as usize >= count) {
            report.problem("vertex index out of range", || match *position {
                NONE => format!("line {line}: no vertex index, of {count}"),
                position => format!("line {line}: vertex index {} out of range of {count}", u64::from(position) + 1),
            });
        } else if corners.iter().any(|corner| !is_sane(model.positions[corner[0] as usize])) {
            report.problem("coordinate not a number or beyond 1e9 m", || format!("line {line}"));
        } else if corners.len() > MAX_CORNERS {
            report.problem("polygon too large", || format!("line {line}: {} corners", corners.len()));
        } else {
            usable.push(*polygon);
        }
    }
    usable
}

/// All materials of all libraries named.
fn library(model: &ObjFile, source: &CitySource<'_>, report: &mut SourceReport) -> HashMap<String, MtlMaterial> {
    let mut materials = HashMap::new();
    let folder = source.name.rsplit_once('/').map_or(String::new(), |(folder, _)| format!("{folder}/"));
    for argument in &model.libraries {
        // One name with blanks or several names: files tell.
        let open = |name: &str| {
            read_beside(&*source.files, &format!("{folder}{}", name.replace('\\', "/")), MAX_LIBRARY_BYTES)
        };
        match open(argument) {
            Ok(bytes) => mtl::parse(&String::from_utf8_lossy(&bytes), &mut materials),
            Err(error) => {
                let mut names = argument.split_ascii_whitespace().filter(|name| name.len() < argument.len()).peekable();
                if names.peek().is_none() {
                    report.problem("material library missing", || format!("{argument}: {error}"));
                }
                for name in names {
                    match open(name) {
                        Ok(bytes) => mtl::parse(&String::from_utf8_lossy(&bytes), &mut materials),
                        Err(error) => report.problem("material library missing", || format!("{name}: {error}")),
                    }
                }
            }
        }
    }
    materials
}

/// How a material's faces are coloured: without the picture where they have no texture coordinates.
#[derive(Clone, Copy, Default)]
struct FaceMaterials {
    plain: u32,
    textured: Option<u32>,
}

/// The paint of each of the model's materials that is used; pictures are decoded here.
fn paints(
    model: &ObjFile,
    polygons: &[ObjFace],
    library: &HashMap<String, MtlMaterial>,
    (reading, source): (&mut ReadContext<'_>, &CitySource<'_>),
    report: &mut SourceReport,
) -> Vec<FaceMaterials> {
    let mut used = vec![false; model.materials.len()];
    polygons.iter().for_each(|polygon| used[polygon.material as usize] = true);
    let mut paints = vec![FaceMaterials::default(); used.len()];
    for (i, name) in model.materials.iter().enumerate().filter(|(i, _)| used[*i]) {
        let material = library.get(name);
        if material.is_none() && !name.is_empty() {
            report.problem("material missing", || name.clone());
        }
        let diffuse = material.and_then(|material| material.diffuse).map(|rgb| rgb.map(byte));
        let picture = material.and_then(|material| material.picture.as_deref());
        let texture = picture.and_then(|name| reading.textures.load(source, name, report));
        let palette = &reading.options.palette;
        let plain = diffuse.or_else(|| palette.material(name)).unwrap_or(palette.fallback);
        paints[i].plain = reading.builder.material(plain, None);
        paints[i].textured = texture.map(|texture| textured(reading, diffuse, texture));
    }
    paints
}

/// A black Kd under a picture is an exporter's way of saying nothing: multiplied, it would hide the picture.
fn textured(reading: &mut ReadContext<'_>, diffuse: Option<[u8; 3]>, texture: u32) -> u32 {
    let rgb = diffuse.filter(|rgb| *rgb != [0; 3]).unwrap_or([255; 3]);
    reading.builder.material(rgb, Some(texture))
}

/// Triangulates object by object.
fn add_objects(
    reading: &mut ReadContext<'_>,
    model: &ObjFile,
    polygons: &[ObjFace],
    (objects, paints): (&FaceGroups, &[FaceMaterials]),
    report: &mut SourceReport,
) {
    let mut order: Vec<usize> = (0..polygons.len()).collect();
    order.sort_by_key(|&i| objects.of_polygon[i]);
    let mut faces = Vec::new();
    for run in order.chunk_by(|&a, &b| objects.of_polygon[a] == objects.of_polygon[b]) {
        faces.clear();
        for &i in run {
            let polygon = &polygons[i];
            add_faces(reading, model, polygon, paints[polygon.material as usize], &mut faces, report);
        }
        let id = &objects.ids[objects.of_polygon[run[0]] as usize];
        let (kind, name) =
            if is_terrain(id) { (ObjectKind::Terrain, "terrain") } else { (ObjectKind::Building, "object") };
        report.count_type(name);
        if faces.is_empty() {
            report.skip("no surface with an area", || id.clone());
        } else {
            reading.builder.add(reading.source, id, kind, &faces, report);
        }
    }
}

fn add_faces(
    reading: &mut ReadContext<'_>,
    model: &ObjFile,
    polygon: &ObjFace,
    paint: FaceMaterials,
    faces: &mut Vec<WorldTriangle>,
    report: &mut SourceReport,
) {
    let corners = &model.corners[polygon.first..polygon.first + polygon.len as usize];
    let points: Vec<[f64; 3]> = corners.iter().map(|corner| model.positions[corner[0] as usize]).collect();
    let Some(triangles) = reading.triangulator.triangulate(&points, &[]) else {
        report.problem("polygon without area", || format!("line {}", polygon.line));
        return;
    };
    let uvs: Option<Vec<[f32; 2]>> = corners.iter().map(|corner| model.uvs.get(corner[1] as usize).copied()).collect();
    let (material, uvs) = match (paint.textured, uvs) {
        (Some(material), Some(uvs)) => (material, uvs),
        (Some(_), None) => {
            report.problem("textured face without texture coordinates", || format!("line {}", polygon.line));
            (paint.plain, Vec::new())
        }
        (None, _) => (paint.plain, Vec::new()),
    };
    for triangle in triangles {
        let corners = triangle.map(|i| points[i as usize]);
        let uv = triangle.map(|i| uvs.get(i as usize).copied().unwrap_or_default());
        faces.push(WorldTriangle { corners, uv, material });
    }
}
