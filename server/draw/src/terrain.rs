//! Terrain with no more triangles than the view needs, by ROAM (Duchaineau and others 1997; Giannitrapani and Fusiello).
//!
//! A city's meshes have terrain of one largest error everywhere. A drawing needs it near the eye only, and less in plans. The terrain's triangles are sampled on a grid, from which a mesh for the view is made. Where a grid cannot hold them
//! within the drawing's error, they stay: terrain with walls and breaks finer than the grid, or with a border inside of the area.

use crate::{
    face::Face,
    scene::{DrawnScene, SceneMesh},
    view::Projection,
};
use glam::{DVec2, DVec3, Vec3};
use insula_objects::FeatureKind;
use insula_roam::{ErrorBounds, HeightField, Node, Priority, RoamMesh, TerrainMesh};

/// Most samples of the grid, about: 16 MiB with their bounds and the mesh, and half a second.
const MAX_SAMPLES: f64 = 1_048_576.0;
/// The grid has a multiple of so many steps along each side.
const ROOT_STEPS: u32 = 64;
/// Smallest distance of samples.
const MIN_STEP_M: f64 = 0.5;
/// Fewer triangles are not worth a grid.
const MIN_TRIANGLES: usize = 20_000;
/// Share of the terrain's corners that may be further from the grid than the error allowed.
const MAX_MISSES: f64 = 1e-3;
/// Least share of a vertical error that counts in views with parallel rays. In a plan none of it is seen, but terrain that is too high
/// would hide the buildings on it.
const MIN_SEEN_SHARE: f64 = 0.25;

/// Replaces a scene's terrain by a mesh within `error_mm` on paper, if that has fewer triangles. A share of [`MAX_MISSES`] of its corners
/// may be further away.
pub(crate) fn refine_terrain(scene: &mut DrawnScene, projection: &Projection, error_mm: f64) {
    let Some(terrain) = largest_terrain(scene) else { return };
    let is_terrain: Vec<bool> = scene.face_objects.iter().map(|object| *object == terrain).collect();
    let faces: Vec<&Face> = scene.faces.iter().zip(&is_terrain).filter_map(|(face, is)| is.then_some(face)).collect();
    if faces.len() < MIN_TRIANGLES {
        return;
    }
    let error = PaperError::new(projection);
    let Some(mesh) = Grid::of(&faces).and_then(|grid| grid.mesh(&faces, &error, error_mm)) else { return };
    if mesh.triangles.len() < faces.len() {
        scene.replace_faces(&is_terrain, &mesh, terrain);
    }
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

/// Errors of the grid's diamonds, whose places are relative to its first sample.
struct GridError<'a> {
    error: &'a PaperError,
    origin: Vec3,
}

impl Priority for GridError<'_> {
    fn priority(&self, node: &Node) -> f32 {
        node.error_m * self.error.of_metre(node.reach_m.map(|corner| corner + self.origin))
    }
}

/// Heights of terrain.
struct Grid {
    /// Of the first sample, in metres from the scene's origin.
    origin: DVec2,
    step: DVec2,
    size: [u32; 2],
    /// `NaN` without terrain.
    heights_m: Vec<f32>,
}

impl Grid {
    /// Samples terrain; `None` if it does not cover the rectangle around it.
    fn of(faces: &[&Face]) -> Option<Self> {
        let points = faces.iter().flat_map(|face| face.points.iter());
        let (mut low, mut high) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
        for point in points {
            (low, high) = (low.min(point.truncate()), high.max(point.truncate()));
        }
        let extent = high - low;
        let step = (extent.x * extent.y / MAX_SAMPLES).sqrt().max(MIN_STEP_M);
        let steps = [extent.x, extent.y].map(|side| {
            let roots = (side / step / f64::from(ROOT_STEPS)).round();
            (roots.clamp(1.0, MAX_SAMPLES / f64::from(ROOT_STEPS)) as u32) * ROOT_STEPS
        });
        let size = steps.map(|n| n + 1);
        let count = size[0] as usize * size[1] as usize;
        if !extent.is_finite() || extent.min_element() <= 0.0 || count as f64 > 4.0 * MAX_SAMPLES {
            return None;
        }
        let step = extent / DVec2::new(f64::from(steps[0]), f64::from(steps[1]));
        let mut grid = Self { origin: low, step, size, heights_m: vec![f32::NAN; count] };
        for face in faces {
            grid.add(face);
        }
        grid.heights_m.iter().all(|height| height.is_finite()).then_some(grid)
    }

    /// Samples a face. Of several above each other, the highest counts.
    fn add(&mut self, face: &Face) {
        let (mut low, mut high) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
        let corners: Vec<DVec2> = face.points.iter().map(|p| (p.truncate() - self.origin) / self.step).collect();
        for corner in &corners {
            (low, high) = (low.min(*corner), high.max(*corner));
        }
        if face.plane.normal.z < MIN_UP {
            return;
        }
        let size = self.size;
        let last = |axis: usize| f64::from(size[axis] - 1);
        let range = |from: f64, to: f64, axis: usize| {
            (from - ON_EDGE).ceil().max(0.0) as u32..=(to + ON_EDGE).floor().min(last(axis)) as u32
        };
        for y in range(low.y, high.y, 1) {
            for x in range(low.x, high.x, 0) {
                let at = DVec2::new(f64::from(x), f64::from(y));
                let is_inside = (0..corners.len()).all(|k| {
                    let (a, b) = (corners[k], corners[(k + 1) % corners.len()]);
                    (b - a).perp_dot(at - a) >= -ON_EDGE * (b - a).length()
                });
                if is_inside {
                    self.keep([x, y], height_at(face, self.origin + at * self.step));
                }
            }
        }
    }

    fn keep(&mut self, place: [u32; 2], height: f64) {
        let index = self.index(place);
        if self.heights_m[index].is_nan() || height as f32 > self.heights_m[index] {
            self.heights_m[index] = height as f32;
        }
    }

    fn index(&self, [x, y]: [u32; 2]) -> usize {
        y as usize * self.size[0] as usize + x as usize
    }

    /// The mesh for a view; `None` if the grid is further from the terrain than `error_mm` on paper.
    fn mesh(self, faces: &[&Face], error: &PaperError, error_mm: f64) -> Option<SceneMesh> {
        let lost_mm = self.lost_mm(faces, error);
        // The grid's own error is a part of what is allowed.
        let misses = lost_mm.iter().filter(|lost| f64::from(**lost) > 0.5 * error_mm).count();
        if misses as f64 > MAX_MISSES * lost_mm.len() as f64 {
            return None;
        }
        let field = HeightField::new(self.size, self.heights_m.clone())?;
        let bounds = ErrorBounds::new(&field, ROOT_STEPS);
        let mut roam = RoamMesh::new(&field, &bounds, self.step.max_element() as f32);
        let priority = GridError { error, origin: self.origin.extend(0.0).as_vec3() };
        roam.update(&priority, (0.5 * error_mm) as f32, faces.len());
        Some(self.scene_mesh(&roam.mesh()))
    }

    /// How far each corner of the terrain is from the grid, in millimetres on paper.
    fn lost_mm(&self, faces: &[&Face], error: &PaperError) -> Vec<f32> {
        let corners = faces.iter().flat_map(|face| face.points.iter());
        corners.map(|p| (p.z - self.height(p.truncate())).abs() as f32 * error.of_metre([p.as_vec3(); 2])).collect()
    }

    /// Height of the grid, between samples by bilinear interpolation.
    fn height(&self, point: DVec2) -> f64 {
        let at = (point - self.origin) / self.step;
        let cell = |v: f64, axis: usize| v.floor().clamp(0.0, f64::from(self.size[axis] - 2));
        let corner = DVec2::new(cell(at.x, 0), cell(at.y, 1));
        let share = (at - corner).clamp(DVec2::ZERO, DVec2::ONE);
        let z = |dx: u32, dy: u32| f64::from(self.heights_m[self.index([corner.x as u32 + dx, corner.y as u32 + dy])]);
        let row = |dy: u32| z(0, dy) + (z(1, dy) - z(0, dy)) * share.x;
        row(0) + (row(1) - row(0)) * share.y
    }

    fn scene_mesh(&self, mesh: &TerrainMesh) -> SceneMesh {
        let point = |place: &[u32; 2]| {
            let at = self.origin + DVec2::new(f64::from(place[0]), f64::from(place[1])) * self.step;
            DVec3::new(at.x, at.y, f64::from(self.heights_m[self.index(*place)]))
        };
        SceneMesh { points: mesh.vertices.iter().map(point).collect(), triangles: mesh.triangles.clone() }
    }
}

/// Faces whose normal points less far up are walls or lie upside down.
const MIN_UP: f64 = 1e-3;
/// A sample so near to an edge is on it, in steps.
const ON_EDGE: f64 = 1e-6;

/// Height of a face's plane at a place of the map.
fn height_at(face: &Face, at: DVec2) -> f64 {
    let normal = face.plane.normal;
    (face.plane.offset - normal.truncate().dot(at)) / normal.z
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        face::{FacePlane, NO_EDGE},
        view::{DrawView, PaperRect, ViewAxes},
    };
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
        let grid = Grid::of(&after.faces.iter().collect::<Vec<_>>()).unwrap();
        let points = before.faces.iter().flat_map(|face| face.points.iter()).filter(|point| within(**point));
        points.map(|p| (p.z - grid.height(p.truncate())).abs()).fold(0.0, f64::max)
    }

    #[test]
    fn axonometric_views_keep_the_error_with_fewer_triangles() {
        let before = hills(10.0);
        let view = DrawView::Axonometric { azimuth_deg: 30.0, elevation_deg: 30.0 };
        let projection = projection(&view, &before);
        for error_mm in [0.5, 2.0] {
            let mut after = hills(10.0);
            refine_terrain(&mut after, &projection, error_mm);
            assert!(after.faces.len() * 2 < before.faces.len(), "{error_mm}: {}", after.faces.len());
            let distance_mm = largest_distance(&before, &after, |_| true) * projection.mm_per_m();
            assert!(distance_mm <= error_mm, "{error_mm}: {distance_mm}");
        }
    }

    #[test]
    fn perspectives_are_fine_near_the_eye_only() {
        let before = hills(10.0);
        let (position, target) = ([0.0, 0.0, 40.0], [500.0, 500.0, 0.0]);
        let view = DrawView::Perspective { position, target, up: [0.0, 0.0, 1.0], fov_y_deg: 50.0 };
        let projection = projection(&view, &before);
        let mut after = hills(10.0);
        refine_terrain(&mut after, &projection, 1.0);
        assert!(after.faces.len() * 2 < before.faces.len(), "{}", after.faces.len());
        let near = after.faces.iter().filter(|face| face.points[0].truncate().length() < 100.0);
        let far = after.faces.iter().filter(|face| face.points[0].truncate().length() > 500.0);
        let mean = |faces: Vec<&Face>| faces.iter().map(|face| face.area_m2()).sum::<f64>() / faces.len() as f64;
        assert!(mean(near.collect()) * 3.0 < mean(far.collect()));
        assert!(largest_distance(&before, &after, |p| p.truncate().length() > 300.0) > 0.05);
    }

    #[test]
    fn all_edges_inside_have_two_faces() {
        let mut scene = hills(10.0);
        let view = DrawView::Axonometric { azimuth_deg: 0.0, elevation_deg: 40.0 };
        let projection = projection(&view, &scene);
        refine_terrain(&mut scene, &projection, 1.0);
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
        let count = broken.faces.len();
        // A hole.
        broken.faces.drain(5000..5040);
        broken.face_objects.drain(5000..5040);
        refine_terrain(&mut broken, &projection, 1.0);
        assert_eq!(broken.faces.len(), count - 40);
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
        refine_terrain(&mut steps, &projection, 0.01);
        assert_eq!(steps.faces.len(), count);
    }
}
