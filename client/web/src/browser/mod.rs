//! The viewer of a page, and what its other workers run.

pub mod console;
mod control;
pub mod decoder;
mod draping;
mod fetcher;
mod frame_job;
mod frame_loop;
mod gpu_canvas;
pub mod host;
mod models;
mod navigation;
pub mod objects;
mod overlay;
mod page_writes;
mod picking;
pub mod row_renderer;
mod transport;
pub mod viewer;

use crate::{commands, messages};
