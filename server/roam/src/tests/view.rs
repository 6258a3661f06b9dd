//! The surface for a view.

use super::super::bounds::ErrorBounds;
use super::super::view_surface::ViewSurface;
use super::super::*;
use super::{Random, bounded, check, field, fractal, refined};
use glam::Vec3;
use std::collections::BTreeSet;

fn hilly(size: [u32; 2], seed: u64, gaps: usize) -> HeightField {
    let mut random = Random(seed);
    let mut heights = fractal(size, 80.0, seed);
    for _ in 0..gaps {
        let i = random.below(heights.len());
        heights[i] = f32::NAN;
    }
    field(size, heights)
}

/// Pixels that a metre in a box takes for an eye.
fn seen_from(eye_m: Vec3, pixels_at_1_m: f32) -> impl Fn([Vec3; 2]) -> f32 {
    move |[low, high]| pixels_at_1_m / eye_m.distance(eye_m.clamp(low, high)).max(5.0)
}

#[test]
fn surfaces_are_closed_and_take_what_matters_most_first() {
    for (seed, gaps) in [(5, 0), (6, 25)] {
        let field = hilly([129, 100], seed, gaps);
        let bounds = ErrorBounds::new(&field, 128);
        let coarsest = bounded(&field, &bounds, f32::INFINITY).triangles.len();
        let mut random = Random(seed);
        for threshold in [0.0, 0.5, 4.0, 30.0] {
            let eye_m = Vec3::new(129.0 * random.unit(), 100.0 * random.unit(), 60.0);
            let scale = seen_from(eye_m, 900.0);
            let all = refined(&field, &bounds, &scale, (threshold, usize::MAX));
            check(&all, &field);
            let places: BTreeSet<Place> = all.vertices.iter().copied().collect();
            for more in [0, 1, 57, 300, 5000, usize::MAX / 2] {
                let limit = coarsest + more;
                let mesh = refined(&field, &bounds, &scale, (threshold, limit));
                check(&mesh, &field);
                assert!(mesh.triangles.len() <= limit && mesh.vertices.iter().all(|place| places.contains(place)));
                // A split adds one or two triangles.
                assert!(mesh == all || mesh.triangles.len() + 2 > limit, "{} of {limit}", mesh.triangles.len());
            }
        }
    }
}

#[test]
fn the_threshold_holds_for_all_triangles() {
    let field = hilly([65, 65], 8, 0);
    let bounds = ErrorBounds::new(&field, 64);
    for error in [5.0, 0.2, 1.0] {
        assert!(check(&bounded(&field, &bounds, error), &field) <= f64::from(error));
    }
    // From above, no pixel is farther off than the threshold.
    let scale = seen_from(Vec3::new(32.0, 32.0, 500.0), 1000.0);
    let mesh = refined(&field, &bounds, &scale, (2.0, usize::MAX));
    assert!(check(&mesh, &field) <= 2.0 * (500.0 + 64.0) / 1000.0);
}

#[test]
fn priorities_without_order_still_give_a_closed_surface() {
    let field = hilly([65, 50], 9, 10);
    let bounds = ErrorBounds::new(&field, 64);
    for seed in 0..12_u32 {
        let hash = |reach_m: [Vec3; 2]| {
            let bits = reach_m.iter().fold(seed, |h, c| (h ^ c.x.to_bits() ^ c.y.to_bits()).wrapping_mul(0x9E37_79B1));
            [f32::NAN, f32::INFINITY, -1.0, 0.0, 1.0, 2.0, 3.0, 4.0][(bits >> 29) as usize]
        };
        let limit = if seed % 3 == 0 { 600 } else { usize::MAX };
        check(&refined(&field, &bounds, &hash, (0.5, limit)), &field);
    }
}

#[test]
fn reach_and_error_of_a_diamond_contain_those_of_its_parts() {
    let field = hilly([65, 65], 10, 0);
    let bounds = ErrorBounds::new(&field, 64);
    let scale = |_: [Vec3; 2]| 1.0;
    let surface = ViewSurface::new(&field, &bounds, 1.5, &scale);
    for index in 0..field.len() {
        let Some([low, high]) = surface.reach_m(index) else { continue };
        for parent in surface.parents(index) {
            let [parent_low, parent_high] = surface.reach_m(parent).unwrap();
            assert!(low.cmpge(parent_low).all() && high.cmple(parent_high).all());
            assert!(bounds.error_m(index) <= bounds.error_m(parent));
        }
        let place = field.place(index).map(|along| along as f32 * 1.5);
        assert!((0..2).all(|axis| (low[axis]..=high[axis]).contains(&place[axis])));
    }
}
