//! Steers the camera with keys and mouse: flying, or orbiting around a point.

use crate::camera::Camera;
use crate::collision::{CitySolids, EYE_HEIGHT_M};
use glam::DVec3;
use std::f64::consts::FRAC_PI_2;
use std::time::Duration;
use web_time::Instant;

/// Angle per pixel of dragging.
const DRAG_RAD_PER_PX: f64 = 0.004;
/// Largest pitch that the mouse and the keys lead to, a little under 90 degrees: the horizon stays level.
const MAX_PITCH_RAD: f64 = 1.55;
/// How far ahead the camera's motion is prefetched, in seconds.
const LOOKAHEAD_SECS: f64 = 0.5;
/// Factor of the speed while Shift is held.
const FAST_FACTOR: f64 = 4.0;
/// Longest time step of the camera. Without a limit, it would jump after a stall.
const MAX_STEP: Duration = Duration::from_millis(200);
/// A key that is pressed for a shorter time, perhaps within one slow frame, moves the camera for this time.
const MIN_PRESS: Duration = Duration::from_millis(50);
/// Distance that a colliding camera keeps from what is ahead.
const CLEARANCE_M: f64 = 0.5;
/// Highest step that a person takes.
const MAX_STEP_UP_M: f64 = 0.6;
/// Speed at the ground, in metres per second, and its increase per metre of height.
const GROUND_SPEED: f64 = 4.0;
const SPEED_PER_METRE: f64 = 0.4;
/// Share of the way to a point that a double click goes.
const APPROACH: f64 = 0.6;

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
    /// The camera is at the height of a person's eyes above the ground.
    Walk,
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
    /// Factor of the speed, by the wheel.
    speed_factor: f64,
    /// Height of the ground below the camera, as far as it is known.
    ground_z_m: f64,
    /// When the key of each [`MoveDirection`] was pressed, while it is held.
    held: [Option<Instant>; 6],
    is_fast: bool,
    /// What the user chose; by default, the mode decides.
    collision: Option<bool>,
    /// The last position that keys did not move the camera to, or that collision has checked.
    checked: DVec3,
    /// Time up to which the camera has moved.
    clock: Instant,
    /// Where the view began.
    home: Camera,
}

impl CameraControl {
    /// Starts at `camera` above ground of the given height.
    pub fn new(camera: &Camera, ground_z_m: f64) -> Self {
        let (yaw_rad, pitch_rad) = camera.angles();
        let mut control = Self {
            mode: ControlMode::Orbit,
            position: camera.position,
            yaw_rad,
            pitch_rad,
            fov_y_rad: camera.fov_y_rad,
            pivot_distance_m: 0.0,
            speed_factor: 1.0,
            ground_z_m,
            held: [None; 6],
            is_fast: false,
            collision: None,
            checked: camera.position,
            clock: Instant::now(),
            home: *camera,
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
        ahead.advance(self.held.map(|since| since.is_some()), LOOKAHEAD_SECS).then(|| ahead.camera())
    }

    /// The control mode.
    pub fn mode(&self) -> ControlMode {
        self.mode
    }

    /// Speed of the movement keys, in metres per second: the higher, the faster.
    pub fn speed_m_per_sec(&self) -> f64 {
        let height_m = (self.position.z - self.ground_z_m).max(0.0);
        ((GROUND_SPEED + SPEED_PER_METRE * height_m) * self.speed_factor).clamp(0.2, 5000.0)
    }

    /// Whether ground and buildings stop the camera: when walking, unless the user chose otherwise.
    pub fn collides(&self) -> bool {
        self.collision.unwrap_or(self.mode == ControlMode::Walk)
    }

    /// Switches [`CameraControl::collides`].
    pub fn toggle_collision(&mut self) {
        self.collision = Some(!self.collides());
    }

    /// Keeps a camera that keys have moved out of solids if it collides, and on the ground if it walks. `plane_z_m` is the height
    /// of the ground where no tile is resident.
    pub fn keep_outside(&mut self, solids: &CitySolids<'_>, plane_z_m: f64) {
        if self.collides() && self.position != self.checked {
            self.position = free_way(solids, self.checked, self.position);
        }
        if self.mode == ControlMode::Walk {
            let step = DVec3::Z * if self.collides() { MAX_STEP_UP_M - EYE_HEIGHT_M } else { 0.0 };
            if let Some(ground) = solids.ground_below(self.position + step) {
                self.position.z = ground + EYE_HEIGHT_M;
            }
        }
        self.checked = self.position;
        self.ground_z_m = solids.ground_below(self.position).unwrap_or(plane_z_m);
    }

    /// Lifts a camera that is inside of a building or below the ground to the roof or the ground. Returns whether it was.
    pub fn lift_out(&mut self, solids: &CitySolids<'_>) -> bool {
        let Some(z) = solids.lifted_eye_z(self.position) else { return false };
        self.position.z = z;
        self.checked = self.position;
        self.pivot_distance_m = self.distance_to_ground_m();
        true
    }

    /// Goes back to where the view began.
    pub fn go_home(&mut self) {
        let home = self.home;
        self.set_camera(&home);
    }

    /// Goes most of the way to `point`, which stays at its place in the view.
    pub fn approach(&mut self, point: DVec3) {
        self.position += (point - self.position) * APPROACH;
        self.checked = self.position;
        self.pivot_distance_m = self.distance_to_ground_m();
    }

    /// Switches from orbiting around the ground ahead to flying, walking, and back.
    pub fn toggle_mode(&mut self) {
        self.set_mode(match self.mode {
            ControlMode::Fly => ControlMode::Walk,
            ControlMode::Walk => ControlMode::Orbit,
            ControlMode::Orbit => ControlMode::Fly,
        });
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
        self.turn(FRAC_PI_2 - self.yaw_rad);
    }

    /// Moves along the view until what was at the pivot's distance appears `factor` times as large.
    pub fn zoom(&mut self, factor: f64) {
        if self.mode != ControlMode::Orbit {
            self.pivot_distance_m = self.distance_to_ground_m();
        }
        let (forward, before_m) = (self.camera().forward, self.pivot_distance_m);
        self.pivot_distance_m = (before_m / factor).clamp(2.0, 100_000.0);
        self.position += forward * (before_m - self.pivot_distance_m);
        self.checked = self.position;
    }

    /// Moves to `camera`. A walk ends, because it might be in the air.
    pub fn set_camera(&mut self, camera: &Camera) {
        if self.mode == ControlMode::Walk {
            self.mode = ControlMode::Fly;
        }
        (self.yaw_rad, self.pitch_rad) = camera.angles();
        (self.position, self.fov_y_rad) = (camera.position, camera.fov_y_rad);
        self.checked = self.position;
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
        self.checked = self.position;
        self.pivot_distance_m = self.distance_to_ground_m();
    }

    /// A movement key was pressed or released at a time.
    pub fn set_held(&mut self, direction: MoveDirection, is_held: bool, now: Instant) {
        if !self.is_moving() {
            self.clock = now;
        }
        self.advance_to(now);
        let key = &mut self.held[direction as usize];
        match (is_held, *key) {
            (true, None) => *key = Some(now),
            (false, Some(since)) => {
                *key = None;
                let lacking = MIN_PRESS.saturating_sub(now.saturating_duration_since(since));
                let mut only = [false; 6];
                only[direction as usize] = true;
                self.advance(only, lacking.as_secs_f64());
            }
            _ => {}
        }
    }

    /// Shift was pressed or released.
    pub fn set_fast(&mut self, is_fast: bool) {
        self.is_fast = is_fast;
    }

    /// Releases all keys, because the window lost the keyboard.
    pub fn release_keys(&mut self) {
        self.held = [None; 6];
        self.is_fast = false;
    }

    /// The mouse was dragged, in pixels to the right and down.
    pub fn drag(&mut self, dx_px: f64, dy_px: f64) {
        let pivot = self.pivot();
        self.yaw_rad -= dx_px * DRAG_RAD_PER_PX;
        self.pitch_rad = (self.pitch_rad - dy_px * DRAG_RAD_PER_PX).clamp(-MAX_PITCH_RAD, MAX_PITCH_RAD);
        if self.mode == ControlMode::Orbit {
            self.orbit(pivot);
        }
    }

    /// Moves along the ground by a distance on the screen, in pixels to the right and down, so that the pivot follows. `height_px` is
    /// the height of the view.
    pub fn pan(&mut self, dx_px: f64, dy_px: f64, height_px: f64) {
        if self.mode != ControlMode::Orbit {
            self.pivot_distance_m = self.distance_to_ground_m();
        }
        let camera = self.camera();
        let metres_per_px = 2.0 * (self.fov_y_rad * 0.5).tan() * self.pivot_distance_m / height_px.max(1.0);
        // The flatter the view, the more ground a pixel covers.
        let ahead = DVec3::new(self.yaw_rad.cos(), self.yaw_rad.sin(), 0.0) / self.pitch_rad.sin().abs().max(0.25);
        self.position += (ahead * dy_px - camera.right * dx_px) * metres_per_px;
        self.checked = self.position;
    }

    /// Tilts up by `angle_rad`, around the pivot when orbiting.
    pub fn tilt(&mut self, angle_rad: f64) {
        self.drag(0.0, -angle_rad / DRAG_RAD_PER_PX);
    }

    /// Sets the control mode.
    pub fn set_mode(&mut self, mode: ControlMode) {
        self.mode = mode;
        self.pivot_distance_m = self.distance_to_ground_m();
    }

    /// The wheel was turned, positive upwards: faster when flying, closer when orbiting.
    pub fn turn_wheel(&mut self, steps: f64) {
        match self.mode {
            ControlMode::Fly | ControlMode::Walk => {
                self.speed_factor = (self.speed_factor * 1.25f64.powf(steps)).clamp(0.01, 100.0);
            }
            ControlMode::Orbit => {
                let pivot = self.pivot();
                self.pivot_distance_m = (self.pivot_distance_m * 0.88f64.powf(steps)).clamp(2.0, 100_000.0);
                self.orbit(pivot);
            }
        }
    }

    /// Turns around `pivot`.
    fn orbit(&mut self, pivot: DVec3) {
        self.position = pivot - self.camera().forward * self.pivot_distance_m;
        self.checked = self.position;
    }

    fn pivot(&self) -> DVec3 {
        self.position + self.camera().forward * self.pivot_distance_m
    }

    /// Whether a movement key is held.
    pub fn is_moving(&self) -> bool {
        self.held.iter().any(Option::is_some)
    }

    /// Moves the camera by the held keys up to a time.
    pub fn advance_to(&mut self, now: Instant) {
        let step = now.saturating_duration_since(self.clock).min(MAX_STEP);
        self.clock = now;
        self.advance(self.held.map(|since| since.is_some()), step.as_secs_f64());
    }

    /// Moves the camera for `secs` in the directions of `held`. Returns whether it has a direction.
    fn advance(&mut self, held: [bool; 6], secs: f64) -> bool {
        let axis = |plus: MoveDirection, minus: MoveDirection| {
            f64::from(u8::from(held[plus as usize])) - f64::from(u8::from(held[minus as usize]))
        };
        let camera = self.camera();
        let forward = match self.mode {
            ControlMode::Fly => camera.forward,
            // The pivot stays at its height, and a person on the ground.
            ControlMode::Orbit | ControlMode::Walk => DVec3::new(self.yaw_rad.cos(), self.yaw_rad.sin(), 0.0),
        };
        let direction = forward * axis(MoveDirection::Forward, MoveDirection::Back)
            + camera.right * axis(MoveDirection::Right, MoveDirection::Left)
            + DVec3::Z * axis(MoveDirection::Up, MoveDirection::Down);
        let speed = self.speed_m_per_sec() * if self.is_fast { FAST_FACTOR } else { 1.0 };
        self.position += direction.normalize_or_zero() * speed * secs;
        direction != DVec3::ZERO
    }
}

/// How far a camera gets on the way between two points: one that would come too near to a solid slides along it, or stays.
fn free_way(solids: &CitySolids<'_>, from: DVec3, to: DVec3) -> DVec3 {
    let way = to - from;
    let is_free = |way: DVec3| {
        let ahead = way + way.normalize_or_zero() * CLEARANCE_M;
        solids.hit_on_way(from, from + ahead).is_none()
    };
    // One that is inside must be able to leave.
    if solids.is_inside(from) || is_free(way) {
        return to;
    }
    let slides = [DVec3::new(way.x, way.y, 0.0), DVec3::X * way.x, DVec3::Y * way.y, DVec3::Z * way.z];
    let longest = slides.into_iter().filter(|slide| is_free(*slide)).max_by(|a, b| a.length().total_cmp(&b.length()));
    from + longest.unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn control() -> CameraControl {
        let camera = Camera::look_at(DVec3::new(0.0, -100.0, 100.0), DVec3::ZERO, DVec3::Z, 1.0).unwrap();
        CameraControl::new(&camera, 0.0)
    }

    #[test]
    fn flying_moves_in_the_view_direction() {
        let mut control = control();
        control.toggle_mode();
        let begin = Instant::now();
        control.advance_to(begin);
        assert!(control.heading().is_none());
        control.set_held(MoveDirection::Forward, true, begin);
        control.advance_to(begin + Duration::from_millis(100));
        let d = 0.1 * 44.0 / 2f64.sqrt();
        assert!((control.camera().position - DVec3::new(0.0, -100.0 + d, 100.0 - d)).length() < 1e-9);
        assert!(control.heading().is_some());
        control.release_keys();
        assert!(!control.is_moving());
    }

    #[test]
    fn maps_look_straight_down() {
        let mut control = control();
        let down = Camera::from_angles(DVec3::new(5.0, 6.0, 70.0), 0.7, -FRAC_PI_2, 0.6);
        control.set_camera(&down);
        let camera = control.camera();
        assert!((camera.forward + DVec3::Z).length() < 1e-12 && (camera.right - down.right).length() < 1e-12);
    }

    #[test]
    fn keys_that_are_pressed_within_one_frame_move_the_camera() {
        let mut control = control();
        let (before, now) = (control.camera().position, Instant::now());
        for (direction, is_held) in [(MoveDirection::Up, true), (MoveDirection::Up, false), (MoveDirection::Up, false)]
        {
            control.set_held(direction, is_held, now);
        }
        let risen_m = control.camera().position.z - before.z;
        assert!((risen_m - 0.05 * 44.0).abs() < 1e-9, "{risen_m}");
        // Two keys whose times overlap move along each for its own time.
        let at = |ms: u64| now + Duration::from_millis(1000 + ms);
        let mut control = self::control();
        control.set_held(MoveDirection::Right, true, at(0));
        control.set_held(MoveDirection::Left, true, at(100));
        control.set_held(MoveDirection::Right, false, at(150));
        control.set_held(MoveDirection::Left, false, at(250));
        assert!((control.camera().position - before).length() < 1e-9);
        assert!(!control.is_moving());
    }

    #[test]
    fn home_and_north_are_found_again() {
        let mut control = control();
        let home = control.camera();
        control.drag(400.0, 20.0);
        let pivot = control.pivot();
        control.turn_north();
        assert!(control.camera().forward.x.abs() < 1e-9 && control.camera().forward.y > 0.0);
        assert!((control.pivot() - pivot).length() < 1e-6, "north is turned up around the pivot");
        let (point, before) = (DVec3::new(20.0, 30.0, 5.0), control.camera().position);
        control.approach(point);
        let (then, now) = (point - before, point - control.camera().position);
        assert!(then.cross(now).length() < 1e-6 && (now.length() / then.length() - 0.4).abs() < 1e-9);
        control.go_home();
        assert!((control.camera().position - home.position).length() < 1e-9);
        assert!((control.camera().forward - home.forward).length() < 1e-9);
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
    fn panning_keeps_the_point_ahead_under_the_pointer() {
        let mut control = control();
        let camera = control.camera();
        control.pan(30.0, 0.0, 600.0);
        let moved = control.camera().position - camera.position;
        let expected_m = 2.0 * 0.5f64.tan() * 100.0 * 2f64.sqrt() * 30.0 / 600.0;
        assert!((moved + camera.right * expected_m).length() < 1e-9, "{moved}");
        control.pan(0.0, 30.0, 600.0);
        let moved = control.camera().position - camera.position;
        assert!(moved.z.abs() < 1e-9 && (moved.y - expected_m * 2f64.sqrt()).abs() < 1e-9, "{moved}");
        control.tilt(0.2);
        assert!((control.camera().angles().1 - camera.angles().1 - 0.2).abs() < 1e-9);
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
        control.zoom(2.0);
        assert!((control.camera().position - DVec3::new(0.0, -50.0, 50.0)).length() < 1e-6);
        control.zoom(1e-9);
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
