//! Translucency maps against all points that light enters. `tests/measure/translucency.rs` prints the errors of more shapes and
//! meshes, with more points.

use glam::Vec3;
use insula_shaders::stone::Stone;
use insula_shaders::translucency::{FAST_TAPS, FINE_TAPS};
use insula_test_support::tier;
use insula_tests::tests;
use insula_tests::translucent_shapes::{LitShape, Shape, filter_error};
use insula_tests::trials::Trials;

pub(crate) fn add(trials: &mut Trials) {
    trials.add(tests![
        taps_gather_the_light_of_a_sphere, taps_gather_the_light_of_a_slab, taps_gather_the_light_of_a_hand,
        thin_parts_glow_and_thick_ones_do_not
    ]);
}

/// Points that light enters; `tests/measure/translucency.rs` has ten times as many.
const SAMPLES: usize = 100_000;

fn marble() -> Stone {
    // Five times the lengths, so that fewer points are enough.
    Stone { scattering_scale: 5.0, ..Stone::preset("carrara-marble").expect("a preset") }
}

fn check(name: &str, shape: &Shape) {
    let sun = Vec3::new(0.6, 0.5, 0.62).normalize();
    let lit = LitShape::new(shape.clone(), sun, &marble(), 256, SAMPLES).expect("marble is translucent");
    let points = if tier::is_full() { 100 } else { 50 };
    for (taps, most) in [(FINE_TAPS, 0.15), (FAST_TAPS, 0.25)] {
        let error = filter_error(&lit, taps, points);
        let is_true = error.of_mean <= most && error.relative < 0.6 && (0.85..1.15).contains(&error.bias);
        assert!(is_true, "{name}, {taps} taps: {error:?}");
    }
}

fn taps_gather_the_light_of_a_sphere() {
    check("sphere", &Shape::ball(64, |_| 0.1));
}

fn taps_gather_the_light_of_a_slab() {
    check("slab", &Shape::slab(Vec3::new(0.15, 0.15, 0.02)));
}

fn taps_gather_the_light_of_a_hand() {
    let mut hand = Shape::hand();
    hand.points.iter_mut().for_each(|p| *p *= 5.0);
    check("hand", &hand);
}

/// Light passes a plate of 3 mm of marble, and hardly one of 30 mm.
fn thin_parts_glow_and_thick_ones_do_not() {
    let stone = Stone::preset("carrara-marble").unwrap();
    let behind = |half_m: f32| {
        let lit = LitShape::new(Shape::slab(Vec3::new(0.06, 0.06, half_m)), Vec3::Z, &stone, 512, 1000)
            .expect("marble is translucent");
        [FINE_TAPS, FAST_TAPS].map(|taps| lit.by_taps(Vec3::new(0.001, 0.002, -half_m), taps))
    };
    for (thin, thick) in behind(0.0015).into_iter().zip(behind(0.015)) {
        assert!(thin.x > 0.1 && thin.x > 1.2 * thin.z, "{thin}");
        assert!(thick.max_element() < 0.01, "{thick}");
    }
}
