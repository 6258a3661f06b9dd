//! Whether visible parts overlap: a check of all pairs.

use crate::{
    convex::{PagePoint, PageRect},
    warnock::VisiblePart,
};
use rayon::prelude::*;

/// Most buckets along a side of the page.
const MAX_BUCKETS: usize = 512;

/// The largest area that two of the parts share, in square units. Parts of translucent surfaces lie over others and must not be among
/// them.
pub(crate) fn largest_overlap(parts: &[&VisiblePart], frame: PageRect) -> f64 {
    let bounds: Vec<PageRect> = parts.iter().map(|part| PageRect::of(&part.shape.points)).collect();
    let side = ((parts.len() as f64).sqrt() / 2.0).ceil().clamp(1.0, MAX_BUCKETS as f64) as usize;
    let buckets = Buckets { frame, side };
    let mut members: Vec<Vec<u32>> = vec![Vec::new(); side * side];
    for (index, rect) in bounds.iter().enumerate() {
        let ([x0, y0], [x1, y1]) = (buckets.of(rect.min), buckets.of(rect.max));
        for y in y0..=y1 {
            members[y * side + x0..=y * side + x1].iter_mut().for_each(|bucket| bucket.push(index as u32));
        }
    }
    let largest_in = |(bucket, members): (usize, &Vec<u32>)| {
        let mut largest = 0.0f64;
        for (k, a) in members.iter().enumerate() {
            for b in &members[k + 1..] {
                let (a, b) = (*a as usize, *b as usize);
                let corner = PagePoint::new(bounds[a].min.x.max(bounds[b].min.x), bounds[a].min.y.max(bounds[b].min.y));
                // Of the buckets that have both, the one with the lower left corner of what they share compares them.
                let [x, y] = buckets.of(corner);
                if bounds[a].overlaps(&bounds[b]) && y * side + x == bucket {
                    largest = largest.max(shared_area(&parts[a].shape.points, &parts[b].shape.points));
                }
            }
        }
        largest
    };
    members.par_iter().enumerate().map(largest_in).reduce(|| 0.0, f64::max)
}

/// Squares of the page.
struct Buckets {
    frame: PageRect,
    /// Along a side.
    side: usize,
}

impl Buckets {
    fn of(&self, p: PagePoint) -> [usize; 2] {
        let PageRect { min, max } = self.frame;
        [(p.x, min.x, max.x), (p.y, min.y, max.y)].map(|(v, low, high)| {
            let share = (i64::from(v) - i64::from(low)) as f64 / (i64::from(high) - i64::from(low)).max(1) as f64;
            ((share * self.side as f64).max(0.0) as usize).min(self.side - 1)
        })
    }
}

/// The area that two convex polygons share, in square units.
pub(crate) fn shared_area(a: &[PagePoint], b: &[PagePoint]) -> f64 {
    let first = a[0];
    let near =
        |p: &PagePoint| [i64::from(p.x) - i64::from(first.x), i64::from(p.y) - i64::from(first.y)].map(|v| v as f64);
    let mut rest: Vec<[f64; 2]> = a.iter().map(near).collect();
    let clip: Vec<[f64; 2]> = b.iter().map(near).collect();
    for k in 0..clip.len() {
        let (p, q) = (clip[k], clip[(k + 1) % clip.len()]);
        let side = |r: [f64; 2]| (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]);
        let mut left = Vec::with_capacity(rest.len() + 1);
        for i in 0..rest.len() {
            let (r, s) = (rest[i], rest[(i + 1) % rest.len()]);
            let (at_r, at_s) = (side(r), side(s));
            if at_r >= 0.0 {
                left.push(r);
            }
            if (at_r > 0.0 && at_s < 0.0) || (at_r < 0.0 && at_s > 0.0) {
                let share = at_r / (at_r - at_s);
                left.push([0, 1].map(|axis| r[axis] + share * (s[axis] - r[axis])));
            }
        }
        rest = left;
        if rest.len() < 3 {
            return 0.0;
        }
    }
    let doubled = |k: usize| {
        let (r, s) = (rest[k], rest[(k + 1) % rest.len()]);
        r[0] * s[1] - s[0] * r[1]
    };
    0.5 * (0..rest.len()).map(doubled).sum::<f64>().abs()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::convex::Convex;

    fn part(points: &[[i32; 2]]) -> VisiblePart {
        let points: Vec<PagePoint> = points.iter().map(|[x, y]| PagePoint::new(*x, *y)).collect();
        VisiblePart { polygon: 0, cell: PagePoint::new(0, 0), shape: Convex { edges: vec![0; points.len()], points } }
    }

    fn square(x: i32, y: i32, side: i32) -> VisiblePart {
        part(&[[x, y], [x + side, y], [x + side, y + side], [x, y + side]])
    }

    #[test]
    fn the_largest_pair_is_found_wherever_it_is() {
        let frame = PageRect { min: PagePoint::new(0, 0), max: PagePoint::new(100_000, 100_000) };
        let mut parts: Vec<VisiblePart> = (0..400).map(|k| square(5_000 * (k % 20), 5_000 * (k / 20), 5_000)).collect();
        let largest = |parts: &[VisiblePart]| largest_overlap(&parts.iter().collect::<Vec<_>>(), frame);
        assert_eq!(largest(&parts), 0.0, "neighbours share borders only");
        parts.push(part(&[[-7, 50_000], [9, 50_000], [9, 50_003], [-7, 50_003]]));
        let is_about = |area: f64, expected: f64| (area - expected).abs() < 1e-3;
        assert!(is_about(largest(&parts), 27.0));
        parts.push(part(&[[99_990, 99_990], [100_020, 99_990], [99_990, 100_020]]));
        assert!(is_about(largest(&parts), 100.0));
        parts.push(square(2_500, 2_500, 5_000));
        assert!(is_about(largest(&parts), 2_500.0 * 2_500.0));
    }
}
