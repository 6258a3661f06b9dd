//! Where tiles are: a frame of metres at the city's middle, its place on Earth, and where nodes lie in it.
//!
//! The frame's axes are those of the city's own coordinate system there, so nodes are squares along them. A projected coordinate
//! system is no plane on Earth: each node is placed by the projection around its own middle.

use crate::matrix::{Matrix, add, cross, dot, length, subtract, times};
use insula_protocol::manifest::GeoLocation;
use insula_protocol::{Manifest, TileId};

/// From a world position in metres to one from the centre of the Earth (EPSG:4978). `None` if the coordinate system is unknown or
/// does not reach there.
pub type ToGeocentric<'a> = &'a dyn Fn([f64; 3]) -> Option<[f64; 3]>;

/// Semi-major axis and squared eccentricity of the WGS84 ellipsoid.
const EARTH_RADIUS_M: f64 = 6_378_137.0;
const ECCENTRICITY_SQUARED: f64 = 6.694_379_990_141_317e-3;
/// Bounding boxes are larger than nodes by this part of their side, so that rounding to f32 does not cut anything.
const MARGIN: f64 = 1e-4;
/// What the Earth and the grid curve between points that are tested, in heights of an arc of the Earth over the node's side. Mercator's
/// scale, which changes most of all, changes by less than twice that much up to 60 degrees of latitude.
const CURVATURE: f64 = 4.0;
/// Scales of a coordinate system: Mercator's at 84 degrees of latitude is a tenth.
const SCALES: std::ops::Range<f64> = 0.1..10.0;
/// Distance over which the vertical axis is measured.
const RISE_M: f64 = 100.0;

pub(super) struct Frame<'a> {
    manifest: &'a Manifest,
    to_geocentric: ToGeocentric<'a>,
    /// World position of the origin.
    middle: [f64; 3],
    /// From the frame to the centre of the Earth; `None` if the city's place is unknown.
    pub(super) to_earth: Option<Matrix>,
    /// The inverse, if positions come from the projection.
    from_earth: Option<Matrix>,
}

impl<'a> Frame<'a> {
    pub(super) fn new(manifest: &'a Manifest, to_geocentric: ToGeocentric<'a>) -> Self {
        let [min, max] = manifest.bounds;
        let middle = [0.5 * (min[0] + max[0]), 0.5 * (min[1] + max[1]), manifest.ground_z_m];
        let projected = rigid(&linearise(to_geocentric, middle, 1.0));
        let to_earth = projected.or_else(|| {
            let [focus_min, focus_max] = manifest.focus;
            let focus = [0, 1].map(|k| 0.5 * (focus_min[k] + focus_max[k]));
            let at_focus = at_location(manifest.location.as_ref()?, manifest.ground_z_m);
            let origin = at_focus.map([middle[0] - focus[0], middle[1] - focus[1], 0.0]);
            Some(Matrix { origin, ..at_focus })
        });
        let from_earth = projected.map(|to_earth| to_earth.inverse_rigid());
        Self { manifest, to_geocentric, middle, to_earth, from_earth }
    }

    /// A world position in the frame.
    fn position(&self, world: [f64; 3]) -> [f64; 3] {
        let projected = self.from_earth.and_then(|from_earth| Some(from_earth.map((self.to_geocentric)(world)?)));
        projected.unwrap_or_else(|| subtract(world, self.middle))
    }

    /// From metres from a node's south-west corner at the city's height zero to the frame.
    pub(super) fn place(&self, node: TileId) -> Matrix {
        let corner = self.manifest.node_corner(node);
        let half = 0.5 * self.manifest.node_side_m(node.level());
        let middle = add(corner, [half, half, 0.0]);
        let position = |world: [f64; 3]| Some(self.position(world));
        let around = linearise(&position, middle, half)
            .and_then(perpendicular)
            .unwrap_or(Matrix::translation(self.position(middle)));
        Matrix::translation([-half, -half, 0.0]).then(&around)
    }

    /// The bounding box of a node between two heights, in metres above the city's height zero: centre and half axes, as in 3D Tiles
    /// 1.1, section "Box". It contains those of the node's children between the same heights.
    pub(super) fn bounding_box(&self, node: TileId, heights: [f64; 2]) -> [f64; 12] {
        let corner = self.manifest.node_corner(node);
        let side = self.manifest.node_side_m(node.level());
        let place = self.place(node);
        let (mut min, mut max) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        for i in 0..18 {
            let share = [i % 3, i / 3 % 3].map(|step: usize| 0.5 * side * step as f64);
            let local = [share[0], share[1], heights[i / 9]];
            for p in [self.position(add(corner, local)), place.map(local)] {
                min = [0, 1, 2].map(|k| min[k].min(p[k]));
                max = [0, 1, 2].map(|k| max[k].max(p[k]));
            }
        }
        let curved = if self.from_earth.is_some() { CURVATURE * side * side / (8.0 * EARTH_RADIUS_M) } else { 0.0 };
        let centre = [0, 1, 2].map(|k| 0.5 * (min[k] + max[k]));
        let half = [0, 1, 2].map(|k| 0.5 * (max[k] - min[k]) + curved + MARGIN * side);
        let [x, y, z] = half;
        [centre[0], centre[1], centre[2], x, 0.0, 0.0, 0.0, y, 0.0, 0.0, 0.0, z]
    }
}

/// The map from offsets around a position to where they are, over `reach` metres to each side.
fn linearise(to: ToGeocentric<'_>, middle: [f64; 3], reach: f64) -> Option<Matrix> {
    let origin = to(middle)?;
    let axis = |k: usize, reach: f64| {
        let mut step = [0.0; 3];
        step[k] = reach;
        let across = subtract(to(add(middle, step))?, to(subtract(middle, step))?);
        Some(times(across, 0.5 / reach))
    };
    let matrix = Matrix { axes: [axis(0, reach)?, axis(1, reach)?, axis(2, RISE_M)?], origin };
    let is_usable = matrix.axes.iter().all(|axis| SCALES.contains(&length(*axis)));
    is_usable.then_some(matrix)
}

/// The map with perpendicular axes of the same lengths: up stays, then north is turned as little as possible. What projections have of
/// shear is far below the errors of tiles, and glTF allows none.
fn perpendicular(matrix: Matrix) -> Option<Matrix> {
    let [x, y, z] = matrix.axes;
    let up = normalised(z)?;
    let north = normalised(subtract(y, times(up, dot(y, up))))?;
    let east = cross(north, up);
    Some(Matrix { axes: [times(east, length(x)), times(north, length(y)), times(up, length(z))], ..matrix })
}

/// The map with perpendicular axes of length 1.
fn rigid(matrix: &Option<Matrix>) -> Option<Matrix> {
    let matrix = perpendicular((*matrix)?)?;
    let [x, y, z] = matrix.axes.map(normalised);
    Some(Matrix { axes: [x?, y?, z?], ..matrix })
}

fn normalised(v: [f64; 3]) -> Option<[f64; 3]> {
    let length = length(v);
    (length > 0.0 && length.is_finite()).then(|| times(v, 1.0 / length))
}

/// East, north and up of the city's grid at a place on the WGS84 ellipsoid.
fn at_location(location: &GeoLocation, height_m: f64) -> Matrix {
    let (latitude, longitude) = (location.latitude_deg.to_radians(), location.longitude_deg.to_radians());
    let ((sin_lat, cos_lat), (sin_lon, cos_lon)) = (latitude.sin_cos(), longitude.sin_cos());
    let up = [cos_lat * cos_lon, cos_lat * sin_lon, sin_lat];
    let east = [-sin_lon, cos_lon, 0.0];
    let north = cross(up, east);
    // True north is clockwise of the grid's.
    let (sin, cos) = location.north_deg.to_radians().sin_cos();
    let grid_north = subtract(times(north, cos), times(east, sin));
    let radius = EARTH_RADIUS_M / (1.0 - ECCENTRICITY_SQUARED * sin_lat * sin_lat).sqrt();
    let flat = (radius + height_m) * cos_lat;
    let z = (radius * (1.0 - ECCENTRICITY_SQUARED) + height_m) * sin_lat;
    Matrix { axes: [cross(grid_north, up), grid_north, up], origin: [flat * cos_lon, flat * sin_lon, z] }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::glb::test_city::manifest;

    /// Mercator's projection of a sphere around 45 degrees of latitude, with its grid rotated by 2 degrees.
    fn to_geocentric([x, y, z]: [f64; 3]) -> Option<[f64; 3]> {
        let (sin, cos) = 2f64.to_radians().sin_cos();
        let scale = EARTH_RADIUS_M * 45f64.to_radians().cos();
        let (lon, north) = ((x * cos - y * sin) / scale, (x * sin + y * cos) / scale);
        let lat = (45f64.to_radians().tan().asinh() + north).sinh().atan();
        let r = EARTH_RADIUS_M + z;
        Some([r * lat.cos() * lon.cos(), r * lat.cos() * lon.sin(), r * lat.sin()])
    }

    fn frames(manifest: &Manifest) -> [Frame<'_>; 2] {
        [Frame::new(manifest, &to_geocentric), Frame::new(manifest, &|_| None)]
    }

    #[test]
    fn the_frame_follows_the_grid_at_the_middle_of_the_city() {
        let manifest = manifest(3, 100.0);
        let to_earth = Frame::new(&manifest, &to_geocentric).to_earth.unwrap();
        for (k, axis) in to_earth.axes.iter().enumerate() {
            assert!((length(*axis) - 1.0).abs() < 1e-9);
            assert!(dot(*axis, to_earth.axes[(k + 1) % 3]).abs() < 1e-9);
        }
        let [min, max] = manifest.bounds;
        let near = [0.5 * (min[0] + max[0]) + 10.0, 0.5 * (min[1] + max[1]) + 20.0, manifest.ground_z_m + 5.0];
        let off = length(subtract(to_earth.map([10.0, 20.0, 5.0]), to_geocentric(near).unwrap()));
        // The grid's scale is wrong by 0.8% there, 50 km from where it is exact.
        assert!(off < 0.2, "{off}");
    }

    #[test]
    fn nodes_are_where_the_projection_has_them() {
        // 51 km wide: curved by 50 m.
        let manifest = manifest(3, 100.0);
        let frame = Frame::new(&manifest, &to_geocentric);
        for (level, limit_m) in [(0, 160.0), (1, 40.0), (3, 2.5)] {
            let node = TileId::new(level, 0, 0).unwrap();
            let local = [0.0, 0.0, 50.0];
            let world = add(manifest.node_corner(node), local);
            let off = length(subtract(frame.place(node).map(local), frame.position(world)));
            assert!(off < limit_m, "level {level}: {off}");
        }
    }

    #[test]
    fn boxes_contain_those_of_children() {
        let manifest = manifest(4, 100.0);
        for frame in frames(&manifest) {
            let span = |node: TileId| {
                let b = frame.bounding_box(node, [-3.0, 60.0]);
                [[b[0] - b[3], b[1] - b[7], b[2] - b[11]], [b[0] + b[3], b[1] + b[7], b[2] + b[11]]]
            };
            let mut nodes = vec![TileId::ROOT];
            while let Some(node) = nodes.pop().filter(|node| node.level() < 4) {
                let [min, max] = span(node);
                for child in node.children() {
                    let [low, high] = span(child);
                    assert!((0..3).all(|k| min[k] <= low[k] && high[k] <= max[k]), "{node} {child}");
                    nodes.push(child);
                }
            }
        }
    }

    #[test]
    fn a_known_place_suffices_without_a_projection() {
        let location = GeoLocation { latitude_deg: 0.0, longitude_deg: 90.0, north_deg: 90.0 };
        let matrix = at_location(&location, 100.0);
        let near = |a: [f64; 3], b: [f64; 3]| length(subtract(a, b)) < 1e-6;
        assert!(near(matrix.origin, [0.0, EARTH_RADIUS_M + 100.0, 0.0]));
        // The grid's east is true north, its north is true west.
        assert!(near(matrix.axes[0], [0.0, 0.0, 1.0]) && near(matrix.axes[1], [1.0, 0.0, 0.0]), "{matrix:?}");
        let unknown = manifest(2, 1.0);
        assert!(Frame::new(&unknown, &|_| None).to_earth.is_none());
        let known = Manifest { location: Some(location), ..unknown };
        assert!(Frame::new(&known, &|_| None).to_earth.is_some());
    }
}
