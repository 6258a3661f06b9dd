//! Formats, codecs and addresses of Insula: bytes to values or typed errors, and back.
//!
//! The bake writes these formats, the server carries them, and the client reads them. The crate has no I/O, no async,
//! no GPU and no logging. Decoders accept untrusted bytes: they never panic, never read out of bounds, and never
//! allocate more than the limits in `docs/formats.md`.

pub mod area;
pub mod blockmap;
pub mod codec;
pub mod earth;
pub mod error;
pub mod manifest;
pub mod mesh;
pub mod mesh_tile;
pub mod name;
pub mod object_tile;
pub mod octahedral;
pub mod release;
pub mod route;
pub mod sea;
pub mod subtree;
pub mod texel;
pub mod text;
pub mod tile;
pub mod tile_group;
pub mod tile_id;
pub mod visibility_tile;

pub use blockmap::{BlockMap, NODE_CELLS};
pub use error::DecodeError;
pub use manifest::Manifest;
pub use mesh_tile::MeshTile;
pub use subtree::Subtree;
pub use texel::Texel;
pub use tile::TileKind;
pub use tile_group::TileGroup;
pub use tile_id::TileId;
pub use visibility_tile::VisibilityTile;
