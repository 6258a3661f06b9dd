//! What a turn would show: looked at, and fetched, while the picture rests.
//!
//! In: a shot that nothing is missing of. Out: a view beside it, tiles to fetch after all others. Next: `flow` asks for them,
//! `session` draws small pictures, whose hits come back here.
//!
//! To the left and to the right, each view is selected as the picture's own was, by what its rays hit: what stands behind
//! something else is not fetched. It begins with what the picture's rays told.

use super::Shot;
use crate::{
    camera::{Camera, View},
    scene::Tree,
    select::{
        Scratch, Selection,
        fade::Fades,
        select,
        sight::{Asked, Sight},
    },
};

/// How far one may turn and find all as it should be.
const TURNS_DEG: [f64; 2] = [30.0, -30.0];
/// A picture so many times smaller is enough to tell what hides what, as long as not all is here.
pub const SMALLER: u32 = 4;

/// Looks beside a picture that rests.
#[derive(Debug, Default)]
pub(super) struct Around {
    /// The picture.
    of: Option<Shot>,
    /// Views that are done with.
    done: usize,
    sight: Sight,
    selection: Selection,
    /// Nothing fades there: the selection as it is drawn.
    shown: Fades,
    /// Counts selections that differ from the one before.
    generation: u64,
}

impl Around {
    /// Whether it is `shot` that is looked beside of, or was.
    pub(super) fn is_of(&self, shot: &Shot) -> bool {
        self.of.as_ref() == Some(shot)
    }

    /// Begins to look beside a shot; `sight` is what its rays told.
    pub(super) fn begin(&mut self, shot: &Shot, sight: &Sight) {
        *self =
            Self { of: Some(*shot), sight: sight.for_another(), generation: self.generation + 1, ..Self::default() };
    }

    /// The picture became another.
    pub(super) fn forget(&mut self) {
        self.of = None;
        self.end();
    }

    /// Nothing more shall be looked at.
    pub(super) fn end(&mut self) {
        self.done = TURNS_DEG.len();
        self.selection = Selection::default();
    }

    /// All is here, and seen: to the next view.
    pub(super) fn next(&mut self, sight: &Sight) {
        self.done += 1;
        self.generation += 1;
        self.sight = sight.for_another();
        self.selection = Selection::default();
    }

    /// The camera of the present view.
    pub(super) fn camera(&self) -> Option<Camera> {
        Some(self.of?.camera.turned(*TURNS_DEG.get(self.done)?))
    }

    /// Selects for the present view.
    pub(super) fn select(&mut self, view: &View, tree: &Tree, scratch: &mut Scratch) {
        let selection = select(view, tree, &self.sight, scratch);
        self.generation += u64::from(selection.cut != self.selection.cut);
        self.selection = selection;
        self.shown.step(&self.selection, tree, 0.0);
    }

    /// What the present view draws.
    pub(super) fn shown(&self) -> &Fades {
        &self.shown
    }

    /// Which selection that is.
    pub(super) fn generation(&self) -> u64 {
        self.generation
    }

    /// What it lacks and draws.
    pub(super) fn selection(&self) -> &Selection {
        &self.selection
    }

    /// Whether it is known what its rays hit in a picture of this size.
    pub(super) fn has_looked(&self, size_px: [u32; 2]) -> bool {
        self.sight.has_looked(self.generation, size_px)
    }

    /// Takes in what the rays of its picture hit; `whole` if no tile was missing.
    pub(super) fn feed(&mut self, asked: &Asked, pixels: &[u32], whole: bool, tree: &Tree) {
        self.sight.feed(asked, pixels, whole, tree);
    }
}
