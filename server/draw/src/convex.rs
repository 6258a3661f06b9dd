//! Convex polygons on the page, with whole coordinates.
//!
//! A page is at most 2^30 units wide, so that products of differences fit into 64 bits. Where edges cross, the point is rounded to
//! the nearest unit, and it is the same for all polygons that share the edge.

use crate::face::NO_EDGE;
use i_overlay::i_float::int::point::IntPoint;

/// A place on the page.
pub(crate) type PagePoint = IntPoint<i32>;

/// A convex polygon on the page, up to rounding.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Convex {
    /// Counter-clockwise; at least three.
    pub(crate) points: Vec<PagePoint>,
    /// Name of the edge from each point to the next one.
    pub(crate) edges: Vec<u32>,
}

/// A rectangle on the page, borders included.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct PageRect {
    pub(crate) min: PagePoint,
    pub(crate) max: PagePoint,
}

impl PageRect {
    pub(crate) fn of(points: &[PagePoint]) -> Self {
        let first = points.first().copied().unwrap_or(PagePoint::new(0, 0));
        points.iter().fold(Self { min: first, max: first }, |Self { min, max }, p| Self {
            min: PagePoint::new(min.x.min(p.x), min.y.min(p.y)),
            max: PagePoint::new(max.x.max(p.x), max.y.max(p.y)),
        })
    }

    /// Whether the insides have a point in common.
    pub(crate) fn overlaps(&self, other: &Self) -> bool {
        self.min.x < other.max.x && other.min.x < self.max.x && self.min.y < other.max.y && other.min.y < self.max.y
    }

    pub(crate) fn corners(&self) -> [PagePoint; 4] {
        let (min, max) = (self.min, self.max);
        [min, PagePoint::new(max.x, min.y), max, PagePoint::new(min.x, max.y)]
    }

    /// Longer side in units.
    pub(crate) fn side(&self) -> i32 {
        (self.max.x - self.min.x).max(self.max.y - self.min.y)
    }

    /// Four parts of equal size.
    pub(crate) fn quarters(&self) -> [Self; 4] {
        let middle =
            PagePoint::new(self.min.x + (self.max.x - self.min.x) / 2, self.min.y + (self.max.y - self.min.y) / 2);
        let (min, max) = (self.min, self.max);
        [
            Self { min, max: middle },
            Self { min: PagePoint::new(middle.x, min.y), max: PagePoint::new(max.x, middle.y) },
            Self { min: PagePoint::new(min.x, middle.y), max: PagePoint::new(middle.x, max.y) },
            Self { min: middle, max },
        ]
    }
}

/// Twice the area between a line and a point: positive to the left of it.
pub(crate) fn cross(a: PagePoint, b: PagePoint, p: PagePoint) -> i64 {
    let d = |p: i32, q: i32| i64::from(q) - i64::from(p);
    d(a.x, b.x) * d(a.y, p.y) - d(a.y, b.y) * d(a.x, p.x)
}

/// [`cross`] of a point one unit away from the line. Nearer points count as on the line.
fn on_line(a: PagePoint, b: PagePoint) -> i64 {
    let d = |p: i32, q: i32| f64::from(q) - f64::from(p);
    d(a.x, b.x).hypot(d(a.y, b.y)).ceil() as i64
}

impl Convex {
    pub(crate) fn twice_area(&self) -> i64 {
        self.points.windows(2).map(|pair| cross(self.points[0], pair[0], pair[1])).sum()
    }

    fn sides(&self) -> impl Iterator<Item = (PagePoint, PagePoint)> {
        (0..self.points.len()).map(|i| (self.points[i], self.points[(i + 1) % self.points.len()]))
    }

    /// Whether all of a rectangle is inside.
    pub(crate) fn covers(&self, rect: &PageRect) -> bool {
        self.sides().all(|(a, b)| rect.corners().iter().all(|p| cross(a, b, *p) >= 0))
    }

    /// Whether a side has all of a rectangle on its outer side.
    pub(crate) fn misses(&self, rect: &PageRect) -> bool {
        self.sides().any(|(a, b)| rect.corners().iter().all(|p| cross(a, b, *p) <= 0))
    }

    /// The parts to the left and to the right of a line. Parts narrower than a unit are dropped.
    fn split(&self, a: PagePoint, b: PagePoint) -> [Option<Self>; 2] {
        let near = on_line(a, b);
        let sides: Vec<i64> = self.points.iter().map(|p| cross(a, b, *p)).collect();
        if sides.iter().all(|side| *side <= near) {
            return [None, Some(self.clone())];
        }
        if sides.iter().all(|side| *side >= -near) {
            return [Some(self.clone()), None];
        }
        let empty = || Self { points: Vec::with_capacity(sides.len() + 1), edges: Vec::with_capacity(sides.len() + 1) };
        let mut parts = [empty(), empty()];
        for i in 0..sides.len() {
            let j = (i + 1) % sides.len();
            for (part, sign) in parts.iter_mut().zip([1, -1]) {
                let (here, next) = (sign * sides[i], sign * sides[j]);
                if here >= -near {
                    part.points.push(self.points[i]);
                    part.edges.push(if here <= near && next < -near { NO_EDGE } else { self.edges[i] });
                }
                if here.abs() > near && next.abs() > near && (here > 0) != (next > 0) {
                    part.points.push(crossing((self.points[i], sides[i]), (self.points[j], sides[j])));
                    part.edges.push(if here > 0 { NO_EDGE } else { self.edges[i] });
                }
            }
        }
        parts.map(|part| (part.points.len() >= 3 && part.twice_area() > 0).then_some(part))
    }

    /// The part inside a rectangle.
    pub(crate) fn clipped(&self, rect: &PageRect) -> Option<Self> {
        let corners = rect.corners();
        let mut rest = self.clone();
        for i in 0..4 {
            let [inside, _] = rest.split(corners[i], corners[(i + 1) % 4]);
            rest = inside?;
        }
        Some(rest)
    }

    /// Adds the parts outside of another polygon to `out`.
    pub(crate) fn subtract(self, other: &Self, out: &mut Vec<Self>) {
        let is_outside = |(a, b): (PagePoint, PagePoint)| self.points.iter().all(|p| cross(a, b, *p) <= on_line(a, b));
        if other.sides().any(is_outside) {
            out.push(self);
            return;
        }
        let mut rest = self;
        for (a, b) in other.sides() {
            let [inside, outside] = rest.split(a, b);
            out.extend(outside);
            match inside {
                Some(inside) => rest = inside,
                None => return,
            }
        }
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

/// Where an edge crosses a line, for its ends with their [`cross`]; the same for both directions of the edge.
fn crossing((a, side_a): (PagePoint, i64), (b, side_b): (PagePoint, i64)) -> PagePoint {
    let ((a, side_a), (b, side_b)) =
        if (a.x, a.y) <= (b.x, b.y) { ((a, side_a), (b, side_b)) } else { ((b, side_b), (a, side_a)) };
    let (above, below) = (i128::from(side_a), i128::from(side_a) - i128::from(side_b));
    let at = |a: i32, b: i32| {
        let step = (i128::from(b) - i128::from(a)) * above;
        // Rounded to the nearest: the sign of the divisor must not matter.
        let (step, divisor) = if below < 0 { (-step, -below) } else { (step, below) };
        (i128::from(a) + (2 * step + divisor).div_euclid(2 * divisor)) as i32
    };
    PagePoint::new(at(a.x, b.x), at(a.y, b.y))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn polygon(points: &[[i32; 2]]) -> Convex {
        let points: Vec<PagePoint> = points.iter().map(|[x, y]| PagePoint::new(*x, *y)).collect();
        Convex { edges: (0..points.len() as u32).collect(), points }
    }

    #[test]
    fn parts_outside_add_up_to_the_rest() {
        let square = polygon(&[[0, 0], [1000, 0], [1000, 1000], [0, 1000]]);
        let hole = polygon(&[[300, 300], [700, 300], [700, 700], [300, 700]]);
        let mut parts = Vec::new();
        square.clone().subtract(&hole, &mut parts);
        assert_eq!(parts.iter().map(Convex::twice_area).sum::<i64>(), square.twice_area() - hole.twice_area());
        let named: Vec<u32> = parts.iter().flat_map(|part| &part.edges).copied().filter(|e| *e != NO_EDGE).collect();
        assert!((0..4).all(|edge| named.contains(&edge)));
        let mut parts = Vec::new();
        hole.clone().subtract(&square, &mut parts);
        assert!(parts.is_empty());
        let beside = polygon(&[[1000, 0], [2000, 0], [2000, 500]]);
        beside.clone().subtract(&square, &mut parts);
        assert_eq!(parts, [beside]);
    }

    #[test]
    fn rectangles_are_covered_missed_or_cut() {
        let rect = PageRect { min: PagePoint::new(0, 0), max: PagePoint::new(10, 10) };
        assert!(polygon(&[[-10, -10], [40, -10], [-10, 40]]).covers(&rect));
        let outside = polygon(&[[30, 0], [0, 30], [30, 30]]);
        assert!(outside.misses(&rect) && !outside.covers(&rect));
        let cut = polygon(&[[5, -5], [15, -5], [15, 15], [5, 15]]);
        assert!(!cut.misses(&rect) && !cut.covers(&rect));
        assert_eq!(cut.clipped(&rect).unwrap().twice_area(), 100);
        assert_eq!(rect.quarters().iter().map(PageRect::side).collect::<Vec<_>>(), [5; 4]);
    }

    #[test]
    fn the_shared_area_is_that_of_what_both_have() {
        let square = |x: i32, y: i32, side: i32| polygon(&[[x, y], [x + side, y], [x + side, y + side], [x, y + side]]);
        let area = |a: &Convex, b: &Convex| shared_area(&a.points, &b.points);
        assert_eq!(area(&square(0, 0, 5000), &square(5000, 0, 5000)), 0.0, "neighbours share a border only");
        let corner = polygon(&[[4990, 4990], [5020, 4990], [4990, 5020]]);
        for (other, expected) in [(square(2500, 2500, 5000), 2500.0 * 2500.0), (square(7, 9, 3), 9.0), (corner, 100.0)]
        {
            let found = [area(&square(0, 0, 5000), &other), area(&other, &square(0, 0, 5000))];
            assert!(found.iter().all(|area| (area - expected).abs() < 1e-3), "{found:?}, {expected}");
        }
    }

    #[test]
    fn neighbours_get_the_same_crossing() {
        let (a, b) = (PagePoint::new(3, 5), PagePoint::new(1_000_000_007, 77));
        let (c, d) = (PagePoint::new(500_000_000, -9), PagePoint::new(500_000_013, 999));
        let at = |p: PagePoint, q: PagePoint| crossing((p, cross(c, d, p)), (q, cross(c, d, q)));
        let other = |p: PagePoint, q: PagePoint| crossing((p, cross(d, c, p)), (q, cross(d, c, q)));
        assert_eq!(at(a, b), at(b, a));
        assert_eq!(at(a, b), other(a, b));
    }
}
