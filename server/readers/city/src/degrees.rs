//! Places of templates. In systems in degrees they are in metres, and placed at a latitude and a longitude.

use insula_place::crs::is_geographic;
pub(crate) use insula_place::placement::degrees_per_metre;
use insula_source::affine::Affine;

/// Whether a coordinate system is in degrees with latitude first.
pub(crate) fn is_latitude_first(system: &str) -> bool {
    is_geographic(system) && !system.contains("CRS84")
}

/// How a template is moved to its place: by a matrix, then the anchor is added.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct TemplatePlace {
    pub(crate) matrix: Affine,
    pub(crate) anchor: [f64; 3],
    /// Of a metre to the east and to the north, in a system in degrees; the first axis is north then.
    pub(crate) degrees_per_metre: Option<[f64; 2]>,
}

impl TemplatePlace {
    /// Position of a template's point.
    pub(crate) fn apply(&self, [x, y, z]: [f64; 3]) -> [f64; 3] {
        let [east, north, up] = self.matrix.rows.map(|[a, b, c, offset]| a * x + b * y + c * z + offset);
        let [first, second, height] = self.anchor;
        match self.degrees_per_metre {
            Some([per_east, per_north]) => [first + north * per_north, second + east * per_east, height + up],
            None => [first + east, second + north, height + up],
        }
    }
}
