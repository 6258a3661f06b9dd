//! Shadows of the sun as shapes.
//!
//! What the sun sees is lit: the visible parts of surfaces in a view from the sun. The shadows of a plane are its visible parts in the
//! drawing without its lit parts. Faces that are turned away from the sun have no shadows; their colour shows it.

use crate::bsp::Eye;
use crate::convex::{Convex, PagePoint, PageRect};
use crate::error::{DrawError, DrawProgress};
use crate::face::{Face, FacePlane, NO_EDGE};
use crate::join::{Rings, difference, unions, without_narrow};
use crate::limits::DrawLimits;
use crate::part::DrawnPart;
use crate::scene::{DrawnScene, clip};
use crate::view::{PaperGrid, PaperRect, Projection, ViewAxes};
use crate::volume::ViewVolume;
use crate::warnock::{PagePolygon, visible_parts};
use glam::{DVec2, DVec3};
use insula_objects::FeatureKind;
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Side of the page on which the sun sees the scene, in millimetres.
const SUN_PAGE_MM: f64 = 1000.0;
/// Narrower shadows come from rounding and are left out, in millimetres.
const MIN_WIDTH_MM: f64 = 0.1;
/// Planes of one object are the same if their normals and their distances from the origin (metres) are, in steps of this.
const NORMAL_STEP: f64 = 1e-3;
const OFFSET_STEP_M: f64 = 0.02;

/// An object and one of its planes.
pub(crate) type PlaneKey = (u32, [i64; 4]);

/// What a face shares with those of its object that lie in its plane.
pub(crate) fn plane_key(scene: &DrawnScene, face: u32) -> PlaneKey {
    let FacePlane { normal, offset } = scene.faces[face as usize].plane;
    let [x, y, z] = normal.to_array().map(|v| (v / NORMAL_STEP).round() as i64);
    (scene.face_objects[face as usize], [x, y, z, (offset / OFFSET_STEP_M).round() as i64])
}

/// The shadows on each object, for the visible parts of the drawing with their faces. Fails if there are too many parts, or if it is
/// stopped.
pub(crate) fn shadows(
    part: &DrawnPart,
    towards_sun: DVec3,
    (projection, grid): (&Projection, &PaperGrid),
    visible: impl Iterator<Item = (u32, Vec<PagePoint>)>,
    (limits, progress): (DrawLimits, DrawProgress<'_>),
) -> Result<BTreeMap<u32, Rings>, DrawError> {
    let scene = &part.scene;
    let mut shown: BTreeMap<PlaneKey, Rings> = BTreeMap::new();
    for (face, ring) in visible {
        if scene.faces[face as usize].plane.normal.dot(towards_sun) > 0.0 {
            shown.entry(plane_key(scene, face)).or_default().push(ring);
        }
    }
    let mut lit: BTreeMap<PlaneKey, Rings> = shown.keys().map(|key| (*key, Rings::new())).collect();
    for face in lit_faces(part, towards_sun, limits, progress)? {
        let Some(rings) = lit.get_mut(&plane_key(scene, face.triangle)) else { continue };
        let planes = projection.planes();
        rings.extend(clip(face, &planes).and_then(|face| ring_of(&face, projection, grid)));
    }
    let planes: Vec<(u32, Rings, Rings)> =
        shown.into_iter().zip(lit.into_values()).map(|((key, shown), lit)| (key.0, shown, lit)).collect();
    let dark: Vec<(u32, Rings)> =
        planes.into_par_iter().map(|(object, shown, lit)| (object, difference(&shown, &lit))).collect();
    let width = MIN_WIDTH_MM * grid.units_per_mm;
    let mut objects: BTreeMap<u32, Rings> = BTreeMap::new();
    for (object, rings) in dark {
        objects.entry(object).or_default().extend(without_narrow(rings, width));
    }
    let numbers: Vec<u32> = objects.keys().copied().collect();
    let joined = unions(objects.into_values().collect(), progress)?;
    let wide = joined.into_iter().map(|rings| without_narrow(rings, width));
    Ok(numbers.into_iter().zip(wide).filter(|(_, rings)| !rings.is_empty()).collect())
}

/// A face on the page, counter-clockwise; `None` if it has no area there.
fn ring_of(face: &Face, projection: &Projection, grid: &PaperGrid) -> Option<Vec<PagePoint>> {
    let mut points: Vec<PagePoint> = face.points.iter().map(|p| grid.point(projection.project(*p))).collect();
    let area = Convex { edges: vec![NO_EDGE; points.len()], points: points.clone() }.twice_area();
    if area < 0 {
        points.reverse();
    }
    (area != 0).then_some(points)
}

/// The parts of faces that the sun sees.
fn lit_faces(
    part: &DrawnPart,
    towards_sun: DVec3,
    limits: DrawLimits,
    progress: DrawProgress<'_>,
) -> Result<Vec<Face>, DrawError> {
    let scene = &part.scene;
    let axes = ViewAxes::towards(-towards_sun);
    let frame = PaperRect { min: [0.0; 2], max: [SUN_PAGE_MM; 2] };
    let grid = PaperGrid::new([SUN_PAGE_MM; 2]);
    let sun = Projection::new(axes, frame, None, scene.faces.iter().flat_map(|face| face.points.iter().copied()));
    let faces = part.front_to_back(Eye::Direction(towards_sun), &ViewVolume::default(), limits.faces(), progress)?;
    let project = |face: Face| {
        let points = face.points.iter().map(|p| grid.point(sun.project(*p))).collect();
        let shape = Convex { points, edges: vec![NO_EDGE; face.points.len()] };
        let bounds = PageRect::of(&shape.points);
        // Flat ground casts no shadows: its leaves end above the plane around them.
        let is_opaque = scene.has_terrain || scene.object(face.triangle).kind != FeatureKind::Relief;
        (shape.twice_area() > 0).then_some(PagePolygon { shape, bounds, triangle: face.triangle, is_opaque })
    };
    let polygons: Vec<PagePolygon> = faces.into_iter().filter_map(project).collect();
    let parts = visible_parts(&polygons, grid.rect(&frame), limits.parts, progress)?;
    let lift = |polygon: u32, shape: &Convex| {
        let triangle = polygons[polygon as usize].triangle;
        let plane = scene.faces[triangle as usize].plane;
        let points = shape.points.iter().map(|p| sun.lift(DVec2::from(grid.mm(*p)), &plane));
        Face { points: points.collect(), edges: vec![NO_EDGE; shape.points.len()], plane, triangle }
    };
    Ok(parts.iter().map(|part| lift(part.polygon, &part.shape)).collect())
}
