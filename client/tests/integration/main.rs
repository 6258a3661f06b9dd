//! Whole sessions against a test server that works, fails, disappears and returns.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod cache;
mod faults;
mod fixture_city;
mod frames;
mod idle_prefetch;
mod picture;
mod test_server;
mod viewers;
