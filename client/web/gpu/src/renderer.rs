//! Draws the frames of a viewer of another module.

use super::canvas::GpuCanvas;
use insula_web_host::console;
use insula_web_host::frame_words::ReceivedFrame;
use insula_web_host::host::{Host, to_js};
use insula_web_host::page_writes;
use js_sys::Promise;
use wasm_bindgen::prelude::*;
use web_sys::OffscreenCanvas;

/// Runs once in each worker.
#[wasm_bindgen(start)]
pub fn start() {
    console::start();
}

/// An open GPU.
#[wasm_bindgen]
pub struct GpuRenderer {
    canvas: GpuCanvas,
}

#[wasm_bindgen]
impl GpuRenderer {
    /// Opens the GPU ray-caster on a canvas, with an atlas of at most `cache_bytes` bytes. See `GpuCanvas::open`.
    pub async fn open(
        host: Host,
        canvas: OffscreenCanvas,
        cache_bytes: f64,
        accepts_software: bool,
    ) -> Result<GpuRenderer, JsError> {
        let opened = GpuCanvas::open(&host, canvas, cache_bytes as u64, accepts_software).await;
        opened.map(|canvas| Self { canvas }).map_err(to_js)
    }

    /// Name of the device.
    pub fn name(&self) -> String {
        self.canvas.name()
    }

    /// Number of pages that the atlas holds.
    pub fn pages(&self) -> u32 {
        self.canvas.adapter.pages()
    }

    /// Why the device was lost, if it was.
    pub fn lost(&self) -> Option<String> {
        self.canvas.lost().map(str::to_owned)
    }

    /// Loses the device, for tests.
    pub fn destroy(&self) {
        self.canvas.destroy();
    }

    /// Writes pages and summaries, as `CityViewer::take_writes` returns them.
    pub fn write(&mut self, words: &[u32]) {
        page_writes::apply(words, &mut self.canvas.adapter);
    }

    /// Draws a frame of `CityViewer::frame_words` on a canvas of this size. The promise resolves when the device has drawn it. Fails with
    /// the reason.
    pub fn draw(&mut self, words: &[u32], width: u32, height: u32) -> Result<Promise, JsError> {
        self.canvas.draw(&received(words)?, [width, height]).map_err(to_js)
    }

    /// Whether the hits of the last frame are being counted.
    #[wasm_bindgen(js_name = countsLast)]
    pub fn counts_last(&self) -> bool {
        self.canvas.counts_last
    }

    /// The hits of each node of the frame that was counted, once they are there.
    #[wasm_bindgen(js_name = takeHits)]
    pub fn take_hits(&mut self) -> Option<Vec<u32>> {
        self.canvas.adapter.take_counts()
    }

    /// The promise resolves to the bytes of the distances of the last frame's pixels.
    pub fn distances(&self) -> Promise {
        self.canvas.distances()
    }

    /// Draws a frame of one pixel of `CityViewer::probe_words`, which is not shown. The promise resolves to the bytes of its word. Fails
    /// with the reason.
    pub fn probe(&mut self, words: &[u32]) -> Result<Promise, JsError> {
        self.canvas.probe(&received(words)?).map_err(to_js)
    }
}

fn received(words: &[u32]) -> Result<ReceivedFrame, JsError> {
    ReceivedFrame::parse(words).ok_or_else(|| JsError::new("not a frame of this version"))
}
