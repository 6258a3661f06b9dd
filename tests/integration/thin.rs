//! Thin things cover as many pixels as they should, at all levels from the leaves to cells of 8 m: their share of the drawn pixels is
//! that of the source. `thin-NAME.png` in the folder `zoo` of the build shows all levels from the leaves upwards.

use glam::DVec3;
use insula_bake::scene::ObjectKind;
use insula_shaders::cpu::raycast::Pixels;
use insula_shaders::layout::Shading;
use insula_tests::tests;
use insula_tests::trials::Trials;
use insula_tests::view::{Camera, FrameSpec};
use insula_tests::zoo::{BakedShape, Shapes, save_frames};

pub(crate) fn add(trials: &mut Trials) {
    trials.add(tests![thin_things_in_the_open, thin_things_on_terrain, thin_things_of_small_cells]);
}

/// From far enough, along y, that all is equally large.
const EYE_M: f64 = 4000.0;
/// What lies as far before or behind the things does not count.
const DEPTH_M: f64 = 40.0;
const PX_M: f64 = 0.05;
const FRAME: FrameSpec = FrameSpec { width_px: 5200, height_px: 320, shading: Shading::Albedo, samples: 1 };
/// Smallest and largest cell at which the shares are checked.
const CELLS_M: [f64; 2] = [1.0, 8.0];
/// Largest error of a share, of the share.
const MAX_ERROR: f64 = 0.25;

/// Something thin: where it stands, from one x to another, above a height, and its area seen along y.
struct Thing {
    name: &'static str,
    x_m: [f64; 2],
    above_m: f64,
    area_m2: f64,
}

/// Two masts, a railing of posts below a bar, a cable and an antenna on a house, each with nothing around it.
fn things(shapes: &mut Shapes) -> Vec<Thing> {
    shapes.cuboid([-106.6, 20.4, 0.0], [-106.4, 20.6, 12.0]);
    shapes.object(ObjectKind::Building).cuboid([-69.75, 20.25, 0.0], [-69.25, 20.75, 12.0]);
    for post in 0..60 {
        let x = -40.0 + 0.5 * f64::from(post);
        shapes.object(ObjectKind::Building).cuboid([x, 20.0, 0.0], [x + 0.05, 20.05, 1.5]);
    }
    shapes.object(ObjectKind::Building).cuboid([-40.0, 20.0, 1.45], [-10.0, 20.05, 1.5]);
    shapes.object(ObjectKind::Building).cuboid([20.0, 20.3, 9.0], [50.0, 20.35, 9.05]);
    shapes.object(ObjectKind::Building).cuboid([80.0, 16.0, 0.0], [92.0, 28.0, 7.0]);
    shapes.object(ObjectKind::Building).cuboid([86.1, 20.3, 7.0], [86.2, 20.4, 13.0]);
    let thing = |name, x_m, above_m, area_m2| Thing { name, x_m, above_m, area_m2 };
    vec![
        thing("mast of 0.2 m", [-120.0, -90.0], 0.5, 0.2 * 11.5),
        thing("mast of 0.5 m", [-84.0, -55.0], 0.5, 0.5 * 11.5),
        thing("railing", [-50.0, 0.0], 0.15, 60.0 * 0.05 * 1.3 + 30.0 * 0.05),
        thing("cable", [10.0, 60.0], 0.5, 30.0 * 0.05),
        thing("antenna", [70.0, 100.0], 8.0, 0.1 * 5.0),
    ]
}

/// Area of the pixels that show a thing.
fn drawn_m2(thing: &Thing, camera: &Camera, drawn: &Pixels) -> f64 {
    let axes = camera.axes(&FRAME);
    let is_shown = |i: &usize| {
        let distance_m = f64::from(drawn.distance[*i]);
        let ray = axes.ray(&FRAME, *i as u32 % FRAME.width_px, *i as u32 / FRAME.width_px);
        let p = DVec3::from(camera.position) + ray * distance_m;
        (distance_m - EYE_M).abs() < DEPTH_M && (thing.x_m[0]..thing.x_m[1]).contains(&p.x) && p.z > thing.above_m
    };
    (0..drawn.distance.len()).filter(is_shown).count() as f64 * PX_M * PX_M
}

fn check(name: &str, cell_m: f64, has_terrain: bool) {
    let mut shapes = Shapes::default();
    if has_terrain {
        shapes.level_ground(140.0);
    }
    let things = things(&mut shapes);
    // So that there are levels up to the largest cell.
    shapes.object(ObjectKind::Building).cuboid([-250.0, -250.0, 0.0], [-248.0, -248.0, 2.0]);
    shapes.object(ObjectKind::Building).cuboid([250.0, 250.0, 0.0], [252.0, 252.0, 2.0]);
    let shape = BakedShape::bake(&format!("thin-{name}"), shapes.scene([0.0; 3]), cell_m).unwrap();
    let middle = DVec3::new(0.0, 20.0, 7.0);
    let fov_y_deg = 2.0 * (0.5 * PX_M * f64::from(FRAME.height_px) / EYE_M).atan().to_degrees();
    // Turned a little, so that edges of columns do not lie along rows of pixels.
    let up = [0.004, 0.0, 1.0];
    let camera = Camera { fov_y_deg, up, ..Camera::looking(middle - DVec3::Y * EYE_M, middle) };
    let (mut frames, mut wrong) = (Vec::new(), Vec::new());
    for (steps, level) in (0..=shape.baked.manifest().depth).rev().enumerate() {
        let level_cell_m = cell_m * f64::from(1 << steps);
        if level_cell_m > CELLS_M[1] {
            break;
        }
        let drawn = shape.baked.draw_list(&shape.baked.ids(level)).unwrap().scene(&camera, &FRAME).render();
        for thing in &things {
            let ratio = drawn_m2(thing, &camera, &drawn) / thing.area_m2;
            println!("{name}, cells of {level_cell_m} m, {}: {ratio:.2} of its pixels", thing.name);
            if level_cell_m >= CELLS_M[0] && (ratio - 1.0).abs() > MAX_ERROR {
                wrong.push((thing.name, level_cell_m, ratio));
            }
        }
        frames.push(vec![drawn]);
    }
    save_frames(&format!("thin-{name}"), &frames).unwrap();
    assert!(frames.len() > (CELLS_M[1] / cell_m).log2() as usize, "the city has too few levels");
    assert!(wrong.is_empty(), "{name}: drawn pixels, of those that are right: {wrong:?}");
}

fn thin_things_in_the_open() {
    check("open", 1.0, false);
}

fn thin_things_on_terrain() {
    check("terrain", 1.0, true);
}

fn thin_things_of_small_cells() {
    check("small", 0.25, false);
}
