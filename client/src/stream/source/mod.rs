//! Sources of tiles that only a native client has: folders, and the disk cache before any other source.

pub mod disk;
pub mod folder;
