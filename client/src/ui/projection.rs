//! From points of the city to positions on the screen.

use egui::{Pos2, Rect, pos2};
use glam::{DVec2, DVec3};
use insula_viewer::camera::View;
use insula_viewer::projection;

/// Position of a point on the screen; `None` behind the camera.
pub fn project(view: &View, point: DVec3, screen: Rect) -> Option<Pos2> {
    projection::project(view, point).map(|share| on_screen(share, screen))
}

/// Ends of a line on the screen: its part in front of the camera; `None` if there is none.
pub fn project_line(view: &View, ends: [DVec3; 2], screen: Rect) -> Option<[Pos2; 2]> {
    projection::project_line(view, ends).map(|ends| ends.map(|share| on_screen(share, screen)))
}

/// A place on the screen of shares of its width and height.
pub fn on_screen(share: DVec2, screen: Rect) -> Pos2 {
    let at = |share: f64, low: f32, high: f32| low + (high - low) * share as f32;
    pos2(at(share.x, screen.left(), screen.right()), at(share.y, screen.top(), screen.bottom()))
}
