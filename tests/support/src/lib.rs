//! What the tests of several packages share. Depends on little, so that every package can use it for its unit tests.
#![allow(clippy::unwrap_used, reason = "tests fail by panicking")]

pub mod bucket;
pub mod faulty_host;
pub mod folder;
pub mod http;
pub mod map_files;
pub mod programs;
pub mod rng;
#[cfg(feature = "city")]
pub mod small_city;
pub mod tier;
