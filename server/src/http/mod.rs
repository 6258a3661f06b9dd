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

mod access;
mod address;
mod answer;
mod app;
mod connection;
mod error;
mod headers;
mod health;
mod listen;
mod manifest;
mod metrics;
mod packed;
mod page;
mod rate;
mod router;
mod state;
mod tile;
mod tile_cache;
mod tls;
mod watch;
mod worker;

pub use address::{NOT_A_TILE, TileAddress};
pub use app::{App, app};
pub use error::Problem;
pub use listen::{ServeError, Server, serve};
pub use state::AppState;
