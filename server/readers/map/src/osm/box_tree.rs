//! Finds the boxes that overlap a box: a static tree over boxes in the order of a space-filling curve.

use super::cover::Bounds;

const FAN_OUT: usize = 16;

/// Boxes that are found by place.
#[derive(Debug, Default)]
pub(super) struct BoxTree {
    /// Number of each leaf's box.
    leaves: Vec<u32>,
    /// Bounds by level from the leaves to the root; each of a level is around [`FAN_OUT`] of the level below.
    levels: Vec<Vec<Bounds>>,
}

impl BoxTree {
    pub(super) fn new(boxes: impl Iterator<Item = Bounds>) -> Self {
        let mut sorted: Vec<(u64, u32, Bounds)> =
            boxes.zip(0..).map(|(bounds, i)| (curve(bounds), i, bounds)).collect();
        sorted.sort_unstable();
        let leaves = sorted.iter().map(|(_, i, _)| *i).collect();
        let mut levels: Vec<Vec<Bounds>> = vec![sorted.iter().map(|(_, _, bounds)| *bounds).collect()];
        while let Some(below) = levels.last().filter(|below| below.len() > 1) {
            let around = |boxes: &[Bounds]| {
                boxes.iter().fold([i32::MAX, i32::MAX, i32::MIN, i32::MIN], |a, b| {
                    [a[0].min(b[0]), a[1].min(b[1]), a[2].max(b[2]), a[3].max(b[3])]
                })
            };
            let level = below.chunks(FAN_OUT).map(around).collect();
            levels.push(level);
        }
        Self { leaves, levels }
    }

    /// Calls `found` with the number of each box that overlaps or touches `bounds`.
    pub(super) fn overlapping(&self, bounds: Bounds, mut found: impl FnMut(u32)) {
        let overlaps = |b: &Bounds| b[0] <= bounds[2] && bounds[0] <= b[2] && b[1] <= bounds[3] && bounds[1] <= b[3];
        let mut open = vec![(self.levels.len().saturating_sub(1), 0)];
        while let Some((level, i)) = open.pop() {
            if !self.levels.get(level).and_then(|boxes| boxes.get(i)).is_some_and(overlaps) {
                continue;
            }
            if level == 0 {
                found(self.leaves[i]);
            } else {
                open.extend((i * FAN_OUT..(i + 1) * FAN_OUT).map(|below| (level - 1, below)));
            }
        }
    }
}

/// Place of a box's middle along a curve through all places (Z order).
fn curve([west, south, east, north]: Bounds) -> u64 {
    let spread = |low: i32, high: i32| {
        let middle = ((i64::from(low) + i64::from(high)) / 2 - i64::from(i32::MIN)) as u64;
        (0..32).fold(0, |bits, bit| bits | (middle >> bit & 1) << (2 * bit))
    };
    spread(west, east) | spread(south, north) << 1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_overlapping_boxes_are_found() {
        let mut seed = 7_u32;
        let mut random = |n: u32| {
            seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (seed >> 8) as i32 % n as i32
        };
        let mut boxes = |count: usize| -> Vec<Bounds> {
            (0..count)
                .map(|_| {
                    let (x, y) = (random(10_000) - 5000, random(10_000) - 5000);
                    [x, y, x + random(300), y + random(300)]
                })
                .collect()
        };
        let known = boxes(700);
        let tree = BoxTree::new(known.iter().copied());
        for asked in boxes(200) {
            let mut found = Vec::new();
            tree.overlapping(asked, |i| found.push(i as usize));
            found.sort_unstable();
            let overlaps = |b: &Bounds| b[0] <= asked[2] && asked[0] <= b[2] && b[1] <= asked[3] && asked[1] <= b[3];
            let expected: Vec<usize> = (0..known.len()).filter(|i| overlaps(&known[*i])).collect();
            assert_eq!(found, expected);
        }
        BoxTree::new(std::iter::empty()).overlapping([0; 4], |_| panic!("nothing there"));
    }
}
