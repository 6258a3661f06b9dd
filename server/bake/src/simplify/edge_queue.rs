//! Edges by what they cost, as closely as matters.
//!
//! In: edges in the order in which they lie in memory. Out: the cheapest of them, class by class. Next: `simplify`.
//!
//! Within a class, costs differ by an eighth at most, and edges keep their order: what is worked on after one another then
//! lies together.

/// Bits of a cost that are not looked at: its sign is 0, then 8 bits are its octave.
const BELOW: u32 = 20;
const CLASSES: usize = 1 << (31 - BELOW);

/// Edges that wait.
#[derive(Debug)]
pub(super) struct EdgeQueue {
    waiting: Vec<(f32, u32)>,
    /// Edges of each class.
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

    /// Adds an edge that costs no less than 0 and less than infinity.
    #[inline]
    pub(super) fn push(&mut self, cost: f32, h: u32) {
        self.counts[class(cost)] += 1;
        self.waiting.push((cost, h));
    }

    /// At least `least` of the cheapest edges, if there are so many, and what they cost at most; all others are forgotten.
    pub(super) fn cheapest(&mut self, least: usize) -> (&[(f32, u32)], f32) {
        let mut before = 0;
        let mut end = 0;
        for (class, count) in self.counts.iter_mut().enumerate() {
            if (before as usize) < least {
                end = class + 1;
            }
            let here = *count;
            *count = before;
            before += here;
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
        (&self.sorted, f32::from_bits((end as u32) << BELOW))
    }
}

#[inline]
fn class(cost: f32) -> usize {
    (cost.to_bits() >> BELOW) as usize & (CLASSES - 1)
}
