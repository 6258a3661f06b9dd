//! Which rings are in which: outer rings with their holes. Rings touch at most.

use super::element::Position;
use insula_source::ring_inside::point_inside;

/// Rings of a polygon, the outer one first, each closed by its first position.
pub(super) type Polygon = Vec<Vec<Position>>;

/// Crossings that are counted for one multipolygon; those of a hostile one would take hours.
const MAX_STEPS: u64 = 1 << 31;

/// A segment of a ring that is not level, from its lower to its upper end.
struct Edge {
    low: Position,
    high: Position,
    ring: u32,
}

/// What is known of a ring.
#[derive(Clone)]
struct Nest {
    /// Number of rings around it.
    depth: u32,
    /// The smallest ring around it.
    around: Option<u32>,
    area: f64,
}

/// Groups closed rings that do not cross to polygons: a ring in an odd number of others is a hole of the smallest of them.
/// Fails with the reason if there is too much to count.
pub(super) fn group(rings: Vec<Vec<Position>>) -> Result<Vec<Polygon>, &'static str> {
    if rings.len() == 1 {
        return Ok(vec![rings]);
    }
    let nests = nest(&rings)?;
    let mut polygon_of = vec![None; rings.len()];
    let mut polygons: Vec<Polygon> = Vec::new();
    let mut holes = Vec::new();
    for (i, ring) in rings.into_iter().enumerate() {
        if nests[i].depth % 2 == 0 {
            polygon_of[i] = Some(polygons.len());
            polygons.push(vec![ring]);
        } else {
            holes.push((nests[i].around, ring));
        }
    }
    for (around, hole) in holes {
        let polygon = around.and_then(|around| polygon_of[around as usize]);
        if let Some(polygon) = polygon {
            polygons[polygon].push(hole);
        }
    }
    Ok(polygons)
}

/// Sweeps upwards over a place inside of each ring, counting the edges left of it.
fn nest(rings: &[Vec<Position>]) -> Result<Vec<Nest>, &'static str> {
    let mut edges = Vec::new();
    let mut points: Vec<([i64; 2], u32)> = Vec::new();
    for (number, ring) in rings.iter().enumerate() {
        let ring_edges = ring.windows(2).filter(|pair| pair[0][1] != pair[1][1]).map(|pair| {
            let (low, high) = if pair[0][1] < pair[1][1] { (pair[0], pair[1]) } else { (pair[1], pair[0]) };
            Edge { low, high, ring: number as u32 }
        });
        edges.extend(ring_edges);
        // Nodes and edges of a hole may be on its outer ring, or a little outside. In units of half the size.
        let on_map: Vec<[f64; 2]> = ring.iter().map(|position| position.map(f64::from)).collect();
        if let Some(point) = point_inside(&on_map) {
            points.push((point.map(|v| (2.0 * v).round() as i64), number as u32));
        }
    }
    edges.sort_unstable_by_key(|edge| edge.low[1]);
    points.sort_unstable_by_key(|(point, _)| point[1]);
    let mut nests: Vec<Nest> =
        rings.iter().map(|ring| Nest { depth: 0, around: None, area: area(ring).abs() }).collect();
    let (mut next, mut steps) = (0, 0);
    let mut active: Vec<&Edge> = Vec::new();
    let mut is_odd = vec![false; rings.len()];
    for ([x, y], number) in points {
        while let Some(edge) = edges.get(next).filter(|edge| 2 * i64::from(edge.low[1]) <= y) {
            active.push(edge);
            next += 1;
        }
        active.retain(|edge| 2 * i64::from(edge.high[1]) > y);
        steps += active.len() as u64;
        if steps > MAX_STEPS {
            return Err("multipolygon too complex");
        }
        let left = || active.iter().filter(|edge| edge.ring != number && is_left(edge, [x, y]));
        left().for_each(|edge| is_odd[edge.ring as usize] ^= true);
        for edge in left() {
            // Each ring once: its mark is taken back. A smaller one around the place is within this ring.
            let is_around = std::mem::take(&mut is_odd[edge.ring as usize]);
            if is_around && nests[edge.ring as usize].area > nests[number as usize].area {
                let is_smaller = nests[number as usize]
                    .around
                    .is_none_or(|around| nests[edge.ring as usize].area < nests[around as usize].area);
                let nest = &mut nests[number as usize];
                nest.depth += 1;
                if is_smaller {
                    nest.around = Some(edge.ring);
                }
            }
        }
    }
    Ok(nests)
}

/// Whether an edge is left of a point at the same height, which is in units of half the size.
fn is_left(edge: &Edge, [x, y]: [i64; 2]) -> bool {
    let [x0, y0, x1, y1] = [edge.low[0], edge.low[1], edge.high[0], edge.high[1]].map(|v| 2 * i128::from(v));
    (x1 - x0) * (i128::from(y) - y0) < (i128::from(x) - x0) * (y1 - y0)
}

/// Signed area in square units, positive if counter-clockwise.
pub(super) fn area(ring: &[Position]) -> f64 {
    let Some(origin) = ring.first() else { return 0.0 };
    let from = |p: &Position| [0, 1].map(|axis| (i64::from(p[axis]) - i64::from(origin[axis])) as f64);
    ring.windows(2).map(|pair| (from(&pair[0]), from(&pair[1]))).map(|(a, b)| a[0] * b[1] - a[1] * b[0]).sum::<f64>()
        / 2.0
}
