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
mod candidates;
mod crossings;
mod directions;
mod local;
pub(crate) mod mend;
mod nearest;
mod scan;
mod sheets;
pub(crate) mod solids;
pub(crate) mod texture;
mod visibility;

use crate::{
    columns::voxels::VoxelNode,
    scene::{Scene, grid::CityGrid},
};
use insula_protocol::TileId;
use local::Block;
use serde::Serialize;

/// Who draws the maps of the nearest triangles.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Visibility {
    /// The processor.
    #[default]
    Cpu,
    /// A graphics device. Texels on the edges of triangles may differ, so the tiles are not the same byte for byte.
    Gpu,
}

impl Visibility {
    /// Whether it can be had here. Errors: built without feature `gpu`, or no device works; says what to do.
    pub fn check(self) -> Result<(), String> {
        match self {
            Self::Cpu => Ok(()),
            Self::Gpu => nearest::check(),
        }
    }
}

/// What decides a bake's result besides its sources; hashed into the manifest.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SampleSettings {
    /// Directions over the upper half of the sphere: ambient occlusion, and sightings from above.
    pub sky_directions: u32,
    /// Directions from a little under the horizon: sightings of undersides. Steeper ones would look into shells without a
    /// floor, which no viewer above the ground can.
    pub low_directions: u32,
    /// Width of the rim around a block whose triangles only cast occlusion.
    pub margin_m: f64,
    /// Who draws what is seen.
    pub visibility: Visibility,
}

impl Default for SampleSettings {
    fn default() -> Self {
        Self { sky_directions: 128, low_directions: 32, margin_m: 64.0, visibility: Visibility::Cpu }
    }
}

/// The work of one call.
#[derive(Debug, Clone, Copy)]
pub struct BlockInput<'a> {
    /// The city.
    pub scene: &'a Scene,
    /// Its nodes.
    pub grid: &'a CityGrid,
    /// Indices of the triangles that touch the block or its margin, ascending.
    pub triangles: &'a [u32],
    /// The leaves of the block that may hold something.
    pub leaves: &'a [TileId],
}

/// Samples the leaves of a block; those in which nothing stands are left out. The same input gives the same result on any
/// number of threads.
pub fn sample_block(input: &BlockInput<'_>, settings: &SampleSettings) -> Vec<VoxelNode> {
    let Some(block) = Block::new(input, settings) else { return Vec::new() };
    let mut crossings = crossings::find(&block);
    let mut candidates = candidates::find(&block);
    visibility::look(&block, settings, &mut crossings, &mut candidates);
    candidates::share_sky(&mut candidates);
    let mut columns = solids::build(&block, &crossings, &candidates);
    drop(crossings);
    sheets::add(&block, &candidates, &mut columns);
    let mut nodes = attributes::build(&block, input, &columns, &candidates);
    for node in &mut nodes {
        mend::fill(node);
    }
    nodes.retain(|node| !node.is_empty());
    nodes
}
