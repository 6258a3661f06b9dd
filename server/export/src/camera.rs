//! Cameras as in the files of the viewer.

use glam::{DMat3, DVec3};
use serde::Deserialize;

/// Distance of the point that a camera of a link looks at.
const TARGET_DISTANCE_M: f64 = 100.0;

/// A camera file: `{"position":[x,y,z],"target":[x,y,z],"up":[0,0,1],"fov_y_deg":60}` in world metres.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ExportCamera {
    pub position: [f64; 3],
    /// A point in the middle of the frame.
    pub target: [f64; 3],
    #[serde(default = "default_up")]
    pub up: [f64; 3],
    /// Vertical field of view, 1 to 170.
    #[serde(default = "default_fov_deg")]
    pub fov_y_deg: f64,
}

fn default_up() -> [f64; 3] {
    [0.0, 0.0, 1.0]
}

fn default_fov_deg() -> f64 {
    60.0
}

impl ExportCamera {
    /// The camera of the numbers that view links have, `X,Y,Z,AZIMUTH,PITCH,FOV` in metres and degrees; `None` if they are out of range.
    #[must_use]
    pub fn of_numbers([x, y, z, azimuth_deg, pitch_deg, fov_y_deg]: [f64; 6]) -> Option<Self> {
        let [(east, north), (up, level)] = [azimuth_deg, pitch_deg].map(|degrees| degrees.to_radians().sin_cos());
        let forward = DVec3::new(east * level, north * level, up);
        // Also of a camera that looks straight down.
        let upright = DVec3::new(-east * up, -north * up, level);
        let position = DVec3::new(x, y, z);
        let camera = Self {
            position: position.to_array(),
            target: (position + forward * TARGET_DISTANCE_M).to_array(),
            up: upright.to_array(),
            fov_y_deg,
        };
        ((-90.0..=90.0).contains(&pitch_deg) && camera.axes().is_some()).then_some(camera)
    }

    /// The camera with its eye raised by some metres, in the same direction.
    #[must_use]
    pub fn raised(self, metres: f64) -> Self {
        let up = |[x, y, z]: [f64; 3]| [x, y, z + metres];
        Self { position: up(self.position), target: up(self.target), ..self }
    }

    /// The unit vectors to the right, to the top and into the frame, as columns. An `up` along the view is replaced. `None` if
    /// position and target are equal, or a value is not finite or out of range.
    #[must_use]
    pub fn axes(&self) -> Option<DMat3> {
        let forward = (DVec3::from(self.target) - DVec3::from(self.position)).try_normalize()?;
        let up = DVec3::from(self.up);
        if !up.is_finite() || !(1.0..=170.0).contains(&self.fov_y_deg) {
            return None;
        }
        let across = [up.normalize_or(DVec3::Z), DVec3::Y, DVec3::X].map(|up| forward.cross(up));
        let right = across.into_iter().find(|right| right.length() > 1e-6)?.try_normalize()?;
        Some(DMat3::from_cols(right, right.cross(forward), forward))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_of_links_are_cameras() {
        let east = ExportCamera::of_numbers([10.0, 20.0, 30.0, 90.0, 0.0, 50.0]).unwrap();
        let axes = east.axes().unwrap();
        assert!((axes.z_axis - DVec3::X).length() < 1e-12 && (axes.y_axis - DVec3::Z).length() < 1e-12);
        assert_eq!((east.position, east.fov_y_deg), ([10.0, 20.0, 30.0], 50.0));
        let raised = east.raised(5.0);
        assert_eq!((raised.position, raised.axes().unwrap().z_axis), ([10.0, 20.0, 35.0], axes.z_axis));
        let down = ExportCamera::of_numbers([0.0, 0.0, 30.0, 90.0, -90.0, 50.0]).unwrap().axes().unwrap();
        assert!((down.z_axis + DVec3::Z).length() < 1e-12 && (down.y_axis - DVec3::X).length() < 1e-12);
        for wrong in
            [[0.0, 0.0, 0.0, 0.0, 91.0, 50.0], [0.0, 0.0, 0.0, 0.0, 0.0, 0.5], [f64::NAN, 0.0, 0.0, 0.0, 0.0, 50.0]]
        {
            assert_eq!(ExportCamera::of_numbers(wrong), None, "{wrong:?}");
        }
    }

    #[test]
    fn axes_are_orthogonal_and_invalid_cameras_have_none() {
        let camera = |json: &str| serde_json::from_str::<ExportCamera>(json).unwrap();
        let north = camera(r#"{"position":[1,2,3],"target":[1,12,3]}"#);
        assert_eq!(north.axes(), Some(DMat3::from_cols(DVec3::X, DVec3::Z, DVec3::Y)));
        let down = camera(r#"{"position":[0,0,30],"target":[0,0,3]}"#);
        assert_eq!(down.axes(), Some(DMat3::from_cols(DVec3::X, DVec3::Y, DVec3::NEG_Z)));
        for invalid in
            [r#"{"position":[1,2,3],"target":[1,2,3]}"#, r#"{"position":[1,2,3],"target":[1,2,4],"fov_y_deg":171}"#]
        {
            assert_eq!(camera(invalid).axes(), None);
        }
    }
}
