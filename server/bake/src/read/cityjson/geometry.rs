//! Converts the geometries of one city object to triangles.

use std::collections::BTreeMap;

use super::appearance::{AppearanceReader, ObjectReport};
use super::levels::level_of;
use super::nested::{NULL, Nested};
use super::schema::{
    CityJsonGeometry, CityJsonLod, CityJsonMaterial, CityObject, GeometryTemplates, ThemeValues, VertexTransform,
};
use crate::read::context::ReadContext;
use crate::read::facade::FacadeUse;
use crate::read::scene_builder::{ObjectRelation, OpenObject, WorldTriangle, is_valid_position};
use crate::scene::{ObjectKind, scratch_scene::StoredMaterial};
use insula_dress::palette::{BuildingLook, ObjectShape, SurfaceFacts, WallKind, normal_z, object_kind};
use insula_dress::polygon::{MAX_CORNERS, NO_AREA, PolygonFault};
use insula_place::placement::Placement;
use insula_source::affine::{Affine, TRANSPOSED};
use insula_source::json::position::JsonPosition;
use insula_source::report::{ColourOrigin, SourceReport};
use insula_source::source::CitySource;

/// Why an object is skipped.
#[derive(Debug)]
pub(super) struct ObjectFault {
    pub(super) reason: &'static str,
    pub(super) detail: String,
}

/// The vertices that a geometry's indices refer to.
pub(super) struct VertexFrame<'a> {
    vertices: &'a [JsonPosition],
    transform: Option<VertexTransform>,
    /// From the source's coordinate system to the city's.
    placement: &'a Placement,
    instance: Option<InstanceFrame>,
}

/// Position of a template: a matrix, then the anchor is added.
struct InstanceFrame {
    matrix: Affine,
    anchor: [f64; 3],
}

impl<'a> VertexFrame<'a> {
    pub(super) fn new(
        vertices: &'a [JsonPosition],
        transform: Option<VertexTransform>,
        placement: &'a Placement,
    ) -> Self {
        Self { vertices, transform, placement, instance: None }
    }

    /// World position of a vertex. Fails if the index is out of range or the position invalid.
    fn point(&self, index: i64) -> Result<[f64; 3], ObjectFault> {
        let p = self.source_point(index)?;
        if let Some(placed) = self.placement.position(p).filter(|placed| is_valid_position(*placed)) {
            return Ok(placed);
        }
        let detail = format!("vertex {index} is at {:e}, {:e}, {:e}", p[0], p[1], p[2]);
        Err(ObjectFault { reason: "coordinate not a number or out of range", detail })
    }

    /// Position of a vertex in the source's coordinate system. Fails if the index is out of range.
    fn source_point(&self, index: i64) -> Result<[f64; 3], ObjectFault> {
        let Some(position) = usize::try_from(index).ok().and_then(|index| self.vertices.get(index)) else {
            let detail = format!("vertex index {index} out of range of {}", self.vertices.len());
            return Err(ObjectFault { reason: "vertex index out of range", detail });
        };
        let mut p = self.transform.map_or(position.0, |transform| transform.apply(position.0));
        if let Some(InstanceFrame { matrix, anchor }) = &self.instance {
            p = std::array::from_fn(|axis| {
                let [x, y, z, offset] = matrix.rows[axis];
                x * p[0] + y * p[1] + z * p[2] + offset + anchor[axis]
            });
        }
        Ok(p)
    }
}

/// What the indices in objects refer to.
pub(super) struct ObjectReferences<'a> {
    pub(super) frame: VertexFrame<'a>,
    pub(super) appearance: AppearanceReader<'a>,
    pub(super) templates: &'a GeometryTemplates,
    pub(super) template_appearance: AppearanceReader<'a>,
}

/// A polygon with its semantics, material and texture.
struct NestedSurface<'g> {
    rings: &'g [Nested],
    semantic: &'g Nested,
    material: &'g Nested,
    texture: &'g Nested,
}

/// An object's identifier, its type and its look.
#[derive(Clone, Copy)]
struct ObjectName<'g> {
    id: &'g str,
    object_type: &'g str,
    look: BuildingLook,
}

/// The building of which an object is a part, or the object itself.
pub(super) struct WholeBuilding<'g> {
    pub(super) id: &'g str,
    /// What its use tells.
    pub(super) walls: Option<WallKind>,
    pub(super) facade_use: FacadeUse,
}

/// Triangles that are collected before they are added to the city, so that an object with many instances of a template
/// is never in memory as a whole.
const FLUSH_TRIANGLES: usize = 1 << 14;
/// An object with more triangles is left out: instances of a large template can make any number of them.
const MAX_OBJECT_TRIANGLES: u64 = 32 << 20;

/// Reads objects one after the other, with reusable buffers.
pub(super) struct ObjectReader<'r, 'o, 's> {
    pub(super) context: &'r mut ReadContext<'o>,
    source: &'r CitySource<'s>,
    pub(super) report: &'r mut SourceReport,
    /// The current object, without `faces`.
    open: OpenObject,
    /// The last triangles of the current object.
    faces: Vec<WorldTriangle>,
    /// That of the current object.
    facade_use: FacadeUse,
    /// That of the current object.
    pub(super) relation: ObjectRelation,
    points: Vec<[f64; 3]>,
    uvs: Vec<[f32; 2]>,
    hole_starts: Vec<u32>,
}

impl<'r, 'o, 's> ObjectReader<'r, 'o, 's> {
    pub(super) fn new(
        context: &'r mut ReadContext<'o>,
        source: &'r CitySource<'s>,
        report: &'r mut SourceReport,
    ) -> Self {
        let open = OpenObject::new(ObjectKind::default());
        let facade_use = FacadeUse::default();
        let (faces, points, uvs, hole_starts) = (vec![], vec![], vec![], vec![]);
        let relation = ObjectRelation::default();
        Self { context, source, report, open, faces, facade_use, relation, points, uvs, hole_starts }
    }

    /// Adds an object with its geometries of one level to the city. Returns whether it has a surface. Fails if the
    /// object must be skipped.
    pub(super) fn read(
        &mut self,
        id: &str,
        object: &CityObject,
        level: CityJsonLod,
        whole: &WholeBuilding<'_>,
        references: &mut ObjectReferences<'_>,
    ) -> Result<bool, ObjectFault> {
        self.faces.clear();
        self.facade_use = whole.facade_use;
        let look = if object.kind.starts_with("Building") {
            BuildingLook::new(whole.id, whole.walls, &self.shape(object, level, references))
        } else {
            BuildingLook::PLAIN
        };
        let name = ObjectName { id, object_type: &object.kind, look };
        let has_volume = has_volume(object, level, references.templates);
        self.open = OpenObject::new(object_kind(&object.kind, has_volume));
        self.open.has_own_base = matches!(object.kind.as_str(), "Building" | "BuildingPart");
        let result = self.read_geometries(name, object, level, references).and_then(|()| self.flush());
        let open = std::mem::replace(&mut self.open, OpenObject::new(ObjectKind::default()));
        let (builder, source) = (&mut self.context.builder, self.context.source);
        if let Err(fault) = result {
            builder.abandon(source, id, open);
            return Err(fault);
        }
        let has_surface = open.triangles > 0;
        builder.close_related(source, id, open, self.relation, self.report);
        Ok(has_surface)
    }

    /// The extent of an object's own geometries of a level; instances of templates are not measured. A surface with an
    /// invalid corner does not count.
    fn shape(&mut self, object: &CityObject, level: CityJsonLod, references: &ObjectReferences<'_>) -> ObjectShape {
        let mut shape = ObjectShape::new();
        for geometry in object.geometry.iter().flatten().filter(|geometry| geometry.lod == level) {
            let Some(depth) = shell_depth(&geometry.kind) else { continue };
            for_each_outer_ring(&geometry.boundaries, depth, &mut |ring| {
                let corners =
                    ring.list().iter().take(MAX_CORNERS).map(|i| references.frame.point(i.index().unwrap_or(-1)));
                self.points.clear();
                self.points.extend(corners.map_while(Result::ok));
                if self.points.len() == ring.list().len() {
                    shape.add(&self.points);
                }
            });
        }
        shape
    }

    fn read_geometries(
        &mut self,
        name: ObjectName<'_>,
        object: &CityObject,
        level: CityJsonLod,
        references: &mut ObjectReferences<'_>,
    ) -> Result<(), ObjectFault> {
        let ObjectReferences { frame, appearance, templates, template_appearance } = references;
        for geometry in object.geometry.iter().flatten() {
            if level_of(geometry.lod, geometry.template, &templates.templates) != level {
                continue;
            }
            if geometry.kind == INSTANCE {
                let (template, frame) = place_template(geometry, frame, templates)?;
                if frame.instance.as_ref().is_some_and(|instance| instance.matrix.is_transposed) {
                    self.report.problem(TRANSPOSED, || name.id.to_owned());
                }
                self.read_geometry(name, template, &frame, template_appearance)?;
            } else {
                self.read_geometry(name, geometry, frame, appearance)?;
            }
        }
        Ok(())
    }

    /// Adds the collected triangles to the city. Fails if the object has too many.
    fn flush(&mut self) -> Result<(), ObjectFault> {
        self.context.push(&mut self.open, &mut self.faces, self.facade_use);
        if self.open.triangles <= MAX_OBJECT_TRIANGLES {
            return Ok(());
        }
        let detail = format!("more than the limit of {MAX_OBJECT_TRIANGLES}");
        Err(ObjectFault { reason: "too many triangles in one object", detail })
    }

    fn read_geometry(
        &mut self,
        name: ObjectName<'_>,
        geometry: &CityJsonGeometry,
        frame: &VertexFrame<'_>,
        appearance: &mut AppearanceReader<'_>,
    ) -> Result<(), ObjectFault> {
        let Some(depth) = shell_depth(&geometry.kind) else {
            self.report.problem("geometry without surfaces", || format!("{}: {}", name.id, geometry.kind));
            return Ok(());
        };
        let whole = NestedSurface {
            rings: std::slice::from_ref(&geometry.boundaries),
            semantic: geometry.semantics.as_ref().map_or(&NULL, |semantics| &semantics.values),
            material: values_of(&geometry.material, appearance.default_theme_material()).unwrap_or(&NULL),
            texture: values_of(&geometry.texture, appearance.default_theme_texture()).unwrap_or(&NULL),
        };
        let mut surfaces = Vec::new();
        collect_surfaces(&geometry.boundaries, &whole, depth, &mut surfaces);
        for surface in &surfaces {
            let report = &mut ObjectReport { id: name.id, report: self.report };
            let semantic = appearance.semantic(geometry.semantics.as_ref(), surface.semantic, report);
            self.read_surface(name, surface, semantic, frame, appearance)?;
            if self.faces.len() >= FLUSH_TRIANGLES {
                self.flush()?;
            }
        }
        Ok(())
    }

    fn read_surface(
        &mut self,
        name: ObjectName<'_>,
        surface: &NestedSurface<'_>,
        semantic: Option<&str>,
        frame: &VertexFrame<'_>,
        appearance: &mut AppearanceReader<'_>,
    ) -> Result<(), ObjectFault> {
        let id = name.id;
        let mut report = ObjectReport { id, report: self.report };
        let texture = appearance.texture(surface.texture, self.context, self.source, &mut report);
        let is_textured = self.collect_rings(surface, texture.is_some(), frame, appearance)?;
        if texture.is_some() && !is_textured {
            self.report.problem("texture coordinates do not fit the ring", || id.to_owned());
        }
        let texture = texture.filter(|_| is_textured);
        let outer = self.hole_starts.first().map_or(self.points.len(), |start| *start as usize);
        let normal_z = normal_z(&self.points[..outer]);
        let facts = SurfaceFacts { semantic, object_type: name.object_type, material: None, normal_z };
        let mut is_reflective = facts.is_reflective();
        let (rgb, origin) = match &texture {
            // In CityJSON a texture replaces the material.
            Some(_) => ([255; 3], ColourOrigin::Texture),
            None => {
                let own = appearance.material(surface.material, &mut ObjectReport { id, report: self.report });
                is_reflective |= own.is_some_and(CityJsonMaterial::is_transparent);
                self.context.options.palette.resolve(own.and_then(CityJsonMaterial::rgb), &facts, &name.look)
            }
        };
        let triangles = match self.context.triangulator.triangulate(&self.points, &self.hole_starts) {
            Ok(triangles) => triangles,
            Err(PolygonFault::NoArea) => {
                self.report.problem(NO_AREA, || format!("{id}: {} corners", self.points.len()));
                return Ok(());
            }
            Err(fault) => {
                let detail = format!("{} corners, {} holes", self.points.len(), self.hole_starts.len());
                return Err(ObjectFault { reason: fault.reason(), detail });
            }
        };
        self.report.colours.add(origin);
        // A model with windows of its own needs no others.
        if matches!(semantic, Some("Window" | "Door")) {
            self.facade_use = FacadeUse::Windowless;
        }
        let is_facade = texture.is_none()
            && !is_reflective
            && matches!(name.object_type, "Building" | "BuildingPart" | "BuildingUnit" | "BuildingStorey")
            && matches!(semantic, None | Some("WallSurface"));
        let material = self.context.builder.material(StoredMaterial { rgb, texture, is_reflective });
        triangles.areas.note_in(self.report, id);
        for triangle in triangles.list {
            let corners = triangle.map(|i| self.points[i as usize]);
            let uv = if is_textured { triangle.map(|i| self.uvs[i as usize]) } else { [[0.0; 2]; 3] };
            self.faces.push(WorldTriangle { corners, uv, material, is_facade });
        }
        Ok(())
    }

    /// Collects the positions and, if `has_texture`, the texture coordinates of all rings. Returns whether all corners
    /// have texture coordinates.
    fn collect_rings(
        &mut self,
        surface: &NestedSurface<'_>,
        has_texture: bool,
        frame: &VertexFrame<'_>,
        appearance: &AppearanceReader<'_>,
    ) -> Result<bool, ObjectFault> {
        self.points.clear();
        self.uvs.clear();
        self.hole_starts.clear();
        let mut is_textured = has_texture;
        for (i, ring) in surface.rings.iter().enumerate() {
            let ring = ring.list();
            if i > 0 && ring.len() < 3 {
                continue;
            }
            if ring.len() + self.points.len() > MAX_CORNERS {
                let detail = format!("more than {MAX_CORNERS} corners");
                return Err(ObjectFault { reason: "polygon too large", detail });
            }
            if i > 0 {
                self.hole_starts.push(self.points.len() as u32);
            }
            for index in ring {
                self.points.push(frame.point(index.index().unwrap_or(-1))?);
            }
            is_textured = is_textured && appearance.append_uvs(surface.texture.child(i), ring.len(), &mut self.uvs);
        }
        Ok(is_textured)
    }
}

/// Type of a geometry that places a template.
const INSTANCE: &str = "GeometryInstance";

/// How many levels of nesting are above the surfaces in a geometry's boundaries; `None` if it has no surfaces.
fn shell_depth(kind: &str) -> Option<u32> {
    match kind {
        "MultiSurface" | "CompositeSurface" => Some(0),
        "Solid" => Some(1),
        "MultiSolid" | "CompositeSolid" => Some(2),
        _ => None,
    }
}

/// Whether one of an object's geometries of a level is a volume.
fn has_volume(object: &CityObject, level: CityJsonLod, templates: &GeometryTemplates) -> bool {
    object.geometry.iter().flatten().any(|geometry| {
        let template = geometry.template.and_then(|index| templates.templates.get(usize::try_from(index).ok()?));
        let shape = if geometry.kind == INSTANCE { template } else { Some(geometry) };
        level_of(geometry.lod, geometry.template, &templates.templates) == level
            && shape.and_then(|shape| shell_depth(&shape.kind)).is_some_and(|depth| depth > 0)
    })
}

/// The values of the default theme, or of the one whose name is alphabetically first.
fn values_of<'g>(themes: &'g Option<BTreeMap<String, ThemeValues>>, default: Option<&str>) -> Option<&'g Nested> {
    let themes = themes.as_ref()?;
    let values = default.and_then(|name| themes.get(name)).or_else(|| themes.values().next());
    values.map(ThemeValues::get)
}

/// Descends to the surfaces of nested boundaries, and in the values in parallel.
fn collect_surfaces<'g>(
    boundaries: &'g Nested,
    values: &NestedSurface<'g>,
    depth: u32,
    surfaces: &mut Vec<NestedSurface<'g>>,
) {
    for (i, below) in boundaries.list().iter().enumerate() {
        let surface = NestedSurface {
            rings: below.list(),
            semantic: values.semantic.child(i),
            material: values.material.child(i),
            texture: values.texture.child(i),
        };
        if depth == 0 {
            surfaces.push(surface);
        } else {
            collect_surfaces(below, &surface, depth - 1, surfaces);
        }
    }
}

/// Calls `visit` for the outer ring of each surface of nested boundaries.
fn for_each_outer_ring(boundaries: &Nested, depth: u32, visit: &mut impl FnMut(&Nested)) {
    for below in boundaries.list() {
        if depth == 0 { visit(below.child(0)) } else { for_each_outer_ring(below, depth - 1, visit) }
    }
}

/// The template of an instance, and the frame that places it. Fails if the instance is malformed.
fn place_template<'t>(
    instance: &CityJsonGeometry,
    frame: &VertexFrame<'t>,
    templates: &'t GeometryTemplates,
) -> Result<(&'t CityJsonGeometry, VertexFrame<'t>), ObjectFault> {
    let index = instance.template.unwrap_or(-1);
    let Some(template) = usize::try_from(index).ok().and_then(|index| templates.templates.get(index)) else {
        let detail = format!("template {index} out of range of {}", templates.templates.len());
        return Err(ObjectFault { reason: "template out of range", detail });
    };
    let matrix = instance.matrix.as_deref().map_or(Ok(Affine::IDENTITY), Affine::new);
    let matrix = matrix.map_err(|detail| ObjectFault { reason: "transformationMatrix malformed", detail })?;
    let anchor = frame.source_point(instance.boundaries.child(0).index().unwrap_or(-1))?;
    let (vertices, placement) = (&templates.vertices, frame.placement);
    Ok((
        template,
        VertexFrame { vertices, transform: None, placement, instance: Some(InstanceFrame { matrix, anchor }) },
    ))
}
