//! What of a city a camera sees: the nodes in its frustum, each as coarse as the error on the screen allows.

use super::{ExportError, boxes, matrix::Matrix, reach::Reach, subtree_at};
use crate::{camera::CameraFile, source::ExportSource};
use glam::{DMat3, DVec3, Vec3};
use insula_protocol::{Manifest, Subtree, TileId, subtree::NodeInfo};
use std::collections::HashMap;

/// Nothing is nearer to the eye than this, in metres.
pub(super) const NEAR_M: f64 = 0.1;

/// A camera with the picture that it makes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ExportView {
    camera: CameraFile,
    position: DVec3,
    axes: DMat3,
    size_px: [u32; 2],
    /// Tolerated error on the screen in pixels.
    tau_px: f64,
}

/// A part of a city that a view shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Part {
    Columns(TileId),
    Mesh { leaf: TileId, lod: u8 },
}

impl ExportView {
    /// `None` if the camera has no direction, or a value is out of range.
    #[must_use]
    pub fn new(camera: CameraFile, size_px: [u32; 2], tau_px: f64) -> Option<Self> {
        let axes = camera.axes()?;
        let is_valid = size_px.iter().all(|side| *side > 0) && tau_px > 0.0 && tau_px.is_finite();
        is_valid.then_some(Self { camera, position: camera.position.into(), axes, size_px, tau_px })
    }

    /// Width by height.
    fn aspect(&self) -> f64 {
        f64::from(self.size_px[0]) / f64::from(self.size_px[1])
    }

    /// Pixels that a metre covers at a distance of one metre.
    fn focal_px(&self) -> f64 {
        0.5 * f64::from(self.size_px[1]) / (0.5 * self.camera.fov_y_deg).to_radians().tan()
    }

    /// Tolerated error in metres of what is in a box.
    fn allowed_m(&self, [low, high]: [DVec3; 2]) -> f64 {
        let distance = self.position.distance(self.position.clamp(low, high));
        self.tau_px * distance.max(NEAR_M) / self.focal_px()
    }

    /// Pixels that an error of a metre covers in a box. Corners are metres from `origin`, in world metres.
    pub(super) fn pixels_of_metre(&self, origin: [f64; 3], [low, high]: [Vec3; 2]) -> f32 {
        let eye = (self.position - DVec3::from(origin)).as_vec3();
        self.focal_px() as f32 / eye.distance(eye.clamp(low, high)).max(NEAR_M as f32)
    }

    pub(super) fn tau_px(&self) -> f64 {
        self.tau_px
    }

    /// Whether a box may be in the frame. Never false if a part of it is.
    fn may_see(&self, [low, high]: [DVec3; 2]) -> bool {
        let tan_y = (0.5 * self.camera.fov_y_deg).to_radians().tan();
        let tan_x = tan_y * self.aspect();
        let [right, up, forward] = [self.axes.x_axis, self.axes.y_axis, self.axes.z_axis];
        let inwards =
            [forward, forward * tan_x + right, forward * tan_x - right, forward * tan_y + up, forward * tan_y - up];
        inwards.iter().all(|normal| {
            // The corner that is furthest inside.
            let corner = DVec3::select(normal.cmpge(DVec3::ZERO), high, low);
            normal.dot(corner - self.position) >= 0.0
        })
    }

    /// The camera in coordinates whose origin is at `origin`, in world metres: it looks along -z, y is up (glTF 2.0, section 3.10).
    pub(super) fn matrix(&self, origin: [f64; 3]) -> Matrix {
        let axes = [self.axes.x_axis, self.axes.y_axis, -self.axes.z_axis].map(|axis| axis.to_array());
        Matrix { axes, origin: (self.position - DVec3::from(origin)).to_array() }
    }

    /// Vertical field of view in radians, and width by height.
    pub(super) fn lens(&self) -> [f64; 2] {
        [self.camera.fov_y_deg.to_radians(), self.aspect()]
    }

    /// What the view shows of the nodes that `reach` has, in no order. Fails if a subtree cannot be read.
    pub(super) fn parts(&self, source: &dyn ExportSource, reach: &Reach<'_>) -> Result<Vec<Part>, ExportError> {
        let mut parts = Vec::new();
        let mut roots = vec![TileId::ROOT];
        while let Some(root) = roots.pop() {
            let subtree = subtree_at(source, root)?;
            let nodes: HashMap<TileId, &NodeInfo> = subtree.nodes.iter().map(|node| (node.id, node)).collect();
            let mut open = vec![root];
            while let Some(id) = open.pop() {
                let Some(node) = nodes.get(&id) else { continue };
                match self.choice(source.manifest(), &subtree, node) {
                    Choice::Nothing => {}
                    _ if !reach.has(node.id) => {}
                    Choice::Show(part) => parts.push(part),
                    Choice::Refine if node.id != root && Subtree::is_root(node.id) => roots.push(node.id),
                    Choice::Refine => {
                        let has = |child: &TileId| node.child_mask >> child.quadrant() & 1 == 1;
                        open.extend(node.id.children().filter(has));
                    }
                }
            }
        }
        Ok(parts)
    }

    fn choice(&self, manifest: &Manifest, subtree: &Subtree, node: &NodeInfo) -> Choice {
        let corner = DVec3::from(manifest.node_corner(node.id));
        let side = manifest.node_side_m(node.id.level());
        let heights = [node.z_min_m, node.z_max_m].map(|z| manifest.origin[2] + f64::from(z));
        let bounds = [corner.with_z(heights[0]), DVec3::new(corner.x + side, corner.y + side, heights[1])];
        if !self.may_see(bounds) {
            return Choice::Nothing;
        }
        let allowed_m = self.allowed_m(bounds);
        let moved_m = boxes::ERROR_CELLS * manifest.cell_m_at(node.id.level());
        let has_columns = node.blockmap_bytes > 0;
        if node.child_mask & 0xf != 0 {
            let is_exact = has_columns && f64::from(node.error_m) + moved_m <= allowed_m;
            return if is_exact { Choice::Show(Part::Columns(node.id)) } else { Choice::Refine };
        }
        let mesh = subtree.meshes.iter().find(|mesh| mesh.id == node.id && !mesh.lods.is_empty());
        match mesh {
            Some(mesh) => {
                let lod = mesh.lods.iter().rposition(|lod| f64::from(lod.error_m) <= allowed_m).unwrap_or(0) as u8;
                Choice::Show(Part::Mesh { leaf: node.id, lod })
            }
            None if has_columns => Choice::Show(Part::Columns(node.id)),
            None => Choice::Nothing,
        }
    }
}

/// What becomes of a node.
enum Choice {
    Nothing,
    Show(Part),
    /// Its children are shown.
    Refine,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{glb::test_city::city, selection::ObjectSelection};

    /// Looks north from a place in metres from the corner of the test city.
    fn view(at: [f64; 3], tau_px: f64) -> ExportView {
        let position = [1000.0 + at[0], 2000.0 + at[1], 30.0 + at[2]];
        let target = [position[0], position[1] + 100.0, position[2]];
        let camera = CameraFile { position, target, up: [0.0, 0.0, 1.0], fov_y_deg: 60.0 };
        ExportView::new(camera, [1280, 720], tau_px).unwrap()
    }

    fn parts(view: &ExportView) -> Vec<Part> {
        let (city, everything) = (city(), ObjectSelection::default());
        let mut parts = view.parts(&city, &Reach::new(&city, &everything).unwrap()).unwrap();
        parts.sort_by_key(|part| match part {
            Part::Columns(node) | Part::Mesh { leaf: node, .. } => *node,
        });
        parts
    }

    #[test]
    fn near_nodes_are_leaves_and_far_ones_are_columns() {
        let leaf = |x, y| TileId::new(1, x, y).unwrap();
        let mesh = |x| Part::Mesh { leaf: leaf(x, 0), lod: 0 };
        let leaves = [mesh(0), Part::Columns(leaf(0, 1)), mesh(1), Part::Columns(leaf(1, 1))];
        assert_eq!(parts(&view([64.0, -20.0, 10.0], 1.0)), leaves);
        // The root's error is 1.74 m and a cell of 2 m: 2.74 m are a pixel at 1.7 km.
        assert_eq!(parts(&view([64.0, -1600.0, 10.0], 1.0)).len(), 4);
        assert_eq!(parts(&view([64.0, -1800.0, 10.0], 1.0)), [Part::Columns(TileId::ROOT)]);
    }

    #[test]
    fn nodes_out_of_the_frame_are_left_out() {
        assert_eq!(parts(&view([64.0, 200.0, 10.0], 1.0)), []);
        // The southern leaves are behind the eye.
        let north = [Part::Columns(TileId::new(1, 0, 1).unwrap()), Part::Columns(TileId::new(1, 1, 1).unwrap())];
        assert_eq!(parts(&view([64.0, 70.0, 10.0], 1.0)), north);
        // Above a narrow frame.
        let high = view([64.0, -20.0, 400.0], 1.0);
        assert_eq!(parts(&high), []);
    }

    #[test]
    fn invalid_views_are_refused() {
        let camera = view([0.0; 3], 1.0).camera;
        assert!(ExportView::new(camera, [0, 720], 1.0).is_none());
        assert!(ExportView::new(camera, [1280, 720], 0.0).is_none());
        assert!(ExportView::new(CameraFile { fov_y_deg: f64::NAN, ..camera }, [1280, 720], 1.0).is_none());
    }
}
