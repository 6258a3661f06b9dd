//! An adaptive coder of symbols from small alphabets: a mesh has a few of them a vertex, where [`super::range`] would take
//! twenty bits one by one.
//!
//! The coder is a range asymmetric numeral system (Duda 2009) of 32 bits that takes 16 at a time; models are tables of
//! cumulated counts that move towards what they see, all entries at once, so that a processor's vectors do it.
//!
//! Encoder and decoder share one trait, so that a format is written down once: see [`Symbols`].

use crate::error::DecodeError;

/// Bits of a probability.
const BITS: u32 = 15;
/// All of it.
const ONE: u32 = 1 << BITS;
/// The state never is below this.
const LOW: u32 = 1 << 16;
/// States beside each other: those of [`Symbols::three`] are found at once, while one state has to wait for itself.
pub const LANES: usize = 4;
/// Most bits that [`Symbols::raw`] takes at once.
pub const RAW: u32 = BITS;

/// How fast a model moves after so many symbols: by `2^-rate` of what is left.
const RATE: [u8; 128] = {
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

/// How likely each of `N` symbols is: what is cumulated below it, of 32768.
#[derive(Debug, Clone)]
#[repr(align(16))]
pub struct Model<const N: usize> {
    below: [i16; N],
    seen: u8,
}

impl<const N: usize> Model<N> {
    /// For each symbol, where a model moves to once it was seen.
    const TARGETS: [[i16; N]; N] = {
        let mut targets = [[0; N]; N];
        let mut symbol = 0;
        while symbol < N {
            let mut i = 0;
            while i < N {
                targets[symbol][i] = i as i16 + if i > symbol { (ONE - N as u32) as i16 } else { 0 };
                i += 1;
            }
            symbol += 1;
        }
        targets
    };

    /// From how often each symbol is expected; none is impossible.
    pub fn new(weight: impl Fn(usize) -> u32) -> Self {
        let sum: u64 = (0..N).map(|symbol| u64::from(weight(symbol))).sum::<u64>().max(1);
        let free = u64::from(ONE) - 4 * N as u64;
        let mut before = 0;
        let below = std::array::from_fn(|symbol| {
            let here = before * free / sum + 4 * symbol as u64;
            before += u64::from(weight(symbol));
            here as i16
        });
        Self { below, seen: 0 }
    }

    /// No share ever falls under 1: targets lie at least 1 apart, and halves of differences are rounded down alike.
    #[inline(always)]
    fn learn(&mut self, symbol: usize) {
        let rate = RATE[usize::from(self.seen & 127)];
        self.seen += u8::from(self.seen < 127);
        let targets = const { &Self::TARGETS }[symbol];
        let below = self.below;
        for i in 0..N {
            self.below[i] = below[i] + ((targets[i] - below[i]) >> rate);
        }
    }

    /// What both expect, on average.
    #[inline(always)]
    fn mean(&self, other: &Self) -> [i16; N] {
        let mut mean = [0; N];
        for i in 0..N {
            mean[i] = ((self.below[i] as u16 + other.below[i] as u16) >> 1) as i16;
        }
        mean
    }
}

/// Where `symbol` begins, and how much it has, when so much is `below` each.
#[inline(always)]
fn share<const N: usize>(below: &[i16; N], symbol: usize) -> (u32, u32) {
    let start = below[symbol] as u32;
    let end = if symbol + 1 < N { below[symbol + 1] as u32 } else { ONE };
    (start, end - start)
}

/// The symbol in whose share `slot` lies.
#[inline(always)]
fn find<const N: usize>(below: &[i16; N], slot: u32) -> usize {
    let slot = slot as i16;
    // Differences of numbers below 2^15 keep their sign; sums of signs are what vectors are good at.
    let mut signs = [0i16; N];
    for i in 0..N {
        signs[i] = (slot - below[i]) >> 15;
    }
    let mut missed = 0i16;
    signs.iter().for_each(|sign| missed += sign);
    // Nothing is below the first, so at least one is not missed.
    (N as i16 + missed) as usize - 1
}

/// The same, apart from what is around it: of three beside each other, compilers make none of vectors.
#[inline(never)]
fn find_apart<const N: usize>(below: &[i16; N], slot: u32) -> usize {
    find(below, slot)
}

impl<const N: usize> Default for Model<N> {
    fn default() -> Self {
        Self::new(|_| 1)
    }
}

/// Writes or reads: each function writes its argument and returns it, or ignores it and returns what was written.
pub trait Symbols {
    /// Whether arguments count; a decoder's may be anything.
    const WRITES: bool;

    /// One of `N`.
    fn symbol<const N: usize>(&mut self, model: &mut Model<N>, symbol: usize) -> usize;

    /// One of `N`, expected as two models do on average; both learn.
    fn pair<const N: usize>(&mut self, a: &mut Model<N>, b: &mut Model<N>, symbol: usize) -> usize;

    /// Three at once, each by a model of its own.
    fn three<const N: usize>(&mut self, models: [&mut Model<N>; 3], symbols: [usize; 3]) -> [usize; 3];

    /// At most [`RAW`] bits, each as likely as not.
    fn raw(&mut self, bits: u32, value: u32) -> u32;

    /// Whether more than a few bytes that are not there were read.
    fn overrun(&self) -> bool;

    /// Yes or no.
    #[inline]
    fn flag(&mut self, model: &mut Model<2>, flag: bool) -> bool {
        self.symbol(model, usize::from(flag)) == 1
    }

    /// A whole number below 2^32 - 1: its length in binary digits by a model, then the digits.
    #[inline(never)]
    fn number(&mut self, model: &mut Model<32>, value: u32) -> u32 {
        let value = value.wrapping_add(1).max(1);
        let length = self.symbol(model, value.ilog2() as usize) as u32;
        let mut read = 1u32;
        let mut left = length;
        while left > 0 {
            let bits = left.min(RAW);
            left -= bits;
            read = read << bits | self.raw(bits, value >> left & ((1 << bits) - 1));
        }
        read - 1
    }
}

/// Collects what is to be written: the coder works from the last symbol to the first.
#[derive(Debug, Clone, Default)]
pub struct Writer {
    /// Where it begins, how much it has, and the lane.
    shares: Vec<(u16, u16, u16)>,
}

impl Writer {
    /// About so many symbols will come.
    pub fn with_capacity(symbols: usize) -> Self {
        Self { shares: Vec::with_capacity(symbols) }
    }

    /// All bytes, an even number; of [`LANES`], or of one where there were never three at once.
    pub fn finish(self, lanes: usize) -> Vec<u8> {
        let mut states = [LOW; LANES];
        let mut words = Vec::with_capacity(self.shares.len() / 4 + 2 * LANES);
        for (start, share, lane) in self.shares.into_iter().rev() {
            let state = &mut states[usize::from(lane) % LANES];
            let (start, share) = (u32::from(start), u32::from(share));
            if u64::from(*state) >= u64::from(share) << (32 - BITS) {
                words.push(*state as u16);
                *state >>= 16;
            }
            *state = ((*state / share) << BITS) + *state % share + start;
        }
        for state in states[..lanes].iter().rev() {
            words.push(*state as u16);
            words.push((*state >> 16) as u16);
        }
        words.iter().rev().flat_map(|word| word.to_le_bytes()).collect()
    }

    /// About how many bits what was collected will take.
    pub fn bits(&self) -> f64 {
        self.shares.iter().map(|(_, share, _)| f64::from(BITS) - f64::from(*share).log2()).sum()
    }

    #[inline]
    fn push(&mut self, (start, share): (u32, u32)) {
        self.shares.push((start as u16, share as u16, 0));
    }
}

impl Symbols for Writer {
    const WRITES: bool = true;

    #[inline]
    fn symbol<const N: usize>(&mut self, model: &mut Model<N>, symbol: usize) -> usize {
        self.push(share(&model.below, symbol));
        model.learn(symbol);
        symbol
    }

    #[inline]
    fn pair<const N: usize>(&mut self, a: &mut Model<N>, b: &mut Model<N>, symbol: usize) -> usize {
        self.push(share(&a.mean(b), symbol));
        a.learn(symbol);
        b.learn(symbol);
        symbol
    }

    #[inline]
    fn three<const N: usize>(&mut self, models: [&mut Model<N>; 3], symbols: [usize; 3]) -> [usize; 3] {
        for (lane, (model, symbol)) in (1..).zip(models.into_iter().zip(symbols)) {
            let (start, share) = share(&model.below, symbol);
            self.shares.push((start as u16, share as u16, lane));
            model.learn(symbol);
        }
        symbols
    }

    #[inline]
    fn raw(&mut self, bits: u32, value: u32) -> u32 {
        if bits > 0 {
            self.push((value << (BITS - bits), 1 << (BITS - bits)));
        }
        value
    }

    fn overrun(&self) -> bool {
        false
    }
}

/// Reads what [`Writer`] wrote. Any bytes can be read; past their end there are zeros.
#[derive(Debug)]
pub struct Reader<'a> {
    states: [u32; LANES],
    words: &'a [[u8; 2]],
    /// Bytes after the last word.
    odd: usize,
    /// The first word that was not read; may lie beyond the last.
    at: usize,
}

impl<'a> Reader<'a> {
    /// From the first byte on, of as many lanes as were written.
    pub fn new(bytes: &'a [u8], lanes: usize) -> Self {
        let (words, odd) = bytes.as_chunks();
        let mut reader = Self { states: [LOW; LANES], words, odd: odd.len(), at: 2 * lanes };
        for lane in 0..lanes {
            reader.states[lane] = reader.word(2 * lane) << 16 | reader.word(2 * lane + 1);
        }
        reader
    }

    /// Whether all was read, and nothing else.
    pub fn finish(self) -> Result<(), DecodeError> {
        match (2 * self.words.len() + self.odd).checked_sub(2 * self.at) {
            Some(0) if self.states == [LOW; LANES] => Ok(()),
            None | Some(0) => Err(DecodeError::Invalid("coded symbols end in disorder")),
            Some(left) => Err(DecodeError::TrailingBytes(left)),
        }
    }

    #[inline(always)]
    fn word(&self, at: usize) -> u32 {
        self.words.get(at).map_or(0, |word| u16::from_le_bytes(*word).into())
    }

    /// The state after a symbol, and where to read on; without a branch on whether another word is needed: nobody could
    /// foretell it.
    #[inline(always)]
    fn after(&self, state: u32, (start, share): (u32, u32), at: usize) -> (u32, usize) {
        let state = share * (state >> BITS) + (state & (ONE - 1)) - start;
        let longer = state << 16 | self.word(at);
        let is_low = state < LOW;
        (if is_low { longer } else { state }, at + usize::from(is_low))
    }

    #[inline(always)]
    fn take(&mut self, share: (u32, u32)) {
        (self.states[0], self.at) = self.after(self.states[0], share, self.at);
    }
}

impl Symbols for Reader<'_> {
    const WRITES: bool = false;

    #[inline]
    fn symbol<const N: usize>(&mut self, model: &mut Model<N>, _: usize) -> usize {
        let symbol = find(&model.below, self.states[0] & (ONE - 1));
        self.take(share(&model.below, symbol));
        model.learn(symbol);
        symbol
    }

    #[inline]
    fn pair<const N: usize>(&mut self, a: &mut Model<N>, b: &mut Model<N>, _: usize) -> usize {
        let mean = a.mean(b);
        let symbol = find(&mean, self.states[0] & (ONE - 1));
        self.take(share(&mean, symbol));
        a.learn(symbol);
        b.learn(symbol);
        symbol
    }

    #[inline]
    fn three<const N: usize>(&mut self, models: [&mut Model<N>; 3], _: [usize; 3]) -> [usize; 3] {
        let [_, x, y, z] = self.states;
        let [a, b, c] = models;
        let slot = |state: u32| state & (ONE - 1);
        let symbols = [find_apart(&a.below, slot(x)), find_apart(&b.below, slot(y)), find_apart(&c.below, slot(z))];
        let (x, at) = self.after(x, share(&a.below, symbols[0]), self.at);
        let (y, at) = self.after(y, share(&b.below, symbols[1]), at);
        let (z, at) = self.after(z, share(&c.below, symbols[2]), at);
        self.states = [self.states[0], x, y, z];
        self.at = at;
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
        self.take((value << (BITS - bits), 1 << (BITS - bits)));
        value
    }

    fn overrun(&self) -> bool {
        self.at > self.words.len() + 32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn walk(coder: &mut impl Symbols, values: &mut [u32]) {
        let (mut few, mut many) = (Model::<4>::default(), Model::<16>::new(|i| i as u32));
        let (mut other, mut number) = (Model::<16>::default(), Model::default());
        for value in values {
            let kind = coder.symbol(&mut few, (*value % 4) as usize) as u32;
            let small = coder.pair(&mut many, &mut other, (*value / 4 % 16) as usize) as u32;
            let raw = coder.raw(3, *value / 64 % 8);
            *value = (coder.number(&mut number, *value / 512) * 8 + raw) * 64 + small * 4 + kind;
        }
    }

    #[test]
    fn what_was_written_is_read() {
        let mut values: Vec<u32> = (0..5000u32).map(|i| i.wrapping_mul(2_654_435_761) >> (i % 32)).collect();
        let mut writer = Writer::default();
        walk(&mut writer, &mut values);
        let (wanted, bits) = (values.clone(), writer.bits());
        let bytes = writer.finish(LANES);
        assert!((bytes.len() as f64 * 8.0 - bits).abs() < bits * 0.001 + 64.0, "{} bytes, {bits} bits", bytes.len());
        values.fill(0);
        let mut reader = Reader::new(&bytes, LANES);
        walk(&mut reader, &mut values);
        assert!(values == wanted && !reader.overrun());
        reader.finish().unwrap();
    }

    #[test]
    fn what_is_always_the_same_costs_next_to_nothing() {
        let (mut writer, mut model) = (Writer::default(), Model::<16>::default());
        for _ in 0..20_000 {
            writer.symbol(&mut model, 15);
        }
        let bytes = writer.finish(LANES);
        assert!(bytes.len() < 40, "{}", bytes.len());
    }

    #[test]
    fn no_symbol_ever_becomes_impossible() {
        let mut model = Model::<32>::new(|i| u32::from(i == 3));
        for i in 0..100_000usize {
            model.learn(if i < 50_000 { 0 } else { i * i % 32 });
            assert!((0..32).all(|symbol| share(&model.below, symbol).1 > 0));
        }
    }

    #[test]
    fn too_little_is_noticed() {
        let mut writer = Writer::default();
        walk(&mut writer, &mut [7; 200]);
        let bytes = writer.finish(LANES);
        let mut values = [0; 200];
        let mut reader = Reader::new(&bytes[..bytes.len() - 2], LANES);
        walk(&mut reader, &mut values);
        assert!(reader.finish().is_err());
        let mut reader = Reader::new(&[], LANES);
        walk(&mut reader, &mut [0; 2000]);
        assert!(reader.overrun() || reader.finish().is_err());
    }
}
