//! Lines as polygons: bands with round corners, and stripes beside a line, whole or dashed.

use crate::paint::canvas::{BLOCK_SAMPLES, PolygonFill, SampleWindow};
use crate::paint::clip::{between, clip_segment};
use crate::paint::prepare::ReadyLine;
use crate::paint::reach::{MAX_MITER, WHOLE_PIECE_M};

/// More segments of one line in one block are left out: they cover it long before.
const MAX_SEGMENTS: usize = 4096;
/// More pieces of one stripe in one block are left out.
const MAX_PIECES: usize = 8192;
/// Bends that leave a smaller gap on their outer side, in samples, need no disc.
const SMALL_GAP: f64 = 0.25;
/// Corners of a disc deviate from its circle by this part of a sample.
const DISC_ERROR: f64 = 0.2;

/// A stripe beside a line.
#[derive(Debug, Clone, Copy)]
pub(super) struct Stripe<'c> {
    /// Distances of its edges from the line in metres, positive to the left. The first is smaller.
    pub edges_m: [f64; 2],
    /// Length of a dash, and from one to the next; `None` for a whole stripe.
    pub dash_m: Option<[f64; 2]>,
    /// Parts of the line that have no stripe, in metres along it, ascending and apart.
    pub cuts_m: &'c [[f64; 2]],
}

/// Fills a line with a half width in metres. Bends are round on the outer side, and ends where the line goes on.
pub(super) fn band(line: &ReadyLine, half_m: f64, fill: &mut PolygonFill<'_>) {
    let window = fill.window();
    let half = half_m * window.samples_per_m;
    let near = SampleWindow::around(half);
    let mut before: Option<[f64; 2]> = None;
    let mut left = MAX_SEGMENTS;
    for (i, pair) in line.points.windows(2).enumerate() {
        let [a, b] = [window.place(pair[0]), window.place(pair[1])];
        let direction = unit(a, b);
        if let Some([from, to]) = clip_segment(a, b, near) {
            let Some(fewer) = left.checked_sub(1) else { return };
            left = fewer;
            let side = [-direction[1] * half, direction[0] * half];
            fill.add(&quad(between(a, b, from), between(a, b, to), side));
            let is_start = i == 0 && line.goes_on[0];
            if from == 0.0 && (is_start || before.is_some_and(|before| has_gap(before, direction, half))) {
                disc(a, half, fill);
            }
            if to == 1.0 && i + 2 == line.points.len() && line.goes_on[1] {
                disc(b, half, fill);
            }
        }
        before = Some(direction);
    }
}

pub(super) fn stripe(line: &ReadyLine, stripe: Stripe<'_>, fill: &mut PolygonFill<'_>) {
    let window = fill.window();
    let reach_m = MAX_MITER * stripe.edges_m[0].abs().max(stripe.edges_m[1].abs());
    let near = SampleWindow::around(reach_m * window.samples_per_m);
    let mut left = MAX_PIECES;
    for i in 1..line.points.len() {
        let [a, b] = [window.place(line.points[i - 1]), window.place(line.points[i])];
        let Some([from, to]) = clip_segment(a, b, near) else { continue };
        let [start_m, end_m] = [line.along_m[i - 1], line.along_m[i]];
        let length_m = end_m - start_m;
        let [from_m, to_m] = [start_m + from * length_m, start_m + to * length_m];
        let [right, at_left] = stripe.edges_m.map(|edge_m| {
            let edge = edge_m * window.samples_per_m;
            [beside(line, i - 1, edge, window), beside(line, i, edge, window)]
        });
        for [from_m, to_m] in pieces(stripe.dash_m, stripe.cuts_m, [from_m, to_m]) {
            let Some(fewer) = left.checked_sub(1) else { return };
            left = fewer;
            let [t, u] = [from_m, to_m].map(|m| (m - start_m) / length_m);
            let on = |[start, end]: [[f64; 2]; 2], share| between(start, end, share);
            fill.add(&[on(right, t), on(right, u), on(at_left, u), on(at_left, t)]);
        }
    }
}

/// The dashes within a part of a line, without its cuts. All are metres along the line.
fn pieces(dash_m: Option<[f64; 2]>, cuts_m: &[[f64; 2]], [from, to]: [f64; 2]) -> impl Iterator<Item = [f64; 2]> {
    let [on, period] = dash_m.unwrap_or([WHOLE_PIECE_M; 2]);
    let first = (from / period).floor();
    let count = (to / period).ceil() - first;
    // The part is within a block and its surroundings, and the caller stops after some thousands.
    let dashes = (0..count.max(0.0) as usize).map(move |k| {
        let start = (first + k as f64) * period;
        // The next piece begins where a whole one ends.
        let end = if on < period { start + on } else { (first + (k + 1) as f64) * period };
        [start.max(from), end.min(to)]
    });
    dashes.filter(|[start, end]| start < end).flat_map(move |dash| without(dash, cuts_m))
}

/// A part without the cuts, which are ascending and apart.
fn without([from, to]: [f64; 2], cuts_m: &[[f64; 2]]) -> impl Iterator<Item = [f64; 2]> {
    let next = cuts_m.partition_point(|cut| cut[1] <= from);
    let cuts = cuts_m[next..].iter().copied().take_while(move |cut| cut[0] < to);
    let ends = cuts.clone().map(|cut| cut[0]).chain([to]);
    let starts = [from].into_iter().chain(cuts.map(|cut| cut[1]));
    starts.zip(ends).map(Into::into).filter(|[start, end]: &[f64; 2]| start < end)
}

/// The corner of a stripe's edge beside a point of a line, in samples.
fn beside(line: &ReadyLine, i: usize, edge: f64, window: SampleWindow) -> [f64; 2] {
    let place = |i: usize| window.place(line.points[i]);
    let middle = place(i);
    let is_loop = line.points.first() == line.points.last() && line.points.len() > 2;
    let end = line.points.len() - 1;
    let before = if i > 0 { Some(i - 1) } else { is_loop.then(|| end - 1) };
    let after = if i < end { Some(i + 1) } else { is_loop.then_some(1) };
    let normal = |[x, y]: [f64; 2]| [-y, x];
    let incoming = before.map(|before| normal(unit(place(before), middle)));
    let outgoing = after.map(|after| normal(unit(middle, place(after))));
    let (a, b) = (incoming.or(outgoing).unwrap_or_default(), outgoing.or(incoming).unwrap_or_default());
    let sum = [a[0] + b[0], a[1] + b[1]];
    let square = sum[0] * sum[0] + sum[1] * sum[1];
    // The miter is `2 / |a + b|` distances long.
    let offset = if square > (2.0 / MAX_MITER).powi(2) { sum.map(|v| v * 2.0 / square) } else { a };
    [middle[0] + offset[0] * edge, middle[1] + offset[1] * edge]
}

fn has_gap([ax, ay]: [f64; 2], [bx, by]: [f64; 2], half: f64) -> bool {
    libm::hypot(ax - bx, ay - by) * half > SMALL_GAP
}

fn unit(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    let step = [b[0] - a[0], b[1] - a[1]];
    let length = libm::hypot(step[0], step[1]);
    if length > 0.0 { step.map(|v| v / length) } else { [1.0, 0.0] }
}

/// Counter-clockwise: `side` is to the left.
fn quad(a: [f64; 2], b: [f64; 2], side: [f64; 2]) -> [[f64; 2]; 4] {
    let moved = |p: [f64; 2], sign: f64| [p[0] + sign * side[0], p[1] + sign * side[1]];
    [moved(a, -1.0), moved(b, -1.0), moved(b, 1.0), moved(a, 1.0)]
}

fn disc(centre: [f64; 2], radius: f64, fill: &mut PolygonFill<'_>) {
    const MAX_CORNERS: usize = 64;
    // A chord of the angle `2 a` is `r (1 - cos a)` from its arc.
    let half_angle = libm::acos(1.0 - (DISC_ERROR / radius.max(DISC_ERROR)).min(1.0));
    let count = ((std::f64::consts::PI / half_angle.max(1e-3)).ceil() as usize).clamp(6, MAX_CORNERS);
    let mut corners = [[0.0; 2]; MAX_CORNERS];
    for (i, corner) in corners[..count].iter_mut().enumerate() {
        let (sin, cos) = libm::sincos(i as f64 * std::f64::consts::TAU / count as f64);
        *corner = [centre[0] + radius * cos, centre[1] + radius * sin];
    }
    fill.add(&corners[..count]);
}

const _: () = assert!(BLOCK_SAMPLES <= 4096, "coordinates of tiny-skia are exact in this range");

#[cfg(test)]
mod tests {
    use super::*;

    fn all(dash_m: Option<[f64; 2]>, cuts_m: &[[f64; 2]], part: [f64; 2]) -> Vec<[f64; 2]> {
        pieces(dash_m, cuts_m, part).collect()
    }

    #[test]
    fn dashes_count_from_the_start_of_the_line() {
        let dash = Some([3.0, 12.0]);
        assert_eq!(all(dash, &[], [0.0, 30.0]), [[0.0, 3.0], [12.0, 15.0], [24.0, 27.0]]);
        assert_eq!(all(dash, &[], [1.0, 13.0]), [[1.0, 3.0], [12.0, 13.0]]);
        assert_eq!(all(dash, &[], [3.0, 12.0]), Vec::<[f64; 2]>::new());
        assert_eq!(all(None, &[], [3.0, 14.0]), [[3.0, 6.0], [6.0, 12.0], [12.0, 14.0]]);
        assert_eq!(all(None, &[], [3.0, 3.0]), Vec::<[f64; 2]>::new());
        assert_eq!(all(Some([3.0, 12.0]), &[], [1.2e9, 1.2e9 + 4.0]).len(), 1);
    }

    #[test]
    fn cuts_are_left_out() {
        let cuts = [[-5.0, 1.0], [2.0, 4.0], [13.0, 14.0], [50.0, 60.0]];
        assert_eq!(all(Some([3.0, 12.0]), &cuts, [0.0, 30.0]), [[1.0, 2.0], [12.0, 13.0], [14.0, 15.0], [24.0, 27.0]]);
        assert_eq!(all(None, &cuts[..2], [0.0, 10.0]), [[1.0, 2.0], [4.0, 6.0], [6.0, 10.0]]);
    }
}
