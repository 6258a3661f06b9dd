//! The ray-caster: the GPU draws what the CPU draws, and the CPU draws what the reference ray-caster draws.

use anyhow::{Context, Result, ensure};
use glam::{DVec3, Vec3};
use insula_protocol::blockmap::ground::GROUND_COLOUR;
use insula_protocol::blockmap::{COLUMNS, MapColumn, WallStrip, flag};
use insula_protocol::{BlockMap, NODE_CELLS, Texel, TileId, octahedral};
use insula_shaders::cpu::night::bays_of;
use insula_shaders::cpu::raycast::{Pixels, count};
use insula_shaders::cpu::shade::{Airlight, background, encode_srgb};
use insula_shaders::layout::{
    FrameUniform, Light, NO_NODE, PALETTE_COLOURED, PALETTE_HIDDEN, PALETTE_OUTLINED, Shading,
};
use insula_shaders::light::{Air, NightLights};
use insula_shaders::look::Look;
use insula_shaders::pack::PackedNode;
use insula_shaders::shore::Shore;
use insula_shaders::tone::decode_radiance;
use insula_test_support::tier;
use insula_tests::draw_list::{CityArea, DrawList, Scene};
use insula_tests::gpu::Gpu;
use insula_tests::random::{self, Pose, RandomCity};
use insula_tests::reference_caster::{ReferenceCaster, ReferencePixel};
use insula_tests::rng::Rng;
use insula_tests::trials::Trials;
use insula_tests::view::{Camera, FrameSpec, in_look};
use insula_tests::{gpu_tests, tests, twin};
use rayon::prelude::*;
use std::sync::OnceLock;

pub(crate) fn add(trials: &mut Trials) {
    trials
        .add(gpu_tests![
            gpu_draws_what_the_cpu_draws,
            gpu_and_cpu_agree_in_every_shading,
            gpu_and_cpu_agree_at_every_hour,
            gpu_and_cpu_agree_on_water,
            gpu_and_cpu_agree_on_the_sea_beyond_a_city,
            gpu_and_cpu_agree_during_cross_fades,
            gpu_and_cpu_agree_on_objects
        ])
        .add(tests![
            each_ray_of_a_cross_fade_sees_one_side,
            cpu_draws_what_the_reference_caster_draws,
            low_quarters_are_skipped_and_change_no_pixel,
            a_wall_casts_a_shadow_as_long_as_it_is_high,
            altered_and_truncated_frames_are_detected
        ]);
}

/// Odd sizes, so that one ray has exactly the direction of the camera.
const FRAME: FrameSpec = FrameSpec { width_px: 241, height_px: 135, shading: Shading::Lit, samples: 1 };

fn cities() -> &'static [RandomCity] {
    static CITIES: OnceLock<Vec<RandomCity>> = OnceLock::new();
    let count = if tier::is_full() { 16 } else { 4 };
    CITIES.get_or_init(|| (0..count).map(|seed| random::city(seed).expect("random cities are valid")).collect())
}

/// A city, on ground that every second number of samples draws.
fn grounded<'a>(city: &'a RandomCity, camera: &Camera, spec: &FrameSpec) -> Scene<'a> {
    let mut scene = city.draw_list.scene(camera, spec);
    scene.frame.ground = spec.samples % 2;
    scene.frame.ground_z_m = -(camera.position[2] - city.area.origin[2]) as f32;
    scene
}

fn gpu_draws_what_the_cpu_draws(gpu: &Gpu) -> Result<()> {
    twin::agree_in_all_poses(gpu, cities().iter(), 1000, |_, city, camera| grounded(city, camera, &FRAME))
}

fn gpu_and_cpu_agree_in_every_shading(gpu: &Gpu) -> Result<()> {
    let some = cities().iter().take(if tier::is_full() { 4 } else { 2 });
    twin::agree_in_every_shading(gpu, some, 2000, FRAME, grounded)
}

/// Both see the same objects, and draw them in the same colours, hidden and outlined.
fn gpu_and_cpu_agree_on_objects(gpu: &Gpu) -> Result<()> {
    let styles: [fn(u32) -> u32; 3] = [
        |_| 0,
        |object| if object % 4 == 0 { PALETTE_HIDDEN } else { 0 },
        |object| PALETTE_COLOURED | (object.wrapping_mul(0x9e_3779) & 0xff_ffff) | (object % 2 * PALETTE_OUTLINED),
    ];
    let mut shown = 0;
    for (seed, city) in cities().iter().enumerate() {
        let mut city = city.clone();
        let style = styles[seed % styles.len()];
        city.draw_list.set_styles(style);
        let camera = random::camera(&mut Rng::new(seed as u64), &city, Pose::Above);
        for (shading, samples) in [(Shading::Objects, 1), (Shading::Albedo, 1), (Shading::Albedo, 2)] {
            let spec = FrameSpec { shading, samples, ..FRAME };
            let mut scene = city.draw_list.scene(&camera, &spec);
            scene.frame.objects = 1;
            twin::agree(gpu, &scene, &camera, "objects")?;
            if shading == Shading::Objects {
                let pixels = scene.render();
                let objects: Vec<u32> =
                    pixels.colour.iter().filter_map(|word| city.draw_list.object_at(*word)).collect();
                ensure!(objects.iter().all(|object| style(*object) & PALETTE_HIDDEN == 0), "a hidden object is seen");
                let hits = pixels.hit.iter().filter(|hit| **hit != NO_NODE).count();
                ensure!(objects.len() == hits, "{} of {hits} hits have an object", objects.len());
                shown += hits;
            }
        }
    }
    ensure!(shown > 10_000, "{shown} pixels");
    Ok(())
}

/// Towards the sun and away from it, from noon to night, in clear air and in haze.
fn gpu_and_cpu_agree_at_every_hour(gpu: &Gpu) -> Result<()> {
    let city = &cities()[1];
    for (i, height) in [1.2f32, 0.2, 0.02, -0.05, -0.6].into_iter().enumerate() {
        let mut rng = Rng::new(4000 + i as u64);
        let views = [(Pose::Grazing, 300.0, 0.0), (Pose::Above, 3e4, 0.0), (Pose::Above, 3e4, 3e3)];
        // In the quick tier, two of three at each hour.
        for (pose, visibility_m, shadow_m) in
            views.into_iter().enumerate().filter(|(k, _)| tier::is_full() || (i + k) % 3 > 0).map(|(_, view)| view)
        {
            let camera = random::camera(&mut rng, city, pose);
            let mut scene = grounded(city, &camera, &FRAME);
            let ahead = Vec3::from(scene.frame.forward).with_z(0.0).normalize_or(Vec3::X);
            let sun = (ahead * if i % 2 == 0 { 1.0 } else { -1.0 } * height.cos()).with_z(height.sin());
            let night = NightLights { moon: Some(scene.frame.forward.into()), lit_windows: i % 2 == 1 };
            (scene.frame.sun, scene.frame.light) =
                (sun.into(), Light::new(sun, Air { visibility_m, ..Air::default() }, &night));
            scene.frame.bays = bays_of(camera.position.into(), 1.0 / FRAME.height_px as f32);
            scene.frame.shadow_m = shadow_m;
            twin::agree(gpu, &scene, &camera, &format!("sun {height} high, {pose:?}"))?;
            for look in [Look::Model, Look::Paper] {
                let mut graded = scene.clone();
                // Lines turn an edge that is one pixel off into several.
                graded.frame = FrameUniform { edges: [0.0; 4], ..in_look(scene.frame, look) };
                twin::agree(gpu, &graded, &camera, &format!("sun {height} high, {pose:?}, {look:?}"))?;
            }
            let occluded = scene.render();
            scene.frame.light.sky_up[3] = 1.0;
            twin::agree(gpu, &scene, &camera, &format!("sun {height} high, {pose:?}, without occlusion"))?;
            ensure!(i > 0 || scene.render().colour != occluded.colour, "occlusion is visible by day");
        }
    }
    Ok(())
}

fn gpu_and_cpu_agree_during_cross_fades(gpu: &Gpu) -> Result<()> {
    for (seed, city) in cities().iter().enumerate().take(6) {
        let mut rng = Rng::new(5000 + seed as u64);
        let share = [1, 20, 32, 63][rng.below(4)];
        let [both, ..] = random::fading(city, 6000 + seed as u64, share)?;
        for (pose, samples) in [(Pose::Above, 1), (Pose::Grazing, 1), (Pose::Outside, 2), (Pose::Inside, 3)] {
            let camera = random::camera(&mut rng, city, pose);
            let spec = FrameSpec { samples, ..FRAME };
            let mut scene = both.scene(&camera, &spec);
            scene.frame.shadow_m = if pose == Pose::Above { 1e3 } else { 0.0 };
            let what = format!("city {seed}, {pose:?}, {share} of 64");
            if samples == 1 {
                twin::agree(gpu, &scene, &camera, &what)?;
            } else {
                // Edges between the rays of one pixel are not searched for.
                let differing = twin::compare(&scene.render(), &gpu.render(&scene)?).differing;
                anyhow::ensure!(differing * 500 < scene.render().hit.len(), "{what}: {differing} pixels differ");
            }
        }
    }
    Ok(())
}

/// During a cross-fade, a frame consists of rays of the new frame and of the old one, in the given proportion everywhere. Rays
/// towards the sun stay on their side of the cross-fade.
fn each_ray_of_a_cross_fade_sees_one_side() -> Result<()> {
    let mut seen = [0usize; 4];
    for (seed, city) in cities().iter().enumerate() {
        let mut rng = Rng::new(7000 + seed as u64);
        for share in [1u8, 16, 40, 63] {
            let draw_lists = random::fading(city, 8000 + seed as u64, share)?;
            let pose = Pose::ALL[rng.below(Pose::ALL.len())];
            let camera = random::camera(&mut rng, city, pose);
            let draw = |draw_list: &DrawList| {
                let mut scene = draw_list.scene(&camera, &FRAME);
                scene.frame.shadow_m = 1e3;
                scene.render()
            };
            let [both, new, old] = [draw(&draw_lists[0]), draw(&draw_lists[1]), draw(&draw_lists[2])];
            let same = |a: &Pixels, i: usize| {
                let (a_m, b_m) = (a.distance[i], both.distance[i]);
                twin::same_colour(a.colour[i], both.colour[i], 1) && (a_m == b_m || (a_m - b_m).abs() < 1e-6 * b_m)
            };
            for i in 0..both.colour.len() {
                match (same(&new, i), same(&old, i)) {
                    (true, true) => seen[0] += 1,
                    (true, false) => seen[1] += 1,
                    (false, true) => seen[2] += usize::from(share == 16),
                    (false, false) => seen[3] += 1,
                }
            }
        }
        // In every block of 8 x 8 pixels, sixteen rays see the old frame.
        let draw_lists = random::fading(city, 9000 + seed as u64, 16)?;
        let camera = random::camera(&mut rng, city, Pose::Above);
        let hit = draw_lists[0].scene(&camera, &FRAME).render().hit;
        for (x, y) in (0..FRAME.width_px / 8).flat_map(|x| (0..FRAME.height_px / 8).map(move |y| (x * 8, y * 8))) {
            let block = (0..64).map(|i| hit[((y + i / 8) * FRAME.width_px + x + i % 8) as usize]);
            let block: Vec<u32> = block.filter(|node| *node != insula_shaders::layout::NO_NODE).collect();
            // Nodes of the new and the old frame alternate.
            let behind = block.iter().filter(|node| *node % 2 == 1).count();
            anyhow::ensure!(block.len() < 64 || behind == 16, "{behind} of {} at {x}, {y}, city {seed}", block.len());
        }
    }
    println!("{seen:?} pixels: in both, new, old, neither");
    anyhow::ensure!(seen[1] > 10_000 && seen[2] > 1000, "{seen:?}");
    anyhow::ensure!(seen[3] * 1000 < seen[0] + seen[1], "{seen:?}: a pixel shows neither frame");
    Ok(())
}

/// A wall of ten metres across a plain. `flags` are added to every column.
fn wall_across_a_plain(flags: u8) -> Result<DrawList> {
    let texel = Texel::new([128; 3], 63);
    let up = octahedral::encode([0.0, 0.0, 1.0]);
    let columns: Vec<_> = (0..COLUMNS)
        .map(|i| {
            let plain = MapColumn { z_max: 16, roof: texel, roof_normal: up, ..MapColumn::default() };
            let strip = Some(WallStrip { texels: vec![texel; 11], azimuth: 128 });
            Some(if i % NODE_CELLS == 32 { MapColumn { z_max: 16 * 11, strip, ..plain } } else { plain })
        })
        .collect();
    let mut draw_list = DrawList::new(CityArea { origin: [0.0; 3], root_side_m: NODE_CELLS as f64 });
    let mut map = BlockMap::from_columns(TileId::ROOT, 1.0, 0, 0, &columns)?;
    map.flags.iter_mut().for_each(|of_column| *of_column |= flags);
    draw_list.add(&map);
    Ok(draw_list)
}

/// Water reflects more of the sky the flatter it is seen, and the sun only where it stands opposite.
fn gpu_and_cpu_agree_on_water(gpu: &Gpu) -> Result<()> {
    let (water, matt) = (wall_across_a_plain(flag::REFLECTIVE)?, wall_across_a_plain(0)?);
    let mut brighter = [0.0f32; 2];
    for (i, z) in [6.0, 60.0].into_iter().enumerate() {
        let camera = Camera::looking(DVec3::new(1.0, 32.0, z), DVec3::new(20.0, 32.0, 1.0));
        let draw = |draw_list: &DrawList, what: &str| -> Result<f32> {
            let mut scene = draw_list.scene(&camera, &FRAME);
            let sun = Vec3::new(-0.4, 0.0, 0.9);
            (scene.frame.sun, scene.frame.light) = (sun.normalize().into(), Light::of_sun(sun, Air::default()));
            scene.frame.shadow_m = 100.0;
            twin::agree(gpu, &scene, &camera, what)?;
            let middle = (FRAME.width_px * (FRAME.height_px / 2) + FRAME.width_px / 2) as usize;
            Ok(decode_radiance(scene.render().radiance[middle]).z)
        };
        brighter[i] = draw(&water, "water")? / draw(&matt, "matt")?;
    }
    anyhow::ensure!(brighter[0] > brighter[1] && brighter[1] < 1.0, "water over matt ground: {brighter:?}");
    Ok(())
}

/// A city with land in the west and water in the east, a part of which has lost a little of its colour, and bare ground at both ends.
fn coast() -> Result<BlockMap> {
    let up = octahedral::encode([0.0, 0.0, 1.0]);
    let columns: Vec<_> = (0..COLUMNS)
        .map(|i| {
            let (rgb, reflective) = match i % NODE_CELLS {
                8..40 => ([230, 225, 215], false),
                40..60 if i / NODE_CELLS % 8 == 3 => ([66, 126, 156], true),
                40..60 => ([60, 120, 150], true),
                _ => (GROUND_COLOUR, false),
            };
            let roof = Texel::new(rgb, 63);
            Some(MapColumn { z_max: 16, roof, roof_normal: up, reflective, ..MapColumn::default() })
        })
        .collect();
    Ok(BlockMap::from_columns(TileId::ROOT, 1.0, 0, 0, &columns)?)
}

/// Water goes on beyond the east, over bare ground and the plane, and nowhere else.
fn gpu_and_cpu_agree_on_the_sea_beyond_a_city(gpu: &Gpu) -> Result<()> {
    let map = coast()?;
    let shore = Shore::of(&PackedNode::new(&map)).context("the city ends in water")?;
    let mut draw_list = DrawList::new(CityArea { origin: [0.0; 3], root_side_m: NODE_CELLS as f64 });
    draw_list.add(&map);
    let mut counts = [0, 0];
    for target_x in [70.0, -20.0] {
        let camera = Camera::looking(DVec3::new(32.0, 32.0, 40.0), DVec3::new(target_x, 32.0, 1.0));
        let mut scene = draw_list.scene(&camera, &FRAME);
        let sun = Vec3::new(-0.4, 0.3, 0.9);
        (scene.frame.sun, scene.frame.light) = (sun.normalize().into(), Light::of_sun(sun, Air::default()));
        (scene.frame.ground, scene.frame.ground_z_m) = (1, 1.0 - camera.position[2] as f32);
        shore.write(&mut scene.frame, -DVec3::from(camera.position).truncate(), NODE_CELLS as f64);
        twin::agree(gpu, &scene, &camera, "the sea beyond a city")?;
        let picture = scene.render();
        for i in 0..FRAME.width_px * FRAME.height_px {
            let ray = camera.ray(&FRAME, i % FRAME.width_px, i / FRAME.width_px);
            let place = DVec3::from(camera.position) + ray * ((camera.position[2] - 1.0) / -ray.z).max(0.0);
            let is_sea = (61.5..200.0).contains(&place.x) && (1.0..63.0).contains(&place.y);
            if ray.z > -0.1 || !is_sea && !(-200.0..7.0).contains(&place.x) {
                continue;
            }
            let light = decode_radiance(picture.radiance[i as usize]);
            anyhow::ensure!((light.z > 1.2 * light.x) == is_sea, "{light} at {place}");
            counts[usize::from(is_sea)] += 1;
        }
    }
    anyhow::ensure!(counts.iter().all(|count| *count > 1000), "pixels of land and sea beyond: {counts:?}");
    Ok(())
}

/// With the sun 45 degrees high behind the wall and the camera above it.
fn a_wall_casts_a_shadow_as_long_as_it_is_high() -> Result<()> {
    let draw_list = wall_across_a_plain(0)?;
    let camera = Camera::looking(DVec3::new(32.0, 32.0, 60.0), DVec3::new(32.0, 32.0, 0.0));
    let mut scene = draw_list.scene(&camera, &FRAME);
    let sun = Vec3::new(1.0, 0.0, 1.0).normalize_or(Vec3::Z);
    (scene.frame.sun, scene.frame.light) = (sun.into(), Light::of_sun(sun, Air::default()));
    let bare = scene.render();
    scene.frame.shadow_m = 1000.0;
    let shaded = scene.render();
    let (mut dark, mut bright) = (0, 0);
    for i in 0..FRAME.width_px * FRAME.height_px {
        let at = i as usize;
        let ray = camera.ray(&FRAME, i % FRAME.width_px, i / FRAME.width_px);
        let p = DVec3::from(camera.position) + ray * f64::from(shaded.distance[at]);
        if !p.is_finite() || p.z > 1.5 {
            continue;
        }
        let darker = shaded.colour[at] & 255 < (bare.colour[at] & 255) - 20;
        if (23.5..31.5).contains(&p.x) {
            anyhow::ensure!(darker, "no shadow at {p}");
            dark += 1;
        } else if p.x < 21.5 || p.x > 33.5 {
            anyhow::ensure!(shaded.colour[at] == bare.colour[at], "a shadow at {p}");
            bright += 1;
        }
    }
    anyhow::ensure!(dark > 1000 && bright > 3000, "{dark} pixels in the shade, {bright} in the sun");
    Ok(())
}

/// A pixel whose neighbours are all like it.
fn flat_pixel(frame: &Pixels) -> Result<usize> {
    let (width, height) = (frame.width_px as usize, frame.height_px as usize);
    let flat = (1..height - 1).flat_map(|y| (1..width - 1).map(move |x| y * width + x)).find(|i| {
        let around = [i - 1, i + 1, i - width, i + width, i - width - 1, i - width + 1, i + width - 1, i + width + 1];
        around.iter().all(|n| {
            // Dithering varies the rounding.
            let alike = frame.hit[*n] == frame.hit[*i] && twin::same_colour(frame.colour[*n], frame.colour[*i], 2);
            alike && frame.distance[*i].is_finite() && (frame.distance[*n] / frame.distance[*i] - 1.0).abs() < 0.01
        })
    });
    flat.ok_or_else(|| anyhow::anyhow!("no flat pixel in the frame"))
}

/// The comparison finds one altered pixel, and frames of another size.
fn altered_and_truncated_frames_are_detected() -> Result<()> {
    let city = &cities()[0];
    let camera = random::camera(&mut Rng::new(7), city, Pose::Above);
    let scene = city.draw_list.scene(&camera, &FRAME);
    let frame = scene.render();
    anyhow::ensure!(twin::compare_twins(&scene, &frame, &frame).check().is_ok(), "a frame differs from itself");
    let i = flat_pixel(&frame)?;
    let altered = |alter: &dyn Fn(&mut Pixels)| {
        let mut altered = frame.clone();
        alter(&mut altered);
        altered
    };
    let is_detected = |a: &Pixels, b: &Pixels| twin::compare_twins(&scene, a, b).check().is_err();
    for (what, altered) in [
        ("colour", altered(&|frame| frame.colour[i] ^= 0x40)),
        ("distance", altered(&|frame| frame.distance[i] *= 1.05)),
        ("NaN", altered(&|frame| frame.distance[i] = f32::NAN)),
    ] {
        anyhow::ensure!(is_detected(&frame, &altered), "an altered pixel is not detected: {what}");
    }
    let narrow = altered(&|frame| frame.width_px -= 1);
    for other in [Pixels::default(), altered(&|frame| frame.colour.truncate(1)), narrow] {
        let both = is_detected(&frame, &other) && is_detected(&other, &frame);
        anyhow::ensure!(both, "a frame of another size was accepted");
    }
    Ok(())
}

/// A ray that starts on the border of a cell may be on either side. All others agree with the reference, or with a reference
/// ray that is rotated by a few millionths.
fn cpu_draws_what_the_reference_caster_draws() -> Result<()> {
    let [width_px, height_px] = if tier::is_full() { [49, 33] } else { [33, 23] };
    let spec = FrameSpec { width_px, height_px, shading: Shading::Albedo, samples: 1 };
    let (mut rays, mut rotated, mut hits) = (0, 0, 0);
    for (seed, city) in cities().iter().enumerate() {
        let reference_caster = ReferenceCaster::new(city.area, &city.maps);
        let mut rng = Rng::new(3000 + seed as u64);
        for pose in Pose::ALL {
            let camera = random::camera(&mut rng, city, pose);
            let scene = city.draw_list.scene(&camera, &spec);
            let drawn = scene.render();
            let verdicts: Vec<Verdict> = (0..spec.width_px * spec.height_px)
                .into_par_iter()
                .map(|i| compare_with_reference(&reference_caster, &camera, &spec, &scene.frame, &drawn, i))
                .collect();
            if let Some(i) = verdicts.iter().position(|v| *v == Verdict::Different) {
                let (x, y) = (i as u32 % spec.width_px, i as u32 / spec.width_px);
                let seen = reference_caster.cast(&camera, camera.ray(&spec, x, y), [x, y]);
                let wrong = verdicts.iter().filter(|v| **v == Verdict::Different).count();
                anyhow::bail!(
                    "city {seed}, {pose:?}: {wrong} wrong, first at {x}, {y}: drawn {:08x} {}, meant {seen:?}\n{camera:?}",
                    drawn.colour[i],
                    drawn.distance[i],
                );
            }
            rays += verdicts.len();
            rotated += verdicts.iter().filter(|v| **v == Verdict::EqualIfRotated).count();
            hits += drawn.distance.iter().filter(|d| d.is_finite()).count();
        }
    }
    println!("{rays} rays, {hits} hits, {rotated} on edges");
    anyhow::ensure!(rotated * 100 < rays, "{rotated} of {rays} rays agree only when turned");
    anyhow::ensure!(hits * 8 > rays, "only {hits} of {rays} rays hit anything");
    Ok(())
}

/// The heights of a node's quarters save visits and change no pixel: in random cities, and in a node with one tower beside its
/// centre, seen past the centre from all sides.
fn low_quarters_are_skipped_and_change_no_pixel() -> Result<()> {
    let (mut with, mut without) = (0, 0);
    let mut compare = |draw_list: &DrawList, camera: &Camera, what: &str| {
        let scene = draw_list.scene(camera, &FRAME);
        let mut blind = scene.clone();
        for word in blind.nodes.iter_mut().flat_map(|node| &mut node.pages) {
            *word &= 0xff_ffff;
        }
        let differing = twin::compare(&scene.render(), &blind.render()).differing;
        anyhow::ensure!(differing == 0, "{what}: {differing} pixels differ");
        with += count(&scene.as_ref()).nodes;
        without += count(&blind.as_ref()).nodes;
        Ok(())
    };
    for (seed, city) in cities().iter().enumerate() {
        let mut rng = Rng::new(7000 + seed as u64);
        for pose in Pose::ALL {
            compare(&city.draw_list, &random::camera(&mut rng, city, pose), &format!("city {seed}, {pose:?}"))?;
        }
    }
    let plain = MapColumn { z_max: 16, roof: Texel::new([128; 3], 63), ..MapColumn::default() };
    for tower in [[30, 30], [33, 30], [30, 33], [33, 33]] {
        let is_tower = |i: usize| [i % NODE_CELLS, i / NODE_CELLS] == tower;
        let columns: Vec<_> = (0..COLUMNS)
            .map(|i| Some(MapColumn { z_max: if is_tower(i) { 16 * 40 } else { 16 }, ..plain.clone() }))
            .collect();
        let mut draw_list = DrawList::new(CityArea { origin: [0.0; 3], root_side_m: NODE_CELLS as f64 });
        draw_list.add(&BlockMap::from_columns(TileId::ROOT, 1.0, 0, 0, &columns)?);
        for azimuth in (0..32).step_by(if tier::is_full() { 1 } else { 5 }) {
            let towards = DVec3::from((glam::DVec2::from_angle(f64::from(azimuth) * 0.2), 0.0));
            let middle = DVec3::new(32.0, 32.0, 20.0);
            compare(&draw_list, &Camera::looking(middle - towards * 60.0, middle), &format!("tower at {tower:?}"))?;
        }
    }
    println!("{with} of {without} visits");
    anyhow::ensure!(with * 20 < without * 19);
    Ok(())
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Verdict {
    Equal,
    EqualIfRotated,
    Different,
}

fn compare_with_reference(
    reference_caster: &ReferenceCaster,
    camera: &Camera,
    spec: &FrameSpec,
    frame: &insula_shaders::layout::FrameUniform,
    drawn: &Pixels,
    i: u32,
) -> Verdict {
    let pixel = [i % spec.width_px, i / spec.width_px];
    let dir = camera.ray(spec, pixel[0], pixel[1]);
    let agrees = |seen: ReferencePixel| {
        let (drawn_m, reference_m) = (f64::from(drawn.distance[i as usize]), seen.distance_m);
        if drawn_m.is_finite() != reference_m.is_finite() {
            return false;
        }
        if reference_m.is_finite() && (drawn_m - reference_m).abs() > 2e-3 + 1e-3 * reference_m {
            return false;
        }
        let sky = || background(frame, dir.as_vec3(), &Airlight::new(frame, dir.as_vec3())).sky;
        let rgb = if reference_m.is_finite() { seen.rgb.as_vec3() } else { sky() };
        twin::same_colour(drawn.colour[i as usize], encode_srgb(rgb), 3)
    };
    if agrees(reference_caster.cast(camera, dir, pixel)) {
        return Verdict::Equal;
    }
    let (side, up) = dir.any_orthonormal_pair();
    let rotations = (0..24).map(|k| {
        let angle = f64::from(k % 8) * std::f64::consts::FRAC_PI_4;
        let offset = [2e-6, 2e-5, 1e-4][k as usize / 8];
        (dir + (side * angle.cos() + up * angle.sin()) * offset).normalize_or(dir)
    });
    if rotations.into_iter().any(|rotated| agrees(reference_caster.cast(camera, rotated, pixel))) {
        Verdict::EqualIfRotated
    } else {
        Verdict::Different
    }
}
