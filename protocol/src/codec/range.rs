//! An adaptive binary range coder: bits in as few bits as their past makes them likely.
//!
//! The coder is the carry-propagating one of LZMA (Martin 1979, byte-wise normalised); the models count what they saw and
//! learn fast at first, as a tile has only some thousand symbols.
//!
//! RangeEncoder and decoder share one trait, so that a format is written down once, as a walk over its values: see [`BitCoder`].

/// Bits of a probability.
const BITS: u32 = 15;
/// Below this the range takes another byte.
const TOP: u32 = 1 << 24;
/// After so many bits a model's memory stays as short as it is.
const MEMORY: u8 = 40;

/// How far a model moves towards its `n`-th bit, in 1/65536; the last goes on for all counts that fit, so that none is out of range.
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

/// The model of one kind of bit: how likely it is set.
#[derive(Debug, Clone, Copy)]
pub struct BitModel {
    /// Of 65536.
    set: u16,
    seen: u8,
}

impl Default for BitModel {
    fn default() -> Self {
        Self::NEW
    }
}

impl BitModel {
    /// Nothing seen yet.
    pub const NEW: Self = Self { set: 1 << 15, seen: 0 };

    /// Of `1 << BITS`; never none or all, as [`BitModel::learn`] moves by less than what is left.
    #[inline]
    fn likely(self) -> u32 {
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

/// Model of a whole number near zero.
#[derive(Debug, Clone, Default)]
pub struct NumberModel {
    zero: BitModel,
    negative: BitModel,
    /// Whether it is further from zero than 1, 2, ...
    further: [BitModel; UNARY],
    /// Beyond [`UNARY`]: whether the rest has another binary digit, and its highest digits.
    digits: [BitModel; 16],
    high: [BitModel; 16],
}

/// Distances from zero that have a bit each.
const UNARY: usize = 12;

/// Writes or reads: `bit` writes its argument and returns it, or ignores it and returns what was written.
///
/// A format is one function over a `BitCoder` and the values: each value is replaced by what the coder returns for it.
pub trait BitCoder {
    /// Whether arguments count; a decoder's may be anything.
    const WRITES: bool;

    /// One bit.
    fn bit(&mut self, model: &mut BitModel, bit: bool) -> bool;

    /// A number, best one near zero, of at most 16 binary digits.
    #[inline]
    fn number(&mut self, model: &mut NumberModel, value: i32) -> i32 {
        if self.bit(&mut model.zero, value == 0) { 0 } else { self.other_number(model, value) }
    }

    /// [`BitCoder::number`] of what is not zero.
    #[inline(never)]
    fn other_number(&mut self, model: &mut NumberModel, value: i32) -> i32 {
        let negative = self.bit(&mut model.negative, value < 0);
        let distance = value.unsigned_abs();
        let mut known = 1u32;
        while known <= UNARY as u32 {
            if !self.bit(&mut model.further[known as usize - 1], distance > known) {
                return if negative { -(known as i32) } else { known as i32 };
            }
            known += 1;
        }
        // Of a decoder the distance may be anything.
        let rest = distance.wrapping_sub(known).wrapping_add(1);
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
        let distance = (value - 1 + known) as i32;
        if negative { -distance } else { distance }
    }

    /// One of `models.len() + 1` values, a power of two: a bit a model, from the highest.
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

/// How many of a group's members have a bit set: said once, it spares the members their bits where all are alike.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum GroupFlag {
    /// None has.
    #[default]
    Unset,
    /// All have.
    Set,
    /// Each says for itself.
    Mixed,
}

impl GroupFlag {
    /// Of these members.
    pub fn of(members: impl Iterator<Item = bool>) -> Self {
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

    /// Writes or reads the share.
    pub fn code(self, coder: &mut impl BitCoder, models: &mut [BitModel; 2]) -> Self {
        if coder.bit(&mut models[0], self == Self::Unset) {
            Self::Unset
        } else if coder.bit(&mut models[1], self == Self::Set) {
            Self::Set
        } else {
            Self::Mixed
        }
    }

    /// One member's bit.
    #[inline]
    pub fn bit(self, coder: &mut impl BitCoder, model: &mut BitModel, bit: bool) -> bool {
        match self {
            Self::Unset => false,
            Self::Set => true,
            Self::Mixed => coder.bit(model, bit),
        }
    }
}

/// Collects bytes.
#[derive(Debug, Clone)]
pub struct RangeEncoder {
    low: u64,
    range: u32,
    /// The last byte that a carry may still change, and how many 0xff follow it.
    held: Option<u8>,
    full: usize,
    bytes: Vec<u8>,
}

impl Default for RangeEncoder {
    fn default() -> Self {
        Self { low: 0, range: u32::MAX, held: None, full: 0, bytes: Vec::new() }
    }
}

impl RangeEncoder {
    /// All bytes; zeros at the end are left out, a decoder reads them anyway.
    pub fn finish(mut self) -> Vec<u8> {
        // Any number of the range will do: the one with most zeros.
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
        // No carry goes beyond the first byte: all that is coded is a fraction under one.
        if carry != 0 || self.low < 0xff00_0000 || self.held.is_none() {
            if let Some(byte) = self.held {
                self.bytes.push(byte.wrapping_add(carry));
                self.bytes.extend(std::iter::repeat_n(0xffu8.wrapping_add(carry), self.full));
            }
            self.full = 0;
            self.held = Some((self.low >> 24) as u8);
        } else {
            self.full += 1;
        }
        self.low = (self.low & 0x00ff_ffff) << 8;
    }
}

impl BitCoder for RangeEncoder {
    const WRITES: bool = true;

    #[inline]
    fn bit(&mut self, model: &mut BitModel, bit: bool) -> bool {
        let bound = (self.range >> BITS) * model.likely();
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

/// Writes nothing: for a walk that is only to show what a reader would see.
#[derive(Debug)]
pub struct NullEncoder;

impl BitCoder for NullEncoder {
    const WRITES: bool = true;

    fn bit(&mut self, _: &mut BitModel, bit: bool) -> bool {
        bit
    }
}

/// Reads what [`RangeEncoder`] wrote. Any bytes can be read; past their end there are zeros.
#[derive(Debug)]
pub struct RangeDecoder<'a> {
    code: u32,
    range: u32,
    bytes: std::slice::Iter<'a, u8>,
}

impl<'a> RangeDecoder<'a> {
    /// From the first byte on.
    pub fn new(bytes: &'a [u8]) -> Self {
        let mut decoder = Self { code: 0, range: u32::MAX, bytes: bytes.iter() };
        for _ in 0..4 {
            decoder.code = decoder.code << 8 | decoder.byte();
        }
        decoder
    }

    /// How many bytes were not looked at.
    pub fn left(&self) -> usize {
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
        let bound = (self.range >> BITS) * model.likely();
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

    fn walk(coder: &mut impl BitCoder, numbers: &mut [i32], choices: &mut [u32]) {
        let (mut number, mut choice) = (NumberModel::default(), [BitModel::default(); 15]);
        for (value, chosen) in numbers.iter_mut().zip(choices) {
            *value = coder.number(&mut number, *value);
            *chosen = coder.choice(&mut choice, *chosen);
        }
    }

    #[test]
    fn what_was_written_is_read() {
        let number = |i: i32| (i * i % 37 - 18) * if i % 50 == 0 { 1800 } else { 1 };
        let mut numbers: Vec<i32> = (0..3000).map(number).collect();
        numbers.extend([0, 1, -1, 12, 13, -13, 14, 65535, -65535, 65547]);
        let mut choices: Vec<u32> = (0..numbers.len() as u32).map(|i| i * i % 16).collect();
        let mut encoder = RangeEncoder::default();
        walk(&mut encoder, &mut numbers.clone(), &mut choices.clone());
        let bytes = encoder.finish();
        let (wanted, wanted_choices) = (numbers.clone(), choices.clone());
        numbers.fill(0);
        choices.fill(0);
        let mut decoder = RangeDecoder::new(&bytes);
        walk(&mut decoder, &mut numbers, &mut choices);
        assert!(numbers == wanted && choices == wanted_choices);
        assert_eq!(decoder.left(), 0);
    }

    #[test]
    fn what_is_always_the_same_costs_next_to_nothing() {
        let mut encoder = RangeEncoder::default();
        let mut model = BitModel::default();
        for _ in 0..20_000 {
            encoder.bit(&mut model, false);
        }
        let bytes = encoder.finish();
        assert!(bytes.len() < 12, "{}", bytes.len());
    }

    #[test]
    fn carries_reach_back_over_full_bytes() {
        for full in 0..60 {
            // Bits as likely as not: a byte a number, the first ones full.
            let bits: Vec<bool> = (0..100u32).map(|i| i > full && i.wrapping_mul(2_654_435_761) >> 31 == 0).collect();
            let mut encoder = RangeEncoder::default();
            bits.iter().for_each(|bit| _ = encoder.bit(&mut BitModel::default(), *bit));
            let bytes = encoder.finish();
            let mut decoder = RangeDecoder::new(&bytes);
            assert!(bits.iter().all(|bit| decoder.bit(&mut BitModel::default(), false) == *bit), "{full}");
        }
    }
}
