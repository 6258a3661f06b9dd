//! Heights of a tile's pixels from triangles.

use super::mesh::{MAX_COORDINATE, Triangle};
use super::tiling::PixelPlaces;

/// Pixels this near to a triangle's edge are in it, so that none is lost between two triangles by rounding. In units of
/// the coordinates of vertices: a millionth of the smallest step.
const EDGE: f64 = 1e-6;

/// Gives the pixels without a height, NaN, those of the triangles at their places. `heights` are by row from the north.
pub(super) fn fill(heights: &mut [f32], places: &PixelPlaces, triangles: &[Triangle]) {
    let scaled =
        |places: &[f64]| -> Vec<f64> { places.iter().map(|place| place * f64::from(MAX_COORDINATE)).collect() };
    let places = PixelPlaces { columns: scaled(&places.columns), rows: scaled(&places.rows) };
    for triangle in triangles {
        fill_triangle(heights, &places, &triangle.map(|corner| corner.map(f64::from)));
    }
}

/// The same with one triangle. Places are in the units of its corners.
fn fill_triangle(heights: &mut [f32], places: &PixelPlaces, corners: &[[f64; 3]; 3]) {
    let PixelPlaces { columns, rows } = places;
    let (south, north) = range(corners.iter().map(|corner| corner[1]));
    let first = rows.partition_point(|y| *y > north + EDGE);
    let end = rows.partition_point(|y| *y >= south - EDGE);
    let lines = heights.get_mut(first * columns.len()..end * columns.len()).unwrap_or_default();
    for (line, y) in lines.chunks_exact_mut(columns.len()).zip(&rows[first..end]) {
        let y = y.clamp(south, north);
        let (west, east) = span(corners, y);
        let first = columns.partition_point(|x| *x < west - EDGE);
        let end = columns.partition_point(|x| *x <= east + EDGE).max(first);
        for (height, x) in line[first..end].iter_mut().zip(&columns[first..end]) {
            if height.is_nan() {
                *height = height_at(corners, [*x, y]);
            }
        }
    }
}

/// The western and the eastern end of a triangle's part at `y`, which is within it.
fn span(corners: &[[f64; 3]; 3], y: f64) -> (f64, f64) {
    let [a, b, c] = corners;
    let crossings = [(a, b), (b, c), (c, a)].into_iter().flat_map(|(from, to)| {
        let (low, high) = if from[1] <= to[1] { (from, to) } else { (to, from) };
        let is_crossed = low[1] <= y && y <= high[1];
        let rise = high[1] - low[1];
        let ends = match rise > 0.0 {
            true => [low[0] + (high[0] - low[0]) * ((y - low[1]) / rise); 2],
            false => [low[0], high[0]],
        };
        ends.into_iter().filter(move |_| is_crossed)
    });
    range(crossings)
}

/// The height at a position in a triangle or at its edge, never beyond the heights of its corners.
fn height_at([a, b, c]: &[[f64; 3]; 3], position: [f64; 2]) -> f32 {
    let area = |from: &[f64; 3], to: &[f64; 3]| {
        (from[0] - position[0]) * (to[1] - position[1]) - (from[1] - position[1]) * (to[0] - position[0])
    };
    let areas = [area(b, c), area(c, a), area(a, b)];
    let total: f64 = areas.iter().sum();
    let weights = areas.map(|area| (area / total).max(0.0));
    let sum: f64 = weights.iter().sum();
    ((weights[0] * a[2] + weights[1] * b[2] + weights[2] * c[2]) / sum) as f32
}

/// The least and the greatest number.
fn range(numbers: impl Iterator<Item = f64>) -> (f64, f64) {
    numbers.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), number| (low.min(number), high.max(number)))
}
