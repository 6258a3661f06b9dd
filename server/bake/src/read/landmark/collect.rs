//! Reads a mesh file of any format into meshes in memory.

use insula_dress::polygon::{CROSSING, Triangulator};
use insula_read_scene::{read_gltf, read_mesh, read_obj};
use insula_source::error::InputError;
use insula_source::object::{CrsReference, Description, ObjectSink, Shape, SourceMaterial, SourceObject, TriangleMesh};
use insula_source::report::SourceFormat;
use insula_source::source::{CitySource, SourceKind, kind_by_name};

/// A mesh file as it is.
#[derive(Default)]
pub(super) struct Collected {
    pub(super) meshes: Vec<TriangleMesh>,
    pub(super) materials: Vec<SourceMaterial>,
    /// Faults of parts, for the report.
    pub(super) problems: Vec<(&'static str, String)>,
    pub(super) described: Vec<(Description, String)>,
}

/// The format of a mesh file by its name; `None` for others.
pub(super) fn format_of(name: &str) -> Option<SourceFormat> {
    match kind_by_name(name) {
        Some(SourceKind::Ply) => Some(SourceFormat::Ply),
        Some(SourceKind::Stl) => Some(SourceFormat::Stl),
        Some(SourceKind::Gltf) => Some(SourceFormat::Gltf),
        Some(SourceKind::Off) => Some(SourceFormat::Off),
        Some(SourceKind::Obj) => Some(SourceFormat::Obj),
        _ => None,
    }
}

/// Reads a mesh file. Positions are the file's own; in glTF they are east, north and up. Fails if it cannot be read, or is larger
/// than `max_bytes`.
pub(super) fn collect(source: &CitySource<'_>, max_bytes: u64) -> Result<Collected, InputError> {
    let mut sink = Collector { out: Collected::default(), triangulator: Triangulator::new() };
    let input = source.input(max_bytes);
    match format_of(&source.name) {
        Some(SourceFormat::Ply | SourceFormat::Stl | SourceFormat::Off) => read_mesh(&input, &mut sink)?,
        Some(SourceFormat::Gltf) => read_gltf(&input, &mut sink)?,
        Some(_) => read_obj(&input, &mut sink)?,
        None => {
            return Err(InputError::unsupported(&source.label, "a landmark is a PLY, OBJ, STL, OFF, GLB or glTF file"));
        }
    }
    Ok(sink.out)
}

struct Collector {
    out: Collected,
    triangulator: Triangulator,
}

impl ObjectSink for Collector {
    fn set_crs(&mut self, _: &CrsReference) -> Result<(), InputError> {
        Ok(())
    }

    fn add_material(&mut self, material: SourceMaterial) -> u32 {
        self.out.materials.push(material);
        self.out.materials.len() as u32 - 1
    }

    fn add(&mut self, object: SourceObject) -> Result<(), InputError> {
        let Shape::Surfaces { polygons, meshes } = object.shape else { return Ok(()) };
        self.out.meshes.extend(meshes);
        let mut of_polygons: Option<TriangleMesh> = None;
        for surface in polygons {
            let Ok(triangles) = self.triangulator.triangulate(&surface.points, &surface.hole_starts) else {
                self.out.problems.push(("polygon without area", object.id.clone()));
                continue;
            };
            if let Some(difference) = triangles.areas.difference() {
                self.out.problems.push((CROSSING, format!("{}: {difference}", object.id)));
            }
            let is_new = of_polygons.as_ref().is_none_or(|mesh| mesh.material != surface.material);
            if is_new {
                self.out.meshes.extend(of_polygons.take());
            }
            let mesh = of_polygons
                .get_or_insert_with(|| TriangleMesh { material: surface.material, ..TriangleMesh::default() });
            let first = mesh.positions.len() as u32;
            mesh.triangles.extend(triangles.list.iter().map(|triangle| triangle.map(|corner| corner + first)));
            if surface.uv.len() == surface.points.len() && mesh.uv.len() == mesh.positions.len() {
                mesh.uv.extend(&surface.uv);
            }
            mesh.positions.extend(surface.points);
        }
        self.out.meshes.extend(of_polygons);
        Ok(())
    }

    fn skip(&mut self, reason: &'static str, detail: String) {
        self.out.problems.push((reason, detail));
    }

    fn problem(&mut self, kind: &'static str, detail: String) {
        self.out.problems.push((kind, detail));
    }

    fn describe(&mut self, what: Description, text: &str) {
        self.out.described.push((what, text.to_owned()));
    }

    fn tick(&mut self, _: u64) {}
}
