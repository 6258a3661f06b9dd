//! Shapes that no map has.

use super::*;

#[test]
fn hostile_shapes_do_no_harm() {
    let weird = [f64::NAN, f64::INFINITY, -f64::INFINITY, 1e300, -1e9, 1e9, 0.0, CORNER[0], CORNER[1], 5e-324];
    let points: Vec<[f64; 2]> = weird.iter().flat_map(|x| weird.iter().map(|y| [*x, *y])).collect();
    let mut shapes = Vec::new();
    for class in AreaClass::ALL {
        shapes.push(area(class, vec![points.clone(), Vec::new(), vec![at(1.0, 1.0)], vec![at(1.0, 1.0); 9]]));
        shapes.push(area(class, Vec::new()));
    }
    for class in LineClass::ALL {
        for width_m in [f64::NAN, f64::INFINITY, -3.0, 0.0, 1e300] {
            let new = PaintLine::new(class, points.clone());
            shapes.push(PaintShape::Line(PaintLine { width_m, lanes: Some(255), ..new }));
        }
        shapes.push(PaintShape::Line(PaintLine::new(class, Vec::new())));
        shapes.push(PaintShape::Line(line(class, &[[5.0, 5.0]])));
        shapes.push(PaintShape::Line(line(class, &[[5.0, 5.0], [5.0, 5.0], [5.0 + 1e-9, 5.0]])));
    }
    for texel_m in [0.01, 0.25, 7.3, 1000.0] {
        GroundPainter::new(texel_m).unwrap().paint(&shapes, CORNER, [70, 50]).unwrap();
    }
}

#[test]
fn many_corners_are_bounded_work() {
    let mut dice = Dice(5);
    // A star whose edges all cross each other, and lines like it.
    let star: Vec<[f64; 2]> =
        (0..1_000_000).map(|_| at(dice.below(400.0) - 150.0, dice.below(400.0) - 150.0)).collect();
    let shapes = [
        area(AreaClass::Forest, vec![star.clone()]),
        PaintShape::Line(PaintLine::new(LineClass::Motorway, star.clone())),
        PaintShape::Line(PaintLine::new(LineClass::Rail, star)),
    ];
    // Without the bounds this would take hours.
    paint(&shapes, [300, 200]);
    // A smooth one is painted as it is.
    let circle = |i: u32| f64::from(i) * std::f64::consts::TAU / 1e6;
    let ring: Vec<[f64; 2]> =
        (0..1_000_000).map(|i| at(50.0 + 40.0 * circle(i).cos(), 50.0 + 40.0 * circle(i).sin())).collect();
    let picture = paint(&[area(AreaClass::Water, vec![ring])], [400, 400]);
    let painted_m2: f64 = picture.iter().map(|texel| f64::from(texel[3]) / 255.0 / 16.0).sum();
    assert!((painted_m2 / (std::f64::consts::PI * 1600.0) - 1.0).abs() < 2e-3, "{painted_m2}");
}

#[test]
fn impossible_pictures_are_refused() {
    for texel_m in [0.0, -1.0, f64::NAN, f64::INFINITY, 1e-9] {
        assert!(matches!(GroundPainter::new(texel_m), Err(PaintError::TexelSize(_))), "{texel_m}");
    }
    let painter = GroundPainter::new(TEXEL_M).unwrap();
    let none: &[PaintShape] = &[];
    assert_eq!(painter.paint(none, [f64::NAN, 0.0], [1, 1]), Err(PaintError::Corner));
    assert_eq!(painter.paint(none, [0.0, 1e10], [1, 1]), Err(PaintError::Corner));
    assert_eq!(painter.paint(none, CORNER, [usize::MAX, 2]), Err(PaintError::TooLarge(usize::MAX, 2)));
    assert_eq!(painter.paint(none, CORNER, [16_000, 16_000]), Err(PaintError::TooLarge(16_000, 16_000)));
    assert_eq!(painter.paint(none, CORNER, [0, 7]).map(|texels| texels.len()), Ok(0));
    assert_eq!(painter.paint(none, CORNER, [2, 3]), Ok(vec![[0; 4]; 6]));
    assert_eq!(over([10, 20, 30, 0], [1, 2, 3]), [1, 2, 3]);
    assert_eq!(over([255, 255, 255, 128], [0, 0, 0]), [188; 3]);
}
