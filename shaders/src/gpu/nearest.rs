//! Maps of the nearest triangle, rendered on a GPU for the bake's visibility.

use super::{DeviceQueue, GpuError, OpenDevice, buffer, read_words, shader_module, target};
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
        let mut pass = depth_pass(&mut encoder, &numbers, &depths, wgpu::Color::TRANSPARENT);
        pass.set_pipeline(&self.pipeline);
        pass.set_vertex_buffer(0, vertices.slice(..));
        pass.draw(0..corners.len() as u32, 0..1);
        drop(pass);
        read_texels(DeviceQueue { device: &self.device, queue: &self.queue }, encoder, &numbers)
    }
}

fn pipeline(device: &wgpu::Device) -> wgpu::RenderPipeline {
    let module = shader_module(device, "nearest", crate::wgsl::nearest());
    let attributes = wgpu::vertex_attr_array![binding::LOCATION_PLACE => Float32x3, binding::LOCATION_NUMBER => Uint32];
    let corners = wgpu::VertexBufferLayout {
        array_stride: size_of::<NearestVertex>() as u64,
        step_mode: wgpu::VertexStepMode::Vertex,
        attributes: &attributes,
    };
    depth_pipeline(device, &module, ["corner", "number"], corners, NUMBERS, None)
}

/// A pipeline for triangles of which the nearest to the eye stays: depths begin at 0, and are larger there. `entry_points` are those of
/// corners and of pixels.
pub fn depth_pipeline(
    device: &wgpu::Device,
    module: &wgpu::ShaderModule,
    entry_points: [&str; 2],
    corners: wgpu::VertexBufferLayout<'_>,
    format: wgpu::TextureFormat,
    cull_mode: Option<wgpu::Face>,
) -> wgpu::RenderPipeline {
    let [corner, pixel] = entry_points;
    device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some(pixel),
        layout: None,
        vertex: wgpu::VertexState {
            module,
            entry_point: Some(corner),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            buffers: &[Some(corners)],
        },
        primitive: wgpu::PrimitiveState { cull_mode, ..wgpu::PrimitiveState::default() },
        depth_stencil: Some(wgpu::DepthStencilState {
            format: DEPTHS,
            depth_write_enabled: Some(true),
            depth_compare: Some(wgpu::CompareFunction::Greater),
            stencil: wgpu::StencilState::default(),
            bias: wgpu::DepthBiasState::default(),
        }),
        multisample: wgpu::MultisampleState::default(),
        fragment: Some(wgpu::FragmentState {
            module,
            entry_point: Some(pixel),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            targets: &[Some(format.into())],
        }),
        multiview_mask: None,
        cache: None,
    })
}

/// Begins a pass of a [`depth_pipeline`] on a cleared colour, with depths that are dropped at its end.
pub fn depth_pass<'e>(
    encoder: &'e mut wgpu::CommandEncoder,
    colour: &wgpu::Texture,
    depths: &wgpu::Texture,
    clear: wgpu::Color,
) -> wgpu::RenderPass<'e> {
    let [colour, depths] = [colour, depths].map(|t| t.create_view(&wgpu::TextureViewDescriptor::default()));
    encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
        label: Some("nearest"),
        color_attachments: &[Some(wgpu::RenderPassColorAttachment {
            view: &colour,
            depth_slice: None,
            resolve_target: None,
            ops: wgpu::Operations { load: wgpu::LoadOp::Clear(clear), store: wgpu::StoreOp::Store },
        })],
        depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
            view: &depths,
            depth_ops: Some(wgpu::Operations { load: wgpu::LoadOp::Clear(0.0), store: wgpu::StoreOp::Discard }),
            stencil_ops: None,
        }),
        ..wgpu::RenderPassDescriptor::default()
    })
}

/// Submits the commands of `encoder`, and returns the texels of a texture, four bytes each, row by row. Fails if the device was lost.
pub fn read_texels(
    DeviceQueue { device, queue }: DeviceQueue<'_>,
    mut encoder: wgpu::CommandEncoder,
    texture: &wgpu::Texture,
) -> Result<Vec<u32>, GpuError> {
    let (width, height) = (texture.width(), texture.height());
    // Rows of a copy are padded to 256 bytes.
    let row_words = width.next_multiple_of(64);
    let copy = buffer(device, "texels", u64::from(row_words) * u64::from(height) * 4, wgpu::BufferUsages::COPY_SRC);
    let layout =
        wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(row_words * 4), rows_per_image: Some(height) };
    let into = wgpu::TexelCopyBufferInfo { buffer: &copy, layout };
    encoder.copy_texture_to_buffer(texture.as_image_copy(), into, texture.size());
    queue.submit([encoder.finish()]);
    let words = read_words(device, queue, &copy)?;
    Ok(words.chunks_exact(row_words as usize).flat_map(|row| &row[..width as usize]).copied().collect())
}
