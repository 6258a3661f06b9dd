//! Selection: which tiles a frame draws, and which missing tiles are fetched.
//!
//! In: [`View`], [`SceneTree`], [`OcclusionFeedback`]. Out: [`Selection`]. Next: `streamer` fetches the requested tiles, `frame`
//! draws the draw list.
//!
//! A pure function: it knows no GPU API, no network and no clock. Three steps:
//!
//! 1. `visit` walks the scene tree, largest screen-space error first, until everything visible is accurate enough or the budget
//!    of cache pages is spent. Its decision table is the heart of this module.
//! 2. `draw_list` lists what can be drawn of the visited nodes. Every area is drawn from its node's tile or from that of the
//!    nearest resident ancestor, so there are no holes, and rays distinguish areas before their tiles are resident.
//! 3. `requests` lists the missing tiles in the order in which they are fetched.
//!
//! docs/selection.md explains the policy.

mod context;
pub mod cull;
mod draw_list;
pub(crate) mod horizon_culling;
mod meshes;
pub mod occlusion_feedback;
pub mod priority;
mod requests;
pub mod screen_error;
mod selection;
pub mod shadow_casters;
#[cfg(test)]
pub(crate) mod tests;
pub mod transitions;
mod visit;
mod visited;

use crate::camera::View;
use crate::scene::SceneTree;
pub(crate) use context::OCCLUDED_TAU_FACTOR;
use context::SelectionContext;
use occlusion_feedback::OcclusionFeedback;
pub use selection::{DrawTile, Selection, SelectionStats};
pub use visited::SelectionScratch;

/// Selects for one frame. `feedback` holds which nodes the rays of the last frames hit.
pub fn select(
    view: &View,
    tree: &SceneTree,
    feedback: &OcclusionFeedback,
    scratch: &mut SelectionScratch,
) -> Selection {
    let ctx = SelectionContext::new(view, tree, feedback);
    let mut selection = Selection::default();
    selection.stats.tau_px = view.tau_px;
    requests::request_entry_points(&ctx, &mut selection);
    visit::visit_tree(&ctx, scratch, &mut selection);
    draw_list::build(&ctx, scratch, &mut selection);
    requests::request_missing_tiles(&ctx, scratch, &mut selection);
    selection
}
