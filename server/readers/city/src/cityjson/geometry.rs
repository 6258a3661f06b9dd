//! The surfaces of one city object.

use super::appearance::AppearanceReader;
use super::levels::level_of;
use super::nested::{NULL, Nested};
use super::schema::{
    CityJsonGeometry, CityJsonLod, CityObject, GeometryTemplates, SurfaceSemantics, ThemeValues, VertexTransform,
    shell_depth,
};
use crate::degrees::{TemplatePlace, degrees_per_metre};
use insula_dress::polygon::NO_AREA;
use insula_source::affine::{Affine, TRANSPOSED};
use insula_source::json::position::JsonPosition;
use insula_source::object::{ObjectSink, Surface, SurfaceRole};
use std::collections::BTreeMap;
use std::rc::Rc;

/// An object with more corners in instances of templates is left out: few bytes can place a large template any number of
/// times.
const MAX_INSTANCE_CORNERS: usize = 8 << 20;
/// No system has positions on Earth with larger coordinates.
const MAX_COORDINATE: f64 = 1e9;
/// Type of a geometry that places a template.
const INSTANCE: &str = "GeometryInstance";

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
    instance: Option<TemplatePlace>,
    /// Positions are latitudes and longitudes, while templates are in metres.
    is_latitude_first: bool,
}

impl<'a> VertexFrame<'a> {
    pub(super) fn new(
        vertices: &'a [JsonPosition],
        transform: Option<VertexTransform>,
        is_latitude_first: bool,
    ) -> Self {
        Self { vertices, transform, instance: None, is_latitude_first }
    }

    /// Position of a vertex in the source's coordinate system. Fails if the index is out of range or the position invalid.
    fn point(&self, index: &Nested) -> Result<[f64; 3], ObjectFault> {
        let index = index.index().unwrap_or(-1);
        let Some(position) = usize::try_from(index).ok().and_then(|index| self.vertices.get(index)) else {
            let detail = format!("vertex index {index} out of range of {}", self.vertices.len());
            return Err(ObjectFault { reason: "vertex index out of range", detail });
        };
        let mut p = self.transform.map_or(position.0, |transform| transform.apply(position.0));
        if let Some(instance) = &self.instance {
            p = instance.apply(p);
        }
        if p.iter().all(|coordinate| coordinate.abs() <= MAX_COORDINATE) {
            return Ok(p);
        }
        let detail = format!("vertex {index} is at {:e}, {:e}, {:e}", p[0], p[1], p[2]);
        Err(ObjectFault { reason: "coordinate not a number or out of range", detail })
    }
}

/// What the indices in objects refer to.
pub(super) struct ObjectReferences<'a> {
    pub(super) frame: VertexFrame<'a>,
    pub(super) appearance: AppearanceReader<'a>,
    pub(super) templates: &'a GeometryTemplates,
    pub(super) template_appearance: AppearanceReader<'a>,
}

/// The surfaces of an object's geometries of one level. Fails if the object must be skipped.
pub(super) fn surfaces_of(
    id: &str,
    object: &CityObject,
    level: CityJsonLod,
    references: &mut ObjectReferences<'_>,
    sink: &mut dyn ObjectSink,
) -> Result<Vec<Surface>, ObjectFault> {
    let ObjectReferences { frame, appearance, templates, template_appearance } = references;
    let mut reader = GeometryReader { id, sink, surfaces: Vec::new() };
    let mut instance_corners = 0;
    for geometry in object.geometry.iter().flatten() {
        if level_of(geometry.lod, geometry.template, &templates.templates) != level {
            continue;
        }
        if geometry.kind != INSTANCE {
            reader.read(geometry, frame, appearance)?;
            continue;
        }
        let (template, frame) = place_template(geometry, frame, templates)?;
        if frame.instance.as_ref().is_some_and(|instance| instance.matrix.is_transposed) {
            reader.problem(TRANSPOSED, "");
        }
        instance_corners += reader.read(template, &frame, template_appearance)?;
        if instance_corners > MAX_INSTANCE_CORNERS {
            let detail = format!("more than the limit of {MAX_INSTANCE_CORNERS} corners");
            return Err(ObjectFault { reason: "too many instances of templates in one object", detail });
        }
    }
    Ok(reader.surfaces)
}

/// A polygon with its semantics, material and texture.
struct NestedSurface<'g> {
    rings: &'g [Nested],
    semantic: &'g Nested,
    material: &'g Nested,
    texture: &'g Nested,
}

/// Collects the surfaces of an object.
struct GeometryReader<'r> {
    id: &'r str,
    sink: &'r mut dyn ObjectSink,
    surfaces: Vec<Surface>,
}

impl GeometryReader<'_> {
    /// Reports a fault that costs only a part of the object; `detail` is appended to its identifier.
    fn problem(&mut self, kind: &'static str, detail: &str) {
        let separator = if detail.is_empty() { "" } else { ": " };
        self.sink.problem(kind, format!("{}{separator}{detail}", self.id));
    }

    /// Reads a geometry; returns the number of its corners.
    fn read(
        &mut self,
        geometry: &CityJsonGeometry,
        frame: &VertexFrame<'_>,
        appearance: &mut AppearanceReader<'_>,
    ) -> Result<usize, ObjectFault> {
        let Some(depth) = shell_depth(&geometry.kind) else {
            self.problem("geometry without surfaces", &geometry.kind);
            return Ok(0);
        };
        let whole = NestedSurface {
            rings: std::slice::from_ref(&geometry.boundaries),
            semantic: geometry.semantics.as_ref().map_or(&NULL, |semantics| &semantics.values),
            material: values_of(&geometry.material, appearance.default_theme_material()).unwrap_or(&NULL),
            texture: values_of(&geometry.texture, appearance.default_theme_texture()).unwrap_or(&NULL),
        };
        let mut nested = Vec::new();
        collect_surfaces(&geometry.boundaries, &whole, depth, &mut nested);
        let roles = roles_of(geometry.semantics.as_ref());
        let mut corners = 0;
        self.surfaces.reserve(nested.len());
        for surface in &nested {
            if surface.rings.iter().all(|ring| ring.list().is_empty()) {
                self.problem(NO_AREA, "no corners");
                continue;
            }
            let surface = self.surface(surface, &roles, frame, appearance)?;
            corners += surface.points.len();
            self.surfaces.push(surface);
        }
        Ok(corners)
    }

    fn surface(
        &mut self,
        nested: &NestedSurface<'_>,
        roles: &[(SurfaceRole, Option<Rc<str>>)],
        frame: &VertexFrame<'_>,
        appearance: &mut AppearanceReader<'_>,
    ) -> Result<Surface, ObjectFault> {
        let (role, semantic) = self.entry("semantic index out of range", nested.semantic, roles).cloned().unzip();
        let texture = nested.texture.child(0).list().first().unwrap_or(&NULL);
        let texture = self.number("texture index out of range", texture, appearance.textures());
        let mut surface =
            Surface { role: role.unwrap_or_default(), semantic: semantic.flatten(), ..Surface::default() };
        let has_uv = collect_rings(nested, texture.is_some(), frame, appearance, &mut surface)?;
        if texture.is_some() && !has_uv {
            self.problem("texture coordinates do not fit the ring", "");
        }
        let material = self.number("material index out of range", nested.material, appearance.materials());
        surface.material = appearance.number(texture.filter(|_| has_uv), material, self.sink);
        Ok(surface)
    }

    /// The number that a value names, if it is one of `count`; others are reported.
    fn number(&mut self, fault: &'static str, value: &Nested, count: usize) -> Option<usize> {
        let index = value.index()?;
        let number = usize::try_from(index).ok().filter(|number| *number < count);
        if number.is_none() {
            self.problem(fault, &format!("index {index} out of range of {count}"));
        }
        number
    }

    fn entry<'t, T>(&mut self, fault: &'static str, value: &Nested, entries: &'t [T]) -> Option<&'t T> {
        entries.get(self.number(fault, value, entries.len())?)
    }
}

/// What the semantic surfaces of a geometry are.
fn roles_of(semantics: Option<&SurfaceSemantics>) -> Vec<(SurfaceRole, Option<Rc<str>>)> {
    let surfaces = semantics.map_or(&[][..], |semantics| &semantics.surfaces);
    let role_of = |name: &str| match SurfaceRole::of_cityjson_semantic(name) {
        SurfaceRole::Other => (SurfaceRole::Other, Some(Rc::from(name))),
        role => (role, None),
    };
    surfaces.iter().map(|surface| role_of(&surface.kind)).collect()
}

/// Collects the positions of all rings and, if `has_texture`, their texture coordinates. Returns whether all corners have
/// texture coordinates.
fn collect_rings(
    nested: &NestedSurface<'_>,
    has_texture: bool,
    frame: &VertexFrame<'_>,
    appearance: &AppearanceReader<'_>,
    surface: &mut Surface,
) -> Result<bool, ObjectFault> {
    let mut has_uv = has_texture;
    for (i, ring) in nested.rings.iter().enumerate() {
        let ring = ring.list();
        if i > 0 && ring.len() < 3 {
            continue;
        }
        if i > 0 {
            surface.hole_starts.push(surface.points.len() as u32);
        }
        surface.points.reserve_exact(ring.len());
        for index in ring {
            surface.points.push(frame.point(index)?);
        }
        has_uv = has_uv && appearance.append_uvs(nested.texture.child(i), ring.len(), &mut surface.uv);
    }
    if !has_uv {
        surface.uv = Vec::new();
    }
    Ok(has_uv)
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
    let anchor = frame.point(instance.boundaries.child(0))?;
    let is_latitude_first = frame.is_latitude_first;
    let degrees_per_metre = is_latitude_first.then(|| degrees_per_metre(anchor[0]));
    let instance = Some(TemplatePlace { matrix, anchor, degrees_per_metre });
    Ok((template, VertexFrame { vertices: &templates.vertices, transform: None, instance, is_latitude_first }))
}
