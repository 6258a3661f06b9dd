//! Draws frames on a GPU or on the CPU.

mod adapter;
mod adapter_info;
mod cpu;
mod gpu;

pub use adapter::{Adapter, AdapterChoice, OpenedAdapter};
pub use adapter_info::AdapterInfo;
pub use cpu::CpuAdapter;
pub use gpu::{GpuAdapter, GpuDevice};
