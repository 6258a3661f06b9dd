//! Meshes in a browser.
//!
//! A module apart from the viewer's, because the first picture is of columns. `page/helper.js` has it in a worker.

#[cfg(target_arch = "wasm32")]
pub mod decoder;
#[cfg(target_arch = "wasm32")]
pub mod models;
