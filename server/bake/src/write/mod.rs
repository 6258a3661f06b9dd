//! Writes finished tiles to disk as a city folder, completely or not at all.
//!
//! A city folder has `city.json`, `blockmaps.pmtiles`, `subtrees.pmtiles`, `fingerprints.bin` and `thumbnail.jpg`, and
//! `meshes.pmtiles`, `objects.pmtiles`, `search.index` and `visibility.pmtiles` if it has meshes, objects, texts of objects and
//! visibility. Until the final rename everything is in `CITY.partial` (`scratch_folder`): finished tiles in packs (`tile_pack`),
//! so that an interrupted bake can continue, then the final files (`archive`, `city`).

pub(crate) mod archive;
mod attributions;
pub(crate) mod city;
pub(crate) mod files;
pub(crate) mod fingerprints;
mod focus;
mod known_sources;
mod location;
pub(crate) mod objects;
pub(crate) mod ownership;
pub(crate) mod scratch_folder;
mod sea;
mod search;
mod thumbnail;
pub(crate) mod tile_bytes;
pub(crate) mod tile_pack;
pub(crate) mod tile_tree;
mod visibility;
