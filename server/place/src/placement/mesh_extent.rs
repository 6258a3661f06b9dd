//! The extent of a mesh, by which it is told that its coordinates are degrees although its format has metres, or that they are metres
//! from the centre of the Earth.

use super::first_shape::FirstShape;
use std::ops::RangeInclusive;

/// A mesh that is wider, in its units, is not in degrees: 0.2 degrees are 20 km.
const MAX_SIDE: f64 = 0.2;
/// One that is narrower and lies far from its origin is no model in metres, even if it is flat.
const SMALL_SIDE: f64 = 0.01;
/// Least height, and least distance from the origin, as a multiple of the width. In degrees, a width is a small number; heights are in
/// metres.
const LEAST_HEIGHT: f64 = 50.0;
const LEAST_DISTANCE: f64 = 100.0;
/// The same for a mesh that is taken as one in degrees after a look at its first object only: no pole or strip of a wall in metres is
/// so thin.
const CERTAIN_HEIGHT: f64 = 100.0;
const CERTAIN_DISTANCE: f64 = 1000.0;

/// Distances of the Earth's surface from its centre, with mountains and trenches.
const EARTH_M: RangeInclusive<f64> = 6_340_000.0..=6_390_000.0;
/// A mesh that is wider is not one of a city.
const MAX_CITY_M: f64 = 200_000.0;

/// Box of a mesh in coordinates towards east, north and up.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MeshExtent {
    low: [f64; 3],
    high: [f64; 3],
}

impl MeshExtent {
    /// The box of positions; `None` if none has three numbers.
    pub fn of(positions: impl Iterator<Item = [f64; 3]>) -> Option<Self> {
        let finite = positions.filter(|position| position.iter().all(|c| c.is_finite()));
        finite.map(|position| Self { low: position, high: position }).reduce(Self::join)
    }

    /// The box of two.
    pub fn join(self, other: Self) -> Self {
        Self {
            low: std::array::from_fn(|axis| self.low[axis].min(other.low[axis])),
            high: std::array::from_fn(|axis| self.high[axis].max(other.high[axis])),
        }
    }

    /// As the first shape of its source.
    pub fn first_shape(&self) -> FirstShape {
        FirstShape::at([self.low[0], self.low[1]], Some([0, 1].map(|axis: usize| self.high[axis] - self.low[axis])))
    }

    /// Whether the coordinates are longitude and latitude, as far as can be told of a whole mesh.
    pub fn looks_like_degrees(&self) -> bool {
        let [side, height, distance] = self.measures();
        let is_upright = side < MAX_SIDE && height > LEAST_HEIGHT * side;
        let is_small = side < SMALL_SIDE && distance > 1.0;
        (is_upright || is_small) && distance > LEAST_DISTANCE * side && self.first_shape().looks_like_degrees()
    }

    /// Whether the coordinates are certainly longitude and latitude, and heights metres, if the extent is that of a single object.
    pub fn is_certainly_in_degrees(&self) -> bool {
        let [side, height, distance] = self.measures();
        let is_upright = side < SMALL_SIDE && height > CERTAIN_HEIGHT * side;
        is_upright && distance > CERTAIN_DISTANCE * side && self.looks_like_degrees()
    }

    /// Whether the coordinates are certainly metres from the centre of the Earth. No map has such heights.
    pub fn is_certainly_geocentric(&self) -> bool {
        let middle = self.middle();
        let size = std::array::from_fn(|axis| self.high[axis] - self.low[axis]);
        EARTH_M.contains(&length(middle)) && length(size) < MAX_CITY_M && middle[2].abs() > MAX_CITY_M
    }

    /// The middle of the box.
    pub fn middle(&self) -> [f64; 3] {
        std::array::from_fn(|axis| (self.low[axis] + self.high[axis]) / 2.0)
    }

    /// For a warning: from which coordinates to which.
    pub fn text(&self) -> String {
        let ([west, south, _], [east, north, _]) = (self.low, self.high);
        format!("coordinates from {west}, {south} to {east}, {north}")
    }

    /// Longer side on the map, height, and distance of the origin along an axis.
    fn measures(&self) -> [f64; 3] {
        let size = |axis: usize| self.high[axis] - self.low[axis];
        [size(0).max(size(1)), size(2), self.low[0].abs().max(self.low[1].abs())]
    }
}

fn length([x, y, z]: [f64; 3]) -> f64 {
    libm::hypot(libm::hypot(x, y), z)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn meshes_around_the_centre_of_the_earth_are_told_from_those_on_a_map() {
        let is_geocentric = |[x, y, z]: [f64; 3], size: f64| {
            let corners = [[x, y, z], [x + size, y + size, z + size]];
            MeshExtent::of(corners.into_iter()).unwrap().is_certainly_geocentric()
        };
        assert!(is_geocentric([4_177_000.0, 855_000.0, 4_727_700.0], 20.0), "Munich");
        assert!(is_geocentric([-4_646_000.0, 2_553_000.0, -3_534_000.0], 5_000.0), "Sydney");
        assert!(!is_geocentric([691_000.0, 5_334_000.0, 520.0], 20.0), "UTM");
        assert!(!is_geocentric([3_500_000.0, 5_334_000.0, 520.0], 5_000.0), "as far from the origin, on a map");
        assert!(!is_geocentric([4_177_000.0, 855_000.0, 4_727_700.0], 900_000.0), "a country");
    }

    #[test]
    fn meshes_in_degrees_are_told_from_small_ones_in_metres() {
        let block = |[x, y]: [f64; 2], [width, depth, height]: [f64; 3]| {
            MeshExtent::of([[x, y, 0.0], [x + width, y + depth, height]].into_iter()).unwrap()
        };
        let of = |place, size| {
            let extent = block(place, size);
            (extent.looks_like_degrees(), extent.is_certainly_in_degrees())
        };
        assert_eq!(of([4.36, 52.01], [1e-4, 8e-5, 9.0]), (true, true), "a house");
        assert_eq!(of([-122.5, 37.7], [0.05, 0.04, 60.0]), (true, false), "a city");
        assert_eq!(of([4.36, 52.01], [1e-4, 8e-5, 0.0]), (true, false), "a plan");
        assert_eq!(
            of([12.0, 40.0], [0.15, 0.15, 8.0]),
            (true, false),
            "a pole in metres, of which nothing else is known"
        );
        for (place, size) in [
            ([0.0, 0.0], [1e-4, 1e-4, 9.0]),
            ([12.0, 40.0], [10.0, 12.0, 9.0]),
            ([0.05, 0.02], [0.08, 0.07, 0.2]),
            ([85_000.0, 446_000.0], [0.005, 0.005, 9.0]),
        ] {
            assert_eq!(of(place, size), (false, false), "{place:?} {size:?}");
        }
        assert_eq!(MeshExtent::of([[f64::NAN; 3]].into_iter()), None);
    }
}
