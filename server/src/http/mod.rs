//! Baked cities over HTTP/1.1 and HTTP/2, with or without TLS.
//!
//! ```text
//! server -> worker -> (tls) -> connection -> service -> cached_tiles -> router -> tile, search, draw, analyse, manifest, index_page,
//!                                                                                       city_page, viewer_files, health
//! search, filter, group, tileset, draw, analyse -> work_queues -> fair_queue     the routes that compute
//! operations -> service -> router                             a listener of its own for health and metrics
//! ```
//!
//! The parts of a URL are only looked up in maps that were built when the cities were opened. None of them is ever used as a
//! file system path.

mod accept;
mod access_control;
#[cfg(feature = "bake")]
mod analyse;
mod catalog;
mod city_documents;
mod city_page;
mod client_usage;
mod computed_cache;
mod connection;
mod connection_state;
mod content_encoding;
#[cfg(feature = "bake")]
mod draw;
mod fair_queue;
mod filter;
mod group;
mod health;
mod hung_disk;
mod in_flight;
mod index_page;
mod log_limit;
mod manifest;
mod metrics;
mod page_request;
mod page_response;
#[cfg(feature = "bake")]
mod posted;
mod problem;
#[cfg(feature = "bake")]
mod proposals;
mod rate_limit;
mod reload;
mod representation;
mod request_guard;
mod request_host;
mod response;
mod response_body;
mod router;
mod search;
mod server;
mod service;
mod state;
mod stream_progress;
mod thread_state;
mod tile;
mod tile_cache;
#[cfg(feature = "bake")]
mod tileset;
mod tls;
mod turns;
mod work_queues;
#[cfg(feature = "bake")]
mod work_threads;
mod worker;
mod wrong_address;

pub use city_documents::OPENAPI;
pub use problem::Problem;
pub use server::{HttpServer, ServeError, serve};
pub use service::HttpService;
pub use state::AppState;
