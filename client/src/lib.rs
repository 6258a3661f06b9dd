//! Native shell of Insula's streaming client.
//!
//! `insula-viewer` selects, caches and assembles frames. This crate adds what it needs from the outside: the network
//! ([`stream`]), the ray-casters ([`render`]), the clock ([`session`]), the window ([`ui`]) and the command line
//! ([`commands`]). The modules depend on each other in one direction only:
//!
//! ```text
//! commands -> viewpoint -> session
//! commands -> ui -> picture -> session -> report -> render -> error
//!                                      -> objects -> proposal, stream -> error
//! ```
//!
//! Only `stream` uses the network. Only `render` and `ui` name wgpu.

pub mod args;
mod box_lines;
pub mod camera_files;
pub mod commands;
pub mod error;
pub mod image_files;
mod language;
pub mod objects;
pub mod picture;
pub mod proposal;
pub mod render;
pub mod report;
pub mod session;
pub mod stream;
pub mod ui;
pub mod viewpoint;
