//! Depth maps of a mesh, and the test of its vertices, which stay on the device until all directions are summed.

use super::{GpuError, OpenDevice, bind_group, buffer, compute_pipeline, read_words, shader_module, target};
use crate::layout::{OCCLUSION_THREADS, OcclusionUniform, binding};
use wgpu::util::DeviceExt;

const DEPTHS: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;
/// Most workgroups along an axis, on any device.
const MAX_GROUPS: u32 = 65_535;

/// What maps are drawn of.
#[derive(Debug, Clone, Copy)]
pub struct OcclusionScene<'a> {
    /// Vertices of the mesh, then of its surroundings.
    pub places: &'a [[i32; 3]],
    pub triangles: &'a [[u32; 3]],
    /// Normals of the mesh's vertices.
    pub normals: &'a [[i32; 3]],
    /// Side of a map in texels.
    pub size_px: u32,
    /// Words of a vertex's sum: 2, or 5 with a bent normal.
    pub sum_words: u32,
}

/// A mesh on a device, with its sums.
#[derive(Debug)]
pub struct OcclusionMaps {
    on: OpenDevice,
    near: wgpu::RenderPipeline,
    far: wgpu::RenderPipeline,
    test: wgpu::ComputePipeline,
    views: [wgpu::TextureView; 2],
    uniform: wgpu::Buffer,
    places: wgpu::Buffer,
    indices: wgpu::Buffer,
    normals: wgpu::Buffer,
    sums: wgpu::Buffer,
    corners: u32,
    vertices: u32,
}

impl OcclusionMaps {
    /// Opens the first device that the environment allows, and uploads a scene of at least one vertex and triangle. Fails
    /// without a device, or if it is too small for the scene.
    pub fn open(scene: OcclusionScene<'_>) -> Result<Self, GpuError> {
        let on = OpenDevice::open("occlusion", wgpu::Features::DEPTH_CLIP_CONTROL)?;
        check(&on.device, scene)?;
        let scopes =
            [wgpu::ErrorFilter::OutOfMemory, wgpu::ErrorFilter::Validation].map(|f| on.device.push_error_scope(f));
        let maps = Self::upload(on, scene);
        for scope in scopes.into_iter().rev() {
            if let Some(error) = pollster::block_on(scope.pop()) {
                return Err(GpuError::Refused(error.to_string()));
            }
        }
        Ok(maps)
    }

    fn upload(on: OpenDevice, scene: OcclusionScene<'_>) -> Self {
        use wgpu::BufferUsages as Usage;
        let device = &on.device;
        let filled = |label: &str, contents: &[u8], usage: Usage| {
            device.create_buffer_init(&wgpu::util::BufferInitDescriptor { label: Some(label), contents, usage })
        };
        let vertices = scene.normals.len() as u32;
        let sum_bytes = u64::from(vertices) * u64::from(scene.sum_words) * 4;
        let map = |_| {
            let texture = target(device, DEPTHS, [scene.size_px; 2], wgpu::TextureUsages::TEXTURE_BINDING);
            texture.create_view(&wgpu::TextureViewDescriptor::default())
        };
        let module = shader_module(device, "occlusion", crate::wgsl::occlusion());
        Self {
            near: depth_pipeline(device, &module, wgpu::CompareFunction::Greater),
            far: depth_pipeline(device, &module, wgpu::CompareFunction::Less),
            test: compute_pipeline(device, &module, "accumulate"),
            views: [(); 2].map(map),
            uniform: buffer(device, "view", size_of::<OcclusionUniform>() as u64, Usage::UNIFORM),
            places: filled("places", bytemuck::cast_slice(scene.places), Usage::VERTEX | Usage::STORAGE),
            indices: filled("triangles", bytemuck::cast_slice(scene.triangles), Usage::INDEX),
            normals: filled("normals", bytemuck::cast_slice(scene.normals), Usage::STORAGE),
            // Devices fill new buffers with zeros.
            sums: buffer(device, "sums", sum_bytes, Usage::STORAGE | Usage::COPY_SRC),
            corners: scene.triangles.len() as u32 * 3,
            vertices,
            on,
        }
    }

    /// Name of the adapter and its backend.
    pub fn name(&self) -> &str {
        &self.on.name
    }

    /// Submits the maps and tests of a pair of directions.
    pub fn add(&self, view: &OcclusionUniform) {
        let device = &self.on.device;
        self.on.queue.write_buffer(&self.uniform, 0, bytemuck::bytes_of(view));
        let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("occlusion") });
        let [near, far] = &self.views;
        self.draw(&mut encoder, &self.near, near, 0.0);
        self.draw(&mut encoder, &self.far, far, 1.0);
        let bind_group = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("occlusion"),
            layout: &self.test.get_bind_group_layout(0),
            entries: &[
                entry(binding::OCCLUSION_VIEW, &self.uniform),
                entry(binding::OCCLUSION_PLACES, &self.places),
                entry(binding::OCCLUSION_NORMALS, &self.normals),
                map_entry(binding::OCCLUSION_NEAR, near),
                map_entry(binding::OCCLUSION_FAR, far),
                entry(binding::OCCLUSION_SUMS, &self.sums),
            ],
        });
        let descriptor = wgpu::ComputePassDescriptor { label: Some("occlusion"), timestamp_writes: None };
        let mut pass = encoder.begin_compute_pass(&descriptor);
        pass.set_pipeline(&self.test);
        pass.set_bind_group(0, &bind_group, &[]);
        let groups = self.vertices.div_ceil(OCCLUSION_THREADS);
        let across = groups.clamp(1, MAX_GROUPS);
        pass.dispatch_workgroups(across, groups.div_ceil(across), 1);
        drop(pass);
        self.on.queue.submit([encoder.finish()]);
    }

    /// Draws all triangles into a map.
    fn draw(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        pipeline: &wgpu::RenderPipeline,
        view: &wgpu::TextureView,
        empty: f32,
    ) {
        let uniform = [(binding::OCCLUSION_VIEW, &self.uniform)];
        let bind_group = bind_group(&self.on.device, "depths", &pipeline.get_bind_group_layout(0), &uniform);
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("depths"),
            depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                view,
                depth_ops: Some(wgpu::Operations { load: wgpu::LoadOp::Clear(empty), store: wgpu::StoreOp::Store }),
                stencil_ops: None,
            }),
            ..wgpu::RenderPassDescriptor::default()
        });
        pass.set_pipeline(pipeline);
        pass.set_bind_group(0, &bind_group, &[]);
        pass.set_vertex_buffer(0, self.places.slice(..));
        pass.set_index_buffer(self.indices.slice(..), wgpu::IndexFormat::Uint32);
        pass.draw_indexed(0..self.corners, 0, 0..1);
    }

    /// Waits until all pairs are summed. Fails if the device was lost.
    pub fn wait(&self) -> Result<(), GpuError> {
        let waited = self.on.device.poll(wgpu::PollType::wait_indefinitely());
        waited.map(drop).map_err(|error| GpuError::ReadBack(error.to_string()))
    }

    /// The sums, vertex by vertex. Fails if the device was lost.
    pub fn read(&self) -> Result<Vec<u32>, GpuError> {
        read_words(&self.on.device, &self.on.queue, &self.sums)
    }
}

fn entry(binding: u32, buffer: &wgpu::Buffer) -> wgpu::BindGroupEntry<'_> {
    wgpu::BindGroupEntry { binding, resource: buffer.as_entire_binding() }
}

fn map_entry(binding: u32, view: &wgpu::TextureView) -> wgpu::BindGroupEntry<'_> {
    wgpu::BindGroupEntry { binding, resource: wgpu::BindingResource::TextureView(view) }
}

/// Fails if a device is too small for a scene, or lacks what its surroundings need.
fn check(device: &wgpu::Device, scene: OcclusionScene<'_>) -> Result<(), GpuError> {
    let limits = device.limits();
    let limit = limits.max_texture_dimension_2d;
    if scene.size_px == 0 || scene.size_px > limit {
        return Err(GpuError::MapSize { found: scene.size_px, limit });
    }
    let sums = scene.normals.len() as u64 * u64::from(scene.sum_words) * 4;
    let storage = sums.max(size_of_val(scene.places) as u64);
    let storage_limit = limits.max_storage_buffer_binding_size.min(limits.max_buffer_size);
    let indices = size_of_val(scene.triangles) as u64;
    for (found, limit) in [(storage, storage_limit), (indices, limits.max_buffer_size)] {
        if found > limit {
            return Err(GpuError::BufferSize { found, limit });
        }
    }
    let has_surroundings = scene.places.len() > scene.normals.len();
    if has_surroundings && !device.features().contains(wgpu::Features::DEPTH_CLIP_CONTROL) {
        return Err(GpuError::NoDepthClamp);
    }
    Ok(())
}

/// Depths only. What lies before or behind the range of depths gets its ends, so that it hides what it should.
fn depth_pipeline(
    device: &wgpu::Device,
    module: &wgpu::ShaderModule,
    compare: wgpu::CompareFunction,
) -> wgpu::RenderPipeline {
    let attributes = wgpu::vertex_attr_array![binding::LOCATION_PLACE => Sint32x3];
    device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some("depths"),
        layout: None,
        vertex: wgpu::VertexState {
            module,
            entry_point: Some("occluder"),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            buffers: &[Some(wgpu::VertexBufferLayout {
                array_stride: size_of::<[i32; 3]>() as u64,
                step_mode: wgpu::VertexStepMode::Vertex,
                attributes: &attributes,
            })],
        },
        primitive: wgpu::PrimitiveState {
            unclipped_depth: device.features().contains(wgpu::Features::DEPTH_CLIP_CONTROL),
            ..wgpu::PrimitiveState::default()
        },
        depth_stencil: Some(wgpu::DepthStencilState {
            format: DEPTHS,
            depth_write_enabled: Some(true),
            depth_compare: Some(compare),
            stencil: wgpu::StencilState::default(),
            bias: wgpu::DepthBiasState::default(),
        }),
        multisample: wgpu::MultisampleState::default(),
        fragment: None,
        multiview_mask: None,
        cache: None,
    })
}
