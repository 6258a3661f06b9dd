//! The ray-caster behind `--adapter`: a GPU, or the CPU.

use super::{DriverTrial, RememberedTrials, trial_key};
use crate::error::{ClientError, Result};
use insula_protocol::text::printable;
use insula_shaders::cpu::raycast::{Pixels, RayCounts};
use insula_shaders::gpu::GpuError;
use insula_shaders::layout::SUMMARY_WORDS;
use insula_viewer::cache::{Upload, pages_for};
use insula_viewer::frame::FrameData;
use insula_viewer::render::{AdapterInfo, CpuAdapter, GpuAdapter, GpuDevice};
use insula_viewer::select::occlusion_feedback::OcclusionQuery;

/// Reason of an adapter that `--adapter` or the environment names.
const ASKED_FOR: &str = "asked for";

/// Value of `--adapter`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, clap::ValueEnum)]
pub enum AdapterChoice {
    /// The GPU if one works, otherwise the CPU, or a software driver where a trial of a window shows that it is faster.
    #[default]
    Auto,
    /// The CPU ray-caster.
    Cpu,
    /// A GPU, or a software driver; an error if there is none.
    Gpu,
}

/// Which trials tell whether a software driver is faster than the CPU ray-caster.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Trial {
    /// One that is remembered, or else one now, which takes seconds.
    Now,
    /// One that is remembered.
    Remembered,
}

/// A ray-caster with its atlas.
#[derive(Debug)]
pub enum Adapter {
    Gpu(Box<GpuAdapter>),
    Cpu(CpuAdapter),
}

/// An adapter and what a session must know of it.
#[derive(Debug)]
pub struct OpenedAdapter {
    pub adapter: Adapter,
    pub info: AdapterInfo,
    /// Number of cache pages that the atlas holds.
    pub pages: u32,
}

impl OpenedAdapter {
    /// The CPU ray-caster with an atlas of `pages` pages.
    pub fn cpu(pages: u32) -> Self {
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        Self { adapter: Adapter::Cpu(CpuAdapter::new(pages)), info: AdapterInfo::cpu(cores), pages }
    }

    /// The ray-caster on a GPU.
    pub fn gpu(gpu: GpuAdapter) -> Self {
        let (info, pages) = (gpu.device.info(), gpu.pages());
        Self { adapter: Adapter::Gpu(Box::new(gpu)), info, pages }
    }

    /// The same with the reason why it draws.
    fn because(mut self, reason: impl Into<String>) -> Self {
        self.info.reason = reason.into();
        self
    }

    /// Opens what `choice` asks for: the CPU, or the device that `open_device` opens. Under `auto`, a software driver draws only if a
    /// trial shows that it is faster than the CPU ray-caster: one now, or only one that is remembered. Notes on standard error why no
    /// GPU draws. Fails if `gpu` finds none.
    pub fn choose(
        choice: AdapterChoice,
        open_device: impl FnOnce() -> std::result::Result<GpuDevice, String>,
        trial: Trial,
        cache_bytes: u64,
    ) -> Result<Self> {
        let pages = pages_for(cache_bytes);
        if choice == AdapterChoice::Cpu {
            return Ok(Self::cpu(pages).because(ASKED_FOR));
        }
        let opened = open_device().and_then(|device| match choice == AdapterChoice::Auto && device.is_software() {
            true => Self::faster_than(device, trial, pages),
            false => pollster::block_on(GpuAdapter::new(device, pages)).map(Self::gpu),
        });
        match opened {
            Ok(opened) if choice == AdapterChoice::Gpu => Ok(opened.because(ASKED_FOR)),
            Ok(opened) if opened.info.reason.is_empty() => Ok(opened.because("a GPU")),
            Ok(opened) => Ok(opened),
            Err(reason) if choice == AdapterChoice::Gpu => Err(ClientError::Graphics(format!(
                "no usable GPU ({reason}): install a graphics driver, or use --adapter auto"
            ))),
            Err(reason) => {
                tracing::debug!("no usable GPU: {reason}");
                eprintln!("note: no usable GPU, using the CPU ray-caster instead");
                Ok(Self::cpu(pages).because("no usable GPU"))
            }
        }
    }

    /// A software driver or the CPU ray-caster, whichever is faster in a trial, or was in one that is remembered. Without one, the CPU
    /// ray-caster. Fails if the driver does.
    fn faster_than(software: GpuDevice, trial: Trial, pages: u32) -> std::result::Result<Self, String> {
        let (trials, key) = (RememberedTrials::of_user(), trial_key(&software));
        let trial = match (trials.get(&key), trial) {
            (Some(trial), _) => trial,
            (None, Trial::Remembered) => {
                let reason = format!("{} was not tried", printable(&software.info().name));
                return Ok(Self::cpu(pages).because(reason));
            }
            (None, Trial::Now) => {
                let trial = DriverTrial::run(&software)?;
                trials.keep(&key, &trial);
                trial
            }
        };
        let reason = trial.text(&printable(&software.info().name));
        if trial.prefers_cpu() {
            eprintln!("note: using the CPU ray-caster: {reason}");
            return Ok(Self::cpu(pages).because(reason));
        }
        pollster::block_on(GpuAdapter::new(software, pages)).map(|gpu| Self::gpu(gpu).because(reason))
    }
}

impl Adapter {
    /// Opens an adapter without a window. See [`OpenedAdapter::choose`]. A trial would take longer than most pictures.
    pub fn headless(choice: AdapterChoice, cache_bytes: u64) -> Result<OpenedAdapter> {
        OpenedAdapter::choose(choice, || headless_device(cache_bytes), Trial::Remembered, cache_bytes)
    }

    /// Draws a frame and waits for its pixels. Fails if the GPU fails.
    pub fn draw(&mut self, data: &FrameData) -> Result<Pixels> {
        match self {
            Self::Gpu(gpu) => gpu.draw(data).map_err(graphics_error),
            Self::Cpu(cpu) => Ok(cpu.draw(data)),
        }
    }

    /// Whether the hit counts of a presented frame are still being read back.
    pub fn has_pending_query(&self) -> bool {
        matches!(self, Self::Gpu(gpu) if gpu.has_pending_query())
    }

    /// The query and the hit counts per node of a presented frame, once they have been read back. Never blocks.
    pub fn take_hits(&mut self) -> Option<(OcclusionQuery, Vec<u32>)> {
        match self {
            Self::Gpu(gpu) => gpu.take_hits(),
            Self::Cpu(_) => None,
        }
    }

    /// Counts the steps of a frame's rays, one ray per pixel. Costs about as much as drawing it. Fails if the GPU fails.
    pub fn count(&mut self, data: &FrameData) -> Result<RayCounts> {
        match self {
            Self::Gpu(gpu) => gpu.count(data).map_err(graphics_error),
            Self::Cpu(cpu) => Ok(cpu.count(data)),
        }
    }
}

impl Upload for Adapter {
    fn write_words(&mut self, at: u32, words: &[u32]) {
        match self {
            Self::Gpu(gpu) => gpu.write_words(at, words),
            Self::Cpu(cpu) => cpu.write_words(at, words),
        }
    }

    fn write_summary(&mut self, slot: u32, words: &[u32; SUMMARY_WORDS]) {
        match self {
            Self::Gpu(gpu) => gpu.write_summary(slot, words),
            Self::Cpu(cpu) => cpu.write_summary(slot, words),
        }
    }
}

/// A failure of the ray-caster on a GPU.
pub fn graphics_error(error: GpuError) -> ClientError {
    ClientError::Graphics(error.to_string())
}

/// Opens a device of Vulkan, Metal or DirectX, otherwise one of OpenGL, which prints complaints where there is no desktop.
/// Obeys `WGPU_BACKEND`.
fn headless_device(cache_bytes: u64) -> std::result::Result<GpuDevice, String> {
    let descriptor = || wgpu::InstanceDescriptor::new_without_display_handle_from_env();
    let mut primary = descriptor();
    primary.backends &= wgpu::Backends::PRIMARY;
    let open = |instance| pollster::block_on(GpuDevice::open(&wgpu::Instance::new(instance), None, cache_bytes));
    open(primary).or_else(|_| open(descriptor()))
}
