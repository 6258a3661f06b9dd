//! Compares the frames of two ray-casters.

use crate::draw_list::Scene;
use crate::gpu::Gpu;
use crate::random::{self, Pose, RandomCity};
use crate::rng::Rng;
use crate::view::{Camera, FrameSpec};
use anyhow::{Result, bail};
use glam::Vec2;
use insula_shaders::cpu::raycast::Pixels;
use insula_shaders::layout::Shading;

/// Largest allowed difference of a colour channel.
pub const COLOUR_STEPS: u8 = 2;
/// Largest allowed relative difference of distances.
pub const DISTANCE_SHARE: f32 = 1e-3;
/// Least share of pixels that must agree.
pub const AGREEING_SHARE: f64 = 0.998;
/// So many may differ in a small frame: where a ray grazes a texture, devices that round otherwise choose other texels along a row.
const FEW_PIXELS: usize = 64;
/// Relative difference of neighbouring distances at an edge.
const EDGE_SHARE: f32 = 0.03;

/// Differences of two frames.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Difference {
    pub pixels: usize,
    /// Pixels that differ in colour or distance.
    pub differing: usize,
    /// The first of them: x, y.
    pub first: Option<[u32; 2]>,
    /// Differing pixels that lie on no edge of the first frame: x, y.
    pub off_edge: Vec<[u32; 2]>,
}

impl Difference {
    /// Fails unless almost all pixels agree and the others lie on edges.
    pub fn check(&self) -> Result<(), String> {
        let agreeing = 1.0 - self.differing as f64 / self.pixels.max(1) as f64;
        if agreeing < AGREEING_SHARE && self.differing > FEW_PIXELS {
            return Err(format!("{} of {} pixels differ", self.differing, self.pixels));
        }
        if let Some(at) = self.off_edge.first() {
            return Err(format!("{} pixels differ away from any edge, the first at {at:?}", self.off_edge.len()));
        }
        Ok(())
    }
}

/// Half widths of the surroundings of a ray that are searched for edges, in pixels. f32 locates a wall 100 m away to within
/// 0.01 mm.
const CLOSE_UPS_PX: [f32; 3] = [5e-3, 1e-3, 1e-4];

/// Compares the GPU's frame of `scene` with the CPU's. Edges can be finer than a pixel, for example between two distant texels:
/// a pixel also lies on an edge if rays of the CPU close to one of its own differ.
pub fn compare_twins(scene: &Scene<'_>, on_cpu: &Pixels, on_gpu: &Pixels) -> Difference {
    let mut difference = compare(on_cpu, on_gpu);
    if on_cpu.colour.len() == on_gpu.colour.len() {
        let is_edge = |ray: Vec2| CLOSE_UPS_PX.iter().any(|reach| holds_edge(&scene.close_up(ray, *reach).render()));
        difference.off_edge.retain(|at| !rays_of(*at, scene.frame.samples.max(1)).any(is_edge));
    }
    difference
}

/// Where the rays of a pixel pass, in pixels from the frame's upper left corner.
fn rays_of([x, y]: [u32; 2], samples: u32) -> impl Iterator<Item = Vec2> {
    let place = move |ray: u32| (Vec2::new((ray % samples) as f32, (ray / samples) as f32) + 0.5) / samples as f32;
    (0..samples * samples).map(move |ray| Vec2::new(x as f32, y as f32) + place(ray))
}

fn holds_edge(near: &Pixels) -> bool {
    let (colour, distance) = (near.colour[0], near.distance[0]);
    !near.colour.iter().all(|near| same_colour(*near, colour, COLOUR_STEPS))
        || !near.distance.iter().all(|near| same_distance(*near, distance, EDGE_SHARE))
}

/// Fails unless the GPU draws a scene as the CPU does. The error has `what` and the values of a pixel that differs.
pub fn agree(gpu: &Gpu, scene: &Scene<'_>, camera: &Camera, what: &str) -> Result<Difference> {
    let (on_cpu, on_gpu) = (scene.render(), gpu.render(scene)?);
    let difference = compare_twins(scene, &on_cpu, &on_gpu);
    if let Err(error) = difference.check() {
        let at = difference.off_edge.first().copied().or(difference.first).unwrap_or_default();
        let i = (at[1] * scene.frame.width_px + at[0]) as usize;
        let values = |p: &Pixels| format!("{:08x} {} {}", p.colour[i], p.distance[i], p.hit[i] as i32);
        bail!("{what}: {error}: cpu {}, gpu {}\n{camera:?}", values(&on_cpu), values(&on_gpu));
    }
    Ok(difference)
}

/// Fails unless the GPU draws cities from all poses as the CPU does. `scene` gives what a camera sees of the city of a number.
pub fn agree_in_all_poses<'a>(
    gpu: &Gpu,
    cities: impl Iterator<Item = &'a RandomCity>,
    first_seed: u64,
    scene: impl Fn(u64, &'a RandomCity, &Camera) -> Scene<'a>,
) -> Result<()> {
    let (mut pixels, mut differing) = (0, 0);
    for (number, city) in (0..).zip(cities) {
        let mut rng = Rng::new(first_seed + number);
        for pose in Pose::ALL {
            let camera = random::camera(&mut rng, city, pose);
            let scene = scene(number, city, &camera);
            let difference = agree(gpu, &scene, &camera, &format!("city {number}, {pose:?}"))?;
            pixels += difference.pixels;
            differing += difference.differing;
        }
    }
    println!("{}: {differing} of {pixels} pixels differ", gpu.name);
    Ok(())
}

/// Fails unless the GPU draws cities in every shading as the CPU does, with one and with nine rays a pixel. `scene` gives what a camera sees
/// of a city.
pub fn agree_in_every_shading<'a>(
    gpu: &Gpu,
    cities: impl Iterator<Item = &'a RandomCity>,
    first_seed: u64,
    frame: FrameSpec,
    scene: impl Fn(&'a RandomCity, &Camera, &FrameSpec) -> Scene<'a>,
) -> Result<()> {
    for (number, city) in (0..).zip(cities) {
        let mut rng = Rng::new(first_seed + number);
        for (shading, samples) in Shading::ALL.into_iter().flat_map(|shading| [(shading, 1), (shading, 3)]) {
            let pose = Pose::ALL[rng.below(Pose::ALL.len())];
            let camera = random::camera(&mut rng, city, pose);
            let scene = scene(city, &camera, &FrameSpec { shading, samples, ..frame });
            let what = format!("city {number}, {pose:?}, {}, {samples} samples", shading.word());
            agree(gpu, &scene, &camera, &what)?;
        }
    }
    Ok(())
}

/// Compares two frames. Frames of different sizes differ everywhere.
pub fn compare(first: &Pixels, other: &Pixels) -> Difference {
    let pixels = first.colour.len();
    if first.width_px != other.width_px || pixels != other.colour.len() || pixels == 0 {
        return Difference { pixels, differing: pixels.max(1), first: None, off_edge: vec![[0, 0]] };
    }
    let mut difference = Difference { pixels, ..Difference::default() };
    for at in 0..pixels {
        if same_colour(first.colour[at], other.colour[at], COLOUR_STEPS)
            && same_distance(first.distance[at], other.distance[at], DISTANCE_SHARE)
        {
            continue;
        }
        let place = [at as u32 % first.width_px, at as u32 / first.width_px];
        difference.differing += 1;
        difference.first.get_or_insert(place);
        if !on_edge(first, at, other.colour[at], other.distance[at]) {
            difference.off_edge.push(place);
        }
    }
    difference
}

/// Whether no channel of two colours differs by more.
pub fn same_colour(a: u32, b: u32, steps: u8) -> bool {
    a.to_le_bytes().iter().zip(b.to_le_bytes()).all(|(a, b)| a.abs_diff(b) <= steps)
}

fn same_distance(a: f32, b: f32, share: f32) -> bool {
    a == b || (a - b).abs() <= share * a.abs().max(b.abs()) || (a.abs() < 1e-3 && b.abs() < 1e-3)
}

/// Whether the 3 x 3 pixels around `at` contain the other colour at a distance between theirs, or a jump of the distance.
fn on_edge(frame: &Pixels, at: usize, colour: u32, distance: f32) -> bool {
    let (width, height) = (frame.width_px as usize, frame.height_px as usize);
    let (x, y) = (at % width, at / width);
    let around = (y.saturating_sub(1)..(y + 2).min(height))
        .flat_map(|y| (x.saturating_sub(1)..(x + 2).min(width)).map(move |x| y * width + x));
    let around: Vec<usize> = around.into_iter().filter(|near| *near != at).collect();
    let here = frame.distance[at];
    let low = around.iter().map(|near| frame.distance[*near]).fold(here, f32::min) * (1.0 - DISTANCE_SHARE);
    let high = around.iter().map(|near| frame.distance[*near]).fold(here, f32::max) * (1.0 + DISTANCE_SHARE);
    let holds_colour = around.iter().any(|near| same_colour(frame.colour[*near], colour, 4 * COLOUR_STEPS));
    let jumps = around.iter().any(|near| !same_distance(frame.distance[*near], here, EDGE_SHARE));
    jumps || (holds_colour && (low..=high).contains(&distance))
}
