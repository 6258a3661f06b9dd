//! Baked cities over HTTP/1.1 and HTTP/2 (design 11).
//!
//! In: a [`Store`](crate::store::Store), requests. Out: responses. Next: the client's fetch, browsers, caches in between.
//!
//! A URL's parts are looked up in maps made when the cities were opened; none of them ever becomes a path.

mod error;
mod headers;
mod health;
mod in_flight;
mod listen;
mod manifest;
mod metrics;
mod page;
mod router;
mod state;
mod tile;

pub use error::Problem;
pub use listen::serve;
pub use router::app;
pub use state::AppState;
