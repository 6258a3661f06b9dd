//! Insula's tile server: serves baked cities over HTTP, and provides the commands that make and check them.
//!
//! Other programs embed the server with [`store::Store::open`], [`config::ServeConfig`] and [`http::serve`].

#[cfg(feature = "bake")]
mod analysis;
#[cfg(feature = "bake")]
mod area_file;
pub mod args;
pub mod commands;
pub mod config;
mod discovery;
pub mod http;
pub mod labels;
pub mod memory;
pub mod page;
#[cfg(feature = "bake")]
pub mod proposal;
mod secret_file;
pub mod share_link;
pub mod store;
