//! Stones and metals of monuments: what a surface shows where the source has no picture of it.
//!
//! [`Stone`] is what shaders read, [`StoneParameters`] what a file or a page says. [`crate::cpu::stone`] evaluates a stone at a
//! point, [`crate::cpu::ward`] reflects light from it.

mod definition;
mod parameters;
mod presets;

pub use definition::{BOTH_VEINS, BROAD_VEINS, FINE_VEINS, MAX_OCTAVES, MAX_STONES, Stone, StoneError, StoneKind};
pub use parameters::{StoneParameters, Veins};
pub use presets::PRESETS;
