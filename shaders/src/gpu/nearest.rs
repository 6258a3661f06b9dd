//! Maps of the nearest triangle, rendered on a GPU for the bake's visibility.

use super::{GpuError, OpenDevice, buffer, read_words, shader_module, target};
use crate::layout::binding;
use bytemuck::{Pod, Zeroable};
use wgpu::util::DeviceExt;

const NUMBERS: wgpu::TextureFormat = wgpu::TextureFormat::R32Uint;
const DEPTHS: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;

/// A triangle's corner, as the shader reads it.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct NearestVertex {
    /// Texels from the map's corner along its rows and across them; then its nearness, from 0 (far) to 1.
    pub place: [f32; 3],
    /// Value of the map where the triangle is nearest. Not 0, which means no triangle.
    pub number: u32,
}

/// A device that renders maps.
#[derive(Debug)]
pub struct Nearest {
    device: wgpu::Device,
    queue: wgpu::Queue,
    pipeline: wgpu::RenderPipeline,
    name: String,
}

impl Nearest {
    /// Opens the first device that the environment allows. Fails if none works.
    pub fn open() -> Result<Self, GpuError> {
        let OpenDevice { device, queue, name } = OpenDevice::open("nearest", wgpu::Features::empty())?;
        let pipeline = pipeline(&device);
        Ok(Self { device, queue, pipeline, name })
    }

    /// Name of the adapter and its backend.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Draws triangles, three corners each. Of two that are equally near, the first wins. Returns `size[0] * size[1]`
    /// numbers, row by row. Fails if the map is larger than the device's textures, or cannot be read back.
    pub fn draw(&self, corners: &[NearestVertex], size: [u32; 2]) -> Result<Vec<u32>, GpuError> {
        let limit = self.device.limits().max_texture_dimension_2d;
        if let Some(found) = size.into_iter().find(|side| *side == 0 || *side > limit) {
            return Err(GpuError::MapSize { found, limit });
        }
        let clip = |corner: &NearestVertex| NearestVertex {
            place: [
                corner.place[0] * 2.0 / size[0] as f32 - 1.0,
                1.0 - corner.place[1] * 2.0 / size[1] as f32,
                corner.place[2],
            ],
            ..*corner
        };
        let corners: Vec<NearestVertex> = corners.iter().map(clip).collect();
        let vertices = self.device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
            label: Some("corners"),
            contents: bytemuck::cast_slice(&corners),
            usage: wgpu::BufferUsages::VERTEX,
        });
        let numbers = target(&self.device, NUMBERS, size, wgpu::TextureUsages::COPY_SRC);
        let depths = target(&self.device, DEPTHS, size, wgpu::TextureUsages::empty());
        let mut encoder =
            self.device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("nearest") });
        self.encode(&mut encoder, &vertices, &numbers, &depths, corners.len() as u32);
        // Rows of a copy are padded to 256 bytes.
        let row_words = size[0].next_multiple_of(64);
        let bytes = u64::from(row_words) * u64::from(size[1]) * 4;
        let copy = buffer(&self.device, "numbers", bytes, wgpu::BufferUsages::COPY_SRC);
        let layout = wgpu::TexelCopyBufferLayout {
            offset: 0,
            bytes_per_row: Some(row_words * 4),
            rows_per_image: Some(size[1]),
        };
        encoder.copy_texture_to_buffer(
            numbers.as_image_copy(),
            wgpu::TexelCopyBufferInfo { buffer: &copy, layout },
            numbers.size(),
        );
        self.queue.submit([encoder.finish()]);
        let words = read_words(&self.device, &self.queue, &copy)?;
        Ok(words.chunks_exact(row_words as usize).flat_map(|row| &row[..size[0] as usize]).copied().collect())
    }

    fn encode(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        vertices: &wgpu::Buffer,
        numbers: &wgpu::Texture,
        depths: &wgpu::Texture,
        corners: u32,
    ) {
        let [numbers, depths] = [numbers, depths].map(|t| t.create_view(&wgpu::TextureViewDescriptor::default()));
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("nearest"),
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: &numbers,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations {
                    load: wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT),
                    store: wgpu::StoreOp::Store,
                },
            })],
            depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                view: &depths,
                depth_ops: Some(wgpu::Operations { load: wgpu::LoadOp::Clear(0.0), store: wgpu::StoreOp::Discard }),
                stencil_ops: None,
            }),
            ..wgpu::RenderPassDescriptor::default()
        });
        pass.set_pipeline(&self.pipeline);
        pass.set_vertex_buffer(0, vertices.slice(..));
        pass.draw(0..corners, 0..1);
    }
}

fn pipeline(device: &wgpu::Device) -> wgpu::RenderPipeline {
    let module = shader_module(device, "nearest", crate::wgsl::nearest());
    let attributes = wgpu::vertex_attr_array![binding::LOCATION_PLACE => Float32x3, binding::LOCATION_NUMBER => Uint32];
    device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some("nearest"),
        layout: None,
        vertex: wgpu::VertexState {
            module: &module,
            entry_point: Some("corner"),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            buffers: &[Some(wgpu::VertexBufferLayout {
                array_stride: size_of::<NearestVertex>() as u64,
                step_mode: wgpu::VertexStepMode::Vertex,
                attributes: &attributes,
            })],
        },
        primitive: wgpu::PrimitiveState::default(),
        depth_stencil: Some(wgpu::DepthStencilState {
            format: DEPTHS,
            depth_write_enabled: Some(true),
            depth_compare: Some(wgpu::CompareFunction::Greater),
            stencil: wgpu::StencilState::default(),
            bias: wgpu::DepthBiasState::default(),
        }),
        multisample: wgpu::MultisampleState::default(),
        fragment: Some(wgpu::FragmentState {
            module: &module,
            entry_point: Some("number"),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            targets: &[Some(NUMBERS.into())],
        }),
        multiview_mask: None,
        cache: None,
    })
}
