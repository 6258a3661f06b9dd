//! Posts below a roof without walls.

use super::prism::GroundPlan;

/// Lower roofs have no posts.
const MIN_HEIGHT_M: f64 = 0.5;
/// Side of a post, and distance of its middle from the edges of the roof.
const SIDE_M: f64 = 0.2;
const INSET_M: f64 = 0.25;
/// Corners at which the outline turns by less have no post: the sine of 20 degrees.
const MIN_TURN: f64 = 0.34;
/// Posts are at least so far apart, and along an edge at most so far.
const MIN_DISTANCE_M: f64 = 1.0;
const MAX_DISTANCE_M: f64 = 9.0;
/// More posts of one roof are left out.
const MAX_POSTS: usize = 64;

/// The posts of a height below a roof, as plans: one at each corner of the outline that turns inward, and between those that are far
/// apart.
pub fn posts(roof: &GroundPlan, height_m: f64) -> Vec<GroundPlan> {
    let Some(ring) = roof.rings.first().filter(|_| height_m >= MIN_HEIGHT_M) else { return Vec::new() };
    let mut places: Vec<[f64; 2]> = Vec::new();
    let mut add = |place: [f64; 2]| {
        let is_free =
            places.iter().all(|other| libm::hypot(other[0] - place[0], other[1] - place[1]) >= MIN_DISTANCE_M);
        if places.len() < MAX_POSTS && is_free && has_room(ring, place) {
            places.push(place);
        }
    };
    let corner = |i: usize| ring[i % ring.len()];
    // From the last post along the outline.
    let mut since_m = 0.0;
    for i in 0..ring.len() {
        let (Some(before), Some(after)) =
            (inward(corner(i + ring.len() - 1), corner(i)), inward(corner(i), corner(i + 1)))
        else {
            continue;
        };
        let (at, next) = (corner(i), corner(i + 1));
        let length_m = libm::hypot(next[0] - at[0], next[1] - at[1]);
        let turn = before[0] * after[1] - before[1] * after[0];
        if turn >= MIN_TURN || turn >= 0.0 && since_m + length_m > MAX_DISTANCE_M {
            since_m = 0.0;
            let sum = [before[0] + after[0], before[1] + after[1]];
            // At this distance from both edges.
            let scale = INSET_M * 2.0 / (sum[0] * sum[0] + sum[1] * sum[1]);
            add([at[0] + sum[0] * scale, at[1] + sum[1] * scale]);
        }
        since_m += length_m;
        let steps = (length_m / MAX_DISTANCE_M).ceil().min(MAX_POSTS as f64) as u32;
        for step in 1..steps {
            let share = f64::from(step) / f64::from(steps);
            add([0, 1].map(|axis| at[axis] + (next[axis] - at[axis]) * share + after[axis] * INSET_M));
        }
    }
    let half = SIDE_M / 2.0;
    let square =
        |[x, y]: [f64; 2]| vec![[x - half, y - half], [x + half, y - half], [x + half, y + half], [x - half, y + half]];
    places.into_iter().map(|place| GroundPlan { rings: vec![square(place)] }).collect()
}

/// Unit vector to the left of an edge, which is the inside; `None` of an edge without length.
fn inward(a: [f64; 2], b: [f64; 2]) -> Option<[f64; 2]> {
    let length = libm::hypot(b[0] - a[0], b[1] - a[1]);
    (length > 0.0).then(|| [(a[1] - b[1]) / length, (b[0] - a[0]) / length])
}

/// Whether a post is within the outline.
fn has_room(ring: &[[f64; 2]], [x, y]: [f64; 2]) -> bool {
    let edges = ring.iter().zip(ring.iter().cycle().skip(1));
    let crossings =
        edges.filter(|([ax, ay], [bx, by])| (*ay > y) != (*by > y) && ax + (y - ay) / (by - ay) * (bx - ax) > x);
    crossings.count() % 2 == 1
}

#[cfg(test)]
mod tests {
    use super::*;

    fn places(ring: &[[f64; 2]], height_m: f64) -> Vec<[f64; 2]> {
        let found = posts(&GroundPlan { rings: vec![ring.to_vec()] }, height_m);
        found.iter().map(|post| [0, 1].map(|axis| (post.rings[0][0][axis] + post.rings[0][2][axis]) / 2.0)).collect()
    }

    #[test]
    fn posts_are_at_corners_and_along_long_edges() {
        let long = [[0.0, 0.0], [5.0, 0.0], [20.0, 0.0], [20.0, 6.0], [0.0, 6.0]];
        let found = places(&long, 4.0);
        assert_eq!(found.len(), 4 + 2 + 2, "{found:?}");
        assert!(found.iter().all(|[x, y]| (0.1..19.9).contains(x) && (0.1..5.9).contains(y)), "{found:?}");
        assert!((found[0][0] - 0.25).abs() < 1e-9 && (found[0][1] - 0.25).abs() < 1e-9);
        assert!(places(&long, 0.3).is_empty());
        assert_eq!(places(&[[0.0, 0.0], [1.0, 0.0], [1.0, 0.8], [0.0, 0.8]], 2.0).len(), 1, "too near to each other");
    }

    #[test]
    fn a_round_roof_has_posts_around_it() {
        let round: Vec<[f64; 2]> = (0..64)
            .map(|i| {
                let (sin, cos) = libm::sincos(f64::from(i) / 64.0 * std::f64::consts::TAU);
                [30.0 * cos, 30.0 * sin]
            })
            .collect();
        assert!(places(&round, 4.0).len() >= 8, "{:?}", places(&round, 4.0));
    }
}
