//! The server from outside: over HTTP, through its library, and as a process.
//!
//! `cargo test --profile ci -p insula-server --test integration live::` runs one module. All tests share a process, so none of them may
//! change what belongs to the whole of it: environment variables, the current folder, the subscriber of the log.
#![allow(clippy::unwrap_used, reason = "a test may panic")]

mod access;
#[cfg(feature = "bake")]
mod addresses;
#[cfg(feature = "bake")]
mod analyse;
#[cfg(feature = "bake")]
mod bad_inputs;
#[cfg(feature = "bake")]
mod bake_safety;
mod binary;
#[cfg(feature = "bake")]
mod bucket_inputs;
#[cfg(feature = "bake")]
mod discovery;
#[cfg(feature = "bake")]
mod draw;
mod hostile_archives;
mod http;
#[cfg(feature = "bake")]
mod kill;
mod limits;
mod live;
#[cfg(feature = "bake")]
mod proposals;
mod proxies;
#[cfg(feature = "bake")]
mod round_trip;
mod search;
mod store;
mod terminal;
mod test_server;
#[cfg(feature = "bake")]
mod tileset;
mod web_pages;
