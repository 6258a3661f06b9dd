//! Guesses of a column's value from those already known: what is left over is small and packs well.

use super::{COLUMNS, NODE_CELLS};

/// Median edge detector (LOCO-I; Weinberger et al. 2000) over the occupied columns west, north-west... of `i`, in raster
/// order: `known(j)` tells whether column j < i has a value. Falls back to what is there, then to `last`.
pub(super) fn guess(values: &[u16], known: impl Fn(usize) -> bool, i: usize, last: u16) -> u16 {
    debug_assert!(i < COLUMNS);
    let (x, y) = (i % NODE_CELLS, i / NODE_CELLS);
    let west = (x > 0 && known(i - 1)).then(|| values[i - 1]);
    let south = (y > 0 && known(i - NODE_CELLS)).then(|| values[i - NODE_CELLS]);
    let corner = (x > 0 && y > 0 && known(i - NODE_CELLS - 1)).then(|| values[i - NODE_CELLS - 1]);
    match (west, south, corner) {
        (Some(w), Some(s), Some(c)) => {
            if c >= w.max(s) {
                w.min(s)
            } else if c <= w.min(s) {
                w.max(s)
            } else {
                w.wrapping_add(s).wrapping_sub(c)
            }
        }
        (Some(v), _, _) | (None, Some(v), _) => v,
        _ => last,
    }
}

/// Residuals as two planes: low bytes, then high bytes.
pub(super) fn push_planes(out: &mut Vec<u8>, values: &[u16]) {
    out.extend(values.iter().map(|v| *v as u8));
    out.extend(values.iter().map(|v| (*v >> 8) as u8));
}

/// Undoes [`push_planes`]; `bytes` has an even number of bytes.
pub(super) fn read_planes(bytes: &[u8]) -> Vec<u16> {
    let (low, high) = bytes.split_at(bytes.len() / 2);
    low.iter().zip(high).map(|(l, h)| u16::from_le_bytes([*l, *h])).collect()
}

/// Difference of two 16-bit numbers, small of either sign near zero.
pub(super) fn residual(value: u16, guess: u16) -> u16 {
    let d = value.wrapping_sub(guess) as i16;
    ((d << 1) ^ (d >> 15)) as u16
}

/// Undoes [`residual`].
pub(super) fn restore(residual: u16, guess: u16) -> u16 {
    let d = (residual >> 1) ^ (residual & 1).wrapping_neg();
    guess.wrapping_add(d)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn residuals_round_trip() {
        for (a, b) in [(0, 0), (1, 0), (0, 1), (4095, 0), (0, 4095), (65535, 0), (32768, 0), (12, 700)] {
            assert_eq!(restore(residual(a, b), b), a);
        }
        assert_eq!(residual(5, 6), 1);
        let mut bytes = Vec::new();
        push_planes(&mut bytes, &[1, 515]);
        assert_eq!(read_planes(&bytes), [1, 515]);
    }
}
