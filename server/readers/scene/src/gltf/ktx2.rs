//! KTX2 images with ETC1S or UASTC texels.

use super::fault::{Budget, Fault};
use crate::bytes::{u32_at, u64_at};
use std::borrow::Cow;
use std::io::Read;

const MAGIC: &[u8] = b"\xabKTX 20\xbb\r\n\x1a\n";
/// Bytes before the index of levels.
const HEADER_BYTES: usize = 80;
/// Bytes of an entry of that index: offset, length and unpacked length.
const LEVEL_BYTES: usize = 24;
const ZSTANDARD: u32 = 2;
/// No image of a city is wider.
const MAX_SIDE: u32 = 1 << 15;
const KIND: &str = "KTX2 image cannot be read";

/// Decoded texels from the top.
pub(super) struct Texels {
    pub(super) width: u32,
    pub(super) height: u32,
    pub(super) rgba: Vec<[u8; 4]>,
}

pub(super) fn is_ktx2(bytes: &[u8]) -> bool {
    bytes.starts_with(MAGIC)
}

/// Decodes the largest level.
pub(super) fn decode(bytes: &[u8], budget: &Budget) -> Result<Texels, Fault> {
    let fault = |what: &str| Fault::new(KIND, what);
    let cut = || fault("its header is cut short");
    let [width, height] = [20, 24].map(|at| u32_at(bytes, at));
    let (width, height) = (width.ok_or_else(cut)?, height.ok_or_else(cut)?);
    let (layers, faces) = (u32_at(bytes, 32).ok_or_else(cut)?, u32_at(bytes, 36).ok_or_else(cut)?);
    if layers > 1 || faces != 1 {
        return Err(fault("it is an array or a cube"));
    }
    if !(1..=MAX_SIDE).contains(&width) || !(1..=MAX_SIDE).contains(&height) {
        return Err(fault("its size is out of range"));
    }
    let count = u64::from(width) * u64::from(height);
    // Blocks and texels.
    budget.take_bytes(count * 6)?;
    let plain = match u32_at(bytes, 44) {
        Some(ZSTANDARD) => Cow::Owned(unpack(bytes, count).map_err(fault)?),
        _ => Cow::Borrowed(bytes),
    };
    let texels = transcode(&plain)?;
    let rgba: Vec<[u8; 4]> = texels.chunks_exact(4).map(|texel| [texel[0], texel[1], texel[2], texel[3]]).collect();
    if rgba.len() as u64 != count {
        return Err(fault("it has too few texels"));
    }
    Ok(Texels { width, height, rgba })
}

/// Red, green, blue and alpha of the largest level.
#[cfg(feature = "basis")]
fn transcode(plain: &[u8]) -> Result<Vec<u8>, Fault> {
    use basisu::{DecodeFlags, TargetFormat, Transcoder};
    let failed = |error: basisu::Error| Fault::new(KIND, format!("{error:?}"));
    let transcoder = Transcoder::new(plain).map_err(failed)?;
    transcoder.transcode(0, TargetFormat::Rgba32, DecodeFlags::NONE).map_err(failed)
}

#[cfg(not(feature = "basis"))]
fn transcode(_: &[u8]) -> Result<Vec<u8>, Fault> {
    Err(Fault::left_out("basis"))
}

/// The file with its first level unpacked and no others.
fn unpack(bytes: &[u8], texels: u64) -> Result<Vec<u8>, &'static str> {
    let cut = "it is cut short";
    let word = |at: usize| u64_at(bytes, at);
    let range = |start: u64, length: u64| {
        let start = usize::try_from(start).ok()?;
        bytes.get(start..start.checked_add(usize::try_from(length).ok()?)?)
    };
    let (offset, length) = (word(HEADER_BYTES).ok_or(cut)?, word(HEADER_BYTES + 8).ok_or(cut)?);
    let unpacked_length = word(HEADER_BYTES + 16).ok_or(cut)?;
    // UASTC has one byte a texel, and whole blocks at the borders.
    if unpacked_length > (texels + 4096) * 4 {
        return Err("its unpacked size is wrong");
    }
    let packed = range(offset, length).ok_or(cut)?;
    let descriptor = range(u32_at(bytes, 48).ok_or(cut)?.into(), u32_at(bytes, 52).ok_or(cut)?.into()).ok_or(cut)?;
    let mut level = Vec::new();
    let decoder = ruzstd::decoding::StreamingDecoder::new(packed).map_err(|_| "its Zstandard data is damaged")?;
    decoder.take(unpacked_length).read_to_end(&mut level).map_err(|_| "its Zstandard data is damaged")?;
    let mut plain = bytes.get(..HEADER_BYTES).ok_or(cut)?.to_vec();
    let level_start = HEADER_BYTES + LEVEL_BYTES + descriptor.len();
    let padding = level_start.next_multiple_of(16) - level_start;
    let mut put = |at: usize, value: u32| {
        if let Some(place) = plain.get_mut(at..at + 4) {
            place.copy_from_slice(&value.to_le_bytes());
        }
    };
    put(40, 1);
    put(44, 0);
    put(48, (HEADER_BYTES + LEVEL_BYTES) as u32);
    // No key-values and no global data.
    (56..80).step_by(4).for_each(|at| put(at, 0));
    let place = [level_start + padding, level.len(), level.len()];
    plain.extend(place.iter().flat_map(|value| (*value as u64).to_le_bytes()));
    plain.extend(descriptor);
    plain.extend(std::iter::repeat_n(0, padding));
    plain.extend(level);
    Ok(plain)
}
