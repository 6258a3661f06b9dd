//! No sky is visible between neighbouring leaves, at any two levels of detail, nor between meshes and columns of terrain, and no ray
//! passes a closed surface.

use anyhow::{Context, Result, ensure};
use glam::{DVec2, DVec3};
use insula_bake::scene::ObjectKind;
use insula_protocol::TileId;
use insula_shaders::cpu::raycast::Pixels;
use insula_shaders::layout::Shading;
use insula_test_support::tier;
use insula_tests::baked::Baked;
use insula_tests::fidelity::{self, REAL_CITIES};
use insula_tests::rng::Rng;
use insula_tests::terraces::{self, Terraces};
use insula_tests::trials::{Test, Trials, WHOLE_CITY};
use insula_tests::truth::Truth;
use insula_tests::view::{Camera, FrameSpec};
use insula_tests::zoo::{BakedShape, Shapes, paint};
use insula_tests::{cameras, tests};
use rayon::prelude::*;

const FRAME: FrameSpec = FrameSpec { width_px: 640, height_px: 360, shading: Shading::Albedo, samples: 1 };

pub(crate) fn add(trials: &mut Trials) {
    trials.add(tests![
        no_ray_passes_a_closed_surface, a_triangle_ends_at_its_edge, no_sky_in_terrain_of_meshes_and_columns
    ]);
    trials.add(REAL_CITIES.map(|name| {
        let test = Test::new(format!("no_sky_between_leaves_of_{}", name.replace('-', "_")), move || check(name))
            .ignored_if(fidelity::real_city(name).is_none())
            .in_turn(&WHOLE_CITY);
        if name == "chiba-textured" { test } else { test.full_tier() }
    }));
}

fn a_triangle_ends_at_its_edge() -> Result<()> {
    terraces::check_the_end_of_a_slab(1)
}

/// `INSULA_CRACK_RAYS` sets the number of rays.
fn no_ray_passes_a_closed_surface() -> Result<()> {
    let rays = if tier::is_full() { 2_000_000 } else { 400_000 };
    let rays: u64 = std::env::var("INSULA_CRACK_RAYS").map_or(Ok(rays), |rays| rays.parse())?;
    let frames = rays.div_ceil(u64::from(terraces::FRAME.width_px * terraces::FRAME.height_px));
    let cities: Vec<Terraces> = (0..4).map(Terraces::new).collect::<Result<_>>()?;
    let results: Vec<Result<()>> = (0..frames)
        .into_par_iter()
        .map(|frame| {
            let city = &cities[frame as usize % cities.len()];
            let camera = terraces::camera(city, &mut Rng::new(frame));
            terraces::check(city, &camera, &city.draw_list.scene(&camera, &terraces::FRAME).render())
        })
        .collect();
    let faults: Vec<_> = results.into_iter().filter_map(Result::err).collect();
    ensure!(faults.is_empty(), "{} of {frames} frames: {:#}", faults.len(), faults[0]);
    println!("{frames} frames");
    Ok(())
}

/// Side of the terrain, and of its squares.
const TERRAIN_M: u32 = 256;
const SQUARE_M: u32 = 4;

/// Hills with slopes of up to 60%.
fn hills_m(p: DVec2) -> f64 {
    12.0 * (p.x / 31.0).sin() + 9.0 * (p.y / 27.0 + p.x / 80.0).cos()
}

fn on_hills(p: DVec2) -> DVec3 {
    p.extend(hills_m(p))
}

/// Pixels of sky in `drawn` below one of terrain, where `whole` shows terrain, too: no hill hangs over.
fn sky_below(whole: &Pixels, drawn: &Pixels) -> usize {
    let width = drawn.width_px as usize;
    let is_sky = |at: &usize| !drawn.distance[*at].is_finite();
    let of_column = |x: usize| {
        let below = (x..drawn.distance.len()).step_by(width).skip_while(is_sky);
        below.filter(|at| is_sky(at) && whole.distance[*at].is_finite()).count()
    };
    (0..width).map(of_column).sum()
}

/// Terrain as the viewer draws it: meshes near the eye, columns of several levels further away, all chosen by the same error on the screen.
fn no_sky_in_terrain_of_meshes_and_columns() -> Result<()> {
    let mut shapes = Shapes::default();
    shapes.object(ObjectKind::Terrain);
    for (x, y) in (0..TERRAIN_M / SQUARE_M).flat_map(|y| (0..TERRAIN_M / SQUARE_M).map(move |x| (x, y))) {
        let corner =
            |dx: u32, dy: u32| on_hills(DVec2::new(f64::from(x + dx), f64::from(y + dy)) * f64::from(SQUARE_M));
        let [a, b, c, d] = [corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1)];
        shapes.face(&[a, b, c], paint::GREEN).face(&[a, c, d], paint::GREEN);
    }
    let shape = BakedShape::bake("terrain", shapes.scene([0.0; 3]), 1.0)?;
    let depth = shape.baked.manifest().depth;
    let whole = shape.baked.draw_list_with_meshes(&shape.baked.ids(depth), |_| Some(0))?;
    let middle = DVec2::splat(f64::from(TERRAIN_M) / 2.0);
    let (mut mixed, mut seen) = (0, 0);
    for place in 0..12 {
        let place = f64::from(place);
        let away = DVec2::from_angle(0.55 * place) * (30.0 + 7.0 * place);
        // From eye level to a low flight, across the middle.
        let position = on_hills(middle + away) + DVec3::Z * (2.0 + 2.5 * place);
        let camera = Camera::looking(position, on_hills(middle - away));
        let reference = whole.scene(&camera, &FRAME).render();
        for tau_px in [1.0, 3.0, 9.0] {
            let ids = shape.baked.select(&camera, &FRAME, tau_px);
            let lod = |id: TileId| shape.baked.drawn_lod(id, &camera, &FRAME, tau_px);
            let drawn = shape.baked.draw_list_with_meshes(&ids, lod)?.scene(&camera, &FRAME).render();
            let below = sky_below(&reference, &drawn);
            ensure!(below == 0, "{tau_px} px: {below} pixels of sky: {camera:?}");
            // A hole in the last row is found.
            let mut holed = drawn.clone();
            if let Some(last) = holed.distance.last_mut() {
                *last = f32::INFINITY;
            }
            ensure!(sky_below(&reference, &holed) == 1, "a hole is not seen: {camera:?}");
            let has_meshes = ids.iter().any(|id| lod(*id).is_some());
            mixed += u32::from(has_meshes && ids.iter().any(|id| id.level() < depth));
            seen += drawn.distance.iter().filter(|d| d.is_finite()).count();
        }
    }
    println!("{mixed} frames of meshes and columns of several levels, {seen} pixels of terrain, no sky between them");
    ensure!(mixed > 5, "{mixed} frames have meshes and columns of several levels");
    Ok(())
}

/// Sky pixels of `mixed` that show the city in `whole`, and whose eight neighbours show one surface.
fn cracks(whole: &Pixels, mixed: &Pixels) -> Vec<[u32; 2]> {
    let (width, height) = (mixed.width_px as usize, mixed.height_px as usize);
    let is_crack = |x: usize, y: usize| {
        let at = y * width + x;
        if mixed.distance[at].is_finite() || !whole.distance[at].is_finite() {
            return false;
        }
        let near = (0..9).filter(|k| *k != 4).map(|k| (y + k / 3 - 1) * width + x + k % 3 - 1);
        let [low, high] = near
            .fold([f32::INFINITY, 0.0], |[low, high], at| [low.min(mixed.distance[at]), high.max(mixed.distance[at])]);
        high.is_finite() && high - low < 0.05 * low
    };
    let inner = (1..height - 1).flat_map(|y| (1..width - 1).map(move |x| (x, y)));
    inner.filter(|(x, y)| is_crack(*x, *y)).map(|(x, y)| [x as u32, y as u32]).collect()
}

fn check(name: &str) -> Result<()> {
    let inputs = fidelity::real_city(name).context("it is not on this machine")?;
    let city = fidelity::baked(name)?;
    let (truth, baked) = (Truth::new(fidelity::read(&inputs)?), Baked::open(&city)?);
    let ids: Vec<TileId> = baked.leaves()?.into_keys().filter(|id| baked.lods(*id) > 0).collect();
    ensure!(!ids.is_empty(), "no leaf has a mesh");
    let most = ids.iter().map(|id| baked.lods(*id)).max().unwrap_or(1);
    ensure!(most > 1, "no leaf has two levels of detail");
    // One camera of each kind is enough for a quick run.
    let stations =
        cameras::stations(&truth).into_iter().step_by(if tier::is_full() { 1 } else { 4 }).collect::<Vec<_>>();
    let whole = baked.draw_list_with_meshes(&ids, |_| Some(0))?;
    let wholes: Vec<Pixels> = stations.iter().map(|s| whole.scene(&s.camera, &FRAME).render()).collect();
    let (mut frames, mut seen) = (0, 0);
    // Alternating levels in a chequerboard: of two neighbours, either may be the finer.
    let pairs = (0..most).flat_map(|a| (0..most).map(move |b| (a, b))).filter(|(a, b)| a != b);
    let is_chosen = |(a, b): &(u8, u8)| tier::is_full() || a.abs_diff(*b) == most - 1;
    for (a, b) in pairs.filter(is_chosen) {
        let mixed = baked.draw_list_with_meshes(&ids, |id| Some(if (id.x() + id.y()) % 2 == 0 { a } else { b }))?;
        for (station, whole) in stations.iter().zip(&wholes) {
            let drawn = mixed.scene(&station.camera, &FRAME).render();
            let cracks = cracks(whole, &drawn);
            let at = cracks.first();
            ensure!(cracks.is_empty(), "levels {a} and {b}: {} pixels of sky, at {at:?}: {station:?}", cracks.len());
            frames += 1;
            seen += drawn.distance.iter().filter(|d| d.is_finite()).count();
        }
    }
    println!("{frames} frames, {seen} pixels of the city, no sky between leaves");
    // The check finds a hole.
    let lone = Pixels { distance: vec![f32::INFINITY; wholes[0].distance.len()], ..wholes[0].clone() };
    let mut holed = wholes[0].clone();
    let at = (1..wholes[0].distance.len() - 1).find(|at| {
        let (x, y) = (at % FRAME.width_px as usize, at / FRAME.width_px as usize);
        let inner = x > 0 && y > 0 && x + 1 < FRAME.width_px as usize && y + 1 < FRAME.height_px as usize;
        let row = |y: usize| (x - 1..x + 2).map(move |x| y * FRAME.width_px as usize + x);
        inner && {
            let near: Vec<f32> = (y - 1..y + 2).flat_map(row).map(|at| wholes[0].distance[at]).collect();
            let (low, high) =
                (near.iter().copied().fold(f32::INFINITY, f32::min), near.iter().copied().fold(0.0, f32::max));
            high - low < 0.02 * low
        }
    });
    if let Some(at) = at {
        holed.distance[at] = f32::INFINITY;
        ensure!(cracks(&wholes[0], &holed).len() == 1 && cracks(&lone, &lone).is_empty(), "a hole is not seen");
    }
    Ok(())
}
