//! The window: keys, mouse, overlay.
//!
//! In: window events. Out: shots for `session`, drawn frames. Next: the screen.
