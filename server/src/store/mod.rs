//! Baked cities, opened once, replaced while they are served.
//!
//! In: where cities are (design 10). Out: a [`Store`]: manifests, and tiles as [`bytes::Bytes`] by layer and id.
//! Next: `http` serves them; the commands `inspect` and `verify` read them.
//!
//! When a city is opened, its manifest and its archives' directories are checked, and that every tile lies inside its file.
//! A tile's own checksums are checked each time it is read to be served: what is wrong is never handed out.

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
