//! Words of the atlas in serialised tiles: as bytes, little-endian, which is many times faster than word by word.

use serde::de::{Error, Visitor};
use serde::{Deserializer, Serializer};

/// Words (u32) of an atlas page: 16 KiB, one plane of a node.
pub const PAGE_WORDS: usize = 4096;

/// Bytes that the deserialiser holds, borrowed or owned.
struct WordBytes;

impl Visitor<'_> for WordBytes {
    type Value = Vec<u32>;

    fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("words of four bytes")
    }

    fn visit_bytes<E: Error>(self, bytes: &[u8]) -> Result<Vec<u32>, E> {
        let (words, []) = bytes.as_chunks() else { return Err(E::custom("a part of a word")) };
        Ok(words.iter().map(|word| u32::from_le_bytes(*word)).collect())
    }
}

fn to_bytes<'a>(words: impl Iterator<Item = &'a u32>) -> Vec<u8> {
    words.flat_map(|word| word.to_le_bytes()).collect()
}

pub(crate) mod pages {
    use super::*;

    pub(crate) fn serialize<S: Serializer>(pages: &[Box<[u32]>], serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_bytes(&to_bytes(pages.iter().flat_map(|page| page.iter())))
    }

    pub(crate) fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<Box<[u32]>>, D::Error> {
        let words = deserializer.deserialize_bytes(WordBytes)?;
        if !words.len().is_multiple_of(PAGE_WORDS) {
            return Err(D::Error::custom("a part of a page"));
        }
        Ok(words.chunks_exact(PAGE_WORDS).map(Box::from).collect())
    }
}

pub(crate) mod array {
    use super::*;

    pub(crate) fn serialize<const N: usize, S: Serializer>(words: &[u32; N], serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_bytes(&to_bytes(words.iter()))
    }

    pub(crate) fn deserialize<'de, const N: usize, D: Deserializer<'de>>(
        deserializer: D,
    ) -> Result<[u32; N], D::Error> {
        let words = deserializer.deserialize_bytes(WordBytes)?;
        words.try_into().map_err(|_| D::Error::custom("an array of another length"))
    }
}
