//! Wavefront OBJ with MTL. A malformed face costs only itself.

mod grouping;
mod mtl;
mod object_count;
mod parse;
#[cfg(test)]
mod tests;

use std::collections::HashMap;

use super::context::{ByteProgress, ObjUpAxis, ReadContext};
use super::facade::FacadeUse;
use super::scene_builder::{OpenObject, WorldTriangle, is_valid_position};
use crate::scene::{ObjectKind, scratch_scene::StoredMaterial};
use grouping::{FaceGroups, group_faces, is_terrain};
use insula_dress::palette::{BuildingLook, ObjectShape, SurfaceFacts, normal_z, unit_to_byte};
use insula_dress::polygon::{CROSSING, MAX_CORNERS};
use insula_source::error::InputError;
use insula_source::report::{ColourOrigin, SourceFormat, SourceReport};
use insula_source::source::{CitySource, open, read_sibling};
use insula_source::subject;
use mtl::MtlMaterial;
use parse::{NONE, ObjFace, ObjFile};

/// Larger material libraries are not read.
const MAX_LIBRARY_BYTES: u64 = 64 << 20;

/// Reads a source. Fails if it cannot be read or exceeds the size limit.
pub(crate) fn read(
    context: &mut ReadContext<'_>,
    source: &CitySource<'_>,
    tick: ByteProgress<'_>,
) -> Result<SourceReport, InputError> {
    let mut report = SourceReport::new(&source.label, SourceFormat::Obj, source.bytes);
    let mut opened = open(source)?;
    let bytes_read = opened.bytes_read;
    let limit = context.options.max_source_bytes;
    let mut file = parse::parse(&mut opened.reader, limit, &mut report, &|| tick(bytes_read.get()))?;
    if context.options.obj_up == ObjUpAxis::Y {
        file.positions.iter_mut().for_each(|p| *p = [p[0], -p[2], p[1]]);
    }
    let (placement, frame) = context.place_of_mesh(source)?;
    report.crs = placement.source_crs().map(str::to_owned);
    // A position that cannot be placed is reported as invalid with its face.
    file.positions.iter_mut().for_each(|p| *p = placement.position(frame.apply(*p)).unwrap_or([f64::NAN; 3]));
    let mut reader = ObjReader { context, source, file: &file, report: &mut report };
    let faces = reader.usable_faces();
    let library = reader.read_libraries();
    let materials = reader.load_materials(&faces, &library);
    let groups = group_faces(&file, &faces, stem(&source.name));
    object_count::count_objects(&file, &faces, &groups, reader.report);
    reader.add_objects(&faces, &groups, &materials);
    Ok(report)
}

/// The file's name without folders and extensions.
fn stem(name: &str) -> &str {
    let name = name.rsplit('/').next().unwrap_or(name);
    let end = name.to_ascii_lowercase().rfind(".obj").unwrap_or(name.len());
    &name[..end]
}

/// One material of the file.
#[derive(Clone, Copy, Default)]
struct FaceMaterial<'a> {
    name: &'a str,
    /// Colour of faces without texture coordinates.
    diffuse: Option<[u8; 3]>,
    /// Number of the scene's material for textured faces.
    textured: Option<u32>,
    /// Whether it is water or glass.
    is_reflective: bool,
}

/// Whether a material is that of windows or doors, judged by its name.
fn names_an_opening(material: &str) -> bool {
    let name = material.to_lowercase();
    ["window", "glass", "door"].iter().any(|word| name.contains(word))
}

/// What the faces of an object have in common.
struct FaceObject {
    /// As in CityJSON; empty for a building.
    object_type: &'static str,
    look: BuildingLook,
}

/// Adds the content of a parsed file to the city.
struct ObjReader<'r, 'o, 's> {
    context: &'r mut ReadContext<'o>,
    source: &'r CitySource<'s>,
    file: &'r ObjFile,
    report: &'r mut SourceReport,
}

impl<'r> ObjReader<'r, '_, '_> {
    /// The faces whose corners all exist and have valid positions.
    fn usable_faces(&mut self) -> Vec<ObjFace> {
        let (file, report) = (self.file, &mut *self.report);
        let count = file.positions.len();
        let mut usable = Vec::with_capacity(file.faces.len());
        for face in &file.faces {
            let corners = file.corners_of(face);
            let line = face.line;
            if let Some([position, _]) = corners.iter().find(|corner| corner[0] as usize >= count) {
                report.problem("vertex index out of range", || match *position {
                    NONE => format!("line {line}: no vertex index, of {count}"),
                    position => {
                        format!("line {line}: vertex index {} out of range of {count}", u64::from(position) + 1)
                    }
                });
            } else if corners.iter().any(|corner| !is_valid_position(file.positions[corner[0] as usize])) {
                report.problem("coordinate not a number or beyond 1e9 m", || format!("line {line}"));
            } else if corners.len() > MAX_CORNERS {
                report.problem("polygon too large", || format!("line {line}: {} corners", corners.len()));
            } else {
                usable.push(*face);
            }
        }
        usable
    }

    /// The materials of all libraries that the file names.
    fn read_libraries(&mut self) -> HashMap<String, MtlMaterial> {
        let (source, report) = (self.source, &mut *self.report);
        let mut materials = HashMap::new();
        let folder = source.name.rsplit_once('/').map_or(String::new(), |(folder, _)| format!("{folder}/"));
        for argument in &self.file.libraries {
            let read = |name: &str| {
                let path = format!("{folder}{}", name.replace('\\', "/"));
                read_sibling(&*source.files, &path, MAX_LIBRARY_BYTES)
            };
            // The argument is one name with blanks, or several names: the one that exists decides.
            match read(argument) {
                Ok(bytes) => mtl::parse(&String::from_utf8_lossy(&bytes), &mut materials),
                Err(error) => {
                    let names = argument.split_ascii_whitespace().filter(|name| name.len() < argument.len());
                    let mut names = names.peekable();
                    if names.peek().is_none() {
                        report.problem("material library missing", || format!("{argument}: {error}"));
                    }
                    for name in names {
                        match read(name) {
                            Ok(bytes) => mtl::parse(&String::from_utf8_lossy(&bytes), &mut materials),
                            Err(error) => report.problem("material library missing", || format!("{name}: {error}")),
                        }
                    }
                }
            }
        }
        materials
    }

    /// Loads the materials that `faces` use, with their textures; by material number of the file.
    fn load_materials(&mut self, faces: &[ObjFace], library: &HashMap<String, MtlMaterial>) -> Vec<FaceMaterial<'r>> {
        let file = self.file;
        let names = &file.materials;
        let mut is_used = vec![false; names.len()];
        faces.iter().for_each(|face| is_used[face.material as usize] = true);
        let mut materials = vec![FaceMaterial::default(); names.len()];
        for (i, name) in names.iter().enumerate().filter(|(i, _)| is_used[*i]) {
            let material = library.get(name);
            if material.is_none() && !name.is_empty() {
                self.report.problem("material missing", || name.clone());
            }
            let diffuse = material.and_then(|material| material.diffuse).map(|rgb| rgb.map(unit_to_byte));
            let image = material.and_then(|material| material.texture.as_deref());
            let texture = image.and_then(|name| self.context.textures.load(self.source, name, self.report));
            let facts = SurfaceFacts { semantic: None, object_type: "", material: Some(name), normal_z: 0.0 };
            let is_reflective = facts.is_reflective() || material.is_some_and(MtlMaterial::is_glass);
            let textured = texture.map(|texture| self.textured_material(diffuse, texture, is_reflective));
            materials[i] = FaceMaterial { name, diffuse, textured, is_reflective };
        }
        materials
    }

    /// The number of a textured material. Exporters write a black `Kd` for textured materials, which would hide the
    /// texture, so it is ignored.
    fn textured_material(&mut self, diffuse: Option<[u8; 3]>, texture: u32, is_reflective: bool) -> u32 {
        let rgb = diffuse.filter(|rgb| *rgb != [0; 3]).unwrap_or([255; 3]);
        self.context.builder.material(StoredMaterial { rgb, texture: Some(texture), is_reflective })
    }

    /// Triangulates the faces and adds them as objects.
    fn add_objects(&mut self, faces: &[ObjFace], groups: &FaceGroups, materials: &[FaceMaterial<'_>]) {
        let mut order: Vec<usize> = (0..faces.len()).collect();
        order.sort_by_key(|&i| groups.of_face[i]);
        /// Triangles that are collected before they are added to the city.
        const FLUSH_TRIANGLES: usize = 1 << 14;
        let mut triangles = Vec::new();
        for run in order.chunk_by(|&a, &b| groups.of_face[a] == groups.of_face[b]) {
            let id = &groups.ids[groups.of_face[run[0]] as usize];
            subject::set(format_args!("{}: object {id}", self.report.path));
            let (kind, name) =
                if is_terrain(id) { (ObjectKind::Terrain, "terrain") } else { (ObjectKind::Building, "object") };
            self.report.count_type(name);
            let object = self.object(kind, id, run.iter().map(|&i| &faces[i]));
            let mut open = OpenObject::new(kind);
            open.has_own_base = kind == ObjectKind::Building;
            for &i in run {
                let face = &faces[i];
                self.triangulate(face, &object, materials[face.material as usize], &mut triangles);
                if triangles.len() >= FLUSH_TRIANGLES {
                    self.context.push(&mut open, &mut triangles, FacadeUse::default());
                }
            }
            self.context.push(&mut open, &mut triangles, FacadeUse::default());
            if open.triangles == 0 {
                self.report.skip("no surface with an area", || id.clone());
            }
            self.context.builder.close(self.context.source, id, open, self.report);
        }
    }

    /// Measures the faces of an object.
    fn object<'f>(&self, kind: ObjectKind, id: &str, faces: impl Iterator<Item = &'f ObjFace>) -> FaceObject {
        if kind == ObjectKind::Terrain {
            return FaceObject { object_type: "TINRelief", look: BuildingLook::PLAIN };
        }
        let mut shape = ObjectShape::new();
        let mut points = Vec::new();
        for face in faces {
            points.clear();
            points.extend(self.file.corners_of(face).iter().map(|corner| self.file.positions[corner[0] as usize]));
            shape.add(&points);
        }
        FaceObject { object_type: "", look: BuildingLook::new(id, None, &shape) }
    }

    fn triangulate(
        &mut self,
        face: &ObjFace,
        object: &FaceObject,
        material: FaceMaterial<'_>,
        triangles: &mut Vec<WorldTriangle>,
    ) {
        let (file, report) = (self.file, &mut *self.report);
        let corners = file.corners_of(face);
        let points: Vec<[f64; 3]> = corners.iter().map(|corner| file.positions[corner[0] as usize]).collect();
        let found = match self.context.triangulator.triangulate(&points, &[]) {
            Ok(found) => found,
            Err(fault) => {
                report.problem(fault.reason(), || format!("line {}", face.line));
                return;
            }
        };
        if let Some(difference) = found.areas.difference() {
            report.problem(CROSSING, || format!("line {}: {difference}", face.line));
        }
        let uvs: Option<Vec<[f32; 2]>> =
            corners.iter().map(|corner| file.uvs.get(corner[1] as usize).copied()).collect();
        if material.textured.is_some() && uvs.is_none() {
            report.problem("textured face without texture coordinates", || format!("line {}", face.line));
        }
        let (number, uvs) = match (material.textured, uvs) {
            (Some(number), Some(uvs)) => {
                report.colours.add(ColourOrigin::Texture);
                (number, uvs)
            }
            _ => {
                let FaceObject { object_type, look } = object;
                let normal_z = normal_z(&points);
                let facts = SurfaceFacts { semantic: None, object_type, material: Some(material.name), normal_z };
                let (rgb, origin) = self.context.options.palette.resolve(material.diffuse, &facts, look);
                report.colours.add(origin);
                let stored = StoredMaterial { rgb, texture: None, is_reflective: material.is_reflective };
                (self.context.builder.material(stored), Vec::new())
            }
        };
        let is_opening = material.is_reflective || names_an_opening(material.name);
        let is_facade = uvs.is_empty() && object.object_type.is_empty() && !is_opening;
        for triangle in found.list {
            let corners = triangle.map(|i| points[i as usize]);
            let uv = triangle.map(|i| uvs.get(i as usize).copied().unwrap_or_default());
            triangles.push(WorldTriangle { corners, uv, material: number, is_facade });
        }
    }
}
