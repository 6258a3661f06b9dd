//! A pool of numbers (pages or slots), each with at most one owner.

/// A stack of the free numbers below a fixed count.
#[derive(Debug, Clone)]
pub(super) struct PagePool {
    free: Vec<u32>,
    count: u32,
}

impl PagePool {
    /// All numbers of `0..count` are free. The lowest is taken first.
    pub(super) fn new(count: u32) -> Self {
        Self { free: (0..count).rev().collect(), count }
    }

    /// Adds the numbers up to `count`, which are taken last.
    pub(super) fn grow(&mut self, count: u32) {
        let more: Vec<u32> = (self.count..count).rev().collect();
        self.free.splice(0..0, more);
        self.count = self.count.max(count);
    }

    /// Number of free numbers.
    pub(super) fn free(&self) -> u32 {
        self.free.len() as u32
    }

    /// Number of numbers that have an owner.
    pub(super) fn used(&self) -> u32 {
        self.count - self.free()
    }

    pub(super) fn count(&self) -> u32 {
        self.count
    }

    /// Takes `n` numbers, or none if fewer are free.
    pub(super) fn take(&mut self, n: u32) -> Option<Vec<u32>> {
        let rest = self.free.len().checked_sub(n as usize)?;
        Some(self.free.split_off(rest))
    }

    /// Gives back numbers that came from [`PagePool::take`].
    pub(super) fn give_back(&mut self, numbers: impl IntoIterator<Item = u32>) {
        self.free.extend(numbers);
        debug_assert!(self.free.len() <= self.count as usize, "a number was given back twice");
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn takes_all_or_nothing() {
        let mut pool = PagePool::new(5);
        let taken = pool.take(3).unwrap();
        assert!(pool.take(3).is_none());
        assert_eq!((pool.free(), pool.used(), pool.count()), (2, 3, 5));
        pool.give_back(taken);
        let mut all = pool.take(5).unwrap();
        all.sort_unstable();
        assert_eq!(all, [0, 1, 2, 3, 4]);
    }

    #[test]
    fn a_larger_pool_has_the_same_owners() {
        let mut pool = PagePool::new(3);
        let taken = pool.take(2).unwrap();
        pool.grow(5);
        pool.grow(4);
        assert_eq!((pool.free(), pool.used(), pool.count()), (3, 2, 5));
        let mut all = [taken, pool.take(3).unwrap()].concat();
        all.sort_unstable();
        assert_eq!(all, [0, 1, 2, 3, 4]);
    }
}
