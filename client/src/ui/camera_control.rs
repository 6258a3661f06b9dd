//! Steers the camera with keys and mouse: flying, or orbiting around a point.

use glam::DVec3;
use insula_viewer::camera::Camera;

/// Angle per pixel of dragging.
const DRAG_RAD_PER_PX: f64 = 0.004;
/// Largest pitch, a little under 90 degrees: the horizon stays level.
const MAX_PITCH_RAD: f64 = 1.55;
/// How far ahead the camera's motion is prefetched, in seconds.
const LOOKAHEAD_SECS: f64 = 0.5;
/// Factor of the speed while Shift is held.
const FAST_FACTOR: f64 = 4.0;
/// Height above the target of a camera that goes there without looking down: that of a person's eyes.
const EYE_HEIGHT_M: f64 = 1.7;

/// Direction of a movement key.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MoveDirection {
    Forward,
    Back,
    Left,
    Right,
    Up,
    Down,
}

/// What the mouse and the movement keys act on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ControlMode {
    /// The mouse turns the camera in place, the keys move it.
    Fly,
    /// The mouse turns the camera around a pivot, the keys move the pivot.
    Orbit,
}

/// The camera and the state of its controls.
#[derive(Debug, Clone)]
pub struct CameraControl {
    mode: ControlMode,
    position: DVec3,
    yaw_rad: f64,
    pitch_rad: f64,
    fov_y_rad: f64,
    /// From the camera to the pivot.
    pivot_distance_m: f64,
    speed_m_per_sec: f64,
    ground_z_m: f64,
    /// Whether the key of each [`MoveDirection`] is held.
    held: [bool; 6],
    is_fast: bool,
}

impl CameraControl {
    /// Starts at `camera` with a speed that suits a city of `size_m`.
    pub fn new(camera: &Camera, size_m: f64, ground_z_m: f64) -> Self {
        let (yaw_rad, pitch_rad) = camera.angles();
        let mut control = Self {
            mode: ControlMode::Orbit,
            position: camera.position,
            yaw_rad,
            pitch_rad,
            fov_y_rad: camera.fov_y_rad,
            pivot_distance_m: 0.0,
            speed_m_per_sec: (size_m / 20.0).clamp(5.0, 500.0),
            ground_z_m,
            held: [false; 6],
            is_fast: false,
        };
        control.pivot_distance_m = control.distance_to_ground_m();
        control
    }

    /// The current camera.
    pub fn camera(&self) -> Camera {
        Camera::from_angles(self.position, self.yaw_rad, self.pitch_rad, self.fov_y_rad)
    }

    /// The camera in half a second, if a movement key is held.
    pub fn heading(&self) -> Option<Camera> {
        let mut ahead = self.clone();
        ahead.advance(LOOKAHEAD_SECS).then(|| ahead.camera())
    }

    /// The control mode.
    pub fn mode(&self) -> ControlMode {
        self.mode
    }

    /// Speed of the movement keys, in metres per second.
    pub fn speed_m_per_sec(&self) -> f64 {
        self.speed_m_per_sec
    }

    /// Switches between flying and orbiting around the ground ahead.
    pub fn toggle_mode(&mut self) {
        self.mode = match self.mode {
            ControlMode::Fly => ControlMode::Orbit,
            ControlMode::Orbit => ControlMode::Fly,
        };
        self.pivot_distance_m = self.distance_to_ground_m();
    }

    /// Distance to the ground ahead, 5 m to 50 km; 200 m for a camera that does not look down.
    fn distance_to_ground_m(&self) -> f64 {
        let (height_m, down) = (self.position.z - self.ground_z_m, -self.camera().forward.z);
        if down > 0.02 && height_m > 0.0 { (height_m / down).clamp(5.0, 50_000.0) } else { 200.0 }
    }

    /// Turns to the left by `angle_rad`: around the pivot when orbiting, else in place.
    pub fn turn(&mut self, angle_rad: f64) {
        self.drag(-angle_rad / DRAG_RAD_PER_PX, 0.0);
    }

    /// Turns to the grid's north, around the pivot when orbiting.
    pub fn turn_north(&mut self) {
        self.turn(std::f64::consts::FRAC_PI_2 - self.yaw_rad);
    }

    /// Moves along the view until what was at the pivot's distance appears `factor` times as large.
    pub fn approach(&mut self, factor: f64) {
        if self.mode == ControlMode::Fly {
            self.pivot_distance_m = self.distance_to_ground_m();
        }
        let (forward, before_m) = (self.camera().forward, self.pivot_distance_m);
        self.pivot_distance_m = (before_m / factor).clamp(2.0, 100_000.0);
        self.position += forward * (before_m - self.pivot_distance_m);
    }

    /// Moves to `camera`.
    pub fn set_camera(&mut self, camera: &Camera) {
        (self.yaw_rad, self.pitch_rad) = camera.angles();
        self.pitch_rad = self.pitch_rad.clamp(-MAX_PITCH_RAD, MAX_PITCH_RAD);
        (self.position, self.fov_y_rad) = (camera.position, camera.fov_y_rad);
        self.pivot_distance_m = self.distance_to_ground_m();
    }

    /// Centres `point` in the view without turning. A camera that does not look down on it moves there instead.
    pub fn go_to(&mut self, point: DVec3) {
        let forward = self.camera().forward;
        let above_m = self.position.z - point.z;
        if forward.z < -0.1 && above_m > 0.0 {
            self.position = point - forward * (above_m / -forward.z);
        } else {
            self.position = point.with_z(self.position.z.max(point.z + EYE_HEIGHT_M));
        }
        self.pivot_distance_m = self.distance_to_ground_m();
    }

    /// A movement key was pressed or released.
    pub fn set_held(&mut self, direction: MoveDirection, is_held: bool) {
        self.held[direction as usize] = is_held;
    }

    /// Shift was pressed or released.
    pub fn set_fast(&mut self, is_fast: bool) {
        self.is_fast = is_fast;
    }

    /// Releases all keys, because the window lost the keyboard.
    pub fn release_keys(&mut self) {
        self.held = [false; 6];
        self.is_fast = false;
    }

    /// The mouse was dragged, in pixels to the right and down.
    pub fn drag(&mut self, dx_px: f64, dy_px: f64) {
        let pivot = self.pivot();
        self.yaw_rad -= dx_px * DRAG_RAD_PER_PX;
        self.pitch_rad = (self.pitch_rad - dy_px * DRAG_RAD_PER_PX).clamp(-MAX_PITCH_RAD, MAX_PITCH_RAD);
        if self.mode == ControlMode::Orbit {
            self.position = pivot - self.camera().forward * self.pivot_distance_m;
        }
    }

    /// The wheel was turned, positive upwards: faster when flying, closer when orbiting.
    pub fn turn_wheel(&mut self, steps: f64) {
        match self.mode {
            ControlMode::Fly => {
                self.speed_m_per_sec = (self.speed_m_per_sec * 1.25f64.powf(steps)).clamp(0.5, 5000.0);
            }
            ControlMode::Orbit => {
                let pivot = self.pivot();
                self.pivot_distance_m = (self.pivot_distance_m * 0.88f64.powf(steps)).clamp(2.0, 100_000.0);
                self.position = pivot - self.camera().forward * self.pivot_distance_m;
            }
        }
    }

    fn pivot(&self) -> DVec3 {
        self.position + self.camera().forward * self.pivot_distance_m
    }

    /// Whether a movement key is held.
    pub fn is_moving(&self) -> bool {
        self.held.contains(&true)
    }

    /// Moves the camera for `secs` by the held keys. Returns whether it moved.
    pub fn advance(&mut self, secs: f64) -> bool {
        let axis = |plus: MoveDirection, minus: MoveDirection| {
            f64::from(u8::from(self.held[plus as usize])) - f64::from(u8::from(self.held[minus as usize]))
        };
        let camera = self.camera();
        let forward = match self.mode {
            ControlMode::Fly => camera.forward,
            // The pivot stays at its height.
            ControlMode::Orbit => DVec3::new(self.yaw_rad.cos(), self.yaw_rad.sin(), 0.0),
        };
        let direction = forward * axis(MoveDirection::Forward, MoveDirection::Back)
            + camera.right * axis(MoveDirection::Right, MoveDirection::Left)
            + DVec3::Z * axis(MoveDirection::Up, MoveDirection::Down);
        let speed = self.speed_m_per_sec * if self.is_fast { FAST_FACTOR } else { 1.0 };
        self.position += direction.normalize_or_zero() * speed * secs;
        direction != DVec3::ZERO
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn control() -> CameraControl {
        let camera = Camera::look_at(DVec3::new(0.0, -100.0, 100.0), DVec3::ZERO, DVec3::Z, 1.0).unwrap();
        CameraControl::new(&camera, 1000.0, 0.0)
    }

    #[test]
    fn flying_moves_in_the_view_direction() {
        let mut control = control();
        control.toggle_mode();
        assert!(!control.advance(1.0) && control.heading().is_none());
        control.set_held(MoveDirection::Forward, true);
        assert!(control.advance(1.0));
        let d = 50.0 / 2f64.sqrt();
        assert!((control.camera().position - DVec3::new(0.0, -100.0 + d, 100.0 - d)).length() < 1e-9);
        assert!(control.heading().is_some());
        control.release_keys();
        assert!(!control.is_moving());
    }

    #[test]
    fn going_to_a_point_centres_it() {
        let mut control = control();
        let point = DVec3::new(700.0, 300.0, 0.0);
        control.go_to(point);
        let camera = control.camera();
        assert!((point - camera.position).cross(camera.forward).length() < 1e-6, "{camera:?}");
        assert!((camera.position.z - 100.0).abs() < 1e-9, "{camera:?}");
        let upwards = Camera::from_angles(DVec3::new(1.0, 2.0, 3.0), 0.5, 0.6, 0.7);
        control.set_camera(&upwards);
        let camera = control.camera();
        assert!((camera.forward - upwards.forward).length() < 1e-12 && camera.position == upwards.position);
        control.go_to(point);
        assert_eq!(control.camera().position, DVec3::new(700.0, 300.0, 3.0));
    }

    #[test]
    fn gestures_turn_around_the_pivot_and_approach_it() {
        let mut control = control();
        let distance_m = 100.0 * 2f64.sqrt();
        control.turn(1.0);
        let camera = control.camera();
        assert!((camera.position + camera.forward * distance_m).length() < 1e-6, "{camera:?}");
        control.turn_north();
        assert!((control.camera().position - DVec3::new(0.0, -100.0, 100.0)).length() < 1e-6);
        control.approach(2.0);
        assert!((control.camera().position - DVec3::new(0.0, -50.0, 50.0)).length() < 1e-6);
        control.approach(1e-9);
        assert!((control.camera().position.length() - 1e5).abs() < 1e-3);
    }

    #[test]
    fn orbiting_keeps_the_ground_ahead_centred() {
        let mut control = control();
        for _ in 0..50 {
            control.drag(13.0, -3.0);
        }
        control.turn_wheel(2.0);
        let camera = control.camera();
        let to_pivot = -camera.position;
        assert!(to_pivot.cross(camera.forward).length() < 1e-6 * to_pivot.length());
        assert!((to_pivot.length() - 100.0 * 2f64.sqrt() * 0.88 * 0.88).abs() < 1e-6);
    }
}
