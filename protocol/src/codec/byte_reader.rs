//! Sequential reading of little-endian values from a byte slice.

use crate::error::DecodeError;

/// A cursor over bytes. Every read fails with [`DecodeError::Truncated`] if too few bytes remain.
#[derive(Debug, Clone)]
pub struct ByteReader<'a> {
    remaining: &'a [u8],
    total_bytes: usize,
}

impl<'a> ByteReader<'a> {
    /// A cursor at the start of `bytes`.
    pub fn new(bytes: &'a [u8]) -> Self {
        Self { remaining: bytes, total_bytes: bytes.len() }
    }

    /// Reads `n` bytes.
    pub fn take(&mut self, n: usize) -> Result<&'a [u8], DecodeError> {
        let (head, tail) = self.remaining.split_at_checked(n).ok_or(DecodeError::Truncated {
            wanted: (self.total_bytes - self.remaining.len()).saturating_add(n),
            found: self.total_bytes,
        })?;
        self.remaining = tail;
        Ok(head)
    }

    /// Reads `N` bytes.
    pub fn array<const N: usize>(&mut self) -> Result<[u8; N], DecodeError> {
        let mut out = [0; N];
        out.copy_from_slice(self.take(N)?);
        Ok(out)
    }

    /// Reads a byte.
    pub fn u8(&mut self) -> Result<u8, DecodeError> {
        Ok(self.array::<1>()?[0])
    }

    /// Reads a u16.
    pub fn u16(&mut self) -> Result<u16, DecodeError> {
        Ok(u16::from_le_bytes(self.array()?))
    }

    /// Reads a u32.
    pub fn u32(&mut self) -> Result<u32, DecodeError> {
        Ok(u32::from_le_bytes(self.array()?))
    }

    /// Reads an f32. Fails also if it is not finite.
    pub fn f32(&mut self) -> Result<f32, DecodeError> {
        let v = f32::from_le_bytes(self.array()?);
        if v.is_finite() { Ok(v) } else { Err(DecodeError::Invalid("a number is not finite")) }
    }

    /// Reads a number written by [`push`](super::varint::push). Fails also if it has more than 32 bits.
    pub fn varint(&mut self) -> Result<u32, DecodeError> {
        let mut v = 0u64;
        for shift in [0, 7, 14, 21, 28] {
            let byte = self.u8()?;
            v |= u64::from(byte & 0x7f) << shift;
            if byte < 0x80 {
                return u32::try_from(v).map_err(|_| DecodeError::Invalid("a varint has more than 32 bits"));
            }
        }
        Err(DecodeError::Invalid("a varint has more than 32 bits"))
    }

    /// Reads a number written by [`push64`](super::varint::push64). Fails also if it has more than 64 bits.
    pub fn varint64(&mut self) -> Result<u64, DecodeError> {
        let mut v = 0;
        for shift in (0..64).step_by(7) {
            let byte = self.u8()?;
            let digits = u64::from(byte & 0x7f);
            if shift == 63 && digits > 1 {
                break;
            }
            v |= digits << shift;
            if byte < 0x80 {
                return Ok(v);
            }
        }
        Err(DecodeError::Invalid("a varint has more than 64 bits"))
    }

    /// Reads a count of `what` as [`Self::varint64`] does. Fails also if it is above `limit`.
    pub fn count(&mut self, what: &'static str, limit: usize) -> Result<usize, DecodeError> {
        let found = self.varint64()?;
        if found > limit as u64 {
            return Err(DecodeError::Limit { what, found, limit: limit as u64 });
        }
        Ok(found as usize)
    }

    /// All remaining bytes.
    pub fn rest(self) -> &'a [u8] {
        self.remaining
    }

    /// Fails if bytes remain.
    pub fn finish(self) -> Result<(), DecodeError> {
        if self.remaining.is_empty() { Ok(()) } else { Err(DecodeError::TrailingBytes(self.remaining.len())) }
    }
}
