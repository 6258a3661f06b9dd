//! The WGSL stages as wgpu passes, and the memory that they read.

pub mod compose;
#[cfg(not(target_arch = "wasm32"))]
pub mod nearest;
#[cfg(not(target_arch = "wasm32"))]
pub mod occlusion;
pub mod raycast;

use crate::layout::{DrawNode, FrameUniform, HIT_BLOCK_PX, HIT_COUNTS_THREADS, WORKGROUP, binding};
use crate::translucency::{COARSEST_PX, MAX_MAP_PX, level_words, map_words};
pub use compose::Compose;
#[cfg(not(target_arch = "wasm32"))]
pub use nearest::Nearest;
#[cfg(not(target_arch = "wasm32"))]
pub use occlusion::OcclusionMaps;
pub use raycast::{Capacity, Raycaster};
use raycast::{MapMaker, OutputBuffers, PipelineVariant, pipeline};
use std::sync::mpsc::{Receiver, TryRecvError, sync_channel};

/// A device, and the queue of its commands.
#[derive(Debug, Clone, Copy)]
pub struct DeviceQueue<'a> {
    /// Where resources are made.
    pub device: &'a wgpu::Device,
    /// Where commands and writes are submitted.
    pub queue: &'a wgpu::Queue,
}

/// A device of a program that shows nothing.
#[cfg(not(target_arch = "wasm32"))]
#[derive(Debug)]
struct OpenDevice {
    device: wgpu::Device,
    queue: wgpu::Queue,
    /// The adapter and its backend.
    name: String,
}

#[cfg(not(target_arch = "wasm32"))]
impl OpenDevice {
    /// Opens the first device that the environment allows, with all its limits, and those of `wanted` that it has. Fails if
    /// none works.
    fn open(label: &str, wanted: wgpu::Features) -> Result<Self, GpuError> {
        let none = |e: &dyn std::fmt::Display| GpuError::NoDevice(e.to_string());
        let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle_from_env());
        let options = wgpu::RequestAdapterOptions {
            power_preference: wgpu::PowerPreference::HighPerformance,
            ..wgpu::RequestAdapterOptions::default()
        };
        let adapter = pollster::block_on(instance.request_adapter(&options)).map_err(|e| none(&e))?;
        let info = adapter.get_info();
        let descriptor = wgpu::DeviceDescriptor {
            label: Some(label),
            required_limits: adapter.limits(),
            required_features: adapter.features() & wanted,
            ..wgpu::DeviceDescriptor::default()
        };
        let (device, queue) = pollster::block_on(adapter.request_device(&descriptor)).map_err(|e| none(&e))?;
        Ok(Self { device, queue, name: format!("{} ({})", info.name, info.backend) })
    }
}

/// Why the device delivered nothing.
#[derive(Debug, thiserror::Error)]
pub enum GpuError {
    #[error("no graphics device can be used ({0}): install a driver")]
    NoDevice(String),
    /// More nodes than the [`Capacity`] allows.
    #[error("the draw list has {found} nodes, the ray-caster was made for {limit}: raise tau")]
    TooManyNodes {
        /// Number of nodes in the draw list.
        found: usize,
        /// [`Capacity::nodes`].
        limit: u32,
    },
    /// A map without texels, or larger than the device's textures.
    #[error("a map is {found} texels wide or high, this device draws 1 to {limit}")]
    MapSize {
        /// Texels along a side.
        found: u32,
        /// Largest side of a texture.
        limit: u32,
    },
    /// A mesh needs a buffer larger than the device's.
    #[error("the mesh takes a buffer of {found} bytes, this device has up to {limit}")]
    BufferSize {
        /// Bytes of the largest buffer.
        found: u64,
        /// Largest buffer that a shader can read.
        limit: u64,
    },
    /// The device cannot keep what lies outside of a map's range of depths.
    #[error("this device cannot draw surroundings: it has no depth clamp")]
    NoDepthClamp,
    /// Commands or resources were refused.
    #[error("the graphics device refused: {0}")]
    Refused(String),
    #[error("the frame could not be read back from the graphics device: {0}")]
    ReadBack(String),
}

/// An empty buffer that can be written.
pub fn buffer(device: &wgpu::Device, label: &str, bytes: u64, usage: wgpu::BufferUsages) -> wgpu::Buffer {
    let usage = usage | wgpu::BufferUsages::COPY_DST;
    device.create_buffer(&wgpu::BufferDescriptor { label: Some(label), size: bytes, usage, mapped_at_creation: false })
}

/// A module of WGSL.
pub fn shader_module(device: &wgpu::Device, label: &str, source: String) -> wgpu::ShaderModule {
    let source = wgpu::ShaderSource::Wgsl(source.into());
    device.create_shader_module(wgpu::ShaderModuleDescriptor { label: Some(label), source })
}

/// The pipeline of an entry point. The shader says what it binds.
pub fn compute_pipeline(
    device: &wgpu::Device,
    module: &wgpu::ShaderModule,
    entry_point: &str,
) -> wgpu::ComputePipeline {
    device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: Some(entry_point),
        layout: None,
        module,
        entry_point: Some(entry_point),
        compilation_options: wgpu::PipelineCompilationOptions::default(),
        cache: None,
    })
}

/// Binds whole buffers.
pub fn bind_group(
    device: &wgpu::Device,
    label: &str,
    layout: &wgpu::BindGroupLayout,
    buffers: &[(u32, &wgpu::Buffer)],
) -> wgpu::BindGroup {
    let entries: Vec<wgpu::BindGroupEntry<'_>> = buffers
        .iter()
        .map(|(binding, buffer)| wgpu::BindGroupEntry { binding: *binding, resource: buffer.as_entire_binding() })
        .collect();
    device.create_bind_group(&wgpu::BindGroupDescriptor { label: Some(label), layout, entries: &entries })
}

/// A texture to draw into.
#[cfg(not(target_arch = "wasm32"))]
pub fn target(
    device: &wgpu::Device,
    format: wgpu::TextureFormat,
    size: [u32; 2],
    more: wgpu::TextureUsages,
) -> wgpu::Texture {
    device.create_texture(&wgpu::TextureDescriptor {
        label: Some("map"),
        size: wgpu::Extent3d { width: size[0], height: size[1], depth_or_array_layers: 1 },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage: wgpu::TextureUsages::RENDER_ATTACHMENT | more,
        view_formats: &[],
    })
}

/// Waits for the device and copies a buffer, which a browser cannot. Fails if the device was lost.
#[cfg(not(target_arch = "wasm32"))]
pub fn read_words(device: &wgpu::Device, queue: &wgpu::Queue, source: &wgpu::Buffer) -> Result<Vec<u32>, GpuError> {
    let failed = |e: &dyn std::fmt::Display| GpuError::ReadBack(e.to_string());
    let staging = buffer(device, "read back", source.size(), wgpu::BufferUsages::MAP_READ);
    let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("read back") });
    encoder.copy_buffer_to_buffer(source, 0, &staging, 0, source.size());
    queue.submit([encoder.finish()]);
    let (sender, receiver) = std::sync::mpsc::sync_channel(1);
    staging.slice(..).map_async(wgpu::MapMode::Read, move |result| {
        // The receiver is gone if waiting for the device failed.
        let _ = sender.send(result);
    });
    device.poll(wgpu::PollType::wait_indefinitely()).map_err(|e| failed(&e))?;
    receiver.recv().map_err(|e| failed(&e))?.map_err(|e| failed(&e))?;
    let view = staging.slice(..).get_mapped_range().map_err(|e| failed(&e))?;
    Ok(words_of(&view))
}

/// Little-endian words, as devices write them.
fn words_of(bytes: &[u8]) -> Vec<u32> {
    bytes.as_chunks().0.iter().map(|word| u32::from_le_bytes(*word)).collect()
}

/// The pass, and the one count that may be in flight.
#[derive(Debug)]
pub struct HitCounts {
    pipeline: wgpu::ComputePipeline,
    size: wgpu::Buffer,
    pixels: wgpu::Buffer,
    staging: wgpu::Buffer,
    in_flight: Option<CountInFlight>,
}

#[derive(Debug)]
struct CountInFlight {
    nodes: usize,
    /// Whether the staging buffer was mapped; `None` until the count was submitted.
    mapped: Option<Receiver<bool>>,
}

impl HitCounts {
    /// Makes the pass for draw lists of at most `nodes` nodes.
    pub fn new(device: &wgpu::Device, nodes: u32) -> Self {
        use wgpu::BufferUsages as Usage;
        let module = shader_module(device, "hit counts", crate::wgsl::hit_counts());
        let bytes = u64::from(nodes.max(1)) * 4;
        Self {
            pipeline: compute_pipeline(device, &module, "hit_counts"),
            size: buffer(device, "hit counts size", 8, Usage::UNIFORM),
            pixels: buffer(device, "hit counts", bytes, Usage::STORAGE | Usage::COPY_SRC),
            staging: buffer(device, "hit counts read back", bytes, Usage::MAP_READ),
            in_flight: None,
        }
    }

    /// Records the count of the frame that was recorded last, whose draw list has `nodes` nodes. `false` if nothing was
    /// recorded: another count is in flight, or the number of nodes is 0 or too large.
    pub fn encode(
        &mut self,
        on: DeviceQueue<'_>,
        encoder: &mut wgpu::CommandEncoder,
        raycaster: &Raycaster,
        nodes: usize,
    ) -> bool {
        let DeviceQueue { device, queue } = on;
        let bytes = nodes as u64 * 4;
        if self.in_flight.is_some() || bytes > self.pixels.size() || nodes == 0 {
            return false;
        }
        let [width, height] = raycaster.size_px();
        queue.write_buffer(&self.size, 0, bytemuck::cast_slice(&[width, height]));
        encoder.clear_buffer(&self.pixels, 0, Some(bytes));
        let buffers = [
            (binding::COUNTS_SIZE, &self.size),
            (binding::COUNTS_HIT, raycaster.hit_buffer()),
            (binding::COUNTS, &self.pixels),
        ];
        let bind_group = bind_group(device, "hit counts", &self.pipeline.get_bind_group_layout(0), &buffers);
        let descriptor = wgpu::ComputePassDescriptor { label: Some("hit counts"), timestamp_writes: None };
        let mut pass = encoder.begin_compute_pass(&descriptor);
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &bind_group, &[]);
        let blocks = width.div_ceil(HIT_BLOCK_PX) * height.div_ceil(HIT_BLOCK_PX);
        pass.dispatch_workgroups(blocks.div_ceil(HIT_COUNTS_THREADS), 1, 1);
        drop(pass);
        encoder.copy_buffer_to_buffer(&self.pixels, 0, &self.staging, 0, bytes);
        self.in_flight = Some(CountInFlight { nodes, mapped: None });
        true
    }

    /// Requests the count. To be called when the commands of [`HitCounts::encode`] have been submitted.
    pub fn submitted(&mut self) {
        if let Some(CountInFlight { nodes, mapped: mapped @ None }) = &mut self.in_flight {
            let (sender, receiver) = sync_channel(1);
            self.staging.slice(..*nodes as u64 * 4).map_async(wgpu::MapMode::Read, move |result| {
                // The receiver is gone if the window was closed.
                let _ = sender.send(result.is_ok());
            });
            *mapped = Some(receiver);
        }
    }

    /// Pixels of each node, once they have arrived; never waits. Empty if the device failed.
    pub fn take(&mut self, device: &wgpu::Device) -> Option<Vec<u32>> {
        let CountInFlight { nodes, mapped } = self.in_flight.as_ref()?;
        let receiver = mapped.as_ref()?;
        // An error is reported by the next submission too.
        let _ = device.poll(wgpu::PollType::Poll);
        let is_mapped = match receiver.try_recv() {
            Ok(is_mapped) => is_mapped,
            Err(TryRecvError::Empty) => return None,
            Err(TryRecvError::Disconnected) => false,
        };
        let bytes = *nodes as u64 * 4;
        self.in_flight = None;
        if !is_mapped {
            return Some(Vec::new());
        }
        let pixels = self.staging.slice(..bytes).get_mapped_range().map(|view| words_of(&view)).unwrap_or_default();
        self.staging.unmap();
        Some(pixels)
    }
}

impl Raycaster {
    /// Makes the frame's translucency map `number` and writes it into the atlas, before the frame itself is rendered. Does nothing if
    /// the frame has no such map, or if the atlas has no room for it. Fails if there are more nodes than the capacity allows.
    pub fn make_map(
        &mut self,
        on: DeviceQueue<'_>,
        frame: &FrameUniform,
        grid: &[[u32; 2]],
        nodes: &[DrawNode],
        number: usize,
    ) -> Result<(), GpuError> {
        let Some(map) = frame.translucency.get(number).filter(|map| map.width_px >= COARSEST_PX) else { return Ok(()) };
        let end = u64::from(map.address) + u64::from(map_words(map.width_px));
        if end * 4 > self.inputs.atlas.size() || map.width_px > MAX_MAP_PX {
            return Ok(());
        }
        self.upload(on, &FrameUniform { map_in_progress: number as u32, ..*frame }, grid, nodes)?;
        let device = on.device;
        let (layout, inputs) = (&self.bind_group_layout, &self.inputs);
        let maker = self.maps.get_or_insert_with(|| {
            let variant = PipelineVariant::with_landmarks();
            MapMaker {
                finest: pipeline(device, layout, "translucency_map", variant),
                coarser: pipeline(device, layout, "translucency_level", variant),
            }
        });
        let output = OutputBuffers::new(device, layout, inputs, [map.width_px; 2]);
        let label = Some("translucency map");
        let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label });
        let (mut width, mut address) = (map.width_px, u64::from(map.address));
        while width >= COARSEST_PX {
            let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor { label, timestamp_writes: None });
            pass.set_pipeline(if width == map.width_px { &maker.finest } else { &maker.coarser });
            pass.set_bind_group(0, &output.bind_group, &[]);
            pass.dispatch_workgroups(width / WORKGROUP[0], width / WORKGROUP[1], 1);
            drop(pass);
            let bytes = u64::from(width * width) * 4;
            encoder.copy_buffer_to_buffer(&output.colour, 0, &self.inputs.atlas, address * 4, bytes);
            encoder.copy_buffer_to_buffer(&output.hit, 0, &self.inputs.atlas, address * 4 + bytes, bytes);
            address += u64::from(level_words(width));
            width /= 2;
        }
        on.queue.submit([encoder.finish()]);
        Ok(())
    }
}
