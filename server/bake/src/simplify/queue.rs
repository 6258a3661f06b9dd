//! Edges by cost, to within a hundredth: buckets that each hold a chain, and a map of those that are not empty.
//!
//! In: edges with costs. Out: the cheapest. Next: `simplify`.

use insula_protocol::mesh::pieces::NONE;

/// Buckets: the upper half of a positive number's bits.
const BUCKETS: usize = 1 << 15;

#[derive(Debug, Clone, Copy)]
struct Entry {
    half_edge: u32,
    changes: u32,
    next: u32,
}

/// A queue whose order is that of costs in single precision, rounded down to seven bits of mantissa.
#[derive(Debug)]
pub(super) struct Queue {
    entries: Vec<Entry>,
    /// Chain of entries that are free.
    free: u32,
    first: Vec<u32>,
    /// A bit for each bucket, and a bit for each word of these.
    filled: Vec<u64>,
    words: [u64; BUCKETS / 64 / 64],
}

impl Queue {
    pub(super) fn new() -> Self {
        Self {
            entries: Vec::new(),
            free: NONE,
            first: vec![NONE; BUCKETS],
            filled: vec![0; BUCKETS / 64],
            words: [0; BUCKETS / 64 / 64],
        }
    }

    /// Adds an edge; `cost` is not negative. `changes` comes back with it.
    #[inline]
    pub(super) fn push(&mut self, cost: f64, half_edge: u32, changes: u32) {
        let bucket = ((cost as f32).to_bits() >> 16) as usize & (BUCKETS - 1);
        let entry = Entry { half_edge, changes, next: self.first[bucket] };
        let place = self.free;
        self.first[bucket] = if place == NONE {
            self.entries.push(entry);
            self.entries.len() as u32 - 1
        } else {
            self.free = self.entries[place as usize].next;
            self.entries[place as usize] = entry;
            place
        };
        self.filled[bucket / 64] |= 1 << (bucket % 64);
        self.words[bucket / 4096] |= 1 << (bucket / 64 % 64);
    }

    fn cheapest(&self) -> Option<usize> {
        let upper = self.words.iter().position(|word| *word != 0)?;
        let word = 64 * upper + self.words[upper].trailing_zeros() as usize;
        Some(64 * word + self.filled[word].trailing_zeros() as usize)
    }

    /// About what the cheapest costs, not more; infinity where there is none.
    pub(super) fn cost(&self) -> f64 {
        self.cheapest().map_or(f64::INFINITY, |bucket| f32::from_bits((bucket as u32) << 16).into())
    }

    /// Takes one of the cheapest out.
    #[inline]
    pub(super) fn pop(&mut self) -> Option<(u32, u32)> {
        let bucket = self.cheapest()?;
        let place = self.first[bucket];
        let Entry { half_edge, changes, next } = self.entries[place as usize];
        self.first[bucket] = next;
        self.entries[place as usize].next = self.free;
        self.free = place;
        if next == NONE {
            self.filled[bucket / 64] &= !(1 << (bucket % 64));
            if self.filled[bucket / 64] == 0 {
                self.words[bucket / 4096] &= !(1 << (bucket / 64 % 64));
            }
        }
        Some((half_edge, changes))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_cheapest_come_first() {
        let mut queue = Queue::new();
        let cost = |i: u32| f64::from(i.wrapping_mul(2_654_435_761) >> 8) * 1e-5;
        (0..5000).for_each(|i| queue.push(cost(i), i, i + 1));
        let mut last = 0.0;
        for i in 0..5000u32 {
            let at_least = queue.cost();
            let (edge, changes) = queue.pop().unwrap();
            assert_eq!(changes, edge + 1);
            assert!(
                cost(edge) >= last * 0.99 && (at_least..=at_least * 1.01).contains(&(cost(edge) as f32).into()),
                "{i}"
            );
            last = cost(edge);
            if i % 3 == 0 {
                // What comes in later goes before what is dearer, wherever the search has got to.
                queue.push(0.0, 7, 8);
                assert_eq!((queue.cost(), queue.pop()), (0.0, Some((7, 8))));
            }
        }
        assert!(queue.pop().is_none() && queue.cost() == f64::INFINITY);
    }
}
