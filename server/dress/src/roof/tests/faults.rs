//! Names, heights, and plans that get no roof.

use super::*;
use plans::{courtyard, l_shape, rectangle, ring};

#[test]
fn names_are_those_of_openstreetmap_and_overture() {
    for (name, shape) in [
        ("gabled", Some(RoofShape::Gabled)),
        ("half-hipped", Some(RoofShape::HalfHipped)),
        ("half_hipped", Some(RoofShape::HalfHipped)),
        ("Hipped ", Some(RoofShape::Hipped)),
        ("lean_to", Some(RoofShape::Skillion)),
        ("shed", Some(RoofShape::Skillion)),
        ("flat", Some(RoofShape::Flat)),
        ("many;hipped;gabled", Some(RoofShape::Hipped)),
        ("many", None),
        ("sawtooth", None),
        ("", None),
        ("屋根", None),
    ] {
        assert_eq!(roof_shape_by_name(name), shape, "{name}");
    }
}

#[test]
fn usual_heights_follow_the_width() {
    let height = |shape, rings: &Rings, angle_deg| default_roof_height(shape, rings, angle_deg);
    let house = rectangle(14.0, 8.0);
    assert!((height(RoofShape::Gabled, &house, Some(45.0)) - 4.0).abs() < 1e-9);
    assert!((height(RoofShape::Skillion, &house, Some(45.0)) - 8.0).abs() < 1e-9);
    assert!((height(RoofShape::Dome, &house, None) - 4.0).abs() < 1e-9);
    assert_eq!(height(RoofShape::Flat, &house, Some(45.0)), 0.0);
    // As wide as a wing, not as the whole.
    assert!((2.0..3.0).contains(&height(RoofShape::Hipped, &l_shape(), None)));
    for shape in SHAPES {
        let hall = height(shape, &rectangle(400.0, 300.0), None);
        assert!(hall <= 30.0 && (shape == RoofShape::Flat || hall > 1.0), "{shape:?}: {hall}");
        for rings in [vec![], vec![vec![]], vec![vec![[0.0, 0.0]; 3]], vec![vec![[f64::NAN; 2]; 4]]] {
            assert_eq!(height(shape, &rings, None), 0.0);
        }
    }
}

#[test]
fn plans_without_a_roof_are_faults() {
    let fault = |rings: &[Vec<[f64; 2]>]| build(rings, &spec(RoofShape::Hipped)).expect_err("no roof");
    assert_eq!(fault(&[]), RoofFault::Ring);
    assert_eq!(fault(&[vec![[0.0, 0.0], [1.0, 0.0]]]), RoofFault::Ring);
    assert_eq!(fault(&[vec![[0.0, 0.0], [1.0, 0.0], [1.0, f64::NAN]]]), RoofFault::Ring);
    assert_eq!(fault(&[vec![[0.0, 0.0], [1.0, 0.0], [1e300, 1.0]]]), RoofFault::Ring);
    assert_eq!(fault(&[vec![[0.0, 0.0], [1.0, 0.0], [1.0, 0.0], [0.0, 1.0]]]), RoofFault::Ring);
    assert_eq!(fault(&[vec![[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]]]), RoofFault::Turn);
    let mut clockwise = rectangle(14.0, 8.0);
    clockwise[0].reverse();
    assert_eq!(fault(&clockwise), RoofFault::Turn);
    let bow = [ring(&[(0.0, 0.0), (9.0, 0.0), (9.0, 9.0), (4.0, -1.0)])];
    assert_eq!(fault(&bow), RoofFault::Crossing);
    let spike = [ring(&[(0.0, 0.0), (9.0, 0.0), (12.0, 0.0), (9.0, 0.0 + 1e-9), (9.0, 9.0), (0.0, 9.0)])];
    assert!(build(&spike, &spec(RoofShape::Hipped)).is_err());
    for shift in [6.0, 30.0] {
        // The hole touches the outer ring, or is outside of it.
        let mut rings = courtyard();
        rings[1].iter_mut().for_each(|corner| corner[0] += shift);
        assert_eq!(fault(&rings), RoofFault::Crossing);
    }
    let mut nested = courtyard();
    nested.push(ring(&[(8.0, 8.0), (8.0, 9.0), (9.0, 9.0), (9.0, 8.0)]));
    assert_eq!(fault(&nested), RoofFault::Crossing);
}

#[test]
fn heights_must_be_in_order() {
    let rings = rectangle(14.0, 8.0);
    let fault =
        |base_m, eaves_m, top_m| build(&rings, &RoofSpec { base_m, eaves_m, top_m, ..spec(RoofShape::Gabled) }).err();
    for (base_m, eaves_m, top_m) in
        [(0.0, 5.0, 4.0), (5.0, 4.0, 6.0), (0.0, f64::NAN, 1.0), (f64::NEG_INFINITY, 0.0, 1.0), (3.0, 3.0, 3.0)]
    {
        assert_eq!(fault(base_m, eaves_m, top_m), Some(RoofFault::Heights), "{base_m} {eaves_m} {top_m}");
    }
    // No room for a slope.
    assert_eq!(fault(0.0, 4.0, 4.0), None);
    let odd = RoofSpec { direction_deg: Some(f64::INFINITY), ..spec(RoofShape::Skillion) };
    build_checked(&rings, &odd);
}

#[test]
fn the_check_finds_damage() {
    let (rings, spec) = (l_shape(), spec(RoofShape::Gabled));
    let (surfaces, _) = build_checked(&rings, &spec);
    let is_found = |damage: &dyn Fn(&mut Vec<Surface>)| {
        let mut damaged = surfaces.clone();
        damage(&mut damaged);
        check::check(&rings, &spec, &damaged, 1e-5).is_err()
    };
    assert!(!is_found(&|_| ()));
    for i in 0..surfaces.len() {
        assert!(is_found(&|surfaces| drop(surfaces.remove(i))));
        assert!(is_found(&|surfaces| surfaces[i].points.reverse()));
        assert!(is_found(&|surfaces| surfaces[i].points[0][2] += 1e-9));
        let middle = |a: [f64; 3], b: [f64; 3]| [0, 1, 2].map(|axis| (a[axis] + b[axis]) / 2.0);
        let split = |surfaces: &mut Vec<Surface>| {
            let points = &mut surfaces[i].points;
            points.insert(1, middle(points[0], points[1]));
        };
        assert!(is_found(&split));
        let mut damaged = surfaces.clone();
        split(&mut damaged);
        assert!(check::check_no_t_junction(&damaged, 1e-6).is_err());
    }
    assert!(is_found(&|surfaces| surfaces.iter_mut().flat_map(|s| &mut s.points).for_each(|point| point[2] += 1e-3)));
    let other = plans::t_shape();
    assert!(check::check(&other, &spec, &surfaces, 1e-5).is_err());
}
