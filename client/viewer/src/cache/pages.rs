//! Who owns which page and which slot of the atlas.
//!
//! In: how many there are. Out: numbers, each given to one owner at a time. Next: `cache` hands them to nodes.

/// A stack of free numbers below a fixed count.
#[derive(Debug, Clone)]
pub(super) struct PagePool {
    free: Vec<u32>,
    count: u32,
}

impl PagePool {
    /// All of `0..count` are free; the lowest is given first.
    pub(super) fn new(count: u32) -> Self {
        Self { free: (0..count).rev().collect(), count }
    }

    /// How many can be taken.
    pub(super) fn free(&self) -> u32 {
        self.free.len() as u32
    }

    /// How many are out.
    pub(super) fn used(&self) -> u32 {
        self.count - self.free()
    }

    /// How many there are.
    pub(super) fn count(&self) -> u32 {
        self.count
    }

    /// Takes `n`, or none if there are fewer.
    pub(super) fn take(&mut self, n: u32) -> Option<Vec<u32>> {
        let rest = self.free.len().checked_sub(n as usize)?;
        Some(self.free.split_off(rest))
    }

    /// Gives numbers back that came from [`PagePool::take`].
    pub(super) fn give(&mut self, numbers: impl IntoIterator<Item = u32>) {
        self.free.extend(numbers);
        debug_assert!(self.free.len() <= self.count as usize, "a page was given back twice");
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_or_nothing() {
        let mut pool = PagePool::new(5);
        let a = pool.take(3).unwrap();
        assert!(pool.take(3).is_none());
        assert_eq!((pool.free(), pool.used(), pool.count()), (2, 3, 5));
        pool.give(a);
        assert_eq!(
            pool.take(5).map(|mut p| {
                p.sort_unstable();
                p
            }),
            Some(vec![0, 1, 2, 3, 4])
        );
    }
}
