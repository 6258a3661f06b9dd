//! Draws rows of a frame on the CPU, in a worker with its own copy of the atlas.

use insula_shaders::cpu::render::render_row;
use insula_viewer::cache::pages_for;
use insula_viewer::render::CpuAdapter;
use insula_web_host::frame_words::ReceivedFrame;
use insula_web_host::page_writes;
use wasm_bindgen::prelude::*;

/// The CPU ray-caster of one worker.
#[wasm_bindgen]
#[derive(Debug)]
pub struct RowRenderer {
    adapter: CpuAdapter,
    frame: Option<ReceivedFrame>,
    hit: Vec<u32>,
}

#[wasm_bindgen]
impl RowRenderer {
    /// An atlas of `cache_bytes` bytes.
    #[wasm_bindgen(constructor)]
    pub fn new(cache_bytes: f64) -> Self {
        Self { adapter: CpuAdapter::new(pages_for(cache_bytes as u64)), frame: None, hit: Vec::new() }
    }

    /// Writes pages and summaries.
    pub fn write(&mut self, words: &[u32]) {
        page_writes::apply(words, &mut self.adapter);
    }

    /// The frame whose rows are drawn next. Fails if it is not one.
    pub fn begin(&mut self, words: &[u32]) -> Result<(), JsError> {
        let frame = ReceivedFrame::parse(words).ok_or_else(|| JsError::new("not a frame of this version"))?;
        self.adapter.make_maps(&frame.frame, &frame.grid, &frame.nodes);
        self.frame = Some(frame);
        Ok(())
    }

    /// Draws rows `first`, `first + step`, ... below `end`. Returns a word for each pixel.
    pub fn draw(&mut self, first: u32, end: u32, step: u32) -> Vec<u32> {
        let (mut words, mut hit) = (Vec::new(), Vec::new());
        if let Some(ReceivedFrame { frame, grid, nodes, .. }) = &self.frame {
            let scene = self.adapter.scene(frame, grid, nodes);
            let end = end.min(frame.height_px);
            for y in (first..end).step_by(step.max(1) as usize) {
                render_row(&scene, y, &mut words, &mut hit);
            }
        }
        self.hit = hit;
        words
    }

    /// Casts the ray of a frame of one pixel, which is not the frame whose rows are drawn. Returns its word; 0 if it is not such a
    /// frame.
    pub fn probe(&self, words: &[u32]) -> u32 {
        let Some(ReceivedFrame { frame, grid, nodes, .. }) = &ReceivedFrame::parse(words) else { return 0 };
        let (mut words, mut hit) = (Vec::new(), Vec::new());
        if frame.width_px == 1 {
            render_row(&self.adapter.scene(frame, grid, nodes), 0, &mut words, &mut hit);
        }
        words.first().copied().unwrap_or_default()
    }

    /// For each row of the last [`RowRenderer::draw`], the nodes that its pixels hit, then the bits of their distances.
    pub fn take_hits(&mut self) -> Vec<u32> {
        std::mem::take(&mut self.hit)
    }
}
