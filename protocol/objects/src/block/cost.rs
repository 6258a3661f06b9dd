//! Estimated sizes of coded columns after zstd, by which the encoder chooses a coding.
//!
//! The estimate is the order-0 entropy of each byte plane. It is computed in integers, so that equal input gives equal bytes on
//! every platform.

use super::BLOCK_OBJECTS;

/// Fractional bits of a [`Cost`].
const FRACTION: u32 = 16;
/// Cost of a plane that is not constant, and of each of its symbols: roughly the table of its code.
const PLANE_OVERHEAD: Cost = bits(32);
const SYMBOL_OVERHEAD: Cost = bits(2);

/// Bits in 1/65536.
pub(super) type Cost = u64;

pub(super) const fn bits(bits: u64) -> Cost {
    bits << FRACTION
}

/// `n log2(n)` in bits, for each count of values.
const ENTROPY_TERMS: [Cost; BLOCK_OBJECTS + 1] = {
    let mut terms = [0; BLOCK_OBJECTS + 1];
    let mut n = 1;
    while n <= BLOCK_OBJECTS {
        terms[n] = n as u64 * log2(n as u64);
        n += 1;
    }
    terms
};

/// The logarithm to base 2 in 1/65536, rounded down: each squaring of the mantissa gives one digit.
const fn log2(n: u64) -> u64 {
    let exponent = n.ilog2();
    let mut mantissa = (n << 32) >> exponent;
    let mut result = (exponent as u64) << FRACTION;
    let mut digit = FRACTION;
    while digit > 0 {
        digit -= 1;
        mantissa = ((mantissa as u128 * mantissa as u128) >> 32) as u64;
        if mantissa >= 2 << 32 {
            mantissa >>= 1;
            result |= 1 << digit;
        }
    }
    result
}

/// The cost of at most [`BLOCK_OBJECTS`] bytes.
pub(super) fn of_plane(bytes: impl Iterator<Item = u8>) -> Cost {
    let mut counts = [0u16; 256];
    let mut n = 0usize;
    for byte in bytes {
        counts[usize::from(byte)] += 1;
        n += 1;
    }
    let term = |n: usize| ENTROPY_TERMS.get(n).copied().unwrap_or(bits(10) * n as u64);
    let coded = counts.iter().filter(|count| **count > 0).map(|count| term(usize::from(*count))).sum::<Cost>();
    let entropy = term(n).saturating_sub(coded);
    let symbols = counts.iter().filter(|count| **count > 0).count() as u64;
    let coded = entropy + PLANE_OVERHEAD + symbols * SYMBOL_OVERHEAD;
    if entropy == 0 { bits(8) } else { coded.min(bits(8 * n as u64)) }
}

/// The cost of any number of bytes of text.
pub(super) fn of_text(bytes: &[u8]) -> Cost {
    bytes.chunks(BLOCK_OBJECTS).map(|chunk| of_plane(chunk.iter().copied())).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn logarithms_and_entropies_are_right() {
        for n in 1..=BLOCK_OBJECTS as u64 {
            let expected = (n as f64).log2() * f64::from(1 << FRACTION);
            assert!((log2(n) as f64 - expected).abs() < 1.5, "{n}");
        }
        let half = of_plane((0..512).map(|i| i as u8 & 1)) - PLANE_OVERHEAD - 2 * SYMBOL_OVERHEAD;
        assert!(half.abs_diff(bits(512)) < bits(1));
        assert_eq!(of_plane((0..512).map(|_| 7)), bits(8));
        assert_eq!(of_plane((0..512).map(|i| i as u8)), bits(8 * 512));
    }
}
