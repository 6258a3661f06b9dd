//! Bounding volumes, only to leave out tiles outside of the wanted part of the Earth.

use super::globe;
use super::tileset::VolumeJson;
use glam::{DMat4, DVec3};

/// Degrees that a volume may be wrong.
const MARGIN_DEG: f64 = 1e-6;

/// The space that contains a tile's content.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Volume {
    /// West, south, east, north in radians, lowest and highest height.
    Region([f64; 6]),
    /// Centre and half axes, before the transform of the tile.
    Box { center: DVec3, half_axes: [DVec3; 3] },
    /// Before the transform of the tile.
    Sphere { center: DVec3, radius: f64 },
}

impl Volume {
    /// `None` if the volume is none of the three kinds, or malformed.
    pub(super) fn new(json: &VolumeJson) -> Option<Self> {
        let is_finite = |numbers: &[f64]| numbers.iter().all(|number| number.is_finite());
        if let Some(region) = &json.region {
            return <[f64; 6]>::try_from(region.as_slice()).ok().filter(|region| is_finite(region)).map(Self::Region);
        }
        if let Some(numbers) = json.box_.as_ref().filter(|numbers| numbers.len() == 12 && is_finite(numbers)) {
            let at = |i: usize| DVec3::from_slice(&numbers[3 * i..]);
            return Some(Self::Box { center: at(0), half_axes: [at(1), at(2), at(3)] });
        }
        let numbers = json.sphere.as_ref().filter(|numbers| numbers.len() == 4 && is_finite(numbers))?;
        Some(Self::Sphere { center: DVec3::from_slice(numbers), radius: numbers[3] })
    }

    /// The volume of an implicit tile, with `cells` along each divided axis. Spheres cannot be divided and stay whole.
    pub(super) fn part(&self, level: u32, at: [u64; 3], has_z: bool) -> Self {
        let cells = libm::exp2(level as f64);
        match *self {
            Self::Region([west, south, east, north, low, high]) => {
                let east = if east < west { east + std::f64::consts::TAU } else { east };
                let cut = |from: f64, to: f64, i: u64| from + (to - from) * i as f64 / cells;
                let z = if has_z { [cut(low, high, at[2]), cut(low, high, at[2] + 1)] } else { [low, high] };
                let [x0, x1] = [0, 1].map(|i| cut(west, east, at[0] + i));
                let [y0, y1] = [0, 1].map(|i| cut(south, north, at[1] + i));
                Self::Region([x0, y0, x1, y1, z[0], z[1]])
            }
            Self::Box { center, half_axes } => {
                let parts = |axis: usize| if axis == 2 && !has_z { 1.0 } else { cells };
                let offset = |axis: usize| {
                    let i = if axis == 2 && !has_z { 0 } else { at[axis] };
                    (2.0 * i as f64 + 1.0) / parts(axis) - 1.0
                };
                let moved = (0..3).map(|axis| half_axes[axis] * offset(axis)).sum::<DVec3>();
                Self::Box { center: center + moved, half_axes: [0, 1, 2].map(|axis| half_axes[axis] / parts(axis)) }
            }
            sphere => sphere,
        }
    }

    /// Whether the volume is certainly outside of west, south, east and north in degrees. Volumes that are not on the Earth's
    /// surface are never outside.
    pub(super) fn is_outside(&self, transform: &DMat4, bbox_deg: [f64; 4]) -> bool {
        let Some([west, south, east, north]) = self.extent_deg(transform) else { return false };
        let [bbox_west, bbox_south, bbox_east, bbox_north] = bbox_deg;
        let is_apart = |from: f64, to: f64, bbox_from: f64, bbox_to: f64| {
            to + MARGIN_DEG < bbox_from || bbox_to + MARGIN_DEG < from
        };
        let bbox_east = if bbox_east < bbox_west { bbox_east + 360.0 } else { bbox_east };
        is_apart(south, north, bbox_south, bbox_north)
            || [-360.0, 0.0, 360.0].iter().all(|turn| is_apart(west + turn, east + turn, bbox_west, bbox_east))
    }

    /// West, south, east and north in degrees around the volume, `west <= east`. `None` if it is not at the Earth's surface.
    fn extent_deg(&self, transform: &DMat4) -> Option<[f64; 4]> {
        let (center, radius) = match *self {
            Self::Region(region) => {
                let [west, south, east, north, ..] = region.map(f64::to_degrees);
                return Some([west, south, if east < west { east + 360.0 } else { east }, north]);
            }
            Self::Box { center, half_axes } => {
                let radius = half_axes.iter().map(|axis| transform.transform_vector3(*axis).length()).sum::<f64>();
                (transform.transform_point3(center), radius)
            }
            Self::Sphere { center, radius } => {
                let axes = [transform.x_axis, transform.y_axis, transform.z_axis];
                let scale = axes.iter().map(|axis| axis.truncate().length()).fold(0.0, f64::max);
                (transform.transform_point3(center), radius * scale)
            }
        };
        if !globe::is_near_surface(center) || radius.is_nan() {
            return None;
        }
        let [lon, lat] = globe::lon_lat_deg(center);
        // The polar radius is the smallest, so the angles are rather too large.
        let lat_reach = (radius / globe::POLAR_RADIUS_M).to_degrees() * 1.01;
        let widest = libm::cos((lat.abs() + lat_reach).min(90.0).to_radians());
        let lon_reach = if widest > 1e-3 { lat_reach / widest } else { 180.0 };
        (lat_reach < 90.0).then_some([lon - lon_reach, lat - lat_reach, lon + lon_reach, lat + lat_reach])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn volume(json: &str) -> Option<Volume> {
        Volume::new(&serde_json::from_str(json).unwrap())
    }

    #[test]
    fn malformed_volumes_have_no_extent() {
        for json in ["{}", r#"{"region":[1,2,3]}"#, r#"{"box":[]}"#, r#"{"sphere":[0,0,0]}"#, r#"{"region":[]}"#] {
            assert_eq!(volume(json), None, "{json}");
        }
    }

    #[test]
    fn regions_compare_across_the_antimeridian() {
        let region = volume(r#"{"region":[3.1,0.1,-3.1,0.2,0,9]}"#).unwrap();
        let is_outside = |bbox| region.is_outside(&DMat4::IDENTITY, bbox);
        assert!(!is_outside([179.0, 6.0, 180.0, 12.0]));
        assert!(!is_outside([-180.0, 6.0, -179.0, 12.0]));
        assert!(!is_outside([179.5, 6.0, -179.5, 12.0]));
        assert!(is_outside([0.0, 6.0, 1.0, 12.0]));
        assert!(is_outside([179.0, 12.0, 180.0, 13.0]));
    }

    #[test]
    fn boxes_and_spheres_are_placed_by_the_transform() {
        let transform = DMat4::from_translation(globe::ecef(14.4, 50.1, 200.0));
        for json in [r#"{"box":[0,0,0, 500,0,0, 0,500,0, 0,0,50]}"#, r#"{"sphere":[0,0,0,900]}"#] {
            let volume = volume(json).unwrap();
            assert!(!volume.is_outside(&transform, [14.4, 50.1, 14.5, 50.2]), "{json}");
            assert!(!volume.is_outside(&transform, [14.408, 50.1, 14.5, 50.2]), "{json}");
            assert!(volume.is_outside(&transform, [14.45, 50.0, 14.5, 50.2]), "{json}");
            assert!(volume.is_outside(&transform, [14.0, 50.2, 15.0, 51.0]), "{json}");
            assert!(!volume.is_outside(&DMat4::IDENTITY, [14.45, 50.0, 14.5, 50.2]), "{json}");
        }
    }

    #[test]
    fn parts_of_volumes() {
        let region = volume(r#"{"region":[0,0,0.4,0.4,0,8]}"#).unwrap();
        assert_eq!(region.part(2, [1, 3, 0], false), Volume::Region([0.1, 0.30000000000000004, 0.2, 0.4, 0.0, 8.0]));
        let cube = volume(r#"{"box":[0,0,0, 4,0,0, 0,4,0, 0,0,4]}"#).unwrap();
        let Volume::Box { center, half_axes } = cube.part(1, [0, 1, 1], true) else { panic!() };
        assert_eq!((center, half_axes[0].x), (DVec3::new(-2.0, 2.0, 2.0), 2.0));
        let Volume::Box { center, half_axes } = cube.part(1, [0, 1, 0], false) else { panic!() };
        assert_eq!((center, half_axes[2].z), (DVec3::new(-2.0, 2.0, 0.0), 4.0));
    }
}
