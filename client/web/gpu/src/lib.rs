//! The GPU ray-caster in a browser.
//!
//! A module apart from the viewer's, because the CPU draws the first pictures. `page/engine-core.js` fetches it where there is WebGPU, and
//! gives it the words that the workers of the CPU get as well: writes to the atlas, and frames.

#[cfg(target_arch = "wasm32")]
mod canvas;
#[cfg(target_arch = "wasm32")]
pub mod renderer;
