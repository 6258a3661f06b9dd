//! Byte-level tools of the codecs: the only places that know bincode and zstd, and the range coder.

pub mod bincode;
pub mod range;
pub mod varint;
pub mod zstd;
