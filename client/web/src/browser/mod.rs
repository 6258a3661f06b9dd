//! The viewer of a page, and what its other workers run.

mod control;
pub mod decoder;
mod draping;
mod fetcher;
mod frame_job;
mod frame_loop;
mod models;
mod navigation;
mod object_styles;
mod overlay;
mod picking;
pub mod row_renderer;
pub mod viewer;

use wasm_bindgen::prelude::*;

/// Runs once in each worker.
#[wasm_bindgen(start)]
pub fn start() {
    insula_web_host::console::start();
}
