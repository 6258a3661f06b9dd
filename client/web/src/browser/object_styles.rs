//! How objects are drawn: styles by rules, which the module of objects makes, states and outlines.

use super::viewer::CityViewer;
use insula_viewer::objects::{ObjectState, ObjectStyles};
use wasm_bindgen::prelude::*;

#[wasm_bindgen]
impl CityViewer {
    /// Draws objects by the words of `MadeStyles` from the next frame on. No tile is fetched again.
    #[wasm_bindgen(js_name = setStyles)]
    pub fn set_styles(&mut self, words: Vec<u32>) {
        self.apply_styles(self.styles().with_rules_of(ObjectStyles::of_rules(words)));
    }

    /// Draws single objects in a way of their own: for each of `objects` a number of `states`, a colour as 0xRRGGBB, -1 for hidden,
    /// anything else for what the styles say.
    #[wasm_bindgen(js_name = setStates)]
    pub fn set_states(&mut self, objects: &[u32], states: &[i32]) {
        let mut styles = self.styles().clone();
        for (&object, &state) in objects.iter().zip(states) {
            let [high, r, g, b] = state.to_be_bytes();
            styles.set_state(
                object,
                match (state, high) {
                    (-1, _) => Some(ObjectState::Hidden),
                    (_, 0) => Some(ObjectState::Colour([r, g, b])),
                    _ => None,
                },
            );
        }
        self.apply_styles(styles);
    }

    /// Outlines these objects and no others.
    pub fn outline(&mut self, objects: &[u32]) {
        let mut styles = self.styles().clone();
        styles.outline(objects.iter().copied().collect());
        self.apply_styles(styles);
    }
}

impl CityViewer {
    pub(crate) fn styles(&self) -> &ObjectStyles {
        self.streamer.cache().styles()
    }

    pub(crate) fn apply_styles(&mut self, styles: ObjectStyles) {
        self.streamer.set_styles(styles, &mut self.renderer);
        self.style_changes += 1;
    }
}
