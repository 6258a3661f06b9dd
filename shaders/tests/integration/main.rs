//! The WGSL and what Rust shares with it, without a graphics adapter.

mod backends;
mod layout;
