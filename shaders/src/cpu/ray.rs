//! Types that the stages of the ray-caster share: the scene, the ray, its hit. GPU twin: `ray.wgsl`.

use crate::layout::{DrawNode, FrameUniform, NO_NODE};
use glam::{Vec2, Vec3};

/// The arrays that a frame is made of, as the GPU reads them.
#[derive(Debug, Clone, Copy)]
pub struct SceneRef<'a> {
    /// Camera and light.
    pub frame: &'a FrameUniform,
    /// Entries of the grid.
    pub grid: &'a [[u32; 2]],
    /// Nodes of the draw list.
    pub nodes: &'a [DrawNode],
    /// Block summaries, [`SUMMARY_WORDS`](crate::layout::SUMMARY_WORDS) a slot.
    pub summaries: &'a [u32],
    /// Pages.
    pub atlas: &'a [u32],
}

impl<'a> SceneRef<'a> {
    /// The meshes of what is added to the city, with the numbers of their nodes.
    pub(super) fn additions(&self) -> impl Iterator<Item = (u32, &'a DrawNode)> + use<'a> {
        let [first, count] = self.frame.additions;
        let nodes = self.nodes.get(first as usize..).unwrap_or_default();
        (first..).zip(nodes).take(count as usize)
    }
}

/// Counters of the work of one ray or of many.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct RayCounts {
    /// Rays from the eye.
    pub rays: u64,
    /// Nodes that were walked: the ray was between their lowest and highest point.
    pub nodes: u64,
    /// Entries of the grid that were read.
    pub steps: u64,
    /// Words of the atlas and rows of summaries that were read.
    pub fetches: u64,
    /// Cells whose column was read, and triangles that were tested.
    pub cells: u64,
}

impl std::ops::AddAssign for RayCounts {
    fn add_assign(&mut self, other: Self) {
        self.rays += other.rays;
        self.nodes += other.nodes;
        self.steps += other.steps;
        self.fetches += other.fetches;
        self.cells += other.cells;
    }
}

/// Most entries of the grid that a ray reads: a guard against damaged grids, far above any real walk.
pub(crate) const MAX_STEPS: u32 = 4096;
/// Least component of a direction, so that the distance to every boundary is a finite number.
pub(crate) const MIN_DIRECTION: f32 = 1e-12;
/// How far above a surface its ray towards the sun begins, in columns: steps between columns of one roof or wall must
/// not cast shadows.
pub(crate) const SUN_LIFT_CELLS: f32 = 0.5;
/// The same above the plane where there is no column, in metres.
pub(crate) const SUN_LIFT_M: f32 = 0.05;

/// A part of a ray: from the eye to the visible surface, or from there towards the sun.
#[derive(Debug, Clone, Copy)]
pub(super) struct RaySegment {
    /// Relative to the camera, in metres.
    pub(super) origin: Vec3,
    pub(super) dir: Vec3,
    pub(super) reach_m: f32,
    /// Distance from the eye to the origin.
    pub(super) eye_m: f32,
    /// Whether this is a shadow segment, which only tests whether anything is in the way.
    pub(super) to_sun: bool,
}

/// The surface that a ray segment has hit. Of a shadow segment, only `is_hit` is set.
#[derive(Debug, Clone, Copy)]
pub(super) struct RayHit {
    pub(super) is_hit: bool,
    /// Linear RGB.
    pub(super) albedo: Vec3,
    /// Share of the sky that it sees, 0 to 1.
    pub(super) ao: f32,
    pub(super) normal: Vec3,
    pub(super) flags: u32,
    pub(super) level: u32,
    pub(super) distance_m: f32,
    pub(super) node: u32,
    /// Address of its object's word in a palette; 0 if it has none, or if the frame does not need objects.
    pub(super) object: u32,
    /// Where the ray towards the sun begins.
    pub(super) shadow_origin: Vec3,
    /// 1 + number of its stone; 0 without.
    pub(super) stone: u32,
    /// Place in the stone's pattern, in metres from its origin.
    pub(super) stone_point: Vec3,
}

impl RayHit {
    /// Before the segment has hit anything.
    pub(super) const NOTHING: Self = Self {
        is_hit: false,
        albedo: Vec3::ZERO,
        ao: 0.0,
        normal: Vec3::ZERO,
        flags: 0,
        level: 0,
        distance_m: f32::INFINITY,
        node: NO_NODE,
        object: 0,
        shadow_origin: Vec3::ZERO,
        stone: 0,
        stone_point: Vec3::ZERO,
    };
}

/// The ray inside of a node: x and y in cells, z in height codes; `t` stays in metres.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct NodeRay {
    pub(super) index: u32,
    pub(super) o: Vec3,
    pub(super) d: Vec3,
    pub(super) inv: Vec2,
    /// First words of the node's planes in the atlas.
    pub(super) planes: [usize; 4],
    pub(super) z_shift: u32,
    /// First word of the node's blocks in the summaries.
    pub(super) summary: usize,
    pub(super) cell_m: f32,
    pub(super) level: u32,
}

impl NodeRay {
    /// Height of the ray in the node, in codes.
    #[inline]
    pub(super) fn z_at(&self, t: f32) -> f32 {
        self.o.z + self.d.z * t
    }
}

/// The state of one ray, whose parts are private variables in WGSL.
pub(super) struct Ray<'a> {
    pub(super) scene: &'a SceneRef<'a>,
    pub(super) segment: RaySegment,
    /// Which of two nodes the ray sees where one cross-fades into the other, and which thin columns it hits: 0 to 4,095.
    pub(super) threshold: u32,
    pub(super) hit: RayHit,
    pub(super) node: NodeRay,
    pub(super) counts: RayCounts,
}

impl Ray<'_> {
    /// A word of the atlas; 0 outside of it.
    #[inline]
    pub(super) fn read_word(&mut self, at: usize) -> u32 {
        self.counts.fetches += 1;
        self.scene.atlas.get(at).copied().unwrap_or(0)
    }

    /// Four words of the atlas, whose place is given in vec4s; 0 outside of it.
    pub(super) fn read_vec4(&mut self, at: u32) -> [u32; 4] {
        self.counts.fetches += 1;
        self.scene.atlas.get(at as usize * 4..).and_then(|words| words.first_chunk()).copied().unwrap_or_default()
    }

    /// A word of a plane of the node that the ray is in.
    #[inline]
    pub(super) fn read_plane(&mut self, plane: usize, i: usize) -> u32 {
        self.read_word(self.node.planes[plane] + i)
    }
}
