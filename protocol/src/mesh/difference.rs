//! DifferenceCoder of numbers of at most 16 bits, when all that is known of them is about how large they are.
//!
//! In: a difference. Out: symbols: its sign and how many binary digits it has, then the digits. Next: `built`, `attributes`.

use crate::codec::rans::{RAW, SymbolCoder, SymbolModel};

/// What is likely: by two contexts, each with its own models.
#[derive(Debug)]
pub(super) struct DifferenceCoder {
    /// Sign and number of digits: 0 for none, else twice the digits, less 1 if positive.
    digits: [Vec<SymbolModel<32>>; 2],
    /// The digit after the highest.
    second: [SymbolModel<2>; 17],
}

impl DifferenceCoder {
    pub(super) fn new(contexts: [usize; 2]) -> Self {
        let model = || SymbolModel::new(|symbol| if symbol < 26 { 4 } else { 1 });
        Self { digits: contexts.map(|count| vec![model(); count]), second: [(); 17].map(|()| SymbolModel::default()) }
    }

    /// Writes or reads `value`, given as the difference to what was expected; all modulo 65536.
    #[inline]
    pub(super) fn code<C: SymbolCoder>(
        &mut self,
        coder: &mut C,
        contexts: [usize; 2],
        value: i32,
        expected: i32,
    ) -> i32 {
        // From -32767 to 32768: 16 digits are positive.
        let difference = (value.wrapping_sub(expected).wrapping_add(32767) & 0xffff) - 32767;
        let distance = difference.unsigned_abs();
        let digits = 32 - distance.leading_zeros();
        let symbol = (2 * digits).saturating_sub(u32::from(difference > 0));
        let [a, b] = &mut self.digits;
        let symbol = coder.pair(&mut a[contexts[0]], &mut b[contexts[1]], symbol as usize);
        if symbol == 0 {
            return expected & 0xffff;
        }
        let digits = symbol.div_ceil(2) as u32;
        let mut read = 1;
        let mut left = digits - 1;
        if left > 0 {
            left -= 1;
            let second = distance >> left & 1 == 1;
            read = 2 | u32::from(coder.flag(&mut self.second[digits as usize], second));
        }
        while left > 0 {
            let bits = left.min(RAW);
            left -= bits;
            read = read << bits | coder.raw(bits, distance >> left & ((1 << bits) - 1));
        }
        let difference = if symbol % 2 == 1 { read as i32 } else { -(read as i32) };
        expected.wrapping_add(difference) & 0xffff
    }
}

/// How many binary digits `v` has, at most 17.
#[inline]
pub(super) fn digits(v: i32) -> usize {
    ((32 - v.unsigned_abs().leading_zeros()) as usize).min(17)
}
