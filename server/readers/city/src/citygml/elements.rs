//! The elements that a top-level object is made of.

use super::names::Names;
use super::tree::Tree;

/// The elements of a top-level object.
#[derive(Clone, Copy)]
pub(super) struct Elements<'e> {
    pub(super) tree: &'e Tree,
    pub(super) names: &'e Names,
}
