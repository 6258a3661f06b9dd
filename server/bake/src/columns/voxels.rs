//! The columns of a node before they are encoded: metres and linear colours.
//!
//! `sample` makes them for leaves, `downsample` for parents; `parametrise` encodes them.

use insula_protocol::TileId;
use insula_protocol::blockmap::ground::{VERTEX_COUNT, VERTICES};
use insula_protocol::blockmap::{COLUMNS, NO_OBJECT};

/// Colour and light of one voxel. The default is not known yet.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct VoxelAppearance {
    /// Linear RGB, 0 to 1.
    pub rgb: [f32; 3],
    /// Ambient occlusion: 0 is fully occluded, 1 sees the whole sky.
    pub ao: f32,
    pub is_known: bool,
}

/// A run of full voxels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SolidRun {
    /// Metres above the grid's height zero.
    pub bottom_m: f32,
    /// Above `bottom_m`. In an inclined column the last run's top is the height at the cell's centre.
    pub top_m: f32,
}

/// A vertical plane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VoxelPlane {
    /// Horizontal unit vector that points out of the column.
    pub normal: [f32; 2],
    /// Metres from the cell's centre along `normal`.
    pub offset_m: f32,
}

/// The second plane of a column that ends at a corner of two walls.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VoxelCorner {
    /// The smaller wall of the two.
    pub plane: VoxelPlane,
    /// Whether the column fills the inner side of either plane; otherwise only that of both.
    pub concave: bool,
}

/// The top beyond a clip.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VoxelOuterTop {
    /// Metres above the grid's height zero. What lies beyond the clip reaches from the column's bottom to here.
    pub top_m: f32,
    /// Seen from above.
    pub appearance: VoxelAppearance,
}

/// Where a column ends inside its cell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VoxelClip {
    /// The wall, or the larger one of a corner.
    pub plane: VoxelPlane,
    /// The other wall of a corner.
    pub corner: Option<VoxelCorner>,
    /// `None` if nothing stands beyond the clip.
    pub outer: Option<VoxelOuterTop>,
}

/// The objects that a column shows, by their numbers in the city.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct VoxelObjects {
    pub roof: u32,
    pub wall: u32,
    /// Of the lower top: beyond the clip, or below the gap.
    pub lower: u32,
}

impl Default for VoxelObjects {
    fn default() -> Self {
        Self { roof: NO_OBJECT, wall: NO_OBJECT, lower: NO_OBJECT }
    }
}

/// How much a thin object covers of its part of a cell (Vacca 2008, 3.4.2), 0 to 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ThinShares {
    /// Seen from the side.
    pub side: f32,
    /// Seen from above.
    pub top: f32,
}

/// Least height, in cells, by which an object of one cell rises above the columns around it to be a thin one.
pub(crate) const LEAST_THIN_RISE: f32 = 1.5;

impl ThinShares {
    /// Whether they are those of a thin object: others look more like a whole cell.
    pub(crate) fn is_thin(self) -> bool {
        self.side < 0.8 || self.top < 0.6
    }
}

/// One column.
#[derive(Debug, Clone, PartialEq)]
pub struct VoxelColumn {
    /// Bottom to top, disjoint, at least one.
    pub solids: Vec<SolidRun>,
    /// Whether the top is the plane perpendicular to `normal`.
    pub inclined: bool,
    /// Whether the lowest run does not reach the ground.
    pub suspended: bool,
    /// Unit normal of the top.
    pub normal: [f32; 3],
    /// The top, seen from above.
    pub roof: VoxelAppearance,
    /// Whether the column gets a wall strip.
    pub exposed: bool,
    /// Sum of the wall's horizontal normals, weighted by area. May be zero.
    pub wall_normal: [f32; 2],
    /// Row of `wall[0]`, in whole cells above the grid's height zero.
    pub first_row: i32,
    /// Appearance of the sides, one per cell of height, upwards. Empty unless `exposed`.
    pub wall: Vec<VoxelAppearance>,
    /// Where the column ends inside its cell. Only exposed columns have one.
    pub clip: Option<VoxelClip>,
    /// Whether most of its visible surface is water or glass.
    pub reflective: bool,
    pub objects: VoxelObjects,
    /// What of the last run is full, if that is a thin object. Only exposed columns with neither a slope nor a clip have one.
    pub thin: Option<ThinShares>,
}

/// The columns of one node, [`COLUMNS`] of them, row-major from the south-west corner.
#[derive(Debug, Clone, PartialEq)]
pub struct VoxelNode {
    /// Address of the node in the quadtree.
    pub id: TileId,
    /// `None` where nothing stands.
    pub columns: Vec<Option<VoxelColumn>>,
    /// Generated ground.
    pub ground: Option<VoxelGround>,
    /// Of a leaf, points spread over what is visible of the source: metres from the root's corner and above the grid's height zero.
    pub surface: Vec<[f32; 3]>,
}

/// The generated ground of a node, at vertices in the order of [`insula_protocol::blockmap::NodeGround`].
#[derive(Debug, Clone, PartialEq)]
pub struct VoxelGround {
    /// Metres above the grid's height zero.
    pub heights_m: [f32; VERTEX_COUNT],
    /// The corners of the surface, as in the encoded ground; `None` if those are best that follow the heights.
    pub corners: Option<u128>,
    /// Share of the sky that is not occluded, 0 to 1.
    pub sky: [f32; VERTEX_COUNT],
    /// Which squares have ground.
    pub squares: u64,
}

impl VoxelGround {
    /// Gives vertices with an unknown (NaN) height or sky that of the nearest ones in the node. `None` if no square has
    /// ground, or no height is known.
    pub fn new(
        mut heights_m: [f32; VERTEX_COUNT],
        mut sky: [f32; VERTEX_COUNT],
        squares: u64,
        corners: Option<u128>,
    ) -> Option<Self> {
        if squares == 0 || heights_m.iter().all(|z| z.is_nan()) {
            return None;
        }
        spread_known(&mut heights_m);
        spread_known(&mut sky);
        // Nobody sees ground of which no point sees the sky.
        sky.iter_mut().filter(|sky| sky.is_nan()).for_each(|sky| *sky = 1.0);
        Some(Self { heights_m, corners, sky, squares })
    }
}

/// Replaces unknown values, ring by ring, by the mean of the known ones next to them.
fn spread_known(values: &mut [f32; VERTEX_COUNT]) {
    for _ in 0..2 * VERTICES {
        let before = *values;
        for i in (0..before.len()).filter(|i| before[*i].is_nan()) {
            let (x, y) = (i % VERTICES, i / VERTICES);
            let sides = [
                (x > 0).then(|| i - 1),
                (x + 1 < VERTICES).then(|| i + 1),
                (y > 0).then(|| i - VERTICES),
                (y + 1 < VERTICES).then(|| i + VERTICES),
            ];
            let known = sides.into_iter().flatten().map(|side| before[side]).filter(|value| !value.is_nan());
            let (sum, count) = known.fold((0.0, 0.0), |(sum, count), value| (sum + value, count + 1.0));
            if count > 0.0 {
                values[i] = sum / count;
            }
        }
    }
}

impl VoxelNode {
    /// A node without columns and ground.
    pub fn empty(id: TileId) -> Self {
        Self { id, columns: vec![None; COLUMNS], ground: None, surface: Vec::new() }
    }

    /// Whether it has neither columns nor ground.
    pub fn is_empty(&self) -> bool {
        self.ground.is_none() && !self.has_columns()
    }

    /// Whether a column stands anywhere.
    pub fn has_columns(&self) -> bool {
        self.columns.iter().any(Option::is_some)
    }
}
