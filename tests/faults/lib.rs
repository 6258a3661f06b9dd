//! Faults around a running server. Each fault is real, and a client checks every byte that it gets.
#![allow(clippy::unwrap_used, reason = "a test may panic")]

pub mod client;
pub mod contract;
pub mod disk;
pub mod process;
mod server;
pub mod store;
pub mod swap;
