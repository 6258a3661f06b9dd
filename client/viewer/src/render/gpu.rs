//! The GPU ray-caster.

use super::{AdapterInfo, MadeMaps};
use crate::additions::MAX_ADDED_MESHES;
use crate::cache::{PAGE_BYTES, Upload, slots_for};
use crate::frame::FrameData;
use crate::select::occlusion_feedback::OcclusionQuery;
use crate::select::transitions::MAX_FADING;
use crate::translucency::MAP_PAGES;
#[cfg(not(target_arch = "wasm32"))]
use insula_shaders::cpu::raycast::{Pixels, RayCounts};
use insula_shaders::gpu::{Capacity, DeviceQueue, GpuError, HitCounts, Raycaster};
use insula_shaders::layout::{DrawNode, FrameUniform, SUMMARY_WORDS};

/// An open GPU device.
#[derive(Debug, Clone)]
pub struct GpuDevice {
    /// Needed for the formats of a surface.
    pub adapter: wgpu::Adapter,
    pub device: wgpu::Device,
    pub queue: wgpu::Queue,
    /// Size of the largest storage buffer.
    pub storage_bytes: u64,
}

impl GpuDevice {
    /// Opens the best device that can present to `surface`, or any device without one. Its storage buffers may have up to
    /// `bytes`, or less if the device supports less. Fails if no driver has a device.
    pub async fn open(
        instance: &wgpu::Instance,
        surface: Option<&wgpu::Surface<'_>>,
        bytes: u64,
    ) -> Result<Self, String> {
        let options = wgpu::RequestAdapterOptions {
            power_preference: wgpu::PowerPreference::HighPerformance,
            compatible_surface: surface,
            ..wgpu::RequestAdapterOptions::default()
        };
        let adapter = instance.request_adapter(&options).await.map_err(|e| e.to_string())?;
        let supported = adapter.limits();
        let storage_bytes = bytes.min(supported.max_storage_buffer_binding_size).min(supported.max_buffer_size);
        let defaults = wgpu::Limits::default();
        let required_limits = wgpu::Limits {
            max_storage_buffer_binding_size: storage_bytes.max(defaults.max_storage_buffer_binding_size),
            max_buffer_size: storage_bytes.max(defaults.max_buffer_size),
            max_texture_dimension_2d: supported.max_texture_dimension_2d,
            ..defaults
        };
        let descriptor =
            wgpu::DeviceDescriptor { label: Some("insula"), required_limits, ..wgpu::DeviceDescriptor::default() };
        let (device, queue) = adapter.request_device(&descriptor).await.map_err(|e| e.to_string())?;
        device.on_uncaptured_error(std::sync::Arc::new(|error| tracing::error!("GPU error: {error}")));
        Ok(Self { adapter, device, queue, storage_bytes })
    }

    /// Whether the driver computes on the CPU. The CPU ray-caster may be faster then.
    pub fn is_software(&self) -> bool {
        self.adapter.get_info().device_type == wgpu::DeviceType::Cpu
    }

    /// Name and backend of the device.
    pub fn info(&self) -> AdapterInfo {
        let info = self.adapter.get_info();
        AdapterInfo { name: info.name, backend: info.backend.to_string(), reason: String::new() }
    }
}

/// The ray-caster on a [`GpuDevice`].
#[derive(Debug)]
pub struct GpuAdapter {
    pub device: GpuDevice,
    pub raycaster: Raycaster,
    tally: HitCounts,
    /// Query whose hit counts are being read back.
    pending_query: Option<OcclusionQuery>,
    /// Generation and size of the last frame that was counted.
    last_counted: Option<(u64, [u32; 2])>,
    maps: MadeMaps,
}

impl GpuAdapter {
    /// Allocates GPU memory for `pages` pages, or for fewer if one buffer cannot be that large. Fails if the memory or a
    /// shader is refused.
    pub async fn new(device: GpuDevice, pages: u32) -> Result<Self, String> {
        let pages = pages.min(((device.storage_bytes / PAGE_BYTES) as u32).saturating_sub(MAP_PAGES));
        let slots = slots_for(pages);
        let nodes = slots + (2 * MAX_FADING + MAX_ADDED_MESHES) as u32;
        let capacity = Capacity { atlas_pages: pages + MAP_PAGES, slots, nodes };
        let validation = device.device.push_error_scope(wgpu::ErrorFilter::Validation);
        let memory = device.device.push_error_scope(wgpu::ErrorFilter::OutOfMemory);
        let raycaster = Raycaster::new(&device.device, capacity);
        let errors = [memory.pop().await, validation.pop().await];
        match errors.into_iter().flatten().next() {
            Some(error) => Err(error.to_string().lines().map(str::trim).collect::<Vec<_>>().join(" ")),
            None => {
                let tally = HitCounts::new(&device.device, nodes);
                Ok(Self {
                    device,
                    raycaster,
                    tally,
                    pending_query: None,
                    last_counted: None,
                    maps: MadeMaps::default(),
                })
            }
        }
    }

    /// Number of pages that the atlas holds, without those of translucency maps.
    pub fn pages(&self) -> u32 {
        self.raycaster.capacity().atlas_pages - MAP_PAGES
    }

    /// Records the ray-casting pass. The pixels stay on the device. Fails if the frame exceeds the capacity.
    pub fn encode(
        &mut self,
        encoder: &mut wgpu::CommandEncoder,
        frame: &FrameUniform,
        grid: &[[u32; 2]],
        nodes: &[DrawNode],
    ) -> Result<(), GpuError> {
        self.raycaster.resize(&self.device.device, [frame.width_px, frame.height_px]);
        let on = DeviceQueue { device: &self.device.device, queue: &self.device.queue };
        for number in self.maps.begin(frame) {
            self.raycaster.make_map(on, frame, grid, nodes, number)?;
        }
        self.raycaster.render(on, encoder, frame, grid, nodes)
    }

    /// Records a pass that counts the hits per node of the frame that [`GpuAdapter::encode`] recorded. Does nothing if these
    /// counts are known or if another query is pending.
    pub fn encode_query(&mut self, encoder: &mut wgpu::CommandEncoder, data: &FrameData) {
        if self.encode_count(encoder, data.query.generation, &data.frame, data.nodes.len()) {
            self.pending_query = Some(data.query.clone());
        }
    }

    /// The same for a frame whose query is elsewhere: `generation` is the number of its draw list, which has `nodes`. Returns whether its
    /// hits are counted.
    pub fn encode_count(
        &mut self,
        encoder: &mut wgpu::CommandEncoder,
        generation: u64,
        frame: &FrameUniform,
        nodes: usize,
    ) -> bool {
        let counted = (generation, [frame.width_px, frame.height_px]);
        let on = DeviceQueue { device: &self.device.device, queue: &self.device.queue };
        let is_new = self.last_counted != Some(counted) && self.tally.encode(on, encoder, &self.raycaster, nodes);
        if is_new {
            self.last_counted = Some(counted);
        }
        is_new
    }

    /// Starts to read back the counts. To be called after the commands of [`GpuAdapter::encode_query`] were submitted.
    pub fn query_submitted(&mut self) {
        self.tally.submitted();
    }

    /// Whether hit counts are still being read back.
    pub fn has_pending_query(&self) -> bool {
        self.pending_query.is_some()
    }

    /// The pending query and its hit counts per node, once they have been read back. Never blocks.
    pub fn take_hits(&mut self) -> Option<(OcclusionQuery, Vec<u32>)> {
        let pixels = self.take_counts()?;
        Some((self.pending_query.take()?, pixels))
    }

    /// The hit counts per node of the frame that [`GpuAdapter::encode_count`] recorded, once they have been read back. Never blocks.
    pub fn take_counts(&mut self) -> Option<Vec<u32>> {
        self.tally.take(&self.device.device)
    }

    /// Counts the steps of a frame's rays without drawing it. Waits for the result. Fails if the GPU fails.
    #[cfg(not(target_arch = "wasm32"))]
    pub fn count(&mut self, data: &FrameData) -> Result<RayCounts, GpuError> {
        let on = DeviceQueue { device: &self.device.device, queue: &self.device.queue };
        self.raycaster.resize(on.device, [data.frame.width_px, data.frame.height_px]);
        self.raycaster.count(on, &data.frame, &data.grid, &data.nodes)
    }

    /// Draws a frame and reads its pixels back. Fails if the GPU fails.
    #[cfg(not(target_arch = "wasm32"))]
    pub fn draw(&mut self, data: &FrameData) -> Result<Pixels, GpuError> {
        let label = wgpu::CommandEncoderDescriptor { label: Some("frame") };
        let mut encoder = self.device.device.create_command_encoder(&label);
        self.encode(&mut encoder, &data.frame, &data.grid, &data.nodes)?;
        self.device.queue.submit([encoder.finish()]);
        self.raycaster.read_back(&self.device.device, &self.device.queue)
    }
}

impl Upload for GpuAdapter {
    fn write_words(&mut self, at: u32, words: &[u32]) {
        self.raycaster.write_words(&self.device.queue, at, words);
    }

    fn write_summary(&mut self, slot: u32, words: &[u32; SUMMARY_WORDS]) {
        self.raycaster.write_summary(&self.device.queue, slot, words);
    }
}
