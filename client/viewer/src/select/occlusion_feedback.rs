//! Occlusion feedback: which nodes the rays of the last frames hit, and so which nodes are occluded.
//!
//! For each frame, the ray-caster counts the pixels that hit each node of the draw list. [`OcclusionFeedback::update`] takes the
//! counts in; `OcclusionFeedback::visibility` derives the visibility of a node:
//!
//! | visibility | condition |
//! |---|---|
//! | visible | a ray hit it, or something in it, in one of the last `LINGER_FRAMES` frames; while the camera is still, see below |
//! | unknown | it lies next to a node that was hit recently, and the camera moves; or it was not wholly inside the last frame, and the camera has moved; or it was not drawn in the last frame, but lies in a node that is not occluded |
//! | occluded | it was drawn in the last frame and not hit; or it was not drawn, but lies in an occluded node |
//!
//! While the camera is still and tiles are missing, only the last frame counts: what coarse columns let through, finer ones may
//! occlude. Once a frame had all its tiles, all frames since then count: visible nodes only become more, so the frame settles.
//! Before the first feedback, all nodes are visible.

use super::cull;
use crate::camera::{FrustumPlane, View};
use crate::scene::{NodeIndex, SceneTree};
use insula_protocol::TileId;

/// Number of frames for which a node stays visible after its last hit, while the camera moves.
const LINGER_FRAMES: u32 = 12;

/// Nodes that cover a smaller share of the frame's pixels contribute nothing. At least one pixel is needed.
const MIN_PIXEL_SHARE: f64 = 1.0 / 300_000.0;

/// What is known about the visibility of a node.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Visibility {
    /// A ray hit it.
    Visible,
    /// The next frame decides.
    Unknown,
    /// It was drawn, and no ray hit it.
    Occluded,
}

/// The nodes that a frame was drawn with: the pixels that hit each are to be counted.
#[derive(Debug, Clone, PartialEq)]
pub struct OcclusionQuery {
    /// In the order of the ray-caster's nodes. A node that is drawn more than once is listed more than once.
    pub nodes: Vec<NodeIndex>,
    pub view: View,
    /// Number of the frame's draw list.
    pub generation: u64,
}

/// The hits of the last frames. Frames are numbered from 1; 0 means never.
#[derive(Debug, Clone, Default)]
pub struct OcclusionFeedback {
    frame: u32,
    /// First frame of the present view; 0 if there was no other view before.
    still_since: u32,
    /// First frame, since the camera is still, that lacked no tile.
    complete_since: Option<u32>,
    last: Option<LastFrame>,
    /// Draw list of the last frame, and the most pixels that it was drawn with.
    covered: Option<(u64, u64)>,
    /// By the nodes' slots.
    marks: Vec<NodeMarks>,
}

/// What is recorded about a node. All zero for another node than that of `node`.
#[derive(Debug, Clone, Copy, Default)]
struct NodeMarks {
    node: Option<NodeIndex>,
    /// The last frame in which it, or something in it, was hit.
    hit: u32,
    /// The last frame in which it, or something in it, was next to a node that was hit.
    near_hit: u32,
    /// The last frame in which it, or something in it, was drawn.
    drawn: u32,
    /// Pixels of the present frame. Zero outside of [`OcclusionFeedback::update`].
    pixels: u32,
}

#[derive(Debug, Clone)]
struct LastFrame {
    view: View,
    planes: [FrustumPlane; 5],
}

impl OcclusionFeedback {
    /// Takes in a frame. `pixels` holds the pixels that hit each node of `query`; `is_complete` is whether no tile was
    /// missing.
    pub fn update(&mut self, query: &OcclusionQuery, pixels: &[u32], is_complete: bool, tree: &SceneTree) {
        let frame_pixels = u64::from(query.view.width_px) * u64::from(query.view.height_px);
        self.begin_frame(query, frame_pixels, is_complete);
        self.marks.resize(tree.slots(), NodeMarks::default());
        let known = || query.nodes.iter().zip(pixels).filter(|(node, _)| tree.is_known(**node));
        for (node, pixels) in known() {
            self.marks_mut(*node).pixels += *pixels;
        }
        let min_pixels = ((frame_pixels as f64 * MIN_PIXEL_SHARE) as u32).max(1);
        for (node, _) in known() {
            self.mark_with_ancestors(tree, Some(*node), |marks| &mut marks.drawn);
            if std::mem::take(&mut self.marks_mut(*node).pixels) >= min_pixels {
                self.mark_with_ancestors(tree, Some(*node), |marks| &mut marks.hit);
                for neighbour in neighbours(tree.node(*node).id) {
                    self.mark_with_ancestors(tree, tree.find(neighbour), |marks| &mut marks.near_hit);
                }
            }
        }
    }

    /// What is recorded about a known node. Drops what was recorded about an evicted one in its slot.
    fn marks_mut(&mut self, node: NodeIndex) -> &mut NodeMarks {
        let marks = &mut self.marks[node.slot()];
        if marks.node != Some(node) {
            *marks = NodeMarks { node: Some(node), ..NodeMarks::default() };
        }
        marks
    }

    /// Marks a node and its ancestors with the present frame.
    fn mark_with_ancestors(
        &mut self,
        tree: &SceneTree,
        mut node: Option<NodeIndex>,
        field: impl Fn(&mut NodeMarks) -> &mut u32,
    ) {
        let frame = self.frame;
        while let Some(index) = node {
            let mark = field(self.marks_mut(index));
            if *mark == frame {
                return;
            }
            *mark = frame;
            node = tree.node(index).parent;
        }
    }

    /// What is recorded about a node.
    fn marks(&self, node: NodeIndex) -> NodeMarks {
        self.marks.get(node.slot()).filter(|marks| marks.node == Some(node)).copied().unwrap_or_default()
    }

    fn begin_frame(&mut self, query: &OcclusionQuery, frame_pixels: u64, is_complete: bool) {
        // Before the first frame, there is no camera to compare with.
        let is_same_view = self.last.as_ref().is_none_or(|last| has_same_rays(&last.view, &query.view));
        self.frame += 1;
        self.still_since = if is_same_view { self.still_since } else { self.frame };
        self.complete_since = self.complete_since.filter(|_| is_same_view).or(is_complete.then_some(self.frame));
        self.last = Some(LastFrame { view: query.view, planes: query.view.planes() });
        let before = self.covered.filter(|(generation, _)| *generation == query.generation);
        self.covered = Some((query.generation, frame_pixels.max(before.map_or(0, |(_, most)| most))));
    }

    /// A copy for another view, of which there is no frame yet.
    pub(crate) fn for_other_view(&self) -> Self {
        Self { covered: None, ..self.clone() }
    }

    /// Whether any frame was taken in.
    pub fn has_feedback(&self) -> bool {
        self.frame > 0
    }

    /// Whether the last frame was of draw list `generation`, with at least as many pixels as `size_px`.
    pub fn covers(&self, generation: u64, size_px: [u32; 2]) -> bool {
        let pixels = size_px.map(u64::from).iter().product();
        self.covered.is_some_and(|(covered, most)| covered == generation && most >= pixels)
    }

    /// Whether the last two frames were of this view (or the only one was): nothing new will come into view.
    pub(super) fn is_camera_still(&self, view: &View) -> bool {
        self.still_since < self.frame && self.last.as_ref().is_some_and(|last| has_same_rays(&last.view, view))
    }

    /// Whether a ray has hit a node, or something in it, since the camera is still.
    pub(super) fn was_visible(&self, node: NodeIndex) -> bool {
        self.marks(node).hit >= self.still_since.max(1)
    }

    /// The visibility of a node in `view`; `parent` is that of its parent.
    pub(super) fn visibility(&self, index: NodeIndex, tree: &SceneTree, view: &View, parent: Visibility) -> Visibility {
        let Some(last) = &self.last else { return Visibility::Visible };
        let marks = self.marks(index);
        let is_recent = |frame: u32| frame >= self.first_frame();
        if is_recent(marks.hit) {
            return Visibility::Visible;
        }
        let node = tree.node(index);
        let is_near_hit = is_recent(marks.near_hit) && !self.is_camera_still(view);
        let was_inside_last_frame =
            || has_same_rays(&last.view, view) || cull::is_box_inside_view(&last.planes, node.centre, node.half);
        if is_near_hit || !was_inside_last_frame() {
            return Visibility::Unknown;
        }
        match marks.drawn {
            frame if frame == self.frame => Visibility::Occluded,
            _ if parent == Visibility::Occluded => Visibility::Occluded,
            _ => Visibility::Unknown,
        }
    }

    /// The first frame whose hits count.
    fn first_frame(&self) -> u32 {
        let is_still = self.still_since < self.frame;
        let recent = if is_still { self.frame } else { self.frame.saturating_sub(LINGER_FRAMES - 1) };
        self.complete_since.unwrap_or(u32::MAX).min(recent).max(1)
    }
}

/// The up to eight nodes around a node, on its level.
fn neighbours(id: TileId) -> impl Iterator<Item = TileId> {
    let offsets = (0..9u32).filter(|i| *i != 4).map(|i| (i % 3, i / 3));
    offsets.filter_map(move |(dx, dy)| {
        TileId::new(id.level(), (id.x() + dx).checked_sub(1)?, (id.y() + dy).checked_sub(1)?)
    })
}

/// Whether two views have the same rays, except for their number.
fn has_same_rays(a: &View, b: &View) -> bool {
    a.camera == b.camera && (a.aspect() - b.aspect()).abs() < 0.02
}
