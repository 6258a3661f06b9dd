//! Insula's viewer in a browser.
//!
//! `page/engine.js` is a worker that owns a [`viewer::CityViewer`]: it passes commands in, and frames and states out. Other workers
//! (`page/helper.js`) decode tiles ([`decoder`]) and draw rows on the CPU ([`row_renderer`]). Workers share no memory, so pages need
//! no special headers. What is not of the browser is in `insula-viewer`.
//!
//! On targets other than WebAssembly the crate is empty.
#![cfg(target_arch = "wasm32")]

mod commands;
pub mod console;
mod control;
pub mod decoder;
mod fetcher;
mod frame_loop;
mod gpu_canvas;
pub mod host;
mod navigation;
mod overlay;
mod page_writes;
pub mod row_renderer;
mod transport;
pub mod viewer;
