//! Terrain and checks for the tests of this module.

mod surface;
mod tiles;
mod view;

use super::bounds::ErrorBounds;
use super::field::HeightField;
use super::view_surface::ViewSurface;
use super::{Place, TerrainMesh};
use glam::Vec3;
use std::collections::{HashMap, HashSet};

/// Random numbers that are the same in each run (SplitMix64).
pub(super) struct Random(pub(super) u64);

impl Random {
    pub(super) fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    pub(super) fn below(&mut self, n: usize) -> usize {
        (self.next() % n as u64) as usize
    }

    pub(super) fn unit(&mut self) -> f32 {
        (self.next() >> 40) as f32 / (1 << 24) as f32
    }
}

/// Value noise of several octaves, up to `amplitude_m`.
pub(super) fn fractal(size: [u32; 2], amplitude_m: f32, seed: u64) -> Vec<f32> {
    let mut random = Random(seed);
    let mut heights = vec![0.0; (size[0] * size[1]) as usize];
    for power in 0..7 {
        let step = 1 << power;
        let [columns, rows] = size.map(|n| (n / step + 2) as usize);
        let corners: Vec<f32> = (0..columns * rows).map(|_| random.unit()).collect();
        let scale = amplitude_m * step as f32 / 128.0;
        for (i, height) in heights.iter_mut().enumerate() {
            let [x, y] = [i as u32 % size[0], i as u32 / size[0]];
            let corner = (y / step) as usize * columns + (x / step) as usize;
            let [u, v] = [x, y].map(|n| (n % step) as f32 / step as f32);
            let along = |i: usize| corners[i] + u * (corners[i + 1] - corners[i]);
            *height += scale * (along(corner) + v * (along(corner + columns) - along(corner)));
        }
    }
    heights
}

pub(super) fn field(size: [u32; 2], heights: Vec<f32>) -> HeightField {
    HeightField::new(size, heights).unwrap()
}

/// The surface of a view in which `scale` is the priority of a metre of error.
pub(super) fn refined(
    field: &HeightField,
    bounds: &ErrorBounds,
    scale: &dyn Fn([Vec3; 2]) -> f32,
    (threshold, max_triangles): (f32, usize),
) -> TerrainMesh {
    let mut surface = ViewSurface::new(field, bounds, 1.0, scale);
    surface.refine(threshold, max_triangles);
    surface.mesh()
}

/// The surface of the diamonds with bounds above `max_error_m`.
pub(super) fn bounded(field: &HeightField, bounds: &ErrorBounds, max_error_m: f32) -> TerrainMesh {
    refined(field, bounds, &|_| 1.0, (max_error_m, usize::MAX))
}

/// Checks that a mesh is closed and covers all that has data, and gives its largest distance from a sample.
pub(super) fn check(mesh: &TerrainMesh, field: &HeightField) -> f64 {
    check_edges(mesh);
    let mut twice_area = 0;
    let mut farthest = 0.0_f64;
    for triangle in &mesh.triangles {
        let corners = triangle.map(|i| mesh.vertices[i as usize]);
        let [a, b, c] = corners.map(|p| p.map(i64::from));
        let side =
            |a: [i64; 2], b: [i64; 2], p: [i64; 2]| (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0]);
        let det = side(a, b, c);
        assert!(det > 0, "{corners:?} is clockwise");
        twice_area += det;
        let [low, high] =
            [0, 1].map(|axis| [a, b, c].map(|p| p[axis])).map(|v| [v.into_iter().min(), v.into_iter().max()]);
        for y in high[0].unwrap()..=high[1].unwrap() {
            for x in low[0].unwrap()..=low[1].unwrap() {
                let shares = [side(b, c, [x, y]), side(c, a, [x, y]), side(a, b, [x, y])];
                if shares.iter().all(|share| *share >= 0) {
                    let weighted = |k: usize| shares[k] as f64 / det as f64 * f64::from(field.height(corners[k]));
                    let distance =
                        f64::from(field.height([x as u32, y as u32])) - (weighted(0) + weighted(1) + weighted(2));
                    assert!(!distance.is_nan(), "{corners:?} covers {x} {y} without data");
                    farthest = farthest.max(distance.abs());
                }
            }
        }
    }
    assert_eq!(twice_area, twice_ground(field));
    farthest
}

/// Checks that no edge has more than two triangles, and that none of a mesh's vertices lies inside of an edge.
fn check_edges(mesh: &TerrainMesh) {
    let places: HashSet<Place> = mesh.vertices.iter().copied().collect();
    assert_eq!(places.len(), mesh.vertices.len(), "vertices are not shared");
    let mut uses: HashMap<[u32; 2], usize> = HashMap::new();
    for [a, b, c] in &mesh.triangles {
        for [from, to] in [[a, b], [b, c], [c, a]] {
            // A direction of an edge belongs to one triangle, the other to its neighbour.
            *uses.entry([*from, *to]).or_default() += 1;
        }
    }
    assert!(uses.values().all(|n| *n == 1));
    for [from, to] in uses.keys().filter(|[from, to]| !uses.contains_key(&[*to, *from])) {
        let [a, b] = [from, to].map(|i| mesh.vertices[*i as usize].map(i64::from));
        let d = [b[0] - a[0], b[1] - a[1]];
        let steps = d[0].abs().max(d[1].abs());
        for k in 1..steps {
            let place = [a[0] + d[0] * k / steps, a[1] + d[1] * k / steps].map(|v| v as u32);
            assert!(!places.contains(&place), "{place:?} lies between {a:?} and {b:?}");
        }
    }
}

/// Number of the smallest triangles with data at all corners, which have half a cell each.
fn twice_ground(field: &HeightField) -> i64 {
    let [columns, rows] = field.size().map(|n| n.saturating_sub(1));
    let has_data = |x: u32, y: u32| !field.height([x, y]).is_nan();
    let mut count = 0;
    for y in 0..rows {
        for x in 0..columns {
            let [south_west, south_east, north_west, north_east] =
                [has_data(x, y), has_data(x + 1, y), has_data(x, y + 1), has_data(x + 1, y + 1)];
            // Diagonals join places whose sums of coordinates are even.
            let (diagonal, others) = match (x + y).is_multiple_of(2) {
                true => (south_west && north_east, [south_east, north_west]),
                false => (south_east && north_west, [south_west, north_east]),
            };
            count += others.into_iter().filter(|other| diagonal && *other).count() as i64;
        }
    }
    count
}
