//! The first shape of a source, by which its system is checked or guessed.

use super::MAX_COORDINATE_M;

/// A feature in degrees is at most this large; one in metres is hardly ever smaller.
const MAX_DEGREES: f64 = 0.2;
/// Positions of a shape that are looked at.
const MAX_POSITIONS: usize = 256;

/// The first shape of a source in its coordinates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FirstShape {
    /// Of its first corner.
    pub position: [f64; 2],
    /// The third coordinate there, which only positions from the centre of the Earth need; else 0.
    pub(super) third: f64,
    low: [f64; 2],
    /// `None` if it is not known.
    size: Option<[f64; 2]>,
}

impl FirstShape {
    /// The shape of positions; `None` if the first are no numbers, or none of any place.
    pub fn of(positions: impl Iterator<Item = [f64; 2]>) -> Option<Self> {
        let mut found: Option<Self> = None;
        let is_possible = |position: &[f64; 2]| position.iter().all(|c| c.abs() <= MAX_COORDINATE_M);
        for [x, y] in positions.take(MAX_POSITIONS).filter(is_possible) {
            let at = Self::at([x, y], Some([0.0; 2]));
            let shape = found.get_or_insert(at);
            let [width, height] = shape.size.unwrap_or_default();
            let high = [shape.low[0] + width, shape.low[1] + height];
            shape.low = [shape.low[0].min(x), shape.low[1].min(y)];
            shape.size = Some([high[0].max(x) - shape.low[0], high[1].max(y) - shape.low[1]]);
        }
        found
    }

    /// A shape of a size, if it is known, at a position.
    pub fn at([x, y]: [f64; 2], size: Option<[f64; 2]>) -> Self {
        Self { position: [x, y], third: 0.0, low: [x, y], size }
    }

    /// Whether it begins at the origin, which tells nothing.
    pub(super) fn is_origin(&self) -> bool {
        self.position == [0.0; 2]
    }

    /// Whether the coordinates can be longitude and latitude, or the other way round. A point at the origin of a plan in
    /// metres is no place at sea.
    pub fn looks_like_degrees(&self) -> bool {
        let [x, y] = self.low.map(f64::abs);
        let is_on_globe = is_on_globe([x, y]) || is_on_globe([y, x]);
        let is_small = self.size.is_some_and(|[width, height]| {
            let width = width_deg([self.low[0], self.low[0] + width]);
            width < MAX_DEGREES && height < MAX_DEGREES
        });
        is_on_globe && is_small && self.low != [0.0; 2]
    }

    /// Whether only the second coordinate can be the longitude.
    pub(super) fn is_latitude_first(&self) -> bool {
        self.low[1].abs() > 90.0
    }
}

/// Width of a shape by its lowest and highest longitude. Those of one that crosses the antimeridian are nearly a turn apart.
pub fn width_deg([west, east]: [f64; 2]) -> f64 {
    let width = east - west;
    if west >= -180.0 && east <= 180.0 && width > 359.0 { 360.0 - width } else { width }
}

/// Whether degrees are a longitude (up to one turn, as in files of 0 to 360 degrees) and a latitude.
pub fn is_on_globe([longitude_deg, latitude_deg]: [f64; 2]) -> bool {
    longitude_deg.abs() <= 360.0 && latitude_deg.abs() <= 90.0
}

impl From<[f64; 3]> for FirstShape {
    fn from([x, y, z]: [f64; 3]) -> Self {
        Self { third: z, ..Self::at([x, y], None) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn small_shapes_on_the_globe_look_like_degrees() {
        let shape = |positions: &[[f64; 2]]| FirstShape::of(positions.iter().copied()).unwrap();
        let house = [[139.7, 35.6], [139.7001, 35.6], [139.7001, 35.6001]];
        assert!(shape(&house).looks_like_degrees() && !shape(&house).is_latitude_first());
        let turned = house.map(|[x, y]| [y, x]);
        assert!(shape(&turned).looks_like_degrees() && shape(&turned).is_latitude_first());
        assert!(shape(&house.map(|[x, y]| [x + 180.0, y])).looks_like_degrees(), "of 0 to 360 degrees");
        assert!(!shape(&house.map(|[x, y]| [x + 240.0, y])).looks_like_degrees());
        assert!(shape(&[[179.9999, -16.8], [-179.9999, -16.8001]]).looks_like_degrees(), "across the antimeridian");
        assert!(!shape(&[[10.0, 10.0], [20.0, 20.0]]).looks_like_degrees());
        assert!(!shape(&[[0.0, 0.0], [0.1, 0.1]]).looks_like_degrees());
        assert!(!shape(&[[85_000.0, 446_000.0]]).looks_like_degrees());
        assert!(!FirstShape::from([4.0, 52.0, 0.0]).looks_like_degrees(), "its size is not known");
        assert_eq!(FirstShape::of([[f64::NAN, 1.0], [1e300, 2.0]].into_iter()), None);
    }
}
