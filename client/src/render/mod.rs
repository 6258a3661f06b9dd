//! From a cut to pixels, on a graphics device or on the CPU.
//!
//! In: the cut, the cache, a view. Out: [`Pixels`](insula_shaders::cpu::raycast::Pixels), or a drawn surface. Next: a
//! picture file, or the window.

pub mod adapter;
pub mod cpu;
pub mod frame;
pub mod gpu;

pub use adapter::{Adapter, AdapterChoice, AdapterInfo};
pub use frame::{Drawn, FrameData, Look, MOVING_SAMPLES, STILL_SAMPLES};
