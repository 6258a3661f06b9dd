//! Geometry that objects share: templates of implicit geometry and surfaces of other objects.

use insula_source::object::{Surface, TriangleMesh};
use std::collections::HashMap;
use std::rc::Rc;

/// Shared geometry with more points is left out.
const MAX_STORED_POINTS: usize = 2 << 20;

/// Surfaces that are ready for use, in their own coordinates.
#[derive(Debug, Default)]
pub(super) struct StoredGeometry {
    pub(super) polygons: Vec<Surface>,
    pub(super) meshes: Vec<TriangleMesh>,
    /// Number of points.
    pub(super) points: usize,
}

/// Shared geometry by the hash of its identifier.
#[derive(Debug, Default)]
pub(super) struct Store {
    geometries: HashMap<u64, Rc<StoredGeometry>>,
    points: usize,
    /// Coordinate system of the file, where nothing else tells.
    srs: Option<String>,
}

impl Store {
    pub(super) fn get(&self, id: u64) -> Option<Rc<StoredGeometry>> {
        self.geometries.get(&id).cloned()
    }

    /// Keeps geometry, unless there is some of that identifier or too much already.
    pub(super) fn insert(&mut self, id: u64, polygons: Vec<Surface>, meshes: Vec<TriangleMesh>) {
        let of_polygons = polygons.iter().map(|surface| surface.points.len());
        let of_meshes = meshes.iter().map(|mesh| mesh.positions.len());
        let points = of_polygons.chain(of_meshes).sum::<usize>().max(1);
        if self.points + points > MAX_STORED_POINTS || self.geometries.contains_key(&id) {
            return;
        }
        self.points += points;
        self.geometries.insert(id, Rc::new(StoredGeometry { polygons, meshes, points }));
    }

    pub(super) fn srs(&self) -> Option<&str> {
        self.srs.as_deref()
    }

    pub(super) fn set_srs(&mut self, srs: &str) {
        self.srs = Some(srs.to_owned());
    }
}
