//! What the modules of Insula's viewer in a browser share.
//!
//! Targets other than WebAssembly build only what has tests: words, and the messages, of which a test makes
//! `client/web/package/messages.d.ts`.

pub mod commands;
#[cfg(target_arch = "wasm32")]
pub mod console;
pub mod frame_words;
#[cfg(target_arch = "wasm32")]
pub mod host;
#[cfg(test)]
mod message_types;
pub mod messages;
pub mod page_writes;
#[cfg(target_arch = "wasm32")]
pub mod transport;
