//! Coding of differences of 16-bit numbers whose approximate size is known from context.

use crate::codec::rans::{RAW, SymbolCoder, SymbolModel};

/// Number of values of [`digits`].
pub(super) const DIGIT_COUNTS: usize = 18;

/// Codes a difference as its sign and number of binary digits, the second digit, and raw digits.
#[derive(Debug)]
pub(super) struct DifferenceCoder {
    /// Sign and number of digits, by each of two contexts: 0 for zero, else twice the digits, less 1 if positive.
    digits: [Vec<SymbolModel<32>>; 2],
    /// The digit after the highest, by number of digits.
    second: [SymbolModel<2>; 17],
}

impl DifferenceCoder {
    /// `contexts` are the numbers of values of the two contexts.
    pub(super) fn new(contexts: [usize; 2]) -> Self {
        let model = || SymbolModel::new(|symbol| if symbol < 26 { 4 } else { 1 });
        Self { digits: contexts.map(|count| vec![model(); count]), second: [(); 17].map(|()| SymbolModel::default()) }
    }

    /// Codes `value` as its difference from `expected`, all modulo 65536.
    #[inline]
    pub(super) fn code<C: SymbolCoder>(
        &mut self,
        coder: &mut C,
        contexts: [usize; 2],
        value: i32,
        expected: i32,
    ) -> i32 {
        // From -32767 to 32768, so that 16 digits are always positive.
        let difference = (value.wrapping_sub(expected).wrapping_add(32767) & 0xffff) - 32767;
        let magnitude = difference.unsigned_abs();
        let digits = 32 - magnitude.leading_zeros();
        let symbol = (2 * digits).saturating_sub(u32::from(difference > 0));
        let [a, b] = &mut self.digits;
        let symbol = coder.pair(&mut a[contexts[0]], &mut b[contexts[1]], symbol as usize);
        if symbol == 0 {
            return expected & 0xffff;
        }
        let digits = symbol.div_ceil(2) as u32;
        let mut read = 1;
        let mut remaining = digits - 1;
        if remaining > 0 {
            remaining -= 1;
            let second = magnitude >> remaining & 1 == 1;
            read = 2 | u32::from(coder.flag(&mut self.second[digits as usize], second));
        }
        while remaining > 0 {
            let bits = remaining.min(RAW);
            remaining -= bits;
            read = read << bits | coder.raw(bits, magnitude >> remaining & ((1 << bits) - 1));
        }
        let difference = if symbol % 2 == 1 { read as i32 } else { -(read as i32) };
        expected.wrapping_add(difference) & 0xffff
    }
}

/// The number of binary digits of `|v|`, at most 17.
#[inline]
pub(super) fn digits(v: i32) -> usize {
    ((32 - v.unsigned_abs().leading_zeros()) as usize).min(17)
}
