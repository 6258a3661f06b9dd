//! Which object a pixel shows: one ray is cast, on the device that draws.

use super::viewer::CityViewer;
use insula_shaders::layout::Shading;
use insula_viewer::frame::{FrameData, RenderSettings};
use insula_web_host::frame_words::frame_words;
use wasm_bindgen::prelude::*;

#[wasm_bindgen]
impl CityViewer {
    /// A frame of the ray at shares of the view's width and height, for `RowRenderer::probe` or
    /// `GpuRenderer::probe`; its word is for
    /// [`CityViewer::object_of`].
    #[wasm_bindgen(js_name = probeWords)]
    pub fn probe_words(&self, x: f64, y: f64) -> Vec<u32> {
        frame_words(&self.probe(x, y))
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
