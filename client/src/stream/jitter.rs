//! Random numbers that spread retries.

use std::hash::{BuildHasher, Hasher, RandomState};

/// A random number in 0..1. The standard library seeds each hasher at random.
pub(crate) fn jitter() -> f64 {
    (RandomState::new().build_hasher().finish() >> 11) as f64 / (1u64 << 53) as f64
}
