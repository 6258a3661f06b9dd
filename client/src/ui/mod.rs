//! The window: keys, mouse, panels.
//!
//! In: window events. Out: shots for `session`, drawn frames. Next: the screen.

pub mod city;
pub mod control;
pub mod keys;
pub mod link;
pub mod measure;
pub mod minimap;
mod orders;
pub mod overlay;
pub mod pace;
pub mod places;
pub mod record;
pub mod settings;
pub mod shell;
pub mod surface;
pub mod tour;
pub mod window;
