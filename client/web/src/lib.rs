//! Insula's viewer in a browser.
//!
//! `page/engine.js` is a worker that owns a `CityViewer`: it passes commands in, and frames and states out. Other workers
//! (`page/helper.js`) decode tiles and draw rows on the CPU. Workers share no memory, so pages need no special headers.
//! `insula-viewer` has what all viewers share.
//!
//! Targets other than WebAssembly build only the messages, of which a test makes `package/messages.d.ts`.
#![cfg_attr(not(target_arch = "wasm32"), allow(dead_code, reason = "the browser's parts use them"))]

#[cfg(target_arch = "wasm32")]
pub mod browser;
mod commands;
#[cfg(test)]
mod message_types;
mod messages;
