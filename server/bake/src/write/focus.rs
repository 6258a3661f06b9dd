//! Which part of a city one sees first: where most of it is.

/// A gap of this share of the extent, in which there is no leaf, divides a city: between its parts there is nothing to see.
const GAP_SHARE: f64 = 0.35;
/// Smaller gaps, in leaves, divide nothing: one sees both sides.
const MIN_GAP: u32 = 16;

/// The leaves in the south-west and north-east corner of the rectangle between the first and the ninth decile of the leaves' bytes, along x
/// and along y. Of a city that is divided by wide gaps, only the part with most bytes counts. `None` without leaves.
pub(super) fn of_leaves(mut leaves: Vec<([u32; 2], u32)>) -> Option<[[u32; 2]; 2]> {
    while let Some(part) = (0..2).find_map(|axis| heavier_part(&mut leaves, axis)) {
        leaves = part;
    }
    let mut ends = [[0; 2]; 2];
    for axis in 0..2 {
        leaves.sort_unstable_by_key(|(leaf, bytes)| (leaf[axis], *bytes));
        for (end, share) in ends.iter_mut().zip([0.1, 0.9]) {
            let wanted = share * weight(&leaves);
            let mut sum = 0.0;
            let found = leaves.iter().find(|(_, bytes)| {
                sum += f64::from(*bytes);
                sum >= wanted
            });
            end[axis] = found.or(leaves.last())?.0[axis];
        }
    }
    Some(ends)
}

/// The part before or after the widest gap along an axis, whichever has more bytes; `None` if no gap is wide.
fn heavier_part(leaves: &mut [([u32; 2], u32)], axis: usize) -> Option<Vec<([u32; 2], u32)>> {
    leaves.sort_unstable_by_key(|(leaf, _)| leaf[axis]);
    let at = |i: usize| leaves[i].0[axis];
    let after = (1..leaves.len()).max_by_key(|i| at(*i) - at(*i - 1))?;
    let (gap, extent) = (at(after) - at(after - 1), at(leaves.len() - 1) - at(0));
    if gap < MIN_GAP || f64::from(gap) < GAP_SHARE * f64::from(extent) {
        return None;
    }
    let (before, after) = leaves.split_at(after);
    Some(if weight(before) >= weight(after) { before } else { after }.to_vec())
}

fn weight(leaves: &[([u32; 2], u32)]) -> f64 {
    leaves.iter().map(|(_, bytes)| f64::from(*bytes)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The leaves of a square.
    fn square(corner: [u32; 2], side: u32, bytes: u32) -> Vec<([u32; 2], u32)> {
        (0..side * side).map(|i| ([corner[0] + i % side, corner[1] + i / side], bytes)).collect()
    }

    #[test]
    fn the_middle_four_fifths_are_seen_first() {
        assert_eq!(of_leaves(square([100, 200], 20, 7)), Some([[101, 201], [117, 217]]));
        assert_eq!(of_leaves(vec![([3, 4], 0)]), Some([[3, 4]; 2]));
        assert_eq!(of_leaves(Vec::new()), None);
    }

    #[test]
    fn of_parts_far_apart_the_heaviest_is_seen() {
        let parts =
            |bytes: u32| [square([0, 0], 10, 500), square([300, 10], 10, bytes), square([310, 400], 10, 400)].concat();
        assert_eq!(of_leaves(parts(600)), Some([[300, 10], [308, 18]]));
        assert_eq!(of_leaves(parts(50)), Some([[0, 0], [8, 8]]));
        // A river of 10 leaves between two halves.
        let halves = [square([0, 0], 10, 5), square([20, 0], 10, 5)].concat();
        assert_eq!(of_leaves(halves), Some([[1, 0], [27, 8]]));
    }
}
