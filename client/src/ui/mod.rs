//! The window: keys, mouse, overlay.
//!
//! In: window events. Out: shots for `session`, drawn frames. Next: the screen.

pub mod control;
pub mod overlay;
pub mod surface;
pub mod window;
