//! Baked cities over HTTP/1.1 and HTTP/2, in the clear or over TLS (design 11).
//!
//! In: a [`Store`](crate::store::Store), requests. Out: responses. Next: the client's fetch, browsers, caches in between.
//!
//! ```text
//! listen -> worker -> (tls) -> connection -> app -> tile      the way of nearly every request
//!                                             \--> router -> manifest, page, health
//! ```
//!
//! A URL's parts are looked up in maps made when the cities were opened; none of them ever becomes a path.

mod access_control;
mod catalog;
mod city_documents;
mod connection;
mod connection_state;
mod content_encoding;
mod health;
mod index_page;
mod manifest;
mod metrics;
mod problem;
mod rate_limit;
mod reload;
mod representation;
mod request_guard;
mod response;
mod router;
mod server;
mod service;
mod state;
mod tile;
mod tile_address;
mod tile_cache;
mod tls;
mod worker;

pub use problem::Problem;
pub use server::{HttpServer, ServeError, serve};
pub use service::{HttpService, app};
pub use state::AppState;
pub use tile_address::{NOT_A_TILE, TileAddress};
