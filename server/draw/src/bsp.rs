//! A BSP tree of faces: from any eye, it gives them in the order of their distance (Moldoveanu, "Algoritmul BSP").
//!
//! Large sets are divided by planes parallel to the axes, as in a k-d tree ("Axis Aligned BSP Tree"). Small sets are divided by the
//! plane of one of their faces. Of several planes, the one with few splits and equal parts is taken.

use crate::{
    error::{DrawError, DrawProgress, DrawStep, advance},
    face::{Face, FacePlane, ON_PLANE_M, Side},
};
use glam::DVec3;

/// Sets of more faces are divided by planes parallel to the axes.
const MAX_OWN_PLANES: usize = 64;
/// Planes that are tried for each axis.
const AXIS_PLANES: usize = 32;
/// Planes of faces that are tried: all of small sets.
const FACE_PLANES: usize = 64;
/// What a split costs, in faces of imbalance.
const SPLIT_COST: usize = 10;
/// At least this part of a set must be off the larger side of a plane parallel to the axes.
const LEAST_SIDE: usize = 16;
/// At most this part of a set may be split by such a plane: faces of small sets are split less by their own planes.
const MOST_SPLITS: usize = 48;
const NO_NODE: u32 = u32::MAX;

/// Where the eye is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Eye {
    /// Infinitely far in this direction.
    Direction(DVec3),
    /// Metres from the scene's origin.
    Point(DVec3),
}

impl Eye {
    /// Whether the eye is in front of a plane.
    pub(crate) fn is_front(&self, plane: &FacePlane) -> bool {
        match self {
            Self::Direction(towards) => plane.normal.dot(*towards) > 0.0,
            Self::Point(point) => plane.height(*point) > 0.0,
        }
    }
}

/// A BSP tree of faces.
#[derive(Debug, Default)]
pub(crate) struct BspTree {
    nodes: Vec<BspNode>,
    /// Of each cut, the node whose plane made it.
    cuts: Vec<u32>,
}

#[derive(Debug)]
struct BspNode {
    plane: FacePlane,
    /// Faces in the plane.
    faces: Vec<Face>,
    front: u32,
    back: u32,
}

impl BspTree {
    /// Builds the tree. The cuts get names from `first_cut` on. Fails if there are more than `max_faces` after the splits.
    pub(crate) fn new(
        faces: Vec<Face>,
        first_cut: u32,
        max_faces: usize,
        progress: DrawProgress<'_>,
    ) -> Result<Self, DrawError> {
        let mut tree = Self { nodes: Vec::new(), cuts: Vec::new() };
        let all = faces.len().max(1);
        let (mut placed, mut total) = (0, faces.len());
        // A set that is still to be divided, and the node and side below which it is.
        let mut waiting = vec![(faces, NO_NODE, false)];
        while let Some((faces, parent, is_front)) = waiting.pop() {
            if faces.is_empty() {
                continue;
            }
            let index = tree.nodes.len() as u32;
            if let Some(parent) = tree.nodes.get_mut(parent as usize) {
                *if is_front { &mut parent.front } else { &mut parent.back } = index;
            }
            let plane = choose_plane(&faces);
            let mut node = BspNode { plane, faces: Vec::new(), front: NO_NODE, back: NO_NODE };
            let (mut front, mut back) = (Vec::new(), Vec::new());
            for face in faces {
                match face.side(&plane) {
                    Side::On => node.faces.push(face),
                    Side::Front => front.push(face),
                    Side::Back => back.push(face),
                    Side::Both => {
                        total += 1;
                        let [before, behind] = face.split(&plane, first_cut.saturating_add(tree.cuts.len() as u32));
                        tree.cuts.push(index);
                        front.extend(before);
                        back.extend(behind);
                    }
                }
            }
            if total > max_faces {
                return Err(DrawError::TooManyParts { limit: max_faces });
            }
            if placed / 4096 != (placed + node.faces.len()) / 4096 {
                advance(progress, DrawStep::Sort, (placed as f64 / all as f64).min(1.0))?;
            }
            placed += node.faces.len();
            tree.nodes.push(node);
            waiting.push((front, index, true));
            waiting.push((back, index, false));
        }
        Ok(tree)
    }

    /// Number of faces.
    pub(crate) fn len(&self) -> usize {
        self.nodes.iter().map(|node| node.faces.len()).sum()
    }

    /// Where faces of which `is_asked` holds pass through a plane at a cut. The cut itself goes on to the ends of the face that was
    /// cut, beyond those of the faces that have cut it.
    pub(crate) fn meetings(&self, cut: usize, plane: &FacePlane, is_asked: impl Fn(&Face) -> bool) -> Vec<[DVec3; 2]> {
        let node = self.cuts.get(cut).and_then(|node| self.nodes.get(*node as usize));
        let faces = node.into_iter().flat_map(|node| &node.faces).filter(|face| is_asked(face));
        faces.filter_map(|face| face.meeting(plane)).collect()
    }

    /// The faces from the nearest to the farthest: none hides any face before it.
    pub(crate) fn front_to_back(&self, eye: Eye) -> impl Iterator<Item = &Face> {
        let mut waiting = vec![(0u32, false)];
        std::iter::from_fn(move || {
            while let Some((index, is_entered)) = waiting.pop() {
                let Some(node) = self.nodes.get(index as usize) else { continue };
                if is_entered {
                    return Some(&node.faces);
                }
                let is_front = eye.is_front(&node.plane);
                let (near, far) = if is_front { (node.front, node.back) } else { (node.back, node.front) };
                waiting.extend([(far, false), (index, true), (near, false)]);
            }
            None
        })
        .flatten()
    }
}

/// The plane by which a set is divided: at least one face is on it, or not all are on one side.
fn choose_plane(faces: &[Face]) -> FacePlane {
    let axis = if faces.len() > MAX_OWN_PLANES { axis_plane(faces) } else { None };
    axis.unwrap_or_else(|| best_face(faces).plane)
}

/// Lowest and highest coordinate of a face along an axis.
fn extent(face: &Face, axis: usize) -> [f64; 2] {
    face.points.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], p| [low.min(p[axis]), high.max(p[axis])])
}

/// The best plane parallel to the axes; `None` if each splits too many faces or leaves almost all on one side.
fn axis_plane(faces: &[Face]) -> Option<FacePlane> {
    let mut best: Option<(usize, FacePlane)> = None;
    for axis in 0..3 {
        let extents: Vec<[f64; 2]> = faces.iter().map(|face| extent(face, axis)).collect();
        let mut ends: Vec<f64> = extents.iter().flatten().copied().collect();
        ends.sort_unstable_by(f64::total_cmp);
        for k in 1..=AXIS_PLANES {
            let at = ends[k * (ends.len() - 1) / (AXIS_PLANES + 1)];
            let (mut front, mut back, mut both) = (0usize, 0usize, 0usize);
            for [low, high] in &extents {
                match (*low < at - ON_PLANE_M, *high > at + ON_PLANE_M) {
                    (true, true) => both += 1,
                    (true, false) => back += 1,
                    (false, true) => front += 1,
                    (false, false) => {}
                }
            }
            let is_useful =
                front.max(back) + both <= faces.len() - faces.len() / LEAST_SIDE && both <= faces.len() / MOST_SPLITS;
            let cost = front.abs_diff(back) + SPLIT_COST * both;
            if is_useful && best.as_ref().is_none_or(|(known, _)| cost < *known) {
                let mut normal = DVec3::ZERO;
                normal[axis] = 1.0;
                best = Some((cost, FacePlane { normal, offset: at }));
            }
        }
    }
    best.map(|(_, plane)| plane)
}

/// The face with the best plane.
fn best_face(faces: &[Face]) -> &Face {
    let largest = faces.iter().enumerate().max_by(|(_, a), (_, b)| a.area_m2().total_cmp(&b.area_m2()));
    let first = largest.map_or(0, |(index, _)| index);
    let others = (0..FACE_PLANES).map(|k| k * faces.len() / FACE_PLANES);
    let cost = |plane: &FacePlane| {
        let (mut front, mut back, mut both) = (0usize, 0usize, 0usize);
        for face in faces {
            match face.side(plane) {
                Side::Front => front += 1,
                Side::Back => back += 1,
                Side::Both => both += 1,
                Side::On => {}
            }
        }
        front.abs_diff(back) + SPLIT_COST * both
    };
    let tried = std::iter::once(first).chain(others).map(|index| &faces[index]);
    tried.min_by_key(|face| cost(&face.plane)).unwrap_or(&faces[0])
}
