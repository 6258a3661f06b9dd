//! A part of a city, read and sorted once for all views of it.

use crate::bsp::{BspTree, Eye, TreeWalk};
use crate::error::{DrawError, DrawProgress};
use crate::face::{Face, FacePlane, bounds_of};
use crate::request::DrawRequest;
use crate::scene::{DrawnScene, clip, turned};
use crate::volume::ViewVolume;
use glam::DVec3;
use insula_export::source::ExportSource;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// The surfaces of a part of a city in levels of detail for one scale, and a tree that sorts them for any eye. Drawings of other views
/// need no more of the city than names.
#[derive(Debug)]
pub struct DrawnPart {
    pub(crate) scene: DrawnScene,
    /// Whether the backs of each object's faces may be seen.
    is_open: Vec<bool>,
    bounds: [DVec3; 2],
    /// Grows by what views show for the first time.
    tree: Mutex<BspTree>,
}

impl DrawnPart {
    /// Reads the part that a request selects, with the detail that its scale needs. Fails if the city cannot be read, if there is
    /// nothing or too much to draw, or if `progress` stops it.
    pub fn read(
        source: &dyn ExportSource,
        request: &DrawRequest,
        progress: DrawProgress<'_>,
    ) -> Result<Self, DrawError> {
        let detail = (request.error_m()?, request.limits.triangles);
        Ok(Self::of(DrawnScene::read(source, &request.selection, detail, progress)?))
    }

    pub(crate) fn of(scene: DrawnScene) -> Self {
        let tree = Mutex::new(BspTree::new(&scene.faces, scene.edges.len() as u32));
        Self { is_open: scene.open_objects(), bounds: bounds_of(scene.faces.iter()), tree, scene }
    }

    /// Estimated memory. Drawings may make it larger.
    #[must_use]
    pub fn byte_len(&self) -> usize {
        self.scene.byte_len() + self.is_open.len() + self.tree().byte_len(&self.scene.faces)
    }

    /// Lowest and highest coordinates.
    pub(crate) fn bounds(&self) -> [DVec3; 2] {
        self.bounds
    }

    /// The parts of faces in a volume that an eye may see, from the nearest to the farthest: none hides any face before it. Of closed
    /// objects, only faces towards the eye can be seen; those of open ones are turned to it. Of surfaces in one place, the first one is
    /// seen. Fails if there are more than `max_faces`.
    pub(crate) fn front_to_back(
        &self,
        eye: Eye,
        volume: &ViewVolume,
        max_faces: usize,
        progress: DrawProgress<'_>,
    ) -> Result<Vec<Face>, DrawError> {
        let is_asked = |face: &Face| self.is_seen(face, eye);
        let walk = TreeWalk { eye, volume, is_asked: &is_asked, max_faces };
        let mut tree = self.tree();
        let order = tree.front_to_back(&self.scene.faces, &walk, progress)?;
        let shown = |number: &u32| {
            let face = tree.face(&self.scene.faces, *number);
            let face = if eye.is_front(&face.plane) { face.clone() } else { turned(face) };
            clip(face, &volume.planes)
        };
        Ok(order.iter().filter_map(shown).collect())
    }

    /// Intersections of visible faces with the plane at a cut of the tree, within a view volume. `is_asked` selects the triangles.
    pub(crate) fn meetings(
        &self,
        cut: u32,
        plane: &FacePlane,
        (eye, volume): (Eye, &ViewVolume),
        is_asked: impl Fn(u32) -> bool,
    ) -> Vec<[DVec3; 2]> {
        let seen = |face: &Face| {
            let is_shown = self.is_seen(face, eye) && is_asked(face.triangle);
            is_shown.then(|| clip(face.clone(), &volume.planes)).flatten()
        };
        self.tree().meetings(&self.scene.faces, cut as usize, plane, seen)
    }

    fn is_seen(&self, face: &Face, eye: Eye) -> bool {
        eye.is_front(&face.plane) || self.is_open[self.scene.face_objects[face.triangle as usize] as usize]
    }

    fn tree(&self) -> MutexGuard<'_, BspTree> {
        self.tree.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
