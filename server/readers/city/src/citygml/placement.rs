//! Placement of implicit geometry: one template of surfaces at many places.

use super::coordinates::numbers;
use crate::degrees::{TemplatePlace, degrees_per_metre, is_latitude_first};
use insula_source::affine::Affine;

/// A matrix and a reference point that differ by less than this part of their size name the same place twice.
const SAME_PLACE: f64 = 1e-4;
/// Shorter translations of a matrix are offsets within the template.
const FAR_UNITS: f64 = 1000.0;

impl TemplatePlace {
    /// `srs` names the coordinate system of the reference point.
    pub(super) fn new(mut matrix: Affine, reference: Option<[f64; 3]>, srs: Option<&str>) -> Self {
        let anchor = reference.unwrap_or([0.0; 3]);
        if is_same_place(&matrix.rows, anchor) {
            for row in &mut matrix.rows {
                row[3] = 0.0;
            }
        }
        let is_degrees = reference.is_some() && srs.is_some_and(is_latitude_first);
        Self { matrix, anchor, degrees_per_metre: is_degrees.then(|| degrees_per_metre(anchor[0])) }
    }

    /// Whether the placement turns surfaces inside out.
    pub(super) fn is_mirrored(&self) -> bool {
        let [a, b, c] = self.matrix.rows.map(|[x, y, z, _]| [x, y, z]);
        let determinant = a[0] * (b[1] * c[2] - b[2] * c[1]) - a[1] * (b[0] * c[2] - b[2] * c[0])
            + a[2] * (b[0] * c[1] - b[1] * c[0]);
        // North comes first in systems in degrees, which mirrors all positions alike.
        determinant < 0.0
    }
}

/// The matrix of a text. Fails with the reason if it is none.
pub(super) fn matrix_of(text: &str) -> Result<Affine, String> {
    // More numbers than a matrix has are as bad as fewer.
    Affine::new(&numbers(text).take(17).collect::<Vec<f64>>())
}

/// Whether the matrix moves the template to the reference point, so that both together would move it twice as far.
fn is_same_place(rows: &[[f64; 4]; 3], reference: [f64; 3]) -> bool {
    let size = reference[0].abs().max(reference[1].abs());
    let difference = (rows[0][3] - reference[0]).abs().max((rows[1][3] - reference[1]).abs());
    size > FAR_UNITS && difference <= size * SAME_PLACE
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_place::crs::is_geographic;

    const IDENTITY_AT: &str = "1 0 0 689778 0 1 0 5333790 0 0 1 0 0 0 0 1";

    fn placement(matrix: &str, reference: Option<[f64; 3]>) -> TemplatePlace {
        TemplatePlace::new(matrix_of(matrix).unwrap(), reference, None)
    }

    #[test]
    fn matrix_then_reference_point() {
        let turned = placement("0 -1 0 2  1 0 0 0  0 0 1 3  0 0 0 1", Some([100.0, 200.0, 10.0]));
        assert_eq!(turned.apply([1.0, 0.0, 0.0]), [102.0, 201.0, 13.0]);
        assert!(!turned.is_mirrored());
        assert!(placement("-1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1", None).is_mirrored());
        let identity = TemplatePlace::new(Affine::IDENTITY, None, None);
        assert_eq!(identity.apply([1.0, 2.0, 3.0]), [1.0, 2.0, 3.0]);
        for text in ["1 2 x", "", "1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1 1", "1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 x"] {
            assert!(matrix_of(text).is_err(), "{text}");
        }
    }

    #[test]
    fn translation_that_is_given_twice_counts_once() {
        let twice = placement(IDENTITY_AT, Some([689778.0, 5333790.0, 5.0]));
        assert_eq!(twice.apply([1.0, 1.0, 1.0]), [689779.0, 5333791.0, 6.0]);
        let once = placement(IDENTITY_AT, None);
        assert_eq!(once.apply([0.0; 3]), [689778.0, 5333790.0, 0.0]);
    }

    #[test]
    fn templates_in_degrees_are_in_metres() {
        let srs = Some("http://www.opengis.net/def/crs/EPSG/0/6697");
        let placed =
            TemplatePlace::new(Affine::IDENTITY, Some([60.0, 139.0, 2.0]), srs).apply([111.600_003, 111.412_287, 1.0]);
        let expected = [60.001, 139.002, 3.0];
        for (value, expected) in placed.iter().zip(expected) {
            assert!((value - expected).abs() < 1e-9, "{placed:?}");
        }
        assert!(!is_geographic("urn:ogc:def:crs,crs:EPSG:6.12:25832,crs:EPSG:6.12:5783"));
        assert!(is_geographic("urn:ogc:def:crs:EPSG:6.12:4326") && !is_geographic("urn:adv:crs:ETRS89_UTM32"));
    }
}
