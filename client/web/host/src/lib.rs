//! What the modules of Insula's viewer in a browser share.
//!
//! Targets other than WebAssembly build only the messages, of which a test makes `client/web/package/messages.d.ts`.

pub mod commands;
#[cfg(target_arch = "wasm32")]
pub mod console;
#[cfg(target_arch = "wasm32")]
pub mod host;
#[cfg(test)]
mod message_types;
pub mod messages;
#[cfg(target_arch = "wasm32")]
pub mod transport;
