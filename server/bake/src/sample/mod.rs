//! Samples one block of leaves: which voxels exist and what they look like (Vacca 2008, 3.4).
//!
//! In: the triangles around a block ([`BlockInput`]). Out: a [`VoxelNode`] per leaf. Next: `parametrise`.
//!
//! The thesis carves space with shadow maps from many directions. Here the same maps decide which surface points are
//! visible from outside, and only visible points become geometry:
//!
//! | step | module |
//! |---|---|
//! | triangles in coordinates of the block | `local_block` |
//! | points where vertical lines cross surfaces, for geometry | `crossings` |
//! | surfels: points spread over the surfaces, for appearance and walls | `surfels` |
//! | where viewers can be below the horizon | `floor` |
//! | from which directions crossings and surfels are visible | `directions`, `visibility`, `visibility_map` |
//! | full runs and slopes of each column, walls inside cells | `solids`, `cell_grid` |
//! | columns for walls that no vertical line meets | `thin_surfaces` |
//! | columns for masts, railings and cables, which cover a share of their cells | `thin_objects` |
//! | heights and occlusion of generated ground | `ground` |
//! | colour, normal and occlusion of the visible voxels | `attributes`, `texture` |
//! | appearance of the voxels without surfels | `columns::fill` |
//!
//! `rasterise` finds grid points in triangles for several of these steps; `nearest` draws maps on a GPU.

mod attributes;
mod cell_grid;
mod crossings;
mod directions;
mod floor;
mod ground;
mod local_block;
mod nearest;
mod rasterise;
mod settings;
mod solids;
mod surfels;
pub(crate) mod texture;
mod thin_objects;
mod thin_surfaces;
mod visibility;
mod visibility_map;

use crate::columns::fill::fill_unknown;
use crate::columns::voxels::VoxelNode;
use floor::Floor;
use local_block::LocalBlock;
pub(crate) use rasterise::rasterise;
pub use settings::{BlockInput, SampleSettings, VisibilityBackend};

/// Samples the leaves of a block. Leaves without columns are left out. The result does not depend on the number of
/// threads.
pub fn sample_block(input: &BlockInput<'_>, settings: &SampleSettings) -> Vec<VoxelNode> {
    let Some(block) = LocalBlock::new(input, settings) else { return Vec::new() };
    let mut crossings = crossings::find(&block);
    let floor = Floor::new(&block, settings.margin_m);
    let mut surfels = surfels::place(&block, &floor);
    surfels::drop_covered(&block, &crossings, &mut surfels);
    let mut ground = ground::LocalGround::new(&block);
    visibility::find_sightings(&block, &floor, settings, &mut crossings, &mut surfels, ground.as_mut());
    surfels::share_sky(&mut surfels);
    let mut cells = solids::build_columns(&block, &floor, &crossings, &surfels);
    drop(crossings);
    thin_objects::cut_swollen(&block, &surfels, &mut cells);
    thin_surfaces::add_columns(&block, &floor, &surfels, &mut cells);
    thin_objects::add_columns(&block, &floor, &surfels, &mut cells);
    let mut nodes = attributes::build_nodes(&block, input, &cells, &surfels, ground.as_ref());
    for node in &mut nodes {
        fill_unknown(node);
        node.surface = surfels::visible_points(&block, &surfels, node.id, settings.sky_directions);
    }
    nodes.retain(|node| !node.is_empty());
    nodes
}
