//! Translucency maps on a device. CPU twin: [`crate::cpu::translucency_map`].

use super::raycast::{MapMaker, OutputBuffers, PipelineVariant, Raycaster, pipeline};
use super::{DeviceQueue, GpuError};
use crate::layout::{DrawNode, FrameUniform, WORKGROUP};
use crate::translucency::{COARSEST_PX, MAX_MAP_PX, level_words, map_words};

impl Raycaster {
    /// Makes the frame's translucency map `number` and writes it into the atlas, before the frame itself is rendered. Does nothing if
    /// the frame has no such map, or if the atlas has no room for it. Fails if there are more nodes than the capacity allows.
    pub fn make_map(
        &mut self,
        on: DeviceQueue<'_>,
        frame: &FrameUniform,
        grid: &[[u32; 2]],
        nodes: &[DrawNode],
        number: usize,
    ) -> Result<(), GpuError> {
        let Some(map) = frame.translucency.get(number).filter(|map| map.width_px >= COARSEST_PX) else { return Ok(()) };
        let end = u64::from(map.address) + u64::from(map_words(map.width_px));
        if end * 4 > self.inputs.atlas.size() || map.width_px > MAX_MAP_PX {
            return Ok(());
        }
        self.upload(on, &FrameUniform { map_in_progress: number as u32, ..*frame }, grid, nodes)?;
        let device = on.device;
        let (layout, inputs) = (&self.bind_group_layout, &self.inputs);
        let maker = self.maps.get_or_insert_with(|| {
            let variant = PipelineVariant::with_landmarks();
            MapMaker {
                finest: pipeline(device, layout, "translucency_map", variant),
                coarser: pipeline(device, layout, "translucency_level", variant),
            }
        });
        let output = OutputBuffers::new(device, layout, inputs, [map.width_px; 2]);
        let label = Some("translucency map");
        let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label });
        let (mut width, mut address) = (map.width_px, u64::from(map.address));
        while width >= COARSEST_PX {
            let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor { label, timestamp_writes: None });
            pass.set_pipeline(if width == map.width_px { &maker.finest } else { &maker.coarser });
            pass.set_bind_group(0, &output.bind_group, &[]);
            pass.dispatch_workgroups(width / WORKGROUP[0], width / WORKGROUP[1], 1);
            drop(pass);
            let bytes = u64::from(width * width) * 4;
            encoder.copy_buffer_to_buffer(&output.colour, 0, &self.inputs.atlas, address * 4, bytes);
            encoder.copy_buffer_to_buffer(&output.hit, 0, &self.inputs.atlas, address * 4 + bytes, bytes);
            address += u64::from(level_words(width));
            width /= 2;
        }
        on.queue.submit([encoder.finish()]);
        Ok(())
    }
}
