//! Draws frames on a GPU or on the CPU.

mod adapter;
mod remembered;
mod trial;

pub use adapter::{Adapter, AdapterChoice, OpenedAdapter, Trial, graphics_error};
pub use insula_viewer::render::{AdapterInfo, CpuAdapter, GpuAdapter, GpuDevice};
