//! Formats and addresses: round trips, damage, and frozen bytes.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod group_vector;
mod mesh;
mod mesh_tile;
mod roundtrip;
mod route;
mod vectors;
mod visibility_vector;
