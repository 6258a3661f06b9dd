//! Carries out the page's commands.

use super::navigation::CameraFlight;
use super::viewer::{CityViewer, clamped_size, clamped_tau};
use glam::DVec3;
use insula_shaders::layout::Shading;
use insula_shaders::look::Look;
use insula_viewer::camera::Camera;
use insula_viewer::camera_text;
use insula_viewer::sun::parse_time;
use insula_viewer::switching::{SwitchDistances, SwitchVolume};
use insula_web_host::commands::{Command, MeasureCommand, OptionsCommand};
use insula_web_host::host::to_js;
use wasm_bindgen::prelude::*;
use web_time::Instant;

/// Most markers, and most points of all lines: each frame searches for what hides them.
const MAX_POINTS: usize = 1000;
/// Height above a point, in metres, from which it is looked at, unless the camera is higher.
const VISIT_HEIGHT_M: f64 = 150.0;

#[wasm_bindgen]
impl CityViewer {
    /// Carries out a command (JSON, see `Command`). Fails if it is not one.
    pub fn command(&mut self, json: &str) -> Result<(), JsError> {
        let command = serde_json::from_str(json).map_err(to_js)?;
        match command {
            Command::Markers { points } => {
                check_count(points.len())?;
                self.markers = points.into_iter().map(DVec3::from).collect();
            }
            Command::Lines { lines } => {
                check_count(lines.iter().map(Vec::len).sum())?;
                self.lines = lines.into_iter().map(|line| line.into_iter().map(DVec3::from).collect()).collect();
            }
            Command::Measure(action) => self.measure(&action),
            Command::Resize { width, height } => {
                self.size_px = clamped_size(width, height);
            }
            Command::Time { time } => {
                self.daylight.set_time(&parse_time(&time).map_err(to_js)?);
            }
            Command::Day { running } => {
                if running != self.day.is_running() {
                    self.day.toggle(Instant::now());
                }
            }
            Command::Options(OptionsCommand { tau, fps, distances, shadows, shading, look }) => {
                self.set_options(tau, shadows);
                if let Some(text) = distances {
                    let metres: Vec<f64> =
                        text.split(',').filter_map(|metres| camera_text::number(metres.trim())).collect();
                    self.switching = SwitchDistances::new(&metres, SwitchVolume::Box);
                }
                if let Some(fps) = fps {
                    self.pacer.set_frame_rate(fps);
                }
                self.shading = chosen(&Shading::ALL, shading).unwrap_or(self.shading);
                self.daylight.look = chosen(&Look::ALL, look).unwrap_or(self.daylight.look);
            }
            steering => self.steer(steering)?,
        }
        Ok(())
    }
}

#[wasm_bindgen]
impl CityViewer {
    /// Whether the camera is on its way to where a command sent it.
    #[wasm_bindgen(js_name = isFlying)]
    pub fn is_flying(&self) -> bool {
        self.flight.is_some()
    }
}

impl CityViewer {
    /// A command that moves the camera. Ends a flight, unless it only lets keys go: a page that loses the focus does that.
    fn steer(&mut self, command: Command) -> Result<(), JsError> {
        let now = Instant::now();
        if !matches!(command, Command::Release {} | Command::Fast { .. } | Command::Move { held: false, .. }) {
            self.flight = None;
        }
        let height_px = f64::from(self.size_px[1]);
        match command {
            Command::Move { direction, held } => self.control.set_held(direction.into(), held, now),
            Command::Fast { held } => self.control.set_fast(held),
            Command::Release {} => self.control.release_keys(),
            Command::Drag { dx, dy } => self.control.drag(dx, dy),
            Command::Pan { dx, dy } => self.control.pan(dx, dy, height_px),
            Command::Zoom { factor } if factor.is_finite() && factor > 0.0 => self.control.zoom(factor),
            Command::Wheel { steps } => self.control.turn_wheel(steps.clamp(-50.0, 50.0)),
            Command::Turn { rad } => self.control.turn(rad),
            Command::Tilt { rad } => self.control.tilt(rad),
            Command::Approach { x, y } => {
                if let Some((point, _)) = self.surface_at(x, y) {
                    self.control.approach(point);
                }
            }
            Command::Mode { mode } => self.control.set_mode(mode.into()),
            Command::North {} => self.control.turn_north(),
            Command::Home {} => self.control.go_home(),
            Command::Collision { on } => {
                if on != self.control.collides() {
                    self.control.toggle_collision();
                }
            }
            Command::Camera { camera, seconds } => {
                let camera = camera_text::parse(&camera)
                    .ok_or_else(|| JsError::new("a camera is X,Y,Z,AZIMUTH,PITCH,FOV in metres and degrees"))?;
                self.fly_to(camera, seconds.unwrap_or(0.0));
            }
            Command::Goto { position, seconds } => {
                let camera = self.visiting(position.into());
                self.fly_to(camera, seconds.unwrap_or(0.0));
            }
            _ => {}
        }
        Ok(())
    }

    fn fly_to(&mut self, camera: Camera, seconds: f64) {
        if seconds > 0.0 {
            self.flight = Some(CameraFlight::new(self.control.camera(), camera, seconds, Instant::now()));
        } else {
            self.control.set_camera(&camera);
        }
    }

    /// A camera that looks at a point from where it can be seen; the present one if the point is none.
    fn visiting(&self, point: DVec3) -> Camera {
        let mut control = self.control.clone();
        let camera = control.camera();
        if !point.is_finite() {
            return camera;
        }
        let least_m = point.z + VISIT_HEIGHT_M;
        if camera.forward.z > -0.3 || camera.position.z < least_m {
            let (yaw, _) = camera.angles();
            let position = camera.position.with_z(camera.position.z.max(least_m));
            control.set_camera(&Camera::from_angles(position, yaw, -0.7, camera.fov_y_rad));
        }
        control.go_to(point);
        control.camera()
    }

    fn set_options(&mut self, tau_px: Option<f64>, shadows: Option<bool>) {
        if let Some(tau_px) = tau_px {
            self.tau_px = clamped_tau(tau_px);
        }
        if let Some(shadows) = shadows {
            self.daylight.shadows = shadows;
        }
    }

    fn measure(&mut self, action: &MeasureCommand) {
        match *action {
            MeasureCommand::Start {} if !self.measure.is_active => self.measure.toggle(),
            MeasureCommand::Stop {} if self.measure.is_active => self.measure.toggle(),
            MeasureCommand::Kind { kind } => self.measure.set_kind(kind.into()),
            MeasureCommand::Click { x, y } => {
                if let Some((point, _)) = self.surface_at(x, y) {
                    self.measure.add_point(point);
                }
            }
            MeasureCommand::Undo {} => self.measure.undo(),
            MeasureCommand::Clear {} => self.measure.clear(),
            MeasureCommand::Start {} | MeasureCommand::Stop {} => {}
        }
    }
}

/// Fails if there are more points than a frame has time for.
fn check_count(points: usize) -> Result<(), JsError> {
    if points > MAX_POINTS {
        return Err(JsError::new(&format!("{points} points: at most {MAX_POINTS} are shown")));
    }
    Ok(())
}

/// The choice with a number, which the page has sent.
fn chosen<T: Copy>(all: &[T], number: Option<usize>) -> Option<T> {
    all.get(number?).copied()
}
