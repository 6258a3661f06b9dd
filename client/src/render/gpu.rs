//! The ray-caster on a graphics device.
//!
//! In: uploads, [`FrameData`]. Out: pixels in device memory, or read back. Next: `session`, `ui::window`.

use super::AdapterInfo;
use crate::error::{ClientError, Result};
use insula_shaders::{
    cpu::raycast::{Counts, Pixels},
    gpu::{Capacity, Raycaster, Tally},
    layout::SUMMARY_WORDS,
};
use insula_viewer::{
    cache::{PAGE_BYTES, Upload, slots_for},
    frame::FrameData,
    select::{occlusion_feedback::OcclusionQuery, transitions::MAX_FADING},
};

/// A device, and what it can hold.
#[derive(Debug, Clone)]
pub struct Device {
    /// The adapter, for its surface formats.
    pub adapter: wgpu::Adapter,
    /// Makes things.
    pub device: wgpu::Device,
    /// Takes work.
    pub queue: wgpu::Queue,
    /// Largest storage buffer.
    pub storage_bytes: u64,
}

impl Device {
    /// The best device that can present to `surface` (any, without one), with storage buffers of up to `bytes`.
    pub fn open(instance: &wgpu::Instance, surface: Option<&wgpu::Surface<'_>>, bytes: u64) -> Result<Self, String> {
        let options = wgpu::RequestAdapterOptions {
            power_preference: wgpu::PowerPreference::HighPerformance,
            compatible_surface: surface,
            ..wgpu::RequestAdapterOptions::default()
        };
        let adapter = pollster::block_on(instance.request_adapter(&options)).map_err(|e| e.to_string())?;
        let has = adapter.limits();
        let storage_bytes = bytes.min(has.max_storage_buffer_binding_size).min(has.max_buffer_size);
        let defaults = wgpu::Limits::default();
        let required_limits = wgpu::Limits {
            max_storage_buffer_binding_size: storage_bytes.max(defaults.max_storage_buffer_binding_size),
            max_buffer_size: storage_bytes.max(defaults.max_buffer_size),
            max_texture_dimension_2d: has.max_texture_dimension_2d,
            ..defaults
        };
        let descriptor =
            wgpu::DeviceDescriptor { label: Some("insula"), required_limits, ..wgpu::DeviceDescriptor::default() };
        let (device, queue) = pollster::block_on(adapter.request_device(&descriptor)).map_err(|e| e.to_string())?;
        device.on_uncaptured_error(std::sync::Arc::new(|error| tracing::error!("graphics device: {error}")));
        Ok(Self { adapter, device, queue, storage_bytes })
    }

    /// Whether it is a driver that computes on the CPU; the CPU ray-caster does that better.
    pub fn is_software(&self) -> bool {
        self.adapter.get_info().device_type == wgpu::DeviceType::Cpu
    }

    /// Name and backend.
    pub fn info(&self) -> AdapterInfo {
        let info = self.adapter.get_info();
        AdapterInfo { name: info.name, backend: info.backend.to_string() }
    }
}

/// The ray-caster and its device.
#[derive(Debug)]
pub struct GpuAdapter {
    /// Where it runs.
    pub device: Device,
    /// Its buffers and its pass.
    pub raycaster: Raycaster,
    tally: Tally,
    /// The picture whose hits are on their way, and the last one that was.
    asked: Option<OcclusionQuery>,
    last: Option<(u64, [u32; 2])>,
}

impl GpuAdapter {
    /// Takes the device memory for `pages` pages (fewer if one buffer cannot be as large).
    pub fn new(device: Device, pages: u32) -> Result<Self, String> {
        let pages = pages.min((device.storage_bytes / PAGE_BYTES) as u32);
        let slots = slots_for(pages);
        let nodes = slots + 2 * MAX_FADING as u32;
        let capacity = Capacity { atlas_pages: pages, slots, nodes };
        let scope = device.device.push_error_scope(wgpu::ErrorFilter::Validation);
        let memory = device.device.push_error_scope(wgpu::ErrorFilter::OutOfMemory);
        let raycaster = Raycaster::new(&device.device, capacity);
        let errors = [pollster::block_on(memory.pop()), pollster::block_on(scope.pop())];
        match errors.into_iter().flatten().next() {
            Some(error) => Err(error.to_string().lines().map(str::trim).collect::<Vec<_>>().join(" ")),
            None => {
                let tally = Tally::new(&device.device, nodes);
                Ok(Self { device, raycaster, tally, asked: None, last: None })
            }
        }
    }

    /// Pages that fit.
    pub fn pages(&self) -> u32 {
        self.raycaster.capacity().atlas_pages
    }

    /// Records the ray-casting pass; the pixels stay on the device.
    pub fn encode(&mut self, encoder: &mut wgpu::CommandEncoder, data: &FrameData) -> Result<()> {
        let failed = |e: insula_shaders::gpu::GpuError| ClientError::Graphics(e.to_string());
        self.raycaster.resize(&self.device.device, [data.frame.width_px, data.frame.height_px]);
        let device = (&self.device.device, &self.device.queue);
        self.raycaster.render(device, encoder, &data.frame, &data.grid, &data.nodes).map_err(failed)
    }

    /// Records a count of what the pixels hit that [`GpuAdapter::encode`] recorded, unless that is known, or one is on its way.
    pub fn ask(&mut self, encoder: &mut wgpu::CommandEncoder, data: &FrameData) {
        let now = (data.query.generation, [data.frame.width_px, data.frame.height_px]);
        let device = (&self.device.device, &self.device.queue);
        if self.last != Some(now) && self.tally.encode(device, encoder, &self.raycaster, data.nodes.len()) {
            (self.asked, self.last) = (Some(data.query.clone()), Some(now));
        }
    }

    /// To be called once what [`GpuAdapter::ask`] recorded was submitted.
    pub fn submitted(&mut self) {
        self.tally.submitted();
    }

    /// Whether a count is on its way.
    pub fn is_asking(&self) -> bool {
        self.asked.is_some()
    }

    /// The count that was asked for, once it is here; never waits.
    pub fn answer(&mut self) -> Option<(OcclusionQuery, Vec<u32>)> {
        let pixels = self.tally.take(&self.device.device)?;
        Some((self.asked.take()?, pixels))
    }

    /// What the rays of such a picture do: draws nothing, waits.
    pub fn count(&mut self, data: &FrameData) -> Result<Counts> {
        let device = (&self.device.device, &self.device.queue);
        self.raycaster.resize(device.0, [data.frame.width_px, data.frame.height_px]);
        let counts = self.raycaster.count(device, &data.frame, &data.grid, &data.nodes);
        counts.map_err(|e| ClientError::Graphics(e.to_string()))
    }

    /// Draws, waits and reads back.
    pub fn draw(&mut self, data: &FrameData) -> Result<Pixels> {
        let label = wgpu::CommandEncoderDescriptor { label: Some("picture") };
        let mut encoder = self.device.device.create_command_encoder(&label);
        self.encode(&mut encoder, data)?;
        self.device.queue.submit([encoder.finish()]);
        let pixels = self.raycaster.read_back(&self.device.device, &self.device.queue);
        pixels.map_err(|e| ClientError::Graphics(e.to_string()))
    }
}

impl Upload for GpuAdapter {
    fn write_page(&mut self, page: u32, words: &[u32]) {
        self.raycaster.write_page(&self.device.queue, page, words);
    }

    fn write_summary(&mut self, slot: u32, words: &[u32; SUMMARY_WORDS]) {
        self.raycaster.write_summary(&self.device.queue, slot, words);
    }
}
