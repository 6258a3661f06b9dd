//! How much of an area other areas cover, by scan lines. Broken rings do no harm.

use super::element::Position;

/// Scan lines over an outline, and over a part.
const OUTLINE_LINES: u32 = 64;
const PART_LINES: u32 = 16;

/// West, south, east, north.
pub(super) type Bounds = [i32; 4];

/// Bounds of positions; `None` without any.
pub(super) fn bounds<'p>(positions: impl IntoIterator<Item = &'p Position>) -> Option<Bounds> {
    let mut positions = positions.into_iter();
    let [x, y] = *positions.next()?;
    Some(positions.fold([x, y, x, y], |[w, s, e, n], [x, y]| [w.min(*x), s.min(*y), e.max(*x), n.max(*y)]))
}

/// Share of an area that is within another, from 0 to 1. Inside is where a line to the left crosses an odd number of
/// segments.
pub(super) fn share_within(area: &[&[Position]], bounds: Bounds, other: &[&[Position]]) -> f64 {
    let (mut inside, mut outside) = (Vec::new(), Vec::new());
    let (mut whole, mut shared) = (0.0, 0.0);
    for y in scan_lines(bounds, PART_LINES) {
        spans(area, y, &mut inside);
        spans(other, y, &mut outside);
        whole += length(&inside);
        shared += common_length(&inside, &outside);
    }
    if whole > 0.0 { shared / whole } else { 0.0 }
}

/// Share of an area that others cover together, from 0 to 1.
pub(super) fn covered_share(area: &[&[Position]], bounds: Bounds, others: &[Vec<&[Position]>]) -> f64 {
    let (mut inside, mut other, mut covered) = (Vec::new(), Vec::new(), Vec::new());
    let (mut whole, mut shared) = (0.0, 0.0);
    for y in scan_lines(bounds, OUTLINE_LINES) {
        spans(area, y, &mut inside);
        covered.clear();
        for rings in others {
            spans(rings, y, &mut other);
            covered.extend_from_slice(&other);
        }
        unite(&mut covered);
        whole += length(&inside);
        shared += common_length(&inside, &covered);
    }
    if whole > 0.0 { shared / whole } else { 0.0 }
}

/// Heights of evenly spread lines, none of which is at the height of a position as a rule.
fn scan_lines(bounds: Bounds, count: u32) -> impl Iterator<Item = f64> {
    let (south, north) = (f64::from(bounds[1]), f64::from(bounds[3]));
    (0..count).map(move |i| south + (north - south) * (f64::from(i) + 0.5) / f64::from(count))
}

/// The stretches of a line of latitude that are inside of rings, in order.
fn spans(rings: &[&[Position]], y: f64, spans: &mut Vec<[f64; 2]>) {
    let mut crossings = Vec::new();
    for pair in rings.iter().flat_map(|ring| ring.windows(2)) {
        let ([x0, y0], [x1, y1]) = (pair[0].map(f64::from), pair[1].map(f64::from));
        if (y0 <= y) != (y1 <= y) {
            crossings.push(x0 + (x1 - x0) * (y - y0) / (y1 - y0));
        }
    }
    crossings.sort_by(f64::total_cmp);
    spans.clear();
    spans.extend(crossings.chunks_exact(2).map(|pair| [pair[0], pair[1]]));
}

/// Joins stretches that overlap.
fn unite(spans: &mut Vec<[f64; 2]>) {
    spans.sort_by(|a, b| a[0].total_cmp(&b[0]));
    spans.dedup_by(|next, span| {
        let overlaps = next[0] <= span[1];
        if overlaps {
            span[1] = span[1].max(next[1]);
        }
        overlaps
    });
}

fn length(spans: &[[f64; 2]]) -> f64 {
    spans.iter().map(|[from, to]| to - from).sum()
}

/// Total length of the intersection of two lists of intervals. Each list is sorted and without overlaps.
fn common_length(a: &[[f64; 2]], b: &[[f64; 2]]) -> f64 {
    let (mut i, mut k, mut sum) = (0, 0, 0.0);
    while let (Some(left), Some(right)) = (a.get(i), b.get(k)) {
        sum += (left[1].min(right[1]) - left[0].max(right[0])).max(0.0);
        if left[1] < right[1] { i += 1 } else { k += 1 }
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square(x: i32, y: i32, side: i32) -> Vec<Position> {
        vec![[x, y], [x + side, y], [x + side, y + side], [x, y + side], [x, y]]
    }

    #[test]
    fn shares_are_those_of_the_areas() {
        let (outline, hole) = (square(0, 0, 100), square(25, 25, 50));
        let rings = [&outline[..], &hole[..]];
        let bounds = bounds(&outline).unwrap();
        let halves = [square(-50, 0, 100), square(-50, 0, 100)];
        let others: Vec<Vec<&[Position]>> = halves.iter().map(|ring| vec![&ring[..]]).collect();
        assert!((covered_share(&rings, bounds, &others) - 0.5).abs() < 1e-9, "parts above one another count once");
        assert!((covered_share(&rings, bounds, &[vec![&hole[..]]])).abs() < 1e-9);
        let part = square(75, 0, 50);
        let share = share_within(&[&part[..]], [75, 0, 125, 50], &rings);
        assert!((share - 0.5).abs() < 1e-9, "{share}");
        assert_eq!(share_within(&[&[][..]], [0; 4], &rings), 0.0);
    }
}
