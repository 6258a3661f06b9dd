//! A word per object, as the ray-caster reads it from palettes.

use insula_shaders::layout::{PALETTE_COLOURED, PALETTE_HIDDEN, PALETTE_OUTLINED};
use std::collections::{BTreeMap, BTreeSet};

/// How the objects of a city are drawn. By default all have their own colours.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct ObjectStyles {
    /// By object: a word of a palette without outlines. Objects beyond the end have their own colours.
    words: Vec<u32>,
    /// In ascending order.
    outlined: BTreeSet<u32>,
    /// Words of objects that are drawn in a way of their own, whatever `words` has for them.
    states: BTreeMap<u32, u32>,
}

/// How a single object is drawn, whatever the rules say.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ObjectState {
    /// In 8-bit sRGB.
    Colour([u8; 3]),
    /// Rays pass through it.
    Hidden,
}

impl ObjectStyles {
    /// Styles of the words that [`rules`](Self::rules) returned: a word of a palette for each object.
    pub fn of_rules(words: Vec<u32>) -> Self {
        Self { words, ..Self::default() }
    }

    /// What rules made of the objects, without outlines and states.
    pub fn rules(&self) -> &[u32] {
        &self.words
    }

    /// Whether all objects are drawn as they are.
    pub fn is_empty(&self) -> bool {
        self.outlined.is_empty() && self.states.is_empty() && self.words.iter().all(|word| *word == 0)
    }

    /// Gives an object a colour, in 8-bit sRGB.
    pub fn set_colour(&mut self, object: u32, rgb: [u8; 3]) {
        *self.word_mut(object) = coloured(rgb);
    }

    /// Makes rays pass through an object.
    pub fn hide(&mut self, object: u32) {
        *self.word_mut(object) = PALETTE_HIDDEN;
    }

    /// Outlines these objects and no others.
    pub fn outline(&mut self, objects: BTreeSet<u32>) {
        self.outlined = objects;
    }

    /// Draws an object in a way of its own; `None` as the rules say.
    pub fn set_state(&mut self, object: u32, state: Option<ObjectState>) {
        match state {
            Some(ObjectState::Colour(rgb)) => self.states.insert(object, coloured(rgb)),
            Some(ObjectState::Hidden) => self.states.insert(object, PALETTE_HIDDEN),
            None => self.states.remove(&object),
        };
    }

    /// The styles of other rules, with the outlines and states of these.
    pub fn with_rules_of(&self, other: Self) -> Self {
        Self { words: other.words, ..self.clone() }
    }

    fn word_mut(&mut self, object: u32) -> &mut u32 {
        let at = object as usize;
        if at >= self.words.len() {
            self.words.resize(at + 1, 0);
        }
        &mut self.words[at]
    }

    /// The palette of a list of objects.
    pub(crate) fn words(&self, list: &[u32]) -> Vec<u32> {
        let word = |object: &u32| {
            let outlined = if self.outlined.contains(object) { PALETTE_OUTLINED } else { 0 };
            let word = self.states.get(object).or_else(|| self.words.get(*object as usize));
            word.copied().unwrap_or(0) | outlined
        };
        list.iter().map(word).collect()
    }
}

/// The word of an object in a colour.
fn coloured([r, g, b]: [u8; 3]) -> u32 {
    PALETTE_COLOURED | u32::from(r) | u32::from(g) << 8 | u32::from(b) << 16
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_say_how_objects_are_drawn() {
        let mut styles = ObjectStyles::default();
        assert!(styles.is_empty());
        styles.set_colour(3, [1, 2, 3]);
        styles.hide(5);
        styles.outline(BTreeSet::from([3, 9]));
        let coloured = PALETTE_COLOURED | 0x03_02_01 | PALETTE_OUTLINED;
        assert_eq!(styles.words(&[9, 3, 4, 5]), [PALETTE_OUTLINED, coloured, 0, PALETTE_HIDDEN]);
        assert!(!styles.is_empty());
    }

    #[test]
    fn states_go_before_rules_and_outlast_them() {
        let mut styles = ObjectStyles::default();
        styles.hide(1);
        styles.set_state(1, Some(ObjectState::Colour([1, 2, 3])));
        styles.set_state(2, Some(ObjectState::Hidden));
        styles.outline(BTreeSet::from([2]));
        assert_eq!(styles.words(&[1, 2]), [PALETTE_COLOURED | 0x03_02_01, PALETTE_HIDDEN | PALETTE_OUTLINED]);
        let mut other = ObjectStyles::default();
        other.hide(4);
        let other = ObjectStyles::of_rules(other.rules().to_vec());
        let mut styles = styles.with_rules_of(other);
        styles.set_state(2, None);
        let expected = [PALETTE_COLOURED | 0x03_02_01, PALETTE_OUTLINED, PALETTE_HIDDEN];
        assert_eq!(styles.words(&[1, 2, 4]), expected);
    }
}
