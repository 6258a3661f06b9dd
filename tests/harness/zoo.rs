//! Small scenes of single shapes: baked, drawn, and compared with their ray-traced source.

use crate::baked::Baked;
use crate::fixtures::build_folder;
use crate::truth::Truth;
use crate::view::{Camera, FrameSpec};
use anyhow::{Context, Result, ensure};
use glam::{DVec2, DVec3};
use image::{Rgb, RgbImage};
use insula_bake::read::ReadReport;
use insula_bake::scene::{Material, ObjectKind, Scene, SceneObject, SceneTriangle};
use insula_bake::{BakeOptions, Silent};
use insula_protocol::BlockMap;
use insula_shaders::cpu::raycast::Pixels;
use insula_shaders::layout::Shading;
use std::f64::consts::TAU;

pub const FRAME: FrameSpec = FrameSpec { width_px: 320, height_px: 240, shading: Shading::Albedo, samples: 1 };
/// Largest difference of equal distances, in cells.
const NEAR_CELLS: f64 = 2.0;
/// Largest difference of equal colours, per channel.
const NEAR_COLOUR: u8 = 40;

/// Colours by orientation, so that a wrong surface is detected.
pub mod paint {
    pub const ROOF: [u8; 3] = [190, 70, 60];
    pub const WALL: [u8; 3] = [220, 210, 180];
    pub const UNDER: [u8; 3] = [60, 110, 190];
    pub const GREEN: [u8; 3] = [70, 140, 60];
    pub const BLUE: [u8; 3] = [90, 140, 190];
    pub const GROUND: [u8; 3] = [150, 150, 130];
}

/// A scene under construction. Lengths in metres.
#[derive(Debug, Default)]
pub struct Shapes {
    faces: Vec<([DVec3; 3], [u8; 3], u32)>,
    kinds: Vec<ObjectKind>,
}

impl Shapes {
    /// Starts a new object.
    pub fn object(&mut self, kind: ObjectKind) -> &mut Self {
        self.kinds.push(kind);
        self
    }

    /// A flat convex polygon, counter-clockwise from outside.
    pub fn face(&mut self, corners: &[DVec3], rgb: [u8; 3]) -> &mut Self {
        if self.kinds.is_empty() {
            self.kinds.push(ObjectKind::Building);
        }
        let object = self.kinds.len() as u32 - 1;
        for i in 1..corners.len().saturating_sub(1) {
            self.faces.push(([corners[0], corners[i], corners[i + 1]], rgb, object));
        }
        self
    }

    /// A closed prism on a convex outline (counter-clockwise from above).
    pub fn prism(&mut self, outline: &[DVec2], z_m: [f64; 2]) -> &mut Self {
        let ring = |z: f64| outline.iter().map(|p| p.extend(z)).collect::<Vec<_>>();
        let (low, high) = (ring(z_m[0]), ring(z_m[1]));
        self.face(&high, paint::ROOF).face(&low.iter().rev().copied().collect::<Vec<_>>(), paint::UNDER);
        self.walls(&low, &high)
    }

    /// The sides between two rings.
    pub fn walls(&mut self, low: &[DVec3], high: &[DVec3]) -> &mut Self {
        for i in 0..low.len() {
            let next = (i + 1) % low.len();
            self.face(&[low[i], low[next], high[next], high[i]], paint::WALL);
        }
        self
    }

    /// Level ground at height zero as an object of its own, before the next.
    pub fn level_ground(&mut self, half_side_m: f64) -> &mut Self {
        let square: Vec<DVec3> = rectangle([-half_side_m; 2], [half_side_m; 2]).iter().map(|p| p.extend(0.0)).collect();
        self.object(ObjectKind::Terrain).face(&square, paint::GROUND).object(ObjectKind::Building)
    }

    pub fn cuboid(&mut self, low: [f64; 3], high: [f64; 3]) -> &mut Self {
        self.prism(&rectangle([low[0], low[1]], [high[0], high[1]]), [low[2], high[2]])
    }

    /// A closed body of revolution: rings of radius and height from bottom to top.
    pub fn turned(&mut self, middle: DVec2, rings: &[[f64; 2]], rgb: [u8; 3]) -> &mut Self {
        let ring = |[radius, z]: [f64; 2]| {
            (0..24).map(move |k| (middle + DVec2::from_angle(f64::from(k) / 24.0 * TAU) * radius).extend(z))
        };
        for pair in rings.windows(2) {
            let (low, high) = (ring(pair[0]).collect::<Vec<_>>(), ring(pair[1]).collect::<Vec<_>>());
            for k in 0..24 {
                let next = (k + 1) % 24;
                self.face(&[low[k], low[next], high[next], high[k]], rgb);
            }
        }
        if let (Some(first), Some(last)) = (rings.first(), rings.last()) {
            let floor: Vec<DVec3> = ring(*first).collect();
            self.face(&floor.into_iter().rev().collect::<Vec<_>>(), rgb);
            self.face(&ring(*last).collect::<Vec<_>>(), rgb);
        }
        self
    }

    /// The scene; `origin` is the world position of the shapes' zero.
    pub fn scene(&self, origin: [f64; 3]) -> Scene {
        let mut scene = Scene { origin, ..Scene::default() };
        for kind in &self.kinds {
            scene.objects.push(SceneObject {
                id: scene.objects.len().to_string(),
                kind: *kind,
                base_z_m: f32::INFINITY,
            });
        }
        for (corners, rgb, object) in &self.faces {
            let found = scene.materials.iter().position(|material| material.rgb == *rgb);
            let material = found.unwrap_or(scene.materials.len()) as u32;
            if found.is_none() {
                scene.materials.push(Material { rgb: *rgb, texture: None, is_reflective: false });
            }
            let corners = corners.map(|corner| corner.as_vec3().into());
            let base = &mut scene.objects[*object as usize].base_z_m;
            *base = corners.iter().fold(*base, |low, corner: &[f32; 3]| low.min(corner[2]));
            scene.triangles.push(SceneTriangle { corners, uv: [[0.0; 2]; 3], material, object: *object });
        }
        scene
    }
}

pub fn rectangle(low: [f64; 2], high: [f64; 2]) -> Vec<DVec2> {
    [[low[0], low[1]], [high[0], low[1]], [high[0], high[1]], [low[0], high[1]]].map(DVec2::from).into()
}

/// Rotates points around the origin.
pub fn turned(outline: &[DVec2], degrees: f64) -> Vec<DVec2> {
    outline.iter().map(|p| DVec2::from_angle(degrees.to_radians()).rotate(*p)).collect()
}

/// A camera around `target`. `angle_deg` is 0 in the east and 90 in the north.
pub fn orbit_camera(target: [f64; 3], distance_m: f64, angle_deg: f64, up_deg: f64) -> Camera {
    let (angle, up) = (angle_deg.to_radians(), up_deg.to_radians());
    let away = DVec3::new(angle.cos() * up.cos(), angle.sin() * up.cos(), up.sin());
    Camera::looking(DVec3::from(target) + away * distance_m, target.into())
}

/// Measures of a shape over all its views.
#[derive(Debug, Clone, Copy)]
pub struct ShapeScore {
    /// Silhouettes: pixels hit in both over pixels hit in either.
    pub iou: f64,
    /// Of the pixels hit in both, the share with equal distances.
    pub near: f64,
    /// Of those, the share with equal colours.
    pub coloured: f64,
}

impl ShapeScore {
    /// Fails if a measure is below its bound.
    pub fn ensure_at_least(self, iou: f64, near: f64, coloured: f64) -> Result<()> {
        ensure!(
            self.iou >= iou && self.near >= near && self.coloured >= coloured,
            "{self:?}, at least {iou}, {near}, {coloured} are required"
        );
        Ok(())
    }
}

/// Writes rows of frames, all of one size, as `NAME.png` to the folder `zoo` beside the programs of the build.
pub fn save_frames(name: &str, rows: &[Vec<Pixels>]) -> Result<()> {
    let first = rows.first().and_then(|row| row.first()).context("no frames")?;
    let (width, height) = (first.width_px, first.height_px);
    let image = RgbImage::from_fn(width * rows[0].len() as u32, height * rows.len() as u32, |x, y| {
        let frame = &rows[(y / height) as usize][(x / width) as usize];
        let [r, g, b, _] = frame.colour[(y % height * width + x % width) as usize].to_le_bytes();
        Rgb([r, g, b])
    });
    image.save(build_folder("zoo")?.join(format!("{name}.png")))?;
    Ok(())
}

pub struct BakedShape {
    pub truth: Truth,
    pub baked: Baked,
    name: String,
    _folder: tempfile::TempDir,
}

impl BakedShape {
    /// Bakes a scene. [`Self::score`] saves its pictures by this name.
    pub fn bake(name: &str, scene: Scene, cell_m: f64) -> Result<Self> {
        let folder = tempfile::tempdir()?;
        let out = folder.path().join("city");
        let options = BakeOptions { out: out.clone(), cell_m, ..BakeOptions::default() };
        insula_bake::bake_scene(scene.clone(), ReadReport::default(), &options, &Silent).context("bake")?;
        Ok(Self { truth: Truth::new(scene), baked: Baked::open(&out)?, name: name.to_owned(), _folder: folder })
    }

    pub fn leaves(&self) -> Result<Vec<BlockMap>> {
        self.baked.maps(self.baked.manifest().depth)
    }

    /// Draws the nodes that `tau_px` requires.
    pub fn draw(&self, camera: &Camera, tau_px: f64, shading: Shading) -> Result<Pixels> {
        let ids = self.baked.select(camera, &FRAME, tau_px);
        Ok(self.baked.draw_list(&ids)?.scene(camera, &FrameSpec { shading, ..FRAME }).render())
    }

    /// Compares all views and writes an image of them: source, drawn, lit.
    pub fn score(&self, cameras: &[Camera]) -> Result<ShapeScore> {
        let (mut both, mut either, mut near, mut coloured) = (0.0, 0.0, 0.0, 0.0);
        let (mut rows, cell_m) = (Vec::new(), self.baked.manifest().cell_m);
        for camera in cameras {
            let reference = self.truth.render(camera, &FRAME);
            let drawn = self.draw(camera, 0.01, Shading::Albedo)?;
            let lit = self.draw(camera, 0.01, Shading::Lit)?;
            for i in 0..reference.colour.len() {
                let (a, b) = (f64::from(reference.distance[i]), f64::from(drawn.distance[i]));
                either += f64::from(a.is_finite() || b.is_finite());
                if a.is_finite() && b.is_finite() {
                    both += 1.0;
                    if (a - b).abs() < NEAR_CELLS * cell_m {
                        near += 1.0;
                        coloured += f64::from(alike(reference.colour[i], drawn.colour[i]));
                    }
                }
            }
            ensure!(either > 1000.0, "the shape is not in the frame");
            rows.push(vec![reference, drawn, lit]);
        }
        save_frames(&self.name, &rows)?;
        Ok(ShapeScore { iou: both / either, near: near / both, coloured: coloured / near })
    }
}

fn alike(a: u32, b: u32) -> bool {
    a.to_le_bytes().iter().zip(b.to_le_bytes()).all(|(a, b)| a.abs_diff(b) < NEAR_COLOUR)
}
