//! The ground of clouds without classes.

use super::super::super::facts::RasterSize;
use super::super::extremes::Extreme;
use super::super::ground_filter::keep_ground;
use super::file::{TestCloud, TestPoint};
use super::{assert_heights, open, read};

const SIDE: usize = 100;
const SIZE: RasterSize = RasterSize { width: SIDE as u32, height: SIDE as u32 };

fn slope(x: usize, y: usize) -> f32 {
    10.0 + x as f32 * 0.1 + y as f32 * 0.05
}

/// A slope on which `height` stands. Returns which cells were removed.
fn removed(step_m: f64, unit_m: f64, height: impl Fn(usize, usize) -> f32) -> Vec<[usize; 2]> {
    let cells = || (0..SIDE * SIDE).map(|i| (i % SIDE, i / SIDE));
    let unit = unit_m as f32;
    let mut heights: Vec<f32> = cells().map(|(x, y)| (slope(x, y) * step_m as f32 + height(x, y)) / unit).collect();
    keep_ground(&mut heights, SIZE, step_m, unit_m);
    cells().zip(heights).filter(|(_, height)| height.is_nan()).map(|((x, y), _)| [x, y]).collect()
}

#[test]
fn buildings_are_removed() {
    for (step_m, unit_m) in [(1.0, 1.0), (2.0, 0.3048)] {
        // 40 m and 8 m wide.
        let cells = |metres: f64| (metres / step_m) as usize;
        let is_building = |x: usize, y: usize| {
            let large = (30..30 + cells(40.0)).contains(&x) && (30..30 + cells(30.0)).contains(&y);
            large || (10..10 + cells(8.0)).contains(&x) && (80..80 + cells(8.0)).contains(&y)
        };
        let removed = removed(step_m, unit_m, |x, y| if is_building(x, y) { 6.0 } else { 0.0 });
        let buildings = (0..SIDE * SIDE).filter(|i| is_building(i % SIDE, i / SIDE)).count();
        assert_eq!(removed.len(), buildings, "{step_m}");
        assert!(removed.iter().all(|[x, y]| is_building(*x, *y)));
    }
}

#[test]
fn terrain_stays() {
    assert!(removed(1.0, 1.0, |_, _| 0.0).is_empty());
    // A ditch of 1 m, and a hill of 4 m that is 80 m wide.
    assert!(removed(1.0, 1.0, |x, _| if x == 20 { -1.0 } else { 0.0 }).is_empty());
    let hill = |x: usize, y: usize| {
        let from_top = ((x as f32 - 50.0).hypot(y as f32 - 50.0) / 40.0).min(1.0);
        2.0 * (1.0 + (from_top * std::f32::consts::PI).cos())
    };
    assert!(removed(1.0, 1.0, hill).is_empty());
}

#[test]
fn single_errors_far_below_are_removed() {
    assert_eq!(removed(1.0, 1.0, |x, y| if (x, y) == (40, 60) { -30.0 } else { 0.0 }), [[40, 60]]);
}

#[test]
fn extremes_of_squares() {
    let size = RasterSize { width: 13, height: 7 };
    let heights: Vec<f32> = (0..91_u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 24) as f32).collect();
    let heights: Vec<f32> = heights.iter().map(|height| if *height < 60.0 { f32::NAN } else { *height }).collect();
    for radius in [0_usize, 1, 2, 3, 5, 20] {
        for extreme in [Extreme::Lowest, Extreme::Highest] {
            let mut found = heights.clone();
            extreme.of_squares(&mut found, size, radius);
            let expected = |i: usize| {
                let is_near = |j: &usize| (i % 13).abs_diff(j % 13) <= radius && (i / 13).abs_diff(j / 13) <= radius;
                let near = (0..91).filter(is_near).map(|j| heights[j]);
                if extreme == Extreme::Lowest { near.fold(f32::NAN, f32::min) } else { near.fold(f32::NAN, f32::max) }
            };
            assert_heights(&found, &(0..91).map(expected).collect::<Vec<f32>>());
        }
    }
}

#[test]
fn clouds_without_classes() {
    // A building of 10 m on flat ground, and trees of which the last reflection is from the ground.
    let points = |class: u8| {
        let places = (0..SIDE * SIDE).map(|i| (i % SIDE, i / SIDE));
        places.flat_map(move |(x, y)| {
            let is_building = (40..50).contains(&x) && (40..50).contains(&y);
            let place = |z_m| TestPoint::ground(x as f64 + 0.5, y as f64 + 0.5, z_m).class(class);
            let tree = place(17.0).returns(1, 2);
            [place(if is_building { 14.0 } else { 4.0 }).returns(2, 2), tree]
        })
    };
    for format in [1, 6] {
        let bytes = TestCloud::new(points(1).collect()).format(format).bytes();
        assert!(open(&bytes).unwrap().0.warning().is_some());
        let (facts, heights) = read(&bytes);
        assert_eq!(facts.size, SIZE);
        assert_heights(&heights, &[4.0; SIDE * SIDE]);
        // A few stray points of the ground do not decide.
        let stray = (0..9).map(|i| TestPoint::ground(f64::from(i) * 10.0 + 0.5, 50.5, 9.0));
        let bytes = TestCloud::new(points(1).chain(stray).collect()).format(format).bytes();
        assert!(open(&bytes).unwrap().0.warning().is_some());
        assert_heights(&read(&bytes).1, &[4.0; SIDE * SIDE]);
    }
    // Points that are known to be above the ground are none of it.
    assert!(open(&TestCloud::new(points(5).collect()).bytes()).is_err());
    assert_eq!(open(&TestCloud::new(points(2).collect()).bytes()).unwrap().0.warning(), None);
}
