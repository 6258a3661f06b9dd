//! An adaptive binary range coder.
//!
//! The coder is the carry-propagating one of LZMA (Martin 1979, normalised byte by byte). Models count the bits that
//! they have seen and adapt fast at first, because a tile has only some thousand symbols.
//!
//! Encoder and decoder share the trait [`BitCoder`], so that a format is written down once, as a walk over its values.

const BITS: u32 = 15;
/// The range is at least this after normalisation.
const TOP: u32 = 1 << 24;
/// Number of bits after which a model's adaptation rate stays constant.
const MEMORY: u8 = 40;

/// How far a model moves towards its `n`-th bit, in 1/65536. All `u8` indices are valid.
const STEP: [u16; 256] = {
    let mut steps = [0; 256];
    let mut n = 0;
    while n < steps.len() {
        let seen = if n < MEMORY as usize { n } else { MEMORY as usize };
        steps[n] = (65536 * 2 / (2 * seen + 3)) as u16;
        n += 1;
    }
    steps
};

/// The adaptive probability that a bit is set.
#[derive(Debug, Clone, Copy)]
pub struct BitModel {
    /// Probability in 1/65536.
    set: u16,
    /// Number of bits seen, at most [`MEMORY`].
    seen: u8,
}

impl Default for BitModel {
    fn default() -> Self {
        Self::NEW
    }
}

impl BitModel {
    /// Probability 1/2.
    pub(crate) const NEW: Self = Self { set: 1 << 15, seen: 0 };

    /// The probability in `1 / (1 << BITS)`. It is never 0 or 1, because [`BitModel::learn`] moves by less than the
    /// rest.
    #[inline]
    fn probability(self) -> u32 {
        u32::from(self.set) >> (16 - BITS)
    }

    #[inline]
    fn learn(&mut self, bit: bool) {
        let step = u32::from(STEP[usize::from(self.seen)]);
        let set = u32::from(self.set);
        self.set = if bit { set + (((65535 - set) * step) >> 16) } else { set - ((set * step) >> 16) } as u16;
        self.seen += u8::from(self.seen < MEMORY);
    }
}

/// Models of a signed number that is usually near zero.
#[derive(Debug, Clone, Default)]
pub struct NumberModel {
    zero: BitModel,
    negative: BitModel,
    /// Whether the absolute value is greater than 1, 2, ..., [`UNARY`].
    greater: [BitModel; UNARY],
    /// Beyond [`UNARY`]: whether the rest has another binary digit, and its highest digits.
    digits: [BitModel; 16],
    high: [BitModel; 16],
}

/// Largest absolute value that is coded in unary.
const UNARY: usize = 12;

/// Writes or reads bits. A writer writes its argument and returns it; a reader ignores it and returns what it read.
///
/// A format is one function over a `BitCoder` and its values. It replaces each value by what the coder returns.
pub trait BitCoder {
    /// Whether arguments count. A reader's arguments may have any value.
    const WRITES: bool;

    /// Codes one bit.
    fn bit(&mut self, model: &mut BitModel, bit: bool) -> bool;

    /// Codes a number of at most 16 binary digits. Small absolute values are the cheapest.
    #[inline]
    fn number(&mut self, model: &mut NumberModel, value: i32) -> i32 {
        if self.bit(&mut model.zero, value == 0) { 0 } else { self.nonzero_number(model, value) }
    }

    /// Codes the rest of a number that is not zero.
    #[inline(never)]
    fn nonzero_number(&mut self, model: &mut NumberModel, value: i32) -> i32 {
        let negative = self.bit(&mut model.negative, value < 0);
        let magnitude = value.unsigned_abs();
        let mut known = 1u32;
        while known <= UNARY as u32 {
            if !self.bit(&mut model.greater[known as usize - 1], magnitude > known) {
                return if negative { -(known as i32) } else { known as i32 };
            }
            known += 1;
        }
        // A reader's magnitude may be smaller than `known`.
        let rest = magnitude.wrapping_sub(known).wrapping_add(1);
        let mut digits = 0usize;
        while digits < 15 && self.bit(&mut model.digits[digits], rest >> (digits + 1) != 0) {
            digits += 1;
        }
        let mut value = 1;
        for digit in (0..digits).rev() {
            let mut even = BitModel::default();
            let model = if digit + 1 == digits { &mut model.high[digits] } else { &mut even };
            value = value << 1 | u32::from(self.bit(model, rest >> digit & 1 != 0));
        }
        let magnitude = (value - 1 + known) as i32;
        if negative { -magnitude } else { magnitude }
    }

    /// Codes one of `models.len() + 1` values, which must be a power of two: one bit per digit, highest first.
    fn choice(&mut self, models: &mut [BitModel], value: u32) -> u32 {
        let digits = (models.len() + 1).ilog2();
        let mut node = 1;
        for digit in (0..digits).rev() {
            let bit = self.bit(&mut models[node - 1], value >> digit & 1 != 0);
            node = node << 1 | usize::from(bit);
        }
        node as u32 - (1 << digits)
    }
}

/// Whether a flag is the same for all members of a group. If it is, members need no bits of their own.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) enum GroupFlag {
    #[default]
    Unset,
    Set,
    /// Each member has its own bit.
    Mixed,
}

impl GroupFlag {
    pub(crate) fn of(members: impl Iterator<Item = bool>) -> Self {
        let (mut set, mut unset) = (false, false);
        for member in members {
            set |= member;
            unset |= !member;
        }
        match (set, unset) {
            (false, _) => Self::Unset,
            (true, false) => Self::Set,
            (true, true) => Self::Mixed,
        }
    }

    pub(crate) fn code(self, coder: &mut impl BitCoder, models: &mut [BitModel; 2]) -> Self {
        if coder.bit(&mut models[0], self == Self::Unset) {
            Self::Unset
        } else if coder.bit(&mut models[1], self == Self::Set) {
            Self::Set
        } else {
            Self::Mixed
        }
    }

    #[inline]
    pub(crate) fn bit(self, coder: &mut impl BitCoder, model: &mut BitModel, bit: bool) -> bool {
        match self {
            Self::Unset => false,
            Self::Set => true,
            Self::Mixed => coder.bit(model, bit),
        }
    }
}

/// Writes bits to bytes.
#[derive(Debug, Clone)]
pub(crate) struct RangeEncoder {
    low: u64,
    range: u32,
    /// The last byte that a carry may still change.
    held: Option<u8>,
    /// Number of 0xff bytes after `held`.
    held_full: usize,
    bytes: Vec<u8>,
}

impl Default for RangeEncoder {
    fn default() -> Self {
        Self { low: 0, range: u32::MAX, held: None, held_full: 0, bytes: Vec::new() }
    }
}

impl RangeEncoder {
    /// The encoded bytes without trailing zeros, which a decoder assumes anyway.
    pub(crate) fn finish(mut self) -> Vec<u8> {
        // Any number inside the range is valid: take the one with the most trailing zeros.
        let end = self.low + u64::from(self.range);
        let rounded = |zeros: u32| (self.low + (1 << zeros) - 1) >> zeros << zeros;
        self.low = (0..32).rev().map(rounded).find(|low| *low < end).unwrap_or(self.low);
        for _ in 0..5 {
            self.shift();
        }
        if let Some(byte) = self.held {
            self.bytes.push(byte);
        }
        while self.bytes.last() == Some(&0) {
            self.bytes.pop();
        }
        self.bytes
    }

    fn shift(&mut self) {
        let carry = (self.low >> 32) as u8;
        // No carry passes the first byte, because the coded fraction is below one.
        if carry != 0 || self.low < 0xff00_0000 || self.held.is_none() {
            if let Some(byte) = self.held {
                self.bytes.push(byte.wrapping_add(carry));
                self.bytes.extend(std::iter::repeat_n(0xffu8.wrapping_add(carry), self.held_full));
            }
            self.held_full = 0;
            self.held = Some((self.low >> 24) as u8);
        } else {
            self.held_full += 1;
        }
        self.low = (self.low & 0x00ff_ffff) << 8;
    }
}

impl BitCoder for RangeEncoder {
    const WRITES: bool = true;

    #[inline]
    fn bit(&mut self, model: &mut BitModel, bit: bool) -> bool {
        let bound = (self.range >> BITS) * model.probability();
        if bit {
            self.range = bound;
        } else {
            self.low += u64::from(bound);
            self.range -= bound;
        }
        model.learn(bit);
        while self.range < TOP {
            self.range <<= 8;
            self.shift();
        }
        bit
    }
}

/// A writer without output, for a walk that only computes what a reader would see.
#[derive(Debug)]
pub(crate) struct NullEncoder;

impl BitCoder for NullEncoder {
    const WRITES: bool = true;

    fn bit(&mut self, _: &mut BitModel, bit: bool) -> bool {
        bit
    }
}

/// Reads what [`RangeEncoder`] wrote. It accepts any bytes and reads zeros past their end.
#[derive(Debug)]
pub(crate) struct RangeDecoder<'a> {
    code: u32,
    range: u32,
    bytes: std::slice::Iter<'a, u8>,
}

impl<'a> RangeDecoder<'a> {
    pub(crate) fn new(bytes: &'a [u8]) -> Self {
        let mut decoder = Self { code: 0, range: u32::MAX, bytes: bytes.iter() };
        for _ in 0..4 {
            decoder.code = decoder.code << 8 | decoder.byte();
        }
        decoder
    }

    /// Number of bytes that were not read.
    pub(crate) fn unread_bytes(&self) -> usize {
        self.bytes.len()
    }

    fn byte(&mut self) -> u32 {
        u32::from(self.bytes.next().copied().unwrap_or(0))
    }
}

impl BitCoder for RangeDecoder<'_> {
    const WRITES: bool = false;

    #[inline]
    fn bit(&mut self, model: &mut BitModel, _: bool) -> bool {
        let bound = (self.range >> BITS) * model.probability();
        let bit = self.code < bound;
        if bit {
            self.range = bound;
        } else {
            self.code -= bound;
            self.range -= bound;
        }
        model.learn(bit);
        while self.range < TOP {
            self.range <<= 8;
            self.code = self.code << 8 | self.byte();
        }
        bit
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_test_support::rng::Rng;

    fn code(coder: &mut impl BitCoder, numbers: &mut [i32], choices: &mut [u32]) {
        let (mut number, mut choice) = (NumberModel::default(), [BitModel::default(); 15]);
        for (value, chosen) in numbers.iter_mut().zip(choices) {
            *value = coder.number(&mut number, *value);
            *chosen = coder.choice(&mut choice, *chosen);
        }
    }

    #[test]
    fn numbers_and_choices_round_trip() {
        let number = |i: i32| (i * i % 37 - 18) * if i % 50 == 0 { 1800 } else { 1 };
        let mut numbers: Vec<i32> = (0..3000).map(number).collect();
        numbers.extend([0, 1, -1, 12, 13, -13, 14, 65535, -65535, 65547]);
        let mut choices: Vec<u32> = (0..numbers.len() as u32).map(|i| i * i % 16).collect();
        let mut encoder = RangeEncoder::default();
        code(&mut encoder, &mut numbers.clone(), &mut choices.clone());
        let bytes = encoder.finish();
        let (expected, expected_choices) = (numbers.clone(), choices.clone());
        numbers.fill(0);
        choices.fill(0);
        let mut decoder = RangeDecoder::new(&bytes);
        code(&mut decoder, &mut numbers, &mut choices);
        assert!(numbers == expected && choices == expected_choices);
        assert_eq!(decoder.unread_bytes(), 0);
    }

    #[test]
    fn constant_bits_take_almost_no_bytes() {
        let mut encoder = RangeEncoder::default();
        let mut model = BitModel::default();
        for _ in 0..20_000 {
            encoder.bit(&mut model, false);
        }
        let bytes = encoder.finish();
        assert!(bytes.len() < 12, "{}", bytes.len());
    }

    #[test]
    fn carries_propagate_over_full_bytes() {
        let mut rng = Rng::new(1);
        for full in 0..60 {
            // Unbiased bits, the first ones all 0.
            let bits: Vec<bool> = (0..100).map(|i| i > full && rng.chance(0.5)).collect();
            let mut encoder = RangeEncoder::default();
            bits.iter().for_each(|bit| _ = encoder.bit(&mut BitModel::default(), *bit));
            let bytes = encoder.finish();
            let mut decoder = RangeDecoder::new(&bytes);
            assert!(bits.iter().all(|bit| decoder.bit(&mut BitModel::default(), false) == *bit), "{full}");
        }
    }
}
