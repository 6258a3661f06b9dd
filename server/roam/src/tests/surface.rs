//! Surfaces for one largest error.

use super::super::bounds::ErrorBounds;
use super::super::*;
use super::{Random, bounded, check, field, fractal};

#[test]
fn every_sample_is_within_the_error() {
    for (seed, size) in [(1, [65, 65]), (2, [129, 129]), (3, [100, 70]), (4, [3, 5]), (5, [2, 2]), (6, [2, 300])] {
        let field = field(size, fractal(size, 60.0, seed));
        let bounds = ErrorBounds::new(&field, 128);
        let mut count = usize::MAX;
        for error in [0.0, 0.05, 0.3, 1.0, 4.0, 1000.0] {
            let mesh = triangulate(&field, error);
            assert!(check(&mesh, &field) <= f64::from(error) + 1e-9, "{size:?} {error}");
            assert!(mesh.triangles.len() <= count);
            count = mesh.triangles.len();
            let nested = bounded(&field, &bounds, error);
            assert!(check(&nested, &field) <= f64::from(error) + 1e-9, "{size:?} {error}");
        }
    }
}

#[test]
fn bounds_are_upper_bounds_and_nested() {
    let size = [97, 65];
    let field = field(size, fractal(size, 100.0, 7));
    let bounds = ErrorBounds::new(&field, 64);
    let limits: Vec<f32> = (0..field.len()).map(|i| bounds.error_m(i)).filter(|e| e.is_finite() && *e > 0.0).collect();
    for k in (0..limits.len()).step_by(limits.len() / 20) {
        // Just at a bound, its diamond is not halved.
        let mesh = bounded(&field, &bounds, limits[k]);
        assert!(check(&mesh, &field) <= f64::from(limits[k]));
    }
}

#[test]
fn flat_and_sloping_ground_has_two_triangles_a_tile() {
    for slope in [0.0, 0.25] {
        let heights = (0..1025 * 1025).map(|i| (i % 1025) as f32 * slope).collect();
        assert_eq!(triangulate(&field([1025, 1025], heights), 0.01).triangles.len(), 2);
    }
    let mesh = triangulate(&field([2049, 1025], vec![3.0; 2049 * 1025]), 0.01);
    assert_eq!((mesh.vertices.len(), mesh.triangles.len()), (6, 4));
}

#[test]
fn odd_sizes_end_at_the_field() {
    for size in [[1025, 700], [1026, 1030]] {
        let flat = field(size, vec![1.0; (size[0] * size[1]) as usize]);
        let mesh = triangulate(&flat, 0.1);
        assert_eq!(check(&mesh, &flat), 0.0);
        assert!(mesh.triangles.len() < 30_000, "{}", mesh.triangles.len());
    }
    let size = [1025, 700];
    let rough = field(size, fractal(size, 200.0, 8));
    assert!(check(&triangulate(&rough, 2.0), &rough) <= 2.0 + 1e-9);
    for size in [[1, 1], [1, 9], [9, 1], [0, 0], [0, 5]] {
        let thin = field(size, vec![1.0; (size[0] * size[1]) as usize]);
        assert_eq!(triangulate(&thin, 0.1), TerrainMesh::default());
    }
}

#[test]
fn places_without_data_are_holes() {
    let mut random = Random(9);
    for (size, gaps) in [([65, 65], 1), ([65, 65], 40), ([90, 50], 2000), ([40, 40], 1600), ([17, 33], 200)] {
        let mut heights = fractal(size, 30.0, 10);
        for _ in 0..gaps {
            let i = random.below(heights.len());
            heights[i] = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY][i % 3];
        }
        let field = field(size, heights);
        for error in [0.0, 0.5, 100.0] {
            let mesh = triangulate(&field, error);
            assert!(check(&mesh, &field) <= f64::from(error) + 1e-9);
            check(&bounded(&field, &ErrorBounds::new(&field, 64), error), &field);
        }
    }
    let nothing = field([70, 70], vec![f32::NAN; 4900]);
    assert_eq!(triangulate(&nothing, 1.0), TerrainMesh::default());
}

#[test]
fn a_large_hole_is_coarse_inside() {
    let heights = (0..513 * 513).map(|i| if i % 513 < 256 { 1.0 } else { f32::NAN }).collect();
    let field = field([513, 513], heights);
    let mesh = triangulate(&field, 0.1);
    assert_eq!(check(&mesh, &field), 0.0);
    assert!(mesh.triangles.len() < 6000, "{}", mesh.triangles.len());
}

#[test]
fn huge_heights_and_errors_that_are_no_numbers_end() {
    let mut random = Random(11);
    let heights = (0..33 * 33).map(|_| f32::MAX * [1.0, -1.0, 1e-38][random.below(3)]).collect();
    let field = field([33, 33], heights);
    for error in [f32::NAN, -1.0, 0.0] {
        check(&triangulate(&field, error), &field);
    }
    assert_eq!(triangulate(&field, f32::INFINITY).triangles.len(), 2);
    for error in [f32::NAN, -1.0, 1e30, f32::INFINITY] {
        check(&bounded(&field, &ErrorBounds::new(&field, 64), error), &field);
    }
    assert!(HeightField::new([3, 3], vec![0.0; 8]).is_none());
    assert!(HeightField::new([u32::MAX, u32::MAX], Vec::new()).is_none());
}
