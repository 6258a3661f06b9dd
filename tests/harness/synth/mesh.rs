//! The triangles of a city on a GPU, as a plain renderer draws them.
//!
//! Tiles of blocks are culled by the view frustum and drawn front to back, with one draw call each. A corner has 8 bytes.

use super::City;
use super::triangles::{self, Corner};
use crate::view::{Camera, FrameSpec};
use anyhow::Result;
use glam::{DVec2, DVec3, Vec3};
use insula_shaders::gpu::nearest::{depth_pass, depth_pipeline};
use insula_shaders::gpu::{bind_group, buffer, shader_module, target};
use std::ops::Range;

const TILE_BLOCKS: i32 = 4;
/// Resolution of positions.
const STEPS_PER_M: f32 = 128.0;
const CORNER_BYTES: usize = 8;
const BUFFER_CORNERS: usize = 12 << 20;
const NEAR_M: f32 = 0.3;

const WGSL: &str = "
struct View { clip_from_world: mat4x4<f32>, sun: vec4<f32> }
struct Out { @builtin(position) p: vec4<f32>, @location(0) rgb: vec3<f32> }
@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> origins: array<vec4<f32>>;
@vertex
fn corner(@location(0) word: vec2<u32>, @builtin(instance_index) tile: u32) -> Out {
    let step = vec3<f32>(f32(word.x & 0xffffu), f32(word.x >> 16u), f32(word.y & 0xffffu)) / 128.0;
    let code = word.y >> 16u;
    let turn = f32((code >> 12u) & 7u) * 0.7853982;
    let wall = vec3<f32>(cos(turn), sin(turn), 0.0);
    let n = select(wall, vec3<f32>(0.0, 0.0, 1.0), (code & 0x8000u) != 0u);
    let rgb = vec3<f32>(f32((code >> 8u) & 15u), f32((code >> 4u) & 15u), f32(code & 15u)) / 15.0;
    let light = 0.4 + 0.6 * max(dot(n, view.sun.xyz), 0.0);
    return Out(view.clip_from_world * vec4<f32>(origins[tile].xyz + step, 1.0), rgb * light);
}
@fragment
fn colour(in: Out) -> @location(0) vec4<f32> {
    return vec4<f32>(in.rgb, 1.0);
}
";

#[derive(Debug)]
struct Tile {
    centre: DVec3,
    half: DVec3,
    buffer: usize,
    corners: Range<u32>,
    origin: Vec3,
}

/// The triangles of a city in GPU memory.
#[derive(Debug)]
pub struct Mesh {
    tiles: Vec<Tile>,
    buffers: Vec<wgpu::Buffer>,
    pipeline: wgpu::RenderPipeline,
    view: wgpu::Buffer,
    bind_group: wgpu::BindGroup,
    pub triangles: u64,
}

#[derive(Debug)]
pub struct Target {
    colour: wgpu::Texture,
    depth: wgpu::Texture,
}

impl Mesh {
    pub fn new(device: &wgpu::Device, queue: &wgpu::Queue, city: &City) -> Result<Self> {
        let mut uploader =
            MeshUploader { device, queue, tiles: Vec::new(), buffers: Vec::new(), pending: Vec::new(), corners: 0 };
        let [low, high] = city.plan.bounds();
        let (first, last) = (city.plan.blocks_in(low, low).next(), city.plan.blocks_in(high, high).last());
        let ([i0, j0], [i1, j1]) = (first.unwrap_or_default(), last.unwrap_or_default());
        for j in (j0..=j1).step_by(TILE_BLOCKS as usize) {
            for i in (i0..=i1).step_by(TILE_BLOCKS as usize) {
                uploader.tile(city, [i, j]);
            }
        }
        uploader.flush();
        let MeshUploader { tiles, buffers, corners, .. } = uploader;
        let view = buffer(device, "view", 80, wgpu::BufferUsages::UNIFORM);
        let origins: Vec<[f32; 4]> = tiles.iter().map(|tile| tile.origin.extend(0.0).into()).collect();
        let bytes: &[u8] = bytemuck::cast_slice(&origins);
        let origins = buffer(device, "origins", bytes.len().max(16) as u64, wgpu::BufferUsages::STORAGE);
        queue.write_buffer(&origins, 0, bytes);
        let pipeline = pipeline(device);
        let layout = pipeline.get_bind_group_layout(0);
        let bind_group = bind_group(device, "triangles", &layout, &[(0, &view), (1, &origins)]);
        Ok(Self { tiles, buffers, pipeline, view, bind_group, triangles: corners / 3 })
    }

    /// Records a frame. Returns the number of triangles drawn.
    pub fn draw(
        &self,
        queue: &wgpu::Queue,
        encoder: &mut wgpu::CommandEncoder,
        target: &Target,
        camera: &Camera,
        spec: &FrameSpec,
    ) -> u64 {
        let eye = DVec3::from(camera.position);
        let axes = camera.axes(spec);
        // Reversed depth without a far plane.
        let row = |axis: DVec3, w: f64| axis.extend(w - axis.dot(eye));
        let (x, y) = (axes.right / axes.right.length_squared(), axes.up / axes.up.length_squared());
        let near = glam::DVec4::new(0.0, 0.0, 0.0, f64::from(NEAR_M));
        let rows = [row(x, 0.0), row(y, 0.0), near, row(axes.forward, 0.0)];
        let sun = glam::Vec4::new(0.45, -0.55, 0.704, 0.0);
        let column = |k: usize| rows.map(|row| row[k] as f32);
        let mut words: Vec<f32> = (0..4).flat_map(column).collect();
        words.extend(sun.to_array());
        queue.write_buffer(&self.view, 0, bytemuck::cast_slice(&words));
        let planes = crate::baked::planes(camera, spec);
        let mut seen: Vec<(f64, usize)> = (0..self.tiles.len())
            .filter(|i| {
                insula_viewer::select::cull::is_box_in_view(&planes, self.tiles[*i].centre, self.tiles[*i].half)
            })
            .map(|i| ((self.tiles[i].centre - eye).length(), i))
            .collect();
        seen.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut pass = depth_pass(encoder, &target.colour, &target.depth, wgpu::Color::WHITE);
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &self.bind_group, &[]);
        let (mut bound, mut triangles) = (usize::MAX, 0);
        for (_, i) in seen {
            let tile = &self.tiles[i];
            if tile.buffer != bound {
                bound = tile.buffer;
                pass.set_vertex_buffer(0, self.buffers[bound].slice(..));
            }
            pass.draw(tile.corners.clone(), i as u32..i as u32 + 1);
            triangles += tile.corners.len() as u64 / 3;
        }
        triangles
    }
}

impl Target {
    pub fn new(device: &wgpu::Device, spec: &FrameSpec) -> Self {
        let texture = |format, usage| target(device, format, [spec.width_px, spec.height_px], usage);
        Self {
            colour: texture(wgpu::TextureFormat::Rgba8Unorm, wgpu::TextureUsages::COPY_SRC),
            depth: texture(wgpu::TextureFormat::Depth32Float, wgpu::TextureUsages::empty()),
        }
    }

    pub fn colour(&self) -> &wgpu::Texture {
        &self.colour
    }
}

struct MeshUploader<'a> {
    device: &'a wgpu::Device,
    queue: &'a wgpu::Queue,
    tiles: Vec<Tile>,
    buffers: Vec<wgpu::Buffer>,
    pending: Vec<[u32; 2]>,
    corners: u64,
}

impl MeshUploader<'_> {
    fn tile(&mut self, city: &City, [i, j]: [i32; 2]) {
        let mut corners = Vec::new();
        let mut corner: Option<DVec2> = None;
        for (i, j) in (0..TILE_BLOCKS * TILE_BLOCKS).map(|k| (i + k % TILE_BLOCKS, j + k / TILE_BLOCKS)) {
            let Some(block) = city.plan.block([i, j]) else { continue };
            let origin = *corner.get_or_insert(block.streets[0] - 10.0);
            triangles::push_block(&block, origin.extend(-1.0), &mut corners);
        }
        let Some(origin) = corner else { return };
        let (low, high) =
            corners.iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(l, h), c| (l.min(c.p), h.max(c.p)));
        let origin = origin.extend(-1.0);
        if self.pending.len() + corners.len() > BUFFER_CORNERS {
            self.flush();
        }
        let first = self.pending.len() as u32;
        self.pending.extend(corners.iter().map(words));
        self.corners += corners.len() as u64;
        self.tiles.push(Tile {
            centre: origin + ((low + high) / 2.0).as_dvec3(),
            half: ((high - low) / 2.0).as_dvec3(),
            buffer: self.buffers.len(),
            corners: first..self.pending.len() as u32,
            origin: origin.as_vec3(),
        });
    }

    fn flush(&mut self) {
        let bytes = (self.pending.len().max(1) * CORNER_BYTES) as u64;
        let buffer = buffer(self.device, "corners", bytes, wgpu::BufferUsages::VERTEX);
        self.queue.write_buffer(&buffer, 0, bytemuck::cast_slice(&self.pending));
        self.queue.submit([]);
        self.buffers.push(buffer);
        self.pending.clear();
    }
}

/// 16 bits each: x, y, z, and colour (4 bits per channel) with the normal (up, or one of eight directions).
fn words(corner: &Corner) -> [u32; 2] {
    let p = (corner.p * STEPS_PER_M).round().clamp(Vec3::ZERO, Vec3::splat(65535.0)).as_uvec3();
    let [r, g, b] = corner.rgb.map(|c| u32::from(c) >> 4);
    let turn = corner.normal.y.atan2(corner.normal.x) / std::f32::consts::FRAC_PI_4;
    let turn = (turn.round() as i32).rem_euclid(8) as u32;
    let up = u32::from(corner.normal.z.abs() > 0.5);
    [p.x | p.y << 16, p.z | (r << 8 | g << 4 | b | turn << 12 | up << 15) << 16]
}

fn pipeline(device: &wgpu::Device) -> wgpu::RenderPipeline {
    let module = shader_module(device, "triangles", WGSL.into());
    let corners = wgpu::VertexBufferLayout {
        array_stride: CORNER_BYTES as u64,
        step_mode: wgpu::VertexStepMode::Vertex,
        attributes: &wgpu::vertex_attr_array![0 => Uint32x2],
    };
    let (format, cull_mode) = (wgpu::TextureFormat::Rgba8Unorm, Some(wgpu::Face::Back));
    depth_pipeline(device, &module, ["corner", "colour"], corners, format, cull_mode)
}
