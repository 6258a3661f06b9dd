//! `hit_counts.wgsl` on a device: which nodes a picture shows, read back without waiting.
//!
//! In: a [`Raycaster`]'s hits. Out: a count a node, a frame or two later. Next: the client's selection.

use super::{DeviceQueue, Raycaster};
use std::sync::mpsc::{Receiver, TryRecvError, sync_channel};

/// Threads of a workgroup, and pixels along the side of what one counts.
const THREADS: u32 = 64;
const SIDE: u32 = 8;

/// The pass, and the one count that may be on its way.
#[derive(Debug)]
pub struct HitCounts {
    pipeline: wgpu::ComputePipeline,
    size: wgpu::Buffer,
    pixels: wgpu::Buffer,
    staging: wgpu::Buffer,
    /// Nodes of the count on its way, and where its arrival is told.
    flight: Option<(usize, Option<Receiver<bool>>)>,
}

fn buffer(device: &wgpu::Device, label: &str, bytes: u64, usage: wgpu::BufferUsages) -> wgpu::Buffer {
    device.create_buffer(&wgpu::BufferDescriptor { label: Some(label), size: bytes, usage, mapped_at_creation: false })
}

impl HitCounts {
    /// For cuts of at most `nodes` nodes.
    pub fn new(device: &wgpu::Device, nodes: u32) -> Self {
        use wgpu::BufferUsages as Usage;
        let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some("hit_counts"),
            source: wgpu::ShaderSource::Wgsl(crate::HIT_COUNTS_WGSL.into()),
        });
        let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some("hit_counts"),
            layout: None,
            module: &module,
            entry_point: Some("hit_counts"),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            cache: None,
        });
        let bytes = u64::from(nodes.max(1)) * 4;
        Self {
            pipeline,
            size: buffer(device, "hit_counts size", 8, Usage::UNIFORM | Usage::COPY_DST),
            pixels: buffer(device, "hit_counts", bytes, Usage::STORAGE | Usage::COPY_SRC | Usage::COPY_DST),
            staging: buffer(device, "hit_counts copy", bytes, Usage::MAP_READ | Usage::COPY_DST),
            flight: None,
        }
    }

    /// Records the count of the picture that was recorded last, of `nodes` nodes. `false`: another one is still on its way.
    pub fn encode(
        &mut self,
        on: DeviceQueue<'_>,
        encoder: &mut wgpu::CommandEncoder,
        raycaster: &Raycaster,
        nodes: usize,
    ) -> bool {
        if self.flight.is_some() || nodes as u64 * 4 > self.pixels.size() || nodes == 0 {
            return false;
        }
        let DeviceQueue { device, queue } = on;
        let [width, height] = raycaster.size_px();
        queue.write_buffer(&self.size, 0, bytemuck::cast_slice(&[width, height]));
        encoder.clear_buffer(&self.pixels, 0, Some(nodes as u64 * 4));
        let bind_group = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("hit_counts"),
            layout: &self.pipeline.get_bind_group_layout(0),
            entries: &[
                wgpu::BindGroupEntry { binding: 0, resource: self.size.as_entire_binding() },
                wgpu::BindGroupEntry { binding: 1, resource: raycaster.hit_buffer().as_entire_binding() },
                wgpu::BindGroupEntry { binding: 2, resource: self.pixels.as_entire_binding() },
            ],
        });
        let mut pass = encoder
            .begin_compute_pass(&wgpu::ComputePassDescriptor { label: Some("hit_counts"), timestamp_writes: None });
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &bind_group, &[]);
        pass.dispatch_workgroups((width.div_ceil(SIDE) * height.div_ceil(SIDE)).div_ceil(THREADS), 1, 1);
        drop(pass);
        encoder.copy_buffer_to_buffer(&self.pixels, 0, &self.staging, 0, nodes as u64 * 4);
        self.flight = Some((nodes, None));
        true
    }

    /// To be called once what [`HitCounts::encode`] recorded was submitted: asks for the count.
    pub fn submitted(&mut self) {
        if let Some((nodes, arrival @ None)) = &mut self.flight {
            let (sender, receiver) = sync_channel(1);
            self.staging.slice(..*nodes as u64 * 4).map_async(wgpu::MapMode::Read, move |result| {
                // Nobody listens any more if the window was closed.
                let _ = sender.send(result.is_ok());
            });
            *arrival = Some(receiver);
        }
    }

    /// The count that was asked for, once it is here; never waits. An empty one if the device failed.
    pub fn take(&mut self, device: &wgpu::Device) -> Option<Vec<u32>> {
        let (nodes, receiver) = self.flight.as_ref()?;
        let receiver = receiver.as_ref()?;
        // What goes wrong here is told by the next submission too.
        let _ = device.poll(wgpu::PollType::Poll);
        let mapped = match receiver.try_recv() {
            Ok(mapped) => mapped,
            Err(TryRecvError::Empty) => return None,
            Err(TryRecvError::Disconnected) => false,
        };
        let bytes = *nodes as u64 * 4;
        self.flight = None;
        if !mapped {
            return Some(Vec::new());
        }
        let pixels = match self.staging.slice(..bytes).get_mapped_range() {
            Ok(view) => view.chunks_exact(4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect(),
            Err(_) => Vec::new(),
        };
        self.staging.unmap();
        Some(pixels)
    }
}
