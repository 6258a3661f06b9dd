//! Baked cities, opened once, replaced while they are served.
//!
//! In: where cities are (design 10). Out: a [`Store`]: manifests, and tiles as [`bytes::Bytes`] by kind and id.
//! Next: `http` serves them; the commands `inspect` and `verify` read them.
//!
//! `insula-archive` checks the manifest and the directories when a city is opened, and the checksums of a tile each time it is
//! served. No damaged tile is served.

mod cities;
mod city;
mod error;
mod reload;
mod remote;
mod requests;

pub use cities::Store;
pub use city::CityStore;
pub use error::StoreError;
pub use reload::{RetentionPolicy, StoreReload};
pub(crate) use requests::StoreMetrics;
