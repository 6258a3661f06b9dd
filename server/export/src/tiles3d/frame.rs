//! Where tiles are: a frame of metres at the city's middle, its place on Earth, and where nodes lie in it.
//!
//! The frame's axes are those of the city's own coordinate system there, so nodes are squares along them. A projected coordinate
//! system is no plane on Earth: each node is placed by the projection around its own middle.

use glam::{DAffine3, DMat3, DVec3};
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
    middle: DVec3,
    /// From the frame to the centre of the Earth; `None` if the city's place is unknown.
    pub(super) to_earth: Option<DAffine3>,
    /// The inverse, if positions come from the projection.
    from_earth: Option<DAffine3>,
}

impl<'a> Frame<'a> {
    pub(super) fn new(manifest: &'a Manifest, to_geocentric: ToGeocentric<'a>) -> Self {
        let [min, max] = manifest.bounds;
        let middle = DVec3::new(0.5 * (min[0] + max[0]), 0.5 * (min[1] + max[1]), manifest.ground_z_m);
        let projected = linearise(to_geocentric, middle, 1.0).and_then(rigid);
        let to_earth = projected.or_else(|| {
            let [focus_min, focus_max] = manifest.focus;
            let focus = [0, 1].map(|k| 0.5 * (focus_min[k] + focus_max[k]));
            let at_focus = at_location(manifest.location.as_ref()?, manifest.ground_z_m);
            let moved = DVec3::new(middle.x - focus[0], middle.y - focus[1], 0.0);
            Some(DAffine3 { translation: at_focus.transform_point3(moved), ..at_focus })
        });
        let from_earth = projected.map(|to_earth| {
            let turned_back = to_earth.matrix3.transpose();
            DAffine3::from_mat3_translation(turned_back, -(turned_back * to_earth.translation))
        });
        Self { manifest, to_geocentric, middle, to_earth, from_earth }
    }

    /// A world position in the frame.
    fn position(&self, world: DVec3) -> DVec3 {
        let from_earth = self.from_earth.zip((self.to_geocentric)(world.to_array()));
        let projected = from_earth.map(|(from_earth, geocentric)| from_earth.transform_point3(geocentric.into()));
        projected.unwrap_or_else(|| world - self.middle)
    }

    /// From metres from a node's south-west corner at the city's height zero to the frame.
    pub(super) fn place(&self, node: TileId) -> DAffine3 {
        let half = 0.5 * self.manifest.node_side_m(node.level());
        let to_middle = DVec3::new(half, half, 0.0);
        let middle = DVec3::from(self.manifest.node_corner(node)) + to_middle;
        let position = |world: [f64; 3]| Some(self.position(world.into()).to_array());
        let around = linearise(&position, middle, half)
            .and_then(perpendicular)
            .unwrap_or_else(|| DAffine3::from_translation(self.position(middle)));
        around * DAffine3::from_translation(-to_middle)
    }

    /// The bounding box of a node between two heights, in metres above the city's height zero: centre and half axes, as in 3D Tiles
    /// 1.1, section "Box". It contains those of the node's children between the same heights.
    pub(super) fn bounding_box(&self, node: TileId, heights: [f64; 2]) -> [f64; 12] {
        let corner = DVec3::from(self.manifest.node_corner(node));
        let side = self.manifest.node_side_m(node.level());
        let place = self.place(node);
        let (mut min, mut max) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for i in 0..18 {
            let share = [i % 3, i / 3 % 3].map(|step: usize| 0.5 * side * step as f64);
            let local = DVec3::new(share[0], share[1], heights[i / 9]);
            for p in [self.position(corner + local), place.transform_point3(local)] {
                (min, max) = (min.min(p), max.max(p));
            }
        }
        let curved = if self.from_earth.is_some() { CURVATURE * side * side / (8.0 * EARTH_RADIUS_M) } else { 0.0 };
        let (centre, half) = (0.5 * (min + max), 0.5 * (max - min) + curved + MARGIN * side);
        [centre.x, centre.y, centre.z, half.x, 0.0, 0.0, 0.0, half.y, 0.0, 0.0, 0.0, half.z]
    }
}

/// The map from offsets around a position to where they are, over `reach` metres to each side.
fn linearise(to: ToGeocentric<'_>, middle: DVec3, reach: f64) -> Option<DAffine3> {
    let at = |place: DVec3| to(place.to_array()).map(DVec3::from);
    let origin = at(middle)?;
    let axis = |direction: DVec3, reach: f64| {
        let step = direction * reach;
        Some((at(middle + step)? - at(middle - step)?) * (0.5 / reach))
    };
    let axes = DMat3::from_cols(axis(DVec3::X, reach)?, axis(DVec3::Y, reach)?, axis(DVec3::Z, RISE_M)?);
    let is_usable = [0, 1, 2].iter().all(|k| SCALES.contains(&axes.col(*k).length()));
    is_usable.then(|| DAffine3::from_mat3_translation(axes, origin))
}

/// The map with perpendicular axes of the same lengths: up stays, then north is turned as little as possible. What projections have of
/// shear is far below the errors of tiles, and glTF allows none.
fn perpendicular(map: DAffine3) -> Option<DAffine3> {
    let DMat3 { x_axis, y_axis, z_axis } = map.matrix3;
    let up = z_axis.try_normalize()?;
    let north = (y_axis - up * y_axis.dot(up)).try_normalize()?;
    let east = north.cross(up);
    let matrix3 = DMat3::from_cols(east * x_axis.length(), north * y_axis.length(), up * z_axis.length());
    Some(DAffine3 { matrix3, ..map })
}

/// The map with perpendicular axes of length 1.
fn rigid(map: DAffine3) -> Option<DAffine3> {
    let DMat3 { x_axis, y_axis, z_axis } = perpendicular(map)?.matrix3;
    let matrix3 = DMat3::from_cols(x_axis.try_normalize()?, y_axis.try_normalize()?, z_axis.try_normalize()?);
    Some(DAffine3 { matrix3, ..map })
}

/// East, north and up of the city's grid at a place on the WGS84 ellipsoid.
fn at_location(location: &GeoLocation, height_m: f64) -> DAffine3 {
    let (latitude, longitude) = (location.latitude_deg.to_radians(), location.longitude_deg.to_radians());
    let ((sin_lat, cos_lat), (sin_lon, cos_lon)) = (latitude.sin_cos(), longitude.sin_cos());
    let up = DVec3::new(cos_lat * cos_lon, cos_lat * sin_lon, sin_lat);
    let east = DVec3::new(-sin_lon, cos_lon, 0.0);
    let north = up.cross(east);
    // True north is clockwise of the grid's.
    let (sin, cos) = location.north_deg.to_radians().sin_cos();
    let grid_north = north * cos - east * sin;
    let radius = EARTH_RADIUS_M / (1.0 - ECCENTRICITY_SQUARED * sin_lat * sin_lat).sqrt();
    let flat = (radius + height_m) * cos_lat;
    let z = (radius * (1.0 - ECCENTRICITY_SQUARED) + height_m) * sin_lat;
    DAffine3::from_cols(grid_north.cross(up), grid_north, up, DVec3::new(flat * cos_lon, flat * sin_lon, z))
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
        for k in 0..3 {
            let axis = to_earth.matrix3.col(k);
            assert!((axis.length() - 1.0).abs() < 1e-9);
            assert!(axis.dot(to_earth.matrix3.col((k + 1) % 3)).abs() < 1e-9);
        }
        let [min, max] = manifest.bounds;
        let near = [0.5 * (min[0] + max[0]) + 10.0, 0.5 * (min[1] + max[1]) + 20.0, manifest.ground_z_m + 5.0];
        let expected = DVec3::from(to_geocentric(near).unwrap());
        let off = to_earth.transform_point3(DVec3::new(10.0, 20.0, 5.0)).distance(expected);
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
            let local = DVec3::new(0.0, 0.0, 50.0);
            let world = DVec3::from(manifest.node_corner(node)) + local;
            let off = frame.place(node).transform_point3(local).distance(frame.position(world));
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
        let near = |a: DVec3, b: DVec3| a.distance(b) < 1e-6;
        assert!(near(matrix.translation, DVec3::Y * (EARTH_RADIUS_M + 100.0)));
        // The grid's east is true north, its north is true west.
        assert!(near(matrix.matrix3.x_axis, DVec3::Z) && near(matrix.matrix3.y_axis, DVec3::X), "{matrix:?}");
        let unknown = manifest(2, 1.0);
        assert!(Frame::new(&unknown, &|_| None).to_earth.is_none());
        let known = Manifest { location: Some(location), ..unknown };
        assert!(Frame::new(&known, &|_| None).to_earth.is_some());
    }
}
