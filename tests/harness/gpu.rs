//! A graphics device for tests, or the reason why there is none.

use crate::draw_list::Scene;
use anyhow::{Context, Result};
use insula_shaders::{
    cpu::raycast::Pixels,
    gpu::{Capacity, DeviceQueue, Raycaster},
    layout::{PAGE_WORDS, SUMMARY_WORDS},
};
use std::sync::{Mutex, PoisonError};

/// A device, its queue and what it calls itself.
#[derive(Debug)]
pub struct Gpu {
    pub device: wgpu::Device,
    pub queue: wgpu::Queue,
    /// Made once, and again when a scene is larger: its shader takes longer to compile than a frame to draw.
    /// One frame at a time: error scopes are the device's, not a thread's.
    raycaster: Mutex<Option<Raycaster>>,
    pub name: String,
}

/// Whether a missing adapter is a failure (`INSULA_REQUIRE_ADAPTER=1`, as in CI) rather than a reason to ignore a test.
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

    /// The GPU's frame of a scene; any validation error is an error.
    pub fn render(&self, scene: &Scene<'_>) -> Result<Pixels> {
        let mut raycaster = self.raycaster.lock().unwrap_or_else(PoisonError::into_inner);
        let guard = self.device.push_error_scope(wgpu::ErrorFilter::Validation);
        let pixels = self.draw(&mut raycaster, scene);
        if let Some(error) = pollster::block_on(guard.pop()) {
            anyhow::bail!("the device refused: {error}");
        }
        pixels
    }

    fn draw(&self, made: &mut Option<Raycaster>, scene: &Scene<'_>) -> Result<Pixels> {
        let data = scene.as_ref();
        let wanted = capacity(scene);
        if !made.as_ref().is_some_and(|raycaster| holds(raycaster.capacity(), wanted)) {
            *made = Some(Raycaster::new(&self.device, wanted));
        }
        let raycaster = made.as_mut().context("no ray-caster")?;
        self.upload(raycaster, scene);
        let mut encoder = self.device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("test") });
        let on = DeviceQueue { device: &self.device, queue: &self.queue };
        raycaster.render(on, &mut encoder, data.frame, data.grid, data.nodes)?;
        self.queue.submit([encoder.finish()]);
        Ok(raycaster.read_back(&self.device, &self.queue)?)
    }

    /// A ray-caster that holds all of a scene.
    pub fn raycaster(&self, scene: &Scene<'_>) -> Raycaster {
        let mut raycaster = Raycaster::new(&self.device, capacity(scene));
        self.upload(&mut raycaster, scene);
        raycaster
    }

    fn upload(&self, raycaster: &mut Raycaster, scene: &Scene<'_>) {
        let data = scene.as_ref();
        raycaster.resize(&self.device, [data.frame.width_px, data.frame.height_px]);
        for (page, words) in data.atlas.chunks_exact(PAGE_WORDS).enumerate() {
            raycaster.write_page(&self.queue, page as u32, words);
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

fn holds(has: Capacity, wanted: Capacity) -> bool {
    has.atlas_pages >= wanted.atlas_pages && has.slots >= wanted.slots && has.nodes >= wanted.nodes
}
