//! Byte-level tools of the codecs: the only places that know bincode and zstd, and the range coder, the coder of symbols.

pub mod bincode;
pub mod range;
pub mod rans;
pub mod varint;
pub mod zstd;

/// CRC-32 (of IEEE 802.3), as tiles and mesh files carry it.
pub fn checksum(bytes: &[u8]) -> u32 {
    crc32fast::hash(bytes)
}
