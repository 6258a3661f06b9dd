//! Work in parallel with a fixed number of pieces in flight.
//!
//! In: pieces and what to do with one. Out: the results in the pieces' order. Next: `leaves` and `parents` store tiles.
//!
//! Rayon alone would not bound memory: a worker that waits inside one block steals another, and holds both. So feeders
//! take the pieces one after the other, as far as their bytes find room in a [`Budget`], and each piece's own parallelism
//! goes to the shared pool.

use std::{
    panic::resume_unwind,
    sync::{
        Condvar, Mutex, PoisonError,
        atomic::{AtomicUsize, Ordering},
    },
    thread,
};

/// Runs `work` on every item, at most `in_flight` at once. After an error or a panic no further item is
/// begun; the error of the earliest item that failed is returned, a panic goes on.
pub(super) fn feed<T: Sync, R: Send, E: Send>(
    in_flight: usize,
    items: &[T],
    work: impl Fn(&T) -> Result<R, E> + Sync,
) -> Result<Vec<R>, E> {
    let queue = Queue { next: AtomicUsize::new(0), len: items.len() };
    let done = Mutex::new(Vec::with_capacity(items.len()));
    let feeder = || {
        let guard = StopOnPanic(&queue);
        while let Some(i) = queue.take() {
            let result = work(&items[i]);
            if result.is_err() {
                queue.stop();
            }
            done.lock().unwrap_or_else(PoisonError::into_inner).push((i, result));
        }
        drop(guard);
    };
    thread::scope(|scope| {
        let feeders: Vec<_> = (0..in_flight.max(1).min(items.len())).map(|_| scope.spawn(feeder)).collect();
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

struct Queue {
    next: AtomicUsize,
    len: usize,
}

impl Queue {
    fn take(&self) -> Option<usize> {
        Some(self.next.fetch_add(1, Ordering::Relaxed)).filter(|i| *i < self.len)
    }

    fn stop(&self) {
        self.next.fetch_add(self.len, Ordering::Relaxed);
    }
}

/// A number of bytes that pieces of work share. A piece that wants more than all of it is done alone.
pub(super) struct Budget {
    limit: usize,
    used: Mutex<usize>,
    freed: Condvar,
}

impl Budget {
    pub(super) fn new(limit: usize) -> Self {
        Self { limit, used: Mutex::new(0), freed: Condvar::new() }
    }

    /// Does the work as soon as there is room for it.
    pub(super) fn with<R>(&self, bytes: usize, work: impl FnOnce() -> R) -> R {
        let bytes = bytes.min(self.limit);
        let used = self.used.lock().unwrap_or_else(PoisonError::into_inner);
        let full = |used: &mut usize| *used + bytes > self.limit;
        *self.freed.wait_while(used, full).unwrap_or_else(PoisonError::into_inner) += bytes;
        let _share = Share { budget: self, bytes };
        work()
    }
}

/// Given back when dropped, after a panic as well.
struct Share<'a> {
    budget: &'a Budget,
    bytes: usize,
}

impl Drop for Share<'_> {
    fn drop(&mut self) {
        *self.budget.used.lock().unwrap_or_else(PoisonError::into_inner) -= self.bytes;
        self.budget.freed.notify_all();
    }
}

struct StopOnPanic<'a>(&'a Queue);

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
        let budget = Budget::new(100);
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
