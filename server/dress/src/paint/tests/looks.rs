//! The order of layers, and the widths of lines.

use super::*;

/// A painter whose materials have colours of their own, without variation.
fn distinct(wanted: &[(PaintMaterial, [u8; 3])]) -> GroundPainter {
    let mut style = PaintStyle::default();
    style.variation = 0.0;
    wanted.iter().for_each(|(material, rgb)| style.set_colour(*material, *rgb));
    GroundPainter::with_style(TEXEL_M, style).unwrap()
}

#[test]
fn later_passes_lie_on_earlier_ones() {
    let all = rectangle([0.0, 0.0], [40.0, 40.0]);
    let across = |class| PaintShape::Line(PaintLine { width_m: 10.0, ..line(class, &[[-9.0, 20.0], [60.0, 20.0]]) });
    // Each lies on all before, whatever their order.
    let mut shapes = vec![
        (area(AreaClass::Residential, vec![all.clone()]), PaintMaterial::ResidentialGround),
        (area(AreaClass::Water, vec![all.clone()]), PaintMaterial::Water),
        (area(AreaClass::Forest, vec![rectangle([1.0, 1.0], [39.0, 39.0])]), PaintMaterial::Forest),
        (across(LineClass::Waterway), PaintMaterial::Water),
        (area(AreaClass::Square, vec![all.clone()]), PaintMaterial::Paving),
        (across(LineClass::Footway), PaintMaterial::Pavement),
        (area(AreaClass::Carriageway, vec![all]), PaintMaterial::Carriageway),
        (across(LineClass::Service), PaintMaterial::SideAsphalt),
        (across(LineClass::Primary), PaintMaterial::Asphalt),
    ];
    let colours: Vec<(PaintMaterial, [u8; 3])> = PaintMaterial::ALL
        .iter()
        .enumerate()
        .map(|(i, material)| (*material, [7 * i as u8, 255 - 7 * i as u8, 90]))
        .collect();
    let painter = distinct(&colours);
    while let Some((_, material)) = shapes.last() {
        let mut given: Vec<PaintShape> = shapes.iter().map(|(shape, _)| shape.clone()).collect();
        given.reverse();
        let picture = painter.paint(&given, CORNER, [160, 160]).unwrap();
        // Beside the lane line in the middle.
        let [r, g, b, _] = picture[88 * 160 + 80];
        assert_eq!([r, g, b], colours[*material as usize].1, "{material:?}");
        shapes.pop();
    }
}

#[test]
fn widths_are_right_in_texels() {
    let colours = [
        (PaintMaterial::Asphalt, [255, 0, 0]),
        (PaintMaterial::Kerb, [0, 255, 0]),
        (PaintMaterial::Pavement, [0, 0, 255]),
        (PaintMaterial::Marking, [0, 0, 0]),
    ];
    // Along an axis, and slanted: a cut across is longer by the slope.
    for (end, slope) in [([70.0, 20.0], 1.0), ([70.0, 48.0], (1.0 + (28.0f64 / 78.0).powi(2)).sqrt())] {
        let road = PaintLine { width_m: 7.0, lanes: Some(2), ..line(LineClass::Primary, &[[-8.0, 20.0], end]) };
        let picture = distinct(&colours).paint(&[PaintShape::Line(road)], CORNER, [256, 256]).unwrap();
        // Linear light, summed over columns that a dash covers, and that none does.
        let column = |x: usize| {
            let mut sum = [0.0; 3];
            for y in 0..256 {
                let texel = picture[y * 256 + x];
                let linear = crate::paint::pattern::to_linear([texel[0], texel[1], texel[2]]);
                (0..3).for_each(|i| sum[i] += f64::from(linear[i]) * f64::from(texel[3]) / 255.0 * TEXEL_M);
            }
            sum.map(|v| v / slope)
        };
        let columns: Vec<[f64; 3]> = (0..256).map(column).collect();
        let mean = |i: usize| columns.iter().map(|sums| sums[i]).sum::<f64>() / 256.0;
        // A quarter of the line has a dash of 0.15 m.
        assert!((mean(0) - (7.0 - 0.0375)).abs() < 0.04, "{}", mean(0));
        assert!((mean(1) - 0.3).abs() < 0.06, "{}", mean(1));
        assert!((mean(2) - 4.0).abs() < 0.06, "{}", mean(2));
        let widest = columns.iter().map(|sums| sums[0]).fold(0.0, f64::max);
        let dashed = columns.iter().filter(|sums| sums[0] < widest - 0.08).count() as f64 / 256.0;
        // 3 of 12 m.
        assert!((dashed - 0.25).abs() < 0.06, "{dashed}");
    }
}

#[test]
fn rails_lie_at_their_gauge_and_sleepers_across() {
    let colours = [
        (PaintMaterial::Rail, [255, 0, 0]),
        (PaintMaterial::Sleeper, [0, 255, 0]),
        (PaintMaterial::Ballast, [0, 0, 255]),
    ];
    let rail = PaintLine { lanes: Some(2), width_m: 7.2, ..line(LineClass::Rail, &[[-8.0, 20.0], [80.0, 20.0]]) };
    let picture = distinct(&colours).paint(&[PaintShape::Line(rail)], CORNER, [128, 160]).unwrap();
    let column: Vec<[u8; 4]> = (0..160).map(|y| picture[y * 128 + 64]).collect();
    let rails: Vec<f64> = (0..160)
        .filter(|y| column[*y][0] > 100 && column[y - 1][0] <= 100)
        .map(|y| y as f64 * TEXEL_M - 20.0)
        .collect();
    assert_eq!(rails.len(), 4, "{rails:?}");
    for (found, expected) in rails.iter().zip([-2.75, -1.25, 1.25, 2.75]) {
        assert!((found + 0.125 - expected).abs() < 0.26, "{rails:?}");
    }
    let bed = column.iter().filter(|texel| texel[3] > 0).count();
    assert!((28..=30).contains(&bed), "{bed}");
    let sleepers: f64 =
        (0..128).map(|x| f64::from(crate::paint::pattern::to_linear([picture[88 * 128 + x][1]; 3])[0])).sum();
    assert!((sleepers / 128.0 - 0.25 / 0.6).abs() < 0.03, "{sleepers}");
}

#[test]
fn pavements_are_where_it_is_built_up() {
    let painter = distinct(&[(PaintMaterial::Pavement, [255, 0, 255])]);
    let road = |sidewalks| {
        PaintShape::Line(PaintLine { sidewalks, ..line(LineClass::Residential, &[[-9.0, 20.0], [80.0, 20.0]]) })
    };
    let pavement = |class: AreaClass, sidewalks, y_m: f64| {
        let ground = area(class, vec![rectangle([-9.0, -9.0], [60.0, 60.0])]);
        let picture = painter.paint(&[road(sidewalks), ground], CORNER, [100, 160]).unwrap();
        picture[(y_m / TEXEL_M) as usize * 100 + 50] == [255, 0, 255, 255]
    };
    // The carriageway ends 2.75 m from the middle, the pavement 2.15 m beyond.
    for (class, expected) in [
        (AreaClass::Residential, true),
        (AreaClass::Grass, true),
        (AreaClass::Forest, false),
        (AreaClass::Water, false),
    ] {
        assert_eq!([23.5, 16.5].map(|y_m| pavement(class, Sidewalks::Usual, y_m)), [expected; 2], "{class:?}");
    }
    for (sidewalks, expected) in [
        (Sidewalks::None, [false, false]),
        (Sidewalks::Left, [true, false]),
        (Sidewalks::Right, [false, true]),
        (Sidewalks::Both, [true, true]),
    ] {
        assert_eq!([23.5, 16.5].map(|y_m| pavement(AreaClass::Forest, sidewalks, y_m)), expected, "{sidewalks:?}");
    }
    assert!(!pavement(AreaClass::Residential, Sidewalks::Usual, 25.2));
}

#[test]
fn crossings_are_open_and_without_lane_lines() {
    let painter = distinct(&[(PaintMaterial::Asphalt, [255, 0, 0]), (PaintMaterial::Marking, [255; 3])]);
    let streets = [
        PaintShape::Line(PaintLine {
            lanes: Some(4),
            width_m: 12.0,
            ..line(LineClass::Primary, &[[-30.0, 30.0], [30.0, 30.0], [90.0, 30.0]])
        }),
        PaintShape::Line(line(LineClass::Residential, &[[30.0, -30.0], [30.0, 30.0], [30.0, 90.0]])),
        PaintShape::Line(PaintLine { width_m: 4.0, ..line(LineClass::Zebra, &[[45.0, 20.0], [45.0, 40.0]]) }),
    ];
    let picture = painter.paint(&streets, CORNER, [240, 240]).unwrap();
    let white = |x_m: f64| (0..240).filter(|y| picture[y * 240 + (x_m / TEXEL_M) as usize][1] > 60).count();
    let in_middle = (100..140).all(|y| (112..128).all(|x| picture[y * 240 + x] == [255, 0, 0, 255]));
    assert!(in_middle, "nothing but asphalt where the streets meet");
    assert!(white(15.0) >= 2, "lane lines of the primary street");
    // Stripes of half a metre, each half a metre apart, on 12 m of carriageway and nowhere else.
    let stripes = picture.iter().skip(45 * 4).step_by(240).filter(|texel| texel[1] > 200).count() as f64 * TEXEL_M;
    assert!((5.0..=7.0).contains(&stripes), "{stripes}");
}

#[test]
fn plants_vary_a_little_and_water_not_at_all() {
    let tones = |class: AreaClass| {
        let picture = paint(&[area(class, vec![rectangle([0.0, 0.0], [100.0, 100.0])])], [400, 400]);
        let green: Vec<f64> = picture.iter().map(|texel| f64::from(texel[1])).collect();
        let mean = green.iter().sum::<f64>() / green.len() as f64;
        let deviation = (green.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / green.len() as f64).sqrt();
        (mean, deviation)
    };
    assert_eq!(tones(AreaClass::Water), (129.0, 0.0));
    for class in [AreaClass::Grass, AreaClass::Forest, AreaClass::Farmland, AreaClass::Meadow] {
        let (mean, deviation) = tones(class);
        assert!((0.4..0.08 * mean).contains(&deviation), "{class:?} {mean} {deviation}");
    }
}
