//! `raycast.wgsl` on a device: its buffers, its dispatch, its read-back.
//!
//! In: pages, summaries, the cut. Out: pixels in device memory. Next: `compose`, or [`Raycaster::read_back`].

use crate::{
    cpu::raycast::Pixels,
    layout::{Frame, Node, PAGE_WORDS, SUMMARY_WORDS, TreeNode, WORKGROUP, binding},
};
use bytemuck::Zeroable;
use wgpu::util::DeviceExt;

/// How much the device holds; fixed when the ray-caster is made.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Capacity {
    /// Pages of the atlas, 16 KiB each; at most `max_storage_buffer_binding_size / 16 KiB` of the device.
    pub atlas_pages: u32,
    /// Nodes that may be resident.
    pub slots: u32,
    /// Nodes that may be drawn in one frame.
    pub nodes: u32,
    /// Inner nodes of the cut's tree.
    pub tree: u32,
}

/// Why the device gave no pixels.
#[derive(Debug, thiserror::Error)]
pub enum GpuError {
    /// No device works.
    #[error("no graphics device can be used ({0}): install a driver")]
    None(String),
    /// More nodes than [`Capacity`] says.
    #[error("the cut has {found} {what}, the ray-caster was made for {limit}: raise tau")]
    Capacity {
        /// Nodes or tree entries.
        what: &'static str,
        /// In the cut.
        found: usize,
        /// When made.
        limit: u32,
    },
    /// Buffers could not be read back.
    #[error("the graphics device did not hand the picture over: {0}")]
    ReadBack(String),
}

/// The ray-caster on a device.
#[derive(Debug)]
pub struct Raycaster {
    capacity: Capacity,
    pipeline: wgpu::ComputePipeline,
    bind_group_layout: wgpu::BindGroupLayout,
    inputs: Inputs,
    target: Target,
}

#[derive(Debug)]
struct Inputs {
    frame: wgpu::Buffer,
    tree: wgpu::Buffer,
    nodes: wgpu::Buffer,
    summaries: wgpu::Buffer,
    atlas: wgpu::Buffer,
}

#[derive(Debug)]
struct Target {
    width_px: u32,
    height_px: u32,
    colour: wgpu::Buffer,
    distance: wgpu::Buffer,
    hit: wgpu::Buffer,
    bind_group: wgpu::BindGroup,
}

fn buffer(device: &wgpu::Device, label: &str, bytes: u64, usage: wgpu::BufferUsages) -> wgpu::Buffer {
    let usage = usage | wgpu::BufferUsages::COPY_DST;
    device.create_buffer(&wgpu::BufferDescriptor { label: Some(label), size: bytes, usage, mapped_at_creation: false })
}

impl Raycaster {
    /// Takes the memory of `capacity` on the device at once: what fits then fits for good.
    pub fn new(device: &wgpu::Device, capacity: Capacity) -> Self {
        let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some("raycast"),
            source: wgpu::ShaderSource::Wgsl(crate::RAYCAST_WGSL.into()),
        });
        let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some("raycast"),
            layout: None,
            module: &module,
            entry_point: Some("raycast"),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            cache: None,
        });
        let bind_group_layout = pipeline.get_bind_group_layout(0);
        let storage = wgpu::BufferUsages::STORAGE;
        let sized = |label: &str, count: u32, bytes: usize| {
            buffer(device, label, u64::from(count.max(1)) * bytes as u64, storage)
        };
        let inputs = Inputs {
            frame: device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
                label: Some("frame"),
                contents: bytemuck::bytes_of(&Frame::zeroed()),
                usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            }),
            tree: sized("tree", capacity.tree, size_of::<TreeNode>()),
            nodes: sized("nodes", capacity.nodes, size_of::<Node>()),
            summaries: sized("summaries", capacity.slots, SUMMARY_WORDS * 4),
            atlas: sized("atlas", capacity.atlas_pages, PAGE_WORDS * 4),
        };
        let target = Target::new(device, &bind_group_layout, &inputs, [1, 1]);
        Self { capacity, pipeline, bind_group_layout, inputs, target }
    }

    /// What it was made for.
    pub fn capacity(&self) -> Capacity {
        self.capacity
    }

    /// Writes a page of the atlas; a page outside the capacity is ignored.
    pub fn write_page(&self, queue: &wgpu::Queue, page: u32, words: &[u32]) {
        if page < self.capacity.atlas_pages && words.len() <= PAGE_WORDS {
            queue.write_buffer(
                &self.inputs.atlas,
                u64::from(page) * PAGE_WORDS as u64 * 4,
                bytemuck::cast_slice(words),
            );
        }
    }

    /// Writes a node's summary; a slot outside the capacity is ignored.
    pub fn write_summary(&self, queue: &wgpu::Queue, slot: u32, words: &[u32; SUMMARY_WORDS]) {
        if slot < self.capacity.slots {
            let offset = u64::from(slot) * SUMMARY_WORDS as u64 * 4;
            queue.write_buffer(&self.inputs.summaries, offset, bytemuck::cast_slice(words));
        }
    }

    /// Makes room for a picture of this size.
    pub fn resize(&mut self, device: &wgpu::Device, size_px: [u32; 2]) {
        if [self.target.width_px, self.target.height_px] != size_px {
            self.target = Target::new(device, &self.bind_group_layout, &self.inputs, size_px);
        }
    }

    /// Records one picture of `frame.width_px x frame.height_px`, which must be the size of the last [`Raycaster::resize`].
    pub fn render(
        &self,
        queue: &wgpu::Queue,
        encoder: &mut wgpu::CommandEncoder,
        frame: &Frame,
        tree: &[TreeNode],
        nodes: &[Node],
    ) -> Result<(), GpuError> {
        let fits = |what, found, limit| {
            if found > limit as usize { Err(GpuError::Capacity { what, found, limit }) } else { Ok(()) }
        };
        fits("nodes", nodes.len(), self.capacity.nodes)?;
        fits("tree entries", tree.len(), self.capacity.tree)?;
        queue.write_buffer(&self.inputs.frame, 0, bytemuck::bytes_of(frame));
        queue.write_buffer(&self.inputs.tree, 0, bytemuck::cast_slice(tree));
        queue.write_buffer(&self.inputs.nodes, 0, bytemuck::cast_slice(nodes));
        let mut pass =
            encoder.begin_compute_pass(&wgpu::ComputePassDescriptor { label: Some("raycast"), timestamp_writes: None });
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &self.target.bind_group, &[]);
        pass.dispatch_workgroups(
            self.target.width_px.div_ceil(WORKGROUP[0]),
            self.target.height_px.div_ceil(WORKGROUP[1]),
            1,
        );
        Ok(())
    }

    /// Pixels, r, g, b, 255 in sRGB, row by row from the top.
    pub fn colour_buffer(&self) -> &wgpu::Buffer {
        &self.target.colour
    }

    /// Width and height of the last [`Raycaster::resize`].
    pub fn size_px(&self) -> [u32; 2] {
        [self.target.width_px, self.target.height_px]
    }

    /// Waits for the device and copies the last picture out.
    pub fn read_back(&self, device: &wgpu::Device, queue: &wgpu::Queue) -> Result<Pixels, GpuError> {
        let read = |source: &wgpu::Buffer| read_words(device, queue, source);
        let colour = read(&self.target.colour)?;
        let distance = read(&self.target.distance)?.into_iter().map(f32::from_bits).collect();
        let hit = read(&self.target.hit)?;
        Ok(Pixels { width_px: self.target.width_px, height_px: self.target.height_px, colour, distance, hit })
    }
}

pub(super) fn read_words(
    device: &wgpu::Device,
    queue: &wgpu::Queue,
    source: &wgpu::Buffer,
) -> Result<Vec<u32>, GpuError> {
    let failed = |e: &dyn std::fmt::Display| GpuError::ReadBack(e.to_string());
    let staging = buffer(device, "read back", source.size(), wgpu::BufferUsages::MAP_READ);
    let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("read back") });
    encoder.copy_buffer_to_buffer(source, 0, &staging, 0, source.size());
    queue.submit([encoder.finish()]);
    let (sender, receiver) = std::sync::mpsc::sync_channel(1);
    staging.slice(..).map_async(wgpu::MapMode::Read, move |result| {
        let _ = sender.send(result);
    });
    device.poll(wgpu::PollType::wait_indefinitely()).map_err(|e| failed(&e))?;
    receiver.recv().map_err(|e| failed(&e))?.map_err(|e| failed(&e))?;
    let view = staging.slice(..).get_mapped_range().map_err(|e| failed(&e))?;
    Ok(view.chunks_exact(4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect())
}

impl Target {
    fn new(
        device: &wgpu::Device,
        layout: &wgpu::BindGroupLayout,
        inputs: &Inputs,
        [width_px, height_px]: [u32; 2],
    ) -> Self {
        let bytes = u64::from(width_px.max(1)) * u64::from(height_px.max(1)) * 4;
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC;
        let colour = buffer(device, "colour", bytes, usage);
        let distance = buffer(device, "distance", bytes, usage);
        let hit = buffer(device, "hit", bytes, usage);
        let entry = |binding, buffer: &wgpu::Buffer| (binding, buffer.clone());
        let entries = [
            entry(binding::FRAME, &inputs.frame),
            entry(binding::TREE, &inputs.tree),
            entry(binding::NODES, &inputs.nodes),
            entry(binding::SUMMARIES, &inputs.summaries),
            entry(binding::ATLAS, &inputs.atlas),
            entry(binding::COLOUR, &colour),
            entry(binding::DISTANCE, &distance),
            entry(binding::HIT, &hit),
        ];
        let entries: Vec<wgpu::BindGroupEntry<'_>> = entries
            .iter()
            .map(|(binding, buffer)| wgpu::BindGroupEntry { binding: *binding, resource: buffer.as_entire_binding() })
            .collect();
        let bind_group =
            device.create_bind_group(&wgpu::BindGroupDescriptor { label: Some("raycast"), layout, entries: &entries });
        Self { width_px, height_px, colour, distance, hit, bind_group }
    }
}
