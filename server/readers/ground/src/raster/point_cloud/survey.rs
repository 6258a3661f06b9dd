//! The first pass over the points: the number, bounds and density of each kind.

use super::header::Header;
use super::points::{CloudPoint, PointKind};

/// Columns and rows of the largest table in which points are counted: a power of two.
const MAX_SIDE: usize = 1024;
/// Places in a smaller table for each point, so that it shows gaps between groups of points.
const PLACES_OF_POINT: u64 = 64;
/// Places of the table are merged until those with points have this many on average, so that those without are gaps.
const MIN_POINTS_OF_PLACE: u64 = 8;

/// Fewer points than one of so many that could be on the ground do not tell where it is: somebody classified some by hand.
const STRAY_PART: u64 = 100;

/// What is known of the points of each kind.
pub(super) struct Survey {
    corner: [f64; 2],
    size: [f64; 2],
    /// Columns and rows of the table.
    side: usize,
    kinds: [KindSurvey; 3],
}

/// The points of a kind.
#[derive(Default)]
pub(super) struct KindSurvey {
    pub(super) points: u64,
    /// Lowest and highest numbers of x and y.
    pub(super) low: [i32; 2],
    pub(super) high: [i32; 2],
    /// Points at each place of the table; empty without points.
    counts: Vec<u32>,
}

impl Survey {
    pub(super) fn new(header: &Header) -> Self {
        let [low, high] = header.bounds;
        let size = [0, 1].map(|axis| high[axis] - low[axis]);
        let mut side = 1;
        while side < MAX_SIDE && (side * side) as u64 / PLACES_OF_POINT < header.points {
            side *= 2;
        }
        Self { corner: low, size, side, kinds: [(); 3].map(|()| KindSurvey::default()) }
    }

    pub(super) fn add(&mut self, point: CloudPoint, position: [f64; 2]) {
        let [column, row] = [0, 1].map(|axis| {
            let along = (position[axis] - self.corner[axis]) / self.size[axis];
            // Without a size, there is only one place.
            (along * self.side as f64).clamp(0.0, self.side as f64 - 1.0) as usize
        });
        let [x, y, _] = point.numbers;
        let kind = &mut self.kinds[point.kind as usize];
        if kind.points == 0 {
            (kind.low, kind.high) = ([x, y], [x, y]);
            kind.counts = vec![0; self.side * self.side];
        }
        kind.points += 1;
        kind.low = [kind.low[0].min(x), kind.low[1].min(y)];
        kind.high = [kind.high[0].max(x), kind.high[1].max(y)];
        let count = &mut kind.counts[row * self.side + column];
        *count = count.saturating_add(1);
    }

    /// The best kind of points that there is, but for a few stray ones.
    pub(super) fn best(&self) -> Option<(PointKind, &KindSurvey)> {
        let least = (self.kinds.iter().map(|kind| kind.points).sum::<u64>() / STRAY_PART).max(1);
        PointKind::ALL.into_iter().zip(&self.kinds).find(|(_, kind)| kind.points >= least)
    }

    /// The area that the points of a kind cover, without gaps, in the square of the coordinates' unit.
    pub(super) fn area(&self, kind: &KindSurvey) -> f64 {
        let mut counts: Vec<bool> = kind.counts.iter().map(|count| *count > 0).collect();
        let mut side = self.side;
        loop {
            let covered = counts.iter().filter(|has_points| **has_points).count();
            if side == 1 || kind.points / MIN_POINTS_OF_PLACE >= covered as u64 {
                return self.size[0] * self.size[1] * covered as f64 / (side * side) as f64;
            }
            side /= 2;
            let place = |index: usize| {
                let (column, row) = (index % side, index / side);
                (0..4).any(|part| counts[(row * 2 + part / 2) * side * 2 + column * 2 + part % 2])
            };
            counts = (0..side * side).map(place).collect();
        }
    }
}
