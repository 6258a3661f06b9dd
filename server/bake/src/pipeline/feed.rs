//! Work in parallel with a fixed number of pieces in flight.
//!
//! In: pieces and what to do with one. Out: the results in the pieces' order. Next: `leaves` and `parents` store tiles.
//!
//! Rayon alone would not bound memory: a worker that waits inside one block steals another, and holds both. So feeders
//! take the pieces one after the other, as far as their bytes find room in a [`MemoryBudget`], and each piece's own parallelism
//! goes to the shared pool.

use std::{
    ops::Range,
    panic::resume_unwind,
    sync::{Condvar, Mutex, PoisonError},
    thread,
};

/// Runs `work` on every item, at most `in_flight` at once. Every second feeder takes the items from the end: where they are
/// sorted, few of the heaviest are in flight at once. After an error or a panic no further item is begun; of the errors that
/// came, that of the first item is returned; a panic goes on.
pub(super) fn feed<T: Sync, R: Send, E: Send>(
    in_flight: usize,
    items: &[T],
    work: impl Fn(&T) -> Result<R, E> + Sync,
) -> Result<Vec<R>, E> {
    let queue = WorkQueue(Mutex::new(0..items.len()));
    let done = Mutex::new(Vec::with_capacity(items.len()));
    let feeder = |from_end: bool| {
        let guard = StopOnPanic(&queue);
        while let Some(i) = queue.take(from_end) {
            let result = work(&items[i]);
            if result.is_err() {
                queue.stop();
            }
            done.lock().unwrap_or_else(PoisonError::into_inner).push((i, result));
        }
        drop(guard);
    };
    let feeder = &feeder;
    thread::scope(|scope| {
        let count = in_flight.max(1).min(items.len());
        let feeders: Vec<_> = (0..count).map(|n| scope.spawn(move || feeder(n % 2 == 1))).collect();
        for feeder in feeders {
            if let Err(panic) = feeder.join() {
                resume_unwind(panic);
            }
        }
    });
    let mut done = done.into_inner().unwrap_or_else(PoisonError::into_inner);
    done.sort_unstable_by_key(|(i, _)| *i);
    done.into_iter().map(|(_, result)| result).collect()
}

/// Items that are not begun.
struct WorkQueue(Mutex<Range<usize>>);

impl WorkQueue {
    fn take(&self, from_end: bool) -> Option<usize> {
        let mut left = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if from_end { left.next_back() } else { left.next() }
    }

    fn stop(&self) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = 0..0;
    }
}

/// A number of bytes that pieces of work share. A piece that wants more than all of it is done alone.
pub(super) struct MemoryBudget {
    limit: usize,
    used: Mutex<usize>,
    freed: Condvar,
}

impl MemoryBudget {
    pub(super) fn new(limit: usize) -> Self {
        Self { limit, used: Mutex::new(0), freed: Condvar::new() }
    }

    /// Does the work as soon as there is room for it.
    pub(super) fn with<R>(&self, bytes: usize, work: impl FnOnce() -> R) -> R {
        let bytes = bytes.min(self.limit);
        let used = self.used.lock().unwrap_or_else(PoisonError::into_inner);
        let full = |used: &mut usize| *used + bytes > self.limit;
        *self.freed.wait_while(used, full).unwrap_or_else(PoisonError::into_inner) += bytes;
        let _share = MemoryReservation { budget: self, bytes };
        work()
    }
}

/// Given back when dropped, after a panic as well.
struct MemoryReservation<'a> {
    budget: &'a MemoryBudget,
    bytes: usize,
}

impl Drop for MemoryReservation<'_> {
    fn drop(&mut self) {
        *self.budget.used.lock().unwrap_or_else(PoisonError::into_inner) -= self.bytes;
        self.budget.freed.notify_all();
    }
}

struct StopOnPanic<'a>(&'a WorkQueue);

impl Drop for StopOnPanic<'_> {
    fn drop(&mut self) {
        if thread::panicking() {
            self.0.stop();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::{
        panic::{AssertUnwindSafe, catch_unwind},
        sync::atomic::{AtomicUsize, Ordering},
    };

    #[test]
    fn results_keep_the_order_and_the_number_in_flight_is_bounded() {
        let items: Vec<usize> = (0..200).collect();
        let (now, most) = (AtomicUsize::new(0), AtomicUsize::new(0));
        let result: Result<Vec<usize>, ()> = feed(3, &items, |i| {
            most.fetch_max(now.fetch_add(1, Ordering::SeqCst) + 1, Ordering::SeqCst);
            thread::sleep(std::time::Duration::from_micros(50));
            now.fetch_sub(1, Ordering::SeqCst);
            Ok(i * 2)
        });
        assert_eq!(result.unwrap(), (0..400).step_by(2).collect::<Vec<_>>());
        assert!(most.into_inner() <= 3);
        assert_eq!(feed(2, &[] as &[u8], |_| Ok::<(), ()>(())), Ok(vec![]));
    }

    #[test]
    fn the_first_and_the_last_are_begun_together() {
        let both = std::sync::Barrier::new(2);
        let begun = Mutex::new(Vec::new());
        let work = |i: &usize| {
            begun.lock().unwrap().push(*i);
            if [0, 9].contains(i) {
                both.wait();
            }
            Ok::<usize, ()>(*i)
        };
        let items: Vec<usize> = (0..10).collect();
        assert_eq!(feed(2, &items, work), Ok(items.clone()));
        let mut first = begun.into_inner().unwrap();
        first.truncate(2);
        first.sort_unstable();
        assert_eq!(first, [0, 9]);
    }

    #[test]
    fn an_error_or_a_panic_ends_the_work() {
        let items: Vec<usize> = (0..10_000).collect();
        let begun = AtomicUsize::new(0);
        let work = |i: &usize| {
            begun.fetch_add(1, Ordering::Relaxed);
            if *i >= 5 { Err(*i) } else { Ok(*i) }
        };
        assert!(feed(2, &items, work).is_err());
        assert!(begun.load(Ordering::Relaxed) < 20);
        let panics = |i: &usize| if *i == 5 { panic!("at five") } else { Ok::<usize, ()>(*i) };
        let caught = catch_unwind(AssertUnwindSafe(|| feed(2, &items, panics))).unwrap_err();
        assert_eq!(caught.downcast_ref::<&str>(), Some(&"at five"));
    }

    #[test]
    fn a_budget_is_never_exceeded_and_what_is_larger_is_done_alone() {
        let items: Vec<usize> = (0..300).map(|i| [10, 40, 250, 1][i % 4]).collect();
        let budget = MemoryBudget::new(100);
        let (now, most) = (AtomicUsize::new(0), AtomicUsize::new(0));
        let work = |bytes: &usize| {
            budget.with(*bytes, || {
                let bytes = (*bytes).min(100);
                most.fetch_max(now.fetch_add(bytes, Ordering::SeqCst) + bytes, Ordering::SeqCst);
                thread::sleep(std::time::Duration::from_micros(20));
                now.fetch_sub(bytes, Ordering::SeqCst);
            });
            Ok::<(), ()>(())
        };
        assert!(feed(4, &items, work).is_ok());
        assert_eq!(most.into_inner(), 100);
        assert!(catch_unwind(AssertUnwindSafe(|| budget.with(100, || panic!("in work")))).is_err());
        assert_eq!(budget.with(100, || 7), 7);
    }
}
