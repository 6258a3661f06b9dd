//! Byte-level tools of the codecs: the only places that know bincode and zstd.

pub mod bincode;
pub mod varint;
pub mod zstd;
