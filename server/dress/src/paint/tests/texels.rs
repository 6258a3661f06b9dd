//! Texels: borders of pictures, edges of shapes, and what decides them.

use super::*;
use crate::map_store::{MapRecord, overlap};

/// A town by chance: all classes, in an area of about 150 m.
fn town(seed: u64) -> Vec<PaintShape> {
    let mut dice = Dice(seed);
    let mut shapes = Vec::new();
    for i in 0..120 {
        let count = 3 + (dice.next() % 6) as usize;
        let [x, y] = [dice.below(150.0), dice.below(150.0)];
        let mut points: Vec<[f64; 2]> =
            (0..count).map(|_| at(x + dice.below(60.0) - 30.0, y + dice.below(60.0) - 30.0)).collect();
        if i % 2 == 0 {
            let class = AreaClass::ALL[i / 2 % AreaClass::ALL.len()];
            shapes.push(area(class, vec![points.clone(), points.iter().rev().take(3).copied().collect()]));
        } else {
            if i % 3 == 0
                && let Some(PaintShape::Line(other)) = shapes.iter().rfind(|s| matches!(s, PaintShape::Line(_)))
            {
                points[1] = other.points[other.points.len() / 2];
            }
            let class = LineClass::ALL[i / 2 % LineClass::ALL.len()];
            let sides = [Sidewalks::Usual, Sidewalks::None, Sidewalks::Left, Sidewalks::Right, Sidewalks::Both];
            let sidewalks = sides[(dice.next() % 5) as usize];
            let lanes = Some((dice.next() % 4) as u8);
            shapes.push(PaintShape::Line(PaintLine { lanes, sidewalks, ..PaintLine::new(class, points) }));
        }
    }
    shapes
}

/// The shapes that touch a picture.
fn touching(shapes: &[PaintShape], corner: [f64; 2], size: [usize; 2], texel_m: f64) -> Vec<PaintShape> {
    let high = [0, 1].map(|axis| corner[axis] + size[axis] as f64 * texel_m);
    let touches = |shape: &&PaintShape| shape.bounds().is_some_and(|bounds| overlap(bounds, [corner, high]));
    shapes.iter().filter(touches).cloned().collect()
}

#[test]
fn neighbouring_pictures_are_parts_of_one() {
    for (seed, texel_m) in (200..220).map(|s| (s, [0.25, 0.3, 0.5, 2.0][s as usize % 4])) {
        let shapes = town(seed);
        let painter = GroundPainter::new(texel_m).unwrap();
        let corner = painter.snap([CORNER[0] - 7.0, CORNER[1] - 5.0]);
        let [width, height] = [601, 421];
        let whole = painter.paint(&shapes, corner, [width, height]).unwrap();
        assert!(whole.iter().filter(|texel| texel[3] > 0).count() > 5000);
        let (mut x, mut part_count) = (0, 0);
        for part_width in [150, 1, 200, 250] {
            let mut y = 0;
            for part_height in [333, 88] {
                let size = [part_width, part_height];
                let part_corner = [corner[0] + x as f64 * texel_m, corner[1] + y as f64 * texel_m];
                let near = touching(&shapes, part_corner, size, texel_m);
                assert!(texel_m > 1.0 || near.len() < shapes.len());
                let part = painter.paint(&near, part_corner, size).unwrap();
                for (row, texels) in part.chunks_exact(part_width).enumerate() {
                    let expected = &whole[(y + row) * width + x..][..part_width];
                    assert!(texels == expected, "seed {seed}, part {part_count}, row {row}");
                }
                y += part_height;
                part_count += 1;
            }
            x += part_width;
        }
    }
}

#[test]
fn pictures_depend_on_nothing_but_shapes() {
    let mut shapes = town(9);
    let size = [300, 280];
    let first = paint(&shapes, size);
    assert!(first == paint(&shapes, size));
    shapes.reverse();
    shapes.rotate_left(17);
    assert!(first == paint(&shapes, size), "the order of shapes does not matter");
    let one_thread = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    assert!(first == one_thread.install(|| paint(&shapes, size)));
    let shared: Vec<std::sync::Arc<PaintShape>> = shapes.iter().cloned().map(Into::into).collect();
    assert!(first == GroundPainter::new(TEXEL_M).unwrap().paint(&shared, CORNER, size).unwrap());
    shapes.truncate(100);
    assert!(first != paint(&shapes, size), "the comparison sees differences");
}

#[test]
fn areas_with_a_common_border_have_no_gap() {
    let (a, b) = (at(5.3, -3.0), at(31.9, 60.0));
    let west = area(AreaClass::Water, vec![vec![at(-9.0, -3.0), a, b, at(-9.0, 60.0)]]);
    let east = area(AreaClass::Square, vec![vec![a, at(70.0, -3.0), at(70.0, 60.0), b]]);
    let picture = paint(&[west, east], [200, 200]);
    assert!(picture.iter().all(|texel| texel[3] == 255));
}

#[test]
fn edges_are_the_covered_share_of_texels() {
    // A triangle with slanted edges: alphas add up to its area.
    let ring = vec![at(3.1, 2.2), at(47.7, 9.9), at(21.3, 44.4)];
    let shape = area(AreaClass::Water, vec![ring]);
    let size_m2 = (44.6 * 42.2 - 18.2 * 7.7f64).abs() / 2.0;
    let picture = paint(std::slice::from_ref(&shape), [200, 200]);
    let painted_m2: f64 = picture.iter().map(|texel| f64::from(texel[3]) / 255.0 / 16.0).sum();
    assert!((painted_m2 / size_m2 - 1.0).abs() < 1e-3, "{painted_m2} {size_m2}");
    assert!(picture.iter().filter(|texel| (1..255).contains(&texel[3])).count() > 300, "edges are smooth");
    // A finer picture of the same: each texel is the mean of 16.
    let fine = GroundPainter::new(TEXEL_M / 4.0).unwrap().paint(&[shape], CORNER, [800, 800]).unwrap();
    for (i, texel) in picture.iter().enumerate() {
        let [x, y] = [i % 200 * 4, i / 200 * 4];
        let sum: u32 = (0..16).map(|k| u32::from(fine[(y + k / 4) * 800 + x + k % 4][3])).sum();
        assert!((f64::from(sum) / 16.0 - f64::from(texel[3])).abs() < 50.0, "{i}");
    }
}

#[test]
fn holes_and_islands_are_left_out() {
    let rings = vec![
        rectangle([2.0, 2.0], [22.0, 22.0]),
        rectangle([7.0, 7.0], [17.0, 17.0]),
        rectangle([10.0, 10.0], [14.0, 14.0]),
    ];
    let picture = paint(&[area(AreaClass::Water, rings)], [96, 96]);
    let alpha = |x_m: f64, y_m: f64| picture[(y_m * 4.0) as usize * 96 + (x_m * 4.0) as usize][3];
    assert_eq!(
        [alpha(1.0, 12.0), alpha(4.0, 12.0), alpha(8.0, 12.0), alpha(12.0, 12.0), alpha(18.0, 18.0)],
        [0, 255, 0, 255, 255]
    );
    let painted: u32 = picture.iter().map(|texel| u32::from(texel[3])).sum();
    assert_eq!(painted, (20 * 20 - 10 * 10 + 4 * 4) * 16 * 255);
}
