//! Insula's viewer in a browser.
//!
//! `page/engine.js` is a worker that owns a `CityViewer`: it passes commands in, and frames and states out. Other workers
//! (`page/helper.js`) decode tiles and draw rows on the CPU. Workers share no memory, so pages need no special headers.
//! `insula-viewer` has what all viewers share, `insula-web-objects` what is known of objects, `insula-web-host` the messages.

#[cfg(target_arch = "wasm32")]
pub mod browser;
