//! Landmarks: single objects whose triangles stay dense.

use super::SceneSink;
use crate::read::scene_builder::PendingLandmark;
use insula_place::local_frame::LocalFrame;
use insula_place::placement::Placement;
use insula_source::error::InputError;
use insula_source::object::{ObjectSink, SourceObject};

impl SceneSink<'_, '_, '_> {
    /// Sets where the positions are that follow.
    pub(crate) fn set_placement(&mut self, placement: Placement) {
        (self.placement, self.frame, self.unplaced_mesh) = (placement, LocalFrame::IDENTITY, None);
        self.is_place_sought = false;
    }

    /// Adds an object as a landmark, whose number is set here. Fails if the whole bake must end.
    pub(crate) fn add_landmark(&mut self, object: SourceObject, landmark: PendingLandmark) -> Result<(), InputError> {
        let number = self.context.builder.len();
        self.add(object)?;
        if self.context.builder.len() > number {
            self.context.builder.add_landmark(PendingLandmark { object: number as u32, ..landmark });
        }
        Ok(())
    }
}
