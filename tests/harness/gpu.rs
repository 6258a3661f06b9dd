//! A GPU for tests.

use crate::draw_list::Scene;
use anyhow::{Context, Result};
use insula_shaders::cpu::raycast::Pixels;
use insula_shaders::gpu::{Capacity, DeviceQueue, Raycaster};
use insula_shaders::layout::{PAGE_WORDS, SUMMARY_WORDS};
use insula_shaders::translucency::MAX_MAPS;
use std::sync::{Mutex, PoisonError};

#[derive(Debug)]
pub struct Gpu {
    pub device: wgpu::Device,
    pub queue: wgpu::Queue,
    /// Kept between frames, and replaced for a larger scene, because compiling its shader takes longer than a frame. Locked,
    /// because error scopes belong to the device, not to a thread.
    raycaster: Mutex<Option<Raycaster>>,
    pub name: String,
}

/// Whether a missing adapter fails a test (`INSULA_REQUIRE_ADAPTER=1`, as in CI) instead of ignoring it.
pub fn adapter_is_required() -> bool {
    std::env::var("INSULA_REQUIRE_ADAPTER").is_ok_and(|v| v == "1")
}

impl Gpu {
    /// The first adapter that the environment allows (`WGPU_BACKEND`, `VK_ICD_FILENAMES`).
    pub fn open() -> Result<Self> {
        let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle_from_env());
        let adapter = pollster::block_on(instance.request_adapter(&wgpu::RequestAdapterOptions::default()))
            .context("no graphics adapter")?;
        let info = adapter.get_info();
        let descriptor = wgpu::DeviceDescriptor { required_limits: adapter.limits(), ..Default::default() };
        let (device, queue) = pollster::block_on(adapter.request_device(&descriptor)).context("no graphics device")?;
        Ok(Self { device, queue, raycaster: Mutex::new(None), name: format!("{} ({})", info.name, info.backend) })
    }

    /// Draws a scene. Fails at any validation error.
    pub fn render(&self, scene: &Scene<'_>) -> Result<Pixels> {
        let mut raycaster = self.raycaster.lock().unwrap_or_else(PoisonError::into_inner);
        let guard = self.device.push_error_scope(wgpu::ErrorFilter::Validation);
        let pixels = self.draw(&mut raycaster, scene);
        if let Some(error) = pollster::block_on(guard.pop()) {
            anyhow::bail!("the device refused: {error}");
        }
        pixels
    }

    fn draw(&self, cached: &mut Option<Raycaster>, scene: &Scene<'_>) -> Result<Pixels> {
        let data = scene.as_ref();
        let needed = capacity(scene);
        if !cached.as_ref().is_some_and(|raycaster| is_large_enough(raycaster.capacity(), needed)) {
            *cached = Some(Raycaster::new(&self.device, needed));
        }
        let raycaster = cached.as_mut().context("no ray-caster")?;
        self.upload(raycaster, scene);
        let device_queue = DeviceQueue { device: &self.device, queue: &self.queue };
        for number in 0..MAX_MAPS {
            raycaster.make_map(device_queue, data.frame, data.grid, data.nodes, number)?;
        }
        let mut encoder = self.device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("test") });
        raycaster.render(device_queue, &mut encoder, data.frame, data.grid, data.nodes)?;
        self.queue.submit([encoder.finish()]);
        Ok(raycaster.read_back(&self.device, &self.queue)?)
    }

    /// A new ray-caster with a scene uploaded.
    pub fn raycaster(&self, scene: &Scene<'_>) -> Raycaster {
        let mut raycaster = Raycaster::new(&self.device, capacity(scene));
        self.upload(&mut raycaster, scene);
        raycaster
    }

    fn upload(&self, raycaster: &mut Raycaster, scene: &Scene<'_>) {
        let data = scene.as_ref();
        raycaster.resize(&self.device, [data.frame.width_px, data.frame.height_px]);
        for (page, words) in data.atlas.chunks_exact(PAGE_WORDS).enumerate() {
            raycaster.write_words(&self.queue, (page * PAGE_WORDS) as u32, words);
        }
        for (slot, words) in data.summaries.as_chunks::<SUMMARY_WORDS>().0.iter().enumerate() {
            raycaster.write_summary(&self.queue, slot as u32, words);
        }
    }
}

fn capacity(scene: &Scene<'_>) -> Capacity {
    let (slots, atlas_pages) = scene.slots_and_pages();
    Capacity { atlas_pages, slots, nodes: scene.nodes.len() as u32 }
}

fn is_large_enough(has: Capacity, needed: Capacity) -> bool {
    has.atlas_pages >= needed.atlas_pages && has.slots >= needed.slots && has.nodes >= needed.nodes
}
