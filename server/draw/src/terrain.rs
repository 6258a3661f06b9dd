//! Terrain with no more triangles than the view needs, by ROAM (Duchaineau and others 1997; Giannitrapani and Fusiello).
//!
//! A city's meshes have terrain of one largest error everywhere. A drawing needs it near the eye only, and less in plans. The terrain's triangles are sampled on a grid, from which a mesh for the view is made. Where a grid cannot hold them
//! within the drawing's error, they stay: terrain with walls and breaks finer than the grid, or with a border inside of the area.

use crate::face::Face;
use crate::scene::{DrawnScene, SceneMesh};
use crate::view::Projection;
use glam::{DVec2, Vec3};
use insula_objects::FeatureKind;
use insula_roam::{ROOT_STEPS, SampleGrid, SampledTerrain, TerrainFace};

/// Most samples of the grid, about: 16 MiB with their bounds and the mesh, and half a second.
const MAX_SAMPLES: f64 = 1_048_576.0;
/// Smallest distance of samples.
const MIN_STEP_M: f64 = 0.5;
/// Fewer triangles are not worth a grid.
const MIN_TRIANGLES: usize = 20_000;
/// Least share of a vertical error that counts in views with parallel rays. In a plan none of it is seen, but terrain that is too high
/// would hide the buildings on it.
const MIN_SEEN_SHARE: f64 = 0.25;

/// A scene with a mesh within `error_mm` on paper in the place of its terrain; `None` if the mesh has no fewer triangles. One in a
/// thousand of its corners may be further away.
pub(crate) fn refine_terrain(scene: &DrawnScene, projection: &Projection, error_mm: f64) -> Option<DrawnScene> {
    let terrain = largest_terrain(scene)?;
    let is_terrain: Vec<bool> = scene.face_objects.iter().map(|object| *object == terrain).collect();
    let faces: Vec<&Face> = scene.faces.iter().zip(&is_terrain).filter_map(|(face, is)| is.then_some(face)).collect();
    if faces.len() < MIN_TRIANGLES {
        return None;
    }
    let mesh = mesh(&faces, &PaperError::new(projection), error_mm)?;
    let has_fewer = mesh.triangles.len() < faces.len();
    has_fewer.then(|| scene.with_faces_replaced(&is_terrain, &mesh, terrain))
}

/// The object that most triangles of terrain have. Other terrain lies in or on it, such as embankments.
fn largest_terrain(scene: &DrawnScene) -> Option<u32> {
    let mut counts = vec![0u32; scene.objects.len()];
    scene.face_objects.iter().for_each(|object| counts[*object as usize] += 1);
    let terrain = (0u32..).zip(&scene.objects).filter(|(_, object)| object.kind == FeatureKind::Relief);
    terrain.map(|(index, _)| index).max_by_key(|index| counts[*index as usize])
}

/// How large a vertical error is on paper.
struct PaperError {
    /// Place of the eye, in metres from the scene's origin; `None` for parallel rays.
    eye: Option<Vec3>,
    /// Millimetres on paper of a metre of height; with an eye, at a distance of a metre.
    mm_per_m: f32,
}

impl PaperError {
    fn new(projection: &Projection) -> Self {
        let axes = &projection.axes;
        // With an eye, parts of the view look along the heights and others across them.
        let seen = if axes.position.is_some() { 1.0 } else { axes.up.z.abs().max(MIN_SEEN_SHARE) };
        Self { eye: axes.position.map(|eye| eye.as_vec3()), mm_per_m: (projection.mm_per_m() * seen) as f32 }
    }

    /// Of a vertical error of a metre in a box, in millimetres.
    fn of_metre(&self, [low, high]: [Vec3; 2]) -> f32 {
        let distance = self.eye.map_or(1.0, |eye| eye.distance(eye.clamp(low, high)).max(1.0));
        self.mm_per_m / distance
    }
}

/// The grid on which terrain is sampled; `None` if it has no area.
fn grid_over(faces: &[&Face]) -> Option<SampleGrid> {
    let points = faces.iter().flat_map(|face| face.points.iter());
    let (mut low, mut high) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
    for point in points {
        (low, high) = (low.min(point.truncate()), high.max(point.truncate()));
    }
    let extent = high - low;
    if !extent.is_finite() || extent.min_element() <= 0.0 {
        return None;
    }
    let step = (extent.x * extent.y / MAX_SAMPLES).sqrt().max(MIN_STEP_M);
    let steps = [extent.x, extent.y].map(|side| {
        let roots = (side / step / f64::from(ROOT_STEPS)).round();
        (roots.clamp(1.0, MAX_SAMPLES / f64::from(ROOT_STEPS)) as u32) * ROOT_STEPS
    });
    let step = extent / DVec2::new(f64::from(steps[0]), f64::from(steps[1]));
    Some(SampleGrid { origin: low, step, size: steps.map(|n| n + 1) })
}

/// The terrain for a view; `None` if it has holes, or if a grid cannot hold it within half of `error_mm` on paper.
fn mesh(faces: &[&Face], error: &PaperError, error_mm: f64) -> Option<SceneMesh> {
    let terrain_faces: Vec<TerrainFace<'_>> =
        faces.iter().map(|face| TerrainFace { corners: &face.points, normal: face.plane.normal }).collect();
    let terrain = SampledTerrain::new(grid_over(faces)?, &terrain_faces)?;
    if !terrain.is_complete() {
        return None;
    }
    // The grid's own error is the other half of what is allowed.
    let allowed = ((0.5 * error_mm) as f32, faces.len());
    let mesh = terrain.for_view(&terrain_faces, &|box_m| error.of_metre(box_m), allowed)?;
    Some(SceneMesh { points: mesh.points, triangles: mesh.triangles })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::face::{FacePlane, NO_EDGE};
    use crate::view::{DrawView, PaperRect, ViewAxes};
    use glam::DVec3;
    use insula_export::camera::ExportCamera;
    use insula_export::leaves::LeafObject;

    const STEPS: u32 = 128;

    /// Hills over a square of 512 m, in triangles of 4 m.
    fn hills(height_m: f64) -> DrawnScene {
        let height = |x: f64, y: f64| height_m * ((x / 60.0).sin() + (y / 45.0).cos());
        let point = |[x, y]: [u32; 2]| {
            let (x, y) = (4.0 * f64::from(x), 4.0 * f64::from(y));
            DVec3::new(x, y, height(x, y))
        };
        let object = LeafObject { number: 7, kind: FeatureKind::Relief, identifier: String::new(), is_selected: true };
        let mut scene = DrawnScene { objects: vec![object], ..DrawnScene::default() };
        for (x, y) in (0..STEPS).flat_map(|y| (0..STEPS).map(move |x| (x, y))) {
            let [a, b, c, d] = [[x, y], [x + 1, y], [x + 1, y + 1], [x, y + 1]].map(point);
            for corners in [[a, b, c], [a, c, d]] {
                let plane = FacePlane::of(corners).unwrap();
                let triangle = scene.faces.len() as u32;
                scene.faces.push(Face { points: corners.to_vec(), edges: vec![NO_EDGE; 3], plane, triangle });
                scene.face_objects.push(0);
            }
        }
        scene
    }

    fn projection(view: &DrawView, scene: &DrawnScene) -> Projection {
        let frame = PaperRect { min: [0.0, 0.0], max: [400.0, 280.0] };
        let axes = ViewAxes::new(view, scene.origin).unwrap();
        Projection::new(axes, frame, None, scene.faces.iter().flat_map(|face| face.points.iter().copied()))
    }

    /// Largest vertical distance of a point of the hills from the scene's faces.
    fn largest_distance(before: &DrawnScene, after: &DrawnScene, within: impl Fn(DVec3) -> bool) -> f64 {
        let faces: Vec<&Face> = after.faces.iter().collect();
        let terrain_faces: Vec<TerrainFace<'_>> =
            faces.iter().map(|face| TerrainFace { corners: &face.points, normal: face.plane.normal }).collect();
        let terrain = SampledTerrain::new(grid_over(&faces).unwrap(), &terrain_faces).unwrap();
        let points = before.faces.iter().flat_map(|face| face.points.iter()).filter(|point| within(**point));
        points.map(|p| (p.z - terrain.height(p.truncate())).abs()).fold(0.0, f64::max)
    }

    #[test]
    fn axonometric_views_keep_the_error_with_fewer_triangles() {
        let before = hills(10.0);
        let view = DrawView::Axonometric { azimuth_deg: 30.0, elevation_deg: 30.0 };
        let projection = projection(&view, &before);
        for error_mm in [0.5, 2.0] {
            let after = refine_terrain(&before, &projection, error_mm).unwrap();
            assert!(after.faces.len() * 2 < before.faces.len(), "{error_mm}: {}", after.faces.len());
            let distance_mm = largest_distance(&before, &after, |_| true) * projection.mm_per_m();
            assert!(distance_mm <= error_mm, "{error_mm}: {distance_mm}");
        }
    }

    #[test]
    fn perspectives_are_fine_near_the_eye_only() {
        let before = hills(10.0);
        let (position, target) = ([0.0, 0.0, 40.0], [500.0, 500.0, 0.0]);
        let camera = ExportCamera { position, target, up: [0.0, 0.0, 1.0], fov_y_deg: 50.0 };
        let projection = projection(&DrawView::Perspective(camera), &before);
        let after = refine_terrain(&before, &projection, 1.0).unwrap();
        assert!(after.faces.len() * 2 < before.faces.len(), "{}", after.faces.len());
        let near = after.faces.iter().filter(|face| face.points[0].truncate().length() < 100.0);
        let far = after.faces.iter().filter(|face| face.points[0].truncate().length() > 500.0);
        let mean = |faces: Vec<&Face>| faces.iter().map(|face| face.area_m2()).sum::<f64>() / faces.len() as f64;
        assert!(mean(near.collect()) * 3.0 < mean(far.collect()));
        assert!(largest_distance(&before, &after, |p| p.truncate().length() > 300.0) > 0.05);
    }

    #[test]
    fn all_edges_inside_have_two_faces() {
        let before = hills(10.0);
        let view = DrawView::Axonometric { azimuth_deg: 0.0, elevation_deg: 40.0 };
        let scene = refine_terrain(&before, &projection(&view, &before), 1.0).unwrap();
        let side = 4.0 * f64::from(STEPS);
        for face in &scene.faces {
            for (k, edge) in face.edges.iter().enumerate() {
                let ends = [face.points[k], face.points[(k + 1) % 3]];
                let is_border = (0..2).any(|axis| {
                    [0.0, side].iter().any(|border| ends.iter().all(|end| (end[axis] - border).abs() < 1e-6))
                });
                assert_eq!(scene.edges[*edge as usize].count, if is_border { 1 } else { 2 }, "{ends:?}");
            }
        }
    }

    #[test]
    fn terrain_that_no_grid_holds_stays() {
        let mut broken = hills(10.0);
        let view = DrawView::Axonometric { azimuth_deg: 0.0, elevation_deg: 40.0 };
        let projection = projection(&view, &broken);
        // A hole.
        broken.faces.drain(5000..5040);
        broken.face_objects.drain(5000..5040);
        assert!(refine_terrain(&broken, &projection, 1.0).is_none());
        // Walls of 20 m between the steps of the grid.
        let mut steps = hills(10.0);
        for face in &mut steps.faces {
            for point in &mut face.points {
                point.z = if (point.x / 4.0).round() as i64 % 2 == 0 { 0.0 } else { 20.0 };
                point.x += if point.z > 0.0 { -3.9 } else { 0.0 };
            }
            let corners = [face.points[0], face.points[1], face.points[2]];
            face.plane = FacePlane::of(corners).unwrap();
        }
        assert!(refine_terrain(&steps, &projection, 0.01).is_none());
    }
}
