//! Packets of rays draw what single rays draw, with every instruction set, and adaptive sampling draws nearly the same.

use anyhow::{Context, Result, ensure};
use insula_protocol::blockmap::{COLUMNS, MapColumn};
use insula_protocol::{BlockMap, NODE_CELLS, Texel, TileId};
use insula_shaders::cpu::instruction_set::InstructionSet;
use insula_shaders::cpu::night::bays_of;
use insula_shaders::cpu::raycast::{Pixels, Sampling, SceneRef};
use insula_shaders::cpu::render::{RenderedRows, render_with};
use insula_shaders::cpu::stepped::{FrameProgress, SteppedFrame};
use insula_shaders::layout::{Light, PALETTE_COLOURED, PALETTE_HIDDEN, PALETTE_OUTLINED, Shading};
use insula_shaders::light::{Air, NightLights};
use insula_shaders::look::Look;
use insula_shaders::tone::decode_radiance;
use insula_test_support::tier;
use insula_tests::draw_list::{CityArea, DrawList, Scene};
use insula_tests::random::{self, Pose, RandomCity};
use insula_tests::rng::Rng;
use insula_tests::trials::Trials;
use insula_tests::view::{Camera, FrameSpec, in_look};
use insula_tests::{random_mesh, tests};

pub(crate) fn add(trials: &mut Trials) {
    trials.add(tests![
        packets_draw_what_single_rays_draw,
        packets_draw_every_shading_the_night_and_objects,
        packets_draw_every_look,
        lamps_light_streets_and_not_roofs,
        packets_draw_cross_fades,
        packets_draw_what_is_added_to_a_city,
        adaptive_frames_are_the_same_in_steps_and_close_to_full_ones
    ]);
}

const FRAME: FrameSpec = FrameSpec { width_px: 121, height_px: 67, shading: Shading::Lit, samples: 1 };

fn cities() -> Vec<RandomCity> {
    let count = if tier::is_full() { 12 } else { 4 };
    (0..count).map(|seed| random::city(seed).expect("random cities are valid")).collect()
}

/// Fails unless all instruction sets draw what single rays draw.
fn check(scene: &Scene<'_>, what: &str) -> Result<()> {
    let scene = scene.as_ref();
    let expected = render_with(&scene, None, Sampling::Full);
    for set in InstructionSet::all() {
        let found = render_with(&scene, Some(set), Sampling::Full);
        let differs = |i: &usize| {
            let words = |p: &Pixels| (p.colour[*i], p.radiance.get(*i).copied(), p.distance[*i].to_bits(), p.hit[*i]);
            words(&expected) != words(&found)
        };
        let differing: Vec<usize> = (0..expected.colour.len()).filter(differs).collect();
        if let Some(i) = differing.first() {
            let values = |p: &Pixels| format!("{:08x} {} {}", p.colour[*i], p.distance[*i], p.hit[*i] as i32);
            anyhow::bail!(
                "{what}, {}: {} pixels differ, the first is {i}: {}, not {}",
                set.name(),
                differing.len(),
                values(&found),
                values(&expected)
            );
        }
    }
    Ok(())
}

fn packets_draw_what_single_rays_draw() -> Result<()> {
    for (seed, city) in cities().iter().enumerate() {
        let mut rng = Rng::new(100 + seed as u64);
        for (pose, samples) in Pose::ALL.into_iter().zip([1, 1, 2, 3, 1, 4].into_iter().cycle()) {
            let camera = random::camera(&mut rng, city, pose);
            let mut scene = city.draw_list.scene(&camera, &FrameSpec { samples, ..FRAME });
            scene.frame.ground = seed as u32 % 2;
            scene.frame.ground_z_m = -(camera.position[2] - city.area.origin[2]) as f32;
            scene.frame.shadow_m = if samples == 1 { 0.0 } else { 1e3 };
            scene.frame.sun_radius = if samples == 3 { 0.005 } else { 0.0 };
            check(&scene, &format!("city {seed}, {pose:?}, {samples} samples"))?;
        }
    }
    Ok(())
}

fn packets_draw_every_shading_the_night_and_objects() -> Result<()> {
    let styles = |object: u32| match object % 3 {
        0 => PALETTE_HIDDEN,
        1 => PALETTE_COLOURED | (object.wrapping_mul(0x9e_3779) & 0xff_ffff),
        _ => PALETTE_OUTLINED,
    };
    for (seed, city) in cities().iter().enumerate() {
        let mut city = city.clone();
        let mut rng = Rng::new(200 + seed as u64);
        if seed % 2 == 0 {
            random_mesh::add(&mut city, &mut Rng::new(500 + seed as u64), 0.5)?;
        }
        city.draw_list.set_styles(styles);
        for shading in Shading::ALL.into_iter().chain([Shading::Objects]) {
            let camera = random::camera(&mut rng, &city, Pose::Above);
            for samples in [1, 2] {
                let mut scene = city.draw_list.scene(&camera, &FrameSpec { shading, samples, ..FRAME });
                scene.frame.objects = 1;
                check(&scene, &format!("city {seed}, {}, {samples} samples", shading.word()))?;
            }
        }
        let camera = random::camera(&mut rng, &city, Pose::Grazing);
        let mut scene = city.draw_list.scene(&camera, &FRAME);
        scene.frame.light.sky_up[3] = 1.0;
        check(&scene, &format!("city {seed}, without occlusion"))?;
        let sun = glam::Vec3::new(0.3, 0.4, -0.1).normalize();
        let night = NightLights { moon: Some(scene.frame.forward.into()), lit_windows: seed % 2 == 0 };
        (scene.frame.sun, scene.frame.light) = (sun.into(), Light::new(sun, Air::default(), &night));
        scene.frame.bays = bays_of(camera.position.into(), 1.0 / 67.0);
        check(&scene, &format!("city {seed}, at night"))?;
    }
    Ok(())
}

/// Packets and single rays agree on added meshes: in front of the city, behind it, and in its shadow.
fn packets_draw_what_is_added_to_a_city() -> Result<()> {
    let mut differing = 0;
    for (seed, city) in cities().iter().enumerate() {
        let mut city = city.clone();
        let mut rng = Rng::new(300 + seed as u64);
        random_mesh::add(&mut city, &mut Rng::new(500 + seed as u64), 0.5)?;
        city.draw_list.set_styles(|object| if object % 3 == 0 { PALETTE_HIDDEN } else { 0 });
        for (pose, shading) in
            Pose::ALL.into_iter().zip([Shading::Lit, Shading::Objects, Shading::Wire].into_iter().cycle())
        {
            let camera = random::camera(&mut rng, &city, pose);
            let mut scene = city.draw_list.scene(&camera, &FrameSpec { shading, samples: 2, ..FRAME });
            (scene.frame.objects, scene.frame.shadow_m) = (1, 1e3);
            let without = scene.render();
            scene.add_moved_meshes([7.0, -3.0, 5.0]);
            let with = scene.render();
            let nearer = without.distance.iter().zip(&with.distance).all(|(without, with)| *with <= *without + 0.01);
            ensure!(nearer, "city {seed}, {pose:?}: additions hide nothing that is before them");
            differing += usize::from(without.hit != with.hit);
            check(&scene, &format!("city {seed} with additions, {pose:?}, {}", shading.word()))?;
        }
    }
    ensure!(differing > 0, "no addition is seen");
    Ok(())
}

/// With the exposure that each look finds.
fn packets_draw_every_look() -> Result<()> {
    for (seed, city) in cities().iter().enumerate() {
        let mut rng = Rng::new(700 + seed as u64);
        for (look, samples) in Look::ALL.into_iter().zip([1, 2, 1]) {
            let camera = random::camera(&mut rng, city, Pose::Above);
            let mut scene = city.draw_list.scene(&camera, &FrameSpec { samples, ..FRAME });
            (scene.frame.ground, scene.frame.exposure) = (1, 0.0);
            scene.frame.ground_z_m = -(camera.position[2] - city.area.origin[2]) as f32;
            scene.frame = in_look(scene.frame, look);
            check(&scene, &format!("city {seed}, {look:?}"))?;
            let mut plain = scene.clone();
            plain.frame.edges = [0.0; 4];
            let has_edges = scene.render().colour != plain.render().colour;
            ensure!(has_edges == (look != Look::Physical), "city {seed}: lines and shade in the look {look:?}");
        }
    }
    Ok(())
}

/// A house of 20 m between two streets, from above at night.
fn lamps_light_streets_and_not_roofs() -> Result<()> {
    let column = |i: usize| {
        let z_max = if (20..44).contains(&(i % NODE_CELLS)) { 320 } else { 4 };
        Some(MapColumn { z_max, roof: Texel::new([180; 3], 20), ..MapColumn::default() })
    };
    let columns: Vec<Option<MapColumn>> = (0..COLUMNS).map(column).collect();
    let mut list = DrawList::new(CityArea { origin: [0.0; 3], root_side_m: 64.0 });
    list.add(&BlockMap::from_columns(TileId::ROOT, 1.0, 0, 0, &columns).context("a valid node")?);
    let camera =
        Camera { position: [32.0, 32.0, 150.0], target: [32.0, 32.0, 0.0], up: [0.0, 1.0, 0.0], fov_y_deg: 20.0 };
    let mut scene = list.scene(&camera, &FrameSpec { width_px: 64, height_px: 64, ..FRAME });
    let sun = glam::Vec3::new(0.6, 0.0, -0.8);
    (scene.frame.sun, scene.frame.light) = (sun.into(), Light::new(sun, Air::default(), &NightLights::default()));
    check(&scene, "a house at night")?;
    let pixels = scene.render();
    let light = |x: usize| decode_radiance(pixels.radiance[32 * 64 + x]).y;
    let [street, roof, other_street] = [8, 32, 56].map(light);
    ensure!(roof < 0.2 * street && street == other_street, "street {street}, roof {roof}, street {other_street}");
    Ok(())
}

fn packets_draw_cross_fades() -> Result<()> {
    for (seed, city) in cities().iter().enumerate() {
        let [both, ..] = random::fading(city, 300 + seed as u64, 20)?;
        let camera = random::camera(&mut Rng::new(seed as u64), city, Pose::Above);
        let mut scene = both.scene(&camera, &FrameSpec { samples: 2, ..FRAME });
        scene.frame.shadow_m = 1e3;
        check(&scene, &format!("city {seed}, fading"))?;
    }
    Ok(())
}

/// Adaptive frames do not depend on the steps in which they are drawn, nor on the instruction set.
fn adaptive_frames_are_the_same_in_steps_and_close_to_full_ones() -> Result<()> {
    let (mut squares, mut codes) = (0.0, 0.0f64);
    for (seed, city) in cities().iter().enumerate() {
        let camera = random::camera(&mut Rng::new(400 + seed as u64), city, Pose::Above);
        let mut scene = city.draw_list.scene(&camera, &FrameSpec { samples: 3, ..FRAME });
        scene.frame.shadow_m = 1e3;
        let scene = scene.as_ref();
        let full = render_with(&scene, None, Sampling::Full);
        for set in InstructionSet::all() {
            let whole = render_with(&scene, Some(set), Sampling::Adaptive);
            let mut rows = RenderedRows::new(Sampling::Adaptive);
            while !rows.render(&scene, 9) {}
            ensure!(rows.develop(scene.frame) == whole, "city {seed}, {}", set.name());
            ensure!(in_steps(&scene, set, seed % 2 == 0)? == whole, "city {seed} in steps, {}", set.name());
            for (a, b) in full.colour.iter().zip(&whole.colour) {
                let apart = a.to_le_bytes().into_iter().zip(b.to_le_bytes()).take(3);
                squares += apart.map(|(a, b)| f64::from(a.abs_diff(b)).powi(2)).sum::<f64>();
                codes += 3.0;
            }
        }
    }
    let rms = (squares / codes.max(1.0)).sqrt();
    ensure!(rms < 1.0, "adaptive frames differ by {rms} of 255");
    Ok(())
}

/// An adaptive frame that is drawn in the shortest steps or in the longest.
fn in_steps(scene: &SceneRef<'_>, set: InstructionSet, is_short: bool) -> Result<Pixels> {
    let mut frame = SteppedFrame::new(Some(set), Sampling::Adaptive);
    let (mut steps, mut sketches) = (0, 0);
    loop {
        steps += 1;
        match frame.step(scene, || is_short) {
            FrameProgress::Drawing => {}
            FrameProgress::Sketched => {
                sketches += 1;
                let sketch = frame.sketch(scene);
                ensure!(
                    sketch.is_some_and(|sketch| sketch.hit.len() == scene.frame.width_px as usize * 67),
                    "no sketch"
                );
            }
            FrameProgress::Drawn => break,
        }
    }
    ensure!(sketches == 1 && if is_short { steps > 2 } else { steps == 2 }, "{sketches} sketches in {steps} steps");
    Ok(frame.develop(scene))
}
