//! Finds objects that the inputs have twice, such as buildings on the border of neighbouring deliveries.
//!
//! A sweep along x finds the pairs. The boxes that it has reached and not left are in bins of similar sizes and places: boxes that have
//! half of their union in common are in the same bin or in neighbouring ones. Each box is compared with a bounded number, so that
//! the time is O(n log n), however many boxes there are in one place. A pair is
//! one object if both have the same identifier and mostly the same box, or the same footprint and height. Within one source, objects with
//! the same identifier have about the same height, too: parts of a building may have that of the building. Footprints are
//! compared as bit masks that one pass over the stored triangles fills. An object is left out for one that is kept: of three in a row of
//! which only neighbours are alike, the third stays. Objects, pairs and masks are sorted in scratch files, so
//! that memory does not follow the size of the city.

use crate::error::BakeError;
use insula_scratch::record_sorter::SortedRecords;
use serde::{Deserialize, Serialize};
use std::cmp::Ordering;
use std::collections::{BTreeMap, VecDeque};
use std::ops::ControlFlow;

/// What becomes of an object that another source, or the same, has already.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum DuplicateOption {
    #[default]
    KeepFirst,
    /// The one of the best level of detail is kept, also where their heights differ.
    KeepBestLevel,
    /// All are kept.
    KeepAll,
}

/// Shares of the boxes' union that must be common before identifiers, or footprints, are compared.
const SAME_ID_BOX_SHARE: f64 = 0.5;
const FOOTPRINT_BOX_SHARE: f64 = 0.85;
/// Share of the footprints' union that is common to two footprints that are the same.
const FOOTPRINT_SHARE: f64 = 0.95;
/// Heights of the same object differ by less, and by less than this share of them: slabs have a top and an underside.
const HEIGHT_TOLERANCE_M: f64 = 1.0;
const HEIGHT_TOLERANCE_SHARE: f64 = 0.5;
const LEAST_HEIGHT_TOLERANCE_M: f64 = 0.05;
/// An object is compared with this many similar ones at most: a source may have any number of objects in one place.
const MAX_SIMILAR: usize = 8;
/// An object is compared with this many of the active boxes of a bin at most, the last ones.
const MAX_ACTIVE: usize = 1024;
/// Side of the smallest bins.
const LEAST_SIDE_M: f64 = 1.0;
/// Boxes beyond twice as many as at the last time are searched for those that the sweep has left.
const MIN_SWEPT: usize = 1 << 12;
/// Points in x and y at which footprints are compared.
const MASK_SIDE: usize = 64;

/// A box in world coordinates.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(super) struct PlacedBox {
    pub(super) low: [f64; 3],
    pub(super) high: [f64; 3],
}

/// An object as far as it matters here.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
pub(super) struct DuplicateCandidate {
    /// Index of the pending object.
    pub(super) object: usize,
    /// Number of its source's report.
    pub(super) source: usize,
    pub(super) bounds: PlacedBox,
    pub(super) id: u64,
    pub(super) parent: Option<u64>,
    /// Level of detail; 0 where the source has none.
    pub(super) lod: f32,
    /// Equal for the same triangles in the same order.
    pub(super) shape_hash: u64,
    pub(super) is_terrain: bool,
}

/// Two objects that may be one. Indices of pending objects: the one that is kept if they are comes first.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(super) struct SimilarPair {
    pub(super) first: usize,
    pub(super) second: usize,
    /// Level of detail of the first one if the best is kept, else 0.
    lod: f32,
    /// Whether the identifiers are equal.
    pub(super) has_same_id: bool,
    /// Whether box and triangles are the same. If neither these nor the identifiers are, the footprints decide.
    pub(super) is_copy: bool,
    /// Whether the second one is left out also if the first one is, because of a third: it is its copy, or in a crowd of similar
    /// objects of which not all were compared. Else it may differ from the third, and stays.
    pub(super) is_chained: bool,
    /// The box of both on the map.
    low: [f64; 2],
    high: [f64; 2],
}

impl SimilarPair {
    /// The order in which it is decided what is left out: all pairs that may leave out the first one of a pair come before.
    pub(super) fn by_rank(a: &Self, b: &Self) -> Ordering {
        b.lod.total_cmp(&a.lod).then(a.first.cmp(&b.first)).then(a.second.cmp(&b.second))
    }
}

/// Passes all pairs of objects that may be one object to `visit`. `candidates` are in the order of their lowest x, and then of their
/// numbers. Fails if they cannot be read, or with the first error of `visit`.
pub(super) fn similar_pairs(
    candidates: SortedRecords<DuplicateCandidate>,
    option: DuplicateOption,
    mut visit: impl FnMut(SimilarPair) -> Result<(), BakeError>,
) -> Result<(), BakeError> {
    let mut active = ActiveBoxes::default();
    candidates.try_for_each(|new| {
        let mut pairs = Vec::new();
        active.for_each_near(&new, |old| {
            let pair = similar(old, &new, option);
            pairs.extend(pair);
            // One that it certainly equals suffices.
            let is_enough = pairs.len() >= MAX_SIMILAR || pair.is_some_and(|pair| pair.is_copy);
            if is_enough { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        });
        active.push(new);
        let is_crowded = pairs.len() >= MAX_SIMILAR;
        pairs.into_iter().try_for_each(|pair| visit(SimilarPair { is_chained: pair.is_copy || is_crowded, ..pair }))
    })
}

/// The size of a box: powers of two that its sides do not exceed, times [`LEAST_SIDE_M`].
type SizeClass = [i32; 2];

/// The boxes that a sweep along x has reached and not left.
#[derive(Default)]
struct ActiveBoxes {
    /// By size class and the strip of the lowest y, which is as wide as the class is: a box reaches into the next one at most. In
    /// the order of their lowest x.
    bins: BTreeMap<(SizeClass, i64), VecDeque<DuplicateCandidate>>,
    count: usize,
    /// What was left when all bins were swept the last time.
    swept: usize,
}

impl ActiveBoxes {
    fn push(&mut self, new: DuplicateCandidate) {
        let class = size_class(&new.bounds);
        self.bins.entry((class, strip(new.bounds.low[1], class))).or_default().push_back(new);
        self.count += 1;
        if self.count > 2 * self.swept + MIN_SWEPT {
            self.bins.retain(|(class, _), bin| {
                self.count -= leave(bin, *class, new.bounds.low[0]);
                !bin.is_empty()
            });
            self.swept = self.count;
        }
    }

    /// Calls `visit` for the boxes that may have half of the union with a new one in common, until it breaks.
    fn for_each_near(
        &mut self,
        new: &DuplicateCandidate,
        mut visit: impl FnMut(&DuplicateCandidate) -> ControlFlow<()>,
    ) {
        let [along_x, along_y] = size_class(&new.bounds);
        for class in (-1..=1).flat_map(|dx| (-1..=1).map(move |dy| [along_x + dx, along_y + dy])) {
            let [from, to] = [strip(new.bounds.low[1], class) - 1, strip(new.bounds.high[1], class)];
            for (_, bin) in self.bins.range_mut((class, from)..=(class, to)) {
                self.count -= leave(bin, class, new.bounds.low[0]);
                let last = bin.range(bin.len().saturating_sub(MAX_ACTIVE)..);
                if last.into_iter().try_for_each(&mut visit).is_break() {
                    return;
                }
            }
        }
    }
}

/// Forgets the first boxes of a bin that no box at `x` or beyond overlaps; returns how many.
fn leave(bin: &mut VecDeque<DuplicateCandidate>, [along_x, _]: SizeClass, x: f64) -> usize {
    let before = bin.len();
    while bin.front().is_some_and(|first| first.bounds.low[0] + side_m(along_x) < x) {
        bin.pop_front();
    }
    before - bin.len()
}

fn size_class(bounds: &PlacedBox) -> SizeClass {
    [0, 1].map(|axis: usize| {
        let sides = (bounds.high[axis] - bounds.low[axis]) / LEAST_SIDE_M;
        // At most 10^9, whose logarithm is 30.
        if sides > 1.0 { libm::ceil(libm::log2(sides)) as i32 } else { 0 }
    })
}

/// Longest side of boxes of a class.
fn side_m(class: i32) -> f64 {
    libm::ldexp(LEAST_SIDE_M, class)
}

/// Number of the strip of a coordinate, which is at most 10^9, in a size class.
fn strip(y: f64, [_, along_y]: SizeClass) -> i64 {
    (y / side_m(along_y)).floor() as i64
}

fn similar(a: &DuplicateCandidate, b: &DuplicateCandidate, option: DuplicateOption) -> Option<SimilarPair> {
    let is_part = |part: &DuplicateCandidate, whole: &DuplicateCandidate| part.parent == Some(whole.id);
    if a.is_terrain != b.is_terrain || is_part(a, b) || is_part(b, a) {
        return None;
    }
    let share = common_share(&a.bounds, &b.bounds);
    let height_m = |bounds: &PlacedBox| bounds.high[2] - bounds.low[2];
    let tolerance_m = height_m(&a.bounds).max(height_m(&b.bounds)) * HEIGHT_TOLERANCE_SHARE;
    let tolerance_m = tolerance_m.clamp(LEAST_HEIGHT_TOLERANCE_M, HEIGHT_TOLERANCE_M);
    let differs = |x: f64, y: f64| (x - y).abs() >= tolerance_m;
    let has_same_height = !differs(a.bounds.low[2], b.bounds.low[2]) && !differs(a.bounds.high[2], b.bounds.high[2]);
    let has_same_id = a.id == b.id && share >= SAME_ID_BOX_SHARE && (a.source != b.source || has_same_height);
    let is_by_level = option == DuplicateOption::KeepBestLevel;
    let may_differ = is_by_level && a.lod != b.lod;
    if !has_same_id && (share < FOOTPRINT_BOX_SHARE || !(has_same_height || may_differ)) {
        return None;
    }
    let is_copy = a.shape_hash == b.shape_hash && a.bounds == b.bounds;
    let rank = |object: &DuplicateCandidate| if is_by_level { object.lod } else { 0.0 };
    let by_rank = rank(b).total_cmp(&rank(a)).then(a.object.cmp(&b.object));
    let (first, second) = if by_rank.is_le() { (a, b) } else { (b, a) };
    let low = [0, 1].map(|axis: usize| a.bounds.low[axis].min(b.bounds.low[axis]));
    let high = [0, 1].map(|axis: usize| a.bounds.high[axis].max(b.bounds.high[axis]));
    let (lod, first, second) = (rank(first), first.object, second.object);
    Some(SimilarPair { first, second, lod, has_same_id, is_copy, is_chained: is_copy, low, high })
}

/// Area on the map that two boxes have in common, as a share of their union's.
fn common_share(a: &PlacedBox, b: &PlacedBox) -> f64 {
    let side = |axis: usize| (a.high[axis].min(b.high[axis]) - a.low[axis].max(b.low[axis])).max(0.0);
    let area = |bounds: &PlacedBox| (bounds.high[0] - bounds.low[0]) * (bounds.high[1] - bounds.low[1]);
    let common = side(0) * side(1);
    let union = area(a) + area(b) - common;
    if union > 0.0 { common / union } else { 0.0 }
}

/// The footprint of one object of a pair, at points of both.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct PairMask {
    pub(super) pair: SimilarPair,
    /// A bit for each point, row by row.
    rows: Vec<u64>,
    is_second: bool,
}

impl PairMask {
    pub(super) fn new(pair: SimilarPair, is_second: bool) -> Self {
        Self { pair, rows: vec![0; MASK_SIDE], is_second }
    }

    /// Adds a triangle of the object, in world coordinates on the map.
    pub(super) fn add(&mut self, corners: [[f64; 2]; 3]) {
        let SimilarPair { low, high, .. } = self.pair;
        let step = [0, 1].map(|axis: usize| (high[axis] - low[axis]) / MASK_SIDE as f64);
        if !(step[0] > 0.0 && step[1] > 0.0) {
            return;
        }
        let points = corners.map(|corner| [0, 1].map(|axis: usize| (corner[axis] - low[axis]) / step[axis] - 0.5));
        cover(&mut self.rows, points);
    }

    /// Whether the footprint of the other object is the same.
    pub(super) fn equals(&self, other: &Self) -> bool {
        let count = |of: fn(u64, u64) -> u64| {
            self.rows.iter().zip(&other.rows).map(|(a, b)| of(*a, *b).count_ones()).sum::<u32>()
        };
        let (common, union) = (count(|a, b| a & b), count(|a, b| a | b));
        self.is_second != other.is_second && union > 0 && f64::from(common) > FOOTPRINT_SHARE * f64::from(union)
    }
}

/// Sets the bits of the points in a triangle. Points are at whole numbers.
fn cover(mask: &mut [u64], points: [[f64; 2]; 3]) {
    let range = |axis: usize| {
        let values = points.map(|point| point[axis]);
        let low = values.into_iter().fold(f64::MAX, f64::min).ceil().max(0.0);
        (low as usize, values.into_iter().fold(f64::MIN, f64::max).floor())
    };
    let (first_row, last_row) = range(1);
    if last_row < 0.0 {
        return;
    }
    for row in first_row..=(last_row as usize).min(MASK_SIDE - 1) {
        let y = row as f64;
        let (mut left, mut right) = (f64::MAX, f64::MIN);
        for i in 0..3 {
            let (a, b) = (points[i], points[(i + 1) % 3]);
            if (a[1] <= y) != (b[1] <= y) {
                let x = a[0] + (y - a[1]) / (b[1] - a[1]) * (b[0] - a[0]);
                left = left.min(x);
                right = right.max(x);
            }
        }
        let (from, to) = (left.ceil().max(0.0), right.floor().min(MASK_SIDE as f64 - 1.0));
        if from <= to {
            let width = (to - from) as u32 + 1;
            let bits = (u64::MAX >> (64 - width)) << from as u32;
            mask.iter_mut().skip(row).take(1).for_each(|mask| *mask |= bits);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_scratch::record_list::RecordScratch;
    use insula_scratch::record_sorter::RecordSorter;

    fn candidate(object: usize, low: [f64; 3], high: [f64; 3], id: u64) -> DuplicateCandidate {
        let (bounds, shape_hash) = (PlacedBox { low, high }, object as u64);
        // Of one source each.
        let source = object;
        DuplicateCandidate { object, source, bounds, id, parent: None, lod: 0.0, shape_hash, is_terrain: false }
    }

    fn all_pairs(candidates: &[DuplicateCandidate], option: DuplicateOption) -> Vec<SimilarPair> {
        let mut sorter = RecordSorter::new(&RecordScratch::default(), |a: &DuplicateCandidate, b| {
            a.bounds.low[0].total_cmp(&b.bounds.low[0])
        });
        candidates.iter().for_each(|candidate| sorter.push(*candidate).unwrap());
        let mut found = Vec::new();
        let push = |pair| {
            found.push(pair);
            Ok(())
        };
        similar_pairs(sorter.finish().unwrap(), option, push).unwrap();
        found.sort_by_key(|pair| (pair.first, pair.second));
        found
    }

    fn pairs(candidates: &[DuplicateCandidate]) -> Vec<(usize, usize, bool)> {
        let found = all_pairs(candidates, DuplicateOption::KeepFirst);
        found.iter().map(|pair| (pair.first, pair.second, pair.has_same_id)).collect()
    }

    #[test]
    fn all_overlapping_pairs_are_found() {
        // Against all pairs, on boxes of a simple generator. Few are in one place, so that none is left out by the bound.
        let mut state = 7_u64;
        let mut next = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (state >> 40) as f64 / (1 << 24) as f64
        };
        let all: Vec<DuplicateCandidate> = (0..600)
            .map(|object| {
                // Also across strips, and of other classes.
                let low = [(next() * 60.0).floor(), (next() * 12.0).floor() + 58.0, 0.0];
                let width = if object % 10 == 0 { 100.0 } else { 4.0 };
                candidate(object, low, [low[0] + 4.0, low[1] + width, 5.0], object as u64 % 40)
            })
            .collect();
        let mut expected = Vec::new();
        for a in 0..all.len() {
            for b in a + 1..all.len() {
                if let Some(pair) = similar(&all[a], &all[b], DuplicateOption::KeepFirst) {
                    expected.push((pair.first, pair.second, pair.has_same_id));
                }
            }
        }
        assert!(expected.len() > 50, "{}", expected.len());
        assert_eq!(pairs(&all), expected);
    }

    #[test]
    fn boxes_that_the_sweep_has_left_are_forgotten() {
        let mut active = ActiveBoxes::default();
        for i in 0..100_000 {
            let x = i as f64;
            active.push(candidate(i, [x, x * 7.0, 0.0], [x + 3.0, x * 7.0 + 3.0, 5.0], i as u64));
        }
        assert!(active.count <= 2 * MIN_SWEPT, "{}", active.count);
        assert_eq!(active.count, active.bins.values().map(VecDeque::len).sum::<usize>());
    }

    #[test]
    fn any_number_of_objects_in_one_place_give_few_pairs() {
        let all: Vec<DuplicateCandidate> = (0..500).map(|i| candidate(i, [0.0; 3], [10.0; 3], i as u64)).collect();
        let found = pairs(&all);
        assert!(found.len() <= 500 * MAX_SIMILAR, "{}", found.len());
        assert!((1..500).all(|i| found.contains(&(0, i, false))), "each is compared with the first");
    }

    #[test]
    fn a_copy_is_compared_with_one() {
        let of = |shape_hash: u64| {
            move |i: usize| DuplicateCandidate { shape_hash, ..candidate(i, [0.0; 3], [9.0; 3], i as u64) }
        };
        let all: Vec<DuplicateCandidate> = (0..500).map(of(7)).collect();
        assert_eq!(pairs(&all).len(), 499);
        let pair = similar(
            &of(7)(0),
            &DuplicateCandidate { bounds: PlacedBox { low: [0.0; 3], high: [9.0, 9.0, 9.1] }, ..of(7)(1) },
            DuplicateOption::KeepFirst,
        );
        assert!(!pair.unwrap().is_copy, "another place");
    }

    #[test]
    fn height_kind_and_relation_distinguish_objects() {
        let base = candidate(0, [0.0; 3], [10.0; 3], 1);
        assert_eq!(pairs(&[base, candidate(1, [0.0; 3], [10.0, 10.0, 10.9], 2)]), [(0, 1, false)]);
        assert!(pairs(&[base, candidate(1, [0.0; 3], [10.0, 10.0, 11.1], 2)]).is_empty());
        let terrain = DuplicateCandidate { is_terrain: true, ..candidate(1, [0.0; 3], [10.0; 3], 2) };
        assert!(pairs(&[base, terrain]).is_empty());
        let part = DuplicateCandidate { parent: Some(1), ..candidate(1, [0.0; 3], [10.0; 3], 2) };
        assert!(pairs(&[base, part]).is_empty());
        let upper = candidate(1, [0.0, 0.0, 10.0], [10.0, 10.0, 40.0], 1);
        assert_eq!(pairs(&[base, upper]), [(0, 1, true)], "of another delivery, whose heights may be others");
        let stacked = DuplicateCandidate { source: 0, ..upper };
        assert!(pairs(&[base, stacked]).is_empty(), "parts of one building with its identifier");
        let again = DuplicateCandidate { source: 0, ..candidate(1, [1.0, 0.0, 0.0], [11.0, 10.0, 10.5], 1) };
        assert_eq!(pairs(&[base, again]), [(0, 1, true)]);
        let far = candidate(1, [8.0, 0.0, 0.0], [18.0, 10.0, 10.0], 1);
        assert!(pairs(&[base, far]).is_empty(), "the same identifier at another place");
        let lower = DuplicateCandidate { lod: 1.0, ..candidate(1, [0.0; 3], [10.0, 10.0, 6.0], 2) };
        assert_eq!(all_pairs(&[base, lower], DuplicateOption::KeepBestLevel).len(), 1);
    }

    #[test]
    fn top_and_underside_of_a_slab_are_two() {
        let face = |object, z: f64| candidate(object, [0.0, 0.0, z], [10.0, 10.0, z], object as u64);
        assert!(pairs(&[face(0, 0.0), face(1, 0.8)]).is_empty());
        assert_eq!(pairs(&[face(0, 0.0), face(1, 0.02)]), [(0, 1, false)]);
    }

    #[test]
    fn footprints_are_compared_by_their_shape() {
        let pair = similar(
            &candidate(0, [0.0; 3], [10.0; 3], 1),
            &candidate(1, [0.0; 3], [10.0; 3], 2),
            DuplicateOption::KeepFirst,
        );
        let masks = |second: &[[[f64; 2]; 3]]| {
            let [mut one, mut other] = [false, true].map(|is_second| PairMask::new(pair.unwrap(), is_second));
            one.add([[0.0, 0.0], [10.0, 0.0], [10.0, 10.0]]);
            one.add([[0.0, 0.0], [10.0, 10.0], [0.0, 10.0]]);
            second.iter().for_each(|triangle| other.add(*triangle));
            one.equals(&other)
        };
        // The same square, cut along the other diagonal and facing down.
        assert!(masks(&[[[0.0, 0.0], [0.0, 10.0], [10.0, 0.0]], [[10.0, 0.0], [10.0, 10.0], [0.0, 10.0]]]));
        assert!(!masks(&[[[0.0, 0.0], [10.0, 0.0], [10.0, 10.0]]]), "half of it");
        assert!(!masks(&[]), "no footprint");
        let shifted = |dx: f64| {
            let [a, b, c, d] = [[dx, 0.0], [10.0 + dx, 0.0], [10.0 + dx, 10.0], [dx, 10.0]];
            masks(&[[a, b, c], [a, c, d]])
        };
        assert!(shifted(0.2) && !shifted(0.6));
    }
}
