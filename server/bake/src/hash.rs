//! Shortened BLAKE3 hashes.

/// The first 16 bytes of a BLAKE3 hash.
pub(crate) type ShortHash = [u8; 16];

/// The first 16 bytes.
pub(crate) fn short_hash(hash: &blake3::Hash) -> ShortHash {
    std::array::from_fn(|i| hash.as_bytes()[i])
}

/// The first 16 hexadecimal digits.
pub(crate) fn short_hex(hash: &blake3::Hash) -> String {
    hash.to_hex().chars().take(16).collect()
}
