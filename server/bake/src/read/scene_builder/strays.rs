//! Strays: objects at places that cannot be a part of the city.
//!
//! A country is a thousand kilometres wide, so only what is absurd is a stray: further from the median object than any country
//! reaches, far above or below it, or at the origin of the coordinate system, where exporters put what has no place. The median
//! comes from histograms of whole numbers, which can be added in any order. Where no object is near it, the object nearest to it takes
//! its place.

use crate::read::duplicates::PlacedBox;
use std::collections::BTreeMap;

/// Side of a class of the histograms.
const CLASS_M: f64 = 1024.0;
/// An object that is further from the median on the map is a stray: no projected system has true lengths there.
const MAX_DISTANCE_M: f64 = 3_000_000.0;
/// The same for heights, and for objects at the origin of the coordinate system.
const MAX_RISE_M: f64 = 200_000.0;
/// Objects this near to the origin of the coordinate system are at the origin. Degrees that are taken for metres are, too.
const AT_ORIGIN_M: f64 = 1000.0;

/// Number of objects by their places along each axis.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(super) struct PlaceHistogram {
    axes: [BTreeMap<i32, u64>; 3],
}

impl PlaceHistogram {
    /// Adds a place in world coordinates, which are at most 10^9.
    pub(super) fn add(&mut self, place: [f64; 3]) {
        for (classes, v) in self.axes.iter_mut().zip(place) {
            // The cast saturates.
            *classes.entry((v / CLASS_M).floor() as i32).or_default() += 1;
        }
    }

    /// The median place: the middles of the classes that have it. Zero without places.
    pub(super) fn median_m(&self) -> [f64; 3] {
        self.axes.each_ref().map(|classes| {
            let half = classes.values().sum::<u64>() / 2;
            let mut before = 0;
            let found = classes.iter().find(|(_, count)| {
                before += **count;
                before > half
            });
            found.map_or(0.0, |(class, _)| (f64::from(*class) + 0.5) * CLASS_M)
        })
    }
}

/// A rectangle outside of which few objects make the city much wider.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Outskirts {
    low: [f64; 2],
    high: [f64; 2],
}

/// This share of the objects, or one, is few.
const FEW: u64 = 1000;
/// Smaller cities have no objects far away.
const LEAST_WIDTH_M: f64 = 20_000.0;
/// Of a city of fewer objects, none is unusual.
const LEAST_OBJECTS: u64 = 20;

impl Outskirts {
    /// `None` unless few objects are responsible for more than half of the city's width or height on the map.
    pub(super) fn of(places: &PlaceHistogram) -> Option<Self> {
        let mut all = Self { low: [f64::NEG_INFINITY; 2], high: [f64::INFINITY; 2] };
        let mut is_wide = false;
        for (axis, classes) in places.axes.iter().take(2).enumerate() {
            let count: u64 = classes.values().sum();
            let (first, last) = (classes.keys().next()?, classes.keys().last()?);
            let width_m = (f64::from(*last) - f64::from(*first) + 1.0) * CLASS_M;
            if count < LEAST_OBJECTS || width_m < LEAST_WIDTH_M {
                continue;
            }
            let (from, to) = densest(classes, count - (count / FEW).max(1))?;
            let (low, high) = (f64::from(from) * CLASS_M, (f64::from(to) + 1.0) * CLASS_M);
            if high - low < width_m / 2.0 {
                (all.low[axis], all.high[axis], is_wide) = (low, high, true);
            }
        }
        is_wide.then_some(all)
    }

    /// Distance of a place from the rectangle; `None` inside.
    pub(super) fn distance_m(&self, place: [f64; 3]) -> Option<f64> {
        let outside = |axis: usize| (self.low[axis] - place[axis]).max(place[axis] - self.high[axis]).max(0.0);
        Some(libm::hypot(outside(0), outside(1))).filter(|distance_m| *distance_m > 0.0)
    }
}

/// First and last class of the shortest run of classes with at least so many places.
fn densest(classes: &BTreeMap<i32, u64>, least: u64) -> Option<(i32, i32)> {
    let all: Vec<(i32, u64)> = classes.iter().map(|(class, count)| (*class, *count)).collect();
    let (mut start, mut sum, mut best) = (0, 0, None);
    for &(last, count) in &all {
        sum += count;
        while sum - all[start].1 >= least {
            sum -= all[start].1;
            start += 1;
        }
        let width = |(from, to): (i32, i32)| i64::from(to) - i64::from(from);
        let found = (all[start].0, last);
        if sum >= least && best.is_none_or(|best| width(found) < width(best)) {
            best = Some(found);
        }
    }
    best
}

/// Whether a place is near the origin of the coordinate system.
pub(super) fn is_at_origin(place: [f64; 3]) -> bool {
    place[0].abs().max(place[1].abs()) < AT_ORIGIN_M
}

/// Distance of an object from the median in metres if it is a stray.
pub(super) fn stray_distance_m(middle: [f64; 3], place: PlacedBox) -> Option<f64> {
    let along = |axis: usize| (place.high[axis] - middle[axis]).max(middle[axis] - place.low[axis]);
    let (on_map, rise) = (along(0).max(along(1)), along(2));
    let has_no_place = is_at_origin(place.low) && is_at_origin(place.high);
    let is_stray = on_map > MAX_DISTANCE_M || rise > MAX_RISE_M || has_no_place && on_map > MAX_RISE_M;
    is_stray.then_some(on_map.max(rise))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn house([x, y, z]: [f64; 3]) -> PlacedBox {
        PlacedBox { low: [x, y, z], high: [x + 10.0, y + 10.0, z + 5.0] }
    }

    #[test]
    fn a_country_has_no_strays_and_absurd_places_are_strays() {
        let mut places = PlaceHistogram::default();
        (0..1000).for_each(|i| places.add([f64::from(i) * 1000.0 + 4e5, 5e6, 3.0]));
        let middle = places.median_m();
        assert!((middle[0] - 9e5).abs() < 2000.0 && (middle[1] - 5e6).abs() < 1024.0, "{middle:?}");
        for near in [[4e5, 5e6, 0.0], [1.4e6, 5e6, 8848.0], [3e6, 3e6, -100.0]] {
            assert_eq!(stray_distance_m(middle, house(near)), None, "{near:?}");
        }
        for far in [[0.0; 3], [4.3, 52.0, 3.0], [9e5, 5e6, 3e5], [9e5, 1e6, 0.0]] {
            assert!(stray_distance_m(middle, house(far)).is_some(), "{far:?}");
        }
        // A local system has its city at the origin.
        assert_eq!(stray_distance_m([500.0, 500.0, 0.0], house([0.0; 3])), None);
    }

    #[test]
    fn few_objects_that_make_the_city_wide_are_found_and_towns_are_not() {
        let mut places = PlaceHistogram::default();
        (0..5000).for_each(|i| places.add([4e5 + f64::from(i % 100) * 50.0, 5e6 + f64::from(i / 100) * 50.0, 0.0]));
        assert_eq!(Outskirts::of(&places), None);
        (0..4).for_each(|i| places.add([9e5 + f64::from(i), 5e6, 0.0]));
        let found = Outskirts::of(&places).unwrap();
        let km = found.distance_m([9e5, 5e6, 0.0]).unwrap() / 1000.0;
        assert!((490.0..500.0).contains(&km), "{km} km");
        assert_eq!(found.distance_m([402_000.0, 5_001_000.0, 0.0]), None);
        // Another town of many objects is a part of the country.
        (0..4).for_each(|i| places.add([9e5, 5e6 + f64::from(i), 0.0]));
        assert_eq!(Outskirts::of(&places), None);
    }

    #[test]
    fn medians_do_not_depend_on_the_order() {
        let places = [[0.0, 1.0, 2.0], [-5e4, 7e4, 0.0], [1e9, -1e9, 1e9], [12.0, 13.0, 14.0]];
        let of = |order: [usize; 4]| {
            let mut all = PlaceHistogram::default();
            order.iter().for_each(|i| all.add(places[*i]));
            all
        };
        assert_eq!(of([0, 1, 2, 3]), of([3, 1, 0, 2]));
        assert_eq!(PlaceHistogram::default().median_m(), [0.0; 3]);
    }
}
