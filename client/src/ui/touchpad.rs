//! Touchpad gestures, as motions of the camera.
//!
//! winit reports pinches and rotations on macOS and Wayland, and two-finger scrolling in pixels.

use winit::event::{MouseScrollDelta, WindowEvent};

/// Pixels of a touchpad that count as one step of a mouse wheel.
const PX_PER_WHEEL_STEP: f64 = 40.0;
/// Largest magnification of one event. The deltas come from outside.
const MAX_PINCH: f64 = 4.0;

/// A motion of the camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum GestureMotion {
    /// Turn the wheel by these steps, positive upwards.
    Wheel(f64),
    /// Drag by pixels to the right and down.
    Drag(f64, f64),
    /// Move along the view until the point ahead appears this many times as large.
    Approach(f64),
    /// Turn to the left, in radians.
    Turn(f64),
}

/// The motion of an event; `None` if it is no gesture, no wheel, or not a number.
pub fn motion_of(event: &WindowEvent) -> Option<GestureMotion> {
    let motion = match event {
        WindowEvent::MouseWheel { delta, .. } => scrolled(*delta),
        WindowEvent::PinchGesture { delta, .. } => GestureMotion::Approach(magnification(*delta)?),
        // Degrees, positive counterclockwise: the city follows the fingers, so the camera turns the other way.
        WindowEvent::RotationGesture { delta, .. } => GestureMotion::Turn(-f64::from(*delta).to_radians()),
        WindowEvent::PanGesture { delta, .. } => GestureMotion::Drag(f64::from(delta.x), f64::from(delta.y)),
        _ => return None,
    };
    let is_finite = match motion {
        GestureMotion::Drag(x, y) => x.is_finite() && y.is_finite(),
        GestureMotion::Wheel(v) | GestureMotion::Approach(v) | GestureMotion::Turn(v) => v.is_finite(),
    };
    is_finite.then_some(motion)
}

/// Scrolling with a wheel, or with two fingers: up and down like a wheel, sideways turns the view. The larger component
/// decides, because fingers never move along an axis exactly.
fn scrolled(delta: MouseScrollDelta) -> GestureMotion {
    match delta {
        MouseScrollDelta::LineDelta(_, y) => GestureMotion::Wheel(f64::from(y)),
        MouseScrollDelta::PixelDelta(at) if at.x.abs() > at.y.abs() => GestureMotion::Drag(at.x, 0.0),
        MouseScrollDelta::PixelDelta(at) => GestureMotion::Wheel(at.y / PX_PER_WHEEL_STEP),
    }
}

/// The magnification of a pinch: 0.1 is a tenth larger, negative is smaller.
fn magnification(delta: f64) -> Option<f64> {
    let factor = if delta >= 0.0 { 1.0 + delta } else { 1.0 / (1.0 - delta) };
    factor.is_finite().then(|| factor.clamp(1.0 / MAX_PINCH, MAX_PINCH))
}

#[cfg(test)]
mod tests {
    use super::*;
    use winit::dpi::PhysicalPosition;
    use winit::event::{DeviceId, TouchPhase};

    fn wheel(delta: MouseScrollDelta) -> WindowEvent {
        WindowEvent::MouseWheel { device_id: DeviceId::dummy(), delta, phase: TouchPhase::Moved }
    }

    #[test]
    fn scrolling_is_a_wheel_or_a_turn() {
        let pixels = |x, y| wheel(MouseScrollDelta::PixelDelta(PhysicalPosition::new(x, y)));
        assert_eq!(motion_of(&wheel(MouseScrollDelta::LineDelta(3.0, -2.0))), Some(GestureMotion::Wheel(-2.0)));
        assert_eq!(motion_of(&pixels(3.0, 80.0)), Some(GestureMotion::Wheel(2.0)));
        assert_eq!(motion_of(&pixels(-30.0, 8.0)), Some(GestureMotion::Drag(-30.0, 0.0)));
        assert_eq!(motion_of(&pixels(0.0, f64::NAN)), None);
        assert_eq!(motion_of(&WindowEvent::Focused(true)), None);
    }

    #[test]
    fn pinches_move_and_rotations_turn() {
        let (device_id, phase) = (DeviceId::dummy(), TouchPhase::Moved);
        let pinch = |delta| motion_of(&WindowEvent::PinchGesture { device_id, delta, phase });
        let factor = |delta| match pinch(delta) {
            Some(GestureMotion::Approach(factor)) => factor,
            other => panic!("{other:?}"),
        };
        assert_eq!(factor(0.25), 1.25);
        assert!((factor(0.3) * factor(-0.3) - 1.0).abs() < 1e-12, "there and back ends where it began");
        assert_eq!((factor(1e9), factor(-1e9)), (MAX_PINCH, 1.0 / MAX_PINCH));
        assert_eq!(pinch(f64::NAN), None);
        let turned = motion_of(&WindowEvent::RotationGesture { device_id, delta: 90.0, phase });
        assert_eq!(turned, Some(GestureMotion::Turn(-std::f64::consts::FRAC_PI_2)));
        let delta = PhysicalPosition::new(3.0, -4.0);
        assert_eq!(
            motion_of(&WindowEvent::PanGesture { device_id, delta, phase }),
            Some(GestureMotion::Drag(3.0, -4.0))
        );
    }
}
