//! Landmarks: the GPU draws smooth normals, occlusion at vertices and all stones as the CPU does.

use anyhow::{Context, Result};
use glam::DVec3;
use insula_protocol::mesh::{Attribute, AttributeKind, Mesh, PositionGrid};
use insula_protocol::mesh_tile::{LandmarkObject, OCCLUSION_BITS};
use insula_protocol::{BlockMap, TileId};
use insula_shaders::cpu::instruction_set::InstructionSet;
use insula_shaders::cpu::raycast::{Pixels, Sampling};
use insula_shaders::cpu::render::render_with;
use insula_shaders::cpu::translucency_map::make_map;
use insula_shaders::layout::Shading;
use insula_shaders::mesh::PackedMesh;
use insula_shaders::stone::{MAX_STONES, PRESETS, Stone};
use insula_shaders::tone::decode_radiance;
use insula_shaders::translucency::{FAST_TAPS, FINE_TAPS, MAP_WORDS, MapPlace, TranslucencyMap};
use insula_test_support::tier;
use insula_tests::draw_list::{CityArea, DrawList, Scene};
use insula_tests::gpu::Gpu;
use insula_tests::trials::Trials;
use insula_tests::view::{Camera, FrameSpec};
use insula_tests::{gpu_tests, tests, twin};

pub(crate) fn add(trials: &mut Trials) {
    trials.add(gpu_tests![gpu_draws_landmarks_as_the_cpu_does, gpu_lets_light_through_stone_as_the_cpu_does]).add(
        tests![
            packets_draw_landmarks_as_single_rays_do,
            light_goes_through_stone_and_softens_shadows,
            stones_normals_and_occlusion_are_seen
        ],
    );
}

const FRAME: FrameSpec = FrameSpec { width_px: 161, height_px: 121, shading: Shading::Lit, samples: 1 };
const SIDE_M: f64 = 32.0;
/// Meridians of the sphere; half as many parallels.
const STEPS: u32 = 96;

/// A bumpy sphere of 3 m in the middle of a leaf. The lower half is more occluded.
fn sphere() -> Mesh {
    let grid = PositionGrid { min: [0.0; 3], step: SIDE_M / 32_768.0, bits: 16 };
    let point = |i: u32, j: u32| {
        let (theta, phi) = (
            f64::from(i) * std::f64::consts::TAU / f64::from(STEPS),
            f64::from(j) * std::f64::consts::TAU / f64::from(STEPS),
        );
        let radius = 3.0 + 0.2 * (5.0 * phi).sin() * (4.0 * theta).sin().powi(2);
        let ring = theta.sin();
        let p = DVec3::new(ring * phi.cos(), ring * phi.sin(), theta.cos()) * radius + DVec3::new(16.0, 16.0, 5.0);
        grid.nearest(p.into())
    };
    let rings = STEPS / 2;
    let mut positions = vec![point(0, 0), point(rings, 0)];
    positions.extend((1..rings).flat_map(|i| (0..STEPS).map(move |j| (i, j))).map(|(i, j)| point(i, j)));
    let at = |i: u32, j: u32| match i {
        0 => 0,
        i if i == rings => 1,
        i => 2 + (i - 1) * STEPS + j % STEPS,
    };
    let quads = (0..rings).flat_map(|i| (0..STEPS).map(move |j| (i, j)));
    let triangles: Vec<[u32; 3]> = quads
        .flat_map(|(i, j)| [[at(i, j), at(i + 1, j), at(i + 1, j + 1)], [at(i, j), at(i + 1, j + 1), at(i, j + 1)]])
        .filter(|[a, b, c]| a != b && b != c && c != a)
        .collect();
    let colour = Attribute::colours([[180, 90, 60]], vec![0; 3 * triangles.len()]);
    let share = |p: &[u32; 3]| [(f64::from(p[2]) * grid.step * 4.0).clamp(4.0, 31.0) as u32, 0, 0, 0];
    let occlusion = Attribute {
        kind: AttributeKind::Other,
        components: 1,
        bits: OCCLUSION_BITS,
        range: [0.0, 1.0 / 31.0],
        values: positions.iter().map(share).collect(),
        corners: triangles.concat(),
    };
    Mesh { grid, positions, triangles, attributes: vec![colour, occlusion] }
}

/// A draw list of the sphere as a landmark.
fn draw_list(stone: Option<u8>) -> Result<DrawList> {
    let mut draw_list = DrawList::new(CityArea { origin: [0.0; 3], root_side_m: SIDE_M });
    draw_list.add(&BlockMap::empty(TileId::ROOT, (SIDE_M / 64.0) as f32, 0, 0));
    let mesh = sphere();
    let landmark = LandmarkObject { object: 7, stone, anchor_m: [15.0, 14.0, 2.0] };
    let objects = vec![7; mesh.triangles.len()];
    draw_list.add_mesh(TileId::ROOT, PackedMesh::new(&mesh, None, &objects, &[landmark])?);
    Ok(draw_list)
}

fn stones() -> [Stone; MAX_STONES] {
    std::array::from_fn(|k| PRESETS.get(k).map_or(Stone::NONE, |(_, stone)| *stone))
}

fn scene<'a>(draw_list: &'a DrawList, distance_m: f64, spec: &FrameSpec) -> Scene<'a> {
    let position = [16.0 + 0.5 * distance_m, 16.0 - 0.8 * distance_m, 5.0 + 0.3 * distance_m];
    let camera = Camera { position, target: [16.0, 16.0, 5.0], up: [0.0, 0.0, 1.0], fov_y_deg: 40.0 };
    let mut scene = draw_list.scene(&camera, spec);
    scene.frame.stones = stones();
    scene.frame.landmarks = 1;
    scene
}

fn gpu_draws_landmarks_as_the_cpu_does(gpu: &Gpu) -> Result<()> {
    let with_stones = (0..PRESETS.len() as u8).map(Some).chain([None]);
    for stone in with_stones {
        let draw_list = draw_list(stone)?;
        for shading in [Shading::Lit, Shading::Albedo, Shading::Ao, Shading::Normal] {
            // All distances are seen in light, and the middle one in each shading.
            let distances: &[f64] =
                if tier::is_full() || shading == Shading::Lit { &[4.5, 12.0, 60.0] } else { &[12.0] };
            for distance_m in distances.iter().copied() {
                let mut scene = scene(&draw_list, distance_m, &FrameSpec { shading, ..FRAME });
                scene.frame.shadow_m = if distance_m < 20.0 { 100.0 } else { 0.0 };
                let (on_cpu, on_gpu) = (scene.render(), gpu.render(&scene)?);
                let difference = twin::compare_twins(&scene, &on_cpu, &on_gpu);
                difference
                    .check()
                    .map_err(anyhow::Error::msg)
                    .with_context(|| format!("{stone:?}, {shading:?}, {distance_m} m"))?;
            }
        }
    }
    Ok(())
}

fn differing(a: &Pixels, b: &Pixels) -> usize {
    a.colour.iter().zip(&b.colour).filter(|(a, b)| a != b).count()
}

/// A draw list of the sphere in marble, with room for a map.
fn translucent_list() -> Result<(DrawList, u32)> {
    let mut draw_list = draw_list(Some(0))?;
    let address = draw_list.add_words(&vec![0; MAP_WORDS as usize]);
    Ok((draw_list, address))
}

/// The scene with a translucency map of the sphere that nothing has made.
fn translucent_scene<'a>(draw_list: &'a DrawList, address: u32, distance_m: f64, taps: u32) -> Result<Scene<'a>> {
    let mut scene = scene(draw_list, distance_m, &FRAME);
    scene.frame.shadow_m = 100.0;
    scene.frame.stones[0].scattering_scale = 100.0;
    let eye = DVec3::new(16.0 + 0.5 * distance_m, 16.0 - 0.8 * distance_m, 5.0 + 0.3 * distance_m);
    let place = MapPlace {
        centre: (DVec3::new(16.0, 16.0, 5.0) - eye).as_vec3(),
        radius_m: 3.3,
        anchor: (DVec3::new(15.0, 14.0, 2.0) - eye).as_vec3(),
    };
    let map = TranslucencyMap::new(&scene.frame.stones[0], &place, 256, taps, address);
    scene.frame.translucency[0] = map.context("the stone is not translucent")?;
    scene.frame.translucent = 1;
    Ok(scene)
}

/// Each makes its own map.
fn gpu_lets_light_through_stone_as_the_cpu_does(gpu: &Gpu) -> Result<()> {
    for (taps, distance_m) in [(FINE_TAPS, 4.5), (FAST_TAPS, 4.5), (FINE_TAPS, 12.0)] {
        let (draw_list, address) = translucent_list()?;
        let unmade = translucent_scene(&draw_list, address, distance_m, taps)?;
        let mut made_list = draw_list.clone();
        made_list.set_words(address, &make_map(&unmade.as_ref(), 0));
        let made = translucent_scene(&made_list, address, distance_m, taps)?;
        let (on_cpu, on_gpu) = (made.render(), gpu.render(&unmade)?);
        let opaque = unmade.render();
        anyhow::ensure!(2 * differing(&on_cpu, &opaque) > 2000, "the map is not seen");
        let difference = twin::compare_twins(&made, &on_cpu, &on_gpu);
        difference.check().map_err(anyhow::Error::msg).with_context(|| format!("{taps} taps, {distance_m} m"))?;
    }
    Ok(())
}

fn packets_draw_landmarks_as_single_rays_do() -> Result<()> {
    for stone in [Some(0), Some(4), None] {
        let draw_list = draw_list(stone)?;
        for (shading, distance_m) in
            [(Shading::Lit, 4.5), (Shading::Lit, 12.0), (Shading::Normal, 12.0), (Shading::Ao, 12.0)]
        {
            let mut scene = scene(&draw_list, distance_m, &FrameSpec { shading, samples: 2, ..FRAME });
            scene.frame.shadow_m = 100.0;
            let singly = render_with(&scene.as_ref(), None, Sampling::Full);
            for set in InstructionSet::all() {
                let in_packets = render_with(&scene.as_ref(), Some(set), Sampling::Full);
                anyhow::ensure!(in_packets == singly, "{stone:?}, {shading:?}, {distance_m} m, {}", set.name());
            }
        }
    }
    Ok(())
}

/// Just behind the border between light and shadow, stone that light passes is brighter, and redder than where the sun shines.
fn light_goes_through_stone_and_softens_shadows() -> Result<()> {
    let (mut draw_list, address) = translucent_list()?;
    let words = make_map(&translucent_scene(&draw_list, address, 9.0, FINE_TAPS)?.as_ref(), 0);
    draw_list.set_words(address, &words);
    let mut scene = translucent_scene(&draw_list, address, 9.0, FINE_TAPS)?;
    let lit = scene.render();
    scene.frame.translucent = 0;
    let opaque = scene.render();
    let rgb = |word: u32| DVec3::from(decode_radiance(word).to_array().map(f64::from));
    let gains: Vec<DVec3> = lit.radiance.iter().zip(&opaque.radiance).map(|(a, b)| rgb(*a) - rgb(*b)).collect();
    let brighter: Vec<DVec3> = gains.into_iter().filter(|gain| gain.y > 0.002).collect();
    let gained: DVec3 = brighter.iter().sum();
    anyhow::ensure!(brighter.len() > 60 && gained.x > 1.1 * gained.z, "{} pixels, {gained}", brighter.len());
    Ok(())
}

/// What a landmark has besides other objects changes its picture, but not its shape.
fn stones_normals_and_occlusion_are_seen() -> Result<()> {
    let (marble, plain) = (draw_list(Some(0))?, draw_list(None)?);
    for shading in [Shading::Lit, Shading::Albedo, Shading::Ao, Shading::Normal] {
        let spec = FrameSpec { shading, ..FRAME };
        let on = scene(&marble, 12.0, &spec).render();
        let mut off = scene(&marble, 12.0, &spec);
        off.frame.landmarks = 0;
        let off = off.render();
        let covered = on.distance.iter().filter(|distance| distance.is_finite()).count();
        anyhow::ensure!(covered > 2000 && on.distance == off.distance, "{covered} pixels");
        anyhow::ensure!(2 * differing(&on, &off) > covered, "{shading:?}: as without landmarks");
        let without_stone = scene(&plain, 12.0, &spec).render();
        let has_stone = matches!(shading, Shading::Lit | Shading::Albedo);
        anyhow::ensure!((differing(&on, &without_stone) > 1000) == has_stone, "{shading:?}: the stone");
    }
    Ok(())
}
