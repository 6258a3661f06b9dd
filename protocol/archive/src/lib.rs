//! Reads a baked city by byte ranges, wherever its archives are: in files, in object stores, behind web servers.
//!
//! A place implements [`RangeSource`]. [`Archive`] checks all directories of an archive when it is opened, for programs that
//! serve or check whole cities. [`LazyArchive`] reads none but those that it needs, for clients. Archives may come from anyone: every length and
//! offset is checked, and all memory is bounded, before it is used.
//!
//! Without the feature `fs` the crate has no file access and compiles to WebAssembly.

#[cfg(feature = "block-cache")]
pub mod block_cache;
pub mod city;
mod directory;
#[cfg(feature = "fs")]
pub mod directory_writer;
#[cfg(feature = "fs")]
pub mod disk_cache;
pub mod error;
#[cfg(feature = "fs")]
pub mod file;
#[cfg(feature = "fs")]
pub mod file_source;
pub mod index;
pub mod joined;
pub mod lazy;
pub mod limits;
pub mod mark;
#[cfg(feature = "fs")]
pub mod new_file;
#[cfg(feature = "fs")]
pub mod open_files;
#[cfg(feature = "fs")]
pub mod owned;
#[cfg(feature = "fs")]
pub mod places;
pub mod resident_directories;
pub mod source;
#[cfg(test)]
mod test_support;

pub use city::{BakedCity, CityArchives};
pub use error::{ArchiveError, CityError, ReadError};
pub use index::Archive;
pub use lazy::{LazyArchive, LazyCity};
pub use source::{RangeRead, RangeSource, SharedSource};
