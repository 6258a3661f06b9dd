//! The ray-caster on a device: its buffers, its dispatch, its read-back. CPU twin: [`crate::cpu::raycast`].

#[cfg(not(target_arch = "wasm32"))]
use super::read_words;
use super::{DeviceQueue, GpuError, bind_group, buffer};
#[cfg(not(target_arch = "wasm32"))]
use crate::cpu::raycast::{Pixels, RayCounts};
use crate::layout::{DrawNode, FrameUniform, PAGE_WORDS, SUMMARY_WORDS, Shading, WORKGROUP, binding};
use bytemuck::Zeroable;
use std::collections::HashMap;
use wgpu::util::DeviceExt;

/// Capacity of a ray-caster. Fixed when it is created.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Capacity {
    /// Pages of the atlas, 16 KiB each; at most `max_storage_buffer_binding_size / 16 KiB` of the device.
    pub atlas_pages: u32,
    /// Nodes that may be resident.
    pub slots: u32,
    /// Nodes that a frame's draw list may have.
    pub nodes: u32,
}

/// The ray-caster on a device.
#[derive(Debug)]
pub struct Raycaster {
    capacity: Capacity,
    /// The variants that were needed so far.
    pipelines: HashMap<PipelineVariant, wgpu::ComputePipeline>,
    pub(super) bind_group_layout: wgpu::BindGroupLayout,
    pub(super) inputs: InputBuffers,
    output: OutputBuffers,
    /// The frame that the output holds.
    last_frame: FrameUniform,
    /// Makes translucency maps; `None` before the first one.
    pub(super) maps: Option<MapMaker>,
}

/// What makes translucency maps.
#[derive(Debug)]
pub(super) struct MapMaker {
    pub(super) finest: wgpu::ComputePipeline,
    pub(super) coarser: wgpu::ComputePipeline,
}

/// A specialisation of the shader: code that it leaves out costs nothing, even on devices that execute both sides of an
/// `if`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub(super) struct PipelineVariant {
    /// Counts the rays' work, and draws nothing.
    count: bool,
    /// The draw list has meshes.
    meshes: bool,
    /// Shadings other than [`Shading::Lit`].
    for_study: bool,
    /// With lit windows: lavapipe computes them even where they are not added.
    windows: bool,
    /// Objects have colours or are hidden, or the frame shows objects.
    objects: bool,
    /// There are meshes with landmarks.
    landmarks: bool,
    /// There are translucency maps.
    translucent: bool,
    /// Something is added to the city.
    additions: bool,
}

impl PipelineVariant {
    /// For meshes with landmarks.
    pub(super) fn with_landmarks() -> Self {
        Self { meshes: true, landmarks: true, ..Self::default() }
    }
}

#[derive(Debug)]
pub(super) struct InputBuffers {
    frame: wgpu::Buffer,
    grid: wgpu::Buffer,
    nodes: wgpu::Buffer,
    summaries: wgpu::Buffer,
    pub(super) atlas: wgpu::Buffer,
}

#[derive(Debug)]
pub(super) struct OutputBuffers {
    width_px: u32,
    height_px: u32,
    pub(super) colour: wgpu::Buffer,
    /// Only read back.
    distance: wgpu::Buffer,
    pub(super) hit: wgpu::Buffer,
    pub(super) bind_group: wgpu::BindGroup,
}

/// Entries of the grid buffer at first: more than a view of a million buildings needs at full HD.
const INITIAL_GRID_ENTRIES: u32 = 1 << 16;

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
        (binding::ATLAS_VEC4S, read),
    ];
    let entries = kinds.map(|(binding, ty)| wgpu::BindGroupLayoutEntry {
        binding,
        visibility: wgpu::ShaderStages::COMPUTE,
        ty: wgpu::BindingType::Buffer { ty, has_dynamic_offset: false, min_binding_size: None },
        count: None,
    });
    device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: Some("raycast"), entries: &entries })
}

/// The shader module. Without meshes it leaves out naga's counter in every loop, which costs 8% on lavapipe.
fn module(device: &wgpu::Device, meshes: bool) -> wgpu::ShaderModule {
    let checks = wgpu::ShaderRuntimeChecks { force_loop_bounding: meshes, ..wgpu::ShaderRuntimeChecks::checked() };
    let label = Some("raycast");
    let source = wgpu::ShaderSource::Wgsl(crate::wgsl::raycast().into());
    // SAFETY: the only thing that is not checked is that loops end. Without meshes all do, whatever the buffers hold:
    // over squares and over hits after MAX_STEPS, over blocks and cells as each round goes on by a whole one, over a
    // column's six solids and MAX_STRIP_ROWS rows, over levels and planes by their number. (A damaged tree of a mesh's
    // boxes could be a cycle.)
    unsafe { device.create_shader_module_trusted(wgpu::ShaderModuleDescriptor { label, source }, checks) }
}

pub(super) fn pipeline(
    device: &wgpu::Device,
    layout: &wgpu::BindGroupLayout,
    entry_point: &str,
    variant: PipelineVariant,
) -> wgpu::ComputePipeline {
    let module = module(device, variant.meshes);
    let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: Some("raycast"),
        bind_group_layouts: &[Some(layout)],
        immediate_size: 0,
    });
    device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: Some(entry_point),
        layout: Some(&layout),
        module: &module,
        entry_point: Some(entry_point),
        compilation_options: wgpu::PipelineCompilationOptions {
            constants: &[
                ("COUNT", variant.count),
                ("MESHES", variant.meshes),
                ("FOR_STUDY", variant.for_study),
                ("WINDOWS", variant.windows),
                ("OBJECTS", variant.objects),
                ("LANDMARKS", variant.landmarks),
                ("TRANSLUCENT", variant.translucent),
                ("ADDITIONS", variant.additions),
            ]
            .map(|(name, on)| (name, f64::from(u8::from(on)))),
            ..wgpu::PipelineCompilationOptions::default()
        },
        cache: None,
    })
}

impl Raycaster {
    /// Allocates the device memory of `capacity` at once.
    pub fn new(device: &wgpu::Device, capacity: Capacity) -> Self {
        let bind_group_layout = bind_group_layout(device);
        let pipelines = HashMap::from(
            [PipelineVariant::default()].map(|v| (v, pipeline(device, &bind_group_layout, "raycast", v))),
        );
        let storage = wgpu::BufferUsages::STORAGE;
        let sized = |label: &str, count: u32, bytes: usize| {
            buffer(device, label, u64::from(count.max(1)) * bytes as u64, storage)
        };
        let inputs = InputBuffers {
            frame: device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
                label: Some("frame"),
                contents: bytemuck::bytes_of(&FrameUniform::zeroed()),
                usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            }),
            grid: sized("grid", INITIAL_GRID_ENTRIES, size_of::<[u32; 2]>()),
            nodes: sized("nodes", capacity.nodes, size_of::<DrawNode>()),
            summaries: sized("summaries", capacity.slots, SUMMARY_WORDS * 4),
            atlas: sized("atlas", capacity.atlas_pages, PAGE_WORDS * 4),
        };
        let output = OutputBuffers::new(device, &bind_group_layout, &inputs, [1, 1]);
        Self { capacity, pipelines, bind_group_layout, inputs, output, last_frame: FrameUniform::zeroed(), maps: None }
    }

    /// The capacity of the ray-caster.
    pub fn capacity(&self) -> Capacity {
        self.capacity
    }

    /// Writes some words of the atlas. Words beyond the capacity are ignored.
    pub fn write_words(&self, queue: &wgpu::Queue, at: u32, words: &[u32]) {
        let end = u64::from(at) + words.len() as u64;
        if end <= u64::from(self.capacity.atlas_pages) * PAGE_WORDS as u64 {
            queue.write_buffer(&self.inputs.atlas, u64::from(at) * 4, bytemuck::cast_slice(words));
        }
    }

    /// Writes a node's summary. A slot beyond the capacity is ignored.
    pub fn write_summary(&self, queue: &wgpu::Queue, slot: u32, words: &[u32; SUMMARY_WORDS]) {
        if slot < self.capacity.slots {
            let offset = u64::from(slot) * SUMMARY_WORDS as u64 * 4;
            queue.write_buffer(&self.inputs.summaries, offset, bytemuck::cast_slice(words));
        }
    }

    /// Allocates the pixels of frames of this size.
    pub fn resize(&mut self, device: &wgpu::Device, size_px: [u32; 2]) {
        if self.size_px() != size_px {
            self.output = OutputBuffers::new(device, &self.bind_group_layout, &self.inputs, size_px);
        }
    }

    /// Records the pass of a frame whose size is that of the last [`Raycaster::resize`]. Fails if there are more nodes
    /// than the capacity allows.
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
        let for_study = frame.shading != Shading::Lit as u32;
        let windows = frame.light.window[3] > 0.0;
        self.dispatch(
            on.device,
            encoder,
            PipelineVariant {
                count: false,
                meshes,
                for_study,
                windows,
                objects: frame.objects != 0,
                landmarks: meshes && frame.landmarks != 0,
                translucent: meshes && frame.translucent != 0,
                additions: meshes && frame.additions[1] != 0,
            },
        );
        self.last_frame = *frame;
        Ok(())
    }

    /// Work of the rays of such a frame, one per pixel. Draws nothing, and waits for the device. Fails if there are
    /// more nodes than the capacity allows, or if the counts cannot be read back.
    #[cfg(not(target_arch = "wasm32"))]
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
        self.dispatch(
            device,
            &mut encoder,
            PipelineVariant { count: true, meshes: true, for_study: true, ..PipelineVariant::default() },
        );
        queue.submit([encoder.finish()]);
        // Not a lit frame: the words are counts.
        self.last_frame = FrameUniform { shading: Shading::Albedo as u32, ..*frame };
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

    fn dispatch(&mut self, device: &wgpu::Device, encoder: &mut wgpu::CommandEncoder, variant: PipelineVariant) {
        let (layout, output) = (&self.bind_group_layout, &self.output);
        let mut pass =
            encoder.begin_compute_pass(&wgpu::ComputePassDescriptor { label: Some("raycast"), timestamp_writes: None });
        pass.set_pipeline(
            self.pipelines.entry(variant).or_insert_with(|| pipeline(device, layout, "raycast", variant)),
        );
        pass.set_bind_group(0, &output.bind_group, &[]);
        pass.dispatch_workgroups(output.width_px.div_ceil(WORKGROUP[0]), output.height_px.div_ceil(WORKGROUP[1]), 1);
    }

    pub(super) fn upload(
        &mut self,
        on: DeviceQueue<'_>,
        frame: &FrameUniform,
        grid: &[[u32; 2]],
        nodes: &[DrawNode],
    ) -> Result<(), GpuError> {
        let DeviceQueue { device, queue } = on;
        let (found, limit) = (nodes.len(), self.capacity.nodes);
        if found > limit as usize {
            return Err(GpuError::TooManyNodes { found, limit });
        }
        let bytes = size_of_val(grid) as u64;
        if bytes > self.inputs.grid.size() {
            self.inputs.grid = buffer(device, "grid", bytes.next_power_of_two(), wgpu::BufferUsages::STORAGE);
            self.output = OutputBuffers::new(device, &self.bind_group_layout, &self.inputs, self.size_px());
        }
        queue.write_buffer(&self.inputs.frame, 0, bytemuck::bytes_of(frame));
        queue.write_buffer(&self.inputs.grid, 0, bytemuck::cast_slice(grid));
        queue.write_buffer(&self.inputs.nodes, 0, bytemuck::cast_slice(nodes));
        Ok(())
    }

    /// The frame of the last [`Raycaster::render`].
    pub fn last_frame(&self) -> &FrameUniform {
        &self.last_frame
    }

    /// Radiances of the pixels ([`crate::tone::encode_radiance`]), of frames that are not lit r, g, b, 255 in sRGB, row by row
    /// from the top.
    pub fn colour_buffer(&self) -> &wgpu::Buffer {
        &self.output.colour
    }

    /// Node that each pixel hit, row by row from the top.
    pub fn hit_buffer(&self) -> &wgpu::Buffer {
        &self.output.hit
    }

    /// Metres along each pixel's ray, infinity where no node was hit, row by row from the top.
    pub fn distance_buffer(&self) -> &wgpu::Buffer {
        &self.output.distance
    }

    /// Width and height of the last [`Raycaster::resize`].
    pub fn size_px(&self) -> [u32; 2] {
        [self.output.width_px, self.output.height_px]
    }

    /// Waits for the device and copies the last frame. Fails if the device was lost.
    #[cfg(not(target_arch = "wasm32"))]
    pub fn read_back(&self, device: &wgpu::Device, queue: &wgpu::Queue) -> Result<Pixels, GpuError> {
        let read = |source: &wgpu::Buffer| read_words(device, queue, source);
        let OutputBuffers { width_px, height_px, .. } = self.output;
        let words = read(&self.output.colour)?;
        let distance = read(&self.output.distance)?.into_iter().map(f32::from_bits).collect();
        let hit = read(&self.output.hit)?;
        let mut pixels = Pixels { width_px, height_px, distance, hit, ..Pixels::default() };
        pixels.set_words(&self.last_frame, words);
        Ok(pixels)
    }
}

impl OutputBuffers {
    pub(super) fn new(
        device: &wgpu::Device,
        layout: &wgpu::BindGroupLayout,
        inputs: &InputBuffers,
        [width_px, height_px]: [u32; 2],
    ) -> Self {
        let bytes = u64::from(width_px.max(1)) * u64::from(height_px.max(1)) * 4;
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC;
        let colour = buffer(device, "colour", bytes, usage);
        let distance = buffer(device, "distance", bytes, usage);
        let hit = buffer(device, "hit", bytes, usage);
        let buffers = [
            (binding::FRAME, &inputs.frame),
            (binding::GRID, &inputs.grid),
            (binding::NODES, &inputs.nodes),
            (binding::SUMMARIES, &inputs.summaries),
            (binding::ATLAS, &inputs.atlas),
            (binding::COLOUR, &colour),
            (binding::DISTANCE, &distance),
            (binding::HIT, &hit),
            (binding::ATLAS_VEC4S, &inputs.atlas),
        ];
        let bind_group = bind_group(device, "raycast", layout, &buffers);
        Self { width_px, height_px, colour, distance, hit, bind_group }
    }
}
