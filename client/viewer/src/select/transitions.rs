//! What squares show while they pass from one level of detail to another (design 8).
//!
//! In: [`Selection`], which tiles are resident, seconds since the last frame. Out: [`Transition`] squares, some with two faces and
//! a share. Next: `render::frame` makes nodes of them; each ray sees one of the two (`insula_shaders::grid`).
//!
//! Pure: the time is handed in. A square that is drawn otherwise than in the last frame passes in [`FADE_SECS`] from what it
//! showed to what it shall show; if that changes meanwhile, it passes on from there when it has arrived. Squares that a coarser
//! one replaces stay, in it, until they have passed. What was not drawn before, or hidden until now, is right
//! at once.

use crate::select::{Selection, error};
use crate::{
    camera::{NEAR_M, View},
    scene::{NodeIndex, SceneTree},
};
use insula_shaders::layout::FADE_RAYS;

/// How long a square takes to pass, in seconds.
pub const FADE_SECS: f64 = 0.25;
/// Most squares that pass at a time; what is over that passes at once.
pub const MAX_FADING: usize = 4096;
/// Share from which on enough rays see what is new to tell what that hides.
const TOLD: f64 = 0.25;

/// What is drawn in a square.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DrawSource {
    /// Whose tile: the square's own or an ancestor's.
    pub source: NodeIndex,
    /// Which level of detail of the square's mesh in place of that.
    pub mesh_lod: Option<u8>,
}

impl DrawSource {
    fn is_here(self, square: NodeIndex, tree: &SceneTree) -> bool {
        let lods = &tree.node(square).lods;
        let mesh_is_here = |lod: u8| lods.get(usize::from(lod)).is_some_and(|lod| lod.tile.is_resident());
        tree.node(self.source).tile.is_resident() && self.mesh_lod.is_none_or(mesh_is_here)
    }

    /// Its projected error in `square`.
    pub fn error_px(self, square: NodeIndex, tree: &SceneTree, view: &View) -> f64 {
        let node = tree.node(if self.mesh_lod.is_some() { square } else { self.source });
        let lod = self.mesh_lod.and_then(|lod| node.lods.get(usize::from(lod)));
        let error_m = lod.map_or(node.error_m, |lod| lod.error_m);
        error::error_px(error_m, node.centre, node.radius_m, view.camera.position, view.focal_px(), NEAR_M)
    }
}

/// A square of a picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Transition {
    /// Which.
    pub node: NodeIndex,
    /// The square of the cut that it is, or lies in.
    pub owner: NodeIndex,
    /// Whether that is not known to be hidden.
    pub is_unoccluded: bool,
    face: DrawSource,
    /// What it passes to, and how far it is: 0 to 1.
    to: Option<(DrawSource, f64)>,
}

impl Transition {
    /// What is drawn, and what so many of [`FADE_RAYS`] rays see in place of it.
    pub fn sources(&self) -> (DrawSource, Option<(DrawSource, u8)>) {
        match self.to {
            Some((to, share)) if share > 0.0 => {
                let rays = (f64::from(FADE_RAYS) * (1.0 - share)).round() as u8;
                (to, Some((self.face, rays.clamp(1, FADE_RAYS as u8 - 1))))
            }
            _ => (self.face, None),
        }
    }

    /// Whether what comes now, which is seen or not, comes by and by. What was hidden until now has nothing to come from. What
    /// stays hidden has: at once, it might show over what hides it and is still to come.
    fn fades_into(&self, seen: bool) -> bool {
        self.is_unoccluded || !seen || self.is_fading()
    }

    /// Whether it shows, or is about to show, something else.
    pub fn is_fading(&self) -> bool {
        self.to.is_some()
    }
}

/// Places of squares in a list, by node.
#[derive(Debug, Clone, Default)]
struct Places(Vec<u32>);

impl Places {
    fn get(&self, at: NodeIndex) -> Option<usize> {
        (*self.0.get(at.0 as usize)? as usize).checked_sub(1)
    }

    fn set(&mut self, at: NodeIndex, place: usize) {
        if let Some(slot) = self.0.get_mut(at.0 as usize) {
            *slot = place as u32 + 1;
        }
    }

    fn clear(&mut self, squares: &[Transition]) {
        for slot in squares.iter().map(|s| s.node.0 as usize) {
            if let Some(slot) = self.0.get_mut(slot) {
                *slot = 0;
            }
        }
    }

    /// The place of `at` or of the nearest of what it lies in.
    fn over(&self, at: NodeIndex, tree: &SceneTree) -> Option<usize> {
        std::iter::successors(Some(at), |at| tree.node(*at).parent).find_map(|at| self.get(at))
    }
}

/// What the last frame showed.
#[derive(Debug, Clone, Default)]
pub struct Transitions {
    on: bool,
    shown: Vec<Transition>,
    places: Places,
    passing: usize,
    /// Memory that is used again.
    spare: (Vec<Transition>, Places),
}

impl Transitions {
    /// Whether squares pass; else all is as it shall be at once.
    pub fn set_enabled(&mut self, on: bool) {
        self.on = on;
    }

    /// Whether they do.
    pub fn is_enabled(&self) -> bool {
        self.on
    }

    /// The squares of the last step: those of the cut, and finer ones in some of them that have not passed yet.
    pub fn tiles(&self) -> &[Transition] {
        &self.shown
    }

    /// The square of the last step that `at` is or lies in.
    pub fn covering(&self, at: NodeIndex, tree: &SceneTree) -> Option<&Transition> {
        self.shown.get(self.places.over(at, tree)?)
    }

    /// How many squares pass.
    pub fn fading_count(&self) -> usize {
        self.passing
    }

    /// What squares that pass show, and which those are: worth keeping, but not for any price.
    pub fn fading_sources(&self) -> impl Iterator<Item = (NodeIndex, DrawSource)> {
        let passing = self.shown.iter().filter(|_| self.passing > 0);
        passing.filter_map(|s| s.to.map(|(to, _)| [(s.node, s.face), (s.node, to)])).flatten()
    }

    /// The next step shows everything as it shall be.
    pub fn reset(&mut self) {
        self.places.clear(&self.shown);
        self.shown.clear();
        self.passing = 0;
    }

    /// `secs` after the last step; whether rays see enough that they did not to be asked again what they hit.
    pub fn step(&mut self, selection: &Selection, tree: &SceneTree, secs: f64) -> bool {
        if !self.on {
            self.reset();
        }
        let before = std::mem::take(&mut self.shown);
        let (mut after, mut owners) = std::mem::take(&mut self.spare);
        after.clear();
        owners.0.resize(tree.nodes().len(), 0);
        let mut step = Step { tree, secs, passing: 0, told: false };
        let mut seen = selection.unoccluded.iter().peekable();
        for item in &selection.draw_tiles {
            let face = DrawSource { source: item.source, mesh_lod: item.mesh_lod };
            let seen = seen.next_if_eq(&&item.node).is_some();
            let mut square = Transition { node: item.node, owner: item.node, is_unoccluded: seen, face, to: None };
            let was = self.places.over(item.node, tree).map(|place| before[place]);
            if let Some(was) = was.filter(|was| was.fades_into(seen)) {
                (square.face, square.to) = (was.face, was.to);
                step.go_on(&mut square, face);
            }
            owners.set(square.node, after.len());
            after.push(square);
        }
        // Finer squares, where the cut has become coarser.
        for was in before.iter().filter(|was| owners.get(was.node).is_none()) {
            let owner = owners
                .over(was.node, tree)
                .map(|place| after[place])
                .filter(|owner| was.fades_into(owner.is_unoccluded));
            let Some(owner) = owner else { continue };
            let mut square = Transition { owner: owner.node, is_unoccluded: owner.is_unoccluded, ..*was };
            step.go_on(&mut square, owner.to.map_or(owner.face, |(to, _)| to));
            if square.is_fading() || owner.is_fading() && step.passing < MAX_FADING {
                step.passing += usize::from(!square.is_fading());
                after.push(square);
            }
        }
        self.places.clear(&before);
        for (place, square) in after.iter().enumerate() {
            owners.set(square.node, place);
        }
        self.spare = (before, std::mem::replace(&mut self.places, owners));
        (self.shown, self.passing) = (after, step.passing);
        step.told
    }
}

/// One step's way through the squares.
struct Step<'a> {
    tree: &'a SceneTree,
    secs: f64,
    passing: usize,
    told: bool,
}

impl Step<'_> {
    /// Brings a square nearer to what it shall show.
    fn go_on(&mut self, square: &mut Transition, shall: DrawSource) {
        if let Some((to, share)) = square.to {
            let further = share + self.secs / FADE_SECS;
            square.to = (further < 1.0).then_some((to, further));
            if square.to.is_none() {
                square.face = to;
            }
            self.told |= share < TOLD && further >= TOLD || further >= 1.0;
        }
        if square.to.is_none() && square.face != shall {
            square.to = Some((shall, 0.0));
        }
        let is_here = |face: DrawSource| face.is_here(square.node, self.tree);
        let both_here = square.to.is_none_or(|(to, _)| is_here(to) && is_here(square.face));
        if !both_here || square.is_fading() && self.passing >= MAX_FADING {
            (square.face, square.to) = (shall, None);
            self.told = true;
        }
        self.passing += usize::from(square.is_fading());
    }
}
