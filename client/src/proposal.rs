//! What a session shows of a proposal: added objects, and none of those that are removed.

use crate::error::{ClientError, Result};
use insula_objects::NamedValues;
use insula_viewer::additions::{AddedObject, FIRST_ADDED, PackedAddition, pack};
use insula_viewer::objects::{ObjectDescription, ObjectState, ObjectStyles};
use std::sync::Arc;

/// A proposal that a session shows, or hides.
#[derive(Debug)]
pub struct ShownProposal {
    title: String,
    objects: AddedObjects,
    /// Until the session has them.
    meshes: Vec<PackedAddition>,
    /// Numbers of objects that are removed.
    removed: Vec<u32>,
    is_shown: bool,
}

/// What is known of added objects: names, and where they stand.
#[derive(Debug, Clone, Default)]
pub struct AddedObjects(Arc<[(String, Option<[f64; 3]>)]>);

impl ShownProposal {
    /// A proposal that is shown. Fails if what it adds cannot be drawn.
    pub fn new(title: String, added: &[AddedObject], removed: Vec<u32>) -> Result<Self> {
        let meshes = pack(added).map_err(|error| ClientError::Usage(format!("--proposal: {error}")))?;
        let objects = AddedObjects(added.iter().map(|object| (object.name.clone(), object.centre())).collect());
        Ok(Self { title, objects, meshes, removed, is_shown: true })
    }

    /// The title for people.
    pub fn title(&self) -> &str {
        &self.title
    }

    /// Whether the city is shown as it would be, and not as it is.
    pub fn is_shown(&self) -> bool {
        self.is_shown
    }

    pub(crate) fn set_shown(&mut self, is_shown: bool) {
        self.is_shown = is_shown;
    }

    /// Whether an object of the city or of the proposal is in what is shown.
    pub(crate) fn shows(&self, object: u32) -> bool {
        if self.is_shown { !self.removed.contains(&object) } else { object < FIRST_ADDED }
    }

    pub(crate) fn objects(&self) -> AddedObjects {
        self.objects.clone()
    }

    /// The meshes that it adds, once.
    pub(crate) fn take_meshes(&mut self) -> Vec<PackedAddition> {
        std::mem::take(&mut self.meshes)
    }

    /// Hides what is removed, while the proposal is shown.
    pub(crate) fn hide_removed(&self, styles: &mut ObjectStyles) {
        let state = self.is_shown.then_some(ObjectState::Hidden);
        self.removed.iter().for_each(|object| styles.set_state(*object, state));
    }
}

impl AddedObjects {
    /// What is known of an object; `None` if it is not added.
    pub(crate) fn describe(&self, id: u32) -> Option<ObjectDescription> {
        let (name, centre) = self.0.get(id.checked_sub(FIRST_ADDED)? as usize)?;
        Some(ObjectDescription {
            id,
            identifier: name.clone(),
            parent: None,
            kind: "proposal",
            attributes: NamedValues::default(),
            centre: *centre,
            parts: Vec::new(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_added_has_a_name_and_what_is_removed_is_hidden_while_it_is_shown() {
        let triangles = vec![[[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [0.0, 2.0, 6.0]]];
        let added = [AddedObject { name: "tower".to_owned(), triangles }];
        let mut proposal = ShownProposal::new("Plan".to_owned(), &added, vec![7]).unwrap();
        assert_eq!((proposal.take_meshes().len(), proposal.take_meshes().len()), (1, 0));
        let tower = proposal.objects().describe(FIRST_ADDED).unwrap();
        assert_eq!((&tower.identifier[..], tower.centre), ("tower", Some([2.0, 1.0, 3.0])));
        assert!(proposal.objects().describe(FIRST_ADDED + 1).is_none() && proposal.objects().describe(7).is_none());
        let mut styles = ObjectStyles::default();
        proposal.hide_removed(&mut styles);
        assert!(!styles.is_empty());
        let shown = |proposal: &ShownProposal| [3, 7, FIRST_ADDED].map(|object| proposal.shows(object));
        assert_eq!(shown(&proposal), [true, false, true]);
        proposal.set_shown(false);
        assert_eq!(shown(&proposal), [true, true, false]);
        proposal.hide_removed(&mut styles);
        assert!(styles.is_empty() && !proposal.is_shown());
    }
}
