//! A camera as text, in view links and in addresses of pages: `X,Y,Z,AZIMUTH,PITCH,FOV`.
//!
//! Metres in the city's coordinates; degrees clockwise from the grid's north, upwards, and of the vertical field of view.

use crate::camera::Camera;
use glam::DVec3;
use insula_protocol::text::fixed;
#[cfg(target_arch = "wasm32")]
use wasm_bindgen::JsValue;

/// Largest accepted coordinate.
const MAX_COORDINATE_M: f64 = 1e10;

/// The text of a camera, to the millimetre.
pub fn format(camera: &Camera) -> String {
    let p = camera.position;
    let (azimuth, (_, pitch)) = (camera.azimuth_deg(), camera.angles());
    let (pitch, fov) = (pitch.to_degrees(), camera.fov_y_rad.to_degrees());
    [(p.x, 3), (p.y, 3), (p.z, 3), (azimuth, 4), (pitch, 4), (fov, 3)].map(|(v, decimals)| fixed(v, decimals)).join(",")
}

/// Parses a text that may come from anybody. `None` if it is not a camera.
pub fn parse(text: &str) -> Option<Camera> {
    let numbers: Vec<f64> = text.split(',').map(|n| number(n.trim())).collect::<Option<_>>()?;
    of_numbers(numbers.try_into().ok()?)
}

/// A finite number in decimal digits. `None` for anything else.
#[cfg(not(target_arch = "wasm32"))]
pub fn number(text: &str) -> Option<f64> {
    text.parse().ok().filter(|value: &f64| value.is_finite())
}

/// The same by the browser: the library's table of powers is 10 kB that cannot be compressed.
#[cfg(target_arch = "wasm32")]
pub fn number(text: &str) -> Option<f64> {
    let is_decimal = !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit() || b"+-.eE".contains(&byte));
    let value = if is_decimal { JsValue::from_str(text).unchecked_into_f64() } else { f64::NAN };
    Some(value).filter(|value| value.is_finite())
}

/// The camera of the six numbers of a text. `None` if they are out of range.
pub fn of_numbers([x, y, z, azimuth, pitch, fov]: [f64; 6]) -> Option<Camera> {
    let is_in_range = [x, y, z].iter().all(|v| v.abs() < MAX_COORDINATE_M);
    if !is_in_range || !azimuth.is_finite() || !(-90.0..=90.0).contains(&pitch) || !(1.0..=170.0).contains(&fov) {
        return None;
    }
    let yaw = (90.0 - azimuth).to_radians();
    Some(Camera::from_angles(DVec3::new(x, y, z), yaw, pitch.to_radians(), fov.to_radians()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_finite_and_decimal() {
        assert_eq!(["1", "-0.5", "+2", ".5", "5.", "1e3"].map(number), [1.0, -0.5, 2.0, 0.5, 5.0, 1e3].map(Some));
        assert_eq!(["", " 1", "inf", "NaN", "1e999", "0x10", "-", "1,0"].map(number), [None; 8]);
    }
}
