//! Work in parallel with a fixed number of pieces in flight.
//!
//! In: pieces and what to do with one. Out: the results in the pieces' order. Next: `leaves` and `parents` store tiles.
//!
//! Rayon alone would not bound memory: a worker that waits inside one block steals another, and holds both. So a few
//! feeders take the pieces one after the other, and each piece's own parallelism goes to the shared pool.

use std::{
    panic::resume_unwind,
    sync::{
        Mutex, PoisonError,
        atomic::{AtomicUsize, Ordering},
    },
    thread,
};

use rayon::ThreadPool;

/// Runs `work` on every item in the pool, at most `in_flight` at once. After an error or a panic no further item is
/// begun; the error of the earliest item that failed is returned, a panic goes on.
pub(super) fn feed<T: Sync, R: Send, E: Send>(
    pool: &ThreadPool,
    in_flight: usize,
    items: &[T],
    work: impl Fn(&T) -> Result<R, E> + Sync,
) -> Result<Vec<R>, E> {
    let queue = Queue { next: AtomicUsize::new(0), len: items.len() };
    let done = Mutex::new(Vec::with_capacity(items.len()));
    let feeder = || {
        let guard = StopOnPanic(&queue);
        while let Some(i) = queue.take() {
            let result = pool.install(|| work(&items[i]));
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

    fn pool(threads: usize) -> ThreadPool {
        rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap()
    }

    #[test]
    fn results_keep_the_order_and_the_number_in_flight_is_bounded() {
        let items: Vec<usize> = (0..200).collect();
        let (now, most) = (AtomicUsize::new(0), AtomicUsize::new(0));
        let result: Result<Vec<usize>, ()> = feed(&pool(4), 3, &items, |i| {
            most.fetch_max(now.fetch_add(1, Ordering::SeqCst) + 1, Ordering::SeqCst);
            // Inner parallelism is what would make rayon take up further pieces.
            rayon::join(|| thread::sleep(std::time::Duration::from_micros(50)), || ());
            now.fetch_sub(1, Ordering::SeqCst);
            Ok(i * 2)
        });
        assert_eq!(result.unwrap(), (0..400).step_by(2).collect::<Vec<_>>());
        assert!(most.into_inner() <= 3);
        assert_eq!(feed(&pool(2), 2, &[] as &[u8], |_| Ok::<(), ()>(())), Ok(vec![]));
    }

    #[test]
    fn an_error_or_a_panic_ends_the_work() {
        let items: Vec<usize> = (0..10_000).collect();
        let begun = AtomicUsize::new(0);
        let work = |i: &usize| {
            begun.fetch_add(1, Ordering::Relaxed);
            if *i >= 5 { Err(*i) } else { Ok(*i) }
        };
        assert!(feed(&pool(2), 2, &items, work).is_err());
        assert!(begun.load(Ordering::Relaxed) < 20);
        let panics = |i: &usize| if *i == 5 { panic!("at five") } else { Ok::<usize, ()>(*i) };
        let caught = catch_unwind(AssertUnwindSafe(|| feed(&pool(2), 2, &items, panics))).unwrap_err();
        assert_eq!(caught.downcast_ref::<&str>(), Some(&"at five"));
    }
}
