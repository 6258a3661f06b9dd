//! What a person does with a view, the same in a window and in a browser: steering the camera, measuring, running the time of
//! day, and how finely frames are drawn meanwhile.
//!
//! Times are [`web_time::Instant`]s, which are those of the standard library except in WebAssembly, where that has no clock.

pub mod camera_control;
pub mod day_animation;
mod frame_budget;
pub mod frame_pacing;
pub mod measure;
pub mod units;
