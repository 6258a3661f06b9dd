//! Areas of rings in the coordinates of a source.

/// Twice the area of a ring, as a vector.
pub(super) fn ring_area_vector(ring: &[[f64; 3]]) -> [f64; 3] {
    let Some(first) = ring.first() else { return [0.0; 3] };
    ring.windows(2).fold([0.0; 3], |sum, pair| {
        let area = cross(minus(pair[0], *first), minus(pair[1], *first));
        [sum[0] + area[0], sum[1] + area[1], sum[2] + area[2]]
    })
}

fn minus(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}
