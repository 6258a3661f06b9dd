//! The cheapest edges, sorted into classes of similar cost.
//!
//! Costs of a class differ by at most an eighth. Within a class, edges keep the order in which they were pushed, so
//! that edges that are collapsed one after the other are near each other in memory. A full sort would be slower and no
//! better.

/// Low bits of a cost that do not decide its class. Above them are the 8 bits of the exponent and 3 of the mantissa.
const IGNORED_BITS: u32 = 20;
const CLASSES: usize = 1 << (31 - IGNORED_BITS);

/// Edges with their costs.
#[derive(Debug)]
pub(super) struct EdgeQueue {
    /// Cost and half-edge.
    waiting: Vec<(f32, u32)>,
    /// Number of waiting edges of each class.
    counts: Vec<u32>,
    sorted: Vec<(f32, u32)>,
}

impl EdgeQueue {
    pub(super) fn new() -> Self {
        Self { waiting: Vec::new(), counts: vec![0; CLASSES], sorted: Vec::new() }
    }

    pub(super) fn len(&self) -> usize {
        self.waiting.len()
    }

    /// Adds an edge. Its cost must be at least 0 and finite.
    #[inline]
    pub(super) fn push(&mut self, cost: f32, h: u32) {
        self.counts[class(cost)] += 1;
        self.waiting.push((cost, h));
    }

    /// The cheapest classes with together at least `least` edges, or all edges, and an upper bound of their
    /// costs. Empties the queue.
    pub(super) fn take_cheapest(&mut self, least: usize) -> (&[(f32, u32)], f32) {
        // Counts become the place of each class's next edge in the sorted list.
        let mut before = 0;
        let mut end = 0;
        for (class, count) in self.counts.iter_mut().enumerate() {
            if (before as usize) < least {
                end = class + 1;
            }
            let own = *count;
            *count = before;
            before += own;
        }
        let chosen = self.counts.get(end).copied().unwrap_or(before);
        self.sorted.clear();
        self.sorted.resize(chosen as usize, (0.0, 0));
        for &(cost, h) in &self.waiting {
            let class = class(cost);
            if class < end {
                let place = &mut self.counts[class];
                self.sorted[*place as usize] = (cost, h);
                *place += 1;
            }
        }
        self.counts.fill(0);
        self.waiting.clear();
        (&self.sorted, f32::from_bits((end as u32) << IGNORED_BITS))
    }
}

#[inline]
fn class(cost: f32) -> usize {
    (cost.to_bits() >> IGNORED_BITS) as usize & (CLASSES - 1)
}
