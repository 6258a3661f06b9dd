//! Draws the ray-caster's pixels on a render target.

use super::{DeviceQueue, Raycaster, bind_group, buffer, compute_pipeline, shader_module};
use crate::layout::{ComposeUniform, WORKGROUP, binding};
use bytemuck::Zeroable;
use wgpu::util::DeviceExt;

/// The pass that shows a ray-cast frame.
#[derive(Debug)]
pub struct Compose {
    pipeline: wgpu::RenderPipeline,
    meter: wgpu::ComputePipeline,
    contact: wgpu::ComputePipeline,
    settings: wgpu::Buffer,
    exposure: wgpu::Buffer,
    /// Shade of each block of two by two pixels.
    shade: wgpu::Buffer,
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
        let compute = |name: &str, source: String| compute_pipeline(device, &shader_module(device, name, source), name);
        let meter = compute("meter", crate::wgsl::meter());
        let contact = compute("contact", crate::wgsl::contact());
        let settings = device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
            label: Some("compose settings"),
            contents: bytemuck::bytes_of(&ComposeUniform::zeroed()),
            usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
        });
        let exposure = buffer(device, "exposure", 4, wgpu::BufferUsages::STORAGE);
        let shade = buffer(device, "shade", 4, wgpu::BufferUsages::STORAGE);
        Self { pipeline, meter, contact, settings, exposure, shade }
    }

    /// Records the measurement of the exposure and of the shade of `raycaster`'s last frame, which is to be drawn on a target of a size.
    pub fn measure(
        &mut self,
        DeviceQueue { device, queue }: DeviceQueue<'_>,
        encoder: &mut wgpu::CommandEncoder,
        raycaster: &Raycaster,
        target_px: [u32; 2],
    ) {
        let frame = raycaster.last_frame();
        let settings = ComposeUniform::new(frame, raycaster.size_px(), target_px);
        queue.write_buffer(&self.settings, 0, bytemuck::bytes_of(&settings));
        let blocks = raycaster.size_px().map(|side| side.div_ceil(2));
        let bytes = blocks.iter().map(|side| u64::from(*side)).product::<u64>().max(1) * 4;
        if self.shade.size() < bytes {
            self.shade = buffer(device, "shade", bytes, wgpu::BufferUsages::STORAGE);
        }
        let meter = [
            (binding::COMPOSE_SETTINGS, &self.settings),
            (binding::COMPOSE_COLOUR, raycaster.colour_buffer()),
            (binding::COMPOSE_EXPOSURE, &self.exposure),
            (binding::COMPOSE_HIT, raycaster.hit_buffer()),
        ];
        let meter = bind_group(device, "meter", &self.meter.get_bind_group_layout(0), &meter);
        let contact = [
            (binding::COMPOSE_SETTINGS, &self.settings),
            (binding::COMPOSE_DISTANCE, raycaster.distance_buffer()),
            (binding::COMPOSE_SHADE, &self.shade),
        ];
        let contact = bind_group(device, "contact", &self.contact.get_bind_group_layout(0), &contact);
        let mut pass =
            encoder.begin_compute_pass(&wgpu::ComputePassDescriptor { label: Some("measure"), timestamp_writes: None });
        pass.set_pipeline(&self.meter);
        pass.set_bind_group(0, &meter, &[]);
        pass.dispatch_workgroups(1, 1, 1);
        if settings.edges[1] > 0.0 {
            pass.set_pipeline(&self.contact);
            pass.set_bind_group(0, &contact, &[]);
            pass.dispatch_workgroups(blocks[0].div_ceil(WORKGROUP[0]), blocks[1].div_ceil(WORKGROUP[1]), 1);
        }
    }

    /// Draws the last frame of `raycaster` over the whole target, scaled to the nearest pixel, with the exposure of the last
    /// [`Compose::measure`].
    pub fn draw(&self, device: &wgpu::Device, pass: &mut wgpu::RenderPass<'_>, raycaster: &Raycaster) {
        let inputs = [
            (binding::COMPOSE_SETTINGS, &self.settings),
            (binding::COMPOSE_COLOUR, raycaster.colour_buffer()),
            (binding::COMPOSE_EXPOSURE, &self.exposure),
            (binding::COMPOSE_DISTANCE, raycaster.distance_buffer()),
            (binding::COMPOSE_SHADE, &self.shade),
        ];
        let bind_group = bind_group(device, "compose", &self.pipeline.get_bind_group_layout(0), &inputs);
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &bind_group, &[]);
        pass.draw(0..3, 0..1);
    }
}
