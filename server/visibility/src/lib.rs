//! Potentially visible sets: which leaves can be seen from the streets of a city.
//!
//! From the V-BlockMaps of a baked city's nodes without children come, for each cell of the space where people walk and stand, the
//! leaves that an eye in it may see ([`CitySets`]). The bake writes them as visibility tiles.
//!
//! The sets are conservative: each has all visible leaves, and may have hidden ones.

mod cells;
mod height_scale;
mod heights;
mod row_tables;
mod shape;
mod sweep;

pub use cells::{CitySets, SWEEPS};
pub use heights::{CityExtent, MAX_LEAF_SQUARES, MIN_LEAF_M, NoSets};
use insula_protocol::visibility_tile::LAYERS;

/// How finely sets are computed. Coarser values give larger sets, never incomplete ones.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    /// A cell's set is about this many squares of each scale on each side of the cell's.
    pub reach: u8,
    /// Number of ranges of directions, a multiple of 4.
    pub sectors: u32,
    /// Heights of the layers above the ground in decimetres, ascending.
    pub layers_dm: [u16; LAYERS],
    /// Least height of a horizon above a leaf that it hides, in metres per metre of distance. Nodes and meshes are drawn with errors of
    /// up to a pixel.
    pub slope_margin: f32,
}

impl Default for Settings {
    fn default() -> Self {
        Self { reach: 8, sectors: 192, layers_dm: [30, 80, 200], slope_margin: 1.0 / 600.0 }
    }
}
