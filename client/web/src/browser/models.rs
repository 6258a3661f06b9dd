//! Models that the page adds to the city.

use super::viewer::CityViewer;
use insula_viewer::additions::{AdditionError, MAX_ADDED_MESHES, added_object};
use insula_viewer::transfer;
use insula_web_host::host::to_js;
use wasm_bindgen::prelude::*;

#[wasm_bindgen]
impl CityViewer {
    /// Adds a model that the module of meshes has packed. All tiles are fetched again. Returns the object that a named model is. Fails if it
    /// is too large together with the others, and then is not added.
    #[wasm_bindgen(js_name = addModel)]
    pub fn add_model(&mut self, number: u32, packed: &[u8], is_named: bool) -> Result<Option<u32>, JsError> {
        let addition = transfer::from_bytes(packed).map_err(to_js)?;
        if self.models.len() >= MAX_ADDED_MESHES {
            return Err(to_js(AdditionError::TooMany(self.models.len() + 1)));
        }
        self.models.insert(number, addition);
        let pages = self.streamer.cache().capacity_pages();
        if self.restart(pages).is_err() {
            self.models.remove(&number);
            self.renew(pages);
            return Err(JsError::new("the models take more than half of the memory for the city: simplify them"));
        }
        Ok(added_object(number).filter(|_| is_named))
    }

    /// Shows or hides all models from the next frame on. No tile is fetched again.
    #[wasm_bindgen(js_name = showModels)]
    pub fn show_models(&mut self, are_shown: bool) {
        self.are_models_shown = are_shown;
        self.streamer.show_additions(are_shown);
        self.style_changes += 1;
    }

    /// Removes a model. All tiles are fetched again.
    #[wasm_bindgen(js_name = removeModel)]
    pub fn remove_model(&mut self, number: u32) {
        if self.models.remove(&number).is_some() {
            self.renew(self.streamer.cache().capacity_pages());
        }
    }
}
