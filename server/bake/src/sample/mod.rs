//! Which voxels exist and what they look like (Vacca 2008, 3.4; design 5), for one block of leaves.
//!
//! In: the triangles around a block ([`BlockInput`]). Out: a [`VoxelNode`] a leaf. Next: `parametrise`.
//!
//! | step | file |
//! |---|---|
//! | triangles in the block's own coordinates | `local` |
//! | points on the surfaces: where vertical lines cross them, and where colours are taken | `crossings`, `candidates` |
//! | which of them are seen from outside, and from how much of the sky | `directions`, `visibility` |
//! | full runs of each column, slopes of their tops | `solids`, `sheets` |
//! | colours, normals and occlusion of what is seen | `attributes`, `texture` |
//! | holes closed, every voxel coloured | `mend` |

mod attributes;
mod crossings;
mod directions;
mod local_block;
mod nearest;
mod rasterise;
mod settings;
mod solids;
mod surface_samples;
pub(crate) mod texture;
mod thin_surfaces;
mod visibility;

use crate::columns::{fill, voxels::VoxelNode};
use local_block::LocalBlock;

pub use settings::{BlockInput, SampleSettings, VisibilityBackend};

/// Samples the leaves of a block; those in which nothing stands are left out. The same input gives the same result on any
/// number of threads.
pub fn sample_block(input: &BlockInput<'_>, settings: &SampleSettings) -> Vec<VoxelNode> {
    let Some(block) = LocalBlock::new(input, settings) else { return Vec::new() };
    let mut crossings = crossings::find(&block);
    let mut candidates = surface_samples::find(&block);
    visibility::look(&block, settings, &mut crossings, &mut candidates);
    surface_samples::share_sky(&mut candidates);
    let mut columns = solids::build(&block, &crossings, &candidates);
    drop(crossings);
    thin_surfaces::add(&block, &candidates, &mut columns);
    let mut nodes = attributes::build(&block, input, &columns, &candidates);
    for node in &mut nodes {
        fill::fill(node);
    }
    nodes.retain(|node| !node.is_empty());
    nodes
}
