//! An adaptive entropy coder of symbols from small alphabets, for meshes.
//!
//! The coder is a range asymmetric numeral system (Duda 2009) with states of 32 bits that are renormalised 16 bits at a
//! time. A mesh has a few such symbols per vertex, where [`super::range`] would need about twenty binary decisions.
//!
//! Encoder and decoder share the trait [`SymbolCoder`], so that a format is written down once.

mod model;

use crate::error::DecodeError;
pub(crate) use model::SymbolModel;
use model::{Interval, find, find_out_of_line, interval};

const BITS: u32 = 15;
/// Probability 1.
const ONE: u32 = 1 << BITS;
/// A normalised state is at least this.
const LOW: u32 = 1 << 16;
/// Number of independent states: one for single symbols, and three for [`SymbolCoder::three`], which need not wait for
/// each other.
pub(crate) const LANES: usize = 4;
/// Maximum number of bits of one call of [`SymbolCoder::raw`].
pub(crate) const RAW: u32 = BITS;

/// A model that has learnt `n` symbols moves by `2^-RATES[n]` of the distance to its target.
const RATES: [u8; 128] = {
    let mut rates = [7; 128];
    let mut n = 0;
    while n < rates.len() {
        rates[n] = match n {
            0..=2 => 3,
            3..=9 => 4,
            10..=35 => 5,
            36..=100 => 6,
            _ => 7,
        };
        n += 1;
    }
    rates
};

/// Writes or reads symbols. A writer writes its argument and returns it; a reader ignores it and returns what it read.
pub(crate) trait SymbolCoder {
    /// Whether arguments count. A reader's arguments may have any value.
    const WRITES: bool;

    /// Codes one of `N` symbols.
    fn symbol<const N: usize>(&mut self, model: &mut SymbolModel<N>, symbol: usize) -> usize;

    /// Codes one of `N` symbols with the average of two models. Both learn.
    fn pair<const N: usize>(&mut self, a: &mut SymbolModel<N>, b: &mut SymbolModel<N>, symbol: usize) -> usize;

    /// Codes three symbols, each with its own model, in the second to fourth state.
    fn three<const N: usize>(&mut self, models: [&mut SymbolModel<N>; 3], symbols: [usize; 3]) -> [usize; 3];

    /// Codes `bits` equally likely bits, at most [`RAW`].
    fn raw(&mut self, bits: u32, value: u32) -> u32;

    /// Whether a reader has read far beyond the end of its bytes.
    fn overrun(&self) -> bool;

    #[inline]
    fn flag(&mut self, model: &mut SymbolModel<2>, flag: bool) -> bool {
        self.symbol(model, usize::from(flag)) == 1
    }

    /// Codes a number below 2^32 - 1: its length in binary digits with a model, then its digits as raw bits.
    #[inline(never)]
    fn number(&mut self, model: &mut SymbolModel<32>, value: u32) -> u32 {
        let value = value.wrapping_add(1).max(1);
        let length = self.symbol(model, value.ilog2() as usize) as u32;
        let mut read = 1u32;
        let mut remaining = length;
        while remaining > 0 {
            let bits = remaining.min(RAW);
            remaining -= bits;
            read = read << bits | self.raw(bits, value >> remaining & ((1 << bits) - 1));
        }
        read - 1
    }
}

#[derive(Debug, Clone, Copy)]
struct CodedSymbol {
    start: u16,
    width: u16,
    lane: u16,
}

/// Collects symbols. They are encoded at the end, from the last to the first.
#[derive(Debug, Clone, Default)]
pub(crate) struct RansEncoder {
    symbols: Vec<CodedSymbol>,
}

impl RansEncoder {
    pub(crate) fn with_capacity(symbols: usize) -> Self {
        Self { symbols: Vec::with_capacity(symbols) }
    }

    /// The encoded bytes, an even number. `lanes` is [`LANES`], or 1 if [`SymbolCoder::three`] was never called.
    pub(crate) fn finish(self, lanes: usize) -> Vec<u8> {
        let mut states = [LOW; LANES];
        let mut words = Vec::with_capacity(self.symbols.len() / 4 + 2 * LANES);
        for CodedSymbol { start, width, lane } in self.symbols.into_iter().rev() {
            let state = &mut states[usize::from(lane) % LANES];
            let (start, width) = (u32::from(start), u32::from(width));
            if u64::from(*state) >= u64::from(width) << (32 - BITS) {
                words.push(*state as u16);
                *state >>= 16;
            }
            *state = ((*state / width) << BITS) + *state % width + start;
        }
        for state in states[..lanes].iter().rev() {
            words.push(*state as u16);
            words.push((*state >> 16) as u16);
        }
        words.iter().rev().flat_map(|word| word.to_le_bytes()).collect()
    }

    /// Estimated size of the output in bits.
    pub(crate) fn bits(&self) -> f64 {
        self.symbols.iter().map(|symbol| f64::from(BITS) - libm::log2(f64::from(symbol.width))).sum()
    }

    #[inline]
    fn push(&mut self, interval: Interval, lane: u16) {
        self.symbols.push(CodedSymbol { start: interval.start as u16, width: interval.width as u16, lane });
    }
}

impl SymbolCoder for RansEncoder {
    const WRITES: bool = true;

    #[inline]
    fn symbol<const N: usize>(&mut self, model: &mut SymbolModel<N>, symbol: usize) -> usize {
        self.push(interval(model.starts(), symbol), 0);
        model.learn(symbol);
        symbol
    }

    #[inline]
    fn pair<const N: usize>(&mut self, a: &mut SymbolModel<N>, b: &mut SymbolModel<N>, symbol: usize) -> usize {
        self.push(interval(&a.mean_starts(b), symbol), 0);
        a.learn(symbol);
        b.learn(symbol);
        symbol
    }

    #[inline]
    fn three<const N: usize>(&mut self, models: [&mut SymbolModel<N>; 3], symbols: [usize; 3]) -> [usize; 3] {
        for (lane, (model, symbol)) in (1..).zip(models.into_iter().zip(symbols)) {
            self.push(interval(model.starts(), symbol), lane);
            model.learn(symbol);
        }
        symbols
    }

    #[inline]
    fn raw(&mut self, bits: u32, value: u32) -> u32 {
        if bits > 0 {
            self.push(raw_interval(bits, value), 0);
        }
        value
    }

    fn overrun(&self) -> bool {
        false
    }
}

/// The interval of one of `2^bits` equally likely values.
#[inline(always)]
fn raw_interval(bits: u32, value: u32) -> Interval {
    Interval { start: value << (BITS - bits), width: 1 << (BITS - bits) }
}

/// Reads what [`RansEncoder`] wrote. It accepts any bytes and reads zeros past their end.
#[derive(Debug)]
pub(crate) struct RansDecoder<'a> {
    states: [u32; LANES],
    words: &'a [[u8; 2]],
    /// Number of bytes after the last word, 0 or 1.
    odd_bytes: usize,
    /// Index of the next word; may lie past the end.
    next_word: usize,
}

impl<'a> RansDecoder<'a> {
    /// `lanes` must be that of [`RansEncoder::finish`].
    pub(crate) fn new(bytes: &'a [u8], lanes: usize) -> Self {
        let (words, odd) = bytes.as_chunks();
        let mut reader = Self { states: [LOW; LANES], words, odd_bytes: odd.len(), next_word: 2 * lanes };
        for lane in 0..lanes {
            reader.states[lane] = reader.word(2 * lane) << 16 | reader.word(2 * lane + 1);
        }
        reader
    }

    /// Fails if bytes remain, or if the states are not those that an encoder starts with.
    pub(crate) fn finish(self) -> Result<(), DecodeError> {
        match (2 * self.words.len() + self.odd_bytes).checked_sub(2 * self.next_word) {
            Some(0) if self.states == [LOW; LANES] => Ok(()),
            None | Some(0) => Err(DecodeError::Invalid("the coded symbols are damaged: the final state is wrong")),
            Some(remaining) => Err(DecodeError::TrailingBytes(remaining)),
        }
    }

    #[inline(always)]
    fn word(&self, at: usize) -> u32 {
        self.words.get(at).map_or(0, |word| u16::from_le_bytes(*word).into())
    }

    /// The state and the next word after a symbol. Renormalisation has no branch, because it is unpredictable.
    #[inline(always)]
    fn advance(&self, state: u32, interval: Interval, next_word: usize) -> (u32, usize) {
        let state = interval.width * (state >> BITS) + (state & (ONE - 1)) - interval.start;
        let longer = state << 16 | self.word(next_word);
        let is_low = state < LOW;
        (if is_low { longer } else { state }, next_word + usize::from(is_low))
    }

    #[inline(always)]
    fn take(&mut self, interval: Interval) {
        (self.states[0], self.next_word) = self.advance(self.states[0], interval, self.next_word);
    }
}

impl SymbolCoder for RansDecoder<'_> {
    const WRITES: bool = false;

    #[inline]
    fn symbol<const N: usize>(&mut self, model: &mut SymbolModel<N>, _: usize) -> usize {
        let symbol = find(model.starts(), self.states[0] & (ONE - 1));
        self.take(interval(model.starts(), symbol));
        model.learn(symbol);
        symbol
    }

    #[inline]
    fn pair<const N: usize>(&mut self, a: &mut SymbolModel<N>, b: &mut SymbolModel<N>, _: usize) -> usize {
        let mean = a.mean_starts(b);
        let symbol = find(&mean, self.states[0] & (ONE - 1));
        self.take(interval(&mean, symbol));
        a.learn(symbol);
        b.learn(symbol);
        symbol
    }

    #[inline]
    fn three<const N: usize>(&mut self, models: [&mut SymbolModel<N>; 3], _: [usize; 3]) -> [usize; 3] {
        let [_, x, y, z] = self.states;
        let [a, b, c] = models;
        let slot = |state: u32| state & (ONE - 1);
        let symbols = [
            find_out_of_line(a.starts(), slot(x)),
            find_out_of_line(b.starts(), slot(y)),
            find_out_of_line(c.starts(), slot(z)),
        ];
        let (x, next_word) = self.advance(x, interval(a.starts(), symbols[0]), self.next_word);
        let (y, next_word) = self.advance(y, interval(b.starts(), symbols[1]), next_word);
        let (z, next_word) = self.advance(z, interval(c.starts(), symbols[2]), next_word);
        self.states = [self.states[0], x, y, z];
        self.next_word = next_word;
        a.learn(symbols[0]);
        b.learn(symbols[1]);
        c.learn(symbols[2]);
        symbols
    }

    #[inline]
    fn raw(&mut self, bits: u32, _: u32) -> u32 {
        if bits == 0 {
            return 0;
        }
        let value = (self.states[0] & (ONE - 1)) >> (BITS - bits);
        self.take(raw_interval(bits, value));
        value
    }

    fn overrun(&self) -> bool {
        self.next_word > self.words.len() + 32
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_test_support::rng::Rng;

    fn code(coder: &mut impl SymbolCoder, values: &mut [u32]) {
        let (mut few, mut many) = (SymbolModel::<4>::default(), SymbolModel::<16>::new(|i| i as u32));
        let (mut other, mut number) = (SymbolModel::<16>::default(), SymbolModel::default());
        for value in values {
            let kind = coder.symbol(&mut few, (*value % 4) as usize) as u32;
            let small = coder.pair(&mut many, &mut other, (*value / 4 % 16) as usize) as u32;
            let raw = coder.raw(3, *value / 64 % 8);
            *value = (coder.number(&mut number, *value / 512) * 8 + raw) * 64 + small * 4 + kind;
        }
    }

    #[test]
    fn symbols_round_trip_in_the_estimated_size() {
        let mut rng = Rng::new(1);
        let mut values: Vec<u32> = (0..5000).map(|i| rng.bits() as u32 >> (i % 32)).collect();
        let mut encoder = RansEncoder::default();
        code(&mut encoder, &mut values);
        let (expected, bits) = (values.clone(), encoder.bits());
        let bytes = encoder.finish(LANES);
        assert!((bytes.len() as f64 * 8.0 - bits).abs() < bits * 0.001 + 64.0, "{} bytes, {bits} bits", bytes.len());
        values.fill(0);
        let mut decoder = RansDecoder::new(&bytes, LANES);
        code(&mut decoder, &mut values);
        assert!(values == expected && !decoder.overrun());
        decoder.finish().unwrap();
    }

    #[test]
    fn constant_symbols_take_almost_no_bytes() {
        let (mut encoder, mut model) = (RansEncoder::default(), SymbolModel::<16>::default());
        for _ in 0..20_000 {
            encoder.symbol(&mut model, 15);
        }
        let bytes = encoder.finish(LANES);
        assert!(bytes.len() < 40, "{}", bytes.len());
    }

    #[test]
    fn truncated_bytes_are_refused() {
        let mut encoder = RansEncoder::default();
        code(&mut encoder, &mut [7; 200]);
        let bytes = encoder.finish(LANES);
        let mut values = [0; 200];
        let mut decoder = RansDecoder::new(&bytes[..bytes.len() - 2], LANES);
        code(&mut decoder, &mut values);
        assert!(decoder.finish().is_err());
        let mut decoder = RansDecoder::new(&[], LANES);
        code(&mut decoder, &mut [0; 2000]);
        assert!(decoder.overrun() || decoder.finish().is_err());
    }
}
