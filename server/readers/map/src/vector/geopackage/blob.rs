//! A geometry: a header with an optional extent, then WKB.

use crate::vector::geometry::{Geometry, MALFORMED};
use crate::vector::wkb;

const MAGIC: [u8; 2] = *b"GP";
const FIXED_BYTES: usize = 8;
const FLAG_LITTLE_ENDIAN: u8 = 1;
const FLAG_EMPTY: u8 = 1 << 4;
const FLAG_EXTENDED: u8 = 1 << 5;

/// Numbers of the extent by its code in the flags; `None` if the code is not valid.
fn extent_numbers(flags: u8) -> Option<usize> {
    match flags >> 1 & 7 {
        0 => Some(0),
        1 => Some(4),
        2 | 3 => Some(6),
        4 => Some(8),
        _ => None,
    }
}

/// Reads the geometry. Fails with the reason for skipping the feature.
pub(super) fn geometry(bytes: &[u8]) -> Result<Geometry, &'static str> {
    let (header, rest) = bytes.split_at_checked(FIXED_BYTES).ok_or(MALFORMED)?;
    let flags = header[3];
    if header[..2] != MAGIC {
        return Err(MALFORMED);
    }
    if flags & FLAG_EXTENDED != 0 {
        return Err("geometry of an extension of GeoPackage");
    }
    let wkb = rest.get(extent_numbers(flags).ok_or(MALFORMED)? * 8..).ok_or(MALFORMED)?;
    let mut geometry = Geometry::default();
    if flags & FLAG_EMPTY == 0 {
        wkb::parse(wkb, &mut geometry)?;
    }
    Ok(geometry)
}

/// West, south, east and north as the header gives them; `None` if it does not.
pub(super) fn bounds(bytes: &[u8]) -> Option<[f64; 4]> {
    let (header, rest) = bytes.split_at_checked(FIXED_BYTES)?;
    let flags = header[3];
    if header[..2] != MAGIC || extent_numbers(flags)? < 4 {
        return None;
    }
    let is_little_endian = flags & FLAG_LITTLE_ENDIAN != 0;
    let number = |index: usize| {
        let bytes = *rest.get(index * 8..)?.first_chunk::<8>()?;
        Some(if is_little_endian { f64::from_le_bytes(bytes) } else { f64::from_be_bytes(bytes) })
    };
    Some([number(0)?, number(2)?, number(1)?, number(3)?])
}
