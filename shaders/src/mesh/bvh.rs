//! A bounding volume hierarchy of a mesh's triangles.
//!
//! Split where the boxes' surfaces, weighted by their triangles, are smallest (Wald 2007, "On fast construction of
//! SAH-based bounding volume hierarchies"). Deep levels split by number of triangles, so that no tree is deeper than a
//! ray's stack.

use std::ops::Range;

const LEAF_TRIANGLES: usize = 3;
/// Bins along an axis, between which a set may be split.
const BINS: usize = 16;
/// Depth from which sets are split into equal numbers: 2^18 triangles need 17 more levels.
const HALVING_DEPTH: u32 = 13;

/// Lowest and highest corner of a box.
pub(super) type Bounds = [[u32; 3]; 2];

/// One of the two halves of a set of triangles.
#[derive(Debug, Clone)]
pub(super) struct BvhChild {
    pub(super) bounds: Bounds,
    /// Its halves in [`Bvh::pairs`]. `None`: it is a leaf.
    pub(super) halves: Option<u32>,
    /// A leaf's triangles in [`Bvh::order`].
    pub(super) triangles: Range<u32>,
}

#[derive(Debug)]
pub(super) struct Bvh {
    pub(super) pairs: Vec<[BvhChild; 2]>,
    /// Numbers of the triangles; those of a child are contiguous.
    pub(super) order: Vec<u32>,
    pub(super) root: BvhChild,
}

const NOTHING: Bounds = [[u16::MAX as u32; 3], [0; 3]];

fn join(a: Bounds, b: Bounds) -> Bounds {
    [std::array::from_fn(|k| a[0][k].min(b[0][k])), std::array::from_fn(|k| a[1][k].max(b[1][k]))]
}

fn bounds_of(corners: &[[u32; 3]; 3]) -> Bounds {
    corners.iter().fold(NOTHING, |bounds, corner| join(bounds, [*corner; 2]))
}

/// Half of a box's surface. Thin boxes count as one step thick.
fn surface([low, high]: Bounds) -> f64 {
    let [x, y, z]: [f64; 3] = std::array::from_fn(|k| f64::from(high[k].saturating_sub(low[k])) + 1.0);
    x * y + y * z + z * x
}

/// Twice the middle of a box.
fn middle([low, high]: Bounds) -> [u32; 3] {
    std::array::from_fn(|k| low[k] + high[k])
}

struct BvhBuilder {
    bounds: Vec<Bounds>,
    middles: Vec<[u32; 3]>,
    order: Vec<u32>,
    pairs: Vec<[BvhChild; 2]>,
}

impl Bvh {
    /// The hierarchy of triangles whose coordinates are below 65,536.
    pub(super) fn of(corners: &[[[u32; 3]; 3]]) -> Self {
        let bounds: Vec<Bounds> = corners.iter().map(bounds_of).collect();
        let middles = bounds.iter().copied().map(middle).collect();
        let order = (0..corners.len() as u32).collect();
        let mut builder = BvhBuilder { bounds, middles, order, pairs: Vec::new() };
        let root = builder.child(0..corners.len(), 0);
        Self { pairs: builder.pairs, order: builder.order, root }
    }
}

impl BvhBuilder {
    fn child(&mut self, range: Range<usize>, depth: u32) -> BvhChild {
        let set = &self.order[range.clone()];
        let bounds = set.iter().fold(NOTHING, |bounds, at| join(bounds, self.bounds[*at as usize]));
        let triangles = range.start as u32..range.end as u32;
        if range.len() <= LEAF_TRIANGLES {
            return BvhChild { bounds, halves: None, triangles };
        }
        let split = range.start + self.split(range.clone(), depth);
        let at = self.pairs.len();
        let unknown = BvhChild { bounds, halves: None, triangles: 0..0 };
        self.pairs.push([unknown.clone(), unknown]);
        let halves = [self.child(range.start..split, depth + 1), self.child(split..range.end, depth + 1)];
        self.pairs[at] = halves;
        BvhChild { bounds, halves: Some(at as u32), triangles }
    }

    /// Sorts a set so that its halves are contiguous. Returns the size of the first one.
    fn split(&mut self, range: Range<usize>, depth: u32) -> usize {
        let (bounds, middles) = (&self.bounds, &self.middles);
        let set = &mut self.order[range];
        let spread = set.iter().fold([[u32::MAX; 3], [0; 3]], |b, at| join(b, [middles[*at as usize]; 2]));
        let wide = |axis: usize| spread[1][axis] - spread[0][axis];
        let longest = (0..3).max_by_key(|axis| wide(*axis)).unwrap_or(0);
        let bin = |at: u32, axis: usize| {
            let along = u64::from(middles[at as usize][axis] - spread[0][axis]);
            (along * BINS as u64 / (u64::from(wide(axis)) + 1)) as usize
        };
        let mut best = (f64::INFINITY, 0, 0);
        for axis in (0..3).filter(|axis| wide(*axis) > 0 && depth < HALVING_DEPTH) {
            let mut bins = [(NOTHING, 0usize); BINS];
            for at in set.iter() {
                let bin = &mut bins[bin(*at, axis)];
                *bin = (join(bin.0, bounds[*at as usize]), bin.1 + 1);
            }
            let mut above = [(NOTHING, 0usize); BINS + 1];
            for k in (0..BINS).rev() {
                above[k] = (join(above[k + 1].0, bins[k].0), above[k + 1].1 + bins[k].1);
            }
            let mut below = (NOTHING, 0usize);
            for k in 1..BINS {
                below = (join(below.0, bins[k - 1].0), below.1 + bins[k - 1].1);
                let cost = surface(below.0) * below.1 as f64 + surface(above[k].0) * above[k].1 as f64;
                if below.1 > 0 && above[k].1 > 0 && cost < best.0 {
                    best = (cost, axis, k);
                }
            }
        }
        let (cost, axis, first) = best;
        if cost.is_finite() {
            set.sort_by_key(|at| bin(*at, axis) >= first);
            set.iter().take_while(|at| bin(**at, axis) < first).count()
        } else {
            set.sort_by_key(|at| middles[*at as usize][longest]);
            set.len() / 2
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_test_support::rng::Rng;

    /// Depth below a child, whose triangles are checked to be in their boxes and each in one leaf.
    fn check(tree: &Bvh, child: &BvhChild, corners: &[[[u32; 3]; 3]], seen: &mut [u32]) -> usize {
        let Some(pair) = child.halves else {
            for at in &tree.order[child.triangles.start as usize..child.triangles.end as usize] {
                seen[*at as usize] += 1;
                assert_eq!(join(child.bounds, bounds_of(&corners[*at as usize])), child.bounds);
            }
            assert!(child.triangles.len() <= LEAF_TRIANGLES);
            return 0;
        };
        let halves = &tree.pairs[pair as usize];
        halves.iter().for_each(|half| assert_eq!(join(child.bounds, half.bounds), child.bounds));
        1 + halves.iter().map(|half| check(tree, half, corners, seen)).max().unwrap()
    }

    #[test]
    fn every_triangle_is_in_one_leaf_and_trees_fit_the_stack() {
        let mut rng = Rng::new(1);
        let mut random = |below: u32| rng.below_u32(below);
        for (count, side) in [(0, 9), (1, 9), (3, 9), (4, 1), (700, 1), (700, 4), (3000, 60_000)] {
            let mut corners: Vec<[[u32; 3]; 3]> = (0..count)
                .map(|_| {
                    let p: [u32; 3] = std::array::from_fn(|_| random(side));
                    std::array::from_fn(|_| p.map(|v| v + random(20)))
                })
                .collect();
            // Ever smaller triangles, ever nearer to one corner: splits by surface would split off one at a time.
            corners.extend((0..count.min(40)).map(|k| [[u32::from(u16::MAX) >> (k % 16); 3]; 3]));
            let tree = Bvh::of(&corners);
            let mut seen = vec![0; corners.len()];
            let depth = check(&tree, &tree.root, &corners, &mut seen);
            assert!(seen.iter().all(|times| *times == 1) && depth + 1 < super::super::TRAVERSAL_STACK, "{depth}");
        }
    }
}
