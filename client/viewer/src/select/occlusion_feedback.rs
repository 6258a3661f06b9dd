//! What the rays of the last pictures hit, and so which nodes are hidden behind others (design 7).
//!
//! In: per square of a drawn cut, the pixels that hit it. Out: [`OcclusionFeedback`]. Next: `select` asks what is seen.
//!
//! Pure. A square is **seen** if a ray hit it in one of the last pictures; **hidden** if it was drawn in the last one, wholly
//! inside the picture or from this very view, and nothing hit it, nor what lies beside it; else nobody knows. Until the first
//! picture is told of, everything counts as seen.

use crate::select::cull;
use crate::{
    camera::{FrustumPlane, View},
    scene::{NodeIndex, SceneTree},
};
use insula_protocol::TileId;

/// Pictures that a square stays seen after its last hit, while the camera moves. While it stands and tiles still come, only the
/// last picture counts: what coarse buildings let through, finer ones may hide.
const LINGER: u32 = 12;

/// A square that takes a smaller share of the picture's pixels contributes nothing. At least one pixel counts.
const CONTRIBUTES: f64 = 1.0 / 300_000.0;

/// What is known of a square.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Visibility {
    /// Hit.
    Visible,
    /// Beside what was hit; or not drawn in the last picture as it would be now: it came into the frustum, or it lay in a
    /// square that was drawn. The next picture tells.
    Unknown,
    /// Drawn and not hit.
    Occluded,
}

/// The squares that a picture was drawn with, to be told of with the pixels that hit each.
#[derive(Debug, Clone, PartialEq)]
pub struct OcclusionQuery {
    /// In the order of the ray-caster's nodes; one that is drawn in parts or by two nodes is named for each.
    pub nodes: Vec<NodeIndex>,
    /// What was looked at.
    pub view: View,
    /// Which selection that was.
    pub generation: u64,
}

/// Hits of the last pictures. Numbers count pictures from 1; 0 is never.
#[derive(Debug, Clone, Default)]
pub struct OcclusionFeedback {
    picture: u32,
    /// The first picture of this view; 0 if there was no other view yet.
    stood: u32,
    /// The first picture, since the camera stands, to which nothing was missing. From then on what was seen stays seen: the
    /// squares that are seen only become more, and the picture comes to rest.
    rest: Option<u32>,
    view: Option<View>,
    planes: Option<[FrustumPlane; 5]>,
    /// Per node: the last picture in which it, or something in it, was hit.
    hit: Vec<u32>,
    /// Per node: the last picture in which it, or something in it, lay beside what was hit.
    beside: Vec<u32>,
    /// Per node: the last picture in which it, or something in it, was drawn.
    drawn: Vec<u32>,
    /// Per node: pixels of the picture that is taken in.
    pixels: Vec<u32>,
    /// The selection that the last picture was of, and its finest picture's pixels.
    looked: Option<(u64, u64)>,
    hits: usize,
}

impl OcclusionFeedback {
    /// Takes in a picture: `pixels` are those that hit each square of `asked`; `whole` if no tile was missing.
    pub fn update(&mut self, query: &OcclusionQuery, pixels: &[u32], whole: bool, tree: &SceneTree) {
        // Of the first picture nobody knows that the camera moves.
        let same = self.view.is_none_or(|view| same_place(&view, &query.view));
        self.picture += 1;
        self.stood = if same { self.stood } else { self.picture };
        self.rest = self.rest.filter(|_| same).or(whole.then_some(self.picture));
        self.view = Some(query.view);
        self.planes = Some(query.view.planes());
        let pixels_of = |view: &View| u64::from(view.width_px) * u64::from(view.height_px);
        let before = self.looked.filter(|(generation, _)| *generation == query.generation);
        self.looked = Some((query.generation, pixels_of(&query.view).max(before.map_or(0, |(_, most)| most))));
        self.hit.resize(tree.nodes().len(), 0);
        self.beside.resize(tree.nodes().len(), 0);
        self.drawn.resize(tree.nodes().len(), 0);
        self.pixels.resize(tree.nodes().len(), 0);
        self.hits = 0;
        for (at, pixels) in query.nodes.iter().zip(pixels) {
            self.pixels[at.0 as usize] += *pixels;
        }
        let least = ((pixels_of(&query.view) as f64 * CONTRIBUTES) as u32).max(1);
        for at in &query.nodes {
            stamp(&mut self.drawn, tree, Some(*at), self.picture);
            if std::mem::take(&mut self.pixels[at.0 as usize]) >= least {
                self.hits += 1;
                stamp(&mut self.hit, tree, Some(*at), self.picture);
                for beside in around(tree.node(*at).id) {
                    stamp(&mut self.beside, tree, tree.find(beside), self.picture);
                }
            }
        }
    }

    /// What is known, for another view of which there is no picture yet.
    pub fn for_other_view(&self) -> Self {
        Self { looked: None, ..self.clone() }
    }

    /// Forgets everything: a new place altogether.
    pub fn clear(&mut self) {
        *self = Self::default();
    }

    /// Whether any picture was told of.
    pub fn has_feedback(&self) -> bool {
        self.picture > 0
    }

    /// Whether the last picture was of this selection, with at least so many pixels along its sides.
    pub fn covers(&self, generation: u64, size_px: [u32; 2]) -> bool {
        let pixels = size_px.map(u64::from).iter().product();
        self.looked.is_some_and(|(looked, most)| looked == generation && most >= pixels)
    }

    /// Squares that the last picture's rays hit.
    pub fn hits(&self) -> usize {
        self.hits
    }

    /// Whether the last two pictures were of this view (or there was but one): nothing will come into view.
    pub(super) fn is_camera_still(&self, view: &View) -> bool {
        self.stood < self.picture && self.view.is_some_and(|last| same_place(&last, view))
    }

    /// Whether a ray hit a square, or something in it, in any picture since the camera stands.
    pub(super) fn was_visible(&self, at: NodeIndex) -> bool {
        self.hit.get(at.0 as usize).is_some_and(|mark| *mark >= self.stood.max(1))
    }

    /// What is known of the square of `at` in `view`; `parent` is what is known of its parent.
    pub(super) fn visibility(&self, at: NodeIndex, tree: &SceneTree, view: &View, parent: Visibility) -> Visibility {
        let Some((planes, tested)) = self.planes.as_ref().zip(self.view.as_ref()) else { return Visibility::Visible };
        let place = at.0 as usize;
        let lately = |marks: &[u32]| marks.get(place).is_some_and(|mark| *mark >= self.since());
        if lately(&self.hit) {
            return Visibility::Visible;
        }
        let node = tree.node(at);
        let moved = !same_place(tested, view);
        // A camera that stands sees nothing new beside what it sees.
        let beside = lately(&self.beside) && !self.is_camera_still(view);
        if beside || moved && !cull::wholly_in_view(planes, node.centre, node.half) {
            return Visibility::Unknown;
        }
        match self.drawn.get(place) {
            Some(drawn) if *drawn == self.picture => Visibility::Occluded,
            // It lay in a drawn square. What lay in a hidden one is hidden.
            _ if parent == Visibility::Occluded => Visibility::Occluded,
            _ => Visibility::Unknown,
        }
    }

    /// The picture since which hits count.
    fn since(&self) -> u32 {
        let lately = if self.stood < self.picture { self.picture } else { self.picture.saturating_sub(LINGER - 1) };
        self.rest.unwrap_or(u32::MAX).min(lately).max(1)
    }
}

/// Marks a node and those that it lies in.
fn stamp(marks: &mut [u32], tree: &SceneTree, mut at: Option<NodeIndex>, picture: u32) {
    while let Some(node) = at
        && let Some(mark) = marks.get_mut(node.0 as usize)
        && *mark != picture
    {
        *mark = picture;
        at = tree.node(node).parent;
    }
}

/// The eight squares around one, as far as there are any.
fn around(id: TileId) -> impl Iterator<Item = TileId> {
    let places = (0..9u32).filter(|i| *i != 4).map(|i| (i % 3, i / 3));
    places.filter_map(move |(dx, dy)| {
        TileId::new(id.level(), (id.x() + dx).checked_sub(1)?, (id.y() + dy).checked_sub(1)?)
    })
}

/// Whether two views' rays are the same ones, but for how many there are.
fn same_place(a: &View, b: &View) -> bool {
    a.camera == b.camera && (a.aspect() - b.aspect()).abs() < 0.02
}
