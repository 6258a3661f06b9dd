//! Meshes for a view of terrain that exists as triangles: its heights are sampled on a grid, which a [`ViewSurface`] refines.

use super::bounds::ErrorBounds;
use super::diamond::Place;
use super::field::HeightField;
use super::view_surface::ViewSurface;
use glam::{DVec2, DVec3, Vec3};

/// A grid's sides have a multiple of so many steps.
pub const ROOT_STEPS: u32 = 64;
/// Most samples of a grid: 32 MiB of heights and faces.
const MAX_SAMPLES: usize = 1 << 22;
/// Share of the terrain's corners that may be further from the grid than the error allowed.
const MAX_MISSES: f64 = 1e-3;
/// Faces whose normal points less far up are walls or lie upside down.
const MIN_UP: f64 = 1e-3;
/// A sample so near to an edge is on it, in steps.
const ON_EDGE: f64 = 1e-6;

/// A convex face of terrain.
#[derive(Debug, Clone, Copy)]
pub struct TerrainFace<'a> {
    /// In metres, counter-clockwise from above.
    pub corners: &'a [DVec3],
    pub normal: DVec3,
}

impl TerrainFace<'_> {
    /// Height of the face's plane at a place of the map.
    fn height_at(&self, at: DVec2) -> Option<f64> {
        let first = self.corners.first()?;
        Some(first.z - self.normal.truncate().dot(at - first.truncate()) / self.normal.z)
    }
}

/// Where samples are.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SampleGrid {
    /// Of the first sample, in metres.
    pub origin: DVec2,
    /// Distance of the samples in metres.
    pub step: DVec2,
    /// Columns and rows. One less is a multiple of [`ROOT_STEPS`].
    pub size: [u32; 2],
}

impl SampleGrid {
    fn count(&self) -> Option<usize> {
        let is_whole = self.size.iter().all(|n| *n > 1 && (n - 1) % ROOT_STEPS == 0);
        let is_finite = self.origin.is_finite() && self.step.is_finite() && self.step.min_element() > 0.0;
        let count = (self.size[0] as usize).checked_mul(self.size[1] as usize)?;
        (is_whole && is_finite && count <= MAX_SAMPLES).then_some(count)
    }

    fn index(&self, [x, y]: Place) -> usize {
        y as usize * self.size[0] as usize + x as usize
    }

    /// The place of a sample on the map.
    pub fn at(&self, place: Place) -> DVec2 {
        self.origin + DVec2::new(f64::from(place[0]), f64::from(place[1])) * self.step
    }
}

/// How much of a view an error of a metre takes in a box, given by its lower and upper corner: pixels, or millimetres on paper. It
/// does not shrink for a larger box.
pub type ErrorScale<'a> = &'a dyn Fn([Vec3; 2]) -> f32;

/// Heights of terrain on a grid.
#[derive(Debug)]
pub struct SampledTerrain {
    grid: SampleGrid,
    /// `NaN` without terrain.
    heights_m: Vec<f32>,
    /// The face of each sample.
    faces: Vec<u32>,
}

/// Terrain as a view needs it.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ViewMesh {
    pub points: Vec<DVec3>,
    /// The sample of each point.
    pub places: Vec<Place>,
    /// The face from which each point comes.
    pub faces: Vec<u32>,
    pub triangles: Vec<[u32; 3]>,
}

impl SampledTerrain {
    /// Samples terrain. Of several faces above each other, the highest counts. `None` if the grid has more than 4 million samples,
    /// or sides that are no multiple of [`ROOT_STEPS`].
    pub fn new(grid: SampleGrid, faces: &[TerrainFace<'_>]) -> Option<Self> {
        let count = grid.count()?;
        let mut terrain = Self { grid, heights_m: vec![f32::NAN; count], faces: vec![0; count] };
        for (number, face) in (0u32..).zip(faces) {
            terrain.add(number, face);
        }
        Some(terrain)
    }

    fn add(&mut self, number: u32, face: &TerrainFace<'_>) {
        if face.normal.z < MIN_UP {
            return;
        }
        let grid = self.grid;
        let (mut low, mut high) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
        let corners: Vec<DVec2> = face.corners.iter().map(|p| (p.truncate() - grid.origin) / grid.step).collect();
        for corner in &corners {
            (low, high) = (low.min(*corner), high.max(*corner));
        }
        let range = |from: f64, to: f64, axis: usize| {
            let last = f64::from(grid.size[axis] - 1);
            (from - ON_EDGE).ceil().max(0.0) as u32..=(to + ON_EDGE).floor().min(last) as u32
        };
        if high.min_element() < -ON_EDGE {
            return;
        }
        for y in range(low.y, high.y, 1) {
            for x in range(low.x, high.x, 0) {
                let at = DVec2::new(f64::from(x), f64::from(y));
                let is_inside = (0..corners.len()).all(|k| {
                    let (a, b) = (corners[k], corners[(k + 1) % corners.len()]);
                    (b - a).perp_dot(at - a) >= -ON_EDGE * (b - a).length()
                });
                if let Some(height) = face.height_at(grid.at([x, y])).filter(|_| is_inside) {
                    self.keep([x, y], height as f32, number);
                }
            }
        }
    }

    fn keep(&mut self, place: Place, height_m: f32, face: u32) {
        let index = self.grid.index(place);
        let known = self.heights_m[index];
        if known.is_nan() || height_m > known {
            self.heights_m[index] = height_m;
            self.faces[index] = face;
        }
    }

    /// Whether there is terrain at a sample; false outside of the grid.
    pub fn has(&self, place: Place) -> bool {
        (0..2).all(|k| place[k] < self.grid.size[k]) && self.heights_m[self.grid.index(place)].is_finite()
    }

    /// Whether there is terrain at all samples.
    pub fn is_complete(&self) -> bool {
        self.heights_m.iter().all(|height| height.is_finite())
    }

    /// A mesh that is within `max_error` of the samples in a view, unless it would have more than `max_triangles`. `None` if the samples
    /// are themselves further than `max_error` from one in a thousand of the corners of `faces`.
    pub fn for_view(
        &self,
        faces: &[TerrainFace<'_>],
        scale: ErrorScale<'_>,
        (max_error, max_triangles): (f32, usize),
    ) -> Option<ViewMesh> {
        let corners = || faces.iter().flat_map(|face| face.corners.iter());
        let is_lost = |p: &&DVec3| {
            let lost = (p.z - self.height(p.truncate())).abs() as f32 * scale([p.as_vec3(); 2]);
            lost.is_nan() || lost > max_error
        };
        if corners().filter(is_lost).count() as f64 > MAX_MISSES * corners().count() as f64 {
            return None;
        }
        let field = HeightField::new(self.grid.size, self.heights_m.clone())?;
        let bounds = ErrorBounds::new(&field, ROOT_STEPS);
        let origin = self.grid.origin.extend(0.0).as_vec3();
        let in_grid = |reach_m: [Vec3; 2]| scale(reach_m.map(|corner| corner + origin));
        let mut surface = ViewSurface::new(&field, &bounds, self.grid.step.max_element() as f32, &in_grid);
        surface.refine(max_error, max_triangles);
        let mesh = surface.mesh();
        let height = |place: &Place| f64::from(self.heights_m[self.grid.index(*place)]);
        Some(ViewMesh {
            points: mesh.vertices.iter().map(|place| self.grid.at(*place).extend(height(place))).collect(),
            faces: mesh.vertices.iter().map(|place| self.faces[self.grid.index(*place)]).collect(),
            places: mesh.vertices,
            triangles: mesh.triangles,
        })
    }

    /// Height of the grid, between samples by bilinear interpolation over those that have terrain; `NaN` where none has.
    pub fn height(&self, point: DVec2) -> f64 {
        let at = (point - self.grid.origin) / self.grid.step;
        let cell = |v: f64, axis: usize| v.floor().clamp(0.0, f64::from(self.grid.size[axis] - 2));
        let corner = DVec2::new(cell(at.x, 0), cell(at.y, 1));
        let share = (at - corner).clamp(DVec2::ZERO, DVec2::ONE);
        let (mut sum, mut weights) = (0.0, 0.0);
        for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
            let height = f64::from(self.heights_m[self.grid.index([corner.x as u32 + dx, corner.y as u32 + dy])]);
            let along = |is_upper: u32, share: f64| if is_upper == 1 { share } else { 1.0 - share };
            let weight = along(dx, share.x) * along(dy, share.y);
            if height.is_finite() && weight > 0.0 {
                (sum, weights) = (sum + weight * height, weights + weight);
            }
        }
        sum / weights
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Hills over two of the four squares of 64 steps, with triangles of a step of 2 m.
    fn hills() -> Vec<[DVec3; 3]> {
        let point = |[x, y]: [u32; 2]| {
            let (x, y) = (2.0 * f64::from(x), 2.0 * f64::from(y));
            DVec3::new(x, y, 10.0 * ((x / 40.0).sin() + (y / 30.0).cos()))
        };
        let cells = (0..64).flat_map(|y| (0..128).map(move |x| [x, y]));
        let faces = cells.flat_map(|[x, y]: [u32; 2]| {
            let [a, b, c, d] = [[x, y], [x + 1, y], [x + 1, y + 1], [x, y + 1]].map(point);
            [[a, b, c], [a, c, d]]
        });
        faces.collect()
    }

    fn faces(triangles: &[[DVec3; 3]]) -> Vec<TerrainFace<'_>> {
        let normal = |[a, b, c]: &[DVec3; 3]| (b - a).cross(c - a).normalize();
        triangles.iter().map(|corners| TerrainFace { corners, normal: normal(corners) }).collect()
    }

    const GRID: SampleGrid = SampleGrid { origin: DVec2::ZERO, step: DVec2::splat(2.0), size: [129, 129] };

    #[test]
    fn meshes_end_where_the_terrain_ends() {
        let hills = hills();
        let faces = faces(&hills);
        let terrain = SampledTerrain::new(GRID, &faces).unwrap();
        assert!(terrain.has([0, 64]) && !terrain.has([0, 65]) && !terrain.has([129, 0]) && !terrain.is_complete());
        let mesh = terrain.for_view(&faces, &|_| 1.0, (0.5, usize::MAX)).unwrap();
        assert!(mesh.triangles.len() * 4 < hills.len(), "{}", mesh.triangles.len());
        let area: f64 = mesh
            .triangles
            .iter()
            .map(|t| {
                let [a, b, c] = t.map(|v| mesh.points[v as usize].truncate());
                0.5 * (b - a).perp_dot(c - a)
            })
            .sum();
        assert_eq!(area, 256.0 * 128.0);
        for (point, face) in mesh.points.iter().zip(&mesh.faces) {
            assert!((point.z - faces[*face as usize].height_at(point.truncate()).unwrap()).abs() < 1e-4);
        }
    }

    #[test]
    fn grids_that_cannot_hold_the_terrain_are_refused() {
        let hills = hills();
        let faces = faces(&hills);
        assert!(SampledTerrain::new(SampleGrid { size: [100, 129], ..GRID }, &faces).is_none());
        assert!(SampledTerrain::new(SampleGrid { size: [64 * 64 + 1, 64 * 64 + 1], ..GRID }, &faces).is_none());
        let coarse = SampleGrid { step: DVec2::splat(32.0), size: [65, 65], ..GRID };
        let terrain = SampledTerrain::new(coarse, &faces).unwrap();
        assert_eq!(terrain.for_view(&faces, &|_| 1.0, (0.05, usize::MAX)), None);
    }
}
