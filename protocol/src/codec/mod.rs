//! Byte-level tools of the codecs: the only places that know bincode and zstd, and the range coder, the coder of symbols.

pub mod bincode;
pub mod range;
pub mod rans;
pub mod varint;
pub mod zstd;
