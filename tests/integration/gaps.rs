//! Openings of bridges, arcades, roads and stacked slabs: one looks through them at every level that can show them.
//! `gap-NAME.png` in the folder `zoo` of the build shows the source and all levels from the leaves upwards.

use glam::DVec3;
use insula_shaders::cpu::raycast::Pixels;
use insula_tests::tests;
use insula_tests::trials::Trials;
use insula_tests::view::Camera;
use insula_tests::zoo::{BakedShape, FRAME, Shapes, save_frames};

pub(crate) fn add(trials: &mut Trials) {
    trials.add(tests![four_slabs_with_gaps_of_8_m, a_bridge, an_arcade, an_elevated_road]);
}

const CELL_M: f64 = 0.5;
/// Distance of the camera from the plane y = 0, and of what counts as behind the shapes.
const EYE_M: f64 = 60.0;
const BEHIND_M: f64 = 30.0;
/// Least share of the rays through the middle of an opening that a level lets through.
const LEAST_OPEN: f64 = 0.5;

/// An opening: one looks along y through the rectangles `[low, high]` of x and z in the plane y = 0.
struct Opening {
    camera: Camera,
    rectangles: Vec<[[f64; 2]; 2]>,
}

impl Opening {
    /// Rows of openings of the same height.
    fn new(rectangles: &[[[f64; 2]; 2]]) -> Self {
        let z = rectangles[0].iter().map(|corner| corner[1]).sum::<f64>() / 2.0;
        let (position, target) = (DVec3::new(0.3, -EYE_M, z), DVec3::new(0.0, 0.0, z));
        Self { camera: Camera { fov_y_deg: 35.0, ..Camera::looking(position, target) }, rectangles: rectangles.into() }
    }

    /// The pixels that look through the middle half of a rectangle.
    fn pixels(&self) -> Vec<usize> {
        let axes = self.camera.axes(&FRAME);
        let is_inside = |i: &usize| {
            let ray = axes.ray(&FRAME, *i as u32 % FRAME.width_px, *i as u32 / FRAME.width_px);
            let p = DVec3::from(self.camera.position) + ray * (-self.camera.position[1] / ray.y);
            self.rectangles.iter().any(|[low, high]| {
                [(p.x, 0), (p.z, 1)]
                    .iter()
                    .all(|(v, k)| (v - (low[*k] + high[*k]) / 2.0).abs() < (high[*k] - low[*k]) / 4.0)
            })
        };
        (0..(FRAME.width_px * FRAME.height_px) as usize).filter(is_inside).collect()
    }
}

/// Share of `pixels` that see nothing, or only what lies behind the shapes.
fn open_share(pixels: &[usize], drawn: &Pixels) -> f64 {
    let is_open = |i: &&usize| f64::from(drawn.distance[**i]) > EYE_M + BEHIND_M;
    pixels.iter().filter(is_open).count() as f64 / pixels.len() as f64
}

/// Shapes with small boxes far away, so that there are levels up to cells of 8 m.
fn far_apart() -> Shapes {
    let mut shapes = Shapes::default();
    shapes.cuboid([-150.0, -150.0, 0.0], [-148.0, -148.0, 2.0]).cuboid([250.0, 250.0, 0.0], [252.0, 252.0, 2.0]);
    shapes
}

fn bake(name: &str, shapes: &Shapes) -> BakedShape {
    BakedShape::bake(&format!("gap-{name}"), shapes.scene([0.0; 3]), CELL_M).unwrap()
}

/// Looks through the opening at each level whose cell is under twice `gap_m`.
fn check(name: &str, shape: &BakedShape, gap_m: f64, opening: &Opening) {
    let pixels = opening.pixels();
    let truth = shape.truth.render(&opening.camera, &FRAME);
    assert!(pixels.len() > 300 && open_share(&pixels, &truth) > 0.99, "{name}: the source is closed");
    let depth = shape.baked.manifest().depth;
    let (mut frames, mut report) = (vec![truth], Vec::new());
    for level in (0..=depth).rev() {
        let cell_m = CELL_M * f64::from(1 << (depth - level));
        let ids = shape.baked.ids(level);
        let drawn = shape.baked.draw_list(&ids).unwrap().scene(&opening.camera, &FRAME).render();
        report.push((cell_m, open_share(&pixels, &drawn)));
        frames.push(drawn);
    }
    save_frames(&format!("gap-{name}"), &[frames]).unwrap();
    println!("{name}: {report:?}");
    assert!(report.last().unwrap().0 >= gap_m, "{name}: the city has too few levels");
    let closed: Vec<_> = report.iter().filter(|(cell_m, open)| *cell_m < 2.0 * gap_m && *open < LEAST_OPEN).collect();
    assert!(closed.is_empty(), "{name}: a gap of {gap_m} m is closed: (cell, open share) = {closed:?} of {report:?}");
}

fn four_slabs_with_gaps_of_8_m() {
    let mut shapes = far_apart();
    shapes.level_ground(140.0);
    for floor in 0..4 {
        let z = 9.0 * f64::from(floor);
        shapes.cuboid([-20.0, -14.0, z], [20.0, 14.0, z + 1.0]);
    }
    let shape = bake("slabs", &shapes);
    for (name, floor) in [("slabs-low", 0), ("slabs-middle", 1), ("slabs-high", 2)] {
        let z = 9.0 * f64::from(floor) + 1.0;
        check(name, &shape, 8.0, &Opening::new(&[[[-16.0, z], [16.0, z + 8.0]]]));
    }
}

fn a_bridge() {
    for with_ground in [false, true] {
        let mut shapes = far_apart();
        if with_ground {
            shapes.level_ground(140.0);
        }
        shapes.cuboid([-25.0, -5.0, 6.0], [25.0, 5.0, 7.0]);
        shapes.cuboid([-25.0, -5.0, 0.0], [-23.0, 5.0, 6.0]).cuboid([23.0, -5.0, 0.0], [25.0, 5.0, 6.0]);
        let name = if with_ground { "bridge-ground" } else { "bridge" };
        check(name, &bake(name, &shapes), 6.0, &Opening::new(&[[[-15.0, 0.0], [15.0, 6.0]]]));
    }
}

fn an_arcade() {
    let mut shapes = far_apart();
    shapes.level_ground(140.0);
    shapes.cuboid([-19.0, -4.0, 4.0], [19.0, 4.0, 12.0]);
    let mut openings = Vec::new();
    for k in 0..8 {
        let x = -19.0 + 5.3 * f64::from(k);
        shapes.cuboid([x, -4.0, 0.0], [x + 0.9, -3.0, 4.0]).cuboid([x, 3.0, 0.0], [x + 0.9, 4.0, 4.0]);
        openings.push([[x + 0.9, 0.0], [x + 5.3, 4.0]]);
    }
    // Rays through the others are too oblique: the source's own pillars are in their way.
    check("arcade", &bake("arcade", &shapes), 4.0, &Opening::new(&openings[2..5]));
}

fn an_elevated_road() {
    for with_ground in [false, true] {
        let mut shapes = far_apart();
        if with_ground {
            shapes.level_ground(140.0);
        }
        shapes.cuboid([-100.0, -6.0, 7.0], [100.0, 6.0, 8.2]);
        for k in 0..10 {
            let x = -95.0 + 20.0 * f64::from(k);
            shapes.cuboid([x - 0.8, -1.0, 0.0], [x + 0.8, 1.0, 7.0]);
        }
        let name = if with_ground { "road-ground" } else { "road" };
        check(name, &bake(name, &shapes), 7.0, &Opening::new(&[[[-14.0, 0.0], [4.0, 7.0]], [[6.0, 0.0], [14.0, 7.0]]]));
    }
}
