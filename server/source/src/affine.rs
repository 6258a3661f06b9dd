//! Matrices that place templates, as files write them: 16 numbers, row by row.

/// Determinants of smaller matrices flatten a template: a part of the product of the lengths of the rows.
const FLAT: f64 = 1e-9;

/// Kind of a matrix in a report that is read column by column.
pub const TRANSPOSED: &str = "transformationMatrix without a last row of 0 0 0 1, taken column by column";

/// Rows of a matrix that turns, scales and moves.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Affine {
    pub rows: [[f64; 4]; 3],
    /// Whether it was written column by column.
    pub is_transposed: bool,
}

impl Affine {
    /// Positions as they are.
    pub const IDENTITY: Self =
        Self { rows: [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]], is_transposed: false };

    /// Fails with the reason if the numbers are no such matrix.
    pub fn new(numbers: &[f64]) -> Result<Self, String> {
        let matrix: [f64; 16] = numbers.try_into().map_err(|_| format!("{} numbers instead of 16", numbers.len()))?;
        if !matrix.iter().all(|number| number.is_finite()) {
            return Err("a number is not finite".to_owned());
        }
        let by_row = |row: usize, column: usize| matrix[4 * row + column];
        let by_column = |row: usize, column: usize| matrix[4 * column + row];
        let is_affine = |at: &dyn Fn(usize, usize) -> f64| (0..3).all(|column| at(3, column) == 0.0) && at(3, 3) != 0.0;
        let rows = |at: &dyn Fn(usize, usize) -> f64| {
            [0, 1, 2].map(|row| [0, 1, 2, 3].map(|column| at(row, column) / at(3, 3)))
        };
        let (rows, is_transposed) = match (is_affine(&by_row), is_affine(&by_column)) {
            (true, _) => (rows(&by_row), false),
            (false, true) => (rows(&by_column), true),
            (false, false) => return Err("its last row is not 0 0 0 1".to_owned()),
        };
        let [a, b, c] = rows.map(|[x, y, z, _]| [x, y, z]);
        let determinant = a[0] * (b[1] * c[2] - b[2] * c[1]) - a[1] * (b[0] * c[2] - b[2] * c[0])
            + a[2] * (b[0] * c[1] - b[1] * c[0]);
        let length = |v: [f64; 3]| libm::sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
        let size = length(a) * length(b) * length(c);
        // Also if the size is too large to be a number.
        if size > 0.0 && determinant.abs() > FLAT * size && size.is_finite() {
            Ok(Self { rows, is_transposed })
        } else {
            Err("it flattens the template".to_owned())
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TURNED: [f64; 16] = [0.0, -1.0, 0.0, 10.0, 1.0, 0.0, 0.0, 20.0, 0.0, 0.0, 3.0, 0.0, 0.0, 0.0, 0.0, 1.0];

    #[test]
    fn matrices_by_row_and_by_column_are_read() {
        let rows = [[0.0, -1.0, 0.0, 10.0], [1.0, 0.0, 0.0, 20.0], [0.0, 0.0, 3.0, 0.0]];
        assert_eq!(Affine::new(&TURNED), Ok(Affine { rows, is_transposed: false }));
        let columns: Vec<f64> = (0..16).map(|i| TURNED[4 * (i % 4) + i / 4]).collect();
        assert_eq!(Affine::new(&columns), Ok(Affine { rows, is_transposed: true }));
        assert_eq!(Affine::new(&TURNED.map(|number| 2.0 * number)).unwrap().rows, rows);
    }

    #[test]
    fn other_numbers_say_what_is_wrong() {
        let reason = |numbers: &[f64]| Affine::new(numbers).unwrap_err();
        assert_eq!(reason(&TURNED[..12]), "12 numbers instead of 16");
        assert_eq!(reason(&[f64::NAN; 16]), "a number is not finite");
        assert_eq!(reason(&[1.0; 16]), "its last row is not 0 0 0 1");
        for changed in [10, 1] {
            let mut flat = TURNED;
            flat[changed] = 0.0;
            assert_eq!(reason(&flat), "it flattens the template");
        }
    }
}
