//! Opened cities: manifests, and tiles as [`bytes::Bytes`] by layer and id.
//!
//! In: folders and URLs of baked cities. Out: a [`Store`]. Next: `http` serves it; `inspect` and `verify` read it.
//!
//! Opening a city checks its manifest, its archives' directories, and that every tile lies inside its file. The checksums of
//! a tile are checked at every read for a client, so that damaged bytes are never served.

mod archive;
mod blocks;
mod cities;
mod city;
mod directory;
mod disk;
mod error;
mod reload;
mod remote;
mod source;

pub use archive::Archive;
pub(crate) use blocks::StoreMetrics;
pub use cities::Store;
pub use city::{CityStore, MANIFEST_FILE};
pub use error::{ArchiveError, StoreError};
pub use reload::{RetentionPolicy, StoreReload};
pub use source::{Read, ReadError, Source};
