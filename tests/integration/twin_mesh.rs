//! Meshes: the GPU draws what the CPU draws, and the CPU hits the triangle that an exhaustive search finds.

use anyhow::{Context, Result};
use glam::{DVec3, Vec3};
use insula_protocol::blockmap::{COLUMNS, MapColumn};
use insula_protocol::mesh::{Attribute, Mesh, PositionGrid};
use insula_protocol::{BlockMap, NODE_CELLS, Texel, TileId, octahedral};
use insula_shaders::cpu::raycast::Pixels;
use insula_shaders::layout::Shading;
use insula_shaders::mesh::PackedMesh;
use insula_test_support::tier;
use insula_tests::draw_list::{CityArea, DrawList};
use insula_tests::gpu::Gpu;
use insula_tests::random::{self, Pose, RandomCity};
use insula_tests::random_mesh::{self, RandomMesh};
use insula_tests::rng::Rng;
use insula_tests::terraces::{self, Terraces};
use insula_tests::trials::Trials;
use insula_tests::view::{Camera, FrameSpec};
use insula_tests::{gpu_tests, tests, twin};
use std::sync::OnceLock;

pub(crate) fn add(trials: &mut Trials) {
    trials
        .add(gpu_tests![
            gpu_draws_meshes_as_the_cpu_does,
            gpu_draws_what_is_added_as_the_cpu_does,
            no_ray_on_the_gpu_passes_a_closed_surface,
            gpu_and_cpu_agree_in_every_shading
        ])
        .add(tests![cpu_hits_what_an_exhaustive_search_hits, a_mesh_has_the_sky_occlusion_of_its_columns]);
}

const FRAME: FrameSpec = FrameSpec { width_px: 161, height_px: 91, shading: Shading::Lit, samples: 1 };

type City = (RandomCity, Vec<RandomMesh>);

/// Cities of meshes only, and of meshes and columns. In some, a third of the meshes has the sky occlusion of coarser columns.
fn cities() -> &'static [City] {
    static MADE: OnceLock<Vec<City>> = OnceLock::new();
    MADE.get_or_init(|| {
        let make = |seed: u64| -> Result<City> {
            let mut city = random::city(seed)?;
            if seed % 4 > 1 {
                [_, _, city.draw_list] = random::fading(&city, seed + 700, 1)?;
            }
            let meshes =
                random_mesh::add(&mut city, &mut Rng::new(seed + 500), if seed.is_multiple_of(2) { 1.0 } else { 0.5 })?;
            Ok((city, meshes))
        };
        let count = if tier::is_full() { 12 } else { 4 };
        (0..count).map(|seed| make(seed).expect("random cities are valid")).collect()
    })
}

fn drawn() -> impl Iterator<Item = &'static RandomCity> {
    cities().iter().map(|(city, _)| city)
}

fn no_ray_on_the_gpu_passes_a_closed_surface(gpu: &Gpu) -> Result<()> {
    let (city, views) = (Terraces::new(0)?, if tier::is_full() { 100 } else { 50 });
    for seed in 0..views {
        let camera = terraces::camera(&city, &mut Rng::new(seed));
        terraces::check(&city, &camera, &gpu.render(&city.draw_list.scene(&camera, &terraces::FRAME))?)?;
    }
    Ok(())
}

fn gpu_draws_meshes_as_the_cpu_does(gpu: &Gpu) -> Result<()> {
    twin::agree_in_all_poses(gpu, drawn(), 3000, |number, city, camera| {
        let mut scene = city.draw_list.scene(camera, &FRAME);
        scene.frame.shadow_m = if number % 3 == 0 { 500.0 } else { 0.0 };
        scene
    })
}

fn gpu_draws_what_is_added_as_the_cpu_does(gpu: &Gpu) -> Result<()> {
    twin::agree_in_all_poses(gpu, drawn().take(2), 4000, |_, city, camera| {
        let mut scene = city.draw_list.scene(camera, &FRAME);
        scene.frame.shadow_m = 500.0;
        scene.add_moved_meshes([7.0, -3.0, 5.0]);
        scene
    })
}

fn gpu_and_cpu_agree_in_every_shading(gpu: &Gpu) -> Result<()> {
    let some = drawn().take(if tier::is_full() { 3 } else { 2 });
    twin::agree_in_every_shading(gpu, some, 5000, FRAME, |city, camera, spec| city.draw_list.scene(camera, spec))
}

/// Distances and normals agree, except at the edges of triangles.
fn cpu_hits_what_an_exhaustive_search_hits() -> Result<()> {
    let (mut rays, mut hits, mut turned) = (0, 0, 0);
    // In a city of meshes only, nothing occludes the triangles.
    for (seed, (city, meshes)) in cities().iter().enumerate().step_by(2) {
        let mut rng = Rng::new(6000 + seed as u64);
        for pose in Pose::ALL {
            let camera = random::camera(&mut rng, city, pose);
            let spec = FrameSpec { shading: Shading::Normal, width_px: 61, height_px: 41, ..FRAME };
            let drawn = city.draw_list.scene(&camera, &spec).render();
            for i in 0..spec.width_px * spec.height_px {
                let dir = camera.ray(&spec, i % spec.width_px, i / spec.width_px);
                let agrees = |dir: DVec3, slack: f64| {
                    let reference = random_mesh::nearest(city, meshes, DVec3::from(camera.position), dir, slack);
                    let (drawn_m, rgb) = (drawn.distance[i as usize], drawn.colour[i as usize].to_le_bytes());
                    match reference {
                        Some((metres, normal)) => {
                            let near = f64::from(drawn_m) - metres;
                            let same = (normal * 0.5 + 0.5).to_array().map(encode);
                            let colours = same.iter().zip(rgb).all(|(a, b)| a.abs_diff(b) <= 2);
                            near.abs() <= 1e-3 + 2e-4 * metres && colours
                        }
                        None => !drawn_m.is_finite(),
                    }
                };
                rays += 1;
                hits += usize::from(drawn.distance[i as usize].is_finite());
                if !agrees(dir, 0.0) {
                    turned += 1;
                    let (side, up) = dir.any_orthonormal_pair();
                    let turns = (0..8).map(|k| f64::from(k) * std::f64::consts::FRAC_PI_4);
                    let mut turns = turns.map(|angle| dir + (side * angle.cos() + up * angle.sin()) * 2e-5);
                    let right = [-1e-3, 1e-3].into_iter().any(|slack| agrees(dir, slack))
                        || turns.any(|dir| agrees(dir.normalize_or(DVec3::X), 0.0));
                    anyhow::ensure!(
                        right,
                        "city {seed}, {pose:?}, pixel {i}: {} m\n{camera:?}",
                        drawn.distance[i as usize]
                    );
                }
            }
        }
    }
    println!("{rays} rays, {hits} hits, {turned} on edges");
    anyhow::ensure!(
        turned * 100 < rays && hits * 10 > rays,
        "{rays} rays, {hits} hits, {turned} agree only with slack"
    );
    Ok(())
}

/// A flat roof over a part of a coarser tile has the sky occlusion of that part's columns.
fn a_mesh_has_the_sky_occlusion_of_its_columns() -> Result<()> {
    let area = CityArea { origin: [0.0; 3], root_side_m: 512.0 };
    let column = |i: usize| {
        let (x, y) = (i % NODE_CELLS, i / NODE_CELLS);
        let texel = Texel::new([255; 3], (x / 2 + y / 2) as u8);
        let flat = octahedral::encode([0.0, 0.0, 1.0]);
        Some(MapColumn { z_max: 32, roof: texel, roof_normal: flat, ..MapColumn::default() })
    };
    let columns: Vec<Option<MapColumn>> = (0..COLUMNS).map(column).collect();
    let map = BlockMap::from_columns(TileId::ROOT, 8.0, 0, 0, &columns).context("a flat node")?;
    let height_m = map.z_base_m() + 32.0 * f64::from(map.z_step_m());
    for leaf in [[1, 0, 0], [1, 1, 0], [2, 1, 3], [3, 5, 2]].map(|[level, x, y]| TileId::new(level as u8, x, y)) {
        let leaf = leaf.context("a leaf")?;
        let side_m = area.root_side_m / f64::from(1u32 << leaf.level());
        let attributes = vec![Attribute::colours([[255; 3]], vec![0; 6])];
        let grid = PositionGrid { min: [0.0, 0.0, height_m], step: side_m / 1023.0, bits: 10 };
        let positions = vec![[0, 0, 0], [1023, 0, 0], [1023, 1023, 0], [0, 1023, 0]];
        let mesh = Mesh { grid, positions, triangles: vec![[0, 1, 2], [0, 2, 3]], attributes };
        let mut alone = DrawList::new(area);
        alone.add_in(leaf, &map);
        let mut meshed = alone.clone();
        meshed.add_mesh(leaf, PackedMesh::new(&mesh, None, &[], &[])?);
        let middle = |of: u32| (f64::from(of) + 0.5) * side_m;
        let (x, y) = (middle(leaf.x()), middle(leaf.y()));
        let camera =
            Camera { position: [x, y, 3.0 * side_m], target: [x, y, 0.0], up: [0.0, 1.0, 0.0], fov_y_deg: 15.0 };
        let spec = FrameSpec { shading: Shading::Ao, width_px: 64, height_px: 64, samples: 3 };
        let [columns, mesh] = [alone, meshed].map(|draw_list| draw_list.scene(&camera, &spec).render());
        let light = |p: &Pixels| p.colour.iter().map(|rgb| f64::from(rgb & 255)).sum::<f64>() / 4096.0;
        let apart = columns.colour.iter().zip(&mesh.colour).map(|(a, b)| (a & 255).abs_diff(b & 255)).max();
        anyhow::ensure!(mesh.hit.iter().all(|hit| *hit == 0) && light(&mesh) > 20.0);
        anyhow::ensure!(apart < Some(16), "{leaf}: {apart:?}, {} and {}", light(&columns), light(&mesh));
    }
    Ok(())
}

fn encode(linear: f32) -> u8 {
    insula_shaders::cpu::shade::encode_srgb(Vec3::splat(linear)) as u8
}
