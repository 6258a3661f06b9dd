//! Cross-fades: what nodes show while they pass from one level of detail to another.
//!
//! A node that is drawn from another source than in the last frame cross-fades in `FADE_SECS`. If its target changes meanwhile,
//! the next cross-fade starts when the present one has ended. Finer nodes that a coarser one replaces stay, inside its area,
//! until they have faded. A node that was not drawn in the last frame, or was occluded, appears without a cross-fade.
//!
//! Each ray sees either the old or the new source (`insula_shaders::grid`), so a node in transition has two sources and the
//! number of rays that see the old one. The time is passed in.

use super::Selection;
use super::screen_error::ErrorMetric;
use crate::camera::View;
use crate::scene::{NodeIndex, SceneTree};
use insula_shaders::layout::FADE_RAYS;

/// Duration of a cross-fade, in seconds.
pub(super) const FADE_SECS: f64 = 0.25;
/// Most nodes that cross-fade at a time; further ones change at once.
pub const MAX_FADING: usize = 4096;
/// Progress at which enough rays see the new source to require new feedback.
const FEEDBACK_PROGRESS: f64 = 0.25;

/// What is drawn in a node's area.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DrawSource {
    /// Node whose V-BlockMap is drawn: the node itself or an ancestor.
    pub source: NodeIndex,
    /// Level of detail of the node's mesh that is drawn instead.
    pub mesh_lod: Option<u8>,
}

impl DrawSource {
    fn is_resident(self, node: NodeIndex, tree: &SceneTree) -> bool {
        let lods = &tree.node(node).lods;
        let is_lod_resident = |lod: u8| lods.get(usize::from(lod)).is_some_and(|lod| lod.tile.is_resident());
        tree.node(self.source).tile.is_resident() && self.mesh_lod.is_none_or(is_lod_resident)
    }

    /// Screen-space error in pixels when drawn in the area of `node`.
    pub(crate) fn error_px(self, node: NodeIndex, tree: &SceneTree, view: &View) -> f64 {
        let drawn = tree.node(if self.mesh_lod.is_some() { node } else { self.source });
        let lod = self.mesh_lod.and_then(|lod| drawn.lods.get(usize::from(lod)));
        let error_m = lod.map_or(drawn.error_m, |lod| lod.error_m);
        ErrorMetric::new(view).error_px(error_m, drawn.centre, drawn.radius_m)
    }
}

/// A node of a frame, and its cross-fade if it is in one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Transition {
    pub node: NodeIndex,
    /// The node of the draw list that `node` is, or lies in.
    pub owner: NodeIndex,
    /// Whether `owner` is visible, or its visibility is unknown.
    pub is_unoccluded: bool,
    current: DrawSource,
    fade: Option<Fade>,
}

/// A cross-fade under way.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Fade {
    target: DrawSource,
    /// 0 to 1.
    progress: f64,
}

impl Transition {
    /// The source that is drawn; and while the node fades, the old source and how many of [`FADE_RAYS`] rays see that instead.
    pub fn sources(&self) -> (DrawSource, Option<(DrawSource, u8)>) {
        match self.fade {
            Some(Fade { target, progress }) if progress > 0.0 => {
                let rays = (f64::from(FADE_RAYS) * (1.0 - progress)).round() as u8;
                (target, Some((self.current, rays.clamp(1, FADE_RAYS as u8 - 1))))
            }
            _ => (self.current, None),
        }
    }

    /// Whether the node cross-fades, or starts to in the next frame.
    pub(crate) fn is_fading(&self) -> bool {
        self.fade.is_some()
    }

    /// Whether what replaces this node cross-fades with it. What was occluded and becomes visible does not: there is nothing to
    /// fade from. What stays occluded does: shown at once, it might show above an occluder that is still to come.
    fn can_fade_into(&self, is_unoccluded: bool) -> bool {
        self.is_unoccluded || !is_unoccluded || self.is_fading()
    }
}

/// Positions in a list of transitions, by node.
#[derive(Debug, Clone, Default)]
struct TransitionIndex(Vec<u32>);

impl TransitionIndex {
    fn get(&self, node: NodeIndex) -> Option<usize> {
        (*self.0.get(node.slot())? as usize).checked_sub(1)
    }

    fn set(&mut self, node: NodeIndex, position: usize) {
        if let Some(slot) = self.0.get_mut(node.slot()) {
            *slot = position as u32 + 1;
        }
    }

    fn clear(&mut self, transitions: &[Transition]) {
        for node in transitions.iter().map(|t| t.node) {
            if let Some(slot) = self.0.get_mut(node.slot()) {
                *slot = 0;
            }
        }
    }

    /// The position of `node`, or of its nearest ancestor in the list.
    fn find_covering(&self, node: NodeIndex, tree: &SceneTree) -> Option<usize> {
        std::iter::successors(Some(node), |node| tree.node(*node).parent).find_map(|node| self.get(node))
    }
}

/// What the last frame showed.
#[derive(Debug, Clone, Default)]
pub struct Transitions {
    is_enabled: bool,
    tiles: Vec<Transition>,
    index: TransitionIndex,
    fading_count: usize,
    /// Memory that the next step reuses.
    spare: (Vec<Transition>, TransitionIndex),
}

impl Transitions {
    /// Whether nodes cross-fade. Off by default: all changes are shown at once.
    pub fn set_enabled(&mut self, is_enabled: bool) {
        self.is_enabled = is_enabled;
    }

    /// Whether nodes cross-fade.
    pub(crate) fn is_enabled(&self) -> bool {
        self.is_enabled
    }

    /// The nodes of the last step: those of the draw list, and after them finer ones that have not faded yet.
    pub fn tiles(&self) -> &[Transition] {
        &self.tiles
    }

    /// The entry of the last step that is `node`, or its nearest ancestor.
    pub(crate) fn covering(&self, node: NodeIndex, tree: &SceneTree) -> Option<&Transition> {
        self.tiles.get(self.index.find_covering(node, tree)?)
    }

    /// Number of nodes that cross-fade.
    pub fn fading_count(&self) -> usize {
        self.fading_count
    }

    /// The nodes that cross-fade, each with its old and its new source.
    pub(crate) fn fading_sources(&self) -> impl Iterator<Item = (NodeIndex, DrawSource)> {
        let fading = self.tiles.iter().filter(|_| self.fading_count > 0);
        fading.filter_map(|t| t.fade.map(|fade| [(t.node, t.current), (t.node, fade.target)])).flatten()
    }

    /// Forgets the last step: the next one shows everything at once.
    pub(crate) fn reset(&mut self) {
        self.index.clear(&self.tiles);
        self.tiles.clear();
        self.fading_count = 0;
    }

    /// Advances to a new frame, `secs` after the last one. Returns whether new feedback is needed, because rays now see
    /// enough that they did not see before.
    pub fn step(&mut self, selection: &Selection, tree: &SceneTree, secs: f64) -> bool {
        if !self.is_enabled {
            self.reset();
        }
        let mut before = std::mem::take(&mut self.tiles);
        if before.iter().any(|transition| !tree.is_known(transition.node)) {
            self.index.clear(&before);
            before.retain(|transition| tree.is_known(transition.node));
            before.iter().enumerate().for_each(|(position, transition)| self.index.set(transition.node, position));
        }
        let (mut after, mut index) = std::mem::take(&mut self.spare);
        after.clear();
        index.0.resize(tree.slots(), 0);
        let mut step = TransitionStep { tree, secs, fading_count: 0, needs_feedback: false, after, index };
        step.add_draw_list(selection, &before, &self.index);
        step.add_finer_nodes(&before);
        let TransitionStep { fading_count, needs_feedback, after, mut index, .. } = step;
        self.index.clear(&before);
        for (position, transition) in after.iter().enumerate() {
            index.set(transition.node, position);
        }
        self.spare = (before, std::mem::replace(&mut self.index, index));
        (self.tiles, self.fading_count) = (after, fading_count);
        needs_feedback
    }
}

/// One step, under way.
struct TransitionStep<'a> {
    tree: &'a SceneTree,
    secs: f64,
    fading_count: usize,
    needs_feedback: bool,
    after: Vec<Transition>,
    /// Positions in `after` of the draw list's nodes.
    index: TransitionIndex,
}

impl TransitionStep<'_> {
    /// Adds the nodes of the draw list. Those that were drawn before, or lie in a node that was, continue from there.
    fn add_draw_list(&mut self, selection: &Selection, before: &[Transition], before_index: &TransitionIndex) {
        let mut unoccluded = selection.unoccluded.iter().peekable();
        for tile in &selection.draw_tiles {
            let target = DrawSource { source: tile.source, mesh_lod: tile.mesh_lod };
            let is_unoccluded = unoccluded.next_if_eq(&&tile.node).is_some();
            let mut transition =
                Transition { node: tile.node, owner: tile.node, is_unoccluded, current: target, fade: None };
            let was = before_index.find_covering(tile.node, self.tree).map(|position| before[position]);
            if let Some(was) = was.filter(|was| was.can_fade_into(is_unoccluded)) {
                (transition.current, transition.fade) = (was.current, was.fade);
                self.advance(&mut transition, target);
            }
            self.index.set(tile.node, self.after.len());
            self.after.push(transition);
        }
    }

    /// Adds finer nodes that nodes of the draw list replace, as long as they or those fade.
    fn add_finer_nodes(&mut self, before: &[Transition]) {
        for was in before {
            if self.index.get(was.node).is_some() {
                continue;
            }
            let owner = self.index.find_covering(was.node, self.tree).map(|position| self.after[position]);
            let Some(owner) = owner.filter(|owner| was.can_fade_into(owner.is_unoccluded)) else { continue };
            let mut transition = Transition { owner: owner.node, is_unoccluded: owner.is_unoccluded, ..*was };
            self.advance(&mut transition, owner.fade.map_or(owner.current, |fade| fade.target));
            if transition.is_fading() || owner.is_fading() && self.fading_count < MAX_FADING {
                self.fading_count += usize::from(!transition.is_fading());
                self.after.push(transition);
            }
        }
    }

    /// Advances a cross-fade, or starts one if the node does not show `target`.
    fn advance(&mut self, transition: &mut Transition, target: DrawSource) {
        if let Some(Fade { target, progress: before }) = transition.fade {
            let progress = before + self.secs / FADE_SECS;
            transition.fade = (progress < 1.0).then_some(Fade { target, progress });
            if transition.fade.is_none() {
                transition.current = target;
            }
            self.needs_feedback |= before < FEEDBACK_PROGRESS && progress >= FEEDBACK_PROGRESS || progress >= 1.0;
        }
        if transition.fade.is_none() && transition.current != target {
            transition.fade = Some(Fade { target, progress: 0.0 });
        }
        let is_resident = |source: DrawSource| source.is_resident(transition.node, self.tree);
        let are_resident =
            transition.fade.is_none_or(|fade| is_resident(fade.target) && is_resident(transition.current));
        if !are_resident || transition.is_fading() && self.fading_count >= MAX_FADING {
            (transition.current, transition.fade) = (target, None);
            self.needs_feedback = true;
        }
        self.fading_count += usize::from(transition.is_fading());
    }
}
