//! Nodes to draw, in memory as the client's cache lays them out, without limits.

use crate::view::{Camera, FrameSpec};
use glam::{DVec3, Vec2, Vec3};
use insula_protocol::blockmap::voxel_error_m;
use insula_protocol::{BlockMap, NODE_CELLS, TileId};
use insula_shaders::cpu::raycast::{Pixels, SceneRef};
use insula_shaders::cpu::render::render;
use insula_shaders::grid::{self, GridBuilder};
use insula_shaders::layout::{ADDED_LEVEL, DrawNode, FrameUniform, PAGE_WORDS, PLANES, SUMMARY_WORDS, Shading};
use insula_shaders::mesh::{PackedMesh, leaf_offset};
use insula_shaders::pack::PackedNode;
use std::collections::BTreeMap;

/// Position and size of a city.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CityArea {
    /// South-west corner of the root, and the height that heights of nodes are relative to, in world metres.
    pub origin: [f64; 3],
    pub root_side_m: f64,
}

#[derive(Debug, Clone)]
struct Drawn {
    id: TileId,
    pages: [u32; PLANES],
    cell_m: f32,
    z_step_m: f32,
    z_base_m: f64,
    z_range: [f32; 2],
    below: [u8; 4],
    z_shift: u32,
    /// 1 + position of its mesh in the atlas, in units of four words; 0 without a mesh.
    mesh: u32,
    square: TileId,
    object_page: u32,
    palette: u32,
    /// How many of 64 rays see the next node instead, during a cross-fade.
    share: u8,
}

/// None of the nodes may contain another.
#[derive(Debug, Clone)]
pub struct DrawList {
    area: CityArea,
    drawn: Vec<Drawn>,
    summaries: Vec<u32>,
    atlas: Vec<u32>,
    /// Objects by the first words of their palettes.
    palettes: BTreeMap<u32, Vec<u32>>,
}

impl DrawList {
    pub fn new(area: CityArea) -> Self {
        Self { area, drawn: Vec::new(), summaries: Vec::new(), atlas: Vec::new(), palettes: BTreeMap::new() }
    }

    pub fn add(&mut self, map: &BlockMap) {
        self.add_in(map.id, map);
    }

    /// Adds a node, of which only the part in `square` is drawn.
    pub fn add_in(&mut self, square: TileId, map: &BlockMap) {
        let mut packed = PackedNode::new(map);
        let first = (self.atlas.len() / PAGE_WORDS) as u32;
        let pages: Vec<u32> = (first..first + packed.pages.len() as u32).collect();
        packed.relocate(&pages);
        for page in &packed.pages {
            self.atlas.extend_from_slice(page);
        }
        self.summaries.extend_from_slice(&packed.summary);
        self.drawn.push(Drawn {
            id: map.id,
            pages: std::array::from_fn(|plane| pages[plane]),
            cell_m: packed.cell_m,
            z_step_m: packed.z_step_m,
            z_base_m: packed.z_base_m,
            z_range: packed.z_range,
            below: packed.below,
            z_shift: packed.z_shift,
            mesh: 0,
            square,
            object_page: packed.objects.as_ref().and(pages.last()).copied().unwrap_or(0),
            palette: packed.objects.as_ref().map_or(0, |objects| objects.palette),
            share: 0,
        });
        self.palettes.extend(packed.objects.map(|objects| (objects.palette, objects.list)));
    }

    /// Adds the other side of a cross-fade: of 64 rays, `share` see this node instead of the one added last, in the same square.
    pub fn add_behind(&mut self, map: &BlockMap, share: u8) {
        let Some(front) = self.drawn.last_mut() else { return };
        front.share = share;
        let square = front.square;
        self.add_in(square, map);
    }

    /// Draws `leaf`, which was added before, as a mesh.
    pub fn add_mesh(&mut self, leaf: TileId, mut mesh: PackedMesh) {
        let Some(drawn) = self.drawn.iter_mut().find(|drawn| drawn.square == leaf) else { return };
        let first = (self.atlas.len() / PAGE_WORDS) as u32;
        let pages: Vec<u32> = (first..first + mesh.pages.len() as u32).collect();
        mesh.relocate(&pages);
        self.palettes.extend(mesh.objects.take().map(|objects| (objects.palette, objects.list)));
        drawn.mesh = 1 + first * PAGE_WORDS as u32 / 4;
        let codes = mesh.z_m.map(|z| ((f64::from(z) - drawn.z_base_m) / f64::from(drawn.z_step_m)) as f32);
        drawn.z_range = [drawn.z_range[0].min(codes[0]), drawn.z_range[1].max(codes[1])];
        for page in &mesh.pages {
            self.atlas.extend_from_slice(page);
        }
    }

    pub fn len(&self) -> usize {
        self.drawn.len()
    }

    pub fn is_empty(&self) -> bool {
        self.drawn.is_empty()
    }

    /// The node of a pixel's `hit`.
    pub fn id(&self, hit: u32) -> Option<TileId> {
        self.drawn.get(hit as usize).map(|drawn| drawn.id)
    }

    /// Sets each object's word in the palettes.
    pub fn set_styles(&mut self, word: impl Fn(u32) -> u32) {
        for (palette, list) in &self.palettes {
            for (at, object) in (*palette as usize..).zip(list) {
                self.atlas[at] = word(*object);
            }
        }
    }

    /// The object of a pixel of a frame with [`Shading::Objects`].
    pub fn object_at(&self, address: u32) -> Option<u32> {
        let (first, list) = self.palettes.range(..=address).next_back()?;
        list.get((address - first) as usize).copied()
    }

    /// The input of the ray-caster for this camera.
    /// Adds words to the atlas, in pages of their own. Returns the place of the first.
    pub fn add_words(&mut self, words: &[u32]) -> u32 {
        let first = self.atlas.len() as u32;
        self.atlas.extend_from_slice(words);
        self.atlas.resize(self.atlas.len().next_multiple_of(PAGE_WORDS), 0);
        first
    }

    /// Replaces words of the atlas.
    pub fn set_words(&mut self, first: u32, words: &[u32]) {
        self.atlas[first as usize..][..words.len()].copy_from_slice(words);
    }

    pub fn scene(&self, camera: &Camera, spec: &FrameSpec) -> Scene<'_> {
        let p = camera.position;
        let relative = |x: f64, y: f64, z: f64| {
            let [ox, oy, oz] = self.area.origin;
            [(ox + x - p[0]) as f32, (oy + y - p[1]) as f32, (oz + z - p[2]) as f32]
        };
        let nodes = self.drawn.iter().enumerate().map(|(slot, drawn)| {
            // A mesh lies in its leaf, even if its sky occlusion is that of an ancestor's columns.
            let id = if drawn.mesh == 0 { drawn.id } else { drawn.square };
            let side_m = self.area.root_side_m / f64::from(1u32 << id.level());
            let (x, y) = (f64::from(id.x()) * side_m, f64::from(id.y()) * side_m);
            DrawNode {
                corner: relative(x, y, drawn.z_base_m),
                cell_m: drawn.cell_m,
                z_step_m: drawn.z_step_m,
                z_lo: drawn.z_range[0],
                z_hi: drawn.z_range[1],
                slot_and_shift: DrawNode::slot_and_shift(slot as u32, drawn.z_shift),
                pages: DrawNode::pages_and_quarters(drawn.pages, drawn.below),
                level: u32::from(id.level()),
                mesh: drawn.mesh,
                mesh_z_m: relative(x, y, 0.0)[2],
                leaf_offset: if drawn.mesh == 0 { 0 } else { leaf_offset(drawn.square, drawn.id) },
                object_page: drawn.object_page,
                palette: drawn.palette,
                unused: [0; 2],
            }
        });
        let nodes: Vec<DrawNode> = nodes.collect();
        let (ids, shares): (Vec<TileId>, Vec<u8>) = self.drawn.iter().map(|drawn| (drawn.square, drawn.share)).unzip();
        let focal_px = f64::from(spec.height_px) / (2.0 * (camera.fov_y_deg.to_radians() / 2.0).tan());
        let area = grid::GridFrame {
            root_corner: DVec3::from(self.area.origin) - DVec3::from(p),
            root_side_m: self.area.root_side_m,
            // For a tolerance of one pixel; the value only affects speed.
            root_distance_m: voxel_error_m(self.area.root_side_m / NODE_CELLS as f64) * focal_px,
        };
        let mut builder = GridBuilder::default();
        let grid = builder.build_fading(&area, &ids, &shares, &nodes);
        let mut frame = camera.frame(spec);
        grid.head.write(&mut frame);
        frame.objects = u32::from(spec.shading == Shading::Objects);
        Scene { frame, nodes, grid: grid.entries.clone(), draw_list: self }
    }
}

/// The input of the ray-casters for one view.
#[derive(Debug, Clone)]
pub struct Scene<'a> {
    pub frame: FrameUniform,
    /// Positions relative to the camera.
    pub nodes: Vec<DrawNode>,
    pub grid: Vec<[u32; 2]>,
    draw_list: &'a DrawList,
}

impl Scene<'_> {
    pub fn as_ref(&self) -> SceneRef<'_> {
        SceneRef {
            frame: &self.frame,
            grid: &self.grid,
            nodes: &self.nodes,
            summaries: &self.draw_list.summaries,
            atlas: &self.draw_list.atlas,
        }
    }

    /// The same scene within `share_px` of a place of the frame, in pixels from its upper left corner, with 17 x 17 rays.
    pub fn close_up(&self, centre_px: Vec2, share_px: f32) -> Self {
        let mut near = self.clone();
        let frame = &mut near.frame;
        let size = Vec2::new(frame.width_px as f32, frame.height_px as f32);
        let ndc = centre_px / size * 2.0 - 1.0;
        let (right, up) = (Vec3::from(frame.right), Vec3::from(frame.up));
        frame.forward = (Vec3::from(frame.forward) + right * ndc.x - up * ndc.y).into();
        frame.right = (right * (2.0 * share_px / size.x)).into();
        frame.up = (up * (2.0 * share_px / size.y)).into();
        (frame.width_px, frame.height_px, frame.samples) = (17, 17, 1);
        near
    }

    /// Adds copies of all meshes, moved by some metres, to the city.
    pub fn add_moved_meshes(&mut self, by_m: [f32; 3]) {
        let moved = |node: &DrawNode| DrawNode {
            corner: std::array::from_fn(|k| node.corner[k] + by_m[k]),
            mesh_z_m: node.mesh_z_m + by_m[2],
            level: ADDED_LEVEL,
            ..*node
        };
        let moved: Vec<DrawNode> = self.nodes.iter().filter(|node| node.mesh != 0).map(moved).collect();
        self.frame.additions = [self.nodes.len() as u32, moved.len() as u32];
        self.nodes.extend(moved);
    }

    pub fn render(&self) -> Pixels {
        render(&self.as_ref())
    }

    /// Numbers of nodes and pages that a GPU must hold.
    pub fn slots_and_pages(&self) -> (u32, u32) {
        let pages = self.draw_list.atlas.len() / PAGE_WORDS;
        ((self.draw_list.summaries.len() / SUMMARY_WORDS) as u32, pages as u32)
    }
}
