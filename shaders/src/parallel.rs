//! Work on all cores. A module in a browser has one thread, and goes without what shares work between threads: a fiftieth of its bytes.

#[cfg(not(target_arch = "wasm32"))]
pub(crate) use all_cores::*;
#[cfg(target_arch = "wasm32")]
pub(crate) use one_thread::*;

#[cfg(not(target_arch = "wasm32"))]
mod all_cores {
    pub(crate) use rayon::prelude::{
        IndexedParallelIterator, IntoParallelIterator, IntoParallelRefIterator, ParallelIterator, ParallelSlice,
        ParallelSliceMut,
    };

    /// Runs `work` on each core.
    pub(crate) fn on_all_cores(work: impl Fn() + Sync) {
        rayon::scope(|scope| (0..rayon::current_num_threads()).for_each(|_| scope.spawn(|_| work())));
    }
}

#[cfg(target_arch = "wasm32")]
mod one_thread {
    use std::slice::{Chunks, ChunksMut, Iter};

    pub(crate) fn on_all_cores(work: impl Fn() + Sync) {
        work();
    }

    pub(crate) trait IntoParallelIterator: IntoIterator + Sized {
        fn into_par_iter(self) -> Self::IntoIter {
            self.into_iter()
        }
    }

    impl<I: IntoIterator> IntoParallelIterator for I {}

    pub(crate) trait ParallelSlice<T> {
        fn par_iter(&self) -> Iter<'_, T>;
        fn par_chunks(&self, size: usize) -> Chunks<'_, T>;
        fn par_chunks_mut(&mut self, size: usize) -> ChunksMut<'_, T>;
    }

    impl<T> ParallelSlice<T> for [T] {
        fn par_iter(&self) -> Iter<'_, T> {
            self.iter()
        }

        fn par_chunks(&self, size: usize) -> Chunks<'_, T> {
            self.chunks(size)
        }

        fn par_chunks_mut(&mut self, size: usize) -> ChunksMut<'_, T> {
            self.chunks_mut(size)
        }
    }
}
