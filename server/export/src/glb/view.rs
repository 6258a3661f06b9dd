//! What of a city a camera sees: the nodes in its frustum, each as coarse as the error on the screen allows.

use super::reach::Reach;
use super::{ExportError, boxes, mesh_of, subtree_at};
use crate::camera::ExportCamera;
use crate::source::ExportSource;
use glam::{DAffine3, DMat3, DVec3, Vec3};
use insula_protocol::subtree::NodeInfo;
use insula_protocol::{Manifest, Subtree, TileId};
use std::collections::HashMap;

/// Nothing is nearer to the eye than this, in metres.
pub(super) const NEAR_M: f64 = 0.1;

/// A camera with the picture that it makes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ExportView {
    camera: ExportCamera,
    position: DVec3,
    axes: DMat3,
    size_px: [u32; 2],
    /// Tolerated error on the screen in pixels.
    pub(super) tau_px: f64,
}

/// A part of a city that a view shows.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Part {
    /// The columns of a node, or instead of them its meshes, whichever has fewer triangles.
    Columns {
        node: TileId,
        meshes: Option<NodeMeshes>,
    },
    Mesh(ViewMesh),
}

/// A leaf's mesh at the level of detail that a view needs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct ViewMesh {
    pub(super) leaf: TileId,
    pub(super) lod: u8,
}

/// The meshes of all leaves below a node that a view shows.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(super) struct NodeMeshes {
    pub(super) meshes: Vec<ViewMesh>,
    pub(super) triangles: usize,
}

/// Levels between a node and its leaves, at most, if their meshes may stand for the node. Further up, they are rarely fewer triangles
/// than boxes, and many to read.
const MESH_LEVELS: u8 = 2;

/// Share of the tolerated error that a level of detail of a mesh may have. The rest is for the surface that stands for its terrain.
const MESH_SHARE: f64 = 0.5;

struct Nodes<'s> {
    subtree: &'s Subtree,
    by_id: HashMap<TileId, &'s NodeInfo>,
}

impl ExportView {
    /// `None` if the camera has no direction, or a value is out of range.
    #[must_use]
    pub fn new(camera: ExportCamera, size_px: [u32; 2], tau_px: f64) -> Option<Self> {
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

    /// Largest error in metres that the view tolerates in a box.
    fn allowed_m(&self, [low, high]: [DVec3; 2]) -> f64 {
        let distance = self.position.distance(self.position.clamp(low, high));
        self.tau_px * distance.max(NEAR_M) / self.focal_px()
    }

    /// Pixels that an error of a metre covers in a box. Corners are metres from `origin`, in world metres.
    pub(super) fn pixels_of_metre(&self, origin: [f64; 3], [low, high]: [Vec3; 2]) -> f32 {
        let eye = (self.position - DVec3::from(origin)).as_vec3();
        self.focal_px() as f32 / eye.distance(eye.clamp(low, high)).max(NEAR_M as f32)
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
    pub(super) fn matrix(&self, origin: [f64; 3]) -> DAffine3 {
        let place = self.position - DVec3::from(origin);
        DAffine3::from_cols(self.axes.x_axis, self.axes.y_axis, -self.axes.z_axis, place)
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
            let by_id = subtree.nodes.iter().map(|node| (node.id, node)).collect();
            let nodes = Nodes { subtree: &subtree, by_id };
            let mut open = vec![root];
            while let Some(id) = open.pop() {
                let Some(node) = nodes.by_id.get(&id) else { continue };
                match self.choice(source.manifest(), &subtree, node) {
                    Choice::Nothing => {}
                    _ if !reach.has(node.id) => {}
                    // The nodes below it are in its own subtree.
                    Choice::Columns
                        if id != root && may_have_meshes(source.manifest(), node) && Subtree::is_root(id) =>
                    {
                        roots.push(id);
                    }
                    Choice::Columns => {
                        let meshes = self.meshes_below(source.manifest(), &nodes, node, reach);
                        parts.push(Part::Columns { node: node.id, meshes });
                    }
                    Choice::Mesh(mesh, _) => parts.push(Part::Mesh(mesh)),
                    Choice::Refine if node.id != root && Subtree::is_root(node.id) => roots.push(node.id),
                    Choice::Refine => open.extend(children(node)),
                }
            }
        }
        Ok(parts)
    }

    /// The meshes of a node's leaves; `None` for leaves, if one has no mesh, or if they are far below or in other subtrees.
    fn meshes_below(
        &self,
        manifest: &Manifest,
        nodes: &Nodes<'_>,
        node: &NodeInfo,
        reach: &Reach<'_>,
    ) -> Option<NodeMeshes> {
        if !may_have_meshes(manifest, node) {
            return None;
        }
        let mut found = NodeMeshes::default();
        let mut open: Vec<TileId> = children(node).collect();
        while let Some(id) = open.pop() {
            let child = nodes.by_id.get(&id)?;
            if child.child_mask & 0xf != 0 {
                open.extend(children(child));
                continue;
            }
            match self.choice(manifest, nodes.subtree, child) {
                Choice::Nothing => {}
                _ if !reach.has(id) => {}
                Choice::Mesh(mesh, triangles) => {
                    found.meshes.push(mesh);
                    found.triangles += triangles;
                }
                _ => return None,
            }
        }
        Some(found)
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
            return if is_exact { Choice::Columns } else { Choice::Refine };
        }
        match mesh_of(subtree, node).filter(|mesh| !mesh.lods.is_empty()) {
            Some(mesh) => {
                let is_exact = |error_m: f32| f64::from(error_m) <= MESH_SHARE * allowed_m;
                let lod = mesh.lods.iter().rposition(|lod| is_exact(lod.error_m)).unwrap_or(0);
                Choice::Mesh(ViewMesh { leaf: node.id, lod: lod as u8 }, mesh.lods[lod].triangles as usize)
            }
            None if has_columns => Choice::Columns,
            None => Choice::Nothing,
        }
    }
}

/// Whether the meshes of a node's leaves may stand for the node.
fn may_have_meshes(manifest: &Manifest, node: &NodeInfo) -> bool {
    node.child_mask & 0xf != 0 && node.id.level() + MESH_LEVELS >= manifest.depth
}

fn children(node: &NodeInfo) -> impl Iterator<Item = TileId> {
    let mask = node.child_mask;
    node.id.children().filter(move |child| mask >> child.quadrant() & 1 == 1)
}

/// What becomes of a node.
enum Choice {
    Nothing,
    Columns,
    /// With the number of its triangles.
    Mesh(ViewMesh, usize),
    /// Its children are shown.
    Refine,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::glb::test_city::city;
    use crate::selection::ObjectSelection;
    use insula_protocol::subtree::NodeMesh;

    /// Looks north from a place in metres from the corner of the test city.
    fn view(at: [f64; 3], tau_px: f64) -> ExportView {
        let position = [1000.0 + at[0], 2000.0 + at[1], 30.0 + at[2]];
        let target = [position[0], position[1] + 100.0, position[2]];
        let camera = ExportCamera { position, target, up: [0.0, 0.0, 1.0], fov_y_deg: 60.0 };
        ExportView::new(camera, [1280, 720], tau_px).unwrap()
    }

    fn parts(view: &ExportView) -> Vec<Part> {
        let (city, everything) = (city(), ObjectSelection::default());
        let mut parts = view.parts(&city, &Reach::new(&city, &everything).unwrap()).unwrap();
        parts.sort_by_key(|part| match part {
            Part::Columns { node, .. } | Part::Mesh(ViewMesh { leaf: node, .. }) => *node,
        });
        parts
    }

    #[test]
    fn near_nodes_are_leaves_and_far_ones_are_columns() {
        let leaf = |x, y| TileId::new(1, x, y).unwrap();
        let mesh = |x| Part::Mesh(ViewMesh { leaf: leaf(x, 0), lod: 0 });
        let columns = |node| Part::Columns { node, meshes: None };
        let leaves = [mesh(0), columns(leaf(0, 1)), mesh(1), columns(leaf(1, 1))];
        assert_eq!(parts(&view([64.0, -20.0, 10.0], 1.0)), leaves);
        // The root's error is 1.74 m and a cell of 2 m: 2.74 m are a pixel at 1.7 km.
        assert_eq!(parts(&view([64.0, -1600.0, 10.0], 1.0)).len(), 4);
        assert_eq!(parts(&view([64.0, -1800.0, 10.0], 1.0)), [columns(TileId::ROOT)]);
    }

    #[test]
    fn a_far_node_has_the_meshes_of_its_leaves_as_a_choice() {
        let mut city = city();
        let leaves: Vec<TileId> = TileId::ROOT.children().collect();
        let subtree = city.subtrees.get_mut(&TileId::ROOT).unwrap();
        let lods = subtree.meshes[0].lods.clone();
        subtree.meshes = leaves.iter().map(|leaf| NodeMesh { id: *leaf, lods: lods.clone() }).collect();
        let everything = ObjectSelection::default();
        let parts = view([64.0, -1800.0, 10.0], 1.0).parts(&city, &Reach::new(&city, &everything).unwrap()).unwrap();
        let [Part::Columns { node: TileId::ROOT, meshes: Some(found) }] = &parts[..] else { panic!("{parts:?}") };
        assert_eq!((found.meshes.len(), found.triangles), (4, 48));
    }

    #[test]
    fn nodes_out_of_the_frame_are_left_out() {
        assert_eq!(parts(&view([64.0, 200.0, 10.0], 1.0)), []);
        // The southern leaves are behind the eye.
        let north = [0, 1].map(|x| Part::Columns { node: TileId::new(1, x, 1).unwrap(), meshes: None });
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
        assert!(ExportView::new(ExportCamera { fov_y_deg: f64::NAN, ..camera }, [1280, 720], 1.0).is_none());
    }
}
