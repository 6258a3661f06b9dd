//! Frame assembly: the arrays that the ray-caster reads, besides the atlas.
//!
//! In: a draw list with its cross-fades, the cache, a view, [`RenderSettings`]. Out: [`FrameData`]. Next: the shell's ray-caster.
//!
//! Positions are made relative to the camera in f64 and only then rounded to f32. The camera is where rays may begin.

use crate::cache::{AtlasCache, CachedMesh, CachedNode};
use crate::camera::{Camera, View};
use crate::projection::ray_direction;
use crate::scene::{NodeIndex, SceneTree};
use crate::select::occlusion_feedback::OcclusionQuery;
use crate::select::transitions::{DrawSource, Transitions};
use crate::translucency::{DrawnLandmarks, DrawnTile, Translucency};
use bytemuck::Zeroable;
use glam::DVec3;
use insula_protocol::blockmap::voxel_error_m;
use insula_protocol::{Manifest, NODE_CELLS, TileId};
use insula_shaders::cpu::night::bays_of;
use insula_shaders::grid::{GridBuilder, GridFrame};
use insula_shaders::layout::{DrawNode, FrameUniform, Light, MAX_SAMPLES, MESH_LEVEL, PAGE_WORDS, Shading};
use insula_shaders::light::{Air, NightLights, SUN_RADIUS_RAD};
use insula_shaders::look::{Look, low_sun};
use insula_shaders::mesh::{leaf_offset, ray_origin};
use insula_shaders::stone::{MAX_STONES, Stone};

/// Rays along a pixel's side while the camera is still: two miss much of a texture that is finer than the pixels, four gain
/// little.
pub const STILL_SAMPLES: u32 = 3;
/// Rays along a pixel's side while the camera moves, on a device that is fast enough: with one ray a slow pan shimmers
/// (docs/measurements.md).
pub const MOVING_SAMPLES: u32 = 2;

/// How a frame is rendered, apart from the view.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RenderSettings {
    /// What pixels show.
    pub shading: Shading,
    /// Rays along a pixel's side, 1 to [`MAX_SAMPLES`].
    pub samples: u32,
    /// Unit vector towards the sun.
    pub sun: DVec3,
    /// Light of the sun and the sky, in the look.
    pub light: Light,
    /// How a lit city is shown.
    pub look: Look,
    /// Whether there are the look's lines at silhouettes, and its shade where surfaces meet.
    pub edges: [bool; 2],
    /// Longest shadow; 0 without shadows.
    pub shadow_m: f64,
    /// Factor from radiance to display; 0: by the frame's mean.
    pub exposure: f32,
    /// Light through stones.
    pub translucency: Translucency,
}

impl RenderSettings {
    /// Lit by a sun in direction `sun` through `air`, in physical light. One ray a pixel, no shadows.
    pub(crate) fn lit_by(sun: DVec3, air: Air, night: &NightLights) -> Self {
        let light = Light::new(sun.as_vec3(), air, night);
        Self {
            shading: Shading::Lit,
            samples: 1,
            sun,
            light,
            look: Look::Physical,
            edges: [true; 2],
            shadow_m: 0.0,
            exposure: 0.0,
            translucency: Translucency::default(),
        }
    }

    /// The same in another look.
    #[must_use]
    pub(crate) fn in_look(self, look: Look) -> Self {
        Self { light: look.grade(self.light, self.sun.as_vec3()), look, ..self }
    }

    /// Direction to the sun if it casts shadows: by day, with shadows enabled, and where light is shown.
    pub fn shadow_casting_sun(&self) -> Option<DVec3> {
        let is_day = self.sun.z > 0.0 && self.light.sun[0] > 0.0;
        (is_day && self.shadow_m > 0.0 && self.shading == Shading::Lit).then_some(self.sun)
    }
}

impl Default for RenderSettings {
    /// Lit by an afternoon sun in the south-west, 45 degrees high.
    fn default() -> Self {
        let sun = DVec3::new(-0.45, -0.55, 0.71).normalize_or(DVec3::Z);
        Self::lit_by(sun, Air::default(), &NightLights::default())
    }
}

/// Everything that a ray-caster reads besides the atlas.
#[derive(Debug, Clone)]
pub struct FrameData {
    pub frame: FrameUniform,
    pub grid: Vec<[u32; 2]>,
    /// Nodes: one for each entry of the draw list, another for its old source while it cross-fades, shadow casters, and what is added to
    /// the city.
    pub nodes: Vec<DrawNode>,
    /// The entries of the draw list that the hits of `nodes` count for; those of what is added count for none.
    pub query: OcclusionQuery,
    /// Largest screen-space error that is visible, in pixels.
    pub error_px: f64,
}

/// What a frame shows.
#[derive(Debug, Clone, Copy)]
pub struct FrameInputs<'a> {
    /// The draw list with its cross-fades.
    pub transitions: &'a Transitions,
    pub shadow_casters: &'a [NodeIndex],
    /// Number of the draw list.
    pub generation: u64,
    /// Largest screen-space error of visible nodes in the draw list, in pixels.
    pub error_px: f64,
}

impl FrameData {
    /// Leaves one ray of the frame: that at shares of the width and height of `view`, 0 to 1 from the upper left corner.
    pub fn narrow_to_ray(&mut self, view: &View, [x, y]: [f64; 2]) {
        self.frame.forward = ray_direction(view, x, y).as_vec3().to_array();
        self.frame.right = self.frame.right.map(|v| v / view.width_px as f32);
        self.frame.up = self.frame.up.map(|v| v / view.height_px as f32);
        (self.frame.width_px, self.frame.height_px) = (1, 1);
    }

    /// Assembles a frame. What has been evicted from `cache` since the selection is drawn from its nearest resident ancestor.
    pub fn new(
        inputs: FrameInputs<'_>,
        tree: &SceneTree,
        cache: &AtlasCache,
        view: &View,
        settings: &RenderSettings,
    ) -> Self {
        let view = &View { camera: Camera { position: ray_origin(view.camera.position), ..view.camera }, ..*view };
        let mut frame = frame_uniform(view, settings, tree.manifest().ground_z_m, tree.stones());
        if settings.look.has_fog() {
            let low_sun = f64::from(low_sun(settings.sun.as_vec3()));
            (frame.fog, frame.city) = fog_around(tree.manifest(), view.camera.position, low_sun);
            if let Some(shore) = tree.shore().or(cache.shore()) {
                let corner = DVec3::from(tree.manifest().origin) - view.camera.position;
                shore.write(&mut frame, corner.truncate(), tree.manifest().root_side_m);
            }
        }
        frame.objects = u32::from(settings.shading == Shading::Objects || cache.has_styles());
        frame.landmarks = u32::from(cache.has_landmarks());
        let mut list = NodeList::new(&inputs, tree, cache, view);
        if list.weight > 0.0 {
            frame.light.set_albedo_log2((list.albedo_log2 / list.weight) as f32);
        }
        list.landmarks.write(&mut frame, view, settings.translucency, cache.capacity_pages(), &list.drawn);
        let manifest = tree.manifest();
        let root_error_m = voxel_error_m(manifest.cell_m_at(0));
        let grid_frame = GridFrame {
            root_corner: DVec3::from(manifest.origin) - view.camera.position,
            root_side_m: manifest.root_side_m,
            root_distance_m: root_error_m * view.focal_px() / view.tau_px.max(1e-3),
        };
        let mut builder = GridBuilder::default();
        let grid = builder.build_fading(&grid_frame, &list.ids, &list.fade_rays, &list.nodes);
        grid.head.write(&mut frame);
        frame.additions = cache.add_nodes(&mut list.nodes, view.camera.position);
        Self {
            frame,
            grid: grid.entries.clone(),
            nodes: list.nodes,
            query: OcclusionQuery { nodes: list.owners, view: *view, generation: inputs.generation },
            error_px: inputs.error_px.max(list.fading_error_px),
        }
    }
}

/// The ray-caster's nodes, and what belongs to each.
struct NodeList<'a> {
    tree: &'a SceneTree,
    cache: &'a AtlasCache,
    eye: DVec3,
    nodes: Vec<DrawNode>,
    /// The nodes of the scene tree whose areas they cover.
    ids: Vec<TileId>,
    /// Number of rays that see the next node of the list instead.
    fade_rays: Vec<u8>,
    /// The nodes of the draw list that their hits count for.
    owners: Vec<NodeIndex>,
    /// Largest screen-space error of a source that fades out, in pixels.
    fading_error_px: f64,
    /// Sum of the mean log2 of the albedos of what is drawn, weighted by about its part of the view, and of these weights.
    albedo_log2: f64,
    weight: f64,
    landmarks: DrawnLandmarks,
    /// The tiles, if there may be landmarks among them.
    drawn: Vec<DrawnTile>,
}

#[derive(Clone, Copy)]
struct ListEntry {
    node: NodeIndex,
    owner: NodeIndex,
    drawn: DrawSource,
}

impl<'a> NodeList<'a> {
    fn new(inputs: &FrameInputs<'_>, tree: &'a SceneTree, cache: &'a AtlasCache, view: &View) -> Self {
        let FrameInputs { transitions, shadow_casters, .. } = *inputs;
        let capacity = transitions.tiles().len() + transitions.fading_count() + shadow_casters.len();
        let mut list = Self {
            tree,
            cache,
            eye: view.camera.position,
            nodes: Vec::with_capacity(capacity),
            ids: Vec::with_capacity(capacity),
            fade_rays: Vec::with_capacity(capacity),
            owners: Vec::with_capacity(capacity),
            fading_error_px: 0.0,
            albedo_log2: 0.0,
            weight: 0.0,
            landmarks: DrawnLandmarks::default(),
            drawn: Vec::new(),
        };
        // Finer nodes than those of the draw list may have been evicted since the last step.
        for tile in transitions.tiles().iter().filter(|tile| tree.is_known(tile.node)) {
            let (drawn, fading_out) = tile.sources();
            let entry = ListEntry { node: tile.node, owner: tile.owner, drawn };
            if !list.push(entry) {
                continue;
            }
            if let Some((old, rays)) = fading_out
                && cache.get(tree.node(old.source).id).is_some()
            {
                list.push(ListEntry { drawn: old, ..entry });
                let new = list.fade_rays.len() - 2;
                list.fade_rays[new] = rays;
                list.fading_error_px = list.fading_error_px.max(old.error_px(tile.node, tree, view));
            }
        }
        let metered = (list.albedo_log2, list.weight);
        for caster in shadow_casters.iter().filter(|caster| !replaces_drawn(**caster, transitions, tree, view)) {
            let drawn = DrawSource { source: *caster, mesh_lod: None };
            list.push(ListEntry { node: *caster, owner: *caster, drawn });
        }
        (list.albedo_log2, list.weight) = metered;
        list
    }

    /// Adds an entry, drawn from the nearest ancestor in the cache if its source is not there. Returns whether there is one.
    fn push(&mut self, entry: ListEntry) -> bool {
        let Self { tree, cache, eye, .. } = *self;
        let mut line = std::iter::successors(Some(entry.drawn.source), |node| tree.node(*node).parent);
        let source = line.find_map(|node| {
            let id = tree.node(node).id;
            Some(CachedSource { id, cached: cache.get(id)? })
        });
        let Some(source) = source else { return false };
        let id = tree.node(entry.node).id;
        let mut node = source.node(tree, eye);
        if let Some((lod, mesh)) = entry.drawn.mesh_lod.and_then(|lod| Some((lod, cache.mesh(id, lod)?))) {
            source.set_mesh(&mut node, id, mesh, tree, eye);
            node.level = MESH_LEVEL + u32::from(lod);
            let origin = DVec3::from(tree.manifest().node_corner(id)).with_z(tree.manifest().origin[2]);
            self.landmarks.add(&mesh.landmarks, origin);
        }
        let side_m = tree.manifest().cell_m_at(id.level()) * NODE_CELLS as f64;
        let centre = DVec3::from(tree.manifest().node_corner(id)).truncate() + 0.5 * side_m;
        let area = side_m * side_m;
        let weight = area / (area + (centre - eye.truncate()).length_squared());
        self.albedo_log2 += weight * f64::from(source.cached.albedo_log2);
        self.weight += weight;
        if cache.has_landmarks() {
            let mesh_lod = if node.mesh != 0 { entry.drawn.mesh_lod } else { None };
            let half_m = side_m * std::f64::consts::FRAC_1_SQRT_2;
            self.drawn.push(DrawnTile { id, source: source.id, mesh_lod, centre, half_m });
        }
        self.nodes.push(node);
        self.ids.push(id);
        self.fade_rays.push(0);
        self.owners.push(entry.owner);
        true
    }
}

/// Whether a shadow caster would be drawn where the draw list shows, or is about to show, something else. The frame must not change
/// by that at once.
fn replaces_drawn(caster: NodeIndex, transitions: &Transitions, tree: &SceneTree, view: &View) -> bool {
    let Some(tile) = transitions.covering(caster, tree) else { return false };
    let (drawn, _) = tile.sources();
    if tile.node == caster && (drawn.source == caster || drawn.mesh_lod.is_some()) {
        return true;
    }
    transitions.is_enabled()
        && tile.is_unoccluded
        && (tile.is_fading() || drawn.error_px(tile.node, tree, view) > view.tau_px)
}

/// Camera and light of a frame of a city, without its grid and its landmarks.
pub(crate) fn frame_uniform(
    view: &View,
    settings: &RenderSettings,
    ground_z_m: f64,
    stones: &[Stone; MAX_STONES],
) -> FrameUniform {
    let camera = &view.camera;
    let tan_y = (camera.fov_y_rad * 0.5).tan();
    let samples = settings.samples.clamp(1, MAX_SAMPLES);
    FrameUniform {
        forward: camera.forward.as_vec3().to_array(),
        width_px: view.width_px,
        right: (camera.right * tan_y * view.aspect()).as_vec3().to_array(),
        height_px: view.height_px,
        up: (camera.up * tan_y).as_vec3().to_array(),
        samples,
        sun: settings.sun.as_vec3().to_array(),
        shading: settings.shading as u32,
        ground_z_m: (ground_z_m - camera.position.z) as f32,
        ground: 1,
        stones: *stones,
        bays: bays_of(camera.position, (2.0 * tan_y / f64::from((view.height_px * samples).max(1))) as f32),
        light: settings.light,
        edges: edges_of(settings),
        shadow_m: if settings.shadow_casting_sun().is_some() { settings.shadow_m as f32 } else { 0.0 },
        exposure: settings.exposure,
        // With many rays per pixel, those to the sun can show its penumbra.
        sun_radius: if settings.samples >= STILL_SAMPLES { SUN_RADIUS_RAD } else { 0.0 },
        ..FrameUniform::zeroed()
    }
}

/// [`FrameUniform::edges`].
fn edges_of(settings: &RenderSettings) -> [f32; 4] {
    let [lines, contact] = settings.look.edges();
    let strength = |is_on: bool, strength: f32| if is_on { strength } else { 0.0 };
    [strength(settings.edges[0], lines), strength(settings.edges[1], contact), 0.0, 0.0]
}

/// Fog begins at this share of the city's half diagonal from the camera, and is as deep as this multiple of it: by day, and under a low
/// sun. Then the sky is much brighter than the land, which would end in a grey band; but less than half of the light of a first view's
/// far side may be fog's, or an evening looks like smog.
const FOG_START: [f64; 2] = [0.9, 0.7];
const FOG_DEPTH: [f64; 2] = [5.0, 3.5];
/// A camera that is further than this multiple from the city's middle, as that of an upright picture, takes the fog along: it would
/// hide the city.
const FOG_REACH: f64 = 1.7;
/// Land around the city fades within this share of it.
const LAND_DEPTH: f64 = 0.2;
/// Least half diagonal in metres: fog around a single house would hide its street.
const LEAST_CITY_M: f64 = 700.0;

/// [`FrameUniform::fog`] and [`FrameUniform::city`] around a city. `low_sun`: as [`low_sun()`] has it.
fn fog_around(manifest: &Manifest, eye: DVec3, low_sun: f64) -> ([f32; 4], [f32; 4]) {
    let [start, depth] = [FOG_START, FOG_DEPTH].map(|[day, evening]| day + (evening - day) * low_sun);
    let [low, high] = manifest.focus;
    let half_m = (0.5 * (high[0] - low[0]).hypot(high[1] - low[1])).max(LEAST_CITY_M);
    let [[west, south, low_m], [east, north, _]] = manifest.bounds;
    let middle = DVec3::new(0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1]), low_m);
    let back_m = (middle.distance(eye) - FOG_REACH * half_m).max(0.0);
    let fog = [start * half_m + back_m, 1.0 / (depth * half_m), 1.0 / (LAND_DEPTH * half_m), 0.0];
    // What lies between the eye and the city does not fade: fog in front of it would hide its foreground.
    let city = [(west - eye.x).min(0.0), (south - eye.y).min(0.0), (east - eye.x).max(0.0), (north - eye.y).max(0.0)];
    (fog.map(|v| v as f32), city.map(|v| v as f32))
}

/// A V-BlockMap in the cache.
#[derive(Clone, Copy)]
struct CachedSource<'a> {
    id: TileId,
    cached: &'a CachedNode,
}

impl CachedSource<'_> {
    /// The ray-caster's node for the V-BlockMap.
    fn node(&self, tree: &SceneTree, eye: DVec3) -> DrawNode {
        let cached = self.cached;
        let planes = std::array::from_fn(|plane| cached.pages.get(plane).copied().unwrap_or_default());
        DrawNode {
            corner: self.corner_of(self.id, tree, eye),
            // The manifest's side, so that neighbours meet to the last bit.
            cell_m: tree.manifest().cell_m_at(self.id.level()) as f32,
            z_step_m: cached.z_step_m,
            z_lo: cached.z_range[0],
            z_hi: cached.z_range[1],
            slot_and_shift: DrawNode::slot_and_shift(cached.slot, cached.z_shift),
            pages: DrawNode::pages_and_quarters(planes, cached.below),
            level: u32::from(self.id.level()),
            object_page: cached.object_page,
            palette: cached.palette,
            ..DrawNode::zeroed()
        }
    }

    /// South-west corner of a node's area at the V-BlockMap's height code 0, relative to `eye`.
    fn corner_of(&self, node: TileId, tree: &SceneTree, eye: DVec3) -> [f32; 3] {
        let corner = DVec3::from(tree.manifest().node_corner(node));
        (corner + DVec3::Z * self.cached.z_base_m - eye).as_vec3().to_array()
    }

    /// Replaces the columns of `node` by the mesh of `leaf`, which is the V-BlockMap's node or a descendant.
    fn set_mesh(&self, node: &mut DrawNode, leaf: TileId, mesh: &CachedMesh, tree: &SceneTree, eye: DVec3) {
        node.mesh = 1 + mesh.head_page * (PAGE_WORDS / 4) as u32;
        node.mesh_z_m = (tree.manifest().origin[2] - eye.z) as f32;
        let to_code = |z_m: f32| ((f64::from(z_m) - self.cached.z_base_m) / f64::from(self.cached.z_step_m)) as f32;
        [node.z_lo, node.z_hi] = mesh.z_m.map(to_code);
        node.corner = self.corner_of(leaf, tree, eye);
        node.leaf_offset = leaf_offset(leaf, self.id);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_test_support::small_city::empty_manifest;

    #[test]
    fn a_camera_far_from_the_city_takes_the_fog_along() {
        let (focus, bounds) = ([[0.0, 0.0], [3000.0, 4000.0]], [[0.0; 3], [3000.0, 4000.0, 50.0]]);
        let manifest = Manifest { focus, bounds, ..empty_manifest(2) };
        let start_m = |back_m: f64| {
            let ([start_m, ..], _) = fog_around(&manifest, DVec3::new(1500.0, 2000.0 - back_m, 0.0), 0.0);
            f64::from(start_m)
        };
        let near_m = FOG_START[0] * 2500.0;
        assert_eq!([0.0, 4000.0].map(start_m), [near_m; 2]);
        assert!((start_m(10_000.0) - near_m - (10_000.0 - FOG_REACH * 2500.0)).abs() < 1.0);
        let ([evening_m, density, ..], _) = fog_around(&manifest, DVec3::new(1500.0, 2000.0, 0.0), 1.0);
        assert!(f64::from(evening_m) < 0.8 * near_m && f64::from(density) * FOG_DEPTH[0] * 2500.0 > 1.4);
        // The far side of a first view under a low sun.
        let deep = (2.7 * 2500.0 - f64::from(evening_m)) * f64::from(density);
        assert!(1.0 - (-deep.powf(1.25)).exp() < 0.5, "{deep}");
    }

    #[test]
    fn land_before_the_city_does_not_fade() {
        let (focus, bounds) = ([[0.0, 0.0], [3000.0, 4000.0]], [[0.0; 3], [3000.0, 4000.0, 50.0]]);
        let manifest = Manifest { focus, bounds, ..empty_manifest(2) };
        let city = |eye: DVec3| fog_around(&manifest, eye, 0.0).1;
        assert_eq!(city(DVec3::new(500.0, 1000.0, 90.0)), [-500.0, -1000.0, 2500.0, 3000.0]);
        assert_eq!(city(DVec3::new(500.0, -1000.0, 90.0)), [-500.0, 0.0, 2500.0, 5000.0]);
    }
}
