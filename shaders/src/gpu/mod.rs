//! The WGSL stages as wgpu passes, and the memory that they read.

pub mod compose;
pub mod hit_counts;
#[cfg(not(target_arch = "wasm32"))]
pub mod nearest;
#[cfg(not(target_arch = "wasm32"))]
pub mod occlusion;
pub mod raycast;
mod translucency;

pub use compose::Compose;
pub use hit_counts::HitCounts;
#[cfg(not(target_arch = "wasm32"))]
pub use nearest::Nearest;
#[cfg(not(target_arch = "wasm32"))]
pub use occlusion::OcclusionMaps;
pub use raycast::{Capacity, Raycaster};

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
fn buffer(device: &wgpu::Device, label: &str, bytes: u64, usage: wgpu::BufferUsages) -> wgpu::Buffer {
    let usage = usage | wgpu::BufferUsages::COPY_DST;
    device.create_buffer(&wgpu::BufferDescriptor { label: Some(label), size: bytes, usage, mapped_at_creation: false })
}

fn shader_module(device: &wgpu::Device, label: &str, source: String) -> wgpu::ShaderModule {
    let source = wgpu::ShaderSource::Wgsl(source.into());
    device.create_shader_module(wgpu::ShaderModuleDescriptor { label: Some(label), source })
}

/// The pipeline of an entry point. The shader says what it binds.
fn compute_pipeline(device: &wgpu::Device, module: &wgpu::ShaderModule, entry_point: &str) -> wgpu::ComputePipeline {
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
fn bind_group(
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
fn target(
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
fn read_words(device: &wgpu::Device, queue: &wgpu::Queue, source: &wgpu::Buffer) -> Result<Vec<u32>, GpuError> {
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
