//! Cameras in world coordinates (f64), views, and camera files.

use crate::switching::SwitchDistances;
use glam::{DQuat, DVec3};
use insula_protocol::Manifest;
use serde::{Deserialize, Serialize};

const CAMERA_FORMAT: &str = r#"{"position":[x,y,z],"target":[x,y,z],"fov_y_deg":60}"#;
const PATH_FORMAT: &str = r#"{"seconds":S,"keys":[{"t":0,"position":[x,y,z],"target":[x,y,z]}]}"#;

/// Higher buildings do not move the first view of a city away from it.
const MAX_HOUSE_M: f64 = 200.0;

/// Position and orientation of the eye. The three axes are orthogonal unit vectors.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Camera {
    /// In the city's coordinates.
    pub position: DVec3,
    /// Into the frame.
    pub forward: DVec3,
    /// To the right of the frame.
    pub right: DVec3,
    /// To the top of the frame.
    pub up: DVec3,
    /// Vertical field of view.
    pub fov_y_rad: f64,
}

impl Camera {
    /// Looks from `position` to `target`; `None` if the two are equal. An `up` along the view direction is replaced.
    pub fn look_at(position: DVec3, target: DVec3, up: DVec3, fov_y_rad: f64) -> Option<Self> {
        let forward = (target - position).try_normalize()?;
        let up = up.try_normalize().unwrap_or(DVec3::Z);
        let right = [up, DVec3::Y, DVec3::X].into_iter().map(|up| forward.cross(up)).find(|r| r.length() > 1e-6)?;
        let right = right.try_normalize()?;
        Some(Self { position, forward, right, up: right.cross(forward), fov_y_rad })
    }

    /// Looks in a direction: `yaw_rad` from east to north, `pitch_rad` upwards.
    pub fn from_angles(position: DVec3, yaw_rad: f64, pitch_rad: f64, fov_y_rad: f64) -> Self {
        let (sin_yaw, cos_yaw) = yaw_rad.sin_cos();
        let (sin_pitch, cos_pitch) = pitch_rad.sin_cos();
        let forward = DVec3::new(cos_yaw * cos_pitch, sin_yaw * cos_pitch, sin_pitch);
        let right = DVec3::new(sin_yaw, -cos_yaw, 0.0);
        Self { position, forward, right, up: right.cross(forward), fov_y_rad }
    }

    /// The same camera, turned about the vertical; to the left for positive angles.
    pub fn turned(&self, degrees: f64) -> Self {
        let turn = DQuat::from_rotation_z(degrees.to_radians());
        Self { forward: turn * self.forward, right: turn * self.right, up: turn * self.up, ..*self }
    }

    /// Yaw and pitch in radians, as in [`Camera::from_angles`].
    pub fn angles(&self) -> (f64, f64) {
        (self.forward.y.atan2(self.forward.x), self.forward.z.clamp(-1.0, 1.0).asin())
    }

    /// Degrees clockwise from the grid's north, 0 to 360.
    pub fn azimuth_deg(&self) -> f64 {
        (90.0 - self.angles().0.to_degrees()).rem_euclid(360.0)
    }

    /// The first view of a city: the part where most of it stands from the south, or from the north on the southern half of the Earth, 30
    /// degrees above the horizon. In the afternoon the sun stands behind it. `aspect` is width by height.
    pub fn overview(manifest: &Manifest, aspect: f64) -> Self {
        let is_southern = manifest.location.is_some_and(|location| location.latitude_deg < 0.0);
        Self::overview_of(manifest.focus_bounds().map(DVec3::from), is_southern, aspect)
    }

    fn overview_of([low, high]: [DVec3; 2], is_southern: bool, aspect: f64) -> Self {
        let fov_y_rad = 40f64.to_radians();
        let half_m = (0.5 * (high - low).truncate().length()).max(5.0);
        let (sin, cos) = (if is_southern { 195f64 } else { 345.0 }).to_radians().sin_cos();
        let ahead = DVec3::new(sin, cos, 0.0);
        // Most of a city is low: one tower would lift the centre of the box into the air. Seen from one side, the near half is larger.
        let target = ((low + high) * 0.5).with_z(low.z + 0.2 * (high.z - low.z)) - ahead * (0.1 * half_m);
        let distance_m = 1.06 * half_m / ((fov_y_rad * 0.5).tan() * aspect.clamp(0.7, 1.78));
        // A city is flat beside this distance, a single house is not.
        let distance_m = distance_m.max(half_m + 2.5 * (high.z - low.z).min(MAX_HOUSE_M));
        let elevation = 30f64.to_radians();
        let position = target - ahead * (elevation.cos() * distance_m) + DVec3::Z * (elevation.sin() * distance_m);
        Self::look_at(position, target, DVec3::Z, fov_y_rad).unwrap_or(Self::from_angles(position, 0.0, 0.0, fov_y_rad))
    }
}

/// A half-space: a point `p` with `normal . p + offset >= 0` is inside.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrustumPlane {
    /// Unit normal, inwards.
    pub normal: DVec3,
    /// Minus the scalar product of the normal and a point of the plane.
    pub offset: f64,
}

/// A camera, the size of its frame, and how much may be drawn for it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct View {
    pub camera: Camera,
    pub width_px: u32,
    pub height_px: u32,
    /// Tolerated screen-space error in pixels.
    pub tau_px: f64,
    /// What decides instead of the screen-space error. A tau of 1 draws its levels.
    pub switching: Option<SwitchDistances>,
    /// Most cache pages that the visited nodes may take.
    pub budget_pages: u32,
    /// Most nodes that may be visited.
    pub budget_nodes: u32,
}

impl View {
    /// A view of which only the geometry counts: nothing may be drawn for it.
    pub fn of(camera: Camera, [width_px, height_px]: [u32; 2]) -> Self {
        Self { camera, width_px, height_px, tau_px: 1.0, switching: None, budget_pages: 0, budget_nodes: 0 }
    }

    /// Pixels that a metre covers at a distance of one metre: `height_px / (2 tan(fov_y / 2))`.
    pub fn focal_px(&self) -> f64 {
        f64::from(self.height_px) / (2.0 * (self.camera.fov_y_rad * 0.5).tan())
    }

    /// Width by height.
    pub fn aspect(&self) -> f64 {
        f64::from(self.width_px.max(1)) / f64::from(self.height_px.max(1))
    }

    /// The planes of the frustum: left, right, bottom, top, and through the eye. There is no far plane.
    pub fn planes(&self) -> [FrustumPlane; 5] {
        let c = &self.camera;
        let tan_y = (c.fov_y_rad * 0.5).tan();
        let tan_x = tan_y * self.aspect();
        let plane = |normal: DVec3| {
            let normal = normal.normalize_or(c.forward);
            FrustumPlane { normal, offset: -normal.dot(c.position) }
        };
        [
            plane(c.forward * tan_x + c.right),
            plane(c.forward * tan_x - c.right),
            plane(c.forward * tan_y + c.up),
            plane(c.forward * tan_y - c.up),
            plane(c.forward),
        ]
    }
}

/// A camera file: `{"position":[x,y,z],"target":[x,y,z],"up":[0,0,1],"fov_y_deg":60}` in the city's coordinates.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct CameraFile {
    pub position: [f64; 3],
    /// A point in the middle of the frame.
    pub target: [f64; 3],
    #[serde(default = "default_up")]
    pub up: [f64; 3],
    /// Vertical field of view.
    #[serde(default = "default_fov")]
    pub fov_y_deg: f64,
}

fn default_up() -> [f64; 3] {
    [0.0, 0.0, 1.0]
}

fn default_fov() -> f64 {
    60.0
}

impl CameraFile {
    /// The camera; `None` if the values are not finite or out of range, or if there is no view direction.
    pub fn camera(&self) -> Option<Camera> {
        let numbers = self.position.iter().chain(&self.target).chain(&self.up).chain([&self.fov_y_deg]);
        if !numbers.into_iter().all(|v| v.is_finite()) || !(1.0..=170.0).contains(&self.fov_y_deg) {
            return None;
        }
        Camera::look_at(self.position.into(), self.target.into(), self.up.into(), self.fov_y_deg.to_radians())
    }

    /// The file of a camera.
    pub fn from_camera(camera: &Camera) -> Self {
        let target = camera.position + camera.forward * 100.0;
        // What the vertical tells, unless the camera is tilted sideways or looks along it.
        let is_plain = camera.right.z.abs() < 1e-9 && camera.forward.z.abs() < 0.999;
        let up = if is_plain { default_up() } else { camera.up.to_array() };
        Self {
            position: camera.position.to_array(),
            target: target.to_array(),
            up,
            fov_y_deg: camera.fov_y_rad.to_degrees(),
        }
    }

    /// Parses and checks a camera file, and returns it with its camera. Fails with a description of what is wrong.
    pub fn parse(json: &str) -> Result<(Self, Camera), String> {
        let file: Self =
            serde_json::from_str(json).map_err(|e| format!("not a camera ({e}): write {CAMERA_FORMAT}"))?;
        let camera = file.camera().ok_or_else(|| {
            format!("position and target must differ, and fov_y_deg must be 1 to 170: write {CAMERA_FORMAT}")
        })?;
        Ok((file, camera))
    }
}

/// A key of a camera path.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct PathKey {
    /// Seconds from the start.
    pub t: f64,
    pub position: [f64; 3],
    /// A point in the middle of the frame.
    pub target: [f64; 3],
}

/// A camera path: `{"seconds":S,"keys":[{"t":..,"position":..,"target":..}]}`, with straight lines from key to key.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CameraPath {
    pub seconds: f64,
    /// In the order of their times.
    pub keys: Vec<PathKey>,
    /// Vertical field of view.
    #[serde(default = "default_fov")]
    pub fov_y_deg: f64,
}

impl CameraPath {
    /// Parses and checks a camera path. Fails with a description of what is wrong.
    pub fn parse(json: &str) -> Result<Self, String> {
        let path: Self =
            serde_json::from_str(json).map_err(|e| format!("not a camera path ({e}): write {PATH_FORMAT}"))?;
        if !(path.seconds > 0.0 && path.seconds < 86_400.0) || path.keys.is_empty() {
            return Err("a camera path needs seconds above 0 and below 86400, and at least one key".into());
        }
        if !path.keys.windows(2).all(|k| k[0].t < k[1].t) {
            return Err("the times of the camera path's keys must increase".into());
        }
        match path.keys.iter().find(|k| path.camera_between(k.position, k.target).is_none()) {
            Some(key) => Err(format!("camera path has no valid view direction at t={} s", key.t)),
            None => Ok(path),
        }
    }

    fn camera_between(&self, position: [f64; 3], target: [f64; 3]) -> Option<Camera> {
        CameraFile { position, target, up: default_up(), fov_y_deg: self.fov_y_deg }.camera()
    }

    /// The camera at `t` seconds. It is still before the first and after the last key. `None` if there is no view direction.
    pub fn camera_at(&self, t: f64) -> Option<Camera> {
        let next = self.keys.iter().position(|k| k.t > t).unwrap_or(self.keys.len());
        let a = self.keys.get(next.saturating_sub(1))?;
        let b = self.keys.get(next).unwrap_or(a);
        let progress = if b.t > a.t { ((t - a.t) / (b.t - a.t)).clamp(0.0, 1.0) } else { 0.0 };
        let mix = |a: [f64; 3], b: [f64; 3]| DVec3::from(a).lerp(b.into(), progress).to_array();
        self.camera_between(mix(a.position, b.position), mix(a.target, b.target))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_are_orthogonal_even_straight_down() {
        for target in [DVec3::new(0.0, 0.0, -10.0), DVec3::new(3.0, 4.0, 5.0)] {
            let c = Camera::look_at(DVec3::ZERO, target, DVec3::Z, 1.0).unwrap();
            assert!(c.right.dot(c.forward).abs() < 1e-12 && c.up.dot(c.forward).abs() < 1e-12);
            assert!((c.right.cross(c.forward) - c.up).length() < 1e-12);
        }
        assert!(Camera::look_at(DVec3::ONE, DVec3::ONE, DVec3::Z, 1.0).is_none());
    }

    #[test]
    fn angles_round_trip() {
        let c = Camera::from_angles(DVec3::ZERO, 2.0, -0.7, 1.0);
        let (yaw, pitch) = c.angles();
        assert!((yaw - 2.0).abs() < 1e-12 && (pitch + 0.7).abs() < 1e-12);
        let same = Camera::look_at(DVec3::ZERO, c.forward, DVec3::Z, 1.0).unwrap();
        assert!((same.right - c.right).length() < 1e-12 && (same.up - c.up).length() < 1e-12);
    }

    #[test]
    fn an_overview_has_a_whole_house_and_does_not_flee_from_the_towers_of_a_city() {
        let camera = Camera::overview_of([DVec3::ZERO, DVec3::new(18.0, 11.0, 9.0)], false, 1.78);
        for corner in 0..8 {
            let at =
                DVec3::new(18.0, 11.0, 9.0) * DVec3::from_array([0, 1, 2].map(|axis| f64::from(corner >> axis & 1)));
            let seen = at - camera.position;
            let [across, up] = [camera.right, camera.up].map(|axis| (seen.dot(axis) / seen.dot(camera.forward)).abs());
            assert!(
                up < 20f64.to_radians().tan() && across < 1.78 * 20f64.to_radians().tan(),
                "{corner}: {across} {up}"
            );
        }
        let distance_m = |height_m: f64| {
            let camera = Camera::overview_of([DVec3::ZERO, DVec3::new(3000.0, 2000.0, height_m)], false, 1.78);
            (camera.position - DVec3::new(1500.0, 1000.0, 0.2 * height_m)).length()
        };
        assert!((distance_m(300.0) / distance_m(10.0) - 1.0).abs() < 0.01);
    }

    #[test]
    fn planes_bound_the_frame() {
        let camera = Camera::look_at(DVec3::new(5.0, 5.0, 5.0), DVec3::new(5.0, 50.0, 5.0), DVec3::Z, 1.0).unwrap();
        let view = View::of(camera, [200, 100]);
        let is_inside = |p: DVec3| view.planes().iter().all(|plane| plane.normal.dot(p) + plane.offset >= 0.0);
        let edge = (0.5f64).tan() * 10.0;
        let at = |x: f64, z: f64| camera.position + camera.forward * 10.0 + camera.right * x + camera.up * z;
        assert!(is_inside(at(0.0, 0.0)) && is_inside(at(edge * 1.99, 0.0)) && is_inside(at(0.0, -edge * 0.99)));
        assert!(!is_inside(at(edge * 2.01, 0.0)) && !is_inside(at(0.0, edge * 1.01)));
        assert!(!is_inside(camera.position - camera.forward));
    }

    #[test]
    fn paths_interpolate_between_keys() {
        let text = r#"{"seconds":4,"keys":[{"t":0,"position":[0,0,0],"target":[0,1,0]},{"t":4,"position":[8,0,0],"target":[8,1,0]}]}"#;
        let path: CameraPath = serde_json::from_str(text).unwrap();
        assert_eq!(path.camera_at(1.0).unwrap().position, DVec3::new(2.0, 0.0, 0.0));
        assert_eq!(path.camera_at(99.0).unwrap().position, DVec3::new(8.0, 0.0, 0.0));
    }
}
