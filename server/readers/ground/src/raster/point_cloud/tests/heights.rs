//! Heights of cells.

use super::super::super::facts::{RasterLimits, RasterSize, Window};
use super::super::is_point_cloud;
use super::file::{TestCloud, TestPoint};
use super::{LIMITS, assert_heights, heights, open, open_within, read};

/// A point in the middle of each square metre of a rectangle, by row from the north. Cells are 1 m wide.
fn lattice(width: u32, height: u32, z_m: impl Fn(u32, u32) -> f64) -> Vec<TestPoint> {
    let points = (0..height).rev().flat_map(|y| (0..width).map(move |x| (x, y)));
    points.map(|(x, y)| TestPoint::ground(f64::from(x) + 0.5, f64::from(y) + 0.5, z_m(x, y))).collect()
}

fn with(more: impl IntoIterator<Item = TestPoint>) -> TestCloud {
    let points = lattice(8, 8, |x, y| f64::from(x) + f64::from(y) / 10.0);
    TestCloud::new(points.into_iter().chain(more).collect())
}

#[test]
fn places_of_cells() {
    assert!(is_point_cloud(&with([]).bytes()) && !is_point_cloud(b"LAS"));
    let mut cloud = with([]);
    cloud.offset = [1000.0, 2000.0, 50.0];
    let (facts, heights) = read(&cloud.bytes());
    assert_eq!((facts.size, facts.bands), (RasterSize { width: 8, height: 8 }, 1));
    let place = facts.place.unwrap();
    assert_eq!((place.origin, place.column, place.row), ([1000.5, 2007.5], [1.0, 0.0], [0.0, -1.0]));
    let expected: Vec<f32> = (0..64).map(|i| 50.0 + (i % 8) as f32 + (7 - i / 8) as f32 / 10.0).collect();
    assert!(heights.iter().zip(&expected).all(|(a, b)| (a - b).abs() < 1e-4), "{heights:?}");
}

#[test]
fn windows() {
    let bytes = with([]).bytes();
    let (mut cloud, all) = (open(&bytes).unwrap().0, heights(&bytes));
    let found = cloud.read_heights(Window { x: 3, y: 5, width: 2, height: 3 }, 6).unwrap();
    assert_heights(&found, &[all[43], all[44], all[51], all[52], all[59], all[60]]);
}

#[test]
fn cells_without_their_lowest_and_highest_point() {
    let at = |heights: &[f64]| {
        let more = heights.iter().map(|z| TestPoint::ground(0.25, 7.25, *z)).collect::<Vec<_>>();
        super::heights(&with(more).bytes())[0]
    };
    // The first cell has a point with 0.7 already.
    assert_eq!(at(&[]), 0.7);
    assert_eq!(at(&[1.3]), 1.0);
    assert_eq!(at(&[900.0, 0.9]), 0.9);
    assert_eq!(at(&[-40.0, 1.1, 1.2, 1.3]), 1.0);
    assert_eq!(at(&[1.3, -40.0, 1.2, 1.1]), 1.0);
}

#[test]
fn points_in_any_order_give_the_same() {
    let noise = |i: u32| f64::from(i.wrapping_mul(2_654_435_761) >> 20) / 4096.0;
    let point = |i: u32| TestPoint::ground(noise(i) * 8.0, noise(i + 1000) * 8.0, noise(i + 2000) * 90.0);
    let points: Vec<TestPoint> = (0..900).map(point).collect();
    let reversed = points.iter().rev().copied().collect();
    assert_heights(&heights(&TestCloud::new(points).bytes()), &heights(&TestCloud::new(reversed).bytes()));
}

#[test]
fn points_that_are_not_on_the_ground() {
    let high = TestPoint::ground(4.5, 4.5, 90.0);
    let expected = heights(&with([]).bytes());
    for format in [0, 1, 2, 3, 6, 7, 8] {
        let bytes = |point: TestPoint| with([point]).format(format).bytes();
        for class in [0, 1, 3, 4, 5, 6, 7, 12, 17, 18] {
            assert_heights(&heights(&bytes(high.class(class))), &expected);
        }
        for flags in [1, 4, 5] {
            assert_heights(&heights(&bytes(high.flags(flags))), &expected);
        }
        for class in [2, 8, 9, 11] {
            let found = heights(&bytes(high.class(class)));
            assert_eq!(found[3 * 8 + 4], (expected[3 * 8 + 4] + 90.0) / 2.0, "{format} {class}");
        }
        // A key point.
        assert_ne!(heights(&bytes(high.flags(2))), expected);
    }
    let is_left_out = |class, flags| heights(&with([high.class(class).flags(flags)]).format(6).bytes()) == expected;
    assert!(is_left_out(2, 8) && is_left_out(64, 0) && is_left_out(200, 0));
}

#[test]
fn points_beyond_the_bounds_in_the_header() {
    let mut cloud = with([TestPoint::ground(5000.0, 4.0, 9.0), TestPoint::ground(4.0, -20.0, 9.0)]);
    cloud.bounds = Some([[0.5, 0.5], [7.5, 7.5]]);
    assert_heights(&heights(&cloud.bytes()), &heights(&with([]).bytes()));
    // A rounding of the bounds is forgiven, but not more.
    cloud.bounds = Some([[0.505, 0.505], [7.495, 7.495]]);
    assert_eq!(read(&cloud.bytes()).0.size, RasterSize { width: 8, height: 8 });
    cloud.bounds = Some([[0.55, 0.5], [7.5, 7.5]]);
    assert_eq!(read(&cloud.bytes()).0.size, RasterSize { width: 7, height: 8 });
}

#[test]
fn sizes_of_cells() {
    let step = |points_m: f64, side: u32| {
        let mut cloud = TestCloud::new(lattice(side, side, |_, _| 1.0));
        cloud.scale = [0.01 * points_m, 0.01 * points_m, 0.01];
        read(&cloud.bytes()).0.place.unwrap().column[0]
    };
    for (points_m, expected) in [(0.1, 0.25), (0.3, 0.5), (0.5, 0.5), (0.7, 1.0), (1.2, 2.0), (2.5, 5.0), (60.0, 100.0)]
    {
        assert_eq!(step(points_m, 64), expected, "{points_m}");
    }
    // At most 2^20 cells in these tests, in place of 2000 x 2000.
    let far = TestPoint::ground(1999.5, 1999.5, 0.0);
    let mut cloud = TestCloud::new(lattice(64, 64, |_, _| 1.0).into_iter().chain([far]).collect());
    assert_eq!(read(&cloud.bytes()).0.place.unwrap().column[0], 2.0);
    cloud.points.truncate(1);
    assert_eq!(read(&cloud.bytes()).0.size, RasterSize { width: 1, height: 1 });
}

#[test]
fn gaps_do_not_make_cells_larger() {
    // Two squares of 60 m, 740 m apart.
    let far = lattice(60, 60, |_, _| 1.0).into_iter().map(|point| {
        let [x, y, z] = point.numbers;
        TestPoint { numbers: [x + 80_000, y + 80_000, z], ..point }
    });
    let points = lattice(60, 60, |_, _| 1.0).into_iter().chain(far).collect();
    let (facts, heights) = read(&TestCloud::new(points).bytes());
    assert_eq!(facts.place.unwrap().column[0], 1.0);
    assert_eq!(heights.iter().filter(|height| !height.is_nan()).count(), 7200);
}

#[test]
fn cells_that_a_limit_makes_larger_are_told() {
    let coarse = |max_whole_pixels: u64| {
        let (cloud, facts) = open_within(&with([]).bytes(), RasterLimits { max_whole_pixels, ..LIMITS }).unwrap();
        (cloud.warning().is_some_and(|text| text.contains("split it")), facts.size.width)
    };
    assert_eq!((coarse(64), coarse(63)), ((false, 8), (true, 4)));
}

#[test]
fn ground_that_was_not_measured() {
    // It counts if there is no other.
    let points = |flags| lattice(8, 8, |_, _| 7.0).into_iter().map(move |point| point.flags(flags));
    for flags in [1, 8] {
        let (cloud, facts) = open(&TestCloud::new(points(flags).collect()).format(6).bytes()).unwrap();
        assert_eq!((cloud.warning(), facts.size.width), (None, 8));
    }
    assert!(open(&TestCloud::new(points(4).collect()).format(6).bytes()).is_err());
}
