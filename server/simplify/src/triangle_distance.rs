//! Distance of a point from a triangle.

use glam::DVec3;

/// Squared distance of a point from a triangle (Ericson 2005, "Real-Time Collision Detection", 5.1.5).
pub(crate) fn squared_distance(p: DVec3, [a, b, c]: [DVec3; 3]) -> f64 {
    let (ab, ac) = (b - a, c - a);
    let to = |q: DVec3| (p - q).length_squared();
    let (d1, d2) = (ab.dot(p - a), ac.dot(p - a));
    if d1 <= 0.0 && d2 <= 0.0 {
        return to(a);
    }
    let (d3, d4) = (ab.dot(p - b), ac.dot(p - b));
    if d3 >= 0.0 && d4 <= d3 {
        return to(b);
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        return to(a + ab * (d1 / (d1 - d3)));
    }
    let (d5, d6) = (ab.dot(p - c), ac.dot(p - c));
    if d6 >= 0.0 && d5 <= d6 {
        return to(c);
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        return to(a + ac * (d2 / (d2 - d6)));
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0 {
        return to(b + (c - b) * ((d4 - d3) / ((d4 - d3) + (d5 - d6))));
    }
    let sum = va + vb + vc;
    if sum <= 0.0 { to(a).min(to(b)).min(to(c)) } else { to(a + ab * (vb / sum) + ac * (vc / sum)) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distance_is_right_in_every_region_of_a_triangle() {
        let triangle = [DVec3::ZERO, DVec3::new(4.0, 0.0, 0.0), DVec3::new(0.0, 4.0, 0.0)];
        for (p, squared) in [
            ([1.0, 1.0, 3.0], 9.0),
            ([-3.0, -4.0, 0.0], 25.0),
            ([7.0, -4.0, 0.0], 25.0),
            ([-4.0, 7.0, 0.0], 25.0),
            ([2.0, -2.0, 0.0], 4.0),
            ([-2.0, 2.0, 0.0], 4.0),
            ([4.0, 4.0, 0.0], 8.0),
        ] {
            assert!((squared_distance(p.into(), triangle) - squared).abs() < 1e-12, "{p:?}");
        }
    }
}
