//! The window: input, panels, frame pacing, presentation.
//!
//! [`event_loop`] receives window events and passes them to [`viewport`], which moves the camera, streams, draws and lays out
//! the panels. [`city_view`] is the state of the viewed city; [`actions`] changes it on request of keys and panels.

pub mod actions;
pub mod bookmarks;
pub mod box_view;
pub mod city_chooser;
pub mod city_view;
pub mod compass;
pub mod connector;
pub mod event_loop;
pub mod furniture;
pub mod key_bindings;
pub mod measure_view;
pub mod minimap;
mod object_panel;
mod object_source;
pub mod outlined;
pub mod overlay;
pub mod path_playback;
pub mod path_recording;
mod picking;
pub mod picture_job;
mod picture_saving;
pub mod picture_size;
pub mod pointer_readout;
mod process_memory;
pub mod projection;
mod proposal_panel;
pub mod scale_bar;
mod search_panel;
pub mod settings;
mod stone_panel;
pub mod stream_status;
mod style_panel;
pub mod touchpad;
pub mod view_link;
mod view_log;
pub mod viewport;
pub mod window;
pub mod window_surface;
