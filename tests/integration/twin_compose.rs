//! Composition: the pixels of the ray-caster reach a render target, in sRGB and other formats, scaled to the nearest pixel.

use anyhow::Result;
use insula_shaders::cpu::raycast::Pixels;
use insula_shaders::gpu::nearest::read_texels;
use insula_shaders::gpu::{Compose, DeviceQueue, Raycaster, target};
use insula_shaders::layout::Shading;
use insula_shaders::look::Look;
use insula_tests::gpu::Gpu;
use insula_tests::random::{self, Pose};
use insula_tests::rng::Rng;
use insula_tests::trials::Trials;
use insula_tests::view::{FrameSpec, in_look};
use insula_tests::{gpu_tests, twin};

pub(crate) fn add(trials: &mut Trials) {
    trials.add(gpu_tests![target_shows_the_pixels_of_the_ray_caster]);
}

const FRAME_PX: [u32; 2] = [97, 61];
/// The size of the frame, larger and smaller.
const TARGETS_PX: [[u32; 2]; 3] = [FRAME_PX, [192, 122], [64, 33]];

fn target_shows_the_pixels_of_the_ray_caster(gpu: &Gpu) -> Result<()> {
    Look::ALL.into_iter().try_for_each(|look| target_shows_a_look(gpu, look))
}

/// With the exposure that the look finds, and its lines and shade.
fn target_shows_a_look(gpu: &Gpu, look: Look) -> Result<()> {
    let city = random::city(2)?;
    let spec = FrameSpec { width_px: FRAME_PX[0], height_px: FRAME_PX[1], shading: Shading::Lit, samples: 1 };
    let camera = random::camera(&mut Rng::new(5), &city, Pose::Above);
    let mut scene = city.draw_list.scene(&camera, &spec);
    (scene.frame.ground, scene.frame.exposure) = (1, 0.0);
    scene.frame.ground_z_m = -(camera.position[2] - city.area.origin[2]) as f32;
    scene.frame = in_look(scene.frame, look);
    let (data, mut raycaster) = (scene.as_ref(), gpu.raycaster(&scene));
    let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    let on = DeviceQueue { device: &gpu.device, queue: &gpu.queue };
    raycaster.render(on, &mut encoder, data.frame, data.grid, data.nodes)?;
    gpu.queue.submit([encoder.finish()]);
    let frame = raycaster.read_back(&gpu.device, &gpu.queue)?;
    let colours = frame.colour.iter().collect::<std::collections::HashSet<_>>().len();
    anyhow::ensure!(colours > 100, "only {colours} colours in the frame");
    // A device's powers and logarithms round otherwise than those of the CPU.
    const STEPS: u8 = 1;
    for format in [wgpu::TextureFormat::Rgba8Unorm, wgpu::TextureFormat::Rgba8UnormSrgb] {
        for target_px in TARGETS_PX {
            let found = compose(gpu, &raycaster, format, target_px)?;
            for (i, found) in (0..).zip(&found) {
                let reference = nearest_pixel(&frame, [i % target_px[0], i / target_px[0]], target_px);
                anyhow::ensure!(
                    twin::same_colour(*found, reference, STEPS),
                    "{look:?}, {format:?}, {target_px:?}, pixel {i}: {found:08x} instead of {reference:08x}"
                );
            }
        }
    }
    Ok(())
}

fn nearest_pixel(frame: &Pixels, at: [u32; 2], target_px: [u32; 2]) -> u32 {
    let [x, y] = [0, 1].map(|axis| (at[axis] * FRAME_PX[axis] / target_px[axis]).min(FRAME_PX[axis] - 1));
    frame.colour[(y * FRAME_PX[0] + x) as usize]
}

/// Texels of a target with that format and size, row by row.
fn compose(gpu: &Gpu, raycaster: &Raycaster, format: wgpu::TextureFormat, size: [u32; 2]) -> Result<Vec<u32>> {
    let target = target(&gpu.device, format, size, wgpu::TextureUsages::COPY_SRC);
    let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    draw(gpu, &mut encoder, raycaster, &target);
    Ok(read_texels(DeviceQueue { device: &gpu.device, queue: &gpu.queue }, encoder, &target)?)
}

fn draw(gpu: &Gpu, encoder: &mut wgpu::CommandEncoder, raycaster: &Raycaster, target: &wgpu::Texture) {
    let view = target.create_view(&wgpu::TextureViewDescriptor::default());
    let mut compose = Compose::new(&gpu.device, target.format());
    let on = DeviceQueue { device: &gpu.device, queue: &gpu.queue };
    compose.measure(on, encoder, raycaster, [target.width(), target.height()]);
    let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
        color_attachments: &[Some(wgpu::RenderPassColorAttachment {
            view: &view,
            depth_slice: None,
            resolve_target: None,
            ops: wgpu::Operations { load: wgpu::LoadOp::Clear(wgpu::Color::GREEN), store: wgpu::StoreOp::Store },
        })],
        ..wgpu::RenderPassDescriptor::default()
    });
    compose.draw(&gpu.device, &mut pass, raycaster);
}
