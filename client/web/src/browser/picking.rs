//! Which object a pixel shows: one ray is cast, on the device that draws.

use super::frame_job::Renderer;
use super::row_renderer::frame_words;
use super::viewer::CityViewer;
use insula_shaders::layout::Shading;
use insula_viewer::frame::{FrameData, RenderSettings};
use js_sys::Promise;
use wasm_bindgen::prelude::*;

#[wasm_bindgen]
impl CityViewer {
    /// A frame of the ray at shares of the view's width and height, for `RowRenderer::probe`; its word is for
    /// [`CityViewer::object_of`].
    #[wasm_bindgen(js_name = probeWords)]
    pub fn probe_words(&self, x: f64, y: f64) -> Vec<u32> {
        frame_words(&self.probe(x, y))
    }

    /// The same on the GPU: the promise resolves to the bytes of the word. Fails with the reason if no GPU draws.
    #[wasm_bindgen(js_name = probeOnGpu)]
    pub fn probe_on_gpu(&mut self, x: f64, y: f64) -> Result<Promise, JsError> {
        let data = self.probe(x, y);
        let Renderer::Gpu(gpu) = &mut self.renderer else { return Err(JsError::new("no GPU draws")) };
        gpu.probe(&data).map_err(|reason| JsError::new(&reason))
    }

    /// The object that the word of a probe stands for, if it is one.
    #[wasm_bindgen(js_name = objectOf)]
    pub fn object_of(&self, word: u32) -> Option<u32> {
        self.streamer.cache().object_at(word)
    }
}

impl CityViewer {
    fn probe(&self, x: f64, y: f64) -> FrameData {
        let settings = self.daylight.render_settings(Shading::Objects, 1);
        let settings = RenderSettings { shadow_m: 0.0, ..settings };
        let mut data = self.streamer.frame_data(&self.request(1), &settings);
        data.narrow_to_ray(&self.view(), [x, y]);
        data
    }
}
