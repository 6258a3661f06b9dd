//! The landmarks of a mesh tile: their stones, and where the patterns of these begin.

use super::NO_OBJECT;
use crate::codec::byte_reader::ByteReader;
use crate::error::{DecodeError, check_limit, invalid_if};
use crate::manifest::MAX_STONES;

/// Maximum number of landmarks in a tile.
pub const MAX_LANDMARKS: usize = 64;
/// Anchors lie within this many metres of the leaf's corner along each axis.
pub const MAX_ANCHOR_M: f32 = 1e5;
const ENTRY_BYTES: usize = 17;
/// Maximum size of the section in bytes.
pub(super) const MAX_SECTION_BYTES: usize = MAX_LANDMARKS * ENTRY_BYTES;
/// Stands for a landmark in its own colours.
const NO_STONE: u8 = u8::MAX;

/// An object whose surface is smooth, with ambient occlusion at its vertices.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LandmarkObject {
    pub object: u32,
    /// Index into the manifest's `stones`; `None` if it has its own colours.
    pub stone: Option<u8>,
    /// Origin of the stone's pattern, in the coordinates of the tile's positions. It is the same place in all tiles, so that the
    /// pattern has no seam at the border of a leaf.
    pub anchor_m: [f32; 3],
}

/// The section's bytes. Fails as [`check`].
pub(super) fn encode(landmarks: &[LandmarkObject], objects: &[u32]) -> Result<Vec<u8>, DecodeError> {
    check(landmarks, objects)?;
    let mut bytes = Vec::with_capacity(landmarks.len() * ENTRY_BYTES);
    for LandmarkObject { object, stone, anchor_m } in landmarks {
        bytes.extend(object.to_le_bytes());
        bytes.push(stone.unwrap_or(NO_STONE));
        anchor_m.iter().for_each(|v| bytes.extend(v.to_le_bytes()));
    }
    Ok(bytes)
}

/// Reads a section. Fails if it is no list of entries, and as [`check`].
pub(super) fn decode(section: &[u8], objects: &[u32]) -> Result<Vec<LandmarkObject>, DecodeError> {
    let mut reader = ByteReader::new(section);
    let count = section.len() / ENTRY_BYTES;
    check_limit("the number of a mesh tile's landmarks", count, MAX_LANDMARKS)?;
    let mut landmarks = Vec::with_capacity(count);
    for _ in 0..count {
        let (object, stone) = (reader.u32()?, Some(reader.u8()?).filter(|stone| *stone != NO_STONE));
        landmarks.push(LandmarkObject { object, stone, anchor_m: [reader.f32()?, reader.f32()?, reader.f32()?] });
    }
    reader.finish()?;
    check(&landmarks, objects)?;
    Ok(landmarks)
}

/// Fails if there are too many entries, if they are not ascending by object, if an object has no triangle, or if a number is out of
/// range.
pub(super) fn check(landmarks: &[LandmarkObject], objects: &[u32]) -> Result<(), DecodeError> {
    check_limit("the number of a mesh tile's landmarks", landmarks.len(), MAX_LANDMARKS)?;
    invalid_if(!landmarks.is_sorted_by(|a, b| a.object < b.object), "a mesh tile's landmarks are not in order")?;
    for entry in landmarks {
        // Comparisons with NaN are false.
        let is_near = entry.anchor_m.iter().all(|v| v.abs() <= MAX_ANCHOR_M);
        if !is_near || entry.stone.is_some_and(|stone| usize::from(stone) >= MAX_STONES) {
            return Err(DecodeError::Invalid("a landmark has a number out of range"));
        }
        invalid_if(entry.object == NO_OBJECT || !objects.contains(&entry.object), "a landmark has no triangle")?;
    }
    Ok(())
}
