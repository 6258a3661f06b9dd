//! What keys mean.
//!
//! In: key codes. Out: [`Order`]s, and the help's lines. Next: `city`.

use super::control::Motion;
use insula_shaders::layout::Shading;
use winit::keyboard::KeyCode;

/// What a key asks for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Order {
    /// Move while it is held.
    Move(Motion),
    /// End the program.
    Quit,
    /// Fly or orbit.
    Steering,
    /// Show or hide the keys.
    Help,
    /// Write a picture.
    Picture,
    /// Show something else in pixels.
    Shading(Shading),
    /// Fill the screen, or not.
    FullScreen,
    /// Keep this view.
    Keep,
    /// Show or hide the list of views.
    Places,
    /// Copy a link to this view.
    Link,
    /// Begin or end a recording.
    Record,
    /// Measure, or stop that.
    Measure,
    /// Show or hide the map.
    Minimap,
    /// Show or hide the counters.
    Overlay,
    /// Count what rays do, or stop that.
    Counts,
    /// Sun shadows, or none.
    Shadows,
}

/// The help: keys, and what they do.
pub const HELP: [(&str, &str); 19] = [
    ("drag", "look around, or turn around the point ahead"),
    ("W A S D, arrows", "move; with shift, four times as fast"),
    ("Q E, page down and up", "down and up"),
    ("wheel", "speed (flying), distance (orbiting)"),
    ("Tab", "fly or orbit"),
    ("1 to 6, F2 to F7", "light, colour, ambient occlusion, normals, levels, column kinds"),
    ("B", "keep this view as a bookmark"),
    ("V", "bookmarks, and going to coordinates"),
    ("C", "copy a link to this view"),
    ("M", "measure between two clicks"),
    ("N", "map; a click goes there"),
    ("R", "record a path for insula fly; again to end"),
    ("P", "write a picture into the current folder"),
    ("O", "counters and sliders"),
    ("L", "sun shadows, or none"),
    ("K", "count what rays do when the picture rests"),
    ("F11", "full screen"),
    ("F1", "this help"),
    ("Esc", "quit"),
];

/// What a key asks for, if anything.
pub fn order(code: KeyCode) -> Option<Order> {
    Some(match code {
        KeyCode::KeyW | KeyCode::ArrowUp => Order::Move(Motion::Forward),
        KeyCode::KeyS | KeyCode::ArrowDown => Order::Move(Motion::Back),
        KeyCode::KeyA | KeyCode::ArrowLeft => Order::Move(Motion::Left),
        KeyCode::KeyD | KeyCode::ArrowRight => Order::Move(Motion::Right),
        KeyCode::KeyE | KeyCode::PageUp => Order::Move(Motion::Up),
        KeyCode::KeyQ | KeyCode::PageDown => Order::Move(Motion::Down),
        KeyCode::Escape => Order::Quit,
        KeyCode::Tab => Order::Steering,
        KeyCode::F1 => Order::Help,
        KeyCode::F11 => Order::FullScreen,
        KeyCode::KeyP => Order::Picture,
        KeyCode::KeyB => Order::Keep,
        KeyCode::KeyV => Order::Places,
        KeyCode::KeyC => Order::Link,
        KeyCode::KeyR => Order::Record,
        KeyCode::KeyM => Order::Measure,
        KeyCode::KeyN => Order::Minimap,
        KeyCode::KeyO => Order::Overlay,
        KeyCode::KeyK => Order::Counts,
        KeyCode::KeyL => Order::Shadows,
        KeyCode::Digit1 | KeyCode::F2 => Order::Shading(Shading::ALL[0]),
        KeyCode::Digit2 | KeyCode::F3 => Order::Shading(Shading::ALL[1]),
        KeyCode::Digit3 | KeyCode::F4 => Order::Shading(Shading::ALL[2]),
        KeyCode::Digit4 | KeyCode::F5 => Order::Shading(Shading::ALL[3]),
        KeyCode::Digit5 | KeyCode::F6 => Order::Shading(Shading::ALL[4]),
        KeyCode::Digit6 | KeyCode::F7 => Order::Shading(Shading::ALL[5]),
        _ => return None,
    })
}
