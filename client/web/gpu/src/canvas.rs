//! The GPU ray-caster on a canvas.

use insula_shaders::gpu::{Compose, DeviceQueue};
use insula_shaders::wgsl;
use insula_viewer::cache::pages_for;
use insula_viewer::render::{GpuAdapter, GpuDevice};
use insula_web_host::frame_words::ReceivedFrame;
use insula_web_host::host::Host;
use js_sys::{Promise, Uint8Array};
use std::sync::{Arc, OnceLock};
use wasm_bindgen::{JsCast, JsValue};
use wasm_bindgen_futures::JsFuture;
use web_sys::OffscreenCanvas;

/// Reason of a browser that has WebGPU but nothing that computes it.
const NO_ADAPTER: &str = "no graphics adapter";

#[derive(Debug)]
pub(crate) struct GpuCanvas {
    canvas: OffscreenCanvas,
    surface: wgpu::Surface<'static>,
    config: wgpu::SurfaceConfiguration,
    compose: Compose,
    pub(crate) adapter: GpuAdapter,
    /// Whether the hits of the last frame are being counted.
    pub(crate) counts_last: bool,
    /// Why the device was lost, once it is.
    lost: Arc<OnceLock<String>>,
}

impl GpuCanvas {
    /// Opens a device that can draw on `canvas`, with an atlas of at most `cache_bytes` bytes, and fetches the shaders for it. Software
    /// adapters are refused unless `accepts_software`: the CPU ray-caster is faster. Fails with a reason for people.
    pub(crate) async fn open(
        host: &Host,
        canvas: OffscreenCanvas,
        cache_bytes: u64,
        accepts_software: bool,
    ) -> Result<Self, String> {
        let descriptor = wgpu::InstanceDescriptor {
            backends: wgpu::Backends::BROWSER_WEBGPU,
            ..wgpu::InstanceDescriptor::new_without_display_handle()
        };
        let instance = wgpu::Instance::new(descriptor);
        let target = wgpu::SurfaceTarget::OffscreenCanvas(canvas.clone());
        let surface = instance.create_surface(target).map_err(|error| error.to_string())?;
        let opened = GpuDevice::open(&instance, Some(&surface), cache_bytes).await;
        // The library lists the kinds of drivers that a browser cannot have.
        let device = opened.map_err(|error| if error.contains("adapter") { NO_ADAPTER.into() } else { error })?;
        if !accepts_software && is_software(&device) {
            return Err("a software adapter is slower than the CPU ray-caster".into());
        }
        let config = surface
            .get_default_config(&device.adapter, canvas.width().max(1), canvas.height().max(1))
            .ok_or("the canvas has no format that this device can draw")?;
        load_shaders(host).await?;
        let adapter = GpuAdapter::new(device, pages_for(cache_bytes)).await?;
        let compose = Compose::new(&adapter.device.device, config.format);
        surface.configure(&adapter.device.device, &config);
        let lost = Arc::new(OnceLock::new());
        let reason = lost.clone();
        adapter.device.device.set_device_lost_callback(move |_, message| {
            // The first reason is the cause of the others.
            let _ = reason.set(message);
        });
        Ok(Self { canvas, surface, config, compose, adapter, counts_last: false, lost })
    }

    pub(crate) fn name(&self) -> String {
        let name = self.adapter.device.info().name;
        if name.is_empty() { "WebGPU".into() } else { format!("WebGPU, {name}") }
    }

    /// Why the device was lost, if it was.
    pub(crate) fn lost(&self) -> Option<&str> {
        self.lost.get().map(String::as_str)
    }

    /// Loses the device, for tests.
    pub(crate) fn destroy(&self) {
        self.adapter.device.device.destroy();
    }

    /// Draws a frame on a canvas of `size_px`. The promise resolves when the device has drawn it. Fails with a reason.
    pub(crate) fn draw(&mut self, received: &ReceivedFrame, size_px: [u32; 2]) -> Result<Promise, String> {
        self.counts_last = false;
        self.resize(size_px);
        let target = match self.surface.get_current_texture() {
            wgpu::CurrentSurfaceTexture::Success(texture) | wgpu::CurrentSurfaceTexture::Suboptimal(texture) => texture,
            _ => return Err("the canvas has no texture".into()),
        };
        let view = target.texture.create_view(&wgpu::TextureViewDescriptor::default());
        let GpuDevice { device, queue, .. } = self.adapter.device.clone();
        let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("frame") });
        let ReceivedFrame { generation, frame, grid, nodes } = received;
        self.adapter.encode(&mut encoder, frame, grid, nodes).map_err(|error| error.to_string())?;
        self.counts_last = self.adapter.encode_count(&mut encoder, *generation, frame, nodes.len());
        let on = DeviceQueue { device: &device, queue: &queue };
        self.compose.measure(on, &mut encoder, &self.adapter.raycaster, size_px);
        let mut pass = begin_pass(&mut encoder, &view);
        self.compose.draw(&device, &mut pass, &self.adapter.raycaster);
        drop(pass);
        queue.submit([encoder.finish()]);
        self.adapter.query_submitted();
        queue.present(target);
        Ok(Promise::new(&mut |resolve, _| {
            queue.on_submitted_work_done(move || {
                // The function of a promise does not fail.
                let _ = resolve.call0(&JsValue::UNDEFINED);
            });
        }))
    }

    /// Draws a frame of one pixel, which is not shown. The promise resolves to the bytes of its word. Fails with a reason.
    pub(crate) fn probe(&mut self, received: &ReceivedFrame) -> Result<Promise, String> {
        let mut encoder = self.encoder("probe");
        let ReceivedFrame { frame, grid, nodes, .. } = received;
        self.adapter.encode(&mut encoder, frame, grid, nodes).map_err(|error| error.to_string())?;
        Ok(self.read(encoder, self.adapter.raycaster.colour_buffer(), 4))
    }

    /// The promise resolves to the bytes of the distances of the last frame's pixels.
    pub(crate) fn distances(&self) -> Promise {
        let buffer = self.adapter.raycaster.distance_buffer();
        self.read(self.encoder("distances"), buffer, buffer.size())
    }

    fn encoder(&self, label: &str) -> wgpu::CommandEncoder {
        self.adapter.device.device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some(label) })
    }

    /// Submits commands. The promise resolves to the first bytes that a buffer has then.
    fn read(&self, mut encoder: wgpu::CommandEncoder, source: &wgpu::Buffer, size: u64) -> Promise {
        let GpuDevice { device, queue, .. } = &self.adapter.device;
        let copy = device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("read"),
            size,
            usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        encoder.copy_buffer_to_buffer(source, 0, &copy, 0, size);
        queue.submit([encoder.finish()]);
        Promise::new(&mut |resolve, reject| {
            let mapped = copy.clone();
            copy.map_async(wgpu::MapMode::Read, .., move |result| {
                let found = result.map_err(|error| error.to_string()).and_then(|()| {
                    let bytes = mapped.get_mapped_range(..).map_err(|error| error.to_string())?;
                    Ok(Uint8Array::from(&bytes[..]))
                });
                let reply = match found {
                    Ok(bytes) => resolve.call1(&JsValue::UNDEFINED, &bytes.into()),
                    Err(reason) => reject.call1(&JsValue::UNDEFINED, &reason.into()),
                };
                // The functions of a promise do not fail.
                let _ = reply;
            });
        })
    }

    fn resize(&mut self, [width, height]: [u32; 2]) {
        if [self.config.width, self.config.height] != [width, height] {
            (self.config.width, self.config.height) = (width, height);
            self.canvas.set_width(width);
            self.canvas.set_height(height);
            self.surface.configure(&self.adapter.device.device, &self.config);
        }
    }
}

/// Pages that are drawn by the CPU do without them. Fails with a reason for people.
async fn load_shaders(host: &Host) -> Result<(), String> {
    if wgsl::is_loaded() {
        return Ok(());
    }
    let text = JsFuture::from(host.shaders()).await.map_err(|error| match error.dyn_ref::<js_sys::Error>() {
        Some(error) => String::from(error.message()),
        None => "the shaders cannot be fetched".into(),
    })?;
    wgsl::load(text.as_string().unwrap_or_default()).map_err(|error| error.to_string())
}

/// Whether a device computes on the CPU. Browsers do not say it of all: SwiftShader is known by its name.
fn is_software(device: &GpuDevice) -> bool {
    let info = device.adapter.get_info();
    let names = format!("{} {} {}", info.name, info.driver, info.driver_info).to_lowercase();
    device.is_software() || ["swiftshader", "llvmpipe", "warp", "basic render"].iter().any(|name| names.contains(name))
}

fn begin_pass(encoder: &mut wgpu::CommandEncoder, view: &wgpu::TextureView) -> wgpu::RenderPass<'static> {
    let attachment = wgpu::RenderPassColorAttachment {
        view,
        depth_slice: None,
        resolve_target: None,
        ops: wgpu::Operations { load: wgpu::LoadOp::Clear(wgpu::Color::BLACK), store: wgpu::StoreOp::Store },
    };
    let descriptor = wgpu::RenderPassDescriptor {
        label: Some("scene"),
        color_attachments: &[Some(attachment)],
        ..wgpu::RenderPassDescriptor::default()
    };
    encoder.begin_render_pass(&descriptor).forget_lifetime()
}
