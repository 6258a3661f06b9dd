//! Whole bakes: what a finished city holds, and what interrupted, divided and repeated bakes give.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod above;
mod coast;
mod facades;
mod formats;
mod ground;
mod hovering;
mod landmarks;
mod palette;
mod release;
mod resume;
mod steps;
mod steps_foreign;
mod support;
mod terrain;
mod update;
mod water;
mod whole;
