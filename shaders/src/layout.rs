//! Structs, constants and binding numbers that Rust and WGSL share.
//!
//! The structs are repeated in `wgsl/shared/layout.wgsl`; `tests/layout.rs` compares their offsets. [`crate::wgsl`]
//! generates the constants for WGSL.
//!
//! Positions are relative to the camera (world axes, metres), so that f32 is precise enough anywhere on Earth.

use crate::stone::{MAX_STONES, Stone};
use crate::translucency::{MAX_MAPS, TranslucencyMap};
pub use crate::words::PAGE_WORDS;
use bytemuck::{Pod, Zeroable};
use glam::Vec2;
use insula_protocol::NODE_CELLS;

/// Pages that every node has: walk, roof, attributes, strip addresses. Strip pages follow.
pub const PLANES: usize = 4;
/// Page of the words that the walk reads: heights and flags.
pub(crate) const WALK_PLANE: usize = 0;
pub(crate) const ROOF_PLANE: usize = 1;
/// Page of the roof normals and the clipping planes.
pub(crate) const ATTRIBUTE_PLANE: usize = 2;
/// Page of the strip addresses.
pub(crate) const STRIP_PLANE: usize = 3;

/// Cells along a side of a summary block.
pub const BLOCK_CELLS: usize = 8;
/// Logarithm of [`BLOCK_CELLS`].
pub(crate) const BLOCK_SHIFT: u32 = BLOCK_CELLS.ilog2();
/// Blocks along a side of a node.
pub const NODE_BLOCKS: usize = NODE_CELLS / BLOCK_CELLS;
/// Summary words of a node, four per block, which are read at once.
///
/// A word is a row of four quads of 2 x 2 cells. A quad's top takes 6 bits from bit 0 on, in 63rds of
/// the way from the block's lowest to its highest point, rounded up. Bits 24 to 31 of the four words are the low and
/// the high byte of the lowest point in height codes (0xffff where the block is empty), then those of the highest.
pub const SUMMARY_WORDS: usize = NODE_BLOCKS * NODE_BLOCKS * 4;
/// Summary of a node in vec4s, one per block.
pub(crate) const SUMMARY_VEC4S: usize = SUMMARY_WORDS / 4;
/// Where the byte of a block's bounds begins in a summary word.
pub(crate) const SUMMARY_BYTE_SHIFT: u32 = 24;
pub(crate) const QUAD_TOP_BITS: u32 = 6;
pub(crate) const QUAD_TOP_MAX: u32 = (1 << QUAD_TOP_BITS) - 1;

/// Most rays along a pixel's side.
pub const MAX_SAMPLES: u32 = 4;
/// Cosine and sine of the turn between neighbouring points of an even spiral over a disc: 137.5 degrees.
pub(crate) const GOLDEN_TURN: Vec2 = Vec2::new(-0.737_368_9, 0.675_490_3);
/// Threads of a ray-casting workgroup in x and y.
pub const WORKGROUP: [u32; 2] = [8, 8];
/// Threads of the meter's one workgroup, and pixels that each reads at most.
pub(crate) const METER_THREADS: u32 = 256;
pub(crate) const METER_READS: u32 = 64;

pub(crate) const HIT_COUNTS_THREADS: u32 = 64;
/// Side of the block of pixels that one thread counts.
pub(crate) const HIT_BLOCK_PX: u32 = 8;

/// Most levels of a [`crate::grid::NodeGrid`].
pub const GRID_LEVELS: usize = 21;
/// First word of a grid entry whose square is mixed: the next finer level has its entries. 0 is an empty square.
pub const GRID_MIXED: u32 = 1;
/// Set in the first word of a grid entry that a node fills.
///
/// The other bits are the level of the square that the node fills (5 bits from [`GRID_LEVEL_SHIFT`], finest 0), how
/// many of [`FADE_RAYS`] rays see the next node of the list instead (6 bits from [`GRID_SHARE_SHIFT`]), and the node's
/// index (20 bits). The second word is `lowest | highest << 16`, the square's lowest and highest point in the grid's
/// steps.
pub const GRID_NODE_BIT: u32 = 0x8000_0000;
/// Where the level begins in a grid entry.
pub const GRID_LEVEL_SHIFT: u32 = 26;
/// The level in a grid entry, shifted down.
pub(crate) const GRID_LEVEL_MASK: u32 = 31;
/// Where the share of rays begins in a grid entry.
pub const GRID_SHARE_SHIFT: u32 = 20;
/// The share of rays in a grid entry, shifted down.
pub(crate) const GRID_SHARE_MASK: u32 = FADE_RAYS - 1;
/// Most nodes of a grid.
pub const GRID_NODES: usize = 1 << GRID_SHARE_SHIFT;
pub(crate) const GRID_NODE_MASK: u32 = GRID_NODES as u32 - 1;
/// Number of thresholds of rays. Each ray changes from one node to another at its own share.
pub const FADE_RAYS: u32 = 64;
/// Flag of a [surface](crate::cpu::shade::SurfaceSample) that belongs to a mesh. No column has this bit.
pub const MESH_FLAG: u32 = 256;
/// In [`DrawNode::level`]: the finest level of detail of a mesh. Coarser ones follow.
pub const MESH_LEVEL: u32 = 32;
/// In [`DrawNode::level`]: a mesh that is added to the city. There are no columns of it to take ambient occlusion from: it stands in the open.
pub const ADDED_LEVEL: u32 = 63;
/// In the hit buffer: no node was hit.
pub const NO_NODE: u32 = u32::MAX;

/// The quantity that pixels show ([`FrameUniform::shading`]).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[repr(u32)]
pub enum Shading {
    /// Sun and sky.
    #[default]
    Lit = 0,
    /// Colour without light.
    Albedo = 1,
    /// Ambient occlusion.
    Ao = 2,
    /// Normals as colours.
    Normal = 3,
    /// A colour per level of detail: strong for nodes, pale for meshes.
    Lod = 4,
    /// A colour per kind of column: roof grey, exposed orange, suspended blue, with gaps red, inclined tinted green.
    /// Meshes are violet.
    Kind = 5,
    /// No picture: each pixel is the palette word of the object that its centre ray hits, as an address in the atlas, or 0.
    Objects = 6,
    /// The edges of the triangles of meshes, one pixel wide. Columns are grey.
    Wire = 7,
    /// A colour for each triangle of a mesh. Columns are grey.
    Triangles = 8,
    /// As [`Self::Lod`]. Shells draw the boxes of the nodes over it.
    Bounds = 9,
}

impl Shading {
    /// All shadings that are pictures, in the order of their keys in the client.
    pub const ALL: [Self; 9] = [
        Self::Lit,
        Self::Albedo,
        Self::Ao,
        Self::Normal,
        Self::Lod,
        Self::Kind,
        Self::Wire,
        Self::Triangles,
        Self::Bounds,
    ];

    /// The word on command lines.
    pub const fn word(self) -> &'static str {
        match self {
            Self::Lit => "lit",
            Self::Albedo => "albedo",
            Self::Ao => "ao",
            Self::Normal => "normal",
            Self::Lod => "lod",
            Self::Kind => "kind",
            Self::Objects => "objects",
            Self::Wire => "wire",
            Self::Triangles => "triangles",
            Self::Bounds => "bounds",
        }
    }
}

/// Parts of a side of the city that are land or sea.
pub(crate) const SHORE_PARTS: u32 = insula_protocol::sea::PARTS as u32;
/// Rows of four words that hold a byte of each part of the four sides.
pub(crate) const SHORE_ROWS: usize = 4 * SHORE_PARTS as usize / 16;

/// The uniform of one dispatch: camera, light, and the grid's header.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct FrameUniform {
    /// Unit vector through the frame's centre.
    pub forward: [f32; 3],
    pub width_px: u32,
    /// To the right edge: unit right times `tan(fov_x / 2)`.
    pub right: [f32; 3],
    pub height_px: u32,
    /// To the upper edge: unit up times `tan(fov_y / 2)`.
    pub up: [f32; 3],
    /// Rays along a pixel's side, at most [`MAX_SAMPLES`]. If odd, distance and hit node are those of the centre ray.
    pub samples: u32,
    /// Unit vector towards the sun.
    pub sun: [f32; 3],
    /// A [`Shading`].
    pub shading: u32,
    /// Camera within its finest square of the grid, in squares.
    pub eye: [f32; 2],
    /// The finest square that the camera is in.
    pub eye_cell: [i32; 2],
    /// Side of a finest square in metres.
    pub side_m: f32,
    /// Levels of the grid. 0 without nodes.
    pub levels: u32,
    /// Camera's height in the grid's steps of height.
    pub z_eye: f32,
    /// Steps of height per metre.
    pub z_scale: f32,
    /// 1 / the distance in metres from which nodes of the finest level are good enough.
    pub level_scale: f32,
    /// Height of the plane where there is no column, relative to the camera.
    pub ground_z_m: f32,
    /// 1 if the plane is drawn.
    pub ground: u32,
    /// Length of rays towards the sun in metres. 0: none are cast, and [`Shading::Lit`] estimates the sun from the
    /// visible sky.
    pub shadow_m: f32,
    /// Factor from radiance to display. 0: by the frame's mean.
    pub exposure: f32,
    /// Radius of the sun's disc in radians for soft shadows; 0: shadows are hard.
    pub sun_radius: f32,
    /// 1 if objects have colours or are hidden, or the frame shows objects; else rays do not read them.
    pub objects: u32,
    /// 1 if there are meshes with landmarks; else their normals, occlusion and stones are not read.
    pub landmarks: u32,
    /// Place of the camera among lit windows, and metres that a ray covers at a distance of one metre
    /// ([`crate::cpu::night::bays_of`]).
    pub bays: [f32; 4],
    /// Fog of a [`Look`](crate::look::Look): metres from the camera at which it begins, the inverse of its depth in metres, and the
    /// inverse of the distance in metres from the city at which the land around has faded. Without fog, all are 0.
    pub fog: [f32; 4],
    /// West, south, east and north end of the city and of the land between it and the camera, in metres from the camera.
    pub city: [f32; 4],
    /// Strength of lines at silhouettes and of shade where surfaces meet, each 0 to 1, then twice 0. Rays do not read it.
    pub edges: [f32; 4],
    /// Ends of what the source describes, as `city`: beyond, there may be sea (module `shore`).
    pub shore: [f32; 4],
    /// A byte for each part of these ends, of the west, south, east and north end. The low four bits: cells inwards from there in which
    /// bare ground is sea; 0 for land. The high four: how much of what lies far beyond is sea, in fifteenths.
    pub sea: [[u32; 4]; SHORE_ROWS],
    /// Albedo of the sea, then the inverse of a cell's side in metres; all 0 without a sea.
    pub sea_albedo: [f32; 4],
    /// Sun, sky and haze for [`Shading::Lit`].
    pub light: Light,
    /// Per level of the grid, finest first: first entry, log2 of the window's side, the window's west and south end.
    pub windows: [[i32; 4]; GRID_LEVELS],
    /// Stones of landmarks, by their number in the city.
    pub stones: [Stone; MAX_STONES],
    pub translucency: [TranslucencyMap; MAX_MAPS],
    /// 1 if there are any.
    pub translucent: u32,
    /// The map that a pass makes.
    pub map_in_progress: u32,
    /// What each map shows, as a hash; 0 without a map. A map is made again when its key changes.
    pub map_keys: [u32; MAX_MAPS],
    /// The first of the nodes that are not in the grid, and their number: meshes of what is added to the city. Every ray tests them.
    pub additions: [u32; 2],
    pub padding: [u32; 2],
}

/// Heights above the horizon in the sky's tables.
pub const SKY_HEIGHTS: usize = 20;
/// Azimuths from the sun in them.
pub const SKY_AZIMUTHS: usize = 9;
/// Entries of a [`SkyTable`].
pub(crate) const SKY_CELLS: usize = SKY_HEIGHTS * SKY_AZIMUTHS;
/// Linear RGB and 0 by height and azimuth.
pub type SkyTable = [[[f32; 4]; SKY_AZIMUTHS]; SKY_HEIGHTS];

/// Sun, sky and haze, made by [`Light::of_sun`].
///
/// Linear RGB and 0 in units of what a white matt surface that faces the sun reflects. Irradiances are divided by pi, so that
/// times an albedo they are the radiance of a surface.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Light {
    /// Irradiance from the sun on a surface that faces it.
    pub sun: [f32; 4],
    /// Irradiance from the open sky on a surface that faces up; then the least share of the sky that a surface sees, which is 1 if
    /// ambient occlusion is off.
    pub sky_up: [f32; 4],
    /// Irradiance from the open sky on walls across the sun's azimuth; doubled, because a wall sees half of the sky.
    pub sky_wall: [f32; 4],
    /// What walls receive above that times the cosine of their azimuth from the sun, also doubled.
    pub sky_wall_ahead: [f32; 4],
    /// And times the square of that cosine.
    pub sky_wall_axis: [f32; 4],
    /// Light that open ground reflects from the sun.
    pub ground_sun: [f32; 4],
    /// Light that it reflects from the sky.
    pub ground_sky: [f32; 4],
    /// Light that facades reflect from the sun, where it reaches them.
    pub facade_sun: [f32; 4],
    /// Light that they reflect from the sky.
    pub facade_sky: [f32; 4],
    /// Extinction of the air per metre.
    pub haze: [f32; 4],
    /// Light of lamps on the ground of a street; fourth: whether it is seen, 0 or 1.
    pub street: [f32; 4],
    /// Radiance of lit windows, and 1 if there are any.
    pub window: [f32; 4],
    /// Unit vector towards the moon, and the radiance of its lit side; 0 without a moon.
    pub moon: [f32; 4],
    /// East and north of the horizontal unit vector towards the sun.
    pub side: [f32; 2],
    /// 1 if the sun's disc is above the horizon, else 0.
    pub disc: f32,
    /// Always 0. WGSL derives infinity from it.
    pub zero: f32,
    /// Tangent of the sun's height.
    pub sun_tan: f32,
    /// Share of the ground's light that facades reflect.
    pub facade_ground: f32,
    /// Mean radiance that a frame has after exposure.
    pub key: f32,
    /// Radiance of the brightest stars; 0 by day.
    pub stars: f32,
    /// Albedo of the plane where there is no column.
    pub plane: [f32; 4],
    /// The exposure of a graded picture ([`crate::look`]), 0 in physical light: the factor that shows sunlit plaster white, the
    /// logarithm (base 2) of the city's mean radiance under which a frame is exposed longer, by which power of the difference, and
    /// the largest logarithm of the longer exposure.
    pub grade: [f32; 4],
    /// Radiance of the sky without forward scattering: [`SKY_AZIMUTHS`] by the cosine of the azimuth from the sun, -1 to 1,
    /// for each of [`SKY_HEIGHTS`], by the root of the height's sine from 1.7 degrees to the zenith.
    pub sky: SkyTable,
    /// Radiance from forward scattering per unit of its phase function, in the same directions.
    pub glow: SkyTable,
}

/// A node of the draw list, as rays walk it.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct DrawNode {
    /// South-west corner of the node (of a mesh: of its leaf) at height code 0, relative to the camera.
    pub corner: [f32; 3],
    /// Side of a column, in metres.
    pub cell_m: f32,
    /// Metres of a height code.
    pub z_step_m: f32,
    /// Lowest point above code 0, in codes.
    pub z_lo: f32,
    /// Highest point above code 0, in codes; inclined columns' slopes included.
    pub z_hi: f32,
    /// [`DrawNode::slot_and_shift`].
    pub slot_and_shift: u32,
    /// Atlas pages of the [`PLANES`] in 24 bits, and above them how far quarters lie below the node
    /// ([`DrawNode::pages_and_quarters`]).
    pub pages: [u32; 4],
    /// Level of the node in the city, or [`MESH_LEVEL`] and the level of detail of its mesh, for [`Shading::Lod`]; or
    /// [`ADDED_LEVEL`].
    pub level: u32,
    /// 1 + place of the head of its mesh in the atlas, in vec4s. 0: its columns are drawn.
    pub mesh: u32,
    /// The city's height zero relative to the camera: the origin of the mesh's heights.
    pub mesh_z_m: f32,
    /// Place of a mesh's leaf among the columns ([`crate::mesh::leaf_offset`]). 0 without a mesh.
    pub leaf_offset: u32,
    /// Page of the objects' plane, and first word of the palette in the atlas; 0 for a node without objects, and if a mesh is drawn.
    pub object_page: u32,
    pub palette: u32,
    pub unused: [u32; 2],
}

/// In a word of a palette: the object has the colour in the lower 24 bits (8-bit sRGB, r lowest) instead of its own.
pub const PALETTE_COLOURED: u32 = 1 << 24;
/// In a word of a palette: rays pass through the object.
pub const PALETTE_HIDDEN: u32 = 1 << 25;
/// In a word of a palette: the object is outlined.
pub const PALETTE_OUTLINED: u32 = 1 << 26;
/// Bits of the objects of a column's top and wall in a word of the objects' plane; those of the lower top are above them. Each is 1 + a
/// place in the palette, or 0.
pub(crate) const OBJECT_BITS: u32 = 12;
/// Colour of outlines, linear RGB.
pub(crate) const OUTLINE_RGB: [f32; 3] = [1.0, 0.45, 0.0];

/// Where the slot begins in [`DrawNode::slot_and_shift`].
pub(crate) const SLOT_SHIFT: u32 = 3;
/// Where the quarter's byte begins in [`DrawNode::pages`].
pub(crate) const QUARTER_SHIFT: u32 = 24;
/// Largest byte of a quarter.
pub(crate) const QUARTER_MAX: u32 = 255;

impl DrawNode {
    /// The summary's slot (word index / [`SUMMARY_WORDS`], below 2^29) and the map's `z_shift` (at most 4: a strip row
    /// is `16 >> z_shift` codes) in one word, so that rays read a node without a mesh in three rows of four words.
    pub const fn slot_and_shift(slot: u32, z_shift: u32) -> u32 {
        slot << SLOT_SHIFT | z_shift
    }

    /// Pages, below 2^24, and for each quarter (south-west, south-east, north-west, north-east) how far its highest
    /// point is below the node's, in 255ths of the node's height. Rays pass over low quarters without reading their
    /// blocks.
    pub fn pages_and_quarters(pages: [u32; 4], below: [u8; 4]) -> [u32; 4] {
        std::array::from_fn(|i| pages[i] | u32::from(below[i]) << QUARTER_SHIFT)
    }

    pub(crate) const fn page(&self, plane: usize) -> u32 {
        self.pages[plane] & ((1 << QUARTER_SHIFT) - 1)
    }

    /// How far a quarter's highest point lies below the node's, in 255ths of the node's height.
    pub(crate) const fn quarter_below(&self, quarter: usize) -> u32 {
        self.pages[quarter] >> QUARTER_SHIFT
    }

    pub(crate) const fn slot(&self) -> usize {
        (self.slot_and_shift >> SLOT_SHIFT) as usize
    }

    pub(crate) const fn z_shift(&self) -> u32 {
        self.slot_and_shift & ((1 << SLOT_SHIFT) - 1)
    }
}

/// The uniform of metering and composition.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct ComposeUniform {
    pub frame_px: [u32; 2],
    pub target_px: [u32; 2],
    /// 1 if the pixels are radiances, 0 if they are colours.
    pub is_lit: u32,
    /// Factor from radiance to display. 0: by the frame's mean.
    pub exposure: f32,
    /// Mean radiance that the frame has after exposure.
    pub key: f32,
    pub padding: f32,
    /// As in [`Light::grade`].
    pub grade: [f32; 4],
    /// As in [`FrameUniform::edges`]; 0 where the pixels are colours.
    pub edges: [f32; 4],
    /// Inverse depth of the plane without columns in the middle of the picture, what is added to it at the right edge and at the upper
    /// one, and 0; all are 0 without such a plane.
    pub plane: [f32; 4],
    /// Tangents of half of the angles that the picture is wide and high.
    pub tan: [f32; 2],
    pub unused: [u32; 2],
}

/// The uniform of occlusion: a pair of opposite directions, the frame of its maps, and the constants of the test. The CPU
/// twin, `insula-occlusion`, says what they are.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct OcclusionUniform {
    pub right: [i32; 3],
    pub vertices: u32,
    pub down: [i32; 3],
    /// Middle of a map, in steps of a texel.
    pub middle: i32,
    pub towards: [i32; 3],
    pub subtexel_bits: u32,
    /// By how much products are shifted, after [`OCCLUSION_SPLIT`], to give steps of a map.
    pub map_shift: u32,
    /// The same for depths.
    pub depth_shift: u32,
    /// By how much products of unit vectors are shifted to give cosines.
    pub cosine_shift: u32,
    pub cosine_bits: u32,
    pub texel_steps: f32,
    /// From a step of a map to clip space.
    pub clip_scale: f32,
    /// From a depth to the part of the map's range; 0 lies in its middle.
    pub depth_scale: f32,
    /// Words of a vertex's sum: 2, or 5 with a bent normal.
    pub sum_words: u32,
    pub bias_texels: f32,
    pub bias_per_slope: f32,
    pub max_bias_slope: f32,
    pub max_slope: f32,
}

/// Bits of a place that are multiplied apart from the others.
pub const OCCLUSION_SPLIT: u32 = 10;
/// Threads of a workgroup that tests vertices.
pub(crate) const OCCLUSION_THREADS: u32 = 64;

/// Binding numbers of the shaders, all in group 0, and locations of vertex attributes.
pub mod binding {
    /// Ray-caster: uniform [`super::FrameUniform`].
    pub const FRAME: u32 = 0;
    /// Ray-caster: storage, `array<vec2<u32>>`.
    pub const GRID: u32 = 1;
    /// Ray-caster: storage, `array<DrawNode>`.
    pub const NODES: u32 = 2;
    /// Ray-caster: storage, `array<vec4<u32>>`.
    pub const SUMMARIES: u32 = 3;
    /// Ray-caster: storage, `array<u32>`.
    pub const ATLAS: u32 = 4;
    /// Ray-caster: storage, written. `array<u32>`, radiances ([`crate::tone::encode_radiance`]) or r, g, b, 255 in sRGB.
    pub const COLOUR: u32 = 5;
    /// Ray-caster: storage, written. `array<f32>`, metres, infinity where no node was hit.
    pub const DISTANCE: u32 = 6;
    /// Ray-caster: storage, written. `array<u32>`, index of the node that was hit or [`super::NO_NODE`].
    pub const HIT: u32 = 7;
    /// Ray-caster: storage, `array<vec4<u32>>`. The atlas again, for what is read four words at a time.
    pub const ATLAS_VEC4S: u32 = 8;

    /// Composition and meter: uniform, [`super::ComposeUniform`].
    pub const COMPOSE_SETTINGS: u32 = 0;
    /// Composition and meter: storage, the ray-caster's colours.
    pub const COMPOSE_COLOUR: u32 = 1;
    /// Composition: storage, the exposure. The meter writes it.
    pub const COMPOSE_EXPOSURE: u32 = 2;
    /// Meter: storage, the ray-caster's hits.
    pub const COMPOSE_HIT: u32 = 3;
    /// Composition: storage, the ray-caster's distances.
    pub const COMPOSE_DISTANCE: u32 = 4;
    /// Composition: storage, the shade of each block of pixels. The pass `contact` writes it.
    pub const COMPOSE_SHADE: u32 = 5;

    /// Hit counts: uniform, width and height of the frame.
    pub const COUNTS_SIZE: u32 = 0;
    /// Hit counts: storage, the ray-caster's hits.
    pub const COUNTS_HIT: u32 = 1;
    /// Hit counts: storage, written. Pixels of each node.
    pub const COUNTS: u32 = 2;

    /// Nearest triangle and occlusion: location of a corner's place.
    pub const LOCATION_PLACE: u32 = 0;
    /// Nearest triangle: location of a triangle's number.
    pub const LOCATION_NUMBER: u32 = 1;

    /// Occlusion: uniform [`super::OcclusionUniform`].
    pub const OCCLUSION_VIEW: u32 = 0;
    /// Occlusion: storage, three `i32` a vertex.
    pub const OCCLUSION_PLACES: u32 = 1;
    /// Occlusion: storage, three `i32` a vertex.
    pub const OCCLUSION_NORMALS: u32 = 2;
    /// Occlusion: depths nearest to the first direction's viewer.
    pub const OCCLUSION_NEAR: u32 = 3;
    /// Occlusion: depths farthest from him.
    pub const OCCLUSION_FAR: u32 = 4;
    /// Occlusion: storage, written. [`super::OcclusionUniform::sum_words`] `i32` a vertex: cosines of the visible
    /// directions, cosines of all, and the sum of the visible directions.
    pub const OCCLUSION_SUMS: u32 = 5;
}
