//! Composition: the pixels of the ray-caster reach a render target, in sRGB and other formats, scaled to the nearest pixel.

use anyhow::Result;
use insula_shaders::cpu::raycast::Pixels;
use insula_shaders::gpu::{Compose, DeviceQueue, Raycaster};
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
fn compose(
    gpu: &Gpu,
    raycaster: &Raycaster,
    format: wgpu::TextureFormat,
    [width, height]: [u32; 2],
) -> Result<Vec<u32>> {
    let target = gpu.device.create_texture(&wgpu::TextureDescriptor {
        label: Some("target"),
        size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC,
        view_formats: &[],
    });
    // Rows of a copy are padded to 256 bytes.
    let row_bytes = (width * 4).next_multiple_of(256);
    let copy = gpu.device.create_buffer(&wgpu::BufferDescriptor {
        label: Some("copy"),
        size: u64::from(row_bytes) * u64::from(height),
        usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
        mapped_at_creation: false,
    });
    let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    draw(gpu, &mut encoder, raycaster, &target);
    let layout =
        wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(row_bytes), rows_per_image: Some(height) };
    let into = wgpu::TexelCopyBufferInfo { buffer: &copy, layout };
    encoder.copy_texture_to_buffer(target.as_image_copy(), into, target.size());
    gpu.queue.submit([encoder.finish()]);
    copy.slice(..).map_async(wgpu::MapMode::Read, |_| ());
    gpu.device.poll(wgpu::PollType::wait_indefinitely())?;
    let view = copy.slice(..).get_mapped_range()?;
    let rows = view.chunks_exact(row_bytes as usize).map(|row| &row[..width as usize * 4]);
    Ok(rows.flat_map(|row| row.as_chunks().0).map(|texel| u32::from_le_bytes(*texel)).collect())
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
