//! Formats and codecs that both sides of Insula speak.
//!
//! In: bytes, or values. Out: values, or bytes, or a typed error. Next: `insula-bake` writes them, `insula-server` carries
//! them, `insula-client` reads them.
//!
//! No I/O, no async, no GPU, no logging. Decoders take bytes that anyone may have made: they never panic, never read
//! outside, never allocate more than the limits stated in `docs/formats.md`.

pub mod blockmap;
pub mod codec;
pub mod error;
pub mod manifest;
pub mod mesh;
pub mod mesh_tile;
pub mod octahedral;
pub mod route;
pub mod subtree;
pub mod texel;
pub mod tile;
pub mod tile_id;

pub use blockmap::{BlockMap, NODE_CELLS};
pub use error::DecodeError;
pub use manifest::Manifest;
pub use mesh_tile::MeshTile;
pub use subtree::Subtree;
pub use texel::Texel;
pub use tile::TileKind;
pub use tile_id::TileId;
