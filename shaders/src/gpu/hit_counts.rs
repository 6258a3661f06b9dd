//! Counts the pixels of each node on a device, and reads them back without waiting. CPU twin:
//! [`crate::cpu::hit_counts`].

use super::{DeviceQueue, Raycaster, bind_group, buffer, compute_pipeline, shader_module, words_of};
use crate::layout::{HIT_BLOCK_PX, HIT_COUNTS_THREADS, binding};
use std::sync::mpsc::{Receiver, TryRecvError, sync_channel};

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
