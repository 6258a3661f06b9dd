//! A word per object, as the ray-caster reads it from palettes.

use insula_shaders::layout::{PALETTE_COLOURED, PALETTE_HIDDEN, PALETTE_OUTLINED};
use std::collections::BTreeSet;

/// How the objects of a city are drawn. By default all have their own colours.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct ObjectStyles {
    /// By object: a word of a palette without outlines. Objects beyond the end have their own colours.
    words: Vec<u32>,
    /// In ascending order.
    outlined: BTreeSet<u32>,
}

impl ObjectStyles {
    /// Whether all objects are drawn as they are.
    pub fn is_empty(&self) -> bool {
        self.outlined.is_empty() && self.words.iter().all(|word| *word == 0)
    }

    /// Gives an object a colour, in 8-bit sRGB.
    pub fn set_colour(&mut self, object: u32, [r, g, b]: [u8; 3]) {
        *self.word_mut(object) = PALETTE_COLOURED | u32::from(r) | u32::from(g) << 8 | u32::from(b) << 16;
    }

    /// Makes rays pass through an object.
    pub fn hide(&mut self, object: u32) {
        *self.word_mut(object) = PALETTE_HIDDEN;
    }

    /// The objects that are outlined.
    pub fn outlined(&self) -> &BTreeSet<u32> {
        &self.outlined
    }

    /// Outlines these objects and no others.
    pub fn outline(&mut self, objects: BTreeSet<u32>) {
        self.outlined = objects;
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
            self.words.get(*object as usize).copied().unwrap_or(0) | outlined
        };
        list.iter().map(word).collect()
    }
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
}
