//! Runs work in parallel with a limited number of items in flight and a limited amount of memory.
//!
//! Rayon alone would not limit memory: a worker that waits inside one block starts another and keeps both in memory.
//! Here, a few threads take the items one after the other, as far as their bytes fit a [`MemoryBudget`], and the
//! parallelism within each item uses the shared Rayon pool.

use std::ops::Range;
use std::panic::resume_unwind;
use std::sync::{Condvar, Mutex, PoisonError};
use std::thread;

/// Runs `work` on every item, at most `in_flight` at once, and returns the results in the order of the items. Every
/// second thread takes items from the end: in sorted items, few of the heaviest are in flight at once.
///
/// After an error or a panic no further item is started. Fails with the error of the first item that failed; a panic is
/// propagated.
pub(super) fn run_bounded<T: Sync, R: Send, E: Send>(
    in_flight: usize,
    items: &[T],
    work: impl Fn(&T) -> Result<R, E> + Sync,
) -> Result<Vec<R>, E> {
    let queue = WorkQueue(Mutex::new(0..items.len()));
    let done = Mutex::new(Vec::with_capacity(items.len()));
    let worker = |from_end: bool| {
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
    let worker = &worker;
    thread::scope(|scope| {
        let count = in_flight.max(1).min(items.len());
        let workers: Vec<_> = (0..count).map(|n| scope.spawn(move || worker(n % 2 == 1))).collect();
        for worker in workers {
            if let Err(panic) = worker.join() {
                resume_unwind(panic);
            }
        }
    });
    let mut done = done.into_inner().unwrap_or_else(PoisonError::into_inner);
    done.sort_unstable_by_key(|(i, _)| *i);
    done.into_iter().map(|(_, result)| result).collect()
}

/// Indices of the items that are not started yet.
struct WorkQueue(Mutex<Range<usize>>);

impl WorkQueue {
    fn take(&self, from_end: bool) -> Option<usize> {
        let mut remaining = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if from_end { remaining.next_back() } else { remaining.next() }
    }

    fn stop(&self) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = 0..0;
    }
}

/// A number of bytes that concurrent work shares. Work that needs more than the limit runs alone.
pub(super) struct MemoryBudget {
    limit: usize,
    used: Mutex<usize>,
    freed: Condvar,
}

impl MemoryBudget {
    pub(super) fn new(limit: usize) -> Self {
        Self { limit, used: Mutex::new(0), freed: Condvar::new() }
    }

    /// Waits until `bytes` are free, then runs `work`.
    pub(super) fn with<R>(&self, bytes: usize, work: impl FnOnce() -> R) -> R {
        let bytes = bytes.min(self.limit);
        let used = self.used.lock().unwrap_or_else(PoisonError::into_inner);
        let full = |used: &mut usize| *used + bytes > self.limit;
        *self.freed.wait_while(used, full).unwrap_or_else(PoisonError::into_inner) += bytes;
        let _reservation = MemoryReservation { budget: self, bytes };
        work()
    }
}

/// Releases its bytes when dropped, also after a panic.
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
    use std::panic::{AssertUnwindSafe, catch_unwind};
    use std::sync::atomic::{AtomicUsize, Ordering};

    #[test]
    fn results_keep_the_order_and_items_in_flight_are_limited() {
        let items: Vec<usize> = (0..200).collect();
        let (now, most) = (AtomicUsize::new(0), AtomicUsize::new(0));
        let result: Result<Vec<usize>, ()> = run_bounded(3, &items, |i| {
            most.fetch_max(now.fetch_add(1, Ordering::SeqCst) + 1, Ordering::SeqCst);
            thread::sleep(std::time::Duration::from_micros(50));
            now.fetch_sub(1, Ordering::SeqCst);
            Ok(i * 2)
        });
        assert_eq!(result.unwrap(), (0..400).step_by(2).collect::<Vec<_>>());
        assert!(most.into_inner() <= 3);
        assert_eq!(run_bounded(2, &[] as &[u8], |_| Ok::<(), ()>(())), Ok(vec![]));
    }

    #[test]
    fn first_and_last_item_start_together() {
        let both = std::sync::Barrier::new(2);
        let started = Mutex::new(Vec::new());
        let work = |i: &usize| {
            started.lock().unwrap().push(*i);
            if [0, 9].contains(i) {
                both.wait();
            }
            Ok::<usize, ()>(*i)
        };
        let items: Vec<usize> = (0..10).collect();
        assert_eq!(run_bounded(2, &items, work), Ok(items.clone()));
        let mut first = started.into_inner().unwrap();
        first.truncate(2);
        first.sort_unstable();
        assert_eq!(first, [0, 9]);
    }

    #[test]
    fn error_or_panic_stops_further_items() {
        let items: Vec<usize> = (0..10_000).collect();
        let started = AtomicUsize::new(0);
        let work = |i: &usize| {
            started.fetch_add(1, Ordering::Relaxed);
            if *i >= 5 { Err(*i) } else { Ok(*i) }
        };
        assert!(run_bounded(2, &items, work).is_err());
        assert!(started.load(Ordering::Relaxed) < 20);
        let panics = |i: &usize| if *i == 5 { panic!("at five") } else { Ok::<usize, ()>(*i) };
        let caught = catch_unwind(AssertUnwindSafe(|| run_bounded(2, &items, panics))).unwrap_err();
        assert_eq!(caught.downcast_ref::<&str>(), Some(&"at five"));
    }

    #[test]
    fn budget_is_never_exceeded_and_larger_work_runs_alone() {
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
        assert!(run_bounded(4, &items, work).is_ok());
        assert_eq!(most.into_inner(), 100);
        assert!(catch_unwind(AssertUnwindSafe(|| budget.with(100, || panic!("in work")))).is_err());
        assert_eq!(budget.with(100, || 7), 7);
    }
}
