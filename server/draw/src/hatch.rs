//! Hatching: parallel lines inside a shape.

use crate::convex::PagePoint;
use crate::join::Rings;
use crate::style::Hatch;

/// Most lines across a shape; a denser hatching is left out.
const MAX_LINES: f64 = 20_000.0;

/// The lines of a hatching inside `rings`. Lines of neighbouring shapes meet, because all are multiples of the spacing from the
/// middle of the page.
pub(crate) fn hatched(rings: &Rings, hatch: &Hatch, units_per_mm: f64) -> Vec<Vec<PagePoint>> {
    let (sin, cos) = hatch.angle.to_radians().sin_cos();
    let spacing = hatch.spacing * units_per_mm;
    let along =
        |p: PagePoint| [f64::from(p.x) * cos + f64::from(p.y) * sin, f64::from(p.y) * cos - f64::from(p.x) * sin];
    let back =
        |[u, v]: [f64; 2]| PagePoint::new((u * cos - v * sin).round() as i32, (u * sin + v * cos).round() as i32);
    let turned: Vec<Vec<[f64; 2]>> = rings.iter().map(|ring| ring.iter().map(|p| along(*p)).collect()).collect();
    let [low, high] = turned
        .iter()
        .flatten()
        .fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], [_, v]| [low.min(*v), high.max(*v)]);
    let (first, last) = ((low / spacing).ceil(), (high / spacing).floor());
    if !(last >= first && last - first < MAX_LINES) {
        return Vec::new();
    }
    let mut crossings: Vec<Vec<f64>> = vec![Vec::new(); (last - first) as usize + 1];
    for ring in &turned {
        for i in 0..ring.len() {
            let ([u0, v0], [u1, v1]) = (ring[i], ring[(i + 1) % ring.len()]);
            let (below, above) = (v0.min(v1), v0.max(v1));
            let mut line = (below / spacing).ceil().max(first);
            // A line that passes through a point meets one of its two edges.
            while line * spacing < above && line <= last {
                let share = (line * spacing - v0) / (v1 - v0);
                crossings[(line - first) as usize].push(u0 + (u1 - u0) * share);
                line += 1.0;
            }
        }
    }
    let mut lines = Vec::new();
    for (k, crossings) in crossings.iter_mut().enumerate() {
        let v = (first + k as f64) * spacing;
        crossings.sort_by(f64::total_cmp);
        lines.extend(crossings.chunks_exact(2).map(|pair| vec![back([pair[0], v]), back([pair[1], v])]));
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_square_with_a_hole_is_hatched_beside_it() {
        let square = |low: i32, high: i32| {
            [[low, low], [high, low], [high, high], [low, high]].map(|[x, y]| PagePoint::new(x, y)).to_vec()
        };
        let mut hole = square(3000, 7000);
        hole.reverse();
        let hatch = Hatch { spacing: 1.0, angle: 0.0, width: 0.1 };
        let lines = hatched(&vec![square(500, 9500), hole], &hatch, 1000.0);
        assert_eq!(lines.len(), 9 + 4);
        let length: i32 = lines.iter().map(|line| line[1].x - line[0].x).sum();
        assert_eq!(length, 5 * 9000 + 4 * 5000);
        let diagonal = hatched(&vec![square(0, 1000)], &Hatch { angle: 45.0, ..hatch }, 1000.0);
        assert_eq!(diagonal.len(), 1);
    }
}
