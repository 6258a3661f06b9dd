//! Which ray-caster draws.
//!
//! In: `--adapter`, the cache's bytes. Out: [`Adapter`]. Next: `session` uploads to it and draws with it.

use super::{
    AdapterInfo,
    cpu::CpuAdapter,
    gpu::{Device, GpuAdapter},
};
use crate::error::{ClientError, Result};
use insula_shaders::{
    cpu::raycast::{Counts, Pixels},
    layout::SUMMARY_WORDS,
};
use insula_viewer::{
    cache::{Upload, pages_for},
    frame::FrameData,
};

/// `--adapter`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, clap::ValueEnum)]
pub enum AdapterChoice {
    /// A graphics device if there is one that works, else the CPU.
    #[default]
    Auto,
    /// The CPU ray-caster.
    Cpu,
    /// A graphics device, even one in software; an error if there is none.
    Gpu,
}

/// A ray-caster with its memory.
#[derive(Debug)]
pub enum Adapter {
    /// On a graphics device.
    Gpu(Box<GpuAdapter>),
    /// In main memory.
    Cpu(CpuAdapter),
}

impl Adapter {
    /// Without a window. Says on standard error if there is no graphics device.
    pub fn headless(choice: AdapterChoice, cache_bytes: u64) -> Result<(Self, AdapterInfo, u32)> {
        let pages = pages_for(cache_bytes);
        if choice != AdapterChoice::Cpu {
            let gpu = headless_device(cache_bytes).and_then(|device| GpuAdapter::new(device, pages));
            match gpu {
                Ok(gpu) => {
                    let (info, pages) = (gpu.device.info(), gpu.pages());
                    if choice == AdapterChoice::Auto && gpu.device.is_software() {
                        eprintln!("note: {} is no graphics hardware, --adapter cpu may be faster", info.name);
                    }
                    return Ok((Self::Gpu(Box::new(gpu)), info, pages));
                }
                Err(reason) if choice == AdapterChoice::Gpu => {
                    return Err(ClientError::Graphics(format!(
                        "no graphics device can be used ({reason}): install a driver, or use --adapter auto"
                    )));
                }
                Err(reason) => {
                    tracing::debug!("no graphics device: {reason}");
                    eprintln!("note: no graphics device can be used, the CPU ray-caster draws instead");
                }
            }
        }
        Ok((Self::Cpu(CpuAdapter::new(pages)), AdapterInfo::cpu(), pages))
    }

    /// Draws a picture and waits for it.
    pub fn draw(&mut self, data: &FrameData) -> Result<Pixels> {
        match self {
            Self::Gpu(gpu) => gpu.draw(data),
            Self::Cpu(cpu) => Ok(cpu.draw(data)),
        }
    }

    /// Whether what a picture's rays hit is on its way.
    pub fn is_asking(&self) -> bool {
        matches!(self, Self::Gpu(gpu) if gpu.is_asking())
    }

    /// What the rays of such a picture do, one a pixel. Costs about as much as a picture.
    pub fn count(&mut self, data: &FrameData) -> Result<Counts> {
        match self {
            Self::Gpu(gpu) => gpu.count(data),
            Self::Cpu(cpu) => Ok(cpu.count(data)),
        }
    }
}

impl Upload for Adapter {
    fn write_page(&mut self, page: u32, words: &[u32]) {
        match self {
            Self::Gpu(gpu) => gpu.write_page(page, words),
            Self::Cpu(cpu) => cpu.write_page(page, words),
        }
    }

    fn write_summary(&mut self, slot: u32, words: &[u32; SUMMARY_WORDS]) {
        match self {
            Self::Gpu(gpu) => gpu.write_summary(slot, words),
            Self::Cpu(cpu) => cpu.write_summary(slot, words),
        }
    }
}
/// The first device of the modern interfaces, else one of OpenGL, which complains on standard error where there is no
/// desktop. What the environment asks for (`WGPU_BACKEND`) is obeyed.
fn headless_device(cache_bytes: u64) -> std::result::Result<Device, String> {
    let descriptor = || wgpu::InstanceDescriptor::new_without_display_handle_from_env();
    let mut modern = descriptor();
    modern.backends &= wgpu::Backends::PRIMARY;
    Device::open(&wgpu::Instance::new(modern), None, cache_bytes)
        .or_else(|_| Device::open(&wgpu::Instance::new(descriptor()), None, cache_bytes))
}
