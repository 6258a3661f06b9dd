//! Insula's tile server: baked cities over HTTP, and the commands that make and check them.
//!
//! In: city folders, requests. Out: responses. Next: `insula-client` streams them.
//!
//! Other programs embed it with [`store::Store::open`], [`config::ServeConfig`] and [`http::serve`].

pub mod args;
pub mod commands;
pub mod config;
pub mod http;
pub mod store;
pub mod telemetry;
