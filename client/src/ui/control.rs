//! Keys and mouse into a camera: flying, or orbiting around a point.
//!
//! In: which keys are held, drags, wheel. Out: [`Camera`]. Next: `window` asks `session` for its picture.

use glam::DVec3;
use insula_viewer::camera::Camera;

/// Radians that a pixel of dragging turns.
const TURN_RAD_PER_PX: f64 = 0.004;
/// Never quite straight up or down: the horizon stays where it is.
const PITCH_MOST_RAD: f64 = 1.55;
/// Seconds that the camera's heading looks ahead.
const AHEAD_SECS: f64 = 0.5;
/// Holding shift multiplies the speed by this.
const FAST: f64 = 4.0;

/// A key that moves.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Motion {
    /// W.
    Forward,
    /// S.
    Back,
    /// A.
    Left,
    /// D.
    Right,
    /// E.
    Up,
    /// Q.
    Down,
}

/// How the camera is steered.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mode {
    /// The mouse turns the head, the keys move the eye.
    Fly,
    /// The mouse turns around a point, the keys move that point.
    Orbit,
}

/// The steered camera.
#[derive(Debug, Clone)]
pub struct Control {
    mode: Mode,
    position: DVec3,
    yaw_rad: f64,
    pitch_rad: f64,
    fov_y_rad: f64,
    distance_m: f64,
    speed_m_per_sec: f64,
    ground_z_m: f64,
    held: [bool; 6],
    fast: bool,
}

impl Control {
    /// Starts with `camera`, at a speed that suits a city of `size_m`.
    pub fn new(camera: &Camera, size_m: f64, ground_z_m: f64) -> Self {
        let (yaw_rad, pitch_rad) = camera.angles();
        let mut control = Self {
            mode: Mode::Orbit,
            position: camera.position,
            yaw_rad,
            pitch_rad,
            fov_y_rad: camera.fov_y_rad,
            distance_m: 0.0,
            speed_m_per_sec: (size_m / 20.0).clamp(5.0, 500.0),
            ground_z_m,
            held: [false; 6],
            fast: false,
        };
        control.distance_m = control.distance_to_ground();
        control
    }

    /// Where it looks from now.
    pub fn camera(&self) -> Camera {
        Camera::from_angles(self.position, self.yaw_rad, self.pitch_rad, self.fov_y_rad)
    }

    /// Where it will be in a moment, if a key is held.
    pub fn heading(&self) -> Option<Camera> {
        let mut ahead = self.clone();
        ahead.advance(AHEAD_SECS).then(|| ahead.camera())
    }

    /// How it is steered.
    pub fn mode(&self) -> Mode {
        self.mode
    }

    /// Metres a second.
    pub fn speed_m_per_sec(&self) -> f64 {
        self.speed_m_per_sec
    }

    /// Fly becomes orbit around what is ahead, and back.
    pub fn toggle(&mut self) {
        self.mode = match self.mode {
            Mode::Fly => Mode::Orbit,
            Mode::Orbit => Mode::Fly,
        };
        self.distance_m = self.distance_to_ground();
    }

    /// To the ground ahead, within reason.
    fn distance_to_ground(&self) -> f64 {
        let (height_m, down) = (self.position.z - self.ground_z_m, -self.camera().forward.z);
        if down > 0.02 && height_m > 0.0 { (height_m / down).clamp(5.0, 50_000.0) } else { 200.0 }
    }

    /// Looks as `camera` does.
    pub fn set(&mut self, camera: &Camera) {
        (self.yaw_rad, self.pitch_rad) = camera.angles();
        self.pitch_rad = self.pitch_rad.clamp(-PITCH_MOST_RAD, PITCH_MOST_RAD);
        (self.position, self.fov_y_rad) = (camera.position, camera.fov_y_rad);
        self.distance_m = self.distance_to_ground();
    }

    /// Brings `point` into the middle of the picture without turning; at its height, or looking up, goes there itself.
    pub fn go(&mut self, point: DVec3) {
        let forward = self.camera().forward;
        let above_m = self.position.z - point.z;
        if forward.z < -0.1 && above_m > 0.0 {
            self.position = point - forward * (above_m / -forward.z);
        } else {
            self.position = point.with_z(self.position.z.max(point.z + 1.7));
        }
        self.distance_m = self.distance_to_ground();
    }

    /// A key goes down or up.
    pub fn key(&mut self, motion: Motion, down: bool) {
        self.held[motion as usize] = down;
    }

    /// Shift goes down or up.
    pub fn fast(&mut self, down: bool) {
        self.fast = down;
    }

    /// All keys up: the window lost the keyboard.
    pub fn release(&mut self) {
        self.held = [false; 6];
        self.fast = false;
    }

    /// The mouse moved with its button down, in pixels to the right and down.
    pub fn drag(&mut self, dx_px: f64, dy_px: f64) {
        let pivot = self.pivot();
        self.yaw_rad -= dx_px * TURN_RAD_PER_PX;
        self.pitch_rad = (self.pitch_rad - dy_px * TURN_RAD_PER_PX).clamp(-PITCH_MOST_RAD, PITCH_MOST_RAD);
        if self.mode == Mode::Orbit {
            self.position = pivot - self.camera().forward * self.distance_m;
        }
    }

    /// The wheel turned; up is positive: faster, or nearer.
    pub fn wheel(&mut self, steps: f64) {
        match self.mode {
            Mode::Fly => self.speed_m_per_sec = (self.speed_m_per_sec * 1.25f64.powf(steps)).clamp(0.5, 5000.0),
            Mode::Orbit => {
                let pivot = self.pivot();
                self.distance_m = (self.distance_m * 0.88f64.powf(steps)).clamp(2.0, 100_000.0);
                self.position = pivot - self.camera().forward * self.distance_m;
            }
        }
    }

    fn pivot(&self) -> DVec3 {
        self.position + self.camera().forward * self.distance_m
    }

    /// Whether a key is held.
    pub fn moving(&self) -> bool {
        self.held.contains(&true)
    }

    /// Time passes; returns whether the camera moved.
    pub fn advance(&mut self, secs: f64) -> bool {
        let axis = |plus: Motion, minus: Motion| {
            f64::from(u8::from(self.held[plus as usize])) - f64::from(u8::from(self.held[minus as usize]))
        };
        let camera = self.camera();
        let ahead = match self.mode {
            Mode::Fly => camera.forward,
            // Orbiting, the point stays at its height.
            Mode::Orbit => DVec3::new(self.yaw_rad.cos(), self.yaw_rad.sin(), 0.0),
        };
        let way = ahead * axis(Motion::Forward, Motion::Back)
            + camera.right * axis(Motion::Right, Motion::Left)
            + DVec3::Z * axis(Motion::Up, Motion::Down);
        let speed = self.speed_m_per_sec * if self.fast { FAST } else { 1.0 };
        self.position += way.normalize_or_zero() * speed * secs;
        way != DVec3::ZERO
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn control() -> Control {
        let camera = Camera::look_at(DVec3::new(0.0, -100.0, 100.0), DVec3::ZERO, DVec3::Z, 1.0).unwrap();
        Control::new(&camera, 1000.0, 0.0)
    }

    #[test]
    fn flies_where_it_looks() {
        let mut c = control();
        c.toggle();
        assert!(!c.advance(1.0) && c.heading().is_none());
        c.key(Motion::Forward, true);
        assert!(c.advance(1.0));
        let d = 50.0 / 2f64.sqrt();
        assert!((c.camera().position - DVec3::new(0.0, -100.0 + d, 100.0 - d)).length() < 1e-9);
        assert!(c.heading().is_some());
        c.release();
        assert!(!c.moving());
    }

    #[test]
    fn goes_where_it_is_told() {
        let mut c = control();
        let place = DVec3::new(700.0, 300.0, 0.0);
        c.go(place);
        let camera = c.camera();
        assert!((place - camera.position).cross(camera.forward).length() < 1e-6, "{camera:?}");
        assert!((camera.position.z - 100.0).abs() < 1e-9, "{camera:?}");
        let other = Camera::from_angles(DVec3::new(1.0, 2.0, 3.0), 0.5, 0.6, 0.7);
        c.set(&other);
        assert!((c.camera().forward - other.forward).length() < 1e-12 && c.camera().position == other.position);
        c.go(place);
        assert_eq!(c.camera().position, DVec3::new(700.0, 300.0, 3.0));
    }

    #[test]
    fn orbits_around_the_ground_ahead() {
        let mut c = control();
        for _ in 0..50 {
            c.drag(13.0, -3.0);
        }
        c.wheel(2.0);
        let camera = c.camera();
        let to_pivot = -camera.position;
        assert!(to_pivot.cross(camera.forward).length() < 1e-6 * to_pivot.length());
        assert!((to_pivot.length() - 100.0 * 2f64.sqrt() * 0.88 * 0.88).abs() < 1e-6);
    }
}
