//! A BSP tree of faces: from any eye, it gives them in the order of their distance (Moldoveanu, "Algoritmul BSP").
//!
//! The tree does not depend on a view, so all views of a scene share it. A set of faces is divided when a view first comes to it: what
//! no view has shown costs nothing, and a view of what others have shown costs only the walk. What is outside of the view is neither
//! divided nor walked.
//!
//! Large sets are divided by planes parallel to the axes, as in a k-d tree ("Axis Aligned BSP Tree"). Small sets are divided by the
//! plane of one of their faces. Of several planes, the one with few splits and equal parts is taken.

use crate::error::{DrawError, DrawProgress, DrawStep, advance};
use crate::face::{FACE_BYTES, Face, FacePlane, ON_PLANE_M, Side, bounds_of};
use crate::volume::ViewVolume;
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
/// The progress is told after so many faces and nodes.
const PROGRESS_WORK: usize = 1 << 16;

#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Eye {
    /// Infinitely far in this direction.
    Direction(DVec3),
    /// Metres from the scene's origin.
    Point(DVec3),
}

impl Eye {
    pub(crate) fn is_front(&self, plane: &FacePlane) -> bool {
        match self {
            Self::Direction(towards) => plane.normal.dot(*towards) > 0.0,
            Self::Point(point) => plane.height(*point) > 0.0,
        }
    }
}

/// What a view asks of a tree.
pub(crate) struct TreeWalk<'a> {
    pub(crate) eye: Eye,
    pub(crate) volume: &'a ViewVolume,
    /// Whether the view shows a face if nothing hides it.
    pub(crate) is_asked: &'a dyn Fn(&Face) -> bool,
    /// Most faces that are given, and most splits.
    pub(crate) max_faces: usize,
}

/// A BSP tree of the faces of a scene, which each call gets. Faces have numbers: first those of the scene, then the parts of those that
/// were split.
#[derive(Debug)]
pub(crate) struct BspTree {
    nodes: Vec<BspNode>,
    parts: Vec<Face>,
    first_cut: u32,
    /// Of each cut, the node whose plane made it.
    cuts: Vec<u32>,
}

#[derive(Debug)]
struct BspNode {
    /// All of its set is in here.
    bounds: [DVec3; 2],
    /// The set; once it is divided, the faces in the plane.
    faces: Vec<u32>,
    division: Option<NodeDivision>,
}

#[derive(Debug, Clone, Copy)]
struct NodeDivision {
    plane: FacePlane,
    front: u32,
    back: u32,
}

impl BspTree {
    /// The tree of a scene, undivided. The cuts get names from `first_cut` on.
    pub(crate) fn new(scene: &[Face], first_cut: u32) -> Self {
        let mut tree = Self { nodes: Vec::new(), parts: Vec::new(), first_cut, cuts: Vec::new() };
        tree.add_node(scene, (0..scene.len() as u32).collect());
        tree
    }

    /// Number of sets that were divided.
    #[cfg(test)]
    pub(crate) fn divisions(&self) -> usize {
        self.nodes.iter().filter(|node| node.division.is_some()).count()
    }

    /// Estimated memory, without the scene.
    pub(crate) fn byte_len(&self, scene: &[Face]) -> usize {
        let numbers = scene.len() + self.parts.len() + self.cuts.len();
        self.nodes.len() * size_of::<BspNode>() + self.parts.len() * FACE_BYTES + numbers * size_of::<u32>()
    }

    pub(crate) fn face<'a>(&'a self, scene: &'a [Face], number: u32) -> &'a Face {
        let number = number as usize;
        scene.get(number).unwrap_or_else(|| &self.parts[number - scene.len()])
    }

    /// Where faces pass through a plane at a cut, or the parts of them that `seen` gives. The cut itself goes on to the ends of the face
    /// that was cut, beyond those of the faces that have cut it.
    pub(crate) fn meetings(
        &self,
        scene: &[Face],
        cut: usize,
        plane: &FacePlane,
        seen: impl Fn(&Face) -> Option<Face>,
    ) -> Vec<[DVec3; 2]> {
        let node = self.cuts.get(cut).and_then(|node| self.nodes.get(*node as usize));
        let faces = node.into_iter().flat_map(|node| &node.faces).map(|number| self.face(scene, *number));
        faces.filter_map(|face| seen(face)?.meeting(plane)).collect()
    }

    /// The faces that are asked for, from the nearest to the farthest: none hides any face before it. Of those in one plane, the ones
    /// towards the eye come first. Fails if there are too many.
    pub(crate) fn front_to_back(
        &mut self,
        scene: &[Face],
        walk: &TreeWalk<'_>,
        progress: DrawProgress<'_>,
    ) -> Result<Vec<u32>, DrawError> {
        let (cuts, mut work) = (self.cuts.len(), 0);
        let mut order: Vec<u32> = Vec::new();
        // A node, and whether its nearer side is done.
        let mut waiting = vec![(0u32, false)];
        while let Some((index, is_half_done)) = waiting.pop() {
            let Some(node) = self.nodes.get(index as usize) else { continue };
            work += 1;
            if is_half_done {
                let asked = node.faces.iter().copied().filter(|number| (walk.is_asked)(self.face(scene, *number)));
                let is_front = |number: &u32| walk.eye.is_front(&self.face(scene, *number).plane);
                let (fronts, backs): (Vec<u32>, Vec<u32>) = asked.partition(is_front);
                order.extend(fronts.into_iter().chain(backs));
            } else if walk.volume.meets(node.bounds) {
                work += if node.division.is_none() { node.faces.len() } else { 0 };
                self.enter(scene, index, walk, &mut waiting);
            }
            if order.len().max(self.cuts.len() - cuts) > walk.max_faces {
                return Err(DrawError::TooManyParts { limit: walk.max_faces });
            }
            if work >= PROGRESS_WORK {
                work = 0;
                advance(progress, DrawStep::Sort, (order.len() as f64 / scene.len() as f64).min(1.0))?;
            }
        }
        Ok(order)
    }

    /// Puts what a view may see of a node onto `waiting`, the nearer side last. A side that has nothing of the view's volume is left out.
    fn enter(&mut self, scene: &[Face], index: u32, walk: &TreeWalk<'_>, waiting: &mut Vec<(u32, bool)>) {
        let known = self.nodes[index as usize].division;
        let NodeDivision { plane, front, back } = known.unwrap_or_else(|| self.divide(scene, index));
        let [is_front_seen, is_back_seen] = walk.volume.sides(&plane);
        let (front, back) = (is_front_seen.then_some((front, false)), is_back_seen.then_some((back, false)));
        let (near, far) = if walk.eye.is_front(&plane) { (front, back) } else { (back, front) };
        waiting.extend(far);
        waiting.extend((is_front_seen && is_back_seen).then_some((index, true)));
        waiting.extend(near);
    }

    fn divide(&mut self, scene: &[Face], index: u32) -> NodeDivision {
        let numbers = std::mem::take(&mut self.nodes[index as usize].faces);
        let set: Vec<&Face> = numbers.iter().map(|number| self.face(scene, *number)).collect();
        let plane = choose_plane(&set);
        let sides: Vec<Side> = set.iter().map(|face| face.side(&plane)).collect();
        let (mut on, mut front, mut back) = (Vec::new(), Vec::new(), Vec::new());
        for (number, side) in numbers.into_iter().zip(sides) {
            match side {
                Side::On => on.push(number),
                Side::Front => front.push(number),
                Side::Back => back.push(number),
                Side::Both => {
                    let [before, behind] = self.split(scene, number, &plane, index);
                    front.extend(before);
                    back.extend(behind);
                }
            }
        }
        // Rounding can leave a face of almost no area beside its own plane, which would divide the same set for ever.
        if on.is_empty() && (front.is_empty() || back.is_empty()) {
            on.extend(front.drain(..).chain(back.drain(..)));
        }
        let (front, back) = (self.add_node(scene, front), self.add_node(scene, back));
        let division = NodeDivision { plane, front, back };
        let node = &mut self.nodes[index as usize];
        (node.faces, node.division) = (on, Some(division));
        division
    }

    /// The parts of a face in front of the plane of a node and behind it.
    fn split(&mut self, scene: &[Face], number: u32, plane: &FacePlane, node: u32) -> [Option<u32>; 2] {
        let cut = self.first_cut.saturating_add(self.cuts.len() as u32);
        self.cuts.push(node);
        let halves = self.face(scene, number).split(plane, cut);
        // A part that is split itself gives up its place.
        let mut free = (number as usize).checked_sub(scene.len());
        halves.map(|half| {
            let half = half?;
            let place = match free.take() {
                Some(place) => {
                    self.parts[place] = half;
                    place
                }
                None => {
                    self.parts.push(half);
                    self.parts.len() - 1
                }
            };
            Some((scene.len() + place) as u32)
        })
    }

    fn add_node(&mut self, scene: &[Face], faces: Vec<u32>) -> u32 {
        if faces.is_empty() {
            return NO_NODE;
        }
        let bounds = bounds_of(faces.iter().map(|number| self.face(scene, *number)));
        self.nodes.push(BspNode { bounds, faces, division: None });
        self.nodes.len() as u32 - 1
    }
}

/// The plane by which a set is divided: at least one face is on it, or not all are on one side.
fn choose_plane(faces: &[&Face]) -> FacePlane {
    let axis = if faces.len() > MAX_OWN_PLANES { axis_plane(faces) } else { None };
    axis.unwrap_or_else(|| best_face(faces).plane)
}

/// Lowest and highest coordinate of a face along an axis.
fn extent(face: &Face, axis: usize) -> [f64; 2] {
    face.points.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], p| [low.min(p[axis]), high.max(p[axis])])
}

/// The best plane parallel to the axes; `None` if each splits too many faces or leaves almost all on one side.
fn axis_plane(faces: &[&Face]) -> Option<FacePlane> {
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

fn best_face<'a>(faces: &[&'a Face]) -> &'a Face {
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
    let tried = std::iter::once(first).chain(others).map(|index| faces[index]);
    tried.min_by_key(|face| cost(&face.plane)).unwrap_or(faces[0])
}
