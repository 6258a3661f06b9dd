//! One city object's geometries to faces.
//!
//! In: an object, the vertices and appearance that its indices mean. Out: [`WorldTriangle`]s. Next: `builder`.

use std::collections::BTreeMap;

use super::levels::level_of;
use super::looks::{AppearanceReader, SurfaceProperties};
use super::model::{
    CityJsonGeometry, CityJsonLod, CityObject, GeometryTemplates, JsonPosition, ThemeValues, VertexTransform,
};
use super::nested::{NULL, Nested};
use crate::read::ReadContext;
use crate::read::builder::{WorldTriangle, is_sane};
use crate::read::polygon::MAX_CORNERS;
use crate::read::report::SourceReport;
use crate::read::source::CitySource;

/// Why an object is skipped.
#[derive(Debug)]
pub(crate) struct ObjectFault {
    pub(crate) reason: &'static str,
    pub(crate) detail: String,
}

/// What a geometry's vertex indices mean.
pub(crate) struct VertexFrame<'a> {
    pub(crate) vertices: &'a [JsonPosition],
    pub(crate) transform: Option<VertexTransform>,
    placement: Option<TemplatePlacement>,
}

/// Where a template stands: row-major matrix, then the reference point is added.
struct TemplatePlacement {
    matrix: [f64; 16],
    anchor: [f64; 3],
}

impl<'a> VertexFrame<'a> {
    pub(crate) fn new(vertices: &'a [JsonPosition], transform: Option<VertexTransform>) -> Self {
        Self { vertices, transform, placement: None }
    }

    fn point(&self, index: i64) -> Result<[f64; 3], ObjectFault> {
        let Some(position) = usize::try_from(index).ok().and_then(|index| self.vertices.get(index)) else {
            let detail = format!("vertex index {index} out of range of {}", self.vertices.len());
            return Err(ObjectFault { reason: "vertex index out of range", detail });
        };
        let mut p = self.transform.map_or(position.0, |transform| transform.apply(position.0));
        if let Some(TemplatePlacement { matrix: m, anchor }) = &self.placement {
            let w = m[12] * p[0] + m[13] * p[1] + m[14] * p[2] + m[15];
            let w = if w == 0.0 { 1.0 } else { w };
            p = std::array::from_fn(|row| {
                let m = &m[4 * row..4 * row + 4];
                (m[0] * p[0] + m[1] * p[1] + m[2] * p[2] + m[3]) / w + anchor[row]
            });
        }
        if is_sane(p) {
            return Ok(p);
        }
        let detail = format!("vertex {index} lies at {:e}, {:e}, {:e}", p[0], p[1], p[2]);
        Err(ObjectFault { reason: "coordinate not a number or beyond 1e9 m", detail })
    }
}

/// A polygon with what is said about it.
struct NestedSurface<'g> {
    rings: &'g [Nested],
    semantic: &'g Nested,
    material: &'g Nested,
    texture: &'g Nested,
}

/// Everything that reading an object needs besides the object.
pub(crate) struct ObjectReader<'r, 'o, 's> {
    pub(crate) reading: &'r mut ReadContext<'o>,
    pub(crate) source: &'r CitySource<'s>,
    pub(crate) report: &'r mut SourceReport,
    pub(crate) faces: Vec<WorldTriangle>,
    points: Vec<[f64; 3]>,
    uvs: Vec<[f32; 2]>,
    hole_starts: Vec<u32>,
}

impl<'r, 'o, 's> ObjectReader<'r, 'o, 's> {
    pub(crate) fn new(
        reading: &'r mut ReadContext<'o>,
        source: &'r CitySource<'s>,
        report: &'r mut SourceReport,
    ) -> Self {
        Self { reading, source, report, faces: vec![], points: vec![], uvs: vec![], hole_starts: vec![] }
    }

    /// Reads an object's geometries of one level into `faces`; whether one of them is a volume.
    pub(crate) fn read(
        &mut self,
        (id, object): (&str, &CityObject),
        level: CityJsonLod,
        (frame, looks): (&VertexFrame<'_>, &mut AppearanceReader<'_>),
        (templates, template_looks): (&GeometryTemplates, &mut AppearanceReader<'_>),
    ) -> Result<bool, ObjectFault> {
        self.faces.clear();
        let mut has_volume = false;
        for geometry in object.geometry.iter().flatten() {
            if level_of(geometry.lod, geometry.template, &templates.templates) != level {
                continue;
            }
            let named = (id, object.kind.as_str());
            has_volume |= if geometry.kind == "GeometryInstance" {
                let (template, frame) = place(geometry, frame, templates)?;
                self.geometry(named, template, &frame, template_looks)?
            } else {
                self.geometry(named, geometry, frame, looks)?
            };
        }
        Ok(has_volume)
    }

    fn geometry(
        &mut self,
        (id, object_type): (&str, &str),
        geometry: &CityJsonGeometry,
        frame: &VertexFrame<'_>,
        looks: &mut AppearanceReader<'_>,
    ) -> Result<bool, ObjectFault> {
        let depth = match geometry.kind.as_str() {
            "MultiSurface" | "CompositeSurface" => 0,
            "Solid" => 1,
            "MultiSolid" | "CompositeSolid" => 2,
            other => {
                self.report.problem("geometry without surfaces", || format!("{id}: {other}"));
                return Ok(false);
            }
        };
        let whole = NestedSurface {
            rings: std::slice::from_ref(&geometry.boundaries),
            semantic: geometry.semantics.as_ref().map_or(&NULL, |semantics| &semantics.values),
            material: first_values(&geometry.material).unwrap_or(&NULL),
            texture: first_values(&geometry.texture).unwrap_or(&NULL),
        };
        let mut surfaces = Vec::new();
        collect(&geometry.boundaries, &whole, depth, &mut surfaces);
        for surface in &surfaces {
            let semantic = looks.semantic(geometry.semantics.as_ref(), surface.semantic, (id, self.report));
            let look = SurfaceProperties { semantic, object_type, material: surface.material };
            self.surface(id, surface, look, frame, looks)?;
        }
        Ok(depth > 0)
    }

    fn surface(
        &mut self,
        id: &str,
        surface: &NestedSurface<'_>,
        look: SurfaceProperties<'_>,
        frame: &VertexFrame<'_>,
        looks: &mut AppearanceReader<'_>,
    ) -> Result<(), ObjectFault> {
        let texture = looks.texture(surface.texture, (self.reading, self.source), (id, self.report));
        self.points.clear();
        self.uvs.clear();
        self.hole_starts.clear();
        let mut textured = texture.is_some();
        for (i, ring) in surface.rings.iter().enumerate() {
            let ring = ring.list();
            if i > 0 && ring.len() < 3 {
                continue;
            }
            if ring.len() + self.points.len() > MAX_CORNERS {
                return Err(ObjectFault {
                    reason: "polygon too large",
                    detail: format!("more than {MAX_CORNERS} corners"),
                });
            }
            if i > 0 {
                self.hole_starts.push(self.points.len() as u32);
            }
            for index in ring {
                self.points.push(frame.point(index.index().unwrap_or(-1))?);
            }
            textured = textured && looks.uvs(surface.texture.child(i), ring.len(), &mut self.uvs);
        }
        if texture.is_some() && !textured {
            self.report.problem("texture coordinates do not fit the ring", || id.to_owned());
        }
        let texture = texture.filter(|_| textured);
        let rgb = match &texture {
            // CityJSON's texture takes the material's place.
            Some(_) => [255; 3],
            None => looks.colour(&look, &self.reading.options.palette, (id, self.report)),
        };
        let Some(triangles) = self.reading.triangulator.triangulate(&self.points, &self.hole_starts) else {
            self.report.problem("polygon without area", || format!("{id}: {} corners", self.points.len()));
            return Ok(());
        };
        let material = self.reading.builder.material(rgb, texture);
        for triangle in triangles {
            let corners = triangle.map(|i| self.points[i as usize]);
            let uv = if textured { triangle.map(|i| self.uvs[i as usize]) } else { [[0.0; 2]; 3] };
            self.faces.push(WorldTriangle { corners, uv, material });
        }
        Ok(())
    }
}

/// The values of the alphabetically first theme.
fn first_values(themes: &Option<BTreeMap<String, ThemeValues>>) -> Option<&Nested> {
    Some(themes.as_ref()?.values().next()?.get())
}

/// Descends to the surfaces, the values alongside.
fn collect<'g>(boundaries: &'g Nested, values: &NestedSurface<'g>, depth: u32, surfaces: &mut Vec<NestedSurface<'g>>) {
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
            collect(below, &surface, depth - 1, surfaces);
        }
    }
}

/// The template that an instance places, and the frame that puts it there.
fn place<'t>(
    instance: &CityJsonGeometry,
    frame: &VertexFrame<'_>,
    templates: &'t GeometryTemplates,
) -> Result<(&'t CityJsonGeometry, VertexFrame<'t>), ObjectFault> {
    let index = instance.template.unwrap_or(-1);
    let Some(template) = usize::try_from(index).ok().and_then(|index| templates.templates.get(index)) else {
        let detail = format!("template {index} out of range of {}", templates.templates.len());
        return Err(ObjectFault { reason: "template out of range", detail });
    };
    let matrix = match instance.matrix.as_deref() {
        None => [1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1.],
        Some(numbers) => numbers.try_into().map_err(|_| ObjectFault {
            reason: "transformationMatrix malformed",
            detail: format!("{} numbers instead of 16", numbers.len()),
        })?,
    };
    let anchor = frame.point(instance.boundaries.child(0).index().unwrap_or(-1))?;
    let placement = Some(TemplatePlacement { matrix, anchor });
    Ok((template, VertexFrame { vertices: &templates.vertices, transform: None, placement }))
}
