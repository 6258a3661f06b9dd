//! Opened cities: manifests, and tiles as [`bytes::Bytes`] by kind and id.
//!
//! In: folders and URLs of baked cities. Out: a [`Store`]. Next: `http` serves it; `inspect` and `verify` read it.
//!
//! `insula-archive` reads the cities. Opening one checks its manifest, its archives' directories, and that every tile lies
//! inside its file. The checksums of a tile are checked at every read for a client, so that damaged bytes are never served.

mod cities;
mod city;
mod error;
#[cfg(feature = "bake")]
mod export_source;
mod folder_reads;
mod objects;
mod reload;
mod remote;
mod requests;
mod same_host;
mod search;

pub use cities::{RetentionPolicy, Store, StoreReload};
pub use city::CityStore;
pub use error::StoreError;
#[cfg(feature = "bake")]
pub use export_source::{ReadTileFn, StoredCity};
pub use objects::{ObjectError, StoredObjects};
pub(crate) use requests::StoreMetrics;
#[cfg(feature = "bake")]
pub(crate) use same_host::SameHostConnector;
pub use search::{CityIndex, SearchFileError};
