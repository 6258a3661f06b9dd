//! Where pixels are on the map.

use super::error::RasterError;

/// Larger coordinates are taken for damage.
const MAX_COORDINATE: f64 = 1e12;

/// Places the centres of pixels: `origin + x * column + y * row` in the raster's coordinate system, east (or longitude)
/// first.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct GeoPlace {
    /// Centre of the top left pixel.
    pub(crate) origin: [f64; 2],
    /// From a pixel to the next one to the right.
    pub(crate) column: [f64; 2],
    /// From a pixel to the one below it.
    pub(crate) row: [f64; 2],
}

impl GeoPlace {
    /// `None` if the numbers are not finite, too large, or place all pixels on a line.
    pub(super) fn checked(origin: [f64; 2], column: [f64; 2], row: [f64; 2]) -> Option<Self> {
        let numbers = [origin, column, row];
        let is_valid = numbers.as_flattened().iter().all(|number| number.abs() <= MAX_COORDINATE);
        let area = column[0] * row[1] - column[1] * row[0];
        (is_valid && area.abs() > 0.0).then_some(Self { origin, column, row })
    }

    /// The same with a place of the corner of the top left pixel, in place of its centre.
    pub(super) fn from_corner(corner: [f64; 2], column: [f64; 2], row: [f64; 2]) -> Option<Self> {
        let origin = [0, 1].map(|axis| corner[axis] + (column[axis] + row[axis]) / 2.0);
        Self::checked(origin, column, row)
    }

    /// Reads a world file (`.tfw`, `.jgw`, `.pgw`, `.j2w`, `.wld`): six numbers, a line each.
    pub(crate) fn from_world_file(text: &str) -> Result<Self, RasterError> {
        let damaged = || RasterError::damaged("its world file has not six valid numbers");
        let words = text.trim_start_matches('\u{feff}').split_whitespace().take(6);
        let numbers: Vec<f64> = words.filter_map(|word| word.replace(',', ".").parse().ok()).collect();
        let [x_of_column, y_of_column, x_of_row, y_of_row, x, y] = numbers[..] else {
            return Err(damaged());
        };
        Self::checked([x, y], [x_of_column, y_of_column], [x_of_row, y_of_row]).ok_or_else(damaged)
    }

    /// Position of a place among the pixels, whose centres are at whole numbers.
    pub(crate) fn position(&self, x: f64, y: f64) -> [f64; 2] {
        [0, 1].map(|axis| self.origin[axis] + x * self.column[axis] + y * self.row[axis])
    }

    /// The place among the pixels of a position: the inverse of [`Self::position`].
    #[cfg(test)]
    pub(crate) fn pixel(&self, position: [f64; 2]) -> [f64; 2] {
        let ([a, d], [b, e]) = (self.column, self.row);
        let (x, y) = (position[0] - self.origin[0], position[1] - self.origin[1]);
        let area = a * e - b * d;
        [(x * e - b * y) / area, (a * y - x * d) / area]
    }
}
