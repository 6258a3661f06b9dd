//! Properties of all roofs over random plans.

use super::*;
use insula_test_support::tier;
use proptest::prelude::*;

/// Corners that are slightly off a wall's line, and above a roof that begins at the floor, bend its faces.
const PLANAR_M: f64 = 0.1;

fn any_spec() -> impl Strategy<Value = RoofSpec> {
    let shape = (0..SHAPES.len()).prop_map(|i| SHAPES[i]);
    let direction_deg = prop::option::of(prop_oneof![Just(90.0), 0.0..360.0_f64]);
    let across = prop_oneof![Just(None), Just(Some(RoofOrientation::Along)), Just(Some(RoofOrientation::Across))];
    let heights = (-50.0..500.0_f64, prop_oneof![Just(0.0), 0.0..30.0_f64], 0.5..20.0_f64);
    (shape, direction_deg, across, heights).prop_map(|(shape, direction_deg, orientation, (base_m, wall_m, roof_m))| {
        let eaves_m = base_m + wall_m;
        RoofSpec { shape, base_m, eaves_m, top_m: eaves_m + roof_m, direction_deg, orientation }
    })
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(tier::cases()) })]

    #[test]
    fn roofs_are_closed_and_cover_the_footprint(rings in plans::any_plan(), spec in any_spec()) {
        match build(&rings, &spec) {
            Ok(surfaces) => {
                let checked = check::check(&rings, &spec, &surfaces, PLANAR_M);
                prop_assert!(checked.is_ok(), "{:?}", checked);
            }
            // Corners off the line may cross a neighbouring wall.
            Err(fault) => prop_assert_eq!(fault, RoofFault::Crossing),
        }
    }

    #[test]
    fn nearly_degenerate_plans_give_a_closed_roof_or_a_fault(rings in plans::nearly_degenerate(), spec in any_spec()) {
        if let Ok(surfaces) = build(&rings, &spec) {
            let checked = check::check(&rings, &spec, &surfaces, PLANAR_M);
            prop_assert!(checked.is_ok(), "{:?}", checked);
        }
    }

    #[test]
    fn any_corners_give_a_roof_or_a_fault(
        corners in prop::collection::vec(prop::collection::vec((-9..9_i32, -9..9_i32), 0..12), 0..4),
        spec in any_spec(),
    ) {
        let ring = |ring: &Vec<(i32, i32)>| ring.iter().map(|&(x, y)| [f64::from(x), f64::from(y)]).collect();
        let rings: Rings = corners.iter().map(ring).collect();
        if let Ok(surfaces) = build(&rings, &spec) {
            let checked = check::check(&rings, &spec, &surfaces, PLANAR_M);
            prop_assert!(checked.is_ok(), "{:?}", checked);
        }
    }
}
