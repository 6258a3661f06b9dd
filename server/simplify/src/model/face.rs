//! Triangles of the faces of a file, which may have any number of corners.

use insula_dress::polygon::{Triangulator, is_fan};

/// Divides faces into triangles, with reusable buffers.
#[derive(Default)]
pub(super) struct FaceTriangles {
    triangulator: Triangulator,
    points: Vec<[f64; 3]>,
    triangles: Vec<[u32; 3]>,
}

impl FaceTriangles {
    /// The triangles of a face, as numbers of its corners, which are vertices among `positions`: a fan where that covers the face, else as
    /// the bake divides it. Faces without area are fans, too, and those with a vertex that does not exist.
    pub(super) fn of(&mut self, positions: &[[f64; 3]], corners: impl ExactSizeIterator<Item = u32>) -> &[[u32; 3]] {
        let count = corners.len();
        self.points.clear();
        if count > 3 {
            self.points.extend(corners.map_while(|corner| positions.get(corner as usize).copied()));
        }
        self.triangles.clear();
        if count > 3
            && self.points.len() == count
            && !is_fan(&self.points)
            && let Ok(found) = self.triangulator.triangulate(&self.points, &[])
        {
            self.triangles.extend_from_slice(found.list);
        } else {
            self.triangles.extend((2..count as u32).map(|corner| [0, corner - 1, corner]));
        }
        &self.triangles
    }
}
