//! Structs that Rust and WGSL share, checked against naga's offsets by `tests/layout.rs`.
//!
//! Lengths in metres relative to the camera ("view-relative": world axes, camera at zero), so that f32 is enough anywhere.

use bytemuck::{Pod, Zeroable};

/// Words (u32) of an atlas page: 16 KiB, one plane of a node.
pub const PAGE_WORDS: usize = 4096;
/// Pages that every node has: walk, roof, attributes, strip addresses. Strip pages follow.
pub const PLANES: usize = 4;
/// Cells along a side of a summary block.
pub const BLOCK_CELLS: u32 = 8;
/// Blocks of a node, 8 x 8.
pub const BLOCKS: usize = 64;
/// Summary words of a node, four a block, read at once: a row of four quads of 2 x 2 cells each, whose tops take 6 bits each from
/// bit 0 on, in 63rds of the way from the block's lowest to its highest point, rounded up. Bits 24 to 31 are the low and high
/// byte of the lowest point in height codes (0xffff where the block is empty), then those of the highest.
pub const SUMMARY_WORDS: usize = BLOCKS * 4;
/// Most rays along a pixel's side.
pub const MAX_SAMPLES: u32 = 4;
/// Threads of a workgroup in x and y.
pub const WORKGROUP: [u32; 2] = [8, 8];

/// Most levels of a [`crate::grid::Grid`].
pub const GRID_LEVELS: usize = 21;
/// First word of a grid entry: finer squares tell. 0 is an empty square.
pub const GRID_MIXED: u32 = 1;
/// Set in the first word of a grid entry that a node fills: level of the square that it fills (5 bits from bit 26, finest 0),
/// how many of [`FADE_RAYS`] rays see the node behind it in its place (6 bits from bit 20), and its index into the nodes (20
/// bits). The second word is lowest | highest point << 16 of the square.
pub const GRID_NODE_BIT: u32 = 0x8000_0000;
/// Where the level begins.
pub const GRID_LEVEL_SHIFT: u32 = 26;
/// Where the share of rays begins.
pub const GRID_SHARE_SHIFT: u32 = 20;
/// Most nodes of a grid.
pub const GRID_NODES: usize = 1 << GRID_SHARE_SHIFT;
/// Where a square passes from one node to another, each of so many rays side by side passes at a share of its own.
pub const FADE_RAYS: u32 = 64;
/// In the flags of what a ray gathered: it is a mesh. No column has this bit.
pub const MESH_FLAG: u32 = 128;
/// In the hit buffer: no node was hit.
pub const NO_NODE: u32 = u32::MAX;

/// What a pixel shows ([`FrameUniform::shading`]).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[repr(u32)]
pub enum Shading {
    /// Sun and sky.
    #[default]
    Lit = 0,
    /// Colour alone, without light.
    Albedo = 1,
    /// Ambient occlusion alone.
    Ao = 2,
    /// Normals as colours.
    Normal = 3,
    /// One colour a level.
    Lod = 4,
    /// Column kinds: roof grey, exposed orange, suspended blue, with gaps red; inclined tinted green. Meshes violet.
    Kind = 5,
}

impl Shading {
    /// All, in the order of their keys.
    pub const ALL: [Self; 6] = [Self::Lit, Self::Albedo, Self::Ao, Self::Normal, Self::Lod, Self::Kind];

    /// The word on command lines.
    pub const fn word(self) -> &'static str {
        match self {
            Self::Lit => "lit",
            Self::Albedo => "albedo",
            Self::Ao => "ao",
            Self::Normal => "normal",
            Self::Lod => "lod",
            Self::Kind => "kind",
        }
    }
}

/// A camera and what surrounds it, for one dispatch.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct FrameUniform {
    /// Unit vector through the picture's centre.
    pub forward: [f32; 3],
    /// MeshTexture width in pixels.
    pub width_px: u32,
    /// To the right edge: unit right times `tan(fov_x / 2)`.
    pub right: [f32; 3],
    /// MeshTexture height in pixels.
    pub height_px: u32,
    /// To the upper edge: unit up times `tan(fov_y / 2)`.
    pub up: [f32; 3],
    /// Rays along a pixel's side, at most [`MAX_SAMPLES`]. Distance and hit node are those of the centre ray if odd.
    pub samples: u32,
    /// Unit vector towards the sun.
    pub sun: [f32; 3],
    /// A [`Shading`].
    pub shading: u32,
    /// Camera within its finest square of the grid, in squares.
    pub eye: [f32; 2],
    /// Which square that is.
    pub eye_cell: [i32; 2],
    /// Side of a finest square in metres.
    pub side_m: f32,
    /// Levels of the grid; 0 without nodes.
    pub levels: u32,
    /// Camera's height in the grid's steps.
    pub z_eye: f32,
    /// Steps in a metre.
    pub z_scale: f32,
    /// 1 / the distance from which on nodes of the finest level are good enough.
    pub level_scale: f32,
    /// Height of the plane where there is no column, relative to the camera.
    pub ground_z_m: f32,
    /// 1 if the plane is drawn.
    pub ground: u32,
    /// How far rays towards the sun go, in metres; 0: none are cast, and [`Shading::Lit`] guesses by the sky that is seen.
    pub shadow_m: f32,
    /// Sun, sky and haze for [`Shading::Lit`].
    pub light: Light,
    /// Per level of the grid, finest first: first entry, log2 of the window's side, its west and south end.
    pub windows: [[i32; 4]; GRID_LEVELS],
}

/// Sun, sky and haze, made by [`Light::of_sun`]. Linear RGB and 0, exposed: 1 is about what a white surface in the sun sends.
/// What lights surfaces is divided by pi, so that times an albedo it is what they send.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Light {
    /// On a surface that faces the sun.
    pub sun: [f32; 4],
    /// From the open sky on a surface that looks up.
    pub sky_up: [f32; 4],
    /// From the open sky on walls, the mean of all, doubled: a wall sees half the sky.
    pub sky_wall: [f32; 4],
    /// What walls towards the sun have more, doubled too.
    pub sky_side: [f32; 4],
    /// From ground and walls around.
    pub bounce: [f32; 4],
    /// The sky overhead.
    pub zenith: [f32; 4],
    /// The horizon below the sun.
    pub horizon_sun: [f32; 4],
    /// The horizon opposite the sun.
    pub horizon_away: [f32; 4],
    /// What the sky beside the sun has more.
    pub glow: [f32; 4],
    /// What air takes of a surface's light, per metre.
    pub haze: [f32; 4],
    /// East and north of the horizontal unit vector towards the sun.
    pub side: [f32; 2],
    /// 1 if the sun's disc is in the sky, else 0.
    pub disc: f32,
    /// Zero.
    pub pad: f32,
}

/// A node of the cut, ready to be walked.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct DrawNode {
    /// South-west corner of the node (of a mesh: of its leaf) at height code 0, relative to the camera.
    pub corner: [f32; 3],
    /// Side of a column.
    pub cell_m: f32,
    /// Metres of a height code.
    pub z_step_m: f32,
    /// Lowest point above code 0, in codes.
    pub z_lo: f32,
    /// Highest point above code 0, in codes; inclined columns' slopes included.
    pub z_hi: f32,
    /// [`DrawNode::slot_and_shift`].
    pub slot_and_shift: u32,
    /// Atlas pages of the [`PLANES`] (walk, roof, attributes, strip addresses) in 24 bits, and above them how far quarters
    /// lie below the node ([`DrawNode::pages_and_quarters`]).
    pub pages: [u32; 4],
    /// Level of the node in the city, for [`Shading::Lod`].
    pub level: u32,
    /// 1 + where the head of its mesh is in the atlas, in fours of words; 0: its columns are drawn.
    pub mesh: u32,
    /// The city's height zero relative to the camera, which the mesh's heights are above.
    pub mesh_z_m: f32,
    /// Of a mesh: where its leaf lies among the columns ([`crate::mesh::leaf_offset`]); else 0.
    pub leaf_offset: u32,
}

/// Where the slot begins in [`DrawNode::slot_and_shift`].
const SLOT_SHIFT: u32 = 3;
/// Where the quarter's byte begins in [`DrawNode::pages`].
const QUARTER_SHIFT: u32 = 24;

impl DrawNode {
    /// Where the summary lies (word index / [`SUMMARY_WORDS`], below 2^29) and the map's `z_shift` (at most 4: a strip row is
    /// `16 >> z_shift` codes) in one word, so that rays read a node without a mesh in three rows.
    pub const fn slot_and_shift(slot: u32, z_shift: u32) -> u32 {
        slot << SLOT_SHIFT | z_shift
    }

    /// Pages, below 2^24, and per quarter (south-west, south-east, north-west, north-east) how far below the node's highest
    /// point its own is, in 255ths of the node's height: so rays pass over low quarters without a look at their blocks.
    pub fn pages_and_quarters(pages: [u32; 4], below: [u8; 4]) -> [u32; 4] {
        std::array::from_fn(|i| pages[i] | u32::from(below[i]) << QUARTER_SHIFT)
    }

    /// The page of a plane.
    pub(crate) const fn page(&self, plane: usize) -> u32 {
        self.pages[plane] & ((1 << QUARTER_SHIFT) - 1)
    }

    /// How far below the node's highest point a quarter's is, in 255ths of the node's height.
    pub(crate) const fn quarter_below(&self, quarter: usize) -> u32 {
        self.pages[quarter] >> QUARTER_SHIFT
    }

    /// Where the summary lies.
    pub(crate) const fn slot(&self) -> usize {
        (self.slot_and_shift >> SLOT_SHIFT) as usize
    }

    /// The map's `z_shift`.
    pub(crate) const fn z_shift(&self) -> u32 {
        self.slot_and_shift & ((1 << SLOT_SHIFT) - 1)
    }
}

/// Binding numbers in group 0 of `raycast.wgsl`.
pub mod binding {
    /// Uniform [`super::FrameUniform`].
    pub const FRAME: u32 = 0;
    /// Storage, `array<vec2<u32>>`.
    pub const GRID: u32 = 1;
    /// Storage, `array<DrawNode>`.
    pub const NODES: u32 = 2;
    /// Storage, `array<u32>`.
    pub const SUMMARIES: u32 = 3;
    /// Storage, `array<u32>`.
    pub const ATLAS: u32 = 4;
    /// Storage, written: `array<u32>`, r, g, b, 255 in sRGB.
    pub const COLOUR: u32 = 5;
    /// Storage, written: `array<f32>`, metres, infinity where no column was hit.
    pub const DISTANCE: u32 = 6;
    /// Storage, written: `array<u32>`, index of the node that was hit or [`super::NO_NODE`].
    pub const HIT: u32 = 7;
    /// Storage, `array<vec4<u32>>`: the atlas again, for what is read in fours.
    pub const FOURS: u32 = 8;
}
