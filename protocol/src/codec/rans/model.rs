//! Adaptive frequency tables of small alphabets.
//!
//! A table holds, for each symbol, the probability of all symbols before it. After each coded symbol every entry moves
//! towards a target by a power of two, so that compilers vectorise the update.

use super::{ONE, RATES};

/// The part of the probability range, `0..ONE`, that a symbol occupies.
#[derive(Debug, Clone, Copy)]
pub(super) struct Interval {
    pub(super) start: u32,
    /// At least 1.
    pub(super) width: u32,
}

/// Adaptive probabilities of `N` symbols.
#[derive(Debug, Clone)]
#[repr(align(16))]
pub(crate) struct SymbolModel<const N: usize> {
    /// For each symbol, where its interval starts, in 1/[`ONE`].
    starts: [i16; N],
    /// Number of symbols learnt, at most 127.
    learnt: u8,
}

impl<const N: usize> SymbolModel<N> {
    /// `TARGETS[symbol]` is what `starts` would become if only `symbol` occurred.
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

    /// Starts from relative frequencies. A symbol of weight 0 still gets a small probability.
    pub(crate) fn new(weight: impl Fn(usize) -> u32) -> Self {
        let sum: u64 = (0..N).map(|symbol| u64::from(weight(symbol))).sum::<u64>().max(1);
        let free = u64::from(ONE) - 4 * N as u64;
        let mut before = 0;
        let starts = std::array::from_fn(|symbol| {
            let start = before * free / sum + 4 * symbol as u64;
            before += u64::from(weight(symbol));
            start as i16
        });
        Self { starts, learnt: 0 }
    }

    /// No interval ever becomes narrower than 1: targets lie at least 1 apart, and all differences are rounded down
    /// alike.
    #[inline(always)]
    pub(super) fn learn(&mut self, symbol: usize) {
        let rate = RATES[usize::from(self.learnt & 127)];
        self.learnt += u8::from(self.learnt < 127);
        let targets = const { &Self::TARGETS }[symbol];
        let starts = self.starts;
        for i in 0..N {
            self.starts[i] = starts[i] + ((targets[i] - starts[i]) >> rate);
        }
    }

    #[inline(always)]
    pub(super) fn starts(&self) -> &[i16; N] {
        &self.starts
    }

    /// The average of two models, as starts of intervals.
    #[inline(always)]
    pub(super) fn mean_starts(&self, other: &Self) -> [i16; N] {
        let mut mean = [0; N];
        for i in 0..N {
            mean[i] = ((self.starts[i] as u16 + other.starts[i] as u16) >> 1) as i16;
        }
        mean
    }
}

impl<const N: usize> Default for SymbolModel<N> {
    /// All symbols are equally likely.
    fn default() -> Self {
        Self::new(|_| 1)
    }
}

#[inline(always)]
pub(super) fn interval<const N: usize>(starts: &[i16; N], symbol: usize) -> Interval {
    let start = starts[symbol] as u32;
    let end = if symbol + 1 < N { starts[symbol + 1] as u32 } else { ONE };
    Interval { start, width: end - start }
}

/// The symbol whose interval contains `slot`.
#[inline(always)]
pub(super) fn find<const N: usize>(starts: &[i16; N], slot: u32) -> usize {
    let slot = slot as i16;
    // Differences of numbers below 2^15 keep their sign, and sums of signs vectorise well.
    let mut signs = [0i16; N];
    for i in 0..N {
        signs[i] = (slot - starts[i]) >> 15;
    }
    let mut above = 0i16;
    signs.iter().for_each(|sign| above += sign);
    // The first interval starts at 0, so at least one start is not above the slot.
    (N as i16 + above) as usize - 1
}

/// [`find`], never inlined: compilers do not vectorise three inlined copies in a row.
#[inline(never)]
pub(super) fn find_out_of_line<const N: usize>(starts: &[i16; N], slot: u32) -> usize {
    find(starts, slot)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_symbol_keeps_a_nonzero_probability() {
        let mut model = SymbolModel::<32>::new(|i| u32::from(i == 3));
        for i in 0..100_000usize {
            model.learn(if i < 50_000 { 0 } else { i * i % 32 });
            assert!((0..32).all(|symbol| interval(model.starts(), symbol).width > 0));
        }
    }
}
