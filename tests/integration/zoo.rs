//! One shape per test: baked, drawn, and compared with its ray-traced source. `NAME.png` in the folder `zoo` of the build shows the
//! source, the bake, and the bake with light. The origin is the corner of four nodes, so all shapes extend over node borders.

use glam::{DVec2, DVec3};
use insula_bake::scene::{ObjectKind, Scene};
use insula_shaders::layout::Shading;
use insula_tests::tests;
use insula_tests::trials::Trials;
use insula_tests::truth::Truth;
use insula_tests::view::Camera;
use insula_tests::zoo::{BakedShape, ShapeScore, Shapes, orbit_camera, paint, rectangle, turned};
use std::sync::OnceLock;

pub(crate) fn add(trials: &mut Trials) {
    trials.add(tests![
        a_box_of_roof_and_walls,
        boxes_turned_by_20_and_45_degrees,
        a_pitched_roof,
        overhanging_eaves,
        a_dome,
        a_spire,
        a_bridge_and_its_underside,
        an_arcade,
        balconies,
        a_courtyard,
        a_tunnel,
        undersides_around_a_stem,
        a_gap_and_holes_between_floors,
        thin_walls_straight_and_slanted,
        a_wall_with_a_see_through_window,
        a_fence_of_posts_and_rails,
        water_and_a_quay,
        trees,
        a_closed_shell_has_no_inside,
        a_shell_without_one_wall,
        small_holes_in_a_roof_are_repaired,
        a_tower_beside_a_podium,
        a_very_tall_box,
        a_very_small_box,
        position_below_the_sea_or_far_from_the_origin_changes_nothing,
        occlusion_is_continuous_over_node_borders,
        a_tower_darkens_the_roof_beyond_a_block_border,
        no_seams_between_nodes_or_levels,
        flat_land_takes_few_bytes_and_an_empty_scene_is_an_error
    ]);
}

const CELL_M: f64 = 0.5;

/// From above, and from near the ground.
fn two_views(target: [f64; 3], distance_m: f64) -> Vec<Camera> {
    vec![orbit_camera(target, distance_m, -60.0, 35.0), orbit_camera(target, distance_m, 200.0, 8.0)]
}

fn score(name: &str, shapes: &Shapes, cameras: &[Camera]) -> ShapeScore {
    let score = BakedShape::bake(name, shapes.scene([0.0; 3]), CELL_M).unwrap().score(cameras).unwrap();
    println!("{name}: {score:?}");
    score
}

/// A house with a pitched roof whose ridge runs along x. The roof extends `eaves_m` beyond the walls.
fn house(shapes: &mut Shapes, eaves_m: f64) {
    let at = |x: f64, y: f64, z: f64| DVec3::new(x, y, z);
    let (x, y, e) = (6.0, 4.0, eaves_m);
    let low = rectangle([-x, -y], [x, y]);
    let ring = |z: f64| low.iter().map(|p| p.extend(z)).collect::<Vec<_>>();
    shapes.walls(&ring(0.0), &ring(5.0));
    for side in [-1.0, 1.0] {
        let mut gable = [at(side * x, -side * y, 5.0), at(side * x, side * y, 5.0), at(side * x, 0.0, 9.0)];
        gable.rotate_left(1);
        shapes.face(&gable, paint::WALL);
        // The eaves are in the plane of the slope: one metre out, one metre down.
        let (edge, edge_z) = (side * (y + e), 5.0 - e);
        let slope = [at(-side * (x + e), edge, edge_z), at(side * (x + e), edge, edge_z)].map(|p| p.with_x(-p.x));
        let ridge = [at(-side * (x + e), 0.0, 9.0), at(side * (x + e), 0.0, 9.0)];
        shapes.face(&[slope[0], ridge[1], ridge[0], slope[1]], paint::ROOF);
        let down = |p: DVec3| p - DVec3::Z * 0.3;
        shapes.face(&[slope[1], ridge[0], ridge[1], slope[0]].map(down), paint::UNDER);
    }
    shapes.face(&ring(0.0).into_iter().rev().collect::<Vec<_>>(), paint::UNDER);
}

fn a_box_of_roof_and_walls() {
    let mut shapes = Shapes::default();
    shapes.cuboid([-5.0, -4.0, 0.0], [5.0, 4.0, 12.0]);
    score("box", &shapes, &two_views([0.0, 0.0, 6.0], 28.0)).ensure_at_least(0.98, 0.99, 0.97).unwrap();
}

fn boxes_turned_by_20_and_45_degrees() {
    for degrees in [20.0, 45.0] {
        let mut shapes = Shapes::default();
        shapes.prism(&turned(&rectangle([-5.0, -4.0], [5.0, 4.0]), degrees), [0.0, 12.0]);
        score(&format!("turned-{degrees}"), &shapes, &two_views([0.0, 0.0, 6.0], 28.0))
            .ensure_at_least(0.97, 0.98, 0.95)
            .unwrap();
    }
}

fn a_pitched_roof() {
    let mut shapes = Shapes::default();
    house(&mut shapes, 0.0);
    score("pitched-roof", &shapes, &two_views([0.0, 0.0, 4.0], 24.0)).ensure_at_least(0.99, 0.99, 0.98).unwrap();
}

fn overhanging_eaves() {
    let mut shapes = Shapes::default();
    house(&mut shapes, 1.0);
    let cameras =
        [orbit_camera([0.0, 0.0, 4.0], 24.0, -60.0, 35.0), orbit_camera([0.0, -4.0, 3.5], 12.0, -70.0, -10.0)];
    // Thin surfaces 30 cm apart, which is less than a cell, mix their colours.
    score("eaves", &shapes, &cameras).ensure_at_least(0.97, 0.97, 0.8).unwrap();
}

fn a_dome() {
    let mut shapes = Shapes::default();
    let rings: Vec<[f64; 2]> =
        (0..=8).map(|k| f64::from(k) / 8.0 * 1.5).map(|a| [7.0 * a.cos(), 5.0 + 7.0 * a.sin()]).collect();
    shapes.turned(DVec2::ZERO, &[[7.0, 0.0], [7.0, 5.0]], paint::WALL).turned(DVec2::ZERO, &rings, paint::ROOF);
    score("dome", &shapes, &two_views([0.0, 0.0, 6.0], 28.0)).ensure_at_least(0.97, 0.97, 0.9).unwrap();
}

fn a_spire() {
    let mut shapes = Shapes::default();
    shapes.cuboid([-2.5, -2.5, 0.0], [2.5, 2.5, 10.0]).turned(DVec2::ZERO, &[[2.5, 10.0], [0.05, 28.0]], paint::ROOF);
    score("spire", &shapes, &two_views([0.0, 0.0, 14.0], 36.0)).ensure_at_least(0.93, 0.95, 0.9).unwrap();
}

fn a_bridge_and_its_underside() {
    let mut shapes = Shapes::default();
    shapes.cuboid([-15.0, -3.0, 6.0], [15.0, 3.0, 7.0]);
    shapes.cuboid([-15.0, -3.0, 0.0], [-13.0, 3.0, 6.0]).cuboid([13.0, -3.0, 0.0], [15.0, 3.0, 6.0]);
    let cameras = [orbit_camera([0.0, 0.0, 4.0], 34.0, -60.0, 30.0), orbit_camera([0.0, 0.0, 5.0], 20.0, -75.0, -8.0)];
    // An underside has the colour of the roof: a column has one texel for both.
    score("bridge", &shapes, &cameras).ensure_at_least(0.98, 0.98, 0.94).unwrap();
}

fn an_arcade() {
    let mut shapes = Shapes::default();
    shapes.cuboid([-10.0, -4.0, 4.0], [10.0, 4.0, 12.0]);
    for k in 0..6 {
        let x = -10.0 + 3.8 * f64::from(k);
        shapes.cuboid([x, -4.0, 0.0], [x + 1.0, -3.0, 4.0]).cuboid([x, 3.0, 0.0], [x + 1.0, 4.0, 4.0]);
    }
    let cameras = [orbit_camera([0.0, 0.0, 5.0], 30.0, -60.0, 30.0), orbit_camera([0.0, 0.0, 3.0], 22.0, -80.0, 2.0)];
    score("arcade", &shapes, &cameras).ensure_at_least(0.96, 0.95, 0.9).unwrap();
}

fn balconies() {
    let mut shapes = Shapes::default();
    shapes.cuboid([-6.0, 0.0, 0.0], [6.0, 8.0, 15.0]);
    for floor in 1..5 {
        let z = 3.0 * f64::from(floor);
        shapes.cuboid([-4.0, -1.5, z], [4.0, 0.0, z + 0.3]);
    }
    let cameras = [orbit_camera([0.0, 0.0, 8.0], 26.0, -60.0, 25.0), orbit_camera([0.0, 0.0, 8.0], 22.0, -40.0, -12.0)];
    score("balconies", &shapes, &cameras).ensure_at_least(0.96, 0.93, 0.85).unwrap();
}

fn a_courtyard() {
    let mut shapes = Shapes::default();
    shapes.cuboid([-10.0, -10.0, 0.0], [10.0, -6.0, 9.0]).cuboid([-10.0, 6.0, 0.0], [10.0, 10.0, 9.0]);
    shapes.cuboid([-10.0, -6.0, 0.0], [-6.0, 6.0, 9.0]).cuboid([6.0, -6.0, 0.0], [10.0, 6.0, 9.0]);
    let cameras = [orbit_camera([0.0, 0.0, 4.0], 34.0, -60.0, 50.0), orbit_camera([0.0, 0.0, 4.0], 34.0, 200.0, 25.0)];
    score("courtyard", &shapes, &cameras).ensure_at_least(0.98, 0.97, 0.95).unwrap();
}

fn a_tunnel() {
    let mut shapes = Shapes::default();
    shapes.cuboid([-10.0, -5.0, 0.0], [-2.0, 5.0, 9.0]).cuboid([2.0, -5.0, 0.0], [10.0, 5.0, 9.0]);
    shapes.cuboid([-2.0, -5.0, 4.0], [2.0, 5.0, 9.0]);
    let cameras = [orbit_camera([0.0, 0.0, 4.0], 30.0, -70.0, 25.0), orbit_camera([0.0, 0.0, 3.0], 22.0, -88.0, 3.0)];
    score("tunnel", &shapes, &cameras).ensure_at_least(0.97, 0.96, 0.93).unwrap();
}

fn undersides_around_a_stem() {
    let mut shapes = Shapes::default();
    shapes.cuboid([-1.0, -1.0, 0.0], [1.0, 1.0, 8.0]).cuboid([-6.0, -6.0, 8.0], [6.0, 6.0, 9.0]);
    let cameras = [orbit_camera([0.0, 0.0, 6.0], 26.0, -60.0, 25.0), orbit_camera([0.0, 0.0, 7.0], 18.0, 200.0, -15.0)];
    // The blue underside is drawn red: a column has one texel for its roof and its underside.
    score("undersides", &shapes, &cameras).ensure_at_least(0.98, 0.98, 0.9).unwrap();
}

fn a_gap_and_holes_between_floors() {
    let mut shapes = Shapes::default();
    for floor in 0..4 {
        let z = 4.0 * f64::from(floor);
        shapes.cuboid([-6.0, -5.0, z], [6.0, 5.0, z + 1.0]);
    }
    shapes.cuboid([-1.0, -1.0, 0.0], [1.0, 1.0, 13.0]);
    let cameras = [orbit_camera([0.0, 0.0, 7.0], 28.0, -60.0, 20.0), orbit_camera([0.0, 0.0, 7.0], 28.0, 200.0, 3.0)];
    score("floors", &shapes, &cameras).ensure_at_least(0.93, 0.9, 0.85).unwrap();
}

fn thin_walls_straight_and_slanted() {
    let mut shapes = Shapes::default();
    shapes.cuboid([-8.0, -6.1, 0.0], [8.0, -5.9, 3.0]);
    shapes.prism(&turned(&rectangle([-8.0, -0.1], [8.0, 0.1]), 30.0), [0.0, 3.0]);
    score("thin-walls", &shapes, &two_views([0.0, -2.0, 1.0], 24.0)).ensure_at_least(0.9, 0.95, 0.9).unwrap();
}

fn a_wall_with_a_see_through_window() {
    let mut shapes = Shapes::default();
    shapes.cuboid([-6.0, -0.4, 0.0], [-1.5, 0.4, 6.0]).cuboid([1.5, -0.4, 0.0], [6.0, 0.4, 6.0]);
    shapes.cuboid([-1.5, -0.4, 0.0], [1.5, 0.4, 2.0]).cuboid([-1.5, -0.4, 4.0], [1.5, 0.4, 6.0]);
    let cameras = [orbit_camera([0.0, 0.0, 3.0], 16.0, -75.0, 8.0), orbit_camera([0.0, 0.0, 3.0], 16.0, 60.0, 25.0)];
    score("window", &shapes, &cameras).ensure_at_least(0.95, 0.96, 0.93).unwrap();
}

fn a_fence_of_posts_and_rails() {
    let mut shapes = Shapes::default();
    for k in 0..12 {
        let x = -6.0 + f64::from(k);
        shapes.cuboid([x - 0.06, -0.06, 0.0], [x + 0.06, 0.06, 1.5]);
    }
    shapes.cuboid([-6.0, -0.05, 0.6], [5.0, 0.05, 0.75]).cuboid([-6.0, -0.05, 1.2], [5.0, 0.05, 1.35]);
    let cameras = [orbit_camera([0.0, 0.0, 0.7], 10.0, -80.0, 10.0)];
    let mut shape = BakedShape::bake("fence", shapes.scene([0.0; 3]), CELL_M).unwrap();
    // Posts and rails are much thinner than a cell. As many rays hit their columns as they cover of the wall that encloses them: 0.3.
    let mut wall = Shapes::default();
    wall.cuboid([-6.06, -0.06, 0.0], [5.06, 0.06, 1.5]);
    let source = std::mem::replace(&mut shape.truth, Truth::new(wall.scene([0.0; 3])));
    let enclosing = shape.score(&cameras).unwrap();
    shape.truth = source;
    let fence = shape.score(&cameras).unwrap();
    println!("fence: {fence:?}, enclosing wall: {enclosing:?}");
    fence.ensure_at_least(0.18, 0.99, 0.88).unwrap();
    enclosing.ensure_at_least(0.24, 0.99, 0.88).unwrap();
    assert!(enclosing.iou < 0.4, "the fence has swollen");
}

fn water_and_a_quay() {
    let mut shapes = Shapes::default();
    let flat =
        |low: [f64; 2], high: [f64; 2], z: f64| rectangle(low, high).iter().map(|p| p.extend(z)).collect::<Vec<_>>();
    shapes.object(ObjectKind::Terrain).face(&flat([-12.0, -12.0], [12.0, 0.0], 0.0), paint::BLUE);
    shapes.object(ObjectKind::Terrain).face(&flat([-12.0, 0.0], [12.0, 12.0], 1.5), paint::GROUND);
    shapes.object(ObjectKind::Building).cuboid([-4.0, 4.0, 1.5], [4.0, 9.0, 7.0]);
    let cameras = [orbit_camera([0.0, 0.0, 1.0], 28.0, -60.0, 40.0), orbit_camera([0.0, 0.0, 1.0], 28.0, 20.0, 25.0)];
    score("water", &shapes, &cameras).ensure_at_least(0.95, 0.97, 0.95).unwrap();
}

fn trees() {
    let mut shapes = Shapes::default();
    for (x, scale) in [(-5.0, 1.0), (5.0, 1.4)] {
        let crown: Vec<[f64; 2]> = (1..12)
            .map(|k| f64::from(k) / 12.0 * std::f64::consts::PI)
            .map(|a| [2.5 * scale * a.sin(), (4.5 - 2.5 * a.cos()) * scale])
            .collect();
        shapes.turned(DVec2::new(x, 0.0), &[[0.25, 0.0], [0.25, 3.0 * scale]], paint::WALL);
        shapes.turned(DVec2::new(x, 0.0), &crown, paint::GREEN);
    }
    // A trunk of half a metre is drawn one cell wider.
    score("trees", &shapes, &two_views([0.0, 0.0, 4.0], 24.0)).ensure_at_least(0.9, 0.97, 0.95).unwrap();
}

fn a_closed_shell_has_no_inside() {
    let mut shapes = Shapes::default();
    shapes.cuboid([-8.0, -8.0, 0.0], [8.0, 8.0, 10.0]).cuboid([-6.0, -6.0, 2.0], [6.0, 6.0, 6.0]);
    let shape = BakedShape::bake("shell-closed", shapes.scene([0.0; 3]), CELL_M).unwrap();
    shape.score(&two_views([0.0, 0.0, 5.0], 32.0)).unwrap().ensure_at_least(0.98, 0.99, 0.97).unwrap();
    // Only the edge has walls: of 32 x 32 columns, 124. Where it lies on cell borders, one more ring may count.
    let exposed: usize = shape
        .leaves()
        .unwrap()
        .iter()
        .map(|map| map.columns().iter().flatten().filter(|c| c.strip.is_some()).count())
        .sum();
    assert!((100..=260).contains(&exposed), "{exposed} columns show their sides");
}

fn a_shell_without_one_wall() {
    // Walls on cell borders, then inside cells.
    let score = [0.0, 0.17].map(|shift| {
        let mut shapes = Shapes::default();
        let outline = rectangle([shift - 6.0, shift - 5.0], [shift + 6.0, shift + 5.0]);
        let ring = |z: f64| outline.iter().map(|p| p.extend(z)).collect::<Vec<_>>();
        let (low, high) = (ring(0.0), ring(8.0));
        shapes.face(&high, paint::ROOF);
        for i in 0..3 {
            shapes.face(&[low[i + 1], low[(i + 2) % 4], high[(i + 2) % 4], high[i + 1]], paint::WALL);
        }
        // Seen from the closed sides: the open side may be drawn closed or open.
        let cameras =
            [orbit_camera([0.0, 0.0, 4.0], 24.0, 60.0, 35.0), orbit_camera([0.0, 0.0, 4.0], 24.0, 120.0, 8.0)];
        score(&format!("shell-open-{shift}"), &shapes, &cameras)
    });
    score.into_iter().for_each(|score| score.ensure_at_least(0.97, 0.97, 0.95).unwrap());
}

fn small_holes_in_a_roof_are_repaired() {
    let mut shapes = Shapes::default();
    let at = |x: f64, y: f64| DVec3::new(x, y, 8.0);
    let ring = |z: f64| rectangle([-6.0, -5.0], [6.0, 5.0]).iter().map(|p| p.extend(z)).collect::<Vec<_>>();
    shapes.walls(&ring(0.0), &ring(8.0)).face(&ring(0.0).into_iter().rev().collect::<Vec<_>>(), paint::UNDER);
    // A slit of 10 cm across the roof.
    shapes.face(&[at(-6.0, -5.0), at(0.0, -5.0), at(0.0, 5.0), at(-6.0, 5.0)], paint::ROOF);
    shapes.face(&[at(0.1, -5.0), at(6.0, -5.0), at(6.0, 5.0), at(0.1, 5.0)], paint::ROOF);
    let mut shape = BakedShape::bake("hole", shapes.scene([0.0; 3]), CELL_M).unwrap();
    let camera = orbit_camera([0.0, 0.0, 8.0], 20.0, -60.0, 80.0);
    shape.score(&[camera]).unwrap().ensure_at_least(0.97, 0.97, 0.95).unwrap();
    // As if the slit were not there.
    let mut whole = Shapes::default();
    whole.cuboid([-6.0, -5.0, 0.0], [6.0, 5.0, 8.0]);
    shape.truth = Truth::new(whole.scene([0.0; 3]));
    let repaired = shape.score(&[camera]).unwrap();
    println!("hole, repaired: {repaired:?}");
    repaired.ensure_at_least(0.99, 0.99, 0.98).unwrap();
}

fn a_tower_beside_a_podium() {
    let mut shapes = Shapes::default();
    shapes.cuboid([-3.0, -3.0, 0.0], [3.0, 3.0, 40.0]).cuboid([3.0, -6.0, 0.0], [15.0, 6.0, 4.0]);
    score("tower", &shapes, &two_views([3.0, 0.0, 16.0], 56.0)).ensure_at_least(0.97, 0.98, 0.95).unwrap();
}

fn a_very_tall_box() {
    let mut shapes = Shapes::default();
    shapes.cuboid([-12.0, -12.0, 0.0], [12.0, 12.0, 700.0]).cuboid([12.0, -12.0, 0.0], [24.0, 12.0, 9.3]);
    let shape = BakedShape::bake("tall", shapes.scene([0.0; 3]), CELL_M).unwrap();
    assert!(shape.leaves().unwrap().iter().any(|map| map.z_shift > 0), "heights would have fitted anyway");
    let cameras =
        [orbit_camera([0.0, 0.0, 350.0], 800.0, -60.0, 20.0), orbit_camera([10.0, 0.0, 6.0], 40.0, -60.0, 20.0)];
    let score = shape.score(&cameras).unwrap();
    println!("tall: {score:?}");
    score.ensure_at_least(0.96, 0.97, 0.95).unwrap();
}

fn a_very_small_box() {
    let mut shapes = Shapes::default();
    shapes.cuboid([0.1, 0.1, 0.0], [0.9, 0.8, 0.7]);
    score("small", &shapes, &two_views([0.5, 0.5, 0.3], 2.4)).ensure_at_least(0.6, 0.9, 0.8).unwrap();
}

fn position_below_the_sea_or_far_from_the_origin_changes_nothing() {
    let mut shapes = Shapes::default();
    shapes.prism(&turned(&rectangle([-5.0, -4.0], [5.0, 4.0]), 20.0), [-31.3, -19.3]);
    let moved = |origin: [f64; 3]| {
        let name = format!("at-{}", origin[0]);
        let [x, y, z] = origin;
        let shape = BakedShape::bake(&name, shapes.scene(origin), CELL_M).unwrap();
        let score = shape.score(&two_views([x, y, z - 25.3], 28.0)).unwrap();
        println!("{name}: {score:?}");
        score.ensure_at_least(0.97, 0.98, 0.95).unwrap();
        score
    };
    // Both origins lie on the world grid of leaves, so the cells are the same.
    let (home, far) = (moved([0.0; 3]), moved([1_024_000.0, -6_400_000.0, 128.0]));
    assert!((home.iou - far.iou).abs() < 0.003 && (home.near - far.near).abs() < 0.003, "{home:?} {far:?}");
}

/// A hall over many nodes with a tower, whose occlusion extends over node borders.
fn hall() -> &'static BakedShape {
    static HALL: OnceLock<BakedShape> = OnceLock::new();
    HALL.get_or_init(|| {
        let mut shapes = Shapes::default();
        shapes.cuboid([-70.0, -70.0, 0.0], [70.0, 70.0, 6.0]).cuboid([-6.0, -6.0, 6.0], [-2.0, 6.0, 26.0]);
        BakedShape::bake("borders", shapes.scene([0.0; 3]), CELL_M).unwrap()
    })
}

fn occlusion_is_continuous_over_node_borders() {
    let shape = hall();
    let maps = shape.leaves().unwrap();
    let n = insula_protocol::NODE_CELLS;
    let (mut inside, mut across) = (Vec::new(), Vec::new());
    for map in &maps {
        let Some(east) = maps.iter().find(|o| o.id.x() == map.id.x() + 1 && o.id.y() == map.id.y()) else { continue };
        for row in 0..n {
            // Only the hall's roof: the tower and the edges are steps.
            let roof = |m: &insula_protocol::BlockMap, x: usize| {
                let i = row * n + x;
                (m.z_max[i] != 0).then(|| (m.z_max[i], f64::from(m.roof[i].ao())))
            };
            let step = |a: Option<(u16, f64)>, b: Option<(u16, f64)>| match (a, b) {
                (Some((za, a)), Some((zb, b))) if za == zb => Some((a - b).abs()),
                _ => None,
            };
            across.extend(step(roof(map, n - 1), roof(east, 0)));
            inside.extend((n - 9..n - 1).filter_map(|x| step(roof(map, x), roof(map, x + 1))));
        }
    }
    let mean = |v: &[f64]| v.iter().sum::<f64>() / v.len() as f64;
    let (across_mean, inside_mean) = (mean(&across), mean(&inside));
    println!(
        "occlusion's steps: {across_mean:.3} over borders ({}), {inside_mean:.3} inside ({})",
        across.len(),
        inside.len()
    );
    assert!(across.len() > 200 && inside.len() > 1600);
    // Each tile is coded with loss on its own; half a step of 63 is invisible.
    assert!(across_mean <= 1.3 * inside_mean + 0.5, "{across_mean} over borders, {inside_mean} inside, of 63");
}

fn a_tower_darkens_the_roof_beyond_a_block_border() {
    // Blocks are squares of 2 x 2 leaves. What is east of the border knows the tower only by the margin around its block.
    let mut shapes = Shapes::default();
    shapes.cuboid([-70.0, -70.0, 0.0], [70.0, 70.0, 6.0]).cuboid([26.0, -6.0, 6.0], [30.0, 6.0, 26.0]);
    let shape = BakedShape::bake("block-border", shapes.scene([0.0; 3]), CELL_M).unwrap();
    let (manifest, maps) = (shape.baked.manifest(), shape.leaves().unwrap());
    let n = insula_protocol::NODE_CELLS;
    let leaf_m = n as f64 * CELL_M;
    let border = ((32.0 - manifest.origin[0]) / leaf_m) as u32;
    let first_row = ((0.0 - manifest.origin[1]) / leaf_m) as u32;
    assert!(border.is_multiple_of(2) && manifest.origin[0] + f64::from(border) * leaf_m == 32.0, "no border of blocks");
    let leaf = |x: u32| maps.iter().find(|map| (map.id.x(), map.id.y()) == (x, first_row)).unwrap();
    let (west, east) = (leaf(border - 1), leaf(border));
    let ao = |map: &insula_protocol::BlockMap, x: usize, y: usize| f64::from(map.roof[y * n + x].ao());
    // Rows beside the tower, whose northern half is 6 m long.
    let mean = |of: &dyn Fn(usize) -> f64| (0..10).map(of).sum::<f64>() / 10.0;
    let step = mean(&|y| (ao(west, n - 1, y) - ao(east, 0, y)).abs());
    let shade = mean(&|y| ao(east, n - 1, y) - ao(east, 0, y));
    println!("{step:.2} of 63 over the border, {shade:.2} darker than far away");
    assert!(shade > 3.0, "the tower's shade ends at the border");
    // Occlusion is coded with loss, tile by tile. Without a margin, the step is 26.
    assert!(step < 6.0, "a step at the border");
}

fn no_seams_between_nodes_or_levels() {
    let shape = hall();
    let camera = orbit_camera([20.0, 20.0, 6.0], 110.0, -60.0, 50.0);
    for tau_px in [0.01, 2.0, 6.0] {
        let ids = shape.baked.select(&camera, &insula_tests::zoo::FRAME, tau_px);
        let levels: std::collections::BTreeSet<u8> = ids.iter().map(|id| id.level()).collect();
        let reference = shape.truth.render(&camera, &insula_tests::zoo::FRAME);
        let colours = shape.draw(&camera, tau_px, Shading::Albedo).unwrap();
        let light = shape.draw(&camera, tau_px, Shading::Ao).unwrap();
        let width = reference.width_px as usize;
        let roof = u32::from_le_bytes([paint::ROOF[0], paint::ROOF[1], paint::ROOF[2], 255]);
        let (mut count, mut wrong, mut dark) = (0, 0, 0);
        for i in 4 * width..reference.colour.len() - 4 * width {
            // Well inside the roof, far from the tower.
            let orbit_camera = [0, 4, 4 * width].into_iter().flat_map(|step| [i - step, i + step]);
            let far = (reference.distance[i] - 110.0).abs() < 40.0;
            if far && orbit_camera.into_iter().all(|k| reference.colour[k] == roof) {
                count += 1;
                wrong += usize::from(colours.colour[i] != roof);
                dark += usize::from(light.colour[i].to_le_bytes()[0] < 150);
            }
        }
        println!("tau {tau_px}: levels {levels:?}, {count} pixels, {wrong} of another colour, {dark} dark");
        assert!(count > 5000 && wrong == 0 && dark * 50 < count, "tau {tau_px}: {wrong} wrong, {dark} dark of {count}");
    }
    assert!(shape.score(&[camera]).unwrap().iou > 0.98);
}

fn flat_land_takes_few_bytes_and_an_empty_scene_is_an_error() {
    let mut shapes = Shapes::default();
    let flat: Vec<DVec3> = rectangle([-64.0, -64.0], [64.0, 64.0]).iter().map(|p| p.extend(0.0)).collect();
    shapes.object(ObjectKind::Terrain).face(&flat, paint::GROUND);
    let shape = BakedShape::bake("flat", shapes.scene([0.0; 3]), CELL_M).unwrap();
    let levels = shape.baked.levels();
    let (finest, (nodes, bytes)) = levels.into_iter().next_back().unwrap();
    println!("flat: {nodes} nodes at level {finest}, {} bytes each", bytes / nodes);
    assert!(finest < shape.baked.manifest().depth, "plain land has no leaves");
    assert!(nodes <= 9 && bytes / nodes < 100, "{nodes} nodes of {} bytes", bytes / nodes);
    shape.score(&two_views([0.0; 3], 60.0)).unwrap().ensure_at_least(0.97, 0.98, 0.98).unwrap();
    assert!(BakedShape::bake("nothing", Scene::default(), CELL_M).is_err());
}
