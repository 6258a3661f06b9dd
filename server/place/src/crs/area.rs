//! Areas of use of coordinate systems.

/// An area between two meridians and two parallels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Area {
    /// West, south, east and north in degrees; east is more than 180 if the area crosses the antimeridian.
    degrees: [f64; 4],
}

impl Area {
    /// The area of west, south, east and north in degrees.
    pub fn new(degrees: [f64; 4]) -> Self {
        Self { degrees }
    }

    /// Whether it is that of a continent, with seas.
    pub fn is_wide(self) -> bool {
        const WIDE_DEG: f64 = 20.0;
        let [west, south, east, north] = self.degrees;
        east - west > WIDE_DEG && north - south > WIDE_DEG
    }

    /// Whether a longitude and latitude is in it, or at most `reach_deg` outside of it.
    pub fn contains(self, [lon, lat]: [f64; 2], reach_deg: f64) -> bool {
        let [west, south, east, north] = self.degrees;
        let is_between = |lon: f64| (west - reach_deg..=east + reach_deg).contains(&lon);
        let is_in_turn = [lon - 360.0, lon, lon + 360.0].into_iter().any(is_between);
        is_in_turn && (south - reach_deg..=north + reach_deg).contains(&lat)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn areas_may_cross_the_antimeridian() {
        let fiji = Area::new([176.0, -21.0, 182.0, -12.0]);
        assert!(fiji.contains([179.0, -18.0], 0.0) && fiji.contains([-179.0, -18.0], 0.0));
        assert!(!fiji.contains([-177.0, -18.0], 0.5) && fiji.contains([-177.0, -18.0], 1.5));
        assert!(!fiji.contains([179.0, 18.0], 1.0));
    }
}
