//! Circular arcs as short segments.

/// Segments of a full circle that an arc is divided into, as GDAL does.
const CIRCLE_SEGMENTS: f64 = 90.0;

/// Replaces circular arcs, each of a start, a middle and an end (the start of the next), by short segments. They are circles on the map,
/// with heights that change evenly. An arc whose end is its start is a circle, with the middle opposite. Arcs in a straight line stay as
/// they are.
pub fn divide_arcs(controls: &[[f64; 3]]) -> Vec<[f64; 3]> {
    divide_by(controls, divide_on_map)
}

/// As [`divide_arcs`], of arcs that are circles in any plane in space.
pub fn divide_arcs_in_space(controls: &[[f64; 3]]) -> Vec<[f64; 3]> {
    divide_by(controls, |[a, b, c], line| divide_in_plane([a, b, c], false, line))
}

/// A circle in space through three positions, closed.
pub fn circle_in_space(controls: [[f64; 3]; 3]) -> Vec<[f64; 3]> {
    let mut line = vec![controls[0]];
    divide_in_plane(controls, true, &mut line);
    line
}

fn divide_by(controls: &[[f64; 3]], divide: impl Fn([[f64; 3]; 3], &mut Vec<[f64; 3]>)) -> Vec<[f64; 3]> {
    let mut line = Vec::with_capacity(controls.len());
    line.extend(controls.first());
    let mut at = 0;
    while let (Some(a), Some(b), Some(c)) = (controls.get(at), controls.get(at + 1), controls.get(at + 2)) {
        divide([*a, *b, *c], &mut line);
        at += 2;
    }
    line.extend(controls.get(at + 1));
    line
}

/// Adds the positions of an arc after its start.
fn divide_on_map([a, b, c]: [[f64; 3]; 3], line: &mut Vec<[f64; 3]>) {
    let places = [a, b, c].map(|[x, y, _]| [x, y]);
    let is_circle = places[0] == places[2];
    let Some(inner) = between(places, is_circle) else {
        line.extend([b, c]);
        return;
    };
    let steps = inner.len() as f64 + 1.0;
    let height = |step: usize| a[2] + (c[2] - a[2]) * (step as f64 + 1.0) / steps;
    line.extend(inner.iter().enumerate().map(|(step, [x, y])| [*x, *y, height(step)]));
    line.push(c);
}

/// Adds the positions of an arc, or of the full circle through three positions, after its start.
fn divide_in_plane([a, b, c]: [[f64; 3]; 3], is_circle: bool, line: &mut Vec<[f64; 3]>) {
    let ends = if is_circle { [b, c, a] } else { [b, c, c] };
    let inner = plane_of(a, b, c).and_then(|[along, across]| {
        let place = |p: [f64; 3]| [dot(minus(p, a), along), dot(minus(p, a), across)];
        let inner = between([a, b, c].map(place), is_circle)?;
        let back = |[u, v]: [f64; 2]| [0, 1, 2].map(|axis| a[axis] + along[axis] * u + across[axis] * v);
        Some(inner.into_iter().map(back).collect::<Vec<_>>())
    });
    match inner {
        Some(inner) => line.extend(inner.into_iter().chain([ends[2]])),
        None => line.extend(&ends[..if is_circle { 3 } else { 2 }]),
    }
}

/// Positions between the start and the end of an arc, or around the circle through three places; `None` if these are in a straight line.
fn between([a, b, c]: [[f64; 2]; 3], is_circle: bool) -> Option<Vec<[f64; 2]>> {
    let tau = std::f64::consts::TAU;
    let has_opposite = a == c;
    let [x, y] = if has_opposite { [(a[0] + b[0]) / 2.0, (a[1] + b[1]) / 2.0] } else { centre_of(a, b, c)? };
    let angle = |p: [f64; 2]| libm::atan2(p[1] - y, p[0] - x);
    let radius = libm::hypot(a[0] - x, a[1] - y);
    let (start, middle) = (angle(a), (angle(b) - angle(a)).rem_euclid(tau));
    let to_end = if has_opposite { tau } else { (angle(c) - start).rem_euclid(tau) };
    let sweep = match (middle > to_end, is_circle) {
        (false, true) => tau,
        (true, true) => -tau,
        (false, false) => to_end,
        (true, false) => to_end - tau,
    };
    if !(radius.is_finite() && sweep.is_finite()) {
        return None;
    }
    let steps = (sweep.abs() / tau * CIRCLE_SEGMENTS).ceil().clamp(2.0, CIRCLE_SEGMENTS);
    let place = |step: u32| {
        let (sin, cos) = libm::sincos(start + sweep * f64::from(step) / steps);
        [x + radius * cos, y + radius * sin]
    };
    Some((1..steps as u32).map(place).collect())
}

/// Centre of the circle through three places; `None` if they are in a straight line.
fn centre_of(a: [f64; 2], b: [f64; 2], c: [f64; 2]) -> Option<[f64; 2]> {
    let (bx, by, cx, cy) = (b[0] - a[0], b[1] - a[1], c[0] - a[0], c[1] - a[1]);
    let cross = 2.0 * (bx * cy - by * cx);
    let (b2, c2) = (bx * bx + by * by, cx * cx + cy * cy);
    if cross.abs() <= 1e-9 * (b2 + c2) {
        return None;
    }
    let centre = [a[0] + (cy * b2 - by * c2) / cross, a[1] + (bx * c2 - cx * b2) / cross];
    centre.iter().all(|value| value.is_finite()).then_some(centre)
}

/// Two directions at a right angle in the plane of three positions; `None` if they are in a straight line.
fn plane_of(a: [f64; 3], b: [f64; 3], c: [f64; 3]) -> Option<[[f64; 3]; 2]> {
    let along = unit(minus(b, a))?;
    let to_c = minus(c, a);
    let part = dot(to_c, along);
    let across = unit([0, 1, 2].map(|axis| to_c[axis] - along[axis] * part))?;
    Some([along, across])
}

fn minus(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn unit(vector: [f64; 3]) -> Option<[f64; 3]> {
    let length = libm::sqrt(dot(vector, vector));
    (length.is_finite() && length > 0.0).then(|| vector.map(|value| value / length))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arcs_keep_their_ends_side_and_radius() {
        let half = divide_arcs(&[[0.0, 0.0, 0.0], [1.0, 1.0, 0.0], [2.0, 0.0, 2.0]]);
        assert_eq!((half[0], *half.last().unwrap()), ([0.0, 0.0, 0.0], [2.0, 0.0, 2.0]));
        assert_eq!((half.len(), half[9][2]), (46, 0.4));
        assert!(half.iter().all(|[x, y, _]| ((x - 1.0).hypot(*y) - 1.0).abs() < 1e-12 && *y >= 0.0), "{half:?}");
        let below = divide_arcs(&[[0.0, 0.0, 0.0], [1.0, -1.0, 0.0], [2.0, 0.0, 0.0]]);
        assert!(below.iter().all(|[_, y, _]| *y <= 0.0));
        let circle = divide_arcs(&[[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 0.0, 0.0]]);
        assert_eq!(circle.len(), 91);
        let straight = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]];
        assert_eq!(divide_arcs(&straight), straight);
        let broken = [[0.0, 0.0, 0.0], [f64::NAN, 0.0, 0.0], [2.0, f64::INFINITY, 0.0], [3.0, 0.0, 0.0]];
        assert!(divide_arcs(&broken).len() < 10 && divide_arcs_in_space(&broken).len() < 10);
        assert!(divide_arcs(&[]).is_empty());
    }

    #[test]
    fn arcs_in_space_lie_in_their_plane() {
        let radius = |p: &[f64; 3]| libm::sqrt(dot(minus(*p, [5.0, 0.0, 3.0]), minus(*p, [5.0, 0.0, 3.0])));
        // Above a door.
        let arch = divide_arcs_in_space(&[[4.0, 0.0, 3.0], [5.0, 0.0, 4.0], [6.0, 0.0, 3.0]]);
        assert_eq!((arch.len(), arch[0], arch[45]), (46, [4.0, 0.0, 3.0], [6.0, 0.0, 3.0]));
        assert!(arch.iter().all(|p| (radius(p) - 1.0).abs() < 1e-12 && p[1].abs() < 1e-12 && p[2] > 3.0 - 1e-12));
        for controls in
            [[[4.0, 0.0, 3.0], [5.0, 1.0, 3.0], [6.0, 0.0, 3.0]], [[4.0, 0.0, 3.0], [5.0, 1.0, 3.0], [5.0, -1.0, 3.0]]]
        {
            let round = circle_in_space(controls);
            assert_eq!((round.len(), round[0], round[90]), (91, controls[0], controls[0]));
            assert!(round.iter().all(|p| (radius(p) - 1.0).abs() < 1e-12));
            assert!(round[20][1] > 0.5 && round[70][1] < -0.5, "from the first to the second");
        }
        let straight = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]];
        assert_eq!(divide_arcs_in_space(&straight), straight);
    }
}
