//! Makes a drawing: reads the scene, sorts the faces that a view shows, removes hidden parts, and joins the visible ones.

use crate::convex::{Convex, PagePoint, PageRect};
use crate::drawing::{Drawing, DrawnLine, DrawnObject, DrawnShape, ShapeRole};
use crate::error::{DrawError, DrawProgress, DrawStep, advance};
use crate::face::Face;
use crate::join::{Rings, unions};
use crate::legend::{legend_items, visible_legend};
use crate::lines::{EdgePart, LineRole, chains, class_of, collect, visible_lines};
use crate::paint::attribute_colors;
use crate::paint_order::coats;
use crate::part::DrawnPart;
use crate::request::{DrawRequest, LOD_ERROR_MM};
use crate::scene::DrawnScene;
use crate::shadow::{plane_key, shadows};
use crate::sheet::{TitleBlock, sheet_items};
use crate::style::{FillMode, Hatch, Rgb, Stylesheet, kind_name, parse_color};
use crate::terrain::refine_terrain;
use crate::tone::{Tones, towards_sun};
use crate::view::{DrawView, PaperGrid, Projection, ViewAxes};
use crate::volume::ViewVolume;
use crate::warnock::{PagePolygon, VisiblePart, visible_parts};
use insula_export::source::ExportSource;
use insula_objects::FeatureKind;
use insula_protocol::mesh_tile::NO_OBJECT;
use insula_protocol::text::at_most;
use std::collections::{BTreeMap, HashSet};

/// Draws a city. Fails if it cannot be read, if there is nothing or too much to draw, or if `progress` stops it.
pub fn draw(
    source: &dyn ExportSource,
    request: &DrawRequest,
    progress: DrawProgress<'_>,
) -> Result<Drawing, DrawError> {
    let part = DrawnPart::read(source, request, progress)?;
    draw_part(source, &part, request, progress)
}

/// Draws a view of a part that was read for a request of the same selection and scale. Fails as [`draw`] does.
pub fn draw_part(
    source: &dyn ExportSource,
    part: &DrawnPart,
    request: &DrawRequest,
    progress: DrawProgress<'_>,
) -> Result<Drawing, DrawError> {
    request.error_m()?;
    let axes = ViewAxes::new(&request.view, part.scene.origin)?;
    let frame = request.paper.frame(request.is_bare);
    let points = part.scene.faces.iter().flat_map(|face| face.points.iter().copied());
    let projection = Projection::new(axes, frame, request.scale, points);
    // Terrain that is refined for the view is a scene of its own, which no other view shares.
    let refined = if part.scene.has_terrain { refine_terrain(&part.scene, &projection, LOD_ERROR_MM) } else { None };
    let refined = refined.map(DrawnPart::of);
    let part = refined.as_ref().unwrap_or(part);
    let scene = &part.scene;
    let colors = match &request.color_by {
        Some(color_by) => attribute_colors(source, &scene.objects, color_by)?,
        None => Vec::new(),
    };
    let grid = PaperGrid::new(request.paper.size_mm);
    let volume = projection.volume(part.bounds());
    let stage = Stage { part, scene, projection, volume, grid, colors, request };
    let faces = part.front_to_back(stage.projection.axes.eye(), &stage.volume, request.limits.faces(), progress)?;
    let polygons = stage.polygons(faces);
    let parts = visible_parts(&polygons, stage.grid.rect(&frame), request.limits.parts, progress)?;
    if parts.is_empty() {
        return Err(DrawError::Empty);
    }
    let mut objects = Objects::new(scene);
    let style = &request.style;
    objects.add_shapes(stage.shapes(&polygons, &parts, progress)?);
    if style.shadows && style.sun[1] > 0.0 {
        objects.add_shadows(stage.shadows(&polygons, &parts, progress)?, style);
    }
    objects.add_hatching(style, &stage.grid, progress)?;
    objects.add_lines(stage.lines(&polygons, &parts), &request.style);
    let block = title_block(source, request, &stage.projection);
    let mut sheet = if request.is_bare { Vec::new() } else { sheet_items(&stage.projection, &block) };
    if let Some(color_by) = request.color_by.as_ref().filter(|_| !request.is_bare) {
        let legend = visible_legend(color_by.legend(), &stage.visible_colors(&polygons, &parts));
        sheet.extend(legend_items(&legend, &frame));
    }
    let color = |text: &str, default: Rgb| parse_color(text).unwrap_or(default);
    Ok(Drawing {
        grid: stage.grid,
        frame,
        metres: stage.projection.metres(scene.origin).filter(|_| !request.is_sheet),
        fitting_scale: stage.projection.fitting_scale,
        title: block.title,
        attribution: block.attribution,
        is_exact: request.style.fill == FillMode::Object,
        paper: color(&request.style.paper, [255; 3]),
        ink: color(&request.style.ink, [0; 3]),
        objects: objects.sorted(),
        picture: None,
        sheet,
        without_mesh: scene.without_mesh,
    })
}

/// The light of a drawing in words: when, and where the sun stands.
fn light(request: &DrawRequest) -> String {
    if !request.note.is_empty() {
        return request.note.clone();
    }
    let [azimuth, altitude] = request.style.sun.map(|degrees| at_most(degrees, 1));
    let sun = format!("Sun {azimuth}\u{b0} from the map's north, {altitude}\u{b0} above the horizon");
    if request.date.is_empty() { sun } else { format!("{}. {sun}", request.date) }
}

fn title_block(source: &dyn ExportSource, request: &DrawRequest, projection: &Projection) -> TitleBlock {
    let manifest = source.manifest();
    let view = match request.view {
        DrawView::Plan => "Plan".to_owned(),
        DrawView::Axonometric { azimuth_deg, elevation_deg: 0.0 } => {
            format!("Elevation, looking to {azimuth_deg}\u{b0}")
        }
        DrawView::Axonometric { azimuth_deg, elevation_deg } => {
            format!("Axonometric view, looking to {azimuth_deg}\u{b0} from {elevation_deg}\u{b0} above the horizon")
        }
        DrawView::Perspective(_) => "Perspective view".to_owned(),
    };
    let scale = projection.scale.map(|scale| format!(", 1:{scale}")).unwrap_or_default();
    let of_source = |source: &insula_protocol::manifest::Attribution| {
        source.texts().map(String::as_str).collect::<Vec<_>>().join(", ")
    };
    let attribution = manifest.attribution.iter().map(of_source).collect::<Vec<_>>().join("; ");
    let title = request.title.clone().unwrap_or_else(|| manifest.title.clone());
    TitleBlock { title, description: format!("{view}{scale}"), light: light(request), attribution }
}

/// A scene and how it is seen.
struct Stage<'a> {
    part: &'a DrawnPart,
    /// That of the part.
    scene: &'a DrawnScene,
    projection: Projection,
    volume: ViewVolume,
    grid: PaperGrid,
    /// Of the objects that have one by an attribute; empty if there are none.
    colors: Vec<Option<Rgb>>,
    request: &'a DrawRequest,
}

type Ends = [PagePoint; 2];
/// Shapes of one object and colour.
type ShapeKey = (u32, Rgb);

impl Stage<'_> {
    fn polygons(&self, faces: Vec<Face>) -> Vec<PagePolygon> {
        let project = |face: Face| {
            let points = face.points.iter().map(|p| self.grid.point(self.projection.project(*p))).collect();
            let shape = Convex { points, edges: face.edges };
            let bounds = PageRect::of(&shape.points);
            let is_opaque = self.request.style.opacity(self.scene.object(face.triangle).kind) >= 1.0;
            (shape.twice_area() > 0).then_some(PagePolygon { shape, bounds, triangle: face.triangle, is_opaque })
        };
        faces.into_iter().filter_map(project).collect()
    }

    fn shapes(
        &self,
        polygons: &[PagePolygon],
        parts: &[VisiblePart],
        progress: DrawProgress<'_>,
    ) -> Result<Vec<(u32, DrawnShape)>, DrawError> {
        let tones = Tones::new(&self.request.style);
        let name = |face: u32| -> Option<ShapeKey> {
            let object = self.scene.face_objects[face as usize];
            let own = self.colors.get(object as usize).copied().flatten();
            Some((object, tones.color(self.scene.object(face), own, &self.scene.faces[face as usize].plane)?))
        };
        let mut opaque: BTreeMap<ShapeKey, Rings> = BTreeMap::new();
        for part in parts.iter().filter(|part| polygons[part.polygon as usize].is_opaque) {
            if let Some(key) = name(polygons[part.polygon as usize].triangle) {
                opaque.entry(key).or_default().push(part.shape.points.clone());
            }
        }
        let names = |face: u32| Some((name(face)?, plane_key(self.scene, face)));
        let coats = coats(parts, polygons, names, self.request.limits.parts)?;
        let orders = std::iter::repeat_n(0, opaque.len()).chain(1..);
        let painted = opaque.into_iter().chain(coats.into_iter().map(|coat| (coat.shape, coat.rings)));
        let (keys, groups): (Vec<ShapeKey>, Vec<Rings>) = painted.unzip();
        let joined = keys.into_iter().zip(orders).zip(unions(groups, progress)?);
        let shape = |(((object, color), order), rings): ((ShapeKey, u32), Rings)| {
            let opacity = self.request.style.opacity(self.scene.objects[object as usize].kind);
            (object, DrawnShape { role: ShapeRole::Surface, color, opacity, order, rings })
        };
        Ok(joined.filter(|(_, rings)| !rings.is_empty()).map(shape).collect())
    }

    /// The colours by the attribute of all objects that can be seen.
    fn visible_colors(&self, polygons: &[PagePolygon], parts: &[VisiblePart]) -> HashSet<Rgb> {
        let object = |part: &VisiblePart| self.scene.face_objects[polygons[part.polygon as usize].triangle as usize];
        parts.iter().filter_map(|part| self.colors.get(object(part) as usize).copied().flatten()).collect()
    }

    fn shadows(
        &self,
        polygons: &[PagePolygon],
        parts: &[VisiblePart],
        progress: DrawProgress<'_>,
    ) -> Result<BTreeMap<u32, Rings>, DrawError> {
        let visible = parts.iter().map(|part| (polygons[part.polygon as usize].triangle, part.shape.points.clone()));
        let sun = towards_sun(&self.request.style);
        shadows(self.part, sun, (&self.projection, &self.grid), visible, (self.request.limits, progress))
    }

    fn lines(&self, polygons: &[PagePolygon], parts: &[VisiblePart]) -> Vec<(u32, LineRole, Ends)> {
        let first_cut = self.scene.edges.len() as u32;
        let mut edges: Vec<EdgePart> = Vec::new();
        for part in parts {
            collect(&part.shape, polygons[part.polygon as usize].triangle, &mut edges);
        }
        let (eye, crease_deg) = (self.projection.axes.eye(), self.request.style.crease_deg);
        let is_land = |face: u32| self.scene.object(face).kind == FeatureKind::Relief;
        let class = |edge: u32| {
            let edge = self.scene.edges.get(edge as usize)?;
            let class = class_of(self.scene, edge, eye, crease_deg)?;
            // The triangles of terrain are no lines of the city.
            (!is_land(edge.faces[0]) || class == LineRole::Silhouette).then_some(class)
        };
        // Land that passes through land is no line.
        let meetings = |cut: u32, face: u32| {
            let is_asked = |other: u32| !is_land(face) || !is_land(other);
            let plane = &self.scene.faces[face as usize].plane;
            let ends = self.part.meetings(cut, plane, (eye, &self.volume), is_asked).into_iter();
            ends.map(|ends| ends.map(|point| self.grid.point(self.projection.project(point)))).collect()
        };
        let lines = visible_lines(edges, first_cut, class, meetings).into_iter();
        lines.map(|line| (self.scene.face_objects[line.face as usize], line.class, line.ends)).collect()
    }
}

/// The objects of a drawing while they are collected.
struct Objects(Vec<DrawnObject>);

impl Objects {
    fn new(scene: &DrawnScene) -> Self {
        let object = |object: &insula_export::leaves::LeafObject| DrawnObject {
            number: (object.number != NO_OBJECT).then_some(object.number),
            kind: object.kind,
            identifier: object.identifier.clone(),
            shapes: Vec::new(),
            lines: Vec::new(),
        };
        Self(scene.objects.iter().map(object).collect())
    }

    fn add_shapes(&mut self, shapes: Vec<(u32, DrawnShape)>) {
        for (object, shape) in shapes {
            self.0[object as usize].shapes.push(shape);
        }
    }

    fn add_shadows(&mut self, shadows: BTreeMap<u32, Rings>, style: &Stylesheet) {
        let color = parse_color(&style.shadow_color).unwrap_or([0; 3]);
        for (object, rings) in shadows {
            let opacity = style.shadow_opacity;
            let shape = DrawnShape { role: ShapeRole::Shadow, color, opacity, order: 0, rings };
            self.0[object as usize].shapes.push(shape);
        }
    }

    fn add_hatching(
        &mut self,
        style: &Stylesheet,
        grid: &PaperGrid,
        progress: DrawProgress<'_>,
    ) -> Result<(), DrawError> {
        for object in &mut self.0 {
            advance(progress, DrawStep::Join, 1.0)?;
            let Some(hatch) = style.hatch.get(kind_name(object.kind)) else { continue };
            let surfaces = object.shapes.iter().filter(|shape| shape.role == ShapeRole::Surface);
            let chains: Vec<_> = surfaces.flat_map(|shape| hatched(&shape.rings, hatch, grid.units_per_mm)).collect();
            if !chains.is_empty() && hatch.width > 0.0 {
                object.lines.push(DrawnLine { class: LineRole::Hatch, width_mm: hatch.width, chains });
            }
        }
        Ok(())
    }

    fn add_lines(&mut self, mut lines: Vec<(u32, LineRole, Ends)>, style: &Stylesheet) {
        lines.sort_by_key(|(object, class, ends)| (*object, *class, ends[0].x, ends[0].y, ends[1].x, ends[1].y));
        for lines in lines.chunk_by(|a, b| a.0 == b.0 && a.1 == b.1) {
            let (object, class, _) = lines[0];
            let width_mm = match class {
                LineRole::Silhouette => style.lines.silhouette,
                LineRole::Crease => style.lines.crease,
                LineRole::Border => style.lines.border,
                LineRole::Intersection => style.lines.intersection,
                LineRole::Hatch => 0.0,
            };
            if width_mm > 0.0 {
                let ends: Vec<_> = lines.iter().map(|(.., ends)| *ends).collect();
                self.0[object as usize].lines.push(DrawnLine { class, width_mm, chains: chains(&ends) });
            }
        }
    }

    /// Those of which something is seen, by kind and number.
    fn sorted(self) -> Vec<DrawnObject> {
        let mut objects = self.0;
        objects.retain(|object| !object.shapes.is_empty() || !object.lines.is_empty());
        objects.sort_by_key(|object| (object.kind as u8, object.number));
        objects
    }
}

/// Most lines across a shape; a denser hatching is left out.
const MAX_LINES: f64 = 20_000.0;

/// The lines of a hatching inside `rings`. Lines of neighbouring shapes meet, because all are multiples of the spacing from the
/// middle of the page.
fn hatched(rings: &Rings, hatch: &Hatch, units_per_mm: f64) -> Vec<Vec<PagePoint>> {
    let (sin, cos) = hatch.angle.to_radians().sin_cos();
    let spacing = hatch.spacing * units_per_mm;
    let along =
        |p: PagePoint| [f64::from(p.x) * cos + f64::from(p.y) * sin, f64::from(p.y) * cos - f64::from(p.x) * sin];
    let back =
        |[u, v]: [f64; 2]| PagePoint::new((u * cos - v * sin).round() as i32, (u * sin + v * cos).round() as i32);
    let turned: Vec<Vec<[f64; 2]>> = rings.iter().map(|ring| ring.iter().map(|p| along(*p)).collect()).collect();
    let [low, high] = turned
        .iter()
        .flatten()
        .fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], [_, v]| [low.min(*v), high.max(*v)]);
    let (first, last) = ((low / spacing).ceil(), (high / spacing).floor());
    if !(last >= first && last - first < MAX_LINES) {
        return Vec::new();
    }
    let mut crossings: Vec<Vec<f64>> = vec![Vec::new(); (last - first) as usize + 1];
    for ring in &turned {
        for i in 0..ring.len() {
            let ([u0, v0], [u1, v1]) = (ring[i], ring[(i + 1) % ring.len()]);
            let (below, above) = (v0.min(v1), v0.max(v1));
            let mut line = (below / spacing).ceil().max(first);
            // A line that passes through a point meets one of its two edges.
            while line * spacing < above && line <= last {
                let share = (line * spacing - v0) / (v1 - v0);
                crossings[(line - first) as usize].push(u0 + (u1 - u0) * share);
                line += 1.0;
            }
        }
    }
    let mut lines = Vec::new();
    for (k, crossings) in crossings.iter_mut().enumerate() {
        let v = (first + k as f64) * spacing;
        crossings.sort_by(f64::total_cmp);
        lines.extend(crossings.chunks_exact(2).map(|pair| vec![back([pair[0], v]), back([pair[1], v])]));
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_square_with_a_hole_is_hatched_beside_it() {
        let square = |low: i32, high: i32| {
            [[low, low], [high, low], [high, high], [low, high]].map(|[x, y]| PagePoint::new(x, y)).to_vec()
        };
        let mut hole = square(3000, 7000);
        hole.reverse();
        let hatch = Hatch { spacing: 1.0, angle: 0.0, width: 0.1 };
        let lines = hatched(&vec![square(500, 9500), hole], &hatch, 1000.0);
        assert_eq!(lines.len(), 9 + 4);
        let length: i32 = lines.iter().map(|line| line[1].x - line[0].x).sum();
        assert_eq!(length, 5 * 9000 + 4 * 5000);
        let diagonal = hatched(&vec![square(0, 1000)], &Hatch { angle: 45.0, ..hatch }, 1000.0);
        assert_eq!(diagonal.len(), 1);
    }
}
