//! Landmarks: meshes of statues and monuments, each one object of dense triangles, of a stone or in its own colours.
//!
//! | step | module |
//! |---|---|
//! | read the file that places them | `file` |
//! | repair it | `repair` |
//! | check its stone | `../stone` |
//! | turn, scale and place it, as one object of the city | this |
//!
//! Without a height, a landmark stands on the ground ([`super::scene_builder`]).

mod file;

use super::bad_inputs::BadInputs;
use super::context::{ReadContext, ReadOptions};
use super::list::list_mesh;
use super::scene_builder::PendingLandmark;
use super::sink::SceneSink;
pub(super) use file::{LandmarkPlan, read_plans};
use file::{Position, Size, Up};
use glam::DVec3;
use insula_dress::polygon::{CROSSING, Triangulator};
use insula_place::local_frame;
use insula_place::placement::{MeshExtent, Placement};
use insula_read_scene::{read_gltf, read_mesh, read_obj};
use insula_simplify::repair::{PlainMesh, Repairs};
use insula_source::attributes::{AttributeValue, Attributes};
use insula_source::error::InputError;
use insula_source::object::{
    CrsReference, Description, FeatureKind, ObjectSink, Shape, SourceMaterial, SourceObject, TriangleMesh,
};
use insula_source::report::{SourceFormat, SourceReport};
use insula_source::source::{CitySource, SourceKind, kind_by_name};
use std::path::PathBuf;

/// Turns and scales a mesh, and moves the middle of its base to a place.
struct MeshTransform {
    base: DVec3,
    place: DVec3,
    scale: f64,
    cos: f64,
    sin: f64,
    is_y_up: bool,
}

impl MeshTransform {
    fn upright(&self, [x, y, z]: [f64; 3]) -> DVec3 {
        if self.is_y_up { DVec3::new(x, -z, y) } else { DVec3::new(x, y, z) }
    }

    fn apply(&self, p: [f64; 3]) -> [f64; 3] {
        let p = (self.upright(p) - self.base) * self.scale;
        (self.place + DVec3::new(p.x * self.cos + p.y * self.sin, p.y * self.cos - p.x * self.sin, p.z)).to_array()
    }

    /// The transform of a plan, for positions with these bounds. Fails with what is wrong.
    fn new(plan: &LandmarkPlan, place: DVec3, is_y_up: bool, meshes: &[TriangleMesh]) -> Result<Self, &'static str> {
        let (sin, cos) = libm::sincos(plan.heading_deg.to_radians());
        let unplaced = Self { base: DVec3::ZERO, place: DVec3::ZERO, scale: 1.0, cos: 1.0, sin: 0.0, is_y_up };
        let points = meshes.iter().flat_map(|mesh| &mesh.positions).map(|p| unplaced.upright(*p));
        let bounds = points.map(|p| [p, p]).reduce(|[low, high], [p, _]| [low.min(p), high.max(p)]);
        let Some([low, high]) = bounds.filter(|[low, high]| low.is_finite() && high.is_finite()) else {
            return Err("it has no vertices, or one that is not finite");
        };
        let scale = match plan.size {
            Size::Scale(scale) => scale,
            Size::Height(height) if high.z > low.z => height / (high.z - low.z),
            Size::Height(_) => return Err("it has no height of its own: give its scale"),
        };
        let middle = (low + high) / 2.0;
        Ok(Self { base: DVec3::new(middle.x, middle.y, low.z), place, scale, cos, sin, is_y_up })
    }
}

/// Reads a landmark into the city. Fails if its mesh cannot be read, or if its place or its stone is not known.
pub(super) fn read(
    context: &mut ReadContext<'_>,
    source: &CitySource<'_>,
    plan: &LandmarkPlan,
) -> Result<SourceReport, InputError> {
    let format = mesh_format(source)?;
    let mut collected = collect(source, context.options.max_source_bytes)?;
    let stone = plan.stone.as_deref().map(|text| context.add_stone(&source.label, text)).transpose()?;
    let (placement, place) = place_of(context, source, plan)?;
    // glTF has its own vertical axis, which its reader knows.
    let is_y_up = plan.up == Up::Y && format != SourceFormat::Gltf;
    let transform = MeshTransform::new(plan, place, is_y_up, &collected.meshes)
        .map_err(|what| InputError::unsupported(&source.label, what))?;
    for position in collected.meshes.iter_mut().flat_map(|mesh| &mut mesh.positions) {
        *position = transform.apply(*position);
    }
    let mut sink = SceneSink::new(context, source, format, &|_| {})?;
    sink.set_placement(placement);
    let landmark =
        PendingLandmark { object: 0, stone: stone.map(|stone| stone.number), is_on_ground: plan.height_m.is_none() };
    add(&mut sink, collected, &plan.name, stone.map(|stone| stone.rgb), landmark)?;
    let texts = [(Description::Attribution, &plan.attribution), (Description::Licence, &plan.licence)];
    for (what, text) in texts {
        text.iter().for_each(|text| sink.describe(what, text));
    }
    Ok(sink.into_report())
}

/// Reads the only input of a bake, a mesh, as a landmark where its file places it. Fails as [`read`].
pub(super) fn read_alone(context: &mut ReadContext<'_>, source: &CitySource<'_>) -> Result<SourceReport, InputError> {
    let format = mesh_format(source)?;
    let collected = collect(source, context.options.max_source_bytes)?;
    let stone = context.options.stone.as_deref().map(|text| context.add_stone(&source.label, text)).transpose()?;
    let mut sink = SceneSink::new(context, source, format, &|_| {})?;
    let name = source.name.rsplit('/').next().unwrap_or(&source.name);
    let name = name.split_once('.').map_or(name, |(stem, _)| stem);
    let landmark = PendingLandmark { object: 0, stone: stone.map(|stone| stone.number), is_on_ground: false };
    add(&mut sink, collected, if name.is_empty() { "mesh" } else { name }, stone.map(|stone| stone.rgb), landmark)?;
    Ok(sink.into_report())
}

fn mesh_format(source: &CitySource<'_>) -> Result<SourceFormat, InputError> {
    let what = "a landmark is a PLY, OBJ, STL, OFF, GLB or glTF file";
    format_of(&source.name).ok_or_else(|| InputError::unsupported(&source.label, what))
}

/// Where a plan's positions are: in the city's system at its place, or in metres around a place on Earth.
fn place_of(
    context: &mut ReadContext<'_>,
    source: &CitySource<'_>,
    plan: &LandmarkPlan,
) -> Result<(Placement, DVec3), InputError> {
    let height_m = plan.height_m.unwrap_or(0.0);
    match plan.position {
        Position::City([x, y]) => Ok((Placement::Unknown, DVec3::new(x, y, height_m))),
        Position::Earth([lon, lat]) => {
            let name = format!("ENU:{lon},{lat},{height_m}");
            let reference = CrsReference::east_first(name);
            let mut placement = context.world.place(&source.label, &reference)?;
            context.settle(&mut placement, &source.label, [0.0; 3])?;
            Ok((placement, DVec3::ZERO))
        }
    }
}

/// Adds the meshes as one object.
fn add(
    sink: &mut SceneSink<'_, '_, '_>,
    collected: Collected,
    name: &str,
    stone_rgb: Option<[u8; 3]>,
    landmark: PendingLandmark,
) -> Result<(), InputError> {
    let Collected { meshes, materials, problems, described } = collected;
    problems.into_iter().for_each(|(kind, detail)| sink.problem(kind, detail));
    described.iter().for_each(|(what, text)| sink.describe(*what, text));
    let has_colour = |number: u32| {
        materials.get(number as usize).is_some_and(|material| material.rgb.is_some() || material.texture.is_some())
    };
    let is_plain = meshes
        .iter()
        .all(|mesh| mesh.uv.is_empty() && mesh.colours.is_empty() && !mesh.material.is_some_and(has_colour));
    let meshes = if stone_rgb.is_some() || is_plain {
        let material = stone_rgb.map(|rgb| {
            sink.add_material(SourceMaterial { rgb: Some(rgb), is_exact: true, ..SourceMaterial::default() })
        });
        let mut plain = join(&meshes);
        drop(meshes);
        report(sink, name, plain.repair());
        let PlainMesh { positions, triangles } = plain;
        vec![TriangleMesh { positions, triangles, material, ..TriangleMesh::default() }]
    } else {
        let numbers: Vec<u32> = materials.into_iter().map(|material| sink.add_material(material)).collect();
        let renumbered = |mesh: TriangleMesh| {
            let material = mesh.material.and_then(|number| numbers.get(number as usize).copied());
            TriangleMesh { material, ..mesh }
        };
        meshes.into_iter().map(renumbered).collect()
    };
    let mut attributes = Attributes::default();
    attributes.push("name", AttributeValue::Text(name.to_owned()));
    let object = SourceObject {
        id: name.to_owned(),
        parent: None,
        kind: FeatureKind::Furniture,
        source_type: "landmark".to_owned(),
        lod: None,
        attributes,
        shape: Shape::Surfaces { polygons: Vec::new(), meshes },
    };
    sink.add_landmark(object, landmark)
}

fn join(meshes: &[TriangleMesh]) -> PlainMesh {
    let mut all = PlainMesh::default();
    for mesh in meshes {
        let first = all.positions.len() as u32;
        all.positions.extend(&mesh.positions);
        let exists = |t: &&[u32; 3]| t.iter().all(|v| (*v as usize) < mesh.positions.len());
        all.triangles.extend(mesh.triangles.iter().filter(exists).map(|t| t.map(|vertex| vertex + first)));
    }
    all
}

/// Reports the repairs of a scan and the faults that remain.
fn report(sink: &mut SceneSink<'_, '_, '_>, name: &str, repairs: Repairs) {
    let Repairs { dropped_triangles, turned_triangles, filled_holes, open_edges, branching_edges, .. } = repairs;
    let done = [
        (dropped_triangles, "triangles without area or given twice dropped"),
        (turned_triangles, "triangles turned outwards"),
        (filled_holes, "tiny holes filled"),
    ];
    let left = [(open_edges, "open edges"), (branching_edges, "edges of more than two triangles")];
    for (kind, counts) in [("scan repaired", &done[..]), ("scan with faults that remain", &left[..])] {
        let texts: Vec<String> =
            counts.iter().filter(|(count, _)| *count > 0).map(|(count, what)| format!("{count} {what}")).collect();
        if !texts.is_empty() {
            sink.problem(kind, format!("{name}: {}", texts.join(", ")));
        }
    }
}

/// Whether sources may be one mesh without a city. An OBJ or glTF file may well be a city; a stone says that it is none.
fn may_be_monument(sources: &[CitySource<'_>], has_stone: bool) -> bool {
    let [source] = sources else { return false };
    let format = format_of(&source.name);
    matches!(format, Some(SourceFormat::Ply | SourceFormat::Stl | SourceFormat::Off)) || has_stone && format.is_some()
}

/// Side in metres of the columns for inputs that are one mesh, a monument without a city: they show its shape from afar. `None` if the
/// inputs are something else, or cannot be read.
///
/// A large mesh whose coordinates are metres on Earth is a city: `at` or a file beside it places it, or it lies far from its origin.
/// One in degrees is none either. Otherwise the unit of a scan is not known.
#[must_use]
pub fn cell_of_monument(inputs: &[PathBuf], has_stone: bool, at: Option<[f64; 3]>) -> Option<f64> {
    /// Columns along the longest side.
    const COLUMNS: f64 = 100.0;
    const RANGE_M: [f64; 2] = [0.01, 1.0];
    const MAX_MONUMENT_M: f64 = 100.0;
    /// Distance of the origin from which coordinates are those of a map, in longest sides.
    const FAR: f64 = 10.0;
    let options = ReadOptions::default();
    let listed = list_mesh(inputs, &options, &mut BadInputs::new(false)).ok()?;
    if !may_be_monument(&listed.sources, has_stone) {
        return None;
    }
    let source = listed.sources.first()?;
    let [low, high] = join(&collect(source, options.max_source_bytes).ok()?.meshes).bounds()?;
    let has_place = local_frame::find(source, at).ok()?.is_some();
    let extent = MeshExtent::of([low, high].into_iter().map(|corner| corner.to_array()));
    let is_on_earth = |extent: MeshExtent| extent.is_certainly_in_degrees() || extent.is_certainly_geocentric();
    if !has_stone && !has_place && extent.is_some_and(is_on_earth) {
        return None;
    }
    let longest = (high - low).max_element();
    let is_placed = has_place || low.abs().max_element() > FAR * longest;
    if is_placed && longest > MAX_MONUMENT_M && !has_stone {
        return None;
    }
    let cell_m = longest / COLUMNS;
    // 1, 2 or 5 times a power of ten.
    let decade = libm::pow(10f64, libm::log10(cell_m).floor());
    let rounded = [1.0, 2.0, 5.0].map(|step| step * decade).into_iter().rfind(|step| *step <= cell_m).unwrap_or(decade);
    cell_m.is_finite().then(|| rounded.clamp(RANGE_M[0], RANGE_M[1]))
}

/// A mesh file as it is.
#[derive(Default)]
struct Collected {
    meshes: Vec<TriangleMesh>,
    materials: Vec<SourceMaterial>,
    /// Faults of parts, for the report.
    problems: Vec<(&'static str, String)>,
    described: Vec<(Description, String)>,
}

/// The format of a mesh file by its name; `None` for others.
fn format_of(name: &str) -> Option<SourceFormat> {
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
fn collect(source: &CitySource<'_>, max_bytes: u64) -> Result<Collected, InputError> {
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

#[cfg(test)]
mod tests {
    use super::*;
    use insula_test_support::folder::TestFolder;

    #[test]
    fn a_lone_mesh_is_a_monument_unless_it_is_a_placed_city() {
        let folder = TestFolder::new("monuments");
        let write = |name: &str, from: f64, side: f64| {
            let [a, b] = [from, from + side];
            let text = format!("OFF\n3 1 0\n{a} {a} 0\n{b} {a} 0\n{b} {b} {side}\n3 0 1 2\n");
            std::fs::write(folder.path.join(name), text).unwrap();
            vec![folder.path.join(name)]
        };
        let (small, scan, map) =
            (write("a.off", 0.0, 3.0), write("b.off", 0.0, 400.0), write("c.off", 85_000.0, 400.0));
        assert_eq!(cell_of_monument(&small, false, None), Some(0.02));
        assert_eq!(cell_of_monument(&scan, false, None), Some(1.0));
        assert_eq!(cell_of_monument(&scan, false, Some([4.0, 52.0, 0.0])), None);
        assert_eq!(cell_of_monument(&small, false, Some([4.0, 52.0, 0.0])), Some(0.02));
        assert_eq!(cell_of_monument(&map, false, None), None);
        assert_eq!(cell_of_monument(&map, true, None), Some(1.0));
        let house = "OFF\n3 1 0\n11.6 48.2 500\n11.6002 48.2 500\n11.6002 48.2001 512\n3 0 1 2\n";
        std::fs::write(&small[0], house).unwrap();
        assert_eq!(cell_of_monument(&small, false, None), None, "in degrees");
        assert_eq!(cell_of_monument(&[small[0].clone(), scan[0].clone()], true, None), None);
        assert_eq!(cell_of_monument(&[folder.path.join("none.off")], true, None), None);
    }
}
