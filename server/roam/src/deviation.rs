//! Distance of a triangle from the samples that it covers.

use super::diamond::{Corners, middle};
use super::field::{DataCover, HeightField, spans};

/// Largest vertical distance between a triangle and any sample in it or on its edges, in metres. Infinite if the
/// triangle covers places with and without data, because it must be halved; zero if it covers none with data.
///
/// The search ends at the first row that is farther than `limit_m`.
pub(super) fn deviation(field: &HeightField, corners: &Corners, limit_m: f64) -> f64 {
    match field.cover(corners) {
        DataCover::Mixed => return f64::INFINITY,
        DataCover::Empty => return 0.0,
        DataCover::Full => (),
    }
    let z = corners.map(|p| f64::from(field.height(p)));
    let Some(centre) = middle(corners) else { return 0.0 };
    // The middle is usually the farthest sample, and the only one of a triangle with a longest edge of two steps.
    let mut farthest = (f64::from(field.height(centre)) - (z[0] + z[1]) / 2.0).abs();
    let length = [0, 1].map(|axis| corners[0][axis].abs_diff(corners[1][axis]));
    if farthest > limit_m || length == [2, 0] || length == [0, 2] {
        return farthest;
    }
    let [a, b, c] = corners.map(|p| p.map(f64::from));
    let (u, v) = ([b[0] - a[0], b[1] - a[1]], [c[0] - a[0], c[1] - a[1]]);
    let det = u[0] * v[1] - u[1] * v[0];
    let slope_x = ((z[1] - z[0]) * v[1] - (z[2] - z[0]) * u[1]) / det;
    let slope_y = ((z[2] - z[0]) * u[0] - (z[1] - z[0]) * v[0]) / det;
    for [y, from, to] in spans(corners) {
        let start = z[0] + slope_x * (f64::from(from) - a[0]) + slope_y * (f64::from(y) - a[1]);
        farthest = farthest.max(farthest_in_row(field.row(y, from, to), start, slope_x));
        if farthest > limit_m {
            break;
        }
    }
    farthest
}

/// Largest distance of a row's heights from a line that begins at `start` and rises by `slope` a sample.
fn farthest_in_row(row: &[f32], start: f64, slope: f64) -> f64 {
    // Separate maxima, so that the compiler may compute them side by side.
    const LANES: usize = 8;
    let mut farthest = [0.0_f64; LANES];
    let (chunks, rest) = row.as_chunks::<LANES>();
    let mut base = start;
    let within: [f64; LANES] = std::array::from_fn(|lane| lane as f64 * slope);
    for chunk in chunks {
        for lane in 0..LANES {
            let distance = (f64::from(chunk[lane]) - (base + within[lane])).abs();
            farthest[lane] = if distance > farthest[lane] { distance } else { farthest[lane] };
        }
        base += LANES as f64 * slope;
    }
    for (lane, height) in rest.iter().enumerate() {
        farthest[lane] = farthest[lane].max((f64::from(*height) - (base + within[lane])).abs());
    }
    farthest.into_iter().fold(0.0, f64::max)
}
