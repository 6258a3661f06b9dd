//! The WGSL stages as wgpu passes, and the memory that they read.

pub mod compose;
pub mod hit_counts;
#[cfg(not(target_arch = "wasm32"))]
pub mod nearest;
pub mod raycast;

pub use compose::Compose;
pub use hit_counts::HitCounts;
#[cfg(not(target_arch = "wasm32"))]
pub use nearest::Nearest;
pub use raycast::{Capacity, Raycaster};

/// A device, and the queue of its commands.
#[derive(Debug, Clone, Copy)]
pub struct DeviceQueue<'a> {
    /// Where resources are made.
    pub device: &'a wgpu::Device,
    /// Where commands and writes are submitted.
    pub queue: &'a wgpu::Queue,
}

/// Why the device delivered nothing.
#[derive(Debug, thiserror::Error)]
pub enum GpuError {
    /// No device works.
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
    /// Buffers could not be read back.
    #[error("the frame could not be read back from the graphics device: {0}")]
    ReadBack(String),
}

/// An empty buffer that can be written.
fn buffer(device: &wgpu::Device, label: &str, bytes: u64, usage: wgpu::BufferUsages) -> wgpu::Buffer {
    let usage = usage | wgpu::BufferUsages::COPY_DST;
    device.create_buffer(&wgpu::BufferDescriptor { label: Some(label), size: bytes, usage, mapped_at_creation: false })
}

/// A module of the crate's WGSL.
fn shader_module(device: &wgpu::Device, label: &str, source: String) -> wgpu::ShaderModule {
    let source = wgpu::ShaderSource::Wgsl(source.into());
    device.create_shader_module(wgpu::ShaderModuleDescriptor { label: Some(label), source })
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
