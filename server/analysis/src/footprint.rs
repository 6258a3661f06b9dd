//! What a model covers on the map, if that is one area with a plain border.

use insula_export::selection::Polygon;
use std::collections::{BTreeMap, BTreeSet};

/// Each edge is compared with all others.
const MAX_CORNERS: usize = 500;

/// A place in millimetres, so that the corners of neighbours are equal.
type Place = [i64; 2];

/// The border of the faces of a model that look upwards. `None` if they lie upon each other, have several borders or too many corners.
pub(crate) fn footprint(triangles: &[[[f64; 3]; 3]]) -> Option<Polygon> {
    let mut edges: BTreeSet<(Place, Place)> = BTreeSet::new();
    for triangle in triangles {
        let [a, b, c] = triangle.map(|[x, y, _]| [x, y].map(|v| (v * 1000.0).round() as i64));
        if turn(a, b, c) <= 0.0 {
            continue;
        }
        for (from, to) in [(a, b), (b, c), (c, a)] {
            let has_neighbour = edges.remove(&(to, from));
            if !has_neighbour && !edges.insert((from, to)) {
                return None;
            }
        }
    }
    let next: BTreeMap<Place, Place> = edges.iter().copied().collect();
    let start = *next.keys().next()?;
    let mut ring = vec![start];
    while let Some(at) = next.get(ring.last()?).filter(|at| **at != start) {
        if ring.len() == MAX_CORNERS {
            return None;
        }
        ring.push(*at);
    }
    // Else there are several rings, or some that meet at a corner.
    let is_one = ring.len() == edges.len();
    (is_one && !crosses_itself(&ring))
        .then(|| vec![ring.iter().map(|place| place.map(|mm| mm as f64 / 1000.0)).collect()])
}

/// Twice the area of a triangle, above 0 counter-clockwise.
fn turn(a: Place, b: Place, c: Place) -> f64 {
    let to = |p: Place| [0, 1].map(|k| p[k] as f64 - a[k] as f64);
    let ([bx, by], [cx, cy]) = (to(b), to(c));
    bx * cy - by * cx
}

fn crosses_itself(ring: &[Place]) -> bool {
    let edge = |i: usize| (ring[i], ring[(i + 1) % ring.len()]);
    let parts = |(a, b): (Place, Place), (c, d): (Place, Place)| turn(a, b, c) * turn(a, b, d) < 0.0;
    let cross = |i: usize, j: usize| parts(edge(i), edge(j)) && parts(edge(j), edge(i));
    (0..ring.len()).any(|i| (0..i).any(|j| cross(i, j)))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two triangles for each face of a box, all seen from outside.
    fn block([x0, y0, z0]: [f64; 3], [x1, y1, z1]: [f64; 3]) -> Vec<[[f64; 3]; 3]> {
        let quad = |[a, b, c, d]: [[f64; 3]; 4]| [[a, b, c], [a, c, d]];
        let level = |z: f64| [[x0, y0, z], [x1, y0, z], [x1, y1, z], [x0, y1, z]];
        let (floor, roof) = (level(z0), level(z1));
        let wall = |i: usize| quad([floor[i], floor[(i + 1) % 4], roof[(i + 1) % 4], roof[i]]);
        let [a, b, c, d] = floor;
        (0..4).flat_map(wall).chain(quad(roof)).chain(quad([a, d, c, b])).collect()
    }

    #[test]
    fn a_box_covers_its_roof_and_an_odd_model_has_no_plain_border() {
        let low = block([1.0, 2.0, 0.0], [5.0, 8.0, 9.0]);
        assert_eq!(footprint(&low), Some(vec![vec![[1.0, 2.0], [5.0, 2.0], [5.0, 8.0], [1.0, 8.0]]]));
        // A gable: both slopes meet at the ridge.
        let [a, b, c, d] = [[0.0, 0.0], [4.0, 0.0], [4.0, 6.0], [0.0, 6.0]].map(|[x, y]| [x, y, 3.0]);
        let ridge = [[2.0, 0.0, 5.0], [2.0, 6.0, 5.0]];
        let slopes = [[a, ridge[0], ridge[1]], [a, ridge[1], d], [ridge[0], b, c], [ridge[0], c, ridge[1]]];
        assert_eq!(footprint(&slopes).unwrap()[0].len(), 6);
        let chimney = block([2.0, 3.0, 9.0], [3.0, 4.0, 11.0]);
        assert_eq!(footprint(&[low, chimney].concat()), None, "two borders");
        assert_eq!((footprint(&[]), footprint(&[[a, c, b]])), (None, None), "no face looks upwards");
        assert!(
            crosses_itself(&[[0, 0], [4, 4], [4, 0], [0, 4]]) && !crosses_itself(&[[0, 0], [4, 0], [4, 4], [0, 4]])
        );
    }
}
