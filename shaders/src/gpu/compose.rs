//! Draws the ray-caster's pixels on a render target.

use super::{Raycaster, shader_module};
use crate::layout::binding;
use wgpu::util::DeviceExt;

/// The pass that shows a ray-cast frame.
#[derive(Debug)]
pub struct Compose {
    pipeline: wgpu::RenderPipeline,
    size: wgpu::Buffer,
}

impl Compose {
    /// Makes the pass for targets of `format`: sRGB formats get linear values, others sRGB ones.
    pub fn new(device: &wgpu::Device, format: wgpu::TextureFormat) -> Self {
        let module = shader_module(device, "compose", crate::wgsl::compose());
        let entry = if format.is_srgb() { "compose_linear" } else { "compose_srgb" };
        let pipeline = device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some("compose"),
            layout: None,
            vertex: wgpu::VertexState {
                module: &module,
                entry_point: Some("corner"),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                buffers: &[],
            },
            primitive: wgpu::PrimitiveState::default(),
            depth_stencil: None,
            multisample: wgpu::MultisampleState::default(),
            fragment: Some(wgpu::FragmentState {
                module: &module,
                entry_point: Some(entry),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                targets: &[Some(format.into())],
            }),
            multiview_mask: None,
            cache: None,
        });
        let size = device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
            label: Some("compose size"),
            contents: &[0; 16],
            usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
        });
        Self { pipeline, size }
    }

    /// Draws the last frame of `raycaster` over the whole target, scaled to the nearest pixel.
    pub fn draw(
        &self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        pass: &mut wgpu::RenderPass<'_>,
        raycaster: &Raycaster,
        target_px: [u32; 2],
    ) {
        let [width, height] = raycaster.size_px();
        queue.write_buffer(&self.size, 0, bytemuck::cast_slice(&[width, height, target_px[0], target_px[1]]));
        let bind_group = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("compose"),
            layout: &self.pipeline.get_bind_group_layout(0),
            entries: &[
                wgpu::BindGroupEntry { binding: binding::COMPOSE_SIZE, resource: self.size.as_entire_binding() },
                wgpu::BindGroupEntry {
                    binding: binding::COMPOSE_COLOUR,
                    resource: raycaster.colour_buffer().as_entire_binding(),
                },
            ],
        });
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &bind_group, &[]);
        pass.draw(0..3, 0..1);
    }
}
