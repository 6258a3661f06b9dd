//! What every Insula viewer shares, native or in a browser: camera, scene tree, selection, tile cache, cross-fades, frame assembly
//! and the streaming policy.
//!
//! No threads, no file system, no network and, without the feature `gpu`, no GPU API. The shell passes in the time (as a `Duration` since the
//! session's start) and implements [`streamer::TileFetcher`], which fetches and decodes tiles, and [`cache::Upload`], which writes
//! the pages of the atlas.
//!
//! A frame passes through [`select`] -> [`streamer`] (request, receive) -> [`cache`] (pages) -> [`frame`] (arrays for the
//! ray-caster).

pub mod additions;
pub mod cache;
pub mod camera;
pub mod camera_text;
pub mod collision;
pub mod decode;
pub mod frame;
pub mod interaction;
mod moon;
pub mod node_boxes;
pub mod objects;
pub mod projection;
pub mod render;
pub mod scene;
pub mod select;
pub mod solids;
pub mod source;
pub mod streamer;
pub mod sun;
pub mod switching;
pub mod transfer;
pub mod translucency;
