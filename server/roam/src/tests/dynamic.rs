//! The mesh that follows a view.

use super::super::*;
use super::{Random, check, field, fractal};
use glam::Vec3;

fn hilly(size: [u32; 2], seed: u64, gaps: usize) -> HeightField {
    let mut random = Random(seed);
    let mut heights = fractal(size, 80.0, seed);
    for _ in 0..gaps {
        let i = random.below(heights.len());
        heights[i] = f32::NAN;
    }
    field(size, heights)
}

/// Views that move like a flight, and jump now and then.
fn views(count: usize, seed: u64) -> Vec<ScreenError> {
    let mut random = Random(seed);
    let mut eye_m = Vec3::new(30.0, 30.0, 60.0);
    let mut view = |i: usize| {
        let scale = if i % 7 == 6 { 200.0 } else { 6.0 };
        eye_m += scale * (Vec3::new(random.unit(), random.unit(), 0.0) - Vec3::new(0.5, 0.5, 0.0));
        ScreenError { eye_m, pixels_at_1_m: 900.0, near_m: 5.0 }
    };
    (0..count).map(&mut view).collect()
}

#[test]
fn random_splits_and_merges_keep_the_surface_closed() {
    for (seed, size, gaps) in [(1, [65, 65], 0), (2, [65, 33], 0), (3, [50, 41], 0), (4, [64, 64], 30)] {
        let field = hilly(size, seed, gaps);
        let bounds = ErrorBounds::new(&field, 64);
        let mut mesh = RoamMesh::new(&field, &bounds, 2.0);
        let mut random = Random(seed);
        for step in 0..3000 {
            let place = field.place(random.below(field.len()));
            // Runs of mostly splits and of mostly merges.
            let is_split = random.below(10) < if step % 600 < 300 { 6 } else { 1 };
            if is_split {
                mesh.split(place)
            } else {
                mesh.merge(place)
            };
            if step % 50 == 0 {
                let surface = mesh.mesh();
                check(&surface, &field);
                assert_eq!(surface.triangles.len(), mesh.triangle_count());
            }
        }
        // Whatever came before, a view has one mesh.
        for view in views(4, seed) {
            mesh.update(&view, 3.0, usize::MAX);
            let mut fresh = RoamMesh::new(&field, &bounds, 2.0);
            fresh.update(&view, 3.0, usize::MAX);
            assert_eq!(mesh.mesh(), fresh.mesh());
            check(&mesh.mesh(), &field);
        }
    }
}

#[test]
fn a_flight_gives_the_meshes_from_scratch() {
    for (seed, gaps) in [(5, 0), (6, 25)] {
        let field = hilly([129, 100], seed, gaps);
        let bounds = ErrorBounds::new(&field, 128);
        let mut mesh = RoamMesh::new(&field, &bounds, 1.0);
        let coarsest = mesh.triangle_count();
        let mut random = Random(seed);
        for view in views(40, seed) {
            let limit = coarsest + [0, 1, 57, 300, 5000, usize::MAX / 2][random.below(6)];
            let threshold = [0.0, 0.5, 4.0, 30.0][random.below(4)];
            mesh.update(&view, threshold, limit);
            let mut fresh = RoamMesh::new(&field, &bounds, 1.0);
            let changes = fresh.update(&view, threshold, limit);
            assert_eq!(changes.merges, 0);
            assert_eq!(mesh.mesh(), fresh.mesh());
            assert!(mesh.triangle_count() <= limit);
            assert_eq!(mesh.update(&view, threshold, limit), Changes::default());
            check(&mesh.mesh(), &field);
        }
    }
}

#[test]
fn a_small_move_changes_a_small_part() {
    let field = hilly([257, 257], 7, 0);
    let bounds = ErrorBounds::new(&field, 256);
    let mut mesh = RoamMesh::new(&field, &bounds, 1.0);
    let view = |x: f32| ScreenError { eye_m: Vec3::new(x, 100.0, 90.0), pixels_at_1_m: 600.0, near_m: 5.0 };
    let first = mesh.update(&view(100.0), 4.0, usize::MAX);
    let next = mesh.update(&view(101.0), 4.0, usize::MAX);
    assert!(first.splits > 1000 && next.splits + next.merges < first.splits / 5, "{first:?} {next:?}");
}

#[test]
fn the_threshold_holds_for_all_triangles() {
    let field = hilly([65, 65], 8, 0);
    let bounds = ErrorBounds::new(&field, 64);
    let mut mesh = RoamMesh::new(&field, &bounds, 1.0);
    // An equal priority everywhere gives the surface of the bounds.
    for error in [5.0, 0.2, 1.0] {
        mesh.update(&|node: &Node| node.error_m, error, usize::MAX);
        assert_eq!(mesh.mesh(), bounds.triangulate(&field, error));
        assert!(check(&mesh.mesh(), &field) <= f64::from(error));
    }
    // From above, no pixel is farther off than the threshold.
    let view = ScreenError { eye_m: Vec3::new(32.0, 32.0, 500.0), pixels_at_1_m: 1000.0, near_m: 1.0 };
    mesh.update(&view, 2.0, usize::MAX);
    assert!(check(&mesh.mesh(), &field) <= 2.0 * (500.0 + 64.0) / 1000.0);
}

#[test]
fn priorities_without_order_still_give_one_closed_surface() {
    let field = hilly([65, 50], 9, 10);
    let bounds = ErrorBounds::new(&field, 64);
    let mut mesh = RoamMesh::new(&field, &bounds, 1.0);
    for seed in 0..12_u32 {
        let hash = |node: &Node| {
            let bits =
                node.corners_m.iter().fold(seed, |h, c| (h ^ c.x.to_bits() ^ c.y.to_bits()).wrapping_mul(0x9E37_79B1));
            [f32::NAN, f32::INFINITY, -1.0, 0.0, 1.0, 2.0, 3.0, 4.0][(bits >> 29) as usize]
        };
        let limit = if seed % 3 == 0 { 600 } else { usize::MAX };
        mesh.update(&hash, 0.5, limit);
        let mut fresh = RoamMesh::new(&field, &bounds, 1.0);
        fresh.update(&hash, 0.5, limit);
        assert_eq!(mesh.mesh(), fresh.mesh());
        check(&mesh.mesh(), &field);
    }
}

#[test]
fn reach_and_error_of_a_diamond_contain_those_of_its_parts() {
    let field = hilly([65, 65], 10, 0);
    let bounds = ErrorBounds::new(&field, 64);
    let mesh = RoamMesh::new(&field, &bounds, 1.5);
    for index in 0..field.len() {
        let Some(node) = mesh.node(index) else { continue };
        for parent in mesh.parents(index).filter_map(|parent| mesh.node(parent)) {
            assert!(node.reach_m[0].cmpge(parent.reach_m[0]).all() && node.reach_m[1].cmple(parent.reach_m[1]).all());
            assert!(node.error_m <= parent.error_m);
        }
        let is_inside = |c: &Vec3| c.cmpge(node.reach_m[0]).all() && c.cmple(node.reach_m[1]).all();
        assert!(node.corners_m.iter().all(is_inside));
    }
}
