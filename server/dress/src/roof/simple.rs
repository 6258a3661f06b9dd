//! Tests of polygons in the plane.

use glam::DVec2;

/// Edges that turn back on themselves by less than this sine are a spike.
pub(super) const SPIKE_SINE: f64 = 1e-7;

/// Signed area of a ring, positive if counter-clockwise.
pub(super) fn area(ring: &[DVec2]) -> f64 {
    let Some(&first) = ring.first() else { return 0.0 };
    ring.windows(2).map(|pair| (pair[0] - first).perp_dot(pair[1] - first)).sum::<f64>() / 2.0
}

/// Whether a point is inside of rings, by the even-odd rule.
pub(super) fn contains(rings: &[Vec<DVec2>], point: DVec2) -> bool {
    let mut is_inside = false;
    for (a, b) in rings.iter().flat_map(|ring| edges(ring)) {
        if (a.y > point.y) != (b.y > point.y) && point.x < a.x + (point.y - a.y) / (b.y - a.y) * (b.x - a.x) {
            is_inside = !is_inside;
        }
    }
    is_inside
}

/// Edges of a ring as pairs of corners.
pub(super) fn edges(ring: &[DVec2]) -> impl Iterator<Item = (DVec2, DVec2)> + '_ {
    ring.iter().enumerate().map(|(i, &corner)| (corner, ring[(i + 1) % ring.len()]))
}

struct Edge {
    from: DVec2,
    to: DVec2,
    ring: usize,
    index: usize,
}

/// Whether rings neither cross nor touch themselves or each other. Edges nearer than `touch` are taken as touching;
/// a negative `touch` allows for crossings and contacts of that depth.
pub(super) fn is_simple(rings: &[Vec<DVec2>], touch: f64) -> bool {
    let mut all: Vec<Edge> = Vec::new();
    for (ring, corners) in rings.iter().enumerate() {
        all.extend(edges(corners).enumerate().map(|(index, (from, to))| Edge { from, to, ring, index }));
    }
    all.sort_by(|a, b| a.from.x.min(a.to.x).total_cmp(&b.from.x.min(b.to.x)));
    for (i, a) in all.iter().enumerate() {
        let right = a.from.x.max(a.to.x) + touch;
        for b in all[i + 1..].iter().take_while(|b| b.from.x.min(b.to.x) <= right) {
            let corners = rings[a.ring].len();
            let meet = if a.ring == b.ring && (a.index + 1) % corners == b.index {
                is_spike(a, b)
            } else if a.ring == b.ring && (b.index + 1) % corners == a.index {
                is_spike(b, a)
            } else {
                do_meet(a, b, touch)
            };
            if meet {
                return false;
            }
        }
    }
    true
}

fn is_spike(a: &Edge, b: &Edge) -> bool {
    let (u, v) = (a.to - a.from, b.to - b.from);
    u.dot(v) < 0.0 && u.perp_dot(v).abs() <= SPIKE_SINE * u.length() * v.length()
}

/// Whether two edges without a common corner cross, or are nearer than `touch`. With a negative `touch`: whether each has
/// corners farther than that on both sides of the other.
fn do_meet(a: &Edge, b: &Edge, touch: f64) -> bool {
    let (a_low, a_high) = (a.from.min(a.to), a.from.max(a.to));
    let (b_low, b_high) = (b.from.min(b.to), b.from.max(b.to));
    if (b_low - a_high).max_element() > touch || (a_low - b_high).max_element() > touch {
        return false;
    }
    let sides = |line: &Edge, other: &Edge| {
        let direction = (line.to - line.from).normalize_or_zero();
        [other.from, other.to].map(|corner| direction.perp_dot(corner - line.from))
    };
    let margin = (-touch).max(0.0);
    let is_across = |[s, t]: [f64; 2]| s > margin && t < -margin || s < -margin && t > margin;
    if is_across(sides(a, b)) && is_across(sides(b, a)) {
        return true;
    }
    let is_near = |edge: &Edge, corner: DVec2| distance(edge.from, edge.to, corner) <= touch;
    touch >= 0.0 && (is_near(a, b.from) || is_near(a, b.to) || is_near(b, a.from) || is_near(b, a.to))
}

pub(super) fn distance(from: DVec2, to: DVec2, point: DVec2) -> f64 {
    let along = to - from;
    let share = ((point - from).dot(along) / along.length_squared()).clamp(0.0, 1.0);
    if share.is_nan() { from.distance(point) } else { point.distance(from + share * along) }
}
