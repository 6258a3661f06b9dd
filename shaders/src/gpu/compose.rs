//! Draws the ray-caster's pixels on a render target.

use super::{DeviceQueue, Raycaster, buffer, shader_module};
use crate::layout::{ComposeUniform, Shading, binding};
use bytemuck::Zeroable;
use wgpu::util::DeviceExt;

/// The pass that shows a ray-cast frame.
#[derive(Debug)]
pub struct Compose {
    pipeline: wgpu::RenderPipeline,
    meter: wgpu::ComputePipeline,
    settings: wgpu::Buffer,
    exposure: wgpu::Buffer,
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
        let meter = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some("meter"),
            layout: None,
            module: &shader_module(device, "meter", crate::wgsl::meter()),
            entry_point: Some("meter"),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            cache: None,
        });
        let settings = device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
            label: Some("compose settings"),
            contents: bytemuck::bytes_of(&ComposeUniform::zeroed()),
            usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
        });
        let exposure = buffer(device, "exposure", 4, wgpu::BufferUsages::STORAGE);
        Self { pipeline, meter, settings, exposure }
    }

    /// Records the measurement of the exposure of `raycaster`'s last frame, which is to be drawn on a target of a size.
    pub fn measure(
        &self,
        DeviceQueue { device, queue }: DeviceQueue<'_>,
        encoder: &mut wgpu::CommandEncoder,
        raycaster: &Raycaster,
        target_px: [u32; 2],
    ) {
        let frame = raycaster.last_frame();
        let settings = ComposeUniform {
            frame_px: raycaster.size_px(),
            target_px,
            is_lit: u32::from(frame.shading == Shading::Lit as u32),
            exposure: frame.exposure,
            key: frame.light.key,
            day: frame.light.plane[3],
            grade: frame.light.grade,
        };
        queue.write_buffer(&self.settings, 0, bytemuck::bytes_of(&settings));
        let hits = (binding::COMPOSE_HIT, raycaster.hit_buffer());
        let bind_group = self.bind_group(device, &self.meter.get_bind_group_layout(0), raycaster, Some(hits));
        let mut pass =
            encoder.begin_compute_pass(&wgpu::ComputePassDescriptor { label: Some("meter"), timestamp_writes: None });
        pass.set_pipeline(&self.meter);
        pass.set_bind_group(0, &bind_group, &[]);
        pass.dispatch_workgroups(1, 1, 1);
    }

    /// Draws the last frame of `raycaster` over the whole target, scaled to the nearest pixel, with the exposure of the last
    /// [`Compose::measure`].
    pub fn draw(&self, device: &wgpu::Device, pass: &mut wgpu::RenderPass<'_>, raycaster: &Raycaster) {
        let bind_group = self.bind_group(device, &self.pipeline.get_bind_group_layout(0), raycaster, None);
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &bind_group, &[]);
        pass.draw(0..3, 0..1);
    }

    fn bind_group(
        &self,
        device: &wgpu::Device,
        layout: &wgpu::BindGroupLayout,
        raycaster: &Raycaster,
        more: Option<(u32, &wgpu::Buffer)>,
    ) -> wgpu::BindGroup {
        let entries = [
            (binding::COMPOSE_SETTINGS, &self.settings),
            (binding::COMPOSE_COLOUR, raycaster.colour_buffer()),
            (binding::COMPOSE_EXPOSURE, &self.exposure),
        ];
        let entries: Vec<wgpu::BindGroupEntry<'_>> = entries
            .into_iter()
            .chain(more)
            .map(|(binding, buffer)| wgpu::BindGroupEntry { binding, resource: buffer.as_entire_binding() })
            .collect();
        device.create_bind_group(&wgpu::BindGroupDescriptor { label: Some("compose"), layout, entries: &entries })
    }
}
