//! What one frame is made of: the arrays of `insula_shaders::layout`.
//!
//! In: the cut, the cache, a view, a [`RenderSettings`]. Out: [`FrameData`]. Next: `cpu`, `gpu`.
//!
//! Places are taken relative to the camera in f64 and only then rounded to f32.

use crate::{
    cache::{AtlasCache, CachedMesh, CachedNode},
    camera::View,
    scene::{NodeIndex, SceneTree},
    select::{
        occlusion_feedback::OcclusionQuery,
        transitions::{DrawSource, Transitions},
    },
};
use bytemuck::Zeroable;
use glam::DVec3;
use insula_protocol::TileId;
use insula_shaders::{
    grid::{Builder, Place},
    layout::{Frame, Light, MAX_SAMPLES, Node, PAGE_WORDS, Shading},
    mesh::place_in,
};

/// Rays along a pixel's side of a still picture: two miss much of a texture that is finer than the pixels, four gain little.
pub const STILL_SAMPLES: u32 = 3;
/// The same while the camera moves, where a device is fast enough: with one ray a slow pan shimmers (docs/measurements.md).
pub const MOVING_SAMPLES: u32 = 2;

/// Half the diagonal of a cube of side 1: a voxel's error (Vacca 2008, 3.6.2).
const HALF_DIAGONAL: f64 = 0.866_025_403_784_438_6;

/// What is set by taste, not by place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RenderSettings {
    /// What pixels show.
    pub shading: Shading,
    /// Rays along a pixel's side, 1 to [`MAX_SAMPLES`].
    pub samples: u32,
    /// Unit vector towards the sun.
    pub sun: DVec3,
    /// What it and the sky give.
    pub light: Light,
    /// How far its shadows reach, in metres; 0 without shadows.
    pub shadow_m: f64,
}

impl RenderSettings {
    /// Lit by a sun in direction `sun`, in air that takes half of what is `haze_half_m` away; one ray a pixel, no shadows.
    pub fn lit_by(sun: DVec3, haze_half_m: f64) -> Self {
        let light = Light::of_sun(sun.as_vec3(), haze_half_m as f32);
        Self { shading: Shading::Lit, samples: 1, sun, light, shadow_m: 0.0 }
    }

    /// Where shadows come from; nowhere by night, without them, and where light is not shown.
    pub fn shadow_casting_sun(&self) -> Option<DVec3> {
        let day = self.sun.z > 0.0 && self.light.sun[0] > 0.0;
        (day && self.shadow_m > 0.0 && self.shading == Shading::Lit).then_some(self.sun)
    }
}

impl Default for RenderSettings {
    /// Lit by an afternoon's sun from the south-west, 45 degrees high.
    fn default() -> Self {
        Self::lit_by(DVec3::new(-0.45, -0.55, 0.71).normalize_or(DVec3::Z), 6000.0)
    }
}

/// Everything that a ray-caster reads besides the atlas.
#[derive(Debug, Clone)]
pub struct FrameData {
    /// Camera and light.
    pub frame: Frame,
    /// Entries of the cut's grid.
    pub grid: Vec<[u32; 2]>,
    /// The cut: a node a square (and the one behind it, while it fades), several of which may show parts of one tile.
    pub nodes: Vec<Node>,
    /// Which squares those are.
    pub query: OcclusionQuery,
    /// Largest projected error of what is seen.
    pub error_px: f64,
}

/// What a selection draws.
#[derive(Debug, Clone, Copy)]
pub struct FrameInputs<'a> {
    /// Squares in the picture.
    pub transitions: &'a Transitions,
    /// What casts shadows on them.
    pub shadow_casters: &'a [NodeIndex],
    /// Which selection it is.
    pub generation: u64,
    /// Its largest projected error of what is seen.
    pub error_px: f64,
}

impl FrameData {
    /// Of a cut and of what casts shadows on it. What has left `cache` since it was selected is drawn from what it lay in.
    pub fn new(
        drawn: FrameInputs<'_>,
        tree: &SceneTree,
        cache: &AtlasCache,
        view: &View,
        look: &RenderSettings,
    ) -> Self {
        let mut frame = frame(tree, view, look);
        let list = List::new(&drawn, tree, cache, view);
        let manifest = tree.manifest();
        let root_error_m = HALF_DIAGONAL * manifest.cell_m_at(0);
        let place = Place {
            root_corner: DVec3::from(manifest.origin) - view.camera.position,
            root_side_m: manifest.root_side_m,
            root_distance_m: root_error_m * view.focal_px() / view.tau_px.max(1e-3),
        };
        let mut builder = Builder::default();
        let grid = builder.build_fading(&place, &list.ids, &list.shares, &list.nodes);
        grid.head.write(&mut frame);
        Self {
            frame,
            grid: grid.entries.clone(),
            nodes: list.nodes,
            query: OcclusionQuery { nodes: list.squares, view: *view, generation: drawn.generation },
            error_px: drawn.error_px.max(list.error_px),
        }
    }
}

/// Nodes as they are listed, and what is known of each.
struct List<'a> {
    tree: &'a SceneTree,
    cache: &'a AtlasCache,
    eye: DVec3,
    nodes: Vec<Node>,
    /// Which square shows it.
    ids: Vec<TileId>,
    /// How many rays see the next one in its place.
    shares: Vec<u8>,
    /// Which square of the cut its hits count for.
    squares: Vec<NodeIndex>,
    /// Largest projected error of what is seen and on its way out.
    error_px: f64,
}

impl<'a> List<'a> {
    fn new(drawn: &FrameInputs<'_>, tree: &'a SceneTree, cache: &'a AtlasCache, view: &View) -> Self {
        let FrameInputs { transitions: fades, shadow_casters: casters, .. } = *drawn;
        let most = fades.tiles().len() + fades.fading_count() + casters.len();
        let mut list = Self {
            tree,
            cache,
            eye: view.camera.position,
            nodes: Vec::with_capacity(most),
            ids: Vec::with_capacity(most),
            shares: Vec::with_capacity(most),
            squares: Vec::with_capacity(most),
            error_px: 0.0,
        };
        for shown in fades.tiles() {
            let (face, old) = shown.sources();
            if !list.push(shown.node, shown.owner, face, true) {
                continue;
            }
            if let Some((old, rays)) = old
                && list.push(shown.node, shown.owner, old, false)
            {
                let front = list.shares.len() - 2;
                list.shares[front] = rays;
                list.error_px = list.error_px.max(old.error_px(shown.node, tree, view));
            }
        }
        for at in casters.iter().filter(|at| !replaces(**at, fades, tree, view)) {
            list.push(*at, *at, DrawSource { source: *at, mesh_lod: None }, true);
        }
        list
    }

    /// Adds what `face` shows of a square, or if that has left the cache and `or_more` is set, what it lay in.
    fn push(&mut self, square: NodeIndex, of: NodeIndex, face: DrawSource, or_more: bool) -> bool {
        let Self { tree, cache, .. } = *self;
        let steps = if or_more { usize::MAX } else { 1 };
        let line = std::iter::successors(Some(face.source), |at| tree.node(*at).parent).take(steps);
        let mut line = line.map(|at| tree.node(at).id);
        let Some((id, placed)) = line.find_map(|id| Some((id, cache.get(id)?))) else { return false };
        let name = tree.node(square).id;
        let mut shown = node(id, placed, tree, self.eye);
        if let Some(mesh) = face.mesh_lod.and_then(|lod| cache.mesh(name, lod)) {
            put_mesh(&mut shown, name, mesh, (id, placed), tree, self.eye);
        }
        self.nodes.push(shown);
        self.ids.push(name);
        self.shares.push(0);
        self.squares.push(of);
        true
    }
}

/// Whether what casts shadows would be drawn where a square of the picture shows, or is about to show, something else: that
/// shall not change at once.
fn replaces(caster: NodeIndex, fades: &Transitions, tree: &SceneTree, view: &View) -> bool {
    let Some(shown) = fades.covering(caster, tree) else { return false };
    let (face, _) = shown.sources();
    if shown.node == caster && (face.source == caster || face.mesh_lod.is_some()) {
        return true;
    }
    fades.is_enabled()
        && shown.is_unoccluded
        && (shown.is_fading() || face.error_px(shown.node, tree, view) > view.tau_px)
}

fn frame(tree: &SceneTree, view: &View, look: &RenderSettings) -> Frame {
    let (camera, manifest) = (&view.camera, tree.manifest());
    let tan_y = (camera.fov_y_rad * 0.5).tan();
    Frame {
        forward: camera.forward.as_vec3().to_array(),
        width_px: view.width_px,
        right: (camera.right * tan_y * view.aspect()).as_vec3().to_array(),
        height_px: view.height_px,
        up: (camera.up * tan_y).as_vec3().to_array(),
        samples: look.samples.clamp(1, MAX_SAMPLES),
        sun: look.sun.as_vec3().to_array(),
        shading: look.shading as u32,
        ground_z_m: (manifest.ground_z_m - camera.position.z) as f32,
        ground: 1,
        light: look.light,
        shadow_m: if look.shadow_casting_sun().is_some() { look.shadow_m as f32 } else { 0.0 },
        ..Frame::zeroed()
    }
}

fn node(id: TileId, placed: &CachedNode, tree: &SceneTree, eye: DVec3) -> Node {
    let planes = std::array::from_fn(|plane| placed.pages.get(plane).copied().unwrap_or_default());
    Node {
        corner: corner(id, placed, tree, eye),
        // The manifest's side, so that neighbours meet to the last bit.
        cell_m: tree.manifest().cell_m_at(id.level()) as f32,
        z_step_m: placed.z_step_m,
        z_lo: placed.z_range[0],
        z_hi: placed.z_range[1],
        slot_and_shift: Node::slot_and_shift(placed.slot, placed.z_shift),
        pages: Node::pages_and_quarters(planes, placed.below),
        level: u32::from(id.level()),
        ..Node::zeroed()
    }
}

/// South-west corner of a square at height code 0 of a tile, from `eye`.
fn corner(square: TileId, placed: &CachedNode, tree: &SceneTree, eye: DVec3) -> [f32; 3] {
    (DVec3::from(tree.manifest().node_corner(square)) + DVec3::Z * placed.z_base_m - eye).as_vec3().to_array()
}

/// Puts the mesh of `leaf` in place of the columns of `node`, which is of the tile that the leaf is or lies in.
fn put_mesh(
    node: &mut Node,
    leaf: TileId,
    mesh: &CachedMesh,
    (tile, placed): (TileId, &CachedNode),
    tree: &SceneTree,
    eye: DVec3,
) {
    node.mesh = 1 + mesh.head_page * (PAGE_WORDS / 4) as u32;
    node.mesh_z_m = (tree.manifest().origin[2] - eye.z) as f32;
    let [low, high] = mesh.z_m.map(|z_m| ((f64::from(z_m) - placed.z_base_m) / f64::from(placed.z_step_m)) as f32);
    (node.z_lo, node.z_hi) = (low, high);
    node.corner = corner(leaf, placed, tree, eye);
    (node.place_in, node.level) = (place_in(leaf, tile), u32::from(leaf.level()));
}
