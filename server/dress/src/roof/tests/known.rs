//! Roofs whose form is known.

use super::*;
use insula_source::object::SurfaceRole;
use plans::{courtyard, cross, l_shape, placed, rectangle, regular, ring, t_shape};

/// Points of the roof at the top, without repetition, in order.
fn summits(surfaces: &[Surface], spec: &RoofSpec) -> Vec<[f64; 2]> {
    let mut found: Vec<[f64; 2]> = Vec::new();
    for point in surfaces.iter().flat_map(|surface| &surface.points).filter(|point| point[2] > spec.top_m - 1e-6) {
        if found.iter().all(|known| (known[0] - point[0]).hypot(known[1] - point[1]) > 1e-6) {
            found.push([point[0], point[1]]);
        }
    }
    found.sort_by(|a, b| (a[0] - b[0] + 1e-3 * (a[1] - b[1])).total_cmp(&0.0));
    found
}

fn assert_near(found: &[[f64; 2]], expected: &[[f64; 2]]) {
    let is_near = |(a, b): (&[f64; 2], &[f64; 2])| (a[0] - b[0]).hypot(a[1] - b[1]) < 1e-6;
    assert!(found.len() == expected.len() && found.iter().zip(expected).all(is_near), "{found:?}, not {expected:?}");
}

fn count(surfaces: &[Surface], role: SurfaceRole) -> usize {
    surfaces.iter().filter(|surface| surface.role == role).count()
}

/// Walls with more corners than a rectangle.
fn gables(surfaces: &[Surface]) -> usize {
    surfaces.iter().filter(|surface| surface.role == SurfaceRole::Wall && surface.points.len() > 4).count()
}

fn assert_volume(rings: &Rings, shape: RoofShape, expected_m3: f64) {
    let volume_m3 = build_checked(rings, &spec(shape)).1;
    assert!((volume_m3 - expected_m3).abs() < 1e-6 * expected_m3, "{shape:?}: {volume_m3}, not {expected_m3}");
}

#[test]
fn ridge_of_a_hipped_rectangle_is_its_length_less_its_width() {
    for (length, width) in [(14.0, 8.0), (30.0, 0.5), (8.001, 8.0)] {
        let (surfaces, _) = build_checked(&rectangle(length, width), &spec(RoofShape::Hipped));
        let half = width / 2.0;
        assert_near(&summits(&surfaces, &spec(RoofShape::Hipped)), &[[half, half], [length - half, half]]);
        assert_eq!((count(&surfaces, SurfaceRole::Roof), count(&surfaces, SurfaceRole::Wall)), (4, 4));
    }
}

#[test]
fn regular_polygons_have_one_summit() {
    for corners in (3..40).chain([64, 100]) {
        for shape in [RoofShape::Hipped, RoofShape::Mansard, RoofShape::Pyramidal, RoofShape::Dome, RoofShape::Onion] {
            for rings in [regular(corners, 10.0), placed(&regular(corners, 10.0), 0.123, [0.0, 0.0])] {
                let (surfaces, _) = build_checked(&rings, &spec(shape));
                assert_near(&summits(&surfaces, &spec(shape)), &[[0.0, 0.0]]);
            }
        }
    }
}

#[test]
fn volumes_over_a_rectangle_are_exact() {
    let (rings, walls_m3) = (rectangle(14.0, 8.0), 14.0 * 8.0 * 3.0);
    assert_volume(&rings, RoofShape::Flat, 14.0 * 8.0 * 7.0);
    let full_m3 = 14.0 * 8.0 * 4.0;
    assert_volume(&rings, RoofShape::Hipped, walls_m3 + 4.0 * 8.0 * (3.0 * 14.0 - 8.0) / 6.0);
    for shape in [RoofShape::Gabled, RoofShape::Skillion, RoofShape::Saltbox, RoofShape::Butterfly] {
        assert_volume(&rings, shape, walls_m3 + full_m3 / 2.0);
    }
    assert_volume(&rings, RoofShape::Pyramidal, walls_m3 + full_m3 / 3.0);
    let (run, rise) = GAMBREL_BREAK;
    assert_volume(&rings, RoofShape::Gambrel, walls_m3 + full_m3 * (run * rise + (1.0 - run) * (1.0 + rise)) / 2.0);
    // Each half-hip cuts a pyramid off the gable: its base is half as wide and half as high, and it is 2 m deep.
    assert_volume(&rings, RoofShape::HalfHipped, walls_m3 + full_m3 / 2.0 - 2.0 * (4.0 * 2.0 / 2.0) * 2.0 / 3.0);
    let steps = ROUND_STEPS as f64;
    let octagon = (std::f64::consts::FRAC_PI_2 / steps).sin() * steps / 2.0;
    assert_volume(&rings, RoofShape::Round, walls_m3 + full_m3 * octagon);
}

#[test]
fn skeletons_of_known_plans_are_exact() {
    let hipped = spec(RoofShape::Hipped);
    let (surfaces, _) = build_checked(&l_shape(), &hipped);
    assert_near(&summits(&surfaces, &hipped), &[[4.0, 4.0], [4.0, 14.0], [16.0, 4.0]]);
    assert_eq!(count(&surfaces, SurfaceRole::Roof), 6);

    let (surfaces, _) = build_checked(&cross(), &hipped);
    assert_near(&summits(&surfaces, &hipped), &[[-8.0, 0.0], [0.0, -8.0], [0.0, 0.0], [0.0, 8.0], [8.0, 0.0]]);

    let (surfaces, _) = build_checked(&courtyard(), &hipped);
    assert_near(&summits(&surfaces, &hipped), &[[3.0, 3.0], [3.0, 17.0], [21.0, 3.0], [21.0, 17.0]]);
    assert_eq!((count(&surfaces, SurfaceRole::Roof), count(&surfaces, SurfaceRole::Wall)), (8, 8));

    // Teeth narrower than the bar: the bar's ridge is highest.
    let (surfaces, _) = build_checked(&plans::comb(&[9.0, 4.0, 6.0, 4.0]), &hipped);
    assert_eq!(count(&surfaces, SurfaceRole::Roof), 16);
    // A reflex corner meets the opposite wall before any edge disappears.
    let notch =
        vec![ring(&[(0.0, 0.0), (20.0, 0.0), (20.0, 10.0), (11.0, 10.0), (10.0, 2.0), (9.0, 10.0), (0.0, 10.0)])];
    let (surfaces, _) = build_checked(&notch, &hipped);
    assert_eq!((count(&surfaces, SurfaceRole::Roof), summits(&surfaces, &hipped).len()), (7, 2));
}

#[test]
fn ridges_end_in_gables() {
    for (rings, ends) in [(l_shape(), 2), (t_shape(), 3), (cross(), 4), (courtyard(), 0), (rectangle(14.0, 8.0), 2)] {
        for rings in [rings.clone(), placed(&rings, 0.123, [431_234.567, 5_412_345.678])] {
            for shape in [RoofShape::Gabled, RoofShape::HalfHipped, RoofShape::Gambrel, RoofShape::Round] {
                let (surfaces, _) = build_checked(&rings, &spec(shape));
                assert_eq!(gables(&surfaces), ends, "{shape:?} over {rings:?}");
            }
        }
    }
}

#[test]
fn corners_on_straight_walls_make_no_ridges() {
    let rings =
        vec![ring(&[(0.0, 0.0), (9.0, -0.005), (14.0, 0.0), (14.0, 4.0), (14.004, 5.0), (14.0, 8.0), (0.0, 8.0)])];
    let (surfaces, _) = build_checked(&rings, &spec(RoofShape::Hipped));
    assert_eq!((count(&surfaces, SurfaceRole::Roof), count(&surfaces, SurfaceRole::Wall)), (4, 7));
    let mut rings = l_shape();
    rings[0].insert(2, [20.006, 5.0]);
    rings[0].insert(2, [19.995, 3.0]);
    for shape in [RoofShape::Gabled, RoofShape::HalfHipped] {
        let (surfaces, _) = build_checked(&rings, &spec(shape));
        let small = if shape == RoofShape::HalfHipped { 2 } else { 0 };
        assert_eq!(count(&surfaces, SurfaceRole::Roof), 4 + small, "{shape:?}");
    }
}

#[test]
fn slopes_face_their_direction() {
    let height_at = |surfaces: &[Surface], x: f64, y: f64| {
        let mut roof = surfaces.iter().filter(|surface| surface.role == SurfaceRole::Roof).flat_map(|s| &s.points);
        roof.find(|point| point[0] == x && point[1] == y).expect("a corner")[2]
    };
    let rings = rectangle(14.0, 8.0);
    for (direction_deg, corners) in [
        (0.0, [7.0, 7.0, 3.0, 3.0]),
        (90.0, [7.0, 3.0, 3.0, 7.0]),
        // Not quite south, as a point of the compass often is.
        (172.0, [3.0, 3.0, 7.0, 7.0]),
        (270.0, [3.0, 7.0, 7.0, 3.0]),
    ] {
        let spec = RoofSpec { direction_deg: Some(direction_deg), ..spec(RoofShape::Skillion) };
        let (surfaces, _) = build_checked(&rings, &spec);
        let found = [(0.0, 0.0), (14.0, 0.0), (14.0, 8.0), (0.0, 8.0)].map(|(x, y)| height_at(&surfaces, x, y));
        assert_eq!(found, corners, "{direction_deg}");
    }
    // The low side of a trapezoid is its longest.
    let rings = vec![ring(&[(0.0, 0.0), (14.0, 0.0), (10.0, 6.0), (4.0, 6.0)])];
    let (surfaces, _) = build_checked(&rings, &spec(RoofShape::Skillion));
    assert_eq!((height_at(&surfaces, 14.0, 0.0), height_at(&surfaces, 4.0, 6.0)), (3.0, 7.0));
}

#[test]
fn ridges_have_their_direction() {
    let rings = rectangle(14.0, 8.0);
    let gabled = |direction_deg, orientation| {
        let spec = RoofSpec { direction_deg, orientation, ..spec(RoofShape::Gabled) };
        summits(&build_checked(&rings, &spec).0, &spec)
    };
    let along = [[0.0, 4.0], [14.0, 4.0]];
    let across = [[7.0, 0.0], [7.0, 8.0]];
    assert_near(&gabled(None, None), &along);
    assert_near(&gabled(None, Some(RoofOrientation::Along)), &along);
    assert_near(&gabled(None, Some(RoofOrientation::Across)), &across);
    assert_near(&gabled(Some(180.0), Some(RoofOrientation::Across)), &along);
    assert_near(&gabled(Some(90.0), None), &across);
    assert_eq!(gabled(Some(45.0), None).len(), 2);
}

#[test]
fn roofs_down_to_the_floor_have_walls_only_where_they_need_them() {
    for (shape, walls) in
        [(RoofShape::Hipped, 0), (RoofShape::Gabled, 2), (RoofShape::Skillion, 3), (RoofShape::Dome, 0)]
    {
        let spec = RoofSpec { eaves_m: 0.0, ..spec(shape) };
        let (surfaces, _) = build_checked(&rectangle(14.0, 8.0), &spec);
        assert_eq!(count(&surfaces, SurfaceRole::Wall), walls, "{shape:?}");
    }
    // The valley of this one meets the floor within a wall, which is in two parts there.
    let spec = RoofSpec { eaves_m: 0.0, ..spec(RoofShape::Butterfly) };
    let (surfaces, _) = build_checked(&rectangle(14.0, 8.0), &spec);
    assert_eq!(count(&surfaces, SurfaceRole::Wall), 6);
}

#[test]
fn towers_need_a_centre_that_sees_all_walls() {
    let teeth = plans::comb(&[9.0, 9.0]);
    for shape in [RoofShape::Pyramidal, RoofShape::Cone, RoofShape::Dome, RoofShape::Onion] {
        assert_eq!(build_checked(&teeth, &spec(shape)).0, build_checked(&teeth, &spec(RoofShape::Hipped)).0);
        let surfaces = build_checked(&cross(), &spec(shape)).0;
        assert_near(&summits(&surfaces, &spec(shape)), &[[0.0, 0.0]]);
    }
    let widest = |shape| {
        let points = build_checked(&regular(12, 5.0), &spec(shape)).0.into_iter().flat_map(|surface| surface.points);
        points.map(|point| point[0].hypot(point[1])).fold(0.0, f64::max)
    };
    assert!((widest(RoofShape::Dome) - 5.0).abs() < 1e-9 && widest(RoofShape::Onion) > 6.0);
}

#[test]
fn large_plans_end() {
    let teeth: Vec<f64> = (0..120).map(|i| 3.0 + f64::from(i * 7 % 11)).collect();
    let (surfaces, _) = build_checked(&plans::comb(&teeth), &spec(RoofShape::Hipped));
    assert_eq!(count(&surfaces, SurfaceRole::Roof), 480);
    let circle = regular(2000, 500.0);
    assert_eq!(build(&circle, &spec(RoofShape::Dome)).map(|surfaces| surfaces.len()), Ok(2000 * 9 + 1));
    assert_eq!(build(&regular(2001, 500.0), &spec(RoofShape::Dome)), Err(RoofFault::TooManyCorners));
}
