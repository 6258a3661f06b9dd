//! `raycast.wgsl` on a device: its buffers, its dispatch, its read-back.
//!
//! In: pages, summaries, the cut. Out: pixels in device memory. Next: `compose`, or [`Raycaster::read_back`].

use super::DeviceQueue;
use crate::{
    cpu::raycast::{Pixels, RayCounts},
    layout::{DrawNode, FrameUniform, PAGE_WORDS, SUMMARY_WORDS, Shading, WORKGROUP, binding},
};
use bytemuck::Zeroable;
use std::collections::HashMap;
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
        /// Of what there is too much.
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
    /// The builds of the shader that were needed so far.
    pipelines: HashMap<Build, wgpu::ComputePipeline>,
    bind_group_layout: wgpu::BindGroupLayout,
    inputs: Inputs,
    target: Target,
}

/// A build of the shader: what it need not do costs nothing, even on devices that execute both sides of an `if`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
struct Build {
    /// RayCounts what rays do, and draws nothing.
    count: bool,
    /// Knows of meshes.
    meshes: bool,
    /// Knows of shadings other than [`Shading::Lit`].
    for_study: bool,
}

#[derive(Debug)]
struct Inputs {
    frame: wgpu::Buffer,
    grid: wgpu::Buffer,
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

/// Entries of the grid at first: more than a view of a million buildings needs at full HD.
const GRID_ENTRIES: u32 = 1 << 16;

/// Of all builds of the shader.
fn bind_group_layout(device: &wgpu::Device) -> wgpu::BindGroupLayout {
    let read = wgpu::BufferBindingType::Storage { read_only: true };
    let write = wgpu::BufferBindingType::Storage { read_only: false };
    let kinds = [
        (binding::FRAME, wgpu::BufferBindingType::Uniform),
        (binding::GRID, read),
        (binding::NODES, read),
        (binding::SUMMARIES, read),
        (binding::ATLAS, read),
        (binding::COLOUR, write),
        (binding::DISTANCE, write),
        (binding::HIT, write),
        (binding::FOURS, read),
    ];
    let entries = kinds.map(|(binding, ty)| wgpu::BindGroupLayoutEntry {
        binding,
        visibility: wgpu::ShaderStages::COMPUTE,
        ty: wgpu::BindingType::Buffer { ty, has_dynamic_offset: false, min_binding_size: None },
        count: None,
    });
    device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: Some("raycast"), entries: &entries })
}

/// Without naga's counters in every loop, which cost 8% on lavapipe, where no mesh can be in the way.
fn module(device: &wgpu::Device, meshes: bool) -> wgpu::ShaderModule {
    let checks = wgpu::ShaderRuntimeChecks { force_loop_bounding: meshes, ..wgpu::ShaderRuntimeChecks::checked() };
    let label = Some("raycast");
    let source = wgpu::ShaderSource::Wgsl(crate::RAYCAST_WGSL.into());
    // SAFETY: all that is not checked is that loops end, and without meshes all do, whatever the buffers hold: over squares after
    // MAX_STEPS, over blocks and cells after one step of a whole number each, over hits after MAX_STEPS, over a column's
    // six solids and 256 rows, over levels and planes by their count. (A damaged tree of a mesh's boxes could lead around.)
    unsafe { device.create_shader_module_trusted(wgpu::ShaderModuleDescriptor { label, source }, checks) }
}

fn pipeline(device: &wgpu::Device, layout: &wgpu::BindGroupLayout, build: Build) -> wgpu::ComputePipeline {
    let module = module(device, build.meshes);
    let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: Some("raycast"),
        bind_group_layouts: &[Some(layout)],
        immediate_size: 0,
    });
    device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: Some("raycast"),
        layout: Some(&layout),
        module: &module,
        entry_point: Some("raycast"),
        compilation_options: wgpu::PipelineCompilationOptions {
            constants: &[("COUNT", build.count), ("MESHES", build.meshes), ("FOR_STUDY", build.for_study)]
                .map(|(name, on)| (name, f64::from(u8::from(on)))),
            ..wgpu::PipelineCompilationOptions::default()
        },
        cache: None,
    })
}

fn buffer(device: &wgpu::Device, label: &str, bytes: u64, usage: wgpu::BufferUsages) -> wgpu::Buffer {
    let usage = usage | wgpu::BufferUsages::COPY_DST;
    device.create_buffer(&wgpu::BufferDescriptor { label: Some(label), size: bytes, usage, mapped_at_creation: false })
}

impl Raycaster {
    /// Takes the memory of `capacity` on the device at once: what fits then fits for good.
    pub fn new(device: &wgpu::Device, capacity: Capacity) -> Self {
        let bind_group_layout = bind_group_layout(device);
        let pipelines =
            HashMap::from([Build::default()].map(|build| (build, pipeline(device, &bind_group_layout, build))));
        let storage = wgpu::BufferUsages::STORAGE;
        let sized = |label: &str, count: u32, bytes: usize| {
            buffer(device, label, u64::from(count.max(1)) * bytes as u64, storage)
        };
        let inputs = Inputs {
            frame: device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
                label: Some("frame"),
                contents: bytemuck::bytes_of(&FrameUniform::zeroed()),
                usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            }),
            grid: sized("grid", GRID_ENTRIES, size_of::<[u32; 2]>()),
            nodes: sized("nodes", capacity.nodes, size_of::<DrawNode>()),
            summaries: sized("summaries", capacity.slots, SUMMARY_WORDS * 4),
            atlas: sized("atlas", capacity.atlas_pages, PAGE_WORDS * 4),
        };
        let target = Target::new(device, &bind_group_layout, &inputs, [1, 1]);
        Self { capacity, pipelines, bind_group_layout, inputs, target }
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
        &mut self,
        on: DeviceQueue<'_>,
        encoder: &mut wgpu::CommandEncoder,
        frame: &FrameUniform,
        grid: &[[u32; 2]],
        nodes: &[DrawNode],
    ) -> Result<(), GpuError> {
        self.upload(on, frame, grid, nodes)?;
        let meshes = nodes.iter().any(|node| node.mesh != 0);
        self.dispatch(
            on.device,
            encoder,
            Build { count: false, meshes, for_study: frame.shading != Shading::Lit as u32 },
        );
        Ok(())
    }

    /// What the rays of such a picture do, one a pixel: a build of the shader that draws nothing. Waits for the device.
    pub fn count(
        &mut self,
        on: DeviceQueue<'_>,
        frame: &FrameUniform,
        grid: &[[u32; 2]],
        nodes: &[DrawNode],
    ) -> Result<RayCounts, GpuError> {
        let DeviceQueue { device, queue } = on;
        self.upload(on, &FrameUniform { samples: 1, ..*frame }, grid, nodes)?;
        let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("count") });
        self.dispatch(device, &mut encoder, Build { count: true, meshes: true, for_study: true });
        queue.submit([encoder.finish()]);
        let pixels = self.read_back(device, queue)?;
        let mut counts = RayCounts { rays: pixels.colour.len() as u64, ..RayCounts::default() };
        for i in 0..pixels.colour.len() {
            counts.nodes += u64::from(pixels.colour[i] & 0xffff);
            counts.steps += u64::from(pixels.colour[i] >> 16);
            counts.fetches += pixels.distance[i] as u64;
            counts.cells += u64::from(pixels.hit[i]);
        }
        Ok(counts)
    }

    fn dispatch(&mut self, device: &wgpu::Device, encoder: &mut wgpu::CommandEncoder, build: Build) {
        let (layout, target) = (&self.bind_group_layout, &self.target);
        let mut pass =
            encoder.begin_compute_pass(&wgpu::ComputePassDescriptor { label: Some("raycast"), timestamp_writes: None });
        pass.set_pipeline(self.pipelines.entry(build).or_insert_with(|| pipeline(device, layout, build)));
        pass.set_bind_group(0, &target.bind_group, &[]);
        pass.dispatch_workgroups(target.width_px.div_ceil(WORKGROUP[0]), target.height_px.div_ceil(WORKGROUP[1]), 1);
    }

    fn upload(
        &mut self,
        on: DeviceQueue<'_>,
        frame: &FrameUniform,
        grid: &[[u32; 2]],
        nodes: &[DrawNode],
    ) -> Result<(), GpuError> {
        let DeviceQueue { device, queue } = on;
        let (found, limit) = (nodes.len(), self.capacity.nodes);
        if found > limit as usize {
            return Err(GpuError::Capacity { what: "nodes", found, limit });
        }
        let bytes = size_of_val(grid) as u64;
        if bytes > self.inputs.grid.size() {
            self.inputs.grid = buffer(device, "grid", bytes.next_power_of_two(), wgpu::BufferUsages::STORAGE);
            let size_px = [self.target.width_px, self.target.height_px];
            self.target = Target::new(device, &self.bind_group_layout, &self.inputs, size_px);
        }
        queue.write_buffer(&self.inputs.frame, 0, bytemuck::bytes_of(frame));
        queue.write_buffer(&self.inputs.grid, 0, bytemuck::cast_slice(grid));
        queue.write_buffer(&self.inputs.nodes, 0, bytemuck::cast_slice(nodes));
        Ok(())
    }

    /// Pixels, r, g, b, 255 in sRGB, row by row from the top.
    pub fn colour_buffer(&self) -> &wgpu::Buffer {
        &self.target.colour
    }

    /// Which node each pixel hit, row by row from the top.
    pub fn hit_buffer(&self) -> &wgpu::Buffer {
        &self.target.hit
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
            entry(binding::GRID, &inputs.grid),
            entry(binding::NODES, &inputs.nodes),
            entry(binding::SUMMARIES, &inputs.summaries),
            entry(binding::ATLAS, &inputs.atlas),
            entry(binding::COLOUR, &colour),
            entry(binding::DISTANCE, &distance),
            entry(binding::HIT, &hit),
            entry(binding::FOURS, &inputs.atlas),
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
