//! The objects around one place of the curve of leaves.

use super::ExportError;
use super::city::{City, Plan};
use std::collections::{BTreeSet, HashMap};

/// What is known of the objects of which leaves are still to come.
pub(crate) struct OpenObjects<T> {
    open: HashMap<u32, T>,
    /// Position of the last leaf of each open object, and the object.
    closing: BTreeSet<(u64, u32)>,
}

impl<T> Default for OpenObjects<T> {
    fn default() -> Self {
        Self { open: HashMap::new(), closing: BTreeSet::new() }
    }
}

impl<T> OpenObjects<T> {
    /// What is known of an object, `new` if nothing is. Fails if its bounds cannot be read.
    pub(crate) fn get(
        &mut self,
        city: &City<'_>,
        plan: &Plan,
        object: u32,
        new: impl FnOnce() -> T,
    ) -> Result<&mut T, ExportError> {
        if !self.open.contains_key(&object) {
            self.closing.insert((plan.last_leaf(city, object)?, object));
        }
        Ok(self.open.entry(object).or_insert_with(new))
    }

    /// Removes an object whose last leaf is at `position` or before it.
    pub(crate) fn pop(&mut self, position: u64) -> Option<(u32, T)> {
        let (_, object) = self.closing.first().copied().filter(|(last, _)| *last <= position)?;
        self.closing.pop_first();
        self.open.remove_entry(&object)
    }
}
