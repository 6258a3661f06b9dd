//! Byte-level codecs: checked reading, varints, bincode, zstd and the two entropy coders.
//!
//! Within this crate, only these modules call the `bincode` and `zstd` crates.

pub mod bincode;
pub mod byte_reader;
pub mod object_names;
pub mod range;
pub(crate) mod rans;
#[cfg(any(target_arch = "wasm32", test))]
mod small_crc32;
pub mod varint;
pub mod zstd;

/// CRC-32 (IEEE 802.3), the checksum of tiles and mesh files.
pub fn checksum(bytes: &[u8]) -> u32 {
    extend_checksum(0, bytes)
}

/// The [`checksum`] of bytes that have the checksum `before`, and of further bytes behind them. That of no bytes is 0.
pub fn extend_checksum(before: u32, bytes: &[u8]) -> u32 {
    #[cfg(target_arch = "wasm32")]
    return small_crc32::extend(before, bytes);
    #[cfg(not(target_arch = "wasm32"))]
    {
        let mut hasher = crc32fast::Hasher::new_with_initial(before);
        hasher.update(bytes);
        hasher.finalize()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn checksum_of_parts_is_that_of_the_whole() {
        let bytes: Vec<u8> = (0..=255).collect();
        assert_eq!(extend_checksum(0, &[]), 0);
        for cut in [0, 1, 100, 256] {
            let (head, tail) = bytes.split_at(cut);
            assert_eq!(extend_checksum(extend_checksum(0, head), tail), checksum(&bytes));
            assert_eq!(small_crc32::extend(small_crc32::extend(0, head), tail), checksum(&bytes));
        }
    }
}
