//! Insula's streaming client: flies through cities.
//!
//! In: a server's URL, a camera. Out: pictures, in a window or in files.
//!
//! A frame's way: `select` (pure) -> `stream` (request, fetch, decode) -> `cache` (pages) -> `render` (frame, ray-cast,
//! compose). `session` is the loop, shared by the window, `snapshot` and `fly`.

pub mod args;

pub mod camera_files;
pub mod commands;
pub mod error;
pub mod picture;
pub mod render;
pub mod report;

pub mod session;
pub mod stream;

pub mod ui;
